"""Tasks of a virtual rig: scan with it, say what it sees, find the best one, draw its plan."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.errors import MirrorScanError
from ...core.mesh import Mesh
from .captures import load_steps, loaded_steps
from .results import Loaded, RigChecked, Simulated, Steps

if TYPE_CHECKING:
    from ...core.rig_planning.placement_search import Placement
    from ...core.simulation.scene import Rig


def simulate_steps(body: Mesh | None, rig: dict, mirrors: list[dict] | None, folder: str = "") -> Steps[Simulated]:
    """Scan a body (the mannequin without one) with a virtual rig.

    Parameters
    ----------
    body : Mesh or None
        World frame: Z up, floor on z = 0 [m].
    rig : dict
        Fields of ``core.simulation.scene.Rig`` other than mirrors; without ``camera`` arguments of ``default_rig``.
    mirrors : list of dict, optional
        Fields of ``FramedMirror``; None leaves the default rig's own.
    folder : str
        Where to write the capture; "" = nowhere.
    """
    yield 0.0, "Preparing the body"
    from ...core.simulation.coverage import coverage, shares
    from ...core.simulation.mannequin import mannequin
    from ...core.simulation.scene import FramedMirror, Rig, default_rig
    from ...core.simulation.sensors import find_sensor
    from ...core.simulation.simulate import simulate, write_simulation

    subject = mannequin() if body is None else body
    if "camera" in rig:
        intrinsics = find_sensor(rig["sensor"]).intrinsics
        arranged = Rig(intrinsics=intrinsics, mirrors=tuple(FramedMirror(**mirror) for mirror in mirrors or ()), **rig)
    else:
        arranged = default_rig(**rig)
        if mirrors is not None:
            arranged = dataclasses.replace(arranged, mirrors=tuple(FramedMirror(**mirror) for mirror in mirrors))
    yield 0.2, "Simulating the camera"
    simulation = simulate(subject, arranged)
    if not simulation.capture.depth.any():
        raise MirrorScanError("the virtual camera sees nothing; turn it towards the body, or bring it within range")
    yield 0.7, "Measuring coverage"
    view = coverage(simulation)
    share = shares(view, subject.vertices, subject.triangles, len(arranged.mirrors) + 1)
    if folder:
        yield 0.75, "Writing the capture"
        write_simulation(simulation, Path(folder))
    loaded, _ = yield from loaded_steps(simulation.capture, folder)
    # The rig already has a place in the world: the points stay where it puts them.
    return Simulated(dataclasses.replace(loaded, placement=arranged.camera_to_avatar), view, share)


def mannequin_steps() -> Steps[Mesh]:
    """The person of a planned rig: coarse, 1.70 m, avatar frame."""
    yield 0.0, "Preparing the body"
    from ...core.simulation.mannequin import mannequin

    return mannequin(resolution=0.015)


def check_rig_steps(body: Mesh | None, rig: dict, mirrors: list[dict], height: int = 144) -> Steps[RigChecked]:
    """What a rig would see of a body (the mannequin without one), quickly.

    ``rig`` and ``mirrors`` as for :func:`simulate_steps`, ``height`` of the picture [px].
    """
    yield 0.0, "Simulating the camera"
    from ...core.rig_planning.area_coverage import area_coverage, body_samples
    from ...core.rig_planning.placement_advice import placement_advice
    from ...core.rig_planning.predicted_error import predicted_error
    from ...core.simulation.rays import look

    subject = (yield from mannequin_steps()) if body is None else body
    arranged = _rig_of(rig, mirrors)
    samples = body_samples(subject)
    covered = area_coverage(samples, arranged)
    error = predicted_error(samples, covered, arranged)
    yield 0.5, "Trying what to move"
    views = [
        {"name": view.name, "advice": "" if view.advice is None else view.advice, "hidden": view.hidden,
         **{part: view.whole(part) for part in ("head", "hands", "feet")}}
        for view in placement_advice(samples, arranged)
    ]  # fmt: skip
    yield 0.8, "Drawing what the camera sees"
    lens = arranged.intrinsics
    small = dataclasses.replace(arranged, intrinsics=lens.scaled(round(height * lens.width / lens.height), height))
    return RigChecked(
        covered.share, covered.by_view, covered.by_part, views, error.mean_mm, error.light_mm, error.lit_twice,
        look(subject, small)[0].color,
    )  # fmt: skip


def find_rig_steps(
    body: Mesh | None, room: tuple[float, float, float], sensor: str, mirrors: list[tuple[float, float]],
    frame_width: float,
) -> Steps[tuple[Placement, Mesh]]:  # fmt: skip
    """The best placement in a room, and the person it is for; sizes in metres."""
    yield 0.0, "Preparing the body"
    from ...core.rig_planning.placement_search import PlanSettings, placement_steps
    from ...core.rig_planning.rooms import Room

    subject = (yield from mannequin_steps()) if body is None else body
    settings = PlanSettings(frame_width=frame_width)
    return (yield from placement_steps(Room(*room), sensor, mirrors, subject, settings)), subject


def plan_steps(body: Mesh | None, rig: dict, mirrors: list[dict], path: str) -> Steps[str]:
    """Write the plan of a rig, whose ``rig`` has a room, as an SVG page; the path."""
    yield 0.0, "Preparing the body"
    from ...core.rig_planning.area_coverage import area_coverage, body_samples
    from ...core.rig_planning.placement_search import Placement
    from ...core.rig_planning.plan_drawing import write_plan_drawing
    from ...core.rig_planning.predicted_error import predicted_error
    from ...core.rig_planning.rooms import Room

    subject = (yield from mannequin_steps()) if body is None else body
    arranged = _rig_of(rig, mirrors)
    assert arranged.room is not None
    x0, x1, y0, y1, height = arranged.room
    yield 0.5, "Simulating the camera"
    samples = body_samples(subject)
    covered = area_coverage(samples, arranged)
    error = predicted_error(samples, covered, arranged)
    placement = Placement(arranged, Room(x1 - x0, y1 - y0, height), False, covered, error, False, 1)
    write_plan_drawing(path, placement)
    return path


def _rig_of(rig: dict, mirrors: list[dict]) -> Rig:
    from ...core.simulation.scene import FramedMirror, Rig
    from ...core.simulation.sensors import find_sensor

    intrinsics = find_sensor(rig["sensor"]).intrinsics
    return Rig(intrinsics=intrinsics, mirrors=tuple(FramedMirror(**mirror) for mirror in mirrors), **rig)


def sample_steps(folder: str) -> Steps[Loaded]:
    """Take a virtual capture of the mannequin, with what real cameras and mirrors do to light, into a new ``folder``,
    and load it."""
    yield 0.0, "Preparing the body"
    from ...core.io.atomic_files import fresh_folder
    from ...core.simulation.mannequin import mannequin
    from ...core.simulation.optics import real
    from ...core.simulation.scene import default_rig
    from ...core.simulation.simulate import simulate, write_simulation

    rig = default_rig(frames=6, optics=real("azure_kinect"))
    yield 0.05, "Simulating the camera"
    simulation = simulate(mannequin(), rig)
    yield 0.3, "Writing the capture"
    with fresh_folder(folder) as new:
        write_simulation(simulation, new)
    return (yield from load_steps(folder, 0))
