"""The rig of a recording: what most frames say."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.capture import Capture
from mirror_scan.core.light.phase_response import PhaseResponse
from mirror_scan.core.mirrors.mirror import moved, person_before, plane_mirror, reflection_shift
from mirror_scan.core.sequences.rig_placement import _median_mirror, mean_response, still_averaged

CAMERA = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)


def test_the_room_is_averaged_and_who_moves_stays_as_he_stood():
    rng = np.random.default_rng(0)
    captures = []
    for k in range(5):
        depth = 3.0 + 0.005 * rng.standard_normal((48, 64))
        depth[10:40, 10 * k : 10 * k + 12] = 2.0
        captures.append(Capture(depth.astype(np.float32)[None], None, CAMERA))
    background, averaged = still_averaged(captures)
    still = background > 0
    assert still[:8].mean() > 0.9
    assert np.abs(background[still] - 3.0).std() < 0.005 / np.sqrt(5) * 1.2
    for k, capture in enumerate(averaged):
        np.testing.assert_array_equal(capture.depth[0, 10:40, 10 * k : 10 * k + 12], 2.0)
        assert (capture.depth[0][still] > 0).all()


def test_one_wrong_plane_of_five_does_not_count():
    mirror = plane_mirror("left", np.array((-0.8, 0.0, 3.0)), np.array((0.5, 0.0, -1.0)))
    rng = np.random.default_rng(1)
    placed = [moved(mirror, 1e-4 * rng.standard_normal(3)) for _ in range(4)]
    placed.insert(2, moved(mirror, np.array((0.03, -0.02, 0.05))))
    found = _median_mirror(placed)
    assert reflection_shift(person_before(mirror), found, mirror) < 5e-4


def test_the_mean_response_predicts_the_mean():
    responses = [
        PhaseResponse(np.array((10e6, 90e6)), np.array((0.4, 0.5))),
        PhaseResponse(np.array((90e6, 200e6)), np.array((0.7, 0.2))),
    ]
    ratio, longer = np.array([[0.3, 0.1], [0.05, 0.6]]), np.array([[0.8, 1.2], [0.4, 2.0]])
    each = [response.bias(ratio, longer) for response in responses]
    assert mean_response(responses).bias(ratio, longer) == pytest.approx(np.mean(each, axis=0))
