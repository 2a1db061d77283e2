"""Identical frames: a frame with the measures of another mirror's frame is a mirror's, too.

A glass may show next to nothing: what is in it lies beyond the camera's reach, or the person hides their own image.
Then only the frame is evidence. Mirrors of a rig are mostly bought together, and a frame that has, to the pixel, the
size and the bars of a known mirror's, and stands at the same height, is unlikely to be a door's, a window's or a
screen's.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ..camera import RgbdImage, project
from ..mirrors import Mirror
from ..mirrors.disparity_plane import disparity_of_plane
from ..mirrors.frame_sides import frame_sides
from ..mirrors.glass_extent import at_border
from ..mirrors.mirror import behind_glass
from .edge_segments import DetectionSettings
from .framed_mirrors import depth_without_frames, ends_without_edge, fit_to_frame
from .mirror_verification import (
    LEAST_SHOWN,
    WHOLE_EDGE,
    count_evidence,
    doubtful,
    floor_drop_of_points,
    frame_edge_share,
    missing_reflection,
    sampled_points,
)
from .rectangle_hypotheses import Hypothesis

_NOISE_SHARE = 0.02  # of a glass so much may be read in its plane, and of that so much make no sense, by noise


def find_identical_frames(
    image: RgbdImage,
    proposed: list[Hypothesis],
    found: list[Mirror],
    glass_offset: float,
    bare: np.ndarray,
    settings: DetectionSettings,
) -> list[Mirror]:
    """Mirrors that show next to nothing, but have frames identical to those of the mirrors ``found``.

    ``bare`` is the depth without the latter.
    """
    intrinsics = image.intrinsics
    if not found and settings.empty_rig:
        found = _pair(image, proposed, glass_offset)
        bare = depth_without_frames(image.with_depth(bare), found, glass_offset)
        return found + (find_identical_frames(image, proposed, found, glass_offset, bare, settings) if found else [])
    if not found:
        return []
    asked, points = [], sampled_points(image)
    for guess in _uncovered(proposed, found):
        edge, _ = _unopposed(image, guess, points, found)
        if edge > 0.0:
            asked.append((len(guess.sides), edge, guess))
    asked.sort(key=lambda one: one[:2], reverse=True)
    makes = [
        measure_frame(image, replace(m, point=m.point + glass_offset * m.normal))
        for m in (found if asked else ())
        if not doubtful(image, m)
    ]
    new: list[Mirror] = []
    for _, _, guess in asked:
        if len(found) + len(new) == settings.max_mirrors or not _uncovered([guess], new):
            continue
        fitted = fit_to_frame(image.with_depth(bare), guess)
        if fitted is None or missing_reflection(image, fitted):
            continue
        final = replace(guess, point=fitted.point, basis=fitted.basis)
        edge, shown = _unopposed(image, final, points, found)
        mine = measure_frame(image, fitted)
        if edge > 0.0 and any(same_make(mine, make, shown >= min(LEAST_SHOWN)) for make in makes):
            behind = replace(fitted, point=fitted.point - glass_offset * fitted.normal)
            new.append(at_border(behind, intrinsics, ends_without_edge(guess)))
            bare = depth_without_frames(image.with_depth(bare), new[-1:], glass_offset)
    return new


def _pair(image: RgbdImage, proposed: list[Hypothesis], glass_offset: float) -> list[Mirror]:
    """Two mirrors of an empty rig in which nothing is read, confirmed by each other; or none."""
    intrinsics = image.intrinsics
    points, asked = sampled_points(image), []
    for guess in proposed:
        if len(guess.sides) == 4 and _unopposed(image, guess, points, ())[0] > 0.0:
            fitted = fit_to_frame(image, guess)
            if fitted is not None:
                behind = replace(fitted, point=fitted.point - glass_offset * fitted.normal)
                asked.append(
                    (
                        guess,
                        at_border(behind, intrinsics, ends_without_edge(guess)),
                        measure_frame(image, fitted),
                    )
                )
    for k, (_, one, mine) in enumerate(asked):
        for guess, other, its in asked[:k]:
            if is_pair(mine, its) and _uncovered([guess], [one]):
                return [other, one]
    return []


def _uncovered(guesses: list[Hypothesis], mirrors: list[Mirror]) -> list[Hypothesis]:
    """Those of which no more than half is where rectangles of mirrors are in the picture."""
    share = np.linspace(0.0, 1.0, 7)
    x, y = (part.ravel() for part in np.meshgrid(share, share))
    points = []
    for guess in guesses:
        (left, right), (top, bottom) = guess.rectangle
        at = np.column_stack((left + x * (right - left), top + y * (bottom - top)))
        points.append(guess.point + at @ guess.basis[:, :2].T)
    if not points:
        return []
    hidden = behind_glass(np.concatenate(points), mirrors, nearest=np.inf).reshape(len(guesses), -1)
    return [guess for guess, part in zip(guesses, hidden.mean(axis=1), strict=True) if part <= 0.5]


def _unopposed(image: RgbdImage, guess: Hypothesis, points: np.ndarray, known: Iterable[Mirror]) -> tuple[float, float]:
    """Share of the frame's edge that is seen, 0 when something speaks against a mirror; and how many readings it shows.

    Against it speak other objects in the rectangle's plane and free-space violations. The share is that of
    :func:`.mirror_verification.frame_edge_share`; ``points`` as for
    :func:`.mirror_verification.floor_drop_of_points`.
    """
    evidence = count_evidence(image, guess, floor_drop_of_points(points, guess.basis))
    glass = evidence.unread + evidence.behind
    if glass < 60 or evidence.on > _NOISE_SHARE * glass or evidence.violated > max(_NOISE_SHARE * evidence.behind, 3.0):
        return 0.0, 0.0
    edge = frame_edge_share(image, guess, 0.2, known)
    return (edge if edge > WHOLE_EDGE else 0.0), evidence.shown


_BAR_PIXELS = 1.5  # to which bars are known
_SIZE_ERROR = 0.002  # by how much identical frames may differ, besides a pixel
_LEAST_BAR = 0.008  # bars are at least so wide [m]
_BARS_SEEN = 2  # of a frame have to be seen
_LEAST_SINE = 0.2  # sine of the angle between two frames from which the vertical is known
_LEVEL_ERROR = 0.005  # share of the distance between two frames by which the vertical may be off there


@dataclass(frozen=True)
class FrameMeasures:
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


def measure_frame(image: RgbdImage, mirror: Mirror) -> FrameMeasures:
    """The measures of a frame, whose plane is ``mirror``'s and whose ``rectangle`` is about right.

    Parameters
    ----------
    image : RgbdImage
        z [m], 0 = no reading.
    """
    depth, intrinsics = image.depth, image.intrinsics
    assert mirror.rectangle is not None
    z = float(mirror.point[2])
    tolerance = min(max(4.0 * mirror.residual, 0.004), 0.02 * z) / z**2
    plane = disparity_of_plane(mirror.normal, float(mirror.normal @ mirror.point), intrinsics)
    inner, outer, _, turn = frame_sides(
        depth, intrinsics.packed, plane, tolerance, mirror.point, mirror.basis, mirror.rectangle
    )
    a, b, _ = mirror.basis.T
    middle = mirror.rectangle.mean(axis=1)
    edges = mirror.point + middle[0] * a + inner[1][:, None] * b
    ends = mirror.point + np.stack((outer[0][:, None] * a + middle[1] * b, middle[0] * a + outer[1][:, None] * b))
    size = np.array((intrinsics.width, intrinsics.height)) - 1
    cut = ~((project(ends, intrinsics) > 2) & (project(ends, intrinsics) < size - 2)).all(axis=-1)
    across = np.cos(turn) * a + np.sin(turn) * b
    pixel = z / (0.5 * (intrinsics.fx + intrinsics.fy))
    return FrameMeasures(inner[:, 1] - inner[:, 0], np.abs(outer - inner), cut, edges, across, pixel)


def same_make(new: FrameMeasures, known: FrameMeasures, shows: bool = False) -> bool:
    """Whether the frames are identical: bars of the same width, except for one, which may be partly hidden.

    Width and height are the same, as far as they are seen of both. Where they are not, the frames must stand level, and
    where neither is, it must be known that the new one ``shows`` what a mirror would.
    """
    pixel = max(new.pixel, known.pixel)
    bars, whole = np.isfinite(new.bars), (known.bars > _LEAST_BAR) & ~known.cut  # false where NaN
    if not whole.any():
        return False
    wider = new.bars - np.median(known.bars[whole])
    alike = (np.abs(wider) < _BAR_PIXELS * pixel) | (new.cut & (wider < 0.0))
    if (alike & bars).sum() < max(_BARS_SEEN, bars.sum() - 1):
        return False
    difference = np.abs(new.size - known.size)
    seen = np.isfinite(difference)
    if (difference[seen] > _SIZE_ERROR * known.size[seen] + pixel).any():
        return False
    return bool(seen.all() or ((seen.any() or shows) and _level(new, known, pixel)))


def is_pair(one: FrameMeasures, other: FrameMeasures) -> bool:
    """Whether two frames are identical in every measure, stand level and face different ways.

    Mirrors of a rig do; windows of a wall do not.
    """
    seen = np.isfinite(one.size) & np.isfinite(other.size)
    return bool(seen.all()) and same_make(one, other) and _level(one, other, max(one.pixel, other.pixel))


def _level(one: FrameMeasures, other: FrameMeasures, pixel: float) -> bool:
    """Whether tops or bottoms are at one height: across what is level in both planes, however they lean."""
    up = np.cross(one.across, other.across)
    sine = np.linalg.norm(up)
    if sine < _LEAST_SINE:
        return False
    way = other.edges - one.edges
    rise = np.abs(way @ up) / sine - _LEVEL_ERROR * np.linalg.norm(way, axis=1)
    return bool((rise < pixel).any())
