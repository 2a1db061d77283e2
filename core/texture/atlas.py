"""Colours of views written into the texture's image: every texel by its place on the skin."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..numeric.kernels import njit
from ..numeric.threads import each
from .color_cameras import ColorView

_PARTS = 16  # that the triangles are painted in, on all cores
_MOST_SAMPLES = 4  # along a texel's side


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
    Images are sampled by Catmull and Rom's cubic (1974); where pixels are finer than texels, several times a texel.
    """
    pixels, start, extent = _stacked(views)
    projection = np.array([view.projection for view in views]).reshape(-1, 3, 4)
    projection[:, :2] += shifts[:, :, None] * projection[:, 2:3]
    texels = np.empty((len(triangles), 3, 2))
    texels[..., 0] = uv[..., 0].astype(np.float64) * size - 0.5
    texels[..., 1] = (1.0 - uv[..., 1].astype(np.float64)) * size - 0.5
    image, covered = np.zeros((size, size, 3), np.uint8), np.zeros((size, size), np.bool_)
    vertices = np.ascontiguousarray(vertices, np.float64)
    bounds = np.linspace(0, len(triangles), _PARTS + 1).astype(np.int64)
    each(
        lambda k: _paint_kernel(
            bounds[k], bounds[k + 1], vertices, triangles, texels, pixels, start, extent, projection, shading, image,
            covered,
        ),
        range(_PARTS),
    )  # fmt: skip
    return image, covered


def pad(image: np.ndarray, covered: np.ndarray, width: int) -> None:
    """Give texels within ``width`` of the islands the colours of their neighbours, all others the mean; in place."""
    if not covered.any():
        return
    mean = np.array([np.bincount(image[..., c][covered], minlength=256) @ np.arange(256) for c in range(3)])
    mean = np.rint(mean / covered.sum()).astype(np.uint8)
    done = covered.copy()
    _pad_kernel(image, done, width)
    image[~done] = mean


def _stacked(views: Sequence[ColorView]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (N, 3) of all images, each kept once; where each view's begin (K,), and its width and height (K, 2)."""
    images: list[np.ndarray] = []
    start = np.zeros(len(views), np.int64)
    extent = np.array([(v.intrinsics.width, v.intrinsics.height) for v in views], np.int64).reshape(-1, 2)
    for k, view in enumerate(views):
        same = next((j for j in range(k) if views[j].image is view.image), None)
        if same is None:
            start[k] = sum(len(image) for image in images)
            images.append(view.image.reshape(-1, 3))
        else:
            start[k] = start[same]
    return (np.concatenate(images) if images else np.zeros((1, 3), np.uint8)), start, extent


@njit(cache=True, nogil=True, error_model="numpy")
def _cubic(t, weights):
    """Catmull and Rom's weights (4,) at share ``t`` between the middle two of four samples."""
    weights[0] = t * (-0.5 + t * (1.0 - 0.5 * t))
    weights[1] = 1.0 + t * t * (-2.5 + 1.5 * t)
    weights[2] = t * (0.5 + t * (2.0 - 1.5 * t))
    weights[3] = t * t * (-0.5 + 0.5 * t)


@njit(cache=True, nogil=True, error_model="numpy")
def _sample(pixels, start, width, height, table, u, v, across, down, out):
    """Colour (3,) of an image at (u, v), its levels by ``table`` (3, 256)."""
    u0, v0 = np.floor(u), np.floor(v)
    _cubic(u - u0, across)
    _cubic(v - v0, down)
    out[:] = 0.0
    for j in range(4):
        row = start + min(max(int(v0) - 1 + j, 0), height - 1) * width
        for i in range(4):
            at = row + min(max(int(u0) - 1 + i, 0), width - 1)
            w = across[i] * down[j]
            out[0] += w * table[0, pixels[at, 0]]
            out[1] += w * table[1, pixels[at, 1]]
            out[2] += w * table[2, pixels[at, 2]]


@njit(cache=True, nogil=True, error_model="numpy")
def _project(projection, k, x, y, z):
    """Pixel of a point in view k."""
    p = projection
    w = p[k, 2, 0] * x + p[k, 2, 1] * y + p[k, 2, 2] * z + p[k, 2, 3]
    u = p[k, 0, 0] * x + p[k, 0, 1] * y + p[k, 0, 2] * z + p[k, 0, 3]
    v = p[k, 1, 0] * x + p[k, 1, 1] * y + p[k, 1, 2] * z + p[k, 1, 3]
    return u / w, v / w


@njit(cache=True, nogil=True, error_model="numpy")
def _samples_a_side(corner, projection, k, texels, t, doubled):
    """How many samples along a texel's side view k is worth on triangle t."""
    ua, va = _project(projection, k, corner[0, 0], corner[0, 1], corner[0, 2])
    ub, vb = _project(projection, k, corner[1, 0], corner[1, 1], corner[1, 2])
    uc, vc = _project(projection, k, corner[2, 0], corner[2, 1], corner[2, 2])
    seen = abs((ub - ua) * (vc - va) - (vb - va) * (uc - ua))
    side = np.sqrt(seen / max(abs(doubled), 1e-12))
    return min(max(int(np.ceil(side / 1.25)), 1), _MOST_SAMPLES)


@njit(cache=True, nogil=True, error_model="numpy")
def _paint_kernel(
    first, last, vertices, triangles, texels, pixels, start, extent, projection, shading, image, covered
):  # fmt: skip
    """:func:`paint` of the triangles from ``first`` to ``last``."""
    size, views = len(image), len(projection)
    corner, color, sample = np.empty((3, 3)), np.empty(3), np.empty(3)
    across, down, bary = np.empty(4), np.empty(4), np.empty(3)
    samples = np.ones(views, np.int64)
    for t in range(first, last):
        ax, ay = texels[t, 0, 0], texels[t, 0, 1]
        bx, by = texels[t, 1, 0], texels[t, 1, 1]
        cx, cy = texels[t, 2, 0], texels[t, 2, 1]
        doubled = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if doubled == 0.0:
            continue
        for i in range(3):
            for c in range(3):
                corner[i, c] = vertices[triangles[t, i], c]
        for k in range(views):
            samples[k] = _samples_a_side(corner, projection, k, texels, t, doubled)
        u0, u1 = max(int(np.ceil(min(ax, bx, cx))), 0), min(int(np.floor(max(ax, bx, cx))), size - 1)
        v0, v1 = max(int(np.ceil(min(ay, by, cy))), 0), min(int(np.floor(max(ay, by, cy))), size - 1)
        for v in range(v0, v1 + 1):
            for u in range(u0, u1 + 1):
                bary[1] = ((u - ax) * (cy - ay) - (v - ay) * (cx - ax)) / doubled
                bary[2] = ((bx - ax) * (v - ay) - (by - ay) * (u - ax)) / doubled
                bary[0] = 1.0 - bary[1] - bary[2]
                if bary[0] < 0.0 or bary[1] < 0.0 or bary[2] < 0.0:
                    continue
                _texel(
                    u, v, t, bary, corner, triangles, texels, doubled, samples, pixels, start, extent, projection,
                    shading, across, down, sample, color,
                )  # fmt: skip
                for c in range(3):
                    image[v, u, c] = np.uint8(min(max(color[c], 0.0), 255.0) + 0.5)
                covered[v, u] = True


@njit(cache=True, nogil=True, error_model="numpy")
def _texel(
    u, v, t, bary, corner, triangles, texels, doubled, samples, pixels, start, extent, projection, shading,
    across, down, sample, color,
):  # fmt: skip
    """Colour (3,) of texel (u, v) on triangle t, at its shares ``bary`` (3,) of the corners."""
    a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    views = len(projection)
    weight = shading.weight
    filled = bary[0] * weight[a, views] + bary[1] * weight[b, views] + bary[2] * weight[c, views]
    for i in range(3):
        fill = shading.fill
        color[i] = filled * (bary[0] * fill[a, i] + bary[1] * fill[b, i] + bary[2] * fill[c, i])
    for k in range(views):
        share = bary[0] * weight[a, k] + bary[1] * weight[b, k] + bary[2] * weight[c, k]
        if share < 1e-4:
            continue
        n = samples[k]
        for j in range(n):
            for i in range(n):
                x = (i + 0.5) / n - 0.5
                y = (j + 0.5) / n - 0.5
                db = (x * (texels[t, 2, 1] - texels[t, 0, 1]) - y * (texels[t, 2, 0] - texels[t, 0, 0])) / doubled
                dc = ((texels[t, 1, 0] - texels[t, 0, 0]) * y - (texels[t, 1, 1] - texels[t, 0, 1]) * x) / doubled
                wb, wc = bary[1] + db, bary[2] + dc
                wa = 1.0 - wb - wc
                px = wa * corner[0, 0] + wb * corner[1, 0] + wc * corner[2, 0]
                py = wa * corner[0, 1] + wb * corner[1, 1] + wc * corner[2, 1]
                pz = wa * corner[0, 2] + wb * corner[1, 2] + wc * corner[2, 2]
                column, row = _project(projection, k, px, py, pz)
                _sample(
                    pixels, start[k], extent[k, 0], extent[k, 1], shading.table[k], column, row, across, down, sample
                )
                for q in range(3):
                    color[q] += share / (n * n) * sample[q]
        offset = shading.offset
        for q in range(3):
            color[q] += share * (bary[0] * offset[a, k, q] + bary[1] * offset[b, k, q] + bary[2] * offset[c, k, q])
    factor = bary[0] * shading.factor[a] + bary[1] * shading.factor[b] + bary[2] * shading.factor[c]
    for q in range(3):
        color[q] *= factor


@njit(cache=True, nogil=True)
def _pad_kernel(image, done, width):
    """Grow the texels that are ``done`` (S, S) by ``width`` rounds, each new one the mean of those beside it."""
    size = len(done)
    front = np.empty(size * size, np.int32)
    waiting = np.zeros((size, size), np.bool_)
    count = 0
    for v in range(size):
        for u in range(size):
            if not done[v, u] and (
                (v > 0 and done[v - 1, u]) or (v < size - 1 and done[v + 1, u])
                or (u > 0 and done[v, u - 1]) or (u < size - 1 and done[v, u + 1])
            ):  # fmt: skip
                waiting[v, u] = True
                front[count] = v * size + u
                count += 1
    first = 0
    for _ in range(width):
        last = count
        for n in range(first, last):
            v, u = front[n] // size, front[n] % size
            total = 0
            red, green, blue = 0, 0, 0
            for dv in range(max(v - 1, 0), min(v + 2, size)):
                for du in range(max(u - 1, 0), min(u + 2, size)):
                    if done[dv, du]:
                        red += image[dv, du, 0]
                        green += image[dv, du, 1]
                        blue += image[dv, du, 2]
                        total += 1
            if total > 0:
                image[v, u, 0], image[v, u, 1], image[v, u, 2] = red // total, green // total, blue // total
        for n in range(first, last):
            v, u = front[n] // size, front[n] % size
            done[v, u] = True
        for n in range(first, last):
            v, u = front[n] // size, front[n] % size
            for side in range(4):
                dv = v + (1 if side == 0 else -1 if side == 1 else 0)
                du = u + (1 if side == 2 else -1 if side == 3 else 0)
                if 0 <= dv < size and 0 <= du < size and not done[dv, du] and not waiting[dv, du]:
                    waiting[dv, du] = True
                    front[count] = dv * size + du
                    count += 1
        first = last
