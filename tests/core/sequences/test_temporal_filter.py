"""What is seen in successive frames is averaged, what moved is not: on surfaces whose motion is known."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.camera.noise_models import NoiseModel
from mirror_scan.core.sequences import DepthFilter, FilterSettings

CAMERA = Intrinsics(160, 120, 260.0, 260.0, 79.5, 59.5)
NOISE = 0.004  # m
MODEL = NoiseModel("even", 0.5, 5.0, axial=(NOISE, 0.0))


def sphere(middle, radius=0.35):
    """z of a sphere (H, W) [m] as the camera sees it; 0 beside it."""
    v, u = np.mgrid[:120, :160].astype(float)
    rays = np.stack(((u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)), axis=-1)
    a, b = (rays * rays).sum(axis=-1), rays @ np.asarray(middle)
    root = b * b - a * (np.dot(middle, middle) - radius**2)
    return np.where(root > 0, (b - np.sqrt(np.maximum(root, 0.0))) / a, 0.0)


def filtered(truths, settings=FilterSettings(), background=None):
    """The frames with noise, and as the filter gives them."""
    rng = np.random.default_rng(3)
    steady = DepthFilter(CAMERA, MODEL, settings, background)
    raw = [np.where(z > 0, z + NOISE * rng.standard_normal(z.shape), 0.0).astype(np.float32) for z in truths]
    return raw, [steady.next(frame) for frame in raw], steady


def errors(frame, truth):
    """Readings against the truth away from the outline [m]."""
    inner = truth > 0
    for axis in (0, 1):
        for way in (-4, 4):
            inner &= np.roll(truth, way, axis) > 0
    return (frame - truth)[inner]


def test_what_stands_still_is_averaged():
    truth = np.full((120, 160), 2.0)
    raw, steady, _ = filtered([truth] * 8, background=truth.astype(np.float32))
    assert errors(raw[-1], truth).std() == pytest.approx(NOISE, rel=0.1)
    assert errors(steady[-1], truth).std() < 0.6 * NOISE
    assert abs(errors(steady[-1], truth).mean()) < 0.1 * NOISE


@pytest.mark.parametrize("step", [(0.0, 0.0, 0.015), (0.012, 0.0, 0.0), (0.02, -0.01, 0.02)])
def test_what_moves_is_followed_without_lagging(step):
    """The noise falls to less than two thirds, and no part of the motion is left behind."""
    truths = [sphere(np.array((0.0, 0.0, 2.0)) + k * np.array(step)) for k in range(8)]
    _, steady, made = filtered(truths)
    left = errors(steady[-1], truths[-1])
    assert left.std() < 0.65 * NOISE
    assert abs(left.mean()) < 0.4 * NOISE
    assert made.share > 0.6


def test_what_jumps_begins_anew():
    truths = [sphere((0.0, 0.0, 2.0))] * 3 + [sphere((0.0, 0.0, 1.6))]
    raw, steady, made = filtered(truths)
    assert made.share < 0.05
    np.testing.assert_array_equal(steady[-1][raw[-1] == 0], 0.0)
    assert np.abs(errors(steady[-1] - raw[-1] + truths[-1], truths[-1])).mean() < 0.2 * NOISE


def test_readings_are_neither_made_nor_lost():
    rng = np.random.default_rng(1)
    truths = [np.where(rng.random((120, 160)) < 0.7, 2.0, 0.0) for _ in range(4)]
    raw, steady, _ = filtered(truths)
    for before, after in zip(raw, steady, strict=True):
        np.testing.assert_array_equal(before > 0, after > 0)


def test_off_changes_nothing():
    raw, steady, _ = filtered([np.full((120, 160), 2.0)] * 2, FilterSettings(use=False))
    np.testing.assert_array_equal(raw[1], steady[1])
