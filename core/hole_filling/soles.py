"""Soles: holes near the floor are extended down to it and closed flat, except for the arch of the foot."""

from __future__ import annotations

import numpy as np

from ..mesh import FILL, Mesh
from ..mesh.boundary_loops import loops_of
from ..mesh.half_edges import extend_open_edges
from ..numeric.point_products import dot

_FEWEST = 8  # vertices of a loop that may be a sole's


def arch_of_foot(vertices: np.ndarray, flat: np.ndarray, up: np.ndarray) -> np.ndarray:
    """The ``flat`` vertices (V,) bool raised by some hundredths of a millimetre, as a part of one wide arch.

    Whether triangles in one plane cross is decided by rounding: MeshLab reports many in a flat sole. On an arch each
    lies clear of the others' planes.
    """
    if not flat.any():
        return vertices
    level = vertices[flat] - vertices[flat].mean(axis=0)
    level -= dot(level, up)[:, None] * up
    aside = np.einsum("ij,ij->i", level, level)
    out = vertices.copy()
    out[flat] += (4e-4 * (aside.max() - aside))[:, None] * up
    return out


def is_sole(height: np.ndarray, reach: float) -> bool:
    """Whether a loop's heights above the floor (N,) say that it is a sole's: most of it is lower than ``reach`` [m]."""
    return (
        len(height) >= _FEWEST
        and height.max() < 4.0 * reach
        and height.min() > -reach
        and float(np.quantile(height, 0.75)) < reach
    )


def drop_soles(mesh: Mesh, edges: np.ndarray, up: np.ndarray, floor: float, reach: float) -> tuple[Mesh, np.ndarray]:
    """Extend boundary loops just above the floor down to it by a vertical skirt, so that the sole is closed flat.

    Takes and returns the mesh with its open edges.

    A loop counts when at least three quarters of it lie lower than ``reach`` and none four times as high.
    """
    assert mesh.view is not None and mesh.kind is not None  # checked by close_mesh
    below = []
    for loop in loops_of(edges, len(mesh.vertices)):
        height = dot(mesh.vertices[loop], up) - floor
        if is_sole(height, reach):
            below.append(loop)
    if not below:
        return mesh, edges
    vertices, triangles, count = [mesh.vertices], [mesh.triangles], len(mesh.vertices)
    source = np.concatenate(below)
    for loop in below:
        height = dot(mesh.vertices[loop], up) - floor
        vertices.append(mesh.vertices[loop] - height[:, None] * up)
        foot = np.arange(count, count + len(loop))
        count += len(loop)
        after, foot_after = np.roll(loop, -1), np.roll(foot, -1)
        triangles += [np.column_stack((after, loop, foot)), np.column_stack((foot, foot_after, after))]
    skirt = sum(len(t) for t in triangles[1:])
    lowered = Mesh(
        np.concatenate(vertices),
        np.concatenate(triangles).astype(np.int32),
        None if mesh.colors is None else np.concatenate((mesh.colors, mesh.colors[source])),
        np.concatenate((mesh.view, np.full(len(source), -1, np.int8))),
        np.concatenate((mesh.kind, np.full(skirt, FILL, np.int8))),
    )
    return lowered, extend_open_edges(edges, lowered.triangles, len(mesh.triangles), len(lowered.vertices))
