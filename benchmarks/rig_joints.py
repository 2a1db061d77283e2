"""Joints of scanned bodies against the true ones.

``python -m benchmarks.rig_joints [--bodies 0-9] [--sensors azure_kinect …] [--angles 15 35 55 80] [--pictures DIR]``.
The template was trained on none of these bodies, so every figure leaves the body out.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mirror_scan.core.avatar.joints.skeleton_search import find_skeleton
from mirror_scan.core.avatar.skeleton import BONES, PARENTS, Skeleton
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.io.images import write_png
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.surface_distance import rigid_alignment
from mirror_scan.core.numeric.point_products import transform
from mirror_scan.core.pipeline import reconstruct
from mirror_scan.core.preview.mesh_views import render_views
from mirror_scan.core.simulation.mannequin import random_figure, rigged_mannequin
from mirror_scan.core.simulation.scene import default_rig, with_real_optics
from mirror_scan.core.simulation.simulate import simulate

from .machine import say
from .results import Finding, Result, Table, limits_table, number
from .rigged_bodies import LIMBS, rigged_bodies, with_arms

SENSORS = ("azure_kinect", "kinect_v1", "realsense_d455")
ANGLES = (15.0, 35.0, 55.0, 80.0)
"""Upper arms below the horizontal [deg]."""
MANNEQUINS = 6
TRUE_SURFACE = "true surface"
MAX_MEAN, MAX_P95, FAR, MIN_SHARE, MAX_SECONDS = 10.0, 25.0, 50.0, 95.0, 6.0


@dataclass(frozen=True)
class Found:
    """Errors (22,) of one body [mm], or why there is no skeleton; and what it took [s].

    ``placed`` are the errors that are left when the scan is laid over the true body (rigidly): what the scan's own
    shift in the camera's frame costs is no error of the fit.
    """

    body: str
    sensor: str
    angle: float
    errors: np.ndarray | None
    confidence: np.ndarray | None
    seconds: float
    refused: str = ""
    placed: np.ndarray | None = None


def scanned(body: Mesh, joints: np.ndarray, sensor: str, seed: int) -> tuple[Mesh, np.ndarray, Mesh]:
    """A body as a virtual rig with real optics sees it, avatar frame, and its true joints and surface there."""
    rig = default_rig(sensor, camera_height=float(np.ptp(body.vertices[:, 2])) / 2 + 0.1, seed=seed)
    rig = with_real_optics(rig)
    scan = reconstruct(simulate(body, rig).capture)
    there = scan.camera_to_avatar @ np.linalg.inv(rig.camera_to_avatar)
    return scan.mesh, transform(joints, there), body.transformed(there)


def measure(
    name: str, mesh: Mesh, joints: np.ndarray, sensor: str, angle: float, body: Mesh | None = None
) -> tuple[Found, Skeleton | None]:
    """Find a skeleton and hold it against the truth; ``body`` is the true surface where ``mesh`` is a scan of it."""
    start = time.perf_counter()
    try:
        skeleton = find_skeleton(mesh)
    except MirrorScanError as error:
        return Found(name, sensor, angle, None, None, time.perf_counter() - start, str(error)), None
    seconds = time.perf_counter() - start
    errors = 1000 * np.linalg.norm(skeleton.joints - joints, axis=1)
    placed = errors
    if body is not None:
        moved = transform(skeleton.joints, rigid_alignment(mesh, body))
        placed = 1000 * np.linalg.norm(moved - joints, axis=1)
    return Found(name, sensor, angle, errors, skeleton.confidence, seconds, placed=placed), skeleton


def run(
    bodies: Collection[int] | None = None,
    sensors: Sequence[str] = SENSORS,
    angles: Sequence[float] = ANGLES,
    pictures: Path | None = None,
) -> Result:
    """Every body by every sensor and arm angle, its true surface as well, and some mannequins."""
    subjects = [(body.name, body) for k, body in enumerate(rigged_bodies()) if bodies is None or k in bodies]
    if not subjects:
        say("No ../shared/data/rigged beside the checkout: only mannequins are measured.")
    found: list[Found] = []
    for number_, (name, body) in enumerate(subjects):
        for angle in angles:
            mesh, joints = with_arms(body, angle)
            for sensor in (TRUE_SURFACE, *sensors):
                found.append(_one(name, mesh, joints, sensor, angle, 100 * number_ + int(angle), pictures))
    for seed in range(MANNEQUINS):
        rng = np.random.default_rng([seed, 17])
        angle = angles[seed % len(angles)]
        figure = replace(random_figure(rng), arm_angle_deg=float(np.clip(angle, 20, 78)))
        mesh, skeleton = rigged_mannequin(float(rng.uniform(1.1, 1.95)), figure, resolution=0.012)
        sensor = (TRUE_SURFACE, *sensors)[seed % (len(sensors) + 1)]
        found.append(_one(f"mannequin {seed}", mesh, skeleton.joints, sensor, angle, 1000 + seed, pictures))
    return _result(found)


def _one(name, mesh, joints, sensor, angle, seed, pictures) -> Found:
    say(f"{name}, {sensor}, arms {angle:g}°")
    body = None
    if sensor != TRUE_SURFACE:
        try:
            mesh, joints, body = scanned(mesh, joints, sensor, seed)
        except MirrorScanError as error:
            return Found(name, sensor, angle, None, None, 0.0, str(error))
    found, skeleton = measure(name, mesh, joints, sensor, angle, body)
    if pictures is not None and skeleton is not None:
        pictures.mkdir(parents=True, exist_ok=True)
        file = pictures / f"joints {name} {sensor} {angle:g}.png"
        write_png(file, picture(mesh, skeleton.joints, joints))
    return found


def _result(found: list[Found]) -> Result:
    columns = ("bodies", "sensor", "arms °", "scans", "limbs mean", "95 %", "worst", "placed", "all mean", "95 %",
               "worst", "none > 50 %", "s")  # fmt: skip
    table = Table("Joints: errors [mm] against the true ones", columns, left=2)
    table.notes.append("The template was trained on none of these bodies.")
    table.notes.append("placed: limbs' mean when the scan is laid over the true body, so without the scan's own shift")
    people = [f for f in found if not f.body.startswith("mannequin")]
    figures = [f for f in found if f.body.startswith("mannequin")]
    for sensor in dict.fromkeys(f.sensor for f in people):
        of = [f for f in people if f.sensor == sensor]
        for angle in dict.fromkeys(f.angle for f in of):
            table.rows.append(_row("given", sensor, f"{angle:g}", [f for f in of if f.angle == angle]))
        table.rows.append(_row("given", sensor, "all", of))
    if figures:
        table.rows.append(_row("mannequins", "all", "all", figures))
    table.notes += sorted(
        {f"No skeleton of {f.body}, {f.sensor}, {f.angle:g}°: {f.refused}" for f in found if f.refused}
    )
    return Result([table], _findings(people, figures))


def _row(bodies: str, sensor: str, angle: str, of: list[Found]) -> tuple[str, ...]:
    errors = np.array([f.errors for f in of if f.errors is not None]).reshape(-1, len(BONES))
    cells = [bodies, sensor, angle, str(len(of))]
    placed = np.array([f.placed for f in of if f.placed is not None]).reshape(-1, len(BONES))
    cells += [number(value, 1) for value in _figures(errors[:, LIMBS])]
    cells.append(number(_figures(placed[:, LIMBS])[0], 1))
    cells += [number(value, 1) for value in _figures(errors)]
    cells.append(number(_share(of), 0))
    cells.append(number(float(np.median([f.seconds for f in of])), 1))
    return tuple(cells)


def _figures(errors: np.ndarray) -> tuple[float | None, float | None, float | None]:
    if not errors.size:
        return None, None, None
    return float(errors.mean()), float(np.percentile(errors, 95)), float(errors.max())


def _share(of: list[Found]) -> float:
    """Bodies with no joint off by more than ``FAR`` [%]; one without a skeleton is not among them."""
    return 100.0 * float(np.mean([f.errors is not None and f.errors.max() <= FAR for f in of]))


def _findings(people: list[Found], figures: list[Found]) -> list[Finding]:
    findings = []
    groups = {sensor: [f for f in people if f.sensor == sensor] for sensor in dict.fromkeys(f.sensor for f in people)}
    groups |= {"mannequins": figures} if figures else {}
    for name, of in groups.items():
        mean, p95, _ = _figures(np.array([f.errors[LIMBS] for f in of if f.errors is not None]))
        share = _share(of)
        findings += [
            _at_most(f"{name}: limb joints, mean", mean, MAX_MEAN),
            _at_most(f"{name}: limb joints, 95 %", p95, MAX_P95),
            Finding(
                f"{name}: no joint > {FAR:g} mm in ≥ {MIN_SHARE:g} % of bodies", f"{share:.0f} %", share >= MIN_SHARE
            ),
        ]
    slowest = float(np.median([f.seconds for f in [*people, *figures]]))
    findings.append(Finding(f"a skeleton in ≤ {MAX_SECONDS:g} s", f"{slowest:.1f} s", slowest <= MAX_SECONDS))
    return findings


def _at_most(what: str, value: float | None, limit: float) -> Finding:
    return Finding(f"{what} ≤ {limit:g} mm", number(value, 1), None if value is None else value <= limit)


# --- pictures --------------------------------------------------------------------------------------------------------


def picture(mesh: Mesh, joints: np.ndarray, truth: np.ndarray | None = None) -> np.ndarray:
    """Front and left side of a mesh, its bones drawn over it in red, true ones in blue."""
    directions, size = ((0, -1, 0), (1, 0, 0)), (320, 600)
    shown = render_views(mesh, None, directions, *size)
    for at, color in ((truth, (40, 120, 220)), (joints, (220, 50, 30))):
        if at is not None:
            bones = _sticks(at, mesh.vertices)
            drawn = render_views(bones, np.tile(np.uint8(color), (len(bones.vertices), 1)), directions, *size)
            over = np.abs(drawn.astype(int) - drawn[2, 2]).sum(axis=2) > 30
            shown[over] = color
    return shown


def _sticks(joints: np.ndarray, vertices: np.ndarray) -> Mesh:
    """Thin pyramids from each joint to its parent, and two slivers that keep the scale of ``vertices``."""
    points: list[np.ndarray] = []
    faces: list[tuple[int, int, int]] = []
    for bone, parent in enumerate(PARENTS):
        if parent >= 0:
            tip, base, first = joints[bone], joints[parent], len(points)
            across = np.cross(tip - base, (0.3, 0.5, 0.8))
            across *= 0.008 / np.linalg.norm(across)
            up = np.cross(tip - base, across)
            up *= 0.008 / np.linalg.norm(up)
            points += [tip, base + across, base - 0.5 * across + 0.87 * up, base - 0.5 * across - 0.87 * up]
            faces += [(first + a, first + b, first + c) for a, b, c in ((0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2))]
    for corner in (vertices.min(axis=0), vertices.max(axis=0)):
        faces.append((len(points), len(points) + 1, len(points) + 2))
        points += [corner, corner + (0, 0, 1e-6), corner + (1e-6, 0, 0)]
    return Mesh(np.array(points), np.array(faces, dtype=np.int32))


def main() -> None:
    parser = argparse.ArgumentParser("python -m benchmarks.rig_joints", description=__doc__.splitlines()[0])
    parser.add_argument(
        "--bodies", type=int, nargs="+", metavar="N", help="numbers of the given bodies; all by default"
    )
    parser.add_argument("--sensors", nargs="*", choices=SENSORS, default=SENSORS)
    parser.add_argument("--angles", type=float, nargs="+", default=ANGLES)
    parser.add_argument("--pictures", type=Path)
    options = parser.parse_args()
    result = run(options.bodies, options.sensors, options.angles, options.pictures)
    for table in (*result.tables, limits_table(result.findings)):
        print(f"\n{table.text()}")


if __name__ == "__main__":
    main()
