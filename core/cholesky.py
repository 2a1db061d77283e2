"""Sparse symmetric systems solved outright: ordered by Cuthill and McKee (1969), reversed, so that the entries lie near
the diagonal, then factorised within that envelope (George and Liu 1981)."""

from __future__ import annotations

import numpy as np
from numba import njit


def solve(start: np.ndarray, heads: np.ndarray, values: np.ndarray, rhs: np.ndarray) -> np.ndarray:
    """Solve A x = b for a symmetric positive definite A.

    Parameters
    ----------
    start : np.ndarray [shape=(N+1,)]
        Where each row of A begins.
    heads, values : np.ndarray [shape=(E,)]
        Columns and values, both triangles, the diagonal too.
    rhs : np.ndarray [shape=(N, K)]

    Returns
    -------
    np.ndarray [shape=(N, K)]

    Notes
    -----
    O(N · w) memory and O(N · w²) time for envelopes w wide: of a mesh about twice the vertices of its widest front, so
    that strips and many small holes take O(N).
    """
    return _solve_kernel(start, heads, values, rhs, _order(start, heads))


@njit(cache=True, nogil=True)
def _order(start, heads):
    """Reversed Cuthill–McKee: breadth first from a far end of each component, those of few neighbours first."""
    count = len(start) - 1
    order = np.empty(count, np.int64)
    seen = np.zeros(count, np.int64)  # the last walk that came by
    placed, walk = 0, 0
    for seed in range(count):
        if seen[seed] > 0:
            continue
        root = seed
        for _ in range(3):  # the last of a walk is far from its first: begin there
            walk += 1
            seen[root], order[placed] = walk, root
            at, last = placed, placed + 1
            while at < last:
                begin = last
                for e in range(start[order[at]], start[order[at] + 1]):
                    v = heads[e]
                    if seen[v] == walk:
                        continue
                    seen[v] = walk
                    degree = start[v + 1] - start[v]
                    place = last
                    while place > begin and start[order[place - 1] + 1] - start[order[place - 1]] > degree:
                        order[place] = order[place - 1]
                        place -= 1
                    order[place] = v
                    last += 1
                at += 1
            root = order[last - 1]
        placed = last
    return order[::-1].copy()


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _dot(a, b):
    total = 0.0
    for k in range(len(a)):
        total += a[k] * b[k]
    return total


@njit(cache=True, nogil=True)
def _solve_kernel(start, heads, values, rhs, order):
    count = len(order)
    place = np.empty(count, np.int64)
    for k in range(count):
        place[order[k]] = k
    # row k is kept from its first entry, in column low[k], to the diagonal
    low = np.empty(count, np.int64)
    begin = np.zeros(count + 1, np.int64)
    for k in range(count):
        low[k] = k
        for e in range(start[order[k]], start[order[k] + 1]):
            low[k] = min(low[k], place[heads[e]])
        begin[k + 1] = begin[k] + k - low[k] + 1
    lower = np.zeros(begin[-1])
    for k in range(count):
        for e in range(start[order[k]], start[order[k] + 1]):
            j = place[heads[e]]
            if j <= k:
                lower[begin[k] + j - low[k]] = values[e]
    for i in range(count):
        row = lower[begin[i] : begin[i + 1]]
        for j in range(low[i], i):
            k = max(low[i], low[j])
            other = lower[begin[j] + k - low[j] : begin[j + 1]]
            row[j - low[i]] = (row[j - low[i]] - _dot(row[k - low[i] : j - low[i]], other[:-1])) / other[-1]
        row[-1] = np.sqrt(max(row[-1] - _dot(row[:-1], row[:-1]), 1e-12))
    width = rhs.shape[1]
    x = np.empty((width, count))
    for c in range(width):
        for k in range(count):
            x[c, k] = rhs[order[k], c]
        for i in range(count):
            row = lower[begin[i] : begin[i + 1]]
            x[c, i] = (x[c, i] - _dot(row[:-1], x[c, low[i] : i])) / row[-1]
        for i in range(count - 1, -1, -1):
            row = lower[begin[i] : begin[i + 1]]
            x[c, i] /= row[-1]
            share = x[c, i]
            above = x[c, low[i] : i]
            for j in range(len(above)):
                above[j] -= row[j] * share
    out = np.empty((count, width))
    for k in range(count):
        for c in range(width):
            out[order[k], c] = x[c, k]
    return out
