"""The floor as each view sees it about the subject."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..mirrors.disparity_plane import median
from ..numeric.kernels import njit
from ..numeric.point_products import dot
from .connected_pixels import Pieces, Readings, gather_pixels
from .foot_segmentation import NEAR_FLOOR, ROW, FloorViews, share_of_feet, standing_pixels
from .subject_views import ViewSettings

ROUGH = 0.014  # a floor's noise is less [m]
_UNSEEN = 0.004  # where a floor is of which a mirror shows almost nothing, one standard deviation [m]
_FLOOR_SAMPLES = 1000  # readings that a floor is measured with
_FEWEST, _FEWEST_LEVEL, _FEWEST_RING = 80, 60, 200  # readings: with fewer, on a plane, or in a ring, there is no floor
_BIN = 0.005  # m: of the histogram of heights that a floor is looked for in
FOOTPRINT = 0.4  # radius about the subject in which feet may be [m]
_FLOOR_PRIOR = (0.01, 0.006, 0.006)  # by how much a mirror's error may lift [m] and tilt the floor in it
_PER_SAMPLE = 60.0  # readings that count as one, because the errors of neighbours are correlated
_FEET, ABOUT, _FARTHER = 0.2, 0.45, 1.5  # m: feet, the floor right about them; what is farther off, of that
_LIFT, LOW = (
    0.003,
    0.04,
)  # m: a carpet is higher; a mirror shows too little of a lower step to separate it from the floor about it
CARPET = 0.026  # m: nobody needs to hear of what is no higher
_EDGE, _GOES_ON = 0.05, 0.75  # m: how exactly it is known where a carpet ends; share of the readings that are on it
STEP, MAT = (0.008, 0.2), 0.2  # how high [m], and how large [m²] at least, is a mat or step that a person stands on


@dataclass(frozen=True)
class Floor:
    """What the subject stands on, as far as it is known.

    Parameters
    ----------
    height : float or None
        Along the vertical [m]; None when no floor is seen.
    center : np.ndarray [shape=(3,)] or None
        A point of the vertical line through the subject [m].
    wide : bool
        It goes on beyond the feet, and is measured there; else it is measured right about them.
    outer : float
        Radius within which it is measured [m].
    highest : float
        Height above which nothing is the subject's [m].
    """

    height: float | None
    center: np.ndarray | None
    wide: bool
    outer: float
    highest: float


def standing_pieces(
    readings: Readings, views: range, floor: Floor, rough: float, settings: ViewSettings
) -> tuple[Pieces, float]:
    """Connected pieces of what stands on the floor as these views see it.

    Parameters
    ----------
    readings : Readings
    views : range
        The views to look in.
    floor : Floor
    rough : float
        The largest noise that a view of the floor may have [m].
    settings : ViewSettings

    Returns
    -------
    pieces : Pieces
    rough : float
        As given, or, where the direct view is one of these, as that one measures it.
    """
    seen_floor = floor_of_views(readings, views, floor, rough, settings)
    upright = standing_pixels(readings, seen_floor, views[0], floor.highest, settings.floor_clearance)
    return gather_pixels(readings, upright), seen_floor.rough


def standing_pieces_of_all(
    readings: Readings, views: int, floor: Floor, settings: ViewSettings
) -> tuple[Pieces, float]:
    """:func:`standing_pieces` of the direct view and all mirrors, ``views`` in all."""
    pieces, rough = standing_pieces(readings, range(1), floor, ROUGH, settings)
    if views > 1:
        mirrored, _ = standing_pieces(readings, range(1, views), floor, rough, settings)
        component = np.where(mirrored.component >= 0, mirrored.component + pieces.count, pieces.component)
        pieces = replace(pieces, component=component, sizes=np.concatenate((pieces.sizes, mirrored.sizes)))
    return pieces, rough


class RaisedFloor(NamedTuple):
    """A carpet, mat or step [m]: its height along the vertical, and above the floor, and how far it goes on."""

    height: float
    step: float
    goes_on: float


def raised_floor(readings: Readings, floor: float, middle: np.ndarray, reach: float) -> RaisedFloor | None:
    """The floor right about the feet where it is higher than farther off, None where it is not.

    That may be a carpet, or what a camera that looks down misjudges.

    Parameters
    ----------
    readings : Readings
    floor : float
        Height of the floor farther off [m].
    middle : np.ndarray [shape=(3,)]
        Where the subject stands [m].
    reach : float
        Radius within which the floor farther off is measured [m].
    """
    up = readings.up

    def ring(inner: float, outer: float) -> np.ndarray:
        """Points (N, 3) of a floor in a ring, as it is seen directly."""
        sample, *_ = _near_floor_kernel(
            readings.points, readings.seen, up, floor, 0.5 * NEAR_FLOOR, middle, inner**2, outer**2, 0.0,
            horizontal_projection(up), 0, 1, readings.pixel_angle,
        )  # fmt: skip
        return sample

    def level(inner: float, outer: float) -> tuple[float, float, np.ndarray]:
        """Height of what is level in a ring, its standard deviation, and all heights there."""
        height = np.sort(dot(ring(inner, outer), up) - floor)
        if len(height) < _FEWEST_RING:
            return np.nan, np.inf, height
        half = len(height) // 2
        first = int(np.argmin(height[half:] - height[: len(height) - half]))
        noise = (height[first + half] - height[first]) / 1.349
        return float(np.median(height[first : first + half])), float(noise), height

    near, noise, heights = level(_FEET, ABOUT)
    far, far_noise, others = level(_FARTHER * ABOUT, reach)
    if not np.isfinite(near + far) or max(noise, far_noise) > ROUGH:
        return None
    chance = 2.0 * np.hypot(
        noise * np.sqrt(_PER_SAMPLE / len(heights)), far_noise * np.sqrt(_PER_SAMPLE / len(others))
    )  # fmt: skip
    if near - far < max(_LIFT, chance) or np.mean(np.abs(heights - near) < 3.0 * max(noise, 0.001)) < 0.5:
        return None
    points = ring(_FEET, reach)
    away = np.linalg.norm((points - middle) @ horizontal_projection(up), axis=1)
    on = dot(points, up) - floor > 0.5 * (near + far)
    bins = np.minimum((away / _EDGE).astype(np.int64), int(reach / _EDGE))
    share = np.bincount(bins, on) / np.maximum(np.bincount(bins), 1)
    ends = np.flatnonzero((share < _GOES_ON) & (np.arange(len(share)) >= int(_FEET / _EDGE)))
    return RaisedFloor(floor + near, near - far, _EDGE * float(ends[0] if len(ends) else len(share)))


def is_stepped(height: np.ndarray) -> bool:
    """Whether much of a figure, by the heights of its pixels (N,), is at one level near the floor: a mat, a step."""
    bins = np.bincount(np.floor(height[(height >= 0.0) & (height < 1.5)] / 0.01).astype(np.int64), minlength=150)
    return bins[: int(STEP[1] / 0.01) + 1].max() > 5.0 * np.median(bins)


def floor_of_views(readings: Readings, views: range, floor: Floor, rough: float, settings: ViewSettings) -> FloorViews:
    """The floor as these views see it about the subject, how noisy it is, and how much of it there is beside feet.

    Each view has its own plane, because a mirror's error moves the floor in it, and its own noise, because a longer
    path is noisier.
    """
    up, count = readings.up, len(views)
    planes = np.zeros((count, 4))
    planes[:, :3], planes[:, 3] = up, -np.inf if floor.height is None else floor.height
    noises, shares = np.zeros((2, count))
    if floor.height is None:
        return FloorViews(planes, noises, shares, rough)
    center = np.zeros(3) if floor.center is None else floor.center
    if floor.center is None:
        ring = (0.0, np.inf)
    elif floor.wide:  # farther off it is noisier, and at the subject there are feet
        ring = (FOOTPRINT, floor.outer)
    else:
        ring = (0.0 if settings.object else _FEET, floor.outer)
    under = np.inf if floor.center is None else FOOTPRINT
    samples, medians, begin, heights = _near_floor_kernel(
        readings.points, readings.seen, up, floor.height, NEAR_FLOOR, center, ring[0] ** 2, ring[1] ** 2, under**2,
        horizontal_projection(up), views[0], count, readings.pixel_angle,
    )  # fmt: skip
    for k, view in enumerate(views):
        sample, rows = samples[begin[k] : begin[k + 1]], medians[begin[k] : begin[k + 1]]
        fitted = _fit_floor(sample, up, floor.height, center, rough)
        if fitted is None:
            noises[k], lift = _UNSEEN, 0.0
        else:
            normal, d, kept, noise = fitted
            if view == 0:  # twice as far a sensor is four times as noisy, through a mirror more
                rough = min(ROUGH, 7.0 * noise + 0.002)
            planes[k, :3], planes[k, 3] = normal, d
            # a row's median decides on a pixel
            noises[k] = _closest_half(rows[kept] + dot(sample[kept], normal))
            # of this view's floor at the center
            lift = (d - normal @ center) / (normal @ up) + up @ center - floor.height
        shares[k] = share_of_feet(heights[k], lift, noises[k])
    return FloorViews(planes, noises, shares, rough)


def _fit_floor(
    sample: np.ndarray, up: np.ndarray, floor: float, center: np.ndarray, rough: float
) -> tuple[np.ndarray, float, np.ndarray, float] | None:
    """Plane n·p = d of the level surface among points near the floor, its points (N,), their standard deviation.

    None when there is almost none, or it is ``rough``: feet, in a mirror that shows no floor.

    A mirror shows the floor where its plane's error puts it, near the true one: an offset and two slopes are fitted
    with that as prior, for a narrow strip says nothing of its tilt, and a few readings beside feet say little.
    """
    if len(sample) < _FEWEST:
        return None
    height = dot(sample, up) - floor
    # feet are spread over all heights, the floor has one
    bins = np.bincount(np.floor((height + NEAR_FLOOR) / _BIN).astype(np.int64).clip(0))
    level = np.convolve(bins, np.ones(4), mode="same")
    place = _BIN * (np.arange(len(bins)) + 0.5) - NEAR_FLOOR
    likely = level * np.exp(-0.5 * (place / (2.0 * _FLOOR_PRIOR[0])) ** 2)
    first = _level_axis(up)
    plan = sample - center
    rows = np.column_stack((np.ones(len(sample)), dot(plan, first), dot(plan, np.cross(up, first))))
    found = np.array((place[np.argmax(likely)], 0.0, 0.0))
    band = noise = rough
    for _ in range(5):
        miss = height - dot(rows, found)
        kept = np.abs(miss) < band
        if kept.sum() < _FEWEST_LEVEL:
            return None
        # images of images put a second sheet across the floor: its own spread is that of the closest half
        noise = max(_closest_half(miss[kept]), 0.0005)
        matrix, right = _floor_equations(rows, height, miss, band, noise)
        found = np.linalg.solve(np.diag(1.0 / np.square(_FLOOR_PRIOR)) + matrix, right)
        band = min(max(4.0 * noise, 0.003), 2.0 * rough)
    if noise >= rough or (np.abs(found) > 3.0 * np.array(_FLOOR_PRIOR)).any():
        return None
    normal = up - found[1] * first - found[2] * np.cross(up, first)
    length = np.linalg.norm(normal)
    d = (floor + found[0] - found[1] * (first @ center) - found[2] * (np.cross(up, first) @ center)) / length
    return normal / length, float(d), kept, noise


@njit(cache=True, nogil=True)
def _floor_equations(rows, height, miss, band, noise):
    """Weighted normal equations (3, 3) and (3,) of ``rows`` · x = ``height``, of rows that miss by less than a band."""
    matrix, right = np.zeros((3, 3)), np.zeros(3)
    for i in range(len(rows)):
        if abs(miss[i]) < band:
            weight = 1.0 / (_PER_SAMPLE * noise * noise * (1.0 + (miss[i] / (2.0 * noise)) ** 2))
            for a in range(3):
                right[a] += weight * rows[i, a] * height[i]
                for b in range(3):
                    matrix[a, b] += weight * rows[i, a] * rows[i, b]
    return matrix, right


def _closest_half(values: np.ndarray) -> float:
    """Standard deviation of a normal distribution whose middle half is as wide as the narrowest half of the values."""
    values = np.sort(values)
    half = len(values) // 2
    return float((values[half:] - values[: len(values) - half]).min() / 1.349)


@njit(cache=True, nogil=True)
def _near_floor_kernel(
    points, seen, up, floor, band, center, inner2, outer2, under2, across, first, views, pixel_angle
):
    """Up to ``_FLOOR_SAMPLES`` points of the floor in each view, evenly taken, and how far each one's row is above it.

    Those of view k begin at the k-th of the third answer.

    Of the views from ``first`` on, within ``band`` of the floor and in a ring about the subject; of a row its median
    counts. What stands upright is left out. And how many points there are at each height (views, 120), from -``band``
    to ``band``, nearer to the subject.
    """
    heights = np.zeros((views, 120), np.int64)
    height, width = seen.shape
    found = np.empty((views, seen.size), np.int32)
    count = np.zeros(views, np.int64)
    for v in range(height):
        for u in range(width):
            k = seen[v, u] - first
            if k < 0 or k >= views or (seen[v, u] == 0 and (u + v) % 4 > 0):  # directly there is more than enough
                continue
            x, y, z = points[v, u, 0], points[v, u, 1], points[v, u, 2]
            level = up[0] * x + up[1] * y + up[2] * z - floor
            if abs(level) >= band:
                continue
            x, y, z = x - center[0], y - center[1], z - center[2]
            squared = 0.0
            for r in range(3):
                squared += (across[r, 0] * x + across[r, 1] * y + across[r, 2] * z) ** 2
            if squared < under2:
                heights[k, int((level + band) / band * 60.0)] += 1
            if squared < inner2 or squared > outer2:
                continue
            if 3 <= v < height - 3 and seen[v - 3, u] == seen[v, u] and seen[v + 3, u] == seen[v, u]:
                a, b = points[v - 3, u], points[v + 3, u]
                rise = up[0] * (a[0] - b[0]) + up[1] * (a[1] - b[1]) + up[2] * (a[2] - b[2])
                if abs(rise) > 3.0 * pixel_angle * points[v, u, 2]:  # half of what an upright surface rises
                    continue
            found[k, count[k]] = v * width + u
            count[k] += 1
    row, begin = np.empty(2 * ROW + 1), np.zeros(views + 1, np.int64)
    for k in range(views):
        stride = count[k] // _FLOOR_SAMPLES + 1
        begin[k + 1] = begin[k] + (count[k] + stride - 1) // stride
    samples, medians = np.empty((begin[views], 3)), np.empty(begin[views])
    for k in range(views):
        for i in range(begin[k], begin[k + 1]):
            at = found[k, (i - begin[k]) * (count[k] // _FLOOR_SAMPLES + 1)]
            v, u = at // width, at % width
            p = points[v, u]
            for c in range(3):
                samples[i, c] = p[c]
            n = 0
            for w in range(max(u - ROW, 0), min(u + ROW + 1, width)):
                q = points[v, w]
                if seen[v, w] == seen[v, u] and abs(q[2] - p[2]) < 0.1:
                    row[n] = up[0] * (q[0] - p[0]) + up[1] * (q[1] - p[1]) + up[2] * (q[2] - p[2])
                    n += 1
            medians[i] = median(row[:n])
    return samples, medians, begin, heights


def horizontal_projection(up: np.ndarray) -> np.ndarray:
    """Projection (3, 3) onto the horizontal."""
    return np.eye(3) - np.outer(up, up)


def _level_axis(up: np.ndarray) -> np.ndarray:
    """A horizontal unit vector."""
    level = horizontal_projection(up)[:, int(np.argmin(np.abs(up)))]
    return level / np.linalg.norm(level)
