"""Edge collapse with quadrics (Garland and Heckbert 1997) on a mesh whose corners have places in a texture.

Corners of one vertex that share a place in the texture are a *wedge* (Hoppe 1999). An edge across which the wedges
differ is a texture seam; a boundary edge counts as one. A seam is thinned only along itself, the same on both sides:

=============  ======================  =================================================
one end        the other end           the vertex that is left
=============  ======================  =================================================
inner          inner                   where the quadrics are least; place in the texture of the surface there
on a seam      inner                   the one on the seam, unmoved
on a seam      on a seam, edge is one  on the edge, where the quadrics are least; on both sides of the seam alike
fixed          any but fixed           the fixed one; from a seam only along that seam
=============  ======================  =================================================

Fixed is a vertex where other than two seam edges meet. What is not in the table is not collapsed, nor is what breaks
the link condition (Dey et al. 1999), turns a triangle over in space or in the texture, or merges two seams.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..mesh.half_edges import twins
from ..mesh.normals import triangle_normals
from ..numeric.kernels import njit

_INNER, _SEAM, _FIXED = 0, 1, 2
_COSINE_75 = 0.26  # a triangle that rotates by more is a fold
_SLIVER = 0.1 / 3.4641016  # twice the area by the squares of the sides: of a shape, 1 = equilateral, of 0.1
_PULL = 1e-5  # share of a quadric's trace that draws the vertex to the middle of the edge: flat places stay solvable
_FAR = 2.0  # edge lengths from the middle of the edge beyond which the solution is not believed
_SEAM_WEIGHT = 0.02  # of planes through a seam, beside those of triangles; zigzags of a seam need not stay
_BORDER_WEIGHT = 10.0  # of planes through a boundary
_LEAST_TEXTURE_AREA = 0.02  # share of a triangle's area in the texture that must be left; it also must not turn over


# called by kernels only: what calls a function from Python is left out, which spares half of the time to compile it
_inner = njit(cache=True, nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)


class Collapse(NamedTuple):
    """The state of a mesh while edges collapse; kernels change it in place.

    Corner k of triangle t is 3 t + k. The corners of vertex v begin at ``head[v]``, go on at ``after[corner]`` and end
    at ``tail[v]``; -1 is none. Corners of triangles that are not ``alive`` do not count.

    Attributes
    ----------
    points : np.ndarray [shape=(V, 3), dtype=float64]
        [m], from the middle of the mesh.
    triangles, wedge : np.ndarray [shape=(T, 3), dtype=int32]
        Vertices, and rows of ``uv``, of the corners.
    uv : np.ndarray [shape=(W, 2), dtype=float64]
        Places in the texture; (0, 2) without one.
    alive : np.ndarray [shape=(T,), dtype=bool]
    quadric : np.ndarray [shape=(V, 10), dtype=float64]
        Sum of squared distances from planes: A (6), b (3), c [m⁴].
    seams : np.ndarray [shape=(V,), dtype=int8]
        Inner, on a seam, or fixed.
    factor : np.ndarray [shape=(V,), dtype=float64]
        Costs are multiplied by the larger one of an edge's ends.
    head, tail : np.ndarray [shape=(V,), dtype=int32]
    after : np.ndarray [shape=(3·T,), dtype=int32]
    into : np.ndarray [shape=(V,), dtype=int32]
        The vertex each became one with; itself while it lives.
    stamp, mark : np.ndarray [shape=(V,), dtype=int32]
        How often a vertex has changed, and scratch.
    counts : np.ndarray [shape=(3,), dtype=int64]
        Triangles alive, entries of the heap, ticks of ``mark``.
    heap_cost : np.ndarray [shape=(H,), dtype=float64]
    heap_edge : np.ndarray [shape=(H, 4), dtype=int32]
        Two vertices and their stamps when the cost was found.
    """

    points: np.ndarray
    triangles: np.ndarray
    wedge: np.ndarray
    uv: np.ndarray
    alive: np.ndarray
    quadric: np.ndarray
    seams: np.ndarray
    factor: np.ndarray
    head: np.ndarray
    tail: np.ndarray
    after: np.ndarray
    into: np.ndarray
    stamp: np.ndarray
    mark: np.ndarray
    counts: np.ndarray
    heap_cost: np.ndarray
    heap_edge: np.ndarray


def begin_collapse(
    vertices: np.ndarray, triangles: np.ndarray, wedge: np.ndarray | None, uv: np.ndarray | None, factor: np.ndarray
) -> Collapse:
    """The state of a mesh none of whose edges has collapsed, every edge in the heap.

    Parameters
    ----------
    vertices : np.ndarray [shape=(V, 3)]
        [m].
    triangles, wedge : np.ndarray [shape=(T, 3), dtype=int32]
        Of the corners: vertices, and rows of ``uv``. None without a texture.
    uv : np.ndarray [shape=(W, 2)] or None
    factor : np.ndarray [shape=(V,), dtype=float64]
        By how much dearer it is to collapse an edge there.
    """
    count, total = len(vertices), len(triangles)
    corner = np.ascontiguousarray(triangles, np.int32)
    wedge = corner if wedge is None else wedge
    twin = twins(corner, count)
    points = vertices - vertices.mean(axis=0)  # quadrics lose digits far from the origin
    ends = np.roll(corner, -1, axis=1)

    seam = twin.reshape(-1, 3) < 0
    inner = np.flatnonzero(twin >= 0)
    at, other = wedge.ravel(), np.roll(wedge, -1, axis=1).ravel()  # wedges at the half-edge's beginning and end
    split = (at[inner] != other[twin[inner]]) | (other[inner] != at[twin[inner]])
    seam.ravel()[inner] = split
    once = seam & ((twin.reshape(-1, 3) < 0) | (np.arange(3 * total) < twin).reshape(-1, 3))
    meets = np.bincount(corner[once], minlength=count) + np.bincount(ends[once], minlength=count)
    seams = np.where(meets == 0, _INNER, np.where(meets == 2, _SEAM, _FIXED)).astype(np.int8)

    order = np.argsort(corner.ravel(), kind="stable").astype(np.int32)
    sorted_ = corner.ravel()[order]
    same = sorted_[1:] == sorted_[:-1]
    after = np.full(3 * total, -1, np.int32)
    after[order[:-1][same]] = order[1:][same]
    head, tail = np.full(count, -1, np.int32), np.full(count, -1, np.int32)
    head[sorted_[::-1]] = order[::-1]
    tail[sorted_] = order

    tail_, head_ = corner.ravel(), ends.ravel()
    first = np.flatnonzero((twin < 0) | (np.arange(3 * total) < twin))
    edges = np.column_stack((tail_[first], head_[first]))
    room = 3 * len(edges) + 1024
    state = Collapse(
        np.ascontiguousarray(points, np.float64), corner.copy(), wedge.astype(np.int32),
        np.zeros((0, 2)) if uv is None else np.array(uv, np.float64), np.ones(total, np.bool_),
        _quadrics(points, corner, ends, seam, twin.reshape(-1, 3) < 0), seams, np.ascontiguousarray(factor, np.float64),
        head, tail, after, np.arange(count, dtype=np.int32), np.zeros(count, np.int32), np.zeros(count, np.int32),
        np.array((total, 0, 0), np.int64), np.empty(room), np.empty((room, 4), np.int32),
    )  # fmt: skip
    _collapse_kernel(state, edges.astype(np.int32), len(edges), total)
    return state


def collapse_until(state: Collapse, count: int) -> None:
    """Collapse edges, the least visible first, until ``count`` triangles are left or no edge can be collapsed."""
    _collapse_kernel(state, np.empty((16, 2), np.int32), 0, count)


def _quadrics(
    points: np.ndarray, corner: np.ndarray, ends: np.ndarray, seam: np.ndarray, border: np.ndarray
) -> np.ndarray:
    """(V, 10): planes of triangles, a third of their area to each corner, and planes upright on them through seams."""
    normals = triangle_normals(points, corner)
    twice = np.linalg.norm(normals, axis=1)
    normals = np.divide(normals, twice[:, None], out=np.zeros_like(normals), where=twice[:, None] > 0)
    rows, at = np.nonzero(seam)
    starts, stops = corner[rows, at], ends[rows, at]
    edge = points[stops] - points[starts]
    sides = np.cross(edge, normals[rows])  # as long as the edge
    length = np.linalg.norm(sides, axis=1)
    sides = np.divide(sides, length[:, None], out=np.zeros_like(sides), where=length[:, None] > 0)
    weight = length**2 / 2 * np.where(border[rows, at], _BORDER_WEIGHT, _SEAM_WEIGHT)
    unit = np.concatenate((np.repeat(normals, 3, axis=0), sides, sides))
    vertex = np.concatenate((corner.ravel(), starts, stops))
    shares = np.concatenate((np.repeat(twice / 6, 3), weight, weight))
    offset = -np.concatenate((
        np.repeat(np.einsum("ij,ij->i", normals, points[corner[:, 0]]), 3),
        np.tile(np.einsum("ij,ij->i", sides, points[starts]), 2),
    ))  # fmt: skip
    x, y, z = unit.T
    terms = (x * x, x * y, x * z, y * y, y * z, z * z, x * offset, y * offset, z * offset, offset * offset)
    return np.column_stack([np.bincount(vertex, shares * term, len(points)) for term in terms])


# --- the heap: a binary heap in arrays; an entry whose ends have changed since is stale ------------------------------


@_inner
def _sift_down(cost, edge, i, n):
    while True:
        child = 2 * i + 1
        if child >= n:
            return
        if child + 1 < n and cost[child + 1] < cost[child]:
            child += 1
        if cost[i] <= cost[child]:
            return
        _swap(cost, edge, i, child)
        i = child


@_inner
def _swap(cost, edge, i, j):
    cost[i], cost[j] = cost[j], cost[i]
    for k in range(4):
        edge[i, k], edge[j, k] = edge[j, k], edge[i, k]


@_inner
def _is_stale(s, i):
    u, v = s.heap_edge[i, 0], s.heap_edge[i, 1]
    return s.stamp[u] != s.heap_edge[i, 2] or s.stamp[v] != s.heap_edge[i, 3]


@_inner
def _push(s, cost, u, v):
    """Into the heap; stale entries are thrown out where there is no more room."""
    n = s.counts[1]
    if n == len(s.heap_cost):
        n = 0
        for i in range(s.counts[1]):
            if not _is_stale(s, i):
                _swap(s.heap_cost, s.heap_edge, n, i)
                n += 1
        for i in range(n // 2 - 1, -1, -1):
            _sift_down(s.heap_cost, s.heap_edge, i, n)
    s.heap_cost[n] = cost
    s.heap_edge[n, 0], s.heap_edge[n, 1] = u, v
    s.heap_edge[n, 2], s.heap_edge[n, 3] = s.stamp[u], s.stamp[v]
    s.counts[1] = n + 1
    while n > 0 and s.heap_cost[n] < s.heap_cost[(n - 1) // 2]:
        _swap(s.heap_cost, s.heap_edge, n, (n - 1) // 2)
        n = (n - 1) // 2


# --- what a collapse would do ----------------------------------------------------------------------------------------


@_inner
def _sides(s, u, v, found):
    """How many triangles the edge u v has; ``found`` (2, 4): corners at u, v, opposite; number of two."""
    n = 0
    c = s.head[u]
    while c >= 0:
        t, k = c // 3, c % 3
        c = s.after[c]
        if not s.alive[t]:
            continue
        i, j = (k + 1) % 3, (k + 2) % 3
        if s.triangles[t, j] == v:
            i, j = j, i
        if s.triangles[t, i] == v:
            if n < 2:
                found[n, 0], found[n, 1], found[n, 2], found[n, 3] = k, i, j, t
            n += 1
    return n


@_inner
def _is_seam(s, u, v, found):
    """Whether the edge u v is a seam or a boundary."""
    if _sides(s, u, v, found) != 2:
        return True
    t, r = found[0, 3], found[1, 3]
    for end in range(2):
        if s.wedge[t, found[0, end]] != s.wedge[r, found[1, end]]:
            return True
    return False


@_inner
def _least(s, u, v, along, to):
    """Where the sum of both ends' quadrics is least, on the edge itself if ``along``; returns the cost there [m⁴]."""
    q, r, p = s.quadric[u], s.quadric[v], s.points
    a, b, c, d, e, f = q[0] + r[0], q[1] + r[1], q[2] + r[2], q[3] + r[3], q[4] + r[4], q[5] + r[5]
    g, h, i = q[6] + r[6], q[7] + r[7], q[8] + r[8]
    mx, my, mz = (p[u, 0] + p[v, 0]) / 2, (p[u, 1] + p[v, 1]) / 2, (p[u, 2] + p[v, 2]) / 2
    ex, ey, ez = p[v, 0] - p[u, 0], p[v, 1] - p[u, 1], p[v, 2] - p[u, 2]
    length = ex * ex + ey * ey + ez * ez
    pull = _PULL * (a + d + f)
    # half the gradient at the middle, with its sign changed
    x, y, z = -(a * mx + b * my + c * mz + g), -(b * mx + d * my + e * mz + h), -(c * mx + e * my + f * mz + i)
    dx = dy = dz = 0.0
    if along:
        curve = ex * (a * ex + 2 * (b * ey + c * ez)) + ey * (d * ey + 2 * e * ez) + ez * f * ez + pull * length
        share = (x * ex + y * ey + z * ez) / curve if curve > 0 else 0.0
        share = min(max(share, -0.5), 0.5)
        dx, dy, dz = share * ex, share * ey, share * ez
    else:
        j, k, m = a + pull, d + pull, f + pull
        m0, m1, m2 = k * m - e * e, c * e - b * m, b * e - c * k
        det = j * m0 + b * m1 + c * m2
        if det > 0:
            dx = (x * m0 + y * m1 + z * m2) / det
            dy = (x * m1 + y * (j * m - c * c) + z * (b * c - j * e)) / det
            dz = (x * m2 + y * (b * c - j * e) + z * (j * k - b * b)) / det
            if dx * dx + dy * dy + dz * dz > _FAR * _FAR * length:
                dx = dy = dz = 0.0
    to[0], to[1], to[2] = mx + dx, my + dy, mz + dz
    return _cost_at(s, u, v, to) + pull * length


@_inner
def _cost_at(s, u, v, at):
    q, r = s.quadric[u], s.quadric[v]
    x, y, z = at[0], at[1], at[2]
    cost = x * ((q[0] + r[0]) * x + 2 * ((q[1] + r[1]) * y + (q[2] + r[2]) * z + q[6] + r[6]))
    cost += y * ((q[3] + r[3]) * y + 2 * ((q[4] + r[4]) * z + q[7] + r[7]))
    return max(cost + z * ((q[5] + r[5]) * z + 2 * (q[8] + r[8])) + q[9] + r[9], 0.0)


@_inner
def _plan(s, u, v, found, to):
    """How the edge collapses by the table above: which vertex stays (-1: it may not), whether along a seam, the cost.

    ``to`` (3,) gets its place.
    """
    su, sv = s.seams[u], s.seams[v]
    seam = su != _INNER and sv != _INNER
    if seam and ((su == _FIXED and sv == _FIXED) or not _is_seam(s, u, v, found)):
        return -1, seam, np.inf
    if su == sv:
        cost = _least(s, u, v, seam, to)
        return u, seam, cost * max(s.factor[u], s.factor[v])
    stays = u if su > sv else v
    for k in range(3):
        to[k] = s.points[stays, k]
    ex, ey, ez = s.points[u, 0] - s.points[v, 0], s.points[u, 1] - s.points[v, 1], s.points[u, 2] - s.points[v, 2]
    trace = s.quadric[u, 0] + s.quadric[u, 3] + s.quadric[u, 5] + s.quadric[v, 0] + s.quadric[v, 3] + s.quadric[v, 5]
    cost = _cost_at(s, u, v, to) + _PULL * trace * (ex * ex + ey * ey + ez * ez)
    return stays, seam, cost * max(s.factor[u], s.factor[v])


@_inner
def _triangles_lost(s, u, v, sides, found):
    """How many triangles, ``sides`` of :func:`_sides`, go with the edge; 0 when its collapse would break the topology.

    The link condition: what both ends of an edge are joined to is just what lies opposite to it. Nor may a vertex
    opposite to it lose its last but one triangle, or an inner one its last but three; nor may two seams become one.
    """
    s.counts[2] += 2
    tick = s.counts[2]
    shared = _sides(s, u, v, sides)
    if shared > 2:
        return 0
    common = 0
    for end in range(2):
        c = s.head[u if end == 0 else v]
        while c >= 0:
            t, k = c // 3, c % 3
            c = s.after[c]
            if s.alive[t]:
                for step in range(1, 3):
                    w = s.triangles[t, (k + step) % 3]
                    if end == 0:
                        s.mark[w] = tick
                    elif s.mark[w] == tick:
                        s.mark[w] = tick + 1
                        common += 1
    if common != shared:
        return 0
    for n in range(shared):
        apex = s.triangles[sides[n, 3], sides[n, 2]]
        if s.seams[apex] != _INNER and s.seams[u] != _INNER and s.seams[v] != _INNER:
            both = 0
            for end in range(2):
                both += _is_seam(s, u if end == 0 else v, apex, found)
            if both == 2:
                return 0
        left = 0
        c = s.head[apex]
        while c >= 0:
            left += s.alive[c // 3]
            c = s.after[c]
        if left <= 3:
            return 0
    return shared


@_inner
def _ring_uv(s, u, v, to, uv):
    """Place in the texture of the point ``to`` on the triangles of u and v, all of one wedge there, into ``uv[0]``."""
    best = np.inf
    for end in range(2):
        c = s.head[u if end == 0 else v]
        while c >= 0:
            t = c // 3
            c = s.after[c]
            if not s.alive[t]:
                continue
            i, j, k = s.triangles[t, 0], s.triangles[t, 1], s.triangles[t, 2]
            p = s.points
            ax, ay, az = p[j, 0] - p[i, 0], p[j, 1] - p[i, 1], p[j, 2] - p[i, 2]
            bx, by, bz = p[k, 0] - p[i, 0], p[k, 1] - p[i, 1], p[k, 2] - p[i, 2]
            x, y, z = to[0] - p[i, 0], to[1] - p[i, 1], to[2] - p[i, 2]
            aa, ab, bb = ax * ax + ay * ay + az * az, ax * bx + ay * by + az * bz, bx * bx + by * by + bz * bz
            xa, xb = x * ax + y * ay + z * az, x * bx + y * by + z * bz
            det = aa * bb - ab * ab
            if det <= 0:
                continue
            m, n = max((bb * xa - ab * xb) / det, 0.0), max((aa * xb - ab * xa) / det, 0.0)
            if m + n > 1:
                m, n = m / (m + n), n / (m + n)
            x, y, z = x - m * ax - n * bx, y - m * ay - n * by, z - m * az - n * bz
            if x * x + y * y + z * z < best:
                best = x * x + y * y + z * z
                e, f, g = s.wedge[t, 0], s.wedge[t, 1], s.wedge[t, 2]
                for q in range(2):
                    uv[0, q] = s.uv[e, q] * (1 - m - n) + s.uv[f, q] * m + s.uv[g, q] * n


@_inner
def _breaks(s, v, other, to, places, sides, shared, end):
    """Whether a triangle of v that does not hold ``other`` folds, or becomes a sliver, when v moves to ``to``.

    Or turns over in the texture, when v's wedge of side n moves to ``places[n]``. ``end``: where ``sides`` has v.
    """
    p, uv, wedge = s.points, s.uv, s.wedge
    c = s.head[v]
    while c >= 0:
        t, k = c // 3, c % 3
        c = s.after[c]
        i, j = s.triangles[t, (k + 1) % 3], s.triangles[t, (k + 2) % 3]
        if not s.alive[t] or i == other or j == other:
            continue
        ex, ey, ez = p[j, 0] - p[i, 0], p[j, 1] - p[i, 1], p[j, 2] - p[i, 2]
        ax, ay, az = p[v, 0] - p[i, 0], p[v, 1] - p[i, 1], p[v, 2] - p[i, 2]
        bx, by, bz = to[0] - p[i, 0], to[1] - p[i, 1], to[2] - p[i, 2]
        lx, ly, lz = ey * az - ez * ay, ez * ax - ex * az, ex * ay - ey * ax
        mx, my, mz = ey * bz - ez * by, ez * bx - ex * bz, ex * by - ey * bx
        old, new = np.sqrt(lx * lx + ly * ly + lz * lz), np.sqrt(mx * mx + my * my + mz * mz)
        if lx * mx + ly * my + lz * mz <= _COSINE_75 * old * new:
            return True
        edge = ex * ex + ey * ey + ez * ez
        before = edge + ax * ax + ay * ay + az * az + (ax - ex) ** 2 + (ay - ey) ** 2 + (az - ez) ** 2
        behind = edge + bx * bx + by * by + bz * bz + (bx - ex) ** 2 + (by - ey) ** 2 + (bz - ez) ** 2
        # 2 √3 · 2 A / Σ l² is 1 for an equilateral triangle
        if new < _SLIVER * behind and new * before < old * behind:
            return True
        if len(uv) == 0:
            continue
        w, e, f = wedge[t, k], wedge[t, (k + 1) % 3], wedge[t, (k + 2) % 3]
        for n in range(shared):
            if wedge[sides[n, 3], sides[n, end]] == w:
                dx, dy = uv[f, 0] - uv[e, 0], uv[f, 1] - uv[e, 1]
                area = dx * (uv[w, 1] - uv[e, 1]) - dy * (uv[w, 0] - uv[e, 0])
                left = dx * (places[n, 1] - uv[e, 1]) - dy * (places[n, 0] - uv[e, 0])
                if left * area <= _LEAST_TEXTURE_AREA * area * area:
                    return True
                break
    return False


@_inner
def _join(s, u, v, sides, shared):
    """Make v one with u: v's triangles get the corner u and its wedges, those of the edge between them die."""
    for k in range(10):
        s.quadric[u, k] += s.quadric[v, k]
    s.factor[u] = max(s.factor[u], s.factor[v])
    c = s.head[v]
    while c >= 0:
        t, k = c // 3, c % 3
        c = s.after[c]
        if s.alive[t] and s.triangles[t, 0] != u and s.triangles[t, 1] != u and s.triangles[t, 2] != u:
            s.triangles[t, k] = u
            for n in range(shared):
                if s.wedge[sides[n, 3], sides[n, 1]] == s.wedge[t, k]:
                    s.wedge[t, k] = s.wedge[sides[n, 3], sides[n, 0]]
                    break
    for n in range(shared):
        s.alive[sides[n, 3]] = False
    s.counts[0] -= shared
    s.after[s.tail[u]] = s.head[v]
    s.tail[u] = s.tail[v]
    s.into[v] = u
    s.stamp[v] = -1
    s.stamp[u] += 1


@_inner
def _tidy(s, u, edges):
    """Unlink what died around u; the edges there (E, 2), which all have to be queued anew, and how many."""
    s.counts[2] += 2
    tick = s.counts[2]
    previous, n = np.int32(-1), 0
    c = s.head[u]
    while c >= 0:
        t, k = c // 3, c % 3
        if s.alive[t]:
            previous = c
            for step in range(1, 3):
                w = s.triangles[t, (k + step) % 3]
                if s.mark[w] != tick:
                    s.mark[w] = tick
                    if n == len(edges):
                        edges = np.concatenate((edges, edges))
                    edges[n, 0], edges[n, 1] = u, w
                    n += 1
        elif previous < 0:
            s.head[u] = s.after[c]
        else:
            s.after[previous] = s.after[c]
        c = s.after[c]
    s.tail[u] = previous
    return edges, n


@_inner
def _new_places(s, u, v, seam, to, sides, shared, places):
    """Where the wedges go that become one, on each side of the edge: ``places`` (2, 2)."""
    share = 0.0  # of the way from u to v
    if seam:
        length = along = 0.0
        for k in range(3):
            step = s.points[v, k] - s.points[u, k]
            length += step * step
            along += step * (to[k] - s.points[u, k])
        share = along / length if length > 0 else 0.0
    inner = s.seams[u] == _INNER
    if inner:
        _ring_uv(s, u, v, to, places)
    for n in range(shared):
        w, x = s.wedge[sides[n, 3], sides[n, 0]], s.wedge[sides[n, 3], sides[n, 1]]
        for k in range(2):
            places[n, k] = places[0, k] if inner else s.uv[w, k] + share * (s.uv[x, k] - s.uv[w, k])


@njit(cache=True, nogil=True, error_model="numpy")
def _collapse_kernel(s, edges, waiting, count):
    """Queue the first ``waiting`` of ``edges`` (E > 0, 2), then collapse the cheapest edges.

    Until ``count`` triangles are left, or no edge is.
    """
    sides, found, to = np.empty((2, 4), np.int32), np.empty((2, 4), np.int32), np.empty(3)
    places = np.empty((2, 2))
    while True:
        for i in range(waiting):
            stays, seam, cost = _plan(s, edges[i, 0], edges[i, 1], found, to)
            if stays >= 0:
                _push(s, cost, edges[i, 0], edges[i, 1])
        waiting = 0
        if s.counts[0] <= count or s.counts[1] == 0:
            return
        u, v, stale = s.heap_edge[0, 0], s.heap_edge[0, 1], _is_stale(s, 0)
        s.counts[1] -= 1
        _swap(s.heap_cost, s.heap_edge, 0, s.counts[1])
        _sift_down(s.heap_cost, s.heap_edge, 0, s.counts[1])
        if stale:
            continue
        stays, seam, cost = _plan(s, u, v, found, to)
        if stays == v:
            u, v = v, u
        shared = _triangles_lost(s, u, v, sides, found) if stays >= 0 else 0
        if shared == 0:
            continue
        if len(s.uv):
            _new_places(s, u, v, seam, to, sides, shared, places)
        broken = False
        for end in range(2):
            if not broken:
                one, other = (u, v) if end == 0 else (v, u)
                broken = _breaks(s, one, other, to, places, sides, shared, end)
        if broken:
            continue
        for n in range(shared if len(s.uv) else 0):
            w = s.wedge[sides[n, 3], sides[n, 0]]
            s.uv[w, 0], s.uv[w, 1] = places[n, 0], places[n, 1]
        for k in range(3):
            s.points[u, k] = to[k]
        _join(s, u, v, sides, shared)
        edges, waiting = _tidy(s, u, edges)
