"""Half-edges: the other half of each, open edges, and what keeps triangles from being a manifold."""

from __future__ import annotations

import numpy as np

from ..errors import MirrorScanError
from ..numeric.kernels import njit


@njit(cache=True, nogil=True)
def clashing(triangles: np.ndarray, twin: np.ndarray) -> np.ndarray:
    """Triangles that keep a mesh from being a manifold, bool (T,).

    With a corner twice, or at an edge of more than two triangles or of two wound against each other.
    """
    out = np.empty(len(triangles), np.bool_)
    for t in range(len(triangles)):
        i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        out[t] = i == j or j == k or k == i or twin[3 * t] == -2 or twin[3 * t + 1] == -2 or twin[3 * t + 2] == -2
    return out


def check_sheet(triangles: np.ndarray, twin: np.ndarray, what: str) -> None:
    """Refuse triangles of which some are :func:`clashing`, in words that begin with ``what``.

    Raises
    ------
    MirrorScanError
    """
    clashes = int(np.count_nonzero(clashing(triangles, twin)))
    if clashes:
        raise MirrorScanError(
            f"{what}: {clashes} triangles have a corner twice, share an edge with more than one other, or are wound "
            "against their neighbours; remove or flip them first"
        )


def edge_keys(triangles: np.ndarray, vertex_count: int) -> np.ndarray:
    """Undirected edges of each triangle as integers (T, 3): edge k runs from corner k to corner k + 1."""
    a = triangles.astype(np.int64)
    b = np.roll(a, -1, axis=1)
    return np.minimum(a, b) * vertex_count + np.maximum(a, b)


@njit(cache=True, nogil=True)
def twins(triangles: np.ndarray, vertex_count: int) -> np.ndarray:
    """The other half of each half-edge.

    (3·T,) int32, half-edge 3·t + k runs from corner k to corner k + 1 of triangle t.

    -1 where there is none (boundary); -2 where an edge has more than two triangles or two of the same direction.
    Half-edges are bucketed by their smaller vertex, so it takes O(T) time and memory.
    """
    count = 3 * len(triangles)
    start = np.zeros(vertex_count + 1, np.int32)
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        start[min(a, b) + 1] += 1
        start[min(b, c) + 1] += 1
        start[min(c, a) + 1] += 1
    for v in range(vertex_count):
        start[v + 1] += start[v]
    fill = start[:-1].copy()
    bucket = np.empty(count, np.int32)
    high = np.empty(count, np.int32)  # the larger vertex, negated where it is the tail
    for t in range(len(triangles)):
        for k in range(3):
            tail, head = triangles[t, k], triangles[t, k + 1 if k < 2 else 0]
            low = min(tail, head)
            at = fill[low]
            bucket[at] = 3 * t + k
            high[at] = head + 1 if tail < head else -(tail + 1)
            fill[low] = at + 1
    twin = np.full(count, -1, np.int32)
    for v in range(vertex_count):
        for i in range(start[v], start[v + 1]):
            other = abs(high[i])
            for j in range(i + 1, start[v + 1]):
                if abs(high[j]) != other:
                    continue
                e, f = bucket[i], bucket[j]
                if twin[e] == -1 and twin[f] == -1 and high[i] != high[j]:
                    twin[e] = f
                    twin[f] = e
                else:
                    for g in (e, f):
                        if twin[g] >= 0:
                            twin[twin[g]] = -2
                        twin[g] = -2
    return twin


@njit(cache=True, nogil=True)
def boundary_vertices(triangles: np.ndarray, vertex_count: int) -> np.ndarray:
    """Which vertices lie on a boundary, bool (V,), of a consistently wound mesh; unused ones do not.

    Around an inner vertex the next and previous corners of its triangles are the same set: their hashes cancel.
    """
    balance = np.zeros(vertex_count, np.uint64)
    for t in range(len(triangles)):
        for k in range(3):
            a = np.uint64(triangles[t, (k + 1) % 3]) + np.uint64(1)
            b = np.uint64(triangles[t, (k + 2) % 3]) + np.uint64(1)
            balance[triangles[t, k]] += _hash(a) - _hash(b)
    return balance != 0


@njit(cache=True, nogil=True)
def _hash(x):
    """Finaliser of splitmix64 (Steele, Lea and Flood 2014)."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def extend_twins(twin: np.ndarray, triangles: np.ndarray, vertex_count: int) -> np.ndarray:
    """:func:`twins` after triangles were added behind those whose ``twin`` is known, at open edges only."""
    known = len(twin) // 3
    some = np.concatenate((np.unique(np.flatnonzero(twin == -1) // 3), np.arange(known, len(triangles))))
    found = twins(triangles[some], vertex_count)
    found = np.where(found >= 0, 3 * some[found // 3] + found % 3, found)
    out = np.concatenate((twin, np.full(3 * (len(triangles) - known), -1, np.int32)))
    half = (3 * some[:, None] + np.arange(3)).ravel()
    news = out[half] == -1
    out[half[news]] = found[news]
    return out


def open_edges(triangles: np.ndarray, vertex_count: int, twin: np.ndarray | None = None) -> np.ndarray:
    """Edges of one triangle only: rows (tail, head, triangle), int32 (B, 3), in their triangle's direction.

    The surface lies on the left of the edge. Pass ``twin`` where :func:`twins` is known already.
    """
    alone = np.flatnonzero((twins(triangles, vertex_count) if twin is None else twin) == -1)
    rows = np.empty((len(alone), 3), np.int32)
    rows[:, 0] = triangles.ravel()[alone]
    rows[:, 1] = triangles[alone // 3, (alone % 3 + 1) % 3]
    rows[:, 2] = alone // 3
    return rows


@njit(cache=True, nogil=True)
def extend_open_edges(edges: np.ndarray, triangles: np.ndarray, first: int, vertex_count: int) -> np.ndarray:
    """:func:`open_edges` after the triangles from ``first`` on were added, without looking at the others."""
    found = dict()
    found[np.int64(-1)] = np.int64(-1)
    for e in range(len(edges)):
        found[np.int64(edges[e, 0]) * vertex_count + edges[e, 1]] = np.int64(edges[e, 2])
    for t in range(first, len(triangles)):
        for k in range(3):
            i, j = np.int64(triangles[t, k]), np.int64(triangles[t, (k + 1) % 3])
            back = j * vertex_count + i
            if back in found and found[back] >= 0:
                found[back] = np.int64(-2)  # closed
            else:
                found[i * vertex_count + j] = np.int64(t)
    out = np.empty((len(found), 3), np.int32)
    n = 0
    for key, t in found.items():  # type: ignore[assignment]
        if t >= 0:
            out[n, 0], out[n, 1], out[n, 2] = key // vertex_count, key % vertex_count, t
            n += 1
    return out[:n].copy()


@njit(cache=True, nogil=True)
def keep_twins(twin: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """:func:`twins` of the triangles where ``keep`` (T,) bool holds, from those of all."""
    index = np.empty(len(keep), np.int32)
    count = 0
    for t in range(len(keep)):
        index[t] = count
        count += keep[t]
    out = np.empty(3 * count, np.int32)
    for t in range(len(keep)):
        if keep[t]:
            for k in range(3):
                e = twin[3 * t + k]
                if e >= 0:
                    e = 3 * index[e // 3] + e % 3 if keep[e // 3] else -1
                out[3 * index[t] + k] = e
    return out
