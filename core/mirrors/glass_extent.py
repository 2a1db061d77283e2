"""How far a glass reaches: its rectangle or outline on the plane, and what the image border cuts off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..camera import Intrinsics, RgbdImage, project
from .disparity_plane import DisparityPlane
from .frame_sides import frame_sides
from .mirror import PAST_BORDER, Mirror, oriented


def with_measured_sides(
    image: RgbdImage, mirror: Mirror, frame: np.ndarray, picked: np.ndarray, drawn: np.ndarray, fitted: DisparityPlane
) -> Mirror:
    """The mirror rotated as its frame is, with the rectangle that this encloses.

    Parameters
    ----------
    frame, picked : np.ndarray [shape=(K, 3)]
        The frame's points, and the picks that lie on the plane [m].
    drawn : np.ndarray [shape=(K, 3)]
        All picks, where their lines of sight meet the plane [m].
    image : RgbdImage
        z [m], 0 = no reading.
    fitted : DisparityPlane
        Of the frame.

    Notes
    -----
    Each side is where the depth across it says, see :func:`.frame_sides.frame_sides`; the extent of the pixels that
    were grown, which may run on along the floor or a wall, counts only where no evidence is.
    """
    depth, intrinsics = image.depth, image.intrinsics
    plane = fitted.coefficients
    # a plane's pixels, but not what a shallow surface beside it has within a hand's breadth
    tolerance = 4.0 * np.hypot(fitted.scale, np.sqrt(fitted.common))
    tolerance = min(max(tolerance, 0.004 / mirror.point[2] ** 2), 0.02 / mirror.point[2])
    thin = frame[:: len(frame) // 6000 + 1]
    rectangle = _extent(thin, picked, drawn, mirror)[0]
    for _ in range(3):
        inner, outer, cut, turn = frame_sides(
            depth, intrinsics.packed, plane, tolerance, mirror.point, mirror.basis, rectangle
        )
        # a frame's bars are about as wide as each other: what is wider runs on along the floor or a wall
        width = np.abs(outer - inner)
        least = np.nanmin(width) if np.isfinite(width).sum() > 1 else np.inf
        outer = inner + np.sign(outer - inner) * np.minimum(width, 1.5 * least + 0.005)
        place = (picked - mirror.point) @ mirror.basis[:, :2]
        within = np.column_stack((outer[:, 0] - place.min(axis=0), place.max(axis=0) - outer[:, 1]))
        known = within < _SHORT_OF_PICKS  # false where NaN
        rectangle = np.where(known, outer, rectangle)
        if abs(turn) < 2.5e-3:
            break
        down = mirror.basis[:, 1] - np.tan(turn) * mirror.basis[:, 0]
        mirror = replace(mirror, basis=oriented(mirror.normal, mirror.point, down)[1])
    if not known.all():
        extent, wall = _extent(thin, picked, drawn, mirror)
        rectangle = np.where(known, rectangle, extent)
        cut = (cut & ~wall) | _cut_off(frame, mirror, rectangle, intrinsics, ~known & ~wall)
    return at_border(replace(mirror, rectangle=rectangle), intrinsics, ~known, cut & ~known)


def _extent(frame: np.ndarray, picked: np.ndarray, drawn: np.ndarray, mirror: Mirror) -> tuple[np.ndarray, np.ndarray]:
    """Extent of the frame along the mirror's right and down axes, about its point.

    Rows (min, max) [m]; and on which sides (2, 2) a wall goes on in its plane: there only the picks, as ``drawn`` on
    the plane, say how far it goes.
    """
    grown = (frame - mirror.point) @ mirror.basis[:, :2]
    picks = (picked - mirror.point) @ mirror.basis[:, :2]
    top, bottom = np.quantile(grown[:, 1], (0.002, 0.998))
    # near the floor the flood may run along the line where floor and plane meet: the width is read above it
    upper = grown[grown[:, 1] < top + 0.7 * (bottom - top)]
    extent = np.array((np.quantile(upper[:, 0], (0.005, 0.995)), (top, bottom)))
    said = np.column_stack((picks.min(axis=0), picks.max(axis=0)))
    wall = np.zeros((2, 2), np.bool_)
    for axis in range(2):
        for end, sign in ((0, -1.0), (1, 1.0)):
            start = sign * said[axis, end] + _FRAME_WIDTH / 2
            far = sign * extent[axis, end] - start
            if far > _FRAME_WIDTH / 2:
                # a frame that goes on past the picks stays a narrow band, a wall is a surface
                beyond = grown[sign * grown[:, axis] > start]
                cells = np.floor(beyond / _SURFACE_CELL).astype(np.int64)
                filled = len(np.unique(cells[:, 0] * 100_003 + cells[:, 1])) * _SURFACE_CELL**2
                wall[axis, end] = filled > 0.5 * far * (said[1 - axis, 1] - said[1 - axis, 0])
    marks = (drawn - mirror.point) @ mirror.basis[:, :2]
    clipped = np.column_stack((marks.min(axis=0) - _PAST_PICKS, marks.max(axis=0) + _PAST_PICKS))
    outer = np.column_stack((np.minimum(extent[:, 0], said[:, 0]), np.maximum(extent[:, 1], said[:, 1])))
    return np.where(wall, clipped, outer), wall


def with_rectangle(mirror: Mirror, frame: np.ndarray, picked: np.ndarray, intrinsics: Intrinsics) -> Mirror:
    """The mirror with the bounding rectangle of its frame as its glass, and that rectangle's corners in pixels.

    Parameters
    ----------
    frame, picked : np.ndarray [shape=(K, 3)]
        The frame's points, and the picks that lie on the plane [m].

    Notes
    -----
    A side that lies at the image's border, or beyond it, is cut off by it: the glass goes on there.
    """
    rectangle, wall = _extent(frame, picked, picked, mirror)
    cut = _cut_off(frame, mirror, rectangle, intrinsics, ~wall)
    return at_border(replace(mirror, rectangle=rectangle), intrinsics, cut=cut)


def _cut_off(
    frame: np.ndarray, mirror: Mirror, rectangle: np.ndarray, intrinsics: Intrinsics, asked: np.ndarray
) -> np.ndarray:
    """Which sides of the rectangle (2, 2) bool, of those ``asked`` for, the image's border cuts off.

    The frame reaches the border on that side, and has no bar along it.
    """
    pixels, middle = project(frame, intrinsics), project(mirror.point, intrinsics)
    place = (frame - mirror.point) @ mirror.basis[:, :2]
    size = np.array((intrinsics.width, intrinsics.height)) - 1
    cut = np.zeros((2, 2), np.bool_)
    for axis in range(2):
        low, high = rectangle[1 - axis]
        for end in np.flatnonzero(asked[axis]):
            at = np.empty(2)
            at[axis], at[1 - axis] = rectangle[axis, end], rectangle[1 - axis].mean()
            beyond = project(mirror.point + mirror.basis[:, :2] @ at, intrinsics)[axis] > middle[axis]
            reaches = (pixels[:, axis] > size[axis] - 2).sum() if beyond else (pixels[:, axis] < 2).sum()
            along = place[np.abs(place[:, axis] - rectangle[axis, end]) < 0.04, 1 - axis]
            cells = np.unique(np.floor(20.0 * (along - low) / max(high - low, 1e-9)))
            cut[axis, end] = reaches >= 3 and len(cells) < 8
    return cut


def at_border(
    mirror: Mirror, intrinsics: Intrinsics, open_ends: np.ndarray | None = None, cut: np.ndarray | None = None
) -> Mirror:
    """The mirror with the outline of its rectangle [px]; sides at the image's border are moved beyond it.

    ``open_ends`` (2, 2) bool, as ``rectangle``, says which ends may be cut off; by default any. ``cut`` (2, 2) bool
    says which are known to be.
    """
    rectangle = np.array(mirror.rectangle)
    margin = 0.04 * np.array((intrinsics.width, intrinsics.height))
    for axis in range(2):
        for end in range(2):
            if open_ends is not None and not open_ends[axis, end]:
                continue
            at = np.empty(2)
            at[axis], at[1 - axis] = rectangle[axis, end], rectangle[1 - axis].mean()
            pixel = project(mirror.point + mirror.basis[:, :2] @ at, intrinsics)[axis]
            size = (intrinsics.width, intrinsics.height)[axis]
            known = cut is not None and cut[axis, end]
            if known or not margin[axis] < pixel < size - 1 - margin[axis]:
                rectangle[axis, end] += (-PAST_BORDER, PAST_BORDER)[end]
    return with_outline(replace(mirror, rectangle=rectangle), intrinsics)


def with_outline(mirror: Mirror, intrinsics: Intrinsics) -> Mirror:
    """The mirror with the corners of its rectangle in pixels."""
    assert mirror.rectangle is not None
    (left, right), (top, bottom) = mirror.rectangle
    corners = np.array(((left, top), (right, top), (right, bottom), (left, bottom)))
    return replace(mirror, outline=project(mirror.point + corners @ mirror.basis[:, :2].T, intrinsics))


def glass_corners(mirror: Mirror) -> np.ndarray | None:
    """Corners (K, 2) of the glass along the mirror's a and b about its point [m]; None when it is unlimited."""
    if mirror.polygon is not None:
        return mirror.polygon
    if mirror.rectangle is None:
        return None
    (left, right), (top, bottom) = mirror.rectangle
    return np.array(((left, top), (right, top), (right, bottom), (left, bottom)))


_FRAME_WIDTH = 0.15  # more than a frame is wide [m]
_PAST_PICKS = 0.01  # about as far outside of picks on a wall a mirror ends [m]
_SURFACE_CELL = 0.03  # side of the cells by which frames and surfaces are distinguished [m]
_SHORT_OF_PICKS = 0.04  # a side that ends so far inside of picks on the plane is not the frame's [m]
