"""The table or plinth that an object stands on."""

from __future__ import annotations

import numpy as np

from ..numeric.kernels import njit
from ..numeric.point_products import dot
from .connected_pixels import Readings

_PLAN_CELL = 0.025  # of the plan [m]
_LEVEL = 0.03  # a level surface's readings are within this of it [m]
_ROUNDED = 0.35  # a rounded back has more than this share of its top's plan again right below it
_BESIDE = 4  # cells on each side of what stands on it in which a support goes on
_BREADTH = 0.045  # a handle or a back of rods is nowhere so broad [m]


def find_support(
    readings: Readings,
    figure: np.ndarray,
    floor: float | None,
    least: int,
    between: tuple[float, float] = (0.15, np.inf),
    smallest: float = 0.016,
) -> float | None:
    """Height along the vertical of the table or plinth that an object stands on; None when it stands on the floor.

    A support is a level surface, ``between`` so high above the floor, that ends in edges (an animal's back is rounded)
    and goes on in front of, behind and beside what stands on it (a chair's seat ends at its back). What stands on it is
    broader than a handle. Of several the largest counts.

    Parameters
    ----------
    readings : Readings
    figure : np.ndarray [shape=(H, W), dtype=bool]
        Where the object and what it stands on is seen, in any view.
    floor : float or None
        Height of the floor [m].
    least : int
        Pixels that an object has.
    between : tuple of float
        What is lower is the object's own foot [m].
    smallest : float
        Of a support, beside what stands on it [m²].

    Returns
    -------
    float or None
        [m]

    Notes
    -----
    O(H W).
    """
    points, up = readings.points, readings.up
    mine = points[figure]
    height = dot(mine, up)
    away = np.median(mine, axis=0)
    away -= (away @ up) * up
    away /= np.linalg.norm(away)
    low, high, cell = _plan_kernel(mine, height, np.cross(up, away), away)
    lowest = height.min() if floor is None else floor
    tops = high[(high > lowest + between[0]) & (high < lowest + between[1] + _LEVEL)]
    if len(tops) * _PLAN_CELL**2 < smallest:
        return None
    base = tops.min()
    bins = np.convolve(np.bincount(np.floor((tops - base) / 0.01).astype(np.int64)), np.ones(3), mode="same")
    thin = np.where(low <= high, high, np.inf) - np.where(low <= high, low, 0.0) < 2.0 * _LEVEL
    while bins.max() * _PLAN_CELL**2 >= smallest:
        best = int(np.argmax(bins))
        top = base + (best + 0.5) * 0.01
        # a cell's highest reading is off by its noise
        at = float(np.median(height[np.abs(height - top + 0.01) < _LEVEL]))

        def reached(lower: float, upper: float, at: float = at) -> np.ndarray:
            """Cells with readings between two heights above the level."""
            some = cell[(height > at + lower) & (height < at + upper)]
            return np.bincount(some, minlength=low.size).reshape(low.shape) > 0

        surface = reached(-0.5 * _LEVEL, 0.5 * _LEVEL) & (high < at + _LEVEL)
        rounded = thin & (np.abs(high - at + 2.0 * _LEVEL) < _LEVEL)
        enough = surface.sum() * _PLAN_CELL**2 >= smallest and rounded.sum() <= _ROUNDED * surface.sum()
        if enough and _goes_on(surface, reached(_LEVEL, 2.0 * _LEVEL)):
            pixels, breadth = _breadth_kernel(points, figure & (readings.seen == 0), up, at + _LEVEL)
            if pixels >= least and breadth * readings.pixel_angle > _BREADTH:
                found = float(np.median(height[np.abs(height - at) < 0.5 * _LEVEL]))
                return found if between[0] < found - lowest < between[1] else None
        bins[max(best - 3, 0) : best + 4] = 0.0
    return None


def _goes_on(surface: np.ndarray, touching: np.ndarray) -> bool:
    """Whether a level ``surface`` (A, B) goes on about what is right above it, in front of, behind and beside it."""
    if not touching.any():
        return False
    a, b = np.nonzero(touching)
    (a0, a1), (b0, b1) = np.quantile(a, (0.02, 0.98)).astype(int), np.quantile(b, (0.02, 0.98)).astype(int)
    left = surface[max(a0 - _BESIDE, 0) : a0, max(b0 - 1, 0) : b1 + 2]
    right = surface[a1 + 1 : a1 + 1 + _BESIDE, max(b0 - 1, 0) : b1 + 2]
    # to whichever side: what is right behind it is often not read
    front, rear = surface[:, max(b0 - _BESIDE, 0) : b0], surface[:, b1 + 1 : b1 + 1 + _BESIDE]
    return min(max(left.sum(), right.sum()), front.sum(), rear.sum()) >= 3


@njit(cache=True, nogil=True)
def _plan_kernel(points, height, side, away):
    """Lowest and highest point of each cell (A, B) of the plan along ``side`` and ``away``; the cell of each point."""
    count = len(points)
    plan = np.empty((count, 2))
    least, most = np.full(2, np.inf), np.full(2, -np.inf)
    for i in range(count):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        plan[i, 0] = side[0] * x + side[1] * y + side[2] * z
        plan[i, 1] = away[0] * x + away[1] * y + away[2] * z
        for c in range(2):
            least[c], most[c] = min(least[c], plan[i, c]), max(most[c], plan[i, c])
    # what goes on for longer than 10 m is a room
    across, along = (
        min(int((most[0] - least[0]) / _PLAN_CELL), 399) + 1,
        min(int((most[1] - least[1]) / _PLAN_CELL), 399) + 1,
    )
    low, high = np.full((across, along), np.inf), np.full((across, along), -np.inf)
    cell = np.empty(count, np.int64)
    for i in range(count):
        a = min(int((plan[i, 0] - least[0]) / _PLAN_CELL), across - 1)
        b = min(int((plan[i, 1] - least[1]) / _PLAN_CELL), along - 1)
        low[a, b], high[a, b] = min(low[a, b], height[i]), max(high[a, b], height[i])
        cell[i] = a * along + b
    return low, high, cell


@njit(cache=True, nogil=True)
def _breadth_kernel(points, figure, up, least):
    """Pixels of the figure above a height, and the side of the largest square that they fill, times its z [px m]."""
    height, width = figure.shape
    side = np.zeros((height + 1, width + 1), np.int32)
    pixels, breadth = 0, 0.0
    for v in range(height):
        for u in range(width):
            if not figure[v, u]:
                continue
            p = points[v, u]
            if p[0] * up[0] + p[1] * up[1] + p[2] * up[2] > least:
                side[v + 1, u + 1] = 1 + min(side[v, u + 1], side[v + 1, u], side[v, u])
                pixels += 1
                breadth = max(breadth, side[v + 1, u + 1] * p[2])
    return pixels, breadth
