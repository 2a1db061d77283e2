"""Organized .ply clouds: what a writer made from the published description comes back value by value."""

from __future__ import annotations

import numpy as np
import pytest
import writers
from mirror_scan.core.capture import open_capture
from writers import assert_camera, saved


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian", "range grid"])
def test_organized_ply(tmp_path, kind):
    depth, color = writers.scene(160, 120)
    camera = (150.0, 150.0, 80.0, 59.5)
    cloud = writers.cloud_of(depth, *camera)
    grid = kind == "range grid"
    path = saved(tmp_path, "a.ply", writers.ply(cloud, color, "binary_little_endian" if grid else kind, grid))
    capture = open_capture(path)
    np.testing.assert_array_equal(capture.depth[0], np.nan_to_num(cloud[..., 2]))
    np.testing.assert_array_equal(capture.color[depth > 0], color[depth > 0])
    assert_camera(capture.intrinsics, *camera, within=2e-3)
