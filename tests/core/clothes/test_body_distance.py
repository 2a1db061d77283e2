"""Signed distances: against closed forms, and against trimesh on a shape with sharp edges."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.clothes.body_distance import BodyDistance
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.mesh import Mesh


def as_mesh(shape: trimesh.Trimesh) -> Mesh:
    return Mesh(np.array(shape.vertices, np.float64), np.array(shape.faces, np.int32))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.tuples(*[st.floats(0.05, 1.0)] * 3))
def test_a_box_has_its_closed_form(seed, extents):
    half = np.array(extents) / 2
    box = as_mesh(trimesh.creation.box(extents))
    points = np.random.default_rng(seed).uniform(-1.2, 1.2, (200, 3))
    beyond = np.abs(points) - half
    truth = np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)
    np.testing.assert_allclose(BodyDistance(box).at(points).distance, truth, atol=1e-9)


def test_sharp_edges_are_as_trimesh_has_them():
    shape = trimesh.creation.cone(0.3, 1.0, sections=7)
    points = np.random.default_rng(3).uniform(-0.5, 1.3, (2000, 3))
    found = BodyDistance(as_mesh(shape)).at(points)
    far = np.abs(found.distance) > 1e-6
    assert (shape.contains(points)[far] == (found.distance < 0)[far]).all()
    corners = np.array(shape.vertices)[np.array(shape.faces)[found.triangle]]
    np.testing.assert_allclose(np.einsum("nc,nci->ni", found.shares, corners), found.point, atol=1e-9)


def test_nothing_is_known_beyond_the_reach():
    found = BodyDistance(as_mesh(trimesh.creation.box((1, 1, 1)))).at(np.array([[0, 0, 0.6], [0, 0, 5.0]]), 0.2)
    assert found.distance[0] == pytest.approx(0.1) and np.isinf(found.distance[1]) and found.triangle[1] == -1


def test_a_body_without_triangles_is_refused():
    with pytest.raises(MirrorScanError, match="no triangles"):
        BodyDistance(Mesh(np.zeros((3, 3)), np.zeros((0, 3), np.int32)))
