"""Where the sides of a frame lie, read from the depth across them."""

from __future__ import annotations

import numpy as np

from ..numeric.kernels import njit
from .disparity_plane import median

WIDEST = 0.15
"""More than a frame is wide [m]: what goes on in its plane is a wall."""

_LINES = 48  # across each side
_SEARCHED = 0.4  # so far past the first guess of a side its frame is looked for [m]
_STRAY = 0.015  # a line whose edge is farther from the side's straight line does not count [m]
_IN_GLASS = 4  # so many steps of a line must have been in the glass, else it began beyond it
_THINNEST = 1.0e-3  # a stretch on the plane that is no longer is no frame [m]
_AT_CAMERA = 0.1  # a line that comes so near to the camera ends [m]


def frame_sides(
    depth: np.ndarray,
    intrinsics: np.ndarray,
    plane: np.ndarray,
    tolerance: float,
    point: np.ndarray,
    basis: np.ndarray,
    rectangle: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Where a mirror's frame begins and ends on each side, and how it is rotated in its plane.

    Lines run from the middle of the rectangle outwards, across each side. In the glass they meet readings beyond the
    plane, or none; the first stretch on the plane is the frame, until it is beyond (or in front of) it again. A line
    that comes to the frame from something in front of it, such as a person, says nothing.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    intrinsics : np.ndarray [shape=(4,)]
        fx, fy, cx, cy.
    plane : np.ndarray [shape=(3,)]
        1/z = a·u + b·v + c.
    tolerance : float
        Readings whose 1/z is this near are on it [1/m].
    point, basis : np.ndarray [shape=(3,)], [shape=(3, 3)]
        See :class:`.mirror.Mirror`.
    rectangle : np.ndarray [shape=(2, 2)]
        First guess of the extent along a and b.

    Returns
    -------
    inner, outer : np.ndarray [shape=(2, 2)]
        The frame's edges as ``rectangle``; NaN where there is no evidence. ``outer`` is ``inner`` where the plane goes
        on for more than :data:`WIDEST`.
    cut : np.ndarray [shape=(2, 2), dtype=bool]
        Most lines leave the picture through the glass there.
    turn : float
        By which angle the sides are rotated from a towards b [rad].

    Notes
    -----
    O(pixels across the frame).
    """
    return _sides_kernel(depth, intrinsics, plane, tolerance, point, basis, np.ascontiguousarray(rectangle), WIDEST)


_FRAME_MET, _LEFT_IMAGE = 1, 2
_SHADOW = 6  # px without a reading beside an object in front of a mirror are that object's shadow, more are the glass


@njit(cache=True, nogil=True, error_model="numpy")
def _sides_kernel(depth, intrinsics, plane, tolerance, point, basis, rectangle, widest):
    """Inner and outer edges (2, 2), sides that the image cuts off, and the rotation [rad]."""
    inner, outer, cut = np.full((2, 2), np.nan), np.full((2, 2), np.nan), np.zeros((2, 2), np.bool_)
    slope, weight = 0.0, 0.0
    places, edges = np.empty(_LINES), np.empty((_LINES, 2))
    for axis in range(2):
        low, high = rectangle[1 - axis, 0], rectangle[1 - axis, 1]
        for end in range(2):
            met, gone = 0, 0
            for i in range(_LINES):
                place = low + (0.06 + 0.88 * i / (_LINES - 1)) * (high - low)
                state, begins, ends = _walk(
                    depth, intrinsics, plane, tolerance, point, basis, axis, end, rectangle[axis], place, widest
                )
                if state == _FRAME_MET:
                    places[met], edges[met, 0], edges[met, 1] = place, begins, ends
                    met += 1
                elif state == _LEFT_IMAGE:
                    gone += 1
            cut[axis, end] = gone > max(2 * met, _LINES // 6)
            if met < max(6, gone // 2):
                continue
            near, tilt, level, middle, width, reach = _side_line(places, edges, met)
            if near < max(6.0, 0.4 * met):
                continue
            inner[axis, end] = level + tilt * (0.5 * (low + high) - middle)
            outer[axis, end] = inner[axis, end] + (2 * end - 1) * width
            # seen along b a side drifts along a by the tangent of the rotation, the other way round against it
            share = near * reach**2
            slope += share * (tilt if axis == 1 else -tilt)
            weight += share
    return inner, outer, cut, np.arctan(slope / weight) if weight > 0.0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _side_line(places, edges, met):
    """Robust line through the inner edges of a side.

    How many are near it, its slope, its level at the mean place, that place; of those near it the frame's median width
    and how far apart they are.
    """
    middle = 0.0
    for i in range(met):
        middle += places[i]
    middle /= met
    half = met // 2
    some = np.empty(met)
    for i in range(half):
        some[i] = (edges[half + i, 0] - edges[i, 0]) / (
            (places[half + i] - middle) - (places[i] - middle)
        )  # of pairs half the side apart: Theil 1950, with fewer pairs
    tilt = median(some[:half])
    for i in range(met):
        some[i] = edges[i, 0] - tilt * (places[i] - middle)
    level = median(some)
    near, least, most = 0, np.inf, -np.inf
    for i in range(met):
        x, y = places[i] - middle, edges[i, 0]
        if abs(y - tilt * x - level) < _STRAY:
            some[near] = abs(edges[i, 1] - y)
            near += 1
            least, most = min(least, x), max(most, x)
    return near, tilt, level, middle, median(some[:near]) if near > 0 else 0.0, most - least


@njit(cache=True, nogil=True, error_model="numpy")
def _walk(depth, intrinsics, plane, tolerance, point, basis, axis, end, extent, place, widest):
    """What a line across a side meets, and the frame's inner and outer edge on it along ``axis`` [m]."""
    height, width = depth.shape
    sign = 2.0 * end - 1.0
    stop = extent[end] + sign * _SEARCHED
    s = 0.5 * (extent[0] + extent[1]) + sign * 0.15 * (extent[1] - extent[0])
    began, last, gap, before, glass = np.nan, np.nan, 0, False, 0
    while sign * (stop - s) > 0.0 or not np.isnan(began):
        x = point[0] + basis[0, axis] * s + basis[0, 1 - axis] * place
        y = point[1] + basis[1, axis] * s + basis[1, 1 - axis] * place
        z = point[2] + basis[2, axis] * s + basis[2, 1 - axis] * place
        if z < _AT_CAMERA:
            break
        u, v = (
            int(np.floor(x / z * intrinsics[0] + intrinsics[2] + 0.5)),
            int(np.floor(y / z * intrinsics[1] + intrinsics[3] + 0.5)),
        )
        step = 0.8 * z / intrinsics[0]
        if u < 0 or v < 0 or u >= width or v >= height:
            if np.isnan(began):
                return 0 if before or glass < _IN_GLASS else _LEFT_IMAGE, s, s
            break
        reading = depth[v, u]
        apart = 1.0 / reading - (plane[0] * u + plane[1] * v + plane[2]) if reading > 0.0 else -np.inf
        if abs(apart) < tolerance:
            if np.isnan(began):
                began = s
            last, gap = s, 0
            if sign * (last - began) > widest:
                break
        else:
            gap += 1
            if gap > 1 and not np.isnan(began):
                if sign * (last - began) > 1.2 * step:
                    break
                began = np.nan  # a stray pixel
            if np.isnan(began) and (reading > 0.0 or gap > _SHADOW):
                before = reading > 0.0 and apart > 0.0
            glass += apart < 0.0
        s += sign * step
    if np.isnan(began) or before or glass < _IN_GLASS or sign * (last - began) <= _THINNEST:
        return 0, s, s
    return _FRAME_MET, began, began if sign * (last - began) > widest else last
