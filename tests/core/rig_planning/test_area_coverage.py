"""Shares of area against closed forms."""

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.rig_planning.area_coverage import PARTS, area_coverage, body_samples
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.scene import FramedMirror, Rig, default_rig
from scipy.optimize import brentq
from trimesh.creation import icosphere

LENS = Intrinsics(160, 120, 140.0, 140.0, 79.5, 59.5)


def ball(radius: float, height: float) -> Mesh:
    made = icosphere(subdivisions=4, radius=radius)
    return Mesh(np.asarray(made.vertices) + (0, 0, height), np.asarray(made.faces, np.int32))


def seen_of_ball(radius: float, distance: float, steepest_deg: float) -> float:
    """Share of a ball's area that is seen under at most this incidence from this distance to its centre."""
    beyond = brentq(
        lambda a: a + np.arctan2(radius * np.sin(a), distance - radius * np.cos(a)) - np.radians(steepest_deg),
        0.0, np.pi / 2,
    )  # fmt: skip
    return (1.0 - np.cos(beyond)) / 2.0


def test_a_ball_is_seen_by_its_cap_directly_and_through_a_mirror() -> None:
    mirror = FramedMirror("back", (0.6, 1.0, 1.0), (-0.42, -0.9, 0.0), width=1.2, height=1.6)
    rig = Rig(LENS, (0.0, -2.0, 1.0), (mirror,), room=None, sensor="ideal", frames=1)
    found = area_coverage(body_samples(ball(0.3, 1.0), 4000), rig)
    normal = mirror.axes[2]
    image = np.array((0.0, 0.0, 1.0)) - 2.0 * ((np.array((0.0, 0.0, 1.0)) - mirror.centre) @ normal) * normal
    assert found.by_view["direct"] == pytest.approx(seen_of_ball(0.3, 2.0, 75.0), abs=0.006)
    distance = np.linalg.norm(image - rig.camera)
    assert found.by_view["back"] == pytest.approx(seen_of_ball(0.3, distance, 75.0), abs=0.006)
    assert found.share <= sum(found.by_view.values()) + 1e-12
    assert np.allclose(found.length[:, 1].min(), distance - 0.3, atol=0.01)


def test_shares_do_not_depend_on_how_finely_the_mesh_is_divided() -> None:
    coarse = ball(0.3, 1.0)
    triangles = coarse.triangles
    # one octant is divided four times finer: vertices crowd there, area does not
    corners = coarse.vertices[triangles]
    fine = (corners.mean(axis=1) - (0, 0, 1.0) > 0).all(axis=1)
    middle = (corners[fine] + np.roll(corners[fine], -1, axis=1)) / 2
    pieces = [np.stack((corners[fine][:, k], middle[:, k], middle[:, k - 1]), axis=1) for k in range(3)]
    soup = np.concatenate((corners[~fine], *pieces, middle))
    divided = Mesh(soup.reshape(-1, 3), np.arange(3 * len(soup), dtype=np.int32).reshape(-1, 3))
    rig = Rig(LENS, (0.0, -2.0, 1.0), (), room=None, sensor="ideal", frames=1)
    one, other = (area_coverage(body_samples(mesh, 4000), rig).share for mesh in (coarse, divided))
    assert one == pytest.approx(other, abs=0.006)


def test_head_hands_and_feet_of_a_mannequin_are_where_they_are() -> None:
    body = body_samples(mannequin(1.8, resolution=0.02), 2000)
    by_name = {name: body.points[body.part == k] for k, name in enumerate(PARTS)}
    assert by_name["head"][:, 2].min() > 1.5 and by_name["feet"][:, 2].max() < 0.12
    assert (np.abs(by_name["hands"][:, 0]) > 0.35).all() and len(by_name["hands"]) > 30
    assert np.sign(by_name["hands"][:, 0]).min() == -1 and np.sign(by_name["hands"][:, 0]).max() == 1
    covered = area_coverage(body, default_rig())
    assert 0.85 < covered.share < 1.0 and all(0.4 < share <= 1.0 for share in covered.by_part.values())
    pattern = area_coverage(body, default_rig("kinect_v1"))
    assert pattern.share < covered.share - 0.05  # patterns that arrive by two ways spoil readings


def test_a_body_without_area_is_refused() -> None:
    with pytest.raises(MirrorScanError, match="no surface"):
        body_samples(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32)))
