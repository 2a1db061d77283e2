"""The tape against scipy's convex hull and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.measurements.plane_cuts import plane_axes
from mirror_scan.core.measurements.tape import DIRECTIONS, lay_tape
from scipy.spatial import ConvexHull


@pytest.mark.parametrize("seed", range(6))
def test_it_is_the_convex_hull(seed):
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=3)
    flat = rng.normal(size=(300, 2)) * (0.2, 0.1)
    points = flat @ np.stack(plane_axes(normal)) + rng.normal(size=3)
    tape = lay_tape(points, normal)
    hull = ConvexHull(flat)
    assert tape.length == pytest.approx(hull.area, rel=1e-3)  # scipy calls a polygon's length its area
    assert tape.length <= hull.area + 1e-12
    assert np.isin(tape.rests_on, hull.vertices).all()


def test_a_circle_and_a_bent_loop_have_their_lengths():
    angle = np.linspace(0, 2 * np.pi, 1000, endpoint=False)
    circle = 0.15 * np.stack((np.cos(angle), np.sin(angle), 0 * angle), axis=1)
    assert lay_tape(circle, np.array([0.0, 0.0, 1.0])).length == pytest.approx(0.3 * np.pi, rel=3e-5)
    square = np.array([(0.0, 0, 0), (1, 0, 0), (1, 0, 1), (0.5, 0, 0.5), (0, 0, 1)])
    assert lay_tape(square, np.array([0.0, 1.0, 0.0])).length == pytest.approx(4.0)


def test_surface_further_out_lengthens_it_by_its_angle():
    """Cauchy: half of a circle pushed out along one direction by d lengthens the tape by 2 d, the integral of cos."""
    angle = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    circle = 0.15 * np.stack((np.cos(angle), np.sin(angle), 0 * angle), axis=1)
    up, moved = np.array([0.0, 0.0, 1.0]), circle + np.where(circle[:, :1] > 0, (0.001, 0.0, 0.0), 0.0)
    before, after = lay_tape(circle, up), lay_tape(moved, up)
    expected = np.maximum(before.outward[:, 0], 0.0).sum() * 2 * np.pi / DIRECTIONS * 0.001
    assert after.length - before.length == pytest.approx(expected, rel=0.03)


def test_one_point_has_a_tape_of_no_length():
    assert lay_tape(np.ones((1, 3)), np.array([0.0, 0.0, 1.0])).length == 0.0
