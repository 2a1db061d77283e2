"""Slow, obvious twins of the fast routines in core: dictionaries, loops and brute force, nothing clever."""

from __future__ import annotations

from collections import defaultdict
from itertools import product

import numpy as np


def fuse(readings, low: float, high: float, tolerance: float, share: float) -> float:
    """One pixel of ``fuse_burst``: the mean disparity of the readings that agree with their median, as a depth."""
    good = sorted(float(z) for z in readings if low <= z <= high)
    needed = max(1, int(np.ceil(share * len(readings))))
    if len(good) < needed:
        return 0.0
    median = float(np.median(good))
    kept = [1.0 / z for z in good if abs(median / z - 1.0) <= tolerance]
    return len(kept) / sum(kept) if len(kept) >= needed else 0.0


def half_edges(triangles) -> dict[tuple[int, int], list[int]]:
    """Directed edge -> the half-edges (3 t + k) that run along it."""
    edges = defaultdict(list)
    for t, triangle in enumerate(np.asarray(triangles).tolist()):
        for k in range(3):
            edges[triangle[k], triangle[(k + 1) % 3]].append(3 * t + k)
    return edges


def twins(triangles) -> np.ndarray:
    edges = half_edges(triangles)
    twin = np.full(3 * len(triangles), -1)
    for (i, j), there in edges.items():
        back = edges.get((j, i), [])
        for e in there:
            if len(there) == 1 and len(back) == 1:
                twin[e] = back[0]
            elif len(there) + len(back) > 1:
                twin[e] = -2
    return twin


def boundary_edges(triangles) -> set[tuple[int, int]]:
    edges = half_edges(triangles)
    return {(i, j) for (i, j), there in edges.items() if len(there) == 1 and (j, i) not in edges}


def vertex_fans(triangles, vertex_count: int) -> list[int]:
    """Groups of triangles around each vertex, joined over shared edges that meet the vertex."""
    around = defaultdict(list)
    for triangle in np.asarray(triangles).tolist():
        for k in range(3):
            around[triangle[k]].append({triangle[(k + 1) % 3], triangle[(k + 2) % 3]})
    fans = []
    for vertex in range(vertex_count):
        groups: list[set[int]] = []
        for ends in around[vertex]:
            apart = [g for g in groups if not g & ends]
            groups = [*apart, ends.union(*(g for g in groups if g & ends))]
        fans.append(len(groups))
    return fans


def vertex_normals(vertices, triangles) -> np.ndarray:
    total = np.zeros((len(vertices), 3))
    for i, j, k in np.asarray(triangles).tolist():
        cross = np.cross(vertices[j] - vertices[i], vertices[k] - vertices[i])
        for corner in (i, j, k):
            total[corner] += cross
    for n in total:
        if np.linalg.norm(n) > 0:
            n /= np.linalg.norm(n)
    return total


def first_come(triangles, new) -> list[bool]:
    """Which new triangles can join, in order, without a directed edge coming twice."""
    taken = set(half_edges(triangles))
    accepted = []
    for i, j, k in np.asarray(new).tolist():
        mine = {(i, j), (j, k), (k, i)}
        ok = len({i, j, k}) == 3 and not mine & taken
        taken |= mine if ok else set()
        accepted.append(ok)
    return accepted


def dtw_distance(x, y) -> float:
    """Both ends matched: the recurrence of Sakoe and Chiba, cell by cell."""
    total = {}
    for i, j in product(range(len(x)), range(len(y))):
        before = [total[c] for c in ((i - 1, j), (i, j - 1), (i - 1, j - 1)) if c in total]
        total[i, j] = float(np.linalg.norm(x[i] - y[j])) + (min(before) if before else 0.0)
    return total[len(x) - 1, len(y) - 1]


def open_dtw_distance(x, y, skip: float) -> float:
    """Open ends by brute force: every first and last pair that leaves vertices of one sequence only unmatched."""
    n, m = len(x), len(y)
    best = np.inf
    for i0, j0, i1, j1 in product(range(n), range(m), range(n), range(m)):
        if min(i0, j0) == 0 and (i1 == n - 1 or j1 == m - 1) and i0 <= i1 and j0 <= j1:
            left = skip * (i0 + j0 + n - 1 - i1 + m - 1 - j1)
            best = min(best, left + dtw_distance(x[i0 : i1 + 1], y[j0 : j1 + 1]))
    return best


def umbrellas(rest, triangles) -> np.ndarray:
    """Dense scale-dependent umbrella operator: neighbours weighed by one over their distance, minus the vertex."""
    rings = defaultdict(set)
    for i, j, k in np.asarray(triangles).tolist():
        rings[i] |= {j, k}
        rings[j] |= {i, k}
        rings[k] |= {i, j}
    matrix = np.zeros((len(rest), len(rest)))
    for i, ring in rings.items():
        ring = sorted(ring)
        weight = 1.0 / np.linalg.norm(rest[ring] - rest[i], axis=1)
        matrix[i, ring] = weight / weight.sum()
        matrix[i, i] = -1.0
    return matrix


def thin_plate(rest, triangles, stiffness) -> tuple[np.ndarray, np.ndarray]:
    """Dense least squares: the vertices that bend least, and the operator whose squared length is the energy."""
    plate = umbrellas(rest, triangles)
    free = np.isfinite(stiffness)
    springs = np.diag(np.where(free, stiffness, 0.0))
    rows = np.concatenate((plate[:, free], springs[:, free]))
    wanted = np.concatenate((-plate[:, ~free] @ rest[~free], springs @ rest))
    points = rest.copy()
    points[free] = np.linalg.lstsq(rows, wanted, rcond=None)[0]
    return points, plate


def half_plane_area(polygon, normal, level: float) -> float:
    """Area of the part of a convex polygon (K, 2) where normal · p >= level: Sutherland and Hodgman, then Gauss."""
    polygon = np.asarray(polygon, dtype=float)
    kept = []
    for p, q in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        a, b = normal @ p - level, normal @ q - level
        if a >= 0:
            kept.append(p)
        if a * b < 0:
            kept.append(p + a / (a - b) * (q - p))
    x, y = np.array(kept).T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)
