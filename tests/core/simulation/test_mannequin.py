"""The mannequin is one closed, outward, handle-free surface of the height asked for, whatever its proportions."""

from __future__ import annotations

import networkx
import numpy as np
import pytest
import trimesh
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.numeric.isosurface import surface_nets
from mirror_scan.core.simulation.mannequin import Figure, mannequin, random_figure


def check_closed(vertices, triangles):
    body = trimesh.Trimesh(vertices, triangles, process=False)
    assert body.is_watertight and body.is_winding_consistent
    assert body.volume > 0
    directed = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    assert len(np.unique(directed, axis=0)) == len(directed), "an edge is used twice the same way round"
    assert len(np.unique(triangles)) == len(vertices)
    return body


@pytest.mark.parametrize(
    ("height", "figure", "resolution"),
    [
        (1.70, None, 0.006),
        (1.52, Figure(girth=1.35, arm_angle_deg=78, leg_spread_deg=3, bust=1.0, hip_width=1.15), 0.010),
        (1.95, Figure(girth=0.8, arm_angle_deg=20, elbow_bend_deg=45, leg_spread_deg=22, head_turn_deg=-45), 0.016),
        (1.10, random_figure(np.random.default_rng(7)), 0.009),
        (1.70, Figure(arm_angle_deg=25, arm_forward_deg=70, step_deg=-20, leg_spread_deg=3), 0.012),
    ],
)
def test_closed_handle_free_and_as_tall_as_asked(height, figure, resolution):
    mesh = mannequin(height, figure, resolution)
    body = check_closed(mesh.vertices, mesh.triangles)
    assert body.euler_number == 2 and body.body_count == 1
    assert mesh.vertices[:, 2].min() == 0.0 and mesh.vertices[:, 2].max() == pytest.approx(height, abs=1e-12)
    assert mesh.colors.shape == mesh.vertices.shape and mesh.colors.dtype == np.uint8
    # As heavy as people are: 9 to 26 kg per cubic metre of height (the ponderal index).
    assert 9 < body.volume * 1000 / height**3 < 26


def test_stands_in_the_avatar_frame():
    mesh = mannequin(resolution=0.010)
    x, y, z = mesh.vertices.T
    assert abs(x[z < 0.05].mean()) < 0.005 and abs(y[z < 0.05].mean()) < 0.06
    head = z > 1.50
    nose = mesh.vertices[head][y[head].argmin()]
    assert abs(nose[0]) < 0.02 and nose[1] < -0.09, "it does not face -Y"
    sole = (z < 0.002) & (np.abs(y) < 0.3)
    assert sole.sum() > 100, "the soles are not flat"
    green = (mesh.colors == (60, 190, 110)).all(axis=1)
    assert green.sum() > 50 and (x[green] > 0).all(), "green marks the left"


def test_arms_hang_as_told():
    spans = [np.ptp(mannequin(figure=Figure(arm_angle_deg=a), resolution=0.016).vertices[:, 0]) for a in (25, 45, 70)]
    assert spans[0] > spans[1] + 0.15 > spans[2] + 0.30


def test_arms_reach_forward_and_legs_step_as_told():
    still, reaching, stepping = (
        mannequin(figure=Figure(arm_angle_deg=30, **pose), resolution=0.011).vertices
        for pose in ({}, {"arm_forward_deg": 70}, {"step_deg": 15})
    )
    assert reaching[:, 1].min() < still[:, 1].min() - 0.3 and np.ptp(reaching[:, 0]) < np.ptp(still[:, 0]) - 0.5
    left, right = (stepping[(stepping[:, 2] < 0.01) & (side * stepping[:, 0] > 0)] for side in (1, -1))
    assert len(left) > 20 and len(right) > 20, "a foot is off the floor"
    # the left ahead (-Y) by twice 0.79 m · tan 15°
    assert right[:, 1].mean() - left[:, 1].mean() == pytest.approx(0.42, abs=0.03)


def test_seed_draws_a_figure():
    one, same, other = (mannequin(resolution=0.018, seed=s) for s in (1, 1, 2))
    assert np.array_equal(one.vertices, same.vertices) and np.array_equal(one.colors, same.colors)
    assert one.vertices.shape != other.vertices.shape or not np.allclose(one.vertices, other.vertices)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Figure(arm_angle_deg=95),
        lambda: Figure(girth=float("nan")),
        lambda: Figure(step_deg=30),
        lambda: Figure(skin=(1, 2, 300)),
        lambda: mannequin(height=170),
        lambda: mannequin(resolution=0.0),
    ],
)
def test_refuses_what_cannot_be(make):
    with pytest.raises(MirrorScanError, match="mannequin"):
        make()


def test_surface_nets_are_closed_on_noise():
    """Random signs hold every ambiguous cell there is."""
    rng = np.random.default_rng(5)
    for density in (0.15, 0.5):
        values = np.ones((14, 13, 12), dtype=np.float32)
        values[2:-2, 2:-2, 2:-2] = rng.uniform(-density, 1 - density, (10, 9, 8))
        points, quads = surface_nets(values)
        triangles = np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))
        body = check_closed(points, triangles)
        for vertex in range(len(points)):
            fan = body.vertex_faces[vertex]
            around = triangles[fan[fan >= 0]]
            ring = networkx.Graph(around[around != vertex].reshape(-1, 2).tolist())
            assert networkx.is_connected(ring) and all(d == 2 for _, d in ring.degree), "a vertex joins two sheets"


def test_surface_nets_on_a_sphere():
    grid = np.stack(np.meshgrid(*[np.arange(-12.3, 13)] * 3, indexing="ij"), axis=-1)
    points, quads = surface_nets((np.linalg.norm(grid, axis=-1) - 9.0).astype(np.float32))
    triangles = np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))
    body = check_closed(points, triangles)
    assert body.euler_number == 2
    assert np.abs(np.linalg.norm(points - 12.3, axis=1) - 9.0).max() < 0.2
    assert body.volume == pytest.approx(4 / 3 * np.pi * 9.0**3, rel=0.02)
