"""The generated corpus: bodies of many proportions and poses in many rigs, made from one seed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from mirror_scan.core.io import read_mesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.simulation.mannequin import mannequin, random_figure
from mirror_scan.core.simulation.scene import Rig, default_rig
from mirror_scan.core.simulation.simulate import Simulation, simulate

from .scenes import SHARED

SCENES = 64
QUICK = (0, 1, 2, 7, 13, 18, 25, 36)
"""Of all sensors, poses and numbers of mirrors some."""
SEED = 20121
SENSORS = ("azure_kinect", "kinect_v1", "realsense_d455", "ideal")
FARTHER = {"kinect_v1": 2.8, "ideal": 2.8}
"""Distance at which a tall person fits into a lower picture [m]."""
MIRRORS = (2, 2, 3, 2, 1, 2, 2, 3, 2, 2, 1, 3, 2)  # 13 and 10 share no factor: each body meets each number
BODIES = (
    ("mh_base_neutral", "A-pose"), ("mannequin", "A-pose"), ("mh_woman_armsdown", "arms down"),
    ("mannequin", "arms forward"), ("mh_man_clothed_apose_closed", "A-pose"), ("mannequin", "arms down"),
    ("mh_man_apose", "A-pose"), ("mannequin", "a step"), ("statue_maria_closed", "statue"), ("mannequin", "A-pose"),
)  # fmt: skip
"""A name is that of a file of ``../shared/data/bodies``; a mannequin takes its place where there is none."""


@dataclass(frozen=True)
class Recipe:
    """What makes a scene: body, its height [m], pose, the virtual rig, and the number all random draws follow from."""

    number: int
    body: str
    pose: str
    height: float
    rig: Rig

    @property
    def name(self) -> str:
        return f"{self.number:02d}"

    @property
    def mirrors(self) -> int:
        return len(self.rig.mirrors)

    def __str__(self) -> str:
        light = {None: "", True: ", interference", False: ", no interference"}[self.rig.interference]
        return (
            f"{self.name} {self.body}, {self.pose}, {self.height:.2f} m, {self.rig.sensor} x {self.rig.frames}{light}, "
            f"{self.mirrors} mirror{'s' if self.mirrors > 1 else ''}, tilt {self.rig.tilt_deg:.1f}°, "
            f"roll {self.rig.roll_deg:+.1f}°"
        )


def recipes(numbers: tuple[int, ...] | None = None) -> Iterator[Recipe]:
    """Those numbered, or all; each depends on its own number only."""
    for number in range(SCENES) if numbers is None else numbers:
        rng = np.random.default_rng((SEED, number))
        body, pose = BODIES[number % len(BODIES)]
        if body != "mannequin" and not (SHARED / "data" / "bodies" / f"{body}.ply").exists():
            body, pose = "mannequin", "A-pose" if pose == "statue" else pose
        count = MIRRORS[number % len(MIRRORS)]
        side = float(rng.choice((-1.0, 1.0)))
        right, left = rng.uniform(100.0, 130.0, 2)
        angles = [(side * right,), (right, -left), (right, -left, side * (right if side > 0 else left) + side * 32.0)]
        # three mirrors light the back three times over: with interference next to nothing of it can be read
        interference = (None, None, True, False)[rng.integers(4)] if count < 3 else False
        sensor = SENSORS[(number + number // len(BODIES)) % len(SENSORS)]
        height, tilt = float(rng.uniform(1.52, 1.88)), float(rng.uniform(0.0, 6.0))
        distance = FARTHER.get(sensor, 2.5)
        rig = default_rig(
            sensor, subject_distance=distance, mirrors=angles[count - 1], path_length=rng.uniform(4.4, 4.9),
            lean_deg=rng.uniform(-1.0, 1.0, count), roll_deg=rng.uniform(-3.0, 3.0), tilt_deg=tilt,
            camera_height=height / 2 + distance * np.tan(np.radians(tilt)),  # it looks at the middle of the body
            frames=int(rng.choice((1, 3, 10, 30))), seed=number, interference=interference,
        )  # fmt: skip
        yield Recipe(number, body, pose, height, rig)


def make(recipe: Recipe) -> Simulation:
    """The virtual snapshot; its picks miss the frames by up to 0.7 px, as :func:`.simulate.simulate` writes them."""
    return simulate(body_of(recipe), recipe.rig)


def body_of(recipe: Recipe) -> Mesh:
    """The true body of a recipe, avatar frame."""
    if recipe.body != "mannequin":
        body = read_mesh(SHARED / "data" / "bodies" / f"{recipe.body}.ply")
        return replace(body, vertices=body.vertices * (recipe.height / np.ptp(body.vertices[:, 2])))
    rng = np.random.default_rng((SEED, recipe.number, 1))
    figure = random_figure(rng)
    sign = float(rng.choice((-1.0, 1.0)))
    pose = {
        "A-pose": {},
        "arms down": {"arm_angle_deg": rng.uniform(68, 75), "elbow_bend_deg": rng.uniform(0, 10)},
        "arms forward": {
            "arm_angle_deg": rng.uniform(25, 50), "arm_forward_deg": rng.uniform(45, 70),
            "elbow_bend_deg": rng.uniform(0, 8),
        },
        "a step": {"step_deg": sign * rng.uniform(8, 18), "arm_angle_deg": rng.uniform(45, 65)},
    }[recipe.pose]  # fmt: skip
    return mannequin(recipe.height, replace(figure, **pose))
