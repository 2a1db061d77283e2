"""Cut a mesh along a level line of a field on its vertices: smooth outlines instead of stairs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..mesh import Mesh
from ..mesh.half_edges import boundary_vertices
from ..mesh.submesh import compact, keep_triangles
from ..numeric.kernels import njit

_SNAP = 0.25  # of an edge: a vertex nearer to the line than this is moved onto it, as cutting would leave a sliver


def trim_outline(mesh: Mesh, level: float) -> Mesh:
    """Round a patch's outline: teeth and threads that stick out of it are cut off along a smooth line.

    The share of interior one deep around a vertex (1 inside, about a half on a straight edge, less on a tooth) is the
    field, ``level`` where it is cut.
    """
    if not len(mesh.triangles):
        return mesh
    inner = 1.0 - boundary_vertices(mesh.triangles, len(mesh.vertices))
    return clip(mesh, smooth_on_mesh(inner[:, None], mesh.triangles, 3)[:, 0], level)


def smooth_on_mesh(values: np.ndarray, triangles: np.ndarray, rounds: int) -> np.ndarray:
    """Values (V, C) averaged over their one-ring, ``rounds`` times."""
    return _smooth_values_kernel(np.ascontiguousarray(values, dtype=np.float64), triangles, rounds)


@njit(cache=True, nogil=True, error_model="numpy")
def _smooth_values_kernel(values, triangles, rounds):
    # a triangle adds half of either neighbour to each corner: an edge has two, and so counts once
    count, width = values.shape
    share = np.ones(count)
    for t in range(len(triangles)):
        for k in range(3):
            share[triangles[t, k]] += 1.0
    share = 1.0 / share
    for _ in range(rounds):
        total = values.copy()
        for t in range(len(triangles)):
            i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            for c in range(width):
                a, b, d = 0.5 * values[i, c], 0.5 * values[j, c], 0.5 * values[k, c]
                total[i, c] += b + d
                total[j, c] += a + d
                total[k, c] += a + b
        for i in range(count):
            for c in range(width):
                total[i, c] *= share[i]
        values = total
    return values


@njit(cache=True, nogil=True, error_model="numpy")
def distance_to_zero(field: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """First-order distance of each vertex to the field's zero line: value over gradient length [m].

    Fields flatter than 1/m count as 1/m, so that distances stay bounded where a field hardly changes.
    """
    gradient = np.zeros(len(vertices))
    area = np.zeros(len(vertices))
    e = np.empty((3, 3))
    n = np.empty(3)
    g = np.empty(3)
    for t in range(len(triangles)):
        for k in range(3):
            for c in range(3):
                e[k, c] = vertices[triangles[t, (k + 2) % 3], c] - vertices[triangles[t, (k + 1) % 3], c]
        n[0] = e[0, 1] * e[1, 2] - e[0, 2] * e[1, 1]
        n[1] = e[0, 2] * e[1, 0] - e[0, 0] * e[1, 2]
        n[2] = e[0, 0] * e[1, 1] - e[0, 1] * e[1, 0]
        double = np.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2)
        if double == 0:
            continue
        g[:] = 0.0
        for k in range(3):
            f = field[triangles[t, k]] / (double * double)
            g[0] += f * (n[1] * e[k, 2] - n[2] * e[k, 1])
            g[1] += f * (n[2] * e[k, 0] - n[0] * e[k, 2])
            g[2] += f * (n[0] * e[k, 1] - n[1] * e[k, 0])
        length = np.sqrt(g[0] ** 2 + g[1] ** 2 + g[2] ** 2)
        for k in range(3):
            gradient[triangles[t, k]] += double * length
            area[triangles[t, k]] += double
    out = np.empty(len(vertices))
    for i in range(len(vertices)):
        slope = gradient[i] / area[i] if area[i] > 0 else 0.0
        out[i] = field[i] / max(slope, 1.0)
    return out


def clip(mesh: Mesh, field: np.ndarray, level: float) -> Mesh:
    """The part of the mesh where ``field`` (V,) ≥ ``level``, cut exactly along that line.

    Triangles the line crosses are split; new vertices lie on the line, colours interpolated. Vertices nearly on the
    line are moved onto it, so that no slivers arise. O(T).
    """
    inside = field >= level
    if inside.all():
        return mesh
    if not inside.any():
        return keep_triangles(mesh, np.zeros(len(mesh.triangles), np.bool_))
    clipped = _clip_kernel(mesh.vertices, mesh.triangles, field, level)
    a, b, share = clipped.source[:, 0], clipped.source[:, 1], clipped.share
    colors = None
    if mesh.colors is not None:
        colors = mesh.colors.take(a, axis=0)
        cut = np.flatnonzero(share)
        blend = mesh.colors[a[cut]] * (1 - share[cut, None]) + mesh.colors[b[cut]] * share[cut, None]
        colors[cut] = np.rint(blend).astype(np.uint8)
    view = None if mesh.view is None else mesh.view.take(a)
    kind = None if mesh.kind is None else mesh.kind.take(clipped.parent)
    return compact(Mesh(clipped.vertices, clipped.triangles, colors, view, kind))


class _Clipped(NamedTuple):
    """Vertices (V, 3) and triangles (T, 3) of what is left, and whence they came.

    Vertex i lies ``share`` (V,) of the way from one old vertex to another, ``source`` (V, 2); triangle t is a part of
    the old triangle ``parent`` (T,).
    """

    vertices: np.ndarray
    triangles: np.ndarray
    source: np.ndarray
    share: np.ndarray
    parent: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def _slide(vertices, i, j, s, out_v, source, share):
    """Put vertex i at ``s`` of the way to vertex j."""
    source[i, 1] = j
    share[i] = s
    for c in range(3):
        out_v[i, c] = vertices[i, c] + s * (vertices[j, c] - vertices[i, c])


@njit(cache=True, nogil=True, error_model="numpy")
def _snap(vertices, triangles, f, out_v, source, share):
    """Move vertices close to the line onto it along the edge that crosses it, into ``out_v``, ``source`` and ``share``.

    Returns which were moved (V,); those that come in have 0 in ``f``, the field less the level, then.
    """
    snapped = np.zeros(len(vertices), np.bool_)
    for t in range(len(triangles)):  # outer vertices just beyond the line first: they come in
        for k in range(3):
            i, j = triangles[t, k], triangles[t, (k + 1) % 3]
            if (f[i] >= 0) == (f[j] >= 0):
                continue
            near, outer = (i, j) if f[i] >= 0 else (j, i)
            s = f[near] / (f[near] - f[outer])
            if s > 1.0 - _SNAP and not snapped[near]:
                snapped[outer] = True
                _slide(vertices, outer, near, 1.0 - s, out_v, source, share)
                f[outer] = 0.0
    for t in range(len(triangles)):
        for k in range(3):
            i, j = triangles[t, k], triangles[t, (k + 1) % 3]
            if (f[i] >= 0) == (f[j] >= 0):
                continue
            s = f[i] / (f[i] - f[j])
            if s < _SNAP and f[i] >= 0 and not snapped[i]:
                snapped[i] = True
                _slide(vertices, i, j, s, out_v, source, share)
            if s > 1.0 - _SNAP and f[j] >= 0 and not snapped[j]:
                snapped[j] = True
                _slide(vertices, j, i, 1.0 - s, out_v, source, share)
    return snapped


@njit(cache=True, nogil=True, error_model="numpy")
def _clip_kernel(vertices, triangles, field, level):
    count = len(vertices)
    n_max = count + 3 * len(triangles)
    out_v = np.empty((n_max, 3))
    source = np.empty((n_max, 2), np.int64)
    share = np.zeros(n_max)
    for i in range(count):
        for c in range(3):
            out_v[i, c] = vertices[i, c]
        source[i, 0] = source[i, 1] = i
    f = field - level
    snapped = _snap(vertices, triangles, f, out_v, source, share)
    n = count
    # no edge is cut twice: of each inner end the last vertex put on one of its edges, of each of these the one before
    last, before = np.empty(count, np.int64), np.empty(n_max - count, np.int64)
    for i in range(count):
        last[i] = -1
    out_t = np.empty((2 * len(triangles), 3), np.int32)
    parent = np.empty(2 * len(triangles), np.int64)
    m = 0
    poly = np.empty(4, np.int64)
    for t in range(len(triangles)):
        size = 0
        inner = full = 0
        for k in range(3):
            i = triangles[t, k]
            inner += f[i] >= 0
            full += f[i] >= 0 and not snapped[i]
        if full == 0:
            continue
        if inner == 3:
            for k in range(3):
                out_t[m, k] = triangles[t, k]
            parent[m] = t
            m += 1
            continue
        for k in range(3):
            i, j = triangles[t, k], triangles[t, (k + 1) % 3]
            if f[i] >= 0:
                poly[size] = i
                size += 1
            a_in, b_in = f[i] >= 0, f[j] >= 0
            if a_in != b_in:
                near = i if a_in else j
                outer = j if a_in else i
                if snapped[near]:
                    continue  # the inner end already lies on the line
                cut = last[near]
                while cut >= 0 and source[cut, 1] != outer:
                    cut = before[cut - count]
                if cut < 0:
                    s = f[near] / (f[near] - f[outer])
                    for c in range(3):
                        out_v[n, c] = vertices[near, c] + s * (vertices[outer, c] - vertices[near, c])
                    source[n, 0], source[n, 1], share[n] = near, outer, s
                    before[n - count], last[near] = last[near], n
                    cut = n
                    n += 1
                poly[size] = cut
                size += 1
        for k in range(1, size - 1):
            out_t[m, 0], out_t[m, 1], out_t[m, 2] = poly[0], poly[k], poly[k + 1]
            parent[m] = t
            m += 1
    return _Clipped(out_v[:n].copy(), out_t[:m].copy(), source[:n].copy(), share[:n].copy(), parent[:m].copy())
