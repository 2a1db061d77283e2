"""Whoever sits takes the seat along, and is told so; whoever stands, or crouches, is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.checks.seat import check_seat
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.errors import ReconstructionError
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mirrors.picked_mirror import place_mirror
from mirror_scan.core.pipeline import reconstruct
from mirror_scan.core.simulation import props
from mirror_scan.core.simulation.mannequin import Figure, mannequin
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate
from mirror_scan.core.subject.subject_search import find_subject

HIP, KNEE, SEAT = 0.93, 0.48, 0.42


@pytest.fixture(scope="module")
def standing():
    return mannequin(1.7, Figure(arm_angle_deg=35.0), resolution=0.012)


@pytest.fixture(scope="module")
def sitting(standing):
    """The body folded at the hips and knees: thighs level, shins upright."""
    x, y, z = standing.vertices.T
    hand = np.abs(x) > 0.32
    fold = np.clip((HIP - z) / 0.16 + 0.5, 0.0, 1.0) * ~hand  # of the hip
    angle = np.radians(86.0) * fold
    along, depth = HIP - z, y - 0.02
    thigh = np.minimum(along, HIP - KNEE)
    shin = along - thigh
    out = standing.vertices.copy()
    bent = (fold > 0.0) & (along > -0.08)
    upright = np.where(shin > 0.0, 1.0, np.cos(angle))  # of what is before or behind the bone
    out[bent, 1] = (0.02 + depth * upright - thigh * np.sin(angle))[bent]
    out[bent, 2] = (HIP - thigh * np.cos(angle) - shin + depth * np.sin(angle) * (shin <= 0.0))[bent]
    out[:, 1] += 0.2
    out[:, 2] -= out[:, 2].min()
    return replace(standing, vertices=out)


def seat(kind: str, body: Mesh) -> list[Mesh]:
    """Something as high as the body's lowest point behind its shins."""
    behind = body.vertices[(body.vertices[:, 1] > 0.05) & (np.abs(body.vertices[:, 0]) < 0.2)]
    height = float(behind[:, 2].min()) + 0.005
    made = {
        "stool": props.table(0.36, 0.36, height),
        "box": props.box((-0.22, -0.2, 0.0), (0.22, 0.2, height)),
    }[kind]  # fmt: skip
    return [props.placed(made, 0.0, 0.24, 5.0)]


def views_of(body: Mesh, sensor: str, others=()):
    simulation = simulate(body, default_rig(sensor, 2.3, frames=3, camera_height=0.85), others)
    image = RgbdImage(one_depth_map(simulation.capture)[0], simulation.capture.intrinsics)
    mirrors = [place_mirror(image, m) for m in simulation.capture.mirrors]
    return simulation, find_subject(image, mirrors)


@pytest.mark.parametrize("sensor", ["azure_kinect", "realsense_d455", "kinect_v1"])
@pytest.mark.parametrize("kind", ["stool", "box"])
def test_a_seat_is_warned_of(sitting, sensor, kind):
    _, views = views_of(sitting, sensor, seat(kind, sitting))
    (warning,) = check_seat(views)
    assert "seat" in str(warning) and "stays part of it" in str(warning)


@pytest.mark.parametrize("sensor", ["azure_kinect", "realsense_d455", "kinect_v1"])
def test_who_stands_or_crouches_is_not_warned(standing, sitting, sensor):
    for body in (standing, sitting):
        assert check_seat(views_of(body, sensor)[1]) == []


def test_a_wide_robe_is_no_seat(standing):
    """Broad where it stands, and level nowhere."""
    around = np.linspace(0.0, 2.0 * np.pi, 49)[:-1]
    heights = np.linspace(0.0, 1.2, 13)
    radius = 0.3 - 0.13 * heights / 1.2
    ring = np.column_stack((np.cos(around), np.sin(around)))
    vertices = np.concatenate(
        [np.column_stack((r * ring, np.full(48, h))) for r, h in zip(radius, heights, strict=True)]
    )
    i = np.arange(48)
    below = np.concatenate([np.column_stack((48 * k + i, 48 * k + (i + 1) % 48)) for k in range(12)])
    triangles = np.concatenate((np.column_stack((below, below[:, 0] + 48)),
                                np.column_stack((below[:, 1], below[:, 1] + 48, below[:, 0] + 48))))  # fmt: skip
    robe = Mesh(vertices, triangles.astype(np.int32), np.tile(np.array((90, 90, 120), np.uint8), (len(vertices), 1)))
    assert check_seat(views_of(props.together(standing, robe), "azure_kinect")[1]) == []


def test_a_seat_that_makes_the_avatar_impossible_is_named_as_the_cause(sitting):
    simulation, _ = views_of(sitting, "azure_kinect", seat("box", sitting))
    try:
        warnings = reconstruct(simulation.capture).warnings
    except ReconstructionError as error:
        warnings = [str(error)]
    assert "such as a seat" in str(warnings[0])
