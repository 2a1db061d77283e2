"""Thin-plate fairing: filled surface continues the tangent planes around it, measured surface holds its place."""

from __future__ import annotations

import numpy as np

from ..numeric.kernels import njit
from ..numeric.sparse_least_squares import elimination_order, solve_squares


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
    for v in range(vertex_count):
        packed[v + 1] = packed[v] + count[v]
    out = np.empty(packed[-1], np.int32)
    for v in range(vertex_count):
        for k in range(count[v]):
            out[packed[v] + k] = heads[start[v] + k]
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
        Time and memory as :func:`.sparse_least_squares.solve_squares` says.
    """
    free = np.isfinite(stiffness)
    if not free.any():
        return vertices
    used, local, near = _surroundings(triangles, free)
    start, heads = neighbours(local, len(used))
    rest = vertices.take(used, axis=0)
    unknown, meets, system = _system_kernel(
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
    begin, columns, values, diagonal, rhs = system
    out[used[unknown]] += solve_squares(begin, columns, values, diagonal, rhs, elimination_order(*meets))
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _surroundings(triangles, free):
    """What fairing the ``free`` vertices (V,) bool takes.

    The vertices in use (U,), the triangles in their numbers (K, 3), and which vertices (V,) share a triangle with a
    free one; their one-rings are complete.
    """
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
    """What :func:`.sparse_least_squares.solve_squares` takes to move the ``free`` vertices.

    Their numbers, which of them are neighbours (CSR), and rows of L, stiffness² and right side. Rows of L are those
    where ``rows`` holds.
    """
    count = len(p)
    unknown = np.flatnonzero(free)
    number = np.full(count, -1, np.int32)
    for n in range(len(unknown)):
        number[unknown[n]] = n
    begin = np.zeros(rows.sum() + 1, np.int64)
    column, value = np.empty(len(heads) + count, np.int32), np.empty(len(heads) + count)
    diagonal, rhs = np.empty(len(unknown)), np.empty((len(unknown), 3))
    for n in range(len(unknown)):
        i = unknown[n]
        diagonal[n] = stiffness[i] ** 2
        for c in range(3):
            rhs[n, c] = diagonal[n] * (target[i, c] - p[i, c])
    n = row = 0
    for i in range(count):
        if not rows[i]:
            continue
        first, total = n, 0.0
        bend_x = bend_y = bend_z = 0.0
        for e in range(start[i], start[i + 1]):
            j = heads[e]
            x, y, z = p[j, 0] - p[i, 0], p[j, 1] - p[i, 1], p[j, 2] - p[i, 2]
            weight = 1.0 / (0.5 * (stretch[i] + stretch[j]) * np.sqrt(x * x + y * y + z * z) + 1e-5)
            total += weight
            bend_x, bend_y, bend_z = bend_x + weight * x, bend_y + weight * y, bend_z + weight * z
            column[n], value[n] = number[j], weight
            n += 1
        scale = 1.0 / (total * stretch[i])
        for e in range(first, n):
            value[e] *= scale
        column[n], value[n] = number[i], -1.0 / stretch[i]
        n += 1
        for e in range(first, n):
            if column[e] >= 0:
                rhs[column[e], 0] -= value[e] * bend_x * scale
                rhs[column[e], 1] -= value[e] * bend_y * scale
                rhs[column[e], 2] -= value[e] * bend_z * scale
        row += 1
        begin[row] = n
    near_start, near = _meeting(start, heads, rows, unknown, number)
    return unknown, (near_start, near), (begin, column[:n].copy(), value[:n].copy(), diagonal, rhs)


@njit(cache=True, nogil=True, error_model="numpy")
def _meeting(start, heads, rows, unknown, number):
    """Which unknowns are neighbours: CSR arrays (start (N+1,), neighbour (E,)).

    Unknowns that follow one another around a vertex that does not move count as neighbours too, so that none is
    eliminated long before another in the same row.
    """
    tail, head = np.empty(2 * len(heads), np.int32), np.empty(2 * len(heads), np.int32)
    count = 0
    for v in range(len(number)):
        last = -1
        for e in range(start[v], start[v + 1]):
            one = number[heads[e]]
            if one < 0:
                continue
            if number[v] >= 0:
                tail[count], head[count] = number[v], one
                count += 1
            elif rows[v] and last >= 0:
                tail[count], head[count] = one, last
                tail[count + 1], head[count + 1] = last, one
                count += 2
            last = one
    begin = np.zeros(len(unknown) + 1, np.int64)
    for n in range(count):
        begin[tail[n] + 1] += 1
    begin = np.cumsum(begin)
    near, end = np.empty(count, np.int32), begin[:-1].copy()
    for n in range(count):
        near[end[tail[n]]] = head[n]
        end[tail[n]] += 1
    return begin, near
