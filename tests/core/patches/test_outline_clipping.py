"""Cutting meshes along level lines: on planes and spheres with closed forms, and along rough lines on anything."""

from __future__ import annotations

import naive
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.boundary_loops import boundary_loops
from mirror_scan.core.mesh.half_edges import open_edges, twins
from mirror_scan.core.mesh.normals import triangle_normals
from mirror_scan.core.mesh.submesh import vertex_fans
from mirror_scan.core.patches.outline_clipping import clip, distance_to_zero, smooth_on_mesh, trim_outline


def coloured(vertices, faces) -> Mesh:
    vertices = np.array(vertices, dtype=np.float64)
    shade = np.clip(np.rint(255 * (vertices - vertices.min()) / np.ptp(vertices)), 0, 255).astype(np.uint8)
    kind = (np.arange(len(faces)) % 3).astype(np.int8)
    return Mesh(vertices, np.array(faces, dtype=np.int32), shade, np.full(len(vertices), 2, np.int8), kind)


def ball(level=4):
    mesh = trimesh.creation.icosphere(subdivisions=level)
    return coloured(mesh.vertices, mesh.faces)


def plate(n=30):
    """A unit square of n × n cells, corners moved a little off the grid inside it."""
    v, u = np.mgrid[: n + 1, : n + 1] / n
    inside = (u > 0) & (u < 1) & (v > 0) & (v < 1)
    shake = 0.25 / n * np.random.default_rng(0).uniform(-1, 1, (2, n + 1, n + 1)) * inside
    vertices = np.column_stack(((u + shake[0]).ravel(), (v + shake[1]).ravel(), np.zeros((n + 1) ** 2)))
    at = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    quads = np.column_stack((at, at + 1, at + n + 2, at + n + 1))
    return coloured(vertices, np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]])))


def area(mesh):
    return np.linalg.norm(triangle_normals(mesh.vertices, mesh.triangles), axis=1).sum() / 2


def check_arrays(mesh):
    count = len(mesh.vertices)
    assert len(mesh.colors) == len(mesh.view) == count and len(mesh.kind) == len(mesh.triangles)
    assert mesh.colors.dtype == np.uint8 and mesh.triangles.dtype == np.int32
    assert len(np.unique(mesh.triangles)) == count, "unused vertices remain"
    assert (mesh.triangles != np.roll(mesh.triangles, 1, axis=1)).all()


@pytest.mark.parametrize("level", [-0.93, -0.31, 0.0, 0.4, 0.85])
def test_a_ball_cut_by_a_plane(level):
    mesh, axis = ball(), np.array([0.36, -0.48, 0.8])
    cut = clip(mesh, mesh.vertices @ axis, level)
    check_arrays(cut)
    height = cut.vertices @ axis
    assert height.min() > level - 1e-12, "something on the wrong side was kept"
    (loop,) = boundary_loops(cut.triangles, len(cut.vertices))
    np.testing.assert_allclose(height[loop], level, atol=1e-12)
    assert len(open_edges(cut.triangles, len(cut.vertices))) == len(loop) == (np.abs(height - level) < 1e-9).sum()
    assert (twins(cut.triangles, len(cut.vertices)) >= -1).all()
    assert (vertex_fans(cut.triangles, len(cut.vertices)) == 1).all()
    # a spherical cap has area 2 π R h; facets and sliding along edges cost a little
    assert area(cut) / area(mesh) == pytest.approx((1 - level) / 2, abs=0.003)
    assert (
        np.einsum("ij,ij->i", triangle_normals(cut.vertices, cut.triangles), cut.vertices[cut.triangles[:, 0]]) > 0
    ).all()


def test_no_slivers_along_the_cut():
    mesh, axis = ball(), np.array([0.36, -0.48, 0.8])
    cut = clip(mesh, mesh.vertices @ axis, 0.4)
    sides = np.linalg.norm(cut.vertices[cut.triangles] - cut.vertices[np.roll(cut.triangles, 1, axis=1)], axis=2)
    assert sides.min() > 0.1 * np.median(sides)


@pytest.mark.parametrize("normal", [(1, 0), (0, 1), (0.6, 0.8), (1, -1)])
def test_a_plate_cut_straight(normal):
    mesh = plate()
    axis = np.array([*normal, 0.0])
    field = (mesh.vertices - (0.52, 0.47, 0)) @ axis
    parts = clip(mesh, field, 0.0), clip(mesh, -field, 0.0)
    for part, side in zip(parts, (1, -1), strict=True):
        check_arrays(part)
        assert (side * (part.vertices - (0.52, 0.47, 0)) @ axis).min() > -1e-12
        assert len(boundary_loops(part.triangles, len(part.vertices))) == 1
    # where the line leaves the plate a corner may slide along it: less than a cell at either end
    assert sum(area(p) for p in parts) == pytest.approx(1.0, abs=1 / 30**2)
    expected = naive.half_plane_area([(0, 0), (1, 0), (1, 1), (0, 1)], axis[:2], axis @ (0.52, 0.47, 0))
    assert area(parts[0]) == pytest.approx(expected, abs=1 / 30**2)


def test_attributes_follow():
    mesh = ball(3)
    cut = clip(mesh, mesh.vertices[:, 2], 0.1)
    low, span = mesh.vertices.min(), np.ptp(mesh.vertices)
    assert np.abs(cut.colors - 255 * (cut.vertices - low) / span).max() <= 2, (
        "colours are interpolated as positions are"
    )
    assert (cut.view == 2).all() and set(cut.kind.tolist()) == {0, 1, 2}
    bare = clip(Mesh(mesh.vertices, mesh.triangles), mesh.vertices[:, 2], 0.1)
    assert bare.colors is None and bare.view is None and bare.kind is None
    np.testing.assert_array_equal(bare.vertices, cut.vertices)


def test_all_or_nothing():
    mesh = ball(1)
    assert clip(mesh, np.ones(len(mesh.vertices)), 0.5) is mesh
    assert clip(mesh, np.full(len(mesh.vertices), 0.5), 0.5) is mesh, "the level itself is kept"
    none = clip(mesh, np.zeros(len(mesh.vertices)), 0.5)
    assert none.triangles.shape == (0, 3) and len(none.kind) == 0


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-0.8, 0.8), st.sampled_from([0, 1, 4]))
def test_rough_lines_leave_a_sound_mesh(seed, level, rounds):
    mesh = ball(2)
    field = np.random.default_rng(seed).uniform(-1, 1, len(mesh.vertices))
    field = smooth_on_mesh(field[:, None].copy(), mesh.triangles, rounds)[:, 0]
    field *= 1 / np.abs(field).max()
    cut = clip(mesh, field, level)
    if not len(cut.triangles):
        return
    check_arrays(cut)
    assert (twins(cut.triangles, len(cut.vertices)) >= -1).all()
    assert np.isfinite(cut.vertices).all()
    loops = boundary_loops(cut.triangles, len(cut.vertices))
    assert sum(len(loop) for loop in loops) == len(open_edges(cut.triangles, len(cut.vertices)))
    low, high = (mesh.vertices.min(axis=0), mesh.vertices.max(axis=0))
    assert (cut.vertices >= low - 1e-12).all() and (cut.vertices <= high + 1e-12).all()


def test_distance_to_the_zero_line():
    """On a plate the distance of a linear field steeper than one is its value over its slope."""
    mesh = plate()
    field = 3.0 * (mesh.vertices @ (0.6, 0.8, 0) - 0.7)
    np.testing.assert_allclose(
        distance_to_zero(field, mesh.vertices, mesh.triangles), mesh.vertices @ (0.6, 0.8, 0) - 0.7, atol=1e-12
    )


def test_averaging_over_the_one_ring():
    mesh = ball(3)
    values = np.column_stack(
        (np.full(len(mesh.vertices), 7.0), np.random.default_rng(0).normal(size=len(mesh.vertices)))
    )
    before = values.copy()
    out = smooth_on_mesh(values, mesh.triangles, 3)
    np.testing.assert_allclose(out[:, 0], 7.0)
    assert out[:, 1].std() < 0.5 * before[:, 1].std() and abs(out[:, 1].mean()) < 0.1
    assert out[:, 1].max() <= before[:, 1].max()
    np.testing.assert_array_equal(smooth_on_mesh(before.copy(), mesh.triangles, 0), before)


def test_a_thread_is_cut_off_an_outline():
    n = 24
    u, v = np.meshgrid(np.arange(60), np.arange(n))
    kept = (u < 24) | ((v >= 11) & (v < 12))  # a plate with a thread one cell wide hanging on it
    corner = np.arange(61 * (n + 1)).reshape(n + 1, 61)
    cells = np.column_stack([c[kept] for c in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1])])
    y, x = np.mgrid[: n + 1, :61]
    vertices = np.column_stack((x.ravel(), y.ravel(), np.zeros(61 * (n + 1)))).astype(float)
    mesh = coloured(vertices, np.concatenate((cells[:, [0, 1, 2]], cells[:, [0, 2, 3]])))
    trimmed = trim_outline(mesh, 0.5)
    check_arrays(trimmed)
    assert trimmed.vertices[:, 0].max() < 26 and 0.93 < area(trimmed) / (24 * 24) < 1.01
    assert trim_outline(mesh, 0.0) is mesh
    empty = Mesh(np.empty((0, 3)), np.empty((0, 3), np.int32))
    assert trim_outline(empty, 0.5) is empty
