"""Areas averaged against a slow and obvious twin: each pixel cut into a grid of small ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mirror_scan.core.camera.image_resampling import area_resampled


@pytest.mark.parametrize(("wide", "tall", "width", "height"), [(12, 8, 4, 4), (9, 7, 6, 5), (5, 5, 5, 5), (7, 3, 1, 1)])
def test_each_pixel_is_the_mean_of_its_area(wide, tall, width, height):
    image = np.random.default_rng(0).integers(0, 256, (tall, wide, 3)).astype(np.uint8)
    across, down = math.lcm(wide, width), math.lcm(tall, height)
    fine = image.repeat(down // tall, axis=0).repeat(across // wide, axis=1).astype(float)
    expected = fine.reshape(height, down // height, width, across // width, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(area_resampled(image, width, height), expected, atol=0.5 + 1e-6)


def test_fine_stripes_do_not_alias():
    stripes = np.zeros((60, 400, 3), np.uint8)
    stripes[:, ::2] = 200
    assert np.ptp(area_resampled(stripes, 130, 20).astype(int)) < 90  # every fourth would give bands of 0 and 200
    assert np.ptp(area_resampled(stripes, 100, 20)) == 0
    same = np.full((50, 70, 3), 255, np.uint8)
    assert (area_resampled(same, 33, 21) == 255).all()
