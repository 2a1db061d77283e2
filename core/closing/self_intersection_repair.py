"""Self-intersection repair.

Intersecting triangles are smoothed until they no longer intersect, or else cut out and filled anew.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..hole_filling.delaunay_refinement import edge_length_at_vertices, refine
from ..hole_filling.loop_triangulation import fill_loops
from ..hole_filling.thin_plate_fairing import fair, neighbours
from ..mesh import FILL, SURFACE, Mesh
from ..mesh.boundary_loops import boundary_loops
from ..mesh.half_edges import keep_twins, open_edges, twins
from ..mesh.self_intersections import self_intersections
from ..mesh.submesh import components_of, keep_triangles, made_vertices, remove_bowties, renumbered, triangles_touching
from ..numeric.kernels import njit
from ..views.view_maps import NOTHING_SEEN, ViewMaps

COLLISION_REACH = 0.03
"""What a new triangle may run into has a vertex nearer than this [m]."""

_TOLERATED = 0.0003  # of all triangles: what smoothing leaves of these is left
_MOST_CELLS = 2e7  # one byte each
_HOPELESS = 0.75  # of the first crossings: where so many are left after _PATIENCE rounds, smoothing does not help
_PATIENCE = 4  # rounds
_LOST_PIECE, _LOST_IN_ALL = 0.02, 0.06  # of all triangles: more than crumbs must not go with a cut
_LIMB = 2e-6  # a piece that holds more, right side out, is a part of the body, such as a hand, and no crumb [m³]
_MOST_CUT = 0.3  # of all triangles: where more run through each other, nothing sound is near to be filled to


def untangle(
    mesh: Mesh, maps: ViewMaps = NOTHING_SEEN, rounds: int = 8, cuts: int = 3, coarseness: float = 2.0
) -> tuple[Mesh, int]:
    """Smooth the surroundings of intersecting triangles until they separate; cut out and fill anew what does not.

    Each round relaxes the vertices of the triangles that still intersect, and their neighbours, from the third round on
    two rings of them; all other vertices stay where they are. Where more than a few are left then, they are taken out,
    a ring more each time, with the crumbs that are connected by them alone, and the holes are filled (as Attene 2010
    does). Where a hand or another part of the body hangs by them alone, they stay.

    Parameters
    ----------
    mesh : Mesh
        Closed. Searched are seams and fills and what touches them: depth grids do not cross themselves.
    maps : ViewMaps
        What the views saw, to keep fills out of empty space.
    rounds, cuts : int
        At most so many; smoothing stops after four rounds that have removed almost no crossings.
    coarseness : float
        Edges of what is filled anew are split where longer than this [edge lengths around].

    Returns
    -------
    mesh : Mesh
    left : int
        Triangles that still intersect one another, near where any did at first.

    Notes
    -----
    O(S log S) for S triangles searched; later rounds look at the surroundings of what moved only.
    """
    mesh, crossing = _smooth_crossings(mesh, _crossing(mesh), rounds)
    for rings in range(cuts):
        if len(crossing) <= _TOLERATED * len(mesh.triangles):  # cutting takes as long for one as for a hundred
            break
        refilled = _fill_anew(mesh, crossing, rings, maps, coarseness)
        if refilled is None:
            continue
        repaired, changed = refilled
        repaired, left = _smooth_crossings(repaired, _crossing(repaired, changed), 2)
        if len(left) < len(crossing):
            mesh, crossing = repaired, left
    return mesh, len(crossing)


def _crossing(mesh: Mesh, changed: np.ndarray | None = None) -> np.ndarray:
    """Triangles that intersect others, ascending, among seams, fills and what touches them.

    Only near the ``changed`` points (K, 3), where these are given.
    """
    near = made_vertices(mesh)
    if changed is not None:
        near &= vertices_within(mesh.vertices, changed, COLLISION_REACH)
    searched = np.flatnonzero(triangles_touching(mesh.triangles, near))
    if not len(searched):
        return searched
    return searched[np.unique(self_intersections(mesh.vertices, mesh.triangles[searched]))]


@njit(cache=True, nogil=True)
def vertices_within(vertices, points, reach):
    """Which vertices (V,) are in the cells of ``points`` (K, 3), ``reach`` wide, or beside one. O(V + K).

    Cells are wider where the points are spread so widely that there would be too many.
    """
    low = np.empty(3)
    size = np.empty(3, np.int64)
    cells = np.inf
    while cells > _MOST_CELLS:
        cells = 1.0
        for c in range(3):
            least, most = points[0, c], points[0, c]
            for i in range(len(points)):
                least, most = min(least, points[i, c]), max(most, points[i, c])
            low[c] = least - reach
            wide = (most + reach - low[c]) / reach
            size[c] = int(min(wide, _MOST_CELLS)) + 1
            cells *= wide + 1.0
        if cells > _MOST_CELLS:
            reach *= 2.0
    busy = np.zeros((size[0], size[1], size[2]), np.bool_)
    for v in range(len(points)):
        x, y, z = points[v, 0] - low[0], points[v, 1] - low[1], points[v, 2] - low[2]
        i, j, k = int(x / reach), int(y / reach), int(z / reach)
        for a in range(max(i - 1, 0), min(i + 2, size[0])):
            for b in range(max(j - 1, 0), min(j + 2, size[1])):
                for c in range(max(k - 1, 0), min(k + 2, size[2])):
                    busy[a, b, c] = True
    out = np.zeros(len(vertices), np.bool_)
    for v in range(len(vertices)):
        i = int(np.floor((vertices[v, 0] - low[0]) / reach))
        j = int(np.floor((vertices[v, 1] - low[1]) / reach))
        k = int(np.floor((vertices[v, 2] - low[2]) / reach))
        if 0 <= i < size[0] and 0 <= j < size[1] and 0 <= k < size[2]:
            out[v] = busy[i, j, k]
    return out


def _smooth_crossings(mesh: Mesh, crossing: np.ndarray, rounds: int) -> tuple[Mesh, np.ndarray]:
    """The mesh relaxed around its ``crossing`` triangles, and which still cross."""
    if not len(crossing):
        return mesh, crossing
    # only what is near matters; vertices whose whole one-ring is in it may move
    near = vertices_within(mesh.vertices, mesh.vertices[mesh.triangles[crossing].ravel()], COLLISION_REACH)
    part = np.flatnonzero(triangles_touching(mesh.triangles, near))
    inner, triangles = renumbered(mesh.triangles[part], len(mesh.vertices))
    vertices, movable = mesh.vertices[inner], near[inner]
    few, first, before = _TOLERATED * len(mesh.triangles), len(crossing), np.inf
    crossing = np.searchsorted(part, crossing)
    for number in range(rounds):
        hopeless, done = len(crossing) >= _HOPELESS * first, len(crossing) <= few and len(crossing) >= before
        if number >= _PATIENCE and (hopeless or done):
            break
        before = len(crossing)
        reach = 1 + min(number, 3) // 2
        seeds = triangles[crossing].ravel()
        # what moves, and what it may run into: triangles that reach into its surroundings
        ring, local = _rings_around(triangles, seeds, reach + 3, len(vertices))
        used, around = renumbered(triangles[local], len(vertices))
        start, heads = neighbours(around, len(used))
        core = np.flatnonzero(movable[used] & (ring[used] <= reach))
        if not len(core):
            break
        moved = _relax(vertices[used], core, start, heads, 4 + 2 * min(number, 3))
        vertices[used] = moved
        crossing = local[np.unique(self_intersections(moved, around))]
        if not len(crossing):
            break
    out = mesh.vertices.copy()
    out[inner] = vertices
    return replace(mesh, vertices=out), part[crossing]


def _fill_anew(
    mesh: Mesh, crossing: np.ndarray, rings: int, maps: ViewMaps, coarseness: float
) -> tuple[Mesh, np.ndarray] | None:
    """The mesh with its ``crossing`` triangles and so many rings around them taken out, and the holes filled.

    Also the points (K, 3) around which the mesh was changed. Nothing is cut where that would cut off a part of the
    body: there the triangles stay, and cross.

    None where that would cut out a whole piece or much of the mesh, take away a piece of more than 2 % of it, or 6 % in
    all, or cannot be closed.
    """
    whole = twins(mesh.triangles, len(mesh.vertices))
    pieces = components_of(whole, len(mesh.triangles))[1]
    keep, cut = np.ones(len(mesh.triangles), np.bool_), crossing
    for wide in (0, rings) if rings else (0,):  # what no ring may be cut around is known before
        keep[cut] = False
        if wide:
            keep[_rings_around(mesh.triangles, mesh.triangles[cut].ravel(), wide - 1, len(mesh.vertices))[1]] = False
        twin = keep_twins(whole, keep)
        label, count = components_of(twin, int(keep.sum()))
        if count < pieces or keep.sum() < (1.0 - _MOST_CUT) * len(keep):
            return None
        while count > pieces:
            limbs = _limbs(mesh.vertices, mesh.triangles[keep], label, pieces)
            if not len(limbs):
                break
            keep |= _hanging(whole, keep, label, pieces, limbs)
            twin = keep_twins(whole, keep)
            label, count = components_of(twin, int(keep.sum()))
        cut = cut[~keep[cut]]
        if not len(cut):
            return None
    if count > pieces:  # crumbs that were connected only by what is cut out go with it
        size = np.bincount(label)
        main = np.argsort(-size, kind="stable")[:pieces]
        lost = np.delete(size, main)
        if lost.max() > _LOST_PIECE * len(mesh.triangles) or lost.sum() > _LOST_IN_ALL * len(mesh.triangles):
            return None
        held = np.isin(label, main)
        keep[np.flatnonzero(keep)[~held]] = False
        twin = keep_twins(twin, held)
    rest = remove_bowties(keep_triangles(mesh, keep), twin)
    known = len(rest.triangles)
    filled = fill_loops(rest, maps, edges=open_edges(rest.triangles, len(rest.vertices), twin))
    twin = twins(filled.triangles, len(filled.vertices))
    if (twin == -1).any():
        return None
    filled = remove_bowties(filled, twin)
    assert filled.kind is not None  # fill_loops says it
    kind = filled.kind.copy()
    filled.kind[:known] = SURFACE  # only what is new is refined and moved
    filled, parents = refine(filled, edge_length_at_vertices(filled), coarseness)
    new = np.concatenate((np.zeros(len(filled.vertices) - len(parents), np.bool_), np.ones(len(parents), np.bool_)))
    vertices = fair(filled.vertices, filled.triangles, np.where(new, 0.0, np.inf))
    kind = np.concatenate((kind[:known], np.full(len(filled.triangles) - known, FILL, np.int8)))
    changed = (vertices[filled.triangles[known:].ravel()], mesh.vertices[mesh.triangles[crossing].ravel()])
    return replace(filled, vertices=vertices, kind=kind), np.concatenate(changed)


def _limbs(vertices: np.ndarray, triangles: np.ndarray, label: np.ndarray, pieces: int) -> np.ndarray:
    """Which of the connected pieces, beside the ``pieces`` largest, are parts of the body.

    They hold more than :data:`_LIMB` when their loops are closed by fans. A fold that was turned inside out holds less
    than nothing. ``label`` (T,) is the piece of each triangle.
    """
    size = np.bincount(label)
    found = []
    for piece in np.argsort(-size, kind="stable")[pieces:]:
        used, mine = renumbered(np.ascontiguousarray(triangles[label == piece]), len(vertices))
        points = vertices[used] - vertices[used].mean(axis=0)
        corners = [points[mine]]
        for loop in boundary_loops(mine, len(used)):
            rim = points[loop]
            middle = np.broadcast_to(rim.mean(axis=0), rim.shape)
            corners.append(np.stack((np.roll(rim, -1, axis=0), rim, middle), axis=1))
        if np.linalg.det(np.concatenate(corners)).sum() / 6.0 > _LIMB:
            found.append(piece)
    return np.array(found, np.int64)


def _hanging(twin: np.ndarray, keep: np.ndarray, label: np.ndarray, pieces: int, limbs: np.ndarray) -> np.ndarray:
    """The ``limbs``, and all that was cut out, or went with it, between them and the ``pieces`` largest: bool (T,).

    ``label`` is the piece of each triangle that is kept.
    """
    main = np.argsort(-np.bincount(label), kind="stable")[:pieces]
    goes, limb = ~keep, np.zeros(len(keep), np.bool_)
    goes[keep] = ~np.isin(label, main)
    limb[keep] = np.isin(label, limbs)
    part = components_of(keep_twins(twin, goes), int(goes.sum()))[0]
    hanging = np.zeros(len(keep), np.bool_)
    hanging[goes] = np.isin(part, part[limb[goes]])
    return hanging


@njit(cache=True, nogil=True)
def _rings_around(triangles, seeds, rings, count):
    """Of each vertex (V,) the ring around the seeds in which it lies, ``rings + 1`` farther off.

    And the triangles that reach into these rings, ascending. O(rings · T).
    """
    ring = np.full(count, rings + 1)
    for v in seeds:
        ring[v] = 0
    for r in range(rings):
        for t in range(len(triangles)):
            i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            if ring[i] == r or ring[j] == r or ring[k] == r:
                ring[i], ring[j], ring[k] = min(ring[i], r + 1), min(ring[j], r + 1), min(ring[k], r + 1)
    reached = np.empty(len(triangles), np.int32)
    n = 0
    for t in range(len(triangles)):
        if min(ring[triangles[t, 0]], ring[triangles[t, 1]], ring[triangles[t, 2]]) <= rings:
            reached[n] = t
            n += 1
    return ring, reached[:n].copy()


@njit(cache=True, nogil=True, error_model="numpy")
def _relax(vertices, chosen, start, heads, steps):
    """Chosen vertices moved half way to the mean of their one-ring, ``steps`` times."""
    now, after = vertices.copy(), np.empty((len(chosen), 3))
    for _ in range(steps):
        for n in range(len(chosen)):
            v = chosen[n]
            x = y = z = 0.0
            for e in range(start[v], start[v + 1]):
                x, y, z = x + now[heads[e], 0], y + now[heads[e], 1], z + now[heads[e], 2]
            share = 0.5 / (start[v + 1] - start[v])
            after[n, 0] = 0.5 * now[v, 0] + share * x
            after[n, 1] = 0.5 * now[v, 1] + share * y
            after[n, 2] = 0.5 * now[v, 2] + share * z
        for n in range(len(chosen)):
            for c in range(3):
                now[chosen[n], c] = after[n, c]
    return now
