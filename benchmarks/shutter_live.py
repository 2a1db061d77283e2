"""Live guidance: how fast, how soon, when the burst is taken, and whether advice that is followed goes away.

``python -m benchmarks.shutter_live [--quick]`` prints its tables alone.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from mirror_scan.core.errors import CaptureError
from mirror_scan.core.guidance import Advice, LiveScene, LiveSettings, Shutter, ShutterSettings, guide
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.simulation.props import box, placed
from mirror_scan.core.simulation.scene import FramedMirror, Rig, default_rig
from mirror_scan.core.simulation.simulate import simulate

from .results import Finding, Result, Table, number
from .shutter_scripts import RATE, Approach, Moment, at, person, small_rig, walk

LEAST_RATE, LONGEST_MS, SOONEST_S = 8.0, 150.0, 0.5
WITHIN_S, LEAST_TAKEN, LEAST_FOLLOWED = 1.0, 22, 0.9
SETTINGS = ShutterSettings(countdown_s=1.0, frames=10)
_LAST = 48  # frames for which all is well in the end


def run(quick: bool = False) -> Result:
    """All tables; ``quick``: a few approaches and cases."""
    results = [_speed(quick), _changes(quick), _approaches(quick), _followed(quick)]
    return Result([t for r in results for t in r.tables], [f for r in results for f in r.findings])


# --- speed -----------------------------------------------------------------------------------------------------------


def _speed(quick: bool) -> Result:
    """What a frame of a whole camera costs, standing well and badly; in wall and processor time."""
    rows, slowest, worst = [], np.inf, 0.0
    for sensor in ("azure_kinect",) if quick else ("azure_kinect", "realsense_d455"):
        rig = default_rig(sensor, frames=12)
        scene = LiveScene(rig.intrinsics, rig.sensor, (), LiveSettings(improvements=0, beside=False))
        for name, x in (("stands well", 0.0), ("stands aside", 0.7)):
            capture = simulate(at(person(), x, 0.0), rig).capture
            if x == 0.0:
                for k, depth in enumerate(capture.depth):  # the start: the mirrors are placed
                    scene.look(depth, capture.color, 0.2 * k)
            wall, busy = [], []
            for k, depth in enumerate(np.concatenate([capture.depth] * (1 if quick else 3))):
                began, used = time.perf_counter(), time.process_time()
                scene.look(depth, capture.color, 10.0 + 10.0 * (x > 0) + 0.1 * k)
                wall.append(time.perf_counter() - began)
                busy.append(time.process_time() - used)
            wall, busy = wall[3:], busy[3:]
            rate = 1.0 / float(np.median(busy))
            slowest, worst = min(slowest, rate), max(worst, 1e3 * float(np.max(busy)))
            rows.append((sensor, name, f"{scene.intrinsics.width}×{scene.intrinsics.height}",
                         number(1e3 * np.median(wall), 0), number(1e3 * np.max(wall), 0),
                         number(1e3 * np.median(busy), 0), number(1e3 * np.max(busy), 0), number(rate, 1)))  # fmt: skip
    columns = ("sensor", "person", "thinned to", "wall, median", "longest", "processor, median", "longest", "a second")
    table = Table("Live: one frame, looked at [ms]", columns, rows, left=3)
    table.notes.append("Judged by processor time of all threads, which other programs do not lengthen.")
    return Result([table], [
        Finding(f"live: >= {LEAST_RATE:g} frames a second", f"{slowest:.1f}", slowest >= LEAST_RATE),
        Finding(f"live: our longest call <= {LONGEST_MS:g} ms", f"{worst:.0f} ms", worst <= LONGEST_MS),
    ])  # fmt: skip


# --- how soon --------------------------------------------------------------------------------------------------------

_HELD = 12  # frames for which each state of a change lasts


def _changes(quick: bool) -> Result:
    """How soon advice comes after something is wrong, and goes after it is right again, from one frame to the next."""
    rig, usual = small_rig(), person()
    crate = placed(box((-0.4, -0.15, 0.0), (0.4, 0.15, 0.45)), 0.0, -0.8)
    changes = {
        "step": Moment((at(usual, 0.75, 0.0),), _HELD, rig),
        "arms_close": Moment((person(1.7, 77.0),), _HELD, rig),
        "feet_hidden": Moment((usual,), _HELD, rig, props=(crate,)),
        "two_people": Moment((usual, at(person(1.75, 70.0), -1.0, -0.5)), _HELD, rig),
        "nobody": Moment((at(usual, 40.0, 0.0),), _HELD, rig),
    }
    rows, late = [], 0.0
    for kind, wrong in list(changes.items())[:2] if quick else changes.items():
        well = Moment((usual,), _HELD, rig)
        approach = Approach(kind, [well, wrong, well], 3)
        stream = approach.stream()
        mirrors = simulate(usual, rig).capture.mirrors
        scene = LiveScene(stream.intrinsics, stream.sensor, mirrors, LiveSettings(beside=False))
        waits = Shutter(stream.intrinsics, ShutterSettings(countdown_s=60.0))
        shown = []
        with contextlib.suppress(CaptureError):  # it ends before a burst
            for update in guide(stream, scene, waits, clock=lambda k: k / RATE):
                shown.append(kind in {one.code for one in update.advices})
        came = next((k for k in range(_HELD, 2 * _HELD) if shown[k]), None)
        went = next((k for k in range(2 * _HELD, 3 * _HELD) if not shown[k]), None)
        after = [np.inf if k is None else (k - first) / RATE for k, first in ((came, _HELD), (went, 2 * _HELD))]
        late = max(late, *after)
        rows.append((kind, *(number(one, 1) for one in after)))
    table = Table("Live: how soon advice comes and goes [s]", ("kind", "comes after", "goes after"), rows)
    table.notes.append(f"Recordings of {RATE:g} frames a second; a change from one frame to the next.")
    finding = Finding(f"live: advice within {SOONEST_S:g} s of a change", f"{late:.1f} s at most", late <= SOONEST_S)
    return Result([table], [finding])


# --- approaches ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Played:
    """What became of an approach: when the burst began, whether something was wrong then, how soon advice came [s]."""

    began: float | None
    wrong: bool
    delays: tuple[float, ...]
    retaken: int
    said: tuple[str, ...]


def play(approach: Approach, known: bool) -> Played:
    """Look at an approach's frames as :mod:`mirror_scan.core.guidance` does of a camera's."""
    stream = approach.stream()
    rig = approach.moments[0].rig
    mirrors = simulate(approach.moments[-1].bodies[0], replace(rig, frames=1)).capture.mirrors if known else ()
    scene = LiveScene(stream.intrinsics, stream.sensor, mirrors, LiveSettings(beside=False))
    shutter = Shutter(stream.intrinsics, SETTINGS)
    delays: dict[int, float] = {}
    said: list[str] = []
    begun: list[float] = []
    wrong, before = False, ""
    for update in guide(stream, scene, shutter, clock=lambda k: k / RATE):
        moment = approach.moment_at(update.number)
        said += [one.code for one in update.advices if one.code not in said and one.severity == "warning"]
        if update.state == "burst" and before != "burst":
            begun.append(update.seconds)
            wrong |= bool(moment.faults) or moment.walking
        before = update.state
        index = approach.moments.index(moment)
        if moment.faults and index not in delays and {one.code for one in update.advices} & set(moment.faults):
            delays[index] = update.seconds - sum(m.frames for m in approach.moments[:index]) / RATE
    missed = [k for k, m in enumerate(approach.moments) if m.faults and k not in delays]
    return Played(
        begun[-1] if begun else None, wrong, (*delays.values(), *(np.inf for _ in missed)), shutter.retaken, tuple(said)
    )


def approaches() -> Iterator[tuple[Approach, bool]]:
    """The scripted approaches, and whether the mirrors are known when they begin."""
    azure, femto, low = small_rig(), small_rig("femto_bolt"), small_rig(camera_height=1.1, tilt_deg=6.0)
    tall, small = person(1.85, 50.0), person(1.58, 40.0, girth=1.15)
    usual = person()
    asides = (("left", -0.75, 0.0), ("right", 0.75, 0.0), ("near", 0.0, -0.75), ("far", 0.0, 0.75),
              ("left and far", -0.5, 0.5), ("right and near", 0.5, -0.5))  # fmt: skip
    for k, (name, x, y) in enumerate(asides):
        for j, (rig, body) in enumerate(((azure, usual), (femto, tall))):
            yield _stands_wrong(f"too {name}, {rig.sensor}", rig, body, x, y, 2 * k + j), j == 0
    for k, (rig, height) in enumerate(((azure, 1.7), (femto, 1.8), (low, 1.6))):
        yield _arms(f"arms at the body, {height:g} m", rig, height, 20 + k), True
    for k, (rig, body) in enumerate(((azure, usual), (femto, small))):
        yield _box(f"a box before the feet, {rig.sensor}", rig, body, 30 + k), True
        yield _second(f"a second person, {rig.sensor}", rig, body, 40 + k), True
        yield _returns(f"goes away and returns, {rig.sensor}", rig, body, 50 + k), k == 0
    yield _sways("moves during the burst", azure, usual, 60), False
    yield _straight("stands well at once", femto, tall, 61), False
    yield _mirror_turned("a mirror is turned", azure, usual, 62), True


def _in(body: Mesh, rig: Rig, x: float = 0.0, y: float = 0.0) -> list[Moment]:
    return list(walk(body, (-1.3, -0.4), (x, y), rig))


def _straight(name: str, rig: Rig, body: Mesh, seed: int) -> Approach:
    return Approach(name, [*_in(body, rig), Moment((body,), _LAST, rig)], seed)


def _stands_wrong(name: str, rig: Rig, body: Mesh, x: float, y: float, seed: int) -> Approach:
    wrong = Moment((at(body, x, y),), 16, rig, ("step", "nobody", "mirrors_missing"))
    back = list(walk(body, (x, y), (0.0, 0.0), rig))
    return Approach(name, [*_in(body, rig, x, y), wrong, *back, Moment((body,), _LAST, rig)], seed)


def _arms(name: str, rig: Rig, height: float, seed: int) -> Approach:
    hanging, out = person(height, 77.0), person(height, 48.0)
    wrong = Moment((hanging,), 16, rig, ("arms_close",))
    raising = [Moment((person(height, angle),), 1, rig, walking=True) for angle in (70.0, 60.0, 52.0)]
    return Approach(name, [*_in(hanging, rig), wrong, *raising, Moment((out,), _LAST, rig)], seed)


def _box(name: str, rig: Rig, body: Mesh, seed: int) -> Approach:
    crate = placed(box((-0.4, -0.15, 0.0), (0.4, 0.15, 0.45)), 0.0, -0.8)
    walking = [replace(moment, props=(crate,)) for moment in _in(body, rig)]
    wrong = Moment((body,), 16, rig, ("feet_hidden",), props=(crate,))
    return Approach(name, [*walking, wrong, Moment((body,), _LAST, rig)], seed)


def _second(name: str, rig: Rig, body: Mesh, seed: int) -> Approach:
    other = person(1.75, 70.0)
    come = [Moment((body, m.bodies[0]), 1, rig, walking=True) for m in walk(other, (-2.0, -0.6), (-0.95, -0.5), rig)]
    stand = Moment((body, at(other, -0.95, -0.5)), 14, rig, ("two_people",))
    go = [Moment((body, m.bodies[0]), 1, rig, walking=True) for m in walk(other, (-0.95, -0.5), (-2.2, -0.6), rig)]
    return Approach(name, [*_in(body, rig), Moment((body,), 6, rig), *come, stand, *go, Moment((body,), _LAST, rig)],
                    seed)  # fmt: skip


def _returns(name: str, rig: Rig, body: Mesh, seed: int) -> Approach:
    away = Moment((at(body, -0.8, -0.3),), 14, rig, ("step", "nobody", "mirrors_missing"))
    there, back = (list(walk(body, *ends, rig)) for ends in (((0, 0), (-0.8, -0.3)), ((-0.8, -0.3), (0, 0))))
    return Approach(name, [*_in(body, rig), Moment((body,), 10, rig), *there, away, *back,
                           Moment((body,), _LAST, rig)], seed)  # fmt: skip


def _sways(name: str, rig: Rig, body: Mesh, seed: int) -> Approach:
    ahead = 5 + int((SETTINGS.well_s + SETTINGS.countdown_s) * RATE)
    swaying = [Moment((at(body, 0.012 * k, 0.0),), 1, rig) for k in range(8)]
    still = Moment((at(body, 0.085, 0.0),), _LAST, rig)
    held = Moment((body,), ahead, rig)
    return Approach(name, [*_in(body, rig), held, *(replace(m, walking=k == 7) for k, m in enumerate(swaying)), still],
                    seed)  # fmt: skip


def _mirror_turned(name: str, rig: Rig, body: Mesh, seed: int) -> Approach:
    turned = replace(rig, mirrors=(turn(rig.mirrors[0], 4.0), *rig.mirrors[1:]))
    moved = Moment((body,), 4, turned, walking=True)
    return Approach(name, [*_in(body, rig), Moment((body,), 10, rig), moved, Moment((body,), _LAST, turned)], seed)


def turn(mirror: FramedMirror, angle_deg: float) -> FramedMirror:
    """A mirror turned about the vertical through its middle."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    x, y, z = mirror.normal
    return replace(mirror, normal=(c * x - s * y, s * x + c * y, z))


def _approaches(quick: bool) -> Result:
    rows, taken, wrong = [], 0, 0
    chosen = list(approaches())
    chosen = chosen[:: max(len(chosen) // 5, 1)] if quick else chosen
    for approach, known in chosen:
        try:
            played = play(approach, known)
        except CaptureError as error:  # the recording ended first
            played = Played(None, False, (), 0, (str(error)[:60],))
        approach.frames = []
        wanted = approach.right_moment + SETTINGS.well_s + SETTINGS.countdown_s
        off = None if played.began is None else played.began - wanted
        good = off is not None and abs(off) <= WITHIN_S and not played.wrong
        taken, wrong = taken + good, wrong + played.wrong
        rows.append((approach.name, "known" if known else "found", ", ".join(played.said) or "–",
                     number(max(played.delays, default=None), 1), number(wanted, 1), number(played.began, 1),
                     number(off, 1), "yes" if good else "NO"))  # fmt: skip
    columns = ("approach", "mirrors", "said", "said after", "right moment", "burst began", "off", "within 1 s")
    table = Table("Live: scripted approaches [s]", columns, rows, left=3)
    need = LEAST_TAKEN if not quick else int(np.ceil(len(rows) * LEAST_TAKEN / 24))
    return Result([table], [
        Finding(f"live: the burst within {WITHIN_S:g} s of the right moment in >= {need} of {len(rows)} approaches",
                str(taken), taken >= need),
        Finding("live: no burst while a warning stands", str(wrong), wrong == 0),
    ])  # fmt: skip


# --- advice followed -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Setting:
    """A scene of which advice is asked for: who, with which arms, where, before which mirrors, what else is there."""

    rig: Rig
    height: float = 1.7
    arms: float = 47.0
    place: tuple[float, float] = (0.0, 0.0)
    props: tuple[Mesh, ...] = ()
    other: tuple[float, float] | None = None
    absent: bool = False


def advice_on(setting: Setting, seed: int) -> tuple[Advice, ...]:
    """What is said of a setting, the mirrors being known by picks on their frames."""
    rig = replace(setting.rig, frames=6, seed=seed)
    body = at(person(setting.height, setting.arms), *setting.place)
    scene = None
    if setting.other is not None or setting.absent:  # what is behind them was seen before they came
        empty = simulate(body if setting.other is not None else at(body, 40.0, 0.0), rig).capture
        scene = LiveScene(rig.intrinsics, rig.sensor, empty.mirrors, LiveSettings(beside=False))
        for k, depth in enumerate(empty.depth):
            found = scene.look(depth, None, 0.1 * k)
        if setting.absent:
            return found.advices
        body = Approach("", [Moment((body, at(person(), *setting.other)), 1, rig)]).moments[0].bodies  # type: ignore
        from mirror_scan.core.simulation.props import together

        body = together(*body)
    capture = simulate(body, rig, setting.props).capture
    scene = scene or LiveScene(rig.intrinsics, rig.sensor, capture.mirrors, LiveSettings(beside=False))
    for k, depth in enumerate(capture.depth):
        frame = scene.look(depth, None, 5.0 + 0.1 * k)
    return frame.advices


def follow(setting: Setting, advice: Advice) -> Setting:
    """The setting after the advice was followed, in the simulation, as it says."""
    rig, arrow = setting.rig, advice.arrow
    turning = rig.camera_to_avatar[:3, :3]
    shift = np.zeros(3) if arrow is None else turning @ (arrow.length * arrow.direction)
    if advice.code in ("step", "nobody", "side_cut") and not setting.absent:
        return replace(setting, place=(setting.place[0] + shift[0], setting.place[1] + shift[1]))
    if advice.code == "nobody":
        return replace(setting, absent=False)
    if advice.code == "arms_close":
        return replace(setting, arms=_arms_after(setting, float(np.linalg.norm(shift))))
    if advice.code in ("feet_hidden", "blocked"):
        return replace(setting, props=())
    if advice.code == "two_people":
        return replace(setting, other=None)
    if advice.what == "camera":
        up = np.array((0.0, 0.0, 1.0)) @ (turning @ np.array(arrow.direction)) if arrow is not None else 0.0
        if abs(up) > 0.5:
            return replace(setting, rig=replace(rig, tilt_deg=rig.tilt_deg - np.sign(up) * advice.angle_deg))
        side = float((turning @ np.array(arrow.direction))[0]) if arrow is not None else 0.0
        return replace(setting, rig=replace(rig, pan_deg=rig.pan_deg + np.sign(side) * advice.angle_deg))
    mirrors = tuple(_moved(m, advice, shift) if m.name == advice.where else m for m in rig.mirrors)
    return replace(setting, rig=replace(rig, mirrors=mirrors))


def _arms_after(setting: Setting, outwards: float) -> float:
    """The angle of arms whose hands are so much further out [m]."""
    length = 0.43 * setting.height
    reach = np.cos(np.radians(setting.arms)) + outwards / length
    return float(np.clip(np.degrees(np.arccos(np.clip(reach, 0.0, 0.9))), 20.0, 78.0))


def _moved(mirror: FramedMirror, advice: Advice, shift: np.ndarray) -> FramedMirror:
    """A mirror moved, turned, or replaced by a larger one, as is said."""
    values = getattr(advice.text, "values", {})
    if advice.code == "mirror_small":
        by = float(values["lacking"]) / 100.0
        grown = {"height": mirror.height + by} if values["what"] == "shorter" else {"width": mirror.width + by}
        made = replace(mirror, **grown)
        x, y, z = made.centre
        return replace(made, centre=(x, y, z + (by / 2 if "height" in grown else 0.0)))
    if advice.angle_deg:
        return min(
            (turn(mirror, sign * advice.angle_deg) for sign in (-1.0, 1.0)), key=lambda m: _edge_off(m, mirror, shift)
        )
    x, y, z = np.array(mirror.centre) + shift
    return replace(mirror, centre=(float(x), float(y), float(z)))


def _edge_off(turned: FramedMirror, before: FramedMirror, shift: np.ndarray) -> float:
    """How far a turned mirror's edges are from going the way that is said."""
    gone = [0.5 * before.width * sign * (turned.axes[0] - before.axes[0]) for sign in (-1.0, 1.0)]
    return float(min(np.linalg.norm(one - shift) for one in gone))


def settings_by_kind(quick: bool) -> dict[str, list[Setting]]:
    """Scenes in each of which a kind of advice is due."""
    rng = np.random.default_rng(7)
    count = 3 if quick else 10

    def rig(**changes) -> Rig:
        sensor = ("azure_kinect", "femto_bolt")[int(rng.integers(2))]
        return small_rig(sensor, **changes)

    def high(by: float) -> Rig:
        base = rig()
        return replace(base, mirrors=tuple(replace(m, centre=(*m.centre[:2], m.centre[2] + by)) for m in base.mirrors))

    def aside() -> tuple[float, float]:
        angle, far = rng.uniform(0.0, 2 * np.pi), rng.uniform(0.75, 0.95)
        return far * np.cos(angle), far * np.sin(angle)

    crate = placed(box((-0.4, -0.15, 0.0), (0.4, 0.15, 0.45)), 0.0, -0.8)
    made: dict[str, Callable[[], Setting]] = {
        "step": lambda: Setting(rig(), rng.uniform(1.55, 1.85), place=aside()),
        "arms_close": lambda: Setting(rig(), rng.uniform(1.55, 1.85), arms=rng.uniform(75.0, 78.0)),
        "feet_cut": lambda: Setting(rig(tilt_deg=-rng.uniform(9.0, 12.0)), rng.uniform(1.6, 1.8)),
        "head_cut": lambda: Setting(rig(tilt_deg=rng.uniform(17.0, 20.0)), rng.uniform(1.6, 1.8)),
        "feet_hidden": lambda: Setting(rig(), rng.uniform(1.6, 1.85), props=(crate,)),
        "two_people": lambda: Setting(rig(), rng.uniform(1.6, 1.85), other=(rng.uniform(-1.3, -0.95), -0.5)),
        "nobody": lambda: Setting(rig(), rng.uniform(1.6, 1.85), absent=True),
        "mirror_small": lambda: Setting(rig(mirror_size=(0.8, rng.uniform(0.9, 1.2))), rng.uniform(1.65, 1.85)),
        "glass_edge": lambda: Setting(high(rng.uniform(0.35, 0.5)), rng.uniform(1.6, 1.7)),
    }
    return {kind: [make() for _ in range(count)] for kind, make in made.items()}


def _followed(quick: bool) -> Result:
    rows, worst = [], 1.0
    for kind, settings in settings_by_kind(quick).items():
        given = gone = clear = 0
        for seed, setting in enumerate(settings):
            said = {one.code: one for one in advice_on(setting, seed)}
            if kind not in said:
                continue
            given += 1
            after = advice_on(follow(setting, said[kind]), 1000 + seed)
            same = [one for one in after if one.code == kind and one.where == said[kind].where]
            gone += not same
            clear += all(one.severity != "warning" for one in after)
        share = gone / given if given else 0.0
        worst = min(worst, share)
        rows.append((kind, str(len(settings)), str(given), str(gone), str(clear), f"{share:.0%}"))
    table = Table(
        "Live: advice followed in the simulation", ("kind", "scenes", "given", "goes", "all well", "goes"), rows
    )
    limit = f"live: each kind of advice, followed, goes in >= {LEAST_FOLLOWED:.0%}"
    return Result([table], [Finding(limit, f"{worst:.0%} at worst", worst >= LEAST_FOLLOWED)])


if __name__ == "__main__":
    made = run("--quick" in sys.argv)
    for one in made.tables:
        print("\n" + one.text())
    for finding in made.findings:
        print(finding)
