"""Mirrors found without a click: in simulated captures against their true planes; none where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics, RgbdImage, project
from mirror_scan.core.capture import MirrorPicks
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.depth.sensor_recognition import measuring_principle
from mirror_scan.core.depth.settings import DepthSettings
from mirror_scan.core.errors import MirrorError
from mirror_scan.core.mirror_detection.detection import find_mirrors
from mirror_scan.core.mirror_detection.edge_segments import BOTTOM, LEFT, RIGHT, TOP
from mirror_scan.core.mirror_detection.mirror_at_picks import find_mirror_at
from mirror_scan.core.mirror_detection.mirror_verification import _open_sides
from mirror_scan.core.mirror_detection.rectangle_hypotheses import Hypothesis
from mirror_scan.core.mirrors.mirror import person_before, plane_mirror, reflect
from mirror_scan.core.mirrors.picked_mirror import MirrorSettings, place_mirror
from mirror_scan.core.pipeline import Settings, reconstruct
from mirror_scan.core.pipeline.mirror_placement import align_mirrors, first_mirrors
from mirror_scan.core.simulation.mannequin import Figure, mannequin
from mirror_scan.core.simulation.props import open_door, placed, wall_behind
from mirror_scan.core.simulation.rays import FRAME
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate


def clean(capture) -> np.ndarray:
    return one_depth_map(capture)[0]


def place_all(picks, depth, capture):
    """Mirrors placed, or found, and aligned; and the notes."""
    first = first_mirrors(picks, depth, capture, Settings())
    principle = measuring_principle(capture, DepthSettings())
    return align_mirrors(first, RgbdImage(depth, capture.intrinsics), capture, Settings(), principle)


def misplaced(mirror, truth, body) -> float:
    """Median displacement of the reflected body [m]."""
    true = plane_mirror(truth.name, truth.point, truth.normal)
    return float(np.median(np.linalg.norm(reflect(body, mirror) - reflect(body, true), axis=1)))


def check_found(simulation, limit: float):
    capture, truth = simulation.capture, simulation.truth
    found = find_mirrors(RgbdImage(clean(capture), capture.intrinsics))
    true = {m.name: m for m in truth.mirrors}
    assert {m.name for m in found} == set(true), "as many as there are, named by their side"
    for mirror in found:
        assert mirror.source == "found" and mirror.refined and mirror.outline.shape == (4, 2)
        assert misplaced(mirror, true[mirror.name], truth.body.vertices) < limit
        turn = mirror.basis
        np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1) and mirror.normal @ mirror.point < 0
        glass = [m for m in simulation.rig.mirrors if m.name == mirror.name][0]
        outer = np.array((glass.width, glass.height)) + 2 * glass.frame_width
        assert (np.abs(np.ptp(mirror.rectangle, axis=1) - outer) < 0.12).all(), mirror.rectangle
    return found


def test_lines_in_colour_stand_for_frames_that_are_hardly_read(simulated):
    simulation = simulated("azure_kinect")
    capture, truth = simulation.capture, simulation.truth
    depth = clean(capture)
    # a black frame: seven of ten patches of it give no readings
    patches = np.random.default_rng(1).random((depth.shape[0] // 8, depth.shape[1] // 8)) < 0.7
    frame = (truth.sight.object == FRAME) & (truth.sight.view == 0)
    depth[frame & np.kron(patches, np.ones((8, 8), bool))] = 0
    assert not any(m.refined for m in find_mirrors(RgbdImage(depth, capture.intrinsics))), "no frame by depth alone"
    found = find_mirrors(RgbdImage(depth, capture.intrinsics, capture.color))
    true = {m.name: m for m in truth.mirrors}
    assert {m.name for m in found} == set(true) and all(m.refined for m in found)
    for mirror in found:
        assert misplaced(mirror, true[mirror.name], truth.body.vertices) < 0.004
    other_size = capture.color[::2, ::2]
    assert not any(m.refined for m in find_mirrors(RgbdImage(depth, capture.intrinsics, other_size)))


@pytest.mark.parametrize(
    ("sensor", "limit"), [("ideal", 0.0005), ("azure_kinect", 0.003), ("realsense_d455", 0.006), ("kinect_v1", 0.006)]
)
def test_both_mirrors_are_found(simulated, sensor, limit):
    simulation = simulated(sensor)
    found = check_found(simulation, limit)
    again = find_mirrors(RgbdImage(clean(simulation.capture), simulation.capture.intrinsics))
    for a, b in zip(found, again, strict=True):
        np.testing.assert_array_equal(a.normal, b.normal)


def test_an_avatar_without_a_click(simulated):
    made = reconstruct(replace(simulated("azure_kinect").capture, mirrors=()))
    assert [m["source"] for m in made.report["mirrors"]] == ["found", "found"]
    assert made.report["mesh"]["watertight"] and made.report["mesh"]["components"] == 1


@pytest.mark.parametrize("sensor", ["azure_kinect", "kinect_v1"])
def test_a_room_without_mirrors(person, sensor):
    simulation = simulate(person, replace(default_rig(sensor, frames=2), mirrors=()))
    assert find_mirrors(RgbdImage(clean(simulation.capture), simulation.capture.intrinsics)) == []


def test_pictures_that_show_nothing():
    intrinsics = default_rig("ideal").intrinsics
    shape = (intrinsics.height, intrinsics.width)
    rng = np.random.default_rng(0)
    for depth in (np.zeros(shape), np.full(shape, 2.0), rng.uniform(0.5, 5.0, shape), rng.uniform(0, 1, shape) > 0.999):
        assert find_mirrors(RgbdImage(depth.astype(np.float32), intrinsics)) == []


@pytest.mark.parametrize("count", [1, 2])
def test_one_pick_is_enough_to_say_which(simulated, count):
    simulation = simulated("azure_kinect")
    capture, truth = simulation.capture, simulation.truth
    depth = clean(capture)
    for picks, true in zip(capture.mirrors, truth.mirrors, strict=True):
        few = replace(picks, frame_pixels=picks.frame_pixels[2 : 2 + count])
        mirror = find_mirror_at(RgbdImage(depth, capture.intrinsics), few)
        assert mirror.name == picks.name and mirror.source == "picked" and mirror.refined
        assert misplaced(mirror, true, truth.body.vertices) < 0.003
    with pytest.raises(MirrorError, match=r"left: no straight frame.*\(320, 60\)"):
        find_mirror_at(RgbdImage(depth, capture.intrinsics), MirrorPicks("left", np.array([(320.0, 60.0)])))


def test_a_mirror_cut_by_the_picture_and_one_behind_the_person(person):
    """The camera is panned until the right mirror leaves the picture; the left one is partly hidden by the body."""
    rig = default_rig("azure_kinect", frames=4, roll_deg=5.0, lean_deg=(1.5, -2.0), seed=3)
    rig = replace(rig, pan_deg=-8.0)
    right, left = rig.mirrors
    nearer = replace(left, centre=tuple(np.array(left.centre) + (0.35, 0.1, 0.0)))
    simulation = simulate(person, replace(rig, mirrors=(right, nearer)))
    found = find_mirrors(RgbdImage(clean(simulation.capture), simulation.capture.intrinsics))
    assert [m.name for m in found] == ["left", "right"]
    true = {m.name: m for m in simulation.truth.mirrors}
    for mirror in found:
        assert misplaced(mirror, true[mirror.name], simulation.truth.body.vertices) < 0.006
    assert found[1].outline[:, 0].max() > simulation.capture.intrinsics.width - 30


@pytest.mark.parametrize("sensor", ["azure_kinect", "kinect_v1"])
def test_wide_mirrors_that_show_each_other(person, sensor):
    """Cut off by the picture; in each the other's image carries on the lines of its own frame."""
    simulation = simulate(person, default_rig(sensor, frames=4, mirror_size=(1.5, 2.0), view_angle_deg=112.0))
    found = find_mirrors(RgbdImage(clean(simulation.capture), simulation.capture.intrinsics))
    assert [m.name for m in found] == ["left", "right"]
    true = {m.name: m for m in simulation.truth.mirrors}
    for mirror in found:
        assert misplaced(mirror, true[mirror.name], simulation.truth.body.vertices) < 0.006


@pytest.mark.parametrize("angles", [(115.0, -118.0, -150.0), (121.0, -120.0, -154.0)])
def test_mirrors_that_cross(person, angles):
    """Two mirrors through one another, a side of the one hidden by the other, and its other side by the person."""
    simulation = simulate(person, default_rig("azure_kinect", frames=6, mirrors=angles))
    found = find_mirrors(RgbdImage(clean(simulation.capture), simulation.capture.intrinsics))
    assert len(found) == 3
    body = simulation.truth.body.vertices
    for true in simulation.truth.mirrors:
        assert min(misplaced(mirror, true, body) for mirror in found) < 0.006


def bad_picks(simulation, how: str, rng) -> list[MirrorPicks]:
    """The picks of both mirrors, clicked as people may."""
    picks = [m.frame_pixels + rng.uniform(-0.6, 0.6, m.frame_pixels.shape) for m in simulation.capture.mirrors]
    person_v, person_u = np.nonzero(simulation.truth.labels == 0)
    for pixels in picks:
        which = rng.permutation(len(pixels))[:2]
        angle, on = rng.uniform(0.0, 2.0 * np.pi), rng.integers(0, len(person_u), 2)
        if how == "one slipped":
            pixels[which[0]] += 15.0 * np.array((np.cos(angle), np.sin(angle)))
        elif how == "on the person":
            pixels[which] = np.column_stack((person_u[on], person_v[on]))
        elif how == "on the glass":
            pixels[which] = 0.5 * (pixels[which] + pixels.mean(axis=0))
        elif how == "careless":
            pixels += rng.normal(0.0, 3.0, pixels.shape)
    if how == "in the other list":
        picks[0][:2], picks[1][:2] = picks[1][:2].copy(), picks[0][:2].copy()
    size = np.array(simulation.truth.labels.shape[::-1])
    return [
        replace(m, frame_pixels=np.clip(pixels, 0, size - 1))
        for m, pixels in zip(simulation.capture.mirrors, picks, strict=True)
    ]


@pytest.mark.parametrize(
    "how", ["good", "one slipped", "in the other list", "on the person", "on the glass", "careless"]
)
def test_never_worse_than_the_picks(simulated, how):
    for sensor in ("azure_kinect", "kinect_v1"):
        simulation = simulated(sensor)
        capture, body = simulation.capture, simulation.truth.body.vertices
        depth, true = clean(capture), {m.name: m for m in simulation.truth.mirrors}
        rng = np.random.default_rng(len(how))
        for _ in range(4):
            picks = bad_picks(simulation, how, rng)
            mirrors, notes = place_all(tuple(picks), depth, capture)
            for mirror, one in zip(mirrors, picks, strict=True):
                plain = place_mirror(RgbdImage(depth, capture.intrinsics), one, MirrorSettings(grow=False))
                error, before = (misplaced(m, true[one.name], body) for m in (mirror, plain))
                assert error < before + 1e-3 and mirror.name == one.name
                told = any(text.startswith(one.name) and "pick again" in text for text in notes)
                assert error < 0.012 or told


def test_picks_on_no_frame_are_told_or_put_right(simulated):
    """Four of eight on the person, who stands between: the plane through them is none of a mirror."""
    simulation = simulated("azure_kinect")
    capture, body = simulation.capture, simulation.truth.body.vertices
    v, u = np.nonzero(simulation.truth.labels == 0)
    rng = np.random.default_rng(0)
    depth, true = clean(capture), {m.name: m for m in simulation.truth.mirrors}
    for _ in range(6):
        pixels = capture.mirrors[0].frame_pixels.copy()
        on = rng.integers(0, len(u), 4)
        pixels[rng.permutation(len(pixels))[:4]] = np.column_stack((u[on], v[on]))
        picks = replace(capture.mirrors[0], frame_pixels=pixels)
        try:
            mirrors, notes = place_all((picks,), depth, capture)
        except MirrorError as error:
            assert "pick" in str(error)
            continue
        right = misplaced(mirrors[0], true[picks.name], body) < 0.006
        assert right or any("pick again" in text for text in notes)


def test_what_looks_like_a_mirror():
    """An empty frame before a wall 1 m behind it: flipped, that wall would hang in the air before the camera."""
    intrinsics = default_rig("ideal").intrinsics
    v, u = np.mgrid[: intrinsics.height, : intrinsics.width]
    rays = np.stack(
        ((u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy, np.ones(u.shape)), axis=-1
    )
    for turn in (0.0, 0.5):
        normal = np.array((np.sin(turn), 0.0, -np.cos(turn)))
        z = normal @ (0, 0, 2.5) / (rays @ normal)
        at = rays * z[..., None] - (0, 0, 2.5)
        across, down = np.abs(at @ (np.cos(turn), 0.0, np.sin(turn))), np.abs(at[..., 1])
        frame = (across < 0.45) & (down < 0.8) & ~((across < 0.4) & (down < 0.75))
        floor = 1.0 / np.maximum(rays[..., 1], 1e-6)
        depth = np.minimum(np.where(frame, z, 3.5), floor).astype(np.float32)
        assert find_mirrors(RgbdImage(depth, intrinsics)) == []


def test_a_longer_burst_is_surer(person):
    """Errors fall with the root of the frames, and the covariance says so; edges set the floor."""
    simulation = simulate(person, default_rig("azure_kinect", frames=32, seed=8))
    capture, body = simulation.capture, simulation.truth.body.vertices
    promised = []
    for frames in (1, 4, 16, 32):
        depth = clean(replace(capture, depth=capture.depth[:frames]))
        found = find_mirrors(RgbdImage(depth, capture.intrinsics))
        true = {m.name: m for m in simulation.truth.mirrors}
        promised.append(np.mean([m.displacement(body) for m in found]))
        for mirror in found:
            assert misplaced(mirror, true[mirror.name], body) < 4 * mirror.displacement(body) + 3e-4
    assert promised[1] < 0.7 * promised[0] and promised[2] < 0.4 * promised[0] and promised[3] < promised[1]
    assert promised[2] > 0.1 * promised[0], "no better than the root promises, by far"


@pytest.mark.parametrize("sensor", ["azure_kinect", "kinect_v1", "realsense_d455"])
def test_frameless_mirrors(person, sensor):
    """Hung on a wall, the wall tells their plane."""
    rig = default_rig(sensor, frames=4, frame_width=0.0, seed=4)
    hung = simulate(person, rig, [wall_behind(m) for m in rig.mirrors])
    found = find_mirrors(RgbdImage(clean(hung.capture), hung.capture.intrinsics))
    assert [m.name for m in found] == ["left", "right"]
    true = {m.name: m for m in hung.truth.mirrors}
    for mirror in found:
        assert misplaced(mirror, true[mirror.name], hung.truth.body.vertices) < 0.008, "2 mm of it are the glass's"
        assert (np.abs(np.ptp(mirror.rectangle, axis=1) - (0.8, 1.75)) < 0.06).all(), mirror.rectangle

    def picked(glass, outside: float) -> MirrorPicks:
        to_camera = np.linalg.inv(rig.camera_to_avatar)
        at = np.array([(-1, -1), (0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0)])
        at = at * (np.array((glass.width, glass.height)) / 2 + outside)
        edge = np.array(glass.centre) + at @ glass.axes[:2]
        pixels = project(edge @ to_camera[:3, :3].T + to_camera[:3, 3], hung.capture.intrinsics)
        return MirrorPicks(glass.name, pixels)

    for glass in rig.mirrors:
        mirror = place_mirror(RgbdImage(clean(hung.capture), hung.capture.intrinsics), picked(glass, 0.02))
        assert misplaced(mirror, true[mirror.name], hung.truth.body.vertices) < 0.008
        assert (np.abs(np.ptp(mirror.rectangle, axis=1) - (0.8, 1.75)) < 0.08).all(), "the wall is no frame"


@pytest.mark.parametrize("sensor", ["azure_kinect", "realsense_d455", "kinect_v1"])
def test_frameless_mirrors_clear_of_any_wall(person, sensor):
    """Nothing is at their plane; the figure seen twice tells it, as far as the sensor sees skin both ways. Of the first
    Kinect, whose patterns put one another out there, nothing is made up."""
    simulation = simulate(person, default_rig(sensor, frames=6, frame_width=0.0, view_angle_deg=118.0, seed=4))
    capture, truth = simulation.capture, simulation.truth
    depth, true = clean(capture), {m.name: m for m in truth.mirrors}
    found = find_mirrors(RgbdImage(depth, capture.intrinsics))
    if sensor == "kinect_v1":
        assert found == []
        return
    assert [m.name for m in found] == ["left", "right"]
    for mirror in found:
        error = misplaced(mirror, true[mirror.name], truth.body.vertices)
        expected = mirror.displacement(person_before(mirror))
        assert error < 0.025 and error < 3.0 * expected < 0.09, "sure to what it says"
        assert mirror.source == "found" and not mirror.refined and mirror.points_used > 40
        assert abs(np.ptp(mirror.rectangle[0]) - 0.8) < 0.12 and abs(np.ptp(mirror.rectangle[1]) - 1.87) < 0.12
    placed, notes = place_all((), depth, capture)
    assert max(misplaced(m, true[m.name], truth.body.vertices) for m in placed) < 0.025
    assert all("may be misplaced by" in text and "tape" in text for text in notes)
    edges = tuple(replace(m, frame_pixels=project_corners(simulation, m.name)) for m in capture.mirrors)
    picked, _ = place_all(edges, depth, capture)
    assert max(misplaced(m, true[m.name], truth.body.vertices) for m in picked) < 0.025, "picks on its edges say which"


@pytest.mark.parametrize(
    ("sensor", "y", "turn", "facing"),
    [("azure_kinect", 1.0, 35.0, 90.0), ("realsense_d455", 1.0, 35.0, 270.0), ("realsense_d455", 1.2, 25.0, 90.0)],
)
def test_a_door_in_a_wall_aslant(person, sensor, y, turn, facing):
    """Its posts stand in the wall's plane as a frame does, and the figure behind, flipped, lands close behind the one
    before it: but that one is not seen in it, as it would be in a mirror. Nor is there a rim where the camera's reach
    ends."""
    rig = replace(default_rig(sensor, frames=2, tilt_deg=3.0), mirrors=(), room=(-4.5, 4.5, -5.0, 6.5, 2.8))
    others = [placed(open_door(), -1.1, y, turn), placed(person, -1.45, y + 1.2, facing)]
    capture = simulate(person, rig, others).capture
    assert find_mirrors(RgbdImage(clean(capture), capture.intrinsics)) == []


def project_corners(simulation, name: str) -> np.ndarray:
    """Corners and middles of the sides of a mirror's glass [px]."""
    rig = simulation.rig
    glass = next(m for m in rig.mirrors if m.name == name)
    to_camera = np.linalg.inv(rig.camera_to_avatar)
    at = np.array([(-1, -1), (0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0)])
    edge = np.array(glass.centre) + at * (np.array((glass.width, glass.height)) / 2) @ glass.axes[:2]
    return project(edge @ to_camera[:3, :3].T + to_camera[:3, 3], simulation.capture.intrinsics)


@pytest.mark.parametrize("sensor", ["azure_kinect", "ideal"])
@pytest.mark.parametrize("twin", [True, False])
def test_a_door_with_somebody_behind(person, sensor, twin):
    """Farther depth behind straight jumps, and a figure in it, even of the same build: but no body turned about."""
    rig = replace(default_rig(sensor, frames=2), mirrors=(), room=(-4.5, 4.5, -5.0, 6.5, 2.8))
    other = person if twin else mannequin(1.72, seed=5, resolution=0.014)
    for turn in (0.0, 100.0, 190.0):
        behind = placed(other, 1.35, 1.9, turn)
        capture = simulate(person, rig, [placed(open_door(), 1.0, 0.8, -25.0), behind]).capture
        assert find_mirrors(RgbdImage(clean(capture), capture.intrinsics)) == []


def test_a_side_beyond_the_picture_is_not_missing():
    """Of a rim whose left side is not seen: it may be hidden in the picture, or outside of it."""
    intrinsics = Intrinsics(640, 480, 580.0, 580.0, 319.5, 239.5)
    basis = np.diag((-1.0, 1.0, -1.0))  # left, down, towards the camera
    rectangle, sides = np.array(((-0.4, 0.4), (-0.7, 0.7))), dict.fromkeys((RIGHT, TOP, BOTTOM))
    for left, missing in ((0.0, 1), (-1.1, 1), (-1.35, 0), (-1.6, 0)):
        guess = Hypothesis(np.array((left + 0.4, 0.0, 2.5)), basis, rectangle, sides)
        assert _open_sides(guess, intrinsics, np.inf) == missing


def test_a_glass_that_stands_on_the_floor_is_open_nowhere():
    """Its lower side has no bar: the floor goes on through it."""
    intrinsics = Intrinsics(640, 480, 580.0, 580.0, 319.5, 239.5)
    basis = np.diag((-1.0, 1.0, -1.0))
    sides = dict.fromkeys((LEFT, RIGHT, TOP))
    guess = Hypothesis(np.array((0.0, 0.0, 2.5)), basis, np.array(((-0.4, 0.4), (-0.7, 0.7))), sides)
    assert _open_sides(guess, intrinsics, np.inf) == 1 and _open_sides(guess, intrinsics, 0.65) == 0


@pytest.mark.parametrize("sensor", ["kinect_v1", "azure_kinect"])
def test_mirrors_on_the_floor_cut_off_by_the_border(sensor):
    """Upper and inner bar are seen; the outer one is out of the picture, and below the glass there is none.

    Arms hang down, and reflections are torn where light comes two ways.
    """
    rig = default_rig(
        sensor, 2.4 if sensor == "kinect_v1" else 2.1, mirrors=(122.0, -116.0), path_length=4.5,
        mirror_size=(1.0, 1.95), frames=4, seed=5, interference=True, camera_height=0.9,
    )  # fmt: skip
    rig = replace(rig, mirrors=tuple(replace(m, centre=(*m.centre[:2], m.height / 2)) for m in rig.mirrors))
    simulation = simulate(mannequin(1.7, Figure(arm_angle_deg=72.0), resolution=0.012), rig)
    found = find_mirrors(RgbdImage(clean(simulation.capture), rig.intrinsics))
    assert [m.name for m in found] == ["left", "right"]
    true = {m.name: m for m in simulation.truth.mirrors}
    for mirror in found:
        assert misplaced(mirror, true[mirror.name], simulation.truth.body.vertices) < 0.007
