"""Islands packed into a square: turned to their least box, then each as low as it fits.

As Lévy et al. 2002 pack charts, but on a grid of cells, so that islands also go into each other's hollows.
"""

from __future__ import annotations

import numpy as np

from ...mesh.boundary_loops import boundary_loops
from ...numeric.kernels import njit

_GRID = 512  # cells along the square's side
_TURNS = 90  # angles that are tried for the least box
_TRIALS = 7  # halvings of the interval in which the scale lies
_ROOM = 0.5  # of the square by the islands' area, where the search for the scale begins


def pack(flat: list[np.ndarray], triangles: list[np.ndarray], gap: float) -> list[np.ndarray]:
    """Places of islands in the unit square, all to one scale, apart from one another.

    Parameters
    ----------
    flat : list of np.ndarray [shape=(V_i, 2)]
        Each island laid flat [m].
    triangles : list of np.ndarray [shape=(T_i, 3)]
        Of its vertices; a disk.
    gap : float
        Room that each island keeps about it, in parts of the square's side.

    Returns
    -------
    list of np.ndarray [shape=(V_i, 2), dtype=float64]
        0..1, counter-clockwise as they were.
    """
    turned = [_least_box(places) for places in flat]
    loops = [boundary_loops(rows, len(places))[0] for places, rows in zip(flat, triangles, strict=True)]
    order = sorted(range(len(flat)), key=lambda k: -float(turned[k].max(axis=0).max()))
    area = sum(_area(places, rows) for places, rows in zip(flat, triangles, strict=True))
    widest = max(float(places.max()) for places in turned)
    low, high = 0.0, min(np.sqrt(1.0 / max(area, 1e-18)), 0.98 / max(widest, 1e-9))
    scale = min(np.sqrt(_ROOM / max(area, 1e-18)), high)
    best = None
    for _ in range(4 * _TRIALS):
        placed = _packed(turned, loops, order, scale, gap)
        if placed is None:
            high = scale
        else:
            low, best = scale, placed
        if best is not None and high - low < 0.004 * high:
            break
        scale = 0.5 * (low + high) if best is not None else 0.85 * scale
    assert best is not None  # everything fits where it is small enough
    return best


def _area(flat: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (flat[triangles[:, k]] for k in range(3))
    return float(0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).sum())


def _least_box(flat: np.ndarray) -> np.ndarray:
    """Places turned so that their box is least and lies on its longer side, its corner at the origin."""
    angle = np.arange(_TURNS) * (0.5 * np.pi / _TURNS)
    axes = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    along, across = flat @ axes.T, flat @ np.stack((-axes[:, 1], axes[:, 0]))
    best = int((np.ptp(along, axis=0) * np.ptp(across, axis=0)).argmin())
    turned = np.stack((along[:, best], across[:, best]), axis=1)
    if np.ptp(turned[:, 0]) < np.ptp(turned[:, 1]):
        turned = np.stack((turned[:, 1], -turned[:, 0]), axis=1)
    return turned - turned.min(axis=0)


def _packed(turned, loops, order, scale: float, gap: float) -> list[np.ndarray] | None:
    """The islands at one scale, None where one of them finds no place."""
    border = gap * _GRID
    last = np.full((_GRID, _GRID), -1, np.int32)  # at each cell: the nearest one in use to the left, itself included
    placed: list = [None] * len(order)
    for k in order:
        cells = turned[k] * (scale * _GRID)
        cells = cells + border
        mask = _covered(cells[loops[k]], border)
        best: tuple | None = None
        for _ in range(4):
            # a quarter of a turn
            cells = np.stack((mask.shape[0] - cells[:, 1], cells[:, 0]), axis=1)
            mask = np.ascontiguousarray(mask.T[:, ::-1])
            if max(mask.shape) > _GRID:
                continue
            spans = _spans(mask)
            row, column = _place_kernel(last, spans, mask.shape[0], mask.shape[1])
            if row >= 0:
                rank = (row + mask.shape[0], column)
                if best is None or rank < best[0]:
                    best = (rank, row, column, mask, cells)
        if best is None:
            return None
        _, row, column, mask, moved = best
        part = last[row : row + mask.shape[0]]
        cell = np.arange(_GRID)[None]
        used = part == cell
        used[:, column : column + mask.shape[1]] |= mask
        part[:] = np.maximum.accumulate(np.where(used, cell, -1), axis=1)
        placed[k] = (moved + (column, row)) / _GRID
    return placed


def _covered(loop: np.ndarray, margin: float) -> np.ndarray:
    """Cells, bool (h, w), that lie within ``margin`` of a polygon (K, 2) [cells]."""
    width, height = (int(n) + 1 for n in np.ceil(loop.max(axis=0) + margin))
    after = np.roll(loop, -1, axis=0)
    # inside: the even-odd rule, row by row; each side changes the cells to the right of where it crosses the row
    low, high = np.minimum(loop[:, 1], after[:, 1]), np.maximum(loop[:, 1], after[:, 1])
    first = np.ceil(low - 0.5).astype(np.int64)
    count = np.maximum(np.ceil(high - 0.5).astype(np.int64) - first, 0)
    side = np.repeat(np.arange(len(loop)), count)
    row = np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count) + first[side]
    rise = after[side, 1] - loop[side, 1]
    x = loop[side, 0] + (row + 0.5 - loop[side, 1]) * (after[side, 0] - loop[side, 0]) / rise
    crossed = np.zeros((height, width + 1), np.int64)
    np.add.at(crossed, (row, np.clip(np.ceil(x - 0.5).astype(np.int64), 0, width)), 1)
    mask = (np.cumsum(crossed, axis=1) % 2 == 1)[:, :width]
    # and what is near the sides
    steps = np.maximum(np.ceil(2 * np.linalg.norm(after - loop, axis=1)).astype(np.int64), 1)
    side = np.repeat(np.arange(len(loop)), steps)
    share = (np.arange(len(side)) - np.repeat(np.cumsum(steps) - steps, steps)) / steps[side]
    x, y = (loop[side, c] + share * (after - loop)[side, c] for c in (0, 1))
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    x, y = x - column, y - row
    reach = int(np.ceil(margin))
    for dv in range(-reach, reach + 1):
        for du in range(-reach, reach + 1):
            off_x = np.maximum(np.abs(du + 0.5 - x) - 0.5, 0.0)
            off_y = np.maximum(np.abs(dv + 0.5 - y) - 0.5, 0.0)
            near = off_x * off_x + off_y * off_y <= margin * margin
            u, v = column[near] + du, row[near] + dv
            good = (u >= 0) & (v >= 0) & (u < width) & (v < height)
            mask[v[good], u[good]] = True
    return mask


def _spans(mask: np.ndarray) -> np.ndarray:
    """Runs of cells in use, (row, first, behind the last) (K, 3) int32; those in the middle rows first."""
    padded = np.zeros((mask.shape[0], mask.shape[1] + 2), np.int8)
    padded[:, 1:-1] = mask
    step = np.diff(padded, axis=1)
    row, first = np.nonzero(step == 1)
    behind = np.nonzero(step == -1)[1]
    order = np.argsort(-(behind - first), kind="stable")
    return np.stack((row, first, behind), axis=1)[order].astype(np.int32)


@njit(cache=True, nogil=True)
def _place_kernel(last, spans, height, width):
    """Lowest row, then leftmost column, at which no span of the island meets a cell in use; (-1, -1) for none."""
    grid = last.shape[0]
    for row in range(grid - height + 1):
        column = 0
        while column <= grid - width:
            step = 0
            for s in range(len(spans)):
                met = last[row + spans[s, 0], column + spans[s, 2] - 1]
                if met >= column + spans[s, 1]:
                    step = met - column - spans[s, 1] + 1
                    break
            if step == 0:
                return row, column
            column += step
    return -1, -1
