"""What light of two ways makes of readings, predicted from the true body and its true mirrors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.light.phase_response import weighted_by_frequency
from mirror_scan.core.light.surface_light import LitReadings, light_on_surface, placed_readings, shown_surfaces
from mirror_scan.core.mesh.bvh import build_bvh, raycast
from mirror_scan.core.mesh.normals import vertex_normals
from mirror_scan.core.mirrors.mirror import plane_mirror

FREQUENCIES = (165.0, 140.0, 60.0)


@pytest.fixture(scope="module")
def lit(seen, person):
    """Readings of a camera that measures phase, placed by the true planes, and the true body about the camera."""
    one = seen("azure_kinect", ("multipath",), FREQUENCIES)
    mirrors = [plane_mirror(m.name, m.point, m.normal) for m in one.simulation.truth.mirrors]
    labels = np.where(one.inside(), one.views.labels, -1).astype(np.int8)
    response = weighted_by_frequency(tuple(1e6 * f for f in FREQUENCIES))
    readings = placed_readings(LitReadings(one.image, labels, np.zeros(labels.shape, np.bool_), response), mirrors)
    body = person.transformed(np.linalg.inv(one.simulation.truth.camera_to_avatar))
    vertices = np.ascontiguousarray(body.vertices, np.float64)
    return readings, vertices, np.ascontiguousarray(body.triangles, np.int32)


def test_the_bias_of_every_reading_is_predicted(lit):
    readings, vertices, triangles = lit
    shown = shown_surfaces(vertices, triangles, readings)
    light = light_on_surface(readings, vertices, triangles, vertex_normals(vertices, triangles), shown)
    assert light.known.mean() > 0.99
    np.testing.assert_allclose(light.shares[light.known].sum(axis=1), 1.0, atol=1e-6)
    alone, twice = light.known & (light.total == 0), light.known & (light.total > 0.05) & (light.total < 0.6)
    assert twice.sum() > 300 and (light.bias[alone] == 0).all()
    noise = np.median(np.abs(light.behind[alone]))
    raw, left = (np.abs(x[twice]) for x in (light.behind, light.behind - light.bias))
    assert np.median(raw) > 3.0 * noise
    # the mirrors' reflectivity is not known
    assert np.median(left) < 2.0 * noise and np.mean(left) < 0.4 * np.mean(raw), (noise, np.median(left), left.mean())


def test_views_show_what_rays_meet(lit):
    """The pictures of the mesh against rays through it, from where each view's camera seems to stand."""
    readings, vertices, triangles = lit
    tree = build_bvh(vertices, triangles)
    shown = shown_surfaces(vertices, triangles, readings)
    light = light_on_surface(readings, vertices, triangles, vertex_normals(vertices, triangles), shown)
    origins = readings.sources[readings.view]
    t, _, _ = raycast(tree, origins, readings.rays)
    met = np.linalg.norm(readings.points - origins, axis=1) - t
    assert np.isfinite(met[light.known]).mean() > 0.99
    both = light.known & np.isfinite(met) & (light.facing > 0.3)
    assert np.quantile(np.abs(met - light.behind)[both], 0.98) < 0.001


def test_a_camera_that_nothing_is_known_of_predicts_none(lit):

    readings, vertices, triangles = lit
    readings = replace(readings, response=None)
    light = light_on_surface(
        readings,
        vertices,
        triangles,
        vertex_normals(vertices, triangles),
        shown_surfaces(vertices, triangles, readings),
    )
    assert (light.bias == 0).all()
