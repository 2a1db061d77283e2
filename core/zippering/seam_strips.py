"""Matched boundary runs → strips of triangles, each run taking what earlier ones left of its boundary."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..mesh import SEAM, Mesh
from ..numeric.kernels import njit
from ..numeric.union_find import root_of
from .boundary_frames import Boundary

_LONG_SEAM = 12.0  # mean gaps, and
_LONGEST_CHANCE = 0.08  # [m]: a seam longer than both does not occur by chance, and may make a handle


@dataclass(frozen=True)
class Seam:
    """One zippered seam, for the report: the two views, its length, mean and widest gap [m], and how it was matched."""

    views: tuple[int, int]
    length: float
    mean_gap: float
    max_gap: float
    method: str
    distance: float


class Candidates(NamedTuple):
    """Pairs of boundary runs with the warping path between them, one after another in flat arrays, best first.

    Candidate k matches ``at_a[begin_a[k]:begin_a[k + 1]]`` (boundary entries in the boundary's direction) with
    ``at_b[begin_b[k]:begin_b[k + 1]]`` (against it) along ``path[begin_path[k]:begin_path[k + 1]]`` (K, 2).
    """

    at_a: np.ndarray
    begin_a: np.ndarray
    at_b: np.ndarray
    begin_b: np.ndarray
    path: np.ndarray
    begin_path: np.ndarray

    @staticmethod
    def of(triples: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> Candidates:
        """From (at_a, at_b, path) each."""

        def flat(column: int, empty: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            parts = [triple[column] for triple in triples]
            begin = np.concatenate(([0], np.cumsum([len(part) for part in parts]))).astype(np.int64)
            return np.concatenate([empty, *parts]).astype(empty.dtype), begin

        none, no_steps = np.empty(0, np.int64), np.empty((0, 2), np.int32)
        return Candidates(*flat(0, none), *flat(1, none), *flat(2, no_steps))


class Weave(NamedTuple):
    """What a round of zippering keeps up to date: which loop and which piece every boundary entry belongs to.

    ``after`` (B,) next entry along the boundary as it is now, ``loop`` (B,) its loop, ``piece`` (B,) the connected
    piece of the mesh, ``root`` (P,) union-find over the pieces, ``used`` (B,) edges that a seam has taken.
    """

    after: np.ndarray
    loop: np.ndarray
    piece: np.ndarray
    root: np.ndarray
    used: np.ndarray


def begin_weave(boundary: Boundary, piece: np.ndarray, root: np.ndarray) -> Weave:
    """Before the first seam of a round. ``piece`` (V,) of each vertex; ``root`` (P,) goes on from round to round."""
    after = np.arange(1, len(boundary.vertex) + 1)
    after[boundary.start[1:] - 1] = boundary.start[:-1]
    return Weave(after, boundary.loop.copy(), piece[boundary.vertex], root, np.zeros(len(boundary.vertex), np.bool_))


def weave_seams(
    mesh: Mesh, boundary: Boundary, weave: Weave, candidates: Candidates, method: str
) -> tuple[Mesh, list[Seam]]:
    """Turn candidates, best first, into seams: each takes what earlier ones left of its boundary.

    ``weave`` is brought up to date. O(B) a seam at worst, for B boundary entries.
    """
    strips, views, figures = _weave_kernel(candidates, weave, boundary.vertex, mesh.vertices, mesh.view)
    seams = [
        Seam((int(low), int(high)), float(run), float(mean), float(worst), method, float(total))
        for (low, high), (run, mean, worst, total) in zip(views, figures, strict=True)
    ]
    if not seams:
        return mesh, seams
    assert mesh.kind is not None  # checked by zip_patches
    new = strips[add_triangles(mesh.triangles, strips, len(mesh.vertices))]
    kind = np.concatenate((mesh.kind, np.full(len(new), SEAM, np.int8)))
    return replace(mesh, triangles=np.concatenate((mesh.triangles, new)), kind=kind), seams


@njit(cache=True, nogil=True)
def _weave_kernel(candidates, weave, vertex, vertices, view):
    """Triangles (K, 3); per seam its views (S, 2), and length, mean, largest and summed gap (S, 4) [m]."""
    at_a, begin_a, at_b, begin_b, paths, begin_path = candidates
    used = weave.used
    count = len(begin_a) - 1
    triangles = np.empty((2 * len(paths), 3), np.int32)
    views, figures = np.empty((count, 2), np.int64), np.empty((count, 4))
    n, seams = 0, 0
    for k in range(count):
        a, b = at_a[begin_a[k] : begin_a[k + 1]], at_b[begin_b[k] : begin_b[k + 1]]
        path = _longest_free(paths[begin_path[k] : begin_path[k + 1]], a, b, used)
        if len(path) < 3:
            continue
        i0, j0, i1, j1 = path[0, 0], path[0, 1], path[-1, 0], path[-1, 1]
        if i0 == i1 or j0 == j1:
            continue
        total = worst = run = 0.0
        for s in range(len(path)):
            gap = _distance(vertices, vertex[a[path[s, 0]]], vertex[b[path[s, 1]]])
            total += gap
            worst = max(worst, gap)
        for i in range(i0, i1):
            run += _distance(vertices, vertex[a[i]], vertex[a[i + 1]])
        mean = total / len(path)
        sure = run > _LONG_SEAM * mean and run > _LONGEST_CHANCE
        if not _admit(weave, a[i0], a[i1], b[j0], b[j1], sure):
            continue
        for i in range(i0, i1):
            used[a[i]] = True
        for j in range(j0 + 1, j1 + 1):
            used[b[j]] = True
        n = _strip_kernel(vertices, vertex, a, b, path, triangles, n)
        one, other = view[vertex[a[i0]]], view[vertex[b[j0]]]
        views[seams, 0], views[seams, 1] = min(one, other), max(one, other)
        figures[seams, 0], figures[seams, 1], figures[seams, 2], figures[seams, 3] = run, mean, worst, total
        seams += 1
    return triangles[:n].copy(), views[:seams].copy(), figures[:seams].copy()


@njit(cache=True, nogil=True)
def _longest_free(path, a, b, used):
    """Longest part of a warping path whose steps run over boundary edges that no seam has taken yet."""
    best_first = best_last = first = 0
    for k in range(len(path) - 1):
        # step k goes over edge i → i+1 of a (entry i) and, a chain against its direction, j+1 → j of b (entry j+1)
        taken = path[k + 1, 0] > path[k, 0] and used[a[path[k, 0]]]
        taken = taken or (path[k + 1, 1] > path[k, 1] and used[b[path[k + 1, 1]]])
        if taken:
            first = k + 1
        elif k + 1 - first > best_last - best_first:
            best_first, best_last = first, k + 1
    return path[best_first : best_last + 1]


@njit(cache=True, nogil=True)
def _distance(points, i, j):
    return np.sqrt(
        (points[i, 0] - points[j, 0]) ** 2 + (points[i, 1] - points[j, 1]) ** 2 + (points[i, 2] - points[j, 2]) ** 2
    )


@njit(cache=True, nogil=True)
def _admit(weave, a0, a1, b0, b1, sure):
    """Join a0…a1 with b0…b1 (b against its direction) in the linked boundary, unless that makes a handle.

    A seam between two pieces joins them, one along a single loop splits it in two: both leave a sphere a sphere. One
    between two loops of the same piece adds a handle (a tunnel), and is taken only where it is certain (``sure``).
    """
    after, loop, piece, root = weave.after, weave.loop, weave.piece, weave.root
    p, q = root_of(root, piece[a0]), root_of(root, piece[b0])
    if p == q and loop[a0] != loop[b0] and not sure:
        return False
    root[max(p, q)] = min(p, q)
    after[a0] = b0
    after[b1] = a1
    name = loop.max() + 1
    for begin in (a0, b1):
        k = begin
        for _ in range(len(after)):
            loop[k] = name
            k = after[k]
            if k == begin:
                break
        name += 1
    return True


@njit(cache=True, nogil=True)
def _strip_kernel(points, vertex, a, b, path, out, n):
    """Write the strip along a warping ``path`` (K, 2) from row n of ``out`` on; returns the row after it.

    ``a`` and ``b`` are entries of the boundary's ``vertex``, ``a`` in its direction (surface on the left), ``b``
    against its own. The strip is wound like the patches; a diagonal step gives two triangles, split along the shorter
    diagonal.
    """
    for k in range(1, len(path)):
        i0, j0 = path[k - 1]
        i1, j1 = path[k]
        a0, a1, b0, b1 = vertex[a[i0]], vertex[a[i1]], vertex[b[j0]], vertex[b[j1]]
        if i1 > i0 and j1 > j0:
            if _distance(points, a1, b0) <= _distance(points, a0, b1):
                out[n, 0], out[n, 1], out[n, 2] = a1, a0, b0
                out[n + 1, 0], out[n + 1, 1], out[n + 1, 2] = b0, b1, a1
            else:
                out[n, 0], out[n, 1], out[n, 2] = b0, b1, a0
                out[n + 1, 0], out[n + 1, 1], out[n + 1, 2] = a1, a0, b1
            n += 2
        elif i1 > i0:
            out[n, 0], out[n, 1], out[n, 2] = a1, a0, b0
            n += 1
        else:
            out[n, 0], out[n, 1], out[n, 2] = b0, b1, a0
            n += 1
    return n


def add_triangles(triangles: np.ndarray, new: np.ndarray, vertex_count: int) -> np.ndarray:
    """Which of the ``new`` triangles (K, 3) can join ``triangles`` without a directed edge coming twice: bool (K,).

    Tested in order, so an earlier new triangle may shut a later one out. Degenerate triangles are refused.
    """
    return _first_come_kernel(triangles, new, vertex_count)


@njit(cache=True, nogil=True)
def _first_come_kernel(triangles, new, vertex_count):
    touched = np.zeros(vertex_count, np.bool_)
    for t in range(len(new)):
        for k in range(3):
            touched[new[t, k]] = True
    # only edges between vertices of new triangles can clash
    taken = dict()
    taken[np.int64(-1)] = True
    for t in range(len(triangles)):
        for k in range(3):
            i, j = triangles[t, k], triangles[t, (k + 1) % 3]
            if touched[i] and touched[j]:
                taken[np.int64(i) * vertex_count + j] = True
    ok = np.zeros(len(new), np.bool_)
    for t in range(len(new)):
        i, j, m = np.int64(new[t, 0]), np.int64(new[t, 1]), np.int64(new[t, 2])
        if i == j or j == m or m == i:
            continue
        a, b, c = i * vertex_count + j, j * vertex_count + m, m * vertex_count + i
        if a in taken or b in taken or c in taken:
            continue
        ok[t] = True
        taken[a] = True
        taken[b] = True
        taken[c] = True
    return ok
