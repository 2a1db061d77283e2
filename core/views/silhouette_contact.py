"""Where silhouettes say a mirror is: what it shows of a body touches the outline that is seen directly.

Surface that the camera sees edge-on, where its silhouette of a body ends, a mirror at the body's side shows frontally.
Flipped over the right plane it just touches the outline; over a wrong one it stays inside, or the camera would look
through it. The same holds the other way round: what is seen directly touches the outline of the image. So a mirror's
yaw is known to a fraction of a pixel also where light that comes two ways has torn all skin that both views share.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..camera import Intrinsics
from ..camera.noise_models import SENSORS
from .view_correspondences import Surfaces

_CLEAR = 0.4  # a background is so much farther than the middle of a body [m]
_FRAYED = 4  # px without a reading at an outline, of which half belong to the body
_EDGE_ON, _SIDEWAYS = 0.4, 0.7  # cosines of a piece's normal with its line of sight, and with the rows
_ABOUT = 90  # px beside a body in which its background is looked for
_REACH = 25.0  # px from an outline in which a piece may be of it
_SHORT = 0.6  # px by which the last piece of a surface stays inside its outline
_SPREAD = 1.5  # px that pieces stray from it
_MOST_COST = 8.0  # of a row where a piece lies outside
_LEAST_JUMP, _LEAST_STEP = 0.3, 0.12  # of z [m] and of 1/z [1/m] beside a shadow
_LEAST_SHADOW, _MOST_SHADOW = 4.0, 60  # width of shadows, in the middle and at most [px]
_SHADOWED, _LEAST_SHADOWS = 0.3, 60  # share of the gaps without a reading that are shadows, and how many
_BASELINES = tuple(sorted({model.baseline for model in SENSORS.values()} - {0.0}))  # of depth cameras [m]


@dataclass(frozen=True)
class Outline:
    """The left and right ends of a body in each row, as far as a background beside it is read.

    Attributes
    ----------
    corner : tuple of int
        Column and row of the first pixel of the part of the picture, H rows and W columns, that is looked at.
    right, left : np.ndarray [shape=(H, W)]
        For each pixel where, along its row, the background begins to its right, and ends to its left [px].
    behind_left : np.ndarray [shape=(H, W)]
        1/z of that at the left [1/m].
    shadow : float
        Width of the shadow without a reading at the left of a body, per 1/m by which its background is farther [px m].
    """

    corner: tuple[int, int]
    right: np.ndarray
    left: np.ndarray
    behind_left: np.ndarray
    shadow: float


def shadow_width(depth: np.ndarray, focal: float) -> float:
    """:attr:`Outline.shadow` of the camera that took ``depth`` (H, W), z [m]: its ``focal`` length times its baseline.

    A camera that compares two views, or a view and a pattern, reads nothing where the second one, which all cameras
    have at their right as they look, does not reach. Which
    baseline it is the widths tell to a quarter only: that of a Kinect v1 is taken, since the others see enough skin
    twice. 0 where there is no such shadow, as with a camera that measures light's travel.
    """
    rows, columns = np.nonzero(depth > 0)
    z = depth[rows, columns].astype(np.float64)
    same = rows[1:] == rows[:-1]
    gap = (columns[1:] - columns[:-1] - 1)[same]
    left, right = z[:-1][same], z[1:][same]
    wide = (gap > 1) & (gap < _MOST_SHADOW) & (np.abs(left - right) > _LEAST_JUMP)
    gap, left, right = gap[wide], left[wide], right[wide]
    found = []
    for near, far in ((right, left), (left, right)):
        steps = 1.0 / near - 1.0 / far
        clear = steps > _LEAST_STEP
        found.append(_shadows(steps[clear], gap[clear], focal))
    return focal * SENSORS["kinect_v1"].baseline if found[0] > max(2 * found[1], _LEAST_SHADOWS) else 0.0


def _shadows(steps: np.ndarray, widths: np.ndarray, focal: float) -> int:
    """How many widths (N,) [px] are in proportion to ``steps`` (N,) [1/m], by the baseline of a camera that is known.

    None where they are even, as the frayed outlines of other cameras are.
    """
    if len(widths) < _LEAST_SHADOWS or np.median(widths) < _LEAST_SHADOW:
        return 0
    widest = focal * np.array(_BASELINES)[:, None] * steps
    count = int((np.abs(widest - widths) <= 2.0).sum(axis=1).max())
    return count if count > _SHADOWED * len(widths) else 0


def outline_of(depth: np.ndarray, body: np.ndarray, shadow: float, frayed: int = _FRAYED) -> Outline:
    """The outline of the pixels ``body`` (H, W) bool before what is read farther off in ``depth`` (H, W), z [m].

    Of up to ``frayed`` pixels without a reading between both half belong to the body, of more all.
    """
    background = float(np.median(depth[body])) + _CLEAR
    rows, columns = np.flatnonzero(body.any(axis=1)), np.flatnonzero(body.any(axis=0))
    top, bottom = rows[0], rows[-1] + 1
    left, right = max(columns[0] - _ABOUT, 0), columns[-1] + 1 + _ABOUT
    depth, body = depth[top:bottom, left:right], body[top:bottom, left:right]
    height, width = depth.shape
    index = np.arange(width, dtype=np.int32)

    def following(mask: np.ndarray, none: int) -> np.ndarray:
        at = np.where(mask, index, np.int32(none))
        return np.minimum.accumulate(at[:, ::-1], axis=1)[:, ::-1]

    def preceding(mask: np.ndarray, none: int) -> np.ndarray:
        return np.maximum.accumulate(np.where(mask, index, np.int32(none)), axis=1)

    free = depth > background
    rows = np.arange(height)[:, None]
    inverse = np.where(depth > 0, 1.0 / np.maximum(depth, 1e-3), 0.0)
    # frayed ends without a reading: half of them are the body's
    known = free | body
    before, after = preceding(known, -1), following(known, width)
    shared = ~known & (before >= 0) & (after < width) & (after - before <= frayed + 1)
    v, u = np.nonzero(shared)
    before, after = before[v, u], after[v, u]
    at_left, at_right = free[v, before], free[v, after]
    halved = (at_left & ~at_right & (2 * u < before + after)) | (at_right & ~at_left & (2 * u > before + after))
    v, u, whose = v[halved], u[halved], np.where(at_right, after, before)[halved]
    free[v, u], inverse[v, u] = True, inverse[v, whose]
    shadow = shadow if _casts_shadow(body, free, inverse, shadow) else 0.0
    first = np.where(free, preceding(~free, -width) + 1, following(free, 2 * width))
    last = np.where(free, following(~free, 2 * width) - 1, preceding(free, -width))
    behind = inverse[rows, np.clip(last, 0, width - 1)]
    return Outline((int(left), int(top)), first + (left - 0.5), last + (left + 0.5), behind, shadow)


def _casts_shadow(body: np.ndarray, free: np.ndarray, inverse: np.ndarray, shadow: float) -> bool:
    """Whether so much more is unread at a body's left than at its right as its shadow is wide.

    Edges of bodies are lost also where light comes two ways, at both sides.
    """
    rows = np.flatnonzero(body.any(axis=1) & free.any(axis=1))
    if not shadow or not len(rows):
        return False
    width, index = body.shape[1], np.arange(body.shape[1])
    left, right = body[rows].argmax(axis=1), width - 1 - body[rows, ::-1].argmax(axis=1)
    before = np.where(free[rows] & (index < left[:, None]), index, -1).max(axis=1)
    after = np.where(free[rows] & (index > right[:, None]), index, 2 * width).min(axis=1)
    seen = (before >= 0) & (after < width)
    if seen.sum() < _LEAST_SHADOWS // 3:
        return False
    expected = shadow * (inverse[rows, left] - inverse[rows, np.maximum(before, 0)])
    more = (left - before) - (after - right)
    return bool(np.median(more[seen]) > 0.4 * np.median(expected[seen]))


def edge_on(shown: Surfaces, flip: np.ndarray) -> Surfaces:
    """Those pieces of a surface that another view may see edge-on, with ``flip`` about right."""
    q, normals = _flipped(shown, flip)
    return _some(shown, _is_edge_on(q, normals, 1.4 * _EDGE_ON, 0.85 * _SIDEWAYS))


def _some(shown: Surfaces, which: np.ndarray) -> Surfaces:
    return replace(shown, points=shown.points[which], normals=shown.normals[which])


def _flipped(shown: Surfaces, flip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return shown.points @ flip[:3, :3].T + flip[:3, 3], shown.normals @ flip[:3, :3].T


def _is_edge_on(q: np.ndarray, normals: np.ndarray, edge: float, sideways: float) -> np.ndarray:
    along = np.abs(np.einsum("nc,nc->n", normals, q)) < edge * np.sqrt(np.einsum("nc,nc->n", q, q))
    return along & (np.abs(normals[:, 0]) > sideways) & (q[:, 2] > 0.1)


class Contacts(NamedTuple):
    """The outermost pieces of a surface beside an outline, one in each row and at each side of the body.

    ``gaps`` (K,): how far inside the outline each lies, negative outside [px]; ``pieces`` (K,) their indices;
    ``rows`` (K,) of the picture; ``rightward`` (K,) bool, at the right side.
    """

    gaps: np.ndarray
    pieces: np.ndarray
    rows: np.ndarray
    rightward: np.ndarray


def contacts(shown: Surfaces, flip: np.ndarray, outline: Outline, intrinsics: Intrinsics) -> Contacts:
    """Where a surface touches an outline, or should.

    Parameters
    ----------
    shown : Surfaces
        Of one view; only pieces that the other sees edge-on count.
    flip : np.ndarray [shape=(4, 4)]
        From where the camera sees the one view's pieces to where it would see them in the other.
    outline : Outline
        Of the body in the other view.
    """
    q, normals = _flipped(shown, flip)
    index = np.flatnonzero(_is_edge_on(q, normals, _EDGE_ON, _SIDEWAYS))
    q, rightward = q[index], normals[index, 0] > 0.0
    u, v = q[:, 0] / q[:, 2] * intrinsics.fx + intrinsics.cx, q[:, 1] / q[:, 2] * intrinsics.fy + intrinsics.cy
    column, row = np.rint(u).astype(np.int64) - outline.corner[0], np.rint(v).astype(np.int64) - outline.corner[1]
    inside = (column >= 0) & (row >= 0) & (column < outline.right.shape[1]) & (row < outline.right.shape[0])
    column, row, u, rightward, z = column[inside], row[inside], u[inside], rightward[inside], q[inside, 2]
    index = index[inside]
    widths = np.where(rightward, 0.0, outline.shadow * np.maximum(1.0 / z - outline.behind_left[row, column], 0.0))
    gaps = np.where(rightward, outline.right[row, column] - u, u - outline.left[row, column]) - widths - _SHORT
    near = np.abs(gaps) < _REACH
    gaps, line, index = gaps[near], 2 * row[near] + rightward[near], index[near]
    order = np.lexsort((gaps, line))
    order = order[np.diff(line[order], prepend=-1) != 0]
    return Contacts(gaps[order], index[order], line[order] // 2 + outline.corner[1], line[order] % 2 == 1)


def contact(shown: Surfaces, flip: np.ndarray, outline: Outline, intrinsics: Intrinsics) -> np.ndarray:
    """How far inside of the outline, in each row and at each side, the outermost piece lies [px]: (K,)."""
    return contacts(shown, flip, outline, intrinsics).gaps


def contact_cost(gaps: np.ndarray) -> float:
    """How badly :func:`contact` fits, in units of a log likelihood: outside is unlikely, far inside proves nothing."""
    relative = gaps / _SPREAD
    nothing = np.log1p((_REACH / _SPREAD) ** 2)
    cost = np.where(gaps < 0.0, np.minimum(0.5 * relative**2, _MOST_COST), np.log1p(relative**2))
    return float((cost - 0.5 * nothing).sum())


def contact_slope(before: np.ndarray, after: np.ndarray, step: float) -> float:
    """How fast the outermost pieces move with a mirror's yaw [px/rad], by the medians of gaps ``step`` [rad] apart."""
    near = [gaps[np.abs(gaps) < 4.0 * _SPREAD] for gaps in (before, after)]
    if min(map(len, near)) < 5:
        return 0.0
    return abs(float(np.median(near[1]) - np.median(near[0]))) / step
