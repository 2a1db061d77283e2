"""Measures of scanned bodies against the true ones: of the given bodies, and of mannequins.

``python -m benchmarks.look_measures [--quick] [--pictures DIR]``. What a file says of a bare body is the truth. What it
does not hold, and all of clothed bodies and mannequins, is measured in the same way on the true surface with true
joints: clothed bodies are judged by a tape over their clothes.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from mirror_scan.core.avatar.skeleton import Skeleton
from mirror_scan.core.avatar.skin_weights import skin_weights
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.io.images import write_png
from mirror_scan.core.measurements import Measurements, measure, view_errors
from mirror_scan.core.mesh import KIND_NAMES, Mesh
from mirror_scan.core.pipeline import Settings, reconstruct
from mirror_scan.core.preview.mesh_views import KIND_COLORS, SIDES, render_views
from mirror_scan.core.simulation.mannequin import random_figure, rigged_mannequin
from mirror_scan.core.simulation.scene import default_rig, with_real_optics
from mirror_scan.core.simulation.simulate import simulate

from .machine import say
from .results import Finding, Result, Table, limits_table, number
from .rigged_bodies import FOLDER, rigged_bodies

LIMITS = {"chest": 9.0, "waist": 9.0, "hip": 9.0, "thigh": 4.0, "calf": 4.0, "upper_arm": 4.0, "neck": 4.0,
          "height": 4.0}  # fmt: skip
"""ISO 20685-1: greatest mean difference to a tape [mm]."""
LENGTHS = ("height_standing", "inseam", "arm_length", "shoulder_width")
SENSOR = "azure_kinect"
OTHERS = ("realsense_d455", "kinect_v1")
MANNEQUINS = 6
SINGLE, HELD, WIDTH = 0.90, 0.90, 3.0
TAPE = (214, 40, 40)


@dataclass(frozen=True, eq=False)
class Subject:
    """Somebody with true joints, and the true measures [mm]."""

    name: str
    mesh: Mesh
    skeleton: Skeleton
    truth: dict[str, float]
    kind: str


@dataclass(frozen=True)
class Row:
    """One measure of one scan [mm]."""

    subject: str
    kind: str
    sensor: str
    name: str
    off: float
    error: float


@cache
def subjects(quick: bool) -> tuple[Subject, ...]:
    """The given bodies and some mannequins; two bare bodies and one mannequin when it shall be quick."""
    found = []
    bodies = [body for body in rigged_bodies() if not body.clothed][:2] if quick else rigged_bodies()
    for body in bodies:
        truth = {name: one.mm for name, one in measure(body.mesh, body.skeleton, body.weights).items()}
        if not body.clothed:
            truth |= stated(body.name)
        found.append(Subject(body.name, body.mesh, body.skeleton, truth, "clothed" if body.clothed else "bare"))
    for seed in range(1 if quick else MANNEQUINS):
        rng = np.random.default_rng([seed, 41])
        mesh, skeleton = rigged_mannequin(float(rng.uniform(1.25, 1.95)), random_figure(rng), resolution=0.01)
        made = measure(mesh, skeleton, skin_weights(mesh, skeleton))
        found.append(
            Subject(f"mannequin {seed}", mesh, skeleton, {name: one.mm for name, one in made.items()}, "mannequin")
        )
    return tuple(found)


def stated(name: str) -> dict[str, float]:
    """What the file of a given body says, both sides' mean [mm]."""
    held = json.loads((FOLDER / name / "measures.json").read_text())
    girths = held["girths"]
    found = {part: girths[part]["mm"] for part in ("chest", "waist", "hip", "neck")}
    for part in ("thigh", "calf", "upper_arm"):
        found[part] = float(np.mean([girths[f"{part}_{side}"]["mm"] for side in ("left", "right")]))
    return found | {"height": held["height_mm"], "height_standing": held["height_standing_mm"]}


def scanned(one: Subject, sensor: str, seed: int) -> tuple[Mesh, Measurements] | None:
    """What a virtual rig with real optics makes of a subject; None when it finds no skeleton."""
    rig = default_rig(sensor, camera_height=float(np.ptp(one.mesh.vertices[:, 2])) / 2 + 0.1, seed=seed)
    made = reconstruct(simulate(one.mesh, with_real_optics(rig)).capture, settings=Settings(skeleton=True))
    if made.skeleton is None or made.weights is None:
        return None
    return made.mesh, measure(made.mesh, made.skeleton, made.weights, view_errors(made.report))


def rows_of(one: Subject, sensor: str, measures: Measurements) -> list[Row]:
    return [
        Row(one.name, one.kind, sensor, name, found.mm - one.truth[name], found.error_mm)
        for name, found in measures.items()
    ]


def tables(quick: bool = False, pictures: Path | None = None) -> Result:
    """True surfaces, then scans: bare bodies and mannequins by ``SENSOR``, given bodies by other sensors by turns."""
    people = [one for one in subjects(quick) if one.kind != "mannequin"]
    figures = [one for one in subjects(quick) if one.kind == "mannequin"]
    bare = [one for one in people if one.kind == "bare"]
    jobs = [(one, SENSOR) for one in (*bare, *figures)]
    if not quick:
        jobs += [(one, sensor) for k, one in enumerate(people) for sensor in (OTHERS[k % 2], SENSOR)]
    if not people:
        say("No ../shared/data/rigged beside the checkout: only mannequins are measured.")
    rows: list[Row] = []
    missing: list[str] = []
    for one, sensor in dict.fromkeys(jobs):
        say(f"{one.name}, {sensor}")
        try:
            made = scanned(one, sensor, 700 + len(rows))
        except MirrorScanError as error:
            missing.append(f"{one.name}, {sensor}: {error}")
            continue
        if made is None:
            missing.append(f"{one.name}, {sensor}: no skeleton")
            continue
        rows += rows_of(one, sensor, made[1])
        if pictures is not None:
            pictures.mkdir(parents=True, exist_ok=True)
            write_png(pictures / f"measures {one.name} {sensor}.png", picture(*made))
    return judged(_on_true_surface(bare), rows, missing)


def _on_true_surface(bare: Sequence[Subject]) -> list[Row]:
    """What the definitions cost: the true surface with true joints against the files."""
    rigged = {body.name: body for body in rigged_bodies()}
    rows = []
    for one in bare:
        body = rigged[one.name]
        rows += rows_of(one, "true surface", measure(body.mesh, body.skeleton, body.weights))
    return rows


def judged(exact: list[Row], rows: list[Row], missing: list[str]) -> Result:
    """The tables and the limits."""
    columns = ("measure", "bodies", "n", "mean", "median abs.", "95 % abs.", "bound, median", "holds %", "limit")
    table = Table("Measures: differences to the truth [mm]", columns, left=2)
    main = [row for row in rows if row.sensor == SENSOR and row.kind in ("bare", "mannequin")]
    others = [row for row in rows if row not in main]
    for name in (*LIMITS, *LENGTHS):
        for title, of in (("true surface", exact), (SENSOR, main), ("others, clothed", others)):
            if found := [row for row in of if row.name == name]:
                table.rows.append((name, title, *_figures(found), number(LIMITS.get(name), 0)))
    table.notes += [f"Not measured: {text}" for text in missing]
    return Result([table], _findings(main, rows))


def _figures(of: Sequence[Row]) -> tuple[str, ...]:
    off, error = np.array([(row.off, row.error) for row in of]).T
    size = np.abs(off)
    values = (off.mean(), np.median(size), np.percentile(size, 95), np.median(error))
    return (
        str(len(of)),
        *(number(float(value), 1) for value in values),
        number(100 * float((size <= error).mean()), 0),
    )


def _findings(main: list[Row], rows: list[Row]) -> list[Finding]:
    findings, inside = [], []
    for name, limit in LIMITS.items():
        off = np.array([row.off for row in main if row.name == name])
        mean = abs(float(off.mean())) if len(off) else None
        inside += list(np.abs(off) <= 2 * limit)
        said = f"{name}: mean difference ≤ {limit:g} mm"
        findings.append(Finding(said, number(mean, 1), None if mean is None else mean <= limit))
    if inside:
        share = float(np.mean(inside))
        findings.append(
            Finding(f"single values within twice that ≥ {100 * SINGLE:g} %", f"{100 * share:.0f} %", share >= SINGLE)
        )
    if rows:
        off, error = np.abs([row.off for row in rows]), np.array([row.error for row in rows])
        held, width = float((off <= error).mean()), float(np.median(error) / np.median(off))
        findings.append(Finding(f"error_mm holds in ≥ {100 * HELD:g} %", f"{100 * held:.0f} %", held >= HELD))
        findings.append(Finding(f"its median ≤ {WIDTH:g} median true errors", f"{width:.1f}", width <= WIDTH))
    return findings


# --- pictures --------------------------------------------------------------------------------------------------------


def picture(mesh: Mesh, measures: Measurements) -> np.ndarray:
    """Four sides of a mesh, its kinds in pale colours, with the tapes about it."""
    points, triangles = _bands(measures, 0.0035)
    count = len(mesh.vertices)
    colors = np.full((count, 3), KIND_COLORS[0], np.uint8)
    if mesh.kind is not None:
        for kind in range(1, len(KIND_NAMES)):
            pale = np.uint8(0.6 * np.array(KIND_COLORS[0]) + 0.4 * np.array(KIND_COLORS[kind]))
            colors[mesh.triangles[mesh.kind == kind]] = pale
    both = Mesh(
        np.concatenate((mesh.vertices, points)), np.concatenate((mesh.triangles, triangles + count)).astype(np.int32)
    )
    colors = np.concatenate((colors, np.tile(np.array(TAPE, np.uint8), (len(points), 1))))
    return render_views(both, colors, list(SIDES.values()), 420, 760)


def _bands(measures: Measurements, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Three-sided tubes along all tapes."""
    points: list[np.ndarray] = []
    triangles: list[tuple[int, int, int]] = []
    for one in measures.values():
        for loop in one.loops:
            ends = np.roll(loop, -1, axis=0)
            for start, end in list(zip(loop, ends, strict=True))[: None if one.closed else -1]:
                along = end - start
                if np.linalg.norm(along) < 1e-6:
                    continue
                aside = np.cross(along, np.eye(3)[np.abs(along).argmin()])
                aside *= radius / np.linalg.norm(aside)
                across = np.cross(along, aside) / np.linalg.norm(along)
                corners = [aside, -0.5 * aside + 0.87 * across, -0.5 * aside - 0.87 * across]
                first = len(points)
                points += [start + corner for corner in corners] + [end + corner for corner in corners]
                for k in range(3):
                    after = (k + 1) % 3
                    triangles.append((first + k, first + after, first + 3 + k))
                    triangles.append((first + after, first + 3 + after, first + 3 + k))
    return np.array(points), np.array(triangles)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two bodies and one mannequin")
    parser.add_argument("--pictures", type=Path, help="folder for pictures of the tapes")
    options = parser.parse_args()
    result = tables(options.quick, options.pictures)
    for table in (*result.tables, limits_table(result.findings)):
        print(table.text(), end="\n\n")


if __name__ == "__main__":
    main()
