"""PCL's image grabber: what a writer made from the published description comes back value by value."""

from __future__ import annotations

import numpy as np
import writers
from mirror_scan.core.capture import open_capture
from writers import COLOR, DEPTH, METRES, assert_camera


def test_pclzf(tmp_path):
    (tmp_path / "s_depth.pclzf").write_bytes(writers.pclzf(DEPTH, "depth16"))
    (tmp_path / "s_rgb.pclzf").write_bytes(writers.pclzf(COLOR, "rgb24"))
    (tmp_path / "s.xml").write_text(writers.pclzf_xml(61.0, 32.0, 24.0))
    for path in (tmp_path, tmp_path / "s_depth.pclzf"):
        capture = open_capture(path)
        np.testing.assert_array_equal(capture.depth[0], METRES)
        np.testing.assert_array_equal(capture.color, COLOR)
        assert_camera(capture.intrinsics, 61, 61, 32, 24)
