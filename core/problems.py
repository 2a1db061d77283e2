"""Where a mesh is at fault or guessed: places a person can look at, worst first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .intersections import self_intersections
from .mesh import FILL, Mesh, edge_keys, loops_of, open_edges, triangle_components, triangle_normals

HOLE, EDGE, CROSSING, PIECE, GUESS = "hole", "edge", "crossing", "piece", "guess"
"""An open loop; an edge of more than two triangles; surface through surface; a loose piece; a large fill."""

ORDER = (HOLE, EDGE, CROSSING, PIECE, GUESS)


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


def find_problems(mesh: Mesh, min_guess: float = 0.004, limit: int = 100) -> list[Problem]:
    """All places where the mesh is open, branches, runs through itself, is in pieces, or was made up over a large area.

    Parameters
    ----------
    mesh : Mesh
        In metres.
    min_guess : float
        Fills smaller than this are not worth a look [m²].
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
    if mesh.kind is not None:
        guesses = _places(GUESS, mesh, triangles, crosses, np.asarray(mesh.kind) == FILL)
        found[GUESS] = [place for place in guesses if place.area >= min_guess]
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
    center = 0.5 * (low + high)
    return Problem(
        kind, tuple(map(float, center)), tuple(map(float, normal)), float(np.linalg.norm(high - low)), area, count
    )
