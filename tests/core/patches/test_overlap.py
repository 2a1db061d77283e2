"""A ball seen directly and in a mirror: what the views say of it, and how they are parted."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from mirror_scan.core.camera import Intrinsics, RgbdImage, unproject
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.boundary_loops import boundary_loops
from mirror_scan.core.mesh.bvh import build_bvh, raycast
from mirror_scan.core.mesh.half_edges import twins
from mirror_scan.core.mesh.normals import vertex_normals
from mirror_scan.core.mesh.submesh import vertex_fans
from mirror_scan.core.mesh.triangle_mesh import merge
from mirror_scan.core.mirrors.mirror import plane_mirror, reflect, reflection_matrix
from mirror_scan.core.patches.grid_triangulation import triangulate_view
from mirror_scan.core.patches.overlap import part_overlaps
from mirror_scan.core.patches.view_comparison import OverlapSettings, compare_views, own_confidence
from mirror_scan.core.views.view_maps import view_maps
from mirror_scan.core.zippering.zipper import zip_patches
from scipy.spatial import cKDTree

LENS = Intrinsics(260, 160, 200.0, 200.0, 99.5, 79.5)
RAYS = unproject(np.ones((160, 260)), LENS)
CENTRE, RADIUS = np.array([-0.15, 0.0, 1.6]), 0.4
MIRROR = plane_mirror("right", (0.75, 0.0, 1.9), (-0.85, 0.0, -0.53))


def ball_depth(centre, radius):
    a, b, c = (RAYS**2).sum(-1), RAYS @ centre, centre @ centre - radius**2
    on = b * b > a * c
    return np.where(on, (b - np.sqrt(np.where(on, b * b - a * c, 0))) / a, np.inf)


def two_views(mirrored_radius=RADIUS, noise=0.0, seed=0):
    """The ball, and its image in the mirror: depth, labels, maps and both patches (the mirrored one flipped back)."""
    direct, mirrored = ball_depth(CENTRE, RADIUS), ball_depth(reflect(CENTRE, MIRROR), mirrored_radius)
    labels = np.where(np.isfinite(direct), 0, np.where(np.isfinite(mirrored), 1, -1)).astype(np.int8)
    depth = np.where(labels == 0, direct, np.where(labels == 1, mirrored, 0))
    depth *= 1 + noise * np.random.default_rng(seed).normal(size=depth.shape)
    depth = depth.astype(np.float32)
    maps = view_maps(RgbdImage(depth, LENS), labels, labels.copy(), [MIRROR], np.full(2, max(noise, 1e-6)))
    patches = [triangulate_view(depth, labels, k, unproject(depth, LENS), 1 / LENS.fx, noise) for k in range(2)]
    back = patches[1].transformed(reflection_matrix(MIRROR))
    patches[1] = replace(back, triangles=np.ascontiguousarray(back.triangles[:, ::-1]))
    return SimpleNamespace(depth=depth, labels=labels, maps=maps, patches=patches)


@pytest.fixture(scope="module")
def ball():
    return two_views()


def eye(view):
    return np.zeros(3) if view == 0 else reflect(np.zeros(3), MIRROR)


def test_normals_and_confidence_of_a_ball(ball):
    points = unproject(ball.depth, LENS)
    for view in range(2):
        mine = ball.labels == view
        real = points[mine] if view == 0 else reflect(points[mine], MIRROR)
        truth = (real - CENTRE) / RADIUS
        ray = real - eye(view)
        cosine = -(truth * ray).sum(axis=1) / np.linalg.norm(ray, axis=1)
        frontal = cosine > 0.5
        assert frontal.sum() > 1500
        found = ball.maps.normals[mine]
        assert np.degrees(np.arccos(np.clip((found * truth).sum(axis=1)[frontal], -1, 1))).max() < 0.5
        expected = cosine**2 / points[mine][:, 2]
        np.testing.assert_allclose(ball.maps.confidence[mine][frontal], expected[frontal], rtol=0.02)
        own = own_confidence(ball.patches[view], ball.maps)
        assert own.shape == (len(ball.patches[view].vertices),) and own.max() == pytest.approx(expected.max(), rel=0.02)
    assert not ball.maps.confidence[ball.labels < 0].any() and not ball.maps.normals[ball.labels < 0].any()
    np.testing.assert_allclose(ball.maps.to_view, [np.eye(4), reflection_matrix(MIRROR)])


def test_who_sees_a_vertex_better(ball):
    patch = ball.patches[0]
    normals = vertex_normals(patch.vertices, patch.triangles)
    own = own_confidence(patch, ball.maps)
    advantage, shift = compare_views(patch.vertices, patch.view, normals, own, ball.maps, OverlapSettings())
    truth = (patch.vertices - CENTRE) / RADIUS
    away = patch.vertices - eye(1)
    other = -(truth * away).sum(axis=1) / np.linalg.norm(away, axis=1)
    assert np.isinf(advantage[other < -0.2]).all(), "the mirror cannot see these"
    assert np.isfinite(advantage[(other > 0.35) & (own > 0.1)]).mean() > 0.99
    # frontal to the one and slanting to the other
    mine = -(truth * patch.vertices).sum(axis=1) / np.linalg.norm(patch.vertices, axis=1)
    assert (advantage[(other > 0.4) & (mine > other + 0.2)] > 0).all()
    assert np.linalg.norm(shift, axis=1).max() < 0.005, "both views lie on the ball already"


def crossings(patches) -> int:
    """How many vertices of one patch the other covers, seen from the middle of the ball."""
    count = 0
    for one, other in (patches, patches[::-1]):
        hit = raycast(build_bvh(other.vertices, other.triangles), CENTRE, one.vertices - CENTRE)[1]
        count += int((hit >= 0).sum())
    return count


@pytest.mark.parametrize(("radius", "noise"), [(RADIUS, 0.0), (RADIUS - 0.006, 0.0), (RADIUS, 0.001)])
def test_overlaps_are_parted_along_a_narrow_gap(radius, noise):
    scene = two_views(radius, noise)
    before = crossings(scene.patches)
    parted = part_overlaps(scene.patches, scene.maps)
    assert len(parted) == 2 and before > 3000
    # where both silhouettes meet, at the ends of the cut, a few vertices may reach under the other patch
    assert crossings(parted) <= 8
    edge = 1.9 / LENS.fx  # a pixel where the mirror shows the ball
    for k, (patch, whole) in enumerate(zip(parted, scene.patches, strict=True)):
        assert (patch.view == k).all() and len(patch.triangles) == len(patch.kind)
        assert (vertex_fans(patch.triangles, len(patch.vertices)) == 1).all()
        assert 0.5 * len(whole.triangles) < len(patch.triangles) < len(whole.triangles)
        apart = np.linalg.norm(patch.vertices - CENTRE, axis=1)
        assert (apart > radius - 0.004 - 6 * noise).all() and (apart < RADIUS + 0.004 + 6 * noise).all()
    # all that either saw is still seen by one of them, but for the gap
    left = cKDTree(np.concatenate([p.vertices for p in parted]))
    lost = left.query(np.concatenate([p.vertices for p in scene.patches]))[0]
    assert lost.max() < 4 * edge
    # facing boundaries run in parallel, a gap apart
    rims = [p.vertices[boundary_loops(p.triangles, len(p.vertices))[0]] for p in parted]
    gap = cKDTree(rims[0]).query(rims[1])[0]
    facing = gap < 4 * edge
    assert facing.sum() > 40 and 0.3 * edge < np.median(gap[facing]) < 3 * edge


def test_parted_views_zip_to_one_surface():
    """A mirror right behind would see the rest; here the zipper joins both patches and leaves one outline."""
    scene = two_views(noise=0.0005)
    parted = part_overlaps(scene.patches, scene.maps)
    mesh, seams, _ = zip_patches(parted, scene.maps, np.array((0, -1.0, 0)), CENTRE, None)
    assert seams and all(set(s.views) <= {0, 1} for s in seams)
    assert (twins(mesh.triangles, len(mesh.vertices)) >= -1).all()
    loops = boundary_loops(mesh.triangles, len(mesh.vertices))
    assert len(loops) == 1, "one outline is left: what neither view has seen"
    ball = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    assert ball.is_winding_consistent and len(ball.split(only_watertight=False)) == 1
    outwards = (ball.face_normals * (ball.triangles_center - CENTRE)).sum(axis=1)
    assert (outwards > 0).mean() > 0.999
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices - CENTRE, axis=1), RADIUS, atol=0.006)


def test_surfaces_that_do_not_overlap_stay_as_they_are(ball):
    """Half of the ball each, a clear gap between."""
    halves = []
    towards = [(eye(k) - CENTRE) / np.linalg.norm(eye(k) - CENTRE) for k in range(2)]
    for k, patch in enumerate(ball.patches):
        middle = patch.vertices[patch.triangles].mean(axis=1) - CENTRE
        halves.append((patch, middle @ (towards[k] - towards[1 - k]) > 0.12))
    labels = np.full(ball.labels.shape, -1, np.int8)
    for k, (patch, keep) in enumerate(halves):
        inner = patch.vertices[np.unique(patch.triangles[keep])]
        seen_at = inner if k == 0 else reflect(inner, MIRROR)
        u, v = np.rint(seen_at[:, 0] / seen_at[:, 2] * 200 + 99.5), np.rint(seen_at[:, 1] / seen_at[:, 2] * 200 + 79.5)
        labels[v.astype(int), u.astype(int)] = k
    maps = view_maps(RgbdImage(ball.depth, LENS), labels, labels, [MIRROR], np.full(2, 1e-6))
    patches = []
    for k in range(2):
        patch = triangulate_view(ball.depth, labels, k, unproject(ball.depth, LENS), 1 / LENS.fx, 0.0)
        if k:
            patch = patch.transformed(reflection_matrix(MIRROR))
            patch = replace(patch, triangles=np.ascontiguousarray(patch.triangles[:, ::-1]))
        patches.append(patch)
    for before, after in zip(patches, part_overlaps(patches, maps), strict=True):
        assert len(before.triangles) > 500
        np.testing.assert_array_equal(after.vertices, before.vertices)
        np.testing.assert_array_equal(after.triangles, before.triangles)


def test_a_view_that_shows_nothing(ball):
    empty = Mesh(np.empty((0, 3)), np.empty((0, 3), np.int32), None, np.empty(0, np.int8), np.empty(0, np.int8))
    labels = np.where(ball.labels == 0, 0, -1).astype(np.int8)
    maps = view_maps(RgbdImage(ball.depth, LENS), labels, labels, [MIRROR], np.zeros(2))
    one, none = part_overlaps([ball.patches[0], empty], maps)
    np.testing.assert_array_equal(one.vertices, ball.patches[0].vertices)
    assert len(none.triangles) == 0 and len(merge([one, none]).triangles) == len(one.triangles)
    assert part_overlaps([], maps) == []
