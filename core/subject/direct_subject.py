"""The subject as it is seen directly, and what it stands on: the floor, a step, a table."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..numeric.kernels import njit
from ..numeric.point_products import dot
from .connected_pixels import IN_FRONT, Pieces, Readings, gap_kernel, label_kernel, member_table
from .floor_plane import (
    ABOUT,
    CARPET,
    FOOTPRINT,
    LOW,
    MAT,
    ROUGH,
    STEP,
    Floor,
    RaisedFloor,
    horizontal_projection,
    is_stepped,
    raised_floor,
    standing_pieces,
    standing_pieces_of_all,
)
from .object_pieces import group_pieces
from .subject_views import ViewSettings
from .support_surface import find_support

PIECE = 8  # px: fewer are noise
_BELOW = 0.15  # of the figure: so much of it may be seen below what stands in front of it
_PLACED, _SMALLEST = 0.6, 20  # of a piece, and pixels, that must be within reach of where the subject is expected
_SHOWN = 0.3  # of the least pixels that a view of the subject has: a mirror with fewer does not show the object
_BESIDE_FEET = 0.15  # m: so far beyond the feet a carpet must go on, to be measured there
_PART_GAP = 0.12  # m: a hand or a head whose wrist or neck was not read is so near to the rest
# m: what lies partly outside of the figure's box is nearer, if it is smaller than a share of the figure; and what
# stands on the floor by itself, to within 5 cm, is furniture unless it is right at the figure
_OUTSIDE_GAP, _OUTSIDE_SHARE, _STANDING_GAP, _LOW = 0.08, 0.3, 0.04, 0.05
_UNREAD, _SAME_LIMB = 4, 0.3  # px without a reading beside what hides a limb; m: how far a limb's two ends differ in z
# m: a foot whose instep was not read is no higher above the floor, its toes are higher, and no farther from its limb
_FOOT, _TOES, _INSTEP = 0.12, 0.025, 0.2
_GIVEN_UP = 0.015  # m: so wide at least is what was not read between them; at the edge of what stands in front less is
_AXIS_SPREAD, _OBJECT_SPREAD = 0.5, 0.3  # how far off the rig's axis a person or object counts less [m]


@dataclass(frozen=True)
class DirectSubject:
    """What of the subject is seen directly, and what it stands on.

    Parameters
    ----------
    pieces : Pieces
        What stands on ``floor``: of a person what is seen directly, of an object what any view shows.
    member : np.ndarray [shape=(C,), dtype=bool]
        Which pieces are the subject.
    floor : Floor
        As the mirrors are to look for it.
    rough : float
        The largest noise that a view of the floor may have [m].
    warnings : tuple of str
    """

    pieces: Pieces
    member: np.ndarray
    floor: Floor
    rough: float
    warnings: tuple[str, ...] = ()

    def labels(self) -> np.ndarray:
        """The direct view's labels (H, W) int8: 0 = the subject, else -1."""
        labels = np.full(self.pieces.depth.shape, -1, np.int8)
        label_kernel(self.pieces.component, self.member, self.pieces.seen, 0, labels)
        return labels

    def middle(self) -> np.ndarray:
        """Median point (3,) of what is seen directly of it, camera frame [m]."""
        return np.median(self.pieces.points[self.pieces.pixels_of(self.member) & (self.pieces.seen == 0)], axis=0)


def find_person(
    readings: Readings, floor: Floor, clicked: tuple[int, int] | None, settings: ViewSettings
) -> DirectSubject | None:
    """The person seen directly; None when there is nobody. On a carpet, a mat or a step it is looked for once more.

    Parameters
    ----------
    readings : Readings
    floor : Floor
        Its ``center``: where the person is expected.
    clicked : tuple of int or None
        Row and column of a pixel of the person.
    settings : ViewSettings
    """
    found = _person_on(readings, floor, clicked, settings)
    if found is None or floor.height is None:
        return found
    above = _raised_floor(readings, found, floor.height, settings)
    if above is None:
        return found
    raised = replace(floor, height=above.height, center=found.middle(), wide=False, outer=ABOUT)
    found = _person_on(readings, raised, clicked, settings)
    if found is None:
        return None
    warnings: tuple[str, ...] = ()
    if above.step > CARPET:
        warnings = (f"what the subject stands on, {100.0 * above.step:.0f} cm above the floor, is cut off",)
    if above.step < LOW:  # a mirror shows too little of it to separate it from the floor about it
        goes_on = above.goes_on > FOOTPRINT + _BESIDE_FEET
        raised = replace(raised, wide=True, outer=above.goes_on if goes_on else floor.outer)
    return replace(found, floor=raised, warnings=warnings)


def _person_on(
    readings: Readings, floor: Floor, clicked: tuple[int, int] | None, settings: ViewSettings
) -> DirectSubject | None:
    """The person standing on this floor."""
    pieces, rough = standing_pieces(readings, range(1), floor, ROUGH, settings)
    member = _person_pieces(pieces, floor, clicked, settings)
    return None if member is None else DirectSubject(pieces, member, floor, rough)


def _raised_floor(readings: Readings, found: DirectSubject, floor: float, settings: ViewSettings) -> RaisedFloor | None:
    """The carpet, mat or step that a person stands on; None when it is the ``floor`` itself."""
    raised = raised_floor(readings, floor, found.middle(), settings.reach)
    figure = found.pieces.pixels_of(found.member)
    if raised is None and is_stepped(dot(readings.points[figure], readings.up) - floor):
        height = find_support(readings, figure, floor, settings.min_pixels, STEP, MAT)
        raised = None if height is None else RaisedFloor(height, height - floor, 0.0)
    return raised


def find_object(
    readings: Readings, floor: Floor, clicked: tuple[int, int] | None, views: int, settings: ViewSettings
) -> DirectSubject | None:
    """The object, in all ``views``; None when there is nothing. A table or plinth that it stands on is cut off.

    Parameters
    ----------
    readings : Readings
    floor : Floor
        Its ``center``: where the object is expected.
    clicked : tuple of int or None
        Row and column of a pixel of the object.
    views : int
        How many views there are.
    settings : ViewSettings
    """
    found = _object_on(readings, floor, clicked, views, settings)
    if found is None:
        return None
    figure, up = found.pieces.pixels_of(found.member), readings.up
    warnings: tuple[str, ...] = ()
    support = find_support(readings, figure, floor.height, settings.min_pixels)
    if support is not None and clicked is not None and readings.points[clicked] @ up < support:
        support = None  # what is clicked on is meant
    if support is not None:
        how = "" if floor.height is None else f", {100.0 * (support - floor.height):.0f} cm above the floor"
        warnings = (
            f"what the object stands on{how}, is cut off; if it is part of the object, click on it to keep it",
        )  # fmt: skip
    middle = found.middle()
    off = np.inf if floor.center is None else np.linalg.norm(horizontal_projection(up) @ (middle - floor.center))
    if support is None and off <= FOOTPRINT / 2:
        return found
    # from here on what the object stands on is its floor
    height = floor.height if support is None else support
    floor = replace(floor, height=height, center=middle, wide=support is None)
    found = _object_on(readings, floor, clicked, views, settings)
    return None if found is None else replace(found, warnings=warnings)


def _object_on(
    readings: Readings, floor: Floor, clicked: tuple[int, int] | None, views: int, settings: ViewSettings
) -> DirectSubject | None:
    """The object standing on this floor."""
    pieces, rough = standing_pieces_of_all(readings, views, floor, settings)
    member = _object_pieces(pieces, floor.center, clicked, settings)
    return None if member is None else DirectSubject(pieces, member, floor, rough)


def _person_pieces(
    pieces: Pieces, floor: Floor, clicked: tuple[int, int] | None, settings: ViewSettings
) -> np.ndarray | None:
    """Which pieces (C,) seen directly are the person: the clicked or best one, and what belongs to it."""
    extents = _extents(pieces, floor.center, _AXIS_SPREAD if clicked is None else _OBJECT_SPREAD, settings)
    if clicked is not None and pieces.component[clicked] >= 0:
        best = int(pieces.component[clicked])
    else:
        whole = np.where(extents.within >= settings.min_pixels, extents.score, 0.0)
        if not pieces.count or whole.max() <= 0:
            return None
        best = int(np.argmax(whole))
    member = _joined(np.array([best]), pieces, extents)
    below = ~member & (extents.score > 0) & (pieces.sizes < _BELOW * pieces.sizes[member].sum())
    if below.any():
        member |= _below_kernel(pieces.component, member, below, pieces.depth) >= PIECE // 2
    if floor.height is not None:
        member |= _feet_beyond_gaps(pieces, member, extents, floor.height)
    return member


def _feet_beyond_gaps(pieces: Pieces, member: np.ndarray, extents: _Extents, floor: float) -> np.ndarray:
    """Which pieces (C,) are feet, of which the instep was not read: low, and below where a limb breaks off."""
    small = ~member & (extents.score > 0) & (pieces.sizes < _BELOW * pieces.sizes[member].sum())
    if not small.any():
        return small
    lowest, highest = _height_kernel(pieces.component, pieces.count, pieces.points, pieces.up)
    small &= (lowest < floor + _LOW) & (highest < floor + _FOOT) & (highest > floor + _TOES)
    if not small.any():
        return small
    steps = _instep_kernel(
        pieces.component, member, small, pieces.depth, pieces.points, pieces.up, floor + _TOES,
        _INSTEP / pieces.pixel_angle,
    )  # fmt: skip
    return small & (steps >= PIECE // 2)


def _object_pieces(
    pieces: Pieces, expected: np.ndarray | None, clicked: tuple[int, int] | None, settings: ViewSettings
) -> np.ndarray | None:
    """Which pieces (C,) of all views are the object: what most views show best where it is expected."""
    extents = _extents(pieces, expected, _OBJECT_SPREAD, settings)
    component, count, seen = pieces.component, pieces.count, pieces.seen
    group = group_pieces(pieces, (extents.score > 0) & (pieces.sizes >= PIECE))
    views = int(seen.max()) + 1
    standing = component >= 0
    pixels = np.bincount(seen[standing].astype(np.int64) * count + group[component[standing]], minlength=views * count)
    pixels = pixels.reshape(views, count)
    if clicked is not None and component[clicked] >= 0:
        best = int(group[component[clicked]])
    else:
        near = np.bincount(group, extents.score, count)
        # furniture that happens to stand there is rarely seen in every mirror
        near *= (pixels >= _SHOWN * settings.min_pixels).sum(axis=0) ** 2
        near[pixels[0] < settings.min_pixels] = 0.0
        if not count or near.max() <= 0:
            return None
        best = int(np.argmax(near))
    mine = group == best
    direct = np.zeros(count, np.bool_)
    direct[np.unique(component[standing & (seen == 0)])] = True
    direct &= mine
    if not direct.any():
        return None
    alone = replace(pieces, component=np.where(seen == 0, component, -1))
    return mine | _joined(np.flatnonzero(direct), alone, extents)


def figure_areas(pieces: Pieces, places: np.ndarray, settings: ViewSettings) -> np.ndarray:
    """How large the figure is that stands at each of some places (K, 3), camera frame [m]; weighted by how near it is.

    What reaches from one side of the image to the other is a room's wall or floor, and no figure.

    Returns
    -------
    np.ndarray [shape=(K,)]
        [m²]; 0 where nothing stands.
    """
    component, figure = pieces.component, pieces.sizes >= settings.min_pixels
    columns = np.flatnonzero((component >= 0).any(axis=0))
    if not len(columns):
        return np.zeros(len(places))
    for side in ((columns[0], columns[-1]), (0, component.shape[1] - 1)):
        left, right = (np.unique(component[:, max(u - 2, 0) : u + 3]) for u in side)
        both = np.intersect1d(left, right)
        figure[both[both >= 0]] = False
    areas = []
    for place in places:
        extents = _extents(pieces, place, _AXIS_SPREAD, settings)
        areas.append(extents.score[figure & (extents.within >= settings.min_pixels)].max(initial=0.0))
    return np.array(areas)


def small_pieces(pieces: Pieces, member: np.ndarray, axis: np.ndarray, settings: ViewSettings) -> np.ndarray:
    """Bool (C,): what else stands about the subject, on the vertical through ``axis`` (3,) [m], and is small beside it.

    Parameters
    ----------
    pieces : Pieces
    member : np.ndarray [shape=(C,), dtype=bool]
        Which of them are the subject.
    axis : np.ndarray [shape=(3,)]
    settings : ViewSettings
    """
    within, _, _ = _extent_kernel(
        pieces.component, pieces.count, pieces.points, axis, horizontal_projection(pieces.up), settings.reach**2, 1.0,
        pieces.pixel_angle,
    )  # fmt: skip
    total = pieces.sizes
    return ~member & (total >= PIECE) & (within > _PLACED * total) & (total < _BELOW * total[member].sum())


class _Extents(NamedTuple):
    """How large each piece is, and how near to where the subject is expected.

    ``within`` (C,): pixels within reach of the place; ``score`` (C,) [m²]: its area, weighted by how near it is; its
    ``box`` (C, 2, 3) [m].
    """

    within: np.ndarray
    score: np.ndarray
    box: np.ndarray


def _extents(pieces: Pieces, expected: np.ndarray | None, spread: float, settings: ViewSettings) -> _Extents:
    """Where the pieces are, in relation to the vertical through the point where the subject is ``expected``."""
    if expected is None:  # near the vertical plane straight ahead of the camera
        axis, across = np.zeros(3), np.diag((1.0, 0, 0))
    else:
        axis, across = expected, horizontal_projection(pieces.up)
    within, weight, box = _extent_kernel(
        pieces.component, pieces.count, pieces.points, axis, across, settings.reach**2, spread**2, pieces.pixel_angle
    )
    # a wall or a chair row that only passes through the place is mostly outside of it
    return _Extents(within, np.where((within > _PLACED * pieces.sizes) & (within >= _SMALLEST), weight, 0.0), box)


def _joined(chosen: np.ndarray, pieces: Pieces, extents: _Extents) -> np.ndarray:
    """Bool (C,): the ``chosen`` pieces and what belongs to them, as near as it is."""
    total, score, box = pieces.sizes, extents.score, extents.box
    member = member_table(chosen, pieces.count)
    lowest, _ = _height_kernel(pieces.component, pieces.count, pieces.points, pieces.up)
    floor_reach = lowest[chosen].min() + _LOW
    while True:  # a piece may reach the body through another one: a hand through a forearm
        low, high = box[member, 0].min(axis=0) - _PART_GAP, box[member, 1].max(axis=0) + _PART_GAP
        near = ~member & (score > 0) & (box[:, 0] < high).all(axis=1) & (box[:, 1] > low).all(axis=1)
        if not near.any():
            return member
        gap = gap_kernel(pieces.component, member, near, pieces.points, total, _PART_GAP / pieces.pixel_angle)
        inside = (box[:, 0] > low).all(axis=1) & (box[:, 1] < high).all(axis=1)
        # a head whose neck was not read lies outside of the rest; another person does, too, but is as large as the rest
        small = total < _OUTSIDE_SHARE * total[member].sum()
        limit = np.where(inside, _PART_GAP, np.where(small, _OUTSIDE_GAP, 0.0))
        joined = near & (gap < np.where(lowest < floor_reach, np.minimum(limit, _STANDING_GAP), limit))
        if not joined.any():
            return member
        member |= joined


@njit(cache=True, nogil=True)
def _extent_kernel(component, count, points, origin, projection, reach2, spread2, pixel_angle):
    """Per piece: pixels within reach, the piece's area weighted by how near it is, box."""
    within, weight = np.zeros(count, np.int64), np.zeros(count)
    box = np.empty((count, 2, 3))
    box[:, 0], box[:, 1] = np.inf, -np.inf
    for v in range(component.shape[0]):
        for u in range(component.shape[1]):
            k = component[v, u]
            if k < 0:
                continue
            p = points[v, u]
            for c in range(3):
                box[k, 0, c] = min(box[k, 0, c], p[c])
                box[k, 1, c] = max(box[k, 1, c], p[c])
            x, y, z = p[0] - origin[0], p[1] - origin[1], p[2] - origin[2]
            squared = 0.0
            for r in range(3):
                squared += (projection[r, 0] * x + projection[r, 1] * y + projection[r, 2] * z) ** 2
            if squared < reach2:
                within[k] += 1
                weight[k] += (p[2] * pixel_angle) ** 2 * np.exp(-squared / spread2)
    return within, weight, box


@njit(cache=True, nogil=True)
def _below_kernel(component, member, small, depth):
    """In how many columns (C,) a ``small`` component goes on below a member, but for what stands in front of both."""
    height, width = component.shape
    columns = np.zeros(len(member), np.int64)
    for v in range(1, height):
        for u in range(width):
            k = component[v, u]
            if k < 0 or not small[k] or component[v - 1, u] == k:
                continue
            hidden = unread = 0
            y = v - 1
            while y >= 0 and unread <= _UNREAD:
                j, z = component[y, u], depth[y, u]
                if j >= 0 and member[j]:
                    columns[k] += hidden > 0 and abs(z - depth[v, u]) < _SAME_LIMB
                    break
                if z == 0:
                    unread += 1
                elif z < depth[v, u] - IN_FRONT:
                    hidden, unread = hidden + 1, 0
                else:
                    break
                y -= 1
    return columns


@njit(cache=True, nogil=True)
def _height_kernel(component, count, points, up):
    """Lowest and highest height (C,) of each component along ``up``."""
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    for v in range(component.shape[0]):
        for u in range(component.shape[1]):
            k = component[v, u]
            if k >= 0:
                p = points[v, u]
                level = p[0] * up[0] + p[1] * up[1] + p[2] * up[2]
                low[k], high[k] = min(low[k], level), max(high[k], level)
    return low, high


@njit(cache=True, nogil=True)
def _instep_kernel(component, member, small, depth, points, up, least, reach):
    """From how many pixels (C,) of a ``small`` component a member is in reach, above it, across unread pixels only.

    The member's pixel is higher than ``least``: a limb that comes down to the floor has its foot.
    """
    height, width = component.shape
    count = np.zeros(len(member), np.int64)
    for v in range(1, height):
        for u in range(width):
            k = component[v, u]
            if k < 0 or not small[k] or component[v - 1, u] == k:
                continue
            p = points[v, u]
            radius = int(reach / p[2]) + 1
            found = False
            for y in range(v - 1, max(v - radius, 0) - 1, -1):
                for x in range(max(u - (v - y), 0), min(u + (v - y) + 1, width)):
                    j = component[y, x]
                    if j < 0 or not member[j]:
                        continue
                    q, away, level = points[y, x], 0.0, 0.0
                    for i in range(3):
                        away += (q[i] - p[i]) ** 2
                        level += q[i] * up[i]
                    if away > _INSTEP**2 or level < least:
                        continue
                    if _unread_between(component, depth, v, u, y, x) * p[2] * _INSTEP > _GIVEN_UP * reach:
                        found = True
                        break
                if found:
                    break
            count[k] += found
    return count


@njit(cache=True, nogil=True)
def _unread_between(component, depth, v, u, y, x):
    """How many pixels between two are not read; 0 where one is read that does not belong to the first."""
    steps, unread = max(abs(y - v), abs(x - u)), 0
    for step in range(1, steps):
        a, b = int(np.rint(v + (y - v) * step / steps)), int(np.rint(u + (x - u) * step / steps))
        if depth[a, b] > 0 and component[a, b] != component[v, u]:
            return 0
        unread += depth[a, b] == 0
    return unread
