"""The plane of a mirror's frame from its pixels: robust, in inverse depth, as certain as its noise allows.

A frame is a thin band of some thousand noisy pixels; beside it stand walls, floors, the person, and the frames of other
mirrors that touch or cross it. Neighbouring pixels share errors (edges, quantisation, smoothing inside the camera), so
they are pooled to blocks: a block's mean is so much more certain than a pixel that what belongs to another surface
shows, and the noise of the blocks says how certain the plane is.
"""

from __future__ import annotations

import numpy as np

from ..numeric.kernels import njit
from .disparity_plane import BLOCK, DisparityPlane, disparity_plane


def grow_frame(
    depth: np.ndarray, seeds: np.ndarray, plane: np.ndarray, focal: float, band: float = 0.02
) -> tuple[np.ndarray, np.ndarray, DisparityPlane] | None:
    """The frame's pixels around picked ones, and the plane through them.

    First the picks' own neighbourhoods, then what is connected to them between the picks, then beyond: as far as the
    blocks of it agree with the plane so far, within what their noise and the plane's uncertainty there allow. So the
    frame of another mirror, which meets this one at an angle, is left a few centimetres behind the crease, and a floor,
    which cuts through the plane, is left out.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    seeds : np.ndarray [shape=(K, 2), dtype=int]
        Pixels (u, v) with a reading.
    plane : np.ndarray [shape=(3,)]
        First guess, 1/z = a·u + b·v + c.
    focal : float
        [px]
    band : float
        No pixel farther from the plane than this is the frame's, relative to z.

    Returns
    -------
    u, v : np.ndarray [shape=(K,), dtype=int]
        The pixels; not all weigh.
    fitted : DisparityPlane
        Of all of them.
    None when there are fewer than 30 pixels or all are on a line.

    Notes
    -----
    O(pixels of the box about the frame).
    """
    height, width = depth.shape
    seeds = np.asarray(seeds, dtype=np.int64)
    u, v = _near_seeds(depth, seeds, plane, band)
    fitted = disparity_plane(u, v, depth[v, u]) if len(u) >= 12 else None
    if fitted is None:
        return None
    z = float(np.median(depth[seeds[:, 1], seeds[:, 0]]))
    low, high = seeds.min(axis=0), seeds.max(axis=0)
    for reach in (0.08, 0.4, np.inf):
        apart = min(reach * focal / z + 4.0, width + height)
        box = np.clip(np.concatenate((low - apart, high + apart + 1)), 0, (width, height, width, height))
        box = box.astype(np.int64)
        for _ in range(4):
            more_u, more_v = _gather_kernel(
                depth, seeds, fitted.coefficients, fitted.covariance, fitted.scale, fitted.common, band, box
            )
            again = None
            if len(more_u) >= 12:
                again = disparity_plane(more_u, more_v, depth[more_v, more_u], fitted.coefficients)
            if again is None:
                break
            moved = np.abs(again.coefficients - fitted.coefficients) @ (width, height, 1.0) * z
            u, v, fitted = more_u, more_v, again
            if moved < 5e-4:
                break
        # nothing reaches the box's sides but where the image ends there
        open_sides = (u.min() < box[0] + 3 > 3, v.min() < box[1] + 3 > 3,
                      u.max() > box[2] - 4 < width - 4, v.max() > box[3] - 4 < height - 4)  # fmt: skip
        if not any(open_sides):
            break
    return (u, v, fitted) if len(u) >= 30 else None


@njit(cache=True, nogil=True)
def _near_seeds(depth, seeds, plane, band):
    """The pixels about picked ones that read the same depth as they."""
    height, width = depth.shape
    columns, rows = np.empty(81 * len(seeds), np.int64), np.empty(81 * len(seeds), np.int64)
    n = 0
    for k in range(len(seeds)):
        u, v = seeds[k]
        z = depth[v, u]
        if abs((plane[0] * u + plane[1] * v + plane[2]) * z - 1.0) > band:
            continue
        for y in range(max(v - 4, 0), min(v + 5, height)):
            for x in range(max(u - 4, 0), min(u + 5, width)):
                there = plane[0] * x + plane[1] * y + plane[2]
                same = depth[y, x] > 0 and abs(depth[y, x] / z - 1.0) < 2.0 * band
                if same and abs(there * depth[y, x] - 1.0) < band:
                    columns[n], rows[n] = x, y
                    n += 1
    return columns[:n], rows[:n]


@njit(cache=True, nogil=True)
def _spread(covariance, u, v):
    """Variance of the plane's 1/z at a pixel."""
    return max(
        covariance[0, 0] * u * u + covariance[1, 1] * v * v + covariance[2, 2]
        + 2.0 * (covariance[0, 1] * u * v + covariance[0, 2] * u + covariance[1, 2] * v), 0.0,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _connect(state, i, j, stack, top):
    """Take a block and its eight neighbours, where they are on the plane, for connected; the stack's new height."""
    for y in range(max(i - 1, 0), min(i + 2, state.shape[0])):
        for x in range(max(j - 1, 0), min(j + 2, state.shape[1])):
            if state[y, x] == 1:
                state[y, x] = 2
                stack[top, 0], stack[top, 1] = y, x
                top += 1
    return top


@njit(cache=True, nogil=True)
def _gather_kernel(depth, seeds, plane, covariance, sigma, common, band, box):
    """Pixels inside the box (u0, v0, u1, v1) on the plane, in blocks that are connected to the seeds'.

    A block is left out when its mean is off the plane by more than noise and the plane's own uncertainty explain, or
    when its surface cuts through it, as a floor does.
    """
    columns, rows = (box[2] - box[0]) // BLOCK + 1, (box[3] - box[1]) // BLOCK + 1
    sums = np.zeros((rows, columns, 8))  # 1, x, y, xx, yy, r, rx, ry of its pixels
    near, spread = np.empty((rows, columns)), np.empty((rows, columns))
    for i in range(rows):
        for j in range(columns):
            u, v = box[0] + (j + 0.5) * BLOCK, box[1] + (i + 0.5) * BLOCK
            there = plane[0] * u + plane[1] * v + plane[2]
            spread[i, j] = _spread(covariance, u, v)
            near[i, j] = min(4.0 * sigma + 3.0 * np.sqrt(spread[i, j]), band * there)
    on = np.zeros((box[3] - box[1], box[2] - box[0]), np.bool_)
    for v in range(box[1], box[3]):
        i = (v - box[1]) // BLOCK
        base = plane[1] * v + plane[2]
        for u in range(box[0], box[2]):
            z = depth[v, u]
            if z == 0.0:
                continue
            j = (u - box[0]) // BLOCK
            r = 1.0 / z - (base + plane[0] * u)
            if abs(r) > near[i, j]:
                continue
            on[v - box[1], u - box[0]] = True
            cell = sums[i, j]
            x, y = u - box[0] - (j + 0.5) * BLOCK, v - box[1] - (i + 0.5) * BLOCK
            cell[0] += 1.0
            cell[1] += x
            cell[2] += y
            cell[3] += x * x
            cell[4] += y * y
            cell[5] += r
            cell[6] += r * x
            cell[7] += r * y
    state = np.zeros((rows, columns), np.uint8)  # 1 on the plane, 2 and connected
    for i in range(rows):
        for j in range(columns):
            cell = sums[i, j]
            n = cell[0]
            if n == 0.0:
                continue
            mean, own = cell[5] / n, sigma * sigma / n + common
            good = mean * mean < 12.0 * (own + spread[i, j])
            for k in range(1, 3):
                across = cell[2 + k] - cell[k] * cell[k] / n
                tilt = cell[5 + k] - cell[k] * mean
                good = good and tilt * tilt <= 25.0 * across * own * n
            state[i, j] = 1 if good else 0
    stack = np.empty((rows * columns, 2), np.int64)
    top = 0
    for k in range(len(seeds)):
        top = _connect(state, (seeds[k, 1] - box[1]) // BLOCK, (seeds[k, 0] - box[0]) // BLOCK, stack, top)
    while top > 0:
        top = _connect(state, stack[top - 1, 0], stack[top - 1, 1], stack, top - 1)
    total = 0
    for i in range(rows):
        for j in range(columns):
            if state[i, j] == 2:
                total += int(sums[i, j, 0])
    out_u, out_v = np.empty(total, np.int64), np.empty(total, np.int64)
    n = 0
    for y in range(box[3] - box[1]):
        for x in range(box[2] - box[0]):
            if on[y, x] and state[y // BLOCK, x // BLOCK] == 2:
                out_u[n], out_v[n] = box[0] + x, box[1] + y
                n += 1
    return out_u, out_v
