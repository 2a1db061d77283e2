"""Readings of a pole in a mirror: those that light bends forward at an edge are found, sound ones are not."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics, RgbdImage
from mirror_scan.core.light.lit_scene import LitScene
from mirror_scan.core.light.outer_readings import standing_out
from mirror_scan.core.mirrors.mirror import plane_mirror
from mirror_scan.core.subject.subject_views import Views

LENS = Intrinsics(120, 90, 250.0, 250.0, 59.5, 44.5)
RADIUS, AWAY = 0.16, 4.0
TOWARDS = np.array((0.08, 0.045, 0.015, 0.004))
"""By so much the outermost pixels' readings are too near [m]."""


def pole(noise, seed=0):
    """z (H, W) of an upright pole, 0 beside it, and the columns of its edges."""
    rng, slope = np.random.default_rng(seed), (np.arange(120) - LENS.cx) / LENS.fx
    square = slope**2 + 1.0
    root = AWAY**2 - square * (AWAY**2 - RADIUS**2)
    z = np.where(root > 0, (AWAY - np.sqrt(np.maximum(root, 0.0))) / square, 0.0)
    columns = np.flatnonzero(z)
    depth = np.tile(z, (90, 1)) + np.where(z > 0, rng.normal(0.0, noise, (90, 120)), 0.0)
    return depth, columns[0], columns[-1]


def found(depth, view=1):
    glass = plane_mirror("right", np.array((0.0, 0.0, 3.0)), np.array((-0.6, 0.0, -0.8)))
    labels = np.where(depth > 0, view, -1).astype(np.int8)
    depth = depth.astype(np.float32)
    views = Views(labels, labels, np.zeros((*depth.shape, 3)), np.array((0.0, -1.0, 0.0)), None, 0.0, np.zeros(3), ())
    return standing_out(LitScene(RgbdImage(depth, LENS), views, [glass]), depth, labels >= 0)


def bent(depth, first):
    depth = depth.copy()
    depth[25:65, first : first + len(TOWARDS)] -= TOWARDS
    return depth


@pytest.mark.parametrize("noise", [0.002])
def test_a_bent_edge_is_found_and_nothing_else(noise):
    depth, first, last = pole(noise)
    assert last - first >= 15
    marked = found(bent(depth, first))
    assert marked[25:65, first : first + 2].mean() > 0.9, "the two that are worst"
    assert not marked[:20].any() and not marked[70:].any() and not marked[:, first + 5 :].any()


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.008])
def test_a_sound_pole_is_left_alone(noise):
    depth, _, _ = pole(noise, seed=1)
    assert found(depth).sum() <= 0.002 * (depth > 0).sum()


def test_what_is_seen_directly_is_left_alone():
    depth, first, _ = pole(0.002)
    assert not found(bent(depth, first), view=0).any()


def test_a_limb_too_thin_to_have_an_inside_is_left_alone():
    depth, first, _ = pole(0.002)
    thin = np.where(np.arange(120) < first + 6, bent(depth, first), 0.0)
    assert not found(thin).any() and not found(np.zeros_like(thin)).any()
