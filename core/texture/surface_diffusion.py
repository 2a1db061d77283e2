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
        How strongly each vertex is drawn to its target.
    member : np.ndarray [shape=(V,), dtype=bool]
        Only these count, and only edges between them; others are 0.
    rounds : int
        Of over-relaxed Gauss and Seidel steps.
    """
    start, heads = graph
    known = member & (pull > 0)
    begin = target[known].mean(axis=0) if known.any() else np.zeros(target.shape[1])
    value = np.where(known[:, None], target, np.where(member[:, None], begin, 0.0)).astype(np.float64)
    for c in range(target.shape[1]):
        column = np.ascontiguousarray(value[:, c])
        _diffuse_kernel(start, heads, column, np.ascontiguousarray(target[:, c], np.float64), pull, member, rounds)
        value[:, c] = column
    return value


@njit(cache=True, nogil=True, error_model="numpy")
def _diffuse_kernel(start, heads, value, target, pull, member, rounds):
    """:func:`diffuse` of one number a vertex, in place."""
    for sweep in range(rounds):
        over = 1.7 if sweep < rounds - 3 else 1.0
        for v in range(len(value)):
            if member[v]:
                weight, total = pull[v], pull[v] * target[v]
                for e in range(start[v], start[v + 1]):
                    if member[heads[e]]:
                        weight += 1.0
                        total += value[heads[e]]
                if weight > 0.0:
                    value[v] += over * (total / weight - value[v])
