"""Seams contradict a plane that is turned or moved, whatever the camera and however light comes; none that is sound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.capture import MirrorPicks
from mirror_scan.core.mirrors.mirror import oriented
from mirror_scan.core.pipeline import reconstruct
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.scene import default_rig, with_real_optics
from mirror_scan.core.simulation.simulate import simulate

EFFECTS = ("multipath", "glass", "bow", "attenuation", "color", "noise")
WRONG = ("do not meet", "places the subject", "shows the floor", "does not look like", "coincide")
FAULTS = {"turned": (1.0, 0.0, 0.0), "leaning": (0.0, -1.0, 0.0), "moved": (0.0, 0.0, 0.015)}


@pytest.fixture(scope="module", params=["azure_kinect", "kinect_v1"])
def really(request):
    """A virtual snapshot with real optics."""
    rig = default_rig(request.param, 2.75 if request.param == "kinect_v1" else 2.5, frames=10, seed=3)
    return simulate(mannequin(resolution=0.012), with_real_optics(rig, (165.0, 140.0, 60.0), EFFECTS))


def given(simulation, which: int | None = None, fault=(0.0, 0.0, 0.0)) -> tuple[MirrorPicks, ...]:
    """The true planes, one of them turned by degrees about both its axes and moved."""
    out = []
    for k, true in enumerate(simulation.truth.mirrors):
        normal, basis = oriented(np.asarray(true.normal), np.asarray(true.point))
        point = np.asarray(true.point)
        if k == which:
            point = point + fault[2] * normal
            normal = normal + basis[:, :2] @ np.tan(np.radians(fault[:2]))
        out.append(MirrorPicks(true.name, point=point, normal=normal))
    return tuple(out)


def complaints(warnings) -> list[str]:
    return [str(text) for text in warnings if any(part in str(text) for part in WRONG)]


@pytest.mark.parametrize("picked", [True, False])
def test_sound_planes_are_not_warned_of(really, picked):
    made = reconstruct(really.capture, None if picked else given(really))
    assert complaints(made.warnings) == []


@pytest.mark.parametrize(("fault", "which"), [("turned", 0), ("leaning", 1), ("moved", 1)])
def test_a_wrong_plane_is_warned_of(really, fault, which):
    name = really.truth.mirrors[which].name
    told = complaints(reconstruct(really.capture, given(really, which, FAULTS[fault])).warnings)
    assert any(f"“{name}”" in text for text in told), told


@pytest.mark.parametrize("fault", list(FAULTS))
def test_ideal_light_of_a_camera_that_reads_nothing_twice(simulated, fault):
    simulation = simulated("kinect_v1")
    assert complaints(reconstruct(simulation.capture, given(simulation)).warnings) == []
    told = complaints(reconstruct(simulation.capture, given(simulation, 1, FAULTS[fault])).warnings)
    assert any(f"“{simulation.truth.mirrors[1].name}”" in text for text in told), told


def test_what_nothing_tells_of_the_glass_is_part_of_the_error(simulated):
    """A Kinect v1 sees no skin twice: glass of 5 mm, or a frame that projects by 6 mm, is not told from thin glass."""
    simulation = simulated("kinect_v1")
    body = simulation.truth.body.vertices[::7]
    unknown = reconstruct(simulation.capture).mirrors
    assert all(0.005 < m.displacement(body) < 0.008 for m in unknown)
    ideal = simulated("ideal")
    assert all(m.displacement(ideal.truth.body.vertices[::7]) < 0.002 for m in reconstruct(ideal.capture).mirrors)
    rig = replace(simulation.rig, mirrors=tuple(replace(m, frame_depth=0.006) for m in simulation.rig.mirrors))
    proud = simulate(mannequin(resolution=0.012), rig)
    for m, true in zip(reconstruct(proud.capture).mirrors, proud.truth.mirrors, strict=True):
        off = 2.0 * abs((m.point - true.point) @ np.asarray(true.normal))
        assert off < 2.0 * m.displacement(proud.truth.body.vertices[::7])
