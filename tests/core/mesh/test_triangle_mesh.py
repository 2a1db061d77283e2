"""The mesh itself: nothing at all, and moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from meshes import soup
from mirror_scan.core.mesh import FILL, SEAM, SURFACE, Mesh
from mirror_scan.core.mesh.boundary_loops import boundary_loops
from mirror_scan.core.mesh.half_edges import open_edges
from mirror_scan.core.mesh.normals import vertex_normals
from mirror_scan.core.mesh.submesh import (
    compact,
    drop_small_components,
    keep_triangles,
    remove_bowties,
    triangle_components,
)


def test_nothing_at_all():
    empty = Mesh(np.empty((0, 3)), np.empty((0, 3), np.int32), None, np.empty(0, np.int8), np.empty(0, np.int8))
    assert boundary_loops(empty.triangles, 0) == [] and len(open_edges(empty.triangles, 0)) == 0
    assert triangle_components(empty.triangles, 0)[1] == 0
    assert remove_bowties(empty) is empty and drop_small_components(empty, 3) is empty
    assert len(compact(replace(empty, vertices=np.zeros((3, 3)), view=np.zeros(3, np.int8))).vertices) == 0
    assert len(vertex_normals(np.zeros((3, 3)), empty.triangles)) == 3
    assert len(keep_triangles(empty, np.zeros(0, bool)).triangles) == 0


def test_transformed():
    mesh = soup(4)
    matrix = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [0.1, 0.2, 0.3])
    moved = mesh.transformed(matrix)
    np.testing.assert_allclose(moved.vertices, trimesh.transformations.transform_points(mesh.vertices, matrix))
    assert moved.triangles is mesh.triangles and (SURFACE, SEAM, FILL) == (0, 1, 2)
    with pytest.raises(AttributeError):
        mesh.vertices = moved.vertices
