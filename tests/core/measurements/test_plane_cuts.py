"""Plane cuts against trimesh."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.measurements.plane_cuts import cut_by_plane, plane_axes

NUMBERS = st.floats(-1.0, 1.0)


@given(st.tuples(NUMBERS, NUMBERS, NUMBERS), st.floats(-0.4, 0.4), st.integers(0, 5))
@settings(max_examples=40, deadline=None)
def test_a_cut_is_that_of_trimesh(normal, shift, seed):
    normal = np.array(normal)
    if np.linalg.norm(normal) < 0.1:
        normal = np.array([0.0, 0.0, 1.0])
    body = trimesh.creation.torus(0.5, 0.2) if seed % 2 else trimesh.creation.icosphere(3, 0.5)
    body.vertices += np.random.default_rng(seed).normal(0, 0.004, body.vertices.shape)
    point = shift * normal / np.linalg.norm(normal)
    cut = cut_by_plane(body.vertices, body.faces, point, normal)
    theirs = body.section(plane_origin=point, plane_normal=normal)
    ours = np.linalg.norm(np.diff(cut.points[cut.segments], axis=1), axis=2).sum()
    if theirs is None:
        assert ours < 1e-9
        return
    assert ours == pytest.approx(theirs.length, abs=1e-6)
    assert cut.is_closed()
    if all(entity.closed for entity in theirs.entities):  # it breaks one that passes close by a vertex
        assert len(np.unique(cut.loops())) == len(theirs.entities)
    assert np.abs((cut.points - point) @ normal).max() < 1e-9


def test_values_are_linear_and_triangles_are_those_that_are_cut():
    body = trimesh.creation.icosphere(2, 1.0)
    cut = cut_by_plane(body.vertices, body.faces, np.array([0.0, 0.0, 0.3]), np.array([0.0, 0.0, 2.0]))
    assert np.allclose(cut.values(body.vertices @ (1.0, 2.0, 3.0)), cut.points @ (1.0, 2.0, 3.0))
    heights = body.vertices[body.faces[cut.triangle], 2]
    assert (heights.min(axis=1) < 0.3).all() and (heights.max(axis=1) >= 0.3).all()


def test_a_plane_through_vertices_leaves_no_loop_open():
    body = trimesh.creation.box((1.0, 1.0, 1.0)).subdivide().subdivide()
    cut = cut_by_plane(body.vertices, body.faces, np.zeros(3), np.array([0.0, 0.0, 1.0]))
    assert cut.is_closed() and len(np.unique(cut.loops())) == 1


def test_a_plane_beside_the_mesh_cuts_nothing():
    body = trimesh.creation.icosphere(1, 1.0)
    cut = cut_by_plane(body.vertices, body.faces, np.array([0.0, 0.0, 2.0]), np.array([0.0, 0.0, 1.0]))
    assert len(cut.points) == len(cut.segments) == len(cut.loops()) == 0
    assert not cut.is_closed()


def test_the_loop_about_a_point_is_the_one_that_runs_round_it():
    left, right = trimesh.creation.icosphere(3, 0.4), trimesh.creation.icosphere(2, 0.3)
    left.apply_translation((-1.0, 0.0, 0.0))
    right.apply_translation((1.0, 0.0, 0.0))
    both = trimesh.util.concatenate([left, right])
    up = np.array([0.0, 0.0, 1.0])
    cut = cut_by_plane(both.vertices, both.faces, np.zeros(3), up)
    loops = cut.loops()
    for x in (-0.9, 1.1):
        about = cut.loop_about(np.array([x, 0.05, 0.0]), up, loops)
        assert np.sign(cut.points[loops == about, 0]).tolist() == [np.sign(x)] * (loops == about).sum()
    assert cut.loop_about(np.zeros(3), up, loops) == -1


def test_axes_of_a_plane_are_square():
    for normal in np.random.default_rng(0).normal(size=(20, 3)):
        first, second = plane_axes(normal)
        frame = np.stack((first, second, normal / np.linalg.norm(normal)))
        assert np.allclose(frame @ frame.T, np.eye(3))
        assert np.linalg.det(frame) == pytest.approx(1.0)
