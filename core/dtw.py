"""Dynamic time warping of two polylines: the cheapest in-order matching of their vertices (Sakoe and Chiba 1978; paper 4.2.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from .errors import MirrorScanError


@dataclass(frozen=True)
class Warping:
    """Result of :func:`dtw`.

    Parameters
    ----------
    path : np.ndarray [shape=(K, 2), dtype=int32]
        The warping path: matched indices (i, j), each step adds (1, 0), (0, 1) or (1, 1).
    distance : float
        Accumulated local cost along the path, skipped ends included.
    """

    path: np.ndarray
    distance: float


def dtw(x: np.ndarray, y: np.ndarray, skip: float = np.inf) -> Warping:
    """Match two sequences of feature vectors in order, at the least accumulated Euclidean distance.

    Parameters
    ----------
    x : np.ndarray [shape=(N, D)]
        First sequence, finite. D = 3 for plain polylines; further columns (tangents, normals, scaled to metres) weigh in.
    y : np.ndarray [shape=(M, D)]
        Second sequence.
    skip : float
        Open begin and end: at either end, vertices of one sequence may stay unmatched at this cost each.
        Infinite (the default) matches both ends.

    Returns
    -------
    Warping

    Raises
    ------
    MirrorScanError
        Empty sequences, different D, or values that are not finite.

    Notes
    -----
    O(N·M) time; memory one byte a cell for the path and O(N + M) floats. Cells are visited by anti-diagonals, whose
    cells do not depend on each other, so that the inner loop vectorises.

    Examples
    --------
    >>> dtw(np.array([[0.0], [1.0], [2.0]]), np.array([[0.0], [2.0]])).path.tolist()
    [[0, 0], [1, 0], [2, 1]]
    """
    x = np.ascontiguousarray(x, dtype=np.float64)
    y = np.ascontiguousarray(y, dtype=np.float64)
    if x.ndim != 2 or y.ndim != 2 or not len(x) or not len(y) or x.shape[1] != y.shape[1]:
        raise MirrorScanError(f"dtw needs two non-empty (N, D) sequences of the same D, got {x.shape} and {y.shape}")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise MirrorScanError("dtw needs finite values; a sequence holds NaN or infinity")
    if skip < 0 or np.isnan(skip):
        raise MirrorScanError(f"dtw: the cost of skipping a vertex must not be negative, got {skip}")
    columns_x, columns_y = np.ascontiguousarray(x.T), np.ascontiguousarray(y[::-1].T)
    steps = np.empty((len(x) + len(y) - 1, min(len(x), len(y))), np.uint8)
    if len(x) <= len(y):
        end_i, end_j, distance = _accumulate(columns_x, columns_y, float(skip), steps)
        path = _backtrack(steps, end_i, end_j, len(y), np.isfinite(skip))
    else:  # the shorter one indexes the diagonals' cells
        end_j, end_i, distance = _accumulate(np.ascontiguousarray(y.T), np.ascontiguousarray(x[::-1].T), float(skip), steps)
        path = _backtrack(steps, end_j, end_i, len(x), np.isfinite(skip))[:, ::-1].copy()
    return Warping(path, float(distance))


_BOTH, _FIRST, _SECOND, _START = 0, 1, 2, 3  # what the last step advanced


@njit(cache=True, nogil=True, error_model="numpy")
def _diagonal(cost, up, left, across, out, step):
    """out = cost + min of the three predecessors; ties go to the diagonal step, then to the first sequence."""
    for k in range(len(cost)):
        best = across[k]
        which = np.uint8(0)
        if up[k] < best:
            best = up[k]
            which = np.uint8(1)
        if left[k] < best:
            best = left[k]
            which = np.uint8(2)
        out[k] = cost[k] + best
        step[k] = which


@njit(cache=True, nogil=True, error_model="numpy")
def _add_squares(a, b, out):
    for k in range(len(out)):
        d = a[k] - b[k]
        out[k] += d * d


@njit(cache=True, nogil=True, error_model="numpy")
def _roots(out):
    for k in range(len(out)):
        out[k] = np.sqrt(out[k])


@njit(cache=True, nogil=True, error_model="numpy")
def _accumulate(x, y_reversed, skip, steps):
    """Accumulated cost by anti-diagonals i + j = d; row d of ``steps`` holds the step into each of its cells.

    Returns the end cell and its distance. ``x`` (D, N) is the shorter, ``y_reversed`` (D, M) runs backwards so that a
    diagonal reads both forwards.
    """
    dims, n = x.shape
    m = y_reversed.shape[1]
    # three rolling diagonals, one infinite cell of margin on either side; cell i sits at i + 1
    now = np.full(n + 2, np.inf)
    before = np.full(n + 2, np.inf)
    earlier = np.full(n + 2, np.inf)
    cost = np.empty(n)
    best, end_i, end_j = np.inf, n - 1, m - 1
    for d in range(n + m - 1):
        lo, hi = max(0, d - m + 1), min(n, d + 1)
        c = cost[: hi - lo]
        c[:] = 0.0
        shift = m - 1 - d
        for k in range(dims):
            _add_squares(x[k, lo:hi], y_reversed[k, lo + shift : hi + shift], c)
        _roots(c)
        now[lo] = np.inf
        now[hi + 1] = np.inf
        if d == 0:
            now[1] = c[0]
            steps[0, 0] = 3
        else:
            # (i-1, j) and (i, j-1) lie on the last diagonal, (i-1, j-1) on the one before
            _diagonal(c, before[lo:hi], before[lo + 1 : hi + 1], earlier[lo:hi], now[lo + 1 : hi + 1], steps[d, lo:hi])
            if skip < np.inf:
                if lo == 0 and skip * d + c[0] < now[1]:  # starts at (0, d)
                    now[1] = skip * d + c[0]
                    steps[d, 0] = 3
                if hi == d + 1 and skip * d + c[hi - 1 - lo] < now[d + 1]:  # starts at (d, 0)
                    now[d + 1] = skip * d + c[hi - 1 - lo]
                    steps[d, d] = 3
        if skip < np.inf:
            if lo == d - m + 1 and now[lo + 1] + skip * (n - 1 - lo) < best:  # ends at (lo, m-1)
                best, end_i, end_j = now[lo + 1] + skip * (n - 1 - lo), lo, m - 1
            if hi == n and now[n] + skip * (m - 1 - (d - n + 1)) < best:  # ends at (n-1, d-n+1)
                best, end_i, end_j = now[n] + skip * (m - 1 - (d - n + 1)), n - 1, d - n + 1
        earlier, before, now = before, now, earlier
    if skip == np.inf:
        best = before[n]
    return end_i, end_j, best


@njit(cache=True, nogil=True)
def _backtrack(steps, i, j, m, open_begin):
    path = np.empty((i + j + 1, 2), np.int32)
    k = len(path)
    while True:
        k -= 1
        path[k, 0] = i
        path[k, 1] = j
        step = steps[i + j, i]
        if step == 3 or (i == 0 and j == 0):
            break
        if i == 0:
            j -= 1
        elif j == 0:
            i -= 1
        elif step == 0:
            i -= 1
            j -= 1
        elif step == 1:
            i -= 1
        else:
            j -= 1
    return path[k:].copy()
