"""A surface at some distance around a body, with creases bridged as cloth bridges them: a closing of the body."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from ..mesh import Mesh
from ..mesh.bvh import Bvh, build_bvh, closest_point
from ..mesh.submesh import compact

_CORNERS = np.array([(k & 1, k >> 1 & 1, k >> 2) for k in range(8)])  # of a cell
_EDGES = np.array(
    [(0, 1), (0, 2), (0, 4), (1, 3), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 6), (5, 7), (6, 7)]
)  # between corners that differ in one axis


def offset_surface(mesh: Mesh, ease: np.ndarray | float, closing: float, spacing: float) -> Mesh:
    """A closed surface around a closed mesh, an even mesh of about ``spacing`` edges, smooth in creases.

    The mesh is dilated by ease + closing and eroded by closing again (Serra 1982), by distances on a grid: a crease
    narrower than what a ball of the radius ``closing`` fits in is bridged. Only the outermost surface is kept.

    Parameters
    ----------
    mesh : Mesh
        Closed; may cross itself [m].
    ease : float or np.ndarray [shape=(V,)]
        Distance from the mesh, one for all or one a vertex, larger than half of ``spacing`` [m].
    closing : float
        Radius [m].
    spacing : float
        Of the grid [m].
    """
    vertices = np.ascontiguousarray(mesh.vertices, np.float64)
    triangles = np.ascontiguousarray(mesh.triangles, np.int32)
    easing = np.broadcast_to(np.asarray(ease, np.float64), (len(vertices),))
    margin = float(easing.max()) + closing + 2.5 * spacing
    low = vertices.min(axis=0) - margin
    counts = np.ceil((vertices.max(axis=0) + margin - low) / spacing).astype(int) + 1
    axes = [low[k] + spacing * np.arange(counts[k]) for k in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    tree, wide = build_bvh(vertices, triangles), easing[triangles].mean(axis=1) + closing
    distance, triangle, _ = closest_point(tree, points, margin)
    # positive: outside, or deep inside
    dilated = np.where(triangle < 0, np.inf, distance - wide[triangle]).reshape(counts)
    outside = reached_from_border(dilated > 0)
    dilated = np.where(outside, np.minimum(dilated, spacing), -np.minimum(np.abs(dilated), spacing))
    hull = _at_distance(zero_surface(dilated, low, spacing), tree, wide)

    tree = build_bvh(hull.vertices, hull.triangles)
    distance = np.minimum(closest_point(tree, points, closing + 2 * spacing)[0], closing + 2 * spacing).reshape(counts)
    surface = zero_surface(closing - np.where(outside, -distance, distance), low, spacing)
    return _at_distance(surface, tree, np.full(len(hull.triangles), closing))


def _at_distance(mesh: Mesh, tree: Bvh, wanted: np.ndarray) -> Mesh:
    """The mesh with its vertices at the distance ``wanted`` (T,) from the nearest of T triangles, almost as it is.

    Surface nets lie inside of what is round by a part of a cell.
    """
    distance, triangle, nearest = closest_point(tree, mesh.vertices)
    away = (mesh.vertices - nearest) / np.maximum(distance, 1e-9)[:, None]
    return replace(mesh, vertices=nearest + wanted[triangle][:, None] * away)


def reached_from_border(free: np.ndarray) -> np.ndarray:
    """Which free cells (X, Y, Z) bool hang together with the border of the grid, over faces."""
    reached = np.zeros_like(free)
    for axis in range(3):
        for end in (0, -1):
            place: list = [slice(None)] * 3
            place[axis] = end
            reached[tuple(place)] = free[tuple(place)]
    count = -1
    while count != (count := int(reached.sum())):
        for axis in range(3):
            for backwards in (False, True):
                reached = _swept(reached, free, axis, backwards)
    return reached


def _swept(reached: np.ndarray, free: np.ndarray, axis: int, backwards: bool) -> np.ndarray:
    """What is reached by going on along one axis, through free cells, from what is reached already."""
    if backwards:
        reached, free = np.flip(reached, axis), np.flip(free, axis)
    shape = [1, 1, 1]
    shape[axis] = -1
    place = np.arange(free.shape[axis]).reshape(shape)
    last_reached = np.maximum.accumulate(np.where(reached, place, -1), axis=axis)
    last_blocked = np.maximum.accumulate(np.where(free, -1, place), axis=axis)
    out = reached | (free & (last_reached > last_blocked))
    return np.flip(out, axis) if backwards else out


def zero_surface(values: np.ndarray, low: np.ndarray, spacing: float) -> Mesh:
    """Where values (X, Y, Z) on a grid are 0, negative values inside: surface nets (Gibson 1998).

    One vertex for each piece of the surface that passes a cell (Nielson 2004), in the middle of where the piece crosses
    the cell's edges; quads around the crossed edges of the grid, cut along their shorter diagonal.
    """
    inside = values < 0
    shape = np.array(values.shape) - 1
    corners = [tuple(slice(o, n + o) for o, n in zip(offset, shape, strict=True)) for offset in _CORNERS]
    case = np.zeros(shape, np.int64)
    for k, corner in enumerate(corners):
        case |= inside[corner].astype(np.int64) << k
    cells = np.flatnonzero(((case > 0) & (case < 255)).ravel())
    piece = _pieces()[case.ravel()[cells]]  # (C, 12): of each edge, -1 where the surface does not cross it
    own = np.stack([values[corner].ravel()[cells] for corner in corners], axis=1)
    first, second = own[:, _EDGES[:, 0]], own[:, _EDGES[:, 1]]
    share = np.where(piece >= 0, first / np.where(piece >= 0, first - second, 1.0), 0.0)
    ends = _CORNERS[_EDGES]
    places = ends[:, 0] + share[..., None] * (ends[:, 1] - ends[:, 0])
    places += np.stack(np.unravel_index(cells, shape), axis=1)[:, None]

    counts = piece.max(axis=1) + 1
    begin = np.concatenate(([0], np.cumsum(counts)))
    cell, edge = np.nonzero(piece >= 0)
    vertex = begin[cell] + piece[cell, edge]
    degree = np.bincount(vertex, minlength=begin[-1])
    sums = [np.bincount(vertex, places[cell, edge, k], begin[-1]) for k in range(3)]
    vertices = low + spacing * np.stack(sums, axis=1) / degree[:, None]
    row_of = np.full(int(np.prod(shape)), -1)
    row_of[cells] = np.arange(len(cells))
    row_of = row_of.reshape(shape)
    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        ahead, behind = [slice(None)] * 3, [slice(None)] * 3
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        a, b = inside[tuple(behind)], inside[tuple(ahead)]
        edges = np.argwhere(a != b)
        around = []
        for du, dv in ((-1, -1), (0, -1), (0, 0), (-1, 0)):  # the cell's place from the edge
            at = edges.copy()
            at[:, u] += du
            at[:, v] += dv
            row = row_of[tuple(at.T)]
            start = np.zeros(3, np.int64)
            start[u], start[v] = -du, -dv  # the edge's place in the cell
            around.append(begin[row] + piece[row, _edge_at(axis, start)])
        quad = np.stack(around, axis=1)
        quads.append(np.where(a[tuple(edges.T)][:, None], quad, quad[:, ::-1]))
    return compact(Mesh(vertices, _halved(vertices, np.concatenate(quads))))


def _edge_at(axis: int, start: np.ndarray) -> int:
    """Which of a cell's edges runs along an axis from a corner."""
    corner = int(start @ (1, 2, 4))
    return int(np.flatnonzero((_EDGES == (corner, corner + (1 << axis))).all(axis=1))[0])


@cache
def _pieces() -> np.ndarray:
    """For each case of inner corners (256,), which piece of the surface crosses each edge (12,) of a cell; -1 for none.

    On a side where two opposite corners are inside, each is cut off by itself: both cells beside it agree.
    """
    sides = [[k for k in range(8) if (k >> axis & 1) == end] for axis in range(3) for end in (0, 1)]
    table = np.full((256, 12), -1)
    for case in range(256):
        inner = [bool(case >> k & 1) for k in range(8)]
        label = {e: e for e, (a, b) in enumerate(_EDGES.tolist()) if inner[a] != inner[b]}
        for side in sides:
            crossed = [e for e in label if _EDGES[e, 0] in side and _EDGES[e, 1] in side]
            if len(crossed) == 4:  # those that meet in an inner corner
                ends = {e: next(k for k in _EDGES[e].tolist() if inner[k]) for e in crossed}
                pairs = [(e, f) for e in crossed for f in crossed if e < f and ends[e] == ends[f]]
            else:
                pairs = [(crossed[0], crossed[1])] if crossed else []
            for e, f in pairs:
                old, new = label[f], label[e]
                label = {g: new if other == old else other for g, other in label.items()}
        names = sorted(set(label.values()))
        for e, name in label.items():
            table[case, e] = names.index(name)
    return table


def _halved(vertices: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Triangles (2 Q, 3) int32 of quads (Q, 4), cut along the shorter diagonal."""
    corners = vertices[quads]
    first = np.linalg.norm(corners[:, 0] - corners[:, 2], axis=1)
    turned = np.where((first > np.linalg.norm(corners[:, 1] - corners[:, 3], axis=1))[:, None],
                      np.roll(quads, -1, axis=1), quads)  # fmt: skip
    return np.concatenate((turned[:, (0, 1, 2)], turned[:, (0, 2, 3)])).astype(np.int32)
