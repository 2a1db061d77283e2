"""Thin-plate fairing: made surface continues the tangent planes around it, measured surface holds its place."""

from __future__ import annotations

import numpy as np
from numba import njit

from .cholesky import solve


@njit(cache=True, nogil=True, error_model="numpy")
def neighbours(triangles: np.ndarray, vertex_count: int) -> tuple[np.ndarray, np.ndarray]:
    """One-rings as CSR arrays (start (V+1,), neighbour (E,)); an edge with one triangle counts like any other. O(T)."""
    start = np.zeros(vertex_count + 1, np.int64)
    for t in range(len(triangles)):
        for k in range(3):
            start[triangles[t, k] + 1] += 2
    for v in range(vertex_count):
        start[v + 1] += start[v]
    heads = np.empty(start[-1], np.int32)
    count = np.zeros(vertex_count, np.int64)
    for t in range(len(triangles)):
        for k in range(3):
            i = triangles[t, k]
            for j in (triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]):
                known = False
                for e in range(start[i], start[i] + count[i]):
                    if heads[e] == j:
                        known = True
                        break
                if not known:
                    heads[start[i] + count[i]] = j
                    count[i] += 1
    packed = np.zeros(vertex_count + 1, np.int64)
    out = np.empty(count.sum(), np.int32)
    for v in range(vertex_count):
        packed[v + 1] = packed[v] + count[v]
        out[packed[v] : packed[v + 1]] = heads[start[v] : start[v] + count[v]]
    return packed, out


def fair(
    vertices: np.ndarray,
    triangles: np.ndarray,
    stiffness: np.ndarray,
    stretch: np.ndarray | None = None,
    target: np.ndarray | None = None,
) -> np.ndarray:
    """Move vertices so that the surface bends least (thin plate), each held to its place by its stiffness.

    Minimises Σ|L p|² + Σ stiffness²·|p − target|² with L the scale-dependent umbrella (Desbrun et al. 1999), outright;
    vertices of infinite stiffness do not move, so that what is filled continues the tangent planes around it.

    Parameters
    ----------
    vertices : np.ndarray [shape=(V, 3)]
    triangles : np.ndarray [shape=(T, 3)]
    stiffness : np.ndarray [shape=(V,)]
        0 = free, ∞ = fixed.
    stretch : np.ndarray [shape=(V,)], optional
        Edges are taken for this many times as long as they are: what is to be drawn out from a flat start into a
        bulge has farther to go.
    target : np.ndarray [shape=(V, 3)], optional
        Where vertices are held, by default where they are.

    Returns
    -------
    np.ndarray [shape=(V, 3)]
        Time and memory as :func:`.cholesky.solve` says.
    """
    free = np.isfinite(stiffness)
    if not free.any():
        return vertices
    used, local, near = _surroundings(triangles, free)
    start, heads = neighbours(local, len(used))
    rest = vertices.take(used, axis=0)
    unknown, *system = _system_kernel(
        rest,
        start,
        heads,
        free[used],
        np.where(free[used], stiffness[used], 0.0),
        near[used],
        np.ones(len(used)) if stretch is None else stretch[used],
        rest if target is None else target[used],
    )
    out = vertices.copy()
    out[used[unknown]] += solve(*system)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _surroundings(triangles, free):
    """What fairing the ``free`` vertices (V,) bool takes: the vertices in use (U,), the triangles in their numbers
    (K, 3), and which vertices (V,) share a triangle with a free one; their one-rings are complete."""
    count = len(free)
    near, needed = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
    for t in range(len(triangles)):
        i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        if free[i] or free[j] or free[k]:
            near[i] = near[j] = near[k] = True
    chosen = 0
    for t in range(len(triangles)):
        i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        if near[i] or near[j] or near[k]:
            needed[i] = needed[j] = needed[k] = True
            chosen += 1
    used = np.flatnonzero(needed)
    index = np.empty(count, np.int32)
    for n in range(len(used)):
        index[used[n]] = n
    local = np.empty((chosen, 3), np.int32)
    n = 0
    for t in range(len(triangles)):
        i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        if near[i] or near[j] or near[k]:
            local[n, 0], local[n, 1], local[n, 2] = index[i], index[j], index[k]
            n += 1
    return used, local, near


@njit(cache=True, nogil=True, error_model="numpy")
def _system_kernel(p, start, heads, free, stiffness, rows, stretch, target):
    """Normal equations LᵀL + stiffness² of the ``free`` vertices' moves: their numbers, the matrix's row starts,
    columns and values, and the right side. Rows of L are those where ``rows`` holds."""
    count = len(p)
    weight = np.empty(len(heads))
    for i in range(count):
        total = 0.0
        for e in range(start[i], start[i + 1]):
            j = heads[e]
            d = 0.0
            for c in range(3):
                d += (p[i, c] - p[j, c]) ** 2
            weight[e] = 1.0 / (0.5 * (stretch[i] + stretch[j]) * np.sqrt(d) + 1e-5)
            total += weight[e]
        for e in range(start[i], start[i + 1]):
            weight[e] = weight[e] / total / stretch[i] if rows[i] else 0.0
    bend = np.zeros((count, 3))
    for i in range(count):
        if rows[i]:
            for c in range(3):
                bend[i, c] = -p[i, c] / stretch[i]
            for e in range(start[i], start[i + 1]):
                for c in range(3):
                    bend[i, c] += weight[e] * p[heads[e], c]
    unknown = np.flatnonzero(free)
    number = np.full(count, -1, np.int32)
    for n in range(len(unknown)):
        number[unknown[n]] = n
    first = np.zeros(len(unknown) + 1, np.int64)
    room = 32 * len(unknown)
    column, value = np.empty(room, np.int32), np.empty(room)
    rhs = np.empty((len(unknown), 3))
    at = np.full(len(unknown), -1, np.int64)  # where this row has its entry of each column
    n = 0
    for k in range(len(unknown)):
        i = unknown[k]
        begin = n
        for c in range(3):
            rhs[k, c] = stiffness[i] ** 2 * (target[i, c] - p[i, c])
        for e in range(start[i] - 1, start[i + 1]):  # the rows of L in which i comes: its own, its neighbours'
            r = i if e < start[i] else heads[e]
            if not rows[r]:
                continue
            own = -1.0 / stretch[i]
            if r != i:
                for f in range(start[r], start[r + 1]):
                    if heads[f] == i:
                        own = weight[f]
                        break
            for c in range(3):
                rhs[k, c] -= own * bend[r, c]
            if n + start[r + 1] - start[r] + 1 > room:
                room *= 2
                column, value = (
                    np.append(column, np.empty(room - len(column), np.int32)),
                    np.append(value, np.empty(room - len(value))),
                )
            for f in range(start[r] - 1, start[r + 1]):
                j = number[r] if f < start[r] else number[heads[f]]
                if j < 0:
                    continue
                if at[j] < begin:
                    at[j] = n
                    column[n], value[n] = j, 0.0
                    n += 1
                value[at[j]] += own * (-1.0 / stretch[r] if f < start[r] else weight[f])
        value[at[k]] += stiffness[i] ** 2
        first[k + 1] = n
    return unknown, first, column[:n].copy(), value[:n].copy(), rhs
