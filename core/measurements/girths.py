"""Girths of trunk and limbs: where a tape is laid, and how long it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..errors import MirrorScanError
from ..numeric.rotations import unit
from .body import SIDES, UP, Body, measured
from .plane_cuts import PlaneCut, cut_by_plane, plane_axes
from .tape import Tape, lay_tape

_STEP = 0.003  # between levels that are tried, at 1.7 m [m]
_DRAWN = 1.7  # the height steps are meant for [m]
_BELOW_SPINE = 0.02  # of body height: where the waist is looked for, from so far below the joint Spine
_HIPS, _JOINED = 0.045, 0.06  # of body height: hip joints above the crotch; legs are not joined so far below that
_WEB, _WEB_SPREAD, _SEEN_CROTCH = 0.0055, 0.008, 0.003  # of body height
_AROUND = 2  # levels to either side that a level is compared with
_TILT = 0.6  # of the neck's tape, a tangent
_NECK = 0.14  # of body height: what is farther from the neck's middle is not looked at
_CROTCH = 0.010  # hips are above the level at which the legs part, by so much at 1.7 m [m]
_BELOW_CROTCH = (
    0.0015  # a thigh's tape runs so far below the first place where nothing but thigh is in it, at 1.7 m [m]
)


@dataclass(frozen=True)
class Girth:
    """A tape laid about a part of the body.

    Parameters
    ----------
    tape : Tape
    cut : PlaneCut
        What it was laid about.
    point, normal : np.ndarray [shape=(3,)]
        Of its plane.
    placement : float
        How much longer or shorter it would be if the plane lay where it might as well, 95 % [m].
    extra : float
        What is to be added since the right place is covered by surface that was made up [m].
    """

    tape: Tape
    cut: PlaneCut
    point: np.ndarray
    normal: np.ndarray
    placement: float
    extra: float = 0.0


def _girth(cut: PlaneCut, point: np.ndarray, normal: np.ndarray, placement: float, what: str) -> Girth:
    if len(cut.points) < 3:
        raise MirrorScanError(
            f"measurements: there is no surface where the {what} is measured; check that the skeleton fits the mesh",
            code="no_person",
        )
    return Girth(lay_tape(cut.points, normal), cut, point, normal, placement)


def _length(cut: PlaneCut, normal: np.ndarray) -> float:
    return lay_tape(cut.points, normal).length if len(cut.points) > 2 else np.nan


def _levels(body: Body, low: float, high: float) -> np.ndarray:
    step = _STEP * body.height / _DRAWN
    return np.linspace(low, high, max(round((high - low) / step), 2) + 1)


def _trunk_lengths(body: Body, levels: np.ndarray) -> np.ndarray:
    return np.array([_length(body.trunk(level), UP) for level in levels])


def _best(lengths: np.ndarray, sign: float) -> int:
    """Of the longest (sign 1) or shortest (sign -1), where a spike or a dent of one or two levels counts for nothing.

    Medians of neighbouring levels are compared; the level is the one whose length is that median.
    """
    padded = np.pad(lengths, _AROUND, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1)
    order = np.sort(windows, axis=1)  # nan come last
    middle = (np.isfinite(windows).sum(axis=1) - 1) // 2
    medians = np.where(middle >= 0, order[np.arange(len(order)), middle], np.nan)
    at = int(np.nanargmax(sign * medians))
    return at - _AROUND + int(np.nanargmin(np.abs(windows[at] - medians[at])))


def _trunk_girth(body: Body, low: float, high: float, spread: tuple[float, float], sign: float, what: str) -> Girth:
    """The longest or shortest level tape between two levels known to ``spread`` each, 95 % [m]."""
    levels = _levels(body, low - spread[0], high + spread[1])
    lengths = _trunk_lengths(body.between(levels[0], levels[-1]), levels)
    inside = (levels >= low) & (levels <= high)
    if not np.isfinite(lengths[inside]).any():
        raise MirrorScanError(f"measurements: the trunk has no surface where the {what} is measured", code="no_person")
    at = int(np.flatnonzero(inside)[_best(lengths[inside], sign)])
    others = []
    for narrow in ((levels >= low + spread[0]) & (levels <= high - spread[1]), np.ones(len(levels), np.bool_)):
        chosen = lengths[narrow]
        others.append(chosen[_best(chosen, sign)] if np.isfinite(chosen).any() else lengths[at])
    placement = max(abs(other - lengths[at]) for other in others)
    point = np.array([0.0, 0.0, levels[at]])
    return _girth(body.trunk(levels[at]), point, UP, float(placement), what)


def waist(body: Body, spread: float) -> Girth:
    """The smallest level girth from 2 % of height below the joint Spine up to Spine1, known to ``spread`` [m]."""
    low = body.joint("Spine")[2] - _BELOW_SPINE * body.height
    return _trunk_girth(body, low, body.joint("Spine1")[2], (spread, spread), -1.0, "waist")


class Crotch(NamedTuple):
    """Where the mesh's legs part, where the crotch is, and how far that may be off, 95 %: levels [m]."""

    parted: float
    level: float
    spread: float


def hip(body: Body, crotch: float, spread: float) -> Girth:
    """The largest level girth from the crotch, where the legs part, up to the joint Spine, known to ``spread`` [m]."""
    return _trunk_girth(
        body, crotch + _CROTCH * body.height / _DRAWN, body.joint("Spine")[2], (0.0, spread), 1.0, "hip"
    )


def crotch_level(body: Body) -> Crotch:
    """The level at which the legs part, going down: the highest where each leg has a loop of its own.

    Where nobody saw the surface there, a web that closing left hangs between the thighs, and the crotch lies as much
    higher as such webs do in scans of mannequins. Where legs are joined far below the hips, by a skirt or for want of
    readings, the crotch is where it is expected by the joints.
    """
    hips = 0.5 * (body.joint("LeftUpLeg") + body.joint("RightUpLeg"))
    knees = 0.5 * (body.joint("LeftLeg") + body.joint("RightLeg"))

    part = body.between(knees[2], hips[2])

    def apart(level: float) -> bool:
        cut = part.cut(np.array([0.0, 0.0, level]), UP)
        loop = cut.loops()
        left, right = (cut.values(share) for share in part.legs)
        if not len(loop) or max(left.max(), 0.0) < 0.5 or max(right.max(), 0.0) < 0.5:
            return False
        return loop[(left - right).argmax()] != loop[(left - right).argmin()]

    levels = _levels(body, knees[2], hips[2])
    joined = np.flatnonzero([not apart(level) for level in levels])
    lowest = joined[0] if len(joined) else len(levels) - 1
    expected = float(hips[2] - _HIPS * body.height)
    if lowest == 0 or levels[lowest] < expected - _JOINED * body.height:
        return Crotch(expected, expected, _JOINED * body.height)
    low, high = levels[lowest - 1], levels[lowest]
    for _ in range(5):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if apart(middle) else (low, middle)
    above = body.cut(np.array([0.0, 0.0, high]), UP)
    between = above.values(np.minimum(*body.legs)).argmax()
    seen = measured(body.mesh)[above.triangle[(above.segments == between).any(axis=1)]].all()
    if seen:
        return Crotch(float(low), float(low), _SEEN_CROTCH * body.height)
    return Crotch(float(low), float(low + _WEB * body.height), _WEB_SPREAD * body.height)


def _bone(body: Body, start: str, end: str) -> tuple[np.ndarray, np.ndarray, float]:
    """A bone's start, its direction and its length [m]."""
    head = body.joint(start)
    along = body.joint(end) - head
    return head, unit(along), float(np.linalg.norm(along))


def upper_arm(body: Body, side: int, spread: float) -> Girth:
    """About the middle of the upper arm, square to the bone, whose ends are known to ``spread`` [m]."""
    start, along, length = _bone(body, f"{SIDES[side]}Arm", f"{SIDES[side]}ForeArm")

    def cut(at: float) -> PlaneCut:
        return body.limb(start + at * along, along, body.arms[side])

    return _placed(cut, start, along, 0.5 * length, (-spread, spread), f"{SIDES[side].lower()} upper arm")


def calf(body: Body, side: int) -> Girth:
    """The largest girth of the lower leg, square to the bone."""
    start, along, length = _bone(body, f"{SIDES[side]}Leg", f"{SIDES[side]}Foot")
    places = _levels(body, 0.1 * length, 0.6 * length)
    leg = body.restricted(body.legs[side][body.mesh.triangles].max(axis=1) > 0.0)
    lengths = np.array([_length(leg.limb(start + at * along, along, leg.legs[side]), along) for at in places])
    what = f"{SIDES[side].lower()} calf"
    if not np.isfinite(lengths).any():
        raise MirrorScanError(f"measurements: there is no surface where the {what} is measured", code="no_person")
    at = places[_best(lengths, 1.0)]
    return _girth(body.limb(start + at * along, along, body.legs[side]), start + at * along, along, 0.0, what)


def thigh(body: Body, side: int, crotch: Crotch) -> Girth:
    """Square to the thigh's bone, just below the crotch: the highest cut with nothing but this thigh in it.

    Where a web covers the right place the thigh is taken to grow on as it does below.
    """
    start, along, length = _bone(body, f"{SIDES[side]}UpLeg", f"{SIDES[side]}Leg")
    step = _STEP * body.height / _DRAWN / 3

    def cut(at: float) -> PlaneCut:
        found = body.cut(start + at * along, along)
        return found.part(found.values(body.arms[0] + body.arms[1]) <= 0.5)

    def alone(at: float) -> bool:
        found = cut(at)
        loop, mine = found.loops(), found.values(body.legs[side])
        if not len(loop) or mine.max() < 0.5:
            return False
        around = loop == loop[mine.argmax()]
        return bool((found.values(body.legs[1 - side])[around] <= mine[around]).all())

    at = (start[2] - crotch.parted) / max(-along[2], 0.5) - 0.03 * body.height / _DRAWN
    while at < 0.7 * length and not alone(at):
        at += step

    def own(at: float) -> PlaneCut:
        found = cut(at)
        loop, mine = found.loops(), found.values(body.legs[side])
        return found.part(loop == loop[mine.argmax()]) if len(loop) else found

    at += _BELOW_CROTCH * body.height / _DRAWN
    what = f"{SIDES[side].lower()} thigh"
    if at >= 0.7 * length:  # joined all the way down: what the weights say is its own

        def own(at: float) -> PlaneCut:
            found = cut(at)
            return found.part(found.values(body.legs[side]) >= 0.5)

        at = (start[2] - crotch.level) / max(-along[2], 0.5)
        while at < 0.7 * length and len(own(at).points) < 3:
            at += step
        return _placed(own, start, along, at, (-crotch.spread, crotch.spread), what)
    found = _placed(own, start, along, at, (crotch.spread,), what)
    lift = crotch.level - crotch.parted
    if lift == 0.0:
        return found
    run = 3.0 * lift
    growth = (found.tape.length - _length(own(at + run), along)) / run
    return replace(found, extra=float(np.clip(np.nan_to_num(growth), -1.0, 1.0) * lift))


def _placed(
    cut: Callable[[float], PlaneCut],
    start: np.ndarray,
    along: np.ndarray,
    at: float,
    shifts: tuple[float, ...],
    what: str,
) -> Girth:
    """The tape at ``at`` along a bone; it might as well lie by ``shifts``, 95 %, further along [m]."""
    here = _girth(cut(at), start + at * along, along, 0.0, what)
    others = np.array([_length(cut(at + shift), along) for shift in shifts])
    placement = np.nanmax(np.abs(others - here.tape.length), initial=0.0)
    return Girth(here.tape, here.cut, here.point, here.normal, float(placement))


def neck(body: Body) -> Girth:
    """The shortest tape about the neck, free to tilt and to slide: a grid that narrows about the shortest."""
    base, head = body.joint("Neck"), body.joint("Head")
    axis, length = unit(head - base), float(np.linalg.norm(head - base))
    first, second = plane_axes(axis)
    near = np.linalg.norm(body.mesh.vertices - 0.5 * (base + head), axis=1) < _NECK * body.height
    triangles = np.flatnonzero(near[body.mesh.triangles].all(axis=1))
    used, corners = np.unique(body.mesh.triangles[triangles], return_inverse=True)
    vertices, corners = body.mesh.vertices[used], corners.reshape(-1, 3)

    def cut(place: np.ndarray) -> tuple[PlaneCut, np.ndarray, np.ndarray]:
        tilt = place[1:] * min(1.0, _TILT / max(float(np.hypot(*place[1:])), 1e-9))
        point, normal = base + place[0] * axis, unit(axis + tilt[0] * first + tilt[1] * second)
        found = cut_by_plane(vertices, corners, point, normal)
        loop = found.loops()
        if len(loop):  # the mouth, and a face that hangs in the air, have loops of their own
            found = found.part(loop == found.loop_about(point, normal, loop))
        return found, point, normal

    center, size = np.array([0.7 * length, 0.0, 0.0]), np.array([max(0.6 * length, 0.02 * body.height), 0.5, 0.5])
    shortest = np.inf
    for count in (5, 3, 3, 3, 3, 3, 3):
        offsets = np.stack(np.meshgrid(*[np.linspace(-1, 1, count)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        middle = center
        for place in middle + offsets * size:
            found, _, normal = cut(place)
            tape = _length(found, normal) if found.is_closed() else np.inf
            if tape < shortest:
                shortest, center = tape, place
        size = 0.5 * size
    found, point, normal = cut(center)
    inside = PlaneCut(found.points, found.segments, triangles[found.triangle], used[found.edge], found.at)
    return _girth(inside, point, normal, 0.0, "neck")


def at_level(body: Body, level: float, spread: float, what: str) -> Girth:
    """The level tape about the trunk at ``level``, known to ``spread``, 95 % [m]."""
    here = _girth(body.trunk(level), np.array([0.0, 0.0, level]), UP, 0.0, what)
    others = _trunk_lengths(body, np.array([level - spread, level + spread]))
    placement = np.nanmax(np.abs(others - here.tape.length), initial=0.0)
    return Girth(here.tape, here.cut, here.point, here.normal, float(placement))
