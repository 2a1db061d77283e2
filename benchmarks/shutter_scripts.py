"""Scripted approaches: a virtual person walks in before the mirrors, stands wrong in some way, and corrects it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
from mirror_scan.core.capture.live_camera import Stream
from mirror_scan.core.capture.rgbd_writer import FolderWriter
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.simulation.mannequin import Figure, mannequin
from mirror_scan.core.simulation.props import together
from mirror_scan.core.simulation.scene import Rig, default_rig
from mirror_scan.core.simulation.simulate import simulate

RATE = 10.0
"""Frames a second of the recordings."""

STRIDE_M = 0.22
"""How far who walks gets from frame to frame [m]."""

RESOLUTION = 0.018  # of the mannequins [m]


@dataclass(frozen=True, eq=False)
class Moment:
    """What stands still for some frames.

    ``bodies``: in the avatar frame [m]; ``faults``: kinds of advice of which one at least must then be given, empty
    where all is well; ``walking``: nothing is asked of what is said, but that no burst is begun.
    """

    bodies: tuple[Mesh, ...]
    frames: int
    rig: Rig
    faults: tuple[str, ...] = ()
    walking: bool = False
    props: tuple[Mesh, ...] = ()


@dataclass
class Approach:
    """A script: ``name``, its moments, and what became of them when they were played."""

    name: str
    moments: list[Moment]
    seed: int = 0
    frames: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)

    @property
    def right_moment(self) -> float:
        """When the last correction is done, and all is well from then on [s]."""
        before = 0
        for k, moment in enumerate(self.moments):
            if moment.faults or moment.walking:
                before = sum(m.frames for m in self.moments[: k + 1])
        return before / RATE

    def moment_at(self, number: int) -> Moment:
        """The moment of a frame."""
        for moment in self.moments:
            if number < moment.frames:
                return moment
            number -= moment.frames
        return self.moments[-1]

    def render(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """All frames: depth (H, W) [m] and colour (H, W, 3)."""
        if not self.frames:
            for k, moment in enumerate(self.moments):
                rig = replace(moment.rig, frames=moment.frames, seed=1000 * self.seed + k)
                capture = simulate(_joined(moment.bodies), rig, moment.props).capture
                assert capture.color is not None  # simulate gives one
                self.frames += [(depth, capture.color) for depth in capture.depth]
        return self.frames

    def stream(self) -> Stream:
        """As a camera would deliver it."""
        rig = self.moments[0].rig
        return Stream(rig.intrinsics, rig.sensor, iter(self.render()))

    def write(self, folder: Path) -> Path:
        """As an RGB-D folder."""
        rig = self.moments[0].rig
        writer = FolderWriter(folder, rig.intrinsics, rig.sensor)
        for depth, _ in self.render():
            writer.add(depth)
        writer.set_color(self.frames[-1][1])
        return folder


def _joined(bodies: Sequence[Mesh]) -> Mesh:
    return bodies[0] if len(bodies) == 1 else together(*bodies)


def small_rig(sensor: str = "azure_kinect", **changes) -> Rig:
    """The paper's rig with a camera of about 320 × 288 pixels."""
    rig = default_rig(sensor, frames=1, **changes)
    lens = rig.intrinsics
    share = np.sqrt(92_160 / (lens.width * lens.height))
    return replace(rig, intrinsics=lens.scaled(int(round(lens.width * share)), int(round(lens.height * share))))


@cache  # made many times, and never changed
def person(height: float = 1.7, arm_angle_deg: float = 45.0, **figure) -> Mesh:
    """A mannequin in the middle of the avatar frame."""
    return mannequin(height, Figure(arm_angle_deg=arm_angle_deg, **figure), resolution=RESOLUTION)


def at(body: Mesh, x: float, y: float) -> Mesh:
    """A body elsewhere on the floor [m]; x to the camera's right, y away from it."""
    pose = np.eye(4)
    pose[:2, 3] = x, y
    return body.transformed(pose)


def walk(body: Mesh, start: tuple[float, float], end: tuple[float, float], rig: Rig, **more) -> Iterator[Moment]:
    """A way over the floor, a moment a frame; its end is not one of them."""
    away = np.hypot(end[0] - start[0], end[1] - start[1])
    steps = max(int(np.ceil(away / STRIDE_M)), 1)
    for share in np.arange(steps) / steps:
        place = (start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1]))
        yield Moment((at(body, *place),), 1, rig, walking=True, **more)
