"""Who reads a recording frame by frame walks through it once, and notices when it changes."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest
import writers
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.capture import FileIndices, ReadOptions, open_capture
from mirror_scan.core.capture.decoding import rosbag
from mirror_scan.core.capture.recordings import azure_mkv, oni, realsense_db3
from writers import COLOR, DEPTH

FRAMES = [np.where(DEPTH > 0, DEPTH + k, 0).astype(np.uint16) for k in range(4)]
LENS = ReadOptions(intrinsics=Intrinsics(64, 48, 60, 60, 32, 24))


def written(kind, path, frames):
    if kind == "db3":
        path.unlink(missing_ok=True)
        return writers.realsense_db3(path, frames, COLOR)
    if kind == "r3d":
        pytest.importorskip("liblzfse")
        size = (frames[0].shape[1], frames[0].shape[0])
        path.write_bytes(writers.r3d([frame / np.float32(1000) for frame in frames], size=size))
        return path
    make = {"mkv": writers.mkv, "oni": writers.oni, "bag": writers.realsense_bag}[kind]
    path.write_bytes(make(frames))
    return path


@pytest.mark.parametrize(
    ("kind", "module", "walk"),
    [
        ("mkv", azure_mkv, "parse"),
        ("oni", oni, "_nodes"),
        ("bag", rosbag.RosBag, "_index"),
        ("db3", realsense_db3, "_rows"),
        ("r3d", zipfile, "ZipFile"),
    ],
)
def test_a_recording_is_walked_through_once(tmp_path, monkeypatch, kind, module, walk):
    path = written(kind, tmp_path / f"a.{kind}", FRAMES)
    alone = [open_capture(path, str(k), LENS).depth[0] for k in range(len(FRAMES))]
    for one, other in zip(alone, FRAMES, strict=True):
        np.testing.assert_allclose(one, other / 1000, atol=1e-6)
    true, calls = getattr(module, walk), []

    def counted(*arguments, **named):
        calls.append(arguments)
        return true(*arguments, **named)

    monkeypatch.setattr(module, walk, counted)
    indices, counts = FileIndices(), []
    for k in (2, 0, 3, 1):
        with indices.kept():
            np.testing.assert_array_equal(open_capture(path, str(k), LENS).depth[0], alone[k])
        counts.append(len(calls))
    again = counts[3] - counts[2]
    assert again == counts[2] - counts[1] and again < counts[0]
    assert not again or kind == "db3"  # there what the frame itself takes is asked for
    monkeypatch.undo()
    written(kind, path, FRAMES[::-1][:3])
    with indices.kept():
        np.testing.assert_array_equal(open_capture(path, "0", LENS).depth[0], alone[3])
