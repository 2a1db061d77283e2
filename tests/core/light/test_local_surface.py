"""Normals and depth of planes and balls from the readings around a pixel."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.light.local_surface import local_surface

LENS = Intrinsics(120, 90, 100.0, 100.0, 59.5, 44.5)
V, U = np.mgrid[0:90, 0:120]
RAYS = np.stack(((U - LENS.cx) / LENS.fx, (V - LENS.cy) / LENS.fy, np.ones(U.shape)), axis=-1)


def fitted(depth, labels=None, trusted=None, reach=0, pixels=None):
    labels = np.where(depth > 0, 0, -1).astype(np.int8) if labels is None else labels
    trusted = depth > 0 if trusted is None else trusted
    rows, columns = np.nonzero(depth > 0) if pixels is None else pixels
    return rows, columns, local_surface(
        depth.astype(np.float32), labels, trusted, rows, columns, LENS.packed, reach
    )  # fmt: skip


def ball(radius=0.4, centre=(0.1, -0.05, 2.0)):
    """z and outward normals of a ball as the camera sees it; 0 beside it."""
    centre = np.array(centre)
    a, b, c = (RAYS**2).sum(-1), RAYS @ centre, centre @ centre - radius**2
    root = b * b - a * c
    z = np.where(root > 0, (b - np.sqrt(np.maximum(root, 0.0))) / a, 0.0)
    return z, (RAYS * z[..., None] - centre) / radius


@pytest.mark.parametrize("normal", [(0.0, 0.0, -1.0), (0.5, 0.3, -0.8), (-0.2, -0.8, -0.6)])
def test_planes_are_met(normal):
    """Their 1/z is linear in the pixel; slopes are pulled to zero by a thousandth."""
    normal = np.array(normal) / np.linalg.norm(normal)
    z = (normal[2] * 2.0) / (RAYS @ normal)
    z = np.where((z > 0.5) & (z < 5.0), z, 0.0)
    rows, columns, out = fitted(z)
    inner = (rows > 4) & (rows < 85) & (columns > 4) & (columns < 115) & (z[rows, columns] < 4.0)
    np.testing.assert_allclose(out[inner, 3], z[rows, columns][inner], rtol=1e-4)
    assert (out[inner, :3] @ normal).min() > np.cos(np.radians(0.5))


def test_balls_to_their_edge():
    z, normals = ball()
    rows, columns, out = fitted(z)
    known = out[:, 3] > 0
    facing = -(normals[rows, columns] * RAYS[rows, columns]).sum(1) / np.linalg.norm(RAYS[rows, columns], axis=1)
    off = np.degrees(np.arccos(np.clip((out[:, :3] * normals[rows, columns]).sum(1), -1.0, 1.0)))
    assert known[facing > 0.2].all()
    assert np.median(off[known & (facing > 0.5)]) < 1.0 and off[known & (facing > 0.5)].max() < 5.0
    assert np.median(off[known & (facing > 0.2)]) < 1.5
    np.testing.assert_allclose(np.linalg.norm(out[known, :3], axis=1), 1.0, atol=1e-9)
    assert (out[known, :3] * RAYS[rows, columns][known]).sum(1).max() < 0.0, "towards the camera"


def test_a_surface_goes_on_where_its_own_reading_is_not_trusted():
    """A reading 3 cm off beside trusted ones: their surface goes on there, as long as one of them is within reach."""
    z, _ = ball()
    spoiled = z.copy()
    column = 80
    spoiled[:, column:] = np.where(z[:, column:] > 0, z[:, column:] + 0.03, 0.0)
    trusted = (z > 0) & (U < column)
    rows = np.arange(35, 50)
    for away in range(2):
        pixels = rows, np.full(len(rows), column + away)
        out = fitted(spoiled, trusted=trusted, reach=2, pixels=pixels)[2]
        step = z[pixels] - z[rows, column - 1]
        assert (np.abs(out[:, 3] - z[pixels]) < 0.5 * step).all(), "nearer than the nearest trusted reading"
    far = fitted(spoiled, trusted=trusted, reach=2, pixels=(rows, np.full(len(rows), column + 2)))[2]
    nothing = fitted(spoiled, trusted=np.zeros_like(trusted), reach=2, pixels=(rows, np.full(len(rows), column)))[2]
    np.testing.assert_array_equal(np.concatenate((far, nothing))[:, 3], 0.0)


def test_other_views_and_other_limbs_do_not_count():
    plane = np.full(U.shape, 2.0)
    split = np.where(U < 60, plane, 1.5)  # another limb half a metre nearer
    out = fitted(split, pixels=(np.array((45,)), np.array((59,))))[2][0]
    assert out[3] == pytest.approx(2.0, abs=1e-4) and out[2] < -0.999
    labels = np.where(U < 60, 0, 1).astype(np.int8)
    bent = np.where(U < 60, plane, plane + 0.01 * (U - 59))  # another view's surface that goes on from it
    out = fitted(bent, labels=labels, pixels=(np.array((45,)), np.array((59,))))[2][0]
    assert out[3] == pytest.approx(2.0, abs=1e-4) and out[2] < -0.999
    alone = np.zeros(U.shape)
    alone[40:42, 50:53] = 2.0
    assert (fitted(alone)[2][:, 3] == 0.0).all(), "six readings fix no quadratic"
