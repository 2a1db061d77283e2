"""Segmentation of feet from the floor they stand on: in each column of the image, where the heights begin to rise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..numeric.kernels import njit
from ..numeric.threads import each_range
from .connected_pixels import Readings

NEAR_FLOOR = 0.12  # readings within this of the floor show how each view sees it [m]
ROW = 3  # px to either side that a pixel near the floor is judged by
_ROWS = 4  # px above and below, as well
_RISE = 0.8  # what is not floor rises by this share of what an upright surface would
_SOLE = 0.0035  # height at which a foot begins: its sole is rounded [m]
_BEGINNINGS = 4  # places of that beginning that are weighed against each other, a pixel
# an error of the floor right at a sole is almost invisible, a lost piece of foot is not: it counts so many times; more
# where noise is that share of a row's rise, for there such pieces are whole feet in few pixels
_HOLE, _BLURRED_HOLE, _BLURRED = 1.5, 6.0, (0.3, 0.7)
_SIDE, _OWN = 3, 0.3  # px on either side of a foot's edge; how far from floor to foot a pixel of the floor may read
_QUIET = 0.0007  # m: the median of a row is never more accurate
_NOT_NOISE = 4.0  # standard deviations: a height that differs by more is not the floor's by chance
_LIKELIEST = 300.0  # exponent at which a likelihood is as good as certain, so that no product overflows
_SAME_SURFACE = 0.1  # m: pixels of a row that differ by less in z are pooled


class FloorViews(NamedTuple):
    """The floor as each of K views sees it: a mirror's plane is off by a little, and the floor in it by twice that.

    ``planes`` (K, 4): n·p = d [m], d = -inf without a floor; ``noises`` (K,): standard deviation of the median height
    of a short row on it [m]; ``shares`` (K,): :func:`share_of_feet` [1/m]; ``rough``: the largest
    noise that a view of this floor may have [m].
    """

    planes: np.ndarray
    noises: np.ndarray
    shares: np.ndarray
    rough: float


def share_of_feet(heights: np.ndarray, lift: float, noise: float) -> float:
    """How many readings per metre of height feet have for one that the floor has about the subject [1/m].

    The floor's are spread about 0 by ``noise`` [m], feet's evenly over all heights. How many there are of each is
    counted, the floor's below 0 where feet have none.

    Parameters
    ----------
    heights : np.ndarray [shape=(B,)]
        How many of a view's readings about the subject there are in each bin of height, from -``NEAR_FLOOR`` to
        ``NEAR_FLOOR``.
    lift : float
        Where the floor is in it [m].
    """
    place = (np.arange(len(heights)) + 0.5) * (2.0 * NEAR_FLOOR / len(heights)) - NEAR_FLOOR - lift
    ground = 2.0 * float(heights[(place < 0.0) & (place > -5.0 * noise)].sum())
    above = (place > min(3.0 * noise, 0.2 * NEAR_FLOOR)) & (place < 0.5 * NEAR_FLOOR)
    feet = max(float(heights[above].sum()), 1.0) / max(float(np.ptp(place[above])), 0.01)
    return feet / max(ground, 1.0)


def standing_pixels(readings: Readings, floor: FloorViews, first: int, highest: float, clearance: float) -> np.ndarray:
    """``seen`` where it is one of these views and what the pixel shows stands on the floor, else -1.

    Height alone separates a foot from the floor only above the floor's noise, which in a mirror, and in short bursts,
    is a centimetre and more. But up a column of the image the floor stays at 0 and what stands on it rises by about a
    pixel a pixel: of all rows in which that may begin, near a pixel, each is as likely as a column of heights that does
    so fits the one that is seen. Median heights of short rows are used, which keeps a foot's sides where they are.

    Parameters
    ----------
    readings : Readings
    floor : FloorViews
        The floor in each of the K views from ``first`` on.
    first : int
    highest : float
        Height along the vertical above which nothing counts [m].
    clearance : float
        Height threshold: what is lower above the floor is the floor's in any case [m].

    Returns
    -------
    np.ndarray [shape=(H, W), dtype=int8]

    Notes
    -----
    O(H W); some hundred operations a pixel near the floor.
    """
    seen, depth = readings.seen, readings.depth
    noises = np.maximum(floor.noises, _QUIET)
    bands = np.maximum(6.0 * noises, clearance) + 0.03
    height, near = len(seen), np.zeros(len(seen), np.bool_)
    out, above = np.full(seen.shape, -1, np.int8), np.empty(seen.shape, np.float32)
    each_range(
        _above_kernel, height, readings.points, seen, readings.up, floor.planes, bands, highest, clearance, first,
        out, above, near,
    )  # fmt: skip
    rows, kind = np.full(seen.shape, np.inf, np.float32), np.zeros(seen.shape, np.int8)
    each_range(_pooled_kernel, height, above, seen, depth, near, rows)
    each_range(
        _feet_kernel, height, seen, depth, rows, near, noises, floor.shares, clearance, first, readings.pixel_angle,
        kind, out,
    )  # fmt: skip
    _islands_kernel(seen, kind, near, out)
    _sides_kernel(seen, above, kind, near, noises, first, out)
    return out


@njit(cache=True, nogil=True)
def _above_kernel(begin, end, points, seen, up, floors, bands, highest, clearance, first, out, above, near):
    """``seen`` where a point is above its view's floor and below ``highest``.

    Its height above that floor [m]; and which rows have points within ``bands`` of it. The floors are those of the
    views from ``first`` on.
    """
    for v in range(begin, end):
        for u in range(seen.shape[1]):
            k = seen[v, u]
            above[v, u] = np.inf
            if k < first or k >= first + len(floors):
                continue
            p, plane = points[v, u], floors[k - first]
            if p[0] * up[0] + p[1] * up[1] + p[2] * up[2] < highest:
                a = p[0] * plane[0] + p[1] * plane[1] + p[2] * plane[2] - plane[3]
                above[v, u] = a
                if a > clearance:
                    out[v, u] = k
                if a < bands[k - first]:
                    near[v] = True


@njit(cache=True, nogil=True)
def _pooled_kernel(begin, end, above, seen, depth, near, out):
    """Median height (H, W) of each pixel's row about it, in rows ``near`` the floor; inf where there is none."""
    width = seen.shape[1]
    row = np.empty(2 * ROW + 1, np.float32)
    for v in range(begin, end):
        if not near[v]:
            continue
        for u in range(width):
            if above[v, u] > 2.0 * NEAR_FLOOR:
                continue
            n = 0
            for x in range(max(u - ROW, 0), min(u + ROW + 1, width)):
                if seen[v, x] == seen[v, u] and abs(depth[v, x] - depth[v, u]) < _SAME_SURFACE:
                    a, at = above[v, x], n
                    while at > 0 and row[at - 1] > a:
                        row[at] = row[at - 1]
                        at -= 1
                    row[at] = a
                    n += 1
            out[v, u] = row[n // 2] if n % 2 else 0.5 * (row[n // 2 - 1] + row[n // 2])


@njit(cache=True, nogil=True)
def _feet_kernel(begin, end, seen, depth, rows, near, noises, shares, clearance, first, pixel_angle, kind, out):
    """Decide anew for pixels near the floor, in ``out``.

    ``kind``: 1 = the floor's or below it, 2 = near it but a foot's.
    """
    height, width = seen.shape
    column = np.empty(2 * _ROWS + 1)
    for v in range(begin, end):
        if not near[v]:
            continue
        for u in range(width):
            h = rows[v, u]
            if h == np.inf:
                continue
            k = seen[v, u]
            noise = noises[k - first]
            rise = _RISE * pixel_angle * depth[v, u]
            if h < clearance:
                kind[v, u] = 1
                out[v, u] = -1
                continue
            if h > _NOT_NOISE * noise + rise:
                out[v, u] = k
                continue
            # the rows that belong together: what gets higher downwards, or lower upwards, is something else
            column[_ROWS] = h
            less = more = 0
            low = high = h
            for j in range(1, _ROWS + 1):
                y = v - j
                if y < 0 or seen[y, u] != k or rows[y, u] == np.inf or rows[y, u] < high - _NOT_NOISE * noise:
                    break
                less = j
                column[_ROWS - j] = rows[y, u]
                high = max(high, rows[y, u])
            for j in range(1, _ROWS + 1):
                y = v + j
                if y >= height or seen[y, u] != k or rows[y, u] == np.inf or rows[y, u] > low + _NOT_NOISE * noise:
                    break
                more = j
                column[_ROWS + j] = rows[y, u]
                low = min(low, rows[y, u])
            flat = over = 0.0
            for j in range(-less, more + 1):
                flat += column[_ROWS + j] ** 2
                least = rise * (0.5 - j) + _SOLE if j <= 0 else 0.0
                expected = max(column[_ROWS + j], least)
                over += expected * (2.0 * column[_ROWS + j] - expected)
            weight = shares[k - first] * rise / _BEGINNINGS
            blurred = min(max((noise / rise - _BLURRED[0]) / (_BLURRED[1] - _BLURRED[0]), 0.0), 1.0)
            hole = _HOLE + blurred * (_BLURRED_HOLE - _HOLE)
            last = _BEGINNINGS * (more + _ROWS + 2)
            # no foot fits better than one that is all that is seen, but no lower than a foot is: floor mostly ends here
            if hole * weight * last * np.exp(min(0.5 * over / noise**2, _LIKELIEST)) < 1.0:
                kind[v, u] = 1
                out[v, u] = -1
                continue
            # no foot at all, or one from so many rows below this one on; half a row is too little to say
            floor, foot = 1.0, 0.0
            for step in range(-_BEGINNINGS * less, last):
                begin, miss = step / _BEGINNINGS, 0.0
                for j in range(-less, more + 1):
                    expected = rise * (begin - j) + _SOLE if begin > j else 0.0
                    miss += (column[_ROWS + j] - expected) ** 2
                likely = weight * np.exp(min(0.5 * (flat - miss) / noise**2, _LIKELIEST))
                if begin >= 0.5:
                    foot += likely
                else:
                    floor += likely
            mine = hole * foot > floor
            kind[v, u] = 2 if mine else 1
            out[v, u] = k if mine else -1


@njit(cache=True, nogil=True)
def _islands_kernel(seen, kind, near, out):
    """A pixel of a foot amid such of the floor is the floor's as well."""
    height, width = seen.shape
    for v in range(height):
        if not near[v]:
            continue
        for u in range(width):
            if kind[v, u] != 2:
                continue
            floor, other = 0, 0
            for y in range(max(v - 2, 0), min(v + 3, height)):
                for x in range(max(u - 2, 0), min(u + 3, width)):
                    if kind[y, x] == 1:
                        floor += 1
                    elif seen[y, x] >= 0:
                        other += 1
            if floor > 2 * other:
                out[v, u] = -1


@njit(cache=True, nogil=True)
def _sides_kernel(seen, above, kind, near, noises, first, out):
    """Beside a foot the median of a row is the foot's: what the pixel's own readings say is the floor's as well."""
    height, width = seen.shape
    for v in range(1, height - 1):
        if not near[v]:
            continue
        for u in range(_SIDE, width - _SIDE):
            if kind[v, u] != 2 or out[v, u] < 0:
                continue
            k = seen[v, u]
            for way in (-1, 1):
                if kind[v, u + way] != 1 and kind[v, u + 2 * way] != 1:
                    continue
                floor, foot, own = 0.0, 0.0, 0.0
                whole = seen[v - 1, u] == k and seen[v + 1, u] == k
                for step in range(1, _SIDE + 1):
                    whole &= seen[v, u + step * way] == k and seen[v, u - step * way] == k
                    floor += above[v, u + step * way]
                    foot += above[v, u - step * way]
                if not whole:
                    continue
                for y in range(v - 1, v + 2):
                    own += above[y, u]
                if foot - floor > _SIDE * _NOT_NOISE * noises[k - first] and own - floor < _OWN * (foot - floor):
                    kind[v, u] = 1
                    out[v, u] = -1
                    break
