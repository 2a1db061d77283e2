"""A mirror that leans otherwise than its plane shows the floor too high or too low; skin hardly shows a lean."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.checks.view_disagreement import check_agreement, floor_lifts
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.mirrors.mirror import oriented, plane_mirror
from mirror_scan.core.subject.subject_search import find_subject


def warned(simulation, lean_deg: float, which: int) -> tuple[list[str], dict]:
    """What is warned of given planes, one of which leans too much."""
    capture = simulation.capture
    image = RgbdImage(one_depth_map(capture)[0], capture.intrinsics)
    mirrors = []
    for k, true in enumerate(simulation.truth.mirrors):
        normal, basis = oriented(true.normal, true.point)
        normal = normal + (k == which) * np.radians(lean_deg) * basis[:, 1]
        mirrors.append(plane_mirror(true.name, true.point, normal))
    views = find_subject(image, mirrors)
    return [str(text) for text in check_agreement(image, views, mirrors)[1]], floor_lifts(views, len(mirrors))


@pytest.mark.parametrize("sensor", ["ideal", "azure_kinect", "kinect_v1", "realsense_d455"])
def test_true_planes_show_the_floor_where_it_is(simulated, sensor):
    texts, lifts = warned(simulated(sensor), 0.0, 0)
    assert texts == [] and all(abs(lift) < 0.008 for lift in lifts.values())


@pytest.mark.parametrize("sensor", ["ideal", "azure_kinect", "realsense_d455"])
@pytest.mark.parametrize(("lean", "which"), [(1.0, 0), (-1.0, 1)])
def test_a_lean_is_warned_of(simulated, sensor, lean, which):
    """Not with the Kinect v1, which reads no floor where two patterns of light meet."""
    texts, _ = warned(simulated(sensor), lean, which)
    name = simulated(sensor).truth.mirrors[which].name
    assert any(name in text for text in texts), texts
