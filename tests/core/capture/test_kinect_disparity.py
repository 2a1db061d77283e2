"""The formulas of the Kinect v1 meet published values."""

from __future__ import annotations

import numpy as np
from mirror_scan.core.capture.kinect_disparity import depth_of_disparity


def test_kinect_formulas_meet_published_values():
    raw = [500, 800, 900, 950, 1000, 1023]
    published = {
        "linear": [0.557, 1.144, 1.764, 2.419, 3.848, 5.285],
        "tangent": [0.584, 1.195, 1.818, 2.456, 3.779, 5.023],
        "factory": [0.586, 1.194, 1.824, 2.478, 3.864, 5.203],
    }
    for formula, metres in published.items():
        np.testing.assert_allclose(depth_of_disparity(formula)[raw], metres, atol=6e-4)
        assert not depth_of_disparity(formula)[[2047, 1800]].any()
