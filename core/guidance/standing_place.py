"""Where the subject would have to stand for all mirrors to show it whole: the nearest such place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..camera import Intrinsics
from ..checks.reflection_forecast import distance_past_edges
from ..checks.scene_advice import MAX_HIDDEN
from ..mirrors import Mirror
from ..mirrors.glass_extent import glass_corners
from ..mirrors.mirror import reflection_matrix
from ..numeric.point_products import dot
from ..subject.subject_views import Views
from .posture import level_right

_STEP, _FARTHEST = 0.1, 0.9  # between places that are tried, and the farthest of them [m]
_POINTS = 160  # of the subject, that stand for all
_SPARE = 0.015  # of the image's width and height that is left free around the subject
_ROOM = 0.02  # m of the glass that is left free around its reflection
_CELL = 6.0  # px: side of the squares in which what is hidden is counted
_OUTERMOST = 0.01  # share of the points, the outermost, that do not count
_NEAREST = 0.3  # m from the camera


def nearest_place(
    views: Views, mirrors: Sequence[Mirror], intrinsics: Intrinsics, most: float = np.inf
) -> np.ndarray | None:
    """The shortest step after which the image, and every glass, shows the subject whole.

    The subject's points are moved, and their reflections followed to glass and image, for places on a grid about it.

    Parameters
    ----------
    views : Views
        Of :func:`..subject.subject_search.find_subject`.
    mirrors : sequence of Mirror
    intrinsics : Intrinsics
        Of the image the views are of.
    most : float
        Longest way by a mirror at which the camera reads well [m].

    Returns
    -------
    np.ndarray [shape=(3,)] or None
        Level, camera frame [m]; zero where it stands well. None where it stands well nowhere near.
    """
    points = _body(views)
    if not len(points):
        return None
    steps, level = _steps(views)
    fits = _in_image(points[None] + steps[:, None], intrinsics, _SPARE)
    for mirror in mirrors:
        chosen = np.flatnonzero(fits)
        if not len(chosen):
            return None
        fits[chosen] = _shown(points, steps[chosen], mirror, intrinsics, most)
    if not fits.any():
        return None
    return steps[np.flatnonzero(fits)[np.argmin(level[fits])]]


def _body(views: Views) -> np.ndarray:
    """Some hundred points (N, 3) that stand for the subject, its feet among them."""
    mine = views.points[views.labels >= 0]
    points = mine[:: len(mine) // _POINTS + 1]
    if views.floor is None or not len(points):
        return points
    # where it is cut off by the image, its feet are on the floor all the same
    right = level_right(views.up, views.axis)
    foot = views.axis + (views.floor - views.axis @ views.up) * views.up
    return np.concatenate((points, foot + np.array((-0.12, 0.0, 0.12))[:, None] * right))


def _steps(views: Views) -> tuple[np.ndarray, np.ndarray]:
    """Level steps (K, 3) on a grid, none among them, and their lengths (K,) [m]."""
    right = level_right(views.up, views.axis)
    ahead = np.cross(views.up, right)
    count = int(round(_FARTHEST / _STEP))
    a, b = (x.ravel() * _STEP for x in np.mgrid[-count : count + 1, -count : count + 1])
    length = np.hypot(a, b)
    near = length <= _FARTHEST + 1e-9
    return a[near, None] * right + b[near, None] * ahead, length[near]


def _in_image(placed: np.ndarray, intrinsics: Intrinsics, spare: float = 0.0) -> np.ndarray:
    """Which sets of points (K, N, 3) lie within the image, with some of its size to spare, but for a hundredth."""
    u, v, ahead = _pixels(placed, intrinsics)
    wide, high = intrinsics.width - 1, intrinsics.height - 1
    x, y = spare * wide, spare * high
    inside = (u >= x) & (u <= wide - x) & (v >= y) & (v <= high - y) & ahead
    return inside.mean(axis=1) >= 1.0 - _OUTERMOST


def _shown(points: np.ndarray, steps: np.ndarray, mirror: Mirror, intrinsics: Intrinsics, most: float) -> np.ndarray:
    """After which steps (K,) a mirror shows the subject whole, not hidden by itself, and near enough."""
    flip = reflection_matrix(mirror)
    placed = points[None] + steps[:, None]
    reflected = placed @ flip[:3, :3].T + flip[:3, 3]
    share = (mirror.normal @ mirror.point) / dot(reflected, mirror.normal)
    on = reflected * share[..., None] - mirror.point
    shown = (share > 0).all(axis=1) & (share < 1).all(axis=1) & (np.median(reflected[..., 2], axis=1) < most)
    corners = glass_corners(mirror)
    if corners is not None:
        past = distance_past_edges(dot(on, mirror.basis[:, 0]), dot(on, mirror.basis[:, 1]), corners)
        inside = np.logical_and.reduce([side < -_ROOM for side in past.values()])
        shown &= inside.mean(axis=1) >= 1.0 - _OUTERMOST
    shown &= _in_image(reflected, intrinsics)
    chosen = np.flatnonzero(shown)
    shown[chosen] = _hidden(placed[chosen], reflected[chosen], intrinsics) < 0.5 * MAX_HIDDEN
    return shown


def _hidden(placed: np.ndarray, reflected: np.ndarray, intrinsics: Intrinsics) -> np.ndarray:
    """Share (K,) of reflections behind the subject itself, by squares of the image that both fall into."""
    columns, rows = int(intrinsics.width / _CELL) + 1, int(intrinsics.height / _CELL) + 1
    sets = np.arange(len(placed))[:, None]

    def squares(points: np.ndarray) -> np.ndarray:
        u, v, _ = _pixels(points, intrinsics)
        u, v = np.clip(u / _CELL, 0, columns - 1).astype(int), np.clip(v / _CELL, 0, rows - 1).astype(int)
        return (sets * rows + v) * columns + u

    taken = np.zeros(len(placed) * rows * columns, np.bool_)
    taken[squares(placed)] = True
    return taken[squares(reflected)].mean(axis=1)


def _pixels(points: np.ndarray, intrinsics: Intrinsics) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """u, v (K, N) [px] of points (K, N, 3), and which lie ahead of the camera."""
    ahead = points[..., 2] > _NEAREST
    z = np.where(ahead, points[..., 2], 1.0)
    k = intrinsics
    return points[..., 0] / z * k.fx + k.cx, points[..., 1] / z * k.fy + k.cy, ahead
