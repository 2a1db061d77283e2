"""Where a mesh is faulty or filled: places for a person to look at, worst first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..numeric.kernels import njit
from ..numeric.point_products import cross, lengths
from ..numeric.union_find import root_of
from .boundary_loops import loops_of
from .half_edges import edge_keys, open_edges
from .normals import triangle_normals
from .self_intersections import self_intersections
from .submesh import triangle_components
from .triangle_mesh import FILL, Mesh


@njit(cache=True, nogil=True)
def _fans_and_components(triangles, pairs, vertex_count):
    """Vertices whose triangles are more than one fan, and triangles connected over edges: how many of each.

    ``pairs`` (P, 2): the corners (3 * triangle + k) from which the two triangles of each inner edge see it.
    """
    total = triangles.shape[0]
    corner = np.arange(3 * total)
    piece = np.arange(total)
    for p in range(pairs.shape[0]):
        e, f = pairs[p, 0], pairs[p, 1]
        t, s = e // 3, f // 3
        a, b = root_of(piece, t), root_of(piece, s)
        piece[max(a, b)] = min(a, b)
        for i in (e, 3 * t + (e + 1) % 3):
            for j in (f, 3 * s + (f + 1) % 3):
                if triangles[t, i % 3] == triangles[s, j % 3]:
                    a, b = root_of(corner, i), root_of(corner, j)
                    corner[max(a, b)] = min(a, b)
    components = 0
    for t in range(total):
        if piece[t] == t:
            components += 1
    fans = np.zeros(vertex_count, np.int32)
    for i in range(3 * total):
        if corner[i] == i:
            fans[triangles[i // 3, i % 3]] += 1
    return np.count_nonzero(fans > 1), components


def connectivity(mesh: Mesh) -> dict:
    """Counts that need the edges only; see :func:`mesh_report`."""
    triangles, count = np.ascontiguousarray(mesh.triangles, np.int32), len(mesh.vertices)
    keys = edge_keys(triangles, count).ravel()
    order = np.argsort(keys, kind="stable")
    begin = np.flatnonzero(np.concatenate(([True], np.diff(keys[order]) != 0))) if len(keys) else np.empty(0, np.int64)
    uses = np.diff(np.concatenate((begin, [len(keys)])))
    first = begin[uses == 2]
    pairs = np.column_stack((order[first], order[first + 1]))
    split, components = _fans_and_components(triangles, pairs, count)
    tails = triangles.ravel()[pairs]
    # (a, a) is no edge: a triangle that names a vertex twice makes the mesh non-manifold
    repeated = np.any(triangles == np.roll(triangles, 1, axis=1), axis=1)
    boundary, crowded = int(np.sum(uses == 1)), int(np.sum(uses > 2))
    consistent = bool(np.all(tails[:, 0] != tails[:, 1]))
    return {
        "vertices": count,
        "triangles": len(triangles),
        "watertight": bool(len(triangles)) and boundary == 0 and crowded == 0 and consistent,
        "manifold": crowded == 0 and int(split) == 0 and not repeated.any(),
        "winding_consistent": consistent,
        "components": int(components),
        "boundary_edges": boundary,
        "nonmanifold_edges": crowded,
        "nonmanifold_vertices": int(split),
        "euler_characteristic": int(np.count_nonzero(np.bincount(triangles.ravel()))) - len(begin) + len(triangles),
    }


def volume(mesh: Mesh) -> float:
    """Signed volume of a closed mesh [m³], positive when its triangles face outwards; of no meaning for an open one."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, cross(b, c)) / 6)


def mesh_report(mesh: Mesh, crossings: bool = True) -> dict:
    """What a mesh is, as a plain dict ready for JSON.

    Time O(T log T), memory about 400 bytes a triangle. Without ``crossings``, ``self_intersections`` and
    ``min_angle_deg`` are None, in a third of the time.

    Returns
    -------
    dict
        ``vertices``, ``triangles``;
        ``watertight``: every edge has exactly two triangles, wound in opposite senses along it;
        ``manifold``: no edge has more than two triangles, and each vertex's triangles are a single fan;
        ``winding_consistent``: of edges with two triangles;
        ``components`` (connected over edges of two triangles), ``boundary_edges``, ``nonmanifold_edges``,
        ``nonmanifold_vertices`` (more than one fan), ``euler_characteristic`` (of used vertices);
        ``volume_m3`` (None unless watertight), ``area_m2``;
        ``self_intersections``: triangles that run through another one;
        ``filled_share``: of the area, that no view saw; only of a mesh that says how its triangles were made;
        ``min_angle_deg``: quantiles ``p0``, ``p1``, ``p5``, ``p50`` of each triangle's smallest angle, None for no
        triangles.

    Raises
    ------
    MirrorScanError
        When a used vertex is not finite, or a triangle names a vertex that does not exist.
    """
    crossing = np.unique(self_intersections(mesh.vertices, mesh.triangles)) if crossings else None  # checks them, too
    report = connectivity(mesh)
    report["volume_m3"] = volume(mesh) if report["watertight"] else None
    twice_area = lengths(triangle_normals(mesh.vertices, mesh.triangles))
    report["area_m2"] = float(twice_area.sum() / 2)
    report["self_intersections"] = None if crossing is None else len(crossing)
    if mesh.kind is not None and twice_area.any():
        report["filled_share"] = float(twice_area[mesh.kind == FILL].sum() / twice_area.sum())
    report["min_angle_deg"] = None
    if len(twice_area) and crossings:
        p = mesh.vertices[mesh.triangles]
        sides = np.sort(np.linalg.norm(p - np.roll(p, -1, axis=1), axis=2), axis=1)
        # the smallest angle lies between the two longest sides
        sine = twice_area / np.maximum(sides[:, 1] * sides[:, 2], np.finfo(float).tiny)
        angle = np.degrees(np.arcsin(np.clip(sine, 0.0, 1.0)))
        quantiles = np.percentile(angle, (0, 1, 5, 50))
        report["min_angle_deg"] = dict(zip(("p0", "p1", "p5", "p50"), quantiles.tolist(), strict=True))
    return report


HOLE, EDGE, CROSSING, PIECE = "hole", "edge", "crossing", "piece"
"""An open loop; an edge of more than two triangles; surface through surface; a loose piece."""

ORDER = (HOLE, EDGE, CROSSING, PIECE)


@dataclass(frozen=True)
class Problem:
    """One place to look at.

    Parameters
    ----------
    kind : str
        One of :data:`ORDER`.
    point, normal : tuple of float
        Where [m], and which way the surface looks there (unit), in the mesh's frame.
    size : float
        Diagonal of the place's bounding box [m].
    area : float
        Of its triangles [m²]; 0 for a hole.
    count : int
        Triangles, or edges of a hole.
    """

    kind: str
    point: tuple[float, float, float]
    normal: tuple[float, float, float]
    size: float
    area: float
    count: int


def find_problems(mesh: Mesh, limit: int = 100) -> list[Problem]:
    """All places where the mesh is open, branches, runs through itself, or is in pieces.

    Surface that no view saw is no fault: see ``filled_share`` of :func:`mesh_report`.

    Parameters
    ----------
    mesh : Mesh
        In metres.
    limit : int
        At most so many of each kind, the largest.

    Returns
    -------
    list of Problem
        By kind in the order of :data:`ORDER`, largest first.

    Notes
    -----
    O(T log T).
    """
    vertices, triangles = mesh.vertices, np.ascontiguousarray(mesh.triangles, np.int32)
    if not len(triangles):
        return []
    crosses = triangle_normals(vertices, triangles)
    found: dict[str, list[Problem]] = {kind: [] for kind in ORDER}

    edges = open_edges(triangles, len(vertices))
    for loop in loops_of(edges, len(vertices)):
        at = np.zeros(len(vertices), np.bool_)
        at[loop] = True
        around = at[triangles].any(axis=1)
        found[HOLE].append(_problem(HOLE, vertices[loop], crosses[around], 0.0, len(loop)))

    keys = edge_keys(triangles, len(vertices)).ravel()
    _, inverse, uses = np.unique(keys, return_inverse=True, return_counts=True)
    crowded = (uses[inverse.ravel()] > 2).reshape(-1, 3).any(axis=1)
    crossing = np.zeros(len(triangles), np.bool_)
    crossing[self_intersections(vertices, triangles).ravel()] = True
    for kind, chosen in ((EDGE, crowded), (CROSSING, crossing)):
        found[kind] = _places(kind, mesh, triangles, crosses, chosen)

    piece, count = triangle_components(triangles, len(vertices))
    if count > 1:
        largest = np.argmax(np.bincount(piece))
        found[PIECE] = _places(PIECE, mesh, triangles, crosses, piece != largest)
    return [
        place
        for kind in ORDER
        for place in sorted(found[kind], key=lambda place: (-max(place.size, place.area), place.point))[:limit]
    ]


def _places(kind: str, mesh: Mesh, triangles: np.ndarray, crosses: np.ndarray, chosen: np.ndarray) -> list[Problem]:
    """The chosen triangles, as one place for each connected group."""
    which = np.flatnonzero(chosen)
    if not len(which):
        return []
    label, count = triangle_components(np.ascontiguousarray(triangles[which]), len(mesh.vertices))
    order = np.argsort(label, kind="stable")
    groups = np.split(which[order], np.cumsum(np.bincount(label, minlength=count))[:-1])
    return [
        _problem(
            kind, mesh.vertices[np.unique(triangles[group])], crosses[group],
            0.5 * float(np.linalg.norm(crosses[group], axis=1).sum()), len(group),
        )
        for group in groups
    ]  # fmt: skip


def _problem(kind: str, points: np.ndarray, crosses: np.ndarray, area: float, count: int) -> Problem:
    low, high = points.min(axis=0), points.max(axis=0)
    normal = crosses.sum(axis=0)
    length = np.linalg.norm(normal)
    normal = normal / length if length > 0 else np.array((0.0, -1.0, 0.0))
    x, y, z = map(float, 0.5 * (low + high))
    nx, ny, nz = map(float, normal)
    return Problem(kind, (x, y, z), (nx, ny, nz), float(np.linalg.norm(high - low)), area, count)
