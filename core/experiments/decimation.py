"""Fewer triangles by edge collapse (Garland and Heckbert 1997), for the zippering experiment."""

from __future__ import annotations

import heapq
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..mesh import Mesh
from ..mesh.half_edges import twins
from ..mesh.submesh import compact
from ..numeric.kernels import njit

_COSINE_75 = 0.26  # a triangle that rotates by more is a fold


def decimate(mesh: Mesh, count: int) -> Mesh:
    """Collapse edges, the least visible first, until ``count`` vertices are left (Garland and Heckbert 1997).

    Boundaries are thinned along themselves and keep their course; topology, one fan a vertex and the winding stay.
    O(V log V) time, about 600 bytes a vertex.

    Parameters
    ----------
    mesh : Mesh
        Edges with at most two triangles, every vertex with one fan. Colours are not kept; ``view`` and ``kind`` must
        be the same all over.
    count : int
        Vertices to leave; more are left when no edge can be collapsed without a fold or a change of topology.
    """
    if count >= len(mesh.vertices):
        return mesh
    twin = twins(mesh.triangles, len(mesh.vertices))
    points, triangles = _collapse_kernel(mesh.vertices.astype(np.float64), mesh.triangles.astype(np.int64), twin, count)
    kind = None if mesh.kind is None else np.full(len(triangles), mesh.kind[0], np.int8)
    return compact(replace(mesh, vertices=points, triangles=triangles.astype(np.int32), colors=None, kind=kind))


class _Fans(NamedTuple):
    """What is known of each vertex, and which corners of triangles it has; corner k of triangle t is 3 t + k.

    ``quadric`` (V, 10) sums the squared distances from the planes around, ``border`` (V,) bool says which lie on a
    boundary. The corners of vertex v begin at ``head[v]``, go on at ``after[corner]`` and end at ``tail[v]``; -1 is
    none. Corners of triangles that are not ``alive`` (T,) bool do not count.
    """

    quadric: np.ndarray
    border: np.ndarray
    head: np.ndarray
    tail: np.ndarray
    after: np.ndarray
    alive: np.ndarray


@njit(cache=True, nogil=True)
def _add_plane(quadric, v, n, d, weight):
    """Add weight · (n·x + d)² to the quadric of v: six of A, three of b, c."""
    q = quadric[v]
    q[0] += weight * n[0] * n[0]
    q[1] += weight * n[0] * n[1]
    q[2] += weight * n[0] * n[2]
    q[3] += weight * n[1] * n[1]
    q[4] += weight * n[1] * n[2]
    q[5] += weight * n[2] * n[2]
    q[6] += weight * n[0] * d
    q[7] += weight * n[1] * d
    q[8] += weight * n[2] * d
    q[9] += weight * d * d


@njit(cache=True, nogil=True)
def _place(points, fans, u, v, out):
    """Where the edge's vertex goes, into ``out`` (3,), relative to u; returns what it costs [m⁴].

    On the border vertex when there is one, so that inner edges never move a boundary.
    """
    quadric, border = fans.quadric, fans.border
    base = points[u]
    edge = points[v] - base
    q = quadric[u] + quadric[v]
    # the quadrics are about the origin of the mesh; a pull towards the middle of the edge keeps flat ones solvable
    length = (edge**2).sum()
    pull = 1e-3 * (q[0] + q[3] + q[5])
    if border[u] and not border[v]:
        out[:] = 0.0
    elif border[v] and not border[u]:
        out[:] = edge
    else:
        a, b, c, d, e, f = q[0] + pull, q[1], q[2], q[3] + pull, q[4], q[5] + pull
        r0 = pull * edge[0] / 2 - (q[6] + q[0] * base[0] + q[1] * base[1] + q[2] * base[2])
        r1 = pull * edge[1] / 2 - (q[7] + q[1] * base[0] + q[3] * base[1] + q[4] * base[2])
        r2 = pull * edge[2] / 2 - (q[8] + q[2] * base[0] + q[4] * base[1] + q[5] * base[2])
        m0, m1, m2 = d * f - e * e, c * e - b * f, b * e - c * d
        det = a * m0 + b * m1 + c * m2
        if det <= 0:  # both vertices without area around
            out[:] = edge / 2
        else:
            out[0] = (r0 * m0 + r1 * m1 + r2 * m2) / det
            out[1] = (r0 * m1 + r1 * (a * f - c * c) + r2 * (b * c - a * e)) / det
            out[2] = (r0 * m2 + r1 * (b * c - a * e) + r2 * (a * d - b * b)) / det
    x, y, z = base[0] + out[0], base[1] + out[1], base[2] + out[2]
    cost = x * (q[0] * x + 2 * (q[1] * y + q[2] * z + q[6]))
    cost += y * (q[3] * y + 2 * (q[4] * z + q[7])) + z * (q[5] * z + 2 * q[8]) + q[9]
    # among equals the shorter edge goes first
    return max(cost, 0.0) + pull * length


@njit(cache=True, nogil=True)
def _folds(points, triangles, fans, v, other, to):
    """Whether a triangle of v that does not hold ``other`` rotates by more than 75° when v moves to ``to``."""
    c = fans.head[v]
    while c >= 0:
        t, k = c // 3, c % 3
        c = fans.after[c]
        if not fans.alive[t]:
            continue
        i, j = triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
        if i == other or j == other:
            continue
        p, q = points[i], points[j]
        old = np.cross(p - points[v], q - points[v])
        new = np.cross(p - to, q - to)
        if (old * new).sum() <= _COSINE_75 * np.sqrt((old**2).sum() * (new**2).sum()):
            return True
    return False


@njit(cache=True, nogil=True)
def _fans_of(points, triangles, twin):
    """The :class:`_Fans` of a mesh none of whose triangles is gone yet."""
    n, total = len(points), len(triangles)
    quadric = np.zeros((n, 10))
    border = np.zeros(n, np.bool_)
    head, tail, after = np.full(n, -1), np.full(n, -1), np.full(3 * total, -1)
    for t in range(total):
        a, b, c = points[triangles[t, 0]], points[triangles[t, 1]], points[triangles[t, 2]]
        normal = np.cross(b - a, c - a)
        twice = np.sqrt((normal**2).sum())
        if twice > 0:
            normal /= twice
        for k in range(3):
            v, w = triangles[t, k], triangles[t, (k + 1) % 3]
            _add_plane(quadric, v, normal, -(normal * a).sum(), twice / 6)
            if twin[3 * t + k] < 0:
                border[v] = True
                border[w] = True
                side = np.cross(points[w] - points[v], normal)
                length = np.sqrt((side**2).sum())
                if length > 0:
                    side /= length
                for end in (v, w):
                    _add_plane(quadric, end, side, -(side * points[v]).sum(), length * length / 2)
            if head[v] < 0:
                head[v] = 3 * t + k
            else:
                after[tail[v]] = 3 * t + k
            tail[v] = 3 * t + k
    return _Fans(quadric, border, head, tail, after, np.ones(total, np.bool_))


@njit(cache=True, nogil=True)
def _keeps_topology(triangles, fans, u, v, mark, tick):
    """The link condition: what both ends of an edge are joined to is just what lies opposite to it.

    Nor may a vertex opposite to it lose its last but one triangle, or an inner one its last but three. ``mark`` (V,)
    holds nothing from ``tick`` on.
    """
    shared = common = 0
    one = other = u
    c = fans.head[u]
    while c >= 0:
        t, k = c // 3, c % 3
        c = fans.after[c]
        if fans.alive[t]:
            i, j = triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
            mark[i] = mark[j] = tick
            if i == v or j == v:
                one, other = other, j if i == v else i
                shared += 1
    c = fans.head[v]
    while c >= 0:
        t, k = c // 3, c % 3
        c = fans.after[c]
        if fans.alive[t]:
            for w in (triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]):
                if mark[w] == tick:
                    mark[w] = tick + 1
                    common += 1
    if shared < 1 or shared > 2 or common != shared or (shared == 2 and fans.border[u] and fans.border[v]):
        return False
    for apex in (one, other):
        if apex == u:  # there is but one
            continue
        left = 0
        c = fans.head[apex]
        while c >= 0:
            left += fans.alive[c // 3]
            c = fans.after[c]
        if left <= (1 if fans.border[apex] else 3):
            return False
    return True


@njit(cache=True, nogil=True)
def _join(triangles, fans, u, v):
    """Make v one with u: v's triangles get the corner u, those of the edge between them die."""
    fans.quadric[u] += fans.quadric[v]
    fans.border[u] |= fans.border[v]
    c = fans.head[v]
    while c >= 0:
        t = c // 3
        if fans.alive[t]:
            if triangles[t, 0] == u or triangles[t, 1] == u or triangles[t, 2] == u:
                fans.alive[t] = False
            else:
                triangles[t, c % 3] = u
        c = fans.after[c]
    fans.after[fans.tail[u]] = fans.head[v]
    fans.tail[u] = fans.tail[v]


@njit(cache=True, nogil=True)
def _queue_around(points, triangles, fans, u, stamp, mark, tick, heap, out):
    """Unlink what died around u, and queue the edges there anew; only the corners of u moved."""
    previous = np.int64(-1)
    c = fans.head[u]
    while c >= 0:
        t, k = c // 3, c % 3
        if fans.alive[t]:
            previous = c
            for w in (triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]):
                if mark[w] != tick:
                    mark[w] = tick
                    heapq.heappush(heap, (_place(points, fans, u, w, out), u, w, stamp[u], stamp[w]))
        elif previous < 0:
            fans.head[u] = fans.after[c]
        else:
            fans.after[previous] = fans.after[c]
        c = fans.after[c]
    fans.tail[u] = previous


@njit(cache=True, nogil=True)
def _collapse_kernel(points, triangles, twin, count):
    """Vertices (V, 3), not all of them still used, and the triangles left."""
    shift = points[0].copy()  # quadrics lose digits far from the origin
    points -= shift
    fans = _fans_of(points, triangles, twin)
    stamp, mark = np.zeros(len(points), np.int64), np.zeros(len(points), np.int64)
    out = np.empty(3)
    heap = [(0.0, np.int64(0), np.int64(0), np.int64(-1), np.int64(-1)) for _ in range(0)]
    for e in range(len(twin)):
        if twin[e] < e:
            u, v = triangles[e // 3, e % 3], triangles[e // 3, (e % 3 + 1) % 3]
            heap.append((_place(points, fans, u, v, out), u, v, stamp[u], stamp[v]))
    heapq.heapify(heap)
    left = 0
    for v in range(len(points)):
        left += fans.head[v] >= 0
    tick = 0
    while left > count and len(heap):
        _, u, v, stamp_u, stamp_v = heapq.heappop(heap)
        if stamp[u] != stamp_u or stamp[v] != stamp_v:
            continue
        tick += 2
        if not _keeps_topology(triangles, fans, u, v, mark, tick):
            continue
        _place(points, fans, u, v, out)
        to = points[u] + out
        if _folds(points, triangles, fans, u, v, to) or _folds(points, triangles, fans, v, u, to):
            continue
        points[u] = to
        _join(triangles, fans, u, v)
        stamp[v] = -1
        stamp[u] += 1
        left -= 1
        tick += 2
        _queue_around(points, triangles, fans, u, stamp, mark, tick, heap, out)
    return points + shift, triangles[fans.alive]
