"""Polygons in a plane: areas, inside or outside, hulls, and triangles that fill them around their holes."""

from __future__ import annotations

import numpy as np


def signed_area(ring: np.ndarray) -> float:
    """Of a ring of points (N, 2): positive when it runs counter-clockwise."""
    x, y = ring.T
    return float(0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum())


def inside(points: np.ndarray, rings: list[np.ndarray]) -> np.ndarray:
    """Which of ``points`` (N, 2) lie within the ``rings`` (each (M, 2)) an odd number of times, (N,) bool."""
    odd = np.zeros(len(points), np.bool_)
    x, y = points[:, :1], points[:, 1:]
    for ring in rings:
        ax, ay = ring.T
        bx, by = np.roll(ring, -1, axis=0).T
        over = (ay > y) != (by > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            crosses = over & (x < ax + (y - ay) * (bx - ax) / (by - ay))
        odd ^= (crosses.sum(axis=1) % 2).astype(np.bool_)
    return odd


def convex_hull(points: np.ndarray) -> np.ndarray:
    """Convex hull (M, 2) of points (N, 2), counter-clockwise (Andrew 1979)."""
    points = np.unique(points, axis=0)

    def half(points: np.ndarray) -> list[np.ndarray]:
        chain: list[np.ndarray] = []
        for p in points:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= 0:
                chain.pop()
            chain.append(p)
        return chain[:-1]

    return np.array(half(points) + half(points[::-1]))


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def fill(points: np.ndarray, rings: list[np.ndarray]) -> np.ndarray:
    """Triangles that fill the region left of all rings.

    Holes are joined to the ring around them by bridges (Eberly 2002), ears are clipped, and edges flipped until their
    triangles are those of Delaunay (Lawson 1977), so that none is needlessly flat. O(N²).

    Parameters
    ----------
    points : np.ndarray [shape=(N, 2)]
    rings : list of np.ndarray [shape=(M,)]
        Points of each: outer ones counter-clockwise, holes clockwise; they do not cross.

    Returns
    -------
    np.ndarray [shape=(T, 3), dtype=int32]
        Counter-clockwise. Every edge of a ring is an edge of one triangle, in its direction.
    """
    outer = [ring for ring in rings if signed_area(points[ring]) > 0]
    holes: list[list[np.ndarray]] = [[] for _ in outer]
    sizes = [signed_area(points[ring]) for ring in outer]
    for ring in rings:
        if signed_area(points[ring]) <= 0:
            around = [k for k, other in enumerate(outer) if inside(points[ring[:1]], [points[other]])[0]]
            if around:
                holes[min(around, key=lambda k: sizes[k])].append(ring)
    made = [_clip_ears(points, _bridged(points, ring, inner)) for ring, inner in zip(outer, holes, strict=True)]
    return _flipped(points, np.concatenate(made)) if made else np.empty((0, 3), np.int32)


def _bridged(points: np.ndarray, outer: np.ndarray, holes: list[np.ndarray]) -> np.ndarray:
    """One ring that runs into each hole and back on the same way."""
    ring = np.asarray(outer)
    for hole in sorted(holes, key=lambda hole: -points[hole, 0].max()):
        start = int(points[hole, 0].argmax())
        hole = np.roll(hole, -start)
        at = _visible(points, ring, points[hole[0]])
        ring = np.concatenate((ring[: at + 1], hole, hole[:1], ring[at:]))
    return ring


def _visible(points: np.ndarray, ring: np.ndarray, m: np.ndarray) -> int:
    """Place in the ring of a point that the point ``m`` within it sees to its right."""
    a, b = points[ring], points[np.roll(ring, -1)]
    crossing = (a[:, 1] <= m[1]) & (b[:, 1] > m[1])  # upward edges have the inside to their left
    with np.errstate(divide="ignore", invalid="ignore"):
        x = a[:, 0] + (m[1] - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
    x = np.where(crossing & (x >= m[0]), x, np.inf)
    edge = int(x.argmin())
    if not np.isfinite(x[edge]):
        return int(((points[ring] - m) ** 2).sum(axis=1).argmin())
    end = edge if a[edge, 0] > b[edge, 0] else (edge + 1) % len(ring)
    p, i = points[ring[end]], np.array((x[edge], m[1]))
    corner = (m, i, p) if _turn(m, i, p) > 0 else (m, p, i)
    within = np.ones(len(ring), np.bool_)
    for k in range(3):
        c, d = corner[k], corner[(k + 1) % 3]
        within &= (d[0] - c[0]) * (a[:, 1] - c[1]) - (d[1] - c[1]) * (a[:, 0] - c[0]) >= 0
    within &= (a != p).any(axis=1) & _sees(np.roll(a, 1, axis=0), a, b, m)
    if not within.any():
        return end
    step = a - m
    slope = np.abs(step[:, 1]) / np.maximum(step[:, 0], 1e-12)
    slope[~within] = np.inf
    nearest = np.lexsort(((step**2).sum(axis=1), slope))
    return int(nearest[0])


def _sees(before: np.ndarray, here: np.ndarray, behind: np.ndarray, m: np.ndarray) -> np.ndarray:
    """Whether each corner (N, 2) of the ring opens towards ``m``.

    A corner where a bridge ends is there twice, and one of both opens to the bridge's other side.
    """

    def left_of(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
        return (q[:, 0] - p[:, 0]) * (r[..., 1] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (r[..., 0] - p[:, 0]) > 0

    first, second = left_of(before, here, m), left_of(here, behind, m)
    return np.where(left_of(before, here, behind), first & second, first | second)


def _clip_ears(points: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """Triangles of a ring without holes, which may touch itself at bridges."""
    xy, left = points[ring], list(range(len(ring)))
    made: list[list[int]] = []
    at, tried, strictness = 0, 0, 0
    while len(left) > 3:
        n = len(left)
        before, here, behind = left[(at - 1) % n], left[at % n], left[(at + 1) % n]
        if _is_ear(xy, left, before, here, behind, _CLEARANCES[strictness]):
            made.append([before, here, behind])
            del left[at % n]
            at, tried, strictness = at % n + 1, 0, 0
        else:
            at, tried = (at + 1) % n, tried + 1
            if tried > n:  # flatter ears, then ones that hold other points: rings that touch or cross leave no better
                tried, strictness = 0, strictness + 1
    made.append(left)
    return ring[np.array(made)]


_CLEARANCES = (1e-2, 1e-4, 0.0, None, -np.inf)
"""How far an ear's corner must stand out, and others stay outside, by its longest side; None asks only for a left turn,
and the last for nothing."""


def _is_ear(xy: np.ndarray, left: list[int], before: int, here: int, behind: int, clearance: float | None) -> bool:
    a, b, c = xy[before], xy[here], xy[behind]
    if clearance == -np.inf:
        return True
    turn = _turn(a, b, c)
    squared = max(((b - a) ** 2).sum(), ((c - b) ** 2).sum(), ((a - c) ** 2).sum())
    if turn <= (clearance or 0.0) * squared:
        return False
    if clearance is None:
        return True
    others = xy[left]
    within = np.ones(len(left), np.bool_)
    for p, q in ((a, b), (b, c), (c, a)):
        side = (q[0] - p[0]) * (others[:, 1] - p[1]) - (q[1] - p[1]) * (others[:, 0] - p[0])
        within &= side >= -1e-2 * clearance * squared
    for corner in (a, b, c):
        within &= (others != corner).any(axis=1)
    return not within.any()


def _flipped(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Inner edges flipped until each circle around a triangle is free of its neighbours' corners."""
    made = triangles.tolist()
    sides = {(t[k], t[(k + 1) % 3]): n for n, t in enumerate(made) for k in range(3)}
    xy = points.tolist()
    waiting = [edge for edge in sides if edge[0] < edge[1] and edge[::-1] in sides]
    for _ in range(20 * len(waiting)):  # ends long before; rounding may make two flips undo each other
        if not waiting:
            break
        a, b = waiting.pop()
        one, other = sides.get((a, b)), sides.get((b, a))
        if one is None or other is None or one == other:
            continue
        c, d = (next(v for v in made[n] if v not in (a, b)) for n in (one, other))
        if c == d or (c, d) in sides or (d, c) in sides or not _should_flip(xy[a], xy[b], xy[c], xy[d]):
            continue
        for edge in ((a, b), (b, a)):
            del sides[edge]
        made[one], made[other] = [a, d, c], [d, b, c]
        for n in (one, other):
            sides |= {(made[n][k], made[n][(k + 1) % 3]): n for k in range(3)}
        waiting += [(a, d), (d, b), (b, c), (c, a)]
    return np.array(made, np.int32)


def _should_flip(a: list[float], b: list[float], c: list[float], d: list[float]) -> bool:
    """Whether d lies within the circle around a b c, and c d is an edge that can take the place of a b."""

    def turn(p: list[float], q: list[float], r: list[float]) -> float:
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    if turn(a, d, c) <= 0 or turn(d, b, c) <= 0:
        return False
    rows = [(p[0] - d[0], p[1] - d[1], (p[0] - d[0]) ** 2 + (p[1] - d[1]) ** 2) for p in (a, b, c)]
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = rows
    inside_circle = ax * (by * cz - bz * cy) - ay * (bx * cz - bz * cx) + az * (bx * cy - by * cx)
    return inside_circle > 1e-9 * (az + bz + cz) ** 2 or (
        inside_circle > 0 and min(turn(a, d, c), turn(d, b, c)) > min(turn(a, b, c), turn(b, a, d))
    )
