"""What the program saves itself comes back."""

from __future__ import annotations

import numpy as np
from mirror_scan.core.capture import open_capture
from mirror_scan.core.capture.single_files.npz import write_npz
from mirror_scan.core.io.images import write_png
from writers import DEPTH


def test_our_npz(tmp_path):
    source = tmp_path / "folder"
    (source / "depth").mkdir(parents=True)
    write_png(source / "depth" / "0.png", DEPTH)
    write_png(source / "depth" / "1.png", DEPTH + np.uint16(1))
    (source / "intrinsic.json").write_text('{"width":64,"height":48,"intrinsic_matrix":[60,0,0,0,61,0,31.5,24,1]}')
    (source / "mirrors.json").write_text('{"mirrors": [{"name": "a", "frame_pixels": [[1, 2], [3, 4], [5, 7]]}]}')
    capture = open_capture(source)
    write_npz(tmp_path / "a.npz", capture)
    again = open_capture(tmp_path / "a.npz")
    np.testing.assert_array_equal(again.depth, capture.depth)
    assert again.intrinsics == capture.intrinsics and again.color is None and again.name == "folder"
    np.testing.assert_array_equal(again.mirrors[0].frame_pixels, capture.mirrors[0].frame_pixels)
    assert len(open_capture(tmp_path / "a.npz", "1:").depth) == 1
