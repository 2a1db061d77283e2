"""Bad scenes are told in words, each with what to move; good ones are left in peace."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.camera.noise_models import SENSORS
from mirror_scan.core.capture import open_capture
from mirror_scan.core.checks.scene_advice import check_scene, directions, tilt_by
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.depth.sensor_recognition import recognise
from mirror_scan.core.depth.settings import DepthSettings
from mirror_scan.core.mirrors.mirror import plane_mirror
from mirror_scan.core.mirrors.picked_mirror import place_mirror
from mirror_scan.core.simulation.mannequin import Figure, mannequin
from mirror_scan.core.simulation.props import box, placed
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate
from mirror_scan.core.subject.subject_search import find_subject


def checked(capture, model=None):
    intrinsics = capture.intrinsics
    depth = one_depth_map(capture)[0]
    mirrors = [place_mirror(RgbdImage(depth, intrinsics), m) for m in capture.mirrors]
    views = find_subject(RgbdImage(depth, intrinsics), mirrors)
    model = recognise(capture, DepthSettings())[1] if model is None else model
    told = check_scene(RgbdImage(depth, intrinsics), views, mirrors, model)
    print("\n" + "\n".join(told))
    return told


def scene(person, **changes):
    return simulate(person, default_rig("azure_kinect", frames=2, **changes)).capture


@pytest.mark.parametrize("sensor", ["ideal", "kinect_v1", "azure_kinect", "realsense_d455"])
def test_nothing_is_said_of_a_good_scene(simulated, sensor):
    assert checked(simulated(sensor).capture) == []


def test_nothing_is_said_of_the_good_captures(shared_captures):
    for folder in shared_captures:
        assert checked(open_capture(folder)) == [], folder.name


@pytest.fixture(scope="module")
def shared_captures():
    from pathlib import Path

    folders = sorted((Path(__file__).resolve().parents[4] / "shared" / "data" / "simulated").glob("*/intrinsic.json"))
    if not folders:
        pytest.skip("there is no ../shared/data/simulated beside the checkout")
    return [path.parent for path in folders]


def test_a_mirror_too_small(person):
    told = checked(scene(person, mirror_size=(0.22, 1.75)))
    assert len(told) == 2 and all("too small" in text and "narrower" in text for text in told)
    told = checked(scene(person, mirror_size=(0.8, 0.9)))
    assert len(told) == 2 and all("too small" in text and "shorter" in text for text in told)


@pytest.mark.parametrize(("width", "cut"), [(0.3, True), (0.45, False)])
def test_a_mirror_that_loses_a_hand(person, width, cut):
    told = checked(scene(person, mirror_size=(width, 1.75)))
    assert len(told) == (2 if cut else 0) and all("too small" in text or "partly out" in text for text in told)


def test_out_of_the_mirror(person):
    """Out of both: where to stand instead is told, to within some centimetres."""
    farther = replace(person, vertices=person.vertices + (0, 0.5, 0))
    told = checked(scene(farther))
    assert len(told) == 1 and "“right” and the mirror “left” show only part" in told[0]
    assert abs(int(re.search(r"step (\d+) cm towards the camera", told[0])[1]) - 50) < 8


@pytest.mark.parametrize(("degrees", "edge"), [(9.0, "right"), (-9.0, "left")])
def test_a_mirror_that_is_turned_away(person, degrees, edge):
    """How far to turn it back, and which way."""
    rig = default_rig("azure_kinect", frames=2)
    right, left = rig.mirrors
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    x, y, _ = right.normal
    turned = replace(right, normal=(c * x - s * y, s * x + c * y, 0.0))
    told = checked(simulate(person, replace(rig, mirrors=(turned, left))).capture)
    assert len(told) == 1 and "the subject is partly out of the mirror “right”" in told[0]
    found = re.search(r"turn it by (\d+)° about the vertical, its (left|right) edge forward", told[0])
    assert abs(int(found[1]) - 9) <= 1 and found[2] == edge


def test_a_frame_is_no_glass(person):
    """The picks' rectangle goes to the outer edge of the frame."""
    told = checked(scene(person, mirror_size=(0.28, 1.75), frame_width=0.06))
    assert len(told) == 2 and all("too small" in text for text in told)


def test_hidden_by_the_arms():
    """And the way to move and turn the mirrors that is told mends it."""
    body = mannequin(figure=Figure(arm_angle_deg=40.0), resolution=0.014)
    rig = default_rig("azure_kinect", frames=2, view_angle_deg=150.0, mirror_size=(1.1, 1.9))
    told = checked(simulate(body, rig).capture)
    assert len(told) == 2 and all("hidden by the subject's own arms; hold the arms closer" in text for text in told)
    moved = []
    for mirror, text in zip(rig.mirrors, told, strict=True):
        found = re.search(r"outwards by (\d+) cm and turn it by (\d+)° about the vertical, its (\w+) edge", text)
        assert f"“{mirror.name}”" in text and found[3] == mirror.name
        side = 1.0 if mirror.name == "right" else -1.0
        turn = side * np.radians(int(found[2]))
        (x, y, _), (cx, cy, cz) = mirror.normal, mirror.centre
        normal = (np.cos(turn) * x + np.sin(turn) * y, -np.sin(turn) * x + np.cos(turn) * y, 0.0)
        moved.append(replace(mirror, normal=normal, centre=(cx + side * int(found[1]) / 100, cy, cz)))
    assert checked(simulate(body, replace(rig, mirrors=tuple(moved))).capture) == []


def test_hidden_by_a_thing(person):
    """A board before the mirror."""
    rig = default_rig("azure_kinect", frames=2)
    x, y, _ = rig.mirrors[0].centre
    board = placed(box((-0.15, -0.02, 0.0), (0.15, 0.02, 1.4)), x - 0.1, y - 0.35)
    told = checked(simulate(person, rig, (board,)).capture)
    assert len(told) == 1 and "in the mirror “right” is hidden by something in front of it" in told[0]


def test_a_mirror_that_shows_nobody(person):
    rig = default_rig("azure_kinect", frames=2)
    right, left = rig.mirrors
    turned = replace(left, normal=(0.05, -1.0, 0.0))
    told = checked(simulate(person, replace(rig, mirrors=(right, turned))).capture)
    assert any("“left” does not show the subject" in text and "turn" in text for text in told)


def test_a_mirror_that_leans(person):
    told = checked(scene(person, lean_deg=(6.0, 0.0)))
    assert any("“right” is not vertical" in text and "leans 6° towards" in text for text in told)
    assert not any("“left” is not vertical" in text for text in told)


@given(st.floats(-1.0, 8.0), st.floats(0.1, 2.2), st.floats(-20.0, 3.0))
@settings(deadline=None)
def test_a_tilt_leaves_both_ends_within_the_image(beyond, room, other):
    """Where there is one in whole degrees: what is seen afterwards asks for no tilt back."""
    good = [by for by in range(1, 45) if beyond + room < by <= -other - 2.0]
    told = tilt_by(beyond, room, other, 2.0)
    assert (told in good) if good else told == 0
    assert tilt_by(float("nan"), room, other, 2.0) is None and tilt_by(beyond, room, float("nan"), 2.0) >= 2


@pytest.mark.parametrize(
    ("tilt", "words", "way"),
    [
        (-9.0, "lower border cuts the subject off: the feet are", 1),
        (14.0, "upper border cuts the subject off: the head is", -1),
    ],
)
def test_cut_by_the_image(person, tilt, words, way):
    """And the tilt that is named mends it."""
    wide = {"subject_distance": 2.2, "path_length": 4.5}
    told = [text for text in checked(scene(person, tilt_deg=tilt, **wide)) if words in text]
    found = re.search(r"tilt the camera (up|down) by (\d+)°", told[0])
    assert found[1] == {1: "down", -1: "up"}[way]
    assert checked(scene(person, tilt_deg=tilt + way * int(found[2]), **wide)) == []


def test_beyond_the_camera_s_range(person):
    capture = scene(person)
    depth = np.where(capture.depth > 3.9, 0, capture.depth)  # what the camera reads no more
    told = checked(replace(capture, depth=depth), replace(SENSORS["azure_kinect"], max_range=3.9))
    assert sum("measures well only up to 3.9 m" in text and "closer" in text for text in told) == 2


@pytest.mark.parametrize(("path", "told_of"), [(4.6, 0), (6.2, 2)])
def test_a_way_that_is_too_long(person, path, told_of):
    """Half of it is read, as it is at any distance where two patterns meet, but badly."""
    rig = default_rig("kinect_v1", 2.8, frames=2, path_length=path)
    told = checked(simulate(person, rig).capture)
    assert len(told) == told_of and all("measures well only up to 4.0 m" in t and "1.7 m in total" in t for t in told)


def test_hidden_behind_the_subject(person):
    told = checked(scene(person, mirrors=(172.0,)))
    assert any("is hidden by the subject's own body" in text and "outwards" in text for text in told)


def test_hidden_with_an_edge_of_the_glass(person):
    """The inner edges of both mirrors are behind the body: they are hidden, not too small."""
    told = checked(scene(person, view_angle_deg=165.0))
    assert len(told) == 2 and all("is hidden by the subject's own body" in text for text in told)


def test_mirrors_nearly_parallel(person):
    told = checked(scene(person, mirrors=(112.0, 128.0), mirror_size=(0.5, 1.75)))
    assert any("nearly the same side" in text for text in told)
    assert any("one side of the subject is not seen" in text for text in told)


def test_one_mirror_leaves_a_side_unseen(person):
    told = checked(scene(person, mirrors=(120.0,)))
    assert len(told) == 1 and "one side of the subject is not seen" in told[0] and "add a mirror" in told[0]


def test_directions(simulated):
    simulation = simulated("ideal")
    depth, intrinsics = simulation.capture.depth[0], simulation.capture.intrinsics
    mirrors = [plane_mirror(m.name, m.point, m.normal) for m in simulation.truth.mirrors]
    views = find_subject(
        RgbdImage(depth, intrinsics),
        [place_mirror(RgbdImage(depth, intrinsics), m) for m in simulation.capture.mirrors],
    )
    np.testing.assert_allclose(np.abs(directions(views, mirrors)), (0, 120, 120), atol=2.0)
