"""The whole job: virtual captures of every sensor become closed avatars that lie on the true body."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from mirror_scan.core.avatar.coordinate_frame import avatar_frame
from mirror_scan.core.capture import Capture, open_capture
from mirror_scan.core.errors import CaptureError, MirrorError, ReconstructionError
from mirror_scan.core.io import read_mesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.surface_distance import evaluate, surface_distance
from mirror_scan.core.mirrors.mirror import reflect, reflection_matrix
from mirror_scan.core.pipeline import Settings, reconstruct, reconstruction_steps
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate
from scipy.spatial import cKDTree

# mean distances [mm], reconstruction to truth and truth to reconstruction, and the largest ones
LIMITS = {
    "ideal": (0.6, 0.6, 20.0), "kinect_v1": (3.5, 3.5, 40.0), "azure_kinect": (1.2, 1.2, 25.0),
    "realsense_d455": (5.0, 4.5, 55.0),
}  # fmt: skip


@pytest.mark.parametrize("sensor", LIMITS)
def test_a_closed_avatar_on_the_true_body(simulated, reconstructed, person, sensor):
    made = reconstructed(sensor)
    mesh = made.mesh
    body = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    assert body.is_watertight and body.is_winding_consistent and body.body_count == 1
    assert body.volume == pytest.approx(trimesh.Trimesh(person.vertices, person.triangles).volume, rel=0.06)
    report = made.report["mesh"]
    assert report["watertight"] and report["manifold"] and report["components"] == 1
    assert report["self_intersections"] < 0.01 * len(mesh.triangles)

    count = len(mesh.vertices)
    assert mesh.vertices.dtype == np.float64 and mesh.triangles.dtype == np.int32 and np.isfinite(mesh.vertices).all()
    assert mesh.colors.shape == (count, 3) and mesh.colors.dtype == np.uint8
    assert mesh.view.shape == (count,) and mesh.view.dtype == np.int8 and set(np.unique(mesh.view)) == {-1, 0, 1, 2}
    assert mesh.kind.shape == (len(mesh.triangles),) and set(np.unique(mesh.kind)) == {0, 1, 2}
    assert len(np.unique(mesh.triangles)) == count

    # both in the camera frame, and no alignment: the mirrors must be placed right
    truth = simulated(sensor).truth
    found = mesh.transformed(np.linalg.inv(made.camera_to_avatar))
    aligned = evaluate(found, truth.body, samples=10_000)
    plain = 1000 * surface_distance(found, truth.body, 10_000).mean
    print(f"\n{sensor}: accuracy {aligned['accuracy_mean']:.2f} mm (max {aligned['accuracy_max']:.1f}), completeness "
          f"{aligned['complete_mean']:.2f} mm (max {aligned['complete_max']:.1f}), unaligned {plain:.2f}, "
          f"{aligned['self_intersecting_faces']} of {len(mesh.triangles)} intersect")  # fmt: skip
    accuracy, completeness, largest = LIMITS[sensor]
    assert aligned["accuracy_mean"] < accuracy and aligned["complete_mean"] < completeness
    assert max(aligned["accuracy_max"], aligned["complete_max"]) < largest
    assert plain < 1.5 * accuracy + 1.0 and aligned["icp_shift_mm"] < 8
    assert made.warnings == () and made.frame == "avatar"


def test_what_hangs_above_the_floor_has_its_lowest_point_on_z_0():
    """Of a chair with thin legs only the back may be read."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.2)
    mesh = Mesh(ball.vertices + (0.1, -0.5, 2.0), ball.faces.astype(np.int32))
    for floor, lowest in ((-1.0, 0.0), (0.27, 0.03), (None, 0.0)):
        to_avatar = avatar_frame(mesh.vertices, np.array((0, -1.0, 0)), np.array((0, 0, 2.0)), floor)
        placed = mesh.transformed(to_avatar).vertices
        assert placed[:, 2].min() == pytest.approx(lowest, abs=1e-9)
        assert np.abs(placed[:, :2].min(axis=0) + placed[:, :2].max(axis=0)).max() < 1e-9


def test_it_stands_in_the_avatar_frame(simulated, reconstructed, person):
    for sensor in ("ideal", "azure_kinect"):
        made = reconstructed(sensor)
        p = made.mesh.vertices
        assert abs(p[:, 2].min()) < 0.004 and p[:, 2].max() == pytest.approx(1.70, abs=0.012)
        feet = p[p[:, 2] < 0.1]
        assert abs(feet[:, 0].min() + feet[:, 0].max()) < 0.03 and abs(feet[:, 1].min() + feet[:, 1].max()) < 0.04
        head = p[p[:, 2] > 1.50]
        nose = head[head[:, 1].argmin()]
        assert abs(nose[0]) < 0.02 and head[:, 1].max() < -0.7 * nose[1] + 0.2, "the face looks along -Y"
        toes = feet[:, 1].min() + p[(p[:, 2] > 0.2) & (p[:, 2] < 0.3)][:, 1].mean()
        assert toes < 0
        rotation = made.camera_to_avatar[:3, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(rotation) == pytest.approx(1) and made.camera_to_avatar[3].tolist() == [0, 0, 0, 1]
        # the rig's own frame, but for where between the feet the origin is put
        there = made.camera_to_avatar @ np.linalg.inv(simulated(sensor).truth.camera_to_avatar)
        assert np.degrees(np.arccos((np.trace(there[:3, :3]) - 1) / 2)) < 1.0
        assert np.abs(there[[0, 2], 3]).max() < 0.02

        # nothing is mirrored: the patch of colour on the left is on the left, and colours are where they belong
        red, greenish, blue = made.mesh.colors.astype(int).T
        green = greenish - np.maximum(red, blue) > 30
        assert green.sum() > 100 and (p[green, 0] > 0).mean() > 0.98, "+X is the subject's left"
        nearest = cKDTree(person.vertices + there[:3, 3]).query(p)[1]
        # the rig shades what it shows, so only the tints can be compared
        tint, true = (c / c.sum(axis=1, keepdims=True).clip(1) for c in (made.mesh.colors, person.colors[nearest]))
        off = np.abs(tint - true).max(axis=1)
        print(f"\n{sensor}: tints differ by {np.median(off):.3f}, {100 * (off < 0.1).mean():.1f} % by less than 0.1")
        assert np.median(off) < 0.02 and (off < 0.1).mean() > 0.9


def test_views_come_from_where_they_say(simulated, reconstructed):
    """Direct vertices face the camera, those of a mirror its virtual camera behind it."""
    made = reconstructed("azure_kinect")
    mesh = made.mesh.transformed(np.linalg.inv(made.camera_to_avatar))
    normals = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False).vertex_normals
    for view in range(3):
        eye = np.zeros(3) if view == 0 else reflect(np.zeros(3), made.mirrors[view - 1])
        mine = mesh.view == view
        assert mine.sum() > 2000
        assert ((normals[mine] * (eye - mesh.vertices[mine])).sum(axis=1) > 0).mean() > 0.97
        patch = made.patches[view]
        assert (patch.view == view).all() and np.linalg.det(reflection_matrix(made.mirrors[view - 1])) < 0
    for mirror, true in zip(made.mirrors, simulated("azure_kinect").truth.mirrors, strict=True):
        assert np.degrees(np.arccos(min(mirror.normal @ true.normal, 1))) < 0.2
        assert abs((mirror.point - true.point) @ true.normal) < 0.003


def test_the_report_is_plain_and_whole(reconstructed):
    made = reconstructed("kinect_v1")
    report = made.report
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert set(report) == {
        "camera_to_avatar", "sensor", "cameras", "mirrors", "views", "seams", "mesh", "optics", "timings_ms",
        "warnings",
    }  # fmt: skip
    assert report["cameras"] == [{"sensor": "kinect_v1", "measures": "angles", "by": "steps"}]
    assert report["optics"] is None  # its pattern is lost where light comes two ways
    assert all(m["sag_mm"] == 0.0 and m["glass_thickness_mm"] == 0.0 for m in report["mirrors"])
    assert report["sensor"] == "kinect_v1"  # the capture does not say: its steps do
    assert [m["name"] for m in report["mirrors"]] == ["right", "left"]
    assert all({"point", "normal", "residual_mm", "points_used", "refined"} <= set(m) for m in report["mirrors"])
    assert all(m["source"] == "picked" and m["moved_by"] == [] and m["moved_mm"] == 0.0 for m in report["mirrors"])
    assert [v["name"] for v in report["views"]] == ["direct", "right", "left"]
    near, far = zip(*(v["depth_m"] for v in report["views"]), strict=True)
    assert 2.0 < near[0] < far[0] < 3.2 and min(near[1:]) > far[0] and max(far[1:]) < 5.5
    assert all(v["pixels"] > v["vertices"] * 0.5 > 0 and v["triangles"] > 0 for v in report["views"])
    for v in report["views"]:
        assert v["expected_noise_mm"] == pytest.approx(v["frame_noise_mm"] / v["frames"] ** 0.5, abs=0.001)
        assert 0.5 * v["expected_noise_mm"] < v["noise_mm"] < 2.0 * v["expected_noise_mm"]
    assert all({"between", "length_m", "mean_gap_mm", "max_gap_mm"} <= set(s) for s in report["seams"])
    assert {"direct", "right", "left"} <= {name for s in report["seams"] for name in s["between"]}
    mesh = report["mesh"]
    assert mesh["watertight"] is True and mesh["manifold"] is True and mesh["components"] == 1
    assert (mesh["vertices"], mesh["triangles"]) == (len(made.mesh.vertices), len(made.mesh.triangles))
    assert (
        mesh["seam_triangles"] == (made.mesh.kind == 1).sum() and mesh["fill_triangles"] == (made.mesh.kind == 2).sum()
    )
    assert mesh["height_m"] == pytest.approx(1.7, abs=0.03) and 55 < mesh["volume_l"] < 80
    assert all(t >= 0 and math.isfinite(t) for t in report["timings_ms"].values())


def test_same_input_same_mesh_and_either_frame(simulated, reconstructed):
    capture = simulated("azure_kinect").capture
    before = capture.depth.copy()
    told = []
    again = reconstruct(capture, progress=lambda fraction, message: told.append((fraction, message)), frame="camera")
    first = reconstructed("azure_kinect")
    np.testing.assert_array_equal(capture.depth, before)
    np.testing.assert_array_equal(again.mesh.triangles, first.mesh.triangles)
    np.testing.assert_array_equal(again.mesh.colors, first.mesh.colors)
    np.testing.assert_array_equal(again.camera_to_avatar, first.camera_to_avatar)
    np.testing.assert_array_equal(again.mesh.transformed(again.camera_to_avatar).vertices, first.mesh.vertices)
    assert again.frame == "camera" and again.mesh.vertices[:, 2].min() > 2
    fractions = [fraction for fraction, _ in told]
    assert fractions[0] == 0 and fractions == sorted(set(fractions)) and fractions[-1] <= 1 and len(told) >= 8
    assert all(isinstance(message, str) and message for _, message in told)


def test_stopping_on_the_way(simulated):
    capture = simulated("azure_kinect").capture
    calls = []

    class Stopped(Exception):
        pass

    def stop(fraction, message):
        calls.append(fraction)
        if fraction >= 0.3:
            raise Stopped

    with pytest.raises(Stopped):
        reconstruct(capture, progress=stop)
    assert 0 < len(calls) < 8 and calls[-1] >= 0.3 > calls[-2], "nothing runs on after it is stopped"
    steps = reconstruction_steps(capture)
    next(steps)
    steps.close()


def test_what_cannot_be_reconstructed(simulated):
    capture = simulated("azure_kinect").capture
    with pytest.raises(CaptureError, match="reading"):
        reconstruct(replace(capture, depth=np.zeros_like(capture.depth[:1])))
    with pytest.raises(MirrorError, match="no mirror was found.*mirrors.json"):
        reconstruct(replace(capture, mirrors=(), depth=np.where(capture.depth < 2.7, capture.depth, 0)))
    with pytest.raises(ReconstructionError, match="frame"):
        reconstruct(capture, frame="world")
    picks = capture.mirrors[0]
    with pytest.raises(MirrorError, match="right: no straight frame is seen near"):
        reconstruct(capture, mirrors=(replace(picks, frame_pixels=np.array([(320.0, 60.0)])),))
    wall = np.full_like(capture.depth[:1], 3.0)
    with pytest.raises((ReconstructionError, MirrorError)):
        reconstruct(replace(capture, depth=wall))
    with pytest.raises(ReconstructionError, match="nobody"):
        gone = np.where(simulated("azure_kinect").truth.labels[None] >= 0, 0, capture.depth).astype(np.float32)
        reconstruct(replace(capture, depth=gone))


def test_a_blind_mirror_is_warned_about_and_the_rest_goes_on(person):
    rig = default_rig("azure_kinect", frames=2)
    right, left = rig.mirrors
    simulation = simulate(person, replace(rig, mirrors=(right, replace(left, normal=(0.05, -1.0, 0.0)))))
    made = reconstruct(simulation.capture)
    assert [w for w in made.warnings if "“left” does not show the subject" in w]
    assert made.report["warnings"] == list(made.warnings)
    assert (
        made.report["mesh"]["watertight"] and made.report["mesh"]["manifold"] and made.report["mesh"]["components"] == 1
    )
    assert set(np.unique(made.mesh.view)) <= {-1, 0, 1} and made.report["views"][2]["pixels"] == 0


def test_given_planes_and_no_colours(simulated, person):
    """Without a colour image, and with the mirrors' planes told instead of picked."""
    simulation = simulated("azure_kinect")
    capture = simulation.capture
    bare = Capture(capture.depth[:1], None, capture.intrinsics)
    made = reconstruct(bare, capture.mirrors, Settings())
    assert made.mesh.colors is None and made.report["mesh"]["watertight"]


CAPTURES = Path(__file__).resolve().parents[4] / "shared" / "data" / "simulated"


@pytest.mark.parametrize(
    ("name", "accuracy", "completeness"),
    # no worse than the better of both screened Poissons on the same views, true planes and masks given to it [mm]
    [
        ("azure_man", 2.36, 1.64),
        ("kinect1_man_clothed", 7.58, 5.74),
        ("d455_woman", 11.0, 5.73),
        ("ideal_statue", 3.88, 7.90),
    ],
)
def test_captures_of_scanned_people(name, accuracy, completeness):
    folder = CAPTURES / name
    if not folder.is_dir():
        pytest.skip(f"the simulated capture {name} is not here")
    made = reconstruct(open_capture(folder), frame="camera")
    report = made.report["mesh"]
    assert report["watertight"] and report["manifold"] and report["components"] == 1
    assert report["self_intersections"] < 0.01 * report["triangles"]
    truth = read_mesh(folder / "truth" / "body.ply")
    # in the camera frame and not aligned, which asks for more than the published scores do
    there, back = (1000 * surface_distance(*pair, 15_000).mean for pair in ((made.mesh, truth), (truth, made.mesh)))
    print(f"\n{name}: accuracy {there:.2f} mm, completeness {back:.2f} mm")
    assert there < accuracy and back < completeness
