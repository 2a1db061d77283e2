"""Colours beside depth: shifted, blurred, on thin parts; a body before a bright wall whose colours are known."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.patches.outline_colors import ColorSettings, colors_from_inside

WALL, SHIRT, SKIN = (220, 222, 215), (40, 60, 110), (190, 140, 110)
JUMPS = np.array([0.02, 0.02])
V, U = np.mgrid[:240, :320]
TORSO = (np.abs(U - 100) < 40) & (np.abs(V - 120) < 90)
ARM = (np.abs(U - 180) < 5) & (np.abs(V - 120) < 80)
FINGER = (np.abs(U - 220) < 2) & (np.abs(V - 120) < 40)
DISC = (U - 265) ** 2 + (V - 70) ** 2 < 42**2


def scene():
    """Depth, labels (the disc is seen in a mirror) and true colours."""
    body = TORSO | ARM | FINGER | DISC
    depth = np.where(body, 2.0, 3.5).astype(np.float32)
    labels = np.where(DISC, 1, np.where(body, 0, -1)).astype(np.int8)
    color = np.full((*V.shape, 3), WALL, np.uint8)
    color[TORSO], color[ARM], color[FINGER], color[DISC] = SHIRT, SKIN, SKIN, SHIRT
    return depth, labels, color


def error(color, true, where):
    return np.abs(color[where].astype(int) - true[where]).max(axis=-1)


@pytest.mark.parametrize("shift", [(0, 0), (1, 0), (-2, 1), (3, -2), (4, 4), (-4, 0)])
def test_a_shifted_image_leaves_nothing_of_the_wall_on_the_body(shift):
    depth, labels, true = scene()
    moved = np.roll(true, shift[::-1], (0, 1))
    found = colors_from_inside(moved, depth, labels, JUMPS)
    assert error(found, true, labels >= 0).max() == 0  # even on the finger
    if shift != (0, 0):
        assert error(moved, true, labels >= 0).max() > 100
    np.testing.assert_array_equal(found[labels < 0], moved[labels < 0])


def test_colours_that_fit_stay_as_they_are_inside():
    depth, labels, color = scene()
    color[TORSO] = np.random.default_rng(0).integers(20, 90, (TORSO.sum(), 3))
    found = colors_from_inside(color, depth, labels, JUMPS)
    deep = (np.abs(U - 100) < 37) & (np.abs(V - 120) < 87)
    np.testing.assert_array_equal(found[deep], color[deep])
    assert colors_from_inside(color, depth, labels, JUMPS, ColorSettings(least_inset=1)) is color


def test_the_inset_grows_with_what_the_blur_mixes_in():
    depth, labels, true = scene()
    soft = true.astype(float)
    for _ in range(4):
        soft = sum(np.roll(soft, k, axis) for axis in (0, 1) for k in (-1, 0, 1)) / 6
    soft = np.rint(soft).astype(np.uint8)
    found = colors_from_inside(soft, depth, labels, JUMPS)
    rim = TORSO & (np.abs(U - 100) > 36)
    assert np.quantile(error(soft, true, rim), 0.9) > 50
    assert np.quantile(error(found, true, rim), 0.9) < 15


def test_an_arm_before_the_body_keeps_its_own_colour_and_gives_none_away():
    depth, labels, color = scene()
    before = (np.abs(U - 100) < 10) & (np.abs(V - 120) < 60)
    depth[before], color[before] = 1.7, SKIN
    moved = np.roll(color, 3, 1)
    found = colors_from_inside(moved, depth, labels, JUMPS)
    assert error(found, color, TORSO).max() == 0


def test_shading_and_stripes_are_no_shift():
    """A limb that darkens towards its outline before a dark wall, and one with stripes along it."""
    depth, labels, color = scene()
    body = labels >= 0
    color[~body] = (60, 60, 60)
    across = np.abs(U - 100) / 40.0
    shade = np.rint(190 * np.sqrt(np.maximum(1 - 0.8 * across**2, 0)))[..., None] * np.ones(3)
    color[TORSO] = shade.astype(np.uint8)[TORSO]
    color[DISC & (U // 7 % 2 == 0)] = (170, 40, 40)
    found = colors_from_inside(color, depth, labels, JUMPS)
    deep = (np.abs(U - 100) < 34) & (np.abs(V - 120) < 84)
    np.testing.assert_array_equal(found[deep], color[deep])


def test_hair_that_gives_no_reading_is_no_shift_upwards():
    depth, labels, true = scene()
    lost = TORSO & (V < 36)
    depth[lost], labels[lost] = 0, -1
    lost = DISC & (V < 34)
    depth[lost], labels[lost] = 0, -1
    found = colors_from_inside(true, depth, labels, JUMPS)
    assert error(found, true, labels >= 0).max() == 0


def test_pixels_without_a_colour_tell_nothing_and_give_none():
    """A registered image is black where depth has no reading: in a strip beside the body, and here and there on it."""
    depth, labels, true = scene()
    strip = (np.abs(U - 100) < 46) & (np.abs(V - 120) < 96) & ~TORSO
    depth[strip], true[strip] = 0, 0
    spots = TORSO & (U % 9 == 0) & (V % 9 == 0)
    color = true.copy()
    color[spots] = 0
    found = colors_from_inside(np.roll(color, 3, 1), depth, labels, JUMPS)
    assert (found[labels >= 0] == 0).all(axis=-1).sum() <= spots.sum()
    assert np.quantile(error(found, true, ARM | FINGER | DISC), 0.99) == 0


def test_small_and_odd_inputs():
    color = np.random.default_rng(0).integers(0, 255, (6, 5, 3)).astype(np.uint8)
    depth = np.ones((6, 5), np.float32)
    for labels in (np.full((6, 5), -1, np.int8), np.zeros((6, 5), np.int8), np.eye(6, 5, dtype=np.int8) - 1):
        found = colors_from_inside(color, depth, labels, JUMPS)
        assert found.shape == color.shape
        np.testing.assert_array_equal(found[labels < 0], color[labels < 0])
    # a body that fills the picture ends nowhere
    np.testing.assert_array_equal(colors_from_inside(color, depth, np.zeros((6, 5), np.int8), JUMPS), color)
