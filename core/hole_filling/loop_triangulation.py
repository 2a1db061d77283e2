"""Boundary loops → triangles of least weight (Barequet and Sharir 1995, Liepa 2003).

They are kept out of space that a view saw to be empty.
"""

from __future__ import annotations

import numpy as np

from ..mesh import FILL, Mesh
from ..mesh.boundary_loops import loops_of
from ..mesh.edge_lists import empty_edges, join, joined
from ..mesh.half_edges import check_sheet, open_edges, twins
from ..mesh.triangle_mesh import check_mesh
from ..numeric.kernels import njit
from ..views.free_space import bridge_is_free
from ..views.view_maps import NOTHING_SEEN, ViewMaps

_EMPTY_PENALTY = 10.0  # a chord through space seen to be empty weighs so much more: only where no other will do
_FEW_CORNERS = 6  # in loops of no more, chords are as short as edges, and empty space is not asked for
_BEND_WEIGHT = 0.25  # of a fold along an edge, against the area of the triangles
_CUT_SHARE = 6  # a cut leaves at least one part in so many of the loop on either side


def fill_loops(
    mesh: Mesh,
    maps: ViewMaps = NOTHING_SEEN,
    largest: int = 64,
    diameter: float = np.inf,
    edges: np.ndarray | None = None,
) -> Mesh:
    """Close boundary loops by the triangulation of least weight.

    The weight sums area and bending over all triangles; chords through space that a view saw to be empty weigh tenfold.
    A chord that is already an edge of the mesh is not used; a loop that cannot do without gets a vertex in its middle.

    Parameters
    ----------
    mesh : Mesh
        Edges with at most two triangles, consistently wound.
    maps : ViewMaps
        What the views saw.
    largest : int
        Loops of more vertices are first cut in two by the chord that is shortest for the run it cuts off.
    diameter : float
        Only loops whose bounding box is smaller than this along its diagonal are closed [m].
    edges : np.ndarray [shape=(B, 3)], optional
        The mesh's :func:`~.half_edges.open_edges`, where they are known already; the mesh is then taken for sound.

    Returns
    -------
    Mesh
        Its new triangles are of kind ``FILL``, its new vertices of view -1.

    Raises
    ------
    MirrorScanError
        When the mesh is damaged or no sheet: :func:`~.triangle_mesh.check_mesh`, :func:`~.half_edges.check_sheet`.

    Notes
    -----
    O(n³) time and O(n²) memory for a loop of n ≤ ``largest`` vertices.
    """
    if edges is None:
        check_mesh(mesh, "filling")
        twin = twins(mesh.triangles, len(mesh.vertices))
        check_sheet(mesh.triangles, twin, "filling")
        edges = open_edges(mesh.triangles, len(mesh.vertices), twin)
    loops = loops_of(edges, len(mesh.vertices))
    if not loops:
        return mesh
    assert mesh.view is not None and mesh.kind is not None
    flat = np.concatenate(loops)
    starts = np.concatenate(([0], np.cumsum([len(loop) for loop in loops])))
    if np.isfinite(diameter):
        points = mesh.vertices[flat]
        box = np.maximum.reduceat(points, starts[:-1]) - np.minimum.reduceat(points, starts[:-1])
        small = np.einsum("ij,ij->i", box, box) < diameter**2
        if not small.any():
            return mesh
        flat = flat[np.repeat(small, np.diff(starts))]
        starts = np.concatenate(([0], np.cumsum(np.diff(starts)[small])))
    rim = _rim_normals(mesh.vertices, mesh.triangles, edges, flat, starts)
    fill, centers, around, around_of = _fill_kernel(
        mesh.vertices, mesh.triangles, flat, starts, rim, largest, maps.free_space
    )
    vertices, colors, from_view = mesh.vertices, mesh.colors, mesh.view
    if len(centers):
        vertices = np.concatenate((vertices, centers))
        from_view = np.concatenate((from_view, np.full(len(centers), -1, np.int8)))
        if colors is not None:
            total = np.stack([np.bincount(around_of, colors[around, c], len(centers)) for c in range(3)], axis=1)
            share = total / np.bincount(around_of, minlength=len(centers))[:, None]
            colors = np.concatenate((colors, np.rint(share).astype(np.uint8)))
    return Mesh(
        vertices,
        np.concatenate((mesh.triangles, fill)),
        colors,
        from_view,
        np.concatenate((mesh.kind, np.full(len(fill), FILL, np.int8))),
    )


def _rim_normals(
    vertices: np.ndarray, triangles: np.ndarray, edges: np.ndarray, flat: np.ndarray, starts: np.ndarray
) -> np.ndarray:
    """Unit normal (N, 3) of the triangle at each loop edge (entry → next entry)."""
    after = np.arange(1, len(flat) + 1)
    after[starts[1:] - 1] = starts[:-1]
    count = len(vertices)
    known = edges[:, 0].astype(np.int64) * count + edges[:, 1]
    order = np.argsort(known, kind="stable")
    wanted = flat.astype(np.int64) * count + flat[after]
    place = np.searchsorted(known[order], wanted, side="right") - 1
    edge = order[np.maximum(place, 0)]
    found = (place >= 0) & (known[edge] == wanted)
    i, j, k = triangles[edges[edge[found], 2]].T
    (ax, ay, az), (bx, by, bz) = (vertices[j] - vertices[i]).T, (vertices[k] - vertices[i]).T
    normal = np.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))
    length = np.sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]) + 1e-30
    rim = np.zeros((len(flat), 3))
    rim[found] = (normal / length).T
    return rim


@njit(cache=True, nogil=True, error_model="numpy")
def _cross(points, i, j, k):
    ax, ay, az = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    bx, by, bz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True, nogil=True, error_model="numpy")
def _edges_between(triangles, on_loop, room):
    """The :mod:`.edge_lists` of the edges between vertices ``on_loop`` (V,) bool, with ``room`` for more."""
    for t in range(len(triangles)):
        for k in range(3):
            room += on_loop[triangles[t, k]] and on_loop[triangles[t, (k + 1) % 3]]
    edges = empty_edges(len(on_loop), room)
    for t in range(len(triangles)):
        for k in range(3):
            i, j = triangles[t, k], triangles[t, (k + 1) % 3]
            if on_loop[i] and on_loop[j]:
                join(i, j, *edges)
    return edges


@njit(cache=True, nogil=True, error_model="numpy")
def _chords(points, vertex, edges, place, free_space):
    """Which chords i–j, i < j, of a loop of N vertices are edges of the mesh already, bool (N, N).

    And how many times their weight they count (N, N). ``place`` (V,) holds -1 before and after.
    """
    n = len(vertex)
    head, after, other = edges
    penalty, blocked = np.ones((n, n)), np.zeros((n, n), np.bool_)
    for i in range(n):
        place[vertex[i]] = i
    for i in range(n):
        at = head[vertex[i]]
        while at >= 0:
            j = place[other[at]]
            if j >= i + 2 and not (i == 0 and j == n - 1):
                blocked[i, j] = True
            at = after[at]
        if n > _FEW_CORNERS:
            for j in range(i + 2, n - (i == 0)):
                if not blocked[i, j] and bridge_is_free(points, i, points, j, free_space):
                    penalty[i, j] = _EMPTY_PENALTY
    for i in range(n):
        place[vertex[i]] = -1
    return blocked, penalty


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_kernel(vertices, triangles, flat, starts, rim, largest, free_space):
    count = len(vertices)
    on_loop = np.zeros(count, np.bool_)
    for v in flat:
        on_loop[v] = True
    # edges a chord must not repeat; every triangle of a fill and every cut adds some
    edges = _edges_between(triangles, on_loop, 5 * len(flat))
    place = np.full(count, -1, np.int32)  # of each vertex in the piece at hand
    out = np.empty((2 * len(flat), 3), np.int32)
    n_out = 0
    centers = np.empty((len(flat), 3))  # cutting a loop repeats the ends of its chords, so twice is room enough
    around = np.empty(2 * len(flat), np.int32)
    around_of = np.empty(2 * len(flat), np.int32)
    n_centers = n_around = 0
    # Pieces wait one behind the other: entries, and the rim normal of the edge that leaves each, -1 along a chord.
    waiting, sizes, pending = np.empty((2, 3 * len(flat)), np.int64), np.empty(len(flat) + 1, np.int64), 0
    held = np.empty((2, len(flat)), np.int64)
    for loop in range(len(starts) - 1):
        end = starts[loop + 1] - starts[loop]
        for k in range(end):
            waiting[0, k] = waiting[1, k] = starts[loop] + k
        sizes[0], pending = end, 1
        while pending > 0:
            pending -= 1
            n = sizes[pending]
            end -= n
            piece, edge = held[0, :n], held[1, :n]
            for k in range(n):
                piece[k], edge[k] = waiting[0, end + k], waiting[1, end + k]
            if n > largest:
                i, j = _best_chord(vertices, flat, piece, edges)
                if i >= 0:
                    join(flat[piece[i]], flat[piece[j]], *edges)
                    for first, size in ((i, j - i + 1), (j, n - j + i + 1)):
                        for k in range(size):
                            waiting[0, end + k], waiting[1, end + k] = piece[(first + k) % n], edge[(first + k) % n]
                        end += size
                        waiting[1, end - 1] = -1
                        sizes[pending] = size
                        pending += 1
                    continue
            vertex, points, normals = np.empty(n, np.int32), np.empty((n, 3)), np.empty((n, 3))
            for k in range(n):
                vertex[k] = flat[piece[k]]
                for c in range(3):
                    points[k, c] = vertices[vertex[k], c]
                    normals[k, c] = rim[edge[k], c] if edge[k] >= 0 else 0.0
            blocked, penalty = _chords(points, vertex, edges, place, free_space)
            apex = _weight_kernel(points, normals, blocked, penalty)
            if apex[0, n - 1] >= 0:
                chords, depth = np.empty((n, 2), np.int64), 1
                chords[0, 0], chords[0, 1] = 0, n - 1
                while depth > 0:
                    depth -= 1
                    i, j = chords[depth, 0], chords[depth, 1]
                    if j - i < 2:
                        continue
                    m = apex[i, j]
                    out[n_out, 0], out[n_out, 1], out[n_out, 2] = vertex[j], vertex[m], vertex[i]
                    n_out += 1
                    join(vertex[i], vertex[m], *edges)
                    join(vertex[m], vertex[j], *edges)
                    chords[depth, 0], chords[depth, 1], chords[depth + 1, 0], chords[depth + 1, 1] = i, m, m, j
                    depth += 2
            else:
                for c in range(3):
                    centers[n_centers, c] = 0.0
                for k in range(n):
                    for c in range(3):
                        centers[n_centers, c] += points[k, c] / n
                    around[n_around] = vertex[k]
                    around_of[n_around] = n_centers
                    n_around += 1
                    out[n_out, 0] = vertex[(k + 1) % n]
                    out[n_out, 1] = vertex[k]
                    out[n_out, 2] = count + n_centers
                    n_out += 1
                n_centers += 1
    return out[:n_out].copy(), centers[:n_centers].copy(), around[:n_around].copy(), around_of[:n_around].copy()


@njit(cache=True, nogil=True, error_model="numpy")
def _best_chord(vertices, flat, piece, edges):
    n = len(piece)
    best, bi, bj = np.inf, -1, -1
    for i in range(n):
        p = vertices[flat[piece[i]]]
        for j in range(i + 2, n):
            run = min(j - i, n - j + i)
            if run < n // _CUT_SHARE:
                continue
            q = vertices[flat[piece[j]]]
            d = (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2
            if d < best * run * run and not joined(flat[piece[i]], flat[piece[j]], *edges):
                best, bi, bj = d / (run * run), i, j
    return bi, bj


@njit(cache=True, nogil=True, error_model="numpy")
def _bend(points, p, q, nx, ny, nz, normal, i, j):
    """Cost of the fold between a triangle of unit normal n and its neighbour's ``normal[i, j]`` along the edge p–q."""
    ox, oy, oz = normal[i, j, 0], normal[i, j, 1], normal[i, j, 2]
    if ox == 0 and oy == 0 and oz == 0:
        return 0.0
    side = (points[p, 0] - points[q, 0]) ** 2 + (points[p, 1] - points[q, 1]) ** 2 + (points[p, 2] - points[q, 2]) ** 2
    bend = 1.0 - (nx * ox + ny * oy + nz * oz)
    return _BEND_WEIGHT * bend * bend * side


@njit(cache=True, nogil=True, error_model="numpy")
def _weight_kernel(points, rim, blocked, penalty):
    """Dynamic programme over a loop's chords: apex[i, j] is the third corner of the triangle on chord i–j (i < j)."""
    n = len(points)
    weight = np.full((n, n), np.inf)
    apex = np.full((n, n), -1, np.int32)
    normal = np.zeros((n, n, 3))  # of the triangle that closes the part between i and j
    for i in range(n - 1):
        weight[i, i + 1] = weight[i + 1, i] = 0.0
        for c in range(3):
            normal[i, i + 1, c] = rim[i, c]
    for c in range(3):
        normal[n - 1, 0, c] = rim[n - 1, c]  # of what lies behind the loop's last edge
    for span in range(2, n):
        for i in range(n - span):
            j = i + span
            if blocked[i, j]:
                continue
            best, third = np.inf, -1
            best_x = best_y = best_z = 0.0
            for m in range(i + 1, j):
                base = weight[i, m] + weight[j, m]
                if base >= best:
                    continue
                nx, ny, nz = _cross(points, j, m, i)  # the fill winds against the boundary
                length = np.sqrt(nx * nx + ny * ny + nz * nz) + 1e-30
                base += 0.5 * length * penalty[i, m] * penalty[m, j] * penalty[i, j] + 1e-9
                if base >= best:
                    continue
                nx, ny, nz = nx / length, ny / length, nz / length
                base += _bend(points, i, m, nx, ny, nz, normal, i, m) + _bend(points, m, j, nx, ny, nz, normal, m, j)
                if span == n - 1:
                    base += _bend(points, i, j, nx, ny, nz, normal, n - 1, 0)
                if base < best:
                    best, third = base, m
                    best_x, best_y, best_z = nx, ny, nz
            weight[i, j] = weight[j, i] = best  # by row and by column: both are walked along rows
            apex[i, j] = third
            normal[i, j, 0], normal[i, j, 1], normal[i, j, 2] = best_x, best_y, best_z
    return apex
