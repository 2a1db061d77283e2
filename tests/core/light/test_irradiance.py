"""Light at a point from the camera and by mirrors: cos θ / r², the glass's edges, what is in the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.light.irradiance import irradiance, light_sources, path_lengths, ratio_to_own, through_glass
from mirror_scan.core.mirrors.mirror import plane_mirror, reflect

LENS = Intrinsics(160, 120, 110.0, 110.0, 79.5, 59.5)
NOTHING = np.zeros((120, 160), np.float32), np.full((120, 160), -1, np.int8)


def mirror(low=-0.4, high=0.4, tall=0.9, normal=(-0.6, 0.0, -0.8)):
    """0.8 m wide, 0.9 m to the right of the line of sight and 3 m away, turned to it."""
    glass = plane_mirror("right", np.array((0.9, 0.0, 3.0)), np.array(normal))
    return replace(glass, rectangle=np.array(((low, high), (-tall, tall))))


def test_cosine_over_squared_distance_of_either_way():
    glass = mirror()
    points = np.array(((0.0, 0.0, 2.5), (0.1, 0.3, 2.4)))
    tilted = np.array((0.5, 0.0, -np.sqrt(0.75)))
    back = glass.point - points[1]
    normals = np.array((tilted, back / np.linalg.norm(back)))
    light, lengths = irradiance(points, normals, np.array((0, 1)), *NOTHING, [glass], LENS, np.array((0.8,)))
    image = reflect(np.zeros(3), glass)
    assert light[0, 0] == pytest.approx(np.cos(np.radians(30.0)) / 2.5**2)
    assert light[0, 1] == 0.0 and light[1, 0] == 0.0, "each faces away from the other's light"
    away = np.linalg.norm(image - points[1])
    facing = (image - points[1]) @ normals[1] / away
    assert light[1, 1] == pytest.approx(0.8 * facing / away**2)
    np.testing.assert_allclose(lengths, path_lengths(points, light_sources([glass])))
    # as long as camera, glass, point: by a ray traced to where it meets the glass
    share = (glass.point @ glass.normal) / ((points[1] - image) @ glass.normal + glass.point @ glass.normal)
    at = image + (points[1] - image) * ((glass.point - image) @ glass.normal / ((points[1] - image) @ glass.normal))
    assert lengths[1, 1] == pytest.approx(np.linalg.norm(at) + np.linalg.norm(points[1] - at)), share


def test_light_passes_the_glass_alone():
    """A march along the mirror: lit where the ray from the camera's image crosses the rectangle, and nowhere else."""
    glass = mirror()
    image = reflect(np.zeros(3), glass)
    rng = np.random.default_rng(0)
    points = np.column_stack((rng.uniform(-2, 2, 4000), rng.uniform(-2, 2, 4000), rng.uniform(0.5, 4.0, 4000)))
    a, b, n = glass.basis.T
    ahead = (points - glass.point) @ n
    for k in np.flatnonzero(np.abs(ahead) > 0.05):
        t = ((glass.point - image) @ n) / ((points[k] - image) @ n)
        at = image + t * (points[k] - image) - glass.point
        x, y = abs(at @ a), abs(at @ b)
        if min(abs(x - 0.4), abs(y - 0.9)) < 0.02:
            continue  # on the edge
        assert through_glass(points[k : k + 1], glass)[0] == (ahead[k] > 0 and x < 0.4 and y < 0.9)
    endless = replace(glass, rectangle=None)
    np.testing.assert_array_equal(through_glass(points, endless), ahead > 0.0)


def test_what_a_view_shows_in_front_is_in_the_way_of_its_light():
    """For others' points; not for those that the view itself shows, nor where what is near is the point itself."""
    glass = mirror()
    point, up = np.array(((0.0, 0.0, 2.5),)), np.array(((0.0, 0.0, -1.0),))
    depth, labels = NOTHING[0].copy(), NOTHING[1].copy()

    def direct(own=1):
        return irradiance(point, up, np.array((own,)), depth, labels, [glass], LENS, np.ones(1))[0][0, 0]

    assert direct() > 0.0
    labels[55:65, 75:85], depth[55:65, 75:85] = 0, 1.5
    assert direct() == 0.0 and direct(own=0) > 0.0
    depth[55:65, 75:85] = 2.45
    assert direct() > 0.0
    depth[55:65, 75:85] = 0.0
    assert direct() > 0.0


def test_ratios_are_of_the_own_light():
    light = np.array(((2.0, 1.0, 0.0), (0.5, 0.0, 1.0), (0.0, 0.0, 3.0)))
    ratio = ratio_to_own(light, np.array((0, 2, 1)))
    np.testing.assert_allclose(ratio[:2], ((0.0, 0.5, 0.0), (0.5, 0.0, 0.0)))
    assert np.isfinite(ratio).all() and ratio[2, 2] > 1e3, "where the own light is hidden another one's is all there is"
