"""Mirrors half sunk into a wall: the wall is taken for a side of the frame, and must not decide their planes."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mirrors.frame_fit import without_crossing_walls
from mirror_scan.core.mirrors.mirror import plane_mirror, reflect
from mirror_scan.core.mirrors.picked_mirror import place_mirror
from mirror_scan.core.pipeline import Settings
from mirror_scan.core.pipeline.mirror_placement import place_mirrors
from mirror_scan.core.simulation import props
from mirror_scan.core.simulation.scene import FramedMirror, default_rig
from mirror_scan.core.simulation.simulate import Simulation, simulate


def crossing(mirror: FramedMirror, degrees: float, share: float = 0.0) -> Mesh:
    """A wall that hides the outer part of a mirror: from ``share`` of half its width on it stands before its plane."""
    right, up, normal = mirror.axes
    out = np.sign(mirror.centre[0]) * np.sign(right[0])
    angle = np.radians(degrees)
    along = out * right * np.cos(angle) + normal * np.sin(angle)
    facing = np.cross(along, up)
    facing *= np.sign(facing @ normal)
    across = np.cross(up, facing)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack((across, up, facing))
    matrix[:3, 3] = np.array(mirror.centre) + out * mirror.width / 2 * share * right
    low, high = sorted((0.0, 1.2 * float(np.sign(across @ along))))
    return props.box((low, -mirror.centre[2], -0.02), (high, 1.3, 0.0), props.STONE).transformed(matrix)


def displaced(simulation: Simulation, mirrors) -> np.ndarray:
    """By how much each mirror's error moves the reflected body, median [m]."""
    body = simulation.truth.body.vertices[::5]
    true = [plane_mirror(m.name, m.point, m.normal) for m in simulation.truth.mirrors]
    return np.array([
        min(np.median(np.linalg.norm(reflect(body, m) - reflect(body, t), axis=1)) for t in true) for m in mirrors
    ])  # fmt: skip


@pytest.mark.parametrize("sensor", ["azure_kinect", "realsense_d455", "kinect_v1"])
@pytest.mark.parametrize(("degrees", "share"), [(12.0, 0.0), (20.0, 0.3), (30.0, 0.0)])
def test_a_mirror_half_sunk_into_a_wall(person, sensor, degrees, share):
    rig = default_rig(sensor, frames=6, seed=3)
    simulation = simulate(person, rig, [crossing(m, degrees, share) for m in rig.mirrors])
    depth = one_depth_map(simulation.capture)[0]
    mirrors, warnings = place_mirrors(simulation.capture.mirrors, depth, simulation.capture, Settings())
    error = displaced(simulation, mirrors)
    promised = np.array([m.displacement(simulation.truth.body.vertices[::5]) for m in mirrors])
    print(1000 * error, 1000 * promised, warnings)
    assert (error < 0.008).all() and (error < 3.0 * promised).all()
    assert not any(word in text for text in warnings for word in ("bowed", "does not look like"))


@pytest.mark.parametrize("sensor", ["azure_kinect", "realsense_d455", "kinect_v1"])
@pytest.mark.parametrize("case", ["free", "on a wall", "in a corner"])
def test_other_walls_are_left_alone(person, sensor, case):
    rig = default_rig(sensor, frames=4, seed=4)
    walls = {
        "free": [],
        "on a wall": [props.wall_behind(m, gap=0.012) for m in rig.mirrors],
        "in a corner": [crossing(m, 80.0, 1.15) for m in rig.mirrors],
    }[case]
    simulation = simulate(person, rig, walls)
    image = RgbdImage(one_depth_map(simulation.capture)[0], simulation.capture.intrinsics)
    mirrors = [place_mirror(image, m) for m in simulation.capture.mirrors]
    same, kept = without_crossing_walls(image, mirrors)
    assert same is image and all(a is b for a, b in zip(kept, mirrors, strict=True))
