"""TUM RGB-D folders: what a writer made from the published description comes back value by value."""

from __future__ import annotations

import numpy as np
import pytest
import writers
from mirror_scan.core.capture import open_capture
from mirror_scan.core.errors import CaptureError
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
