"""Mirrors without picks in rigs drawn at random: every mirror found, its plane right, its stated error true.

``python -m benchmarks --only rigs``, or other rigs: ``python -m benchmarks.rigs --seed 7 --rigs 24``. Children to tall,
arms down to raised; a quarter of the rigs has one upright side of each frame in the picture. Kinect v1 and phase
cameras lose readings where light comes two ways; D455 and phone get nothing back from dark cloth, and lose some at
random. With ``--losses optics`` phase cameras misread and lose what :mod:`mirror_scan.core.simulation.optics` says, the
frames' bars too, and a D455 gets what dark cloth returns.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from mirror_scan.core.camera import Intrinsics, RgbdImage
from mirror_scan.core.capture import MirrorPicks
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.errors import MirrorError
from mirror_scan.core.io import read_mesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.bvh import build_bvh
from mirror_scan.core.mirror_detection.detection import find_mirrors
from mirror_scan.core.mirrors import Mirror
from mirror_scan.core.mirrors.mirror import plane_mirror, reflect
from mirror_scan.core.pipeline import Settings
from mirror_scan.core.pipeline.mirror_placement import place_mirrors
from mirror_scan.core.simulation.mannequin import mannequin, random_figure
from mirror_scan.core.simulation.optics import real
from mirror_scan.core.simulation.rays import BODY, lit
from mirror_scan.core.simulation.scene import Rig, default_rig
from mirror_scan.core.simulation.simulate import Simulation, simulate

from .machine import milliseconds, say
from .results import Finding, Result, Table, number
from .scenes import SHARED

RIGS = 120
SEED = 4101
FAR_MM = 100.0
"""A mirror that is found but puts the body this far off is a false one."""
LIMIT_MM = {"kinect_v1": 7.0}
LIMIT_ELSE_MM = 4.0
TORN, PATCHY = ("kinect_v1", "azure_kinect", "femto_bolt"), ("realsense_d455", "phone")
CAMERAS = ("kinect_v1", "azure_kinect", "realsense_d455", "phone", "kinect_v1", "femto_bolt", "realsense_d455", "ideal")
PHONE = Intrinsics(256, 192, 213.0, 213.0, 127.5, 95.5)
PHONE_NOISE = 0.002, 0.0005  # a + b z² [m]
SEEN_TWICE = (0.02, 0.4)  # share of other light, between which phase cameras give up more and more readings
OPTICS, DRAWN = "optics", "drawn"
EFFECTS_SEEN = ("multipath", "attenuation", "dark")
POSES = ("body", "body", "armsup", "tpose")


@dataclass(frozen=True)
class Drawn:
    """A rig of the distribution: its number, camera, kind, and the virtual snapshot."""

    number: int
    camera: str
    one_side: bool
    simulation: Simulation
    depth: np.ndarray

    @property
    def limit(self) -> float:
        return LIMIT_MM.get(self.camera, LIMIT_ELSE_MM)


@cache
def _bodies() -> tuple[str, ...]:
    rigged = sorted((SHARED / "data" / "rigged").glob("*/body.ply"))
    if not rigged:
        say("No ../shared/data/rigged beside the checkout: only mannequins stand in the rigs.")
    return tuple(str(path) for path in rigged) + tuple(
        str(path) for path in sorted((SHARED / "data" / "bodies").glob("mh_*.ply"))
    )


def draw_body(rng: np.random.Generator) -> Mesh:
    """Somebody of 1.1 to 1.95 m, arms down to raised, feet on the floor."""
    bodies = _bodies()
    kind = int(rng.integers(len(bodies) + 5))
    if kind >= len(bodies):
        figure = replace(random_figure(rng), arm_angle_deg=float(rng.uniform(20, 78)))
        body = mannequin(float(rng.uniform(1.1, 1.95)), figure, resolution=0.012)
    else:
        path = bodies[kind]
        body = read_mesh(path)
        pose = POSES[rng.integers(len(POSES))]
        if pose != "body" and path.endswith("body.ply"):
            body = replace(body, vertices=np.load(f"{path[:-8]}poses/{pose}.npy").astype(np.float64))
        elif not path.endswith("body.ply"):
            body = replace(body, vertices=body.vertices * float(rng.uniform(0.7, 1.15)))
    turn = np.radians(rng.uniform(-8.0, 8.0))
    c, s = np.cos(turn), np.sin(turn)
    vertices = body.vertices @ np.array(((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)))
    return replace(body, vertices=vertices - (0.0, 0.0, vertices[:, 2].min()))


def draw_rig(number: int, seed: int = SEED, losses: str = DRAWN) -> tuple[Mesh, Rig, str, bool]:
    """Body, rig, camera and whether only one upright side of each frame is in the picture; by the number alone."""
    rng = np.random.default_rng((seed, number))
    camera, one_side = CAMERAS[(number // 4 + number) % len(CAMERAS)], number % 4 == 3
    sensor = "ideal" if camera == "phone" else camera
    for _ in range(400):
        body = draw_body(rng)
        height = float(body.vertices[:, 2].max())
        for _ in range(60):
            small = one_side and camera in PATCHY
            distance = rng.uniform(1.2, 2.4) if small else rng.uniform(1.7, 2.9)
            rig = default_rig(
                sensor, distance, mirrors=(rng.uniform(100, 128), -rng.uniform(100, 128)),
                path_length=distance + (rng.uniform(1.6, 2.3) if small else rng.uniform(1.9, 2.5)),
                mirror_size=(rng.uniform(0.7, 1.1 if one_side else 1.0), rng.uniform(1.6, 2.1)),
                frame_width=rng.uniform(0.03, 0.05), lean_deg=rng.uniform(-2, 2, 2), tilt_deg=rng.uniform(-2, 7),
                camera_height=0.5 * height + rng.uniform(-0.1, 0.4), roll_deg=rng.uniform(-3, 3),
                frames=int(rng.choice((1, 3, 4, 10, 15))), seed=int(rng.integers(1 << 30)),
                interference=True if camera == "kinect_v1" else None,
            )  # fmt: skip
            if camera == "phone":
                rig = replace(rig, intrinsics=PHONE)
            elif losses == OPTICS:
                rig = replace(rig, optics=real(sensor, unit=number, effects=EFFECTS_SEEN))
            on_floor = one_side or rng.random() < 0.5  # the glass begins there, no bar is below it
            lift = np.zeros(2) if on_floor else rng.uniform(0.04, 0.2, 2)
            rig = replace(rig, pan_deg=float(rng.uniform(-2, 2)), mirrors=tuple(
                replace(m, centre=(*m.centre[:2], m.height / 2 + float(z)))
                for m, z in zip(rig.mirrors, lift, strict=True)
            ))  # fmt: skip
            if _fits(body, rig, one_side):
                return body, rig, camera, one_side
    raise AssertionError(f"rig {number} of seed {seed} fits no picture")


def _pixels(points: np.ndarray, rig: Rig) -> np.ndarray:
    """Where points (N, 3), avatar frame, are in the picture: as shares of its size, (N, 2)."""
    pose, k = rig.camera_to_avatar, rig.intrinsics
    x, y, z = ((points - pose[:3, 3]) @ pose[:3, :3]).T
    z = np.maximum(z, 0.05)
    return np.column_stack(((x / z * k.fx + k.cx) / k.width, (y / z * k.fy + k.cy) / k.height))


def _fits(body: Mesh, rig: Rig, one_side: bool) -> bool:
    """The body and its reflections are whole, and of the frames both uprights, or the inner one alone, are seen."""
    points = body.vertices[:: len(body.vertices) // 400]
    seen = _pixels(points, rig)
    if ((seen < 0.015) | (seen > 0.985)).any():
        return False
    low, high = seen.min(axis=0), seen.max(axis=0)
    for m in rig.mirrors:
        right, up, normal = m.axes
        if (points - m.centre) @ normal @ np.ones(len(points)) < 0.25 * len(points):
            return False
        image = points - 2.0 * ((points - m.centre) @ normal)[:, None] * normal
        at = _pixels(image, rig)
        if ((at < 0.01) | (at > 0.99)).mean() > 0.0:
            return False
        eye = np.array(rig.camera)
        share = ((np.array(m.centre) - eye) @ normal) / ((image - eye) @ normal)
        place = (eye + share[:, None] * (image - eye) - m.centre) @ np.column_stack((right, up))
        if (np.abs(place[:, 0]) > m.width / 2).any() or (np.abs(place[:, 1]) > m.height / 2).mean() > 0.06:
            return False
        if ((at > low) & (at < high)).all(axis=1).mean() > 0.35:  # hidden behind the body
            return False
        bars = []
        for sign in (-1.0, 1.0):
            x = np.full(21, sign * (m.width / 2 + m.frame_width / 2))
            y = np.linspace(-0.45, 0.5, 21) * m.height
            bars.append(_pixels(np.array(m.centre) + x[:, None] * right + y[:, None] * up, rig)[:, 0])
        bars.sort(key=lambda bar: abs(bar.mean() - 0.5))
        inner, outer = bars
        if ((inner < 0.02) | (inner > 0.98)).any() or (low[0] < inner.mean() < high[0]):
            return False
        x = np.linspace(-0.5, 0.5, 21) * m.width
        y = np.full(21, m.height / 2 + m.frame_width / 2)
        top = _pixels(np.array(m.centre) + x[:, None] * right + y[:, None] * up, rig)
        top_seen = ((top > 0.005) & (top < 0.995)).all(axis=1).mean()
        out = ((outer < -0.01) | (outer > 1.01)).mean()
        if one_side and (out < 1.0 or top_seen > 0.3):
            return False
        if not one_side and out > 0.0 and top_seen < 0.5:
            return False
    return True


def draw(number: int, seed: int = SEED, losses: str = DRAWN) -> Drawn:
    """The virtual snapshot of a rig, as the real camera would lose readings of it."""
    body, rig, camera, one_side = draw_rig(number, seed, losses)
    simulation = simulate(body, rig)
    rng = np.random.default_rng((seed, number, 1))
    depth = simulation.capture.depth
    if camera == "phone":
        a, b = PHONE_NOISE
        depth = np.where(depth > 0, depth + (a + b * depth**2) * rng.standard_normal(depth.shape, np.float32), 0)
        depth = np.where(depth < 6.0, np.rint(depth * 1000.0) / 1000.0, 0).astype(np.float32)
    if camera in PATCHY:
        lost = _holes(depth.shape[1:], rng)
        if losses == DRAWN or camera == "phone":
            lost |= _dark(simulation, rng)
        depth = np.where(lost, np.float32(0.0), depth)
    elif camera in TORN and camera != "kinect_v1" and losses == DRAWN:
        depth = np.where(_given_up(simulation, rng), np.float32(0.0), depth)
    named = "unknown" if camera == "ideal" else camera  # as the files of real ones name it
    capture = replace(simulation.capture, depth=depth, sensor=named)
    return Drawn(number, camera, one_side, replace(simulation, capture=capture), one_depth_map(capture)[0])


def _dark(simulation: Simulation, rng: np.random.Generator) -> np.ndarray:
    """Pixels (H, W) of a dark jacket or dark trousers, which give little back: little of it at a slant, or far away."""
    sight = simulation.truth.sight
    height = sight.point[..., 2]
    tall = float(np.ptp(simulation.truth.body.vertices[:, 1]))
    low, high = ((0.48, 0.82), (0.05, 0.5))[rng.integers(2)] if rng.random() < 0.7 else (2.0, 3.0)
    cloth = (sight.object == BODY) & (height > low * tall) & (height < high * tall)
    lost = np.clip(0.15 + 0.12 * (sight.depth - 1.5) + 0.6 * (sight.incidence - 0.6), 0.0, 0.85)
    return cloth & (_blobs(lost.shape, rng) < lost)


def _holes(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Readings that are missing for no reason: up to 4 % of the picture, in blobs."""
    return _blobs(shape, rng) < rng.uniform(0.0, 0.04)


def _blobs(shape: tuple[int, int], rng: np.random.Generator, size: int = 5) -> np.ndarray:
    """Even random numbers (H, W) that neighbours share."""
    coarse = rng.random((shape[0] // size + 2, shape[1] // size + 2))
    rows = (np.arange(shape[0])[:, None] + rng.integers(0, size, (1, shape[1]))) // size
    columns = (np.arange(shape[1])[None, :] + rng.integers(0, size, (shape[0], 1))) // size
    return coarse[rows, columns]


def _given_up(simulation: Simulation, rng: np.random.Generator) -> np.ndarray:
    """Pixels (H, W) that a phase camera gives up, since light comes two ways: the more, the stronger the other way."""
    sight, rig = simulation.truth.sight, simulation.rig
    vertices = np.ascontiguousarray(_in_avatar_frame(simulation))
    bvh = build_bvh(vertices, np.ascontiguousarray(simulation.truth.body.triangles, dtype=np.int32))
    light = lit(sight, bvh, rig, 0.0)
    once = sight.bounces <= 1
    own = np.take_along_axis(light, np.where(once, sight.view, 0)[..., None].astype(np.intp), axis=-1)[..., 0]
    ratio = np.where(own > 0, (light.sum(axis=-1) - own) / np.maximum(own, 1e-9), 0.0)
    low, high = SEEN_TWICE
    chance = np.clip((ratio - low) / (high - low), 0.0, 1.0) * rng.uniform(0.3, 0.9)
    return once & (sight.object == BODY) & (_blobs(chance.shape, rng, 4) < chance)


def _in_avatar_frame(simulation: Simulation) -> np.ndarray:
    pose = simulation.truth.camera_to_avatar
    return simulation.truth.body.vertices @ pose[:3, :3].T + pose[:3, 3]


def displacement(mirror: Mirror, true: MirrorPicks, body: np.ndarray) -> float:
    """Median distance [mm] by which the mirror's error moves the reflected body."""
    apart = reflect(body, mirror) - reflect(body, plane_mirror(true.name, true.point, true.normal))
    return 1000.0 * float(np.median(np.linalg.norm(apart, axis=1)))


@dataclass
class Outcome:
    """What became of one rig: of each true mirror its displacement and the stated error [mm]; None = not found."""

    drawn: Drawn
    found: list[tuple[float, float] | None] = field(default_factory=list)
    false: int = 0
    spent: float = 0.0

    @property
    def whole(self) -> bool:
        return not self.false and all(one is not None and one[0] <= self.drawn.limit for one in self.found)


def judge(drawn: Drawn) -> Outcome:
    """The mirrors of a rig, found without a pick and aligned as a reconstruction does, against the truth."""
    capture, truth = drawn.simulation.capture, drawn.simulation.truth
    body = truth.body.vertices[::5]
    spent, _ = milliseconds(lambda: find_mirrors(RgbdImage(drawn.depth, capture.intrinsics, capture.color)))
    try:
        mirrors = place_mirrors((), drawn.depth, replace(capture, mirrors=()), Settings())[0]
    except MirrorError:
        mirrors = []
    apart = np.array([[displacement(m, t, body) for t in truth.mirrors] for m in mirrors]).reshape(-1, 2)
    out = Outcome(drawn, spent=spent)
    for column in apart.T:
        if not len(column) or column.min() >= FAR_MM:
            out.found.append(None)
            continue
        mirror = mirrors[int(column.argmin())]
        out.found.append((float(column.min()), 1000.0 * (mirror.displacement(body) or 0.0)))
    hits = sum(one is not None for one in out.found)
    out.false = len(mirrors) - hits
    return out


def run(seed: int = SEED, rigs: int = RIGS, losses: str = DRAWN) -> Result:
    table = Table(
        f"Rigs drawn at random (seed {seed}): mirrors without a pick, displacement of the reflected body [mm]",
        ("camera", "one side", "rigs", "whole", "not found", "false", "median", "p95", "max", "stated", "< 2 σ",
         "> σ / 2", "ms"),
        left=2,
    )  # fmt: skip
    table.notes = [
        "Whole: every mirror found, none false, each displaces the body by <= 7 mm (Kinect v1) or 4 mm.",
        "Stated: median of the error that the planes promise; shares of the mirrors whose true error is below twice",
        "and above half of it. ms: finding alone.",
    ]
    groups: dict[tuple[str, bool], list[Outcome]] = defaultdict(list)
    for k in range(rigs):
        if k % 12 == 0:
            say(f"rigs: {k} of {rigs}")
        outcome = judge(draw(k, seed, losses))
        groups[outcome.drawn.camera, outcome.drawn.one_side].append(outcome)
        groups["all", outcome.drawn.one_side].append(outcome)
    for (camera, one_side), outcomes in sorted(groups.items(), key=lambda group: (group[0][1], group[0][0])):
        table.rows.append((camera, "yes" if one_side else "no", *_figures(outcomes)))
    everything = groups["all", False] + groups["all", True]
    whole, false = sum(o.whole for o in everything), sum(o.false for o in everything)
    pairs = [one for o in everything for one in o.found if one is not None]
    within, above = (np.mean([test(*pair) for pair in pairs]) if pairs else 0.0 for test in (_within, _above))
    return Result([table], [
        Finding(f"{rigs} rigs without picks: >= {0.983:.1%} whole", f"{whole} of {rigs}", whole >= 0.983 * rigs),
        Finding(f"{rigs} rigs without picks: no mirror false", str(false), false == 0),
        Finding("true error within twice the stated one in >= 90 %", f"{within:.0%}", bool(within >= 0.9)),
        Finding("true error above half of the stated one in >= 30 %", f"{above:.0%}", bool(above >= 0.3)),
    ])  # fmt: skip


def _within(error: float, stated: float) -> bool:
    return error <= 2.0 * stated


def _above(error: float, stated: float) -> bool:
    return error >= 0.5 * stated


def _figures(outcomes: list[Outcome]) -> tuple[str, ...]:
    pairs = [one for o in outcomes for one in o.found if one is not None]
    errors, stated = (np.array([pair[k] for pair in pairs]) for k in (0, 1))
    missed = sum(one is None for o in outcomes for one in o.found)
    spread = [number(float(f)) for f in (np.median(errors), np.quantile(errors, 0.95), errors.max(), np.median(stated))
              ] if pairs else ["–"] * 4  # fmt: skip
    shares = [f"{np.mean([test(*p) for p in pairs]):.0%}" if pairs else "–" for test in (_within, _above)]
    return (
        str(len(outcomes)), str(sum(o.whole for o in outcomes)), str(missed), str(sum(o.false for o in outcomes)),
        *spread, *shares, number(float(np.median([o.spent for o in outcomes])), 0),
    )  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser("python -m benchmarks.rigs", description=__doc__)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--rigs", type=int, default=RIGS)
    parser.add_argument("--losses", choices=(OPTICS, DRAWN), default=DRAWN)
    options = parser.parse_args()
    result = run(options.seed, options.rigs, options.losses)
    for one in result.tables:
        print(one.text())
    for finding in result.findings:
        print(f"{finding.limit}: {finding.measured}")
