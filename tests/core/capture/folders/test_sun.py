"""SUN RGB-D and Redwood folders: what a writer made from the published description comes back value by value."""

from __future__ import annotations

import numpy as np
import pytest
import writers
from mirror_scan.core.capture import open_capture
from mirror_scan.core.errors import CaptureError
from mirror_scan.core.io.images import write_png
from writers import COLOR, DEPTH, assert_camera


def test_sun_and_redwood(tmp_path):
    capture = open_capture(writers.sun(tmp_path / "kv1" / "a", DEPTH + np.uint16(8000), COLOR))
    np.testing.assert_allclose(capture.depth[0], (DEPTH + 8000) / 1000, rtol=1e-6)
    assert_camera(capture.intrinsics, 520, 520, 32, 24)
    depth, color = writers.scene(640, 480)
    for name, image in (("depth", depth), ("image", color)):
        (tmp_path / "redwood" / name).mkdir(parents=True)
        write_png(tmp_path / "redwood" / name / "1.png", image)
    capture = open_capture(tmp_path / "redwood")  # no intrinsics: PrimeSense's, with a note
    assert_camera(capture.intrinsics, 525, 525, 319.5, 239.5)
    assert capture.notes and capture.color is not None
    (tmp_path / "redwood" / "image").rename(tmp_path / "redwood" / "color")  # no longer Redwood's: no camera is guessed
    with pytest.raises(CaptureError, match=r"intrinsic\.json: is missing.*intrinsics”"):
        open_capture(tmp_path / "redwood")
