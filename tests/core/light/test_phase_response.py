"""What cameras that measure phase make of two ways: a closed form, and unknown frequencies learnt from a floor."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.light.phase_response import (
    LIGHT_SPEED,
    PhaseResponse,
    fit_response,
    nonnegative_least_squares,
    weighted_by_frequency,
)
from mirror_scan.core.simulation.multipath import decode, phasors
from mirror_scan.core.simulation.optics import TRIPLES
from scipy.optimize import nnls

UNKNOWN = (*TRIPLES, (150.0, 90.0, 20.0), (240.0, 160.0, 40.0), (50.0,))


def read_too_far(ratio, longer, frequencies, own=1.3):
    """By the phasors' sum and the camera's own decoding (N,) [m]."""
    lengths = np.column_stack((np.full(len(ratio), 2.0 * own), 2.0 * own + longer))
    strength = np.column_stack((np.ones(len(ratio)), ratio))
    return decode(phasors(strength, lengths, frequencies), frequencies)[0] - own


@pytest.mark.parametrize("frequency", [30e6, 80e6, 200e6])
@pytest.mark.parametrize("ratio", [0.03, 0.2, 0.7])
def test_two_paths_of_one_frequency(frequency, ratio):
    """The phase of 1 + q exp(iδ), in metres; at most asin(q) of the period c / 2f."""
    longer = np.linspace(0.0, 3.0, 3001)[:, None]
    bias = PhaseResponse(np.array([frequency]), np.ones(1)).bias(np.full_like(longer, ratio), longer)
    turned = np.angle(1.0 + ratio * np.exp(2j * np.pi * frequency * longer[:, 0] / LIGHT_SPEED))
    period = LIGHT_SPEED / (2.0 * frequency)
    np.testing.assert_allclose(bias, turned / (2.0 * np.pi) * period, atol=1e-12)
    assert np.abs(bias).max() <= np.arcsin(ratio) / (2.0 * np.pi) * period + 1e-12


@pytest.mark.parametrize("frequencies", TRIPLES)
def test_known_frequencies_are_mixed_as_the_camera_mixes_them(frequencies):
    """Two other ways at once; so weak that no frequency is a period off."""
    rng = np.random.default_rng(1)
    ratio, longer = rng.uniform(0.0, 0.12, (500, 2)), rng.uniform(0.3, 2.5, (500, 2))
    bias = weighted_by_frequency(tuple(1e6 * f for f in frequencies)).bias(ratio, longer)
    np.testing.assert_allclose(bias, read_too_far(ratio, longer, frequencies), atol=1e-6)


@pytest.mark.parametrize("frequencies", UNKNOWN)
def test_unknown_frequencies_are_learnt(frequencies):
    """From noisy readings of a floor of unknown tilt, some of which are something else's."""
    rng = np.random.default_rng(2)
    ratio, longer = rng.uniform(0.01, 0.5, (1500, 1)), rng.uniform(0.25, 2.2, (1500, 1))
    place = rng.uniform(-1.0, 1.0, (1500, 2))
    drift = np.column_stack((np.ones(1500), place))
    bias = read_too_far(ratio, longer, frequencies) + rng.normal(0.0, 0.003, 1500) + drift @ (0.004, -0.003, 0.002)
    bias[::20] += rng.uniform(-0.1, 0.1, 75)
    read = np.abs(bias) < 0.5  # else a whole period off, and not taken for the floor
    assert read.sum() > 1000
    response, explained = fit_response(ratio[read], longer[read], bias[read], 0.003, drift[read])
    longer = np.linspace(0.3, 2.1, 400)[:, None]
    for q in (0.05, 0.15, 0.35):
        true = read_too_far(np.full_like(longer, q), longer, frequencies)
        off = response.bias(np.full_like(longer, q), longer) - true
        read = np.abs(true) < 0.5
        assert read.sum() > 200
        assert np.sqrt(np.mean(off[read] ** 2)) < 0.15 * np.sqrt(np.mean(true[read] ** 2)) + 2e-4, q
    assert explained > 0.5 and (response.weights > 0.0).all()


def test_a_floor_that_no_other_light_reaches_noticeably_explains_nothing():
    rng = np.random.default_rng(3)
    ratio, longer = rng.uniform(0.01, 0.5, (1500, 1)), rng.uniform(0.25, 2.2, (1500, 1))
    _, explained = fit_response(ratio, longer, rng.normal(0.0, 0.003, 1500), 0.003)
    assert explained < 0.05


@pytest.mark.parametrize("seed", range(6))
def test_nonnegative_least_squares_as_scipy_has_it(seed):
    """Also where columns are nearly the same; and the conditions of Karush, Kuhn and Tucker."""
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(60, 12))
    if seed % 2:
        matrix[:, 6:] = matrix[:, :6] + 1e-3 * matrix[:, 6:]
    right = matrix @ np.maximum(rng.normal(size=12), 0.0) + 0.5 * rng.normal(size=60)
    gram, moment = matrix.T @ matrix, matrix.T @ right
    x = nonnegative_least_squares(gram, moment)
    best = nnls(matrix, right)[1]
    assert (x >= 0.0).all() and np.linalg.norm(matrix @ x - right) == pytest.approx(best, rel=1e-6)
    slope, scale = moment - gram @ x, np.abs(moment).max()
    assert slope.max() < 1e-5 * scale and np.abs(slope[x > 1e-9]).max(initial=0.0) < 1e-5 * scale


def test_nonnegative_least_squares_without_anything_to_gain():
    np.testing.assert_array_equal(nonnegative_least_squares(np.eye(3), -np.ones(3)), 0.0)
    np.testing.assert_array_equal(nonnegative_least_squares(np.eye(3), np.zeros(3)), 0.0)
