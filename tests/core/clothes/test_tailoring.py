"""Garments on mannequins whose shape and joints are known: off the skin, even, with the openings they must have."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.avatar.pose import bone_matrices, skinned
from mirror_scan.core.avatar.skin_weights import skin_weights, unique_edges
from mirror_scan.core.clothes import KINDS, make_garment
from mirror_scan.core.clothes.body_distance import BodyDistance
from mirror_scan.core.clothes.weight_transfer import dense, garment_weights, top_edge
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.boundary_loops import boundary_loops
from mirror_scan.core.mesh.half_edges import check_sheet, twins
from mirror_scan.core.mesh.normals import vertex_normals
from mirror_scan.core.mesh.self_intersections import self_intersections
from mirror_scan.core.mesh.submesh import triangle_components
from mirror_scan.core.motion import make_clip
from mirror_scan.core.simulation.mannequin import Figure, random_figure, rigged_mannequin

OPENINGS = {"tshirt": 4, "trousers": 3, "skirt": 2}


def body_of(height=1.7, figure=None):
    mesh, skeleton = rigged_mannequin(height, figure or Figure(), 0.016 * height / 1.7)
    return mesh, skeleton, skin_weights(mesh, skeleton)


@pytest.fixture(scope="module")
def usual():
    return body_of()


@pytest.fixture(scope="module", params=["usual", "child", "arms down", "other"])
def body(request, usual):
    if request.param == "usual":
        return usual
    if request.param == "child":
        return body_of(1.15)
    figure = Figure(arm_angle_deg=78.0) if request.param == "arms down" else random_figure(np.random.default_rng(4))
    return body_of(1.7, figure)


@pytest.mark.parametrize("kind", KINDS)
def test_a_garment_lies_around_the_body(body, kind):
    mesh, skeleton, weights = body
    made = make_garment(mesh, skeleton, weights, kind)
    shape = made.mesh
    check_sheet(shape.triangles, twins(shape.triangles, len(shape.vertices)), "garment")
    assert len(boundary_loops(shape.triangles, len(shape.vertices))) == OPENINGS[kind]
    assert triangle_components(shape.triangles, len(shape.vertices))[1] == 1
    distance = BodyDistance(mesh).at(shape.vertices).distance
    arms_rest = skeleton.joints[8, 0] < 0.25 * np.ptp(mesh.vertices[:, 2])  # forearm beside the trunk
    assert np.quantile(distance, 0.01 if arms_rest else 0.0) > 0.003
    assert np.median(distance) < 0.12 and (kind == "skirt" or np.median(distance) < 0.022)
    ends = shape.vertices[unique_edges(shape)]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    usual = np.median(lengths)
    assert 0.007 < usual < 0.021 and lengths.max() < 3 * usual and np.quantile(lengths, 0.01) > 0.3 * usual
    assert len(np.unique(self_intersections(shape.vertices, shape.triangles))) < 0.004 * len(shape.triangles)
    np.testing.assert_allclose(made.weights.weight.sum(axis=1), 1.0, atol=1e-6)
    assert 0.0 <= made.uv.min() and made.uv.max() <= 1.0 and made.uv.shape == (len(shape.triangles), 3, 2)


@pytest.mark.parametrize("kind", KINDS)
def test_pins_are_at_the_edge_it_hangs_on(usual, kind):
    made = make_garment(*usual, kind)
    heights = made.mesh.vertices[:, 2]
    held = made.pinned > 0
    assert 0.02 < held.mean() < 0.35 and made.pinned.max() == 1.0
    assert heights[held].min() > np.quantile(heights, 0.5)
    highest = max(boundary_loops(made.mesh.triangles, len(heights)), key=lambda loop: heights[loop].mean())
    assert made.pinned[highest].min() > 0.95


@pytest.mark.parametrize("kind", ["tshirt", "trousers"])
def test_the_skeleton_alone_keeps_a_tight_piece_on(usual, kind):
    """In the poses of a walk almost nothing of it is in the body, and nothing deep."""
    mesh, skeleton, weights = usual
    made = make_garment(mesh, skeleton, weights, kind, ease=0.006, tight=True)
    clip = make_clip("walk", skeleton)
    for frame in (0, len(clip) // 4):
        matrices = bone_matrices(skeleton, clip.pose(frame))
        posed = Mesh(skinned(mesh.vertices, weights, matrices), mesh.triangles)
        distance = BodyDistance(posed).at(skinned(made.mesh.vertices, made.weights, matrices)).distance
        assert (distance < 0).mean() < 0.01 and np.quantile(distance, 0.002) > -0.006


def test_more_ease_is_wider(usual):
    mesh = usual[0]
    skin = BodyDistance(mesh)
    distances = [
        np.median(skin.at(make_garment(*usual, "trousers", ease=ease).mesh.vertices).distance)
        for ease in (0.004, 0.03)
    ]  # fmt: skip
    assert distances[0] < 0.009 and 0.025 < distances[1] < 0.05


def test_weights_of_any_garment_are_those_of_the_skin_below(usual):
    mesh, _, weights = usual
    shell = Mesh(mesh.vertices + 0.002 * vertex_normals(mesh.vertices, mesh.triangles), mesh.triangles)
    found = garment_weights(shell, mesh, weights)
    difference = np.abs(dense(found) - dense(weights)).sum(axis=1)
    assert np.median(difference) < 0.05 and np.quantile(difference, 0.95) < 0.25


def test_a_garment_without_pins_hangs_on_its_highest_edge():
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.stack((0.2 * np.cos(angle), 0.2 * np.sin(angle)), axis=1)
    vertices = np.concatenate([np.column_stack((ring, np.full(24, z))) for z in (1.0, 0.9, 0.8)])
    one = np.arange(24)
    two = (one + 1) % 24
    rows = [np.column_stack((k + one, k + 24 + one, k + 24 + two)) for k in (0, 24)]
    rows += [np.column_stack((k + one, k + 24 + two, k + two)) for k in (0, 24)]
    pinned = top_edge(Mesh(vertices, np.concatenate(rows).astype(np.int32)), 0.03, 0.07)
    assert (pinned[:24] == 1).all() and (pinned[24:] == 0).all()


def test_what_cannot_be_is_refused(usual):
    with pytest.raises(MirrorScanError, match="cape"):
        make_garment(*usual, "cape")
    with pytest.raises(MirrorScanError, match="ease"):
        make_garment(*usual, "skirt", ease=0.5)
    with pytest.raises(MirrorScanError, match="no faces"):
        garment_weights(Mesh(np.zeros((3, 3)), np.zeros((0, 3), np.int32)), usual[0], usual[2])
