"""Two mirrors that show the camera: their normals differ by as much as it is shown apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics, RgbdImage, project
from mirror_scan.core.mirror_alignment.own_reflection import align_own_reflections
from mirror_scan.core.mirrors import Mirror
from mirror_scan.core.mirrors.mirror import oriented

CAMERA = Intrinsics(640, 400, 600.0, 600.0, 319.5, 199.5)
ROUGH = np.diag((0.012, 0.012, 0.002)) ** 2


def door(name: str, left: float, right: float, yaw: float) -> Mirror:
    """A cabinet door 0.9 m away between two places across [m], turned by ``yaw`` [rad]."""
    point = np.array(((left + right) / 2, 0.0, 0.9))
    normal, basis = oriented(np.array((-np.sin(yaw), -0.03, -np.cos(yaw))), point)
    half = (right - left) / 2
    box = np.array(((-half, half), (-0.28, 0.28)))
    return Mirror(name, point, normal, basis, rectangle=box, covariance=ROUGH, source="picked")


def shown(doors, seed: int, camera: bool = True) -> RgbdImage:
    """What the doors show: walls that differ, and, where each ray is the normal, the same camera."""
    rng = np.random.default_rng(seed)
    smooth = rng.uniform(60, 200, (50, 80)).repeat(8, axis=0).repeat(8, axis=1)
    picture = np.repeat(smooth[..., None], 3, axis=2) + rng.normal(0, 4, (400, 640, 3))
    piece = rng.uniform(0, 255, (23, 27)).repeat(4, axis=0).repeat(4, axis=1)
    for one in doors if camera else ():
        u, v = np.rint(project(-one.normal[None], CAMERA)[0]).astype(int)
        picture[v - 46 : v + 46, u - 54 : u + 54] = piece[..., None] + rng.normal(0, 4, (92, 108, 3))
    depth = np.full((400, 640), 0.9, np.float32)
    return RgbdImage(depth, CAMERA, picture.clip(0, 255).astype(np.uint8))


def angle(a: Mirror, b: Mirror) -> float:
    return float(np.degrees(np.arccos(a.normal @ b.normal)))


@pytest.mark.parametrize("yaw", [(-0.10, 0.11), (-0.085, 0.13)])
def test_the_angle_of_two_doors_is_that_of_the_cameras_reflections(yaw):
    true = [door("left", -0.40, -0.005, yaw[0]), door("right", 0.005, 0.40, yaw[1])]
    wrong = [door("left", -0.40, -0.005, yaw[0] + 0.03), door("right", 0.005, 0.40, yaw[1] - 0.03)]
    right, notes = align_own_reflections(shown(true, 1), wrong)
    assert abs(angle(*wrong) - angle(*true)) > 3.0 and abs(angle(*right) - angle(*true)) < 0.3
    assert len(notes) == 1 and f"{angle(*right):.1f}°" in str(notes[0])
    assert all(m.moved_by == ("own reflection",) for m in right)


def test_nothing_is_turned_without_a_camera_in_the_glass_or_doubt():
    true = [door("left", -0.40, -0.005, -0.10), door("right", 0.005, 0.40, 0.11)]
    wrong = [door("left", -0.40, -0.005, -0.07), door("right", 0.005, 0.40, 0.08)]
    assert align_own_reflections(shown(true, 2, camera=False), wrong) == (wrong, ())
    sure = [replace(m, covariance=1e-8 * np.eye(3)) for m in wrong]
    assert align_own_reflections(shown(true, 2), sure) == (sure, ())
    assert align_own_reflections(shown(true, 2).without_color(), wrong) == (wrong, ())
    assert align_own_reflections(shown(true, 2), wrong[:1]) == (wrong[:1], ())
