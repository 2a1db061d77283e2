"""Colours of views written into the texture's image: every texel by its place on the skin."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..numeric.kernels import njit
from ..numeric.threads import each
from .color_cameras import ColorView

_AT_ONCE = 400_000  # texels of a part, about
_APERTURE = 24.0  # a mean over a cell differs from the value at its middle by its second difference over this
_POLE = float(np.sqrt(3.0) - 2.0)  # of the filter from samples to coefficients of a cubic B-spline
_FINE = 1.5  # so many pixels along a texel's side are averaged beforehand


class Shading(NamedTuple):
    """What each vertex's texels are made of, for V vertices and K views.

    Attributes
    ----------
    weight : np.ndarray [shape=(V, K + 1), dtype=float32]
        Share of each view, the last of ``fill``; rows sum to 1.
    offset : np.ndarray [shape=(V, K, 3), dtype=float32]
        Added to a view's colours [0..255].
    factor : np.ndarray [shape=(V,), dtype=float32]
        By which all is multiplied at last.
    fill : np.ndarray [shape=(V, 3), dtype=float32]
        Colour where no view is to be taken [0..255].
    table : np.ndarray [shape=(K, 3, 256), dtype=float32]
        What a view's levels become.
    """

    weight: np.ndarray
    offset: np.ndarray
    factor: np.ndarray
    fill: np.ndarray
    table: np.ndarray


class _Source(NamedTuple):
    """What is looked up in a view: spline coefficients (h, w, 3) float32 of a part of its image, its gain applied.

    ``projection`` (3, 4) float32 takes the mesh's frame to homogeneous pixels of it; ``vertex`` (V, 6) float32 are
    positions and offsets.
    """

    coefficients: np.ndarray
    projection: np.ndarray
    vertex: np.ndarray


def paint(
    vertices: np.ndarray, triangles: np.ndarray, uv: np.ndarray, size: int,
    views: Sequence[ColorView], shifts: np.ndarray, shading: Shading,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """The image, and which of its texels lie on a triangle.

    Parameters
    ----------
    vertices, triangles
        The mesh.
    uv : np.ndarray [shape=(T, 3, 2)]
        See :class:`.texture.Texture`.
    size : int
        Texels along a side.
    views, shifts
        K views, and by how much each image lies beside where its camera sees the mesh (K, 2) [px].
    shading : Shading

    Returns
    -------
    image : np.ndarray [shape=(size, size, 3), dtype=uint8]
        Black where no triangle lies.
    covered : np.ndarray [shape=(size, size), dtype=bool]

    Notes
    -----
    Images are sampled by the cubic spline of :func:`spline_coefficients`, those whose pixels are much finer than texels
    halved before.
    """
    texels = np.empty((len(triangles), 3, 2))
    texels[..., 0] = uv[..., 0].astype(np.float64) * size - 0.5
    texels[..., 1] = (1.0 - uv[..., 1].astype(np.float64)) * size - 0.5
    sources = [_source(view, shifts[k], vertices, triangles, texels, shading, k) for k, view in enumerate(views)]
    image, covered = np.zeros((size * size, 3), np.uint8), np.zeros(size * size, np.bool_)

    def part(k: int) -> None:
        found, shares = _texels_of(texels[bounds[k] : bounds[k + 1]], size)
        corner = triangles[bounds[k] + found[:, 1]]
        image[found[:, 0]] = _colors(corner, shares, sources, shading)
        covered[found[:, 0]] = True

    area = np.cumsum(_doubled(texels)) * 0.5
    parts = max(1, int(area[-1] / _AT_ONCE))
    bounds = np.searchsorted(area, area[-1] * np.arange(parts + 1) / parts)
    bounds[0], bounds[-1] = 0, len(triangles)
    each(part, range(parts))
    return image.reshape(size, size, 3), covered.reshape(size, size)


def pad(image: np.ndarray, covered: np.ndarray, width: int) -> None:
    """Give texels within ``width`` of the islands the colours of their neighbours, all others the mean; in place."""
    if not covered.any():
        return
    size = len(image)
    mean = np.array([np.bincount(image[..., c][covered], minlength=256) @ np.arange(256) for c in range(3)])
    image[~covered] = np.rint(mean / covered.sum()).astype(np.uint8)
    flat, around = image.reshape(-1, 3), np.pad(covered, 1)
    border = np.zeros(around.shape, np.bool_)
    border[1:-1, 1:-1] = covered & ~(around[:-2, 1:-1] & around[2:, 1:-1] & around[1:-1, :-2] & around[1:-1, 2:])
    done, front = around.ravel(), np.flatnonzero(border)
    steps = np.array((1, -1, size + 2, -size - 2))
    for _ in range(width):
        front = np.unique((front[:, None] + steps).ravel())
        row, column = front // (size + 2) - 1, front % (size + 2) - 1
        front = front[~done[front] & (row >= 0) & (row < size) & (column >= 0) & (column < size)]
        total, count = np.zeros((len(front), 3)), np.zeros(len(front))
        for step in (*steps, *(steps[:2] + size + 2), *(steps[:2] - size - 2)):
            beside = front + step
            known = done[beside]
            at = beside[known]
            total[known] += flat[(at // (size + 2) - 1) * size + at % (size + 2) - 1]
            count += known
        flat[(front // (size + 2) - 1) * size + front % (size + 2) - 1] = np.rint(total / count[:, None])
        done[front] = True


def _doubled(corners: np.ndarray) -> np.ndarray:
    """Twice the area (T,) of triangles (T, 3, 2)."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _source(
    view: ColorView, shift: np.ndarray, vertices: np.ndarray, triangles: np.ndarray, texels: np.ndarray,
    shading: Shading, k: int,
) -> _Source:  # fmt: skip
    """View k, halved until its pixels are about as large as texels of skin that it sees well."""
    projection = view.projection
    projection[:2] += shift[:, None] * projection[2:]
    points = vertices @ projection[:, :3].T + projection[:, 3]
    pixels = points[:, :2] / np.where(np.abs(points[:, 2:]) > 1e-6, points[:, 2:], 1e-6)
    finer = float(np.sqrt(np.quantile(_doubled(pixels[triangles]) / np.maximum(_doubled(texels), 1e-12), 0.8)))
    # the part of the image that vertices around the view's triangles see
    used = np.zeros(len(vertices), np.bool_)
    used[triangles[(shading.weight[triangles, k] > 0).any(axis=1)]] = True
    extent = np.array((view.intrinsics.width, view.intrinsics.height))
    low, high = np.zeros(2, np.int64), np.ones(2, np.int64)
    if used.any():
        low = np.clip(np.floor(pixels[used].min(axis=0)).astype(np.int64) - 8, 0, extent - 1)
        high = np.clip(np.ceil(pixels[used].max(axis=0)).astype(np.int64) + 9, low + 1, extent)
    image = view.image[low[1] : high[1], low[0] : high[0]]
    levels = np.stack([shading.table[k, c][image[..., c]] for c in range(3)], axis=2)
    projection[:2] -= low[:, None] * projection[2:]
    while finer > _FINE and min(levels.shape[:2]) > 16:
        even = levels[: levels.shape[0] // 2 * 2, : levels.shape[1] // 2 * 2]
        levels = np.float32(0.25) * (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2])
        projection = np.array(((0.5, 0.0, -0.25), (0.0, 0.5, -0.25), (0.0, 0.0, 1.0))) @ projection
        finer *= 0.5
    vertex = np.hstack((vertices, shading.offset[:, k])).astype(np.float32)
    return _Source(spline_coefficients(levels), projection.astype(np.float32), vertex)


def spline_coefficients(levels: np.ndarray) -> np.ndarray:
    """Coefficients (H, W, C) float32 of the cubic B-spline that runs through what an image (H, W, C) was taken of.

    A pixel is the mean over its square: values at pixels' middles follow from three of them, to fourth order, as cell
    means do in finite volume schemes. The spline's coefficients follow by a filter there and back along each axis
    (Unser 1999), with the outermost pixels repeated. A spline keeps patterns of three pixels a wave, which shorter
    cubics flatten.
    """
    found = np.asarray(levels, np.float32)
    for axis in (0, 1):
        lines = np.array(np.moveaxis(found, axis, 0), order="C")
        around = np.concatenate((lines[:1], lines, lines[-1:]))
        lines += (2.0 * lines - around[:-2] - around[2:]) / np.float32(_APERTURE)
        lines *= np.float32((1.0 - _POLE) ** 2)
        lines[0] /= np.float32(1.0 - _POLE)  # as if the first went on for ever
        for k in range(1, len(lines)):
            lines[k] += np.float32(_POLE) * lines[k - 1]
        lines[-1] /= np.float32(1.0 - _POLE)
        for k in range(len(lines) - 2, -1, -1):
            lines[k] += np.float32(_POLE) * lines[k + 1]
        found = np.moveaxis(lines, 0, axis)
    return np.ascontiguousarray(found)


def _texels_of(corners: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Texels on triangles (T, 3, 2): texel and triangle (N, 2) int64, shares of corners 2 and 3 (N, 2)."""
    corners = np.ascontiguousarray(corners)
    count = _raster_kernel(corners, size, np.empty((0, 2), np.int64), np.empty((0, 2), np.float32))
    found, shares = np.empty((count, 2), np.int64), np.empty((count, 2), np.float32)
    _raster_kernel(corners, size, found, shares)
    return found, shares


def _colors(corner: np.ndarray, shares: np.ndarray, sources: Sequence[_Source], shading: Shading) -> np.ndarray:
    """Colours (N, 3) uint8 at shares (N, 2) float32 between corners (N, 3)."""
    color = np.zeros((len(corner), 3), np.float32)
    weight = _blended(shading.weight, corner, shares)
    rows = np.flatnonzero(weight[:, -1] > 1e-4)
    color[rows] = weight[rows, -1:] * _blended(shading.fill, corner[rows], shares[rows])
    for k, source in enumerate(sources):
        rows = np.flatnonzero(weight[:, k] > 1e-4)
        if not len(rows):
            continue
        whole = _blended(source.vertex, corner[rows], shares[rows])
        points = whole[:, :3] @ source.projection[:, :3].T + source.projection[:, 3]
        seen = whole[:, 3:].copy()
        _sample_kernel(source.coefficients, points, seen)
        color[rows] += weight[rows, k : k + 1] * seen
    if (shading.factor != 1.0).any():
        color *= _blended(shading.factor[:, None], corner, shares)
    np.clip(color, 0.0, 255.0, out=color)
    return (color + np.float32(0.5)).astype(np.uint8)


def _blended(values: np.ndarray, corner: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Values (V, C) of the vertices at shares (N, 2) between corners (N, 3)."""
    first = values[corner[:, 0]]
    return (
        first
        + shares[:, :1] * (values[corner[:, 1]] - first)
        + shares[:, 1:] * (values[corner[:, 2]] - first)
    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def _sample_kernel(levels, points, out):
    """Add the cubic B-spline of coefficients (H, W, 3) at homogeneous points (N, 3)."""
    height, width = levels.shape[:2]
    weight = np.empty((2, 4))
    for n in range(len(points)):
        u, v = points[n, 0] / points[n, 2], points[n, 1] / points[n, 2]
        left, top = int(np.floor(u)) - 1, int(np.floor(v)) - 1
        for k in range(8):
            s = abs(u - left - k) if k < 4 else abs(v - top - k + 4)
            weight[k // 4, k % 4] = (4.0 + s * s * (3.0 * s - 6.0)) / 6.0 if s < 1.0 else (2.0 - s) ** 3 / 6.0
        red = green = blue = 0.0
        for k in range(16):
            w = weight[0, k % 4] * weight[1, k // 4]
            column, row = min(max(left + k % 4, 0), width - 1), min(max(top + k // 4, 0), height - 1)
            red += w * levels[row, column, 0]
            green += w * levels[row, column, 1]
            blue += w * levels[row, column, 2]
        out[n, 0] += red
        out[n, 1] += green
        out[n, 2] += blue


@njit(cache=True, nogil=True, error_model="numpy")
def _raster_kernel(corners, size, found, shares):
    """Fill in texels whose middles lie on triangles (T, 3, 2), as far as there is room; return how many there are."""
    count = 0
    for t in range(len(corners)):
        ax, ay = corners[t, 0, 0], corners[t, 0, 1]
        bx, by = corners[t, 1, 0] - ax, corners[t, 1, 1] - ay
        cx, cy = corners[t, 2, 0] - ax, corners[t, 2, 1] - ay
        doubled = bx * cy - by * cx
        if doubled == 0.0:
            continue
        u0, u1 = max(int(np.ceil(ax + min(bx, cx, 0.0))), 0), min(int(np.floor(ax + max(bx, cx, 0.0))), size - 1)
        v0, v1 = max(int(np.ceil(ay + min(by, cy, 0.0))), 0), min(int(np.floor(ay + max(by, cy, 0.0))), size - 1)
        for v in range(v0, v1 + 1):
            for u in range(u0, u1 + 1):
                b = ((u - ax) * cy - (v - ay) * cx) / doubled
                c = (bx * (v - ay) - by * (u - ax)) / doubled
                if b >= 0.0 and c >= 0.0 and b + c <= 1.0:
                    if count < len(found):
                        found[count, 0], found[count, 1] = v * size + u, t
                        shares[count, 0], shares[count, 1] = b, c
                    count += 1
    return count
