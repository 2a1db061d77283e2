"""A burst: its noise falls as 1/√n down to what all frames have in common; what moves in it is told, and how far."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.depth.burst_fusion import fuse_burst
from mirror_scan.core.depth.burst_motion import burst_motion, still_warning
from mirror_scan.core.depth.noise_estimate import burst_noise
from mirror_scan.core.depth.settings import DepthSettings


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


FOCAL, LEAST = 260.0, DepthSettings().still_share


def column(aside=0.0, up=0.0, ahead=0.0):
    """A round column, 40 cm thick and 80 cm high, 1.5 m away before a wall; moved by so much [m]."""
    rows, columns = np.mgrid[:240, :320] - np.array((119.5, 159.5)).reshape(2, 1, 1)
    x, z = columns / FOCAL, 1.5 + ahead
    a, b = x**2 + 1, x * aside + z
    root = b * b - a * (aside**2 + z**2 - 0.04)
    front = (b - np.sqrt(np.maximum(root, 0))) / a
    return np.where((root > 0) & (np.abs(rows / FOCAL * front + up) < 0.4), front, 2.6)


def burst(places, noise=0.0015, seed=0):
    rng = np.random.default_rng(seed)
    frames = np.stack([column(*place) for place in places])
    return np.round(frames + noise * rng.standard_normal(frames.shape), 3).astype(np.float32)


WHOLE = np.zeros((240, 320), np.int8)
SUBJECT = np.where(column() < 2.0, 0, -1).astype(np.int8)


def steady(total, frames, axis):
    return [tuple(np.eye(3)[axis] * total * k / (frames - 1)) for k in range(frames)]


@pytest.mark.parametrize("labels", [WHOLE, SUBJECT], ids=["all that is seen", "the subject"])
@pytest.mark.parametrize(
    ("places", "went"),
    [
        *((steady(total, 7, 0), total) for total in (0.03, 0.06, 0.18, 0.36, 0.6)),
        *((steady(total, 7, 2), total) for total in (0.03, 0.06, 0.18, 0.36, 0.6, -0.3)),
        *((steady(0.1, frames, 0), 0.1) for frames in (2, 3, 5, 30)),
        *((steady(0.1, frames, 2), 0.1) for frames in (2, 3, 5, 30)),
        *(([(0.0, 0.0, jump * (k > 3)) for k in range(7)], jump) for jump in (0.025, 0.05, 0.1, 0.2)),
        *(([(jump * (k > 6), 0.0, 0.0) for k in range(10)], jump) for jump in (0.05, 0.2)),
        (steady(0.12, 6, 1), 0.12),
        ([(0.02 * k, 0.0, 0.02 * k) for k in range(6)], 0.1414),
        ([(0.05 * np.sin(k), 0.0, 0.0) for k in range(12)], 0.1),
        ([(0.3 * (3 <= k < 6), 0.0, 0.0) for k in range(9)], 0.3),
        (steady(0.0232, 30, 2), 0.0232),
    ],
)
def test_how_far_it_moved_is_right_within_a_third(labels, places, went):
    motion = burst_motion(burst(places), labels, 1.0 / FOCAL, LEAST)
    assert motion.share > LEAST and motion.median == pytest.approx(abs(went), rel=1 / 3)
    assert f"{1e3 * motion.median:.0f} mm" in still_warning(burst(places), labels, FOCAL, DepthSettings())


def blurred(noise, radius):
    """Noise that is alike over a window, with the standard deviation it had."""
    out = sum(
        np.roll(noise, (dv, du), (1, 2)) for dv in range(-radius, radius + 1) for du in range(-radius, radius + 1)
    )
    return out / out.std() * noise.std()


@pytest.mark.parametrize("frames", [2, 3, 5, 7, 10, 30])
@pytest.mark.parametrize("noise", ["white", "window", "partly fixed", "steps", "missing", "edges"])
def test_a_still_burst_of_noisy_readings_is_still(frames, noise):
    rng = np.random.default_rng(frames)
    depth = np.stack([column()] * frames)
    random = rng.standard_normal(depth.shape)
    if noise in ("window", "partly fixed"):
        random = blurred(random, 3)
    if noise == "partly fixed":
        random = 0.7 * random + 0.7 * random[0]
    depth = depth * (1 + 0.003 * random)
    if noise == "steps":
        depth = 1 / (np.round(1 / depth / 0.0029) * 0.0029)  # a structured-light camera's, 6 mm at 1.5 m
    if noise == "missing":
        depth[rng.random(depth.shape) < 0.1] = 0
    if noise == "edges":
        for way in (-1, 1):  # next to an edge either surface is read
            other = np.roll(depth, way, axis=2)
            depth = np.where((np.abs(other - depth) > 0.3) & (rng.random(depth.shape) < 0.5), other, depth)
    for labels in (WHOLE, SUBJECT):
        assert still_warning(depth.astype(np.float32), labels, FOCAL, DepthSettings()) is None


@pytest.mark.parametrize("sensor", ["azure_kinect", "kinect_v1", "realsense_d455", "ideal"])
def test_still_bursts_of_virtual_cameras(simulated, sensor):
    simulation = simulated(sensor)
    labels = np.where(simulation.capture.depth[0] > 0, simulation.truth.labels, -1).astype(np.int8)
    focal = simulation.capture.intrinsics.fx
    assert still_warning(simulation.capture.depth, labels, focal, DepthSettings()) is None


def test_pictures_of_different_scenes_are_not_still():
    rng = np.random.default_rng(1)
    rows, columns = np.mgrid[:240, :320]
    scenes = []
    for _ in range(10):
        depth = np.full((240, 320), 3.0)
        for _ in range(8):
            v, u, h, w = rng.integers((20, 20, 30, 30), (200, 280, 120, 120))
            depth[v : v + h, u : u + w] = rng.uniform(1.0, 2.8)
        scenes.append(depth + 0.1 * rng.random() + 0.001 * columns * rng.uniform(-1, 1))
    assert still_warning(np.stack(scenes).astype(np.float32), WHOLE, FOCAL, DepthSettings())
