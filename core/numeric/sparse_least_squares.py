"""Sparse least squares, solved directly by factorisation.

Unknowns ordered by Cuthill and McKee (1969), reversed, so that those in a common row are close together, then the
normal equations factorised within that envelope (George and Liu 1981).
"""

from __future__ import annotations

import numpy as np

from .kernels import njit

_SIDE = 4  # of the blocks a matrix is kept in: as wide as the processor's registers


def solve_squares(
    start: np.ndarray,
    columns: np.ndarray,
    values: np.ndarray,
    diagonal: np.ndarray,
    rhs: np.ndarray,
    order: np.ndarray | None = None,
) -> np.ndarray:
    """Solve (LᵀL + D) x = b, which must be positive definite.

    Parameters
    ----------
    start : np.ndarray [shape=(M+1,)]
        Where each row of L begins.
    columns, values : np.ndarray [shape=(E,)]
        Its columns, none twice in a row, and values; entries of column -1 do not count.
    diagonal : np.ndarray [shape=(N,)]
        D.
    rhs : np.ndarray [shape=(N, K)]
    order : np.ndarray [shape=(N,)], optional
        In which order to eliminate the unknowns: :func:`elimination_order` of which unknowns share a row.

    Returns
    -------
    np.ndarray [shape=(N, K)]

    Notes
    -----
    O(N · w) memory and O(N · w²) time for envelopes w wide: of a mesh about twice the vertices of its widest front, so
    that strips and many small holes take O(N).
    """
    columns, rhs = np.ascontiguousarray(columns, np.int64), np.ascontiguousarray(rhs)
    return _solve_kernel(start, columns, values, diagonal, rhs, np.arange(len(rhs)) if order is None else order)


def elimination_order(start: np.ndarray, heads: np.ndarray) -> np.ndarray:
    """Reversed Cuthill–McKee (N,): breadth first from a far end of each component, those of few neighbours first.

    ``start`` (N+1,) and ``heads`` (E,): who is whose neighbour, as CSR arrays. O(E · neighbours).
    """
    return np.ascontiguousarray(_walk_kernel(start, np.ascontiguousarray(heads, np.int64))[::-1])


@njit(cache=True, nogil=True, error_model="numpy")
def _walk_kernel(start, heads):
    """:func:`elimination_order` from its end."""
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
    return order


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def _less_products(lower, at, left, right, blocks):
    """Subtract from block ``at`` the products L · Rᵀ of ``blocks`` blocks from ``left`` and from ``right`` on."""
    c00 = c01 = c02 = c03 = c10 = c11 = c12 = c13 = c20 = c21 = c22 = c23 = c30 = c31 = c32 = c33 = 0.0
    for k in range(_SIDE * blocks):
        i, j = left + _SIDE * k, right + _SIDE * k
        l0, l1, l2, l3 = lower[i], lower[i + 1], lower[i + 2], lower[i + 3]
        r0, r1, r2, r3 = lower[j], lower[j + 1], lower[j + 2], lower[j + 3]
        c00, c01, c02, c03 = c00 + l0 * r0, c01 + l1 * r0, c02 + l2 * r0, c03 + l3 * r0
        c10, c11, c12, c13 = c10 + l0 * r1, c11 + l1 * r1, c12 + l2 * r1, c13 + l3 * r1
        c20, c21, c22, c23 = c20 + l0 * r2, c21 + l1 * r2, c22 + l2 * r2, c23 + l3 * r2
        c30, c31, c32, c33 = c30 + l0 * r3, c31 + l1 * r3, c32 + l2 * r3, c33 + l3 * r3
    products = (c00, c01, c02, c03, c10, c11, c12, c13, c20, c21, c22, c23, c30, c31, c32, c33)
    for k in range(_SIDE * _SIDE):
        lower[at + k] -= products[k]


@njit(cache=True, nogil=True, error_model="numpy")
def _flush(value):
    """Zero for numbers that are almost zero.

    Far from the right-hand sides numbers decay to denormal ones, which take the processor a hundred times as long.
    """
    return value if abs(value) > 1e-100 else 0.0


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _solve_kernel(start, columns, values, diagonal, rhs, order):  # noqa: C901  # the docstring says why it is one piece
    """:func:`solve_squares`: allocate the envelope, fill it with LᵀL + D, factorise, substitute forward and back.

    One piece: all four steps walk the same envelope, and with products fused into sums, parts that are compiled on
    their own may round otherwise.
    """
    count, width = rhs.shape
    blocks = (count + _SIDE - 1) // _SIDE
    place = np.empty(count, np.int64)
    for k in range(count):
        place[order[k]] = k
    # Row i of blocks is kept from its first, in column low[i], to the diagonal: block (i, j) at base[i] + 16 j,
    # column by column.
    low, base = np.empty(blocks, np.int64), np.empty(blocks, np.int64)
    for i in range(blocks):
        low[i] = i
    most = 0
    for row in range(len(start) - 1):
        first = count
        for e in range(start[row], start[row + 1]):
            if columns[e] >= 0:
                first = min(first, place[columns[e]])
        for e in range(start[row], start[row + 1]):
            if columns[e] >= 0:
                block = place[columns[e]] // _SIDE
                low[block] = min(low[block], first // _SIDE)
        most = max(most, start[row + 1] - start[row])
    room = 0
    for i in range(blocks):
        base[i] = 16 * (room - low[i])
        room += i - low[i] + 1
    lower = np.zeros(16 * room)
    member, value = np.empty(most, np.int64), np.empty(most)
    for row in range(len(start) - 1):
        n = 0
        for e in range(start[row], start[row + 1]):
            if columns[e] >= 0:
                member[n], value[n] = place[columns[e]], values[e]
                n += 1
        for a in range(n):
            for b in range(n):
                i, j = member[a], member[b]
                if j <= i:
                    lower[base[i // _SIDE] + _SIDE * j + i % _SIDE] += value[a] * value[b]
    for k in range(count):
        lower[base[place[k] // _SIDE] + _SIDE * place[k] + place[k] % _SIDE] += diagonal[k]
    for k in range(count, _SIDE * blocks):  # rows that fill up the last block
        lower[base[k // _SIDE] + _SIDE * k + k % _SIDE] = 1.0

    over = np.empty(_SIDE * blocks)  # 1 / diagonal
    for i in range(blocks):
        for j in range(low[i], i + 1):
            at, first = base[i] + 16 * j, max(low[i], low[j])
            _less_products(lower, at, base[i] + 16 * first, base[j] + 16 * first, j - first)
            pivot = base[j] + 16 * j
            for b in range(_SIDE):
                for m in range(b):
                    factor = lower[pivot + _SIDE * m + b]
                    for a in range(_SIDE):
                        lower[at + _SIDE * b + a] -= lower[at + _SIDE * m + a] * factor
                if j == i:
                    over[_SIDE * i + b] = 1.0 / np.sqrt(max(lower[at + _SIDE * b + b], 1e-12))
                for a in range(_SIDE):
                    lower[at + _SIDE * b + a] = _flush(lower[at + _SIDE * b + a] * over[_SIDE * j + b])

    out, x = np.empty((count, width)), np.empty((_SIDE * blocks, _SIDE))
    for first in range(0, width, _SIDE):  # so many right sides at once
        here = min(width - first, _SIDE)
        for k in range(_SIDE * blocks):
            for c in range(_SIDE):
                x[k, c] = 0.0
        for k in range(count):
            for c in range(here):
                x[k, c] = rhs[order[k], first + c]
        for i in range(blocks):
            for j in range(_SIDE * low[i], _SIDE * i):
                at = base[i] + _SIDE * j
                for a in range(_SIDE):
                    share = lower[at + a]
                    for c in range(_SIDE):
                        x[_SIDE * i + a, c] -= share * x[j, c]
            for m in range(_SIDE):
                row = _SIDE * i + m
                for c in range(_SIDE):
                    x[row, c] = _flush(x[row, c] * over[row])
                for a in range(m + 1, _SIDE):
                    for c in range(_SIDE):
                        x[_SIDE * i + a, c] -= lower[base[i] + _SIDE * row + a] * x[row, c]
        for i in range(blocks - 1, -1, -1):
            for m in range(_SIDE - 1, -1, -1):
                row = _SIDE * i + m
                for a in range(m + 1, _SIDE):
                    for c in range(_SIDE):
                        x[row, c] -= lower[base[i] + _SIDE * row + a] * x[_SIDE * i + a, c]
                for c in range(_SIDE):
                    x[row, c] = _flush(x[row, c] * over[row])
            for j in range(_SIDE * low[i], _SIDE * i):
                at = base[i] + _SIDE * j
                for c in range(_SIDE):
                    total = x[j, c]
                    for a in range(_SIDE):
                        total -= lower[at + a] * x[_SIDE * i + a, c]
                    x[j, c] = total
        for k in range(count):
            for c in range(here):
                out[order[k], first + c] = x[k, c]
    return out
