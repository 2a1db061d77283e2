"""Edge-preserving smoothing of one view: local quadratic fits in disparity, robust where a window holds an edge.

Where one surface fills the window its weights are the Gaussian's alone, and all the sums a fit needs come from
separable filters. Only where the residual shows that something else is in the window are its readings weighted one by
one.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..numeric.kernels import njit
from ..numeric.threads import each
from .settings import DepthSettings

_STRIP = 24  # rows a thread works on at a time: its sums stay in the cache
_REST = 0.06  # Gaussian weight at the edge of the robust fit's window


def smoothing_sigma(noise: float, z: float, pixel_angle: float, settings: DepthSettings) -> float:
    """Gaussian width [px] of the local fit that balances noise against detail.

    A local quadratic fit over a window of width h [m] leaves noise of about noise·z·pitch/h and a bias that grows with
    h³ at the curvature of limbs; their sum is least near h³ ∝ noise·z·pitch.

    Parameters
    ----------
    noise : float
        Standard deviation of a reading relative to z.
    z : float
        Where the view is [m].
    pixel_angle : float
        1/f [1/px].
    settings : DepthSettings
        ``smoothing`` multiplies, ``max_radius`` limits.
    """
    pitch = z * pixel_angle
    return settings.smoothing * min((noise * z * pitch * 0.35) ** (1.0 / 3.0) * 0.6 / pitch, settings.max_radius / 2.0)


def smooth_view(
    depth: np.ndarray,
    labels: np.ndarray,
    view: int,
    noise: float,
    sigma: float,
    settings: DepthSettings,
) -> np.ndarray:
    """Edge-preserving smoothing of one view's pixels by local quadratic fits in disparity.

    Neighbours of the same view weigh by their distance in pixels (Gaussian of ``sigma``). Where the fit's residual is
    larger than the noise, they weigh also by how well they agree with the surface fitted so far (Tukey's weight), so
    another limb in front or behind does not pull. Local polynomial regression: Cleveland and Devlin 1988.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m].
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel.
    view : int
        The one to smooth.
    noise : float
        Standard deviation of a reading relative to z.
    sigma : float
        Width of the window [px].
    settings : DepthSettings
        ``max_radius`` limits the window.

    Returns
    -------
    np.ndarray [shape=(H, W), dtype=float32]
        The depth map with this view's pixels smoothed.

    Notes
    -----
    O(pixels · radius) where the surface is smooth, O(pixels · radius²) at edges within the view; O(H W) memory.
    """
    radius = min(int(np.ceil(2.4 * sigma)), settings.max_radius)
    rows = np.flatnonzero((labels == view).any(axis=1))
    if radius < 1 or not len(rows):
        return depth
    top, bottom, noise = int(rows[0]), int(rows[-1]) + 1, max(noise, 2e-4)
    inverse, reference = _inverse_kernel(depth, labels, view, radius, top, bottom)
    offset, gauss, terms, products = _taps(sigma, radius)
    # the robust fit starts from whatever could be the same surface; a slanted one may leave the centre by its slope
    slant = np.minimum(0.008 * sigma * np.sqrt(terms[3] + terms[5]).astype(np.float64), 0.015)
    window = Window(
        _row_weights(sigma, radius),
        offset[0] * inverse.shape[1] + offset[1],
        gauss,
        terms,
        products,
        (1.0 / (4.0 * noise + 0.005 + slant)).astype(np.float32),
    )
    out = depth.copy()

    def smooth(first: int) -> None:
        last = min(first + _STRIP, bottom)
        _smooth_kernel(depth, labels, view, noise, inverse, np.float32(reference), window, first, last, out)

    each(smooth, range(top, bottom, _STRIP))
    return out


def keep_relief(
    depth: np.ndarray, smooth: np.ndarray, labels: np.ndarray, view: int, noise: float, share: float
) -> np.ndarray:
    """``smooth`` held back where it takes away more than the noise: what goes there is relief.

    Within 5×5 windows the change of :func:`smooth_view` is shrunk to the noise's standard deviation (shrinkage as of
    James and Stein 1961, a window at a time).

    Parameters
    ----------
    depth, smooth : np.ndarray [shape=(H, W), dtype=float32]
        Before and after smoothing [m].
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel.
    view : int
        The one that was smoothed.
    noise : float
        Standard deviation of a reading relative to z.
    share : float
        How far to go: 0 gives ``smooth``, 1 holds back all that is more than noise [0..1].

    Returns
    -------
    np.ndarray [shape=(H, W), dtype=float32]
    """
    return _relief_kernel(depth, smooth, labels, view, noise, share)


@njit(cache=True, nogil=True, error_model="numpy")
def _relief_kernel(depth, smooth, labels, view, noise, share):
    height, width = depth.shape
    out = smooth.copy()
    change = np.full((height, width), -1.0)  # squared, -1 where there is none
    for v in range(height):
        for u in range(width):
            if labels[v, u] == view:
                change[v, u] = (smooth[v, u] / depth[v, u] - 1.0) ** 2
    for v in range(height):
        for u in range(width):
            if labels[v, u] != view:
                continue
            total, count = 0.0, 0
            for y in range(max(v - 2, 0), min(v + 3, height)):
                for x in range(max(u - 2, 0), min(u + 3, width)):
                    known = change[y, x] >= 0
                    total += change[y, x] if known else 0.0
                    count += known
            held = 1.0 - min(1.0, noise * noise * count / total) if total > 0 else 0.0
            out[v, u] += share * held * (depth[v, u] - smooth[v, u])
    return out


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"}, error_model="numpy")
def _across(weights, row, radius, low, high, out):
    """out[a, u] = Σ weights[a, |k|] · (±1)^a · row[u + radius + k] over k from -radius to radius.

    Loops run from 0 over slices: an index that could be negative would not vectorise.
    """
    for a in range(len(out)):
        target = out[a, low:high]
        w = weights[a, 0]
        middle = row[low + radius : high + radius]
        for u in range(high - low):
            target[u] = w * middle[u]
        for k in range(1, radius + 1):
            w = weights[a, k]
            mirrored = w if a % 2 == 0 else -w
            right, left = row[low + radius + k : high + radius + k], row[low + radius - k : high + radius - k]
            for u in range(high - low):
                target[u] += w * right[u] + mirrored * left[u]


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"}, error_model="numpy")
def _down(weights, rows, at, a, radius, low, high, out):
    """out[b, u] = Σ weights[b, |k|] · (±1)^b · rows[at + k, a, u] over k from -radius to radius."""
    for b in range(len(out)):
        target = out[b, low:high]
        w = weights[b, 0]
        middle = rows[at, a, low:high]
        for u in range(high - low):
            target[u] = w * middle[u]
        for k in range(1, radius + 1):
            w = weights[b, k]
            mirrored = w if b % 2 == 0 else -w
            below, above = rows[at + k, a, low:high], rows[at - k, a, low:high]
            for u in range(high - low):
                target[u] += w * below[u] + mirrored * above[u]


# The six terms of the fit as powers of (x, y), the constant last: elimination then ends with its coefficient.
_TERMS = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (0, 0))
_SUM = {(a, b): a * 5 - a * (a - 1) // 2 + b for a in range(5) for b in range(5 - a)}  # Σ xᵃ yᵇ among the 22 sums
_DATA = {(0, 0): 15, (0, 1): 16, (0, 2): 17, (1, 0): 18, (1, 1): 19, (2, 0): 20}  # Σ xᵃ yᵇ · departure; 21: departure²
_MATRIX = np.array([[_SUM[a + c, b + d] for c, d in _TERMS] for a, b in _TERMS])
_RIGHT = np.array([_DATA[term] for term in _TERMS])
_RIDGE = np.array((2e-3, 2e-3, 3e-2, 3e-2, 3e-2, 1e-6), np.float32)
"""Pulls the higher orders to zero where the window holds too little; relative to the window's weight."""


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"}, error_model="numpy")
def _less(target, a, b):
    for u in range(len(target)):
        target[u] -= a[u] * b[u]


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"}, error_model="numpy")
def _fit_row(sums, low, high, work):
    """Quadratic fits of a whole row at once, LDLᵀ without pivoting: the ridge keeps it stable in single precision.

    Into ``work``: row 0 the constant's coefficient, row 1 the weighted sum of squared residuals; anything in columns
    without readings.
    """
    # rows of work: 2-7 the reciprocal pivots, 8-13 the right side eliminated, 14-28 the lower triangle of L
    left = work[1, low:high]
    whole, weight = sums[21, low:high], sums[0, low:high]
    for u in range(high - low):
        left[u] = whole[u]
    mixed = np.empty((6, high - low), np.float32)  # L times the pivots, of the row at hand
    for i in range(6):
        right, data = work[8 + i, low:high], sums[_RIGHT[i], low:high]
        for u in range(high - low):
            right[u] = data[u]
        for j in range(i + 1):
            entry, moment = mixed[j], sums[_MATRIX[i, j], low:high]
            for u in range(high - low):
                entry[u] = moment[u]
            if i == j:
                ridge = _RIDGE[i]
                for u in range(high - low):
                    entry[u] += ridge * weight[u]
            for k in range(j):
                _less(entry, mixed[k], work[14 + j * (j - 1) // 2 + k, low:high])
            if j < i:
                factor = work[14 + i * (i - 1) // 2 + j, low:high]
                pivot = work[2 + j, low:high]
                for u in range(high - low):
                    factor[u] = entry[u] * pivot[u]
                _less(right, factor, work[8 + j, low:high])
            else:
                pivot = work[2 + i, low:high]
                solved = work[0, low:high]
                for u in range(high - low):
                    pivot[u] = np.float32(1.0) / entry[u]
                    solved[u] = right[u] * pivot[u]  # of the last term, the constant, it is the coefficient
                    left[u] -= right[u] * solved[u]


class Window(NamedTuple):
    """What the fits of all pixels share."""

    rows: np.ndarray  # (5, radius + 1) float32: Gaussian times the powers of du / sigma, for sums along a row
    shift: np.ndarray  # (taps,) int64: from a pixel to the taps of the robust fit, in the flat array
    gauss: np.ndarray  # (taps,) float32
    terms: np.ndarray  # (6, taps) float32
    products: np.ndarray  # (21, taps) float32
    allowed: np.ndarray  # (taps,) float32: 1 over the departure at which Tukey's weight is zero, at first


@njit(cache=True, nogil=True, error_model="numpy")
def _inverse_kernel(depth, labels, view, radius, top, bottom):
    """Inverse depth of this view alone, with a margin, so that a tap asks one question: is it zero? Its mean's inverse.

    Single precision: what is fitted is the small departure from the reference; its error of 1e-7 is far below noise.
    """
    height, width = depth.shape
    one = np.float32(1.0)
    inverse = np.zeros((height + 2 * radius, width + 2 * radius), np.float32)
    total = 0.0
    count = 0
    for v in range(top, bottom):
        for u in range(width):
            if labels[v, u] == view:
                inverse[v + radius, u + radius] = one / depth[v, u]
                total += inverse[v + radius, u + radius]
                count += 1
    return inverse, count / total


@njit(cache=True, nogil=True, error_model="numpy")
def _smooth_kernel(depth, labels, view, noise, inverse, reference, window, v0, v1, out):
    """A view's pixels in the rows from ``v0`` to ``v1`` smoothed, into ``out``.

    It stays whole because the sums, both fits and their buffers share some twenty arrays, which a function for part of
    it would have to be given one by one.
    """
    height, width = depth.shape
    weights = window.rows
    radius = weights.shape[1] - 1
    one = np.float32(1.0)
    inlier = np.float32(1.0 / (3.7 * noise + 0.002))
    limit = 3.0 * noise + 0.002
    spoilt = (1.25 * noise + 0.0004) ** 2
    flat = inverse.reshape(inverse.size)
    first, last = np.empty(v1 - v0, np.int64), np.zeros(v1 - v0, np.int64)
    first[:] = width
    left, right = width, 0
    for v in range(max(v0 - radius, 0), min(v1 + radius, height)):
        for u in range(width):
            if labels[v, u] == view:
                left, right = min(left, u), max(right, u + 1)
                if v0 <= v < v1:
                    first[v - v0], last[v - v0] = min(first[v - v0], u), u + 1
    # sums along the rows: mask · x⁰…x⁴, departure · x⁰…x², departure²
    across = np.zeros((v1 - v0 + 2 * radius, 9, width), np.float32)
    there = np.zeros(width + 2 * radius, np.float32)
    departs = np.zeros(width + 2 * radius, np.float32)
    squares = np.zeros(width + 2 * radius, np.float32)
    low, high = max(left - radius, 0), min(right + radius, width)
    for r in range(v1 - v0 + 2 * radius):
        row = inverse[v0 + r]
        some = False
        for u in range(left + radius, right + radius):
            seen = row[u] > 0
            some |= seen
            there[u] = one if seen else np.float32(0.0)
            departs[u] = reference * row[u] - one if seen else np.float32(0.0)
            squares[u] = departs[u] * departs[u]
        if some:
            _across(weights[:5], there, radius, low, high, across[r, :5])
            _across(weights[:3], departs, radius, low, high, across[r, 5:8])
            _across(weights[:1], squares, radius, low, high, across[r, 8:])
    sums = np.empty((22, width), np.float32)
    work = np.empty((29, width), np.float32)
    A = np.empty((6, 6))
    rhs = np.empty(6)
    coef = np.zeros(6)
    buffers = np.empty((4, len(window.gauss)), np.float32)
    for v in range(v0, v1):
        low, high = first[v - v0], last[v - v0]
        if low >= high:
            continue
        r = v - v0 + radius
        start = 0
        for a in range(9):
            powers = 5 - a if a < 5 else max(8 - a, 1)
            _down(weights[:powers], across, r, a, radius, low, high, sums[start : start + powers])
            start += powers
        _fit_row(sums, low, high, work)
        for u in range(low, high):
            if labels[v, u] != view:
                continue
            zc = depth[v, u]
            if work[1, u] <= spoilt * sums[0, u]:
                change = reference / (zc * (1.0 + work[0, u])) - 1.0
            else:
                at = (v + radius) * (width + 2 * radius) + u + radius
                departure = _robust_fit(flat, at, window, inlier, zc, A, rhs, coef, buffers)
                change = 1.0 / (1.0 + departure) - 1.0
            if np.isfinite(change):
                out[v, u] = zc * (1.0 + min(max(change, -limit), limit))


def _row_weights(sigma: float, radius: int) -> np.ndarray:
    """Gaussian times the powers 0 to 4 of x = du / sigma (5, radius + 1), du from 0."""
    weights = np.empty((5, radius + 1), np.float32)
    for k in range(radius + 1):
        share = math.exp(-0.5 * (k / sigma) * (k / sigma))
        for a in range(5):
            weights[a, k] = share
            share *= k / sigma
    return weights


@lru_cache(maxsize=8)
def _taps(sigma: float, radius: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Window of the robust fit, a column a tap.

    Offset (v, u), Gaussian weight, the quadratic's six terms and their 21 products. Kept, as windows of quantised
    readings are the same in every view and frame: not to be written to.
    """
    side = range(-radius, radius + 1)
    every = [(dv, du, math.exp(-0.5 * (dv * dv + du * du) / (sigma * sigma))) for dv in side for du in side]
    kept = [tap for tap in every if tap[2] >= _REST]
    offset = np.array([tap[:2] for tap in kept]).T
    fy, fx = offset / sigma
    terms = np.stack((np.ones(len(kept)), fx, fy, fx * fx, fx * fy, fy * fy))
    products = np.stack([terms[a] * terms[b] for a in range(6) for b in range(a + 1)])
    single = np.float32
    return offset, np.array([tap[2] for tap in kept], single), terms.astype(single), products.astype(single)


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"}, error_model="numpy")
def _weighted_sums(rows, weights, count, out):
    """out[a] = rows[a] · weights for the first ``count`` rows; summed in any order, so that it vectorises."""
    for a in range(count):
        row = rows[a]
        total = np.float32(0.0)
        for k in range(len(weights)):
            total += row[k] * weights[k]
        out[a] = total


@njit(cache=True, nogil=True, error_model="numpy")
def _robust_fit(flat, at, window, inlier, zc, A, rhs, coef, buffers):
    """Departure of the fitted disparity from the centre's, relative; NaN where nothing can be fitted.

    A plane, once more where the window holds more than one surface, then the quadratic.
    """
    one, none = np.float32(1.0), np.float32(0.0)
    shift, gauss, terms, products, allowed = (
        window.shift, window.gauss, window.terms, window.products, window.allowed,
    )  # fmt: skip
    taps = len(shift)
    e, there, w, we = buffers[0, :taps], buffers[1, :taps], buffers[2, :taps], buffers[3, :taps]
    lower = np.empty(21)
    for k in range(taps):
        near = flat[at + shift[k]]
        e[k] = zc * near - one
        there[k] = gauss[k] if near > none else none
    _weighted_sums(terms, there, 1, rhs)  # the first term is 1: all the weight that readings have
    weight = rhs[0]
    mixed = False
    for turn in range(3):
        if turn == 1 and not mixed:
            continue
        order = 6 if turn == 2 else 3
        if turn == 0:
            for k in range(taps):
                r = e[k] * allowed[k]
                r = max(one - r * r, none)  # Tukey's weight
                w[k] = there[k] * r * r
                we[k] = w[k] * e[k]
        else:
            c0, c1, c2 = np.float32(coef[0]), np.float32(coef[1]), np.float32(coef[2])
            for k in range(taps):
                r = (e[k] - c0 - c1 * terms[1, k] - c2 * terms[2, k]) * inlier
                r = max(one - r * r, none)
                w[k] = there[k] * r * r
                we[k] = w[k] * e[k]
        _weighted_sums(products, w, order * (order + 1) // 2, lower)
        _weighted_sums(terms, we, order, rhs)
        mixed = lower[0] < 0.5 * weight
        if lower[0] < 1e-6:
            return np.nan
        m = 0
        for a in range(order):
            for b in range(a + 1):
                A[a, b] = lower[m]
                m += 1
        if not _solve(A, rhs, coef, order):
            return np.nan
    return coef[0] if coef[0] > -0.5 else np.nan


@njit(cache=True, nogil=True)
def _solve(A, rhs, x, n):
    """Cholesky solve of the leading n×n system given by its lower triangle, in place; False when it is singular.

    A small ridge pulls the higher orders to zero where the window holds too little.
    """
    total = A[0, 0]
    A[0, 0] += 1e-6 * total
    for i in range(1, n):
        A[i, i] += (2e-3 if i < 3 else 3e-2) * total
    for i in range(n):
        for j in range(i + 1):
            s = A[i, j]
            for k in range(j):
                s -= A[i, k] * A[j, k]
            if i == j:
                if s <= 1e-14:
                    return False
                A[i, i] = np.sqrt(s)
            else:
                A[i, j] = s / A[j, j]
    for i in range(n):
        s = rhs[i]
        for k in range(i):
            s -= A[i, k] * x[k]
        x[i] = s / A[i, i]
    for i in range(n - 1, -1, -1):
        s = x[i]
        for k in range(i + 1, n):
            s -= A[k, i] * x[k]
        x[i] = s / A[i, i]
    return True
