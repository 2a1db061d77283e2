"""Readings in mirrors that stand out before the surface farther inside, right beside skin that is not read."""

from __future__ import annotations

import numpy as np

from .limb_correction import DEVIATIONS, reading_noise
from .lit_scene import LitScene, grown

_OUTER = 3  # so near to what is not trusted, readings are held against the surface farther inside [px]
_LEAST = 0.006  # a reading that stands out by less is not doubted [m]
_ALONG = 2  # so many readings above and below count with each: edges of limbs run downwards [px]


def standing_out(scene: LitScene, depth: np.ndarray, trusted: np.ndarray) -> np.ndarray:
    """Trusted readings in mirrors (H, W) in front of the plane that touches the surface farther inside.

    Light of a second way grows towards the edge of a limb. It bends the surface towards the viewer bit by bit: no
    reading lies far off those beside it, and the bent surface seems to turn away from that light, so that none is
    predicted. But a limb lies behind every plane that touches it.
    """
    mirrored = trusted & (scene.labels > 0)
    inner = ~grown(~mirrored, _OUTER)
    rows, columns = np.nonzero(mirrored & ~inner)
    inside = nearest_inside(inner, scene.labels, rows, columns)
    rows, columns, inside = rows[inside >= 0], columns[inside >= 0], inside[inside >= 0]
    where, touching = np.unique(inside, return_inverse=True)
    surface = scene.surface(depth, inner, where // depth.shape[1], where % depth.shape[1])
    view = scene.labels[rows, columns].astype(np.intp)
    points = scene.place(rows, columns, depth[rows, columns].astype(np.float64), view)
    rays = points - scene.sources[view]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    normals = surface.normals[touching]
    steepness = np.einsum("ij,ij->i", normals, rays)
    before_plane = np.einsum("ij,ij->i", normals, points - surface.points[touching])
    known = (surface.z[touching] > 0) & (steepness < 0)
    rows, columns = rows[known], columns[known]
    mean = _mean_along(rows, columns, -before_plane[known] / steepness[known], depth.shape)
    marked = np.zeros(depth.shape, np.bool_)
    marked[rows, columns] = mean > np.maximum(DEVIATIONS * reading_noise(scene, rows, columns), _LEAST)
    return marked


def nearest_inside(inner: np.ndarray, labels: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Flat index (N,) of the pixel of ``inner`` (H, W) nearest to some pixels and of the same view; -1 = none near."""
    height, width = inner.shape
    steps = range(-_OUTER - 1, _OUTER + 2)
    index = np.full(len(rows), -1)
    for dy, dx in sorted(((y, x) for y in steps for x in steps), key=lambda step: step[0] ** 2 + step[1] ** 2):
        y, x = np.clip(rows + dy, 0, height - 1), np.clip(columns + dx, 0, width - 1)
        new = (index < 0) & inner[y, x] & (labels[y, x] == labels[rows, columns])
        index[new] = (y * width + x)[new]
    return index


def _mean_along(rows: np.ndarray, columns: np.ndarray, values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Mean of the values (N,) of each pixel and of those just above and below it."""
    total, count = np.zeros((shape[0] + 2 * _ALONG, shape[1])), np.zeros((shape[0] + 2 * _ALONG, shape[1]))
    for down in range(2 * _ALONG + 1):
        total[rows + down, columns] += values
        count[rows + down, columns] += 1.0
    return (total / np.maximum(count, 1.0))[rows + _ALONG, columns]
