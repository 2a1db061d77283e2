"""What was lost is bridged flat, what hides behind an outline is round."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from mirror_scan.core.camera import Intrinsics, RgbdImage
from mirror_scan.core.closing.mesh_closing import ClosingSettings, close_mesh
from mirror_scan.core.hole_filling.delaunay_refinement import edge_length_at_vertices, refine
from mirror_scan.core.hole_filling.loop_triangulation import fill_loops
from mirror_scan.core.hole_filling.silhouette_bulge import bulge, rim_marks
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.half_edges import boundary_vertices
from mirror_scan.core.mesh.submesh import compact, remove_bowties
from mirror_scan.core.views.view_maps import view_maps

CAMERA = Intrinsics(200, 200, 300.0, 300.0, 99.5, 99.5)
UP = np.array((0.0, -1.0, 0.0))
RADIUS = 0.3


def seen_ball(wall: float):
    """What a camera sees of a ball 2 m away before a wall (0: none reads): its patch and its maps."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=RADIUS)
    points = np.array(ball.vertices) + (0, 0, 2.0)
    middle = points[ball.faces].mean(axis=1)
    facing = np.einsum("ij,ij->i", ball.face_normals, middle) < -0.08 * np.linalg.norm(middle, axis=1)
    patch = Mesh(points, ball.faces[facing].astype(np.int32), None, np.zeros(len(points), np.int8),
                 np.zeros(facing.sum(), np.int8))  # fmt: skip
    v, u = np.mgrid[:200, :200]
    ray = np.stack(((u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones((200, 200))), axis=-1)
    length, along = (ray**2).sum(axis=-1), 2.0 * ray[..., 2]
    root = along**2 - length * (4.0 - RADIUS**2)
    hit = root > 0
    depth = np.where(hit, (along - np.sqrt(np.where(hit, root, 0))) / length, wall).astype(np.float32)
    labels = np.where(hit, 0, -1).astype(np.int8)
    return remove_bowties(compact(patch)), view_maps(
        RgbdImage(depth, CAMERA), labels, np.zeros_like(labels), [], np.zeros(1)
    )


def refined(patch, maps):
    mesh = fill_loops(patch)
    marks = rim_marks(mesh, maps)
    mesh, parents = refine(mesh, edge_length_at_vertices(mesh), 1.7)
    return bulge(marks, parents, mesh), mesh, marks


def test_outlines_are_told_from_losses():
    patch, maps = seen_ball(3.0)
    stretch, mesh, marks = refined(patch, maps)
    ends = marks[:, 3] > 0
    rim = np.zeros(len(marks), np.bool_)
    rim[boundary_vertices(patch.triangles, len(patch.vertices))] = True
    np.testing.assert_array_equal(ends, rim)
    outward = mesh.vertices[: len(marks)] - (0, 0, 2.0)
    assert np.einsum("ij,ij->i", marks[rim, :3], outward[rim]).min() > 0.95 * RADIUS
    made = mesh.view < 0
    assert (stretch[~made] == 1).all() and (stretch[made] > 0.1).all() and stretch.max() < 2.0
    lost, _, marks = refined(patch, seen_ball(0.0)[1])
    assert not marks[:, 3].any() and lost[made].max() < 0.45 < 0.9 < stretch[made].max()


@pytest.mark.parametrize(
    ("wall", "curved", "low", "high"), [(3.0, 0.25, 0.57, 0.8), (0.0, 0.25, 0.34, 0.45), (0.0, 1.0, 0.57, 0.8)]
)
def test_the_unseen_half_is_round_behind_an_outline(wall, curved, low, high):
    """A camera sees less than half of a ball: closed, it is a bowl with a lid, but well rounded before a wall.

    Or where it is known that it is not hollow.
    """
    patch, maps = seen_ball(wall)
    closed, notes = close_mesh(patch, maps, UP, None, ClosingSettings(curved=curved))
    body = trimesh.Trimesh(closed.vertices, closed.triangles, process=False)
    share = body.volume / (4 / 3 * np.pi * RADIUS**3)
    print(f"\nwall {wall}: {share:.3f} of the ball")
    assert body.is_watertight and low < share < high and notes == []


def test_noisy_rims_are_trusted_less():
    patch, maps = seen_ball(3.0)
    sure, mesh, _ = refined(patch, maps)
    noisy, _, _ = refined(patch, replace(maps, noise=np.full(1, 0.003)))
    assert noisy[mesh.view < 0].mean() < 0.6 * sure[mesh.view < 0].mean()


def test_without_a_view_it_goes_on(blind_maps):
    patch, _ = seen_ball(3.0)
    stretch, mesh, marks = refined(patch, blind_maps)
    assert marks[:, 3].any() and stretch[mesh.view < 0].min() > 0.9
    none = replace(blind_maps, to_view=np.empty((0, 4, 4)), intrinsics=np.empty((0, 4)), noise=np.empty(0))
    np.testing.assert_array_equal(rim_marks(fill_loops(patch), none), marks)
