"""Rays and closest points against closed forms, brute force and trimesh."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.mesh.bvh import build_bvh, closest_point, raycast

trimesh = pytest.importorskip("trimesh")


def arrays(mesh):
    return np.ascontiguousarray(mesh.vertices, np.float64), np.ascontiguousarray(mesh.faces, np.int32)


def soup(rng, count, size=0.2):
    vertices = (rng.uniform(-1, 1, (count, 1, 3)) + rng.normal(0, size, (count, 3, 3))).reshape(-1, 3)
    return vertices, np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def brute_raycast(vertices, triangles, origin, direction):
    """Nearest hit by solving each triangle's 3×3 system (no tree, no tricks)."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    system = np.stack((np.broadcast_to(-direction, a.shape), b - a, c - a), axis=2)
    with np.errstate(all="ignore"):
        t, u, v = np.linalg.solve(system, (origin - a)[..., None])[..., 0].T
    t = np.where((t >= 0) & (u >= 0) & (v >= 0) & (u + v <= 1), t, np.inf)
    return t.min(), t.argmin()


def test_rays_agree_with_brute_force():
    rng = np.random.default_rng(1)
    vertices, triangles = soup(rng, 300)
    origins, directions = rng.uniform(-1, 1, (400, 3)), rng.normal(size=(400, 3))
    directions[:90] = np.repeat([[3, 0, 0], [0, -1, 0], [0, 0, 2]], 30, axis=0)  # along the axes
    directions[90:120, 0] = 0
    bvh = build_bvh(vertices, triangles)
    t, triangle, uv = raycast(bvh, origins, directions)
    for i in range(len(t)):
        expected, which = brute_raycast(vertices, triangles, origins[i], directions[i])
        assert t[i] == pytest.approx(expected, rel=1e-9)
        assert triangle[i] == (which if np.isfinite(expected) else -1)
    hit = triangle >= 0
    assert 0.2 < hit.mean() < 0.95
    corners = vertices[triangles[triangle[hit]]]
    weights = np.column_stack((1 - uv.sum(axis=1), uv))[hit]
    np.testing.assert_allclose(
        np.einsum("nk,nkx->nx", weights, corners), origins[hit] + t[hit, None] * directions[hit], atol=1e-9
    )
    near = raycast(bvh, origins, directions, t_max=0.5)[0]
    np.testing.assert_array_equal(near, np.where(t < 0.5, t, np.inf))


def test_no_ray_slips_between_triangles():
    rng = np.random.default_rng(2)
    vertices, triangles = arrays(trimesh.creation.icosphere(4, 0.7))
    bvh = build_bvh(vertices + 100.3, triangles)  # far from the origin, where rounding bites
    edges = vertices[triangles[:, :2]].mean(axis=1)
    along = vertices[triangles[:, 0]] + rng.random((len(triangles), 1)) * (edges - vertices[triangles[:, 0]])
    for aim in (vertices, edges, along):
        source = rng.uniform(-0.2, 0.2, 3)
        t, triangle, _ = raycast(bvh, source + 100.3, aim - source)
        assert (triangle >= 0).all()
        np.testing.assert_allclose(t, 1, atol=1e-3)


def test_rays_that_are_none():
    vertices, triangles = arrays(trimesh.creation.box())
    bvh = build_bvh(vertices, triangles)
    t, triangle, uv = raycast(bvh, np.zeros((4, 3)), [[0, 0, 0], [np.nan, 0, 1], [np.inf, 0, 0], [0, 0, 1]])
    assert np.isinf(t[:3]).all() and (triangle[:3] == -1).all() and (uv[:3] == 0).all()
    assert t[3] == pytest.approx(0.5)
    assert raycast(build_bvh(np.zeros((0, 3)), np.zeros((0, 3), np.int32)), [0, 0, 0], [0, 0, 1])[1].tolist() == [-1]
    with pytest.raises(MirrorScanError, match="pair"):
        raycast(bvh, np.zeros((2, 3)), np.ones((3, 3)))
    with pytest.raises(MirrorScanError, match="must be"):
        raycast(bvh, np.zeros((2, 2)), np.ones((2, 2)))


def test_closest_points_agree_with_brute_force():
    rng = np.random.default_rng(3)
    vertices, triangles = soup(rng, 120)
    points = np.concatenate((rng.uniform(-2, 2, (200, 3)), vertices[:50]))
    bvh = build_bvh(vertices, triangles)
    distance, triangle, nearest = closest_point(bvh, points)
    for i, point in enumerate(points):
        each = trimesh.triangles.closest_point(vertices[triangles], np.tile(point, (len(triangles), 1)))
        expected = np.linalg.norm(each - point, axis=1)
        assert distance[i] == pytest.approx(expected.min(), abs=1e-12)
        assert expected[triangle[i]] == pytest.approx(expected.min(), abs=1e-12)
    np.testing.assert_allclose(np.linalg.norm(nearest - points, axis=1), distance, atol=1e-12)
    limited = closest_point(bvh, points, 0.3)
    np.testing.assert_array_equal(limited[0], np.where(distance < 0.3, distance, np.inf))
    assert (limited[1][distance > 0.3] == -1).all() and np.isnan(limited[2][distance > 0.3]).all()
    assert closest_point(bvh, [[np.nan, 0, 0]])[1][0] == -1


def test_triangles_without_area_are_their_edges():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [3, 0, 0], [0, 5, 0]], float)
    needle = build_bvh(vertices, np.array([[0, 2, 1]], np.int32))
    assert closest_point(needle, [[2, 2, 0], [5, 0, 0]])[0] == pytest.approx([2, 2])
    dot = build_bvh(vertices, np.array([[3, 3, 3]], np.int32))
    assert closest_point(dot, [[0, 0, 0]])[0] == pytest.approx([5])
    assert raycast(needle, [2, 0, 1], [0, 0, -1])[1][0] == -1


def test_a_thousand_triangles_in_one_place_and_a_very_uneven_mesh():
    same = np.tile([[0, 0, 0], [1, 0, 0], [0, 1, 0]], (1000, 1)).astype(float)
    bvh = build_bvh(same, np.arange(3000, dtype=np.int32).reshape(-1, 3))
    assert raycast(bvh, [0.2, 0.2, 1], [0, 0, -1])[0][0] == pytest.approx(1)
    scale = 0.5 ** np.arange(1000) ** 0.9  # each triangle far smaller than the one before: a deep tree
    uneven = (np.array([[1, 0, 0], [1, 1, 0], [1, 0, 1]]) * scale[:, None, None]).reshape(-1, 3)
    bvh = build_bvh(uneven, np.arange(3000, dtype=np.int32).reshape(-1, 3))
    assert raycast(bvh, [2, 0.1, 0.1], [-1, 0, 0])[0][0] == pytest.approx(1)
    assert sorted(bvh.order) == list(range(1000))


def test_damaged_meshes_are_refused():
    triangle = np.array([[0, 1, 2]], np.int32)
    with pytest.raises(MirrorScanError, match="does not exist"):
        build_bvh(np.zeros((2, 3)), triangle)
    with pytest.raises(MirrorScanError, match="finite"):
        build_bvh(np.array([[0, 0, 0], [1, 0, np.nan], [0, 1, 0]]), triangle)
    with pytest.raises(MirrorScanError, match="must be"):
        closest_point(build_bvh(np.eye(3), triangle), np.zeros(3))
