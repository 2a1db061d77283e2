"""Free space: a camera that reads a surface behind a point has seen that nothing is at the point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..numeric.kernels import njit

SLACK = 0.015
"""So much farther than a point, beside noise, must lie what a view reads there to prove the point empty [m]."""

NEAREST_Z = 0.05
"""Nearer than this, or behind the camera, a point has no pixel: no sensor reads there, and z → 0 divides [m]."""

_SPEAKS = 4  # of the nine readings around a pixel, so many must be there
_DEVIATIONS = 3.0  # standard deviations by which a reading must lie behind a point: one in a thousand does so by chance
_SHORTEST_BRIDGE = 0.02  # a shorter one lies within SLACK of the surfaces at its ends: not asked about [m]
_BRIDGE_STEP = 0.015  # so far apart the points of a bridge are looked at, but [m]
_MOST_STEPS = 12  # at most so many points, as most bridges asked about are never made


class FreeSpace(NamedTuple):
    """What N + 1 views have seen to be empty, for kernels to ask :func:`bridge_is_free` and :func:`reach_before_empty`.

    Several cameras share one image: theirs stand below one another, each with its own ``cy``.

    Attributes
    ----------
    to_view : np.ndarray [shape=(N+1, 4, 4), dtype=float64]
        Takes a point to where view k's camera sees it: identity, then each mirror's reflection; of several cameras
        also each one's pose.
    intrinsics : np.ndarray [shape=(N+1, 4), dtype=float64]
        fx, fy, cx, cy of each view [px].
    noise : np.ndarray [shape=(N+1,), dtype=float64]
        Standard deviation of a view's readings, relative to z.
    clear : np.ndarray [shape=(H, W), dtype=float32]
    through : np.ndarray [shape=(H, W), dtype=int8]
        How far each pixel is looked through [m], and by which view: :func:`clear_depth`.
    """

    to_view: np.ndarray
    intrinsics: np.ndarray
    noise: np.ndarray
    clear: np.ndarray
    through: np.ndarray


@njit(cache=True, nogil=True)
def clear_depth(depth: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far each pixel is looked through, and by which view.

    A pixel speaks where the readings in and around it, four at least, are all of one view.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        0 where there is no reading [m].
    seen : np.ndarray [shape=(H, W), dtype=int8]
        The view of each reading, of the room as well as of the subject.

    Returns
    -------
    clear : np.ndarray [shape=(H, W), dtype=float32]
        z of the nearest of those readings [m]; 0 where the pixel does not speak.
    through : np.ndarray [shape=(H, W), dtype=int8]
        The view, -1 where the pixel does not speak.
    """
    height, width = depth.shape
    clear, through = np.zeros((height, width), np.float32), np.full((height, width), -1, np.int8)
    # of three pixels side by side: readings, the nearest of them, the lowest and highest view
    count = np.empty((3, width), np.int8)
    near, low, high = np.empty((3, width), np.float32), np.empty((3, width), np.int8), np.empty((3, width), np.int8)
    for y in range(height):
        row = y % 3
        for x in range(1, width - 1):
            n, z, least, most = 0, np.float32(np.inf), np.int8(127), np.int8(-128)
            for side in range(x - 1, x + 2):
                if depth[y, side] > 0:
                    n += 1
                    z = min(z, depth[y, side])
                    least, most = min(least, seen[y, side]), max(most, seen[y, side])
            count[row, x], near[row, x], low[row, x], high[row, x] = n, z, least, most
        if y < 2:
            continue
        for x in range(1, width - 1):
            least = min(low[0, x], low[1, x], low[2, x])
            if (
                count[0, x] + count[1, x] + count[2, x] >= _SPEAKS
                and least >= 0
                and least == max(high[0, x], high[1, x], high[2, x])
            ):
                through[y - 1, x] = least
                clear[y - 1, x] = min(near[0, x], near[1, x], near[2, x])
    return clear, through


@njit(cache=True, nogil=True)
def in_view_frame(to_view, k, px, py, pz):
    """The point (px, py, pz) in the frame of view k: x, y, z."""
    x = to_view[k, 0, 0] * px + to_view[k, 0, 1] * py + to_view[k, 0, 2] * pz + to_view[k, 0, 3]
    y = to_view[k, 1, 0] * px + to_view[k, 1, 1] * py + to_view[k, 1, 2] * pz + to_view[k, 1, 3]
    z = to_view[k, 2, 0] * px + to_view[k, 2, 1] * py + to_view[k, 2, 2] * pz + to_view[k, 2, 3]
    return x, y, z


@njit(cache=True, nogil=True, error_model="numpy")
def bridge_is_free(p, i, q, j, free_space):
    """Whether the straight bridge from p[i] to q[j] crosses space that was seen to be empty."""
    to_view, intrinsics, noise, clear, through = free_space
    ax, ay, az = p[i, 0], p[i, 1], p[i, 2]
    dx, dy, dz = q[j, 0] - ax, q[j, 1] - ay, q[j, 2] - az
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    if length < _SHORTEST_BRIDGE:
        return False
    steps = min(int(length / _BRIDGE_STEP) + 1, _MOST_STEPS)
    for k in range(len(to_view)):
        far = 1.0 + _DEVIATIONS * noise[k]
        # along the bridge x, y and z in the view's frame change evenly
        x, y, z = in_view_frame(to_view, k, ax, ay, az)
        step_x = (to_view[k, 0, 0] * dx + to_view[k, 0, 1] * dy + to_view[k, 0, 2] * dz) / steps
        step_y = (to_view[k, 1, 0] * dx + to_view[k, 1, 1] * dy + to_view[k, 1, 2] * dz) / steps
        step_z = (to_view[k, 2, 0] * dx + to_view[k, 2, 1] * dy + to_view[k, 2, 2] * dz) / steps
        for _ in range(1, steps):
            x += step_x
            y += step_y
            z += step_z
            if z <= NEAREST_Z:
                continue
            u, v = x / z * intrinsics[k, 0] + intrinsics[k, 2], y / z * intrinsics[k, 1] + intrinsics[k, 3]
            if not (0 <= u <= clear.shape[1] - 1 and 0 <= v <= clear.shape[0] - 1):
                continue
            row, column = int(v + 0.5), int(u + 0.5)
            if through[row, column] == k and clear[row, column] > z * far + SLACK:
                return True
    return False


_CLEAR_AROUND = 2  # so far around a point a view must have looked through it to prove it empty [px]
_HALVINGS = 6  # to find where a path enters empty space: to a sixty-fourth of its length


@njit(cache=True, nogil=True, error_model="numpy")
def reach_before_empty(start, end, free_space):
    """How far each point may move on its straight path before it is in empty space: share of the path (K,).

    Parameters
    ----------
    start, end : np.ndarray [shape=(K, 3)]
        Both ends of each path [m].
    free_space : FreeSpace

    Returns
    -------
    np.ndarray [shape=(K,)]
        1 where ``end`` is not known to be empty, and where ``start`` is so already: going back would not help. O(K).
    """
    out = np.ones(len(start))
    for i in range(len(start)):
        if not _is_empty(end[i, 0], end[i, 1], end[i, 2], free_space):
            continue
        if _is_empty(start[i, 0], start[i, 1], start[i, 2], free_space):
            continue
        free, empty = 0.0, 1.0
        for _ in range(_HALVINGS):
            half = 0.5 * (free + empty)
            x = start[i, 0] + half * (end[i, 0] - start[i, 0])
            y = start[i, 1] + half * (end[i, 1] - start[i, 1])
            z = start[i, 2] + half * (end[i, 2] - start[i, 2])
            if _is_empty(x, y, z, free_space):
                empty = half
            else:
                free = half
        out[i] = free
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _is_empty(px, py, pz, free_space):
    """Whether a view looks through the point and all that is as near as ``_CLEAR_AROUND`` to it in its image."""
    to_view, intrinsics, noise, clear, through = free_space
    for k in range(len(to_view)):
        x, y, z = in_view_frame(to_view, k, px, py, pz)
        if z <= NEAREST_Z:
            continue
        u, v = x / z * intrinsics[k, 0] + intrinsics[k, 2], y / z * intrinsics[k, 1] + intrinsics[k, 3]
        if not (
            _CLEAR_AROUND <= u < clear.shape[1] - 1 - _CLEAR_AROUND
            and _CLEAR_AROUND <= v < clear.shape[0] - 1 - _CLEAR_AROUND
        ):
            continue
        row, column = int(v + 0.5), int(u + 0.5)
        behind = z * (1.0 + _DEVIATIONS * noise[k]) + SLACK
        all_empty = True
        for y_there in (row, row - _CLEAR_AROUND, row + _CLEAR_AROUND):
            for x_there in (column, column - _CLEAR_AROUND, column + _CLEAR_AROUND):
                all_empty = all_empty and through[y_there, x_there] == k and clear[y_there, x_there] > behind
        if all_empty:
            return True
    return False
