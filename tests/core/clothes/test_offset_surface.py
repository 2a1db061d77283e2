"""Offset surfaces: at the right distance from shapes of closed form, closed, creases bridged."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from mirror_scan.core.clothes.offset_surface import offset_surface, reached_from_border
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.soundness import mesh_report
from scipy import ndimage


def ball(radius: float, at=(0.0, 0.0, 0.0)) -> Mesh:
    shape = trimesh.creation.icosphere(4, radius)
    return Mesh(np.array(shape.vertices) + at, np.array(shape.faces, np.int32))


@pytest.mark.parametrize("ease", [0.002, 0.015, 0.05])
def test_a_ball_stays_a_ball(ease):
    found = offset_surface(ball(0.12), ease, closing=0.025, spacing=0.0165)
    radius = np.linalg.norm(found.vertices, axis=1)
    assert np.abs(radius - 0.12 - ease).max() < 0.0015
    report = mesh_report(found)
    assert report["watertight"] and report["components"] == 1
    assert trimesh.Trimesh(found.vertices, found.triangles).volume > 0


def test_a_narrow_crease_is_bridged_and_a_wide_gap_is_not():
    def between(distance):
        both = [ball(0.1, (x, 0, 0)) for x in (-distance / 2, distance / 2)]
        count = len(both[0].vertices)
        mesh = Mesh(
            np.concatenate([one.vertices for one in both]),
            np.concatenate([both[0].triangles, both[1].triangles + count]).astype(np.int32),
        )
        found = offset_surface(mesh, 0.01, closing=0.03, spacing=0.01)
        return mesh_report(found), found

    report, found = between(0.21)
    waist = np.hypot(*found.vertices[np.abs(found.vertices[:, 0]) < 0.006, 1:].T)
    # a ball of radius 0.03 rolled into the crease between two of radius 0.11 touches the axis' plane here
    assert report["components"] == 1 and waist.mean() == pytest.approx(np.sqrt(0.14**2 - 0.105**2) - 0.03, abs=0.002)
    assert between(0.32)[0]["components"] == 2


def test_cells_reached_from_the_border_are_as_scipy_labels_them():
    rng = np.random.default_rng(0)
    for share in (0.3, 0.5, 0.7):
        free = rng.random((14, 11, 9)) < share
        label, _ = ndimage.label(free)
        inner = np.ones(free.shape, bool)
        inner[1:-1, 1:-1, 1:-1] = False
        truth = np.isin(label, np.setdiff1d(label[inner], 0))
        assert (reached_from_border(free) == truth).all()
