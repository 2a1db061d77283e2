"""Views of one body brought to one brightness and tint, by the colours on both sides of their seams."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..mesh import SEAM, Mesh
from ..numeric.kernels import njit

_DARKEST, _BRIGHTEST = 16.0, 245.0  # sRGB levels outside of these say nothing of the exposure
_UNSURE = 0.15  # standard deviation of a view's log gain before anything is known
_TOGETHER = 20  # so many neighbouring pairs say one thing
_MOST = 0.5  # largest log gain; pairs that differ by more show two things
_CELL = 0.03  # of the grid in which what is left is spread [m]
_MOST_CELLS = 128  # along each side of the grid
_SPREAD = 2  # times over a cell's neighbours: three or four centimetres
_FAINT = 1e-2  # of a seam's weight: nothing is spread farther


class _Pairs(NamedTuple):
    """Vertices (K, 2) of two views, the lower first, that a seam joins; logarithm (K, 3) of second over first level."""

    vertex: np.ndarray
    ratio: np.ndarray


def match_exposures(mesh: Mesh, mirrored: np.ndarray) -> Mesh:
    """The zippered mesh with the colours of every view multiplied so that they agree over the seams.

    A mirror swallows a part of the light and tints the rest; cameras choose their exposure themselves. Either is one
    factor a view and channel. Where two views meet, a seam joins a vertex of one with one of the other that shows
    almost the same spot: the factors make the logarithms of their levels agree, by weighted least squares with the
    factors expected near 1. On the mean, the views without a mirror keep their brightness. What still differs in
    brightness at a seam, as where the light is another one, is shared by both sides and fades out over three or four
    centimetres.

    Parameters
    ----------
    mesh : Mesh
        With seams, before it is closed. Without colours it is returned as it is.
    mirrored : np.ndarray [shape=(N,), dtype=bool]
        Of each view.

    Notes
    -----
    O(V + T).
    """
    if mesh.colors is None or mesh.view is None or mesh.kind is None or len(mirrored) < 2:
        return mesh
    pairs = _seam_pairs(mesh)
    if not len(pairs.vertex):
        return mesh
    gain = _gains(pairs, mesh.view, mirrored)
    seen = np.flatnonzero(mesh.view >= 0)
    brighter = gain[mesh.view[seen]]
    first, second = mesh.view[pairs.vertex].T
    # of brightness only: dark colours tell little of a tint
    left = np.clip((pairs.ratio + gain[second] - gain[first]).mean(axis=1, keepdims=True), -_MOST, _MOST)
    for view in np.unique(mesh.view[pairs.vertex]):
        mine = mesh.view[seen] == view
        places = np.concatenate((pairs.vertex[first == view, 0], pairs.vertex[second == view, 1]))
        half = 0.5 * np.concatenate((left[first == view], -left[second == view]))
        brighter[mine] += _spread(mesh.vertices[seen[mine]], mesh.vertices[places], half)
    colors = mesh.colors.copy()
    colors[seen] = np.clip(np.rint(colors[seen] * np.exp(brighter)), 0, 255).astype(np.uint8)
    return replace(mesh, colors=colors)


def _seam_pairs(mesh: Mesh) -> _Pairs:
    assert mesh.view is not None and mesh.kind is not None and mesh.colors is not None
    strips = mesh.triangles[mesh.kind == SEAM]
    pairs = np.concatenate([strips[:, [k, (k + 1) % 3]] for k in range(3)])
    at = mesh.view[pairs]
    pairs = pairs[(at[:, 0] >= 0) & (at[:, 1] >= 0) & (at[:, 0] != at[:, 1])]
    pairs = np.where((mesh.view[pairs[:, 0]] > mesh.view[pairs[:, 1]])[:, None], pairs[:, ::-1], pairs)
    levels = mesh.colors[pairs].astype(np.float64)
    told = ((levels > _DARKEST) & (levels < _BRIGHTEST)).all(axis=(1, 2))
    return _Pairs(pairs[told], np.log(levels[told, 1] / levels[told, 0]))


def _gains(pairs: _Pairs, view: np.ndarray, mirrored: np.ndarray) -> np.ndarray:
    """Natural logarithms (N, 3) of what each view's colours are to be multiplied with."""
    views, ratio = len(mirrored), pairs.ratio
    gain = np.zeros((views, 3))
    number = view[pairs.vertex[:, 0]].astype(np.int64) * views + view[pairs.vertex[:, 1]]
    for channel in range(3):
        A, b = np.eye(views) / _UNSURE**2, np.zeros(views)
        for pair in np.unique(number):
            some = ratio[number == pair, channel]
            middle = float(np.median(some))
            spread = 1.4826 * float(np.median(np.abs(some - middle))) + 0.02
            weight = len(some) / _TOGETHER / spread**2
            i, j = divmod(int(pair), views)
            A[i, i] += weight
            A[j, j] += weight
            A[i, j] -= weight
            A[j, i] -= weight
            b[i] += weight * middle
            b[j] -= weight * middle
        gain[:, channel] = np.linalg.solve(A, b)
    kept = ~mirrored if not mirrored.all() else np.ones(views, np.bool_)
    gain -= gain[kept].mean(axis=0)
    return np.clip(gain, -_MOST, _MOST)


def _spread(points: np.ndarray, places: np.ndarray, values: np.ndarray) -> np.ndarray:
    """At ``points`` (V, 3), the mean of the ``values`` (K, 1) near them, less and less away from their ``places``.

    Both are spread on a grid, values and weights alike; there one is divided by the other.
    """
    edge = max(_CELL, float(np.ptp(places, axis=0).max()) / _MOST_CELLS)
    low = places.min(axis=0) - (_SPREAD + 1.5) * edge
    size = np.ceil((places.max(axis=0) - low) / edge).astype(np.int64) + _SPREAD + 2
    cell = np.rint((places - low) / edge).astype(np.int64)
    flat = np.ravel_multi_index(tuple(cell.T), tuple(size))
    weighed = np.column_stack((values, np.ones(len(values))))
    grid: np.ndarray = np.stack([np.bincount(flat, weighed[:, c], int(size.prod())) for c in range(2)], axis=1)
    grid = grid.astype(np.float32).reshape(*size, 2)
    grid /= np.maximum(grid[..., 1:], 1.0)  # a cell counts once, however dense its seam
    for axis in range(3):
        rows = np.moveaxis(grid, axis, 0)
        for _ in range(_SPREAD):  # the outermost cells are empty
            rows[1:-1] = 0.5 * rows[1:-1] + 0.25 * (rows[:-2] + rows[2:])
    table = grid.reshape(-1, 2)
    # typical of a seam, as what is spread along a line thins out away from it
    whole = float(np.quantile(table[flat, 1], 0.25))
    return _read_kernel(points, grid, low, edge, whole)[:, None]


@njit(cache=True, nogil=True)
def _read_kernel(points, grid, low, edge, whole):
    """The spread mean at each point (V,), between the cells of a grid (X, Y, Z, 2) of sums and weights."""
    out = np.zeros(len(points))
    base, part = np.empty(3, np.int64), np.empty(3)
    for i in range(len(points)):
        inside = True
        for c in range(3):
            there = (points[i, c] - low[c]) / edge
            inside = inside and 0.0 <= there < grid.shape[c] - 1
            base[c] = int(there) if inside else 0
            part[c] = there - base[c]
        if not inside or grid[base[0], base[1], base[2], 1] <= _FAINT * whole:
            continue
        total, weight = 0.0, 0.0
        for x in range(2):
            for y in range(2):
                for z in range(2):
                    share = part[0] if x else 1.0 - part[0]
                    share *= part[1] if y else 1.0 - part[1]
                    share *= part[2] if z else 1.0 - part[2]
                    total += share * grid[base[0] + x, base[1] + y, base[2] + z, 0]
                    weight += share * grid[base[0] + x, base[1] + y, base[2] + z, 1]
        out[i] = total / max(weight, whole)
    return out
