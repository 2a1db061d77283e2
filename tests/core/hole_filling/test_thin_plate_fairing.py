"""Thin-plate fairing: least energy against dense least squares, caps near their sphere, planes that stay planes."""

from __future__ import annotations

import naive
import numpy as np
import pytest
import trimesh
from mirror_scan.core.hole_filling.delaunay_refinement import edge_length_at_vertices, refine
from mirror_scan.core.hole_filling.loop_triangulation import fill_loops
from mirror_scan.core.hole_filling.thin_plate_fairing import fair, neighbours
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.submesh import compact, remove_bowties


def lidded(radius):
    """A unit sphere with a cap cut off, filled flat and refined, and which vertices were made."""
    whole = trimesh.creation.icosphere(subdivisions=4)
    keep = np.linalg.norm(whole.triangles_center - (0, 0, 1), axis=1) > radius
    zeros = np.zeros(keep.sum(), np.int8)
    mesh = Mesh(
        np.array(whole.vertices),
        np.array(whole.faces[keep], np.int32),
        None,
        np.zeros(len(whole.vertices), np.int8),
        zeros,
    )
    mesh = fill_loops(remove_bowties(compact(mesh)))
    return refine(mesh, edge_length_at_vertices(mesh), 1.5)[0]


@pytest.mark.parametrize(("radius", "share"), [(0.3, 0.15), (0.6, 0.25), (0.9, 0.45)])
def test_a_lid_is_drawn_out_to_the_sphere(radius, share):
    mesh = lidded(radius)
    made = mesh.view < 0
    out = fair(mesh.vertices, mesh.triangles, np.where(made, 0.0, np.inf))
    np.testing.assert_array_equal(out[~made], mesh.vertices[~made])
    flat = 1 - np.linalg.norm(mesh.vertices[made], axis=1)
    error = np.abs(np.linalg.norm(out[made], axis=1) - 1)
    print(f"\ncap of radius {radius}: flat {flat.max():.4f}, faired {error.max():.4f}")
    assert error.max() < share * flat.max() and error.mean() < 0.7 * share * flat.mean()
    closed = trimesh.Trimesh(out, mesh.triangles, process=False)
    assert closed.is_watertight and closed.volume == pytest.approx(4 / 3 * np.pi, rel=0.04)
    outwards = (closed.face_normals * closed.triangles_center).sum(axis=1)
    assert outwards.min() > 0.8, "a fold"


@pytest.mark.parametrize(("stretch", "low", "high"), [(0.1, -0.02, 0.05), (1.0, 0.1, 0.35), (2.0, 0.35, 0.55)])
def test_a_half_pipe_is_drawn_out_as_far_as_it_is_stretched(stretch, low, high):
    """A flat lid over half a pipe of radius 1/2: a thin plate rises half as high, a stretched one all the way."""
    n, rows = 24, 60
    angle = np.pi * np.arange(n + 1) / n
    y = np.linspace(0, 3, rows)
    shell = np.column_stack((0.5 * np.cos(angle), -0.5 * np.sin(angle)))  # below z = 0, rims upright
    lid = np.column_stack((np.linspace(-0.5, 0.5, 17)[1:-1], np.zeros(15)))
    ring = np.concatenate((shell, lid))
    points = np.concatenate([np.column_stack((ring[:, 0], np.full(len(ring), h), ring[:, 1])) for h in y])
    at = np.arange(len(points)).reshape(rows, -1)
    after = np.roll(at, -1, axis=1)
    a, b, c, d = (k.ravel() for k in (at[:-1], after[:-1], after[1:], at[1:]))
    faces = np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d)))).astype(np.int32)
    made = np.tile(np.arange(len(ring)) > n, rows) & (np.repeat(y, len(ring)) > 0.1) & (np.repeat(y, len(ring)) < 2.9)
    free = np.where(made, 0.0, np.inf)
    out = fair(points, faces, free, np.where(made, stretch, 1.0)).reshape(rows, -1, 3)
    assert low < out[rows // 2, n + 8, 2] < high
    np.testing.assert_allclose(out[rows // 2, n + 1 :, 2], out[rows // 2, :n:-1, 2], atol=1e-3)


def test_what_is_held_elsewhere_goes_there():
    points, faces = grid(15)
    goal = points + (0.0, 0.0, 0.2)
    free = np.abs(points[:, :2] - 0.5).max(axis=1) < 0.4
    held = np.where(free, np.where(np.linalg.norm(points[:, :2] - 0.5, axis=1) < 0.1, 100.0, 0.0), np.inf)
    out = fair(points, faces, held, target=goal)
    assert out[112, 2] == pytest.approx(0.2, abs=1e-3) and (out[~free] == points[~free]).all()


def grid(n, height=None):
    v, u = np.mgrid[:n, :n] / (n - 1.0)
    at = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate((np.column_stack((at, at + 1, at + n + 1)), np.column_stack((at, at + n + 1, at + n))))
    z = np.zeros((n, n)) if height is None else height
    return np.column_stack((u.ravel(), v.ravel(), np.ravel(z))), faces.astype(np.int32)


def test_a_plane_stays_a_plane():
    points, faces = grid(15)
    turned = trimesh.transformations.transform_points(points, trimesh.transformations.rotation_matrix(0.8, [1, 2, 3]))
    normal = np.cross(turned[14] - turned[0], turned[-1] - turned[0])
    free = np.abs(points[:, :2] - 0.5).max(axis=1) < 0.3
    out = fair(turned, faces, np.where(free, 0.0, np.inf))
    assert np.abs((out - turned) @ normal).max() < 1e-12
    np.testing.assert_array_equal(out[~free], turned[~free])


def test_a_bump_is_ironed_out_of_a_plane():
    points, faces = grid(21)
    free = np.linalg.norm(points[:, :2] - 0.5, axis=1) < 0.25
    bumpy = points.copy()
    bumpy[free, 2] = 0.05 * np.random.default_rng(0).normal(size=free.sum())
    out = fair(bumpy, faces, np.where(free, 0.0, np.inf))
    assert np.abs(out[:, 2]).max() < 0.006


@pytest.mark.parametrize("stiff", [0.0, 0.3, 5.0])
def test_energy_is_the_least_there_is(stiff):
    rng = np.random.default_rng(2)
    rest, faces = grid(8, 0.05 * rng.normal(size=(8, 8)))
    rest[:, :2] += 0.02 * rng.normal(size=(64, 2))
    free = np.abs(rest[:, :2] - 0.5).max(axis=1) < 0.33
    stiffness = np.where(free, stiff * rng.uniform(0.5, 1.5, 64), np.inf)
    out = fair(rest, faces, stiffness)
    np.testing.assert_array_equal(out[~free], rest[~free])

    best, plate = naive.thin_plate(rest, faces, stiffness)
    held = np.where(free, stiffness, 0.0)[:, None]

    def energy(points):
        return ((plate @ points) ** 2).sum() + ((held * (points - rest)) ** 2).sum()

    assert energy(out) - energy(best) < 1e-3 * (energy(rest) - energy(best))
    assert np.abs(out - best).max() < 0.05 * max(np.abs(best - rest).max(), 1e-3)


def test_stiffness_holds_things_in_place():
    points, faces = grid(15, 0.05 * np.random.default_rng(1).normal(size=(15, 15)))
    moved = [
        np.linalg.norm(fair(points, faces, np.full(225, s)) - points, axis=1).mean() for s in (0.1, 1.0, 10.0, 1e4)
    ]
    assert moved == sorted(moved, reverse=True) and moved[-1] < 1e-6 < moved[0]
    assert fair(points, faces, np.full(225, np.inf)) is points
    before = points.copy()
    fair(points, faces, np.zeros(225))
    np.testing.assert_array_equal(points, before)


def test_far_things_do_not_matter():
    """Only what lies within two rings of a free vertex has a say."""
    points, faces = grid(25, 0.05 * np.random.default_rng(3).normal(size=(25, 25)))
    stiffness = np.where(np.linalg.norm(points[:, :2] - 0.3, axis=1) < 0.1, 0.0, np.inf)
    far = np.linalg.norm(points[:, :2] - 0.3, axis=1) > 0.1 + 3 * np.sqrt(2) / 24
    shaken = points + far[:, None] * (0, 0, 1.0)
    near = stiffness == 0
    np.testing.assert_allclose(
        fair(shaken, faces, stiffness)[near], fair(points, faces, stiffness)[near], rtol=0, atol=1e-12
    )


def test_one_rings():
    whole = trimesh.creation.torus(1.0, 0.4, major_sections=9, minor_sections=7)
    faces = whole.faces[np.random.default_rng(0).random(len(whole.faces)) > 0.2].astype(np.int32)
    start, heads = neighbours(faces, len(whole.vertices) + 2)
    expected = [set() for _ in range(len(whole.vertices) + 2)]
    for i, j, k in faces.tolist():
        expected[i] |= {j, k}
        expected[j] |= {i, k}
        expected[k] |= {i, j}
    found = [heads[a:b].tolist() for a, b in zip(start[:-1], start[1:], strict=True)]
    assert [set(f) for f in found] == expected and all(len(f) == len(set(f)) for f in found)
