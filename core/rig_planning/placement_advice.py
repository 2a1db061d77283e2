"""Whether head, hands and feet are whole in each view of a planned rig, and what to move otherwise, found by trying."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..camera import project
from ..checks.scene_advice import MAX_HIDDEN
from ..errors import Notice
from ..simulation.rays import lit
from ..simulation.scene import FramedMirror, Rig
from .area_coverage import PARTS, BodySamples, as_sight

WHOLE = 0.97
"""Share of a part that must be within the glass and the image to call it whole; samples are few."""
_MOVES = np.arange(0.05, 0.81, 0.05)  # tried for a mirror or the camera [m]
_TURNS = np.arange(2.0, 31.0, 2.0)  # tried about the vertical, and of the camera's tilt [degrees]
_TILTS = np.arange(1.0, 16.0, 1.0)
_WAYS = ("to the right", "to the left", "back", "towards the camera", "up", "down")
_BOTH = 10.0  # a mirror may be asked to be turned by at the same time as it is moved [degrees]
_LOOKED_AT = 24  # of the moves that show everything, for which it is checked whether the person hides it
_DEGREE = 0.015  # of a turn is as much trouble as moving so far [m]
_BARELY = 0.02  # added to what a mirror is too small by [m]
_TRIED = 400  # samples that moves are tried with


@dataclass(frozen=True)
class ViewCheck:
    """What one view shows of head, hands and feet.

    Parameters
    ----------
    name : str
        ``"direct"`` or the mirror's.
    shown : dict of str to float
        Share of head, hands and feet, and of the ``"rest"``, within the glass and the image. What the body hides of
        itself counts as shown; NaN for what a body does not have.
    hidden : float
        Share of the reflection that the person stands in front of.
    advice : Notice or None
        What is cut off and what to move; None where all is well.
    """

    name: str
    shown: dict[str, float]
    hidden: float
    advice: Notice | None

    def whole(self, part: str) -> bool:
        """Whether ``"head"``, ``"hands"`` or ``"feet"`` are in this view from edge to edge."""
        return not self.shown[part] < WHOLE


def placement_advice(body: BodySamples, rig: Rig) -> list[ViewCheck]:
    """Check each view of the rig, the direct one first. Some 20 ms where something has to be moved."""
    few = slice(None, None, max(1, len(body.points) // _TRIED))
    points, part = body.points[few], body.part[few]
    checks = [_of_camera(points, part, rig)]
    for view in range(1, 1 + len(rig.mirrors)):
        shown = _shares(_shown(points, rig, view), part)
        hidden = _hidden(body, rig, view)
        checks.append(ViewCheck(rig.mirrors[view - 1].name, shown, hidden, None))
        advice = _about_mirror(body, points, part, rig, view, checks[-1])
        checks[-1] = replace(checks[-1], advice=advice)
    return checks


def _shown(points: np.ndarray, rig: Rig, view: int) -> np.ndarray:
    """Which points (N,) lie within the image, and on their way within the glass, of a view."""
    if view:
        mirror = rig.mirrors[view - 1]
        return _shown_from(points, rig, mirror, np.array([mirror.centre]))[0]
    return _in_image(points, rig)


def _in_image(points: np.ndarray, rig: Rig) -> np.ndarray:
    """Which points (..., 3) the camera has in its image."""
    pose, lens = rig.camera_to_avatar, rig.intrinsics
    u, v = np.moveaxis(project((points - pose[:3, 3]) @ pose[:3, :3], lens), -1, 0)
    return (u >= 0) & (v >= 0) & (u <= lens.width - 1) & (v <= lens.height - 1)  # NaN behind the camera


def _shown_from(points: np.ndarray, rig: Rig, mirror: FramedMirror, centres: np.ndarray) -> np.ndarray:
    """Which points (N,) a mirror would show in the image if its centre were at each of some places (T, 3): (T, N)."""
    normal = mirror.axes[2]
    x, y, before, far = _places(points, rig.camera_to_avatar[:3, 3], mirror, centres)
    on_glass = before & (np.abs(x) <= 0.5 * mirror.width) & (np.abs(y) <= 0.5 * mirror.height)
    return on_glass & _in_image(points - 2.0 * far[..., None] * normal, rig)


def _places(
    points: np.ndarray, eye: np.ndarray, mirror: FramedMirror, centres: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Where the lines of sight to the reflections meet the glass, right and up of each centre [m]; all (T, N).

    Whether both the eye and the point are in front of it, and how far the point is [m].
    """
    right, up, normal = mirror.axes
    high, far = (eye - centres) @ normal, points @ normal - (centres @ normal)[:, None]
    before = (far > 0) & (high > 0)[:, None]
    share = far / np.where(before, far + high[:, None], 1.0)
    x, y = (
        points @ axis - (centres @ axis)[:, None] + share * (eye @ axis - points @ axis) for axis in (right, up)
    )  # fmt: skip
    return x, y, before, far


def _shares(shown: np.ndarray, part: np.ndarray) -> dict[str, float]:
    return {name: float(shown[part == k].mean()) if (part == k).any() else float("nan") for k, name in enumerate(PARTS)}


def _hidden(body: BodySamples, rig: Rig, view: int) -> float:
    """Share of a reflection that the person hides from the camera, of what is on the glass and in the image."""
    mirror = rig.mirrors[view - 1]
    pose = rig.camera_to_avatar
    at = np.flatnonzero(_shown(body.points, rig, view))
    if not len(at):
        return 0.0
    right, up, normal = mirror.axes
    x, y = (found[0] for found in _places(body.points[at], pose[:3, 3], mirror, np.array([mirror.centre]))[:2])
    places = np.array(mirror.centre) + x[:, None] * right + y[:, None] * up + 1e-3 * normal
    on_glass = replace(body, points=places, normals=np.tile(normal, (len(at), 1)), part=body.part[at])
    free = lit(as_sight(on_glass, (1, len(at))), body.bvh, replace(rig, mirrors=()), 0.0)[..., 0] > 0
    return float(1.0 - free.mean())


def _all_whole(shown: dict[str, float]) -> bool:
    return not any(value < WHOLE for value in shown.values())  # NaN: the body has no such part


def _cut_parts(shown: dict[str, float]) -> Notice:
    """Which parts are cut off, with their verb."""
    cut = [name for name in PARTS[1:] if shown[name] < WHOLE]
    if not cut:
        return Notice("parts of the body are")
    if cut == ["head"]:
        return Notice("the head is")
    words = {"head": "the head", "hands": "the hands", "feet": "the feet"}
    return Notice("{parts} are", parts=" and ".join(words[name] for name in cut))


def _of_camera(points: np.ndarray, part: np.ndarray, rig: Rig) -> ViewCheck:
    """The direct view."""
    shown = _shares(_shown(points, rig, 0), part)
    if _all_whole(shown):
        return ViewCheck("direct", shown, 0.0, None)
    moved = Notice("step back until all of the person is in the picture")
    for _, words, tried in sorted(_camera_moves(rig), key=lambda move: move[0]):
        if _all_whole(_shares(_shown(points, tried, 0), part)):
            moved = words
            break
    advice = Notice("camera: {parts} cut off; {move}", parts=_cut_parts(shown), move=moved)
    return ViewCheck("direct", shown, 0.0, advice)


def _about_mirror(
    body: BodySamples, points: np.ndarray, part: np.ndarray, rig: Rig, view: int, check: ViewCheck
) -> Notice | None:
    """What is wrong with a mirror's view, and the least move that makes it right."""
    mirror = rig.mirrors[view - 1]
    cut, hidden = not _all_whole(check.shown), check.hidden > MAX_HIDDEN
    if not cut and not hidden:
        return None

    move = _mirror_move(body, points, part, rig, view)
    if not cut:
        move = move or Notice("move it outwards and turn it so that the person stays in its middle")
        return Notice(
            "{name} mirror: {share:.0%} of the reflection is behind the person; {move}", mirrors=[mirror.name],
            name=mirror.name, share=check.hidden, move=move,
        )  # fmt: skip
    move = move or _too_small(points, rig, view)
    return Notice(
        "{name} mirror: {parts} cut off; {move}", mirrors=[mirror.name], name=mirror.name,
        parts=_cut_parts(check.shown), move=move,
    )  # fmt: skip


def _camera_moves(rig: Rig) -> Iterator[tuple[float, Notice, Rig]]:
    """How the camera might be moved: how much trouble it is [m], in words, and the rig then."""
    ahead = rig.camera_to_avatar[:2, 2]
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    for degrees in _TILTS:
        for way, word in ((1.0, "down"), (-1.0, "up")):
            words = Notice("tilt the camera {way} by {angle:.0f}°", way=word, angle=degrees)
            yield _DEGREE * degrees, words, replace(rig, tilt_deg=rig.tilt_deg + way * degrees)
    for metres in np.arange(0.1, 2.01, 0.1):
        x, y = np.array(rig.camera[:2]) - metres * ahead
        for degrees in (0.0, 3.0, -3.0, 6.0, -6.0):
            moved = replace(rig, camera=(x, y, rig.camera[2]), tilt_deg=rig.tilt_deg + degrees, room=None)
            words = Notice("move the camera back by {distance:.0f} cm", distance=100.0 * metres)
            if degrees:
                words = Notice(
                    "{move} and tilt it {way} by {angle:.0f}°", move=words, way="down" if degrees > 0 else "up",
                    angle=abs(degrees),
                )  # fmt: skip
            yield metres + _DEGREE * abs(degrees), words, moved


def _mirror_move(body: BodySamples, points: np.ndarray, part: np.ndarray, rig: Rig, view: int) -> Notice | None:
    """The least move or turn of one mirror that makes its view right, in words; None where none does.

    Directions are as the camera sees them.
    """
    mirror = rig.mirrors[view - 1]
    pose = rig.camera_to_avatar
    side = np.array((pose[0, 0], pose[1, 0], 0.0))
    side /= max(float(np.linalg.norm(side)), 1e-9)
    ahead = np.array((-side[1], side[0], 0.0))
    up = np.array((0.0, 0.0, 1.0))
    ways = np.array((side, -side, ahead, -ahead, up, -up))
    steps = np.concatenate((np.zeros((1, 3)), (_MOVES[:, None, None] * ways).reshape(-1, 3)))
    centres = np.array(mirror.centre) + steps
    stands = centres[:, 2] - 0.5 * mirror.height - mirror.frame_width >= min(
        0.0, mirror.centre[2] - 0.5 * mirror.height
    )
    stands[0] = True
    good: list[tuple[float, float, int]] = []
    for degrees in (0.0, *(-_TURNS), *_TURNS):
        count = 1 if abs(degrees) > _BOTH else len(steps)  # a large turn and a move at once are too much to ask
        shown = _shown_from(points, rig, _turned(mirror, float(degrees)), centres[:count])
        whole = np.ones(count, np.bool_)
        for k in range(len(PARTS)):
            if (part == k).any():
                whole &= shown[:, part == k].mean(axis=1) >= WHOLE
        for at in np.flatnonzero(whole & stands[:count]):
            moved = float(np.linalg.norm(steps[at]))
            both = 0.05 if at and degrees else 0.0
            good.append((moved + _DEGREE * abs(float(degrees)) + both, float(degrees), int(at)))
    for _, degrees, at in sorted(good)[:_LOOKED_AT]:
        x, y, z = (float(value) for value in centres[at])
        if _hidden(body, _with(rig, view, replace(_turned(mirror, degrees), centre=(x, y, z))), view) <= MAX_HIDDEN:
            return _move_in_words(at, degrees)
    return None


def _move_in_words(at: int, degrees: float) -> Notice:
    """The ``at``-th of the moves, 0 = none, and a turn by so much."""
    turn = Notice(
        "turn it by {angle:.0f}°, its {edge} edge forward", angle=abs(degrees), edge="left" if degrees > 0 else "right"
    )
    if not at:
        return turn
    step, way = divmod(at - 1, len(_WAYS))
    move = Notice("move it {way} by {distance:.0f} cm", way=_WAYS[way], distance=100.0 * _MOVES[step])
    return Notice("{move} and {turn}", move=move, turn=turn) if degrees else move


def _turned(mirror: FramedMirror, degrees: float) -> FramedMirror:
    """The mirror turned about its upright middle, anticlockwise seen from above."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    x, y, z = mirror.normal
    a, b, e = mirror.up
    return replace(mirror, normal=(c * x - s * y, s * x + c * y, z), up=(c * a - s * b, s * a + c * b, e))


def _with(rig: Rig, view: int, mirror: FramedMirror) -> Rig:
    return replace(rig, mirrors=(*rig.mirrors[: view - 1], mirror, *rig.mirrors[view:]), room=None)


def _too_small(points: np.ndarray, rig: Rig, view: int) -> Notice:
    """By how much the glass is too small, or that the image ends, where no single move helps."""
    mirror = rig.mirrors[view - 1]
    x, y, before, _ = _places(points, rig.camera_to_avatar[:3, 3], mirror, np.array([mirror.centre]))
    if before.all():
        wide = float(np.ptp(x)) + _BARELY - mirror.width
        high = float(np.ptp(y)) + _BARELY - mirror.height
        parts = [(wide, "wider"), (high, "higher")]
        words = " and ".join(f"{100.0 * value:.0f} cm {word}" for value, word in parts if value > 0)
        if words:
            return Notice("use a mirror that is {sizes}", sizes=words)
    return Notice("move the camera back, or this mirror to where the camera sees the person in it")
