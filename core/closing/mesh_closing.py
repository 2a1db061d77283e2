"""What the zipper left open → one closed, oriented 2-manifold: filled, refined, faired."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..hole_filling.delaunay_refinement import edge_length_at_vertices, refine
from ..hole_filling.foot_hulls import GUESSED
from ..hole_filling.loop_triangulation import fill_loops
from ..hole_filling.silhouette_bulge import bulge, rim_marks
from ..hole_filling.soles import arch_of_foot, drop_soles
from ..hole_filling.thin_plate_fairing import fair
from ..mesh import Mesh
from ..mesh.half_edges import clashing, extend_twins, open_edges, twins
from ..mesh.submesh import keep_components, keep_triangles, made_vertices, remove_bowties
from ..mesh.triangle_mesh import check_mesh
from ..numeric.point_products import dot
from ..numeric.threads import each
from ..views.free_space import reach_before_empty
from ..views.view_maps import ViewMaps, reading_noise
from .self_intersection_repair import untangle

_TIMES_HELD = 4  # rounds of holding vertices back: each pushes its surroundings
_HELD = 1.0  # how stiffly they are held, against the bending of the surface
_GUESS = 0.002  # a guessed place is held as if it were read with this noise [m]
_MATTERS = 0.004  # so far into space seen to be empty is not worth another round [m]


@dataclass(frozen=True)
class ClosingSettings:
    """How what is left open is closed.

    Parameters
    ----------
    largest_loop : int
        Longer loops are first cut in two by their best chord [vertices].
    refine : float
        Edges of seams and fills longer than this are split [median edge lengths of the surface around].
    fairness : float
        How stiffly the outermost measured vertices hold their place while seams and fills are faired, where their
        noise is 1 mm: the more certain the reading, the stiffer.
    curved : float
        Share of the curvature of a body that goes on round its outline, by which surface is curved where readings are
        only missing.
    untangle : bool
        Repair self-intersections.
    floor_reach : float
        Loops that lie lower than this above the floor are soles: they are extended down to it and closed flat [m].
    keep_islands : bool
        Keep pieces that nothing connects to the body, each closed on its own.
    min_island : int
        Islands with fewer triangles are dropped all the same.
    """

    largest_loop: int = 64
    refine: float = 2.0
    fairness: float = 0.45
    curved: float = 0.25
    floor_reach: float = 0.09
    untangle: bool = True
    keep_islands: bool = False
    min_island: int = 200


def close_mesh(
    mesh: Mesh,
    maps: ViewMaps,
    up: np.ndarray,
    floor: float | None,
    settings: ClosingSettings = ClosingSettings(),
    twin: np.ndarray | None = None,
) -> tuple[Mesh, list[str]]:
    """Zippered patches → one closed 2-manifold: fill what is open, refine it to the density around, fair it.

    Parameters
    ----------
    mesh : Mesh
        Edges with at most two triangles, consistently wound; triangles that are not so are taken out.
    maps : ViewMaps
        What the views saw, to keep fills out of empty space.
    up : np.ndarray [shape=(3,)]
        Vertical, camera frame.
    floor : float or None
        Height of the floor along ``up`` [m]; soles are closed flat on it.
    twin : np.ndarray [shape=(3 T,), dtype=int32], optional
        The mesh's :func:`~.half_edges.twins`, where they are known already.

    Returns
    -------
    mesh : Mesh
    notes : list of str
        What was dropped or could not be repaired, for the user.

    Raises
    ------
    MirrorScanError
        When the mesh is damaged: :func:`~.triangle_mesh.check_mesh`.
    """
    notes = []
    check_mesh(mesh, "closing")
    twin = twins(mesh.triangles, len(mesh.vertices)) if twin is None else twin
    clashes = clashing(mesh.triangles, twin)
    if clashes.any():
        mesh = keep_triangles(mesh, ~clashes)
        twin = twins(mesh.triangles, len(mesh.vertices))
        notes.append(f"{np.count_nonzero(clashes)} triangles that clash with their neighbours were taken out")
    mesh = remove_bowties(mesh, twin)  # so that loops that touch in a vertex are separate
    edges = open_edges(mesh.triangles, len(mesh.vertices), twin)
    if floor is not None:
        mesh, edges = drop_soles(mesh, edges, up, floor, settings.floor_reach)
    mesh = fill_loops(mesh, maps, settings.largest_loop, edges=edges)
    twin = extend_twins(twin, mesh.triangles, len(mesh.vertices))
    mesh, kept, dropped = keep_components(mesh, twin, settings.min_island if settings.keep_islands else None)
    if kept:
        notes.append(f"{kept} piece(s) that nothing connects to the body are kept, each closed on its own")
    if dropped:
        notes.append(f"{dropped} small piece(s) that nothing connects to the body were left out")
    whole = mesh
    work: tuple[Callable[[], Any], ...] = (
        lambda: rim_marks(whole, maps),
        lambda: refine(whole, edge_length_at_vertices(whole), settings.refine),
    )
    marks, (mesh, parents) = each(lambda make: make(), work)
    assert mesh.view is not None  # checked above
    made = mesh.view < 0
    flat = np.zeros(len(mesh.vertices), np.bool_)
    if floor is not None:
        flat = made & (np.abs(dot(mesh.vertices, up) - floor) < 1e-6)
        mesh = replace(mesh, vertices=arch_of_foot(mesh.vertices, flat, up))
    rim = made_vertices(mesh)
    stiffness = np.where(flat, np.inf, np.where(made, 0.0, np.where(rim, _stiffness(mesh, maps, settings), np.inf)))
    stiffness[(mesh.view == GUESSED) & ~flat] = settings.fairness * (0.001 / _GUESS)
    stretch = bulge(marks, parents, mesh, settings.curved)
    assert mesh.view is not None  # as above
    mesh = replace(mesh, vertices=_faired(mesh, stiffness, stretch, maps), view=np.maximum(mesh.view, np.int8(-1)))
    if settings.untangle:
        mesh, left = untangle(mesh, maps, coarseness=settings.refine)
        if left > 0.001 * len(mesh.triangles):
            notes.append(
                f"{left} triangles run through others; look at the seams there, a longer burst or a clearer view helps"
            )
    return mesh, notes


def _faired(mesh: Mesh, stiffness: np.ndarray, stretch: np.ndarray, maps: ViewMaps) -> np.ndarray:
    """The vertices faired, but kept out of space that a view saw to be empty.

    A vertex that would move into such space stops before it, and the rest is faired to it. Otherwise a cap over a
    sharp edge would be drawn out through space that the views have seen to be empty.
    """
    start = mesh.vertices
    faired = fair(start, mesh.triangles, stiffness, stretch)
    free = np.flatnonzero(stiffness == 0)
    target = start
    for _ in range(_TIMES_HELD):
        way = faired[free] - start[free]
        reach = reach_before_empty(start[free], faired[free], maps.free_space)
        held = (1.0 - reach) * np.linalg.norm(way, axis=1) > _MATTERS
        if not held.any():
            break
        if target is start:
            target, stiffness = start.copy(), stiffness.copy()
        target[free[held]] += reach[held, None] * way[held]
        stiffness[free[held]] = _HELD
        faired = fair(start, mesh.triangles, stiffness, stretch, target)
        free = free[~held]
    return faired


def _stiffness(mesh: Mesh, maps: ViewMaps, settings: ClosingSettings) -> np.ndarray:
    """How stiffly each vertex (V,) holds its place: stiffer for a more certain reading, infinite without noise."""
    with np.errstate(divide="ignore"):
        return settings.fairness * (0.001 / reading_noise(mesh, maps))
