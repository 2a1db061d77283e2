"""Pieces of a person that something in front cuts off, separated from furniture by what the mirrors show."""

from __future__ import annotations

import numpy as np

from ..camera import Intrinsics
from ..mirrors import Mirror
from ..mirrors.mirror import reflection_matrix
from ..numeric.kernels import njit
from .connected_pixels import IN_FRONT, of_pixels
from .direct_subject import DirectSubject, small_pieces
from .subject_views import ViewSettings

_FEWEST, _TOUCHED = 4, 0.05  # pixels, and of a piece, that must be in touch with the figure in a mirror
_CERTAIN, _OTHER = 0.6, 0.1  # of a piece: in touch with the figure, and with something else, when it is certain
_DIRECTIONS = 13  # from the right over the top to the left in which the rest of the figure may be
_FARTHEST = 220  # px
_UNREAD = 16  # px: the shadow beside what stands in front, seen by a camera with two viewpoints
_ASIDE = 0.35  # m: a foot is no farther from its leg
_SAME_PART = 0.05  # m: the same part of a body, seen from two sides
_NEAREST, _WIDEST = 0.1, 12  # m: what is nearer to the camera is not projected; px: the largest window


def occluded_pieces(
    direct: DirectSubject,
    labels: np.ndarray,
    component: np.ndarray,
    chosen: np.ndarray,
    axis: np.ndarray,
    mirrors: list[Mirror],
    intrinsics: Intrinsics,
    settings: ViewSettings,
) -> np.ndarray:
    """Which pieces seen directly are the person's although something in front of the person separates them from it.

    Such a piece begins where something nearer hides what is beside or above it, and mostly the figure goes on behind
    that. A chair's hind legs do so, too: but in the mirrors, which see behind what hides it, the piece is connected
    with the figure, and a chair's leg is not.

    Parameters
    ----------
    direct : DirectSubject
    labels : np.ndarray [shape=(H, W), dtype=int8]
        0 where the person is seen directly, 1..N where mirror N shows it, else -1.
    component : np.ndarray [shape=(H, W), dtype=int32]
        Piece of each pixel that shows something standing in a mirror, -1 = none.
    chosen : np.ndarray [shape=(M,), dtype=bool]
        Which of these pieces are the person.
    axis : np.ndarray [shape=(3,)]
        A point of the vertical line through the person [m].
    mirrors : list of Mirror
    intrinsics : Intrinsics
    settings : ViewSettings

    Returns
    -------
    np.ndarray [shape=(C,), dtype=bool]
        Those of ``direct.pieces``.

    Notes
    -----
    O(B) of B pixels at the border of candidates, some thousand operations each.
    """
    pieces = direct.pieces
    member, found = direct.member.copy(), np.zeros(pieces.count, np.bool_)
    candidate = small_pieces(pieces, member, axis, settings)
    if not candidate.any():
        return found
    # of what stands in mirrors: 1 = connected with the figure there, 0 = something else
    shown = np.where(component < 0, -1, of_pixels(chosen, component) | (labels > 0)).astype(np.int8)
    flips = np.stack([reflection_matrix(mirror) for mirror in mirrors])
    touches, others, asked = _touch_kernel(
        pieces.component, candidate, pieces.points, pieces.seen, shown, flips, intrinsics.packed, _SAME_PART
    )
    shared = candidate & (touches >= np.maximum(_FEWEST, _TOUCHED * asked)) & (touches > 2 * others)
    certain = shared & (touches > _CERTAIN * asked) & (others < _OTHER * asked)
    while shared.any():  # a shin between two bars, and the foot below
        beside, met = _linked_kernel(pieces.component, member, shared, pieces.points, pieces.depth)
        linked = (met >= _FEWEST) | (certain & (beside >= _FEWEST))
        if not linked.any():
            break
        found |= linked
        member |= linked
        shared &= ~linked
    return found


@njit(cache=True, nogil=True)
def _linked_kernel(component, member, candidate, points, depth):
    """How many border pixels of each ``candidate`` (C,) are beside something nearer, and how many reach the figure.

    They reach it behind what hides the pixels between.
    """
    height, width = component.shape
    beside, count = np.zeros(len(member), np.int64), np.zeros(len(member), np.int64)
    for v in range(1, height):
        for u in range(1, width - 1):
            k = component[v, u]
            if k < 0 or not candidate[k]:
                continue
            if component[v - 1, u] == k and component[v, u - 1] == k and component[v, u + 1] == k:
                continue
            met = before = False
            for direction in range(_DIRECTIONS):
                angle = np.pi * direction / (_DIRECTIONS - 1)
                c, s = np.cos(angle), -np.sin(angle)
                hidden = unread = 0
                for step in range(1, _FARTHEST):
                    y, x = int(np.rint(v + step * s)), int(np.rint(u + step * c))
                    if y < 0 or x < 0 or x >= width:
                        break
                    j, z = component[y, x], depth[y, x]
                    if j == k:
                        break
                    if z == 0.0:
                        unread += 1
                        if unread > _UNREAD:
                            break
                    elif z < depth[v, u] - IN_FRONT and not (j >= 0 and member[j]):
                        hidden += 1
                        before = True
                    elif j >= 0 and member[j] and hidden > 0:
                        away = 0.0
                        for i in (0, 2):
                            away += (points[y, x, i] - points[v, u, i]) ** 2
                        met = away < _ASIDE**2
                        break
                    else:
                        break
                if met:
                    break
            count[k] += met
            beside[k] += before
    return beside, count


@njit(cache=True, nogil=True)
def _touch_kernel(component, candidate, points, seen, shown, flips, intrinsics, reach):
    """How many pixels of each ``candidate`` (C,) touch the figure, as a mirror shows it; how many something else.

    And how many were asked.
    """
    height, width = component.shape
    touches, others = np.zeros(len(candidate), np.int64), np.zeros(len(candidate), np.int64)
    asked = np.zeros(len(candidate), np.int64)
    for v in range(height):
        for u in range(width):
            k = component[v, u]
            if k < 0 or not candidate[k]:
                continue
            asked[k] += 1
            p = points[v, u]
            nearest, other = reach * reach, reach * reach
            for m in range(len(flips)):
                z = flips[m, 2, 0] * p[0] + flips[m, 2, 1] * p[1] + flips[m, 2, 2] * p[2] + flips[m, 2, 3]
                if z < _NEAREST:
                    continue
                x = flips[m, 0, 0] * p[0] + flips[m, 0, 1] * p[1] + flips[m, 0, 2] * p[2] + flips[m, 0, 3]
                y = flips[m, 1, 0] * p[0] + flips[m, 1, 1] * p[1] + flips[m, 1, 2] * p[2] + flips[m, 1, 3]
                column, row = (
                    int(np.rint(x / z * intrinsics[0] + intrinsics[2])),
                    int(np.rint(y / z * intrinsics[1] + intrinsics[3])),
                )
                radius = min(int(reach * intrinsics[0] / z) + 1, _WIDEST)
                for b in range(max(row - radius, 0), min(row + radius + 1, height)):
                    for a in range(max(column - radius, 0), min(column + radius + 1, width)):
                        if shown[b, a] < 0 or seen[b, a] != m + 1:
                            continue
                        away = 0.0
                        for i in range(3):
                            away += (points[b, a, i] - p[i]) ** 2
                        if shown[b, a] == 1:
                            nearest = min(nearest, away)
                        else:
                            other = min(other, away)
            if nearest < reach * reach and nearest <= other:
                touches[k] += 1
            elif other < reach * reach:
                others[k] += 1
    return touches, others, asked
