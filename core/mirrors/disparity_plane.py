"""Planes in disparity, where noise is even: fit, covariance, conversion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..camera import Intrinsics
from ..numeric.kernels import njit

BLOCK = 10
"""Side of a block [px]."""

_EDGE_EFFECT = 0.25  # share of the edges' effect, squared, in the covariance
_BAR_ERROR = 0.03  # of a pixel's noise, that a bar of the frame errs in common
_DEVIATION, _TUKEY = 1.4826, 4.7  # standard deviation over median distance, and Tukey's width, of normal errors
_VARIANCE, _MEDIAN = 2.198, 0.4549  # variance over median square, and the inverse, of normal errors


@dataclass(frozen=True)
class DisparityPlane:
    """1/z = a·u + b·v + c.

    Parameters
    ----------
    coefficients : np.ndarray [shape=(3,)]
    covariance : np.ndarray [shape=(3, 3)]
        Of the coefficients.
    weights : np.ndarray [shape=(K,)]
        Of the pixels, 0 to 1.
    scale : float
        Standard deviation of a pixel's 1/z about the plane [1/m].
    common : float
        Variance of the part of it that neighbouring pixels share [1/m²].
    """

    coefficients: np.ndarray
    covariance: np.ndarray
    weights: np.ndarray
    scale: float
    common: float


def disparity_plane(
    u: np.ndarray, v: np.ndarray, z: np.ndarray, start: np.ndarray | None = None
) -> DisparityPlane | None:
    """Robust plane 1/z = a·u + b·v + c; None when all pixels are (nearly) on a line.

    A depth camera's error is even in 1/z, and a plane is linear there. Pixels are re-weighted (Tukey), then pooled to
    blocks of :data:`BLOCK` pixels, whose means are re-weighted in turn. A block's variance is that of its pixels'
    mean plus a share that all its pixels have in common, which is estimated from the blocks (a random effect;
    DerSimonian and Laird 1986); the covariance is that of clustered data (Liang and Zeger 1986).

    Parameters
    ----------
    u, v, z : np.ndarray [shape=(K,)]
        Pixels and readings [m].
    start : np.ndarray [shape=(3,)], optional
        Coefficients to weigh the pixels by at first; by default all weigh the same.
    """
    u, v = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
    fit = _fit_kernel(
        u, v, 1.0 / z.astype(np.float64), np.zeros(3) if start is None else start, start is not None, BLOCK
    )
    if not fit.found:
        return None
    bread = np.linalg.inv(fit.normal)
    covariance = bread @ fit.scores @ bread
    unscale = np.diag(1.0 / fit.scale)
    unscale[2, :2] = -fit.center[:2] / fit.scale[:2]
    return DisparityPlane(unscale @ fit.solution, unscale @ covariance @ unscale.T, fit.weights, fit.sigma, fit.common)


class _Fit(NamedTuple):
    """What :func:`_fit_kernel` finds.

    Attributes
    ----------
    found : bool
        False: the pixels are on a line, or almost none agree.
    solution : np.ndarray [shape=(3,)]
        1/z over x, y and 1, where (x, y) = ((u, v) - ``center``) / ``scale``.
    normal, scores : np.ndarray [shape=(3, 3)]
        Matrix of its equations, and that of their scores: the bread and the meat of its covariance.
    weights : np.ndarray [shape=(K,)]
        Of the pixels.
    center, scale : np.ndarray [shape=(3,)]
        [px]; of the third place 0 and 1.
    sigma : float
        Standard deviation of a pixel [1/m].
    common : float
        Variance that neighbouring pixels share [1/m²].
    """

    found: bool
    solution: np.ndarray
    normal: np.ndarray
    scores: np.ndarray
    weights: np.ndarray
    center: np.ndarray
    scale: np.ndarray
    sigma: float
    common: float


@njit(cache=True, nogil=True, error_model="numpy")
def _fit_kernel(u, v, d, start, started, block):
    """Fit the pixels, pool them to blocks, and correct the fit by these; see :class:`_Fit`."""
    count = len(d)
    center, scale = np.zeros(3), np.empty(3)
    weights, residual = np.empty(count), np.empty(count)
    for i in range(count):
        center[0] += u[i]
        center[1] += v[i]
        weights[i] = 1.0
    center[0], center[1] = center[0] / count, center[1] / count
    scale[0] = scale[1] = scale[2] = 1.0
    for i in range(count):
        scale[0], scale[1] = max(scale[0], abs(u[i] - center[0])), max(scale[1], abs(v[i] - center[1]))
    normal, nothing = np.zeros((3, 3)), np.zeros((3, 3))
    found, solution, sigma = _fit_pixels(u, v, d, start, started, center, scale, weights, residual, normal)
    if not found:
        return _Fit(False, solution, nothing, nothing, weights, center, scale, sigma, 0.0)
    sums, member = _pool(u, v, center, scale, weights, residual, block)
    place, n = np.empty(len(sums), np.int32), 0  # of a block among those that have enough pixels, -1 none
    for b in range(len(sums)):
        place[b] = n if sums[b, 0] > 3.0 else -1
        n += sums[b, 0] > 3.0
    if n < 6:  # too few to tell what blocks share: the pixels are taken as independent, four as one
        total = 0.0
        for i in range(count):
            total += weights[i]
        if not total > 3.0 or sigma == 0.0:
            return _Fit(False, solution, nothing, nothing, weights, center, scale, sigma, 0.0)
        return _Fit(True, solution, normal, 4.0 * sigma * sigma * normal, weights, center, scale, sigma, 0.0)
    pooled = np.empty((n, 4))  # x, y, residual, weight of its pixels
    for b in range(len(sums)):
        k = place[b]
        if k >= 0:
            for c in range(3):
                pooled[k, c] = sums[b, c + 1] / sums[b, 0]
            pooled[k, 3] = sums[b, 0]
    trust, deviation = np.empty(n), np.empty(n)
    found, change, common = _fit_blocks(pooled, sigma, _largest(solution), trust, deviation, normal)
    if not found:
        return _Fit(False, solution, nothing, nothing, weights, center, scale, sigma, 0.0)
    scores = _block_scores(pooled, trust, deviation, change, sigma)
    for i in range(count):
        k = place[member[i]]
        weights[i] *= trust[k] if k >= 0 else 0.0
    for a in range(3):
        solution[a] += change[a]
    return _Fit(True, solution, normal, scores, weights, center, scale, sigma, common)


@njit(cache=True, nogil=True, error_model="numpy")
def _largest(coefficients):
    """Largest size of three numbers."""
    return max(abs(coefficients[0]), abs(coefficients[1]), abs(coefficients[2]))


@njit(cache=True, nogil=True, error_model="numpy")
def _largest_change(after, before):
    return max(abs(after[0] - before[0]), abs(after[1] - before[1]), abs(after[2] - before[2]))


@njit(cache=True, nogil=True, error_model="numpy")
def median(values):
    """Median of numbers, for kernels: they change their order. Quickselect: Hoare 1961."""
    low, high, middle = 0, len(values) - 1, len(values) // 2
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            break
    upper = values[middle]
    if len(values) % 2 == 1:
        return upper
    lower = values[0]  # those before the middle are no larger
    for k in range(1, middle):
        lower = max(lower, values[k])
    return (lower + upper) / 2


@njit(cache=True, nogil=True, error_model="numpy")
def _fit_pixels(u, v, d, start, started, center, scale, weights, residual, normal):
    """Whether the pixels are not on a line, their plane, and the standard deviation about it.

    They are re-weighted up to twelve times; ``weights``, ``residual`` and ``normal`` are filled.
    """
    count = len(d)
    row, solution, right, previous = np.empty(3), np.zeros(3), np.empty(3), np.empty(3)
    row[2] = 1.0
    stride = count // 2000 + 1
    some = np.empty((count + stride - 1) // stride)
    sigma = 0.0
    for turn in range(12):
        for a in range(3):
            previous[a] = solution[a]
        if turn == 0 and started:
            solution[0], solution[1] = start[0] * scale[0], start[1] * scale[1]
            solution[2] = start[0] * center[0] + start[1] * center[1] + start[2]
        else:
            _clear(normal, right)
            for i in range(count):
                row[0], row[1] = (u[i] - center[0]) / scale[0], (v[i] - center[1]) / scale[1]
                for a in range(3):
                    right[a] += weights[i] * row[a] * d[i]
                    for b in range(3):
                        normal[a, b] += weights[i] * row[a] * row[b]
            found, solution = _solve_3x3(normal, right)
            if not found:
                return False, previous, sigma
        for i in range(count):
            x, y = (u[i] - center[0]) / scale[0], (v[i] - center[1]) / scale[1]
            residual[i] = d[i] - (solution[0] * x + solution[1] * y + solution[2])
        for k in range(len(some)):
            some[k] = abs(residual[k * stride])
        sigma = _DEVIATION * median(some) + 1e-9
        for i in range(count):
            r = residual[i] / (_TUKEY * sigma)
            weights[i] = (1.0 - r * r) ** 2 if abs(r) < 1.0 else 0.0
        if turn > 0 and _largest_change(solution, previous) < 1e-5 * _largest(solution):
            break
    return True, solution, sigma


@njit(cache=True, nogil=True, error_model="numpy")
def _clear(normal, right):
    for a in range(3):
        right[a] = 0.0
        for b in range(3):
            normal[a, b] = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _pool(u, v, center, scale, weights, residual, block):
    """Sums over the pixels of each block of weight, x, y and residual (N, 4), and the block of each pixel (K,)."""
    left, top, right, bottom = u[0], v[0], u[0], v[0]
    for i in range(len(u)):
        left, top, right, bottom = min(left, u[i]), min(top, v[i]), max(right, u[i]), max(bottom, v[i])
    columns = int((right - left) // block) + 1
    rows = int((bottom - top) // block) + 1
    sums, member = np.zeros((rows * columns, 4)), np.empty(len(u), np.int32)
    for i in range(len(u)):
        member[i] = int((v[i] - top) // block) * columns + int((u[i] - left) // block)
        cell = sums[member[i]]
        cell[0] += weights[i]
        cell[1] += weights[i] * (u[i] - center[0]) / scale[0]
        cell[2] += weights[i] * (v[i] - center[1]) / scale[1]
        cell[3] += weights[i] * residual[i]
    return sums, member


@njit(cache=True, nogil=True, error_model="numpy")
def _fit_blocks(pooled, sigma, size, trust, deviation, normal):
    """Whether the blocks are not on a line, the plane through their residuals, and the variance that a block shares.

    That is what its pixels have in common. They are re-weighted up to eight times; ``trust``, ``deviation`` and
    ``normal`` are filled.
    """
    n = len(pooled)
    gap, some, row, right, change = np.empty(n), np.empty(n), np.empty(3), np.empty(3), np.zeros(3)
    row[2] = 1.0
    common = 0.0
    for _ in range(8):
        for k in range(n):
            gap[k] = pooled[k, 2] - (change[0] * pooled[k, 0] + change[1] * pooled[k, 1] + change[2])
        # what the pixels of a block err in common: what their noise does not explain of the blocks' residuals
        for k in range(n):
            some[k] = gap[k] * gap[k] - _MEDIAN * sigma * sigma / pooled[k, 3]
        common = max(_VARIANCE * median(some), 0.0)
        _clear(normal, right)
        for k in range(n):
            deviation[k] = np.sqrt(sigma * sigma / pooled[k, 3] + common) + 1e-9
            r = gap[k] / (_TUKEY * deviation[k])
            trust[k] = (1.0 - r * r) ** 2 if abs(r) < 1.0 else 0.0
            w = trust[k] / (deviation[k] * deviation[k])
            row[0], row[1] = pooled[k, 0], pooled[k, 1]
            for a in range(3):
                right[a] += w * row[a] * pooled[k, 2]
                for b in range(3):
                    normal[a, b] += w * row[a] * row[b]
        found, step = _solve_3x3(normal, right)
        if not found:
            return False, change, common
        moved = _largest_change(step, change)
        change = step
        if moved < 1e-6 * size:
            break
    return True, change, common


@njit(cache=True, nogil=True, error_model="numpy")
def _block_scores(pooled, trust, deviation, change, sigma):
    """Sum of the outer products (3, 3) of the blocks' scores, and of what whole bars of the frame may err in common."""
    scores, kept, bars, row = np.zeros((3, 3)), 0.0, np.zeros((4, 3)), np.empty(3)
    row[2] = 1.0
    for k in range(len(pooled)):
        row[0], row[1] = pooled[k, 0], pooled[k, 1]
        gap = pooled[k, 2] - (change[0] * row[0] + change[1] * row[1] + change[2])
        w = trust[k] / (deviation[k] * deviation[k])
        bar = int((np.arctan2(row[1], row[0]) / (2.0 * np.pi) + 0.625) * 4.0) % 4
        for a in range(3):
            bars[bar, a] += w * row[a]
        w *= gap
        kept += trust[k]
        for a in range(3):
            for b in range(3):
                scores[a, b] += w * w * row[a] * row[b]
    for a in range(3):
        for b in range(3):
            scores[a, b] *= kept / max(kept - 3.0, 1.0)
    # what a whole bar of the frame errs in common shows in no residual: a share of a pixel's noise
    for bar in range(4):
        for a in range(3):
            for b in range(3):
                scores[a, b] += (_BAR_ERROR * sigma) ** 2 * bars[bar, a] * bars[bar, b]
    return scores


@njit(cache=True, nogil=True, error_model="numpy")
def _solve_3x3(matrix, right):
    """Cramer's rule, and whether the determinant is far enough from 0.

    Numba's own solver needs scipy, which Blender has not.
    """
    a, b, c = matrix[0], matrix[1], matrix[2]
    minors = np.empty((3, 3))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        minors[0, k] = b[i] * c[j] - b[j] * c[i]
        minors[1, k] = c[i] * a[j] - c[j] * a[i]
        minors[2, k] = a[i] * b[j] - a[j] * b[i]
    determinant = a[0] * minors[0, 0] + a[1] * minors[0, 1] + a[2] * minors[0, 2]
    trace = a[0] + b[1] + c[2]
    solution = np.zeros(3)
    if determinant < 1e-10 * trace * trace * trace:
        return False, solution
    for k in range(3):
        for row in range(3):
            solution[k] += minors[row, k] * right[row] / determinant
    return True, solution


def fit_core(u: np.ndarray, v: np.ndarray, depth: np.ndarray, fitted: DisparityPlane) -> DisparityPlane:
    """The plane through a frame's pixels without its edges, which cameras smear.

    How much the plane changes when one more ring of pixels, or one fewer, is left out measures the effect of the edges;
    it is part of the covariance.
    """
    left, top = u.min(), v.min()
    mask = np.zeros((v.max() - top + 1, u.max() - left + 1), np.bool_)
    mask[v - top, u - left] = True
    ring = erosion(mask)
    count = np.cumsum(np.bincount(ring.ravel(), minlength=4)[::-1])[::-1]  # pixels with at least so many rings
    edge = 2 if count[3] > max(0.25 * count[1], 200) else 1 if count[2] > max(0.25 * count[1], 200) else 0

    def fit(level: int) -> DisparityPlane | None:
        rows, columns = np.nonzero(ring > level)
        rows, columns = rows + top, columns + left
        return disparity_plane(columns, rows, depth[rows, columns], fitted.coefficients)

    core = fit(edge) if edge else fitted
    if core is None:
        return fitted
    beside = (fitted if edge == 1 else fit(edge - 1)) if edge else fit(1) if count[2] > 100 else None
    if beside is None:
        return core
    change = beside.coefficients - core.coefficients
    return replace(core, covariance=core.covariance + _EDGE_EFFECT * np.outer(change, change))


@njit(cache=True, nogil=True, error_model="numpy")
def erosion(mask):
    """0 off the mask, else 1 + how many rings of 8-neighbours are all on it, up to 3."""
    height, width = mask.shape
    out = np.zeros(mask.shape, np.uint8)
    for v in range(height):
        for u in range(width):
            if not mask[v, u]:
                continue
            rings = 0
            while rings < 2:
                r = rings + 1
                if v < r or u < r or v >= height - r or u >= width - r:
                    break
                whole = True
                for k in range(-r, r + 1):
                    if not (mask[v - r, u + k] and mask[v + r, u + k] and mask[v + k, u - r] and mask[v + k, u + r]):
                        whole = False
                        break
                if not whole:
                    break
                rings = r
            out[v, u] = 1 + rings
    return out


def plane_of_disparity(coefficients: np.ndarray, intrinsics: Intrinsics) -> tuple[np.ndarray, float]:
    """Normal and offset d (n·p = d, metres) of the plane 1/z = a·u + b·v + c."""
    a, b, c = coefficients
    n = np.array((a * intrinsics.fx, b * intrinsics.fy, a * intrinsics.cx + b * intrinsics.cy + c))
    length = np.linalg.norm(n)
    return n / length, float(1.0 / length)


def disparity_of_plane(normal: np.ndarray, d: float, intrinsics: Intrinsics) -> np.ndarray:
    """Coefficients (3,) of 1/z = a·u + b·v + c on the plane n·p = d."""
    n, k = np.asarray(normal) / d, intrinsics
    return np.array((n[0] / k.fx, n[1] / k.fy, n[2] - n[0] * k.cx / k.fx - n[1] * k.cy / k.fy))


def plane_covariance(
    fitted: DisparityPlane, intrinsics: Intrinsics, point: np.ndarray, basis: np.ndarray
) -> np.ndarray:
    """:attr:`.mirror.Mirror.covariance` (3, 3) about ``point`` from that of the disparity plane's coefficients.

    With m = (a·fx, b·fy, a·cx + b·cy + c) the plane is m·p = 1; a change of m lifts it at p by -δm·p / |m|.
    """
    to_m = np.array(((intrinsics.fx, 0, 0), (0, intrinsics.fy, 0), (intrinsics.cx, intrinsics.cy, 1)))
    length = np.linalg.norm(to_m @ fitted.coefficients)
    transfer = -np.array((basis[:, 0], basis[:, 1], point)) @ to_m / length
    return transfer @ fitted.covariance @ transfer.T
