"""What the zipper left open → one closed, oriented 2-manifold: filled, refined, faired."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .fairing import fair
from .filling import fill_loops
from .mesh import SURFACE, Mesh, keep_triangles, remove_bowties, triangle_components
from .overlap import ViewMaps
from .refinement import edge_length_at_vertices, refine


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
        How stiffly the outermost measured vertices hold their place while seams and fills are faired; larger is stiffer.
    floor_reach : float
        Loops this near the floor are soles and closed flat on it [m].
    """

    largest_loop: int = 64
    refine: float = 1.7
    fairness: float = 0.3
    floor_reach: float = 0.05


def close_mesh(
    mesh: Mesh, maps: ViewMaps, up: np.ndarray, floor: float | None, settings: ClosingSettings = ClosingSettings()
) -> tuple[Mesh, list[str]]:
    """Zippered patches → one closed 2-manifold: fill what is open, refine it to the density around, fair it.

    Parameters
    ----------
    mesh : Mesh
        Edges with at most two triangles, consistently wound.
    maps : ViewMaps
        What the views saw, to keep fills out of empty space.
    up : np.ndarray [shape=(3,)]
        Vertical, camera frame.
    floor : float or None
        Height of the floor along ``up`` [m]; soles are closed flat on it.

    Returns
    -------
    mesh : Mesh
    notes : list of str
        What was dropped or could not be mended, for the user.
    """
    notes = []
    mesh, dropped = largest_component(mesh)
    if dropped:
        notes.append(f"{dropped} small piece(s) that nothing connects to the body were left out")
    mesh = remove_bowties(mesh)
    mesh = fill_loops(mesh, maps, settings.largest_loop)
    mesh = remove_bowties(mesh)
    mesh, _ = largest_component(mesh)
    mesh = refine(mesh, edge_length_at_vertices(mesh), settings.refine)
    made = mesh.view < 0
    rim = np.zeros(len(mesh.vertices), np.bool_)
    rim[mesh.triangles[mesh.kind != SURFACE]] = True
    stiffness = np.where(made, 0.0, np.where(rim, settings.fairness, np.inf))
    mesh = replace(mesh, vertices=fair(mesh.vertices, mesh.triangles, stiffness))
    return mesh, notes


def largest_component(mesh: Mesh) -> tuple[Mesh, int]:
    """The connected piece with the most triangles, and how many others were dropped."""
    label, count = triangle_components(mesh.triangles, len(mesh.vertices))
    if count <= 1:
        return mesh, 0
    return keep_triangles(mesh, label == np.bincount(label).argmax()), count - 1
