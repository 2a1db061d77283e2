"""Mirrors whose turn their frames leave open: the views of a person tell it, and say how well."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.mirror_alignment.person_alignment import PersonSettings, align_persons
from mirror_scan.core.mirrors import Mirror
from mirror_scan.core.mirrors.mirror import expected_error, moved, plane_mirror, reflect
from mirror_scan.core.simulation.mannequin import Figure, mannequin
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import Simulation, simulate

TURN = 0.010  # by which the mirrors are turned, and one standard deviation of that [rad]


@pytest.fixture(scope="module", params=["ideal", "azure_kinect", "realsense_d455", "kinect_v1"])
def snapshot(request) -> Simulation:
    rig = default_rig(request.param, 2.2, mirrors=(115, -112), frames=3, seed=5)
    return simulate(mannequin(1.5, Figure(arm_angle_deg=45.0), resolution=0.012), rig)


def turned(simulation: Simulation, turns: tuple[float, float], sd: float = TURN) -> list[Mirror]:
    """The true mirrors, turned about their uprights by so much, and as uncertain."""
    out = []
    for true, made, turn in zip(simulation.truth.mirrors, simulation.rig.mirrors, turns, strict=True):
        half = np.array(((-0.5, 0.5),)) * np.array(((made.width,), (made.height,)))
        mirror = replace(
            plane_mirror(true.name, true.point, true.normal), source="found", rectangle=half,
            covariance=np.diag((sd, min(sd, 0.0005), 0.0003)) ** 2,
        )  # fmt: skip
        out.append(moved(mirror, np.array((turn, 0.0, 0.0))))
    return out


def errors(mirrors: list[Mirror], simulation: Simulation) -> list[float]:
    body = simulation.truth.body.vertices[::7]
    return [
        float(np.median(np.linalg.norm(reflect(body, m) - reflect(body, plane_mirror("", t.point, t.normal)), axis=1)))
        for m, t in zip(mirrors, simulation.truth.mirrors, strict=True)
    ]


def image_of(simulation: Simulation) -> RgbdImage:
    return RgbdImage(one_depth_map(simulation.capture)[0], simulation.capture.intrinsics)


@pytest.mark.parametrize("skin", [True, False])
def test_views_of_a_person_tell_the_turns(snapshot, skin):
    mirrors = turned(snapshot, (TURN, -0.7 * TURN))
    out, notes = align_persons(image_of(snapshot), mirrors, PersonSettings(skin=skin))
    assert notes == ()
    most = {"ideal": 0.0025, "azure_kinect": 0.004, "realsense_d455": 0.006, "kinect_v1": 0.009}[snapshot.rig.sensor]
    assert min(errors(mirrors, snapshot)) > 0.015
    for mirror, old, error in zip(out, mirrors, errors(out, snapshot), strict=True):
        stated = mirror.displacement(snapshot.truth.body.vertices[::7])
        assert error < most and error < 3.0 * stated, (error, stated)
        assert expected_error(mirror) < 0.6 * expected_error(old) and mirror.moved_by == ("person",)


def test_sure_mirrors_stay_and_are_witnesses(snapshot):
    sure, unsure = turned(snapshot, (0.0, 0.0), 0.0002)[0], turned(snapshot, (0.0, TURN))[1]
    out, _ = align_persons(image_of(snapshot), [sure, unsure])
    assert out[0] is sure and errors(out, snapshot)[1] < 0.5 * errors([sure, unsure], snapshot)[1]
    both = turned(snapshot, (0.0, 0.0), 0.0002)
    assert all(new is old for new, old in zip(align_persons(image_of(snapshot), both)[0], both, strict=True))


def test_a_person_counts_once(snapshot):
    """Somebody has turned the mirrors already: the covariance with which they start is what their frames say."""
    mirrors = turned(snapshot, (TURN, TURN), 0.002)
    known = [replace(m, turn_by_frame=TURN**2) for m in mirrors]
    image = image_of(snapshot)
    out = align_persons(image, known)[0]
    assert max(errors(out, snapshot)) < 0.5 * min(errors(mirrors, snapshot))


def test_nobody_there_nothing_moves(snapshot):
    depth = image_of(snapshot).depth.copy()
    depth[snapshot.truth.labels >= 0] = 0.0
    mirrors = turned(snapshot, (TURN, TURN))
    out, _ = align_persons(RgbdImage(depth, snapshot.capture.intrinsics), mirrors)
    assert all(new is old for new, old in zip(out, mirrors, strict=True))
