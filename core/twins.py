"""Mirrors of one make: a frame that measures what that of another mirror does.

A glass may show next to nothing: what is in it lies beyond the camera's reach, or the person hides his own image. Then
only the frame can speak for it. Mirrors of a rig are mostly bought together, and a frame that has, to the pixel, the
size and the bars of one that holds a mirror, and stands as high, is hardly a door's, a window's or a screen's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .camera import Intrinsics, project
from .mirrors import Mirror
from .mirrors.disparity_plane import disparity_of_plane
from .mirrors.frame_sides import frame_sides

_PIXELS = 1.5  # to which bars are known
_SIZE = 0.002  # by how much frames of one make may differ, besides a pixel
_LEAST = 0.008  # bars are at least so wide [m]
_BARS = 2  # of a frame have to be seen
_APART = 0.2  # sine of the angle between two frames that tells what is upright
_LEVEL = 0.005  # share of the distance between two frames by which what is upright may err there


@dataclass(frozen=True)
class Measures:
    """What a frame measures [m]; NaN where that is not seen.

    ``size`` (2,): from inner edge to inner edge along the mirror's a and b. ``bars`` (2, 2): their widths, placed as in
    :attr:`.mirror.Mirror.rectangle`, 0 where a wall goes on in their plane; ``cut`` (2, 2): where the image's border
    cuts them off. ``edges`` (2, 3): middles of the inner edges at the top and at the bottom, which run along ``across``
    (3,). ``pixel``: the size of one at its distance.
    """

    size: np.ndarray
    bars: np.ndarray
    cut: np.ndarray
    edges: np.ndarray
    across: np.ndarray
    pixel: float


def measures(mirror: Mirror, depth: np.ndarray, intrinsics: Intrinsics) -> Measures:
    """The measures of a frame, whose plane is ``mirror``'s and whose ``rectangle`` is about right.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    """
    z = float(mirror.point[2])
    tolerance = min(max(4.0 * mirror.residual, 0.004), 0.02 * z) / z**2
    plane = disparity_of_plane(mirror.normal, float(mirror.normal @ mirror.point), intrinsics)
    inner, outer, _, turn = frame_sides(
        depth, intrinsics.lens, plane, tolerance, mirror.point, mirror.basis, mirror.rectangle
    )
    a, b, _ = mirror.basis.T
    middle = mirror.rectangle.mean(axis=1)
    edges = mirror.point + middle[0] * a + inner[1][:, None] * b
    ends = mirror.point + np.stack((outer[0][:, None] * a + middle[1] * b, middle[0] * a + outer[1][:, None] * b))
    size = np.array((intrinsics.width, intrinsics.height)) - 1
    cut = ~((project(ends, intrinsics) > 2) & (project(ends, intrinsics) < size - 2)).all(axis=-1)
    across = np.cos(turn) * a + np.sin(turn) * b
    pixel = z / (0.5 * (intrinsics.fx + intrinsics.fy))
    return Measures(inner[:, 1] - inner[:, 0], np.abs(outer - inner), cut, edges, across, pixel)


def one_make(new: Measures, known: Measures, shows: bool = False) -> bool:
    """Bars are as wide as each other, but for one, part of which may be hidden; width and height are the same, as far
    as they are seen of both. Where they are not, the frames must stand level, and where neither is, it must be known
    that the new one ``shows`` what a mirror would."""
    pixel = max(new.pixel, known.pixel)
    bars, whole = np.isfinite(new.bars), (known.bars > _LEAST) & ~known.cut  # false where NaN
    if not whole.any():
        return False
    wider = new.bars - np.median(known.bars[whole])
    alike = (np.abs(wider) < _PIXELS * pixel) | (new.cut & (wider < 0.0))
    if (alike & bars).sum() < max(_BARS, bars.sum() - 1):
        return False
    apart = np.abs(new.size - known.size)
    seen = np.isfinite(apart)
    if (apart[seen] > _SIZE * known.size[seen] + pixel).any():
        return False
    return bool(seen.all() or ((seen.any() or shows) and _level(new, known, pixel)))


def a_pair(one: Measures, other: Measures) -> bool:
    """Frames of one make in every measure that stand level and face different ways, as mirrors of a rig do and windows
    of a wall do not."""
    seen = np.isfinite(one.size) & np.isfinite(other.size)
    return bool(seen.all()) and one_make(one, other) and _level(one, other, max(one.pixel, other.pixel))


def _level(one: Measures, other: Measures, pixel: float) -> bool:
    """Whether tops or bottoms are at one height: across what is level in both planes, however they lean."""
    up = np.cross(one.across, other.across)
    sine = np.linalg.norm(up)
    if sine < _APART:
        return False
    way = other.edges - one.edges
    rise = np.abs(way @ up) / sine - _LEVEL * np.linalg.norm(way, axis=1)
    return bool((rise < pixel).any())
