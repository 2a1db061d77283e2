"""Depth grid → triangles, a view at a time and before reflection.

Neighbours in the image are neighbours on the surface (paper 4.2.1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mesh import SURFACE, Mesh
from ..mesh.half_edges import keep_twins, twins
from ..mesh.submesh import components_of, keep_triangles, remove_bowties
from ..numeric.kernels import njit
from .outline_clipping import trim_outline

_ACROSS = 1.42  # pixels that meet in a corner are so much farther apart


@dataclass(frozen=True)
class TriangulationSettings:
    """How a view becomes a patch.

    Parameters
    ----------
    max_slope : float
        Neighbouring pixels are joined when the surface between them is tilted less than this from head-on [degrees].
    jump_floor : float
        Depth differences below this share of z are always joined, and more where noise is larger.
    min_triangles : int
        Connected pieces with fewer triangles are specks and dropped.
    outline : float
        How much of what sticks out of a patch's outline is cut off [0 = nothing, 0.6 = all but straight runs].
    """

    max_slope: float = 75.0
    jump_floor: float = 0.004
    min_triangles: int = 40
    outline: float = 0.5


def triangulate_view(
    depth: np.ndarray,
    labels: np.ndarray,
    view: int,
    points: np.ndarray,
    pixel_angle: float,
    noise: float,
    color: np.ndarray | None = None,
    settings: TriangulationSettings = TriangulationSettings(),
) -> Mesh:
    """Patch of one view: two triangles for every square of pixels that depth continues across.

    Each square is split along its shorter diagonal in space; a square with one pixel missing gives one triangle.
    Triangles face the camera. ``points`` may be anything with one row a pixel: unprojected points give the patch behind
    the mirror; connectivity does not change by reflecting.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m].
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel.
    view : int
        The one to triangulate.
    points : np.ndarray [shape=(H, W, 3)]
        Unprojected pixels, camera frame [m].
    pixel_angle : float
        1/f [1/px].
    noise : float
        Standard deviation of a reading relative to z, after smoothing.
    color : np.ndarray [shape=(H, W, 3), dtype=uint8] or None

    Returns
    -------
    Mesh
        May be empty. O(H W).
    """
    slope = _slope(pixel_angle, settings)
    rows, columns = np.flatnonzero((labels == view).any(axis=1)), np.flatnonzero((labels == view).any(axis=0))
    if not len(rows):
        box = (0, 0, 0, 0)
    else:
        box = (rows[0], rows[-1], columns[0], columns[-1])
    triangles, pixels = _grid_kernel(depth, labels, view, points, slope, _floor(noise, settings), box)
    vertices = points.reshape(-1, 3)[pixels]
    patch = Mesh(
        vertices,
        triangles,
        None if color is None else np.ascontiguousarray(color.reshape(-1, 3)[pixels]),
        np.full(len(vertices), view, np.int8),
        np.full(len(triangles), SURFACE, np.int8),
    )
    return clean_patch(trim_outline(patch, settings.outline), settings.min_triangles)


def largest_jump(pixel_angle: float, noise: float, settings: TriangulationSettings = TriangulationSettings()) -> float:
    """Depth difference up to which neighbouring pixels are joined, relative to z.

    ``pixel_angle`` and ``noise`` as in :func:`triangulate_view`.
    """
    return max(_slope(pixel_angle, settings) * _ACROSS, _floor(noise, settings))


def _slope(pixel_angle: float, settings: TriangulationSettings) -> float:
    return np.tan(np.radians(settings.max_slope)) * pixel_angle


def _floor(noise: float, settings: TriangulationSettings) -> float:
    return settings.jump_floor + 3.0 * noise


def clean_patch(patch: Mesh, min_triangles: int) -> Mesh:
    """Take off what makes a boundary ragged: teeth (triangles hanging by one edge or corner), specks, bow-ties."""
    if not len(patch.triangles):
        return patch
    twin = twins(patch.triangles, len(patch.vertices))
    keep = _peel_kernel(twin)
    label, count = components_of(twin, len(patch.triangles))  # what was peeled off is alone now
    keep &= np.bincount(label[keep], minlength=count)[label] >= min_triangles
    return remove_bowties(keep_triangles(patch, keep), keep_twins(twin, keep))


@njit(cache=True, nogil=True)
def _peel_kernel(twin):
    """Which triangles stay when those sharing fewer than two edges are taken off, over and over; cuts their twins."""
    count = len(twin) // 3
    keep = np.ones(count, np.bool_)
    stack = np.empty(4 * count, np.int64)
    for t in range(count):
        stack[t] = t
    top = count
    while top > 0:
        top -= 1
        t = stack[top]
        if not keep[t]:
            continue
        shared = 0
        for k in range(3):
            shared += twin[3 * t + k] >= 0
        if shared >= 2:
            continue
        keep[t] = False
        for k in range(3):
            e = twin[3 * t + k]
            if e >= 0:
                twin[e] = -1
                twin[3 * t + k] = -1
                stack[top] = e // 3
                top += 1
    return keep


@njit(cache=True, nogil=True, error_model="numpy")
def _joined(za, zb, slope, floor):
    # the depth difference against the distance across the line of sight, both relative to z
    z = min(za, zb)
    return abs(za - zb) <= max(slope * z * _ACROSS, floor * z)


@njit(cache=True, nogil=True, error_model="numpy")
def _distance2(points, i, j):
    return (points[i, 0] - points[j, 0]) ** 2 + (points[i, 1] - points[j, 1]) ** 2 + (points[i, 2] - points[j, 2]) ** 2


@njit(cache=True, nogil=True, error_model="numpy")
def _grid_kernel(depth, labels, view, points, slope, floor, box):
    """Triangles (T, 3) in numbers of vertices, and each vertex's pixel (V,) in the flattened image."""
    width = depth.shape[1]
    z, label, place = depth.ravel(), labels.ravel(), points.reshape(-1, 3)
    index = np.full(len(z), -1, np.int32)
    room = (box[1] - box[0] + 1) * (box[3] - box[2] + 1)
    pixels = np.empty(room, np.int64)
    triangles = np.empty((2 * room, 3), np.int32)
    n_vertices = 0
    n = 0
    for v in range(box[0], box[1]):
        for u in range(box[2], box[3]):
            # counter-clockwise seen from the camera (v points down): top left, bottom left, bottom right, top right
            a = v * width + u
            b, c, d = a + width, a + width + 1, a + 1
            has_a, has_b, has_c, has_d = label[a] == view, label[b] == view, label[c] == view, label[d] == view
            valid = np.int64(has_a) + np.int64(has_b) + np.int64(has_c) + np.int64(has_d)
            if valid < 3:
                continue
            start = n
            if valid == 4:
                if _distance2(place, a, c) <= _distance2(place, b, d):
                    n = _add(a, b, c, z, slope, floor, triangles, n)
                    n = _add(a, c, d, z, slope, floor, triangles, n)
                else:
                    n = _add(a, b, d, z, slope, floor, triangles, n)
                    n = _add(b, c, d, z, slope, floor, triangles, n)
            elif not has_a:
                n = _add(b, c, d, z, slope, floor, triangles, n)
            elif not has_b:
                n = _add(c, d, a, z, slope, floor, triangles, n)
            elif not has_c:
                n = _add(d, a, b, z, slope, floor, triangles, n)
            else:
                n = _add(a, b, c, z, slope, floor, triangles, n)
            for t in range(start, n):
                for k in range(3):
                    pixel = triangles[t, k]
                    if index[pixel] < 0:
                        index[pixel] = n_vertices
                        pixels[n_vertices] = pixel
                        n_vertices += 1
                    triangles[t, k] = index[pixel]
    return triangles[:n].copy(), pixels[:n_vertices].copy()


@njit(cache=True, nogil=True, error_model="numpy")
def _add(a, b, c, z, slope, floor, triangles, n):
    """Write the triangle of pixels a, b, c as the n-th where depth continues along its sides; returns the next n."""
    if not (
        _joined(z[a], z[b], slope, floor) and _joined(z[b], z[c], slope, floor) and _joined(z[c], z[a], slope, floor)
    ):
        return n
    triangles[n, 0], triangles[n, 1], triangles[n, 2] = a, b, c
    return n + 1
