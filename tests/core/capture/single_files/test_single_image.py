"""A lone depth image or array."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.capture import ReadOptions, open_capture
from mirror_scan.core.capture.kinect_disparity import depth_of_disparity
from writers import assert_camera


@pytest.mark.parametrize("suffix", [".npy", ".pgm", "swapped.pgm"])
def test_raw_kinect_disparity_alone(tmp_path, suffix):
    v, u = np.mgrid[:480, :640]
    raw = (500 + u // 2 + v // 4).astype(np.uint16)
    raw[:40] = 2047
    path = tmp_path / f"d{suffix}"
    if suffix == ".npy":
        np.save(path, raw)
    else:
        path.write_bytes(
            b"P5\n# a comment\n640 480\n65535\n" + raw.astype(">u2" if suffix == ".pgm" else "<u2").tobytes()
        )
    capture = open_capture(path, options=ReadOptions(disparity="tangent"))
    np.testing.assert_array_equal(capture.depth[0], depth_of_disparity("tangent")[raw])
    assert_camera(capture.intrinsics, *[575.8157389635317] * 2, 320, 240)
    burrus = open_capture(path, options=ReadOptions(kinect_calibration="burrus"))
    assert burrus.intrinsics.is_pinhole and burrus.intrinsics.fx == 594.21
