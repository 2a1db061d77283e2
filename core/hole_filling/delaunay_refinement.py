"""Seams and fills as dense as the surface around them, and Delaunay: split long edges, flip bad ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..mesh import SURFACE, Mesh
from ..mesh.edge_lists import empty_edges, join, joined, part
from ..mesh.half_edges import twins
from ..mesh.submesh import made_vertices
from ..numeric.kernels import njit

_FLIP_SLACK = 0.02  # of the sine: nearly cocircular pairs would else be flipped back and forth by rounding
_FLIP_GROWTH = 1.3  # most area of a flipped pair against before: a fold would add more
_FLIP_PASSES, _LAST_PASSES = 5, 8  # between splits, where the next ones undo much, and at the end


def edge_length_at_vertices(mesh: Mesh) -> np.ndarray:
    """Mean edge length (V,) of the measured triangles around each vertex of a filled one [m].

    The median of these elsewhere.
    """
    total, count = _edge_length_kernel(mesh.vertices, mesh.triangles, mesh.kind, made_vertices(mesh))
    known = count > 0
    mean = total[known] / count[known]
    length = np.full(len(mesh.vertices), np.median(mean) if len(mean) else 0.01)
    length[known] = mean
    return length


@njit(cache=True, nogil=True, error_model="numpy")
def _edge_length_kernel(vertices, triangles, kind, rim):
    total = np.zeros(len(vertices))
    count = np.zeros(len(vertices))
    for t in range(len(triangles)):
        if kind[t] != SURFACE or not (rim[triangles[t, 0]] or rim[triangles[t, 1]] or rim[triangles[t, 2]]):
            continue
        for k in range(3):
            i, j = triangles[t, k], triangles[t, (k + 1) % 3]
            d = np.sqrt(_distance2(vertices, i, j))
            for m in (i, j):
                if rim[m]:
                    total[m] += d
                    count[m] += 1
    return total, count


def refine(mesh: Mesh, target: np.ndarray, factor: float, rounds: int = 10) -> tuple[Mesh, np.ndarray]:
    """Split long edges of seams and fills, longest first, and flip edges towards Delaunay in between.

    Edges are long that exceed ``factor`` times the target.
    Only edges between two filled triangles are split or flipped: the measured surface stays as it is.

    Parameters
    ----------
    target : np.ndarray [shape=(V,)]
        Wanted edge length at each vertex [m].

    Returns
    -------
    mesh : Mesh
        New vertices, behind the others, have view -1.
    parents : np.ndarray [shape=(K, 2)]
        The two vertices between which each new one was put, themselves new ones where they are.

    Notes
    -----
    O(M log M) for M filled triangles.
    """
    assert mesh.view is not None and mesh.kind is not None
    made = mesh.kind != SURFACE
    if not made.any():
        return mesh, np.empty((0, 2), np.int64)
    count = len(mesh.vertices)
    fixed, region = mesh.triangles[~made], mesh.triangles[made]
    m, room = len(region), 12 * len(region) + 3000
    triangles, kind, twin = np.empty((room, 3), np.int32), np.empty(room, np.int8), np.full(3 * room, -1, np.int32)
    triangles[:m], kind[:m], twin[: 3 * m] = region, mesh.kind[made], np.maximum(twins(region, count), -1)
    points, size = np.empty((count + room, 3)), np.empty(count + room)
    points[:count], size[:count] = mesh.vertices, target
    in_region = np.zeros(count, np.bool_)
    in_region[region] = True
    parents = np.empty((room, 2), np.int64)
    n, m = _refine_kernel(points, size, triangles, kind, twin, parents, in_region, m, fixed, factor, rounds)
    vertices, region, kind, parents = points[:n].copy(), triangles[:m], kind[:m], parents[: n - count].copy()
    colors = mesh.colors
    if colors is not None and len(parents):
        colors = np.concatenate((colors, np.rint(_middle_colors(colors, parents)).astype(np.uint8)))
    refined = Mesh(
        vertices,
        np.concatenate((fixed, region)),
        colors,
        np.concatenate((mesh.view, np.full(len(parents), -1, np.int8))),
        np.concatenate((mesh.kind[~made], kind)),
    )
    return refined, parents


@njit(cache=True, nogil=True, error_model="numpy")
def _middle_colors(colors, parents):
    """Colours (K, 3) float64 of new vertices, each half way between its two parents, which may be new themselves."""
    count = len(colors)
    out = np.zeros((len(parents), 3))
    for k in range(len(parents)):
        for parent in parents[k]:
            for c in range(3):
                out[k, c] += 0.5 * (np.float64(colors[parent, c]) if parent < count else out[parent - count, c])
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _distance2(p, i, j):
    return (p[i, 0] - p[j, 0]) ** 2 + (p[i, 1] - p[j, 1]) ** 2 + (p[i, 2] - p[j, 2]) ** 2


@njit(cache=True, nogil=True, error_model="numpy")
def _link(twin, a, b):
    twin[a] = b
    if b >= 0:
        twin[b] = a


@njit(cache=True, nogil=True, error_model="numpy")
def _refine_kernel(p, size, tri, kinds, tw, parents, in_region, m, fixed, factor, rounds):
    """:func:`refine` in arrays that have room for what comes; how many vertices and triangles there are then."""
    count, room = len(in_region), len(tri)
    n = count
    # edges between old vertices, which a flip must not repeat; a new vertex's one-ring is walked instead
    edges = empty_edges(count, 3 * (m + len(fixed)))
    for t in range(m):
        for k in range(3):
            i, j = tri[t, k], tri[t, (k + 1) % 3]
            if i < j or (tw[3 * t + k] < 0 and not joined(i, j, *edges)):
                join(i, j, *edges)
    for t in range(len(fixed)):
        for k in range(3):
            i, j = fixed[t, k], fixed[t, (k + 1) % 3]
            if i < j and in_region[i] and in_region[j] and not joined(i, j, *edges):
                join(i, j, *edges)
    changed = np.empty(room, np.uint8)
    for t in range(room):
        changed[t] = 1
    fine = np.zeros(room, np.bool_)  # triangles that have not changed since none of their edges was too long
    for _ in range(rounds):
        for _ in range(_FLIP_PASSES):
            if _flip_pass(p, tri, tw, m, edges, count, changed, fine) == 0:
                break
        score = np.empty(3 * m)
        long_edges = np.empty(3 * m, np.int64)
        wanted = 0
        for t in range(m):
            if fine[t]:
                continue
            for k in range(3):
                e, g = 3 * t + k, tw[3 * t + k]
                if g < 0 or (g < e and not fine[g // 3]):
                    continue
                i, j = tri[t, k], tri[t, (k + 1) % 3]
                ratio2 = _distance2(p, i, j) / (factor * 0.5 * (size[i] + size[j])) ** 2
                if ratio2 > 1.0:
                    score[wanted] = -ratio2
                    long_edges[wanted] = min(e, g)
                    wanted += 1
        for t in range(m):
            fine[t] = True
        for k in range(wanted):
            fine[long_edges[k] // 3] = fine[tw[long_edges[k]] // 3] = False
        if wanted == 0:
            break
        order = long_edges[np.argsort(score[:wanted])]
        stamp = np.zeros(m, np.bool_)  # triangles changed in this round wait for the next
        for e in order:
            t, s = e // 3, tw[e] // 3
            if s >= len(stamp) or stamp[t] or stamp[s] or m + 2 > room:
                continue
            stamp[t] = stamp[s] = True
            i, j = tri[t, e % 3], tri[t, (e % 3 + 1) % 3]
            for c in range(3):
                p[n, c] = 0.5 * (p[i, c] + p[j, c])
            size[n] = 0.5 * (size[i] + size[j])
            changed[t] = changed[s] = changed[m] = changed[m + 1] = 1
            fine[t] = fine[s] = False
            parents[n - count, 0], parents[n - count, 1] = i, j
            m = _split(tri, tw, kinds, m, e, n, edges, count)
            n += 1
    for _ in range(_LAST_PASSES):
        if _flip_pass(p, tri, tw, m, edges, count, changed, fine) == 0:
            break
    return n, m


@njit(cache=True, nogil=True, error_model="numpy")
def _split(tri, tw, kinds, m, e, x, edges, count):
    """Put vertex x on half-edge e: triangles (a, b, c) and (b, a, d) become four."""
    g = tw[e]
    t, k, s, q = e // 3, e % 3, g // 3, g % 3
    a, b, c, d = tri[t, k], tri[t, (k + 1) % 3], tri[t, (k + 2) % 3], tri[s, (q + 2) % 3]
    bc, ca = tw[3 * t + (k + 1) % 3], tw[3 * t + (k + 2) % 3]
    ad, db = tw[3 * s + (q + 1) % 3], tw[3 * s + (q + 2) % 3]
    t2, s2 = m, m + 1
    tri[t, 0], tri[t, 1], tri[t, 2] = a, x, c
    tri[t2, 0], tri[t2, 1], tri[t2, 2] = x, b, c
    tri[s, 0], tri[s, 1], tri[s, 2] = b, x, d
    tri[s2, 0], tri[s2, 1], tri[s2, 2] = x, a, d
    kinds[t2], kinds[s2] = kinds[t], kinds[s]
    _link(tw, 3 * t, 3 * s2)
    _link(tw, 3 * t + 1, 3 * t2 + 2)
    _link(tw, 3 * t + 2, ca)
    _link(tw, 3 * t2, 3 * s)
    _link(tw, 3 * t2 + 1, bc)
    _link(tw, 3 * s + 1, 3 * s2 + 2)
    _link(tw, 3 * s + 2, db)
    _link(tw, 3 * s2 + 1, ad)
    if a < count and b < count:
        part(a, b, *edges)
    return m + 2


class _Corner(NamedTuple):
    """Scalar product of a corner's two sides, their cross product x, y, z, and its length: twice the area."""

    dot: float
    x: float
    y: float
    z: float
    area: float


@njit(cache=True, nogil=True, error_model="numpy")
def _corner(p, apex, i, j):
    """The corner at ``apex``, its sides going to i and j."""
    ax, ay, az = p[i, 0] - p[apex, 0], p[i, 1] - p[apex, 1], p[i, 2] - p[apex, 2]
    bx, by, bz = p[j, 0] - p[apex, 0], p[j, 1] - p[apex, 1], p[j, 2] - p[apex, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return _Corner(ax * bx + ay * by + az * bz, nx, ny, nz, np.sqrt(nx * nx + ny * ny + nz * nz))


@njit(cache=True, nogil=True, error_model="numpy")
def _is_neighbour(tri, tw, t, k, v):
    """Whether v is in the one-ring of corner k of triangle t, a vertex all of whose triangles are in the region."""
    t0 = t
    while True:
        if tri[t, (k + 1) % 3] == v or tri[t, (k + 2) % 3] == v:
            return True
        e = tw[3 * t + k]
        if e < 0 or e // 3 == t0:
            return False
        t, k = e // 3, (e % 3 + 1) % 3


@njit(cache=True, nogil=True, error_model="numpy")
def _flip_pass(p, tri, tw, m, edges, count, changed, fine):
    """Flip every inner edge whose opposite angles sum to more than 180°, unless that would fold the surface.

    Only edges of ``changed`` triangles are looked at; the flag is moved on to those that the flips changed, which are
    no longer ``fine``.
    """
    flips = 0
    for e in range(3 * m):
        if not changed[e // 3] & 1:
            continue
        g = tw[e]
        if g < 0 or (g < e and changed[g // 3] & 1):  # an edge of two changed triangles has its turn once
            continue
        t, k, s, q = e // 3, e % 3, g // 3, g % 3
        a, b, c, d = tri[t, k], tri[t, (k + 1) % 3], tri[t, (k + 2) % 3], tri[s, (q + 2) % 3]
        if c == d:
            continue
        at_c, at_d = _corner(p, c, a, b), _corner(p, d, b, a)
        # sin(γ + δ) of the opposite angles is negative when they sum to more than 180°
        sine = at_c.dot * at_d.area + at_d.dot * at_c.area
        if sine > -_FLIP_SLACK * (at_c.area * at_d.area + abs(at_c.dot * at_d.dot)):
            continue
        nx, ny, nz = at_c.x + at_d.x, at_c.y + at_d.y, at_c.z + at_d.z
        at_a, at_b = _corner(p, a, d, c), _corner(p, b, c, d)
        # both new triangles face as the old pair does, and are no larger by much (a fold would add area)
        if at_a.x * nx + at_a.y * ny + at_a.z * nz <= 0 or at_b.x * nx + at_b.y * ny + at_b.z * nz <= 0:
            continue
        if at_a.area + at_b.area > _FLIP_GROWTH * (at_c.area + at_d.area):
            continue
        if c < count and d < count:
            if joined(c, d, *edges):
                continue
            join(c, d, *edges)
        elif c >= count:
            if _is_neighbour(tri, tw, t, (k + 2) % 3, d):
                continue
        elif _is_neighbour(tri, tw, s, (q + 2) % 3, c):
            continue
        if a < count and b < count:
            part(a, b, *edges)
        bc, ca = tw[3 * t + (k + 1) % 3], tw[3 * t + (k + 2) % 3]
        ad, db = tw[3 * s + (q + 1) % 3], tw[3 * s + (q + 2) % 3]
        tri[t, 0], tri[t, 1], tri[t, 2] = a, d, c
        tri[s, 0], tri[s, 1], tri[s, 2] = d, b, c
        _link(tw, 3 * t, ad)
        _link(tw, 3 * t + 1, 3 * s + 2)
        _link(tw, 3 * t + 2, ca)
        _link(tw, 3 * s, db)
        _link(tw, 3 * s + 1, bc)
        changed[t] |= 2
        changed[s] |= 2
        fine[t] = fine[s] = False
        flips += 1
    for t in range(m):
        changed[t] >>= 1
    return flips
