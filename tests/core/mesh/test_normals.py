"""Normals against trimesh."""

from __future__ import annotations

import naive
import numpy as np
import trimesh
from hypothesis import given, settings
from meshes import seeds, soup
from mirror_scan.core.mesh.normals import triangle_normals, vertex_normals


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_normals(seed):
    mesh = soup(seed)
    np.testing.assert_allclose(
        vertex_normals(mesh.vertices, mesh.triangles), naive.vertex_normals(mesh.vertices, mesh.triangles), atol=1e-12
    )
    theirs = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    twice = triangle_normals(mesh.vertices, mesh.triangles)
    np.testing.assert_allclose(twice, theirs.face_normals * 2 * theirs.area_faces[:, None], atol=1e-9)
    expected = np.zeros(len(mesh.vertices), bool)
    expected[mesh.triangles] = True
    assert (np.linalg.norm(vertex_normals(mesh.vertices, mesh.triangles), axis=1) > 0.5).tolist() == expected.tolist()
