"""Which frames are read, and what is no choice."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.capture import open_capture
from mirror_scan.core.errors import CaptureError


@pytest.mark.parametrize(
    ("choice", "expected"),
    [(None, [0, 1, 2, 3, 4]), (2, [0, 1]), ("1:3", [1, 2]), ("3", [3]), ("::2", [0, 2, 4]), ("-2:", [3, 4])],
)
def test_frames_are_chosen(tmp_path, choice, expected):
    np.save(tmp_path / "a.npy", np.arange(1, 6, dtype=np.float32)[:, None, None] * np.ones((1, 480, 640), np.float32))
    assert open_capture(tmp_path / "a.npy", choice).depth[:, 0, 0].tolist() == [n + 1 for n in expected]


@pytest.mark.parametrize("choice", [0, -1, "", "a", "1:2:3:4", "7", "3:3", "1:2:-1", True, 2.5])
def test_frames_that_are_none(tmp_path, choice):
    np.save(tmp_path / "a.npy", np.ones((5, 480, 640), np.float32))
    with pytest.raises(CaptureError, match="a.npy"):
        open_capture(tmp_path / "a.npy", choice)
