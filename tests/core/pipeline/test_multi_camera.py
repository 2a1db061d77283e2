"""One mirror, three mirrors, and cameras about the subject instead of mirrors: closed and on the true body."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core import cli
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.camera.pinhole import rays_of_pixels
from mirror_scan.core.capture import Capture
from mirror_scan.core.capture.camera_poses import check_pose, open_posed_captures, read_poses
from mirror_scan.core.errors import CaptureError, ReconstructionError
from mirror_scan.core.io import read_mesh
from mirror_scan.core.mesh.surface_distance import evaluate, surface_distance
from mirror_scan.core.numeric.point_products import transform
from mirror_scan.core.pipeline import reconstruct
from mirror_scan.core.pipeline.lines_of_sight import lines_of_sight_crossing
from mirror_scan.core.pipeline.multi_camera import MAX_VIEWS, reconstruct_registered, reconstruct_views
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate, write_simulation

ANGLES = {"front": 0.0, "right": 120.0, "left": -120.0}


def standing_at(angle, sensor="azure_kinect", frames=4, distance=2.4, seed=0):
    """A rig of one camera and no mirror, looking at the subject from ``angle`` degrees round it."""
    a = np.radians(angle)
    place = (distance * np.sin(a), -distance * np.cos(a), 0.9)
    rig = default_rig(sensor, mirrors=0, frames=frames, seed=seed)
    return replace(rig, camera=place, pan_deg=-angle, room=(-4.0, 4.0, -4.0, 4.0, 2.8))


@pytest.fixture(scope="module")
def around(person):
    """name → Simulation; three makes of camera, so that resolution, focal length and noise differ."""
    sensors = {"front": "azure_kinect", "right": "kinect_v1", "left": "realsense_d455"}
    return {
        name: simulate(person, standing_at(angle, sensors[name], seed=k))
        for k, (name, angle) in enumerate(ANGLES.items())
    }


def judged(made, truth):
    """Its distances to the truth [mm]: closed, one piece, and where the first camera's frame says it is."""
    report = made.report["mesh"]
    assert report["watertight"] and report["manifold"] and report["components"] == 1
    found = made.mesh.transformed(np.linalg.inv(made.camera_to_avatar))
    score = evaluate(found, truth, samples=10_000)
    plain = 1000 * surface_distance(found, truth, 10_000).mean
    print(f"\naccuracy {score['accuracy_mean']:.2f} (max {score['accuracy_max']:.1f}), completeness "
          f"{score['complete_mean']:.2f} (max {score['complete_max']:.1f}), unaligned {plain:.2f}")  # fmt: skip
    return score, plain


def test_three_cameras_without_mirrors(around):
    captures = [replace(s.capture, name=name) for name, s in around.items()]
    # any common frame will do: here the avatar's, turned and moved
    world = np.eye(4)
    world[:3, :3], world[:3, 3] = [[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]], (5, -7, 1)
    poses = [world @ s.truth.camera_to_avatar for s in around.values()]
    made = reconstruct_views(captures, poses)
    score, plain = judged(made, around["front"].truth.body)
    assert score["accuracy_mean"] < 1.5 and score["complete_mean"] < 1.5 and plain < 2.5
    assert max(score["accuracy_max"], score["complete_max"]) < 35
    assert abs(score["volume_error_pct"]) < 3
    assert [view["name"] for view in made.report["views"]] == list(ANGLES) and made.warnings == ()
    assert len(made.report["cameras"]) == 3 and made.report["optics"] is None
    assert {tuple(seam["between"]) for seam in made.report["seams"]} >= {("front", "right"), ("front", "left")}
    assert made.mesh.vertices[:, 2].max() == pytest.approx(1.70, abs=0.012)


def test_a_camera_with_its_mirrors_beside_one_without(person, around):
    first = simulate(person, default_rig("azure_kinect", mirrors=[140.0], frames=4))
    captures = [replace(first.capture, name="mirror"), replace(around["left"].capture, name="left")]
    made = reconstruct_views(captures, [first.truth.camera_to_avatar, around["left"].truth.camera_to_avatar])
    score, _ = judged(made, first.truth.body)
    assert score["accuracy_mean"] < 3.0 and score["complete_mean"] < 3.0
    assert [view["name"] for view in made.report["views"]] == ["mirror: direct", "mirror: right", "left"]
    assert made.report["mirrors"][0]["name"] == "mirror: right"
    assert not [text for text in made.warnings if "one side of the subject is not seen" in text], (
        "the other camera sees it"
    )


@pytest.mark.parametrize(
    ("mirrors", "accuracy", "completeness"), [((150.0,), 6.0, 9.0), ((110.0, -110.0, 150.0), 1.2, 1.2)]
)
def test_one_mirror_and_three(person, mirrors, accuracy, completeness):
    simulation = simulate(person, default_rig("azure_kinect", mirrors=mirrors, frames=4))
    made = reconstruct(simulation.capture)
    score, _ = judged(made, simulation.truth.body)
    assert score["accuracy_mean"] < accuracy and score["complete_mean"] < completeness
    assert len(made.report["views"]) == len(mirrors) + 1


def test_poses_that_cannot_be(around):
    captures = [s.capture for s in around.values()]
    poses = [s.truth.camera_to_avatar for s in around.values()]
    wrong = poses[1].copy()
    wrong[0, 3] += 1.8
    with pytest.raises(ReconstructionError, match="check the poses|nobody"):
        reconstruct_views(captures[:2], [poses[0], wrong])
    with pytest.raises(CaptureError, match="3 capture.* 2 pose"):
        reconstruct_views(captures, poses[:2])
    with pytest.raises(CaptureError, match="0 capture"):
        reconstruct_views([], [])
    flipped = poses[1] @ np.diag((1.0, 1, -1, 1))
    for bad in (flipped, 1000 * poses[1], poses[1][:3], np.full((4, 4), np.nan), poses[1].T):
        with pytest.raises(CaptureError, match="pose"):
            check_pose(bad, "left")
    tilted = poses[2].copy()
    c, s = np.cos(0.08), np.sin(0.08)
    tilted[:3, :3] = [[1, 0, 0], [0, c, -s], [0, s, c]] @ tilted[:3, :3]
    made = reconstruct_views(captures[::2], [poses[0], tilted])
    assert made.report["mesh"]["watertight"] and any("floor" in text and "calibrate" in text for text in made.warnings)


COLUMN = (0.2, 1.2)
"""Radius and height of a column [m]; its middle is the common frame's origin, y is down."""


def camera_at(place, target=(0.0, 0.0, 0.0)):
    """A level camera's pose."""
    away = np.subtract(target, place) / np.linalg.norm(np.subtract(target, place))
    right = np.cross((0.0, 1.0, 0.0), away)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.column_stack((right, np.cross(away, right), away)), place
    return pose


def turned_about_column(degrees, distance=1.7):
    a = np.radians(degrees)
    return camera_at((distance * np.sin(a), 0.0, -distance * np.cos(a)))


def of_column(pose, name, walls=2.4):
    """What a camera sees of the column in a room, four walls that far from its middle, by intersecting rays."""
    intrinsics = Intrinsics(160, 200, 180.0, 180.0, 79.5, 99.5)
    rays = np.append(rays_of_pixels(intrinsics), np.ones((200, 160, 1)), axis=-1)
    ray, eye = rays @ pose[:3, :3].T, pose[:3, 3]
    radius, height = COLUMN
    with np.errstate(all="ignore"):
        hits = [(sign * walls - eye[c]) / ray[..., c] for c in (0, 2) for sign in (-1.0, 1.0)]
        depth = np.min([np.where(z > 0, z, np.inf) for z in hits], axis=0)
        a, b = ray[..., 0] ** 2 + ray[..., 2] ** 2, ray[..., 0] * eye[0] + ray[..., 2] * eye[2]
        near = (-b - np.sqrt(b * b - a * (eye[0] ** 2 + eye[2] ** 2 - radius**2))) / a
        on = (near > 0) & (np.abs(eye[1] + near * ray[..., 1]) < height / 2)
    depth = np.where(on, near, depth) + np.random.default_rng(0).normal(0, 0.001, depth.shape)
    return Capture(depth=depth.astype(np.float32)[None], color=None, intrinsics=intrinsics, name=name)


LINES = {
    "face to face": [turned_about_column(0), turned_about_column(180)],
    "nearly face to face": [turned_about_column(0), turned_about_column(176)],
    "face to face, beside the middle": [camera_at((0.2, 0, -1.7), (0.2, 0, 0)), camera_at((0.2, 0, 1.6), (0.2, 0, 0))],
    "face to face, of different distance": [turned_about_column(0, 1.5), turned_about_column(180, 2.2)],
    "face to face, from above": [camera_at((0, -0.5, -1.7)), camera_at((0, -0.5, 1.7))],
    "side by side": [camera_at((x, 0, -1.7), (x, 0, 0)) for x in (-0.25, 0.25)],
    "above each other": [camera_at((0, y, -1.7), (0, y, 0)) for y in (-0.1, 0.1)],
    "behind each other": [turned_about_column(0, 1.6), turned_about_column(0, 2.2)],
    "three in a row": [camera_at((x, 0, -1.7), (x, 0, 0)) for x in (-0.3, 0.0, 0.3)],
    "two in front, one behind": [*(camera_at((x, 0, -1.7), (x, 0, 0)) for x in (-0.2, 0.2)), turned_about_column(180)],
    "from four sides": [turned_about_column(a) for a in (0, 90, 180, 270)],
}
"""Cameras that look along one line, and across."""


@pytest.mark.parametrize("case", LINES)
def test_cameras_that_look_along_one_line(case):
    poses = LINES[case]
    made = reconstruct_views([of_column(pose, f"camera {k}") for k, pose in enumerate(poses)], poses, frame="camera")
    report = made.report["mesh"]
    assert report["watertight"] and report["components"] == 1
    seen = transform(made.mesh.vertices[made.mesh.view >= 0], poses[0])
    off = np.hypot(seen[:, 0], seen[:, 2]) - COLUMN[0]
    assert np.quantile(np.abs(off), 0.95) < 0.01 and np.abs(seen[:, 1]).max() < COLUMN[1] / 2 + 0.01
    assert len(np.unique(made.mesh.view[made.mesh.view >= 0])) > 1
    assert not [text for text in made.warnings if "poses" in text]


def moved(pose, by=(0.0, 0.0, 0.0), turn=0.0):
    """The pose with an error: turned where it stands, about the vertical [degrees], and moved [m]."""
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    out = pose.copy()
    out[:3, :3] = np.array(((c, 0, s), (0, 1, 0), (-s, 0, c))) @ pose[:3, :3]
    out[:3, 3] += by
    return out


@pytest.mark.parametrize(
    ("angles", "wrong", "by", "turn", "words"),
    [
        ((0, 120, 240), 1, (0.4, 0, 0.1), 0, "^camera 1: "),
        ((0, 120, 240), 0, (0.9, 0, 0), 0, "^camera 0: "),
        ((0, 120, 240), 2, (0, 0, 0), 15, "^camera 2: "),
        ((0, 120, 240), 1, (1.3, 0, 0), 0, "^camera 1: "),
        ((0, 90, 180, 270), 2, (0, 0, 1.1), 0, "^camera 2: "),
        ((0, 90, 180, 270), 3, (0, 0, 0.6), 0, "^camera 3: "),
        ((0, 180), 1, (0.4, 0, 0), 0, "^camera 0 and camera 1"),
        ((0, 90), 1, (0, 0, 0), 40, "camera 0 and camera 1"),
    ],
)
def test_a_pose_that_contradicts_the_captures_is_named(angles, wrong, by, turn, words):
    true = [turned_about_column(angle) for angle in angles]
    captures = [of_column(pose, f"camera {k}") for k, pose in enumerate(true)]
    poses = [moved(pose, by, turn) if k == wrong else pose for k, pose in enumerate(true)]
    with pytest.raises(ReconstructionError, match=words) as caught:
        reconstruct_views(captures, poses)
    assert "check th" in str(caught.value)


def test_poses_the_wrong_way_round():
    true = [moved(turned_about_column(angle), (0.3, 0.2, 0.5)) for angle in (0, 90, 180, 270)]
    captures = [of_column(turned_about_column(angle), f"camera {k}") for k, angle in enumerate((0, 90, 180, 270))]
    assert reconstruct_views(captures, true).report["mesh"]["watertight"]
    with pytest.raises(ReconstructionError, match="wrong way round"):
        reconstruct_views(captures, [np.linalg.inv(pose) for pose in true])


def test_where_lines_of_sight_cross():
    poses = [standing_at(angle).camera_to_avatar for angle in (0.0, 100.0, -130.0)]
    crossing = lines_of_sight_crossing(poses)
    assert np.abs(crossing[:2]).max() < 0.02 and 0.7 < crossing[2] < 0.9
    assert lines_of_sight_crossing(poses[:1]) is None
    beside = poses[0].copy()
    beside[0, 3] += 1
    assert lines_of_sight_crossing([poses[0], beside]) is None


def test_more_views_than_can_be_numbered():
    lens = Intrinsics(4, 3, 4.0, 4.0, 1.5, 1.0)
    captures = [Capture(np.ones((1, 3, 4), np.float32), None, lens, (), "one", "npz")] * (MAX_VIEWS + 1)
    for make in (reconstruct_registered, lambda many: reconstruct_views(many, [np.eye(4)] * len(many))):
        with pytest.raises(CaptureError, match="128 views are more than the 127"):
            make(captures)


def test_a_folder_of_captures_on_the_command_line(around, tmp_path, capsys):
    folder = tmp_path / "scan"
    cameras = []
    for name, simulation in around.items():
        write_simulation(replace(simulation, capture=replace(simulation.capture, depth=simulation.capture.depth[:1])),
                         folder / name)  # fmt: skip
        cameras.append({"capture": name, "camera_to_world": simulation.truth.camera_to_avatar.tolist()})
    (folder / "poses.json").write_text(json.dumps({"cameras": cameras}))
    assert list(read_poses(folder / "poses.json")) == list(ANGLES)
    out = tmp_path / "a.ply"
    assert cli.main(["reconstruct", str(folder), "-o", str(out), "--report", str(tmp_path / "r.json")]) == 0
    assert "watertight" in capsys.readouterr().out
    mesh = read_mesh(out)
    assert mesh.vertices[:, 2].max() == pytest.approx(1.70, abs=0.02)
    # in any order on the line; the first is the front
    captures, poses = open_posed_captures([folder / "left", folder / "front"], folder / "poses.json", 1)
    assert [c.name for c in captures] == ["left", "front"]
    np.testing.assert_allclose(poses[1], around["front"].truth.camera_to_avatar, atol=1e-9)

    for arguments, words in (
        ([folder / "front", folder / "left"], "--poses"),
        ([folder / "front", folder / "gone", "--poses", folder / "poses.json"], "no pose for it"),
        ([folder, "--mirrors", folder / "front" / "mirrors.json"], "one camera"),
        ([folder / "front", "--poses", tmp_path / "none.json"], "cannot be read"),
        ([folder, "--frames", "3:"], "chooses none"),
        ([folder, "--depth-unit", "1e-6"], "depth reading"),
    ):
        assert cli.main(["reconstruct", *map(str, arguments), "-o", str(out)]) == 1
        assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "not JSON"), ("[]", "no list"), ('{"cameras": [{}]}', 'no "capture"'),
        ('{"cameras": [{"capture": "a", "camera_to_world": [[1, 2], [3]]}]}', "4×4"),
        ('{"cameras": [{"capture": "a", "camera_to_world": "x"}]}', "4×4"),
    ],
)  # fmt: skip
def test_broken_pose_files(tmp_path, text, words):
    path = tmp_path / "poses.json"
    path.write_text(text)
    with pytest.raises(CaptureError, match=words) as caught:
        read_poses(path)
    assert "poses.json" in str(caught.value)
