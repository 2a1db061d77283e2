"""TUM RGB-D folders: what a writer made from the published description comes back value by value."""

from __future__ import annotations

import numpy as np
import pytest
import writers
from mirror_scan.core.capture import ReadOptions, open_capture
from mirror_scan.core.errors import CaptureError
from mirror_scan.core.io.images import write_png
from writers import assert_camera


def test_tum(tmp_path):
    depth, color = writers.scene(640, 480)
    frames = [depth, depth + np.uint16(1)]
    folder = writers.tum(tmp_path / "rgbd_dataset_freiburg3_walking", frames, color)
    capture = open_capture(folder)
    np.testing.assert_allclose(capture.depth, np.array(frames) / 1000, rtol=1e-6)
    np.testing.assert_array_equal(capture.color, color)
    assert_camera(capture.intrinsics, 535.4, 539.2, 320.1, 247.6)
    second = open_capture(folder, "1")
    np.testing.assert_array_equal(second.color, np.roll(color, 1, axis=1))
    late = open_capture(writers.tum(tmp_path / "late", frames, color, apart=0.05), "0")
    assert late.color is None and any("no colour image within" in note for note in late.notes)
    (folder / "depth.txt").write_text("1.0 ../../secret.png\n")
    with pytest.raises(CaptureError, match="outside the folder"):
        open_capture(folder)


SPELLINGS = {
    "a byte order mark": ("1.0 depth/1.png\n", "utf-8-sig"),
    "UTF-16": ("# depth\r\n1.0 depth/1.png\r\n", "utf-16"),
    "UTF-16 without a mark": ("1.0 depth/1.png\n", "utf-16-le"),
    "the other UTF-16": ("1.0 depth/1.png\n", "utf-16-be"),
    "backslashes": ("1.0 depth\\1.png\n", "utf-8"),
    "from here": ("1.0 .\\depth\\1.png\n", "utf-8"),
    "line ends of Windows": ("# time name\r\n\r\n1.0 depth/1.png\r\n", "utf-8"),
    "line ends of old Macs": ("# time name\r1.0 depth/1.png\r", "utf-8"),
    "tabs": ("\t1.0\tdepth/1.png\t\n", "utf-8"),
    "commas": ("1.0, depth/1.png\n", "utf-8"),
    "many blanks, no line end": ("   1.0    depth/1.png   ", "utf-8"),
    "blanks in the name": ("1.0 depth/a frame 1.png\n", "utf-8"),
    "another computer's names": ("1.0 C:\\data\\my scan\\depth\\1.png\n", "utf-8"),
    "names from the root": ("1.0 /home/a/scan/depth/1.png\n", "utf-8"),
    "quotes": ('1.0 "depth/a frame 1.png"\n', "utf-8"),
    "exponents": ("1.305e9 depth/1.png\n", "utf-8"),
}


@pytest.mark.parametrize("case", SPELLINGS)
def test_spellings_of_the_list(tmp_path, case):
    text, encoding = SPELLINGS[case]
    (tmp_path / "depth").mkdir()
    depth = writers.scene(640, 480)[0]
    for name in ("1.png", "a frame 1.png"):
        write_png(tmp_path / "depth" / name, depth * np.uint16(5))
    (tmp_path / "depth.txt").write_bytes(text.encode(encoding))
    np.testing.assert_allclose(open_capture(tmp_path).depth[0], depth / 1000, rtol=1e-6)


@pytest.mark.parametrize(("factor", "unit"), [(1, "millimetres"), (5, ""), (0.9973 * 5, "")])
def test_millimetres_in_the_same_layout(tmp_path, factor, unit):
    """As recorders of other cameras write them; rendered depth of 5000 to a metre is no multiple of 5 either."""
    (tmp_path / "depth").mkdir()
    stored = np.rint(writers.scene(640, 480)[0].astype(np.float64) * factor).astype(np.uint16)
    write_png(tmp_path / "depth" / "1.png", stored)
    (tmp_path / "depth.txt").write_text("1.0 depth/1.png\n")
    capture = open_capture(tmp_path)
    np.testing.assert_allclose(capture.depth[0], stored / (1000 if unit else 5000), rtol=1e-6)
    assert any("millimetres" in note for note in capture.notes) == bool(unit)
    assert capture.sensor == ("unknown" if unit else "kinect_v1")
    assert open_capture(tmp_path, options=ReadOptions(depth_unit_m=0.01)).depth.max() == pytest.approx(
        stored.max() / 100
    )


def test_a_list_that_is_none(tmp_path):
    (tmp_path / "depth.txt").write_text("depth/1.png\n")
    with pytest.raises(CaptureError, match="line 1 must be a time and a file name"):
        open_capture(tmp_path)
    (tmp_path / "depth.txt").write_text("1.0 /etc/../../secret.png\n")
    with pytest.raises(CaptureError, match="outside the folder"):
        open_capture(tmp_path)
    (tmp_path / "depth.txt").write_text("1.0 ..\\..\\secret.png\n")
    with pytest.raises(CaptureError, match="outside the folder"):
        open_capture(tmp_path)
