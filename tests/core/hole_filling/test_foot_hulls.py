"""What was not read of feet is made where the body is, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.hole_filling.foot_hulls import GUESSED, foot_hulls
from mirror_scan.core.mesh import FILL, Mesh
from mirror_scan.core.mesh.bvh import build_bvh, closest_point
from mirror_scan.core.mesh.submesh import keep_triangles
from mirror_scan.core.mesh.surface_distance import sample_surface
from mirror_scan.core.views.view_maps import NOTHING_SEEN

UP = np.array((0.0, 0.0, 1.0))
SIDEWAYS = np.array((0.0, -1.0, 0.0))  # as in a camera's frame


def legs(body: Mesh, turned: bool) -> Mesh:
    """The person's lowest 35 cm as one patch; ``turned`` into a camera's axes."""
    vertices = np.ascontiguousarray(body.vertices, np.float64)
    if turned:
        vertices = np.ascontiguousarray(vertices @ np.array(((1, 0, 0), (0, 0, 1), (0, -1, 0)), np.float64))
    whole = Mesh(
        vertices, body.triangles, np.full(vertices.shape, 120, np.uint8), np.zeros(len(vertices), np.int8),
        np.zeros(len(body.triangles), np.int8),
    )  # fmt: skip
    height = vertices @ (SIDEWAYS if turned else UP)
    return keep_triangles(whole, (height[body.triangles] < 0.35).all(axis=1))


def without(patch: Mesh, low: float, high: float, up: np.ndarray) -> Mesh:
    """The patch with nothing read between two heights, nor of the sole."""
    height = patch.vertices[patch.triangles].mean(axis=1) @ up
    return keep_triangles(patch, ((height < low) | (height > high)) & (height > 0.006))


@pytest.mark.parametrize("turned", [False, True])
def test_an_instep_is_made(person, turned):
    whole, up = legs(person, turned), SIDEWAYS if turned else UP
    read = without(whole, 0.04, 0.095, up)
    made = foot_hulls([read], NOTHING_SEEN.free_space, up, 0.0)
    assert made is not None and (made.view == GUESSED).all() and (made.kind == FILL).all()
    away = closest_point(build_bvh(whole.vertices, whole.triangles), made.vertices)[0]
    assert np.quantile(away, 0.95) < 0.02 and away.mean() < 0.01
    missing, _ = sample_surface(whole, 20_000, 1)
    height = missing @ up
    missing = missing[(height > 0.045) & (height < 0.09)]
    both = [
        np.concatenate((read.vertices, made.vertices)),
        np.concatenate((read.triangles, made.triangles + len(read.vertices))),
    ]
    before = closest_point(build_bvh(read.vertices, read.triangles), missing)[0].mean()
    after = closest_point(build_bvh(both[0], np.ascontiguousarray(both[1].astype(np.int32))), missing)[0].mean()
    assert after < 0.6 * before and after < 0.008


def test_nothing_is_made_of_what_was_read(person):
    whole = legs(person, False)
    assert foot_hulls([without(whole, 1.0, 1.0, UP)], NOTHING_SEEN.free_space, UP, 0.0) is None


def test_nothing_is_made_without_legs(person):
    whole = legs(person, False)
    above = keep_triangles(whole, (whole.vertices[whole.triangles][..., 2] > 0.2).all(axis=1))
    assert foot_hulls([above], NOTHING_SEEN.free_space, UP, 0.0) is None
    # a robe down to the floor
    angle = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    rings = [
        np.column_stack((0.25 * np.cos(angle), 0.25 * np.sin(angle), np.full(200, z)))
        for z in np.linspace(0.01, 0.3, 40)
    ]
    here, after = np.arange(200), np.roll(np.arange(200), -1)
    strips = [np.column_stack((here, after, here + 200)) + 200 * k for k in range(39)]
    robe = Mesh(np.concatenate(rings), np.concatenate(strips).astype(np.int32))
    assert foot_hulls([robe], NOTHING_SEEN.free_space, UP, 0.0) is None


def far_outside(made: Mesh, whole: Mesh) -> float:
    """Area [cm²] of what was made more than 10 mm outside the body."""
    middles = np.ascontiguousarray(made.vertices[made.triangles].mean(axis=1))
    away, triangle, _ = closest_point(build_bvh(whole.vertices, whole.triangles), middles)
    corners = whole.vertices[whole.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[triangle]
    out = ((middles - corners[triangle, 0]) * normals).sum(axis=1) > 0
    corners = made.vertices[made.triangles]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return 1e4 * float(areas[out & (away > 0.01)].sum())


@pytest.mark.parametrize("case", ["arch", "slant"])
def test_nothing_stands_out(person, case):
    """Under an arch on the inner side of a foot, and where a leg slants."""
    whole = legs(person, False)
    vertices = whole.vertices.copy()
    foot = vertices[vertices[:, 2] < 0.05]
    inner = np.clip((np.median(np.abs(foot[:, 0])) - np.abs(vertices[:, 0])) / 0.03, 0.0, 1.0)
    if case == "arch":
        share = (foot[:, 1].max() - vertices[:, 1]) / np.ptp(foot[:, 1])
        hollow = inner * np.sin(np.pi * np.clip((share - 0.2) / 0.5, 0.0, 1.0))
        vertices[:, 2] += 0.024 * hollow * np.clip(1.0 - vertices[:, 2] / 0.05, 0.0, 1.0)
        missing, low, high = inner > 0, 0.0, 0.045
    else:
        vertices[:, 0] += 0.45 * np.sign(vertices[:, 0]) * np.maximum(vertices[:, 2] - 0.09, 0.0)
        missing, low, high = inner < 1, 0.06, 0.13
    height = vertices[:, 2]
    read = replace(whole, vertices=vertices)
    read = keep_triangles(read, ~(missing & (height > low) & (height < high))[whole.triangles].any(axis=1))
    made = foot_hulls([read], NOTHING_SEEN.free_space, UP, 0.0)
    assert made is not None and far_outside(made, replace(whole, vertices=vertices)) < 1.0
