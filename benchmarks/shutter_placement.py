"""*Find a Rig* in six rooms with three sensors, against the README's placement: predicted, and scanned.

Part of ``python -m benchmarks --only shutter``, or alone: ``python -m benchmarks.shutter_placement [--quick]``.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.mesh.surface_distance import evaluate
from mirror_scan.core.pipeline import reconstruct
from mirror_scan.core.rig_planning.area_coverage import AreaCoverage, area_coverage, body_samples
from mirror_scan.core.rig_planning.placement_search import find_placement
from mirror_scan.core.rig_planning.predicted_error import PredictedError, predicted_error
from mirror_scan.core.rig_planning.rooms import Room
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.scene import Rig, default_rig, with_real_optics
from mirror_scan.core.simulation.simulate import simulate
from scipy.stats import spearmanr

from .machine import say
from .results import Finding, Result, Table, number, yes

ROOMS = (
    Room(2.6, 3.2, 2.4), Room(3.0, 3.5, 2.4), Room(3.2, 4.0, 2.4), Room(3.0, 6.0, 2.3), Room(4.0, 5.0, 2.5),
    Room(6.0, 7.5, 2.8),
)  # fmt: skip
SENSORS = ("azure_kinect", "kinect_v1", "realsense_d455")
EFFECTS = ("multipath", "glass", "bow", "attenuation", "color")
"""Of the light and the glass that scans are made with, as in the table `optics`."""
OTHERS = ((2.2, 110.0, 3.8), (2.5, 135.0, 4.2), (2.8, 120.0, 5.2), (3.2, 105.0, 5.6), (2.5, 150.0, 5.0))
"""Rigs that nobody searched: distance [m], direction [degrees], way by a mirror [m]."""
MAX_SECONDS, MAX_WORSE = 20.0, 1.05
"""Of a search; and measured error over the README's, for the noise of a single scan."""
FRAMES = 10


@dataclass(frozen=True)
class _Scanned:
    """A rig, what was predicted of it, and what a scan with it measured [mm]; NaN where nothing came of it."""

    sensor: str
    name: str
    rig: Rig
    coverage: AreaCoverage
    error: PredictedError
    measured: float
    seconds: float = 0.0
    readme: bool = False


def tables(quick: bool = False) -> Result:
    """Search, scan and compare; ``quick``: two rooms and a sensor."""
    rooms, sensors = (ROOMS[1:3], SENSORS[:1]) if quick else (ROOMS, SENSORS)
    others = OTHERS[:2] if quick else OTHERS
    known, found, rest = {}, [], []
    for sensor in sensors:
        say(f"placement: {sensor}")
        known[sensor] = _scanned(sensor, "README", default_rig(sensor, frames=FRAMES))
        found += [_found(sensor, room) for room in rooms]
        for distance, angle, path in others:
            rig = default_rig(sensor, distance, angle, path_length=path, frames=FRAMES)
            rest.append(_scanned(sensor, f"{distance:g} m, {angle:g}°, {path:g} m", rig))
    result = Result([_found_table(known, found), _rank_table(known, found, rest)])
    result.findings += _findings(known, found)
    result.findings.append(_rank_finding(known, found, rest))
    return result


def _found(sensor: str, room: Room) -> _Scanned:
    body = mannequin(resolution=0.015)
    start = time.perf_counter()
    placement = find_placement(room, sensor, body=body)
    seconds = time.perf_counter() - start
    name = f"{room.width:g} × {room.depth:g} m"
    return replace(_scanned(sensor, name, placement.rig), seconds=seconds, readme=placement.readme)


def _scanned(sensor: str, name: str, rig: Rig) -> _Scanned:
    samples = body_samples(mannequin(resolution=0.015))
    coverage = area_coverage(samples, rig)
    return _Scanned(sensor, name, rig, coverage, predicted_error(samples, coverage, rig), measured_error(rig))


def measured_error(rig: Rig) -> float:
    """Mean distance of a scan's avatar from the body, both ways [mm]; NaN when there is none."""
    simulation = simulate(mannequin(), with_real_optics(rig, effects=EFFECTS))
    try:
        result = reconstruct(simulation.capture)
    except MirrorScanError as error:
        say(f"  {error}")
        return float("nan")
    truth = simulation.truth.body.transformed(np.array(result.report["camera_to_avatar"]))
    distances = evaluate(result.mesh, truth, align=True, samples=20_000)
    return 0.5 * (distances["accuracy_mean"] + distances["complete_mean"])


def _found_table(known: dict[str, _Scanned], found: list[_Scanned]) -> Table:
    table = Table(
        "Find a Rig: the placement found in a room, beside the README's (2.5 m, 120°, 4.6 m)",
        ("sensor", "room", "README fits", "seen [%]", "README", "predicted [mm]", "README ", "scanned [mm]", "README  ",
         "search [s]"), left=3,
    )  # fmt: skip
    for one in found:
        other = known[one.sensor]
        table.rows.append(
            (one.sensor, one.name, yes(one.readme), number(100 * one.coverage.share, 1),
             number(100 * other.coverage.share, 1), number(one.error.mean_mm), number(other.error.mean_mm),
             number(one.measured), number(other.measured), number(one.seconds, 1))
        )  # fmt: skip
    table.notes.append(f"scans with {', '.join(EFFECTS)}; mean of both directions, after rigid alignment")
    return table


def _rank_table(known: dict[str, _Scanned], found: list[_Scanned], rest: list[_Scanned]) -> Table:
    table = Table(
        "Predicted and scanned errors of all these rigs: Spearman's rank correlation",
        ("sensor", "rigs", "predicted [mm]", "scanned [mm]", "correlation"),
    )
    for sensor, rigs in _by_sensor(known, found, rest):
        predicted, measured = (
            [getter(rig) for rig in rigs] for getter in (lambda r: r.error.mean_mm, lambda r: r.measured)
        )
        table.rows.append(
            (sensor, str(len(rigs)), f"{min(predicted):.2f} to {max(predicted):.2f}",
             f"{min(measured):.2f} to {max(measured):.2f}", number(_correlation(rigs)))
        )  # fmt: skip
    return table


def _by_sensor(
    known: dict[str, _Scanned], found: list[_Scanned], rest: list[_Scanned]
) -> Iterator[tuple[str, list[_Scanned]]]:
    """Rigs that a scan was made with, by sensor and last all together."""
    everything = [rig for rig in (*known.values(), *found, *rest) if np.isfinite(rig.measured)]
    for sensor in known:
        yield sensor, [rig for rig in everything if rig.sensor == sensor]
    yield "all", everything


def _correlation(rigs: list[_Scanned]) -> float | None:
    if len(rigs) < 3:
        return None
    return float(spearmanr([rig.error.mean_mm for rig in rigs], [rig.measured for rig in rigs]).statistic)


def _findings(known: dict[str, _Scanned], found: list[_Scanned]) -> Iterator[Finding]:
    fits = [one for one in found if one.readme]
    worst = max(one.seconds for one in found)
    yield Finding(f"a search takes at most {MAX_SECONDS:g} s", f"{worst:.1f} s", worst <= MAX_SECONDS)
    for words, holds in (
        ("coverage", lambda one, other: one.coverage.share >= other.coverage.share - 0.005),
        ("predicted error", lambda one, other: one.error.mean_mm <= other.error.mean_mm * 1.005),
        ("scanned error", lambda one, other: one.measured <= MAX_WORSE * other.measured),
    ):
        for where, rigs in (("where it fits", fits), ("in all rooms", found)):
            good = sum(bool(holds(one, known[one.sensor])) for one in rigs)
            yield Finding(f"{words} as good as the README's {where}", f"{good} of {len(rigs)}", good == len(rigs))


def _rank_finding(known: dict[str, _Scanned], found: list[_Scanned], rest: list[_Scanned]) -> Finding:
    value = _correlation(list(_by_sensor(known, found, rest))[-1][1])
    return Finding(
        "predicted errors rank rigs as scans do: correlation of all ≥ 0.7", number(value),
        None if value is None else value >= 0.7,
    )  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser("python -m benchmarks.shutter_placement")
    parser.add_argument("--quick", action="store_true", help="two rooms and one sensor")
    made = tables(parser.parse_args().quick)
    for table in made.tables:
        print(f"\n{table.text()}")
    for finding in made.findings:
        print(f"{finding.limit}: {finding.measured} ({finding.passed})")
    sys.exit(0)
