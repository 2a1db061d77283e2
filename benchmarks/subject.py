"""Pixel labels: subject and views separated from floor, walls, furniture and people, against virtual rigs' truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from statistics import median

import numpy as np
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mirrors.picked_mirror import place_mirror
from mirror_scan.core.simulation import props
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.rays import BODY
from mirror_scan.core.simulation.scene import Rig, default_rig
from mirror_scan.core.simulation.simulate import Simulation, simulate
from mirror_scan.core.subject.subject_search import find_subject
from mirror_scan.core.subject.subject_views import Views, ViewSettings

from .machine import medians, say
from .results import Finding, Result, Table, number

SENSORS = {"ideal": 1, "kinect_v1": 10, "azure_kinect": 10, "realsense_d455": 10}
MIN_RIGHT_PCT, MAX_LEFT_PCT, MAX_LOST_PCT = 99.5, 0.2, 2.0
_SAME = 0.02  # a reading this near to an object's true depth, relative, is that object's
_END = 0.12  # m: what of the body counts as feet and as hair


@dataclass(frozen=True)
class Labels:
    """How well one capture was sorted, in per cent.

    ``right``: pixels of the subject given to the view they are seen through; ``left``: readings of floor, room and
    others among those kept, of them all; ``feet``, ``hair``: pixels of the lowest and highest 12 cm that were lost.
    """

    right: float
    left: float
    feet: float
    hair: float
    lost: float


def judge(simulation: Simulation, depth: np.ndarray, views: Views) -> Labels:
    """Labels against the truth; only readings that are what the ray meets count, not what a sensor blurs at edges."""
    truth = simulation.truth
    sight = truth.sight
    told = np.abs(depth / np.where(sight.depth > 0, sight.depth, np.inf) - 1) < _SAME
    body = told & (truth.labels >= 0)
    kept = views.labels >= 0
    height = truth.sight.point[..., 2]
    low, high = (end(truth.body.transformed(truth.camera_to_avatar).vertices[:, 2]) for end in (np.min, np.max))
    feet, hair = body & (height < low + _END), body & (height > high - _END)
    return Labels(
        100.0 * float((views.seen == truth.labels)[body].mean()),
        100.0 * float((kept & told & (sight.object != BODY)).sum() / max(kept.sum(), 1)),
        100.0 * float(1 - kept[feet].mean()) if feet.any() else 0.0,
        100.0 * float(1 - kept[hair].mean()) if hair.any() else 0.0,
        100.0 * float(1 - (views.labels == truth.labels)[body].mean()),
    )


def rooms(sensor: str, frames: int) -> Iterator[tuple[str, Rig, tuple[Mesh, ...], ViewSettings]]:
    """Scenes with what has to be separated from the subject."""
    rig = default_rig(sensor, frames=frames)
    other = mannequin(1.78, seed=3, resolution=0.014)
    plain = ViewSettings()
    yield "alone", rig, (), plain
    yield "bystander behind", rig, (props.placed(other, 0.55, 1.2, 30),), plain
    yield "bystander beside", rig, (props.placed(other, -1.75, -0.1, -50),), plain
    yield "bystander behind the camera", rig, (props.placed(other, 0.4, -3.6, 180),), plain
    yield "chair beside", rig, (props.placed(props.chair(), 0.62, 0.3, 20),), plain
    yield "chair behind", rig, (props.placed(props.chair(), -0.1, 0.75, 180),), plain
    yield "walls close by", replace(rig, room=(-1.6, 1.6, -3.4, 1.05, 2.4)), (), plain
    yield "in front of a mirror", default_rig(sensor, frames=frames, mirrors=(112.0, -112.0, 180.0)), (), plain
    wide = default_rig(sensor, frames=frames, mirror_size=(1.5, 2.0), view_angle_deg=112.0)
    yield "wide mirrors, images of images", wide, (), plain
    yield "camera tilted and rolled", default_rig(sensor, frames=frames, tilt_deg=9.0, roll_deg=-6.0,
                                                  camera_height=1.2), (), plain  # fmt: skip
    yield "mirrors lean", default_rig(sensor, frames=frames, lean_deg=(2.5, -2.0)), (), plain


def prepared(simulation: Simulation):
    """Depth and mirrors as the pipeline has them when it looks for the subject."""
    intrinsics = simulation.capture.intrinsics
    depth = one_depth_map(simulation.capture)[0]
    return depth, [place_mirror(RgbdImage(depth, intrinsics), m) for m in simulation.capture.mirrors]


def run() -> Result:
    table = Table(
        "Subject: pixels against the truth",
        ("sensor", "scene", "right view %", "room left %", "feet lost %", "hair lost %", "subject lost %", "ms"),
        left=2,
    )
    body = mannequin(resolution=0.01)
    found: list[Labels] = []
    failed = []
    for sensor, frames in SENSORS.items():
        say(f"subject: {sensor}")
        for name, rig, others, settings in rooms(sensor, frames):
            simulation = simulate(body, rig, others)
            depth, mirrors = prepared(simulation)
            intrinsics = simulation.capture.intrinsics
            try:
                spent, views = medians(
                    {"": lambda d=depth, m=mirrors, k=intrinsics, s=settings: find_subject(RgbdImage(d, k), m, s)}, 3
                )
            except MirrorScanError as error:
                failed.append(f"{sensor}, {name}: {error}")
                table.rows.append((sensor, name, "failed", *["–"] * 5))
                continue
            score = judge(simulation, depth, views[""])
            found.append(score)
            cells = (score.right, score.left, score.feet, score.hair, score.lost)
            table.rows.append((sensor, name, *(number(c, 2) for c in cells), number(spent[""], 1)))
    table.notes = [
        f"Right view: direct, through mirror i, or neither. Feet and hair: the lowest and highest {100 * _END:.0f} cm.",
        "Readings that are not what the ray meets (a sensor's edges) are left out of account.",
        *failed,
    ]
    if not found:
        return Result([table], [Finding("subject", "nothing could be measured", False)])
    rows = [
        (f"pixel labels >= {MIN_RIGHT_PCT:g} % right", "right", min, lambda x: x >= MIN_RIGHT_PCT),
        (f"floor and background left <= {MAX_LEFT_PCT:g} %", "left", max, lambda x: x <= MAX_LEFT_PCT),
        (f"feet lost <= {MAX_LOST_PCT:g} %", "feet", max, lambda x: x <= MAX_LOST_PCT),
        (f"hair lost <= {MAX_LOST_PCT:g} %", "hair", max, lambda x: x <= MAX_LOST_PCT),
    ]
    findings = []
    for limit, key, worst, holds in rows:
        values = [getattr(score, key) for score in found]
        text = f"median {median(values):.2f}, worst {worst(values):.2f}, {sum(map(holds, values))} of {len(values)}"
        findings.append(Finding(f"subject: {limit}", text, holds(worst(values)) and not failed))
    return Result([table], findings)
