"""The subject as mirrors show it: the pieces that the direct view does not deny."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..camera import Intrinsics
from ..numeric.kernels import njit
from ..numeric.point_products import dot
from .connected_pixels import IN_FRONT, Pieces, connected_pixels, dilated, gap_kernel, member_table
from .direct_subject import PIECE, DirectSubject
from .floor_plane import horizontal_projection, standing_pieces
from .image_border import cut_sides
from .subject_views import ViewSettings

_CONFIRMED = 0.25  # m: what the direct view confirms is no farther from the figure
_QUANTUM = 0.026  # of z: readings are quantised, a far sensor's pieces may be at so large a distance
_TOUCHING = 0.05  # m: at this distance pieces belong together although the direct view confirms none of them
_THICK = 0.12  # m: what is seen so little behind something else is its other side
_LOOSE = 0.15  # of what a mirror shows of the subject: a larger piece that the direct view does not show is none
_DENIED, _HARDLY = 0.1, 0.15  # of a piece: furniture, that the direct view shows the front of
_TIGHT = 0.5  # of the depth jump that separates a figure from the room
# pixels that the direct view does not deny, and of those that it decides on, and of those it could, what it confirms
_FEWEST, _AGREED, _AGREED_OF_ALL = 30, 0.6, 0.25
_ALLOWED = 0.7  # of a piece beside the figure, that the direct view does not deny
_NEAREST = 0.05  # m: what is nearer to the camera cannot be projected
_DEEPEST = 0.5  # m: a person reaches no farther behind its front
_BEYOND, _TALLER = 0.35, 0.15  # m: mirrors may show so much more of it, to the sides and in height
_STANDS = 0.1  # m: a figure that begins higher above the floor has its feet hidden
_OUTLINE = 0.08  # a view's points may stick out of the subject's outline in another view by this much [m]


@dataclass(frozen=True)
class MirroredPieces:
    """What stands about the subject as the mirrors show it, and how far the subject can reach.

    Parameters
    ----------
    pieces : Pieces
        Of a person those seen in mirrors, of an object those of all views.
    member : np.ndarray [shape=(C,), dtype=bool]
        Which of them are known to be the subject.
    axis : np.ndarray [shape=(3,)]
        A point of the vertical line through the subject [m].
    reach2 : float
        Square of its largest distance from that line [m²].
    deepest : float
        How far behind its front it can reach, along z [m].
    """

    pieces: Pieces
    member: np.ndarray
    axis: np.ndarray
    reach2: float
    deepest: float


def mirrored_pieces(
    direct: DirectSubject, labels: np.ndarray, axis: np.ndarray, views: int, settings: ViewSettings
) -> MirroredPieces:
    """What stands about the subject as the mirrors show it.

    Parameters
    ----------
    direct : DirectSubject
    labels : np.ndarray [shape=(H, W), dtype=int8]
        0 where the subject is seen directly.
    axis : np.ndarray [shape=(3,)]
        A point of the vertical line through it [m].
    views : int
        N + 1 with N mirrors, N > 0.
    settings : ViewSettings
    """
    pieces, member = direct.pieces, direct.member
    across = horizontal_projection(pieces.up)
    reach2 = (np.sqrt(_squared_distance(pieces.points[labels == 0], axis, across).max()) + _BEYOND) ** 2
    if settings.object:
        # it may be as deep as it is wide, and at least 30 cm
        return MirroredPieces(pieces, member, axis, reach2, max(0.3, 3.0 * np.sqrt(reach2) - 1.05))
    floor = replace(direct.floor, center=axis)
    pieces, _ = standing_pieces(pieces, range(1, views), floor, direct.rough, settings)
    return MirroredPieces(pieces, np.zeros(pieces.count, np.bool_), axis, reach2, _DEEPEST)


def label_mirrored_subject(
    labels: np.ndarray,
    direct: DirectSubject,
    mirrored: MirroredPieces,
    intrinsics: Intrinsics,
    views: int,
    settings: ViewSettings,
) -> tuple[np.ndarray, np.ndarray]:
    """Label what the mirrors show of the subject: the pieces that the direct view does not deny.

    Parameters
    ----------
    labels : np.ndarray [shape=(H, W), dtype=int8]
        0 where the subject is seen directly, else -1; 1..N is written where mirror N shows it.
    direct : DirectSubject
    mirrored : MirroredPieces
    intrinsics : Intrinsics
    views : int
        N + 1.
    settings : ViewSettings

    Returns
    -------
    taken : np.ndarray [shape=(N+1,), dtype=int64]
        Pixels that each view got.
    chosen : np.ndarray [shape=(C,), dtype=bool]
        Which pieces are the subject.
    """
    pieces = mirrored.pieces
    verdict, votes = _verdicts(labels, direct, mirrored, intrinsics, settings)
    chosen = _confirmed(votes) | mirrored.member
    _deny_furniture(pieces, chosen & (votes[3] >= PIECE), verdict)
    taken = _take_kernel(pieces.component, chosen, verdict, pieces.seen, labels, views)
    if chosen.any():
        part, joined = _beside_figure(pieces, chosen, verdict, votes, labels, taken.max())
        if joined is not None:
            taken = taken + _take_kernel(part, joined, verdict, pieces.seen, labels, views)
    return taken, chosen


def _verdicts(
    labels: np.ndarray,
    direct: DirectSubject,
    mirrored: MirroredPieces,
    intrinsics: Intrinsics,
    settings: ViewSettings,
) -> tuple[np.ndarray, np.ndarray]:
    """:func:`_verdict_kernel` of what the mirrors show, by the ``labels`` (H, W) of the direct view."""
    pieces, seen_first = mirrored.pieces, direct.pieces
    standing = seen_first.pixels_of(seen_first.sizes >= settings.min_pixels)
    others = standing & (pieces.seen == 0) & (labels < 0)
    wide = dilated(labels, int(np.ceil(_OUTLINE * intrinsics.fx / np.median(pieces.depth[labels == 0]))) + 1)
    heights = _height_limits(pieces.depth, labels, dot(pieces.points[labels == 0], pieces.up), direct.floor.height)
    return _verdict_kernel(
        pieces.component, pieces.count, pieces.seen, pieces.points, pieces.depth, labels, others, intrinsics.packed,
        wide, mirrored.axis, horizontal_projection(pieces.up), mirrored.reach2, pieces.up, heights, mirrored.deepest,
    )  # fmt: skip


def _height_limits(
    depth: np.ndarray, labels: np.ndarray, height: np.ndarray, floor: float | None
) -> tuple[float, float]:
    """Between which heights [m] a mirror may show the subject, by the heights (N,) at which it is seen directly.

    Where the picture's border cuts it off, or something in front of it hides its feet, a mirror may show more of it.
    """
    low, high = height.min(), height.max()
    sides = cut_sides(depth, labels == 0)
    cut = "bottom" in sides or (floor is not None and low > floor + _STANDS)
    return -np.inf if cut else low - _TALLER, np.inf if "top" in sides else high + _TALLER


def _confirmed(votes: np.ndarray) -> np.ndarray:
    """Bool (C,): which pieces the direct view confirms, by the ``votes`` (4, C) of :func:`_verdict_kernel`."""
    yes, hidden, unknown, no = votes
    decided = yes + hidden + no
    return (yes + unknown >= _FEWEST) & (yes > _AGREED * decided) & (yes > _AGREED_OF_ALL * (decided + unknown))


def _beside_figure(
    pieces: Pieces, chosen: np.ndarray, verdict: np.ndarray, votes: np.ndarray, labels: np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray | None]:
    """What belongs to the figure and lies right beside it: pieces (H, W) anew, and which are (P,); None = none.

    It is what the direct view cannot see, a foot behind a chair's leg; and of what it denies as a whole the part that
    it confirms, a foot that touches the chair. ``most``: pixels of the figure in the mirror that shows most of it.
    """
    yes, hidden, unknown, no = votes
    total = yes + hidden + unknown + no
    small = (total < _LOOSE * most) | (yes > unknown)
    loose = ~chosen & small & (yes + unknown >= PIECE) & (yes + unknown > _ALLOWED * total)
    loose &= ~_is_furniture(yes, no, total)
    mixed = ~chosen & ~loose & (yes >= PIECE)
    if not loose.any() and not mixed.any():
        return pieces.component, None
    beside = _pieces_beside(pieces.component, loose, mixed, verdict, pieces.seen)
    part, sizes = connected_pixels(pieces.depth, beside, pieces.pixel_angle)
    count = len(sizes)
    part[labels > 0] = count
    member, near = member_table(np.array([count]), count + 1), np.append(sizes >= PIECE, False)
    gap = gap_kernel(part, member, near, pieces.points, np.append(sizes, 0), _CONFIRMED / pieces.pixel_angle)
    distance, confirmed = _piece_kernel(part, verdict, pieces.depth, count + 1)
    # what the direct view confirms, be it in part, may be far off: a foot below a chair's seat, a heel behind its leg
    limit = np.where(confirmed > 0.0, _CONFIRMED, np.maximum(_TOUCHING, _QUANTUM * distance))
    return part, near & (gap < limit)


@njit(cache=True, nogil=True)
def _verdict_kernel(
    component, count, seen, points, depth, labels, others, intrinsics, wide, axis, across, reach2, up, heights, deepest
):
    """What the direct view says of each standing pixel of a mirror.

    2 the subject's, 1 it hides behind the subject, 0 cannot tell, -1 not the subject's; -2 elsewhere. And how many of
    each (4, C) a component has, 2 first.

    ``intrinsics`` (4,): fx, fy, cx, cy; ``wide``: the directly seen outline, grown; ``others``: where somebody or
    something else is seen to stand.
    """
    height, width = component.shape
    out = np.full((height, width), -2, np.int8)
    votes = np.zeros((4, count), np.int64)
    for v in range(height):
        for u in range(width):
            if component[v, u] < 0 or seen[v, u] <= 0:
                continue
            p = points[v, u]
            level = up[0] * p[0] + up[1] * p[1] + up[2] * p[2]
            x, y, z = p[0] - axis[0], p[1] - axis[1], p[2] - axis[2]
            squared = 0.0
            for r in range(3):
                squared += (across[r, 0] * x + across[r, 1] * y + across[r, 2] * z) ** 2
            verdict = -1
            if heights[0] < level < heights[1] and squared <= reach2:
                verdict = 0
                if p[2] > _NEAREST:
                    row = int(np.floor(p[1] / p[2] * intrinsics[1] + intrinsics[3] + 0.5))
                    column = int(np.floor(p[0] / p[2] * intrinsics[0] + intrinsics[2] + 0.5))
                    if 0 <= row < height and 0 <= column < width:
                        if labels[row, column] == 0:
                            # behind the subject's front; too far behind it is something that the subject hides
                            verdict = 1 if p[2] - depth[row, column] > deepest else 2
                        elif not wide[row, column] and depth[row, column] > p[2] - IN_FRONT:
                            verdict = -1
                        elif others[row, column] and -IN_FRONT < p[2] - depth[row, column] < _THICK:
                            verdict = -1  # the other side of that
            out[v, u] = verdict
            votes[2 - verdict, component[v, u]] += 1
    return out, votes


def _is_furniture(yes: np.ndarray, no: np.ndarray, total: np.ndarray) -> np.ndarray:
    """Whether a piece that the direct view confirms almost nowhere, and denies in part, is furniture.

    Such as the other side of a box that is seen directly, of which all that is deeper is hidden behind its front.
    """
    return (no >= np.maximum(PIECE, _DENIED * total)) & (yes < _HARDLY * total)


def _deny_furniture(pieces: Pieces, mixed: np.ndarray, verdict: np.ndarray) -> None:
    """Judge what touches the figure (``mixed`` pieces) only across a small jump by itself, in ``verdict``."""
    if not mixed.any():
        return
    inside = np.where(pieces.pixels_of(mixed), pieces.seen, -1).astype(np.int8)
    part, sizes = connected_pixels(pieces.depth, inside, pieces.pixel_angle, _TIGHT)
    rows, columns = np.nonzero(part >= 0)
    piece, said = part[rows, columns], verdict[rows, columns]
    yes, no = (np.bincount(piece, said == value, len(sizes)) for value in (2, -1))
    denied = _is_furniture(yes, no, sizes)[piece]
    verdict[rows[denied], columns[denied]] = -1


@njit(cache=True, nogil=True)
def _pieces_beside(component, loose, mixed, verdict, seen):
    """``seen`` on loose components and on the confirmed pixels of mixed ones, else -1."""
    out = np.full(seen.shape, -1, np.int8)
    for v in range(seen.shape[0]):
        for u in range(seen.shape[1]):
            k = component[v, u]
            if k >= 0 and verdict[v, u] >= 0 and (loose[k] or (mixed[k] and verdict[v, u] == 2)):
                out[v, u] = seen[v, u]
    return out


@njit(cache=True, nogil=True)
def _piece_kernel(component, verdict, depth, count):
    """Mean depth of each component, and the share of it that the direct view confirms."""
    total, confirmed, pixels = np.zeros(count), np.zeros(count), np.zeros(count)
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            k = component[v, u]
            if k >= 0:
                total[k] += depth[v, u]
                confirmed[k] += verdict[v, u] == 2
                pixels[k] += 1.0
    pixels = np.maximum(pixels, 1.0)
    return total / pixels, confirmed / pixels


@njit(cache=True, nogil=True)
def _take_kernel(component, chosen, verdict, seen, labels, views):
    taken = np.zeros(views, np.int64)
    for v in range(component.shape[0]):
        for u in range(component.shape[1]):
            if verdict[v, u] >= 0 and chosen[component[v, u]]:
                labels[v, u] = seen[v, u]
                taken[seen[v, u]] += 1
    return taken


@njit(cache=True, nogil=True)
def _squared_distance(points, origin, projection):
    """|projection · (point − origin)|² (N,) of points (N, 3)."""
    out = np.empty(len(points))
    for i in range(len(points)):
        x, y, z = points[i, 0] - origin[0], points[i, 1] - origin[1], points[i, 2] - origin[2]
        total = 0.0
        for r in range(3):
            total += (projection[r, 0] * x + projection[r, 1] * y + projection[r, 2] * z) ** 2
        out[i] = total
    return out
