"""The surface step of other programs: oriented points in, triangles out.

Each function takes points and unit normals (N, 3) and returns its mesh and the time of the call alone, without the
copies into and out of the library.
"""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np
from mirror_scan.core.mesh import Mesh

from .machine import installed, milliseconds

DEPTH = 8
TRIMMED = 0.02
"""Share of Open3D's Poisson vertices, those of the lowest density, that are cut off in the trimmed variant."""
MAX_HOLE_EDGES = 1000
"""MeshLab's default, 30, leaves the gaps between the views open."""

OPEN3D = f"Open3D Poisson d{DEPTH}"
OPEN3D_TRIMMED = f"{OPEN3D}, trimmed"
MESHLAB = f"MeshLab Poisson d{DEPTH}"
BALLS = "MeshLab ball pivoting"
POISSON = (OPEN3D, MESHLAB)

Made = tuple[Mesh, float]
"""A mesh and how long it took [ms]."""


def open3d_poisson(points: np.ndarray, normals: np.ndarray) -> tuple[Made, Made]:
    """Open3D's screened Poisson reconstruction, all cores: as it comes, and the same trimmed."""
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    cloud.normals = open3d.utility.Vector3dVector(normals)
    spent, (made, density) = milliseconds(
        lambda: open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=DEPTH)
    )
    whole = _open3d_mesh(made)
    density = np.asarray(density)
    more, _ = milliseconds(lambda: made.remove_vertices_by_mask(density < np.quantile(density, TRIMMED)))
    return (whole, spent), (_open3d_mesh(made), spent + more)


def _open3d_mesh(surface) -> Mesh:
    return Mesh(np.array(surface.vertices, np.float64), np.array(surface.triangles, np.int32))


def _meshlab(points: np.ndarray, normals: np.ndarray, filters: Callable) -> Made:
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(points, v_normals_matrix=normals))
    spent, _ = milliseconds(lambda: filters(meshes))
    made = meshes.current_mesh()
    return Mesh(made.vertex_matrix(), np.ascontiguousarray(made.face_matrix(), np.int32)), spent


_meshlab_threads: list[int] = []


def meshlab_poisson(points: np.ndarray, normals: np.ndarray, threads: int | None = None) -> Made:
    """MeshLab's screened Poisson reconstruction.

    Its threads wait for each other by spinning: more than the free cores make it ten times slower. The first call
    finds whether one thread or one a core is faster here, and later calls keep to that; or ``threads`` says it.
    """

    def make(threads: int) -> Made:
        settings = {"depth": DEPTH, "threads": threads}
        return _meshlab(points, normals, lambda m: m.generate_surface_reconstruction_screened_poisson(**settings))

    if threads is not None:
        return make(threads)
    if _meshlab_threads:
        return make(_meshlab_threads[0])
    tried = {threads: make(threads) for threads in (1, os.cpu_count() or 1)}
    best = min(tried, key=lambda threads: tried[threads][1])
    _meshlab_threads.append(best)
    return tried[best]


def meshlab_balls(points: np.ndarray, normals: np.ndarray) -> Made:
    """Ball pivoting with MeshLab's own choice of radius, then holes closed as far as MeshLab can."""

    def filters(meshes):
        meshes.generate_surface_reconstruction_ball_pivoting()
        meshes.meshing_repair_non_manifold_edges()  # closing holes asks for it
        meshes.meshing_repair_non_manifold_vertices()
        meshes.meshing_close_holes(maxholesize=MAX_HOLE_EDGES)

    return _meshlab(points, normals, filters)


def surfaces(points: np.ndarray, normals: np.ndarray) -> dict[str, Made | None]:
    """Each peer's; None where its library is not installed."""
    made: dict[str, Made | None] = dict.fromkeys((OPEN3D, OPEN3D_TRIMMED, MESHLAB, BALLS))
    if installed("open3d"):
        made[OPEN3D], made[OPEN3D_TRIMMED] = open3d_poisson(points, normals)
    if installed("pymeshlab"):
        made[MESHLAB] = meshlab_poisson(points, normals)
        made[BALLS] = meshlab_balls(points, normals)
    return made
