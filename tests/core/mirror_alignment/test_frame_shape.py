"""Frames and walls that are no planes: growth stops beside the picks, and the stated error says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics, RgbdImage, project
from mirror_scan.core.capture import MirrorPicks
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.mirror_alignment.frame_shape import frame_shape, honest_error
from mirror_scan.core.mirrors.curved_glass import flattened
from mirror_scan.core.mirrors.mirror import Mirror, expected_error, long_axis, oriented
from mirror_scan.core.mirrors.picked_mirror import place_mirror
from mirror_scan.core.mirrors.wall_behind_frame import on_wall
from mirror_scan.core.views.view_correspondences import likeness

CAMERA = Intrinsics(640, 480, 520.0, 520.0, 319.5, 239.5)
NOISE = 0.0008


def wall(lift, glass, noise: float = NOISE, distance: float = 1.4) -> RgbdImage:
    """A wall that stands ``lift`` (x, y) in front of z = distance, and mirrors in it that are not read.

    ``glass``: boxes (x0, x1, y0, y1) on it [m].
    """
    v, u = np.indices((CAMERA.height, CAMERA.width))
    x, y = (u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy
    z = np.full(u.shape, distance)
    for _ in range(20):
        z = distance - lift(x * z, y * z)
    place_x, place_y = x * z, y * z
    z = z + np.random.default_rng(0).normal(0.0, noise, z.shape)
    for x0, x1, y0, y1 in glass:
        z[(place_x > x0) & (place_x < x1) & (place_y > y0) & (place_y < y1)] = 0.0
    return RgbdImage(z.astype(np.float32), CAMERA)


def around(box, lift, distance: float = 1.4, off: float = 0.012) -> MirrorPicks:
    """Two picks on each side of a glass, just beside it on the wall."""
    x0, x1, y0, y1 = box
    places = []
    for share in (0.25, 0.75):
        x, y = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
        places += [(x, y0 - off), (x, y1 + off), (x0 - off, y), (x1 + off, y)]
    points = np.array([(x, y, distance - lift(x, y)) for x, y in places])
    return MirrorPicks("door", project(points, CAMERA))


LEFT, RIGHT = (-0.55, -0.06, -0.35, 0.35), (0.06, 0.55, -0.35, 0.35)


def creased(x, y):
    return -np.abs(x) * np.tan(np.radians(4.1))


def turned(mirror) -> float:
    return float(np.degrees(np.arctan2(mirror.normal[0], -mirror.normal[2])))


def test_two_mirrors_on_walls_that_meet_keep_their_own_planes():
    image = wall(creased, (LEFT, RIGHT))
    left, right = (place_mirror(image, around(box, creased)) for box in (LEFT, RIGHT))
    assert abs(turned(left) + 4.1) < 0.6 and abs(turned(right) - 4.1) < 0.6


@pytest.mark.parametrize("sag", [0.0, 0.003, -0.003])
def test_a_frame_that_the_image_cuts_off_shows_its_bow_along_the_side_that_is_seen_whole(sag):
    left, top, bottom, bar, middle = 0.3, -0.55, 0.55, 0.04, 0.55  # and on the right beyond the border [m]

    def lift(x, y):  # of the bars: a parabola along the height about its own best plane, as a bowed strip has it
        return sag * (1.0 / 3.0 - (y / 0.55) ** 2)

    image = wall(lift, ((-9.0, left, -9.0, 9.0), (-9.0, 9.0, -9.0, top), (-9.0, 9.0, bottom, 9.0),
                        (left + bar, 9.0, top + bar, bottom - bar)))  # fmt: skip
    point = np.array((middle, 0.0, 1.4))
    normal, basis = oriented(np.array((0.0, 0.0, -1.0)), point)
    visible = np.sort(np.array((left, 1.4 * (639.0 - CAMERA.cx) / CAMERA.fx)) - middle) @ np.array(((0, -1), (-1, 0)))
    rectangle = np.array((visible, (top, bottom)))
    rectangle[0, 0] -= 2.0  # a points left: so far glass is taken to go on past the border
    mirror = Mirror(
        "door", point, normal, basis, rectangle, residual=NOISE, refined=True, covariance=1e-6 * np.eye(3)
    )  # fmt: skip
    shape = frame_shape(image, mirror)
    assert shape is not None and shape.sag_error < 0.0005
    assert abs(shape.sag - sag) < 3.0 * shape.sag_error + 1e-4
    assert long_axis(mirror)[0] == 1 and long_axis(mirror)[2] == pytest.approx(bottom - top)
    # readings in bowed glass are undone along the height alone: level with its middle only the shift remains
    shown = np.array((middle, 0.0, 3.4))[None]
    there = flattened(shown, replace(mirror, sag=sag))
    assert abs(there[0, 0] - shown[0, 0]) < 1e-3 * abs(sag) / 0.003 + 1e-9


def test_an_uneven_wall_makes_the_error_larger_and_is_warned_of():
    def bulging(x, y):
        return 0.012 * np.cos(5.0 * x) * np.cos(4.0 * y)

    image = wall(bulging, (LEFT,))
    mirror = place_mirror(image, around(LEFT, bulging))
    honest, warning = honest_error(image, mirror)
    assert warning is not None and "uneven" in str(warning) and "door" in str(warning)
    assert expected_error(honest) > 1.2 * expected_error(mirror)


@pytest.mark.parametrize("noise", [0.0005, 0.002, 0.006])
def test_a_flat_wall_is_not_warned_of(noise):
    def flat(x, y):
        return 0.02 * x

    image = wall(flat, (LEFT,), noise)
    mirror = place_mirror(image, around(LEFT, flat))
    assert on_wall(mirror)
    assert honest_error(image, mirror) == (mirror, None)


def test_a_straight_frame_is_not_warned_of_nor_said_to_hang_on_a_wall(simulated):
    for sensor in ("ideal", "azure_kinect", "kinect_v1", "realsense_d455"):
        capture = simulated(sensor).capture
        image = RgbdImage(one_depth_map(capture)[0], capture.intrinsics)
        for picks in capture.mirrors:
            mirror = place_mirror(image, picks)
            assert honest_error(image, mirror) == (mirror, None)
            assert not on_wall(mirror)
            shape = frame_shape(image, mirror)
            assert shape is None or abs(shape.sag) < max(4.0 * shape.sag_error, 0.4 * shape.noise) + 1e-4


def test_noise_that_is_alike_over_a_matching_window_makes_a_frame_less_sure():
    """A frame of 4 cm before a far wall, read again and again by a camera that matches windows of 7 px."""
    v, u = np.indices((CAMERA.height, CAMERA.width))
    x, y = 2.0 * (u - CAMERA.cx) / CAMERA.fx, 2.0 * (v - CAMERA.cy) / CAMERA.fy
    inner, outer = (np.maximum(np.abs(x) - half, np.abs(y) - half - 0.35) for half in (0.4, 0.44))
    frame = (inner > 0.0) & (outer < 0.0)
    inverse = np.where(frame, 0.5, np.where(inner < 0.0, np.nan, 0.25))
    off, said, before = [], [], []
    for seed in range(8):
        noise = np.random.default_rng(seed).standard_normal((CAMERA.height + 6, CAMERA.width + 6))
        for axis in (0, 1):
            noise = np.apply_along_axis(np.convolve, axis, noise, np.ones(7), "valid")
        depth = np.nan_to_num(1.0 / (inverse + 0.0015 / 7.0 * noise)).astype(np.float32)
        image = RgbdImage(depth, CAMERA)
        picks = [(a, b) for a in (-0.42, 0.42) for b in (-0.6, -0.2, 0.2, 0.6)] + [(0.0, -0.77), (0.0, 0.77)]
        points = np.array([(*place, 2.0) for place in picks])
        mirror = place_mirror(image, MirrorPicks("door", project(points, CAMERA)))
        honest, warning = honest_error(image, mirror, likeness(depth)[1])
        assert warning is None
        off.append(np.radians(turned(mirror)))
        said.append(np.sqrt(honest.covariance[0, 0]))
        before.append(np.sqrt(mirror.covariance[0, 0]))
    true = float(np.sqrt(np.mean(np.square(off))))
    assert 0.5 < true / np.mean(said) < 1.7 and np.mean(said) > 1.15 * np.mean(before)
