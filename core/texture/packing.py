"""Islands packed into a square: turned to their least box, then each as low as it fits.

As Lévy et al. 2002 pack charts, but on a grid of cells, so that islands also go into each other's hollows.
"""

from __future__ import annotations

import numpy as np

from ..numeric.kernels import njit

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
        Of its vertices.
    gap : float
        Least distance between islands, and twice that from the border, in parts of the square's side.

    Returns
    -------
    list of np.ndarray [shape=(V_i, 2), dtype=float64]
        0..1, counter-clockwise as they were.
    """
    turned = [_least_box(places) for places in flat]
    order = sorted(range(len(flat)), key=lambda k: -float(turned[k].max(axis=0).max()))
    area = sum(_area(places, rows) for places, rows in zip(flat, triangles, strict=True))
    widest = max(float(places.max()) for places in turned)
    low, high = 0.0, min(np.sqrt(1.0 / max(area, 1e-18)), 0.98 / max(widest, 1e-9))
    scale = min(np.sqrt(_ROOM / max(area, 1e-18)), high)
    best = None
    for _ in range(4 * _TRIALS):
        placed = _packed(turned, triangles, order, scale, gap)
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


def _packed(turned, triangles, order, scale: float, gap: float) -> list[np.ndarray] | None:
    """The islands at one scale, None where one of them finds no place."""
    border = gap * _GRID
    last = np.full((_GRID, _GRID), -1, np.int32)  # at each cell: the nearest one in use to the left, itself included
    placed: list = [None] * len(order)
    for k in order:
        cells = turned[k] * (scale * _GRID)
        best: tuple | None = None
        for quarter in range(4):
            moved = cells
            for _ in range(quarter):
                moved = np.stack((-moved[:, 1], moved[:, 0]), axis=1)
            moved = moved - moved.min(axis=0) + border
            mask = _covered(moved, triangles[k], border)
            if mask.shape[0] > _GRID or mask.shape[1] > _GRID:
                continue
            spans = _spans(mask)
            row, column = _place_kernel(last, spans, mask.shape[0], mask.shape[1])
            if row >= 0:
                rank = (row + mask.shape[0], column)
                if best is None or rank < best[0]:
                    best = (rank, row, column, mask, moved)
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


def _covered(cells: np.ndarray, triangles: np.ndarray, margin: float) -> np.ndarray:
    """Cells, bool (h, w), that lie within ``margin`` of the island."""
    width, height = (int(n) for n in np.ceil(cells.max(axis=0) + margin + 0.5))
    mask = np.zeros((height, width), np.bool_)
    _cover_kernel(np.ascontiguousarray(cells[triangles]), margin + 0.5, mask)
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
def _cover_kernel(corners, reach, mask):
    """Mark cells whose middles (+ half) lie within ``reach`` of a triangle of ``corners`` (T, 3, 2)."""
    height, width = mask.shape
    squared = reach * reach
    for t in range(len(corners)):
        ax, ay = corners[t, 0, 0], corners[t, 0, 1]
        bx, by = corners[t, 1, 0], corners[t, 1, 1]
        cx, cy = corners[t, 2, 0], corners[t, 2, 1]
        u0, u1 = max(int(min(ax, bx, cx) - reach), 0), min(int(max(ax, bx, cx) + reach) + 1, width)
        v0, v1 = max(int(min(ay, by, cy) - reach), 0), min(int(max(ay, by, cy) + reach) + 1, height)
        for v in range(v0, v1):
            for u in range(u0, u1):
                if mask[v, u]:
                    continue
                x, y = u + 0.5, v + 0.5
                inside = True
                for k in range(3):
                    px, py = corners[t, k, 0], corners[t, k, 1]
                    dx, dy = corners[t, (k + 1) % 3, 0] - px, corners[t, (k + 1) % 3, 1] - py
                    if dx * (y - py) - dy * (x - px) < 0.0:
                        inside = False
                    share = ((x - px) * dx + (y - py) * dy) / max(dx * dx + dy * dy, 1e-30)
                    share = min(max(share, 0.0), 1.0)
                    if (x - px - share * dx) ** 2 + (y - py - share * dy) ** 2 <= squared:
                        mask[v, u] = True
                        break
                if inside:
                    mask[v, u] = True


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


def overlapping_share(flat: np.ndarray, triangles: np.ndarray) -> float:
    """Share of an island's area in the plane that lies on more of the island, to a 400th of its size."""
    step = float(np.ptp(flat, axis=0).max()) / 400
    corners = np.ascontiguousarray((flat - flat.min(axis=0))[triangles] / max(step, 1e-12))
    width, height = (int(n) + 1 for n in corners.max(axis=(0, 1)))
    times = np.zeros((height, width), np.int32)
    _count_kernel(corners, times)
    return float((times > 1).sum() / max(int((times > 0).sum()), 1))


@njit(cache=True, nogil=True)
def _count_kernel(corners, times):
    """How many triangles of ``corners`` (T, 3, 2), counter-clockwise, lie on the middle of each cell."""
    height, width = times.shape
    for t in range(len(corners)):
        ax, ay = corners[t, 0, 0], corners[t, 0, 1]
        bx, by = corners[t, 1, 0], corners[t, 1, 1]
        cx, cy = corners[t, 2, 0], corners[t, 2, 1]
        for v in range(max(int(min(ay, by, cy)), 0), min(int(max(ay, by, cy)) + 1, height)):
            for u in range(max(int(min(ax, bx, cx)), 0), min(int(max(ax, bx, cx)) + 1, width)):
                x, y = u + 0.5, v + 0.5
                if (
                    (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0.0
                    and (cx - bx) * (y - by) - (cy - by) * (x - bx) > 0.0
                    and (ax - cx) * (y - cy) - (ay - cy) * (x - cx) >= 0.0
                ):
                    times[v, u] += 1
