"""Open edges as closed loops."""

from __future__ import annotations

import numpy as np

from ..numeric.kernels import njit
from .half_edges import open_edges


def boundary_loops(triangles: np.ndarray, vertex_count: int) -> list[np.ndarray]:
    """Closed runs of boundary vertices, longest first, each in the direction of its edges (surface on the left).

    Where loops touch in one vertex the walk leaves it by the edge that keeps the loops separate, so that each loop
    passes a vertex at most once.

    Parameters
    ----------
    triangles : np.ndarray [shape=(T, 3), dtype=int32]
        Of a mesh whose edges have at most two triangles, consistently wound.
    """
    return loops_of(open_edges(triangles, vertex_count), vertex_count)


def loops_of(edges: np.ndarray, vertex_count: int) -> list[np.ndarray]:
    """:func:`boundary_loops` of the given :func:`.half_edges.open_edges`."""
    if not len(edges):
        return []
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    flat, starts = _loops_kernel(np.ascontiguousarray(edges[order, :2]), vertex_count)
    loops = [flat[a:b] for a, b in zip(starts[:-1], starts[1:], strict=True)]
    return sorted((loop for loop in loops if len(loop) >= 3), key=lambda loop: (-len(loop), int(loop[0])))


@njit(cache=True, nogil=True)
def _loops_kernel(edges, vertex_count):
    """Walk the edges (sorted by tail); when a vertex comes again, the loop closed by it is cut off."""
    count = len(edges)
    first = np.full(vertex_count + 1, -1, np.int64)
    for e in range(count - 1, -1, -1):
        first[edges[e, 0]] = e
    used = np.zeros(count, np.bool_)
    place = np.full(vertex_count, -1, np.int64)  # position of a vertex on the current walk
    walk = np.empty(count + 1, np.int32)
    flat = np.empty(count, np.int32)
    starts = np.zeros(count + 1, np.int64)
    n_flat, n_loops = 0, 0
    for seed in range(count):
        if used[seed]:
            continue
        length = 0
        vertex = edges[seed, 0]
        while True:
            if place[vertex] >= 0:
                begin = place[vertex]
                for k in range(begin, length):
                    flat[n_flat] = walk[k]
                    n_flat += 1
                    place[walk[k]] = -1
                n_loops += 1
                starts[n_loops] = n_flat
                length = begin
            e = first[vertex]
            while e >= 0 and e < count and edges[e, 0] == vertex and used[e]:
                e += 1
            if e < 0 or e >= count or edges[e, 0] != vertex:
                for k in range(length):  # an open walk: the boundary is not closed here
                    place[walk[k]] = -1
                break
            used[e] = True
            place[vertex] = length
            walk[length] = vertex
            length += 1
            vertex = edges[e, 1]
    return flat[:n_flat].copy(), starts[: n_loops + 1].copy()
