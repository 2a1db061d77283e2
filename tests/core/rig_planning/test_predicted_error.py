"""What is predicted follows what it is made of."""

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.rig_planning.area_coverage import area_coverage, body_samples
from mirror_scan.core.rig_planning.predicted_error import guessed, plane_covariance, predicted_error, two_way_bias
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.multipath import decode, phasors
from mirror_scan.core.simulation.optics import TRIPLES
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.sensors import find_sensor


@pytest.fixture(scope="module")
def body():
    return body_samples(mannequin(resolution=0.02), 1024)


def test_the_bias_of_two_ways_is_what_a_camera_decodes(body) -> None:
    rig = default_rig()
    covered = area_coverage(body, rig)
    bias = two_way_bias(covered, rig)
    strength = covered.light * (1.0, *(mirror.reflectivity for mirror in rig.mirrors))
    for view in range(3):
        weak = strength.sum(axis=1) - strength[:, view] < 0.3 * strength[:, view]
        at = np.flatnonzero(covered.seen[:, view] & weak)
        assert len(at) > 100
        length = covered.length[at] + covered.length[at, view][:, None]
        read, spread = decode(phasors(strength[at], length, TRIPLES[0]), TRIPLES[0])
        kept = spread < 0.04  # others the camera gives up: their wrap numbers are wrong
        assert kept.sum() > 100
        assert np.abs(read - covered.length[at, view] - bias[at, view])[kept].max() < 1e-9
    assert np.abs(bias).max() > 0.005


def test_more_noise_less_frame_and_less_view_predict_more_error(body) -> None:
    rig = default_rig(frames=10)
    covered = area_coverage(body, rig)
    usual = predicted_error(body, covered, rig)
    assert predicted_error(body, covered, replace(rig, frames=1)).noise_mm > usual.noise_mm
    frameless = replace(rig, mirrors=tuple(replace(m, frame_width=0.0) for m in rig.mirrors))
    assert predicted_error(body, covered, frameless).plane_mm > 3 * usual.plane_mm
    one = replace(rig, mirrors=rig.mirrors[:1])
    assert predicted_error(body, area_coverage(body, one), one).guessed_mm > 2 * usual.guessed_mm
    assert predicted_error(body, covered, rig, real_light=False).mean_mm < usual.mean_mm
    assert usual.lit_twice > 0.1
    stereo = default_rig("realsense_d455")
    assert predicted_error(body, area_coverage(body, stereo), stereo).lit_twice == 0.0
    nothing = replace(rig, mirrors=(), pan_deg=180.0, room=None)
    blind = predicted_error(body, area_coverage(body, nothing), nothing)
    assert blind.mean_mm == pytest.approx(blind.guessed_mm) and blind.mean_mm > 100


def test_a_planes_covariance_is_that_of_fits_to_noisy_frames() -> None:
    rig = default_rig("kinect_v2", frames=1)
    mirror = rig.mirrors[0]
    wide = replace(mirror, frame_width=0.05)
    covariance = plane_covariance(wide, find_sensor(rig.sensor), rig)
    narrow = plane_covariance(replace(mirror, frame_width=0.0125), find_sensor(rig.sensor), rig)
    assert (np.diag(narrow) > np.diag(covariance)).all()
    assert np.linalg.eigvalsh(covariance).min() > 0
    # the taller side gives the better slope, but for the floor that both share
    assert covariance[1, 1] < covariance[0, 0]


def test_guesses_grow_with_the_distance_to_what_is_seen() -> None:
    seen = np.zeros((1, 3))
    error = guessed(np.array([(0.0, 0, 0), (0.05, 0, 0), (0.2, 0, 0), (0.4, 0, 0)]), seen, np.array([0.001]), 1.7)
    assert error[0] == pytest.approx(0.001) and (np.diff(error) > 0).all() and error[-1] < 0.4
    assert guessed(seen, np.zeros((0, 3)), np.zeros(0), 1.7)[0] == pytest.approx(0.34)
