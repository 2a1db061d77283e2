"""The command line: exit codes, one line on stderr, nothing written when something is wrong."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil

import numpy as np
import pytest
from command_line import HEIGHT, PICKS, TETRAHEDRON, WIDTH, intrinsic, listing, refused, remove, write_json
from mirror_scan.core import cli
from mirror_scan.core.capture import ReadOptions, open_capture
from mirror_scan.core.capture.rgbd_writer import write_folder
from mirror_scan.core.capture.single_files.npz import write_npz
from mirror_scan.core.io import read_mesh, write_mesh
from mirror_scan.core.io.images import read_image, write_png
from mirror_scan.core.mesh import Mesh


def picks(folder, pixels):
    write_json(folder / "mirrors.json", {"mirrors": [{"name": "right", "frame_pixels": pixels}]})


def truncate(folder):
    path = folder / "depth" / "000000.png"
    path.write_bytes(path.read_bytes()[:-20])


def depth(folder, image):
    write_png(folder / "depth" / "000000.png", image)


BAD_CAPTURES = {
    "intrinsics missing": (lambda f: remove(f, "intrinsic.json"), r"intrinsic\.json: is missing"),
    "intrinsics zero": (lambda f: write_json(f / "intrinsic.json", intrinsic(fx=0)), "focal lengths must be positive"),
    "depth missing": (lambda f: remove(f, "depth/000000.png"), "holds no PNG"),
    "truncated": (truncate, "truncated"),
    "8 bit": (lambda f: depth(f, np.full((HEIGHT, WIDTH), 90, np.uint8)), "16-bit"),
    "sizes disagree": (lambda f: depth(f, np.full((24, 32), 2000, np.uint16)), "32×24"),
    "no depth anywhere": (lambda f: depth(f, np.zeros((HEIGHT, WIDTH), np.uint16)), "no pixel"),
    "mirrors malformed": (lambda f: (f / "mirrors.json").write_text('{"mirrors": ['), "not valid JSON"),
    "two picks": (lambda f: picks(f, PICKS[:2]), "at least 3"),
    "picks outside": (lambda f: picks(f, [*PICKS, [64, 3]]), "outside the 64×48 image"),
}


@pytest.mark.parametrize("case", BAD_CAPTURES)
def test_a_bad_capture_is_refused_and_nothing_written(folder, capsys, case):
    damage, words = BAD_CAPTURES[case]
    damage(folder)
    (folder.parent / "a.ply").write_text("old")
    before = listing(folder.parent)
    arguments = ["reconstruct", folder, "-o", folder.parent / "a.ply", "--report", folder.parent / "r.json"]
    refused(capsys, arguments, words)
    assert listing(folder.parent) == before


def test_a_missing_capture_is_refused_by_every_command(tmp_path, capsys):
    nowhere = tmp_path / "nowhere"
    for arguments in (
        ["reconstruct", nowhere, "-o", tmp_path / "a.ply"],
        ["inspect", nowhere, "-o", tmp_path / "a.png"],
        ["evaluate", nowhere / "a.ply", nowhere / "b.ply"],
    ):
        refused(capsys, arguments, "no such file|No such file")
    assert listing(tmp_path) == []


def test_reconstruct_writes_all_outputs_and_the_report(folder, capsys, pipeline):
    for i in (1, 2):
        write_png(folder / "depth" / f"{i}.png", np.full((HEIGHT, WIDTH), 2000, np.uint16))
    here = folder.parent
    arguments = ["reconstruct", folder, *(x for s in ("ply", "obj", "stl") for x in ("-o", here / f"a.{s}"))]
    assert cli.main([*map(str, arguments), "--report", str(here / "r.json")]) == 0
    out, err = capsys.readouterr()
    assert "1.00 m tall" in out and "watertight" in out
    assert err == "warning: the left mirror shows nobody\n"
    for suffix in ("ply", "obj", "stl"):
        assert len(read_mesh(here / f"a.{suffix}").triangles) == 4
    report = json.loads((here / "r.json").read_text())
    assert report["frames"] == 3
    assert report["quality"] is None
    assert set(report["timings_ms"]) == {"read", "total", "write"}

    assert cli.main([*map(str, arguments), "--report", str(here / "r.json"), "--single-frame", "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    assert json.loads((here / "r.json").read_text())["frames"] == 1


def test_an_error_of_the_pipeline_is_one_line(folder, capsys, pipeline):
    arguments = ["reconstruct", folder, "--mirrors", folder / "mirrors.json", "-o", folder.parent / "a.ply"]
    refused(capsys, arguments, "nobody stands between camera and mirrors")
    assert not (folder.parent / "a.ply").exists()


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    """A virtual person before two mirrors, and the same room with the person gone behind the camera."""
    from mirror_scan.core.simulation.mannequin import mannequin
    from mirror_scan.core.simulation.scene import default_rig
    from mirror_scan.core.simulation.simulate import simulate, write_simulation

    rig = default_rig("ideal", frames=1)
    rig = dataclasses.replace(rig, intrinsics=rig.intrinsics.scaled(320, 240))
    body, away = mannequin(resolution=0.015), np.eye(4)
    away[1, 3] = -30
    folder = tmp_path_factory.mktemp("scans")
    write_simulation(simulate(body, rig), folder / "person")
    write_simulation(simulate(body.transformed(away), rig), folder / "nobody")
    return folder


def first_picks(scan, change):
    """The scan's mirrors.json with the first mirror's picks changed."""
    content = json.loads((scan / "mirrors.json").read_text())
    picked = np.array(content["mirrors"][0]["frame_pixels"])
    content["mirrors"][0]["frame_pixels"] = change(picked).tolist()
    return content


def test_collinear_picks(scans, tmp_path, capsys):
    write_json(tmp_path / "m.json", first_picks(scans / "person", lambda p: p[0] + [[0, 0], [0.2, 0.1], [0.4, 0.2]]))
    arguments = ["reconstruct", scans / "person", "--mirrors", tmp_path / "m.json", "-o", tmp_path / "a.ply"]
    refused(capsys, arguments, "one line")
    assert [p.name for p in tmp_path.iterdir()] == ["m.json"]


def test_picks_on_no_reading(scans, tmp_path, capsys):
    scan = shutil.copytree(scans / "person", tmp_path / "scan")
    frame = read_image(scan / "depth" / "000000.png")
    for u, v in json.loads((scan / "mirrors.json").read_text())["mirrors"][0]["frame_pixels"]:
        frame[max(int(v) - 14, 0) : int(v) + 15, max(int(u) - 14, 0) : int(u) + 15] = 0
    write_png(scan / "depth" / "000000.png", frame)
    refused(capsys, ["reconstruct", scan, "-o", tmp_path / "a.ply"], "picks are on a depth reading")
    assert [p.name for p in tmp_path.iterdir()] == ["scan"]


def test_nobody_between_camera_and_mirrors(scans, tmp_path, capsys):
    refused(capsys, ["reconstruct", scans / "nobody", "-o", tmp_path / "a.ply"], "nobody stands between")
    assert list(tmp_path.iterdir()) == []


def test_a_mirror_that_shows_nobody_is_a_warning(scans, tmp_path, capsys):
    scan = shutil.copytree(scans / "person", tmp_path / "scan")
    frame = read_image(scan / "depth" / "000000.png")
    frame[read_image(scan / "truth" / "labels.png") == 2] = 0
    write_png(scan / "depth" / "000000.png", frame)
    outputs = ["-o", str(tmp_path / "a.ply"), "--report", str(tmp_path / "r.json")]
    assert cli.main(["reconstruct", str(scan), *outputs]) == 0
    unread = r"^warning: (9\d% of the reflection in the mirror “right” has no reading.*)$"
    told = re.search(unread, capsys.readouterr().err, re.MULTILINE)
    report = json.loads((tmp_path / "r.json").read_text())
    assert told and told[1] in report["warnings"] and report["views"][1]["pixels"] == 0
    assert len(read_mesh(tmp_path / "a.ply").triangles) > 10_000


def test_avatar_and_camera_frame_differ_by_the_reported_motion(scans, tmp_path):
    for frame in ("avatar", "camera"):
        outputs = ["-o", str(tmp_path / f"{frame}.ply"), "--report", str(tmp_path / f"{frame}.json")]
        assert cli.main(["reconstruct", str(scans / "person"), *outputs, "--frame", frame]) == 0
    motion = np.array(json.loads((tmp_path / "camera.json").read_text())["camera_to_avatar"])
    avatar, camera = (read_mesh(tmp_path / f"{frame}.ply") for frame in ("avatar", "camera"))
    np.testing.assert_allclose(camera.transformed(motion).vertices, avatar.vertices, atol=2e-6)
    assert abs(avatar.vertices[:, 2].min()) < 0.02
    assert avatar.colors is not None and avatar.view is not None and set(np.unique(avatar.kind)) <= {0, 1, 2}


def test_inspect_says_what_the_file_holds(folder, capsys):
    frame = np.zeros((HEIGHT, WIDTH), np.uint16)
    frame[:24] = 1500
    frame[24:36] = 3000
    depth(folder, frame)
    assert cli.main(["inspect", str(folder), "-o", str(folder.parent / "p.png")]) == 0
    out = capsys.readouterr().out
    for words in (
        "RGB-D folder", "64×48, 1 frame, 1.50 to 3.00 m", "75% of the pixels", "right: 3 points", "66.7% ####",
    ):  # fmt: skip
        assert words in out
    picture = read_image(folder.parent / "p.png")
    assert picture.shape == (HEIGHT, 2 * WIDTH, 3), "the cleaned depth is on the right"
    assert (picture[40, :WIDTH] == 0).sum() > 100
    assert picture[5, 5].tolist() == [255, 40, 40]
    refused(capsys, ["inspect", folder, "-o", folder.parent / "p.jpg"], r"ends in \.png")


def test_inspect_tells_mixed_up_units(folder, capsys):
    """A wall 2 m away, read as if its millimetres were metres, and as if they were 5000 to a metre."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    floor = np.where(rows > 30, 60 * 1.1 / np.maximum(rows - 23.5, 1), 4.0).clip(0, 4)  # the camera 1.1 m above it
    depth(folder, np.rint(1000 * floor).astype(np.uint16))
    for unit, words in (("1", "multiply .* by 0.001"), ("0.005", "multiply .* by 0.2"), ("0.001", "")):
        assert cli.main(["inspect", str(folder), "--depth-unit", unit]) == 0
        out, err = capsys.readouterr()
        told = [line for line in err.splitlines() if "depth-unit" in line]
        assert len(told) == bool(words) and re.search(words, "".join(told)), (unit, err)
    assert re.search(r"the camera is 1\.1\d m above", out)


def test_inspect_shows_what_cleaning_does(simulated, tmp_path, capsys):
    folder = tmp_path / "scan"
    write_folder(folder, simulated("kinect_v1").capture)
    assert cli.main(["inspect", str(folder)]) == 0
    out, err = capsys.readouterr()
    assert re.search(r"Kinect v1 .*known by its steps", out) and "noise averages them out" in out and not err, err
    before, fused = map(float, re.search(r"8 frames fused: noise ([\d.]+) to ([\d.]+) mm", out).groups())
    assert 2 < before / fused < 4  # √8
    assert re.search(r"subject  1\.[67]\d m tall", out) and "did not move" in out
    without = ["--without", "flying", "--without", "smoothing", "--sensor", "unknown"]
    assert cli.main(["inspect", str(folder), *without]) == 0
    out = capsys.readouterr().out
    assert "flying pixels dropped: 0 " in out and "moved by 0.00 mm" in out and "sensor   unknown" in out
    refused(capsys, ["inspect", folder, "--sensor", "kinect_v3"], "kinect_v3")


def test_convert_writes_what_it_read(simulated, tmp_path, capsys):
    made = simulated("azure_kinect").capture
    write_npz(tmp_path / "scan.npz", made)
    assert cli.main(["convert", str(tmp_path / "scan.npz"), str(tmp_path / "folder"), "--frames", "1:3"]) == 0
    assert "2 frames" in capsys.readouterr().out
    back = open_capture(tmp_path / "folder")
    assert back.format == "RGB-D folder" and back.intrinsics == made.intrinsics
    np.testing.assert_allclose(back.depth, made.depth[1:3], atol=0.5001e-3)
    np.testing.assert_array_equal(back.color, made.color)
    assert [m.name for m in back.mirrors] == [m.name for m in made.mirrors]
    np.testing.assert_array_equal(back.mirrors[0].frame_pixels, made.mirrors[0].frame_pixels)
    before = listing(tmp_path)
    refused(capsys, ["convert", tmp_path / "scan.npz", tmp_path / "folder"], "exists already")
    refused(capsys, ["convert", tmp_path / "scan.npz", tmp_path / "new", "--frames", "9"], "chooses none")
    assert listing(tmp_path) == before


def test_simulate_replaces_a_simulation_but_never_a_recording(folder, capsys):
    before = listing(folder)
    refused(capsys, ["simulate", folder], "not an earlier simulation")
    assert listing(folder) == before

    body, target = folder.parent / "body.ply", folder.parent / "virtual"
    write_mesh(body, Mesh(TETRAHEDRON.vertices + (5, 5, 5), TETRAHEDRON.triangles))
    arguments = ["simulate", str(target), "--sensor", "ideal", "--body", str(body), "--mirrors", "1", "--quiet"]
    assert cli.main([*arguments, "--frames", "3"]) == 0
    assert cli.main([*arguments, "--frames", "2"]) == 0
    capture = open_capture(target)
    assert len(capture.depth) == 2 and len(capture.mirrors) == 1
    assert cli.main([*arguments, "--frames", "2", "--color-scale", "3"]) == 0
    larger = open_capture(target, options=ReadOptions(native_color=True))
    assert larger.native_color.shape == (1440, 1920, 3) and larger.color.shape == capture.color.shape
    np.testing.assert_array_equal(larger.depth, capture.depth)
    assert cli.main([*arguments, "--frames", "2"]) == 0
    assert open_capture(target).color.tobytes() == capture.color.tobytes()
    assert np.isfinite(read_mesh(target / "truth" / "body.ply").vertices).all()
    assert sorted(p.name for p in folder.parent.iterdir()) == ["body.ply", "scan", "virtual"]

    write_mesh(body, Mesh(TETRAHEDRON.vertices * 1000, TETRAHEDRON.triangles))
    refused(capsys, arguments, "in metres")
    (target / "notes.txt").write_text("mine")
    refused(capsys, arguments, "not an earlier simulation")


def test_what_has_no_surface_is_neither_measured_nor_scanned(tmp_path, capsys):
    write_mesh(tmp_path / "a.ply", TETRAHEDRON)
    write_mesh(tmp_path / "points.ply", Mesh(TETRAHEDRON.vertices, np.empty((0, 3), np.int32)))
    before = listing(tmp_path)
    refused(capsys, ["evaluate", tmp_path / "a.ply", tmp_path / "points.ply"], "no faces")
    refused(capsys, ["simulate", tmp_path / "virtual", "--body", tmp_path / "points.ply"], "points.ply.*no faces")
    assert listing(tmp_path) == before
    refused(capsys, ["experiment", "distance", tmp_path / "points.ply", "-o", tmp_path / "x"], "no faces")


@pytest.mark.parametrize("case", ["units", "nobody", "sound"])
def test_convert_warns_of_what_inspect_warns_of(simulated, tmp_path, capsys, case):
    made = simulated("azure_kinect").capture
    if case == "units":
        made = dataclasses.replace(made, depth=made.depth / 20)
    elif case == "nobody":
        made = dataclasses.replace(made, depth=np.full_like(made.depth, 3.0))
    write_npz(tmp_path / "scan.npz", made)

    def warnings(*arguments):
        assert cli.main([*arguments, "--frames", "0"]) == 0
        return [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning")]

    found = warnings("inspect", str(tmp_path / "scan.npz"))
    assert bool(found) == (case != "sound")
    assert warnings("convert", str(tmp_path / "scan.npz"), str(tmp_path / "folder")) == found


def test_convert_says_what_a_folder_cannot_hold(tmp_path, capsys):
    lens = {"width": 64, "height": 48, "intrinsic_matrix": [60, 0, 0, 0, 60, 0, 31.5, 23.5, 1]}
    write_json(tmp_path / "intrinsic.json", lens)
    depth = np.full((48, 64), 2.0, np.float32)
    depth[:10] = np.linspace(70, 90, 640).reshape(10, 64)
    np.save(tmp_path / "depth.npy", depth)
    assert cli.main(["convert", str(tmp_path / "depth.npy"), str(tmp_path / "folder")]) == 0
    assert "20.8% of the readings lie beyond 65.535 m" in capsys.readouterr().err
    before = listing(tmp_path)
    refused(capsys, ["convert", tmp_path / "depth.npy", tmp_path / "b", "--depth-unit", "100"], "check the depth unit")
    assert listing(tmp_path) == before


@pytest.mark.parametrize(("given", "words"), [("kinect_v1", "the file says so"), (None, "by the size of the image")])
def test_the_file_says_so_only_of_what_the_file_says(tmp_path, capsys, given, words):
    rng = np.random.default_rng(0)
    np.save(tmp_path / "depth.npy", rng.integers(1500, 2500, (480, 640)).astype(np.uint16))
    if given:
        matrix = [525, 0, 0, 0, 525, 0, 319.5, 239.5, 1]
        lens = {"width": 640, "height": 480, "intrinsic_matrix": matrix, "sensor": "Kinect v1"}
        write_json(tmp_path / "intrinsic.json", lens)
    assert cli.main(["convert", str(tmp_path / "depth.npy"), str(tmp_path / "folder"), "--quiet"]) == 0
    write_npz(tmp_path / "scan.npz", open_capture(tmp_path / "depth.npy"))
    capsys.readouterr()
    for path in ("depth.npy", "folder", "scan.npz"):
        assert cli.main(["inspect", str(tmp_path / path)]) == 0
        line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("  sensor"))
        assert "Kinect v1" in line and words in line
