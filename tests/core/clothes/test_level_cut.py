"""Cuts: the area that is left has a closed form, the border lies on the level, and nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.clothes.level_cut import cut_at_level, snapped
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.half_edges import open_edges

BALL = trimesh.creation.icosphere(4, 1.0)
MESH = Mesh(np.array(BALL.vertices), np.array(BALL.faces, np.int32))


def area(mesh: Mesh) -> float:
    return float(trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False).area)


@settings(max_examples=30, deadline=None)
@given(st.floats(-0.9, 0.9), st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1))
def test_a_plane_cuts_a_cap_off_a_ball(height, direction):
    normal = np.array(direction) / np.linalg.norm(direction)
    values = MESH.vertices @ normal - height
    cap = cut_at_level(MESH, values)
    truth = 2 * np.pi * (1 - height)
    assert area(cap) == pytest.approx(truth, rel=0.02)
    assert area(cap) + area(cut_at_level(MESH, -values)) == pytest.approx(area(MESH), rel=1e-9)
    border = np.unique(open_edges(cap.triangles, len(cap.vertices))[:, :2])
    assert len(border) and np.abs(cap.vertices[border] @ normal - height).max() < 1e-9


def test_all_or_nothing_may_be_left():
    assert len(cut_at_level(MESH, np.ones(len(MESH.vertices))).triangles) == len(MESH.triangles)
    assert len(cut_at_level(MESH, -np.ones(len(MESH.vertices))).triangles) == 0


def test_snapped_vertices_leave_no_slivers():
    normal, spacing = np.array([0.0, 0.0, 1.0]), 0.08
    vertices, values = snapped(MESH.vertices[:, 2] - 0.217, MESH, normal, 0.35 * spacing)
    cap = cut_at_level(Mesh(vertices, MESH.triangles), values)
    a, b, c = (cap.vertices[cap.triangles[:, k]] for k in range(3))
    longest = np.max([np.linalg.norm(x - y, axis=1) for x, y in ((a, b), (b, c), (c, a))], axis=0)
    height = np.linalg.norm(np.cross(b - a, c - a), axis=1) / longest
    assert height.min() > 0.15 * spacing
