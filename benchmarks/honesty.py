"""Whether checks and stated errors mean something: planes turned or moved, sound ones, bowed glass; all sensors."""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from mirror_scan.core.camera import RgbdImage, unproject
from mirror_scan.core.capture import MirrorPicks
from mirror_scan.core.depth.sensor_recognition import measures_time
from mirror_scan.core.errors import MirrorScanError, Notice
from mirror_scan.core.io import read_mesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mirrors import Mirror
from mirror_scan.core.mirrors.curved_glass import flattened, without_delay
from mirror_scan.core.mirrors.mirror import oriented, reflect
from mirror_scan.core.pipeline import Settings, reconstruct
from mirror_scan.core.simulation.mannequin import mannequin, random_figure
from mirror_scan.core.simulation.multipath import by_one_way
from mirror_scan.core.simulation.optics import TRIPLES
from mirror_scan.core.simulation.rays import BODY
from mirror_scan.core.simulation.scene import Rig, default_rig, with_real_optics
from mirror_scan.core.simulation.sensors import find_sensor
from mirror_scan.core.simulation.simulate import Simulation, simulate

from .machine import say
from .results import Finding, Result, Table, number
from .scenes import SHARED

CAMERAS = {"azure_kinect": 2.5, "realsense_d455": 2.4, "kinect_v1": 2.75, "kinect_v2": 2.4}
"""Sensor -> distance of the subject that suits its field of view [m]."""
OPTICS = ("ideal", "real")
EFFECTS = ("multipath", "glass", "bow", "attenuation", "color", "noise")
"""Of those that apply to a sensor, see :func:`.optics.real`."""
RIGS = 8
SEED = 11
TURN_DEG, SHIFT_MM = 1.0, 15.0
BOWS_MM = (0.0, 1.0, 2.0, 3.0)
FAULTS = ("turned", "leaning", "moved")
COMPLAINTS = (
    "places the subject", "left out, because", "shows the floor about", "does not look like a mirror", "do not meet",
    "does not quite coincide", "lies off one plane", "is not one plane", "has moved", "plane is wrong",
)  # fmt: skip
"""Beginnings of warnings that call a plane wrong; what only says what was done with it is none."""


@dataclass
class Outcome:
    """What became of one group of rigs, mirrors by the error that was stated and by the true one [mm]."""

    rigs: int = 0
    faults: dict[str, list[bool]] = field(default_factory=lambda: defaultdict(list))
    false: list[str] = field(default_factory=list)
    sound: int = 0
    errors: list[tuple[float, float]] = field(default_factory=list)


@cache
def _bodies() -> tuple[str, ...]:
    found = sorted((SHARED / "data" / "bodies").glob("mh_*.ply"))
    if not found:
        say("No ../shared/data/bodies beside the checkout: only mannequins stand in the rigs.")
    return tuple(map(str, found))


def draw(sensor: str, real: bool, number: int, seed: int = SEED) -> tuple[Mesh, Rig, np.random.Generator]:
    """Body and rig, no two alike; the same ones with ideal optics as with real ones."""
    rng = np.random.default_rng((seed, number, sum(sensor.encode())))
    bodies = _bodies()
    kind = int(rng.integers(len(bodies) + 3))
    if kind < len(bodies):
        body = read_mesh(bodies[kind])
        body = replace(body, vertices=body.vertices * float(rng.uniform(0.85, 1.03)))
    else:
        figure = replace(random_figure(rng), arm_angle_deg=float(rng.uniform(35, 70)))
        body = mannequin(float(rng.uniform(1.5, 1.85)), figure, resolution=0.012)
    body = replace(body, vertices=body.vertices - (0.0, 0.0, body.vertices[:, 2].min()))
    rig = default_rig(
        sensor, CAMERAS[sensor] + rng.uniform(-0.1, 0.25), rng.uniform(112, 128), path_length=rng.uniform(4.5, 5.0),
        frame_width=rng.uniform(0.03, 0.05), lean_deg=rng.uniform(-1.5, 1.5, 2), camera_height=rng.uniform(0.85, 1.15),
        tilt_deg=rng.uniform(0, 5), roll_deg=rng.uniform(-3, 3), frames=10, seed=int(rng.integers(1 << 30)),
    )  # fmt: skip
    rig = replace(rig, pan_deg=float(rng.uniform(-2, 2)))
    if real:
        triple = TRIPLES[number % len(TRIPLES)] if sensor != "kinect_v2" else None
        rig = with_real_optics(rig, triple, EFFECTS)
    return body, rig, rng


def displaced(simulation: Simulation, mirrors: list[Mirror]) -> list[float | None]:
    """By how much each mirror misplaces what the camera sees of the body in it, without noise: median [mm]."""
    sight, rig, camera = simulation.truth.sight, simulation.rig, simulation.rig.intrinsics
    depth = sight.depth
    if find_sensor(rig.sensor).principle in ("phase", "pulse"):
        depth = by_one_way(sight, rig, np.zeros(depth.shape))
    image = RgbdImage(depth, camera)
    if measures_time(simulation.capture, Settings().depth) is not False:
        image = without_delay(image, mirrors)
    cloud = unproject(image.depth, camera)
    to_camera = np.linalg.inv(rig.camera_to_avatar)
    true = {m.name: k for k, m in enumerate(simulation.truth.mirrors)}
    out: list[float | None] = []
    for mirror in mirrors:
        k = true.get(mirror.name)
        mine = np.zeros(depth.shape, np.bool_) if k is None else (
            (sight.object == BODY) & (sight.bounces == 1) & (sight.view == k + 1)
        )  # fmt: skip
        if mine.sum() < 100:
            out.append(None)
            continue
        real = sight.point[mine] @ to_camera[:3, :3].T + to_camera[:3, 3]
        shown = reflect(flattened(cloud[mine], mirror), mirror)
        out.append(1000.0 * float(np.median(np.linalg.norm(shown - real, axis=1))))
    return out


def complaints(warnings: tuple[str, ...], name: str | None = None) -> list[str]:
    """Warnings that call a plane wrong; of one mirror, where a ``name`` is given."""
    return [
        str(w) for w in warnings
        if any(part in str(w) for part in COMPLAINTS) and (name is None or name in Notice.of(w).mirrors or name in w)
    ]  # fmt: skip


def faulty(simulation: Simulation, fault: str | None, which: int, sign: float) -> tuple[MirrorPicks, ...]:
    """The true planes as they would be given, one of them turned about the upright, leaning, or moved."""
    given = []
    for k, true in enumerate(simulation.truth.mirrors):
        normal, basis = oriented(np.asarray(true.normal), np.asarray(true.point))
        point = np.asarray(true.point, dtype=np.float64)
        if k == which and fault is not None:
            if fault == "moved":
                point = point + sign * SHIFT_MM / 1000.0 * normal
            else:
                normal = normal + sign * np.tan(np.radians(TURN_DEG)) * basis[:, 0 if fault == "turned" else 1]
        given.append(MirrorPicks(true.name, point=point, normal=normal / np.linalg.norm(normal)))
    return tuple(given)


def _warned(simulation: Simulation, mirrors: tuple[MirrorPicks, ...] | None) -> tuple[tuple[str, ...], list[Mirror]]:
    try:
        made = reconstruct(simulation.capture, mirrors)
    except MirrorScanError as error:
        return (f"{error}",), []
    return made.warnings, list(made.mirrors)


def judge(simulation: Simulation, rng: np.random.Generator, out: Outcome, verbose: str = "") -> None:
    """One rig with the picks of the capture, with its true planes, and with each fault of one of them."""
    out.rigs += 1
    for known in (None, faulty(simulation, None, 0, 1.0)):
        warnings, mirrors = _warned(simulation, known)
        out.sound += len(simulation.truth.mirrors)
        out.false += (told := complaints(warnings))
        for text in told if verbose else ():
            print(verbose, "sound", "picks" if known is None else "given", "FALSE", text[:150], flush=True)
        if known is None:
            body = simulation.truth.body.vertices[::7]
            for mirror, error in zip(mirrors, displaced(simulation, mirrors), strict=True):
                stated = mirror.displacement(body)
                if error is not None and stated is not None:
                    out.errors.append((error, 1000.0 * stated))
                    if verbose:
                        glass = f"sag {1000 * mirror.sag:.1f} thick {1000 * mirror.glass_thickness:.1f}"
                        print(verbose, mirror.name, f"{error:.1f} stated {1000 * stated:.1f}", mirror.moved_by, glass)
    for fault in FAULTS:
        which, sign = int(rng.integers(len(simulation.truth.mirrors))), float(rng.choice((-1.0, 1.0)))
        warnings, _ = _warned(simulation, faulty(simulation, fault, which, sign))
        hit = bool(complaints(warnings, simulation.truth.mirrors[which].name))
        out.faults[fault].append(hit)
        if verbose:
            print(verbose, fault, which, sign, "hit" if hit else f"MISSED {complaints(warnings)}", flush=True)


def run(seed: int = SEED, rigs: int = RIGS, cameras: tuple[str, ...] = tuple(CAMERAS), verbose: bool = False) -> Result:
    table = Table(
        f"Checks and stated errors (seed {seed}): planes turned by {TURN_DEG:g}° or moved by {SHIFT_MM:g} mm warned of",
        ("camera", "optics", "rigs", "turned", "leaning", "moved", "false, of sound", "error", "p95", "stated", "< 2 σ",
         "> σ / 2"),
        left=2,
    )  # fmt: skip
    table.notes = [
        "Turned: about the upright; leaning: about the level axis. Sound: mirrors by picks and by their true planes.",
        "Error: by how much a mirror placed by picks misplaces what is seen of the body in it, median [mm]; stated:",
        "what the report promises. Real: multipath, glass, bow, attenuation, colour, noise, as far as they apply.",
    ]
    groups: dict[tuple[str, str], Outcome] = defaultdict(Outcome)
    for sensor in cameras:
        for optics in OPTICS:
            say(f"honesty: {sensor}, {optics} optics")
            for k in range(rigs):
                body, rig, rng = draw(sensor, optics == "real", k, seed)
                judge(simulate(body, rig), rng, groups[sensor, optics], f"{sensor} {k}:" if verbose else "")
    for (sensor, optics), out in groups.items():
        table.rows.append((sensor, optics, *_figures(out)))
    bowed, told = _bowed(seed)
    return Result([table, bowed], [*_limits(list(groups.values())), *told])


def _figures(out: Outcome) -> tuple[str, ...]:
    errors, stated = np.array(out.errors).reshape(-1, 2).T
    hits = [f"{sum(out.faults[fault])} of {len(out.faults[fault])}" for fault in FAULTS]
    spread = [np.median(errors), np.quantile(errors, 0.95), np.median(stated)] if len(errors) else [None] * 3
    shares = [f"{share:.0%}" for share in _shares(out.errors)]
    return (
        str(out.rigs), *hits, f"{len(out.false)} of {out.sound}",
        *(number(None if v is None else float(v)) for v in spread), *shares,
    )  # fmt: skip


def _shares(errors: list[tuple[float, float]]) -> tuple[float, float]:
    """Of the mirrors, whose true error is within twice the stated one, and above half of it."""
    if not errors:
        return 0.0, 0.0
    true, stated = np.array(errors).T
    return float(np.mean(true <= 2.0 * stated)), float(np.mean(true >= 0.5 * stated))


def _limits(outcomes: list[Outcome]) -> list[Finding]:
    hits = [hit for out in outcomes for fault in FAULTS for hit in out.faults[fault]]
    false = sum(len(out.false) for out in outcomes)
    within, above = _shares([pair for out in outcomes for pair in out.errors])
    return [
        Finding("planes turned or moved: warned of in >= 90 %", f"{sum(hits)} of {len(hits)}", np.mean(hits) >= 0.9),
        Finding("sound planes: none warned of", str(false), false == 0),
        Finding("mirrors' errors within twice the stated ones in >= 90 %", f"{within:.0%}", within >= 0.9),
        Finding("mirrors' errors above half of the stated ones in >= 30 %", f"{above:.0%}", above >= 0.3),
    ]


def _bowed(seed: int, rigs: int = 3) -> tuple[Table, list[Finding]]:
    """Glass bowed along its height, mirrors by picks, light that comes one way."""
    table = Table(
        "Bowed mirrors: misplacement of the body seen in them [mm]",
        ("camera", "bow", "mirrors", "median", "max", "taken for flat", "stated", "< 2 σ", "called bowed", "on a wall"),
    )
    table.notes = ["Bow: how far the middle stands before or behind the ends of 1.75 m [mm].",
                   "Taken for flat: the median with the plane alone, as it was fitted."]  # fmt: skip
    flat_called = walls = 0
    medians: dict[tuple[str, float], float] = {}
    pairs: list[tuple[float, float]] = []
    worse = True
    for sensor in ("azure_kinect", "realsense_d455", "kinect_v1"):
        for bow in BOWS_MM:
            say(f"honesty: {sensor}, bow {bow:g} mm")
            errors, plain, stated, called, hung = [], [], [], 0, 0
            for k in range(rigs):
                body, rig, _ = draw(sensor, False, k, seed)
                signs = (1.0, -1.0) if k % 2 else (-1.0, 1.0)
                rig = replace(rig, mirrors=tuple(
                    replace(m, sag=(0.0, sign * bow / 1000.0)) for m, sign in zip(rig.mirrors, signs, strict=True)
                ))  # fmt: skip
                simulation = simulate(body, rig)
                warnings, mirrors = _warned(simulation, None)
                flat = [replace(m, sag=0.0) for m in mirrors]
                person = simulation.truth.body.vertices[::7]
                for m, error, as_flat in zip(
                    mirrors, displaced(simulation, mirrors), displaced(simulation, flat), strict=True
                ):
                    if error is None or as_flat is None:
                        continue
                    errors.append(error)
                    plain.append(as_flat)
                    stated.append(1000.0 * (m.displacement(person) or 0.0))
                    called += m.sag != 0.0
                hung += sum("wall" in str(w) for w in warnings)
            medians[sensor, bow] = float(np.median(errors))
            worse &= medians[sensor, bow] <= 1.1 * float(np.median(plain)) + 0.2
            if bow:
                pairs += zip(errors, stated, strict=True)
            flat_called, walls = flat_called + called * (bow == 0.0), walls + hung
            table.rows.append((
                sensor, f"{bow:g}", str(len(errors)), number(medians[sensor, bow]), number(max(errors)),
                number(float(np.median(plain))), number(float(np.median(stated))),
                f"{_shares(list(zip(errors, stated, strict=True)))[0]:.0%}", str(called), str(hung),
            ))  # fmt: skip
    ratio = max(medians["azure_kinect", bow] for bow in BOWS_MM) / max(medians["azure_kinect", 0.0], 1e-9)
    within = _shares(pairs)[0]
    return table, [
        Finding("bow of 0 to 3 mm, Azure: <= 1.5 x the displacement with flat glass", f"{ratio:.2f} x", ratio <= 1.5),
        Finding("bowed mirrors: no worse than their planes alone", "yes" if worse else "no", worse),
        Finding("bowed mirrors: stated error covers in >= 90 %", f"{within:.0%}", within >= 0.9),
        Finding("no flat mirror called bowed", str(flat_called), flat_called == 0),
        Finding("no framed mirror that stands free said to hang on a wall", str(walls), walls == 0),
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser("python -m benchmarks.honesty", description=__doc__)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--rigs", type=int, default=RIGS)
    parser.add_argument("--cameras", nargs="+", choices=tuple(CAMERAS), default=tuple(CAMERAS))
    parser.add_argument("--verbose", action="store_true", help="a line for each mirror and fault")
    options = parser.parse_args()
    result = run(options.seed, options.rigs, tuple(options.cameras), options.verbose)
    for one in result.tables:
        print(one.text())
    for finding in result.findings:
        print(f"{finding.limit}: {finding.measured}")
