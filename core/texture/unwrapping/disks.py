"""Parts of a surface that can be laid flat: which are disks, and labels without parts that are too small."""

from __future__ import annotations

import numpy as np

from ...mesh.half_edges import twins
from ...mesh.submesh import components_of, remove_bowties, renumbered
from ...mesh.triangle_mesh import Mesh


def is_disk(triangles: np.ndarray, vertex_count: int) -> bool:
    """Whether triangles are one piece with one boundary and no handle, where they touch in a vertex taken apart."""
    if len(triangles) == 1:
        return True
    vertices, edges, single = _counts(triangles, vertex_count)
    # One piece with Euler characteristic 1 and a boundary is a disk.
    return single and vertices - edges + len(triangles) == 1


def _counts(triangles: np.ndarray, vertex_count: int) -> tuple[int, int, bool]:
    """Vertices and edges of triangles, and whether they are one piece; fans that touch in a vertex count apart."""
    used, own = renumbered(triangles, vertex_count)
    apart = remove_bowties(Mesh(np.zeros((len(used), 3)), own)).triangles
    vertices = int(apart.max()) + 1
    twin = twins(apart, vertices)
    edges = (len(twin) + int((twin < 0).sum())) // 2
    return vertices, edges, components_of(twin, len(apart))[1] == 1


def without_small(label: np.ndarray, twin: np.ndarray, area: np.ndarray, share: float) -> np.ndarray:
    """Connected pieces (T,) of the labels, those of little area joined to the neighbour along most of their border."""
    own = np.arange(len(twin)) // 3
    other = np.where(twin >= 0, twin // 3, own)
    while True:
        same = (twin >= 0) & (label[own] == label[other])
        piece = components_of(np.where(same, twin, -1).astype(np.int32), len(label))[0].astype(np.int64)
        size = np.bincount(piece, weights=area)
        border = piece[own] != piece[other]
        a, b = piece[own[border]], piece[other[border]]
        small = np.flatnonzero((size < share * size.sum()) & (np.bincount(a, minlength=len(size)) > 0))
        if not len(small):
            return piece
        # the smallest first: others may have grown by then
        smallest = small[size[small].argsort()[: max(1, len(small) // 2)]]
        target = np.arange(len(size))
        joined = np.zeros(len(size), np.bool_)
        for k in smallest:
            beside = np.bincount(b[a == k], minlength=len(size))
            best = int(beside.argmax())
            if not joined[k] and not joined[best]:
                target[k] = best
                joined[k] = joined[best] = True
        label = target[piece]
