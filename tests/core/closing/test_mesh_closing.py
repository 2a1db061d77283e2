"""Whatever the zipper left open ends closed, oriented, in one piece, and standing flat on the floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.camera import Intrinsics, RgbdImage
from mirror_scan.core.closing.mesh_closing import ClosingSettings, close_mesh
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.hole_filling.loop_triangulation import fill_loops
from mirror_scan.core.mesh import FILL, SURFACE, Mesh
from mirror_scan.core.mesh.half_edges import twins
from mirror_scan.core.mesh.soundness import mesh_report
from mirror_scan.core.mesh.submesh import compact, keep_components, vertex_fans
from mirror_scan.core.mesh.triangle_mesh import merge
from mirror_scan.core.views.view_maps import view_maps
from mirror_scan.core.zippering.zipper import zip_patches

UP = np.array((0.0, 0.0, 1.0))


def measured(vertices, faces) -> Mesh:
    count = len(vertices)
    grey = np.full((count, 3), 120, np.uint8)
    kind = np.zeros(len(faces), np.int8)
    vertices, faces = np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int32)
    return compact(Mesh(vertices, faces, grey, np.zeros(count, np.int8), kind))


def check_closed(mesh: Mesh):
    assert (twins(mesh.triangles, len(mesh.vertices)) >= 0).all()
    assert (vertex_fans(mesh.triangles, len(mesh.vertices)) == 1).all()
    body = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    assert body.is_watertight and body.is_winding_consistent and body.body_count == 1
    assert np.isfinite(mesh.vertices).all()
    assert len(mesh.view) == len(mesh.colors) == len(mesh.vertices) and len(mesh.kind) == len(mesh.triangles)
    return body


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_a_torn_ball_is_mended(blind_maps, seed, holes):
    whole, rng = trimesh.creation.icosphere(subdivisions=4, radius=0.4), np.random.default_rng(seed)
    middle = whole.triangles_center
    keep = rng.random(len(middle)) > rng.choice([0.0, 0.01])
    for _ in range(holes):
        keep &= np.linalg.norm(middle - middle[rng.integers(len(middle))], axis=1) > rng.uniform(0.03, 0.18)
    mesh, _ = close_mesh(measured(whole.vertices, whole.faces[keep]), blind_maps, UP, None)
    body = check_closed(mesh)
    if holes < 4:
        assert body.volume == pytest.approx(whole.volume, rel=0.05)
        assert np.linalg.norm(mesh.vertices, axis=1) == pytest.approx(0.4, abs=0.05)


def test_holes_follow_the_surface_around(blind_maps):
    """A hole in a ball is closed by a cap that bulges, not by a lid."""
    whole = trimesh.creation.icosphere(subdivisions=4, radius=0.4)
    keep = np.linalg.norm(whole.triangles_center - (0, 0, 0.4), axis=1) > 0.2
    mesh, notes = close_mesh(measured(whole.vertices, whole.faces[keep]), blind_maps, UP, None)
    check_closed(mesh)
    lid = 0.4 - np.sqrt(0.4**2 - 0.2**2 * (1 - 0.2**2 / (4 * 0.4**2)))
    error = np.abs(np.linalg.norm(mesh.vertices[mesh.view < 0], axis=1) - 0.4)
    assert error.max() < 0.35 * lid and notes == []
    surface = mesh.vertices[np.unique(mesh.triangles[mesh.kind == SURFACE])]
    assert np.abs(np.linalg.norm(surface, axis=1) - 0.4).max() < 0.004, "the measured surface moved"


def post(bottom, radius=0.1, n=40, rows=30, top=1.0) -> Mesh:
    """A post open below, closed above, standing beside the origin."""
    angle = 2 * np.pi * np.arange(n) / n
    z = np.linspace(bottom, top, rows)
    ring = np.column_stack((0.3 + radius * np.cos(angle), radius * np.sin(angle)))
    points = np.concatenate([np.column_stack((ring, np.full(n, h))) for h in z] + [[(0.3, 0, top + 0.02)]])
    at = np.arange(rows * n).reshape(rows, n)
    after = np.roll(at, -1, axis=1)
    a, b, c, d = (x.ravel() for x in (at[:-1], after[:-1], after[1:], at[1:]))
    cap = np.column_stack((at[-1], after[-1], np.full(n, rows * n)))
    return measured(points, np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d)), cap)))


@pytest.mark.parametrize("floor", [0.0, -0.4])
def test_soles_stand_flat_on_the_floor(blind_maps, floor):
    mesh = post(floor + 0.03, top=floor + 1.0)
    closed, _ = close_mesh(mesh, blind_maps, UP, floor)
    body = check_closed(closed)
    assert closed.vertices[:, 2].min() == pytest.approx(floor, abs=1e-9)
    sole = (np.abs(body.triangles[:, :, 2] - floor) < 1e-5).all(axis=1)
    assert body.area_faces[sole].sum() == pytest.approx(40 / 2 * np.sin(2 * np.pi / 40) * 0.1**2, rel=0.02)
    assert (body.face_normals[sole][:, 2] < -0.999).all() and (closed.kind[sole] == FILL).all()
    # with no floor in sight the post just goes on, and is rounded off
    hanging, _ = close_mesh(mesh, blind_maps, UP, None)
    assert check_closed(hanging).volume == pytest.approx(body.volume, rel=0.02)
    assert floor - 0.05 < hanging.vertices[:, 2].min() < floor + 0.03 - 0.01


def test_soles_do_not_cross_themselves_for_others(blind_maps):
    """Exactly coplanar triangles do by MeshLab's count; in any frame."""
    pymeshlab = pytest.importorskip("pymeshlab")
    oval = post(0.03, n=120, rows=90)  # of a circle all corners of the sole would share one plane again
    closed, _ = close_mesh(replace(oval, vertices=oval.vertices * (1.0, 0.6, 1.0)), blind_maps, UP, 0.0)
    turn = trimesh.transformations.rotation_matrix(1.0, (1, 2, 3))
    for mesh in (closed, closed.transformed(turn)):
        meshes = pymeshlab.MeshSet(verbose=False)
        meshes.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.triangles))
        meshes.compute_selection_by_self_intersections_per_face()
        crossing = meshes.current_mesh().face_selection_array()
        assert not crossing[closed.kind == FILL].any(), "the post's own sides are flat strips"


def test_what_hangs_in_the_air_is_no_sole(blind_maps):
    closed, _ = close_mesh(post(0.5), blind_maps, UP, 0.0)
    check_closed(closed)
    assert closed.vertices[:, 2].min() > 0.4


def test_crumbs_are_left_out_and_said_so(blind_maps):
    crumb = trimesh.creation.icosphere(subdivisions=1, radius=0.02)
    scene = merge(
        [
            post(0.02),
            measured(crumb.vertices + (2, 0, 0), crumb.faces),
            measured(crumb.vertices - (2, 0, 0), crumb.faces),
        ]
    )
    closed, notes = close_mesh(scene, blind_maps, UP, 0.0)
    check_closed(closed)
    assert closed.vertices[:, 0].min() > 0 and closed.vertices[:, 0].max() < 1
    assert len(notes) == 1 and "2 small piece" in notes[0]
    left, kept, dropped = keep_components(scene, twins(scene.triangles, len(scene.vertices)))
    assert (kept, dropped) == (0, 2) and len(left.triangles) == len(post(0.02).triangles)
    whole = post(0.02)
    alone, kept, dropped = keep_components(whole, twins(whole.triangles, len(whole.vertices)))
    assert (kept, dropped) == (0, 0) and len(alone.triangles) == len(left.triangles)


def test_islands_are_kept_on_request(blind_maps):
    """An open island is closed on its own; specks go all the same."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    cap = ball.faces[ball.vertices[ball.faces][:, :, 2].mean(axis=1) > -0.03]
    crumb = trimesh.creation.icosphere(subdivisions=1, radius=0.02)
    scene = merge(
        [
            post(0.02), measured(ball.vertices + (1.5, 0, 0.5), cap),
            measured(crumb.vertices - (2, 0, 0), crumb.faces),
        ]
    )  # fmt: skip
    closed, notes = close_mesh(scene, blind_maps, UP, 0.0, ClosingSettings(keep_islands=True))
    report = mesh_report(closed)
    assert report["watertight"] and report["manifold"] and report["components"] == 2
    island = trimesh.Trimesh(closed.vertices, closed.triangles, process=False).split()
    volumes = sorted(piece.volume for piece in island)
    assert volumes[0] > 0.5 * 4 / 3 * np.pi * 0.1**3 and len(island) == 2
    assert "1 piece(s) that nothing connects to the body are kept" in notes[0] and "1 small piece" in notes[1]


def test_closed_already(blind_maps):
    whole = trimesh.creation.icosphere(subdivisions=3, radius=0.4)
    mesh = measured(whole.vertices, whole.faces)
    closed, notes = close_mesh(mesh, blind_maps, UP, None, replace(ClosingSettings(), largest_loop=16))
    np.testing.assert_array_equal(closed.vertices, mesh.vertices)
    np.testing.assert_array_equal(closed.triangles, mesh.triangles)
    assert notes == [] and mesh_report(closed)["watertight"]


def test_a_cap_stays_out_of_space_seen_to_be_empty(blind_maps):
    """A pillar with a sharp rim, looked at from below the rim: the wall is read over it, so no dome can be there."""
    up, intrinsics = np.array((0.0, -1.0, 0.0)), Intrinsics(300, 200, 300.0, 300.0, 149.5, 99.5)
    angle, rows = 2 * np.pi * np.arange(80) / 80, 40
    ring = np.column_stack((0.25 * np.cos(angle), np.zeros(80), 2.0 - 0.25 * np.sin(angle)))
    points = np.concatenate([ring + (0, 0.3 - 0.6 * k / (rows - 1), 0) for k in range(rows)])
    at = np.arange(len(points)).reshape(rows, 80)
    after = np.roll(at, -1, axis=1)
    a, b, c, d = (x.ravel() for x in (at[:-1], after[:-1], after[1:], at[1:]))
    pillar = measured(points, np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d)))))
    depth = np.where(np.arange(200)[:, None] < 99.5 - 300 * 0.3 / 1.75, 5.0, 1.75) * np.ones((200, 300))
    seen = np.zeros(depth.shape, np.int8)
    maps = view_maps(
        RgbdImage(depth.astype(np.float32), intrinsics), np.full(depth.shape, -1, np.int8), seen, [], np.zeros(1)
    )
    tops = []
    for known in (blind_maps, maps):
        closed, _ = close_mesh(pillar, known, up, None)
        check_closed(closed)
        tops.append(-closed.vertices[:, 1].min() - 0.3)
    sight = 0.3 / 1.75 * 0.25  # where the ray over the front of the rim is above the middle
    assert tops[0] > 0.1 > 2 * sight > tops[1] > 0, "drawn out where nothing is known, held back where it is"


def test_triangles_that_clash_are_taken_out(blind_maps):
    """Doubled, turned round, or with a corner twice: the rest is closed all the same, and it is said."""
    whole = trimesh.creation.icosphere(subdivisions=4, radius=0.4)
    faces = np.array(whole.faces)
    faces[100:130] = faces[100:130, ::-1]
    faces = np.concatenate((faces, faces[:20], [[5, 5, 6]]))
    mesh = Mesh(np.array(whole.vertices), faces.astype(np.int32), None, np.zeros(len(whole.vertices), np.int8),
                np.zeros(len(faces), np.int8))  # fmt: skip
    closed, notes = close_mesh(mesh, blind_maps, UP, None)
    report = mesh_report(closed)
    assert report["watertight"] and report["manifold"] and report["components"] == 1
    assert report["volume_m3"] == pytest.approx(whole.volume, rel=0.02)
    assert "clash" in notes[0]


def broken(case: str) -> Mesh:
    mesh = post(0.02)
    vertices, triangles = mesh.vertices.copy(), mesh.triangles.copy()
    if case == "not a number":
        vertices[7] = np.nan
    elif case == "no such vertex":
        triangles[3, 1] = len(vertices)
    elif case == "negative":
        triangles[3, 1] = -1
    elif case == "no kind":
        return replace(mesh, kind=None)
    return replace(mesh, vertices=vertices, triangles=triangles)


@pytest.mark.parametrize(
    ("case", "words"),
    [("not a number", "finite"), ("no such vertex", "does not exist"), ("negative", "does not exist"),
     ("no kind", "what kind")],
)  # fmt: skip
def test_a_damaged_mesh_is_refused_in_words(blind_maps, case, words):
    mesh = broken(case)
    for begin, work in (
        ("closing", lambda: close_mesh(mesh, blind_maps, UP, 0.0)),
        ("filling", lambda: fill_loops(mesh, blind_maps)),
        ("zippering: patch 1", lambda: zip_patches([post(0.02), mesh], blind_maps, UP, np.zeros(3), 0.0)),
    ):
        with pytest.raises(MirrorScanError, match=f"^{begin}.*{words}"):
            work()
