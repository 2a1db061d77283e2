"""Components seen in mirrors that are the subject: those that the direct view does not deny."""

from __future__ import annotations

import numpy as np
from numba import njit

from .connected_pixels import connected_pixels, gap_kernel, member_table
from .direct_subject import PIECE

_CONFIRMED = 0.25  # m
_STEPS = 0.026  # a far sensor counts in steps: pieces may be so much of z apart
_THICK = 0.12  # m: what is seen so little behind something else is its other side
_LOOSE = 0.15  # of what a mirror shows of the subject: a larger piece that the direct view does not show is none
_DENIED, _HARDLY = 0.1, 0.15  # of a piece: furniture, that the direct view shows the front of
_TIGHT = 0.5  # of the depth jump that parts a figure from the room


@njit(cache=True, nogil=True)
def verdict_kernel(
    component, count, seen, points, depth, labels, others, lens, wide, axis, across, reach2, up, heights, deepest
):
    """What the direct view says of each standing pixel of a mirror: 2 the subject's, 1 it hides behind the subject, 0
    cannot tell, -1 not the subject's; -2 elsewhere. And how many of each (4, C) a component has, 2 first.

    ``wide`` is the directly seen outline, grown; ``others``: where somebody or something else is seen to stand.
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
                if p[2] > 0.05:
                    row = int(np.floor(p[1] / p[2] * lens[1] + lens[3] + 0.5))
                    column = int(np.floor(p[0] / p[2] * lens[0] + lens[2] + 0.5))
                    if 0 <= row < height and 0 <= column < width:
                        if labels[row, column] == 0:
                            # behind the subject's front; too far behind it is something that the subject hides
                            verdict = 1 if p[2] - depth[row, column] > deepest else 2
                        elif not wide[row, column] and depth[row, column] > p[2] - 0.05:
                            verdict = -1
                        elif others[row, column] and -0.05 < p[2] - depth[row, column] < _THICK:
                            verdict = -1  # the other side of that
            out[v, u] = verdict
            votes[2 - verdict, component[v, u]] += 1
    return out, votes


def label_mirrored_subject(
    depth: np.ndarray,
    component: np.ndarray,
    member: np.ndarray,
    verdict: np.ndarray,
    votes: np.ndarray,
    seen: np.ndarray,
    points: np.ndarray,
    pixel_angle: float,
    labels: np.ndarray,
    views: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Label the mirrors' components that the direct view does not deny, and where it does not those of a ``member``;
    how many pixels (views,) each view has, and which components (C,) are the figure."""
    yes, hidden, unsure, no = votes
    told = yes + hidden + no
    chosen = (yes + unsure >= 30) & (yes > 0.6 * told) & (yes > 0.25 * (told + unsure))
    chosen |= member
    _deny_furniture(depth, component, chosen & (no >= PIECE), verdict, seen, pixel_angle)
    taken = _take_kernel(component, chosen, verdict, seen, labels, views)
    if not chosen.any():
        return taken, chosen
    mine = labels > 0
    # right at the figure: what the direct view cannot see, a foot behind a chair's leg; and of what is denied as a
    # whole the part that it confirms, a foot that touches the chair
    small = (told + unsure < _LOOSE * taken.max()) | (yes > unsure)
    loose = ~chosen & small & (yes + unsure >= PIECE) & (yes + unsure > 0.7 * (told + unsure))
    loose &= ~_is_furniture(yes, no, told + unsure)
    mixed = ~chosen & ~loose & (yes >= PIECE)
    if not loose.any() and not mixed.any():
        return taken, chosen
    pieces = _pieces_beside(component, loose, mixed, verdict, seen)
    part, sizes = connected_pixels(depth, pieces, pixel_angle)
    count = len(sizes)
    part[mine] = count
    member, near = member_table(np.array([count]), count + 1), np.append(sizes >= PIECE, False)
    gap = gap_kernel(part, member, near, points, np.append(sizes, 0), _CONFIRMED / pixel_angle)
    distance, sure = _piece_kernel(part, verdict, depth, count + 1)
    # what the direct view confirms, be it in part, may be far off: a foot below a chair's seat, a heel behind its leg
    joined = near & (gap < np.where(sure > 0.0, _CONFIRMED, np.maximum(0.05, _STEPS * distance)))
    return taken + _take_kernel(part, joined, verdict, seen, labels, views), chosen


def _is_furniture(yes: np.ndarray, no: np.ndarray, total: np.ndarray) -> np.ndarray:
    """Of what a mirror shows that the direct view confirms hardly anywhere, what it denies in part: the other side of
    a box that is seen directly, of which all that is deeper is hidden behind its front."""
    return (no >= np.maximum(PIECE, _DENIED * total)) & (yes < _HARDLY * total)


def _deny_furniture(depth, component, mixed, verdict, seen, pixel_angle) -> None:
    """What is connected with the figure (``mixed`` components) across a small jump only is judged by itself, in
    ``verdict``."""
    if not mixed.any():
        return
    table = np.append(mixed, False)
    part, sizes = connected_pixels(depth, np.where(table[component], seen, -1).astype(np.int8), pixel_angle, _TIGHT)
    rows, columns = np.nonzero(part >= 0)
    piece, told = part[rows, columns], verdict[rows, columns]
    yes, no = (np.bincount(piece, told == value, len(sizes)) for value in (2, -1))
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
    total, sure, pixels = np.zeros(count), np.zeros(count), np.zeros(count)
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            k = component[v, u]
            if k >= 0:
                total[k] += depth[v, u]
                sure[k] += verdict[v, u] == 2
                pixels[k] += 1.0
    pixels = np.maximum(pixels, 1.0)
    return total / pixels, sure / pixels


@njit(cache=True, nogil=True)
def _take_kernel(component, chosen, verdict, seen, labels, views):
    taken = np.zeros(views, np.int64)
    for v in range(component.shape[0]):
        for u in range(component.shape[1]):
            if verdict[v, u] >= 0 and chosen[component[v, u]]:
                labels[v, u] = seen[v, u]
                taken[seen[v, u]] += 1
    return taken
