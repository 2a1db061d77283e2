"""Which frames are read, what is no choice, and which colour image goes with them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from mirror_scan.core.capture import open_capture
from mirror_scan.core.capture.frames import apart_note
from mirror_scan.core.errors import CaptureError
from mirror_scan.core.io.images import write_png


@pytest.mark.parametrize(
    ("choice", "expected"),
    [(None, [0, 1, 2, 3, 4]), (2, [0, 1]), ("1:3", [1, 2]), ("3", [3]), ("::2", [0, 2, 4]), ("-2:", [3, 4])],
)
def test_frames_are_chosen(tmp_path, choice, expected):
    np.save(tmp_path / "a.npy", np.arange(1, 6, dtype=np.float32)[:, None, None] * np.ones((1, 480, 640), np.float32))
    assert open_capture(tmp_path / "a.npy", choice).depth[:, 0, 0].tolist() == [n + 1 for n in expected]


@pytest.mark.parametrize("choice", [0, -1, "", "a", "1:2:3:4", "7", "3:3", "1:2:-1", True, 2.5])
def test_frames_that_are_none(tmp_path, choice):
    np.save(tmp_path / "a.npy", np.ones((5, 480, 640), np.float32))
    with pytest.raises(CaptureError, match="a.npy"):
        open_capture(tmp_path / "a.npy", choice)


def folder_of(tmp_path, depth_names, color_names):
    """An RGB-D folder; a colour image's gray is ten times its place in the list."""
    for kind in ("depth", "color"):
        (tmp_path / kind).mkdir()
    for name in depth_names:
        write_png(tmp_path / "depth" / f"{name}.png", np.full((48, 64), 2000, np.uint16))
    for i, name in enumerate(color_names):
        write_png(tmp_path / "color" / f"{name}.png", np.full((48, 64, 3), 10 * i, np.uint8))
    lens = {"width": 64, "height": 48, "intrinsic_matrix": [60, 0, 0, 0, 60, 0, 31.5, 23.5, 1]}
    (tmp_path / "intrinsic.json").write_text(json.dumps(lens))
    return tmp_path


SIX = [f"{i:06d}" for i in range(6)]
TIMES = [f"1305031102.{160000 + 33000 * i}" for i in range(6)]
# names of depth and of colour; the colour of each depth frame, negative where another frame's stands in for it
PAIRS = {
    "all": (SIX, SIX, [0, 1, 2, 3, 4, 5]),
    "first two dropped": (SIX, SIX[2:], [-1, -1, 0, 1, 2, 3]),
    "one dropped, one more": (SIX, [*SIX[:3], *SIX[4:], "000006"], [0, 1, 2, -3, 3, 4]),
    "last ones dropped": (SIX, SIX[:4], [0, 1, 2, 3, -4, -4]),
    "colour twice as often": (SIX, [f"{i:06d}" for i in range(12)], [0, 1, 2, 3, 4, 5]),
    "depth from 100 on": ([f"{i}" for i in range(100, 103)], [f"{i}" for i in range(99, 104)], [1, 2, 3]),
    "other zeros": (["0", "1", "2", "9", "10"], ["0000", "0001", "0009", "0010"], [0, 1, -2, 2, 3]),
    "words": (["depth_1", "depth_2", "depth_3"], ["color_01", "color_03", "color_04"], [0, -1, 1]),
    "frames of 7-Scenes": (["frame-000001.depth", "frame-000002.depth"], ["frame-000002.color"] * 1 + [
        "frame-000003.color"], [-1, 0]),
    "times": (TIMES, [f"{float(t) + 0.012:.6f}" for t in TIMES], [0, 1, 2, 3, 4, 5]),
    "times, one dropped": (TIMES, [f"{float(t) + 0.012:.6f}" for t in TIMES[:2] + TIMES[4:]], [0, 1, -2, -3, 2, 3]),
    "number and time": (
        ["0000001-000000000000", "0000002-000000033369", "0000003-000000066738"],
        ["0000001-000000000000", "0000003-000000066700", "0000004-000000099999"], [0, -1, 1]),
    "session's date before it": (["20260101_0001", "20260101_0002"], ["20260101_0002", "20260101_0003"], [-1, 0]),
    "seconds and milliseconds": (
        ["10-00-01_020", "10-00-01_520", "10-00-02_020"], ["10-00-01_020", "10-00-02_020", "10-00-02_520"], [0, -1, 1]),
    "one for all": (SIX, ["000000"], [0, 0, 0, 0, 0, 0]),
    "one for all, of any name": (SIX, ["snapshot"], [0, 0, 0, 0, 0, 0]),
    "no numbers": (["a", "b", "c"], ["x", "y", "z"], [0, 1, 2]),
    "no numbers, the same names": (["a", "b", "c"], ["a", "c"], [0, -1, 1]),
}  # fmt: skip


@pytest.mark.parametrize("case", PAIRS)
def test_colour_of_the_same_frame(tmp_path, case):
    depth_names, color_names, expected = PAIRS[case]
    folder = folder_of(tmp_path, depth_names, color_names)
    for place, color in enumerate(expected):
        capture = open_capture(folder, str(place))
        if color < 0:
            assert len(capture.notes) == 1 and "no colour image of its own" in capture.notes[0]
            assert f"{depth_names[place]}.png" in capture.notes[0]
            neighbours = (-color - 1, -color) if "times" not in case else (-color - 1, -color, -color - 2)
            assert capture.color[0, 0, 0] // 10 in neighbours
        else:
            assert (capture.color[0, 0, 0] // 10, capture.notes) == (color, ())


def test_colour_far_in_time_is_said():
    assert apart_note(0.05) == apart_note(-0.03) == []
    assert "0.4 s" in apart_note(-0.4)[0]
