"""A mirror is good, usable or wrong by what the camera can know of it, and what is wrong is said with its cure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.capture import MirrorPicks
from mirror_scan.core.checks.mirror_quality import judge_mirrors, swapped_points
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.mirrors.mirror import moved, plane_mirror
from mirror_scan.core.mirrors.picked_mirror import MirrorSettings, place_mirror
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate


def scanned(sensor, frames):
    """Fused depth of a virtual scan, and the points picked on its mirrors."""
    capture = simulate(mannequin(), default_rig(sensor=sensor, mirrors=2, frames=frames, seed=3)).capture
    return RgbdImage(one_depth_map(capture)[0], capture.intrinsics), capture.mirrors


def placed(image, picks):
    return [place_mirror(image, one, MirrorSettings()) for one in picks]


@pytest.fixture(scope="module")
def azure():
    return scanned("azure_kinect", 4)


def test_a_mirror_of_little_noise_is_good(azure):
    image, picks = azure
    for quality in judge_mirrors(image, placed(image, picks), picks, "azure_kinect"):
        assert (quality.word, quality.reason) == ("good", None)
        assert 0 < quality.error < 0.002 and quality.noise > 0.0005


@pytest.mark.parametrize("sensor", ["realsense_d455", "kinect_v1"])
def test_what_is_the_cameras_noise_is_not_the_mirrors_fault(sensor):
    image, picks = scanned(sensor, 1)
    mirrors = placed(image, picks)
    assert min(mirror.residual for mirror in mirrors) > 0.012  # more than 12 mm
    for quality in judge_mirrors(image, mirrors, picks, sensor):
        assert quality.word == "usable" and "recording" in quality.reason
    # as much at a camera that measures finely is no noise
    steady, fine = scanned("azure_kinect", 1)
    rough = [replace(mirror, residual=0.02) for mirror in placed(steady, fine)]
    for quality in judge_mirrors(steady, rough, fine, "azure_kinect"):
        assert quality.word == "wrong" and "one plane" in quality.reason


def test_swapped_rows_and_columns_are_told_with_their_cure(azure):
    image, picks = azure
    swapped = [MirrorPicks(one.name, np.asarray(one.frame_pixels)[:, ::-1]) for one in picks]
    mirrors = placed(image, swapped)
    assert min(mirror.residual for mirror in mirrors) < 0.001  # on the floor it fits a plane as well as can be
    for quality in judge_mirrors(image, mirrors, swapped, "azure_kinect"):
        assert quality.word == "wrong" and "rows and columns" in quality.reason and "[column, row]" in quality.reason


def test_swapped_points_that_cannot_be_placed_are_told_too(azure):
    image, picks = azure
    high = np.array([(650.0, 300.0), (652.0, 400.0), (700.0, 350.0)])  # columns of an image 640 wide
    assert swapped_points(image, MirrorPicks("none", high)) is None
    for one in picks:
        assert swapped_points(image, one) is None  # they are not
        told = swapped_points(image, MirrorPicks(one.name, np.asarray(one.frame_pixels)[:, ::-1]))
        assert told is not None and told.mirrors == (one.name,)


def test_a_mirror_that_lies_or_shows_nobody_is_wrong(azure):
    image, picks = azure
    height, width = image.depth.shape
    strip = [(0.4 * width, 0.93 * height), (0.6 * width, 0.93 * height), (0.6 * width, 0.98 * height),
             (0.4 * width, 0.98 * height)]  # fmt: skip
    floor = MirrorPicks("floor", np.array(strip))
    mirrors = placed(image, [*picks, floor])
    right, _, lying = judge_mirrors(image, mirrors, [*picks, floor], "azure_kinect")
    assert right.word == "good" and lying.word == "wrong" and "upright" in lying.reason
    assert lying.reason.mirrors == ("floor",)
    turned = moved(mirrors[0], np.array((0.35, 0.0, 0.0)))  # about its own vertical, by 20°: it shows the wall
    quality, other = judge_mirrors(image, [turned, mirrors[1]], (), "azure_kinect")
    assert quality.word == "wrong" and ("not seen" in quality.reason or "no mirror" in quality.reason)
    assert other.word == "good"


def test_where_nobody_is_no_mirror_is_at_fault():
    """An empty room, of which a rig file is made."""
    body = mannequin()
    away = replace(body, vertices=body.vertices - (0, 30.0, 0))
    capture = simulate(away, default_rig(sensor="azure_kinect", mirrors=2, frames=2, seed=1)).capture
    image = RgbdImage(one_depth_map(capture)[0], capture.intrinsics)
    for quality in judge_mirrors(image, placed(image, capture.mirrors), capture.mirrors, "azure_kinect"):
        assert quality.word == "usable" and "nobody is seen" in quality.reason


def test_an_uncertain_plane_is_told_in_millimetres(azure):
    image, picks = azure
    (mirror, _) = placed(image, picks)
    unsure = replace(mirror, covariance=np.diag((1e-3, 1e-3, 1e-6)))
    (quality,) = judge_mirrors(image, [unsure], picks[:1], "azure_kinect")
    assert quality.word == "wrong" and "uncertain" in quality.reason and 0.05 < quality.error < 0.2


def test_a_mirror_without_a_frame_is_usable(azure):
    image, picks = azure
    (mirror, _) = placed(image, picks)
    for source, refined, words in (("found", False, "no frame is seen"), ("picked", True, "hangs on a wall")):
        bare = replace(mirror, source=source, refined=refined, covariance=np.diag((1e-6, 1e-6, 0.03**2)))
        (quality,) = judge_mirrors(image, [bare], (), "azure_kinect")
        assert quality.word == "usable" and words in quality.reason and "tape" in quality.reason


def test_a_plane_that_was_given_is_judged_by_how_it_stands(azure):
    image, _ = azure
    standing = plane_mirror("given", [0.8, 0.0, 3.0], [-0.5, 0.0, -1.0])
    flat = plane_mirror("flat", [0.0, 0.9, 2.5], [0.0, -1.0, 0.0])
    first, second = judge_mirrors(image, [standing, flat])
    assert (first.word, first.error) == ("good", 0.0) and second.word == "wrong"


def test_without_readings_nothing_is_claimed(azure):
    image, picks = azure
    empty = RgbdImage(np.zeros_like(image.depth), image.intrinsics)
    for quality in judge_mirrors(empty, placed(image, picks), picks, "unknown"):
        assert quality.word != "good"  # nobody can be seen where nothing is read
    assert judge_mirrors(empty, []) == []
