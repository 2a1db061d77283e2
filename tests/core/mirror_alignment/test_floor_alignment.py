"""Mirrors that lean otherwise than their frames say: shown by the floor, which is one however it is seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.mirror_alignment.floor_alignment import FloorSettings, align_floor
from mirror_scan.core.mirrors.mirror import expected_error, moved
from mirror_scan.core.mirrors.picked_mirror import place_mirror

UNSURE = 0.005  # of the lean [rad]


def placed(simulation):
    capture = simulation.capture
    depth = one_depth_map(capture)[0]
    return [place_mirror(RgbdImage(depth, capture.intrinsics), p) for p in capture.mirrors], depth, capture.intrinsics


def leaning(mirrors, by):
    """The mirrors leaning by so much more [rad], which their covariances allow for."""
    return [
        replace(moved(m, np.array((0.0, b, 0.0))), covariance=m.covariance + np.diag((0.0, UNSURE**2, 0.0)))
        for m, b in zip(mirrors, by, strict=True)
    ]


def slopes(mirrors, simulation) -> np.ndarray:
    """By how much each mirror is turned off the true one, about its upright and across [rad]."""
    true = {m.name: m.normal for m in simulation.truth.mirrors}
    return np.array([m.basis[:, :2].T @ (true[m.name] * np.sign(true[m.name] @ m.normal)) for m in mirrors])


@pytest.mark.parametrize("sensor", ["ideal", "azure_kinect", "realsense_d455"])
@pytest.mark.parametrize("by", [(0.008, -0.006), (-0.007, 0.009)])
def test_a_lean_is_taken_back(simulated, sensor, by):
    simulation = simulated(sensor)
    frames, depth, intrinsics = placed(simulation)
    wrong = leaning(frames, by)
    right, notes = align_floor(RgbdImage(depth, intrinsics), wrong)
    assert notes == ()
    before, after = slopes(wrong, simulation), slopes(right, simulation)
    assert (np.abs(before[:, 1]) > 0.005).all() and (np.abs(after[:, 1]) < 0.0012).all(), (before, after)
    # of what turns about the upright and of the distance the floor tells next to nothing
    np.testing.assert_allclose(after[:, 0], before[:, 0], atol=4e-4)
    for m, old in zip(right, wrong, strict=True):
        assert m.moved_by == ("floor",) and m.moved > 0.01 and expected_error(m) < 0.5 * expected_error(old)
        assert np.abs(after[:, 1]).max() < 3.0 * np.sqrt(m.covariance[1, 1]) < UNSURE
        np.testing.assert_allclose(m.basis.T @ m.basis, np.eye(3), atol=1e-12)


def test_mirrors_that_are_certain_stay(simulated):
    simulation = simulated("azure_kinect")
    frames, depth, intrinsics = placed(simulation)
    assert all(a is b for a, b in zip(align_floor(RgbdImage(depth, intrinsics), frames)[0], frames, strict=True))
    doubted = leaning(frames, (0.0, 0.0))  # unsure, though right
    for m, truth in zip(
        align_floor(RgbdImage(depth, intrinsics), doubted)[0], slopes(doubted, simulation), strict=True
    ):
        assert abs(truth[1]) < 0.0012 and m.moved < 0.004
    wrong = leaning(frames, (0.008, -0.006))
    assert align_floor(RgbdImage(depth, intrinsics), wrong, FloorSettings(use=False)) == (wrong, ())
    one, other = align_floor(RgbdImage(depth, intrinsics), [wrong[0], replace(wrong[1], source="rig file")])[0]
    assert one.moved_by == ("floor",) and other.moved_by == ()


def test_without_a_floor_they_stay(simulated):
    simulation = simulated("azure_kinect")
    frames, depth, intrinsics = placed(simulation)
    wrong = leaning(frames, (0.008, -0.006))
    hidden = depth.copy()
    hidden[int(0.55 * len(depth)) :] = 0.0
    for ugly in (np.zeros_like(depth), np.full_like(depth, 3.0), hidden):
        assert align_floor(RgbdImage(ugly, intrinsics), wrong) == (wrong, ())
    given = [replace(m, covariance=None, source="given") for m in wrong]
    assert align_floor(RgbdImage(depth, intrinsics), given) == (given, ()) and align_floor(
        RgbdImage(depth, intrinsics), []
    ) == (
        [],
        (),
    )
