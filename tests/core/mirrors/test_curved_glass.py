"""Bowed and thick glass: readings as exact rays make them, undone."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics, RgbdImage, project
from mirror_scan.core.mirrors import Mirror
from mirror_scan.core.mirrors.curved_glass import REFRACTION, behind_front, bow_moves, flattened, without_delay
from mirror_scan.core.mirrors.mirror import oriented, reflect
from mirror_scan.core.mirrors.rig_file import RigFile, read_rig, write_rig

CAMERA = Intrinsics(320, 288, 252.0, 252.0, 159.5, 143.5)
LENGTH = 1.75


def standing(yaw: float = 0.5, **fields) -> Mirror:
    point = np.array((0.4, 0.1, 2.3))
    normal, basis = oriented(np.array((-np.sin(yaw), 0.02, -np.cos(yaw))), point)
    rectangle = np.array(((-0.4, 0.4), (-LENGTH / 2, LENGTH / 2)))
    return Mirror("m", point, normal, basis, rectangle=rectangle, covariance=1e-8 * np.eye(3), **fields)


def bowed(mirror: Mirror, sag: float, rng) -> tuple[np.ndarray, np.ndarray]:
    """Readings and real places (N, 3): rays meet the parabola z = sag (1/3 - 4 y² / L²)."""
    a, b, n = mirror.basis.T
    aim = mirror.point + rng.uniform(-0.35, 0.35, (500, 1)) * a + rng.uniform(-0.8, 0.8, (500, 1)) * b
    ray = aim / np.linalg.norm(aim, axis=1)[:, None]
    k = 4.0 * sag / LENGTH**2
    # local: y = y0 + t dy, z = z0 + t dz, z - sag / 3 + k y² = 0
    y0, z0, dy, dz = -mirror.point @ b, -mirror.point @ n, ray @ b, ray @ n
    A, B, C = k * dy**2, dz + 2.0 * k * y0 * dy, z0 - sag / 3.0 + k * y0**2
    t = 2.0 * C / (-B + np.sqrt(B * B - 4.0 * A * C))
    normal = n + (2.0 * k * (y0 + t * dy))[:, None] * b
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    turned = ray - 2.0 * np.einsum("ni,ni->n", ray, normal)[:, None] * normal
    left = rng.uniform(1.0, 2.5, 500)
    return ray * (t + left)[:, None], ray * t[:, None] + turned * left[:, None]


@pytest.mark.parametrize("sag", [0.003, -0.003, 0.0007])
def test_a_bow_is_undone(sag):
    rng = np.random.default_rng(3)
    mirror = standing()
    read, real = bowed(mirror, sag, rng)
    flat = np.sqrt(((reflect(read, mirror) - real) ** 2).sum(axis=1).mean())
    known = replace(mirror, sag=sag)
    np.testing.assert_allclose(reflect(flattened(read, known), known), real, atol=3e-6)
    assert flat > 1.3 * abs(sag)
    np.testing.assert_allclose(bow_moves(mirror, read) * sag, real - reflect(read, mirror), atol=0.03 * flat)
    # what a sag's error is said to displace is what it does
    stated = replace(mirror, sag_error=abs(sag), covariance=np.zeros((3, 3))).displacement(real)
    assert 0.9 * flat < stated < 1.1 * flat


@pytest.mark.parametrize("thickness", [0.004, 0.006])
def test_thick_glass_is_undone(thickness):
    """Snell's law at the front, silver at the back; a camera that measures time reads the optical path."""
    rng = np.random.default_rng(4)
    front = standing()
    aim = front.point + rng.uniform(-0.35, 0.35, (500, 1)) * front.basis[:, 0]
    aim = aim + rng.uniform(-0.8, 0.8, (500, 1)) * front.basis[:, 1]
    t = np.linalg.norm(aim, axis=1)
    ray, n = aim / t[:, None], front.normal
    cosine = -(ray @ n)
    inside = np.arcsin(np.sqrt(1.0 - cosine**2) / REFRACTION)
    along = ray + cosine[:, None] * n
    along /= np.linalg.norm(along, axis=1)[:, None]
    leaves = aim + (2.0 * thickness * np.tan(inside))[:, None] * along
    left = rng.uniform(1.0, 2.5, 500)
    real = leaves + (ray + 2.0 * cosine[:, None] * n) * left[:, None]
    read = ray * (t + left + 2.0 * thickness * REFRACTION / np.cos(inside))[:, None]
    wrong = np.linalg.norm(reflect(read, front) - real, axis=1).mean()
    assert 2.4 * thickness < wrong < 3.2 * thickness
    thick = behind_front(front, thickness)
    np.testing.assert_allclose(reflect(flattened(read, thick, time_of_flight=True), thick), real, atol=1e-6)
    # the same in two steps, as the program goes: the delay from the depth map, the rest from its points
    pixels = np.rint(project(read, CAMERA)).astype(int)
    depth = np.zeros((CAMERA.height, CAMERA.width), np.float32)
    depth[pixels[:, 1], pixels[:, 0]] = read[:, 2]
    image = RgbdImage(depth, CAMERA)
    delay = (depth - without_delay(image, [thick]).depth)[pixels[:, 1], pixels[:, 0]]
    expected = 2.0 * thickness * (REFRACTION - 1.0 / REFRACTION) / np.cos(inside) * ray[:, 2]
    np.testing.assert_allclose(delay, expected, rtol=0.02)
    assert without_delay(image, [front]) is image


def test_flat_thin_glass_costs_nothing():
    points = np.random.default_rng(0).uniform(2.0, 4.0, (10, 3))
    assert flattened(points, standing()) is points


def test_rig_files_keep_the_glass_and_older_ones_are_read(tmp_path):
    mirror = replace(standing(sag=0.0021, sag_error=0.0002, glass_thickness=0.005), outline=np.zeros((4, 2)))
    path = tmp_path / "rig.json"
    write_rig(path, RigFile(CAMERA, (mirror,)))
    read = read_rig(path).mirrors[0]
    assert (read.sag, read.sag_error, read.glass_thickness) == pytest.approx((0.0021, 0.0002, 0.005))
    content = json.loads(path.read_text(encoding="utf-8"))
    for entry in content["mirrors"]:
        for key in [key for key in entry if "sag_" in key or "thickness" in key or "frame_ahead" in key]:
            del entry[key]
    path.write_text(json.dumps(content), encoding="utf-8")
    assert read_rig(path).mirrors[0].sag == 0.0 and read_rig(path).mirrors[0].glass_thickness == 0.0
