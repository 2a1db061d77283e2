"""``intrinsic.json``: other programs' spellings, keys without effect, intrinsics of another picture."""

from __future__ import annotations

import json

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.camera.pinhole import brown_of_inverse
from mirror_scan.core.capture import ReadOptions, open_capture
from mirror_scan.core.capture.folders.lens_file import check_principal_point, lens_options, read_lens_file
from mirror_scan.core.errors import CaptureError
from writers import assert_one_line_naming, write_folder

BROWN = [0.15, -0.05, 0.001, 0.002, 0.01]


def lens(**keys):
    matrix = [60, 0, 0, 0, 60, 0, 31.5, 23.5, 1]
    return {"width": 64, "height": 48, "intrinsic_matrix": matrix} | keys


def written(tmp_path, content):
    path = tmp_path / "intrinsic.json"
    path.write_text(json.dumps(content))
    return path


UNDERSTOOD = {
    "distortion_coefficients": BROWN, "dist_coeffs": BROWN, "distCoeffs": [BROWN], "coeffs": BROWN[:4], "D": BROWN,
    "Distortion": BROWN, "lens_distortion": [[k] for k in BROWN], "dist": BROWN + [0.0] * 9,
    "distortion_parameters": {"rows": 1, "cols": 5, "data": BROWN},
}  # fmt: skip


@pytest.mark.parametrize("key", UNDERSTOOD)
def test_other_names_of_the_distortion(tmp_path, key):
    found = read_lens_file(written(tmp_path, lens(**{key: UNDERSTOOD[key]}, distortion_model="plumb_bob")))
    wanted = BROWN[:4] if key == "coeffs" else BROWN
    assert found.intrinsics.distortion[: len(wanted)] == tuple(wanted) and not any(found.intrinsics.distortion[5:])
    assert len(found.notes) == 1 and f"“{key}”" in found.notes[0]


def test_coefficients_one_by_one_and_inverse_models(tmp_path):
    found = read_lens_file(written(tmp_path, lens(k1=0.1, k2=-0.2, p2=0.001)))
    assert found.intrinsics.distortion == (0.1, -0.2, 0, 0.001, 0, 0, 0, 0) and "k1, k2, p2" in found.notes[0]
    found = read_lens_file(written(tmp_path, lens(coeffs=BROWN, model="distortion.inverse_brown_conrady")))
    assert found.intrinsics.distortion == brown_of_inverse(tuple(BROWN), Intrinsics(64, 48, 60, 60, 31.5, 23.5))
    with pytest.raises(CaptureError, match="fisheye lens.*rectify"):
        read_lens_file(written(tmp_path, lens(distortion=BROWN[:4], distortion_model="equidistant")))


@pytest.mark.parametrize(
    ("key", "value", "unit"),
    [("depth_units", 0.0001, 1e-4), ("depthScale", 5000, 2e-4), ("depth_unit", "cm", 0.01),
     ("DepthMapFactor", 5000, 2e-4), ("png_depth_scale", 6553.5, 1 / 6553.5), ("depth_factor", 0.00025, 2.5e-4),
     ("depth_units", "Metres", 1.0)],
)  # fmt: skip
def test_other_names_of_the_unit(tmp_path, key, value, unit):
    found = read_lens_file(written(tmp_path, lens(**{key: value})))
    assert found.unit_m == pytest.approx(unit) and f"“{key}”" in found.notes[0]
    options = lens_options(tmp_path / "intrinsic.json")
    assert ReadOptions(**options).lens_unit_m == found.unit_m


NO_EFFECT = {
    "scale": 0.0001, "units": "cm", "depth_units": "0.1 mm", "coeffs": [0.1] * 3, "dist_coeffs": [0.1] * 14,
    "depth": {"coeffs": BROWN}, "lens": {"k1": 0.2}, "camera": {"depth": {"depth_scale": 0.0001}}, "depth_unit": 1,
    "distortion_center_coeff": 0.3, "depth_divisor": 5000, "depth_to_meters": 0.0001, "radial_distortion": [0.1, 0.2],
}  # fmt: skip


@pytest.mark.parametrize("key", NO_EFFECT)
def test_what_looks_like_a_lens_or_a_unit_and_was_not_used_is_said(tmp_path, key):
    found = read_lens_file(written(tmp_path, lens(**{key: NO_EFFECT[key]})))
    assert found.unit_m is None and found.intrinsics.is_pinhole
    assert len(found.notes) == 1 and f"“{key}" in found.notes[0] and "was not used" in found.notes[0]


def test_a_second_spelling_that_disagrees_is_said(tmp_path):
    content = lens(distortion=BROWN, coeffs=[0.3, 0, 0, 0], depth_scale=1000, depth_units=0.0001)
    found = read_lens_file(written(tmp_path, content))
    assert found.intrinsics.distortion == tuple(BROWN) and found.unit_m == 0.001
    assert ["coeffs" in note or "depth_units" in note for note in found.notes] == [True, True]


QUIET = {
    "sensor": "kinect_v1", "serial": "D455-1", "fps": 30, "date": "2026-01-01", "color": {"coeffs": BROWN, "fx": 600},
    "D": [0, 0, 0, 0, 0], "coeffs": [0.0] * 5, "k1": 0, "model": "brown_conrady", "units": "mm", "scale": 1,
    "depth_units": 0.001, "dist": 2.5, "extrinsics": {"coeffs": BROWN}, "baseline": 0.095, "distortion": [],
    "timestamp_unit": "ms", "unit": "px", "skew": 0, "depth_trunc": 3.0,
}  # fmt: skip


@pytest.mark.parametrize("key", QUIET)
def test_sound_keys_without_a_word(tmp_path, key):
    found = read_lens_file(written(tmp_path, lens(**{key: QUIET[key]})))
    assert found.notes == () and found.intrinsics.is_pinhole and found.unit_m in (None, 0.001)


def test_focal_lengths_and_centre_by_name(tmp_path):
    for keys in ({"cx": 31.5, "cy": 23.5}, {"ppx": 31.5, "ppy": 23.5}):
        content = {"width": 64, "height": 48, "fx": 60, "fy": 61} | keys
        found = read_lens_file(written(tmp_path, content))
        assert found.intrinsics == Intrinsics(64, 48, 60, 61, 31.5, 23.5) and found.notes == ()


def folder_of(tmp_path, width, height, fx, cx, cy):
    frame = np.full((height, width), 2000, np.uint16)
    matrix = [fx, 0, 0, 0, fx, 0, cx, cy, 1]
    intrinsic = {"width": width, "height": height, "intrinsic_matrix": matrix}
    return write_folder(tmp_path / "a", depth=[frame], color=False, intrinsic=intrinsic)


OF_ANOTHER_PICTURE = {
    "double": (640, 576, 1008, 639.5, 575.5, "double size.*halve"),
    "double, Kinect v2": (512, 424, 731, 509.8, 410.8, "double size"),
    "double, Azure": (640, 576, 1008, 646, 660, "double size"),
    "half": (640, 576, 252, 159.5, 143.5, "half the size.*double fx"),
    "half, D455": (848, 480, 214, 212, 119, "half the size"),
    "three times": (640, 360, 1400, 959.5, 539.5, "3 times as large"),
    "one axis": (640, 480, 911, 650.9, 360, "edge"),
    "at the other edge": (640, 480, 525, 1, 239.5, "edge"),
    "outside": (640, 480, 525, -40, 239.5, "edge or outside"),
    "exchanged": (640, 480, 525, 239.5, 319.5, "exchanged.*cx 319.5"),
    "parts of the size": (640, 480, 0.82, 0.5, 0.5, "in parts.*pixels"),
}


@pytest.mark.parametrize("case", OF_ANOTHER_PICTURE)
def test_intrinsics_of_another_picture_are_refused_when_read(tmp_path, case):
    *values, words = OF_ANOTHER_PICTURE[case]
    folder = folder_of(tmp_path, *values)
    with pytest.raises(CaptureError, match=words) as caught:
        open_capture(folder)
    assert_one_line_naming(caught.value, folder / "intrinsic.json")
    width, height, fx, cx, cy = values
    if fx > 1:  # and so they are when they come another way
        np.save(tmp_path / "depth.npy", np.full((height, width), 2000, np.uint16))
        with pytest.raises(CaptureError, match=words):
            open_capture(tmp_path / "depth.npy", options=ReadOptions(Intrinsics(width, height, fx, fx, cx, cy)))


SOUND = {
    "middle": (640, 480, 525, 319.5, 239.5),
    "an Azure Kinect": (640, 576, 504, 323, 330),
    "a part, left": (320, 480, 525, 40, 239.5),
    "a part, a quarter from the corner": (320, 240, 525, 80, 60),
    "a part, low right": (320, 240, 525, 290, 200),
    "a wide camera": (1024, 1024, 500, 510, 515),
    "upright": (480, 640, 525, 239.5, 319.5),
    "nearly square": (640, 576, 504, 287.5, 319.5),
}


@pytest.mark.parametrize("case", SOUND)
def test_sound_intrinsics_without_a_word(tmp_path, case):
    capture = open_capture(folder_of(tmp_path, *SOUND[case]))
    assert capture.notes == () and capture.intrinsics.cx == SOUND[case][3]


def test_one_and_a_half_times_the_size_is_a_doubt(tmp_path):
    capture = open_capture(folder_of(tmp_path, 848, 480, 640, 639.5, 359.5))
    assert len(capture.notes) == 1 and "1272×720" in capture.notes[0]


def test_width_and_height_exchanged(tmp_path):
    folder = folder_of(tmp_path, 640, 480, 525, 319.5, 239.5)
    matrix = [525, 0, 0, 0, 525, 0, 239.5, 319.5, 1]
    (folder / "intrinsic.json").write_text(json.dumps({"width": 480, "height": 640, "intrinsic_matrix": matrix}))
    with pytest.raises(CaptureError, match="width and height are exchanged"):
        open_capture(folder)
    wrong = Intrinsics(480, 640, 525, 525, 239.5, 319.5)
    with pytest.raises(CaptureError, match="width and height are exchanged"):
        open_capture(folder, options=ReadOptions(wrong))


def test_an_option_stands_in_for_a_wrong_file(tmp_path):
    folder = folder_of(tmp_path, 640, 576, 1008, 639.5, 575.5)
    good = Intrinsics(640, 576, 504, 504, 319.5, 287.5)
    assert open_capture(folder, options=ReadOptions(good)).intrinsics == good
    (folder / "intrinsic.json").write_text("{")
    assert open_capture(folder, options=ReadOptions(good)).intrinsics == good
    check_principal_point("anything", good)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_json_as_editors_save_it(tmp_path, encoding):
    path = tmp_path / "intrinsic.json"
    path.write_bytes(json.dumps(lens(), indent=1).replace("\n", "\r\n").encode(encoding))
    assert read_lens_file(path).intrinsics == Intrinsics(64, 48, 60, 60, 31.5, 23.5)
