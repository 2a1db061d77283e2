"""OpenNI recordings: what a writer made from the published description comes back value by value."""

from __future__ import annotations

import numpy as np
import pytest
import writers
from mirror_scan.core.capture import ReadOptions, open_capture
from writers import COLOR, DEPTH, METRES, assert_camera, jpeg, saved


@pytest.mark.parametrize("codec", [b"16zT", b"16zP", b"NONE"])
@pytest.mark.parametrize("old", [False, True])
def test_oni(tmp_path, codec, old):
    frames = [DEPTH, np.roll(DEPTH, 3, axis=1), np.zeros_like(DEPTH)]
    path = saved(tmp_path, "a.oni", writers.oni(frames, COLOR, codec, fov=(1.0, 0.8), old=old))
    capture = open_capture(path, "0:2")
    np.testing.assert_array_equal(capture.depth, np.divide(frames[:2], 1000, dtype=np.float32))
    np.testing.assert_array_equal(capture.color, COLOR)
    assert_camera(capture.intrinsics, 32 / np.tan(0.5), 24 / np.tan(0.4), 32, 24)
    assert capture.sensor == "kinect_v1"


def test_a_mirrored_oni_is_turned_round(tmp_path):
    data = writers.oni([DEPTH], COLOR, properties=[writers.oni_number("xnMirror", 1)])
    path = saved(tmp_path, "a.oni", data)
    np.testing.assert_array_equal(open_capture(path).depth[0], METRES[:, ::-1])
    np.testing.assert_array_equal(open_capture(path).color, COLOR[:, ::-1])
    assert open_capture(path).intrinsics.cx == 63 - 32
    np.testing.assert_array_equal(open_capture(path, options=ReadOptions(mirrored=False)).depth[0], METRES)


def test_oni_units_and_jpeg(tmp_path):
    tenths = writers.oni(
        [DEPTH], jpeg(tmp_path, COLOR), color_codec=b"JPEG", properties=[writers.oni_number("oniPixelFormat", 101)]
    )
    capture = open_capture(saved(tmp_path, "a.oni", tenths))
    np.testing.assert_allclose(capture.depth[0], DEPTH / 10000, rtol=1e-6)
    assert np.abs(capture.color.astype(int) - COLOR).mean() < 6
