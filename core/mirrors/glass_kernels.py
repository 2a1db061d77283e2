"""What kernels share: where a ray meets a mirror's glass, and the reflection of what it shows.

:func:`glass_of` packs mirrors into a :class:`Glass`, a tuple of flat arrays that any kernel may take as an argument;
the other functions here are called from kernels, with it and a mirror's index.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..numeric.kernels import njit
from .glass_extent import glass_corners
from .mirror import Mirror, reflection_matrix

NEVER = 2.0
"""What :func:`crossing` returns for a path that does not pass the glass: more than the whole path, 1."""

NEAREST = 0.3
"""A point that would be seen nearer than this is not looked up [m]: no depth camera reads there, and which pixel
sees it is uncertain."""

_ALONG = -1e-6  # a ray that nears a plane by less, a metre of z, runs along it


class Glass(NamedTuple):
    """The glass of M mirrors, for kernels; camera frame.

    Attributes
    ----------
    planes : np.ndarray [shape=(M, 4)]
        Unit normal n towards the camera and offset d, n·p = d [m].
    axes : np.ndarray [shape=(M, 2, 3)]
        The mirrors' a and b, see :class:`.mirror.Mirror`.
    middles : np.ndarray [shape=(M, 2)]
        The mirrors' points along a and b [m].
    limits : np.ndarray [shape=(M, 2, 2)]
        The glass's box about the point, ((a_min, a_max), (b_min, b_max)) [m]; infinite when it is unlimited.
    corners : np.ndarray [shape=(M, K, 2)]
        Corners of the glass along a and b about the point [m], the first ``sides`` of each row.
    sides : np.ndarray [shape=(M,), dtype=int64]
        How many corners; 0 = unlimited.
    flips : np.ndarray [shape=(M, 4, 4)]
        :func:`.mirror.reflection_matrix`.
    """

    planes: np.ndarray
    axes: np.ndarray
    middles: np.ndarray
    limits: np.ndarray
    corners: np.ndarray
    sides: np.ndarray
    flips: np.ndarray


def glass_of(mirrors: Sequence[Mirror]) -> Glass:
    """The glass of mirrors (M), in their order, for kernels."""
    count = len(mirrors)
    outlines = [glass_corners(m) for m in mirrors]
    most = max((len(p) for p in outlines if p is not None), default=1)
    glass = Glass(
        np.empty((count, 4)),
        np.empty((count, 2, 3)),
        np.empty((count, 2)),
        np.empty((count, 2, 2)),
        np.zeros((count, most, 2)),
        np.zeros(count, np.int64),
        np.empty((count, 4, 4)),
    )
    for k, (m, outline) in enumerate(zip(mirrors, outlines, strict=True)):
        glass.planes[k, :3], glass.planes[k, 3] = m.normal, m.normal @ m.point
        glass.axes[k] = m.basis[:, :2].T
        glass.middles[k] = glass.axes[k] @ m.point
        glass.limits[k] = -np.inf, np.inf
        glass.flips[k] = reflection_matrix(m)
        if outline is not None:
            glass.limits[k, :, 0], glass.limits[k, :, 1] = outline.min(axis=0), outline.max(axis=0)
            glass.corners[k, : len(outline)] = outline
            glass.sides[k] = len(outline)
    return glass


@njit(cache=True, nogil=True, error_model="numpy")
def before_plane(glass, k, x, y, z):
    """How far a point is in front of the plane of mirror k, on the camera's side [m]; negative behind it."""
    return glass.planes[k, 0] * x + glass.planes[k, 1] * y + glass.planes[k, 2] * z - glass.planes[k, 3]


@njit(cache=True, nogil=True, error_model="numpy")
def place_on_plane(glass, k, x, y, z):
    """Where a point on the plane of mirror k is along its a and b, about its point [m]."""
    axes = glass.axes
    a = axes[k, 0, 0] * x + axes[k, 0, 1] * y + axes[k, 0, 2] * z - glass.middles[k, 0]
    b = axes[k, 1, 0] * x + axes[k, 1, 1] * y + axes[k, 1, 2] * z - glass.middles[k, 1]
    return a, b


@njit(cache=True, nogil=True, error_model="numpy")
def in_box(boxes, k, a, b, margin):
    """Whether a place is in box k of ``boxes`` (M, 2, 2) by ``margin`` [m]; a negative margin widens the box.

    A box is ((a_min, a_max), (b_min, b_max)).
    """
    return (
        boxes[k, 0, 0] + margin <= a
        and a <= boxes[k, 0, 1] - margin
        and boxes[k, 1, 0] + margin <= b
        and b <= boxes[k, 1, 1] - margin
    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def in_glass(glass, k, a, b):
    """Whether a place on the plane of mirror k, along its a and b, is on its glass."""
    sides, corners = glass.sides[k], glass.corners
    if sides == 0:
        return True
    if not in_box(glass.limits, k, a, b, 0.0):
        return False
    inside = False
    j = sides - 1
    for i in range(sides):  # even-odd rule
        bi, bj = corners[k, i, 1], corners[k, j, 1]
        if (bi > b) != (bj > b):
            if a < (corners[k, j, 0] - corners[k, i, 0]) * (b - bi) / (bj - bi) + corners[k, i, 0]:
                inside = not inside
        j = i
    return inside


@njit(cache=True, nogil=True, error_model="numpy")
def share_at_plane(glass, k, x, y, z):
    """At which share of the path from the camera to (x, y, z), and beyond, the plane of mirror k is met.

    Inf when it is not. Along a pixel's ray (x, y, 1) that is the plane's z [m].
    """
    along = glass.planes[k, 0] * x + glass.planes[k, 1] * y + glass.planes[k, 2] * z
    return glass.planes[k, 3] / along if along < _ALONG else np.inf


@njit(cache=True, nogil=True, error_model="numpy")
def share_at_glass(glass, k, x, y, z, margin):
    """:func:`share_at_plane` where that is in the box of the glass by ``margin`` [m]; else inf."""
    # share_at_plane and place_on_plane written out: as calls they took kernels that ask every pixel three times as long
    planes, axes, middles, limits = glass.planes, glass.axes, glass.middles, glass.limits
    along = planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z
    if along >= _ALONG:
        return np.inf
    share = planes[k, 3] / along
    x, y, z = share * x, share * y, share * z
    a = axes[k, 0, 0] * x + axes[k, 0, 1] * y + axes[k, 0, 2] * z - middles[k, 0]
    b = axes[k, 1, 0] * x + axes[k, 1, 1] * y + axes[k, 1, 2] * z - middles[k, 1]
    return share if in_box(limits, k, a, b, margin) else np.inf


@njit(cache=True, nogil=True, error_model="numpy")
def crossing(glass, k, origin, target, margin):
    """Share of the path from ``origin`` (3,) to ``target`` (3,) at which it passes the glass of mirror k.

    :data:`NEVER` when it does not, or when the target is less than ``margin`` [m] behind the plane.
    """
    start = before_plane(glass, k, origin[0], origin[1], origin[2])
    stop = before_plane(glass, k, target[0], target[1], target[2])
    if start <= 0 or stop >= -margin:
        return NEVER
    t = start / (start - stop)
    a, b = place_on_plane(
        glass,
        k,
        origin[0] + t * (target[0] - origin[0]),
        origin[1] + t * (target[1] - origin[1]),
        origin[2] + t * (target[2] - origin[2]),
    )
    return t if in_glass(glass, k, a, b) else NEVER


@njit(cache=True, nogil=True, error_model="numpy")
def reflected(glass, k, x, y, z):
    """A point over the plane of mirror k: x, y, z [m]."""
    f = glass.flips
    return (
        f[k, 0, 0] * x + f[k, 0, 1] * y + f[k, 0, 2] * z + f[k, 0, 3],
        f[k, 1, 0] * x + f[k, 1, 1] * y + f[k, 1, 2] * z + f[k, 1, 3],
        f[k, 2, 0] * x + f[k, 2, 1] * y + f[k, 2, 2] * z + f[k, 2, 3],
    )


@njit(cache=True, nogil=True, error_model="numpy")
def reflected_direction(glass, k, x, y, z):
    """A direction, such as a normal, over the plane of mirror k."""
    f = glass.flips
    return (
        f[k, 0, 0] * x + f[k, 0, 1] * y + f[k, 0, 2] * z,
        f[k, 1, 0] * x + f[k, 1, 1] * y + f[k, 1, 2] * z,
        f[k, 2, 0] * x + f[k, 2, 1] * y + f[k, 2, 2] * z,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def nearest_pixel(x, y, z, intrinsics):
    """Column and row of the pixel that sees a point in front of the camera; ``intrinsics`` = fx, fy, cx, cy [px]."""
    return int(np.rint(x / z * intrinsics[0] + intrinsics[2])), int(np.rint(y / z * intrinsics[1] + intrinsics[3]))
