"""What a burst's frames do to the noise: it falls as 1/√n down to what all frames have in common."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.depth.burst_fusion import fuse_burst
from mirror_scan.core.depth.noise_estimate import burst_noise


def noise_of(count: int, common: float, seed: int = 0):
    """A slanted wall in two views, read with 4 mm of noise that is new in each frame and some that is the same."""
    rng = np.random.default_rng(seed)
    true = np.tile(np.linspace(2.0, 2.4, 160), (120, 1))
    frames = true + common * rng.standard_normal(true.shape) + 0.004 * rng.standard_normal((count, *true.shape))
    fused, spread = fuse_burst(frames.astype(np.float32))
    labels = np.zeros(true.shape, np.int8)
    labels[:, 80:] = 1
    labels[:10] = -1
    return burst_noise(count, spread, fused, labels, 3)


@pytest.mark.parametrize("count", [2, 4, 16, 64])
def test_noise_falls_with_the_root_of_the_frames(count):
    for view in noise_of(count, 0.0)[:2]:
        assert view.frames == count and view.frame == pytest.approx(0.004, rel=0.06)
        assert view.expected == pytest.approx(view.frame / np.sqrt(count))
        assert view.fused == pytest.approx(0.004 / np.sqrt(count), rel=0.06)


def test_down_to_what_the_frames_have_in_common():
    for view in noise_of(64, 0.002)[:2]:
        assert view.expected == pytest.approx(0.0005, rel=0.06)
        assert view.fused == pytest.approx(np.hypot(0.0005, 0.002), rel=0.06)


def test_one_frame_and_a_view_that_is_empty():
    direct, mirror, empty = noise_of(1, 0.0)
    assert direct.frame is None and direct.expected is None and mirror.fused == pytest.approx(0.004, rel=0.06)
    assert empty.frame is None and empty.fused == 0.0


def test_by_the_truth_of_a_virtual_camera(simulated):
    simulation = simulated("azure_kinect")
    frames, sight = simulation.capture.depth, simulation.truth.sight
    fused, spread = fuse_burst(frames)
    labels = np.where((fused > 0) & (np.abs(fused - sight.depth) < 0.05), simulation.truth.labels, -1).astype(np.int8)
    for k, view in enumerate(burst_noise(len(frames), spread, fused, labels, 3)):
        error = (fused - sight.depth)[labels == k]
        assert view.fused == pytest.approx(1.4826 * np.median(np.abs(error - np.median(error))), rel=0.15)
        assert view.expected == pytest.approx(view.fused, rel=0.2)
