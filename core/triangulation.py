"""Depth grid → triangles, a view at a time and before reflection: neighbours in the image are neighbours on the
surface (paper 4.2.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from .clipping import trim_outline
from .mesh import SURFACE, Mesh, components_of, keep_triangles, keep_twins, remove_bowties, twins


@dataclass(frozen=True)
class TriangulationSettings:
    """How a view becomes a patch.

    Parameters
    ----------
    max_slope : float
        Neighbouring pixels are joined when the surface between them is tilted less than this from head-on [degrees].
    jump_floor : float
        Depth steps below this share of z are always joined, noise allowing.
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
    slope = np.tan(np.radians(settings.max_slope)) * pixel_angle
    rows, columns = np.flatnonzero((labels == view).any(axis=1)), np.flatnonzero((labels == view).any(axis=0))
    if not len(rows):
        box = (0, 0, 0, 0)
    else:
        box = (rows[0], rows[-1], columns[0], columns[-1])
    triangles, pixels = _grid_kernel(depth, labels, view, points, slope, settings.jump_floor + 3.0 * noise, box)
    vertices = points.reshape(-1, 3)[pixels]
    patch = Mesh(
        vertices,
        triangles,
        None if color is None else np.ascontiguousarray(color.reshape(-1, 3)[pixels]),
        np.full(len(vertices), view, np.int8),
        np.full(len(triangles), SURFACE, np.int8),
    )
    return clean_patch(trim_outline(patch, settings.outline), settings.min_triangles)


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


@njit(cache=True, nogil=True)
def _joined(za, zb, slope, floor):
    # the step in depth against the distance across the line of sight, both relative to z
    z = min(za, zb)
    return abs(za - zb) <= max(slope * z * 1.42, floor * z)


@njit(cache=True, nogil=True)
def _distance2(p, q):
    return (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2


@njit(cache=True, nogil=True)
def _grid_kernel(depth, labels, view, points, slope, floor, box):
    height, width = depth.shape
    index = np.full((height, width), -1, np.int32)
    room = (box[1] - box[0] + 1) * (box[3] - box[2] + 1)
    pixels = np.empty(room, np.int64)
    triangles = np.empty((2 * room, 3), np.int32)
    n_vertices = 0
    n = 0
    corner = np.empty(4, np.int64)
    for v in range(box[0], box[1]):
        for u in range(box[2], box[3]):
            # counter-clockwise seen from the camera (v points down): top left, bottom left, bottom right, top right
            corner[0], corner[1] = v * width + u, (v + 1) * width + u
            corner[2], corner[3] = (v + 1) * width + u + 1, v * width + u + 1
            valid = 0
            missing = -1
            for k in range(4):
                if labels[corner[k] // width, corner[k] % width] == view:
                    valid += 1
                else:
                    missing = k
            if valid < 3:
                continue
            start = n
            if valid == 4:
                p0, p1 = points[v, u], points[v + 1, u]
                p2, p3 = points[v + 1, u + 1], points[v, u + 1]
                if _distance2(p0, p2) <= _distance2(p1, p3):
                    options = ((0, 1, 2), (0, 2, 3))
                else:
                    options = ((0, 1, 3), (1, 2, 3))
                for t in range(2):
                    n = _add(options[t], corner, width, depth, slope, floor, triangles, n)
            else:
                a, b, c = (missing + 1) % 4, (missing + 2) % 4, (missing + 3) % 4
                n = _add((a, b, c), corner, width, depth, slope, floor, triangles, n)
            for t in range(start, n):
                for k in range(3):
                    pixel = triangles[t, k]
                    if index[pixel // width, pixel % width] < 0:
                        index[pixel // width, pixel % width] = n_vertices
                        pixels[n_vertices] = pixel
                        n_vertices += 1
                    triangles[t, k] = index[pixel // width, pixel % width]
    return triangles[:n].copy(), pixels[:n_vertices].copy()


@njit(cache=True, nogil=True)
def _add(which, corner, width, depth, slope, floor, triangles, n):
    for k in range(3):
        a, b = corner[which[k]], corner[which[(k + 1) % 3]]
        ya, xa, yb, xb = a // width, a % width, b // width, b % width
        if not _joined(depth[ya, xa], depth[yb, xb], slope, floor):
            return n
    for k in range(3):
        triangles[n, k] = corner[which[k]]
    return n + 1
