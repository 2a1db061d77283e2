"""Clouds with other axes and units are the same camera."""

from __future__ import annotations

import numpy as np
import pytest
import writers
from mirror_scan.core.capture import open_capture
from mirror_scan.core.errors import CaptureError
from writers import CAMERA, COLOR, DEPTH, METRES, assert_camera, saved


def test_clouds_with_other_axes_are_the_same_camera(tmp_path):
    """z backward and y up (OpenGL), z up and y forward (Blender), millimetres: one camera, one depth map."""
    cloud = writers.cloud_of(DEPTH, *CAMERA)
    for name, axes in {
        "opengl": cloud * (1, -1, -1),
        "z up": np.stack((cloud[..., 0], cloud[..., 2], -cloud[..., 1]), axis=-1),
        "turned": np.stack((cloud[..., 2], -cloud[..., 0], -cloud[..., 1]), axis=-1),
        "millimetres": cloud * 1000,
    }.items():
        capture = open_capture(saved(tmp_path, f"{name}.pcd", writers.pcd(axes.astype(np.float32), COLOR, "binary")))
        np.testing.assert_allclose(capture.depth[0], METRES, rtol=1e-6, err_msg=name)
        assert_camera(capture.intrinsics, *CAMERA, within=5e-3)
        assert not any("left-handed" in note for note in capture.notes), name
    wrong = open_capture(
        saved(tmp_path, "left.pcd", writers.pcd((cloud * (-1, 1, 1)).astype(np.float32), COLOR, "binary"))
    )
    assert any("left-handed" in note for note in wrong.notes)
    with pytest.raises(CaptureError, match="not what one camera sees"):
        shuffled = np.random.default_rng(0).permutation(cloud.reshape(-1, 3)).reshape(cloud.shape)
        open_capture(saved(tmp_path, "b.pcd", writers.pcd(shuffled, COLOR, "binary")))
