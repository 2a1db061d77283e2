"""What is wrong with a scene, in words a user understands, and what to move.

:func:`scene_findings` says it with what to move, and where to; :func:`check_scene` in words alone.

All is geometry: the subject's points that the other views show are reflected in each mirror, and it is checked where
they would be seen: on the glass or past it, in the image or out of it, behind something, farther than the camera reads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..camera import Intrinsics, RgbdImage
from ..camera.noise_models import NoiseModel
from ..errors import Notice
from ..mirrors import Mirror
from ..mirrors.glass_extent import glass_corners
from ..mirrors.mirror import reflection_matrix
from ..mirrors.wall_behind_frame import on_wall
from ..numeric.point_products import dot
from ..subject.image_border import cut_sides
from ..subject.subject_views import Views
from ..views.floor_and_vertical import leans
from ..views.rig_axis import rig_axis, visible_middle
from .reflection_forecast import (
    Reflection,
    distance_past_edges,
    foresee,
    reach_beyond_edges,
    reflections_on_mirror,
    thinned,
    without_frame,
)
from .view_disagreement import quoted

MAX_LEAN_DEG = 4.0
"""Mirrors that lean more than this are reported."""

MAX_CUT = 0.05
"""Of the subject that the image, or a glass, may cut off in a mirror before it is reported [share]."""

MAX_OVER = 0.04
"""What the subject's reflection may reach over an edge of the glass, or of the image, before it is reported [m]."""

MAX_HIDDEN = 0.07
"""Of a reflection that may be hidden by the subject's own body or something else before it is reported [share]."""

MAX_FAR = 1.25
"""Of the distance to which the camera reads well, that a reflection may be away before it is reported [share]."""

MAX_UNREAD, MAX_UNREAD_PATTERN = 0.5, 0.75
"""Of a reflection, beyond the camera's range, that may have no reading before it is reported [share]; where two
patterns light a surface a structured-light camera loses half of it at any distance."""

MAX_PLANE_ERROR = 0.012
"""A mirror whose plane may misplace the subject by more than this is reported [m]."""

MIN_ANGLE_DEG = 25.0
"""Views from directions with a smaller angle between them show the same side."""

MAX_GAP_DEG = 200.0
"""A wider gap between the directions the subject is seen from leaves a side unseen."""

_NOT_SHOWN = 0.15  # of the subject: a mirror that shows less of it shows something else
_MUCH_HIDDEN = 0.25  # of a reflection: where the glass ends behind that is uncertain
_CURED, _BY_ARMS = 0.3, 0.5  # of MAX_HIDDEN, when a move helps; of what is hidden, when it is the arms that hide it
_ROOM = 0.02  # added to how much a mirror is too small or too far aside [m]
_CLEARLY_OVER = 0.1  # m: so far over, even an uncertain edge certainly cuts the subject off
_LONG_MOVE, _SHORT_STEP = 0.15, 0.1  # m: a mirror is rotated rather than moved so far; nobody is asked to step less
_OUTWARDS = np.arange(0.05, 0.85, 0.05)  # by how much a mirror may be asked to be moved [m]
_SPARE_DEG = 2.5  # between the image's border and the subject: toes point forward, hair stands up
_TOES_DEG, _HAIR_DEG = 2.0, 0.2  # the least of that at the lower and at the upper border


@dataclass(frozen=True)
class Move:
    """What is to be moved, and where to.

    Parameters
    ----------
    what : str
        ``subject``, ``arms``, ``mirror`` or ``camera``.
    start : np.ndarray [shape=(3,)]
        A point of it, camera frame [m].
    shift : np.ndarray [shape=(3,)]
        By how much it is to be moved [m]; where it is to be turned, the way its ``start`` goes.
    angle_deg : float
        By how much it is to be turned; 0 = only moved.
    """

    what: str
    start: np.ndarray
    shift: np.ndarray
    angle_deg: float = 0.0


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong with a scene.

    Parameters
    ----------
    kind : str
        ``head_cut``, ``feet_cut``, ``side_cut`` (by the image), ``aside`` (the subject is not where the mirrors look),
        ``not_shown``, ``mirror_small``, ``glass_edge``, ``image_edge``, ``far``, ``unread``, ``body_hides``,
        ``arms_hide``, ``blocked``, ``plane_uncertain``, ``no_floor``, ``leaning``, ``same_side``, ``side_unseen``.
    text : str
        What is wrong, where, and what to do.
    mirror : str
        Name of the mirror it is about; empty for none.
    move : Move or None
        What to move, where that is known.
    """

    kind: str
    text: str
    mirror: str = ""
    move: Move | None = None


def check_scene(
    image: RgbdImage, views: Views, mirrors: list[Mirror], model: NoiseModel | None = None, alone: bool = True
) -> list[str]:
    """The texts of :func:`scene_findings`."""
    return [finding.text for finding in scene_findings(image, views, mirrors, model, alone)]


def scene_findings(
    image: RgbdImage,
    views: Views,
    mirrors: list[Mirror],
    model: NoiseModel | None = None,
    alone: bool = True,
    search: bool = True,
) -> list[Finding]:
    """What is wrong with a scene from which a result is possible, the worst for the result first.

    Parameters
    ----------
    image : RgbdImage
        z [m], 0 = no reading.
    views : Views
        Of :func:`.subject_search.find_subject`.
    mirrors : list of Mirror
    model : NoiseModel or None
        Of the camera, where it is known: how far it reads.
    alone : bool
        No other camera looks at the subject: what this one does not see nobody sees.
    search : bool
        Where a mirror ought to stand for the subject not to hide its reflection is searched for, which takes most of
        the time; else it is only said that it is to be moved.

    Returns
    -------
    list of Finding
        Empty for a good scene.
    """
    intrinsics = image.intrinsics
    warned = _cut_by_image(image, views)
    subject = thinned(views, views.labels == 0)
    if len(subject):
        # what a mirror shows itself ends where its glass does
        others = [thinned(views, (views.labels >= 0) & (views.labels != k)) for k in range(1, len(mirrors) + 1)]
        mirrors = [without_frame(image, m, views) for m in mirrors]
        found = [foresee(image, points, views, m) for points, m in zip(others, mirrors, strict=True)]
        step = _step_aside(subject, views, mirrors, found, intrinsics)
        if step is not None:
            warned.append(step)
        for k, (mirror, reflection) in enumerate(zip(mirrors, found, strict=True), start=1):
            if_moved = partial(foresee, image, others[k - 1], views)
            case = _Case(mirror, k, reflection, if_moved, search)
            about = _about_mirror(case, views, model, intrinsics, step is not None)
            warned += [replace(one, text=Notice.of(one.text, [mirror.name]), mirror=mirror.name) for one in about]
            error = mirror.displacement(subject[::16])
            # a mirror whose frame is on a wall has its own warning
            if error is not None and error > MAX_PLANE_ERROR and not on_wall(mirror):
                text = Notice(
                    "the plane of {mirror} is so uncertain that its view of the subject may be {error:.0f} mm off; "
                    "record a longer burst, pick points on all sides of its frame, or use a wider frame",
                    mirror=quoted(mirror), error=1000.0 * error,
                )  # fmt: skip
                warned.append(Finding("plane_uncertain", text, mirror.name))
    warned += _about_rig(views, mirrors, alone)
    return warned


def _cut_by_image(image: RgbdImage, views: Views) -> list[Finding]:
    """The subject, seen directly, where the picture ends."""
    cut = cut_sides(image.depth, views.labels == 0)
    if not cut:
        return []
    aside = "step to the middle of the image or farther back"
    over, under = _beyond_image(views, image.intrinsics, True), _beyond_image(views, image.intrinsics, False)
    up, down = tilt_by(over, _HAIR_DEG, under, _TOES_DEG), tilt_by(under, _TOES_DEG, over, _HAIR_DEG)
    advice = {
        "top": ("upper", "the head is", f"tilt the camera up{_in_degrees(up)} or step back"),
        "bottom": ("lower", "the feet are", f"tilt the camera down{_in_degrees(down)} or step back"),
        "left": ("left", "a side is", aside),
        "right": ("right", "a side is", aside),
    }  # fmt: skip
    if {"top", "bottom"} <= cut.keys() or (up if "top" in cut else down) == 0:  # it is too high for the image
        advice["top"], advice["bottom"] = (
            ("upper", "the head is", "step back"), ("lower", "the feet are", "step back")
        )  # fmt: skip
    warned: list[Finding] = []
    kinds = {"top": "head_cut", "bottom": "feet_cut", "left": "side_cut", "right": "side_cut"}
    for side, margin in cut.items():
        border, what, do = advice[side]
        text: str = f"the image's {border} border cuts the subject off: {what} missing and filled in by guess; {do}"
        if margin > 0:
            text = Notice(
                "the {border} end of what the camera reads, {margin} px inside of the image, cuts the subject off: "
                "{what} missing and filled in by guess; {do}",
                border=border, margin=margin, what=what, do=do,
            )  # fmt: skip
        tilts = side in ("top", "bottom") and "tilt" in do
        tilt = (up if side == "top" else down) if tilts else None
        warned.append(Finding(kinds[side], text, move=_cut_move(views, side, tilt)))
    return warned


def _cut_move(views: Views, side: str, tilt_deg: int | None) -> Move:
    """Where the camera is to be tilted, or the subject to step, when the image cuts it off."""
    up = views.up
    if tilt_deg:
        distance = float(np.linalg.norm(views.axis))
        way = up if side == "top" else -up
        return Move("camera", views.axis, np.tan(np.radians(tilt_deg)) * distance * way, tilt_deg)
    if side in ("top", "bottom"):
        back = views.axis - (views.axis @ up) * up
        return Move("subject", views.axis, 0.3 * back / np.linalg.norm(back))
    right = np.cross(up, (0.0, 0.0, -1.0))
    return Move("subject", views.axis, (0.3 if side == "left" else -0.3) * right / np.linalg.norm(right))


def _beyond_image(views: Views, intrinsics: Intrinsics, upwards: bool) -> float:
    """By what angle head or feet are beyond the image [degrees].

    Mirrors show how tall the subject is, and the floor where its feet are. NaN where neither is known.
    """
    reflected = dot(views.points[views.labels > 0], views.up)
    if upwards:
        end = np.quantile(reflected, 0.999) if len(reflected) else np.nan
    else:
        end = views.floor if views.floor is not None else np.quantile(reflected, 0.001) if len(reflected) else np.nan
    x, y, z = views.axis + (end - views.axis @ views.up) * views.up
    border = 0 if upwards else intrinsics.height - 1
    beyond = np.degrees(np.arctan2(y, z) - np.arctan2(border - intrinsics.cy, intrinsics.fy))
    return float(-beyond if upwards else beyond)


def tilt_by(beyond: float, room: float, other: float, other_room: float) -> int | None:
    """By how much to tilt the camera [degrees], so that neither end of the subject is cut off.

    Parameters
    ----------
    beyond, other : float
        By what angle the end that is cut off, and the other one, are beyond the image [degrees]; negative within it,
        NaN where that is not known.
    room, other_room : float
        How far within the image they have to be at least [degrees].

    Returns
    -------
    int or None
        0 where no tilt shows both ends; None where it is not known.
    """
    if np.isnan(beyond):
        return None
    by = max(int(np.ceil(_SPARE_DEG + beyond)), 2)
    if by >= 45:
        return None
    if not np.isnan(other):
        by = min(by, int(np.floor(-other - other_room)))
    return by if by > max(beyond + room, 0.0) else 0


def _in_degrees(by: int | None) -> str:
    """By how much to tilt the camera, in words."""
    return "" if by is None else f" by {by}°"


def _step_aside(
    subject: np.ndarray, views: Views, mirrors: list[Mirror], found: list[Reflection], intrinsics: Intrinsics
) -> Finding | None:
    """Where to stand instead, when the sides of more than one glass cut the subject off and none would there."""
    sides = [max(reflection.over_glass["left"], reflection.over_glass["right"]) for reflection in found]
    out = [mirror for mirror, over in zip(mirrors, sides, strict=True) if over > MAX_OVER]
    expected = rig_axis(mirrors, views.up, intrinsics) if len(out) > 1 else None
    if expected is None:
        return None
    step = expected - views.axis
    step -= (step @ views.up) * views.up
    if np.linalg.norm(step) < _SHORT_STEP:
        return None
    for mirror in mirrors:
        corners = glass_corners(mirror)
        if corners is not None:
            _, a, b, _ = reflections_on_mirror(subject + step, mirror)
            over = reach_beyond_edges(distance_past_edges(a, b, corners))
            if max(over["left"], over["right"]) > MAX_OVER:
                return None
    right = np.cross(views.up, (0.0, 0.0, -1.0))
    right /= np.linalg.norm(right)
    ways = (
        (step @ right, "to the right", "to the left"),
        (step @ np.cross(views.up, right), "away from the camera", "towards the camera"),
    )
    moves = [f"{100 * abs(by):.0f} cm {one if by > 0 else other}" for by, one, other in ways if abs(by) > 0.05]
    way = " and ".join(moves)
    names = " and ".join(map(quoted, out))
    text = Notice(
        "{names} show only part of the subject, because it is not where they look; step {way} (as seen by the camera)",
        names=names, way=way, mirrors=[mirror.name for mirror in out],
    )  # fmt: skip
    return Finding("aside", text, move=Move("subject", views.axis, step))


def _rotated(mirror: Mirror, views: Views, intrinsics: Intrinsics, outwards: float = 0.0) -> tuple[Mirror, str]:
    """The mirror rotated until the subject is in its middle, and in words how it is rotated.

    It is rotated about the vertical, and first moved ``outwards`` [m], away from the subject's side.
    """
    up = views.up
    middle = mirror.point if mirror.outline is None else visible_middle(mirror, intrinsics)
    right = np.cross(up, (0.0, 0.0, -1.0))
    right /= np.linalg.norm(right)
    side = np.sign((middle - views.axis * (middle[2] / views.axis[2])) @ right) or 1.0
    moved = middle + outwards * side * right

    def level(direction: np.ndarray) -> np.ndarray:
        direction = direction - (direction @ up) * up
        return direction / np.linalg.norm(direction)

    now, wanted = level(mirror.normal), level(level(-moved) + level(views.axis - moved))
    angle = np.arctan2(np.cross(now, wanted) @ up, now @ wanted)
    c, s = np.cos(angle), np.sin(angle)
    cross = np.array(((0.0, -up[2], up[1]), (up[2], 0.0, -up[0]), (-up[1], up[0], 0.0)))
    rotation = c * np.eye(3) + s * cross + (1.0 - c) * np.outer(up, up)
    rotated = replace(
        mirror, point=moved + rotation @ (mirror.point - middle), normal=rotation @ mirror.normal,
        basis=rotation @ mirror.basis,
        outline=None,
    )  # fmt: skip
    edge = "left" if np.cross(up, -right) @ now * angle > 0 else "right"
    how = Notice(
        "turn it by {angle:.0f}° about the vertical, its {edge} edge forward", angle=np.degrees(abs(angle)), edge=edge
    )
    return rotated, how


@dataclass(frozen=True)
class _Case:
    """One mirror's reflection to be checked.

    ``view``: the mirror's, 1..N; ``if_moved``: what the mirror would show if it were moved or rotated; ``search``:
    where it ought to stand is searched for.
    """

    mirror: Mirror
    view: int
    found: Reflection
    if_moved: Callable[[Mirror], Reflection]
    search: bool = True


def _about_mirror(
    case: _Case, views: Views, model: NoiseModel | None, intrinsics: Intrinsics, steps: bool
) -> list[Finding]:
    """What is wrong with one mirror's reflection. ``steps``: the subject was already asked to stand elsewhere."""
    found = case.found
    glass, image = _too_far(found.over_glass), _too_far(found.over_image)
    if found.seen - found.hidden < _NOT_SHOWN and found.hidden < 1.0 - found.seen:
        return _about_not_shown(case, glass, image, views, intrinsics, steps)
    warned = _about_glass(case, glass, views, intrinsics, steps)
    if found.seen < 1 - MAX_CUT:
        warned += _about_image(case.mirror, image, views)
    warned += _about_range(case, views, model, intrinsics)
    if found.hidden > MAX_HIDDEN:
        warned.append(_about_hidden(case, views, intrinsics))
    if found.blocked > MAX_HIDDEN:
        text = Notice(
            "{share:.0%} of the reflection in {name} is hidden by something in front of it; remove that",
            share=found.blocked,
            name=quoted(case.mirror),
        )
        warned.append(Finding("blocked", text))
    return warned


def _too_far(over: dict[str, float]) -> dict[str, float]:
    """The edges that the subject reaches over by too much, and by how much [m]."""
    return {side: value for side, value in over.items() if value > MAX_OVER}


def _about_not_shown(
    case: _Case, glass: dict[str, float], image: dict[str, float], views: Views, intrinsics: Intrinsics, steps: bool
) -> list[Finding]:
    """A mirror that does not show the subject at all, because of its ``glass`` or of the ``image``."""
    name = quoted(case.mirror)
    if not glass:
        text = Notice(
            "{name} does not show the subject: its reflection lies {side} of the image; move the camera back, or "
            "the mirror inwards, until the camera sees the subject's back in it",
            name=name,
            side=_sides(image),
        )
        return [Finding("not_shown", text)]
    if steps:
        return []
    rotated, how = _rotated(case.mirror, views, intrinsics)
    text = Notice(
        "{name} does not show the subject: its reflection lies {side} of the glass; {how}, until the camera sees "
        "the subject's back in it",
        name=name,
        side=_sides(glass),
        how=how,
    )
    return [Finding("not_shown", text, move=_turn(case.mirror, rotated))]


def _turn(mirror: Mirror, rotated: Mirror) -> Move:
    """How the edge that comes forward goes when a mirror is turned about the vertical."""
    turn = float(np.degrees(np.arccos(np.clip(mirror.normal @ rotated.normal, -1.0, 1.0))))
    half = np.ptp(mirror.rectangle[0]) / 2 if mirror.rectangle is not None else 0.4
    edges = [half * sign * mirror.basis[:, 0] for sign in (-1.0, 1.0)]
    moved = [half * sign * rotated.basis[:, 0] for sign in (-1.0, 1.0)]
    forward = int(np.argmax([(b - a) @ mirror.normal for a, b in zip(edges, moved, strict=True)]))
    return Move("mirror", mirror.point + edges[forward], moved[forward] - edges[forward], turn)


def _about_glass(
    case: _Case, glass: dict[str, float], views: Views, intrinsics: Intrinsics, steps: bool
) -> list[Finding]:
    """Edges of the glass that cut the reflection off: the mirror is too small, or in the wrong place."""
    warned: list[Finding] = []
    name, over = quoted(case.mirror), case.found.over_glass
    if case.found.hidden > _MUCH_HIDDEN:  # where a glass ends behind the body is uncertain
        glass = {side: value for side, value in glass.items() if side in ("top", "bottom") or value > _CLEARLY_OVER}
    elif not glass and case.found.out > MAX_CUT:
        worst = max(over, key=over.__getitem__)
        glass = {worst: max(over[worst], 0.01)}
    for one, other, what in (("top", "bottom", "shorter"), ("left", "right", "narrower")):
        lacking = over[one] + over[other] + 2.0 * _ROOM
        if (one in glass or other in glass) and lacking > 0.01:
            text = Notice(
                "{name} is too small: it is {lacking:.0f} cm {what} than the reflection of the subject; use a "
                "larger mirror, or move it closer to the subject",
                name=name,
                lacking=100 * lacking,
                what=what,
            )
            warned.append(Finding("mirror_small", text, move=_closer(case.mirror, views, lacking)))
            glass = {side: value for side, value in glass.items() if side not in (one, other)}
    return warned + [
        _about_edge(case, side, value, views, intrinsics)
        for side, value in glass.items()
        if not (steps and side in ("left", "right"))
    ]


def _closer(mirror: Mirror, views: Views, by: float) -> Move:
    """A mirror, or what it shows, moved level towards the subject by some metres."""
    way = views.axis - mirror.point
    way -= (way @ views.up) * views.up
    return Move("mirror", mirror.point, by * way / np.linalg.norm(way))


def _about_edge(case: _Case, side: str, value: float, views: Views, intrinsics: Intrinsics) -> Finding:
    """One edge of the glass, that the subject reaches over by ``value`` [m]: how to move or turn the mirror."""
    what, do = {
        "top": ("its upper edge", "raise it"), "bottom": ("its lower edge", "lower it"),
        "left": ("its left edge", "move it to the left"), "right": ("its right edge", "move it to the right"),
    }[side]  # fmt: skip
    cut = Notice(
        "the subject is partly out of {mirror}: {what} cuts the reflection off", mirror=quoted(case.mirror), what=what
    )
    by = Notice("{do} by {distance:.0f} cm (as seen by the camera)", do=do, distance=100 * (value + _ROOM))
    # seen by the camera the first axis of a mirror points left, the second one down
    axis, sign = {"top": (1, -1.0), "bottom": (1, 1.0), "left": (0, 1.0), "right": (0, -1.0)}[side]
    moves = Move("mirror", case.mirror.point, sign * (value + _ROOM) * case.mirror.basis[:, axis])
    alone = Finding("glass_edge", Notice("{cut}; {by}", cut=cut, by=by), move=moves)
    if side not in ("left", "right"):
        return alone
    rotated, how = _rotated(case.mirror, views, intrinsics)
    there = case.if_moved(rotated).over_glass
    if max(there["left"], there["right"]) >= MAX_OVER:
        return alone
    if value > _LONG_MOVE:
        return Finding("glass_edge", Notice("{cut}; {how}", cut=cut, how=how), move=_turn(case.mirror, rotated))
    return replace(alone, text=Notice("{cut}; {by}, or {how}", cut=cut, by=by, how=how))


def _about_image(mirror: Mirror, image: dict[str, float], views: Views) -> list[Finding]:
    """Borders of the image that cut the reflection off."""
    warned: list[Finding] = []
    eye = reflection_matrix(mirror)[:3, 3]
    length = float(np.linalg.norm(views.axis - eye))  # of the way by the mirror
    for side, value in image.items():
        what, do = {
            "top": ("upper", "tilt the camera up"), "bottom": ("lower", "tilt the camera down"),
            "left": ("left", "turn the mirror or the camera to the left"),
            "right": ("right", "turn the mirror or the camera to the right"),
        }[side]  # fmt: skip
        text = Notice(
            "the reflection in {name} is cut off by the image's {what} border, {over:.0f} cm of the subject; {do}, "
            "or move the camera back",
            name=quoted(mirror),
            what=what,
            over=100 * value,
            do=do,
        )
        right = np.cross(views.up, (0.0, 0.0, -1.0))
        way = {"top": views.up, "bottom": -views.up, "left": -right, "right": right}[side]
        angle = float(np.degrees(np.arctan2(value + _ROOM, length)))
        warned.append(Finding("image_edge", text, move=Move("camera", mirror.point, (value + _ROOM) * way, angle)))
    return warned


def _about_range(case: _Case, views: Views, model: NoiseModel | None, intrinsics: Intrinsics) -> list[Finding]:
    """A path via the mirror that is too long for the camera, or from which it has no readings."""
    name, found = quoted(case.mirror), case.found
    if model is not None and found.distance > model.max_range:
        unread = found.unread > (MAX_UNREAD_PATTERN if model.disparity_step else MAX_UNREAD)
        if unread or found.distance > MAX_FAR * model.max_range or not (views.labels == case.view).any():
            closer = found.distance - model.max_range
            text = Notice(
                "the path via {name} is {distance:.1f} m, but {camera} measures well only up to {range:.1f} m: "
                "{unread:.0%} of the reflection has no reading, and the rest has {noise:.0f} mm of noise; move the "
                "mirror and the camera closer to the subject, by {closer:.1f} m in total",
                name=name,
                distance=found.distance,
                camera=model.title,
                range=model.max_range,
                unread=found.unread,
                noise=1000.0 * model.sigma(found.distance, intrinsics.fx),
                closer=closer,
            )
            return [Finding("far", text, move=_closer(case.mirror, views, closer))]
    if found.unread > MAX_UNREAD_PATTERN:
        text = Notice(
            "{unread:.0%} of the reflection in {name} has no reading, on a path of {distance:.1f} m; move the "
            "mirror and the camera closer to the subject, clean the glass, and keep sunlight out",
            unread=found.unread,
            name=name,
            distance=found.distance,
        )
        return [Finding("unread", text)]
    return []


def _about_hidden(case: _Case, views: Views, intrinsics: Intrinsics) -> Finding:
    """By how much to move a mirror until the subject does not hide its own reflection, or what else to do."""
    name, found = quoted(case.mirror), case.found
    do, move = Notice("move {name} outwards and turn it so that the subject stays in its middle", name=name), None
    for outwards in _OUTWARDS if case.search else ():
        moved, how = _rotated(case.mirror, views, intrinsics, outwards)
        there = case.if_moved(moved)
        if there.hidden < _CURED * MAX_HIDDEN and max(there.over_image.values()) < MAX_OVER:
            do = Notice(
                "move {name} outwards by {distance:.0f} cm and {how}", name=name, distance=100 * outwards, how=how
            )
            shift = visible_middle(moved, intrinsics) if moved.outline is not None else moved.point
            start = case.mirror.point if case.mirror.outline is None else visible_middle(case.mirror, intrinsics)
            turn = float(np.degrees(np.arccos(np.clip(moved.normal @ case.mirror.normal, -1.0, 1.0))))
            move = Move("mirror", start, shift - start, turn)
            break
    if found.arms > _BY_ARMS:
        text = Notice(
            "{hidden:.0%} of the reflection in {name} is hidden by the subject's own arms; hold the arms closer to the "
            "body, or {do}",
            hidden=found.hidden,
            name=name,
            do=do,
        )
        return Finding("arms_hide", text, move=move)
    text = Notice(
        "{hidden:.0%} of the reflection in {name} is hidden by the subject's own body; {do}",
        hidden=found.hidden,
        name=name,
        do=do,
    )
    return Finding("body_hides", text, move=move)


def _sides(over: dict[str, float]) -> str:
    names = {"left": "to the left", "right": "to the right", "top": "above", "bottom": "below"}
    worst = max(over, key=over.__getitem__, default=None)
    return "outside" if worst is None else names[worst]


def _about_rig(views: Views, mirrors: list[Mirror], alone: bool) -> list[Finding]:
    """How the mirrors stand, to the vertical and around the subject."""
    return _about_vertical(views, mirrors) + _about_directions(views, mirrors, alone)


def _about_vertical(views: Views, mirrors: list[Mirror]) -> list[Finding]:
    """Mirrors that lean, or a vertical that nothing in the scene gives."""
    if views.floor is None:
        if views.disagreement_deg is not None or len(mirrors) >= 2:
            return []
        text = (
            "no floor is seen, so the camera is taken to be level; let it see the floor around the feet, or level the "
            "camera"
        )
        return [Finding("no_floor", text)]
    warned: list[Finding] = []
    for mirror, lean in zip(mirrors, leans(mirrors, views.up), strict=True):
        if abs(lean) > MAX_LEAN_DEG:
            way = "towards" if lean > 0 else "away from"
            notice = Notice(
                "{mirror} is not vertical: its top leans {lean:.0f}° {way} the subject; set it upright, or the "
                "head or the feet may be missing from the reflection",
                mirror=quoted(mirror),
                lean=abs(lean),
                way=way,
            )
            warned.append(Finding("leaning", notice, mirror.name))
    return warned


def _about_directions(views: Views, mirrors: list[Mirror], alone: bool) -> list[Finding]:
    """Views from nearly the same side, and sides that no view shows."""
    warned: list[Finding] = []
    angles = directions(views, mirrors)
    order = np.argsort(angles)
    names = ["the camera", *map(quoted, mirrors)]
    for i, j in zip(order, np.roll(order, -1), strict=True):
        angle = (angles[j] - angles[i]) % 360.0
        if len(angles) > 1 and angle < MIN_ANGLE_DEG:
            text = Notice(
                "{one} and {other} show the subject from nearly the same side, {angle:.0f}° from each other; "
                "turn the mirrors so that the views are about 120° from each other",
                one=names[i],
                other=names[j],
                angle=angle,
            )
            warned.append(Finding("same_side", text))
        elif angle > MAX_GAP_DEG and mirrors and alone:
            text = Notice(
                "one side of the subject is not seen: there is no view in the {angle:.0f}° from {one} to {other}, "
                "and that side is guessed; add a mirror there",
                one=names[i],
                other=names[j],
                angle=angle,
            )
            warned.append(Finding("side_unseen", text))
    return warned


def directions(views: Views, mirrors: list[Mirror]) -> np.ndarray:
    """Directions about the vertical the subject is seen from, one a view [degrees]; 0 = the camera's."""
    eyes = np.stack([np.zeros(3), *(reflection_matrix(mirror)[:3, 3] for mirror in mirrors)])
    away = eyes - views.axis
    away -= np.outer(dot(away, views.up), views.up)
    side = np.cross(views.up, away[0])
    return np.degrees(np.arctan2(dot(away, side) / np.linalg.norm(side), dot(away, away[0] / np.linalg.norm(away[0]))))
