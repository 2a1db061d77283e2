"""The paper's rivals with real optics: error over sway on a turntable, three cameras, and what misplacement costs.

``python -m benchmarks --only shutter`` calls :func:`tables`; alone: ``python -m benchmarks.shutter_rivals [--quick]``.
"""

from __future__ import annotations

import sys

from mirror_scan.core.experiments import cameras, turntable
from mirror_scan.core.experiments.turntable import SNAPSHOT, Row
from mirror_scan.core.registration.pairwise import BACKENDS
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.optics import real

from .machine import installed, say
from .results import Finding, Result, Table, number

SENSORS = ("azure_kinect", "kinect_v1")
FRAMES = 5
SWAYS, FEW_SWAYS = turntable.SWAYS, (0.0, 0.01)
QUICK = {"shifts": (0.0, 0.01), "turns": (0.5,)}


def tables(quick: bool = False) -> Result:
    """The curves, and where the single snapshot wins and loses; quick: one sensor, few points."""
    result = Result()
    for sensor in SENSORS[:1] if quick else SENSORS:
        _turntable(result, sensor, FEW_SWAYS if quick else SWAYS)
        _cameras(result, sensor, QUICK if quick else {})
    return result


def _turntable(result: Result, sensor: str, sways: tuple[float, ...]) -> None:
    limit = f"turntable, {sensor}: {1e3 * sways[-1]:g} mm of sway show in the error"
    if not any(installed(name) for name in BACKENDS):
        result.findings.append(Finding(limit, f"neither {' nor '.join(BACKENDS)} is installed", None))
        return
    say(f"turntable, {sensor}")
    rows = turntable.run(mannequin(), sensor, FRAMES, 0, sways, optics=real(sensor))
    table = Table(
        f"Turntable of {turntable.SCANS} scans beside the single snapshot: {sensor}, real optics",
        ("way", "sway [mm]", "to the body, mean [mm]", "95 %", "of the body, mean [mm]", "95 %", "volume [%]",
         "ICP residual [mm]", "pairs corrected [mm]", "warned"),
    )  # fmt: skip
    for row in rows:
        sway = "–" if row.way == SNAPSHOT else number(1e3 * row.sway, 1)
        volume = row.distances.get("volume_error_pct")
        registered = [number(1e3 * value if value == value else None) for value in (row.residual, row.corrected)]
        table.rows.append((row.way, sway, *_figures(row), number(volume), *registered, "yes" if row.warned else "no"))
    table.notes = [*turntable.verdict(rows), *(f"{1e3 * row.sway:g} mm: {row.fault}" for row in rows if row.fault)]
    result.tables.append(table)
    still, worst = rows[1], rows[-1]
    shown = "no avatar" if worst.mesh is None else f"{worst.error:.2f} mm"
    worse = still.mesh is not None and not worst.error <= still.error  # no avatar at all is worse, too
    result.findings.append(Finding(limit, f"{still.error:.2f} mm without, {shown} with", worse))


def _cameras(result: Result, sensor: str, levels: dict) -> None:
    say(f"three cameras, {sensor}")
    outcome = cameras.run(mannequin(), sensor, FRAMES, 0, real(sensor), **levels)
    table = Table(
        f"Three cameras beside two mirrors: {sensor}, real optics",
        ("way", "poses", "floor [m]", "m²", "without reading [%]", "pose wrong by [mm]", "[°]",
         "to the body, mean [mm]", "95 %", "of the body, mean [mm]", "95 %"), left=2,
    )  # fmt: skip
    for one in outcome.arrangements:
        width, depth = one.floor
        wrong = [number(value if value == value else None) for value in (1e3 * one.shift, one.turn)]
        table.rows.append((one.row.way, one.poses, f"{width:.2f} × {depth:.2f}", number(width * depth, 1),
                           number(100 * one.unread, 1), *wrong, *_figures(one.row)))  # fmt: skip
    table.notes = [*cameras.verdict(outcome), *(f"{one.row.way}, {one.poses}: {one.row.fault}"
                                                for one in outcome.arrangements if one.row.fault)]  # fmt: skip
    moved = Table(
        f"What it costs when a camera or a mirror moved: {sensor}, real optics",
        ("what moved", "by [mm]", "by [°]", "to the body, mean [mm]", "95 %", "of the body, mean [mm]", "95 %"),
    )  # fmt: skip
    for other in outcome.misplaced:
        moved.rows.append((other.row.way, number(1e3 * other.shift, 0), number(other.turn), *_figures(other.row)))
    result.tables += [table, moved]
    still, *rest = [one for one in outcome.misplaced if one.row.way == cameras.FOUND_AGAIN]
    worst = max(rest, key=lambda one: one.row.error if one.row.error == one.row.error else 1e9)
    result.findings.append(
        Finding(
            f"cameras, {sensor}: a mirror that moved and is found again costs less than .5 mm",
            f"{still.row.error:.2f} mm, moved {worst.row.error:.2f} mm at most",
            worst.row.error < still.row.error + 0.5,
        )
    )


def _figures(row: Row) -> tuple[str, ...]:
    """Mean and 95 % both ways; dashes where there is no avatar."""
    names = ("accuracy_mean", "accuracy_p95", "complete_mean", "complete_p95")
    return tuple(number(row.distances.get(name)) for name in names)


if __name__ == "__main__":
    made = tables("--quick" in sys.argv[1:])
    for shown in made.tables:
        print(f"\n{shown.text()}")
    for finding in made.findings:
        print(f"{finding.limit}: {finding.measured}")
