"""Whether a rectangle is a mirror: what it shows is flipped over its plane and must fit the room."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..camera import Intrinsics, RgbdImage, project
from ..mirrors import Mirror
from ..mirrors.glass_kernels import NEAREST, before_plane, glass_of, nearest_pixel, reflected, share_at_glass
from ..mirrors.mirror import behind_glass
from ..numeric.kernels import njit
from .edge_segments import BOTTOM, LEFT, RIGHT, TOP, DetectionSettings, find_edge_segments
from .rectangle_hypotheses import Hypothesis, propose

_OPEN_SHOWN = 0.07  # with a side missing, this share of all readings must lie on or close behind what is seen directly
_MUCH_SHOWN = 0.15  # a mirror that shows so much needs less of a frame edge
WHOLE_EDGE = 0.95
"""Share of a frame's edge that leaves no doubt of the frame."""
LEAST_SHOWN = (15, 8)
"""With :data:`WHOLE_EDGE` on three or four sides, and nothing against it, so few readings must be shown."""
_MISSING_BY_NOISE = 10, 0.005  # readings, and share of them, that noise may make look as if a mirror did not show them
_HARDLY_READ, _IN_REACH = 0.05, 0.8  # with less of a glass read, how near it must be, of the farthest reading
_LINE_REACH, _LINE_CHANGE = 3, 20  # px to each side of a line in the picture, and how much a channel changes there
_HIDING = 0.03, 1.02  # how wide frames are about the glass [m]; how many times as far as a point its plane may be
_AT_BORDER = 0.02  # sides nearer to the image's border, as a share of its size, are cut off by it


def frame_edge_share(
    image: RgbdImage, guess: Hypothesis, least: float = 0.3, known: Iterable[Mirror] = (), floor: float = np.inf
) -> float:
    """Share of the rectangle's visible circumference just outside of which a frame or a wall stands in its plane.

    0 when that is less than ``least`` of the whole circumference. A thin frame is only seen close by. What is farther
    down along the rectangle than ``floor`` [m] may be a floor, which goes on through a glass that stands on it.

    Black and glossy frames give few readings: where half as much as ``least`` is read, lines in the colour picture
    stand for the rest.
    """
    shares = []
    place = guess.point, guess.basis, guess.rectangle
    for outward in (0.015, 0.007):
        on, beyond = circumference(image.without_color(), *place, outward, known, floor)
        if image.color is not None and 0.5 * least <= on < least:
            on, beyond = circumference(image, *place, outward, known, floor)
        shares.append(on / (on + beyond) if on >= least else 0.0)
    return max(shares)


def hidden_by_mirrors(points: np.ndarray, mirrors: Iterable[Mirror]) -> np.ndarray:
    """Which of some points (N, 3) [m] the glass or frame of a mirror hides from the camera, (N,) bool."""
    return behind_glass(points, mirrors, *_HIDING)


def circumference(
    image: RgbdImage,
    point: np.ndarray,
    basis: np.ndarray,
    rectangle: np.ndarray,
    outward: float = 0.015,
    known: Iterable[Mirror] = (),
    floor: float = np.inf,
) -> tuple[float, float]:
    """Shares of a mirror's circumference where something stands in its plane, and where the camera sees beyond it.

    Looked at ``outward`` [m] outside of its rectangle; what the glass of ``known`` mirrors hides counts as neither, and
    so does what is seen beyond it lower than ``floor`` along its b [m], where a glass that stands on a floor shows it.
    With a colour picture something stands also where nothing is read and the picture has a line.
    """
    depth, intrinsics, color = image.depth, image.intrinsics, image.color
    (left, right), (top, bottom) = rectangle + np.array((-outward, outward))
    along = np.linspace(0.0, 1.0, 41)[1:-1]
    corners = np.array(((left, top), (right, top), (right, bottom), (left, bottom), (left, top)))
    at = np.concatenate([a + along[:, None] * (b - a) for a, b in zip(corners[:-1], corners[1:], strict=True)])
    weight = np.repeat(np.linalg.norm(np.diff(corners, axis=0), axis=1), len(along))
    points = point + at @ basis[:, :2].T
    u, v = project(points, intrinsics).T
    inside = (u > 0) & (v > 0) & (u < intrinsics.width - 1) & (v < intrinsics.height - 1)  # false where NaN
    inside[inside] = ~hidden_by_mirrors(points[inside], known)
    read = np.zeros(len(points))
    rows, columns = np.rint(v[inside]).astype(int), np.rint(u[inside]).astype(int)
    read[inside] = depth[rows, columns]
    behind = read - points[:, 2]
    slack = 0.02 * points[:, 2] + 0.02
    on = inside & (np.abs(behind) < slack)
    if color is not None:
        on[inside] |= (read[inside] == 0) & _on_line(color, rows, columns)
    beyond = inside & (read > 0) & (behind >= slack) & (points @ basis[:, 1] < floor)
    return float(weight[on].sum() / weight.sum()), float(weight[beyond].sum() / weight.sum())


def _on_line(color: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Whether the colour picture changes across each of the pixels, along rows or columns."""
    height, width = color.shape[:2]

    def at(down: int, right: int) -> np.ndarray:
        there = color[np.clip(rows + down, 0, height - 1), np.clip(columns + right, 0, width - 1)]
        return there.astype(np.int16)

    change = np.maximum(
        np.abs(at(0, _LINE_REACH) - at(0, -_LINE_REACH)), np.abs(at(_LINE_REACH, 0) - at(-_LINE_REACH, 0))
    )
    return change.max(axis=-1) > _LINE_CHANGE


def verify(
    image: RgbdImage, guess: Hypothesis, floor: float, settings: DetectionSettings, known: Iterable[Mirror] = ()
) -> Hypothesis | None:
    """The hypothesis with its evidence, or None when what it shows cannot be a reflection.

    Every third reading in the rectangle is flipped over the plane. Where it lands nearer than what the camera sees in
    that direction, the camera would have looked through it: a free-space violation. Where it lands on, or up
    to 0.7 m behind, what is seen directly, it is shown. What lies outside the picture says nothing. Behind the glass of
    mirrors that are ``known`` a frame edge is hidden. The colour picture as for :func:`frame_edge_share`.
    """
    depth, intrinsics = image.depth, image.intrinsics
    evidence = count_evidence(image, guess, floor)
    behind, judged, shown, violated = evidence.behind, evidence.judged, evidence.shown, evidence.violated
    glass = behind + evidence.unread
    total = glass + evidence.on
    if total < 60 or glass < 0.5 * total or behind < min(LEAST_SHOWN):
        return None
    if TOP not in guess.sides and BOTTOM not in guess.sides:
        # two uprights alone, such as legs or door posts, must leave the picture where the lying side would be
        if min(s.ends[0, 1] for s in guess.sides.values()) > 0.04 * intrinsics.height:
            return None
    if behind < _HARDLY_READ * total and guess.point[2] > _IN_REACH * float(depth[::8, ::8].max()):
        return None  # the end of what the camera reaches looks like a frame edge, too
    violation = violated / max(judged, 1.0)
    plain = shown > _MUCH_SHOWN * total and violation < 0.02
    if len(guess.sides) == 2 and min(s.length for s in guess.sides.values()) < (0.3 if plain else 0.5):
        return None  # a leg and the edge of its shadow, a table and one of its legs
    least = 0.2 if plain else 0.3
    edge = frame_edge_share(image, guess, least, known, floor)
    made = replace(guess, shown=shown, violated=violation, behind=behind / total, score=edge * (1.0 - violation))
    if edge < settings.min_rim + (0.13 if len(guess.sides) == 2 else 0.0):
        return None
    if violation > settings.max_violation:
        return None
    if settings.empty_rig:
        return made if len(guess.sides) >= 3 or shown >= 30.0 else None
    # a frame edge of which a side is missing may be a wall's, seen past a mirror that stands in front of it
    open_edge = _OPEN_SHOWN * (behind + evidence.on) if _open_sides(guess, intrinsics, floor) else 0.0
    if edge > WHOLE_EDGE and violated == 0.0 and (len(guess.sides) >= 3 or known):
        few = LEAST_SHOWN[len(guess.sides) == 4]
        return made if shown >= max(few, settings.min_shown * judged, open_edge) else None
    if glass < 0.8 * total:  # something is in its plane, such as somebody right in front of the glass, or a wall
        return None
    # something stands there, and little is seen beyond: it may be the image in another mirror
    if evidence.before > behind:
        return None
    return made if shown >= max(30.0, settings.min_shown * behind, open_edge) else None


class Evidence(NamedTuple):
    """What becomes of the readings sampled in a rectangle: how many are of each kind.

    Attributes
    ----------
    before, on, unread : float
        In front of the rectangle's plane, on it, and pixels without a reading.
    outside : float
        Behind it, and flipped over it where the camera reads nothing, so that nothing can be said of them.
    violated : float
        Flipped, nearer than what the camera sees there: it would have to look through them.
    shown, hidden : float
        Flipped, on or close behind what is seen directly; farther behind it.
    ground : float
        Flipped, so low that it may be floor, which proves nothing.
    """

    before: float
    on: float
    unread: float
    outside: float
    violated: float
    shown: float
    hidden: float
    ground: float

    @property
    def judged(self) -> float:
        """Of those behind the plane, how many can be compared with what is seen directly."""
        return self.violated + self.shown + self.hidden + self.ground

    @property
    def behind(self) -> float:
        """How many are behind the plane."""
        return self.outside + self.judged


def count_evidence(image: RgbdImage, guess: Hypothesis, floor: float) -> Evidence:
    """What becomes of the readings in a rectangle that are flipped over its plane.

    Parameters
    ----------
    image : RgbdImage
        z [m], 0 = no reading.
    floor : float
        How far down along the rectangle readings may belong to a floor [m].

    Returns
    -------
    Evidence
        All 0 when the rectangle reaches behind the camera.
    """
    depth, intrinsics = image.depth, image.intrinsics
    mirror = Mirror("", guess.point, guess.basis[:, 2], guess.basis, guess.rectangle)
    corners = np.array([(x, y) for x in guess.rectangle[0] for y in guess.rectangle[1]])
    pixels = project(guess.point + corners @ guess.basis[:, :2].T, intrinsics)
    counts = np.zeros(8, np.int64)
    if np.isfinite(pixels).all():
        low = np.clip(np.floor(pixels.min(axis=0)), 0, None).astype(np.int64)
        high = np.clip(np.ceil(pixels.max(axis=0)) + 1, 0, (intrinsics.width, intrinsics.height)).astype(np.int64)
        _verify_kernel(depth, intrinsics.packed, glass_of([mirror]), low, high, floor, counts)
    return Evidence(*(float(count) for count in counts))


def _open_sides(guess: Hypothesis, intrinsics: Intrinsics, floor: float) -> int:
    """How many sides have no depth edge where the image would show it.

    Its border cuts off the others, or they stand on the ``floor``, which goes on through the glass.
    """
    margin = _AT_BORDER * np.array((intrinsics.width, intrinsics.height))
    count = 0
    for side in range(4):
        if side in guess.sides:
            continue
        axis, end = {LEFT: (0, 1), RIGHT: (0, 0), TOP: (1, 0), BOTTOM: (1, 1)}[side]  # basis[:, 0] points left
        at = np.empty(2)
        at[axis], at[1 - axis] = guess.rectangle[axis, end], guess.rectangle[1 - axis].mean()
        middle = guess.point + guess.basis[:, :2] @ at
        if side == BOTTOM and middle @ guess.basis[:, 1] > floor:
            continue
        place = project(middle, intrinsics)[axis]
        size = (intrinsics.width, intrinsics.height)[axis]
        count += bool(margin[axis] < place < size - 1 - margin[axis])
    return count


_FRAME_EDGE = 0.015  # so near to the edge of the glass readings may be of its frame, smeared [m]
_MANY_PIXELS = 9000  # in a rectangle; every third along rows and columns is asked, of fewer every second
_CLEARLY_BEFORE = 0.97, 0.02  # in front of the plane is what is nearer than this share of the plane's z, less [m]
_NOT_BEHIND = 1.02, 0.04  # and on it when it is less than this share and [m] more: noise, and the thickness of a board
_SIDEWAYS = 0.01, 0.003  # a flipped reading at z may be off sideways by this [m] and this times z²
_IMAGE_MARGIN = 2  # px from the image's border from which what is seen there cannot be looked up
_LOOK = 3  # steps to each side of a flipped reading's pixel in which the depth seen is looked up
_NEARER = 0.05, 0.02  # what is so much nearer than what is seen there, [m] and times z, is a free-space violation
_CLOSE_BEHIND = 0.7  # the hidden side of a body or of furniture is no farther behind what is seen of it [m]
_BEFORE, _ON, _UNREAD, _OUTSIDE, _VIOLATED, _SHOWN, _HIDDEN, _GROUND = range(8)  # places in Evidence


@njit(cache=True, nogil=True)
def _verify_kernel(depth, intrinsics, glass, low, high, floor, counts):
    """Add to ``counts`` (8,) the sampled pixels, in the order of :class:`Evidence`."""
    height, width = depth.shape
    fx, fy, cx, cy = intrinsics
    axes = glass.axes
    step = 3 if (high[0] - low[0]) * (high[1] - low[1]) > _MANY_PIXELS else 2
    for v in range(low[1], high[1], step):
        for u in range(low[0], high[0], step):
            x, y = (u - cx) / fx, (v - cy) / fy
            at = share_at_glass(glass, 0, x, y, 1.0, _FRAME_EDGE)
            if at == np.inf:
                continue
            z = np.float64(depth[v, u])
            if z == 0:
                counts[_UNREAD] += 1
                continue
            if z < at * _CLEARLY_BEFORE[0] - _CLEARLY_BEFORE[1]:
                counts[_BEFORE] += 1
                continue
            if z < at * _NOT_BEHIND[0] + _NOT_BEHIND[1]:
                counts[_ON] += 1
                continue
            drop = axes[0, 1, 0] * (x * z) + axes[0, 1, 1] * (y * z) + axes[0, 1, 2] * z
            px, py, pz = reflected(glass, 0, x * z, y * z, z)
            if pz < NEAREST:
                counts[_OUTSIDE] += 1
                continue
            column, row = nearest_pixel(px, py, pz, intrinsics)
            # a reading's error points sideways once it is flipped: look about the place by what noise at z may be
            reach = int(fx * (_SIDEWAYS[0] + _SIDEWAYS[1] * z * z) / pz) + 2
            if (
                column < _IMAGE_MARGIN
                or row < _IMAGE_MARGIN
                or column >= width - _IMAGE_MARGIN
                or row >= height - _IMAGE_MARGIN
            ):
                counts[_OUTSIDE] += 1
                continue
            nearest, farthest = np.inf, 0.0
            for ky in range(-_LOOK, _LOOK + 1):
                for kx in range(-_LOOK, _LOOK + 1):
                    i = min(max(row + ky * reach // _LOOK, 0), height - 1)
                    seen = depth[i, min(max(column + kx * reach // _LOOK, 0), width - 1)]
                    if seen > 0:
                        nearest, farthest = min(nearest, seen), max(farthest, seen)
            if farthest == 0.0:
                counts[_OUTSIDE] += 1
                continue
            slack = _NEARER[0] + _NEARER[1] * z
            if pz < nearest - slack:
                counts[_VIOLATED] += 1
            elif drop > floor:
                counts[_GROUND] += 1
            elif pz < nearest + _CLOSE_BEHIND:
                counts[_SHOWN] += 1
            else:
                counts[_HIDDEN] += 1


def missing_reflection(image: RgbdImage, mirror: Mirror) -> bool:
    """Whether what stands in front of the plane would be seen in the glass, and is not: then it is a door."""
    depth, intrinsics = image.depth, image.intrinsics
    missing, there = _missing_kernel(depth, intrinsics.packed, glass_of([mirror]), 3)
    return missing > max(_MISSING_BY_NOISE[0], _MISSING_BY_NOISE[1] * (missing + there))


_CLEAR_OF_PLANE = 0.15  # nearer to the plane a reading may be of the frame, or of a board's back [m]
_WELL_INSIDE = 0.08  # farther than this from the edges of the glass a reflection cannot be hidden by its frame [m]
_FARTHER = 0.08, 0.01  # by so much, [m] and times z², must what is read be farther than a reflection that is missing
_AROUND = 3  # px about a reflection's pixel where all must be farther


@njit(cache=True, nogil=True)
def _missing_kernel(depth, intrinsics, glass, stride):
    """How many reflections that the glass should show are missing, and how many are shown or may be hidden.

    Of readings in front of the plane, flipped over it; one is missing where what is read is farther than it.
    """
    height, width = depth.shape
    fx, fy, cx, cy = intrinsics
    missing, there = 0, 0
    for v in range(0, height, stride):
        for u in range(0, width, stride):
            z = np.float64(depth[v, u])
            if z == 0:
                continue
            x, y = (u - cx) / fx * z, (v - cy) / fy * z
            if before_plane(glass, 0, x, y, z) < _CLEAR_OF_PLANE:
                continue
            px, py, pz = reflected(glass, 0, x, y, z)
            if pz < NEAREST:
                continue
            column, row = nearest_pixel(px, py, pz, intrinsics)
            if column < _AROUND or row < _AROUND or column >= width - _AROUND or row >= height - _AROUND:
                continue
            if share_at_glass(glass, 0, px, py, pz, _WELL_INSIDE) == np.inf:
                continue
            nearest = np.inf
            for i in range(-_AROUND, _AROUND + 1, _AROUND):
                for j in range(-_AROUND, _AROUND + 1, _AROUND):
                    if depth[row + i, column + j] == 0.0:
                        nearest = 0.0
                    nearest = min(nearest, depth[row + i, column + j])
            if nearest == 0.0:
                continue
            if nearest > pz + _FARTHER[0] + _FARTHER[1] * pz * pz:
                missing += 1
            else:
                there += 1
    return missing, there


def doubtful(image: RgbdImage, mirror: Mirror) -> bool:
    """Whether more of its glass is hidden than shows anything.

    What was taken for its frame may be the edge of a wall, seen past mirrors without a frame. ``depth`` (H, W) float32
    is z [m], 0 = no reading.
    """
    if mirror.rectangle is None:
        return False
    guess = Hypothesis(mirror.point, mirror.basis, mirror.rectangle, {})
    evidence = count_evidence(image, guess, floor_drop(image, mirror.basis))
    return evidence.before > evidence.behind


def hypotheses(image: RgbdImage, settings: DetectionSettings) -> list[Hypothesis]:
    """Rectangles of depth edges that what they show proves to be mirrors, the best first.

    Parameters
    ----------
    image : RgbdImage
        z [m], 0 = no reading.
    """
    proposed = propose(find_edge_segments(image, settings), settings)
    return verified_hypotheses(image, proposed, settings)


def verified_hypotheses(
    image: RgbdImage, proposed: list[Hypothesis], settings: DetectionSettings, known: Iterable[Mirror] = ()
) -> list[Hypothesis]:
    """Those of ``proposed`` that :func:`verify` lets pass, with their evidence, the best first.

    Parameters
    ----------
    image : RgbdImage
        z [m], 0 = no reading.
        As for :func:`frame_edge_share`.
    known : iterable of Mirror
        Behind whose glass a frame is hidden.
    """
    if not proposed:
        return []
    good, points = [], sampled_points(image)
    for guess in proposed:
        checked = verify(image, guess, floor_drop_of_points(points, guess.basis), settings, known)
        if checked is not None:
            good.append(checked)
    good.sort(key=lambda h: -h.score)
    return good


def floor_drop(image: RgbdImage, basis: np.ndarray) -> float:
    """How far down readings may belong to a floor: their least offset from the camera along a rectangle's b [m].

    Parameters
    ----------
    image : RgbdImage
        z [m], 0 = no reading.
    basis : np.ndarray [shape=(3, 3)]
        The rectangle's, see :class:`.mirror.Mirror`.
    """
    return floor_drop_of_points(sampled_points(image), basis)


def sampled_points(image: RgbdImage) -> np.ndarray:
    """Every eighth reading along the rows and columns of ``depth`` (H, W) as points (3, N) [m], camera frame."""
    depth, intrinsics = image.depth, image.intrinsics
    z = depth[::8, ::8]
    v, u = np.nonzero(z)
    z = z[v, u].astype(np.float64)
    return np.stack(((8.0 * u - intrinsics.cx) / intrinsics.fx * z, (8.0 * v - intrinsics.cy) / intrinsics.fy * z, z))


def floor_drop_of_points(points: np.ndarray, basis: np.ndarray) -> float:
    """:func:`floor_drop` of points (3, N) [m]; 0 when there is none."""
    drop = basis[:, 1] @ points
    k = int(0.97 * (len(drop) - 1))
    return float(np.partition(drop, k)[k]) - 0.15 if len(drop) else 0.0
