"""Which boundary meets which, and the triangles between them (paper 4.2.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit, prange

from .coronal import match_chains, outer_chains, solidity
from .dtw import dtw
from .filling import fill_loops
from .freespace import bridge_is_free
from .mesh import SEAM, Mesh, extend_open_edges, loops_of, merge, open_edges, vertex_normals
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


@dataclass(frozen=True)
class Boundary:
    """All boundary vertices of a mesh, loop after loop.

    ``vertex`` (B,) mesh index; ``loop`` (B,) loop number; ``start`` (L+1,) first entry of each loop; ``point``,
    ``tangent``, ``normal``, ``outward`` (B, 3): ``outward`` is the direction in which the surface would continue.
    """

    vertex: np.ndarray
    loop: np.ndarray
    start: np.ndarray
    point: np.ndarray
    tangent: np.ndarray
    normal: np.ndarray
    outward: np.ndarray
    arc: np.ndarray


def boundary_of(mesh: Mesh, edges: np.ndarray) -> Boundary:
    """Boundary loops with the directions that matching needs, from the mesh's :func:`~.mesh.open_edges`. O(V + T)."""
    loops = loops_of(edges, len(mesh.vertices))
    start = np.concatenate(([0], np.cumsum([len(loop) for loop in loops]))).astype(np.int64)
    vertex = np.concatenate(loops) if loops else np.empty(0, np.int32)
    normals = vertex_normals(mesh.vertices, mesh.triangles)
    point = mesh.vertices[vertex]
    tangent, normal, outward, arc = _frames_kernel(point, normals[vertex], start)
    loop = np.repeat(np.arange(len(loops)), np.diff(start)).astype(np.int64)
    return Boundary(vertex, loop, start, point, tangent, normal, outward, arc)


@njit(cache=True, nogil=True)
def _frames_kernel(point, vertex_normal, start):
    """Directions along each loop, averaged over two neighbours on either side so that teeth do not turn them."""
    count = len(point)
    tangent, normal, outward = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3))
    arc = np.zeros(count)
    for loop in range(len(start) - 1):
        a, n = start[loop], start[loop + 1] - start[loop]
        half = min(3, (n - 1) // 2)
        total = 0.0
        for k in range(n):
            i = a + k
            arc[i] = total
            nxt = a + (k + 1) % n
            total += np.sqrt(((point[nxt] - point[i]) ** 2).sum())
            for s in range(-half, half + 1):
                normal[i] += vertex_normal[a + (k + s) % n]
            tangent[i] = point[a + (k + half) % n] - point[a + (k - half) % n]
        for k in range(n):
            i = a + k
            for m in (normal, tangent):
                length = np.sqrt((m[i] ** 2).sum())
                if length > 0:
                    m[i] /= length
            # the surface lies on the left of the boundary's direction, so its continuation on the right
            outward[i] = np.cross(tangent[i], normal[i])
            length = np.sqrt((outward[i] ** 2).sum())
            if length > 0:
                outward[i] /= length
    return tangent, normal, outward, arc


@njit(cache=True, nogil=True, parallel=True)
def _partners_kernel(
    point, level, order, tangent, normal, outward, loop, arc, length_of, limit, to_view, depth, seen, fx, fy, cx, cy, noise
):
    """For each boundary vertex the one it would best be bridged to (index, -1 none) and at what cost [m]."""
    count = len(point)
    partner = np.full(count, -1, np.int64)
    price = np.full(count, np.inf)
    for at in prange(count):
        i = order[at]
        best = np.inf
        which = -1
        # outwards along the sorting axis, on both sides in turn, until nothing nearer can come
        down, up_ = at - 1, at + 1
        while down >= 0 or up_ < count:
            if up_ >= count or (down >= 0 and level[i] - level[order[down]] <= level[order[up_]] - level[i]):
                j = order[down]
                down -= 1
            else:
                j = order[up_]
                up_ += 1
            if abs(level[j] - level[i]) > min(limit[i], best):
                break
            dx, dy, dz = point[j, 0] - point[i, 0], point[j, 1] - point[i, 1], point[j, 2] - point[i, 2]
            d2 = dx * dx + dy * dy + dz * dz
            if d2 >= best * best or d2 > min(limit[i], limit[j]) ** 2:
                continue
            d = np.sqrt(d2)
            along = tangent[i, 0] * tangent[j, 0] + tangent[i, 1] * tangent[j, 1] + tangent[i, 2] * tangent[j, 2]
            if along > 0.3:
                continue
            facing = normal[i, 0] * normal[j, 0] + normal[i, 1] * normal[j, 1] + normal[i, 2] * normal[j, 2]
            if facing < -0.6:
                continue
            if loop[i] == loop[j]:  # across a slot, not round its tip
                run = abs(arc[i] - arc[j])
                run = min(run, length_of[loop[i]] - run)
                if run < 2.5 * d or run < 0.012:
                    continue
            out_i = (outward[i, 0] * dx + outward[i, 1] * dy + outward[i, 2] * dz) / (d + 1e-9)
            out_j = -(outward[j, 0] * dx + outward[j, 1] * dy + outward[j, 2] * dz) / (d + 1e-9)
            if min(out_i, out_j) < -0.35 and d > 0.01:
                continue
            cost = d * (1.0 + 0.6 * (1.0 + along) + 0.5 * (1.0 - facing) + 0.4 * (2.0 - out_i - out_j))
            if cost >= best:
                continue
            if bridge_is_free(point[i], point[j], to_view, depth, seen, fx, fy, cx, cy, noise):
                continue
            best = cost
            which = j
        partner[i] = which
        price[i] = best
    return partner, price


@njit(cache=True, nogil=True)
def _ring_distance(a, b, n):
    d = abs(a - b) % n
    return min(d, n - d)


@njit(cache=True, nogil=True)
def _runs_kernel(partner, loop, start, point, tolerance, min_run):
    """Runs of boundary vertices whose partners are mutual and follow each other backwards on one loop.

    Rows: loop A, first place on A, number of vertices; loop B, place of the first partner, number of vertices backwards.
    """
    count = len(partner)
    good = np.zeros(count, np.bool_)
    for i in range(count):
        j = partner[i]
        if j < 0 or partner[j] < 0:
            continue
        k = partner[j]
        if loop[k] != loop[i]:
            continue
        gap = np.sqrt(((point[i] - point[j]) ** 2).sum())
        back = np.sqrt(((point[i] - point[k]) ** 2).sum())
        good[i] = back <= 1.5 * gap + tolerance
    rows = np.empty((count, 6), np.int64)
    n_rows = 0
    for a in range(len(start) - 1):
        base, n = start[a], start[a + 1] - start[a]
        # begin where a run is broken, so that none is cut by the loop's seam
        first = 0
        for k in range(n):
            if not good[base + k]:
                first = k
                break
        k = 0
        while k < n:
            i = base + (first + k) % n
            if not good[i]:
                k += 1
                continue
            b = loop[partner[i]]
            nb = start[b + 1] - start[b]
            begin = k
            last_good = k
            place = partner[i] - start[b]
            span = 0
            missed = 0
            k += 1
            while k < n:
                i2 = base + (first + k) % n
                ok = good[i2] and loop[partner[i2]] == b
                if ok:
                    step = (place - (partner[i2] - start[b])) % nb  # backwards steps
                    if step > nb // 2:
                        step -= nb
                    jump = np.sqrt(((point[partner[i2]] - point[start[b] + place]) ** 2).sum())
                    moved = np.sqrt(((point[i2] - point[base + (first + last_good) % n]) ** 2).sum())
                    gap = np.sqrt(((point[partner[i2]] - point[i2]) ** 2).sum())
                    ok = step >= -3 and jump <= 3.0 * moved + gap + tolerance and span + step < nb
                    if ok and step > 0:
                        place = (place - step) % nb
                        span += step
                if ok:
                    last_good = k
                    missed = 0
                else:
                    missed += 1
                    if missed > 4:
                        break
                k += 1
            if last_good - begin + 1 >= min_run and span + 1 >= 2:
                rows[n_rows, 0] = a
                rows[n_rows, 1] = (first + begin) % n
                rows[n_rows, 2] = last_good - begin + 1
                rows[n_rows, 3] = b
                rows[n_rows, 4] = (partner[base + (first + begin) % n] - start[b]) % nb
                rows[n_rows, 5] = span + 1
                n_rows += 1
            k = last_good + 1
    return rows[:n_rows].copy()


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
    """Zipper the patches: a compact figure first as the paper does, then every pair of boundary runs that face each other.

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
    edges = open_edges(mesh.triangles, len(mesh.vertices))
    known = len(mesh.triangles)
    mesh, seams = _zip_compact(mesh, patches, maps, up, axis, floor, settings)
    for reach in settings.gaps:
        edges = extend_open_edges(edges, mesh.triangles, known, len(mesh.vertices))
        known = len(mesh.triangles)
        mesh, found = _zip_round(mesh, edges, maps, reach, up, floor, settings)
        seams += found
        # a hole no wider than the gaps just zippered is a hole in one surface, not two boundaries to match
        edges = extend_open_edges(edges, mesh.triangles, known, len(mesh.vertices))
        known = len(mesh.triangles)
        mesh = fill_loops(mesh, maps, diameter=reach, edges=edges)
    return mesh, seams


def _zip_compact(
    mesh: Mesh, patches: list[Mesh], maps: ViewMaps, up: np.ndarray, axis: np.ndarray, floor: float | None,
    settings: ZipperSettings,
) -> tuple[Mesh, list[Seam]]:
    """The paper's way (4.2.2), kept where the boundaries it matches run along each other.

    A figure on which they mostly do not is not compact, and all is left to the general matching.
    """
    if solidity(maps.labels) < settings.compactness:
        return mesh, []
    chains = outer_chains(patches, up, axis)
    k = maps.intrinsics
    seams, strips = [], []
    for a, b, warping in match_chains(mesh.vertices, chains):
        at_a, at_b = a.vertices, b.vertices[::-1]
        p, q = mesh.vertices[at_a[warping.path[:, 0]]], mesh.vertices[at_b[warping.path[:, 1]]]
        gap = np.linalg.norm(p - q, axis=1)
        near = gap <= settings.compact_gap
        near &= ~_free_bridges(p, q, maps.to_view, maps.depth, maps.seen, k.fx, k.fy, k.cx, k.cy, maps.noise)
        standing = np.ones(len(p), np.bool_)
        if floor is not None:  # soles have nothing to be matched with
            standing = (p @ up > floor + settings.floor_band) & (q @ up > floor + settings.floor_band)
        near &= standing
        if near.sum() < settings.compact_share * standing.sum():
            return mesh, []
        for first, last in _runs_of(near, settings.min_run):
            path = warping.path[first:last]
            i0, i1 = path[0, 0], path[-1, 0]
            if i1 == i0:
                continue
            strips.append(zip_chains(mesh.vertices, at_a, at_b, path))
            run = np.linalg.norm(np.diff(mesh.vertices[at_a[i0 : i1 + 1]], axis=0), axis=1).sum()
            seams.append(Seam(
                (a.patch, b.patch), float(run), float(gap[first:last].mean()), float(gap[first:last].max()),
                "coronal and sagittal planes", float(gap[first:last].sum()),
            ))
    return _with_strips(mesh, strips), seams


def _runs_of(mask: np.ndarray, shortest: int) -> list[tuple[int, int]]:
    """Runs (first, behind last) of True that are at least ``shortest`` long."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2]) if b - a >= shortest]


@njit(cache=True, nogil=True)
def _free_bridges(p, q, to_view, depth, seen, fx, fy, cx, cy, noise):
    free = np.zeros(len(p), np.bool_)
    for i in range(len(p)):
        free[i] = bridge_is_free(p[i], q[i], to_view, depth, seen, fx, fy, cx, cy, noise)
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


def _zip_round(
    mesh: Mesh, edges: np.ndarray, maps: ViewMaps, reach: float, up: np.ndarray, floor: float | None,
    settings: ZipperSettings,
) -> tuple[Mesh, list[Seam]]:
    boundary = boundary_of(mesh, edges)
    if not len(boundary.vertex):
        return mesh, []
    k = maps.intrinsics
    edge = np.median(np.linalg.norm(np.diff(boundary.point[: boundary.start[1]], axis=0), axis=1))
    length_of = np.array([
        boundary.arc[e - 1] + np.linalg.norm(boundary.point[s] - boundary.point[e - 1])
        for s, e in zip(boundary.start[:-1], boundary.start[1:])
    ])
    level = boundary.point @ up
    limit = np.full(len(boundary.vertex), reach)
    if floor is not None:
        limit[level < floor + settings.floor_band] = min(reach, settings.gaps[0])
    partner, price = _partners_kernel(
        boundary.point, level, np.argsort(level, kind="stable"),
        boundary.tangent, boundary.normal, boundary.outward, boundary.loop, boundary.arc, length_of, limit,
        maps.to_view, maps.depth, maps.seen, k.fx, k.fy, k.cx, k.cy, maps.noise,
    )
    rows = _runs_kernel(partner, boundary.loop, boundary.start, boundary.point, 2.0 * edge, settings.min_run)
    candidates = []
    for loop_a, first_a, n_a, loop_b, first_b, n_b in rows:
        size_a = boundary.start[loop_a + 1] - boundary.start[loop_a]
        size_b = boundary.start[loop_b + 1] - boundary.start[loop_b]
        at_a = boundary.start[loop_a] + (first_a + np.arange(n_a)) % size_a
        at_b = boundary.start[loop_b] + (first_b - np.arange(n_b)) % size_b
        if len(at_b) < 2:
            continue
        if loop_a == loop_b and np.intersect1d(at_a, at_b).size:
            continue
        warping = dtw(_features(boundary, at_a, 1.0), _features(boundary, at_b, -1.0), skip=float(2.0 * edge + np.median(price[at_a])))
        mean = warping.distance / len(warping.path)
        candidates.append((mean - 1e-4 * min(n_a, 200), at_a, at_b, warping))
    candidates.sort(key=lambda c: (c[0], int(c[1][0])))
    used = np.zeros(len(boundary.vertex), np.bool_)  # boundary edge from this entry to the next
    new, seams = [], []
    for _, at_a, at_b, warping in candidates:
        path = _longest_free(warping.path, used[at_a], used[at_b])
        if path is None:
            continue
        strip = zip_chains(mesh.vertices, boundary.vertex[at_a], boundary.vertex[at_b], path)
        i0, j0 = path[0]
        i1, j1 = path[-1]
        used[at_a[i0:i1]] = True
        used[at_b[j0 + 1 : j1 + 1]] = True
        new.append(strip)
        gap = np.linalg.norm(boundary.point[at_a[path[:, 0]]] - boundary.point[at_b[path[:, 1]]], axis=1)
        run = np.linalg.norm(np.diff(boundary.point[at_a[i0 : i1 + 1]], axis=0), axis=1).sum()
        views = sorted((int(mesh.view[boundary.vertex[at_a[i0]]]), int(mesh.view[boundary.vertex[at_b[j0]]])))
        seams.append(Seam((views[0], views[1]), float(run), float(gap.mean()), float(gap.max()), "facing runs", warping.distance))
    return _with_strips(mesh, new), seams


def _features(boundary: Boundary, at: np.ndarray, direction: float) -> np.ndarray:
    """What DTW compares: position, and direction and normal scaled to centimetres, so that they part equal distances."""
    return np.concatenate((boundary.point[at], 0.01 * direction * boundary.tangent[at], 0.01 * boundary.normal[at]), axis=1)


def _longest_free(path: np.ndarray, used_a: np.ndarray, used_b: np.ndarray) -> np.ndarray | None:
    """Longest part of a warping path whose steps run over boundary edges that no seam has taken yet."""
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
