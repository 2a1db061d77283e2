"""The rig of a recording: what most frames say."""

from __future__ import annotations

import numpy as np
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


def test_the_mean_response_predicts_the_mean_with_few_frequencies():
    rng = np.random.default_rng(0)
    usual = np.array((18, 26, 98, 106, 194, 202))
    responses = [PhaseResponse(1e6 * (usual + 8 * rng.integers(-1, 2, 6)), rng.uniform(0.1, 0.3, 6)) for _ in range(5)]
    ratio, longer = rng.uniform(0.0, 0.15, (300, 2)), rng.uniform(0.05, 3.0, (300, 2))
    mean = np.mean([response.bias(ratio, longer) for response in responses], axis=0)
    small = np.abs(mean) < 0.03
    made = mean_response(responses)
    assert small.sum() > 100
    assert np.abs(made.bias(ratio, longer) - mean)[small].max() < 0.001
    assert len(made.frequencies) <= 10 < len(np.unique(np.concatenate([r.frequencies for r in responses])))
