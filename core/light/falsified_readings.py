"""Readings that are left out: another view contradicts them, or the light of two ways made them up."""

from __future__ import annotations

import numpy as np

from .evidence import GHOST
from .irradiance import path_lengths, seen_at, through_glass
from .limb_correction import DEVIATIONS, Corrected, reading_noise
from .lit_scene import LitScene, grown, shifted
from .outer_readings import standing_out

_ON_FLOOR, _LOW = 0.03, 0.2  # so near the floor a reading is the floor's; so low a misread one seems to be [m]
_IN_FRONT = 0.006, 0.0015  # so far in front of what another view sees a reading is wrong [m], and times z
_TOGETHER = 4  # of 3 x 3 readings that are left out, so many are no noise


def without_contradicted(scene: LitScene, limbs: Corrected) -> np.ndarray:
    """The trusted readings (H, W) that neither another view nor the surface farther inside contradicts."""
    trusted = limbs.trusted & ~contradicted(scene, limbs.depth, limbs.trusted, limbs.edge)
    trusted &= ~standing_out(scene, limbs.depth, trusted)
    # where a mirror's reading borders on some that are left out, it is half wrong itself; one alone is noise
    left_out = (scene.labels > 0) & ~trusted
    together = sum(shifted(left_out.astype(np.int8), dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1))
    return trusted & ~((scene.labels > 0) & grown(left_out & (together >= _TOGETHER), 1))


def contradicted(scene: LitScene, depth: np.ndarray, trusted: np.ndarray, edge: np.ndarray) -> np.ndarray:
    """Trusted pixels (H, W) in front of what another view sees there.

    That is skin nearer to the middle of a limb, or the floor.
    """
    rows, columns = np.nonzero(trusted)
    view = scene.labels[rows, columns].astype(np.intp)
    points = scene.place(rows, columns, depth[rows, columns].astype(np.float64), view)
    noise = np.zeros(depth.shape, np.float32)
    noise[rows, columns] = reading_noise(scene, rows, columns)
    bad = np.zeros(len(rows), np.bool_)
    for other in range(len(scene.sources)):
        y, x, z, inside = seen_at(points, other, scene.mirrors, scene.intrinsics)
        inside &= view != other
        if other > 0:
            inside &= through_glass(points, scene.mirrors[other - 1])
        slack = _IN_FRONT[0] + _IN_FRONT[1] * z + DEVIATIONS * np.hypot(noise[rows, columns], noise[y, x])
        before = inside & (depth[y, x] > z + slack)
        bad |= before & trusted[y, x] & (scene.labels[y, x] == other) & (edge[rows, columns] > edge[y, x])
        if other == 0 and scene.views.floor is not None:
            floor = (scene.views.seen == 0) & (scene.labels < 0) & (np.abs(scene.heights) < _ON_FLOOR)
            on_floor = ~grown(~floor, 1)
            low = points @ scene.views.up - scene.views.floor < _LOW
            bad |= before & low & on_floor[y, x] & (depth[y, x] > z + 2.0 * _ON_FLOOR)
    marked = np.zeros(depth.shape, np.bool_)
    marked[rows[bad], columns[bad]] = True
    return grown(marked, 1)


def ghosts(scene: LitScene, depth: np.ndarray, trusted: np.ndarray) -> np.ndarray:
    """Readings (H, W) of no view that lie in the middle between both ways to skin which another view shows."""
    rows, columns = np.nonzero((scene.labels >= 0) & (scene.depth > 0))
    surface = scene.surface(depth, trusted, rows, columns)
    light, _ = scene.light(surface.points, surface.normals, surface.view)
    marked = np.zeros(depth.shape, np.bool_)
    for view in range(len(scene.sources)):
        ghost = np.zeros(depth.shape, np.float32)
        for other in range(len(scene.sources)):
            if other == view:
                continue
            mine = np.flatnonzero((surface.z > 0) & (surface.view == other) & (light[:, view] > 0))
            points = surface.points[mine]
            lengths = path_lengths(points, scene.sources[[view, other]])
            y, x, z, inside = seen_at(points, view, scene.mirrors, scene.intrinsics)
            ghost[y[inside], x[inside]] = (0.5 * z * (1.0 + lengths[:, 1] / lengths[:, 0]))[inside]
        rows, columns = np.nonzero(ghost)
        middle = ghost[rows, columns]
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                y, x = rows + dy, columns + dx
                inside = (y >= 0) & (y < depth.shape[0]) & (x >= 0) & (x < depth.shape[1])
                y, x = y[inside], x[inside]
                near = (depth[y, x] > 0) & (np.abs(depth[y, x] - middle[inside]) < GHOST)
                marked[y[near], x[near]] = True
    return marked & (scene.labels < 0)
