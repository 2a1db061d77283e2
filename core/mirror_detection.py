"""Mirrors found without a click: straight rims before farther depth (:mod:`.rims`) that prove to be mirrors by what
they show.

The readings in a rectangle of rims, flipped over its plane, must make sense: nothing may end up where the camera looks
through, and a part must lie on, or close behind, what is seen directly. A doorway, a table's legs or a window fail
there.

Where a mirror has no frame and no wall about it, see :mod:`.frameless`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numba import njit

from .camera import Intrinsics, project
from .capture import MirrorPicks
from .errors import MirrorError
from .frameless import find_frameless
from .mirrors import Mirror
from .mirrors.frame_fit import fit_frame, without_frames
from .mirrors.glass_extent import at_border, with_outline
from .mirrors.mirror import behind_glass, person_before, reflection_matrix, reflection_shift
from .rims import BOTTOM, LEFT, RIGHT, TOP, DetectionSettings, Hypothesis, Segment, find_rims, propose
from .twins import a_pair, measures, one_make

_DETECTION = DetectionSettings()
_OPEN_SHOWN = 0.07  # with a side missing, this share of all readings must lie on or close behind what is seen directly
_PLAIN = 0.15  # a mirror that shows so much needs less of a rim
_WHOLE, _FEW_SHOWN = 0.95, (15, 8)  # with so much of a rim on 3 or 4 sides, and nothing against it, so few must show
_CONTRADICTED = 0.15  # share of what a mirror shows that nothing but a wrong plane puts before what is seen
_HIT = 0.35  # share of the picks that say which mirror is meant, where they fit no plane together
_STANDS, _MOSTLY = 0.6, 0.9  # of its outline, of all and of what can be judged, something must stand in its plane
_MISSING = 10, 0.005  # readings, and share of them, that noise may make look as if a mirror did not show them
_BLIND, _IN_REACH = 0.05, 0.8  # a glass of which less is read must be nearer than this share of the farthest reading
_USUAL = 2  # mirrors: where depth alone finds fewer, the colour picture's lines are asked as well
_LINE, _CHANGE = 3, 20  # px to each side between which a line in the colour picture changes a channel by so much
_HIDDEN = 0.03, 1.02  # glass and frame hide what is seen so far around them [m], the plane at most so many times as far
_EMPTY = 0.02  # of a glass so much may be read in its plane, and of that so much make no sense, by noise
_AT_BORDER = 0.02  # sides nearer to the image's border, as a share of its size, are cut off by it


def rim_share(
    guess: Hypothesis,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    least: float = 0.3,
    known: Iterable[Mirror] = (),
    color: np.ndarray | None = None,
) -> float:
    """Share of the rectangle's circumference, as far as nothing hides it, just outside of which something stands in
    the plane: a frame or a wall; 0 when that is less than ``least`` of it all. A thin frame is only seen close by.

    Black and glossy frames give few readings: where half as much as ``least`` is read, lines in the ``color`` picture
    (H, W, 3) stand for the rest."""
    shares = []
    place = guess.point, guess.basis, guess.rectangle, depth, intrinsics
    for outward in (0.015, 0.007):
        on, beyond = circumference(*place, outward, known)
        if color is not None and 0.5 * least <= on < least:
            on, beyond = circumference(*place, outward, known, color)
        shares.append(on / (on + beyond) if on >= least else 0.0)
    return max(shares)


def circumference(
    point: np.ndarray,
    basis: np.ndarray,
    rectangle: np.ndarray,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    outward: float = 0.015,
    known: Iterable[Mirror] = (),
    color: np.ndarray | None = None,
) -> tuple[float, float]:
    """Shares of a mirror's circumference where, ``outward`` of its rectangle [m], something stands in its plane, and
    where the camera sees beyond; of what the glass of ``known`` mirrors hides neither. With a ``color`` picture
    (H, W, 3) something stands also where nothing is read and the picture has a line."""
    (left, right), (top, bottom) = rectangle + np.array((-outward, outward))
    along = np.linspace(0.0, 1.0, 41)[1:-1]
    corners = np.array(((left, top), (right, top), (right, bottom), (left, bottom), (left, top)))
    at = np.concatenate([a + along[:, None] * (b - a) for a, b in zip(corners[:-1], corners[1:], strict=True)])
    weight = np.repeat(np.linalg.norm(np.diff(corners, axis=0), axis=1), len(along))
    points = point + at @ basis[:, :2].T
    u, v = project(points, intrinsics).T
    inside = (u > 0) & (v > 0) & (u < intrinsics.width - 1) & (v < intrinsics.height - 1)  # false where NaN
    inside[inside] = ~behind_glass(points[inside], known, *_HIDDEN)
    read = np.zeros(len(points))
    rows, columns = np.rint(v[inside]).astype(int), np.rint(u[inside]).astype(int)
    read[inside] = depth[rows, columns]
    apart = read - points[:, 2]
    slack = 0.02 * points[:, 2] + 0.02
    on = inside & (np.abs(apart) < slack)
    if color is not None:
        on[inside] |= (read[inside] == 0) & _on_line(color, rows, columns)
    beyond = inside & (read > 0) & (apart >= slack)
    return float(weight[on].sum() / weight.sum()), float(weight[beyond].sum() / weight.sum())


def _on_line(color: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Whether the colour picture changes across each of the pixels, along rows or columns."""
    height, width = color.shape[:2]

    def at(down: int, right: int) -> np.ndarray:
        there = color[np.clip(rows + down, 0, height - 1), np.clip(columns + right, 0, width - 1)]
        return there.astype(np.int16)

    change = np.maximum(np.abs(at(0, _LINE) - at(0, -_LINE)), np.abs(at(_LINE, 0) - at(-_LINE, 0)))
    return change.max(axis=-1) > _CHANGE


def verify(
    guess: Hypothesis,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    floor: float,
    settings: DetectionSettings,
    known: Iterable[Mirror] = (),
    color: np.ndarray | None = None,
) -> Hypothesis | None:
    """The hypothesis with its evidence, or None when what it shows cannot be a reflection.

    Every third reading in the rectangle is flipped over the plane. Where it lands nearer than what the camera sees in
    that direction, the camera would have looked through it: a violation. Where it lands on, or up to 0.7 m behind, what
    is seen directly, it is shown. What lies outside the picture says nothing. Behind the glass of mirrors that are
    ``known`` a rim is hidden. ``color`` as for :func:`rim_share`.
    """
    before, on, none, outside, violated, shown, hidden, ground = _count(guess, depth, intrinsics, floor)
    behind = outside + violated + shown + hidden + ground
    total = behind + on + none
    if total < 60 or behind + none < 0.5 * total or behind < min(_FEW_SHOWN):
        return None
    if TOP not in guess.sides and BOTTOM not in guess.sides:
        # two uprights alone, such as legs or door posts, must leave the picture where the lying side would be
        if min(s.ends[0, 1] for s in guess.sides.values()) > 0.04 * intrinsics.height:
            return None
    if behind < _BLIND * total and guess.point[2] > _IN_REACH * float(depth[::8, ::8].max()):
        return None  # the end of what the camera reaches looks like a rim, too
    judged = violated + shown + hidden + ground
    violation = violated / max(judged, 1.0)
    plain = shown > _PLAIN * total and violation < 0.02
    if len(guess.sides) == 2 and min(s.length for s in guess.sides.values()) < (0.3 if plain else 0.5):
        return None  # a leg and the edge of its shadow, a table and one of its legs
    least = 0.2 if plain else 0.3
    rim = rim_share(guess, depth, intrinsics, least, known, color)
    made = replace(guess, shown=shown, violated=violation, behind=behind / total, score=rim * (1.0 - violation))
    if rim < settings.min_rim + (0.13 if len(guess.sides) == 2 else 0.0):
        return None
    if violation > settings.max_violation:
        return None
    if settings.empty_rig:
        return made if len(guess.sides) >= 3 or shown >= 30.0 else None
    # a rim of which a side is missing may be a wall's, seen past a mirror that stands before it
    open_rim = _OPEN_SHOWN * (behind + on) if _open_sides(guess, intrinsics) else 0.0
    if rim > _WHOLE and violated == 0.0 and (len(guess.sides) >= 3 or known):
        few = _FEW_SHOWN[len(guess.sides) == 4]
        return made if shown >= max(few, settings.min_shown * judged, open_rim) else None
    if behind + none < 0.8 * total:  # something is in its plane, such as somebody right before the glass, or a wall
        return None
    if before > behind:  # something stands there, and little is seen beyond: it may be the image in another mirror
        return None
    return made if shown >= max(30.0, settings.min_shown * behind, open_rim) else None


def _count(guess: Hypothesis, depth: np.ndarray, intrinsics: Intrinsics, floor: float) -> list[float]:
    """What becomes of the readings in the rectangle, see :func:`_verify_kernel`; all 0 when it reaches behind the
    camera."""
    mirror = Mirror("", guess.point, guess.basis[:, 2], guess.basis)
    corners = np.array([(x, y) for x in guess.rectangle[0] for y in guess.rectangle[1]])
    pixels = project(guess.point + corners @ guess.basis[:, :2].T, intrinsics)
    counts = np.zeros(8, np.int64)
    if np.isfinite(pixels).all():
        low = np.clip(np.floor(pixels.min(axis=0)), 0, None).astype(np.int64)
        high = np.clip(np.ceil(pixels.max(axis=0)) + 1, 0, (intrinsics.width, intrinsics.height)).astype(np.int64)
        _verify_kernel(
            depth, intrinsics.lens, guess.basis, guess.point, guess.rectangle, reflection_matrix(mirror), low, high,
            floor, counts,
        )  # fmt: skip
    return [float(count) for count in counts]


def _open_sides(guess: Hypothesis, intrinsics: Intrinsics) -> int:
    """How many sides have no rim where the image would show it: its border cuts off the others."""
    margin = _AT_BORDER * np.array((intrinsics.width, intrinsics.height))
    count = 0
    for side in range(4):
        if side in guess.sides:
            continue
        axis, end = {LEFT: (0, 1), RIGHT: (0, 0), TOP: (1, 0), BOTTOM: (1, 1)}[side]  # basis[:, 0] points left
        at = np.empty(2)
        at[axis], at[1 - axis] = guess.rectangle[axis, end], guess.rectangle[1 - axis].mean()
        place = project(guess.point + guess.basis[:, :2] @ at, intrinsics)[axis]
        size = (intrinsics.width, intrinsics.height)[axis]
        count += bool(margin[axis] < place < size - 1 - margin[axis])
    return count


@njit(cache=True, nogil=True)
def _verify_kernel(depth, camera, basis, point, rectangle, flip, low, high, floor, counts):
    """Counts of sampled pixels: before the plane, on it, no reading, then flipped outside, violating, shown, hidden,
    ground."""
    height, width = depth.shape
    fx, fy, cx, cy = camera
    d = 0.0
    for c in range(3):
        d += basis[c, 2] * point[c]
    ray, p, q = np.empty(3), np.empty(3), np.empty(3)
    step = 3 if (high[0] - low[0]) * (high[1] - low[1]) > 9000 else 2
    for v in range(low[1], high[1], step):
        for u in range(low[0], high[0], step):
            ray[0], ray[1], ray[2] = (u - cx) / fx, (v - cy) / fy, 1.0
            slope = basis[0, 2] * ray[0] + basis[1, 2] * ray[1] + basis[2, 2]
            if slope >= -1e-6:
                continue
            at = d / slope
            inside = True
            for k in range(2):
                s = 0.0
                for c in range(3):
                    s += basis[c, k] * (ray[c] * at - point[c])
                if s < rectangle[k, 0] + 0.015 or s > rectangle[k, 1] - 0.015:
                    inside = False
            if not inside:
                continue
            z = depth[v, u]
            if z == 0:
                counts[2] += 1
                continue
            if z < at * 0.97 - 0.02:
                counts[0] += 1
                continue
            if z < at * 1.02 + 0.04:
                counts[1] += 1
                continue
            drop = 0.0
            for r in range(3):
                p[r] = ray[r] * z
                drop += basis[r, 1] * p[r]
            for r in range(3):
                q[r] = flip[r, 3]
                for c in range(3):
                    q[r] += flip[r, c] * p[c]
            if q[2] < 0.3:
                counts[3] += 1
                continue
            x, y = int(np.rint(q[0] / q[2] * fx + cx)), int(np.rint(q[1] / q[2] * fy + cy))
            # a reading's error points sideways once it is flipped: look about the place by what noise at z may be
            reach = int(fx * (0.01 + 0.003 * z * z) / q[2]) + 2
            if x < 2 or y < 2 or x >= width - 2 or y >= height - 2:
                counts[3] += 1
                continue
            nearest, farthest = np.inf, 0.0
            for ky in range(-3, 4):
                for kx in range(-3, 4):
                    row = min(max(y + ky * reach // 3, 0), height - 1)
                    seen = depth[row, min(max(x + kx * reach // 3, 0), width - 1)]
                    if seen > 0:
                        nearest, farthest = min(nearest, seen), max(farthest, seen)
            if farthest == 0.0:
                counts[3] += 1
                continue
            slack = 0.05 + 0.02 * z
            if q[2] < nearest - slack:
                counts[4] += 1
            elif drop > floor:
                counts[7] += 1
            elif q[2] < nearest + 0.7:
                counts[5] += 1
            else:
                counts[6] += 1


def _missing(mirror: Mirror, depth: np.ndarray, intrinsics: Intrinsics) -> bool:
    """What stands before the plane would be seen in the glass, and is not: it is a door, whoever stands behind it."""
    flip = reflection_matrix(mirror)
    missing, there = _missing_kernel(
        depth, intrinsics.lens, mirror.basis, mirror.point, mirror.rectangle, flip, 3
    )  # fmt: skip
    return missing > max(_MISSING[0], _MISSING[1] * (missing + there))


@njit(cache=True, nogil=True)
def _missing_kernel(depth, camera, basis, point, rectangle, flip, stride):
    """Of what stands before the plane and, flipped, would be seen in the glass: how much is not, since what is read
    there is farther; and how much is, or may be hidden."""
    height, width = depth.shape
    fx, fy, cx, cy = camera
    d = 0.0
    for c in range(3):
        d += basis[c, 2] * point[c]
    p, q = np.empty(3), np.empty(3)
    missing, there = 0, 0
    for v in range(0, height, stride):
        for u in range(0, width, stride):
            z = depth[v, u]
            if z == 0:
                continue
            p[0], p[1], p[2] = (u - cx) / fx * z, (v - cy) / fy * z, z
            ahead = -d
            for c in range(3):
                ahead += basis[c, 2] * p[c]
            if ahead < 0.15:
                continue
            for r in range(3):
                q[r] = flip[r, 3]
                for c in range(3):
                    q[r] += flip[r, c] * p[c]
            if q[2] < 0.3:
                continue
            x, y = int(np.rint(q[0] / q[2] * fx + cx)), int(np.rint(q[1] / q[2] * fy + cy))
            if x < 3 or y < 3 or x >= width - 3 or y >= height - 3:
                continue
            slope = 0.0
            for c in range(3):
                slope += basis[c, 2] * q[c]
            at, inside = d / slope, True
            for k in range(2):
                s = 0.0
                for c in range(3):
                    s += basis[c, k] * (q[c] * at - point[c])
                if s < rectangle[k, 0] + 0.08 or s > rectangle[k, 1] - 0.08:
                    inside = False
            if not inside:
                continue
            nearest = np.inf
            for i in range(-3, 4, 3):
                for j in range(-3, 4, 3):
                    if depth[y + i, x + j] == 0.0:
                        nearest = 0.0
                    nearest = min(nearest, depth[y + i, x + j])
            if nearest == 0.0:
                continue
            if nearest > q[2] + 0.08 + 0.01 * q[2] * q[2]:
                missing += 1
            else:
                there += 1
    return missing, there


def find_mirrors(
    depth: np.ndarray,
    intrinsics: Intrinsics,
    color: np.ndarray | None = None,
    settings: DetectionSettings = _DETECTION,
    glass_offset: float = 0.0,
) -> list[Mirror]:
    """All mirrors of a scene, from the left, without a click.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        Fused depth, flying pixels removed; z [m], 0 = no reading.
    intrinsics : Intrinsics
    color : np.ndarray [shape=(H, W, 3), dtype=uint8], optional
        On the depth's grid. Where depth alone finds fewer than two mirrors, its lines stand for parts of frames that
        give no readings, as black and glossy ones do. Another size is not used.
    glass_offset : float
        How far the reflecting glass lies behind the front of the frame [m].

    Returns
    -------
    list of Mirror
        ``source`` "found"; named left, right, or mirror 1, 2 … from the left. Empty when there is none.

    Notes
    -----
    O(H W) and the square of the number of straight rims; deterministic.
    """
    if color is not None and color.shape[:2] != depth.shape:
        color = None
    found = _framed([], depth, intrinsics, settings, glass_offset)
    if color is not None and len(found) < _USUAL:
        found = _framed(found, depth, intrinsics, settings, glass_offset, color)
    doubt = [doubtful(m, depth, intrinsics) for m in found]
    sure = [m for m, doubted in zip(found, doubt, strict=True) if not doubted]
    if len(sure) < settings.max_mirrors and not settings.empty_rig:
        better = _frameless(depth, intrinsics, settings, sure)
        found = [m for m, doubted in zip(found, doubt, strict=True) if not (doubted and _overlaps(m, better))] + better
    found.sort(key=lambda m: m.point[0] / m.point[2])
    return [replace(m, name=name) for m, name in zip(found, _names(found), strict=True)]


def _framed(
    found: list[Mirror],
    depth: np.ndarray,
    intrinsics: Intrinsics,
    settings: DetectionSettings,
    glass_offset: float,
    color: np.ndarray | None = None,
) -> list[Mirror]:
    """Mirrors with a frame or a wall about them, besides those ``found``: these and the new ones."""
    lenient = replace(settings, max_violation=2.0 * settings.max_violation)
    proposed = propose(find_rims(depth, intrinsics, settings, color), settings)
    guesses = _verified(proposed, depth, intrinsics, lenient, color=color)
    bare = _without(found, depth, intrinsics, glass_offset)
    while guesses:
        new = []
        for guess in _apart(guesses, intrinsics, found)[: settings.max_mirrors - len(found)]:
            mirror = _settled(guess, depth, intrinsics, settings, glass_offset, found, color, bare)
            if mirror is not None:
                new.append(mirror)
                bare = _without([mirror], bare, intrinsics, glass_offset)
        found = found + new
        if not new or len(found) == settings.max_mirrors:
            break
        # a mirror through another one: its rim is not where the other's glass is before it
        behind = [guess for guess in proposed if _partly_behind(guess, found)]
        guesses = _verified(behind, depth, intrinsics, lenient, found, color)
    return found + _twins(proposed, found, depth, intrinsics, settings, glass_offset, color, bare)


def _without(mirrors: list[Mirror], depth: np.ndarray, intrinsics: Intrinsics, glass_offset: float) -> np.ndarray:
    """The depth without the frames of mirrors."""
    frames = [replace(m, point=m.point + glass_offset * m.normal) for m in mirrors]
    return without_frames(depth, frames, intrinsics) if frames else depth


def _twins(
    proposed: list[Hypothesis],
    found: list[Mirror],
    depth: np.ndarray,
    intrinsics: Intrinsics,
    settings: DetectionSettings,
    glass_offset: float,
    color: np.ndarray | None,
    bare: np.ndarray,
) -> list[Mirror]:
    """Mirrors that show next to nothing, but stand in frames of the make of those ``found`` (:mod:`.twins`); ``bare``
    is the depth without the latter."""
    if not found and settings.empty_rig:
        found = _pair(proposed, depth, intrinsics, glass_offset, color)
        bare = _without(found, bare, intrinsics, glass_offset)
        return found + (
            _twins(proposed, found, depth, intrinsics, settings, glass_offset, color, bare) if found else []
        )
    asked, points = [], _some(depth, intrinsics) if found else None
    for guess in _uncovered(proposed, found) if found else ():
        rim, _ = _unopposed(guess, points, depth, intrinsics, found, color)
        if rim > 0.0:
            asked.append((len(guess.sides), rim, guess))
    asked.sort(key=lambda one: one[:2], reverse=True)
    makes = [
        measures(replace(m, point=m.point + glass_offset * m.normal), depth, intrinsics)
        for m in (found if asked else ())
        if not doubtful(m, depth, intrinsics)
    ]
    new: list[Mirror] = []
    for _, _, guess in asked:
        if len(found) + len(new) == settings.max_mirrors or not _uncovered([guess], new):
            continue
        fitted = _on_its_frame(guess, bare, intrinsics)
        if fitted is None or _missing(fitted, depth, intrinsics):
            continue
        final = replace(guess, point=fitted.point, basis=fitted.basis)
        rim, shown = _unopposed(final, points, depth, intrinsics, found, color)
        mine = measures(fitted, depth, intrinsics)
        if rim > 0.0 and any(one_make(mine, make, shown >= min(_FEW_SHOWN)) for make in makes):
            behind = replace(fitted, point=fitted.point - glass_offset * fitted.normal)
            new.append(at_border(behind, intrinsics, _unseen(guess)))
            bare = _without(new[-1:], bare, intrinsics, glass_offset)
    return new


def _pair(
    proposed: list[Hypothesis],
    depth: np.ndarray,
    intrinsics: Intrinsics,
    glass_offset: float,
    color: np.ndarray | None,
) -> list[Mirror]:
    """Two mirrors of an empty rig in which nothing is read, proved by each other; or none."""
    points, asked = _some(depth, intrinsics), []
    for guess in proposed:
        if len(guess.sides) == 4 and _unopposed(guess, points, depth, intrinsics, (), color)[0] > 0.0:
            fitted = _on_its_frame(guess, depth, intrinsics)
            if fitted is not None:
                behind = replace(fitted, point=fitted.point - glass_offset * fitted.normal)
                asked.append(
                    (guess, at_border(behind, intrinsics, _unseen(guess)), measures(fitted, depth, intrinsics))
                )
    for k, (_, one, mine) in enumerate(asked):
        for guess, other, its in asked[:k]:
            if a_pair(mine, its) and _uncovered([guess], [one]):
                return [other, one]
    return []


def _uncovered(guesses: list[Hypothesis], mirrors: list[Mirror]) -> list[Hypothesis]:
    """Those of which no more than half is where rectangles of mirrors are in the picture."""
    share = np.linspace(0.0, 1.0, 7)
    x, y = (part.ravel() for part in np.meshgrid(share, share))
    points = []
    for guess in guesses:
        (left, right), (top, bottom) = guess.rectangle
        at = np.column_stack((left + x * (right - left), top + y * (bottom - top)))
        points.append(guess.point + at @ guess.basis[:, :2].T)
    if not points:
        return []
    hidden = behind_glass(np.concatenate(points), mirrors, nearest=np.inf).reshape(len(guesses), -1)
    return [guess for guess, part in zip(guesses, hidden.mean(axis=1), strict=True) if part <= 0.5]


def _unopposed(
    guess: Hypothesis,
    points: np.ndarray,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    known: Iterable[Mirror],
    color: np.ndarray | None,
) -> tuple[float, float]:
    """:func:`rim_share` where nothing stands in the rectangle's plane but its rim, and nothing it shows would be where
    the camera looks through, else 0; and how many readings it shows. ``points`` as for
    :func:`_lowest`."""
    before, on, none, *behind = _count(guess, depth, intrinsics, _lowest(points, guess.basis))
    glass = none + sum(behind)
    if glass < 60 or on > _EMPTY * glass or behind[1] > max(_EMPTY * sum(behind), 3.0):
        return 0.0, 0.0
    rim = rim_share(guess, depth, intrinsics, 0.2, known, color)
    return (rim if rim > _WHOLE else 0.0), behind[2]


def doubtful(mirror: Mirror, depth: np.ndarray, intrinsics: Intrinsics) -> bool:
    """More of its glass is hidden than shows anything: its rim may be a wall's, seen past mirrors without a frame."""
    if mirror.rectangle is None:
        return False
    guess = Hypothesis(mirror.point, mirror.basis, mirror.rectangle, {})
    before, _, _, *behind = _count(guess, depth, intrinsics, _ground(depth, intrinsics, mirror.basis))
    return before > sum(behind)


def _overlaps(mirror: Mirror, others: Iterable[Mirror]) -> bool:
    """Whether it shares more than a quarter of the smaller one's place in the picture with one of the others."""
    for other in others:
        low = np.maximum(mirror.outline.min(axis=0), other.outline.min(axis=0))
        size = np.minimum(mirror.outline.max(axis=0), other.outline.max(axis=0)) - low
        smaller = min(np.prod(np.ptp(m.outline, axis=0)) for m in (mirror, other))
        if size.min() > 0 and np.prod(size) > 0.25 * smaller:
            return True
    return False


def _frameless(
    depth: np.ndarray, intrinsics: Intrinsics, settings: DetectionSettings, known: list[Mirror]
) -> list[Mirror]:
    """Mirrors that only the figure in them tells of, as far as the rest of what they show may be a reflection too.

    Where something stands beside the glass it must be a frame in its plane, which then tells that better.
    """
    good = []
    for mirror, beside in find_frameless(depth, intrinsics, known, settings.max_mirrors - len(known)):
        if beside:
            framed = fit_frame(mirror, depth, intrinsics)
            off = framed and reflection_shift(person_before(mirror), framed, mirror)
            if off is None or off > 3.0 * mirror.displacement(person_before(mirror)):
                continue
            mirror = with_outline(framed, intrinsics)
        guess = Hypothesis(mirror.point, mirror.basis, mirror.rectangle, {})
        if beside and rim_share(guess, depth, intrinsics, 0.2, known) < settings.min_rim:
            continue
        _, _, _, _, violated, shown, hidden, ground = _count(
            guess, depth, intrinsics, _ground(depth, intrinsics, mirror.basis)
        )
        bad = violated > settings.max_violation * (violated + shown + hidden + ground)
        if shown >= 30 and not bad and not _missing(mirror, depth, intrinsics):
            good.append(mirror)
    return good


def find_mirror_at(
    picks: MirrorPicks,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    settings: DetectionSettings = _DETECTION,
    glass_offset: float = 0.0,
) -> Mirror:
    """The mirror whose rim is nearest to one or two picked pixels, too few for a plane of their own.

    That a mirror is there is the user's word: it need not show anybody.

    Parameters
    ----------
    picks : MirrorPicks
        One pixel or more on the mirror's frame; in the glass will do.

    Raises
    ------
    MirrorError
        No rim is near.
    """
    trusting = replace(settings, empty_rig=True, max_violation=max(2.0 * settings.max_violation, 0.3))
    pixels = np.asarray(picks.frame_pixels, dtype=np.float64).reshape(-1, 2)
    guesses = hypotheses(depth, intrinsics, trusting)
    settled = [_settled(guess, depth, intrinsics, trusting, glass_offset) for guess in guesses]
    best = _nearest([mirror for mirror in settled if mirror is not None], pixels, 0.5)
    if best is None and (bare := find_frameless_at(picks, depth, intrinsics, settings, 0.5)) is not None:
        return bare
    if best is None:
        u, v = pixels[0]
        raise MirrorError(
            f"{picks.name}: no straight frame is seen near ({u:g}, {v:g}), and {len(pixels)} pick(s) are too few for a "
            "plane; pick at least 3 points on its frame, on two sides"
        )
    return replace(best, name=picks.name, source="picked")


def find_better_at(
    picks: MirrorPicks,
    mirror: Mirror | None,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    settings: DetectionSettings = _DETECTION,
    glass_offset: float = 0.0,
) -> Mirror | None:
    """The mirror that picks mean where that of the plane through them, ``mirror``, cannot be, or there is none: they
    missed its frame, or it has none. Else ``mirror``."""
    if mirror is None or contradicted(mirror, depth, intrinsics):
        pixels = np.asarray(picks.frame_pixels, dtype=np.float64).reshape(-1, 2)
        guesses = hypotheses(depth, intrinsics, settings)
        settled = [_settled(guess, depth, intrinsics, settings, glass_offset) for guess in guesses]
        better = _nearest([found for found in settled if found is not None], pixels, 0.05)
        if better is not None:
            return replace(better, name=picks.name, source="picked")
    elif not doubtful(mirror, depth, intrinsics):
        return mirror
    return find_frameless_at(picks, depth, intrinsics, settings) or mirror


def contradicted(mirror: Mirror, depth: np.ndarray, intrinsics: Intrinsics, known: Iterable[Mirror] = ()) -> bool:
    """Much of what is seen in its glass would, flipped over its plane, stand where the camera looks through; or along
    its outline, as far as other mirrors that are ``known`` do not hide it, hardly anything stands in its plane."""
    if mirror.rectangle is None or mirror.polygon is not None:
        return False
    guess = Hypothesis(mirror.point, mirror.basis, mirror.rectangle, {})
    _, _, _, _, violated, *other = _count(guess, depth, intrinsics, _ground(depth, intrinsics, mirror.basis))
    if violated > max(_CONTRADICTED * (violated + sum(other)), 50.0):
        return True
    rims = [
        circumference(mirror.point, mirror.basis, mirror.rectangle, depth, intrinsics, outward, known)
        for outward in (-0.015, 0.015)
    ]
    return all(on < _STANDS and on < _MOSTLY * (on + beyond) for on, beyond in rims)


def find_frameless_at(
    picks: MirrorPicks,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    settings: DetectionSettings = _DETECTION,
    reach: float = 0.15,
) -> Mirror | None:
    """The mirror without a frame along whose edges picks were made, which no reading there can place; None when there
    is none within ``reach`` of its size. Its ``source`` stays "found": the picks say only which."""
    pixels = np.asarray(picks.frame_pixels, dtype=np.float64).reshape(-1, 2)
    mirror = _nearest(_frameless(depth, intrinsics, settings, []), pixels, reach)
    return None if mirror is None else replace(mirror, name=picks.name)


def _nearest(mirrors: list[Mirror], pixels: np.ndarray, reach: float) -> Mirror | None:
    """The mirror whose outline is nearest to the better part of pixels (K, 2), within ``reach`` of its lesser size."""
    best, nearest = None, np.inf
    for mirror in mirrors:
        corners = np.nan_to_num(mirror.outline)
        distance = np.quantile([_to_outline(pixel, corners) for pixel in pixels], _HIT)
        if distance < nearest and distance < reach * np.ptp(corners, axis=0).min():
            best, nearest = mirror, distance
    return best


def _to_outline(pixel: np.ndarray, corners: np.ndarray) -> float:
    """Distance of a pixel from the outline [px]."""
    start, along = corners, np.roll(corners, -1, axis=0) - corners
    share = ((pixel - start) * along).sum(axis=1) / np.maximum((along * along).sum(axis=1), 1e-9)
    return float(np.linalg.norm(start + np.clip(share, 0.0, 1.0)[:, None] * along - pixel, axis=1).min())


def _partly_behind(guess: Hypothesis, mirrors: list[Mirror]) -> bool:
    """The glass of known mirrors hides some of the rectangle's corners or the middles of its sides, but not its own
    middle: there it would be one of them, or an image in one."""
    (left, right), (top, bottom) = guess.rectangle
    x, y = np.meshgrid((left, 0.5 * (left + right), right), (top, 0.5 * (top + bottom), bottom))
    points = guess.point + np.column_stack((x.ravel(), y.ravel())) @ guess.basis[:, :2].T
    hidden = behind_glass(points, mirrors, *_HIDDEN)
    return bool(hidden.any() and not hidden[4])


def _settled(
    guess: Hypothesis,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    settings: DetectionSettings,
    glass_offset: float,
    known: Iterable[Mirror] = (),
    color: np.ndarray | None = None,
    bare: np.ndarray | None = None,
) -> Mirror | None:
    """The hypothesis as a mirror on its frame's plane; None when what it shows makes no sense with that plane. ``bare``
    is the depth without the frames of other mirrors."""
    fitted = _on_its_frame(guess, depth if bare is None else bare, intrinsics)
    if fitted is None:
        return None
    final = replace(guess, point=fitted.point, basis=fitted.basis)
    if verify(final, depth, intrinsics, _ground(depth, intrinsics, fitted.basis), settings, known, color) is None:
        return None
    if _missing(fitted, depth, intrinsics):
        return None
    behind = replace(fitted, point=fitted.point - glass_offset * fitted.normal)
    return at_border(behind, intrinsics, _unseen(guess))


def _on_its_frame(guess: Hypothesis, depth: np.ndarray, intrinsics: Intrinsics) -> Mirror | None:
    mirror = Mirror("", guess.point, guess.basis[:, 2], guess.basis, guess.rectangle, source="found")
    return fit_frame(mirror, depth, intrinsics, seeds=_along(guess.sides.values()))


def _along(sides: Iterable[Segment]) -> np.ndarray:
    """Pixels (K, 2), every few along the rims."""
    return np.concatenate([np.linspace(*s.ends, max(int(np.abs(s.ends[1] - s.ends[0]).max()) // 8, 2)) for s in sides])


def _unseen(guess: Hypothesis) -> np.ndarray:
    """Which ends of the rectangle have no rim, (2, 2): only those may be cut off by the image's border."""
    return np.array(
        ((RIGHT not in guess.sides, LEFT not in guess.sides), (TOP not in guess.sides, BOTTOM not in guess.sides))
    )


def _names(mirrors: list[Mirror]) -> list[str]:
    if len(mirrors) == 2:
        return ["left", "right"]
    if len(mirrors) == 1:
        return ["left" if mirrors[0].point[0] < 0 else "right"]
    return [f"mirror {k}" for k in range(1, len(mirrors) + 1)]


def _apart(good: list[Hypothesis], intrinsics: Intrinsics, known: list[Mirror]) -> list[Hypothesis]:
    """The best of those that share a part of the picture, with each other or a known mirror; images of mirrors in a
    mirror go."""
    taken = [(m.outline.min(axis=0), m.outline.max(axis=0)) for m in known if np.isfinite(m.outline).all()]
    boxes = []
    for h in good:
        corners = np.array([(x, y) for x in h.rectangle[0] for y in h.rectangle[1]])
        pixels = project(h.point + corners @ h.basis[:, :2].T, intrinsics)
        boxes.append((pixels.min(axis=0), pixels.max(axis=0)))
    chosen: list[int] = []
    for i in range(len(good)):
        for low, high in taken + [boxes[j] for j in chosen]:
            size = np.minimum(boxes[i][1], high) - np.maximum(boxes[i][0], low)
            smaller = min(np.prod(boxes[i][1] - boxes[i][0]), np.prod(high - low))
            if size.min() > 0 and np.prod(size) > 0.25 * smaller:
                break
        else:
            chosen.append(i)
    return [good[i] for i in chosen]


def hypotheses(depth: np.ndarray, intrinsics: Intrinsics, settings: DetectionSettings) -> list[Hypothesis]:
    """Verified rectangles, the best first."""
    return _verified(propose(find_rims(depth, intrinsics, settings), settings), depth, intrinsics, settings)


def _verified(
    proposed: list[Hypothesis],
    depth: np.ndarray,
    intrinsics: Intrinsics,
    settings: DetectionSettings,
    known: Iterable[Mirror] = (),
    color: np.ndarray | None = None,
) -> list[Hypothesis]:
    good, points = [], _some(depth, intrinsics) if proposed else None
    for guess in proposed:
        checked = verify(guess, depth, intrinsics, _lowest(points, guess.basis), settings, known, color)
        if checked is not None:
            good.append(checked)
    good.sort(key=lambda h: -h.score)
    return good


def _ground(depth: np.ndarray, intrinsics: Intrinsics, basis: np.ndarray) -> float:
    """How far down, along the rectangle, readings may belong to a floor [m]."""
    return _lowest(_some(depth, intrinsics), basis)


def _some(depth: np.ndarray, intrinsics: Intrinsics) -> np.ndarray:
    """Every eighth reading along rows and columns as a point, (3, N)."""
    z = depth[::8, ::8]
    v, u = np.nonzero(z)
    z = z[v, u].astype(np.float64)
    return np.stack(((8.0 * u - intrinsics.cx) / intrinsics.fx * z, (8.0 * v - intrinsics.cy) / intrinsics.fy * z, z))


def _lowest(points: np.ndarray, basis: np.ndarray) -> float:
    """:func:`_ground` of points (3, N)."""
    drop = basis[:, 1] @ points
    k = int(0.97 * (len(drop) - 1))
    return float(np.partition(drop, k)[k]) - 0.15 if len(drop) else 0.0
