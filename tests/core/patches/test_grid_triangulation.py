"""Depth grids of analytic surfaces become patches that lie on them, and nothing spans a jump."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from mirror_scan.core.camera import Intrinsics, project, unproject
from mirror_scan.core.mesh import SURFACE
from mirror_scan.core.mesh.boundary_loops import boundary_loops
from mirror_scan.core.mesh.normals import triangle_normals
from mirror_scan.core.mesh.submesh import vertex_fans
from mirror_scan.core.patches.grid_triangulation import TriangulationSettings, triangulate_view

LENS = Intrinsics(120, 90, 110.0, 110.0, 59.5, 44.5)
V, U = np.mgrid[:90, :120]
RAYS = unproject(np.ones((90, 120)), LENS)
PLAIN = TriangulationSettings(outline=0.0, min_triangles=0)
COLORS = np.stack((U, V, U + V), axis=-1).astype(np.uint8)


def patch_of(z, labels=None, view=0, settings=PLAIN, noise=0.0, points=None):
    depth = np.asarray(z, dtype=np.float32)
    labels = np.where(depth > 0, 0, -1).astype(np.int8) if labels is None else labels
    points = unproject(z, LENS) if points is None else points
    return triangulate_view(depth, labels, view, points, 1 / LENS.fx, noise, COLORS, settings)


def check_manifold(patch):
    directed = patch.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    assert len(np.unique(directed, axis=0)) == len(directed), "an edge is used twice the same way round"
    assert (vertex_fans(patch.triangles, len(patch.vertices)) == 1).all()
    assert len(np.unique(patch.triangles)) == len(patch.vertices)
    assert patch.triangles.dtype == np.int32 and patch.vertices.dtype == np.float64
    assert len(patch.view) == len(patch.colors) == len(patch.vertices) and len(patch.kind) == len(patch.triangles)
    assert (patch.kind == SURFACE).all() and patch.view.dtype == patch.kind.dtype == np.int8


def area(patch):
    return np.linalg.norm(triangle_normals(patch.vertices, patch.triangles), axis=1).sum() / 2


def test_a_plane_keeps_its_area():
    normal = np.array([0.6, -0.25, 1.0])
    z = 2.0 / (RAYS @ normal)
    patch = patch_of(z)
    check_manifold(patch)
    points = unproject(z, LENS)
    corners = points[[0, 0, -1, -1], [0, -1, -1, 0]]
    whole = trimesh.triangles.area(corners[[[0, 1, 2], [0, 2, 3]]]).sum()
    # a corner of the image may hang by one edge only; such teeth are taken off
    kept = {tuple(p) for p in np.rint(project(patch.vertices, LENS)).astype(int).tolist()}
    cut = 0.0
    for v, u in ((0, 0), (0, 119), (89, 119), (89, 0)):
        if (u, v) not in kept:
            beside = points[[v, v, abs(v - 1)], [u, abs(u - 1), u]]
            cut += trimesh.triangles.area(beside[None]).sum()
    assert area(patch) + cut == pytest.approx(whole, rel=1e-9)
    assert cut < 1e-3 * whole and len(patch.vertices) >= 90 * 120 - 4
    np.testing.assert_allclose(patch.vertices @ normal, 2.0, rtol=1e-9)
    normals = triangle_normals(patch.vertices, patch.triangles)
    assert ((normals * patch.vertices[patch.triangles[:, 0]]).sum(axis=1) < 0).all(), "towards the camera"
    assert len(boundary_loops(patch.triangles, len(patch.vertices))) == 1


def test_rounding_the_outline_costs_a_plane_next_to_nothing():
    z = 2.0 / (RAYS @ (0.3, 0.1, 1.0))
    exact, rounded = patch_of(z), patch_of(z, settings=TriangulationSettings())
    check_manifold(rounded)
    assert 0.985 < area(rounded) / area(exact) <= 1
    np.testing.assert_allclose(rounded.vertices @ (0.3, 0.1, 1.0), 2.0, rtol=1e-9)


@pytest.fixture(scope="module")
def ball():
    """A ball before a wall, seen as one view: (z, which is ball, centre, radius)."""
    centre, radius = np.array([0.05, -0.03, 1.5]), 0.4
    a, b, c = (RAYS**2).sum(-1), RAYS @ centre, centre @ centre - radius**2
    on = b * b > a * c
    return np.where(on, (b - np.sqrt(np.where(on, b * b - a * c, 0))) / a, 2.5), on, centre, radius


@pytest.mark.parametrize("outline", [0.0, 0.5])
def test_a_ball_before_a_wall(ball, outline):
    z, on, centre, radius = ball
    patch = patch_of(z, settings=TriangulationSettings(outline=outline))
    check_manifold(patch)
    apart = np.linalg.norm(patch.vertices - centre, axis=1)
    is_ball = apart < 1.1 * radius
    sides = is_ball[patch.triangles]
    assert (sides.all(axis=1) | ~sides.any(axis=1)).all(), "a triangle spans the jump from ball to wall"
    if outline == 0:
        np.testing.assert_allclose(apart[is_ball], radius, rtol=1e-9)
    else:
        assert np.abs(apart[is_ball] - radius).max() < 0.006  # cut edges are chords
        assert np.median(np.abs(apart[is_ball] - radius)) < 1e-12
    np.testing.assert_allclose(patch.vertices[~is_ball][:, 2], 2.5, rtol=1e-9)
    normals = triangle_normals(patch.vertices, patch.triangles)
    middle = patch.vertices[patch.triangles].mean(axis=1)
    assert ((normals * middle).sum(axis=1) < 0).all(), "towards the camera"
    outwards = (normals * (middle - centre)).sum(axis=1)
    assert (outwards[sides.all(axis=1)] > 0).all()
    # all that is seen less slantingly than the limit is there
    facing = -((patch_points := unproject(z, LENS)) - centre)[on] / radius
    cosine = (facing * patch_points[on]).sum(axis=1) / np.linalg.norm(patch_points[on], axis=1)
    assert is_ball.sum() > 0.95 * (cosine > np.cos(np.radians(70))).sum()


def test_connectivity_follows_the_image_and_colours_the_pixels():
    """Any points with one row a pixel will do: here the pixels themselves."""
    flat = np.stack((U, V, np.zeros(U.shape)), axis=-1).astype(float)
    patch = patch_of(np.full(U.shape, 2.0), points=flat)
    at = patch.vertices[:, :2].astype(int)
    np.testing.assert_array_equal(patch.colors, COLORS[at[:, 1], at[:, 0]])
    edges = patch.vertices[patch.triangles] - patch.vertices[np.roll(patch.triangles, 1, axis=1)]
    assert np.abs(edges).max() == 1, "only neighbouring pixels are joined"
    assert area(patch) in (119 * 89 - np.arange(5) / 2)


def test_squares_are_split_along_the_shorter_diagonal(ball):
    z, on, _, _ = ball
    patch = patch_of(z)
    points = unproject(z, LENS)
    at = np.rint(project(patch.vertices, LENS)).astype(int)
    a, b = at[patch.triangles], at[np.roll(patch.triangles, -1, axis=1)]
    low, high = np.minimum(a, b).reshape(-1, 2), np.maximum(a, b).reshape(-1, 2)
    diagonal = ((high - low) == 1).all(axis=1)
    u, v = low[diagonal].T
    falling = ((b - a).prod(axis=2).ravel() > 0)[diagonal]  # from top left to bottom right
    inside = on[v, u] & on[v + 1, u] & on[v, u + 1] & on[v + 1, u + 1]
    one = np.linalg.norm(points[v, u] - points[np.minimum(v + 1, 89), np.minimum(u + 1, 119)], axis=1)
    other = np.linalg.norm(points[np.minimum(v + 1, 89), u] - points[v, np.minimum(u + 1, 119)], axis=1)
    steep = np.abs(one - other) > 1e-9
    assert (inside & steep).sum() > 500
    right = falling == (one < other)
    # at the rim, where a square's one half is not joined, the other one may be left with the longer one
    assert right[inside & steep].mean() > 0.97


def test_other_views_are_left_out():
    labels = np.where(U < 40, 0, np.where(U < 80, 1, -1)).astype(np.int8)
    patch = patch_of(np.full(U.shape, 2.0), labels, view=1)
    check_manifold(patch)
    pixels = project(patch.vertices, LENS)
    assert (patch.view == 1).all() and pixels[:, 0].min() > 39.5 and pixels[:, 0].max() < 79.5
    assert len(patch.vertices) > 40 * 90 - 5


def test_slant_decides_what_is_joined():
    def joined(degrees, noise=0.0, limit=75.0):
        z = np.exp(np.tan(np.radians(degrees)) / LENS.fx * (U - 60))  # the same slant in every column
        options = TriangulationSettings(max_slope=limit, outline=0.0, min_triangles=0)
        return len(patch_of(z, settings=options, noise=noise).triangles)

    whole = 2 * 119 * 89
    assert joined(0) >= whole - 4 and joined(60) >= whole - 4
    assert joined(84) < 0.1 * whole
    assert joined(84, noise=0.2) >= whole - 4, "steps within the noise are no jumps"
    assert joined(60, limit=30.0) < 0.1 * whole


def test_specks_and_nothing():
    lonely = np.full(U.shape, -1, np.int8)
    lonely[5::4, 5::4] = 0
    for labels in (lonely, np.full(U.shape, -1, np.int8)):
        patch = patch_of(np.full(U.shape, 2.0), labels)
        assert patch.triangles.shape == (0, 3) and patch.vertices.shape == (0, 3) and len(patch.view) == 0
    speck = np.full(U.shape, -1, np.int8)
    speck[10:14, 10:14] = 0
    speck[30:60, 30:60] = 0
    patch = patch_of(np.full(U.shape, 2.0), speck, settings=TriangulationSettings(outline=0.0, min_triangles=40))
    assert project(patch.vertices, LENS).min() > 28
    bare = triangulate_view(np.ones((1, 5), np.float32), np.zeros((1, 5), np.int8), 0, np.ones((1, 5, 3)), 0.01, 0.0)
    assert len(bare.triangles) == 0 and bare.colors is None
