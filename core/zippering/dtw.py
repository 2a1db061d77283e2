"""Dynamic time warping of two polylines: the cheapest in-order matching of their vertices (paper 4.2.2)."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np

from ..errors import MirrorScanError
from ..numeric.kernels import njit

MEMORY = 1 << 26
"""Bytes that the steps of one warping may take, unless told otherwise."""


@dataclass(frozen=True)
class Warping:
    """Result of :func:`dtw`.

    Parameters
    ----------
    path : np.ndarray [shape=(K, 2), dtype=int32]
        The warping path: matched indices (i, j), each step adds (1, 0), (0, 1) or (1, 1).
    distance : float
        Accumulated local cost along the path, skipped ends included.
    """

    path: np.ndarray
    distance: float


def dtw(x: np.ndarray, y: np.ndarray, skip: float = np.inf, memory: int = MEMORY) -> Warping:
    """Match two sequences of feature vectors in order, at the least accumulated Euclidean distance.

    Parameters
    ----------
    x : np.ndarray [shape=(N, D)]
        First sequence, finite. D = 3 for polylines; further columns (tangents, normals, scaled to metres) weigh in.
    y : np.ndarray [shape=(M, D)]
        Second sequence.
    skip : float
        Open begin and end: at either end, vertices of one sequence may stay unmatched at this cost each.
        Infinite (the default) matches both ends.
    memory : int
        Bytes the steps may take. Where N·M needs more, stretches of diagonals are computed twice instead.

    Returns
    -------
    Warping

    Raises
    ------
    MirrorScanError
        Empty sequences, different D, values that are no finite numbers, or a distance too large for float64.

    Notes
    -----
    Sakoe and Chiba 1978, in O(N·M) time. Memory: one byte a cell while that fits ``memory``, else
    O(min(N, M)·√(N + M)): some 40 MB for 20 000 × 20 000 vertices. Cells are visited by anti-diagonals, whose cells do
    not depend on each other, so that the inner loop vectorises. Values whose squares float64 does not hold take a
    slower way.

    Examples
    --------
    >>> dtw(np.array([[0.0], [1.0], [2.0]]), np.array([[0.0], [2.0]])).path.tolist()
    [[0, 0], [1, 0], [2, 1]]
    """
    x, y = _numbers(x), _numbers(y)
    if x.ndim != 2 or y.ndim != 2 or not len(x) or not len(y) or x.shape[1] != y.shape[1]:
        raise MirrorScanError(f"dtw needs two non-empty (N, D) sequences of the same D, got {x.shape} and {y.shape}")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise MirrorScanError("dtw needs finite values; a sequence holds NaN or infinity")
    if not isinstance(skip, Real) or not skip >= 0:  # nor NaN
        raise MirrorScanError(f"dtw: the cost of skipping a vertex must be a number that is not negative, got {skip}")
    sizes = np.abs(np.concatenate((x.ravel(), y.ravel())))
    largest, smallest = sizes.max(initial=0.0), sizes.min(where=sizes > 0, initial=np.inf)
    # differences of two numbers are 0 or not much smaller than the smallest of them
    careful = largest > _LARGEST or smallest < _SMALLEST
    shift = _HEADROOM + int(np.log2(x.size + y.size + 1)) if largest > _FAR else 0
    if shift:  # sums of them must not become infinite
        x, y, skip = np.ldexp(x, -shift), np.ldexp(y, -shift), float(np.ldexp(float(skip), -shift))
    memory = int(min(max(memory, 0), 1 << 62))
    path, distance = warp(np.ascontiguousarray(x.T), np.ascontiguousarray(y.T), float(skip), memory, careful)
    with np.errstate(over="ignore"):
        distance = float(np.ldexp(distance, shift))
    if not np.isfinite(distance):
        raise MirrorScanError("dtw: the values are so far apart that the distance is too large for float64; scale them")
    return Warping(path, distance)


_LARGEST, _SMALLEST = 1e150, 1e-130  # between these the squares of differences are neither infinite nor rounded to 0
_FAR = 1e290  # above, sums of distances may be infinite
_HEADROOM = 3  # bits: a difference of two numbers, and rounding


def _numbers(sequence: np.ndarray) -> np.ndarray:
    """A sequence as float64.

    Raises
    ------
    MirrorScanError
        When that cannot be.
    """
    try:
        if np.iscomplexobj(sequence):
            raise TypeError("complex numbers have no order here")
        with np.errstate(over="ignore"):  # becomes infinite, which is refused
            return np.ascontiguousarray(sequence, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise MirrorScanError(f"dtw needs two sequences of numbers ({error})") from error


@njit(cache=True, nogil=True, error_model="numpy")
def warp(x, y, skip, memory, careful):
    """:func:`dtw` from inside another kernel: sequences (D, N) and (D, M), unchecked; path (K, 2) and distance.

    ``careful``: squares of the values may be too large or too small for float64.
    """
    flip = x.shape[1] > y.shape[1]  # the shorter one indexes the diagonals' cells
    if flip:
        x, y = y, x
    size = y.shape[1]
    y_reversed = np.empty(y.shape)
    for c in range(len(y)):
        for k in range(size):
            y_reversed[c, k] = y[c, size - 1 - k]
    path, distance = _warp(x, y_reversed, skip, memory, careful)
    if flip:
        for k in range(len(path)):
            path[k, 0], path[k, 1] = path[k, 1], path[k, 0]
    return path, distance


@njit(cache=True, nogil=True, error_model="numpy")
def _diagonal(cost, up, left, across, out, step):
    """Out = cost + min of the three predecessors; ties go to the diagonal step, then to the first sequence."""
    for k in range(len(cost)):
        best = across[k]
        which = np.uint8(0)
        if up[k] < best:
            best = up[k]
            which = np.uint8(1)
        if left[k] < best:
            best = left[k]
            which = np.uint8(2)
        out[k] = cost[k] + best
        step[k] = which


@njit(cache=True, nogil=True, error_model="numpy")
def _add_squares(a, b, out):
    for k in range(len(out)):
        d = a[k] - b[k]
        out[k] += d * d


@njit(cache=True, nogil=True, error_model="numpy")
def _roots(out):
    for k in range(len(out)):
        out[k] = np.sqrt(out[k])


@njit(cache=True, nogil=True, error_model="numpy")
def _lengthen(a, b, out):
    """Lengths in one dimension more, where no square is exact."""
    for k in range(len(out)):
        d = abs(a[k] - b[k])
        longer, shorter = max(d, out[k]), min(d, out[k])
        ratio = shorter / longer if longer > 0.0 else 0.0
        out[k] = longer * np.sqrt(1.0 + ratio * ratio)


@njit(cache=True, nogil=True, error_model="numpy")
def _accumulate(x, y_reversed, skip, first, last, before, earlier, steps, best, careful):
    """Accumulated cost by anti-diagonals i + j = d for first ≤ d < last; row d - first of ``steps`` holds their steps.

    ``x`` (D, N) is the shorter, ``y_reversed`` (D, M) runs backwards so that a diagonal reads both forwards.
    ``before`` and ``earlier`` (N + 2,) are the two diagonals before ``first``, cell i at i + 1, and the two before
    ``last`` on return. ``best`` = (distance, i, j) of the cheapest end so far.
    """
    dims, n = x.shape
    m = y_reversed.shape[1]
    one, two, now = np.empty(n + 2), np.empty(n + 2), np.empty(n + 2)
    for k in range(n + 2):
        one[k], two[k], now[k] = before[k], earlier[k], np.inf
    cost = np.empty(n)
    for d in range(first, last):
        lo, hi = max(0, d - m + 1), min(n, d + 1)
        c = cost[: hi - lo]
        c[:] = 0.0
        shift = m - 1 - d
        for k in range(dims):
            if careful:
                _lengthen(x[k, lo:hi], y_reversed[k, lo + shift : hi + shift], c)
            else:
                _add_squares(x[k, lo:hi], y_reversed[k, lo + shift : hi + shift], c)
        if not careful:
            _roots(c)
        row = steps[d - first]
        now[lo] = np.inf
        now[hi + 1] = np.inf
        if d == 0:
            now[1] = c[0]
            row[0] = 3
        else:
            # (i-1, j) and (i, j-1) lie on the last diagonal, (i-1, j-1) on the one before
            _diagonal(c, one[lo:hi], one[lo + 1 : hi + 1], two[lo:hi], now[lo + 1 : hi + 1], row[lo:hi])
            if skip < np.inf:
                if lo == 0 and skip * d + c[0] < now[1]:  # starts at (0, d)
                    now[1] = skip * d + c[0]
                    row[0] = 3
                if hi == d + 1 and skip * d + c[hi - 1 - lo] < now[d + 1]:  # starts at (d, 0)
                    now[d + 1] = skip * d + c[hi - 1 - lo]
                    row[d] = 3
        if d == n + m - 2 and now[n] < best[0]:
            best[0], best[1], best[2] = now[n], n - 1, m - 1
        if skip < np.inf:
            if lo == d - m + 1 and now[lo + 1] + skip * (n - 1 - lo) < best[0]:  # ends at (lo, m-1)
                best[0], best[1], best[2] = now[lo + 1] + skip * (n - 1 - lo), lo, m - 1
            if hi == n and now[n] + skip * (m - 1 - (d - n + 1)) < best[0]:  # ends at (n-1, d-n+1)
                best[0], best[1], best[2] = now[n] + skip * (m - 1 - (d - n + 1)), n - 1, d - n + 1
        two, one, now = one, now, two
    for k in range(n + 2):
        before[k], earlier[k] = one[k], two[k]


@njit(cache=True, nogil=True, error_model="numpy")
def _warp(x, y_reversed, skip, memory, careful):
    """Path and distance, by stretches of diagonals; each keeps the two before it, to be done again on the way back."""
    n, m = x.shape[1], y_reversed.shape[1]
    diagonals = n + m - 1
    stretch = diagonals
    if diagonals * n > memory:
        stretch = min(diagonals, max(int(np.sqrt(16.0 * diagonals)), 2))  # two float diagonals weigh 16 rows of steps
    count = (diagonals + stretch - 1) // stretch
    # of each stretch the two diagonals before it, one after the other; last those before the next stretch
    starts = np.empty((count + 1, 2 * (n + 2)))
    for k in range(2 * (n + 2)):
        starts[count, k] = np.inf
    before, earlier = starts[count, : n + 2], starts[count, n + 2 :]
    steps = np.empty((stretch, n), np.uint8)
    best = np.empty(3)
    best[0], best[1], best[2] = np.inf, n - 1.0, m - 1.0  # a path even where every way is infinitely long
    for s in range(count):
        for k in range(2 * (n + 2)):
            starts[s, k] = starts[count, k]
        last = min((s + 1) * stretch, diagonals)
        _accumulate(x, y_reversed, skip, s * stretch, last, before, earlier, steps, best, careful)
    i, j = int(best[1]), int(best[2])
    path = np.empty((i + j + 1, 2), np.int32)
    k = len(path)
    held = count - 1  # the stretch whose steps are in memory
    scrap = np.zeros(3)  # no end is better than this one: only the steps are wanted now
    while True:
        k -= 1
        path[k, 0] = i
        path[k, 1] = j
        s = (i + j) // stretch
        if s != held:
            last = min((s + 1) * stretch, diagonals)
            _accumulate(
                x, y_reversed, skip, s * stretch, last, starts[s, : n + 2], starts[s, n + 2 :], steps, scrap, careful
            )
            held = s
        step = steps[i + j - s * stretch, i]
        if step == 3 or (i == 0 and j == 0):
            break
        if i == 0:
            j -= 1
        elif j == 0:
            i -= 1
        elif step == 0:
            i -= 1
            j -= 1
        elif step == 1:
            i -= 1
        else:
            j -= 1
    return path[k:].copy(), best[0]
