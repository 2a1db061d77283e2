"""Frames are brought to one exposure by what stands still."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.capture import Capture
from mirror_scan.core.numeric.srgb import from_linear, to_linear
from mirror_scan.core.sequences.exposure import match_frame

CAMERA = Intrinsics(96, 80, 100.0, 100.0, 47.5, 39.5)


def exposed(color, gains):
    return np.clip(np.rint(255 * from_linear(np.clip(to_linear(color / 255.0) * gains, 0, 1))), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("gains", [(0.6, 0.6, 0.6), (1.3, 1.1, 0.9)])
def test_another_exposure_is_undone_whatever_moves(gains):
    rng = np.random.default_rng(2)
    color = rng.integers(60, 170, (80, 96, 3)).astype(np.uint8)
    background = np.full((80, 96), 2.0, np.float32)
    background[20:60, 30:70] = 0.0  # there somebody moves, in other colours
    other = color.copy()
    other[20:60, 30:70] = rng.integers(0, 255, (40, 40, 3))
    capture = Capture(np.ones((1, 80, 96), np.float32), exposed(other, gains), CAMERA)
    back = match_frame(capture, color, background).color
    still = background > 0
    assert np.abs(back[still].astype(int) - color[still]).max() <= 2


def test_the_same_exposure_is_left_alone():
    color = np.random.default_rng(2).integers(60, 170, (80, 96, 3)).astype(np.uint8)
    capture = Capture(np.ones((1, 80, 96), np.float32), color, CAMERA)
    assert match_frame(capture, color, np.full((80, 96), 2.0, np.float32)) is capture
    assert match_frame(capture, None, np.full((80, 96), 2.0, np.float32)) is capture
    assert match_frame(capture, color, np.zeros((80, 96), np.float32)) is capture  # nothing stands still
