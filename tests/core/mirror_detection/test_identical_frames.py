"""Mirrors that show next to nothing, told by their frames; and what only looks alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mirror_detection.detection import find_mirrors
from mirror_scan.core.mirror_detection.edge_segments import DetectionSettings
from mirror_scan.core.mirror_detection.identical_frames import FrameMeasures, is_pair, same_make
from mirror_scan.core.mirrors.mirror import person_before, plane_mirror, reflect
from mirror_scan.core.simulation.props import box, placed, together
from mirror_scan.core.simulation.rays import PROP
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate

NAN = float("nan")


def clean(capture) -> np.ndarray:
    return one_depth_map(capture)[0]


def misplaced(mirror, truth, body) -> float:
    true = plane_mirror(truth.name, truth.point, truth.normal)
    return float(np.median(np.linalg.norm(reflect(body, mirror) - reflect(body, true), axis=1)))


@pytest.mark.parametrize("angles", [(115.0, -115.0, 175.0), (114.0, -112.0, 152.0)])
def test_a_mirror_in_which_nothing_is_read(person, angles):
    """Behind the person, who hides his own image; and through another one, with the image beyond the reach."""
    simulation = simulate(person, default_rig("kinect_v1", 2.75, mirrors=angles, path_length=5.0, frames=6))
    truth, intrinsics = simulation.truth, simulation.capture.intrinsics
    depth = clean(simulation.capture)
    in_third = depth[(truth.labels == 3) & (depth > 0)]
    assert len(in_third) < 0.05 * max((truth.labels == 3).sum(), 1) + 20, "hardly anything of the body is read in it"
    found = find_mirrors(RgbdImage(depth, intrinsics))
    assert len(found) == 3
    for true in truth.mirrors:
        assert min(misplaced(mirror, true, truth.body.vertices) for mirror in found) < 0.009


def dark_board(width: float, height: float, bar: float):
    """A frame about a black board, its inner edge 12 cm above the floor."""
    w, low, high = width / 2, 0.12, 0.12 + height
    return together(
        box((-w - bar, -0.015, low - bar), (-w, 0.015, high + bar)),
        box((w, -0.015, low - bar), (w + bar, 0.015, high + bar)),
        box((-w, -0.015, low - bar), (w, 0.015, low)),
        box((-w, -0.015, high), (w, 0.015, high + bar)),
        box((-w, 0.005, low), (w, 0.015, high), (0, 0, 0)),
    )


@pytest.mark.parametrize(
    ("size", "bar"), [((0.8, 1.75), 0.06), ((0.8, 1.85), 0.035), ((0.72, 1.75), 0.035), ((1.2, 0.7), 0.02)]
)
def test_dark_boards_are_none(person, size, bar):
    """Black, so that nothing is read in their frames, of the mirrors' measures but for one."""
    rig = default_rig("kinect_v1", 2.75, mirrors=(-115.0,), frames=4)
    simulation = simulate(
        person, replace(rig, room=(-3.2, 3.2, -4.8, 3.4, 2.8)), [placed(dark_board(*size, bar), 1.1, 1.0, -15.0)]
    )
    sight, capture = simulation.truth.sight, simulation.capture
    depth = clean(capture)
    depth[(sight.object == PROP) & (sight.color.max(axis=-1) < 4)] = 0.0
    assert [m.name for m in find_mirrors(RgbdImage(depth, capture.intrinsics))] == ["left"]


def test_an_empty_rig_in_which_nothing_is_read(person):
    """The frames prove each other when the user says that nobody is there, and two windows of a wall do not."""
    rig = default_rig("kinect_v1", 2.75, path_length=5.0, frames=6)
    simulation = simulate(Mesh(person.vertices[:3] + 9.0, np.array([(0, 1, 2)], np.int32)), rig)
    capture, truth = simulation.capture, simulation.truth
    depth = clean(capture)
    depth[(truth.sight.view > 0) & (truth.sight.bounces > 0)] = 0.0
    assert find_mirrors(RgbdImage(depth, capture.intrinsics)) == []
    found = find_mirrors(RgbdImage(depth, capture.intrinsics), settings=DetectionSettings(empty_rig=True))
    assert [m.name for m in found] == ["left", "right"]
    for mirror in found:
        true = next(m for m in truth.mirrors if m.name == mirror.name)
        assert misplaced(mirror, true, person_before(mirror)) < 0.009
    one = frame((0.8, 1.75), (0.04,) * 4)
    assert is_pair(one, frame((0.8, 1.75), (0.04,) * 4, turned=0.6))
    assert not is_pair(one, frame((0.8, 1.75), (0.04,) * 4)), "in one wall"
    assert not is_pair(one, frame((0.8, NAN), (0.04,) * 4, turned=0.6))


def frame(size, bars, level=0.0, turned=0.0, cut=()) -> FrameMeasures:
    """At 3 m, its inner bottom edge at a height."""
    edges = np.array(((0.0, -level - 1.75, 3.0), (0.0, -level, 3.0)))
    bars, at_border = np.array(bars, dtype=float).reshape(2, 2), np.zeros(4, np.bool_)
    at_border[list(cut)] = True
    across = np.array((np.cos(turned), 0.0, np.sin(turned)))
    return FrameMeasures(np.array(size), bars, at_border.reshape(2, 2), edges, across, 0.005)


@pytest.mark.parametrize(
    ("new", "shows", "same"),
    [
        (frame((0.8, 1.75), (0.04,) * 4), False, True),
        (frame((0.8, 1.75), (0.04,) * 4, level=0.3), False, True),
        (frame((0.82, 1.75), (0.04,) * 4), False, False),
        (frame((NAN, 1.75), (NAN, NAN, 0.04, 0.04), turned=0.6), False, True),
        (frame((NAN, 1.75), (NAN, NAN, 0.04, 0.04), turned=0.6, level=0.05), False, False),
        (frame((NAN, 1.75), (NAN, NAN, 0.04, 0.04)), False, False),  # parallel: nothing tells what is level
        (frame((NAN, NAN), (NAN, 0.04, NAN, 0.04), turned=0.6), False, False),
        (frame((NAN, NAN), (NAN, 0.04, NAN, 0.04), turned=0.6), True, True),
        (frame((0.8, 1.75), (0.06,) * 4), True, False),
        (frame((0.8, 1.75), (0.0, 0.0, 0.04, 0.04)), True, False),  # a wall goes on at two sides
        (frame((0.8, 1.75), (0.02, 0.04, 0.04, 0.04)), False, True),  # part of one is hidden
        (frame((0.8, 1.75), (0.02, NAN, NAN, 0.04)), False, False),
        (frame((0.8, 1.75), (0.02, NAN, NAN, 0.04), cut=(0,)), False, True),
    ],
)
def test_one_make(new, shows, same):
    assert same_make(new, frame((0.8, 1.75), (0.04, 0.042, 0.039, 0.04)), shows) is same
