"""What is reconstructed: captures whose truth is known."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from mirror_scan.core.capture import Capture, open_capture
from mirror_scan.core.io import read_mesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate

from .machine import say

SHARED = Path(__file__).resolve().parents[2] / "shared"
"""Test data kept beside the checkout; not part of the project."""
SIMULATED = "simulated data"
RIG = "virtual rig"
RIG_FRAMES = {"azure_kinect": 10, "kinect_v1": 10, "realsense_d455": 10, "ideal": 1}


@dataclass(frozen=True)
class Scene:
    """A capture and the true body, camera frame. ``origin`` is ``SIMULATED`` (another program's) or ``RIG`` (ours)."""

    name: str
    origin: str
    capture: Capture
    truth: Mesh


@cache
def scenes() -> tuple[Scene, ...]:
    """All there are: folders beside the checkout that hold a truth, then our own virtual rig with each sensor."""
    found = []
    for truth in sorted((SHARED / "data" / "simulated").glob("*/truth/body.ply")):
        folder = truth.parents[1]
        found.append(Scene(folder.name, SIMULATED, open_capture(folder), read_mesh(truth)))
    if not found:
        say("No ../shared/data/simulated beside the checkout: only the built-in virtual rig is measured.")
    body = mannequin()
    for sensor, frames in RIG_FRAMES.items():
        say(f"virtual rig: {sensor}")
        made = simulate(body, default_rig(sensor, frames=frames))
        found.append(Scene(f"rig {sensor}", RIG, made.capture, made.truth.body))
    return tuple(found)


def origins() -> tuple[str, ...]:
    return tuple(dict.fromkeys(scene.origin for scene in scenes()))
