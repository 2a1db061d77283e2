"""Polygons with holes are filled exactly, whatever their shape."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.printing.polygons import convex_hull, fill, inside, signed_area
from scipy.spatial import ConvexHull


def star(rng, middle, radius, count):
    """A ring that no ray from its middle meets twice, counter-clockwise."""
    # no gap of half a turn, beyond which the ring would run around the other side, and might cross itself
    angle = (np.arange(count) + rng.uniform(0.0, 0.45, count)) * 2 * np.pi / count
    reach = radius * rng.uniform(0.3, 1.0, count)
    return np.asarray(middle) + reach[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 5), st.integers(3, 60))
def test_triangles_cover_what_is_left_of_all_rings(seed, holes, corners):
    rng = np.random.default_rng(seed)
    square = np.array(((0, 0), (10, 0), (10, 10), (0, 10)), float)
    rings = [square]
    for k in range(holes):
        rings.append(star(rng, (2 + 3 * (k % 3), 3 + 4 * (k // 3)), 1.4, corners)[::-1])
        if k == 0:  # an island within a hole
            shape = rings[-1]
            middle = np.array((2.0, 3.0))
            rings.append((middle + 0.2 * (shape - middle))[::-1])
    points = np.concatenate(rings)
    ends = np.cumsum([len(ring) for ring in rings])
    numbered = [np.arange(end - len(ring), end) for ring, end in zip(rings, ends, strict=True)]
    if signed_area(points[numbered[-1]]) == 0:
        return
    triangles = fill(points, numbered)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    areas = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert areas.min() > -1e-9
    np.testing.assert_allclose(areas.sum(), sum(signed_area(ring) for ring in rings), rtol=1e-9)
    sides = {(t[k], t[(k + 1) % 3]) for t in triangles.tolist() for k in range(3)}
    assert len(sides) == 3 * len(triangles)
    wanted = {(i, j) for ring in numbered for i, j in zip(ring.tolist(), np.roll(ring, -1).tolist(), strict=True)}
    assert {side for side in sides if side[::-1] not in sides} == wanted  # closed but along the rings


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(4, 80))
def test_hull_and_inside_agree_with_scipy(seed, count):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 2))
    hull = convex_hull(points)
    assert np.isclose(signed_area(hull), ConvexHull(points).volume)
    asked = rng.normal(size=(50, 2)) * 1.5
    equations = ConvexHull(points).equations
    truly = (asked @ equations[:, :2].T + equations[:, 2] < 0).all(axis=1)
    np.testing.assert_array_equal(inside(asked, [hull]), truly)
