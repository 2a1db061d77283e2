"""Self-intersections out: what runs through itself is smoothed, a little more in each round, until it no longer
does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numba import njit

from .bvh import self_intersections
from .fairing import neighbours
from .mesh import SURFACE, Mesh, triangles_touching


def untangle(mesh: Mesh, rounds: int = 6, rings: int = 0) -> tuple[Mesh, int]:
    """Smooth the surroundings of intersecting triangles until they come apart.

    Each round relaxes the vertices of the triangles that still intersect, and their neighbours one ring farther than
    the round before; all other vertices stay where they are. Connectivity does not change.

    Parameters
    ----------
    rounds : int
        At most so many.
    rings : int
        Searched are seams and fills, what touches them, and so many rings more: depth grids do not cross themselves.

    Returns
    -------
    mesh : Mesh
    left : int
        Triangles that still intersect one another, near where any did at first.

    Notes
    -----
    O(S log S) for S triangles searched; later rounds look at the surroundings of what moved only.
    """
    near = np.zeros(len(mesh.vertices), np.bool_)
    near[mesh.triangles[mesh.kind != SURFACE]] = True
    for _ in range(rings):
        near[mesh.triangles[triangles_touching(mesh.triangles, near)]] = True
    searched = np.flatnonzero(triangles_touching(mesh.triangles, near))
    if not len(searched):
        return mesh, 0
    crossing = searched[np.unique(self_intersections(mesh.vertices, mesh.triangles[searched]))]
    if not len(crossing):
        return mesh, 0
    vertices = mesh.vertices.copy()
    for turn in range(rounds):
        reach = 1 + turn // 2
        seeds = mesh.triangles[crossing].ravel()
        # what moves, and what it may run into: triangles that reach into its surroundings
        local = _triangles_within(mesh.triangles, seeds, reach + 3, len(vertices))
        used, triangles = np.unique(mesh.triangles[local], return_inverse=True)
        triangles = triangles.reshape(-1, 3).astype(np.int32)
        start, heads = neighbours(triangles, len(used))
        core = _grow(np.searchsorted(used, seeds), start, heads, reach, len(used))
        moved = _relax(vertices[used], core, start, heads, 4 + 2 * turn)
        vertices[used] = moved
        crossing = local[np.unique(self_intersections(moved, triangles))]
        if not len(crossing):
            break
    return replace(mesh, vertices=vertices), len(crossing)


@njit(cache=True, nogil=True)
def _triangles_within(triangles, vertices, rings, count):
    """Triangles that reach into the vertices' surroundings of so many rings, ascending. O(rings · T)."""
    ring = np.full(count, rings + 1)  # how far away each vertex is, as far as that matters
    for v in vertices:
        ring[v] = 0
    for r in range(rings):
        for t in range(len(triangles)):
            i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            if ring[i] == r or ring[j] == r or ring[k] == r:
                ring[i], ring[j], ring[k] = min(ring[i], r + 1), min(ring[j], r + 1), min(ring[k], r + 1)
    out = np.empty(len(triangles), np.int32)
    n = 0
    for t in range(len(triangles)):
        if min(ring[triangles[t, 0]], ring[triangles[t, 1]], ring[triangles[t, 2]]) <= rings:
            out[n] = t
            n += 1
    return out[:n].copy()


def _ring(vertices: np.ndarray, start: np.ndarray, heads: np.ndarray) -> np.ndarray:
    """All neighbours of the given vertices, with repeats."""
    counts = start[vertices + 1] - start[vertices]
    offset = np.repeat(start[vertices] - np.concatenate(([0], np.cumsum(counts)[:-1])), counts)
    return heads[np.arange(counts.sum()) + offset]


def _grow(vertices: np.ndarray, start: np.ndarray, heads: np.ndarray, rings: int, count: int) -> np.ndarray:
    """The vertices and those within so many rings of them, sorted."""
    inside = np.zeros(count, np.bool_)
    inside[vertices] = True
    for _ in range(rings):
        inside[_ring(np.flatnonzero(inside), start, heads)] = True
    return np.flatnonzero(inside)


def _relax(vertices: np.ndarray, chosen: np.ndarray, start: np.ndarray, heads: np.ndarray, steps: int) -> np.ndarray:
    """Chosen vertices moved half way to the mean of their one-ring, ``steps`` times."""
    vertices = vertices.copy()
    counts = start[chosen + 1] - start[chosen]
    ring = _ring(chosen, start, heads)
    begin = np.concatenate(([0], np.cumsum(counts)[:-1]))
    for _ in range(steps):
        mean = np.add.reduceat(vertices[ring], begin, axis=0) / counts[:, None]
        vertices[chosen] = 0.5 * (vertices[chosen] + mean)
    return vertices
