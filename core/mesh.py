"""Triangle mesh as plain arrays: edges, boundary loops, components, manifold checks, clean-up."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from .errors import MirrorScanError
from .numeric.union_find import root_of

SURFACE, SEAM, FILL = 0, 1, 2
KIND_NAMES = ("surface", "seam", "fill")


@dataclass(frozen=True)
class Mesh:
    """Triangles over shared vertices; counter-clockwise seen from outside.

    Parameters
    ----------
    vertices : np.ndarray [shape=(V, 3), dtype=float64]
        Positions [m].
    triangles : np.ndarray [shape=(T, 3), dtype=int32]
        Vertex indices.
    colors : np.ndarray [shape=(V, 3), dtype=uint8] or None
        sRGB.
    view : np.ndarray [shape=(V,), dtype=int8] or None
        0 = seen directly, 1..N = seen through mirror N, -1 = made by us (seam or fill).
    kind : np.ndarray [shape=(T,), dtype=int8] or None
        ``SURFACE`` (measured), ``SEAM`` (zippered) or ``FILL`` (closed).
    """

    vertices: np.ndarray
    triangles: np.ndarray
    colors: np.ndarray | None = None
    view: np.ndarray | None = None
    kind: np.ndarray | None = None

    def transformed(self, matrix: np.ndarray) -> Mesh:
        """The mesh moved by a rigid or similarity ``matrix`` (4, 4)."""
        from .numeric.point_products import transform  # here: to name a mesh must not cost the import of numba

        return replace(self, vertices=transform(self.vertices, matrix))


def check_mesh(mesh: Mesh, what: str) -> None:
    """Refuse what cannot be zippered or closed, in words that begin with ``what``. O(V + T).

    Raises
    ------
    MirrorScanError
        When ``view`` or ``kind`` are missing, a vertex is not finite, or a triangle names one that does not exist.
    """
    if mesh.view is None or mesh.kind is None:
        raise MirrorScanError(f"{what}: the mesh does not say which view its vertices and what kind its triangles are")
    if not np.isfinite(mesh.vertices).all():
        raise MirrorScanError(f"{what}: a vertex of the mesh is not a finite number; take it out first")
    if len(mesh.triangles) and not 0 <= mesh.triangles.min() <= mesh.triangles.max() < len(mesh.vertices):
        raise MirrorScanError(f"{what}: a triangle names a vertex that does not exist; the mesh is damaged")


@njit(cache=True, nogil=True)
def clashing(triangles: np.ndarray, twin: np.ndarray) -> np.ndarray:
    """Triangles that keep a mesh from being a manifold, bool (T,): with a corner twice, or at an edge of more than two
    triangles or of two wound against each other."""
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
            "against their neighbours; take them out or turn them first"
        )


def edge_keys(triangles: np.ndarray, vertex_count: int) -> np.ndarray:
    """Undirected edges of each triangle as integers (T, 3): edge k runs from corner k to corner k + 1."""
    a = triangles.astype(np.int64)
    b = np.roll(a, -1, axis=1)
    return np.minimum(a, b) * vertex_count + np.maximum(a, b)


@njit(cache=True, nogil=True)
def twins(triangles: np.ndarray, vertex_count: int) -> np.ndarray:
    """The other half of each half-edge: (3·T,) int32, half-edge 3·t + k runs from corner k to corner k + 1 of
    triangle t.

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
    for key, t in found.items():
        if t >= 0:
            out[n, 0], out[n, 1], out[n, 2] = key // vertex_count, key % vertex_count, t
            n += 1
    return out[:n].copy()


def boundary_edges(triangles: np.ndarray, vertex_count: int) -> np.ndarray:
    """Directed edges (B, 2) of one triangle only, in their triangle's direction: the surface lies on their left."""
    return open_edges(triangles, vertex_count)[:, :2]


def boundary_loops(triangles: np.ndarray, vertex_count: int) -> list[np.ndarray]:
    """Closed runs of boundary vertices, longest first, each in the direction of its edges (surface on the left).

    Where loops touch in one vertex the walk leaves it by the edge that keeps the loops apart, so that each loop
    passes a vertex at most once.

    Parameters
    ----------
    triangles : np.ndarray [shape=(T, 3), dtype=int32]
        Of a mesh whose edges have at most two triangles, consistently wound.
    """
    return loops_of(open_edges(triangles, vertex_count), vertex_count)


def loops_of(edges: np.ndarray, vertex_count: int) -> list[np.ndarray]:
    """:func:`boundary_loops` of the given :func:`open_edges`."""
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


def triangle_components(triangles: np.ndarray, vertex_count: int) -> tuple[np.ndarray, int]:
    """Component (T,) int32 of each triangle, connected over shared edges, and how many there are."""
    return components_of(twins(triangles, vertex_count), len(triangles))


@njit(cache=True, nogil=True)
def components_of(twin: np.ndarray, count: int) -> tuple[np.ndarray, int]:
    """:func:`triangle_components` of ``count`` triangles whose :func:`twins` are known."""
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


@njit(cache=True, nogil=True)
def triangles_touching(triangles: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Which triangles, bool (T,), have a corner among the ``chosen`` vertices, bool (V,)."""
    out = np.empty(len(triangles), np.bool_)
    for t in range(len(triangles)):
        out[t] = chosen[triangles[t, 0]] or chosen[triangles[t, 1]] or chosen[triangles[t, 2]]
    return out


def made_vertices(mesh: Mesh) -> np.ndarray:
    """Which vertices, bool (V,), are corners of seams or fills: what was made, and the rim of what was measured."""
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
    """Fan of each corner (T, 3) among its vertex's, and the number of fans a vertex: walk round each vertex by
    twins."""
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


def triangle_normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Cross products (T, 3): normal times twice the area."""
    a, b, c = vertices[triangles[:, 0]], vertices[triangles[:, 1]], vertices[triangles[:, 2]]
    return np.cross(b - a, c - a)


def vertex_normals(vertices: np.ndarray, triangles: np.ndarray, wanted: np.ndarray | None = None) -> np.ndarray:
    """Unit vertex normals (V, 3): area-weighted mean of the triangles around; zero where unused.

    With ``wanted`` (V,) bool only these are computed, the others mean nothing.
    """
    if wanted is None:
        wanted = np.ones(len(vertices), np.bool_)
    return _vertex_normals_kernel(vertices, triangles, wanted)


@njit(cache=True, nogil=True)
def _vertex_normals_kernel(vertices, triangles, wanted):
    normals = np.zeros(vertices.shape)
    for t in range(len(triangles)):
        i, j, k = triangles[t]
        if not (wanted[i] or wanted[j] or wanted[k]):
            continue
        ax, ay, az = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
        bx, by, bz = vertices[k, 0] - vertices[i, 0], vertices[k, 1] - vertices[i, 1], vertices[k, 2] - vertices[i, 2]
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        for m in (i, j, k):
            normals[m, 0] += nx
            normals[m, 1] += ny
            normals[m, 2] += nz
    for i in range(len(vertices)):
        length = np.sqrt(normals[i, 0] ** 2 + normals[i, 1] ** 2 + normals[i, 2] ** 2)
        if length > 0:
            for c in range(3):
                normals[i, c] /= length
    return normals


def merge(meshes: list[Mesh]) -> Mesh:
    """One mesh holding all, vertices in order."""
    offsets = np.cumsum([0] + [len(m.vertices) for m in meshes])
    has_color = all(m.colors is not None for m in meshes)
    return Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.triangles + o for m, o in zip(meshes, offsets[:-1], strict=True)]).astype(np.int32),
        np.concatenate([m.colors for m in meshes]) if has_color else None,
        np.concatenate([m.view for m in meshes]),
        np.concatenate([m.kind for m in meshes]),
    )
