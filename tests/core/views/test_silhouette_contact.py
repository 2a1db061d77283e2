"""Silhouettes: whose background is seen, where a shadow is, and which surface just touches them."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.views.silhouette_contact import contact_cost, outline_of, shadow_width


@pytest.mark.parametrize(("sensor", "baseline"), [("kinect_v1", 0.075), ("azure_kinect", 0.0), ("ideal", 0.0)])
def test_shadows_tell_a_baseline(simulated, sensor, baseline):
    capture = simulated(sensor).capture
    width = shadow_width(one_depth_map(capture)[0], capture.intrinsics.fx)
    assert width == pytest.approx(baseline * capture.intrinsics.fx)


def test_an_outline_ends_where_a_background_begins():
    """A body 20 px wide before a wall; at its right two pixels are frayed, at its left a shadow is 10 px wide."""
    depth = np.full((8, 100), 4.0, np.float32)
    depth[:, 40:60], depth[:, 60:62], depth[:, 30:40] = 2.0, 0.0, 0.0
    body = depth == 2.0
    outline = outline_of(depth, body, 40.0)
    column = 50 - outline.corner[0]
    assert outline.right[3, column] == pytest.approx(60.5) and outline.left[3, column] == pytest.approx(29.5)
    assert outline.behind_left[3, column] == pytest.approx(0.25)
    # inside of the wall the outline is the same
    assert outline.right[3, 70 - outline.corner[0]] == pytest.approx(60.5)


def test_outside_is_worse_than_inside_and_far_inside_proves_nothing():
    touching, inside, outside = (contact_cost(np.full(50, gap)) for gap in (0.0, 3.0, -3.0))
    assert touching < inside < outside
    assert contact_cost(np.append(np.zeros(50), np.full(10, 20.0))) < contact_cost(np.full(60, 3.0))
