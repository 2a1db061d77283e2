"""The floor where light reaches it two ways: what its readings tell of the camera, and their correction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera import project
from .irradiance import ratio_to_own, through_glass
from .lit_scene import LitScene, ray_lengths
from .phase_response import CORRECTABLE, NOTICEABLE, UNLEARNT, PhaseResponse, fit_response, predicted_bias

_MODERATE = 0.6  # ratio up to which a floor reading tells how the camera mixes two ways
_FLOOR_SAMPLE = 1500  # floor readings that the response is fitted to
_FLOOR_PIXELS = 90_000  # of the image in which the floor is looked for
_FLOOR_BAND = 0.08  # so far from the floor a reading may be the floor's, misread [m]
_FLOOR_GRAZING = 0.12  # sine of the ray's angle to the floor, below which it is not judged
_FARTHEST_FLOOR, _ABOUT_FEET = 8.0, 1.4  # from the camera, and about the subject [m]
_ENOUGH_FLOOR = 4000  # readings
_IN_SIGHT = 0.05  # z of corners that have a place in the image [m]


@dataclass(frozen=True)
class Floor:
    """What the floor's readings say: the response that they show, and which share of their bias it explains."""

    response: PhaseResponse
    explained: float


def floor_readings(scene: LitScene, noise: float) -> Floor | None:
    """The floor's readings that light reaches two ways, and the response they show."""
    views = scene.views
    if views.floor is None:
        return None
    skipped = max(int(np.sqrt(scene.depth.size / _FLOOR_PIXELS)), 1)
    few = np.s_[::skipped, ::skipped]
    height = scene.heights[few]
    rows, columns = np.nonzero((views.seen[few] == 0) & (scene.labels[few] < 0) & (np.abs(height) < _FLOOR_BAND))
    if len(rows) < _FLOOR_SAMPLE // 10:
        return None
    offset, points = height[rows, columns], views.points[few][rows, columns]
    flat = points - points @ views.up[:, None] * views.up
    grazing = np.abs(points @ views.up) / np.linalg.norm(points, axis=1)
    normals = np.broadcast_to(views.up, points.shape)
    own = np.zeros(len(rows), np.intp)
    light, lengths = scene.light(points, normals, own)
    ratio = ratio_to_own(light, own)
    total, seen_well = ratio.sum(axis=1), grazing > _FLOOR_GRAZING
    east = np.cross(views.up, (0.0, 0.0, 1.0))
    x, y = flat @ east, flat @ np.cross(east, views.up)
    shape = np.column_stack((np.ones(len(x)), x, y, x * x, x * y, y * y))
    clean = np.flatnonzero((total < 0.003) & seen_well)
    lit = np.flatnonzero((total > NOTICEABLE / 2) & (total < _MODERATE) & seen_well)
    if min(len(clean), len(lit)) < _FLOOR_SAMPLE // 10:
        return None
    clean = clean[:: max(len(clean) // _FLOOR_SAMPLE, 1)]
    lit = lit[:: max(len(lit) // _FLOOR_SAMPLE, 1)]
    form = _robust_fit(shape[clean], offset[clean])
    slant = (points @ views.up) / np.linalg.norm(points, axis=1)  # height gained a metre of ray
    bias = (offset - shape @ form) / slant
    noise = max(noise, 1.4826 * float(np.median(np.abs(bias[clean]))))
    response, explained = fit_response(
        ratio[lit][:, 1:], lengths[lit][:, 1:] - lengths[lit][:, :1], bias[lit], noise,
        shape[lit] / slant[lit, None],
    )  # fmt: skip
    return Floor(response, explained)


def correct_floor(scene: LitScene, response: PhaseResponse | None, depth: np.ndarray, spoiled: np.ndarray) -> None:
    """Correct or mark the floor's readings in ``depth`` and ``spoiled``, as they are seen directly and in mirrors.

    What a mirror shows of it is found by its ray, wherever the reading is.
    """
    views = scene.views
    if views.floor is None:
        return
    for view in range(len(scene.sources)):
        rows, columns = _maybe_floor(scene, depth, view)
        to_floor = floor_distance(scene, rows, columns, view)
        some = np.isfinite(to_floor)
        if view == 0:
            away = views.points[rows, columns] - views.axis
            far = some & ((away**2).sum(axis=1) - (away @ views.up) ** 2 > _ABOUT_FEET**2)
            if (some & ~far).sum() > _ENOUGH_FLOOR:  # then nobody needs what is farther
                spoiled[rows[far], columns[far]] = True
                some &= ~far
        rows, columns, z = rows[some], columns[some], to_floor[some]
        own = np.full(len(rows), view, np.intp)
        points = scene.place(rows, columns, z, own)
        if view > 0:
            shown = through_glass(points, scene.mirrors[view - 1])
            rows, columns, own, points = rows[shown], columns[shown], own[shown], points[shown]
        light, lengths = scene.light(points, np.broadcast_to(views.up, points.shape), own)
        ratio = ratio_to_own(light, own)
        total = ratio.sum(axis=1)
        if view > 0:  # what a mirror shows of the floor need not be corrected
            lost = total > UNLEARNT
            spoiled[rows[lost], columns[lost]] = True
            continue
        known = np.ones(len(rows), np.bool_)
        predicted, uncertain = predicted_bias(response, ratio, lengths - lengths[:, :1], known)
        lost = (uncertain > CORRECTABLE) | (total > _MODERATE)
        spoiled[rows[lost], columns[lost]] = True
        kept = ~lost & (predicted != 0)
        rows, columns = rows[kept], columns[kept]
        change = predicted[kept] / ray_lengths(rows, columns, scene.intrinsics)
        depth[rows, columns] -= change.astype(np.float32)


def _maybe_floor(scene: LitScene, depth: np.ndarray, view: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of readings, not the subject's, seen about the floor, or anywhere about a mirror's glass."""
    if view == 0:
        near_floor = np.abs(scene.heights) < _FLOOR_BAND
        rows, columns = np.nonzero(near_floor & (scene.labels < 0) & (depth > 0) & (scene.views.seen == 0))
        return rows, columns
    mirror, (height, width) = scene.mirrors[view - 1], depth.shape
    top, bottom, left, right = 0, height, 0, width
    if mirror.rectangle is not None:
        corners = np.array([(a, b) for a in mirror.rectangle[0] for b in mirror.rectangle[1]])
        places = mirror.point + corners @ mirror.basis[:, :2].T
        if places[:, 2].min() > _IN_SIGHT:
            u, v = project(places, scene.intrinsics).T
            top, bottom = np.clip((int(v.min()), int(v.max()) + 2), 0, height)
            left, right = np.clip((int(u.min()), int(u.max()) + 2), 0, width)
    box = np.s_[top:bottom, left:right]
    rows, columns = np.nonzero((scene.labels[box] < 0) & (depth[box] > 0))
    return rows + top, columns + left


def floor_distance(scene: LitScene, rows: np.ndarray, columns: np.ndarray, view: int) -> np.ndarray:
    """The z (N,) at which the rays of some pixels meet the floor as a view shows it [m]; infinite if they don't."""
    assert scene.views.floor is not None
    up, height = scene.views.up, scene.views.floor
    if view > 0:  # the mirror's image of the floor
        mirror = scene.mirrors[view - 1]
        height = height - 2.0 * (mirror.point @ mirror.normal) * (mirror.normal @ up)
        up = up - 2.0 * (mirror.normal @ up) * mirror.normal
    x, y = (columns - scene.intrinsics.cx) / scene.intrinsics.fx, (rows - scene.intrinsics.cy) / scene.intrinsics.fy
    fall = up[0] * x + up[1] * y + up[2]
    with np.errstate(divide="ignore"):
        z = height / fall
    return np.where((z > 0) & (z < _FARTHEST_FLOOR), z, np.inf)


def _robust_fit(shape: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Coefficients of ``shape`` (N, D) that fit values (N,), those far off left out."""
    form = np.linalg.lstsq(shape, values, rcond=None)[0]
    for _ in range(3):
        rest = np.abs(values - shape @ form)
        near = rest <= 3.0 * 1.4826 * max(float(np.median(rest)), 1e-6)
        form = np.linalg.lstsq(shape[near], values[near], rcond=None)[0]
    return form
