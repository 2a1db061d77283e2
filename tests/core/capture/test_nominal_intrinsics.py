"""Published lenses: each fits its images, and a sensor that nobody knows is refused."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.capture.nominal_intrinsics import CAMERAS, nominal_camera, published_lenses
from mirror_scan.core.errors import CaptureError


@pytest.mark.parametrize("sensor", ["kinect_v1", "kinect_v2", "azure_kinect", "phone", "realsense_d455"])
def test_a_published_lens_has_its_centre_in_the_middle_and_a_camera_s_field_of_view(sensor):
    lenses = published_lenses(sensor)
    assert lenses and len({(lens.width, lens.height) for lens in lenses}) == len(lenses)
    for lens in lenses:
        assert abs(lens.cx / lens.width - 0.5) < 0.05 and abs(lens.cy / lens.height - 0.5) < 0.09
        across = np.degrees(2 * np.arctan(lens.width / 2 / lens.fx))
        assert 50 < across < 95
    across = [lens.width / lens.fx for lens in lenses]
    assert max(across) / min(across) < 1.02  # sizes of one camera see alike


def test_what_a_size_stands_for_is_a_published_lens():
    for size, (sensor, lens) in CAMERAS.items():
        found = nominal_camera(*size)
        assert found is not None and found[:2] == (lens, sensor) and lens in published_lenses(sensor)


def test_an_unknown_sensor_is_refused():
    with pytest.raises(CaptureError, match="polaroid: no lens of it is known; choose one of kinect_v1"):
        published_lenses("polaroid")
