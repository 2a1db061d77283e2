"""Mirrors of which only one upright side of the frame is in the picture.

The bar of the frame gives a line that lies in the plane, to a millimetre, and hardly how the plane is turned about it.
That the image tells: somebody seen directly and, farther off, in what is taken for the glass. The plane is turned about
the bar until what it shows makes sense; then the skin that both views show must coincide, and what either shows must
touch the other's outline (:mod:`..views.silhouette_contact`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..camera import Intrinsics, RgbdImage
from ..mirrors import Mirror
from ..mirrors.frame_fit import fit_frame
from ..mirrors.glass_extent import at_border, with_outline
from ..mirrors.mirror import behind_glass, expected_error, moved, oriented, reflection_matrix, reflection_moves
from ..views.silhouette_contact import (
    Outline,
    contact,
    contact_cost,
    contact_slope,
    edge_on,
    outline_of,
)
from ..views.view_correspondences import Surfaces, find_correspondences, noise_of, surfaces
from .edge_segments import LEFT, RIGHT, DetectionSettings, Segment
from .frameless_mirrors import overlaps
from .mirror_verification import count_evidence, floor_drop, missing_reflection
from .person_images import LEAST_MET, Room, fate_on_person, rooms_about_persons, span, views_of_person
from .rectangle_hypotheses import Hypothesis

_UP = np.array((0.0, -1.0, 0.0))
_LEAST_SIDE, _UPRIGHT = 0.6, 0.97  # a bar is seen over so much [m]; cosine of its angle with the vertical
_MOST_BARS = 8  # that are tried
_TURNS = np.radians(np.arange(-60.0, 60.5, 2.0))  # of a plane about its bar, that are tried first
_ASKED, _FEWEST = 500, 50  # readings in a glass that are flipped by each, later three times as many; and at least
_LEAST_SCORE = 0.04  # of those asked
_WRONG = 6.0  # a violation counts so many times as a reading that is met
_MOST_WRONG = 0.15, 0.05  # share of the image where the camera looks through: before the plane is turned, and then
_BAR_ERROR, _CONTRADICTED = 2.0, 3.0  # standard deviations by which a bar alone may be wrong, and from which it is
_SURE_BAR, _ROUGH = 0.006, 0.06  # a bar's error that is small, and what the first turn may be off [rad]
_PIECES = 8000  # of the surface of a person, and of the image
_FINE = np.linspace(-0.05, 0.05, 41)  # turns about the last one, by outlines [rad]
_LEAST_ROWS, _LEAST_TOUCHING = 12, 0.35  # rows of an outline that say something; share of them that touch it
_LEAST_PAIRS = 16  # of skin seen twice
_ALIKE = 5.0  # neighbouring rows, or pieces, that count as one
_BLUR, _SHADOWED = 0.3, 0.7  # px by which an outline may be off, and one beside a shadow
_SKIN_ERROR = 0.0003  # of the turn by skin, that shows in no residual [rad]
_MOST_ERROR = 0.03  # a mirror expected to misplace a person by more is dropped [m]
_FARTHEST, _WIDEST = 6.0, 1.2  # of glass at the image's border [m]: how far off, and from the bar
_FEET = 0.3  # so near to the floor a glass whose end is not seen goes down to it [m]


def with_one_sided(
    image: RgbdImage, segments: list[Segment], found: list[Mirror], most: int, settings: DetectionSettings
) -> list[Mirror]:
    """The mirrors ``found``, and those that one upright side of a frame and the person they show reveal.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, flying pixels removed; z [m], 0 = no reading.
    segments : list of Segment
        Its straight depth edges.
    found : list of Mirror
        Those that do not show the person are left out where a new one is in their place: they are images in it, or
        made of its bar and of images in it.
    most : int
        At most so many new ones, and known ones that show the person.

    Returns
    -------
    list of Mirror
        The new ones with ``source`` "found", ``refined``; the covariance says how certain the plane is.

    Notes
    -----
    O(H W); nothing but the segments is looked at where there is no upright bar or no person.
    """
    image = image.without_color()
    if not _bars(segments, []):
        return found
    for room in rooms_about_persons(image):
        if behind_glass(room.figure.middle[None], found)[0]:
            continue  # the person's image
        sure = [m for m in found if _shows_person(m, room)]
        if len(sure) >= most:
            break
        new: list[Mirror] = []
        tried = 0
        for bar in _bars(segments, sure):
            if len(sure) + len(new) >= most or tried == _MOST_BARS:
                break
            beside = _beside(bar, image.intrinsics)
            if _is_at(bar, new) or beside[room.person].mean() > 0.2:  # who is seen directly does not stand in the glass
                continue
            tried += 1
            mirror = _mirror_at(bar, beside, room, settings)
            if mirror is not None:
                new.append(mirror)
        if new:
            return [m for m in found if any(m is one for one in sure) or not overlaps(m, new)] + new
    return found


def _shows_person(mirror: Mirror, room: Room) -> bool:
    """Whether readings in its glass, flipped, are on the person."""
    if mirror.rectangle is None:
        return True
    depth, k = room.image.depth, room.image.intrinsics
    rows, columns = np.nonzero(depth[::3, ::3])
    z = depth[3 * rows, 3 * columns].astype(np.float64)
    points = np.column_stack(((3 * columns - k.cx) / k.fx * z, (3 * rows - k.cy) / k.fy * z, z))
    on, through = fate_on_person(points[behind_glass(points, [mirror])], mirror, room)
    return bool(on.sum() > max(LEAST_MET / 9, through.sum()))


def _is_at(bar: Segment, mirrors: list[Mirror]) -> bool:
    """Whether the bar is one of the mirrors' frames, or behind their glass."""
    return bool(behind_glass(bar.points.mean(axis=0)[None], mirrors, 0.1, 1.1)[0])


def may_be_images(found: list[Mirror]) -> bool:
    """Whether one of the mirrors shows nothing of the place before the camera: it may be an image in another one."""
    x, z = (part.ravel() for part in np.meshgrid(np.linspace(-0.6, 0.6, 5), np.linspace(1.0, 3.5, 6)))
    places = np.column_stack((x, np.zeros(len(x)), z))
    for m in found:
        ahead = (places - m.point) @ m.normal
        images = places - 2.0 * ahead[:, None] * m.normal
        if not (behind_glass(images, [m]) & (ahead > 0.0)).any():
            return True
    return False


def _bars(segments: list[Segment], known: list[Mirror]) -> list[Segment]:
    """Upright edges that may be a frame's, off known mirrors; the longest first."""
    out = [
        s for s in segments
        if s.side in (LEFT, RIGHT) and s.length > _LEAST_SIDE and -(s.direction @ _UP) > _UPRIGHT - 0.05
        and not _is_at(s, known)
    ]  # fmt: skip
    return sorted(out, key=lambda s: -s.length)


def _mirror_at(bar: Segment, glass: np.ndarray, room: Room, settings: DetectionSettings) -> Mirror | None:
    """The mirror beside a bar; None when what is seen there is no image of the person."""
    image, intrinsics = room.image, room.image.intrinsics
    start = _turned_to_image(bar, glass, room)
    if start is None:
        return None
    fitted = fit_frame(image, start, seeds=_along(bar))
    if fitted is None:
        return None
    # the bar alone hardly says how the plane is turned, and the image tells; with a part of the upper bar it does
    assert fitted.covariance is not None
    turn, own = _turn_between(fitted, start), _BAR_ERROR * float(np.sqrt(fitted.covariance[0, 0]))
    mirror = fitted if own < _SURE_BAR and abs(turn) > _CONTRADICTED * own + _ROUGH else _turned(fitted, turn)
    for wrong in _MOST_WRONG:
        before = replace(mirror, covariance=fitted.covariance)
        seen = views_of_person(before, glass, room, wrong)
        if seen is None:
            return None
        after = _turned_by_views(before, _turn_between(before, fitted), seen, room)
        if after is None:
            return None
        mirror = after
    mirror = _with_glass(mirror, bar, room)
    if not _makes_sense(mirror, room, settings):
        return None
    return at_border(mirror, intrinsics, np.array(((bar.side == LEFT, bar.side == RIGHT), (True, True))))


def _beside(bar: Segment, intrinsics: Intrinsics) -> np.ndarray:
    """Pixels (H, W) on the bar's far side, where its glass may be."""
    (u0, v0), (u1, v1) = bar.ends
    rows = np.arange(intrinsics.height)[:, None]
    edge = u0 + (u1 - u0) * (rows - v0) / max(v1 - v0, 1.0)
    columns = np.arange(intrinsics.width)[None, :]
    return columns > edge + 1.0 if bar.side == LEFT else columns < edge - 1.0


def _along(bar: Segment) -> np.ndarray:
    """Pixels (K, 2), every few along the bar."""
    return np.linspace(bar.ends[0], bar.ends[1], max(int(np.abs(bar.ends[1] - bar.ends[0]).max()) // 8, 2))


def _plane(bar: Segment, turn: float) -> Mirror:
    """A mirror beside the bar, facing the camera but for ``turn`` [rad] about the bar."""
    point = bar.points.mean(axis=0)
    down = bar.direction
    facing = -point - (-point @ down) * down
    facing /= np.linalg.norm(facing)
    across = np.cross(down, facing)
    normal, basis = oriented(np.cos(turn) * facing + np.sin(turn) * across, point, down)
    half = 0.5 * bar.length
    side = (-1.0, 0.0) if bar.side == LEFT else (0.0, 1.0)  # a points left
    return Mirror("", point, normal, basis, np.array((side, (-half, half))), source="found")


def _turned_to_image(bar: Segment, glass: np.ndarray, room: Room) -> Mirror | None:
    """The plane through the bar over which most of what the glass shows falls onto the person; None of too little."""
    depth, k = room.image.depth, room.image.intrinsics
    rows, columns = np.nonzero(glass & (depth > 0) & ~room.person)
    z = depth[rows, columns].astype(np.float64)
    points = np.column_stack(((columns - k.cx) / k.fx * z, (rows - k.cy) / k.fy * z, z))
    height = points @ room.up - room.floor
    low, high = span(room)
    # an image is farther off than who is seen, and about as high
    far = (z > float(room.figure.middle[2]) + 0.3) & (height > low - 0.1) & (height < high + 0.35)
    points = points[far]
    if len(points) < _FEWEST:
        return None
    turns = _TURNS
    for many in (_ASKED, 3 * _ASKED):
        some = points[:: max(len(points) // many, 1)]
        scores = [_score(_plane(bar, turn), some, room) for turn in turns]
        best, turn = max(scores), float(turns[int(np.argmax(scores))])
        turns = turn + np.radians(np.arange(-2.5, 2.6, 0.5))
    return _plane(bar, turn) if best > _LEAST_SCORE * len(some) else None


def _score(mirror: Mirror, points: np.ndarray, room: Room) -> float:
    """How many of the points are met by the person rather than looked through."""
    on, through = fate_on_person(points, mirror, room)
    return float(on.sum() - _WRONG * through.sum())


def _turn_between(one: Mirror, other: Mirror) -> float:
    """The slope along a from one plane to the other [rad]."""
    normal = one.basis.T @ other.normal
    return float(-normal[0] / normal[2])


def _turned(mirror: Mirror, turn: float) -> Mirror:
    """The mirror turned by ``turn`` [rad] about the middle of its bar, as the bar's covariance has it."""
    assert mirror.covariance is not None
    return moved(mirror, mirror.covariance[:, 0] / mirror.covariance[0, 0] * turn)


def _turned_by_views(
    fitted: Mirror, back: float, seen: np.ndarray, room: Room, own_error: float = _BAR_ERROR
) -> Mirror | None:
    """The mirror turned about its bar until both views of the person agree, with what is then known of it.

    ``back`` [rad] is the turn to where the frame alone would have the plane, to so many of its standard deviations,
    ``own_error``.
    """
    image, intrinsics = room.image, room.image.intrinsics
    noise = noise_of(image.depth, seen)
    shown = [surfaces(image, seen, view, noise, _PIECES) for view in (0, 1)]
    if min(len(s.points) for s in shown) < _LEAST_ROWS:
        return None
    outlines = [outline_of(image.depth, seen == view, room.shadow) for view in (0, 1)]
    touched = _turn_by_outlines(fitted, shown, outlines, intrinsics)
    start = 0.0 if touched is None else touched[0]
    met = _turn_by_skin(fitted, start, shown, intrinsics)
    witnesses = [witness for witness in (touched, met) if witness is not None]
    if not witnesses:
        return None
    assert fitted.covariance is not None
    prior = fitted.covariance
    weight = sum(1.0 / error**2 for _, error in witnesses)
    seen_turn = sum(turn / error**2 for turn, error in witnesses) / weight
    variance = 1.0 / weight
    if len(witnesses) == 2:  # where they contradict each other neither is as certain as it says
        apart = (witnesses[0][0] - witnesses[1][0]) ** 2
        variance *= max(1.0, apart / (witnesses[0][1] ** 2 + witnesses[1][1] ** 2))
    own = own_error**2 * prior[0, 0]
    contradicted = (seen_turn - back) ** 2 > _CONTRADICTED**2 * (own + variance)
    share = 1.0 if contradicted else own / (own + variance)
    made = _turned(fitted, float(share * seen_turn + (1.0 - share) * back))
    # a plane whose turn is known to ``left``, and the rest as far as the bar's line leaves it open
    left = share * variance
    gain = prior[:, 0] / prior[0, 0]
    return replace(made, covariance=prior + np.outer(gain, gain) * (left - prior[0, 0]), turn_by_frame=float(own))


def _turn_by_outlines(
    mirror: Mirror, shown: list[Surfaces], outlines: list[Outline], intrinsics: Intrinsics
) -> tuple[float, float] | None:
    """By how much outlines ask the mirror to be turned, and the standard deviation of that [rad]; None of too few."""
    pieces = [edge_on(s, reflection_matrix(mirror)) for s in shown]

    def gaps(turn: float) -> list[np.ndarray]:
        flip = reflection_matrix(_turned(mirror, turn))
        return [contact(pieces[of], flip, outlines[by], intrinsics) for of, by in ((1, 0), (0, 1))]

    def cost(turn: float) -> float:
        return sum(map(contact_cost, gaps(turn)))

    coarse = np.array([cost(turn) for turn in _FINE])
    best = float(_FINE[int(np.argmin(coarse))])
    fine = best + np.linspace(-0.003, 0.003, 13)
    costs = np.array([cost(turn) for turn in fine])
    curve, tilt, _ = np.polyfit(fine - best, costs, 2)
    low = float(fine[int(np.argmin(costs))])
    turn = best - tilt / (2.0 * curve) if curve > 0.0 else low
    turn = float(np.clip(turn, low - 0.001, low + 0.001))
    at, after = gaps(turn), gaps(turn + 0.002)
    touching = [float((np.abs(g) < 2.0).sum()) for g in at]
    rows = sum(map(len, at))
    if rows < _LEAST_ROWS or sum(touching) < _LEAST_TOUCHING * max(len(at[0]), 1):
        return None
    spread = 1.0 / np.sqrt(max(2.0 * curve / _ALIKE, 1.0))
    slopes = [contact_slope(a, b, 0.002) for a, b in zip(at, after, strict=True)]
    slope = max((s for s, n in zip(slopes, touching, strict=True) if n >= 10), default=0.0)
    if slope <= 0.0:
        return None
    blur = _SHADOWED if outlines[0].shadow else _BLUR
    return turn, float(np.hypot(spread, blur / slope))


def _turn_by_skin(
    mirror: Mirror, start: float, shown: list[Surfaces], intrinsics: Intrinsics
) -> tuple[float, float] | None:
    """As :func:`_turn_by_outlines`, by the distances of skin that both views show."""
    assert mirror.covariance is not None
    way = mirror.covariance[:, 0] / mirror.covariance[0, 0]
    turn = start
    for iteration in range(8):
        at = _turned(mirror, turn)
        information, right, count = 0.0, 0.0, 0
        for m in find_correspondences([at], shown, intrinsics, 0.08 if iteration < 3 else 0.04):
            here = m.here if m.of == 1 else m.there
            moves = np.einsum("nci,nc,i->n", reflection_moves(at, here), m.normals, way) * (1.0 if m.of == 1 else -1.0)
            weights = 1.0 / (m.variances * (1.0 + m.gaps**2 / (4.0 * m.variances))) / _ALIKE
            information += float((weights * moves) @ moves)
            right += float((weights * moves) @ m.gaps)
            count += len(m.gaps)
        if count < _LEAST_PAIRS or information <= 0.0:
            return None
        turn += right / information
        if abs(right / information) < 5e-5:
            break
    few = 1.0 + 60.0 / count
    return turn, float(np.hypot(1.0 / np.sqrt(information), _SKIN_ERROR * few))


def _with_glass(mirror: Mirror, bar: Segment, room: Room) -> Mirror:
    """The mirror with its glass from the bar to the image's border, and down to the floor where it ends close by."""
    assert mirror.rectangle is not None
    a, b, _ = mirror.basis.T
    rectangle, k = mirror.rectangle.copy(), room.image.intrinsics
    outer, sign = (0, -1.0) if bar.side == LEFT else (1, 1.0)  # a points left
    column = k.width - 0.5 if bar.side == LEFT else -0.5
    for v in bar.ends[:, 1]:
        ray = np.array(((column - k.cx) / k.fx, (v - k.cy) / k.fy, 1.0))
        share = (mirror.normal @ mirror.point) / (mirror.normal @ ray)
        at = sign * float((ray * share - mirror.point) @ a) if 0.0 < share < _FARTHEST else _WIDEST
        rectangle[0, outer] = sign * min(max(at, sign * rectangle[0, outer]), _WIDEST)
    bottom = (room.floor - room.up @ mirror.point) / (room.up @ b)
    if 0.0 < bottom - rectangle[1, 1] < _FEET:
        rectangle[1, 1] = bottom
    return with_outline(replace(mirror, rectangle=rectangle), k)


def _makes_sense(mirror: Mirror, room: Room, settings: DetectionSettings) -> bool:
    """Whether all that the glass shows may be a reflection, and nothing is missing in it that it should show."""
    assert mirror.rectangle is not None
    if expected_error(mirror) > _MOST_ERROR:
        return False
    guess = Hypothesis(mirror.point, mirror.basis, mirror.rectangle, {})
    evidence = count_evidence(room.image, guess, floor_drop(room.image, mirror.basis))
    if evidence.violated > settings.max_violation * max(evidence.judged, 1.0):
        return False
    return not missing_reflection(room.image, mirror)
