"""Values spread over a mesh: known ones kept or drawn towards, the others as smooth as they can be."""

from __future__ import annotations

import numpy as np

from ..mesh.half_edges import edge_keys
from ..numeric.kernels import njit


def neighbours(triangles: np.ndarray, vertex_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Who is whose neighbour: where each vertex's list begins (V + 1,), and the lists (E,), both int64."""
    keys = np.unique(edge_keys(triangles, vertex_count))
    a, b = keys // vertex_count, keys % vertex_count
    tail, head = np.concatenate((a, b)), np.concatenate((b, a))
    start = np.zeros(vertex_count + 1, np.int64)
    np.cumsum(np.bincount(tail, minlength=vertex_count), out=start[1:])
    return start, head[np.argsort(tail, kind="stable")]


def diffuse(
    graph: tuple[np.ndarray, np.ndarray], target: np.ndarray, pull: np.ndarray, member: np.ndarray, rounds: int
) -> np.ndarray:
    """Values (V, C) float64 that minimise Σ over edges (x_i - x_j)² + Σ pull_i (x_i - target_i)².

    Parameters
    ----------
    graph
        From :func:`neighbours`.
    target : np.ndarray [shape=(V, C)]
    pull : np.ndarray [shape=(V,)]
        How strongly each vertex is drawn to its target; inf holds it there.
    member : np.ndarray [shape=(V,), dtype=bool]
        Only these count, and only edges between them; others are 0.
    rounds : int
        Of over-relaxed Gauss and Seidel steps, from the nearest targets outwards at first.
    """
    start, heads = graph
    value = np.where((member & (pull > 0))[:, None], target, 0.0).astype(np.float64)
    _diffuse_kernel(
        start, heads, value, np.ascontiguousarray(target, np.float64), pull.astype(np.float64), member, rounds
    )
    return value


@njit(cache=True, nogil=True, error_model="numpy")
def _diffuse_kernel(start, heads, value, target, pull, member, rounds):
    count, width = value.shape
    # in the order of their distance from what is known, each beginning with the mean of those before
    order, reached = np.empty(count, np.int64), np.zeros(count, np.bool_)
    last = 0
    for v in range(count):
        if member[v] and pull[v] > 0.0:
            order[last] = v
            reached[v] = True
            last += 1
    at = 0
    while at < last:
        v = order[at]
        at += 1
        for e in range(start[v], start[v + 1]):
            w = heads[e]
            if member[w] and not reached[w]:
                reached[w] = True
                order[last] = w
                last += 1
                for c in range(width):
                    value[w, c] = value[v, c]
    total = np.empty(width)
    for sweep in range(rounds):
        over = 1.6 if sweep < rounds - 2 else 1.0
        for n in range(last):
            v = order[n] if sweep % 2 == 0 else order[last - 1 - n]
            if pull[v] == np.inf:
                continue
            weight = pull[v]
            for c in range(width):
                total[c] = pull[v] * target[v, c]
            for e in range(start[v], start[v + 1]):
                w = heads[e]
                if member[w]:
                    weight += 1.0
                    for c in range(width):
                        total[c] += value[w, c]
            if weight > 0.0:
                for c in range(width):
                    value[v, c] += over * (total[c] / weight - value[v, c])
