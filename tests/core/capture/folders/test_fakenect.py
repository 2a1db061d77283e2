"""fakenect's folders: what a writer made from the published description comes back value by value."""

from __future__ import annotations

import numpy as np
import pytest
import writers
from mirror_scan.core.capture import open_capture
from mirror_scan.core.capture.kinect_disparity import ZeroPlane
from writers import assert_camera


@pytest.mark.parametrize(
    "given", [None, ZeroPlane(120.0, 0.1042, 7.52, 2.3, 200), ZeroPlane(118.0, 0.105, 7.4, 2.4, 198)]
)
def test_fakenect(tmp_path, given):
    rng = np.random.default_rng(0)
    frames = [rng.integers(400, 1050, (480, 640)).astype(np.uint16) for _ in range(2)]
    frames[0][rng.random((480, 640)) < 0.2] = 2047
    plane = None if given is None else tuple(vars(given).values())
    color = rng.integers(0, 256, (480, 640, 3)).astype(np.uint8)
    capture = open_capture(writers.fakenect(tmp_path / "session", frames, color, plane))
    p = given or ZeroPlane()
    raw = np.array(frames, float)
    metric = ((raw - 4 * p.const_shift) / 4 - 0.375) * p.pixel_size  # libfreenect's registration.c
    mm = 10 * (metric * p.reference_distance / (p.emitter_distance - metric) + p.reference_distance)
    np.testing.assert_allclose(capture.depth, np.where((raw == 2047) | (mm > 10000), 0, mm / 1000), rtol=1e-6)
    f = p.reference_distance / (2 * p.pixel_size)
    assert_camera(capture.intrinsics, f, f, 320, 240)
    assert capture.color.shape == (480, 640, 3) and capture.sensor == "kinect_v1"
