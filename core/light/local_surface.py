"""The surface around a pixel: a quadratic fitted to the trusted readings of its view."""

from __future__ import annotations

import numpy as np

from ..numeric.kernels import njit
from ..numeric.threads import each

RADIUS = 4
"""Readings within so many pixels are fitted."""

_PIECES = 4  # the pixels are fitted in so many pieces, side by side
_STEP = 0.02  # of z: readings at a larger distance from the middle are another surface's, more by half a pixel farther
_JUMP = 0.15  # a trusted neighbour at a larger distance is another limb's [m]
_FEWEST = 9  # readings that fix a quadratic
_RIDGE = 1e-3  # pulls slopes, and three times as much curvatures, to zero where the window holds too little


def local_surface(
    depth: np.ndarray,
    labels: np.ndarray,
    trusted: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
    packed: np.ndarray,
    reach: int = 0,
) -> np.ndarray:
    """Normal and depth of the surface at some pixels, as far as trusted readings of their own view show it.

    A quadratic in 1/z over pixel coordinates is fitted to the window, weights falling to its edge. It goes through
    the pixel's own reading or, where that is not trusted, on from the nearest trusted one.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel, -1 = none.
    trusted : np.ndarray [shape=(H, W), dtype=bool]
        The readings that are fitted.
    rows, columns : np.ndarray [shape=(N,)]
        The pixels.
    packed : np.ndarray [shape=(4,)]
        fx, fy, cx, cy [px].
    reach : int
        So near [px] must be a trusted reading.

    Returns
    -------
    np.ndarray [shape=(N, 4), dtype=float64]
        Unit normal towards the camera, as the view shows it (behind the glass), and z [m]; z = 0 where too few
        readings are there.

    Notes
    -----
    O(N · RADIUS²).
    """
    rows, columns = np.ascontiguousarray(rows), np.ascontiguousarray(columns)  # one layout, one compilation
    out = np.empty((len(rows), 4))
    step = max((len(rows) + _PIECES - 1) // _PIECES, 1)

    def fit(start: int) -> None:
        part = slice(start, start + step)
        _fit_kernel(depth, labels, trusted, rows[part], columns[part], packed, RADIUS, reach, out[part])

    each(fit, range(0, len(rows), step))
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _middle(depth, labels, trusted, v, u, reach):
    """The pixel's own reading if it is trusted, else the nearest trusted one of its view; 0 if there is none."""
    height, width = depth.shape
    own = np.float64(depth[v, u])
    if trusted[v, u] or own <= 0.0:
        return own
    nearest, middle = 1e9, 0.0
    for y in range(max(v - reach, 0), min(v + reach + 1, height)):
        for x in range(max(u - reach, 0), min(u + reach + 1, width)):
            if trusted[y, x] and labels[y, x] == labels[v, u] and abs(depth[y, x] - own) < _JUMP:
                away = float((y - v) ** 2 + (x - u) ** 2)
                if away < nearest:
                    nearest, middle = away, np.float64(depth[y, x])
    return middle


@njit(cache=True, nogil=True, error_model="numpy")
def _weighed_terms(radius):
    """Of each pixel of the window that has a weight, row by row.

    Its place (K, 2) beside the middle, the quadratic's six terms times the weight (K, 6), and these times the terms
    (K, 21), a >= b.
    """
    size = 2 * radius + 1
    most = size * size
    places, weighed, products = np.empty((most, 2), np.int64), np.empty((most, 6)), np.empty((most, 21))
    terms, count = np.empty(6), 0
    for row in range(size):
        for column in range(size):
            dx, dy = (column - radius) / radius, (row - radius) / radius
            weight = 1.2 - dx * dx - dy * dy
            if weight <= 0.0:
                continue
            terms[0], terms[1], terms[2], terms[3], terms[4], terms[5] = 1.0, dx, dy, dx * dx, dx * dy, dy * dy
            places[count, 0], places[count, 1] = row - radius, column - radius
            k = 0
            for a in range(6):
                weighed[count, a] = weight * terms[a]
                for b in range(a + 1):
                    products[count, k] = weighed[count, a] * terms[b]
                    k += 1
            count += 1
    return places[:count], weighed[:count], products[:count]


@njit(cache=True, nogil=True, error_model="numpy")
def _fit_kernel(depth, labels, trusted, rows, columns, packed, radius, reach, out):
    height, width = depth.shape
    fx, fy, cx, cy = packed
    sums, right, every = np.empty((6, 6)), np.empty(6), np.empty(21)
    places, weighed, products = _weighed_terms(radius)
    for i in range(len(rows)):
        v, u = rows[i], columns[i]
        out[i, :] = 0.0
        view, middle = labels[v, u], _middle(depth, labels, trusted, v, u, reach)
        if middle <= 0.0:
            continue
        every[:] = 0.0
        right[:] = 0.0
        count = 0
        inner = radius <= v < height - radius and radius <= u < width - radius
        for p in range(len(places)):
            dy, dx = places[p, 0], places[p, 1]
            y, x = v + dy, u + dx
            if not inner and (y < 0 or y >= height or x < 0 or x >= width):
                continue
            if not trusted[y, x] or labels[y, x] != view:
                continue
            z = np.float64(depth[y, x])
            away = max(abs(dx), abs(dy))
            if z <= 0.0 or abs(z - middle) > _STEP * middle * (1.0 + 0.5 * away):
                continue
            count += 1
            nearer = 1.0 / z - 1.0 / middle
            for a in range(6):
                right[a] += weighed[p, a] * nearer
            for k in range(21):  # in one row, so that the processor adds several at a time
                every[k] += products[p, k]
        if count < _FEWEST:
            continue
        k = 0
        for a in range(6):
            for b in range(a + 1):
                sums[a, b] = every[k]
                k += 1
        ridge = _RIDGE * sums[0, 0]
        for a in range(1, 6):
            sums[a, a] += ridge if a < 3 else 3.0 * ridge
        # Cholesky, forwards and backwards
        for a in range(6):
            for b in range(a + 1):
                total = sums[a, b]
                for c in range(b):
                    total -= sums[a, c] * sums[b, c]
                sums[a, b] = np.sqrt(total) if a == b else total / sums[b, b]
        for a in range(6):
            for c in range(a):
                right[a] -= sums[a, c] * right[c]
            right[a] /= sums[a, a]
        for a in range(5, -1, -1):
            for c in range(a + 1, 6):
                right[a] -= sums[c, a] * right[c]
            right[a] /= sums[a, a]
        near, across, down = right[0] + 1.0 / middle, right[1] / radius, right[2] / radius
        if not near > 0.0:
            continue
        nx, ny, nz = across * fx, down * fy, across * (cx - u) + down * (cy - v) + near
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = -nx / length, -ny / length, -nz / length, 1.0 / near
