"""Mirrors moved by what is seen both directly and in them: frames that project in front of their glass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mirror_alignment.reflection_alignment import JointSettings, align_reflections
from mirror_scan.core.mirror_detection.detection import find_mirrors
from mirror_scan.core.mirror_detection.frameless_mirrors import frameless_notes
from mirror_scan.core.mirrors.mirror import plane_mirror, reflect, reflection_moves
from mirror_scan.core.mirrors.picked_mirror import place_mirror
from mirror_scan.core.mirrors.wall_behind_frame import on_wall
from mirror_scan.core.pipeline.rig_calibration import calibrate
from mirror_scan.core.simulation.props import wall_behind
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate


def misplaced(mirrors, simulation, body) -> np.ndarray:
    true = {m.name: plane_mirror(m.name, m.point, m.normal) for m in simulation.truth.mirrors}
    apart = [np.linalg.norm(reflect(body, m) - reflect(body, true[m.name]), axis=1) for m in mirrors]
    return np.median(apart, axis=1)


def placed(simulation):
    capture = simulation.capture
    depth = one_depth_map(capture)[0]
    return find_mirrors(RgbdImage(depth, capture.intrinsics)), depth, capture.intrinsics


def test_a_projecting_frame_is_noticed(person):
    simulation = simulate(person, default_rig("azure_kinect", frames=6, frame_depth=0.008, seed=1))
    body = simulation.truth.body.vertices
    before, depth, intrinsics = placed(simulation)
    after, notes = align_reflections(RgbdImage(depth, intrinsics), before)
    wrong, right = misplaced(before, simulation, body), misplaced(after, simulation, body)
    assert (wrong > 0.014).all() and (right <= wrong + 1e-9).all() and right.min() < 0.003
    moved = [a for a, b in zip(after, before, strict=True) if a is not b]
    assert moved and len(notes) == len(moved) and all("behind the front of its frame" in n for n in notes)
    assert all(m.moved_by == ("reflections",) and m.moved == pytest.approx(0.016, abs=0.004) for m in moved)
    assert all(m.moved_by == () and m.moved == 0.0 for m in before)
    unused, nothing = align_reflections(RgbdImage(depth, intrinsics), before, JointSettings(use=False))
    assert unused == before and nothing == ()


@pytest.mark.parametrize("sensor", ["azure_kinect", "kinect_v1", "realsense_d455"])
def test_a_flush_frame_is_left_alone(simulated, sensor):
    before, depth, intrinsics = placed(simulated(sensor))
    after, notes = align_reflections(RgbdImage(depth, intrinsics), before)
    assert notes == () and all(a is b for a, b in zip(after, before, strict=True))


def test_what_has_no_pairs_stays(simulated):
    before, depth, intrinsics = placed(simulated("azure_kinect"))
    for ugly in (np.zeros_like(depth), np.full_like(depth, 3.0)):
        assert align_reflections(RgbdImage(ugly, intrinsics), before)[0] == before
    given = [replace(m, covariance=None) for m in before]
    assert align_reflections(RgbdImage(depth, intrinsics), given)[0] == given and align_reflections(
        RgbdImage(depth, intrinsics), []
    ) == ([], ())


def board(turn: float, thickness: float = 0.002) -> Mesh:
    """A flat board 0.6 m wide and 1.2 m high, turned about the vertical [rad]."""
    x, y, z = np.array((0.3, thickness / 2, 0.6))[:, None] * np.array(
        [(-1, 1, 1, -1, -1, 1, 1, -1), (-1, -1, 1, 1, -1, -1, 1, 1), (-1, -1, -1, -1, 1, 1, 1, 1)]
    )
    c, s = np.cos(turn), np.sin(turn)
    faces = [(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7), (0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5), (2, 3, 7),
             (2, 7, 6), (3, 0, 4), (3, 4, 7)]  # fmt: skip
    return Mesh(np.column_stack((c * x - s * y, s * x + c * y, z + 0.9)), np.array(faces, np.int32))


def test_a_board_tells_where_the_glass_is(person):
    rig = default_rig("azure_kinect", frames=6, frame_depth=0.01, seed=2)
    simulation = simulate(board(0.1), rig)
    body = simulate(person, replace(rig, frames=1)).truth.body.vertices
    found = calibrate(replace(simulation.capture, mirrors=())).mirrors
    assert (misplaced(found, simulation, body) < 0.008).all(), "20 mm by the frames alone, 2 mm of them the board's"


def test_reflection_moves_are_derivatives(simulated):
    mirror = placed(simulated("azure_kinect"))[0][0]
    points = np.random.default_rng(0).uniform(-1, 1, (20, 3)) + (0, 0, 2.5)
    moves, small = reflection_moves(mirror, points), 1e-6
    a, b, n = mirror.basis.T
    for k, (normal, point) in enumerate(
        ((n - small * a, mirror.point), (n - small * b, mirror.point), (n, mirror.point + small * n))
    ):
        turned = plane_mirror("m", point, normal)
        np.testing.assert_allclose(
            (reflect(points, turned) - reflect(points, mirror)) / small, moves[..., k], atol=1e-4
        )


@pytest.mark.parametrize("sensor", ["realsense_d455", "kinect_v1"])
@pytest.mark.parametrize("frame_width", [0.045, 0.0])
def test_a_mirror_on_a_wall(person, sensor, frame_width):
    """The wall is 12 mm behind the glass, less than a reading's noise: a frame is told from it all the same; where
    there is none the wall is what is known, and that is said."""
    rig = default_rig(sensor, frames=10, frame_width=frame_width, seed=7)
    hung = simulate(person, rig, [wall_behind(m, gap=0.012) for m in rig.mirrors])
    mirrors, depth, intrinsics = placed(hung)
    assert len(mirrors) == 2
    if frame_width:
        mirrors += [place_mirror(RgbdImage(depth, intrinsics), picks) for picks in hung.capture.mirrors]
    body = hung.truth.body.vertices
    for mirror, error in zip(mirrors, misplaced(mirrors, hung, body), strict=True):
        promised = mirror.displacement(body)
        assert error < 3.0 * promised
        assert error < 0.008 and promised < 0.008 if frame_width else 0.01 < promised < 0.03
        assert on_wall(mirror) == any(mirror.name in note for note in frameless_notes(mirrors)) == (not frame_width)
