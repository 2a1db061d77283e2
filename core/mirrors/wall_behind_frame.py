"""A frame that hangs on a wall, separated from the wall by the difference in depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..numeric.kernels import njit
from .disparity_plane import DisparityPlane, disparity_plane
from .frame_sides import WIDEST, frame_sides
from .mirror import Mirror

THICK = 0.01
"""How far a mirror's glass may lie in front of the wall it hangs on, one standard deviation [m]."""
_DEEPEST_FRAME = 0.035  # a frame that is farther in front of the wall than this is not taken for the wall [m]
_CLEAR_STEP = 4.0  # standard deviations by which a frame must project in front of the wall to be separated from it
_SIDE_PARTS = 6  # of each side, asked one by one
_FEW_READINGS = 5  # readings of a part that say too little


@dataclass(frozen=True)
class SeparatedFrame:
    """A frame without the wall about it.

    Its pixels, their plane, and how far the glass may well be off it, one standard deviation [m]: 0 but where the plane
    is the wall's.
    """

    u: np.ndarray
    v: np.ndarray
    fitted: DisparityPlane
    depth_error: float


def separate_wall(
    u: np.ndarray,
    v: np.ndarray,
    depth: np.ndarray,
    fitted: DisparityPlane,
    intrinsics: np.ndarray,
    point: np.ndarray,
    basis: np.ndarray,
    rectangle: np.ndarray,
) -> SeparatedFrame:
    """The frame of a mirror that hangs on a wall, separated from the wall behind it.

    A frame is a few pixels wide, and a wall a centimetre behind it is, pixel by pixel, on its plane. Over the length of
    the sides the jump in depth between them shows: readings are sorted by how far outside of the glass they are, the
    jump is where they split best in two, and parts of the sides must agree on it. Where there is none the plane is the
    wall's (or that of a frame flush with it), and the glass lies in front of it by its unknown thickness.

    Parameters
    ----------
    u, v : np.ndarray [shape=(K,), dtype=int]
        What was taken for the frame.
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    fitted : DisparityPlane
        Of these pixels.
    intrinsics, point, basis, rectangle
        As for :func:`.frame_sides.frame_sides`; ``point`` and ``basis`` are near the plane.

    Notes
    -----
    O(pixels of the box about the frame); nothing is done where no wall goes on in the plane.
    """
    z = float(point[2])
    tolerance = min(max(4.0 * np.hypot(fitted.scale, np.sqrt(fitted.common)), 0.004 / z**2), 0.02 / z)
    plane, rectangle = fitted.coefficients, np.ascontiguousarray(rectangle)
    limit = _DEEPEST_FRAME / z**2
    inner, outer, _, _ = frame_sides(depth, intrinsics, plane, tolerance, point, basis, rectangle)
    if np.isnan(inner).all():  # the frame may be too far in front of the plane
        inner, outer, _, _ = frame_sides(depth, intrinsics, plane, limit, point, basis, rectangle)
    goes_on = outer == inner  # false where NaN
    if not goes_on.any():
        return SeparatedFrame(u, v, fitted, 0.0)
    wall = SeparatedFrame(u, v, fitted, THICK if goes_on.sum() > 1 else 0.0)
    pixel = z / (0.5 * (intrinsics[0] + intrinsics[1]))
    count, total = _beside_kernel(
        depth, intrinsics, plane, point, basis, inner, limit, pixel, int(WIDEST / pixel), _SIDE_PARTS
    )
    below, above = np.cumsum(count, axis=1), np.cumsum(count[:, ::-1], axis=1)[:, ::-1]
    near, far = np.cumsum(total, axis=1), np.cumsum(total[:, ::-1], axis=1)[:, ::-1]
    best, jump = 0.0, 0
    for k in range(1, int(0.6 * WIDEST / pixel)):  # readings at least 1 and less than 1 + k pixels outside, or beyond
        few, many = below[:, k - 1].sum(), above[:, k].sum()
        if few > 0 and many > 0:
            contrast = few * many / (few + many) * (near[:, k - 1].sum() / few - far[:, k].sum() / many) ** 2
            best, jump = (contrast, k) if contrast > best else (best, jump)
    seen = (
        (below[:, jump - 1] > _FEW_READINGS) & (above[:, jump] > _FEW_READINGS)
        if jump
        else np.zeros(len(count), np.bool_)
    )
    if seen.sum() < _SIDE_PARTS:
        return wall
    few, many = below[seen, jump - 1], above[seen, jump]
    rise = near[seen, jump - 1] / few - far[seen, jump] / many
    weight = few * many / (few + many)
    mean = (weight * rise).sum() / weight.sum()
    error = np.sqrt((weight**2 * (rise - mean) ** 2).sum()) / weight.sum()
    if mean < _CLEAR_STEP * error:
        return wall
    ends = max(jump, 2) * pixel  # a pixel less than where depth jumps
    level = near[seen, jump - 1].sum() / few.sum()
    mine_u, mine_v = _frame_kernel(depth, intrinsics, plane, point, basis, inner, level, tolerance, ends)
    again = disparity_plane(mine_u, mine_v, depth[mine_v, mine_u]) if len(mine_u) >= 30 else None
    return wall if again is None else SeparatedFrame(mine_u, mine_v, again, 0.0)


@njit(cache=True, nogil=True)
def _outside(intrinsics, plane, point, basis, inner, u, v, at):
    """How far outside of the sides that are known a pixel lies on the plane [m], -1 inside, and its side.

    ``at`` (2,) is its place.
    """
    there = plane[0] * u + plane[1] * v + plane[2]
    if there <= 0.0:
        return -1.0, 0
    x, y, z = (
        (u - intrinsics[2]) / intrinsics[0] / there - point[0],
        (v - intrinsics[3]) / intrinsics[1] / there - point[1],
        1.0 / there - point[2],
    )
    best, side = -1.0, 0
    for axis in range(2):
        at[axis] = basis[0, axis] * x + basis[1, axis] * y + basis[2, axis] * z
        for end in range(2):
            beyond = (2 * end - 1) * (at[axis] - inner[axis, end])
            if beyond > best:  # false where NaN
                best, side = beyond, 2 * axis + end
    return best, side


@njit(cache=True, nogil=True)
def _beside_kernel(depth, intrinsics, plane, point, basis, inner, limit, pixel, bins, parts):
    """Counts of readings near the plane, and sums of how much nearer they are in 1/z: (4·parts, bins) each.

    By part of the sides, and by how many pixels outside of the sides they are, from 1 on.
    """
    count, total, at = np.zeros((4 * parts, bins)), np.zeros((4 * parts, bins)), np.empty(2)
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = depth[v, u]
            if z == 0.0:
                continue
            apart = 1.0 / z - (plane[0] * u + plane[1] * v + plane[2])
            if abs(apart) > limit:
                continue
            outside, side = _outside(intrinsics, plane, point, basis, inner, u, v, at)
            k = int(outside / pixel) - 1
            if outside < pixel or k >= bins:
                continue
            other = 1 - side // 2
            share = (at[other] - inner[other, 0]) / (inner[other, 1] - inner[other, 0])
            if not 0.0 <= share < 1.0:  # about a corner, or where a side is not known
                continue
            part = side * parts + int(share * parts)
            count[part, k] += 1.0
            total[part, k] += apart
    return count, total


@njit(cache=True, nogil=True)
def _frame_kernel(depth, intrinsics, plane, point, basis, inner, level, tolerance, ends):
    """Pixels (u, v) up to ``ends`` outside of the sides [m] that are ``level`` nearer than the plane in 1/z."""
    height, width = depth.shape
    columns, rows, at = np.empty(height * width, np.int64), np.empty(height * width, np.int64), np.empty(2)
    n = 0
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            if z == 0.0 or abs(1.0 / z - (plane[0] * u + plane[1] * v + plane[2]) - level) > tolerance:
                continue
            outside, _ = _outside(intrinsics, plane, point, basis, inner, u, v, at)
            if 0.0 <= outside < ends:
                columns[n], rows[n] = u, v
                n += 1
    return columns[:n].copy(), rows[:n].copy()


def on_wall(mirror: Mirror) -> bool:
    """Whether its plane is that of the wall it hangs on; the glass lies an unknown distance in front of it."""
    return mirror.covariance is not None and mirror.covariance[2, 2] > THICK**2
