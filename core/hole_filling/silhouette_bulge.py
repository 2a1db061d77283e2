"""Curvature extrapolation: how far filled surface has to be curved.

A body continues around its outline, while a patch of missing readings is best filled flat.
"""

from __future__ import annotations

import numpy as np

from ..mesh import SURFACE, Mesh
from ..mesh.normals import vertex_normals
from ..mesh.submesh import made_vertices, triangles_touching
from ..numeric.kernels import njit
from ..views.view_maps import ViewMaps, look_at, reading_noise

_OUTLINE_WINDOW = 4  # so far beside the last reading of an outline the next one may be [px]
_OUTLINE_DROP = 0.05  # farther away than this is something else [m]
_NOISY = 0.0025  # noise of a reading that counts half as much [m]


def rim_marks(mesh: Mesh, maps: ViewMaps) -> np.ndarray:
    """Normals of the measured surface along its boundary, and the confidence that an outline is there, (V, 4).

    Rows of vertices that are not on the boundary mean nothing.

    At an outline the view reads something farther away right beside it: the body continues there, out of sight.
    Elsewhere readings are missing or the view was cut. Where nothing is known of the view, an outline is assumed. The
    noisier the readings, the lower the confidence. Zero at filled vertices.
    """
    assert mesh.view is not None and mesh.kind is not None
    rim = made_vertices(mesh)
    around = (mesh.kind == SURFACE) & triangles_touching(mesh.triangles, rim)
    normals = vertex_normals(mesh.vertices, mesh.triangles[around], rim)
    ends = _outline_kernel(mesh.vertices, np.flatnonzero(rim & (mesh.view >= 0)), mesh.view, maps.to_view, maps.depth,
                           maps.intrinsics)  # fmt: skip
    confidence = 1.0 / (1.0 + (reading_noise(mesh, maps) / _NOISY) ** 2)
    return np.column_stack((normals, ends * confidence))


def bulge(marks: np.ndarray, parents: np.ndarray, mesh: Mesh, unread: float = 0.25, rings: int = 8) -> np.ndarray:
    """How many times its flat width the surface between two edges is wide (V,), for :func:`.thin_plate_fairing.fair`.

    Between two edges that are rotated by α either way from the middle between them, an arc that continues both rises
    tan(α/2)/2 of its chord, a thin plate over the flat chord sin(α)/4: it has to be stretched by 2 / (1 + cos α).
    cos α is the length of the mean of the normals around. Only the share ``unread`` of that where the edges are no
    outline: what is missing there may as well be hollow (the back along the spine).

    Parameters
    ----------
    marks : np.ndarray [shape=(K, 4)]
        :func:`rim_marks` before refining.
    parents : np.ndarray [shape=(M, 2)]
        What each vertex that refining added (numbers K to K + M) lies between.
    mesh : Mesh
        Refined.
    unread : float
        From 0 to 1.
    rings : int
        How far from an outline it has an effect.

    Returns
    -------
    np.ndarray [shape=(V,)]
        1 at measured vertices. O(rings · filled triangles).
    """
    assert mesh.view is not None and mesh.kind is not None
    triangles = mesh.triangles[mesh.kind != SURFACE]
    made = mesh.view < 0
    if not len(triangles):
        return np.ones(len(mesh.vertices))
    about = np.zeros(len(mesh.vertices), np.bool_)
    about[triangles] = True
    triangles = (np.cumsum(about, dtype=np.int32) - 1)[triangles]
    spread = _inherited(marks, parents)[about]
    spread = _spread_kernel(spread, triangles, made[about], rings)
    cosine = np.sqrt(np.einsum("ij,ij->i", spread[:, :3], spread[:, :3]))
    ends = _most_kernel(spread[:, 3].copy(), triangles, rings)[:, None]
    ends = _spread_kernel(ends, triangles, np.ones(len(ends), np.bool_), rings // 2)[:, 0]
    out = np.ones(len(mesh.vertices))
    out[about] = np.where(made[about], 2.0 / (1.0 + cosine) * (unread + (1.0 - unread) * ends), 1.0)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _outline_kernel(vertices, chosen, view, to_view, depth, intrinsics):
    ends = np.zeros(len(vertices))
    for i in chosen:
        if view[i] >= len(to_view):
            ends[i] = 1.0  # nothing is known of the view
            continue
        v, u, z = look_at(vertices, i, to_view, view[i], depth, intrinsics)
        if v < 0:
            ends[i] = 1.0  # it is not known what the view reads there
            continue
        y, x = int(v + 0.5), int(u + 0.5)
        blank = True
        for row in range(max(y - _OUTLINE_WINDOW, 0), min(y + _OUTLINE_WINDOW + 1, depth.shape[0])):
            for column in range(max(x - _OUTLINE_WINDOW, 0), min(x + _OUTLINE_WINDOW + 1, depth.shape[1])):
                blank = blank and depth[row, column] == 0
                if depth[row, column] > z + _OUTLINE_DROP:
                    ends[i] = 1.0
        if blank:
            ends[i] = 1.0
    return ends


@njit(cache=True, nogil=True, error_model="numpy")
def _inherited(marks, parents):
    """The marks (V, 4) with those of new vertices: each has the mean of its parents'."""
    known = len(marks)
    out = np.empty((known + len(parents), 4))
    for i in range(known):
        for c in range(4):
            out[i, c] = marks[i, c]
    for k in range(len(parents)):
        for c in range(4):
            out[known + k, c] = 0.5 * (out[parents[k, 0], c] + out[parents[k, 1], c])
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _spread_kernel(field, triangles, chosen, rounds):
    """The field (V, C) with its mean over the edges around at ``chosen`` vertices, over and over."""
    count, width = field.shape
    share = np.zeros(count)  # 1 / ends of edges around
    for t in range(len(triangles)):
        for k in range(3):
            share[triangles[t, k]] += 2.0
    for i in range(count):
        share[i] = 1.0 / share[i] if share[i] > 0 else 0.0
    for _ in range(rounds):
        total = np.zeros((count, width))
        for t in range(len(triangles)):
            i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            for c in range(width):
                a, b, d = field[i, c], field[j, c], field[k, c]
                total[i, c] += b + d
                total[j, c] += a + d
                total[k, c] += a + b
        for i in range(count):
            for c in range(width):
                total[i, c] = total[i, c] * share[i] if chosen[i] and share[i] > 0 else field[i, c]
        field = total
    return field


@njit(cache=True, nogil=True, error_model="numpy")
def _most_kernel(field, triangles, rings):
    """The greatest value (V,) within so many rings."""
    for _ in range(rings):
        most = field.copy()
        for t in range(len(triangles)):
            i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            here = max(field[i], field[j], field[k])
            most[i], most[j], most[k] = max(most[i], here), max(most[j], here), max(most[k], here)
        field = most
    return field
