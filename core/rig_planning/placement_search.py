"""The best place for camera, person and mirrors in a room: :func:`find_placement`.

A coarse grid over distance, directions and lengths of ways is sieved by geometry (inside the room, nothing overlaps,
all of the person in the picture), what is left is judged by :func:`.predicted_error.predicted_error`, and the best few
are bettered by a pattern search over all of their numbers (Hooke and Jeeves 1961).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..camera import Intrinsics, project
from ..errors import MirrorScanError
from ..mesh import Mesh
from ..simulation.mannequin import mannequin
from ..simulation.scene import BACKING, FramedMirror, Rig
from ..simulation.sensors import find_sensor
from .area_coverage import AreaCoverage, BodySamples, area_coverage, body_samples, mirrored
from .predicted_error import PredictedError, predicted_error
from .rooms import Room

Progress = Callable[[float, str], None]

_COARSE = 512  # samples of the body while trying the grid
_DISTANCES, _ANGLES, _LENGTHS = np.arange(1.0, 3.51, 0.25), np.arange(95.0, 156.0, 10.0), np.arange(0.7, 3.2, 0.35)
_BETTERED = 2  # of the coarse placements
_STEPS = ((0.10, 6.0), (0.04, 2.0), (0.015, 0.8))  # of places [m] and angles [degrees], coarse to fine
_SWEEPS = 2  # over all numbers with steps of one size
_MARGIN_PX = 0.015  # of the image, that stays free round the person
_CUT = 0.01  # of a reflection that may be beyond the image
_UNSEEN = 30.0  # millimetres of error that a body's whole area counts as, where it is seen less of than in the README's
_REFUSED = 1000.0  # millimetres of error of what will not do
_FLOOR_GAP = 0.12  # a mirror stands that high above the floor unless the ceiling is low [m]
_CLOSE = 1e-9


@dataclass(frozen=True)
class PlanSettings:
    """What is given besides room, sensor and mirrors.

    Parameters
    ----------
    frame_width : float
        Of the mirrors' mouldings [m]; 0 = frameless.
    frames : int
        Depth frames of the burst.
    behind_camera : float
        Free floor behind the lens, for the tripod [m].
    beside_person : float
        Free space round the person, fingertips included [m].
    from_wall : float
        Least distance of a mirror from a wall [m].
    real_light : bool
        Light by two ways counts; see :func:`.predicted_error.predicted_error`.
    """

    frame_width: float = 0.035
    frames: int = 10
    behind_camera: float = 0.25
    beside_person: float = 0.12
    from_wall: float = 0.02
    real_light: bool = True


@dataclass(frozen=True)
class Placement:
    """A rig in a room, and what it is worth.

    ``rig`` is in the avatar frame, the person at the origin facing -Y, and its ``room`` the walls. ``turned``: the
    person faces along the room's width instead of its depth. ``readme``: the README's placement is possible in this
    room, and the one found is at least as good. ``tried``: rigs judged.
    """

    rig: Rig
    room: Room
    turned: bool
    coverage: AreaCoverage
    error: PredictedError
    readme: bool
    tried: int
    settings: PlanSettings = field(default_factory=PlanSettings)


@dataclass(frozen=True)
class _Numbers:
    """What a rig is made of.

    Distance and height of the camera [m], and for each mirror the direction it shows the person from [degrees], the
    length of the way by it [m], and by how much it looks past the person [degrees].
    """

    distance: float
    height: float
    mirrors: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class _Task:
    """What all candidates have in common."""

    room: Room
    sensor: str
    sizes: tuple[tuple[float, float], ...]
    settings: PlanSettings
    body: BodySamples
    low: np.ndarray
    high: np.ndarray


def find_placement(
    room: Room,
    sensor: str,
    mirrors: Sequence[tuple[float, float]] = ((0.8, 1.75), (0.8, 1.75)),
    body: Mesh | None = None,
    settings: PlanSettings | None = None,
    progress: Progress | None = None,
) -> Placement:
    """The placement in a room with the least predicted error.

    Parameters
    ----------
    room : Room
    sensor : str
        A name of :data:`~.sensors.SENSORS`.
    mirrors : sequence of (width, height)
        Of the glasses [m], one to six.
    body : Mesh or None
        The person, avatar frame: Z up, facing -Y, soles on z = 0. None = a mannequin of 1.70 m.
    settings : PlanSettings or None
    progress : callable or None
        Told the fraction done and what is being done.

    Returns
    -------
    Placement
        The same for the same input. Where the README's placement fits into the room, coverage and predicted error are
        at least as good as its.

    Raises
    ------
    MirrorScanError
        When the room is too small, by how much; when a mirror is higher than the room; when sizes are no sizes.
    """
    steps = placement_steps(room, sensor, mirrors, body, settings)
    while True:
        try:
            fraction, message = next(steps)
        except StopIteration as end:
            return end.value
        if progress is not None:
            progress(fraction, message)


def placement_steps(
    room: Room,
    sensor: str,
    mirrors: Sequence[tuple[float, float]] = ((0.8, 1.75), (0.8, 1.75)),
    body: Mesh | None = None,
    settings: PlanSettings | None = None,
) -> Generator[tuple[float, str], None, Placement]:
    """:func:`find_placement` in pieces of well below a second, so that it can be cancelled between them."""
    settings = settings or PlanSettings()
    sizes = _checked_sizes(room, sensor, mirrors, settings)
    yield 0.0, "Preparing the body"
    body = mannequin(resolution=0.015) if body is None else body
    task = _Task(
        room, sensor, sizes, settings, body_samples(body, _COARSE), body.vertices.min(axis=0), body.vertices.max(axis=0)
    )
    yield 0.02, "Trying placements"
    candidates, shortage = _coarse(task)
    readme = _readme(task)
    possible = _possible(task, _rig_of(task, readme))
    if not candidates and not possible:
        raise _too_small(task, shortage)
    goal = _Goal(_judged(task, readme).coverage.share, possible)
    scored: list[tuple[float, _Numbers]] = []
    for k, numbers in enumerate(candidates):
        if k % 8 == 0:
            yield 0.05 + 0.5 * k / len(candidates), "Trying placements"
        scored.append((goal.cost(_judged(task, numbers)), numbers))
    scored.sort(key=lambda pair: pair[0])
    tried = len(scored)
    whole = replace(task, body=body_samples(body))
    known = _judged(whole, readme)
    goal = _Goal(known.coverage.share, possible)
    starts = [numbers for _, numbers in scored[:_BETTERED]]
    best, cost = (known, goal.cost(known)) if possible else (None, np.inf)
    if possible:
        starts.insert(0, readme)
    for k, numbers in enumerate(starts):
        share = 0.45 / len(starts)
        found, count = yield from _bettered(whole, numbers, goal, 0.55 + share * k, share)
        tried += count
        if best is None or goal.cost(found) < cost:
            best, cost = found, goal.cost(found)
    assert best is not None  # there was at least one start
    rig, turned = _in_room(task, best.rig)
    return Placement(rig, room, turned, best.coverage, best.error, possible, tried, settings)


def _checked_sizes(
    room: Room, sensor: str, mirrors: Sequence[tuple[float, float]], settings: PlanSettings
) -> tuple[tuple[float, float], ...]:
    """The mirrors' sizes, broadest first."""
    find_sensor(sensor)
    if not 1 <= len(mirrors) <= 6:
        raise MirrorScanError(f"plan: {len(mirrors)} mirrors; give one to six")
    for width, height in mirrors:
        if not (0.1 <= width <= 5.0 and 0.1 <= height <= 5.0):
            raise MirrorScanError(f"plan: a mirror of {width:g} × {height:g} m; give sizes from 0.1 to 5 m")
        over = height + 2.0 * settings.frame_width - room.height
        if over > 0:
            raise MirrorScanError(
                f"plan: a mirror of {height:g} m and its frame are {100.0 * over:.0f} cm higher than the room; choose "
                "a lower mirror"
            )
    return tuple(sorted(((float(w), float(h)) for w, h in mirrors), reverse=True))


def _angles_of(first: float, count: int) -> list[float]:
    """Directions of the views by so many mirrors: pairs, one behind the other towards the person's sides."""
    angles: list[float] = []
    for k in range(count):
        aside = max(first - 40.0 * (k // 2), 65.0 + 2.0 * k)
        angles.append(aside if k % 2 == 0 else -aside)
    return angles


def _coarse(task: _Task) -> tuple[list[_Numbers], np.ndarray | None]:
    """The grid's placements that are possible in this room; and by how much width and depth lack for the others [m].

    The second is that of the placement that lacks least; None where none is possible in any room.
    """
    count = len(task.sizes)
    found, least = [], None
    for distance, first, longer in itertools.product(_DISTANCES, _ANGLES, _LENGTHS):
        mirrors = tuple((angle, distance + longer, 0.0) for angle in _angles_of(first, count))
        numbers = _Numbers(float(distance), _camera_height(task), mirrors)
        rig = _rig_of(task, numbers)
        if rig is None:
            continue
        lacking = _lacking(task, rig)
        fits = lacking.max() <= 0.0
        if not fits and least is not None and lacking.clip(0).sum() >= least.clip(0).sum():
            continue
        if _is_free(task, rig) and _in_picture(task, rig):
            if fits:
                found.append(numbers)
            else:
                least = lacking
    return found, least


def _camera_height(task: _Task) -> float:
    """A little above half the person's height, and lower than the ceiling [m]."""
    return float(min(0.53 * task.high[2], task.room.height - 0.2))


def _readme(task: _Task) -> _Numbers:
    """The README's placement, with these mirrors; whether the room holds it or not."""
    return _Numbers(2.5, 0.9, tuple((angle, 4.6, 0.0) for angle in _angles_of(120.0, len(task.sizes))))


def _rig_of(task: _Task, numbers: _Numbers) -> Rig | None:
    """The rig that the numbers describe, its places whole centimetres and its angles half degrees; None without one."""
    lens = find_sensor(task.sensor).intrinsics
    distance, height = round(numbers.distance, 2), round(numbers.height, 2)
    camera = np.array((0.0, -distance, height))
    framed: list[FramedMirror] = []
    for (angle, length, past), (w, h) in zip(numbers.mirrors, task.sizes, strict=True):
        if length <= distance + 0.2:
            return None
        a = np.radians(angle)
        virtual = length * np.array([np.sin(a), -np.cos(a)])
        normal = (camera[:2] - virtual) / np.linalg.norm(camera[:2] - virtual)
        reach = float(((camera[:2] + virtual) / 2) @ normal / (virtual @ normal))
        if not 0.0 < reach < 1.0:
            return None
        place = np.round(reach * virtual, 2)
        facing = np.radians(np.round(2.0 * (np.degrees(np.arctan2(normal[0], -normal[1])) + past)) / 2.0)
        up_to = task.room.height - h - task.settings.frame_width - 0.01
        bottom = round(min(max(_FLOOR_GAP, _reflection_bottom(task, height, reach, h)), max(up_to, 0.0)), 2)
        side = "right" if angle > 0 else "left"
        taken = sum(m.name.split()[0] == side for m in framed)
        framed.append(
            FramedMirror(
                side if not taken else f"{side} {taken + 1}", (float(place[0]), float(place[1]), bottom + h / 2),
                (float(np.sin(facing)), float(-np.cos(facing)), 0.0), width=w, height=h,
                frame_width=task.settings.frame_width,
            )
        )  # fmt: skip
    return Rig(
        lens, (0.0, -distance, height), tuple(framed), tilt_deg=_tilt(task, lens, distance, height), room=None,
        sensor=task.sensor, frames=task.settings.frames,
    )  # fmt: skip


def _reflection_bottom(task: _Task, height: float, reach: float, glass: float) -> float:
    """How high the lower edge of a glass is whose middle shows the person's [m]."""
    share = 1.0 - reach  # of the way from the camera to the glass
    middle = height + share * (0.5 * task.high[2] - height)
    return middle - 0.5 * glass


def _tilt(task: _Task, lens: Intrinsics, distance: float, height: float) -> float:
    """The camera's tilt that leaves as much of the picture free above the person as below, down positive [degrees]."""
    near = distance + task.low[1]
    above, below = np.arctan2(task.high[2] - height, near), np.arctan2(task.low[2] - height, near)
    up, down = np.arctan2(lens.cy, lens.fy), np.arctan2(lens.height - 1 - lens.cy, lens.fy)
    return float(np.round(2.0 * np.degrees(0.5 * (up - down) - 0.5 * (above + below))) / 2.0)


def _possible(task: _Task, rig: Rig | None) -> bool:
    """Whether the rig stands in the room, nothing overlaps, and the camera has all of the person in its picture."""
    return (
        rig is not None and _lacking(task, rig).max() <= 0.0 and _is_free(task, rig) and _in_picture(task, rig)
    )  # fmt: skip


def footprint(mirror: FramedMirror, count: int = 2) -> np.ndarray:
    """Where a mirror stands, seen from above: ``count`` places along its front and as many along its back [m]."""
    right, _, normal = mirror.axes
    along = np.linspace(-1.0, 1.0, count)[:, None] * (0.5 * mirror.width + mirror.frame_width) * right[:2]
    front = np.array(mirror.centre[:2]) + along
    return np.concatenate((front + mirror.frame_depth * normal[:2], front - BACKING * normal[:2]))


def _extent(task: _Task, rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper x, y of all the floor that the rig takes [m]."""
    settings = task.settings
    x, y = rig.camera[:2]
    places = [np.array((x - 0.2, y - settings.behind_camera)), np.array((x + 0.2, y))]
    places += [task.low[:2] - settings.beside_person, task.high[:2] + settings.beside_person]
    for mirror in rig.mirrors:
        stands = footprint(mirror)
        places += [*(stands - settings.from_wall), *(stands + settings.from_wall)]
    return np.min(places, axis=0), np.max(places, axis=0)


def _lacking(task: _Task, rig: Rig) -> np.ndarray:
    """By how much the room's width, depth and height are too small, the rig turned the better way [m]; ≤ 0 fits."""
    low, high = _extent(task, rig)
    across, along = high - low
    over_height = task.high[2] + 0.05 - task.room.height
    ways = [
        np.array((across - task.room.width, along - task.room.depth, over_height)),
        np.array((along - task.room.width, across - task.room.depth, over_height)),
    ]
    return min(ways, key=lambda way: way.clip(0).sum())


def _in_room(task: _Task, rig: Rig) -> tuple[Rig, bool]:
    """The rig with the room's walls round its middle, and whether it is turned a quarter in it."""
    low, high = _extent(task, rig)
    room = task.room
    straight = high[0] - low[0] <= room.width + _CLOSE and high[1] - low[1] <= room.depth + _CLOSE
    sizes = np.array((room.width, room.depth) if straight else (room.depth, room.width))
    start = np.round(0.5 * (low + high - sizes), 2)
    start = np.minimum(np.maximum(start, high - sizes), low)
    x0, y0 = (float(value) for value in start)
    walls = (x0, x0 + float(sizes[0]), y0, y0 + float(sizes[1]), room.height)
    return replace(rig, room=walls), not straight


def _is_free(task: _Task, rig: Rig) -> bool:
    """Whether mirrors, person and camera leave each other room."""
    stands = [footprint(mirror, 33) for mirror in rig.mirrors]
    beside = task.settings.beside_person
    for k, one in enumerate(stands):
        if _nearest(one, task.body.points[:, :2]) < beside or _nearest(one, np.array([rig.camera[:2]])) < 0.3:
            return False
        if any(_nearest(one, other) < 0.05 for other in stands[:k]):
            return False
    return True


def _nearest(one: np.ndarray, other: np.ndarray) -> float:
    """Least distance of two sets of places seen from above (A, 2), (B, 2) [m]."""
    x, y = (one[:, None, axis] - other[None, :, axis] for axis in range(2))
    return float(np.sqrt((x * x + y * y).min()))


def _in_picture(task: _Task, rig: Rig) -> bool:
    """Whether the camera sees all of the person and of its reflections, as far as the edges of its picture go."""
    pose, lens = rig.camera_to_avatar, rig.intrinsics
    spare = _MARGIN_PX * lens.height
    ends = np.array(list(itertools.product(*zip(task.low, task.high, strict=True))))
    ends[:, :2] *= 0.5  # a body fills no corner of its box
    for view, points in enumerate((np.concatenate((task.body.points, ends)), *[task.body.points] * len(rig.mirrors))):
        image = points if view == 0 else mirrored(points, rig.mirrors[view - 1])
        u, v = project((image - pose[:3, 3]) @ pose[:3, :3], lens).T
        inside = (u >= spare) & (v >= spare) & (u <= lens.width - 1 - spare) & (v <= lens.height - 1 - spare)
        if (~inside).mean() > (0.0 if view == 0 else _CUT):
            return False
    return True


@dataclass(frozen=True)
class _Judged:
    """What a rig is worth."""

    rig: Rig
    coverage: AreaCoverage
    error: PredictedError


def _judged(task: _Task, numbers: _Numbers) -> _Judged:
    rig = _rig_of(task, numbers)
    assert rig is not None  # only possible ones are judged
    coverage = area_coverage(task.body, rig)
    return _Judged(rig, coverage, predicted_error(task.body, coverage, rig, task.settings.real_light))


@dataclass(frozen=True)
class _Goal:
    """What is minimised: the predicted error [mm], not to see less than ``share``, the README's placement's.

    ``strict``: that placement is possible here, so nothing that sees less will do.
    """

    share: float
    strict: bool

    def cost(self, judged: _Judged) -> float:
        lacking = max(0.0, self.share - judged.coverage.share)
        if self.strict and lacking > 0.0:
            return _REFUSED * (1.0 + lacking)
        return judged.error.mean_mm + _UNSEEN * lacking


def _bettered(
    task: _Task, start: _Numbers, goal: _Goal, done: float, share: float
) -> Generator[tuple[float, str], None, tuple[_Judged, int]]:
    """A pattern search from ``start``: what it found, and how many rigs were judged.

    It is ``share`` of the whole work, of which ``done`` was done before.
    """
    now, best = _flat(start), _judged(task, start)
    cost, tried = goal.cost(best), 1
    for size, (place, angle) in enumerate(_STEPS):
        steps = np.array([place, place] + [angle, 1.5 * place, 0.5 * angle] * len(start.mirrors))
        for sweep in range(_SWEEPS):
            before = cost
            for k, way in itertools.product(range(len(now)), (1.0, -1.0)):
                here = (size + (sweep + k / len(now)) / _SWEEPS) / len(_STEPS)
                yield done + share * here, "Improving the best placements"
                there = now.copy()
                there[k] += way * steps[k]
                numbers = _unflat(there)
                if not _possible(task, _rig_of(task, numbers)):
                    continue
                tried += 1
                found = _judged(task, numbers)
                if goal.cost(found) < cost - 1e-4:
                    now, best, cost = there, found, goal.cost(found)
            if cost > before - 1e-3:
                break
    return best, tried


def _flat(numbers: _Numbers) -> np.ndarray:
    return np.array((numbers.distance, numbers.height, *itertools.chain.from_iterable(numbers.mirrors)))


def _unflat(values: np.ndarray) -> _Numbers:
    distance, height, *rest = (float(value) for value in values)
    return _Numbers(distance, height, tuple((rest[k], rest[k + 1], rest[k + 2]) for k in range(0, len(rest), 3)))


def _too_small(task: _Task, lacking: np.ndarray | None) -> MirrorScanError:
    """Why no placement is possible, and what would help."""
    if lacking is None:
        return MirrorScanError(
            "plan: in no room do this camera and these mirrors show a whole person; choose other mirrors or a camera "
            "with a wider view"
        )
    parts = [
        f"{np.ceil(100.0 * value):.0f} cm {word}"
        for value, word in zip(lacking, ("wider", "deeper", "higher"), strict=True)
        if value > 0
    ]
    room = task.room
    return MirrorScanError(
        f"plan: a room of {room.width:g} × {room.depth:g} × {room.height:g} m is too small for this camera and these "
        f"mirrors; it would have to be {' and '.join(parts)}, or choose smaller mirrors or a camera with a wider view"
    )
