"""Record3D captures: what a writer made from the published description comes back value by value."""

from __future__ import annotations

import numpy as np
import pytest
import writers
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.capture import ReadOptions, open_capture
from mirror_scan.core.io.images import openimageio
from writers import DEPTH, METRES, assert_camera, jpeg, saved


def test_record3d(tmp_path):
    pytest.importorskip("liblzfse")
    depth, _ = writers.scene(256, 192)
    frames = [depth / np.float32(1000), depth / np.float32(999)]
    frames[0][:5] = np.nan
    trust = (np.indices(depth.shape).sum(axis=0) % 3).astype(np.uint8)
    plain = jpeg(tmp_path, np.full((768, 1024, 3), (200, 90, 40), np.uint8))
    path = saved(tmp_path, "a.r3d", writers.r3d(frames, plain, trust))
    everything = open_capture(path, options=ReadOptions(min_confidence=0))
    np.testing.assert_array_equal(everything.depth, np.nan_to_num(frames))
    np.testing.assert_array_equal(everything.confidence, [trust, trust])
    assert_camera(everything.intrinsics, 50, 50.25, 127.625, 95.625)  # K is for 1024 x 768
    np.testing.assert_allclose(everything.color[50:150, 50:200].reshape(-1, 3).mean(axis=0), (200, 90, 40), atol=3)
    np.testing.assert_array_equal(open_capture(path, 1).depth[0], np.where(trust > 0, np.nan_to_num(frames[0]), 0))
    assert everything.sensor == "phone"


def test_record3d_as_exr(tmp_path):
    oiio = openimageio()
    folder = tmp_path / "EXR_RGBD"
    (folder / "depth").mkdir(parents=True)
    spec = oiio.ImageSpec(64, 48, 1, oiio.FLOAT)
    output = oiio.ImageOutput.create(str(folder / "depth" / "0.exr"))
    values = np.where(DEPTH > 0, METRES, np.nan).astype(np.float32)
    assert output.open(str(folder / "depth" / "0.exr"), spec) and output.write_image(values[..., None])
    assert output.close()
    (folder / "metadata.json").write_text('{"w": 128, "h": 96, "K": [120, 0, 0, 0, 120, 0, 64, 48, 1]}')
    capture = open_capture(folder)
    np.testing.assert_array_equal(capture.depth[0], METRES)
    assert_camera(capture.intrinsics, 60, 60, 31.75, 23.75)
    alone = open_capture(folder / "depth" / "0.exr", options=ReadOptions(intrinsics=Intrinsics(64, 48, 60, 60, 32, 24)))
    np.testing.assert_array_equal(alone.depth[0], METRES)
