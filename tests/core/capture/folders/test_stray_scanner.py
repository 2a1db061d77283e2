"""Stray Scanner's folders: what a writer made from the published description comes back value by value."""

from __future__ import annotations

import numpy as np
import pytest
import writers
from mirror_scan.core.capture import open_capture
from mirror_scan.core.errors import CaptureError
from writers import assert_camera


@pytest.mark.parametrize("kind", ["npy", "png"])
@pytest.mark.parametrize(("down", "turns"), [((0, 1, 0.2), 0), ((1, 0, 0.2), 1), ((0, -1, 0.3), 2), ((-1, 0, 0), 3)])
def test_stray_scanner_is_held_upright(tmp_path, kind, down, turns):
    depth, _ = writers.scene(256, 192)
    trust = np.full(depth.shape, 2, np.uint8)
    trust[:10] = 0
    capture = open_capture(writers.stray(tmp_path / "s", [depth, depth], trust, kind, down))
    expected = np.where(trust > 0, depth / np.float32(1000), 0)
    np.testing.assert_allclose(capture.depth[1], np.rot90(expected, -turns), rtol=1e-6)
    if not turns:
        assert_camera(
            capture.intrinsics, 1430 * 256 / 1920, 1431 * 192 / 1440, 960.5 * 256 / 1920 - 0.5, 720.5 * 192 / 1440 - 0.5
        )


def test_stray_scanner_color_needs_a_video_library(tmp_path, monkeypatch):
    import sys

    depth, _ = writers.scene(256, 192)
    folder = writers.stray(tmp_path / "s", [depth], np.full(depth.shape, 2, np.uint8))
    (folder / "rgb.mp4").write_bytes(b"no video")
    monkeypatch.setitem(sys.modules, "av", None)
    capture = open_capture(folder)
    assert capture.color is None and any("pip install" in note for note in capture.notes)
    monkeypatch.delitem(sys.modules, "av")
    pytest.importorskip("av")
    with pytest.raises(CaptureError, match="rgb.mp4: cannot be decoded"):
        open_capture(folder)
