"""What is wrong with a scene, in words a user understands, and what to move: :func:`check_scene`.

All is geometry: the subject's directly seen points are laid into each mirror, and it is looked at where they would be
seen: on the glass or past it, in the image or out of it, behind something, farther than the camera reads.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .agreement import disagreements
from .camera import Intrinsics, project
from .ground import leans
from .linear import dot, transform
from .mirror import Mirror, reflection_matrix
from .sensors import NoiseModel
from .views import Views, glass_corners

MAX_LEAN_DEG = 4.0
"""Mirrors that lean more than this are told."""

MAX_CUT = 0.05
"""Of the subject that the image may cut off in a mirror before it is told [share]."""

MAX_OVER = 0.04
"""What the subject's reflection may reach over an edge of the glass, or of the image, before it is told [m]."""

MAX_HIDDEN = 0.25
"""Of a reflection that may be hidden by the subject's own body before it is told [share]."""

MAX_FAR = 1.25
"""Of the distance to which the camera reads well, that a reflection may be away before it is told [share]."""

MAX_UNREAD, MAX_UNREAD_PATTERN = 0.5, 0.75
"""Of a reflection, beyond the camera's range, that may have no reading before it is told [share]; where two patterns
light a surface a structured-light camera loses half of it at any distance."""

MAX_UNSURE = 0.012
"""A mirror whose plane may misplace the subject by more than this is told [m]."""

MIN_APART_DEG = 25.0
"""Views from directions less apart than this show the same side."""

MAX_GAP_DEG = 200.0
"""A wider gap between the directions the subject is seen from leaves a side unseen."""

_SPARE_DEG = 2.5  # between the image's border and the subject: toes point forward, hair stands up
_BORDER_PIXELS = 6  # of the subject at the image's border that mean it is cut


@dataclass(frozen=True)
class Reflection:
    """Where the subject's reflection in a mirror ought to be: shares of its directly seen points.

    ``over_glass``, ``over_image``: how far the subject reaches over the left, right, top and bottom edge of the glass
    [m on the mirror] and of the image [m at the subject], negative = room to spare; ``seen``: share inside both;
    ``hidden``: share of those behind the subject's own body; ``unread``: share without a reading; ``distance``: median
    z along the folded path [m].
    """

    over_glass: dict[str, float]
    over_image: dict[str, float]
    seen: float
    hidden: float
    unread: float
    distance: float


def check_scene(
    depth: np.ndarray,
    views: Views,
    mirrors: list[Mirror],
    intrinsics: Intrinsics,
    model: NoiseModel | None = None,
    alone: bool = True,
) -> list[str]:
    """Warnings about a scene from which a result is possible, the worst for the result first.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    views : Views
        Of :func:`.subject.find_subject`.
    mirrors : list of Mirror
    intrinsics : Intrinsics
    model : NoiseModel or None
        Of the camera, where it is known: how far it reads.
    alone : bool
        No other camera looks at the subject: what this one does not see nobody sees.

    Returns
    -------
    list of str
        Each says what is wrong, where, and what to do. Empty for a good scene.
    """
    told = _cut_by_image(views, intrinsics)
    mine = np.flatnonzero(views.labels == 0)
    subject = views.points.reshape(-1, 3)[mine[:: len(mine) // 4000 + 1]]
    if len(subject):
        for k, mirror in enumerate(mirrors, start=1):
            found = foresee(subject, depth, views, mirror, k, intrinsics)
            told += _about(mirror, found, (views.labels == k).any(), model, intrinsics.fx)
            error = mirror.displacement(subject[::16])
            if error is not None and error > MAX_UNSURE:
                told.append(
                    f"the plane of {quoted(mirror)} is known so badly that its view of the subject may be "
                    f"{1000.0 * error:.0f} mm off; take a longer burst, pick points on all sides of its frame, or use "
                    "a wider frame"
                )
    told += _about_rig(views, mirrors, alone)
    return told


def check_agreement(
    depth: np.ndarray, views: Views, mirrors: list[Mirror], intrinsics: Intrinsics
) -> tuple[Views, list[str]]:
    """Mirrors that contradict the other views are told, and left out where they would double the body.

    Returns
    -------
    views : Views
        Without the pixels of mirrors that are left out.
    told : list of str
    """
    told, labels = [], views.labels
    for apart in disagreements(depth, views, mirrors, intrinsics):
        name = quoted(mirrors[apart.mirror])
        other = "the camera" if apart.other == 0 else quoted(mirrors[apart.other - 1])
        how = f"{100.0 * apart.distance:.0f} cm off what {other} shows" if apart.distance else (
            f"where {other} looks through, {apart.through:.0%} of it")  # fmt: skip
        who = "its plane is wrong: pick points on all sides of its frame again"
        if not apart.sure:
            who = "the plane of one of the two is wrong: pick points on all sides of both frames again"
        if apart.hopeless:
            labels = np.where(labels == apart.mirror + 1, -1, labels).astype(labels.dtype)
            what = f"{name} is left out, or the body would be doubled: it places the subject {how}"
        else:
            what = f"{name} places the subject {how}, so that its surface is uneven there"
        told.append(
            f"{what}; {who} (on nothing else), see that the mirror is flat and has not moved, or take a longer burst"
        )
    return replace(views, labels=labels), told


def quoted(mirror: Mirror) -> str:
    return f"the mirror “{mirror.name}”"


def _cut_by_image(views: Views, intrinsics: Intrinsics) -> list[str]:
    """The subject, seen directly, at the image's border."""
    mine = views.labels == 0
    height, width = mine.shape
    # the last pixels of an image often have no reading
    edge, aside = 3, "step to the middle of the image or farther back"
    cut = {
        "upper": mine[:edge].any(axis=0).sum(), "lower": mine[height - edge :].any(axis=0).sum(),
        "left": mine[:, :edge].any(axis=1).sum(), "right": mine[:, width - edge :].any(axis=1).sum(),
    }  # fmt: skip
    advice = {
        "upper": ("the head is", f"tilt the camera up{_by_tilt(views, intrinsics, True)} or step back"),
        "lower": ("the feet are", f"tilt the camera down{_by_tilt(views, intrinsics, False)} or step back"),
        "left": ("a side is", aside),
        "right": ("a side is", aside),
    }  # fmt: skip
    if min(cut["upper"], cut["lower"]) >= _BORDER_PIXELS:
        advice["upper"], advice["lower"] = (("the head is", "step back"), ("the feet are", "step back"))
    return [
        f"the subject is cut off by the image's {side} border: {what} missing there and closed by guess; {do}"
        for side, (what, do) in advice.items()
        if cut[side] >= _BORDER_PIXELS
    ]


def _by_tilt(views: Views, intrinsics: Intrinsics, upwards: bool) -> str:
    """By how much to tilt the camera: mirrors show how tall the subject is, and the floor where its feet are."""
    reflected = dot(views.points[views.labels > 0], views.up)
    if upwards:
        end = np.quantile(reflected, 0.999) if len(reflected) else -np.inf
    else:
        end = views.floor if views.floor is not None else np.quantile(reflected, 0.001) if len(reflected) else np.inf
    if not np.isfinite(end):
        return ""
    x, y, z = views.axis + (end - views.axis @ views.up) * views.up
    border = 0 if upwards else intrinsics.height - 1
    beyond = np.degrees(np.arctan2(y, z) - np.arctan2(border - intrinsics.cy, intrinsics.fy))
    beyond = max(int(np.ceil(_SPARE_DEG + (-beyond if upwards else beyond))), 2)
    return f" by {beyond}°" if beyond < 45 else ""


def foresee(
    subject: np.ndarray, depth: np.ndarray, views: Views, mirror: Mirror, view: int, intrinsics: Intrinsics
) -> Reflection:
    """Where the mirror ought to show the subject, by its directly seen points (N, 3)."""
    k = intrinsics
    laid = transform(subject, reflection_matrix(mirror))
    ahead = laid[:, 2] > 0.1
    z = np.where(ahead, laid[:, 2], 1.0)
    u, v = laid[:, 0] / z * k.fx + k.cx, laid[:, 1] / z * k.fy + k.cy
    share = (mirror.normal @ mirror.point) / dot(laid, mirror.normal)
    on = laid * share[:, None] - mirror.point  # where the line of sight meets the mirror's plane
    a, b = dot(on, mirror.basis[:, 0]), dot(on, mirror.basis[:, 1])
    within = (u >= 0) & (v >= 0) & (u <= k.width - 1) & (v <= k.height - 1)
    row, column = (np.rint(np.where(within, x, 0.0)).astype(int) for x in (v, u))
    masked = within & ahead & (views.labels[row, column] == 0)
    corners = glass_corners(mirror)
    over_glass = dict.fromkeys(("left", "right", "top", "bottom"), -np.inf)
    through = ahead & (share > 0) & (share < 1)
    if corners is not None:
        (a0, b0), (a1, b1) = corners.min(axis=0), corners.max(axis=0)
        # seen by the camera a points left, b down
        over_glass = {"left": a - a1, "right": a0 - a, "top": b0 - b, "bottom": b - b1}
        # where the edge is behind the subject itself, how far the glass goes on is not known
        edge = project(
            mirror.point + np.column_stack((np.clip(a, a0, a1), np.clip(b, b0, b1))) @ mirror.basis[:, :2].T, k
        )  # fmt: skip
        edge = np.rint(np.clip(np.nan_to_num(edge), 0, (k.width - 1, k.height - 1))).astype(int)
        masked &= views.labels[edge[:, 1], edge[:, 0]] == 0
        through &= masked | ((a > a0) & (a < a1) & (b > b0) & (b < b1))
        over_glass = _beyond({
            side: np.where(masked, np.minimum(value, 0.0), np.where(ahead, value, np.inf))
            for side, value in over_glass.items()
        })  # fmt: skip
    per_pixel = z / k.fx
    over_image = _beyond({
        "left": -u * per_pixel, "right": (u - k.width + 1) * per_pixel,
        "top": -v * per_pixel, "bottom": (v - k.height + 1) * per_pixel,
    })  # fmt: skip
    inside = through & within
    row, column = row[inside], column[inside]
    label, reading = views.labels[row, column], depth[row, column]
    hidden = (label == 0) | ((reading > 0) & (views.seen[row, column] == 0))
    unread = reading == 0
    count = max(int(inside.sum()), 1)
    return Reflection(
        over_glass, over_image, float(inside.mean()), float(hidden.sum() / count), float(unread.sum() / count),
        float(np.median(z)),
    )  # fmt: skip


def _beyond(distance: dict[str, np.ndarray]) -> dict[str, float]:
    """How far the subject reaches beyond each edge, but for its outermost hundredth [m]; negative = room to spare."""
    reach = np.quantile(np.stack(list(distance.values())), 0.99, axis=1)
    return dict(zip(distance, reach.tolist(), strict=True))


def _about(mirror: Mirror, found: Reflection, shown: bool, model: NoiseModel | None, focal: float) -> list[str]:
    """What is wrong with one mirror's reflection."""
    name, told = quoted(mirror), []
    glass = {side: value for side, value in found.over_glass.items() if value > MAX_OVER}
    image = {side: value for side, value in found.over_image.items() if value > MAX_OVER}
    if found.seen < 0.05:
        told.append(
            f"{name} does not show the subject: its reflection lies {_sides(glass or image)} of the "
            f"{'glass' if glass else 'image'}; turn {name} towards the line between camera and subject until the "
            "camera sees the subject's back in it"
        )
        return told
    if found.hidden > MAX_HIDDEN:  # where a glass ends behind the body is hardly known
        glass = {side: value for side, value in glass.items() if side in ("top", "bottom") or value > 0.1}
    if glass:
        for one, other, what in (("top", "bottom", "high"), ("left", "right", "wide")):
            lacking = found.over_glass[one] + found.over_glass[other]
            if (one in glass or other in glass) and lacking > 0:
                told.append(
                    f"{name} is too small: it is {100 * lacking:.0f} cm less {what} than the "
                    "reflection of the subject; use a larger mirror, or move it nearer to the subject"
                )
                glass = {side: value for side, value in glass.items() if side not in (one, other)}
        for side, value in glass.items():
            what, do = {
                "top": ("its upper edge", "raise it"), "bottom": ("its lower edge", "lower it"),
                "left": ("its left edge", "move it to the left"), "right": ("its right edge", "move it to the right"),
            }[side]  # fmt: skip
            told.append(
                f"the subject is partly out of {name}: {what} cuts the reflection off; {do} by {100 * value:.0f} cm "
                "(as seen by the camera), or turn it, or step aside"
            )
    if found.seen < 1 - MAX_CUT:
        for side, value in image.items():
            what, do = {
                "top": ("upper", "tilt the camera up"), "bottom": ("lower", "tilt the camera down"),
                "left": ("left", "turn the mirror or the camera to the left"),
                "right": ("right", "turn the mirror or the camera to the right"),
            }[side]  # fmt: skip
            told.append(
                f"the reflection in {name} is cut off by the image's {what} border, {100 * value:.0f} cm of the "
                f"subject; {do}, or move the camera back"
            )
    if model is not None and found.distance > model.max_range and (
        found.distance > MAX_FAR * model.max_range
        or found.unread > (MAX_UNREAD_PATTERN if model.disparity_step else MAX_UNREAD)
        or not shown
    ):
        told.append(
            f"the way over {name} is {found.distance:.1f} m, and {model.title} reads well to {model.max_range:.1f} m: "
            f"{found.unread:.0%} of the reflection has no reading, and the rest scatters by "
            f"{1000.0 * model.sigma(found.distance, focal):.0f} mm; bring the mirror and the camera nearer to the "
            f"subject, by {found.distance - model.max_range:.1f} m in all"
        )
    elif found.hidden > MAX_HIDDEN:
        told.append(
            f"{found.hidden:.0%} of the reflection in {name} is hidden by what stands before it, most likely the "
            f"subject's own body or arms; move {name} outwards, or hold the arms closer to the body"
        )
    return told


def _sides(over: dict[str, float]) -> str:
    names = {"left": "to the left", "right": "to the right", "top": "above", "bottom": "below"}
    worst = max(over, key=over.get, default=None)
    return "outside" if worst is None else names[worst]


def _about_rig(views: Views, mirrors: list[Mirror], alone: bool) -> list[str]:
    told = []
    if views.floor is not None:
        for mirror, lean in zip(mirrors, leans(mirrors, views.up), strict=True):
            if abs(lean) > MAX_LEAN_DEG:
                way = "towards" if lean > 0 else "away from"
                told.append(
                    f"{quoted(mirror)} is not vertical: its top leans {abs(lean):.0f}° {way} the subject; set "
                    "it upright, or the reflection loses head or feet"
                )
    elif views.disagreement_deg is None and len(mirrors) < 2:
        told.append(
            "no floor is seen, so that the vertical is taken from the camera; let the camera see the floor about the "
            "feet, or level the camera"
        )
    angles = directions(views, mirrors)
    order = np.argsort(angles)
    names = ["the camera", *map(quoted, mirrors)]
    for i, j in zip(order, np.roll(order, -1), strict=True):
        apart = (angles[j] - angles[i]) % 360.0
        if len(angles) > 1 and apart < MIN_APART_DEG:
            told.append(
                f"{names[i]} and {names[j]} show the subject from nearly the same side, {apart:.0f}° apart; turn the "
                "mirrors so that the views are about 120° apart"
            )
        elif apart > MAX_GAP_DEG and mirrors and alone:
            told.append(
                f"nothing is seen of one side of the subject: from {names[i]} to {names[j]} there are {apart:.0f}° "
                "without a view, and that side is guessed; add a mirror there"
            )
    return told


def directions(views: Views, mirrors: list[Mirror]) -> np.ndarray:
    """Directions about the vertical the subject is seen from, one a view [degrees]; 0 = the camera's."""
    eyes = np.stack([np.zeros(3), *(reflection_matrix(mirror)[:3, 3] for mirror in mirrors)])
    away = eyes - views.axis
    away -= np.outer(dot(away, views.up), views.up)
    side = np.cross(views.up, away[0])
    return np.degrees(np.arctan2(dot(away, side) / np.linalg.norm(side), dot(away, away[0] / np.linalg.norm(away[0]))))
