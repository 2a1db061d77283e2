"""A closed surface that is wrong where light came two ways is drawn to the readings, corrected by the light it gets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.closing.reading_fit import _free_share, even_normals, fit_to_readings
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.hole_filling.thin_plate_fairing import neighbours
from mirror_scan.core.light.phase_response import weighted_by_frequency
from mirror_scan.core.light.surface_light import LitReadings, light_on_surface, placed_readings, shown_surfaces
from mirror_scan.core.mesh.bvh import build_bvh, closest_point
from mirror_scan.core.mesh.normals import vertex_normals
from mirror_scan.core.mesh.self_intersections import self_intersections
from mirror_scan.core.mirrors.mirror import plane_mirror
from mirror_scan.core.simulation.scene import default_rig, with_real_optics
from mirror_scan.core.simulation.simulate import simulate
from mirror_scan.core.views.free_space import SLACK, FreeSpace

FREQUENCIES = (165.0, 140.0, 60.0)
UP = np.array((0.0, -1.0, 0.0))


@pytest.fixture(scope="module")
def falsified(person):
    """Readings of a body that light reaches two ways, the body, and how strongly each vertex is lit otherwise."""
    rig = default_rig("azure_kinect", frames=8, seed=5)
    made = simulate(person, with_real_optics(rig, FREQUENCIES, ("multipath",)))
    image = RgbdImage(one_depth_map(made.capture)[0], rig.intrinsics)
    response = weighted_by_frequency(tuple(1e6 * f for f in FREQUENCIES))
    labels = np.where(image.depth > 0, made.truth.labels, -1).astype(np.int8)
    mirrors = [plane_mirror(m.name, m.point, m.normal) for m in made.truth.mirrors]
    readings = placed_readings(LitReadings(image, labels, np.zeros(labels.shape, np.bool_), response), mirrors)
    body = person.transformed(np.linalg.inv(made.truth.camera_to_avatar))
    body = replace(
        body, vertices=np.ascontiguousarray(body.vertices, np.float64),
        triangles=np.ascontiguousarray(body.triangles, np.int32),
    )  # fmt: skip
    normals = vertex_normals(body.vertices, body.triangles)
    light = light_on_surface(
        readings, body.vertices, body.triangles, normals, shown_surfaces(body.vertices, body.triangles, readings)
    )
    lit = np.zeros(len(body.vertices))
    corners = body.triangles[light.triangle[light.known]]
    np.maximum.at(lit, corners.ravel(), np.repeat(light.total[light.known], 3))
    return readings, body, lit


def test_what_light_made_wrong_comes_nearer_and_the_rest_stays(falsified):
    """A body that is 8 mm too fat where light reaches it two ways."""
    readings, body, lit = falsified
    start, heads = neighbours(body.triangles, len(body.vertices))
    wrong = np.clip(lit / 0.1, 0.0, 1.0) * (lit < 1.0)
    for _ in range(10):
        wrong = 0.5 * (wrong + np.add.reduceat(wrong[heads], start[:-1]) / np.diff(start))
    swollen = body.vertices + 0.008 * wrong[:, None] * vertex_normals(body.vertices, body.triangles)
    readings = replace(readings, spoiled=np.ones(len(readings.view), np.bool_))  # by what they show themselves
    fitted = fit_to_readings(replace(body, vertices=swollen), readings, UP, None)
    tree = build_bvh(body.vertices, body.triangles)
    before, after = (closest_point(tree, np.ascontiguousarray(v))[0] for v in (swollen, fitted.vertices))
    far = before > 0.004
    assert far.sum() > 100
    assert after[far].mean() < 0.6 * before[far].mean(), (after[far].mean(), before[far].mean())
    np.testing.assert_array_equal(fitted.triangles, body.triangles)


def test_what_is_certain_stays(falsified):
    readings, body, lit = falsified
    fitted = fit_to_readings(body, readings, UP, None)
    moved = np.linalg.norm(fitted.vertices - body.vertices, axis=1)
    assert np.quantile(moved[lit == 0], 0.9) < 0.002
    assert len(self_intersections(fitted.vertices, fitted.triangles)) <= len(
        self_intersections(body.vertices, body.triangles)
    )


def test_the_way_ends_before_space_that_was_seen_empty():
    """A wall 2 m away, seen empty up to 1.97 m; its middle would come 6 cm nearer."""
    lens = (60.0, 60.0, 31.5, 23.5)
    seen = np.full((48, 64), 1.97 + SLACK, np.float32)
    empty = FreeSpace(np.eye(4)[None], np.array([lens]), np.zeros(1), seen, np.zeros(seen.shape, np.int8))
    x, y = np.meshgrid(np.linspace(-0.2, 0.2, 9), np.linspace(-0.2, 0.2, 9))
    vertices = np.column_stack((x.ravel(), y.ravel(), np.full(81, 2.0)))
    corner = np.arange(81).reshape(9, 9)[:-1, :-1].ravel()
    triangles = np.concatenate([corner[:, None] + (0, 1, 9), corner[:, None] + (1, 10, 9)]).astype(np.int32)
    way = np.zeros((81, 3))
    way[40, 2] = -0.06
    share = _free_share(vertices, way, way[:, 2] < 0, empty, *neighbours(triangles, 81))
    assert share[40] == pytest.approx(0.5, abs=0.05)
    assert share[39] < 0.97 and share[0] == 1.0  # what is beside it goes less far, what is far from it goes all the way


def test_nothing_moves_without_a_response(falsified):
    readings, body, _ = falsified
    assert fit_to_readings(body, replace(readings, response=None), UP, None) is body


def test_noise_of_a_surface_does_not_turn_its_normals(person):
    """Normals of a noisy body against those of the smooth one."""
    triangles = np.ascontiguousarray(person.triangles, np.int32)
    start, heads = neighbours(triangles, len(person.vertices))
    true = vertex_normals(person.vertices, triangles)
    noisy = person.vertices + 0.001 * np.random.default_rng(1).standard_normal(person.vertices.shape)
    errors = [
        np.median(
            np.degrees(np.arccos(np.clip((even_normals(noisy, triangles, start, heads, k) * true).sum(1), -1, 1)))
        )
        for k in (0, 4)
    ]
    assert errors[1] < 0.6 * errors[0]
