"""Which part of a body a rig sees, vertex by vertex: to plan a rig before buying mirrors."""

from __future__ import annotations

import numpy as np

from ..camera import project
from ..mirrors.mirror import plane_mirror, reflection_matrix
from ..patches.grid_triangulation import TriangulationSettings
from .simulate import Simulation

TOLERANCE = 0.015
"""A vertex this much behind what its pixel shows is still what the pixel shows [m]; about a pixel's footprint."""


def coverage(simulation: Simulation) -> np.ndarray:
    """The view that sees each vertex of the subject best; -1 where none does.

    Each vertex is projected into each view (via its mirror) and compared with the depth its pixel has there. A surface
    tilted more than the triangulation joins counts as not seen. The best view is the one with the most pixels on a
    square of the surface: cos(tilt) / z².

    Returns
    -------
    np.ndarray [shape=(V,), dtype=int8]
        0 directly, n through mirror n, -1 not seen.

    Notes
    -----
    O(V · views), no ray is cast.
    """
    truth, intrinsics = simulation.truth, simulation.capture.intrinsics
    normals = _normals(truth.body.vertices, truth.body.triangles)
    best = np.full(len(truth.body.vertices), -1, np.int8)
    score = np.zeros(len(best))
    steepest = np.cos(np.radians(TriangulationSettings().max_slope))
    readable = np.where(truth.readable, truth.sight.depth, 0.0)
    for view in range(len(truth.mirrors) + 1):
        points, facing = truth.body.vertices, normals
        if view:
            given = truth.mirrors[view - 1]
            assert given.point is not None and given.normal is not None  # the truth of a mirror is a plane
            flip = reflection_matrix(plane_mirror(given.name, given.point, given.normal))
            points, facing = points @ flip[:3, :3].T + flip[:3, 3], facing @ flip[:3, :3].T
        length = np.linalg.norm(points, axis=1)
        tilt = -np.einsum("ij,ij->i", points, facing) / length
        pixel = project(points, intrinsics)
        inside = np.isfinite(pixel).all(axis=1) & (tilt > steepest)
        inside &= ((pixel > 0.5) & (pixel < (intrinsics.width - 1.5, intrinsics.height - 1.5))).all(axis=1)
        chosen = np.flatnonzero(inside)
        u, v = np.floor(pixel[chosen]).astype(int).T
        seen = np.zeros(len(chosen), bool)
        for du, dv in ((0, 0), (1, 0), (0, 1), (1, 1)):  # at a silhouette one of the four is enough
            at = v + dv, u + du
            steep = TOLERANCE / np.maximum(tilt[chosen], 0.2)
            seen |= (truth.labels[at] == view) & (np.abs(readable[at] - points[chosen, 2]) < steep)
        chosen = chosen[seen]
        value = tilt[chosen] / points[chosen, 2] ** 2
        better = value > score[chosen]
        score[chosen[better]], best[chosen[better]] = value[better], view
    return best


def shares(view: np.ndarray, vertices: np.ndarray, triangles: np.ndarray, views: int) -> list[float]:
    """Share of the surface that each view sees best, and last the share that none sees; they add up to 1."""
    area = np.linalg.norm(_crosses(vertices, triangles), axis=1)
    weight = np.zeros(len(vertices))
    for k in range(3):
        weight += np.bincount(triangles[:, k], weights=area, minlength=len(vertices))
    total = weight.sum()
    return [float(weight[view == k].sum() / total) for k in (*range(views), -1)] if total else [0.0] * views + [1.0]


def _crosses(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def _normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    face, total = _crosses(vertices, triangles), np.zeros_like(vertices)
    for k in range(3):
        for axis in range(3):
            total[:, axis] += np.bincount(triangles[:, k], weights=face[:, axis], minlength=len(vertices))
    return total / np.maximum(np.linalg.norm(total, axis=1), 1e-12)[:, None]
