"""Parts of a mesh: components, chosen triangles, vertices that are used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..numeric.kernels import njit
from ..numeric.union_find import root_of
from .half_edges import twins
from .triangle_mesh import SURFACE, Mesh


def keep_components(mesh: Mesh, twin: np.ndarray, min_island: int | None = None) -> tuple[Mesh, int, int]:
    """The connected piece with the most triangles and, where asked for, others of at least ``min_island`` triangles.

    ``twin`` (3 T,) are the mesh's :func:`~.half_edges.twins`.

    Returns
    -------
    mesh : Mesh
    kept, dropped : int
        Pieces beside the largest one.
    """
    label, count = components_of(twin, len(mesh.triangles))
    if count < 2:
        return mesh, 0, 0
    size = np.bincount(label)
    chosen = np.zeros(count, np.bool_) if min_island is None else size >= min_island
    chosen[size.argmax()] = True
    kept = int(chosen.sum()) - 1
    return keep_triangles(mesh, chosen[label]), kept, count - 1 - kept


def triangle_components(triangles: np.ndarray, vertex_count: int) -> tuple[np.ndarray, int]:
    """Component (T,) int32 of each triangle, connected over shared edges, and how many there are."""
    return components_of(twins(triangles, vertex_count), len(triangles))


@njit(cache=True, nogil=True)
def components_of(twin: np.ndarray, count: int) -> tuple[np.ndarray, int]:
    """:func:`triangle_components` of ``count`` triangles whose :func:`.half_edges.twins` are known."""
    parent = np.arange(count)
    for e in range(3 * count):
        if twin[e] < e:  # each pair once; boundary and non-manifold edges join nothing
            continue
        a, b = root_of(parent, e // 3), root_of(parent, twin[e] // 3)
        if a != b:
            parent[max(a, b)] = min(a, b)
    label = np.empty(count, np.int32)
    n = 0
    for t in range(count):
        root = root_of(parent, t)
        if root == t:
            label[t] = n
            n += 1
        else:
            label[t] = label[root]
    return label, n


def compact(mesh: Mesh) -> Mesh:
    """The mesh without vertices that no triangle uses."""
    used, triangles = renumbered(mesh.triangles, len(mesh.vertices))
    if len(used) == len(mesh.vertices):
        return mesh
    return replace(
        mesh,
        vertices=mesh.vertices.take(used, axis=0),
        triangles=triangles,
        colors=None if mesh.colors is None else mesh.colors.take(used, axis=0),
        view=None if mesh.view is None else mesh.view.take(used),
    )


@njit(cache=True, nogil=True)
def renumbered(triangles: np.ndarray, vertex_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices that are in use, ascending (U,) int32, and the triangles in their numbers."""
    index = np.zeros(vertex_count, np.int32)
    for t in range(len(triangles)):
        for k in range(3):
            index[triangles[t, k]] = 1
    used = np.empty(index.sum(), np.int32)
    count = 0
    for v in range(vertex_count):
        if index[v]:
            used[count] = v
            index[v] = count
            count += 1
    out = np.empty(triangles.shape, np.int32)
    for t in range(len(triangles)):
        for k in range(3):
            out[t, k] = index[triangles[t, k]]
    return used, out


@njit(cache=True, nogil=True)
def triangles_touching(triangles: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Which triangles, bool (T,), have a corner among the ``chosen`` vertices, bool (V,)."""
    out = np.empty(len(triangles), np.bool_)
    for t in range(len(triangles)):
        out[t] = chosen[triangles[t, 0]] or chosen[triangles[t, 1]] or chosen[triangles[t, 2]]
    return out


def made_vertices(mesh: Mesh) -> np.ndarray:
    """Which vertices, bool (V,), are corners of seams or fills: filled surface, and the edge of what was measured."""
    out = np.zeros(len(mesh.vertices), np.bool_)
    out[mesh.triangles[mesh.kind != SURFACE]] = True
    return out


def keep_triangles(mesh: Mesh, keep: np.ndarray) -> Mesh:
    """The mesh of the triangles where ``keep`` (T,) bool holds, unused vertices dropped."""
    kept = np.flatnonzero(keep)
    if len(kept) == len(mesh.triangles):
        return compact(mesh)
    triangles = mesh.triangles.take(kept, axis=0)
    return compact(replace(mesh, triangles=triangles, kind=None if mesh.kind is None else mesh.kind.take(kept)))


def drop_small_components(mesh: Mesh, min_triangles: int) -> Mesh:
    """The mesh without connected pieces of fewer than ``min_triangles``."""
    if not len(mesh.triangles):
        return mesh
    label, count = triangle_components(mesh.triangles, len(mesh.vertices))
    return keep_triangles(mesh, np.bincount(label, minlength=count)[label] >= min_triangles)


def remove_bowties(mesh: Mesh, twin: np.ndarray | None = None) -> Mesh:
    """Where separate fans of triangles meet in one vertex, give each fan its own copy of it.

    Afterwards every vertex's triangles form one fan. Assumes edges with at most two triangles. O(T log T).
    """
    count = len(mesh.vertices)
    if not len(mesh.triangles):
        return mesh
    corner_fan, fans_of = _fan_kernel(mesh.triangles, twins(mesh.triangles, count) if twin is None else twin, count)
    extra = fans_of > 1
    if not extra.any():
        return mesh
    first = np.zeros(count + 1, np.int64)
    np.cumsum(np.maximum(fans_of - 1, 0), out=first[1:])
    triangles = mesh.triangles.copy()
    copied = corner_fan > 0
    triangles[copied] = count + first[mesh.triangles[copied]] + corner_fan[copied] - 1
    source = np.repeat(np.arange(count), np.maximum(fans_of - 1, 0))
    grown = replace(
        mesh,
        vertices=np.concatenate((mesh.vertices, mesh.vertices[source])),
        triangles=triangles,
        colors=None if mesh.colors is None else np.concatenate((mesh.colors, mesh.colors[source])),
        view=None if mesh.view is None else np.concatenate((mesh.view, mesh.view[source])),
    )
    return compact(grown)


def vertex_fans(triangles: np.ndarray, vertex_count: int) -> np.ndarray:
    """How many separate fans of triangles meet at each vertex (V,): 1 on a manifold, 0 where unused."""
    return _fan_kernel(triangles, twins(triangles, vertex_count), vertex_count)[1]


@njit(cache=True, nogil=True)
def _fan_kernel(triangles, twin, vertex_count):
    """Fan of each corner (T, 3) among its vertex's, and the number of fans a vertex.

    Walk around each vertex along the twins.
    """
    fan = np.full(triangles.shape, -1, np.int32)
    fans_of = np.zeros(vertex_count, np.int32)
    for t0 in range(len(triangles)):
        for k0 in range(3):
            if fan[t0, k0] >= 0:
                continue
            v = triangles[t0, k0]
            number = fans_of[v]
            fans_of[v] += 1
            fan[t0, k0] = number
            t, k = t0, k0
            while True:  # over the edge that leaves v
                e = twin[3 * t + k]
                if e < 0:
                    break
                t, k = e // 3, (e % 3 + 1) % 3
                if fan[t, k] >= 0:
                    break
                fan[t, k] = number
            t, k = t0, k0
            while True:  # over the edge that enters v
                e = twin[3 * t + (k + 2) % 3]
                if e < 0:
                    break
                t, k = e // 3, e % 3
                if fan[t, k] >= 0:
                    break
                fan[t, k] = number
    return fan, fans_of
