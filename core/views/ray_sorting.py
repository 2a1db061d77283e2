"""Which pixel is seen through what: directly, through which mirror, or by way of two."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange

from ..camera import Intrinsics
from ..mirrors import Mirror
from ..mirrors.mirror import reflection_matrix


def glass_corners(mirror: Mirror) -> np.ndarray | None:
    """Corners (K, 2) of the glass along the mirror's a and b about its point [m]; None when it is unlimited."""
    if mirror.polygon is not None:
        return mirror.polygon
    if mirror.rectangle is None:
        return None
    (left, right), (top, bottom) = mirror.rectangle
    return np.array(((left, top), (right, top), (right, bottom), (left, bottom)))


def glass_of_outline(mirror: Mirror, pixels: np.ndarray, intrinsics: Intrinsics) -> np.ndarray:
    """What an outline drawn in the image (K, 2) [px] is on the mirror: :attr:`.mirror.Mirror.polygon` [m]."""
    k, pixels = intrinsics, np.asarray(pixels, dtype=np.float64)
    rays = np.column_stack(((pixels[:, 0] - k.cx) / k.fx, (pixels[:, 1] - k.cy) / k.fy, np.ones(len(pixels))))
    on = rays * ((mirror.normal @ mirror.point) / (rays * mirror.normal).sum(axis=1))[:, None]
    offset = on - mirror.point
    return np.stack([(offset * mirror.basis[:, c]).sum(axis=1) for c in range(2)], axis=1)


@dataclass(frozen=True)
class Glass:
    """M mirrors as arrays for kernels: ``planes`` (M, 4) n·p = d; ``axes`` (M, 2, 3) a and b; ``centers`` (M, 3);
    ``limits`` (M, 2, 2) the polygon's box; ``corners`` (M, K, 2) padded, ``sides`` (M,) how many, 0 = unlimited;
    ``flips`` (M, 4, 4) reflections."""

    planes: np.ndarray
    axes: np.ndarray
    centers: np.ndarray
    limits: np.ndarray
    corners: np.ndarray
    sides: np.ndarray
    flips: np.ndarray


def glass_of(mirrors: list[Mirror]) -> Glass:
    count = len(mirrors)
    polygons = [glass_corners(m) for m in mirrors]
    most = max((len(p) for p in polygons if p is not None), default=1)
    glass = Glass(
        np.zeros((count, 4)),
        np.zeros((count, 2, 3)),
        np.zeros((count, 3)),
        np.tile((-np.inf, np.inf), (count, 2, 1)),
        np.zeros((count, most, 2)),
        np.zeros(count, np.int64),
        np.zeros((count, 4, 4)),
    )
    for i, (m, polygon) in enumerate(zip(mirrors, polygons, strict=True)):
        glass.planes[i, :3], glass.planes[i, 3] = m.normal, m.normal @ m.point
        glass.axes[i] = m.basis[:, :2].T
        glass.centers[i] = m.point
        glass.flips[i] = reflection_matrix(m)
        if polygon is not None:
            glass.limits[i] = np.column_stack((polygon.min(axis=0), polygon.max(axis=0)))
            glass.corners[i, : len(polygon)] = polygon
            glass.sides[i] = len(polygon)
    return glass


def sort_rays(
    points: np.ndarray, mirrors: list[Mirror], depth_limit: float = 0.0, near: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Direct or through which mirror: decided by whether a pixel's ray passes a mirror's glass before its reading.

    What stands before a mirror is seen directly; a reading behind the glass is somewhere in the room, and if the way
    from the glass to there passes another glass, it was seen by two reflections and belongs to no view.

    Parameters
    ----------
    points : np.ndarray [shape=(H, W, 3)]
        Unprojected readings, camera frame [m]; z = 0 where there is none.
    mirrors : list of Mirror
    depth_limit, near : float
        Readings with larger or smaller z are dropped [m]; 0 = no limit.

    Returns
    -------
    seen : np.ndarray [shape=(H, W), dtype=int8]
        0 direct, i through mirror i (1-based), -1 no reading, on a mirror's frame, or reflected twice.
    placed : np.ndarray [shape=(H, W, 3)]
        The readings where they really are.
    """
    g = glass_of(mirrors)
    limit = depth_limit if depth_limit > 0 else np.inf
    return _sort_kernel(points, g.planes, g.axes, g.centers, g.limits, g.corners, g.sides, g.flips, near, limit)


@njit(cache=True, nogil=True)
def in_glass(x, y, limits, corners, sides):
    """Whether a place on the mirror's plane, along a and b, is on its glass."""
    if sides == 0:
        return True
    if x < limits[0, 0] or x > limits[0, 1] or y < limits[1, 0] or y > limits[1, 1]:
        return False
    inside = False
    j = sides - 1
    for i in range(sides):  # even-odd rule
        yi, yj = corners[i, 1], corners[j, 1]
        if (yi > y) != (yj > y) and x < (corners[j, 0] - corners[i, 0]) * (y - yi) / (yj - yi) + corners[i, 0]:
            inside = not inside
        j = i
    return inside


@njit(cache=True, nogil=True)
def crossing(origin, target, plane, axes, center, limits, corners, sides, margin):
    """Share of the way from origin to target at which it passes a mirror's glass; 2 when it does not."""
    a = plane[0] * origin[0] + plane[1] * origin[1] + plane[2] * origin[2] - plane[3]
    b = plane[0] * target[0] + plane[1] * target[1] + plane[2] * target[2] - plane[3]
    if a <= 0 or b >= -margin:
        return 2.0
    t = a / (a - b)
    x = y = 0.0
    for c in range(3):
        offset = origin[c] + t * (target[c] - origin[c]) - center[c]
        x += axes[0, c] * offset
        y += axes[1, c] * offset
    return t if in_glass(x, y, limits, corners, sides) else 2.0


@njit(cache=True, nogil=True, parallel=True)
def _sort_kernel(points, planes, axes, centers, limits, corners, sides, flips, near, far):
    height, width = points.shape[:2]
    count = len(planes)
    seen = np.full((height, width), -1, np.int8)
    placed = np.empty_like(points)
    # where the mirrors' points are along their a and b
    middles = np.empty((count, 2))
    for i in range(count):
        for k in range(2):
            middles[i, k] = (axes[i, k] * centers[i]).sum()
    for v in prange(height):
        at_glass = np.empty(3)
        for u in range(width):
            x, y, z = points[v, u, 0], points[v, u, 1], points[v, u, 2]
            placed[v, u, 0], placed[v, u, 1], placed[v, u, 2] = x, y, z
            if z == 0 or z > far or z < near:
                continue
            margin = 0.01 * z + 0.01
            best, which = 2.0, -1
            on_frame = False
            for i in range(count):
                off = planes[i, 0] * x + planes[i, 1] * y + planes[i, 2] * z - planes[i, 3]
                if off >= margin:  # before the mirror
                    continue
                a = axes[i, 0, 0] * x + axes[i, 0, 1] * y + axes[i, 0, 2] * z
                b = axes[i, 1, 0] * x + axes[i, 1, 1] * y + axes[i, 1, 2] * z
                if off > -margin:
                    a -= middles[i, 0]
                    b -= middles[i, 1]
                    on_frame = on_frame or (
                        sides[i] > 0
                        and limits[i, 0, 0] - 0.02 <= a <= limits[i, 0, 1] + 0.02
                        and limits[i, 1, 0] - 0.02 <= b <= limits[i, 1, 1] + 0.02
                    )
                    continue
                if planes[i, 3] >= 0:  # the camera is behind it
                    continue
                t = planes[i, 3] / (planes[i, 3] + off)
                if t < best and in_glass(
                    t * a - middles[i, 0], t * b - middles[i, 1], limits[i], corners[i], sides[i]
                ):  # fmt: skip
                    best, which = t, i
            if which < 0:
                if not on_frame:
                    seen[v, u] = 0
                continue
            for r in range(3):
                placed[v, u, r] = flips[which, r, 0] * x + flips[which, r, 1] * y + flips[which, r, 2] * z
                placed[v, u, r] += flips[which, r, 3]
            at_glass[0], at_glass[1], at_glass[2] = best * x, best * y, best * z
            twice = False
            for j in range(count):
                if j != which and (
                    crossing(
                        at_glass, placed[v, u], planes[j], axes[j], centers[j], limits[j], corners[j], sides[j], margin
                    )
                    < 1.0
                ):
                    twice = True
            if not twice:
                seen[v, u] = which + 1
    return seen, placed
