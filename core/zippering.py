"""Which boundary meets which, and the triangles between them (paper 4.2.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from .boundary import Boundary, boundary_of
from .coronal import match_chains, outer_chains, solidity
from .dtw import dtw
from .filling import fill_loops
from .freespace import bridge_is_free
from .linear import dot
from .matching import find_partners, find_runs
from .mesh import SEAM, Mesh, components_of, extend_open_edges, merge, open_edges, twins
from .overlap import ViewMaps


@dataclass(frozen=True)
class ZipperSettings:
    """How boundaries are matched.

    Parameters
    ----------
    gaps : tuple of float
        Widest gap bridged in each round [m]; narrow gaps are zippered first.
    min_run : int
        Shortest run of facing vertices that is worth a seam.
    compactness : float
        The paper's split at the coronal and sagittal planes is used when at least this share of the silhouette's rows,
        from end to end, is body: no limbs held off it. Above 1 it is never used, 0 always.
    compact_gap : float
        Where the paper's matching leaves a wider gap than this, the general matching takes over [m].
    compact_share : float
        The paper's matching is discarded when less than this share of a matched pair is that near.
    floor_band : float
        Boundaries lower than this above the floor are soles: only the narrowest gaps are bridged there [m].
    """

    gaps: tuple[float, ...] = (0.03, 0.08, 0.12, 0.2)
    min_run: int = 4
    compactness: float = 0.93
    compact_gap: float = 0.05
    compact_share: float = 0.35
    floor_band: float = 0.05


@dataclass(frozen=True)
class Seam:
    """One zippered seam, for the report: the two views, its length, mean and widest gap [m], and how it was matched."""

    views: tuple[int, int]
    length: float
    mean_gap: float
    max_gap: float
    method: str
    distance: float


def zip_chains(points: np.ndarray, a: np.ndarray, b: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Triangles along a warping path between two chains.

    Parameters
    ----------
    points : np.ndarray [shape=(V, 3)]
        Mesh vertices [m].
    a, b : np.ndarray [shape=(N,)], [shape=(M,)]
        Vertex indices; ``a`` in its boundary's direction (surface on the left), ``b`` against its own.
    path : np.ndarray [shape=(K, 2)]
        Warping path over (a, b).

    Returns
    -------
    np.ndarray [shape=(T, 3), dtype=int32]
        A strip wound like the patches; a diagonal step gives two triangles, split along the shorter diagonal.
    """
    return _strip_kernel(points, a, b, path)


@njit(cache=True, nogil=True)
def _strip_kernel(points, a, b, path):
    out = np.empty((2 * len(path), 3), np.int32)
    n = 0
    for k in range(1, len(path)):
        i0, j0 = path[k - 1]
        i1, j1 = path[k]
        a0, a1, b0, b1 = a[i0], a[i1], b[j0], b[j1]
        if i1 > i0 and j1 > j0:
            if ((points[a1] - points[b0]) ** 2).sum() <= ((points[a0] - points[b1]) ** 2).sum():
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
    return out[:n].copy()


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


def zip_patches(
    patches: list[Mesh],
    maps: ViewMaps,
    up: np.ndarray,
    axis: np.ndarray,
    floor: float | None,
    settings: ZipperSettings = ZipperSettings(),
) -> tuple[Mesh, list[Seam]]:
    """Zipper the patches: a compact figure first as the paper does, then every pair of boundary runs that face each
    other.

    Narrow gaps come before wide ones, well matched runs before badly matched ones.

    Parameters
    ----------
    patches : list of Mesh
        One a view, camera frame, consistently wound.
    maps : ViewMaps
        What the views saw: no bridge runs through space seen to be empty.
    up, axis : np.ndarray [shape=(3,)]
        Vertical, and a point of the vertical through the subject, in which coronal and sagittal plane meet.
    floor : float or None
        Height of the floor along ``up`` [m].

    Returns
    -------
    mesh : Mesh
        With the seams' triangles (kind ``SEAM``); no directed edge occurs twice. Small holes are filled (``FILL``).
    seams : list of Seam

    Notes
    -----
    O(B²) time in the worst case for B boundary vertices, O(B) memory and one byte a DTW cell.
    """
    mesh = merge(patches)
    seams: list[Seam] = []
    if not len(mesh.triangles):
        return mesh, seams
    count = len(mesh.vertices)
    twin = twins(mesh.triangles, count)
    label, pieces = components_of(twin, len(mesh.triangles))
    piece, root = np.zeros(count, np.int64), np.arange(pieces)
    piece[mesh.triangles] = label[:, None]
    edges = open_edges(mesh.triangles, count, twin)
    boundary = boundary_of(mesh, edges)
    if not len(boundary.vertex):
        return mesh, seams
    candidates = _compact_candidates(mesh, patches, boundary, maps, up, axis, floor, settings)
    known = len(mesh.triangles)
    mesh, seams = _zip_all(mesh, boundary, _begin(boundary, piece, root), candidates, "coronal and sagittal planes")
    for reach in settings.gaps:
        edges = extend_open_edges(edges, mesh.triangles, known, len(mesh.vertices))
        boundary = boundary_of(mesh, edges)
        if not len(boundary.vertex):
            break
        candidates = _facing_candidates(mesh, boundary, maps, reach, up, floor, settings)
        known = len(mesh.triangles)
        mesh, found = _zip_all(mesh, boundary, _begin(boundary, piece, root), candidates, "facing runs")
        seams += found
        # a hole no wider than the gaps just zippered is a hole in one surface, not two boundaries to match
        edges = extend_open_edges(edges, mesh.triangles, known, len(mesh.vertices))
        known = len(mesh.triangles)
        mesh = fill_loops(mesh, maps, diameter=reach, edges=edges)
        # a hole closed round a new vertex never meets a boundary again: its piece does not matter
        piece = np.concatenate((piece, np.zeros(len(mesh.vertices) - len(piece), np.int64)))
    return mesh, seams


@dataclass
class _Weave:
    """What a round of zippering keeps up to date: which loop and which piece every boundary entry belongs to.

    ``after`` (B,) next entry along the boundary as it is now, ``loop`` (B,) its loop, ``piece`` (B,) the connected
    piece
    of the mesh, ``root`` (P,) union-find over the pieces, ``used`` (B,) edges that a seam has taken.
    """

    after: np.ndarray
    loop: np.ndarray
    piece: np.ndarray
    root: np.ndarray
    used: np.ndarray


def _begin(boundary: Boundary, piece: np.ndarray, root: np.ndarray) -> _Weave:
    after = np.arange(1, len(boundary.vertex) + 1)
    after[boundary.start[1:] - 1] = boundary.start[:-1]
    return _Weave(after, boundary.loop.copy(), piece[boundary.vertex], root, np.zeros(len(boundary.vertex), np.bool_))


@njit(cache=True, nogil=True)
def _admit(after, loop, piece, root, a0, a1, b0, b1, sure):
    """Join a0…a1 with b0…b1 (b against its direction) in the linked boundary, unless that makes a handle.

    A seam between two pieces joins them, one along a single loop parts it in two: both leave a sphere a sphere. One
    between two loops of the same piece adds a handle (a tunnel), and is taken only where it is ``sure``.
    """
    p, q = piece[a0], piece[b0]
    while root[p] != p:
        p = root[p]
    while root[q] != q:
        q = root[q]
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


def _zip_all(
    mesh: Mesh,
    boundary: Boundary,
    weave: _Weave,
    candidates: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    method: str,
) -> tuple[Mesh, list[Seam]]:
    """Turn candidates (at_a, at_b, path), best first, into seams: each takes what earlier ones left of its boundary."""
    strips, seams = [], []
    for at_a, at_b, warped in candidates:
        path = _longest_free(warped, weave.used[at_a], weave.used[at_b])
        if path is None:
            continue
        (i0, j0), (i1, j1) = path[0], path[-1]
        if i0 == i1 or j0 == j1:
            continue
        gap = np.linalg.norm(boundary.point[at_a[path[:, 0]]] - boundary.point[at_b[path[:, 1]]], axis=1)
        run = float(np.linalg.norm(np.diff(boundary.point[at_a[i0 : i1 + 1]], axis=0), axis=1).sum())
        sure = run > 12.0 * gap.mean() and run > 0.08
        if not _admit(weave.after, weave.loop, weave.piece, weave.root, at_a[i0], at_a[i1], at_b[j0], at_b[j1], sure):
            continue
        weave.used[at_a[i0:i1]] = True
        weave.used[at_b[j0 + 1 : j1 + 1]] = True
        strips.append(zip_chains(mesh.vertices, boundary.vertex[at_a], boundary.vertex[at_b], path))
        views = sorted((int(mesh.view[boundary.vertex[at_a[i0]]]), int(mesh.view[boundary.vertex[at_b[j0]]])))
        seams.append(Seam((views[0], views[1]), run, float(gap.mean()), float(gap.max()), method, float(gap.sum())))
    return _with_strips(mesh, strips), seams


def _compact_candidates(
    mesh: Mesh,
    patches: list[Mesh],
    boundary: Boundary,
    maps: ViewMaps,
    up: np.ndarray,
    axis: np.ndarray,
    floor: float | None,
    settings: ZipperSettings,
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """The paper's matching (4.2.2), kept where the boundaries it pairs run along each other.

    Empty for a figure that is not compact, or on which they mostly do not: all is left to the general matching.
    """
    if solidity(maps.labels) < settings.compactness:
        return []
    entry = np.full(len(mesh.vertices), -1)
    entry[boundary.vertex] = np.arange(len(boundary.vertex))
    candidates = []
    for a, b, warping in match_chains(mesh.vertices, outer_chains(patches, up, axis)):
        at_a, at_b, path = entry[a.vertices], entry[b.vertices[::-1]], warping.path
        p, q = boundary.point[at_a[path[:, 0]]], boundary.point[at_b[path[:, 1]]]
        near = np.linalg.norm(p - q, axis=1) <= settings.compact_gap
        near &= ~_free_bridges(p, q, maps.to_view, maps.depth, maps.seen, maps.lens, maps.noise)
        standing = np.ones(len(p), np.bool_)
        if floor is not None:  # soles have nothing to be matched with
            standing = (dot(p, up) > floor + settings.floor_band) & (dot(q, up) > floor + settings.floor_band)
        near &= standing
        if near.sum() < settings.compact_share * standing.sum():
            return []
        candidates += [(at_a, at_b, path[first:last]) for first, last in _runs_of(near, settings.min_run)]
    return candidates


def _facing_candidates(
    mesh: Mesh,
    boundary: Boundary,
    maps: ViewMaps,
    reach: float,
    up: np.ndarray,
    floor: float | None,
    settings: ZipperSettings,
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Runs that face each other over gaps up to ``reach``, warped, the best matched and longest first."""
    edge = np.median(np.linalg.norm(np.diff(boundary.point[: boundary.start[1]], axis=0), axis=1))
    limit = np.full(len(boundary.vertex), reach)
    if floor is not None:
        limit[dot(boundary.point, up) < floor + settings.floor_band] = min(reach, settings.gaps[0])
    partner, price = find_partners(boundary, limit, up, mesh.view[boundary.vertex], maps)
    ranked = []
    for at_a, at_b in find_runs(boundary, partner, 2.0 * edge, settings.min_run):
        skip = float(2.0 * edge + price[at_a][np.isfinite(price[at_a])].mean())
        warping = dtw(_features(boundary, at_a, 1.0), _features(boundary, at_b, -1.0), skip)
        mean = warping.distance / len(warping.path)
        ranked.append((mean - 1e-4 * min(len(at_a), 200), at_a, at_b, warping.path))
    ranked.sort(key=lambda candidate: (candidate[0], int(candidate[1][0])))
    return [candidate[1:] for candidate in ranked]


def _runs_of(mask: np.ndarray, shortest: int) -> list[tuple[int, int]]:
    """Runs (first, behind last) of True that are at least ``shortest`` long."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= shortest]


@njit(cache=True, nogil=True)
def _free_bridges(p, q, to_view, depth, seen, lens, noise):
    free = np.zeros(len(p), np.bool_)
    for i in range(len(p)):
        free[i] = bridge_is_free(p[i], q[i], to_view, depth, seen, lens, noise)
    return free


def _with_strips(mesh: Mesh, strips: list[np.ndarray]) -> Mesh:
    """The mesh with the strips' triangles, but for those that would repeat a directed edge."""
    if not strips:
        return mesh
    new = np.concatenate(strips)
    new = new[add_triangles(mesh.triangles, new, len(mesh.vertices))]
    return replace(
        mesh,
        triangles=np.concatenate((mesh.triangles, new)),
        kind=np.concatenate((mesh.kind, np.full(len(new), SEAM, np.int8))),
    )


def _features(boundary: Boundary, at: np.ndarray, direction: float) -> np.ndarray:
    """What DTW compares: position, and direction and normal scaled to centimetres, so that they part equal
    distances."""
    return np.concatenate(
        (boundary.point[at], 0.01 * direction * boundary.tangent[at], 0.01 * boundary.normal[at]), axis=1
    )


def _longest_free(path: np.ndarray, used_a: np.ndarray, used_b: np.ndarray) -> np.ndarray | None:
    """Longest part of a warping path whose steps run over boundary edges that no seam has taken yet."""
    if not (used_a.any() or used_b.any()):
        return path if len(path) > 2 else None
    i, j = path[:, 0], path[:, 1]
    # step k goes over edge i → i+1 of a (entry i) and, a chain against its direction, j+1 → j of b (entry j+1)
    free = np.ones(len(path) - 1, np.bool_)
    free &= ~((np.diff(i) > 0) & used_a[i[:-1]])
    free &= ~((np.diff(j) > 0) & used_b[j[1:]])
    runs = _runs_of(free, 2)
    if not runs:
        return None
    first, last = max(runs, key=lambda run: run[1] - run[0])
    return path[first : last + 1]
