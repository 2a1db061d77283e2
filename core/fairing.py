"""Thin-plate fairing: made surface continues the tangent planes around it, measured surface holds its place."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
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


def fair(vertices: np.ndarray, triangles: np.ndarray, stiffness: np.ndarray, iterations: int = 30) -> np.ndarray:
    """Move vertices so that the surface bends least (thin plate), each held to its place by its stiffness.

    Minimises Σ|L p|² + Σ stiffness²·|p − p₀|² with L the scale-dependent umbrella (Desbrun et al. 1999), by
    preconditioned conjugate gradients on the normal equations; vertices of infinite stiffness do not move, so that
    what is filled continues the tangent planes around it.

    Parameters
    ----------
    vertices : np.ndarray [shape=(V, 3)]
    triangles : np.ndarray [shape=(T, 3)]
    stiffness : np.ndarray [shape=(V,)]
        0 = free, ∞ = fixed.

    Returns
    -------
    np.ndarray [shape=(V, 3)]
        O(iterations · free vertices) time.
    """
    free = np.isfinite(stiffness)
    if not free.any():
        return vertices
    used, local, near = _surroundings(triangles, free)
    start, heads = neighbours(local, len(used))
    moved = _fair_kernel(
        vertices.take(used, axis=0),
        start,
        heads,
        free[used],
        np.where(free[used], stiffness[used], 0.0),
        near[used],
        iterations,
    )
    out = vertices.copy()
    out[used] = moved
    return out


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def _rows(start, heads, weight, chosen):
    """The CSR rows of the ``chosen`` vertices alone: (row start, head, weight)."""
    first = np.zeros(len(chosen) + 1, np.int64)
    for r in range(len(chosen)):
        first[r + 1] = first[r] + start[chosen[r] + 1] - start[chosen[r]]
    head, value = np.empty(first[-1], np.int32), np.empty(first[-1])
    for r in range(len(chosen)):
        n = first[r]
        for e in range(start[chosen[r]], start[chosen[r] + 1]):
            head[n], value[n] = heads[e], weight[e]
            n += 1
    return first, head, value


@njit(cache=True, nogil=True)
def _gather(p, row, first, head, weight, own, out):
    """out[i] = Σ weight · p[head] − own[i] · p[i] for the vertices i of ``row``, (V, 3); the others are left alone."""
    for r in range(len(row)):
        i = row[r]
        x, y, z = -own[i] * p[i, 0], -own[i] * p[i, 1], -own[i] * p[i, 2]
        for e in range(first[r], first[r + 1]):
            j, w = head[e], weight[e]
            x += w * p[j, 0]
            y += w * p[j, 1]
            z += w * p[j, 2]
        out[i, 0], out[i, 1], out[i, 2] = x, y, z


@njit(cache=True, nogil=True)
def _fair_kernel(p, start, heads, free, stiffness, rows, iterations):
    """Rows of L are those where ``rows`` holds, zero elsewhere; only ``free`` vertices are unknown."""
    count = len(p)
    weight = np.empty(len(heads))
    for i in range(count):
        total = 0.0
        for e in range(start[i], start[i + 1]):
            d = 0.0
            for c in range(3):
                d += (p[i, c] - p[heads[e], c]) ** 2
            weight[e] = 1.0 / (np.sqrt(d) + 1e-5)
            total += weight[e]
        for e in range(start[i], start[i + 1]):
            weight[e] = weight[e] / total if rows[i] else 0.0
    # the transposed umbrella's weights, so that both products gather: that of the edge from the other end
    transposed = np.empty(len(heads))
    for i in range(count):
        for e in range(start[i], start[i + 1]):
            j = heads[e]
            for f in range(start[j], start[j + 1]):
                if heads[f] == i:
                    transposed[e] = weight[f]
                    break
    row, unknown = np.flatnonzero(rows), np.flatnonzero(free)
    umbrella_first, umbrella_head, umbrella = _rows(start, heads, weight, row)
    back_first, back_head, back = _rows(start, heads, transposed, unknown)
    own = rows.astype(np.float64)
    lap = np.zeros((count, 3))
    gradient = np.empty((count, 3))
    # residual of the normal equations at p0: -LᵀL p0 on the free vertices
    _gather(p, row, umbrella_first, umbrella_head, umbrella, own, lap)
    _gather(lap, unknown, back_first, back_head, back, own, gradient)
    # Jacobi preconditioner: the diagonal of LᵀL + stiffness²
    diagonal = own.copy()
    for r in range(len(row)):
        for e in range(umbrella_first[r], umbrella_first[r + 1]):
            diagonal[umbrella_head[e]] += umbrella[e] ** 2
    r = np.zeros((count, 3))
    direction = np.zeros((count, 3))
    norm = 0.0
    for i in unknown:
        diagonal[i] = 1.0 / (diagonal[i] + stiffness[i] ** 2)
        for c in range(3):
            r[i, c] = -gradient[i, c]
            direction[i, c] = diagonal[i] * r[i, c]
            norm += r[i, c] * direction[i, c]
    first = norm
    step = np.zeros((count, 3))
    for _ in range(iterations):
        if norm <= 1e-5 * first or norm == 0:
            break
        _gather(direction, row, umbrella_first, umbrella_head, umbrella, own, lap)
        _gather(lap, unknown, back_first, back_head, back, own, gradient)
        curvature = 0.0
        for i in unknown:
            for c in range(3):
                gradient[i, c] += stiffness[i] ** 2 * direction[i, c]
                curvature += direction[i, c] * gradient[i, c]
        if curvature <= 0:
            break
        alpha = norm / curvature
        new_norm = 0.0
        for i in unknown:
            for c in range(3):
                step[i, c] += alpha * direction[i, c]
                r[i, c] -= alpha * gradient[i, c]
                new_norm += diagonal[i] * r[i, c] ** 2
        beta = new_norm / norm
        norm = new_norm
        for i in unknown:
            for c in range(3):
                direction[i, c] = diagonal[i] * r[i, c] + beta * direction[i, c]
    return p + step
