"""Organized .pcd clouds: what a writer made from the published description comes back value by value."""

from __future__ import annotations

import numpy as np
import pytest
import writers
from mirror_scan.core.capture import open_capture
from writers import CAMERA, COLOR, DEPTH, assert_camera, saved


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_organized_pcd(tmp_path, kind):
    cloud = writers.cloud_of(DEPTH, *CAMERA)
    path = saved(tmp_path, "a.pcd", writers.pcd(cloud, COLOR, kind))
    capture = open_capture(path)
    np.testing.assert_array_equal(capture.depth[0], np.nan_to_num(cloud[..., 2]))
    np.testing.assert_array_equal(capture.color, COLOR)
    assert_camera(capture.intrinsics, *CAMERA, within=2e-3)
    open3d = pytest.importorskip("open3d")
    theirs = np.asarray(open3d.io.read_point_cloud(str(path), remove_nan_points=False).points)
    np.testing.assert_array_equal(theirs.reshape(cloud.shape).astype(np.float32), cloud)
