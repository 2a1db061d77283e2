"""Wrong and odd inputs of every kind, through the command line.

Each ends in the right avatar without a warning (sound), in an avatar with one true warning (warned), or in one line
that says what is wrong (refused); never in a traceback, and nothing that was there is lost.
"""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mirror_scan.core import cli
from mirror_scan.core.capture.rgbd_writer import write_folder
from mirror_scan.core.capture.single_files.npz import write_npz
from mirror_scan.core.io.images import openimageio, read_image, write_png
from mirror_scan.core.io.mesh_files import read_mesh

HEIGHT_M = 1.70


@pytest.fixture(scope="module")
def made():
    """Height of the person and rest of the rig -> Simulation, small and quick; each made once."""
    from mirror_scan.core.simulation.mannequin import mannequin
    from mirror_scan.core.simulation.scene import default_rig
    from mirror_scan.core.simulation.simulate import simulate

    known = {}

    def simulation(height=HEIGHT_M, sideways=0.0, frames=1, sensor="ideal"):
        key = (height, sideways, frames, sensor)
        if key not in known:
            rig = default_rig(sensor, frames=frames)
            if sensor == "ideal":
                rig = dataclasses.replace(rig, intrinsics=rig.intrinsics.scaled(320, 288))
            place = np.eye(4)
            place[0, 3] = sideways
            body = mannequin(height, resolution=0.013 * height / 1.7).transformed(place)
            known[key] = simulate(body, rig)
        return known[key]

    return simulation


@dataclasses.dataclass
class Input:
    """What a case works on: a folder of its own with the capture in it, and the options of the command."""

    made: Callable
    path: Path
    options: list[str] = dataclasses.field(default_factory=list)

    def folder(self, **scene) -> Path:
        """The capture as an RGB-D folder."""
        write_folder(self.path / "scan", self.made(**scene).capture)
        return self.path / "scan"

    def lens(self, scan: Path, change: Callable[[dict], object]) -> None:
        """``intrinsic.json`` changed."""
        content = json.loads((scan / "intrinsic.json").read_text())
        change(content)
        (scan / "intrinsic.json").write_text(json.dumps(content))

    def depth(self, scan: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
        """Each depth image changed."""
        for file in sorted((scan / "depth").iterdir()):
            write_png(file, change(read_image(file)))

    def array(self, change: Callable[[np.ndarray], np.ndarray], suffix: str = ".npy", **scene) -> Path:
        """The depth [m] alone, beside its lens and picks."""
        scan = self.folder(**scene)
        shutil.move(scan / "intrinsic.json", self.path / "lens.json")
        shutil.move(scan / "mirrors.json", self.path / "mirrors.json")
        depth = change(np.array(self.made(**scene).capture.depth[0], np.float32))
        shutil.rmtree(scan)
        self.options += ["--intrinsics", str(self.path / "lens.json"), "--mirrors", str(self.path / "mirrors.json")]
        np.save(self.path / f"depth{suffix}", depth)
        return self.path / f"depth{suffix}"

    def picks(self, scan: Path, change: Callable[[list], object]) -> None:
        """``mirrors.json`` changed."""
        content = json.loads((scan / "mirrors.json").read_text())
        change(content["mirrors"])
        (scan / "mirrors.json").write_text(json.dumps(content))


CASES: dict[str, tuple[Callable[[Input], Path], str, str]] = {}


def case(expected: str, words: str = ""):
    """Register a function that makes an input: it shall be ``sound``, ``warned`` or ``refused``, with ``words``."""

    def register(make):
        CASES[make.__name__] = (make, expected, words)
        return make

    return register


# Units


@case("sound")
def metres_as_real_numbers(case):
    return case.array(lambda depth: depth)


@case("sound")
def millimetres_as_real_numbers(case):
    return case.array(lambda depth: np.round(1000 * depth).astype(np.float32))


@case("sound")
def background_of_half_floats(case):
    return case.array(lambda depth: np.where(depth > 0, depth, 65504).astype(np.float32))


@case("sound")
def background_of_infinity_and_nan(case):
    def change(depth):
        depth = np.where(depth > 0, depth, np.inf)
        depth[:, :4] = np.nan
        depth[:, 4:6] = -1
        return depth

    return case.array(change)


@case("sound")
def tenths_of_millimetres_that_the_file_states(case):
    scan = case.folder()
    case.depth(scan, lambda image: np.minimum(image.astype(int) * 10, 65535).astype(np.uint16))
    case.lens(scan, lambda lens: lens.update(depth_scale=10000))
    return scan


@case("sound")
def millimetres_above_bits_of_a_player(case):
    return case.array(lambda depth: (np.round(1000 * depth).astype(np.uint16) << 3) | (depth > 0))


@case("refused", "16-bit millimetres")
def tenths_of_millimetres_that_nobody_states(case):
    scan = case.folder()
    case.depth(scan, lambda image: (image.astype(int) * 10).clip(0, 65535).astype(np.uint16))
    return scan


@case("refused", "depth-unit|unit")
def a_wrong_unit_by_option(case):
    case.options += ["--depth-unit", "0.0001"]
    return case.array(lambda depth: np.round(1000 * depth).astype(np.uint16))


# Lens


def _matrix(lens, factors):
    lens["intrinsic_matrix"] = [value * factor for value, factor in zip(lens["intrinsic_matrix"], factors, strict=True)]


@case("refused", "twice the size|double|half")
def a_lens_of_double_size(case):
    scan = case.folder()
    case.lens(scan, lambda lens: _matrix(lens, [2, 1, 1, 1, 2, 1, 2, 2, 1]))
    return scan


@case("refused", "principal point|image centre")
def a_lens_of_half_size(case):
    scan = case.folder()
    case.lens(scan, lambda lens: _matrix(lens, [0.5, 1, 1, 1, 0.5, 1, 0.5, 0.5, 1]))
    return scan


@case("refused", "focal")
def a_focal_length_below_zero(case):
    scan = case.folder()
    case.lens(scan, lambda lens: _matrix(lens, [-1, 1, 1, 1, 1, 1, 1, 1, 1]))
    return scan


@case("sound")
def a_matrix_as_rows(case):
    scan = case.folder()

    def change(lens):
        matrix = np.reshape(lens["intrinsic_matrix"], (3, 3)).T
        lens["intrinsic_matrix"] = matrix.tolist()

    case.lens(scan, change)
    return scan


@case("sound")
def a_lens_without_distortion_that_says_so(case):
    scan = case.folder()
    case.lens(scan, lambda lens: lens.update(distortion=[0, 0, 0, 0, 0]))
    return scan


@case("warned", "distortion is taken from “distortion_coefficients”")
def distortion_under_another_name(case):
    scan = case.folder()
    case.lens(scan, lambda lens: lens.update(distortion_coefficients=[1e-4, 0, 0, 0, 0]))
    return scan


@case("warned", "barrel_distortion")
def a_lens_key_that_nobody_knows(case):
    scan = case.folder()
    case.lens(scan, lambda lens: lens.update(barrel_distortion=[0.15, -0.05]))
    return scan


@case("sound")
def a_lens_that_begins_with_a_byte_order_mark(case):
    scan = case.folder()
    text = (scan / "intrinsic.json").read_bytes()
    (scan / "intrinsic.json").write_bytes(b"\xef\xbb\xbf" + text)
    return scan


@case("refused", "intrinsic.json")
def a_lens_of_another_picture(case):
    scan = case.folder()
    case.lens(scan, lambda lens: lens.update(width=640, height=576))
    return scan


# Colour


@case("sound")
def no_colour(case):
    scan = case.folder()
    shutil.rmtree(scan / "color")
    return scan


@case("sound")
def colour_in_grey(case):
    scan = case.folder()
    for file in list((scan / "color").iterdir()):
        grey = read_image(file)[..., 0]
        file.unlink()
        write_png(file.with_suffix(".png"), grey)
    return scan


@case("sound")
def colour_with_transparency(case):
    scan = case.folder()
    for file in list((scan / "color").iterdir()):
        color = read_image(file)
        file.unlink()
        oiio = openimageio()
        writer = oiio.ImageOutput.create(str(file.with_suffix(".png")))
        writer.open(str(file.with_suffix(".png")), oiio.ImageSpec(*color.shape[1::-1], 4, oiio.UINT8))
        writer.write_image(np.dstack((color, np.full(color.shape[:2], 255, np.uint8))))
        writer.close()
    return scan


@case("warned", "colou?r")
def colour_of_other_frames_only(case):
    scan = case.folder(frames=4, sensor="azure_kinect")
    (only,) = (scan / "color").iterdir()
    for number in ("000007", "000009"):
        shutil.copy(only, only.with_stem(number))
    only.unlink()
    return scan


@case("refused", "000000")
def a_colour_image_cut_short(case):
    scan = case.folder()
    for file in (scan / "color").iterdir():
        file.write_bytes(file.read_bytes()[:200])
    return scan


# Mirrors


@case("refused", "one line")
def picks_on_one_line(case):
    scan = case.folder()

    def change(mirrors):
        first = mirrors[0]["frame_pixels"][0]
        mirrors[0]["frame_pixels"] = [[first[0], first[1] + 0.3 * k] for k in range(3)]

    case.picks(scan, change)
    return scan


@case("refused", "outside|not within")
def picks_outside_the_picture(case):
    scan = case.folder()
    case.picks(scan, lambda mirrors: mirrors[0].update(frame_pixels=[[-50, 5], [900, 40], [20, 800]]))
    return scan


@case("sound")
def mirrors_in_the_other_order(case):
    scan = case.folder()
    case.picks(scan, lambda mirrors: mirrors.reverse())
    return scan


@case("sound")
def nobody_has_picked(case):
    scan = case.folder()
    (scan / "mirrors.json").unlink()
    return scan


@case("refused", "three|at least 3")
def two_picks(case):
    scan = case.folder()
    case.picks(scan, lambda mirrors: mirrors[0].update(frame_pixels=mirrors[0]["frame_pixels"][:2]))
    return scan


def _plane(case, turn_deg, offset):
    """Both true planes, the first turned or moved."""
    scan = case.folder()
    planes = []
    for mirror in case.made().truth.mirrors:
        planes.append({"name": mirror.name, "plane": {"point": list(mirror.point), "normal": list(mirror.normal)}})
    angle = np.radians(turn_deg)
    x, y, z = planes[0]["plane"]["normal"]
    turned = np.array([np.cos(angle) * x + np.sin(angle) * z, y, np.cos(angle) * z - np.sin(angle) * x])
    planes[0]["plane"]["normal"] = turned.tolist()
    planes[0]["plane"]["point"] = (np.array(planes[0]["plane"]["point"]) + offset * turned).tolist()
    case.picks(scan, lambda mirrors: mirrors.__setitem__(slice(None), planes))
    return scan


@case("sound")
def true_planes_instead_of_picks(case):
    return _plane(case, 0, 0)


@case("warned", "mirror|plane")
def a_plane_turned_by_two_degrees(case):
    return _plane(case, 2, 0)


@case("warned", "mirror|plane")
def a_plane_moved_by_two_centimetres(case):
    return _plane(case, 0, 0.02)


# Person


@case("sound")
def a_child(case):
    return case.folder(height=1.0)


@case("sound")
def somebody_tall(case):
    return case.folder(height=1.76)


@case("refused", "--object")
def a_doll(case):
    return case.folder(height=0.42)


@case("refused", "nobody|no person|subject")
def an_empty_room(case):
    return case.folder(sideways=-30.0)


@case("warned", "picture|image|cut")
def feet_below_the_picture(case):
    scan = case.folder()

    def change(image):
        image = image.copy()
        return image[:215]

    case.depth(scan, change)
    for file in (scan / "color").iterdir():
        color = read_image(file)[:215]
        file.unlink()
        write_png(file.with_suffix(".png"), color)
    case.lens(scan, lambda lens: lens.update(height=215))
    (scan / "mirrors.json").unlink()
    return scan


# Files and bursts


@case("refused", "000000.png")
def a_depth_image_cut_short(case):
    scan = case.folder()
    file = scan / "depth" / "000000.png"
    file.write_bytes(file.read_bytes()[:300])
    return scan


@case("refused", "no depth|empty|holds no")
def a_folder_without_depth_images(case):
    scan = case.folder()
    for file in (scan / "depth").iterdir():
        file.unlink()
    return scan


@case("refused", "reading")
def depth_without_any_reading(case):
    scan = case.folder()
    case.depth(scan, np.zeros_like)
    return scan


@case("refused", "intrinsic.json")
def a_lens_that_is_no_json(case):
    scan = case.folder()
    (scan / "intrinsic.json").write_text("{'width': 320,")
    return scan


@case("sound")
def names_beyond_ascii(case):
    return case.folder().rename(case.path / "Größe 身体 scan")


@case("sound")
def notes_and_thumbnails_beside_the_images(case):
    scan = case.folder()
    (scan / "depth" / "Thumbs.db").write_bytes(b"\0" * 64)
    (scan / ".DS_Store").write_bytes(b"\0" * 64)
    (scan / "notes.txt").write_text("Anna, second try")
    return scan


@case("sound")
def a_burst(case):
    return case.folder(frames=4, sensor="azure_kinect")


@case("sound")
def an_empty_frame_in_a_burst(case):
    scan = case.folder(frames=4, sensor="azure_kinect")
    file = scan / "depth" / "000002.png"
    write_png(file, np.zeros_like(read_image(file)))
    return scan


@case("refused", "000002.png")
def a_frame_of_another_size_in_a_burst(case):
    scan = case.folder(frames=4, sensor="azure_kinect")
    file = scan / "depth" / "000002.png"
    write_png(file, read_image(file)[::2, ::2])
    return scan


@case("warned", "moved")
def a_burst_in_which_the_person_moves(case):
    scan = case.folder(frames=6, sensor="azure_kinect")
    frames = sorted((scan / "depth").iterdir())
    for k, file in enumerate(frames):
        moved = case.made(sideways=0.02 * k, sensor="azure_kinect").capture.depth[0]
        write_png(file, np.round(1000 * np.nan_to_num(moved)).astype(np.uint16))
    return scan


@case("refused", "not a capture|not recognised|no capture|unknown")
def a_text_file(case):
    (case.path / "scan.txt").write_text("a shopping list\n")
    return case.path / "scan.txt"


@case("sound")
def a_capture_of_ours(case):
    write_npz(case.path / "scan.npz", case.made().capture)
    return case.path / "scan.npz"


def test_the_table_is_as_broad_as_it_says():
    kinds = [expected for _, expected, _ in CASES.values()]
    assert len(kinds) >= 45 and 3 * kinds.count("sound") >= len(kinds)


@pytest.mark.parametrize("name", CASES)
def test_odd_input(made, tmp_path, capsys, name):
    make, expected, words = CASES[name]
    case = Input(made, tmp_path / "input")
    case.path.mkdir()
    path = make(case)
    before = {p: p.read_bytes() for p in case.path.rglob("*") if p.is_file()}
    output = tmp_path / "avatar.ply"
    output.write_bytes(b"an older avatar")
    ended = cli.main(["reconstruct", str(path), *case.options, "-o", str(output)])
    _, err = capsys.readouterr()
    warnings = [line for line in err.splitlines() if line.startswith("warning: ")]
    told = [line for line in err.splitlines() if line.startswith(("warning: ", "note: "))]
    assert {p: p.read_bytes() for p in case.path.rglob("*") if p.is_file()} == before
    assert "Traceback" not in err
    if expected == "refused":
        assert ended == 1 and output.read_bytes() == b"an older avatar"
        errors = [line for line in err.splitlines() if line.startswith("error: ")]
        assert len(errors) == 1 and re.search(words, errors[0]), err
        return
    assert ended == 0, err
    mesh = read_mesh(output)
    assert len(mesh.triangles) > 5000
    if expected == "sound":
        assert warnings == []
        height = {"a_child": 1.0, "somebody_tall": 1.76}.get(name, HEIGHT_M)
        assert np.ptp(mesh.vertices[:, 2]) == pytest.approx(height, rel=0.02)
    else:
        assert any(re.search(words, line) for line in told), err
