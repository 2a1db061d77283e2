"""How noisy readings are, and how far neighbours err alike: planes and a round body with noise of known kind."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics, RgbdImage
from mirror_scan.core.views.view_correspondences import noise_of, surfaces

SIZE = (240, 320)


def scene(window: int, sigma: float, rng: np.random.Generator, curved: bool = False) -> np.ndarray:
    """A floor before a wall, and a round body, with noise of 1/z that a matching window smooths."""
    v, u = np.indices(SIZE).astype(float)
    inverse = np.maximum(1.0 / 3.5, (v - 100.0) / 250.0) + 2e-4 * u
    aside = (u - 160.0) / 40.0
    body = np.abs(aside) < 1.0
    inverse[body] = 1.0 / (2.2 - 0.2 * np.sqrt(1.0 - aside[body] ** 2))
    if curved:
        inverse = 1.0 / (3.0 - 0.2 * np.cos(u / 30.0) * np.cos(v / 30.0))
    return (1.0 / (inverse + sigma * smooth(window, rng))).astype(np.float32)


def smooth(window: int, rng: np.random.Generator) -> np.ndarray:
    """Noise of variance 1, the mean over a matching window."""
    noise = rng.standard_normal((SIZE[0] + window - 1, SIZE[1] + window - 1))
    for axis in (0, 1):
        noise = np.apply_along_axis(np.convolve, axis, noise, np.ones(window), "valid")
    return noise / window


@pytest.mark.parametrize("window", [1, 5, 7, 9])
def test_noise_and_the_window_over_which_it_is_alike(window):
    depth = scene(window, 0.002, np.random.default_rng(window))
    depth[::7, ::5] = 0.0
    noise = noise_of(depth, np.ones(SIZE, np.int8))
    assert noise.sigma == pytest.approx(0.002, rel=0.3)
    assert noise.alike == pytest.approx(window, rel=0.35)


def test_bent_surfaces_are_no_smooth_noise():
    depth = scene(1, 0.0005, np.random.default_rng(0), curved=True)
    assert noise_of(depth, np.ones(SIZE, np.int8)).alike < 3.0


@pytest.mark.parametrize("depth", [np.zeros(SIZE, np.float32), np.ones(SIZE, np.float32), np.ones((3, 5), np.float32)])
def test_where_nothing_varies_nothing_is_alike(depth):
    noise = noise_of(depth, np.ones(depth.shape, np.int8))
    assert noise.sigma == 0.0 and noise.alike == 1.0


def test_means_of_alike_readings_are_as_unsure_as_they_vary():
    """Pieces of one plane, smooth noise drawn again and again: their places vary as their variances say."""
    intrinsics, rng, off, said = Intrinsics(320, 240, 300.0, 300.0, 159.5, 119.5), np.random.default_rng(3), [], []
    for _ in range(6):
        depth = 1.0 / (0.4 + 0.002 * smooth(7, rng))
        image, seen = RgbdImage(depth.astype(np.float32), intrinsics), np.ones(SIZE, np.int8)
        found = surfaces(image, seen, 1, noise_of(image.depth, seen))
        off.append(found.points[:, 2] - 2.5)
        said.append(found.variances)
    ratio = np.concatenate(off).std() / np.sqrt(np.concatenate(said).mean())
    assert 0.7 < ratio < 1.4
