"""Holes → triangles, refined and faired; a closed, oriented 2-manifold at the end."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from .mesh import (
    FILL,
    SURFACE,
    Mesh,
    boundary_edges,
    boundary_loops,
    edge_keys,
    keep_triangles,
    remove_bowties,
    triangle_components,
    triangle_normals,
)
from .overlap import ViewMaps
from .zippering import _bridge_is_free


@dataclass(frozen=True)
class ClosingSettings:
    """How what is left open is closed.

    Parameters
    ----------
    largest_loop : int
        Longer loops are first cut in two by their best chord [vertices].
    refine : float
        Edges of seams and fills longer than this are split [median edge lengths of the surface around].
    fairness : float
        How stiffly the outermost measured vertices hold their place while seams and fills are faired; larger is stiffer.
    floor_reach : float
        Loops this near the floor are soles and closed flat on it [m].
    """

    largest_loop: int = 90
    refine: float = 1.7
    fairness: float = 0.3
    floor_reach: float = 0.05


def close_mesh(
    mesh: Mesh, maps: ViewMaps, up: np.ndarray, floor: float | None, settings: ClosingSettings = ClosingSettings()
) -> tuple[Mesh, list[str]]:
    """Zippered patches → one closed 2-manifold: fill what is open, refine it to the density around, fair it.

    Parameters
    ----------
    mesh : Mesh
        Edges with at most two triangles, consistently wound.
    maps : ViewMaps
        What the views saw, to keep fills out of empty space.
    up : np.ndarray [shape=(3,)]
        Vertical, camera frame.
    floor : float or None
        Height of the floor along ``up`` [m]; soles are closed flat on it.

    Returns
    -------
    mesh : Mesh
    notes : list of str
        What was dropped or could not be mended, for the user.
    """
    notes = []
    mesh, dropped = largest_component(mesh)
    if dropped:
        notes.append(f"{dropped} small piece(s) that nothing connects to the body were left out")
    mesh = remove_bowties(mesh)
    mesh, _ = fill_loops(mesh, maps, settings)
    mesh = remove_bowties(mesh)
    mesh, _ = largest_component(mesh)
    mesh = refine(mesh, edge_length_at_vertices(mesh), settings.refine)
    made = mesh.view < 0
    rim = np.zeros(len(mesh.vertices), np.bool_)
    rim[mesh.triangles[mesh.kind != SURFACE]] = True
    stiffness = np.where(made, 0.0, np.where(rim, settings.fairness, np.inf))
    mesh = replace(mesh, vertices=fair(mesh.vertices, mesh.triangles, stiffness))
    return mesh, notes


def largest_component(mesh: Mesh) -> tuple[Mesh, int]:
    """The connected piece with the most triangles, and how many others were dropped."""
    label, count = triangle_components(mesh.triangles, len(mesh.vertices))
    if count <= 1:
        return mesh, 0
    return keep_triangles(mesh, label == np.bincount(label).argmax()), count - 1


def edge_length_at_vertices(mesh: Mesh) -> np.ndarray:
    """Mean edge length (V,) of the measured triangles around each vertex; the median of all where there are none [m]."""
    surface = mesh.triangles[mesh.kind == SURFACE]
    tails, heads = surface.ravel(), np.roll(surface, -1, axis=1).ravel()
    length = np.linalg.norm(mesh.vertices[tails] - mesh.vertices[heads], axis=1)
    total = np.bincount(tails, length, len(mesh.vertices)) + np.bincount(heads, length, len(mesh.vertices))
    count = np.bincount(tails, minlength=len(mesh.vertices)) + np.bincount(heads, minlength=len(mesh.vertices))
    return np.where(count > 0, total / np.maximum(count, 1), np.median(length))


# --- filling -------------------------------------------------------------------------------------------------------


def fill_loops(mesh: Mesh, maps: ViewMaps | None, settings: ClosingSettings = ClosingSettings()) -> tuple[Mesh, np.ndarray]:
    """Close every boundary loop by the triangulation of least weight (Barequet and Sharir 1995, Liepa 2003).

    The weight sums area and bending over all triangles; chords through space that a view saw to be empty weigh tenfold.
    A chord that is already an edge of the mesh is not used; where nothing else is left, a loop gets a vertex in its middle.

    Returns
    -------
    mesh : Mesh
        Closed; its new triangles are of kind ``FILL``.
    loop_of : np.ndarray [shape=(K,), dtype=int32]
        For each new triangle the loop it closes.

    Notes
    -----
    O(n³) time and O(n²) memory for a loop of n ≤ ``largest_loop`` vertices; longer ones are cut first.
    """
    empty = np.empty(0, np.int32)
    loops = boundary_loops(mesh.triangles, len(mesh.vertices))
    if not loops:
        return mesh, empty
    edges = boundary_edges(mesh.triangles, len(mesh.vertices))
    opposite = _boundary_normals(mesh, edges)
    existing = np.unique(edge_keys(mesh.triangles, len(mesh.vertices)))
    vertices, view, colors = [mesh.vertices], [mesh.view], [mesh.colors]
    count = len(mesh.vertices)
    new, owner = [], []
    taken: set[int] = set()
    for number, loop in enumerate(loops):
        pieces = _cut_loop(mesh.vertices, loop, settings.largest_loop, existing, taken, len(mesh.vertices))
        for piece in pieces:
            triangles = _least_weight(mesh, piece, opposite, existing, taken, maps)
            if triangles is None:
                center = mesh.vertices[piece].mean(axis=0)
                vertices.append(center[None])
                view.append(np.array([-1], np.int8))
                colors.append(None if mesh.colors is None else np.rint(mesh.colors[piece].mean(axis=0)).astype(np.uint8)[None])
                fan = np.column_stack((np.roll(piece, -1), piece, np.full(len(piece), count)))
                triangles = fan.astype(np.int32)
                count += 1
            for a, b, c in triangles.tolist():
                for i, j in ((a, b), (b, c), (c, a)):
                    taken.add(min(i, j) * len(mesh.vertices) + max(i, j))
            new.append(triangles)
            owner.append(np.full(len(triangles), number, np.int32))
    fill = np.concatenate(new)
    return Mesh(
        np.concatenate(vertices),
        np.concatenate((mesh.triangles, fill)).astype(np.int32),
        None if mesh.colors is None else np.concatenate(colors),
        np.concatenate(view),
        np.concatenate((mesh.kind, np.full(len(fill), FILL, np.int8))),
    ), np.concatenate(owner)


def _boundary_normals(mesh: Mesh, edges: np.ndarray) -> dict[int, np.ndarray]:
    """Unit normal of the triangle at each boundary edge, by its tail · V + head."""
    count = len(mesh.vertices)
    a = mesh.triangles.astype(np.int64)
    keys = (a * count + np.roll(a, -1, axis=1)).ravel()
    wanted = edges[:, 0].astype(np.int64) * count + edges[:, 1]
    order = np.argsort(keys)
    at = order[np.searchsorted(keys[order], wanted)] // 3
    normals = triangle_normals(mesh.vertices, mesh.triangles[at])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-30
    return dict(zip(wanted.tolist(), normals))


def _cut_loop(vertices, loop, largest, existing, taken, count) -> list[np.ndarray]:
    """Cut a long loop in two at the chord that is shortest for the run it cuts off, until every piece is short."""
    pieces, todo = [], [loop]
    while todo:
        piece = todo.pop()
        if len(piece) <= largest:
            pieces.append(piece)
            continue
        i, j = _best_chord(vertices[piece], piece.astype(np.int64), existing, count)
        key = min(piece[i], piece[j]) * count + max(piece[i], piece[j]) if i >= 0 else -1
        if i < 0 or key in taken:
            pieces.append(piece)
            continue
        taken.add(int(key))
        todo.append(piece[i : j + 1])
        todo.append(np.concatenate((piece[j:], piece[: i + 1])))
    return pieces


@njit(cache=True, nogil=True)
def _is_in(sorted_keys, key):
    k = np.searchsorted(sorted_keys, key)
    return k < len(sorted_keys) and sorted_keys[k] == key


@njit(cache=True, nogil=True)
def _best_chord(points, ids, existing, count):
    n = len(points)
    best, bi, bj = np.inf, -1, -1
    for i in range(n):
        for j in range(i + 2, n):
            run = min(j - i, n - j + i)
            if run < n // 6:
                continue
            score = np.sqrt(((points[i] - points[j]) ** 2).sum()) / run
            if score < best and not _is_in(existing, min(ids[i], ids[j]) * count + max(ids[i], ids[j])):
                best, bi, bj = score, i, j
    return bi, bj


def _least_weight(mesh, loop, opposite, existing, taken, maps) -> np.ndarray | None:
    """Least-weight triangulation of one loop; None when every one would repeat an edge of the mesh."""
    n = len(loop)
    count = len(mesh.vertices)
    ids = loop.astype(np.int64)
    nxt = np.roll(ids, -1)
    rim = np.zeros((n, 3))
    for k, key in enumerate((ids * count + nxt).tolist()):
        normal = opposite.get(key)  # None along a chord that cut the loop
        if normal is not None:
            rim[k] = normal
    blocked = np.zeros((n, n), np.bool_)
    lower, upper = np.minimum.outer(ids, ids), np.maximum.outer(ids, ids)
    keys = lower * count + upper
    place = np.minimum(np.searchsorted(existing, keys), len(existing) - 1)
    blocked |= existing[place] == keys
    if taken:
        blocked |= np.isin(keys, np.fromiter(taken, np.int64, len(taken)))
    rows = np.arange(n)
    blocked[rows, (rows + 1) % n] = False
    blocked[(rows + 1) % n, rows] = False
    if n == 3 and not blocked.any():
        return loop[::-1][None].astype(np.int32)
    points = mesh.vertices[loop]
    penalty = np.ones((n, n))
    if maps is not None and n > 6:
        k = maps.intrinsics
        _chord_penalty(points, penalty, maps.to_view, maps.depth, maps.seen, k.fx, k.fy, k.cx, k.cy, maps.noise)
    local = _weight_kernel(points, rim, blocked, penalty)
    return None if local is None else loop[local].astype(np.int32)


@njit(cache=True, nogil=True)
def _chord_penalty(points, penalty, to_view, depth, seen, fx, fy, cx, cy, noise):
    n = len(points)
    for i in range(n):
        for j in range(i + 2, n):
            if _bridge_is_free(points[i], points[j], to_view, depth, seen, fx, fy, cx, cy, noise):
                penalty[i, j] = penalty[j, i] = 10.0


@njit(cache=True, nogil=True)
def _cross(points, i, j, k):
    ax, ay, az = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    bx, by, bz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True, nogil=True)
def _weight_kernel(points, rim, blocked, penalty):
    """Dynamic programme over the loop's chords; apex[i, j] closes the part between i and j (i < j)."""
    n = len(points)
    weight = np.full((n, n), np.inf)
    apex = np.full((n, n), -1, np.int32)
    normal = np.zeros((n, n, 3))  # of the triangle that closes the part, seen from the chord i–j
    for i in range(n - 1):
        weight[i, i + 1] = 0.0
        normal[i, i + 1] = rim[i]
    for span in range(2, n):
        for i in range(n - span):
            j = i + span
            if blocked[i, j] and not (i == 0 and j == n - 1):
                continue
            for m in range(i + 1, j):
                base = weight[i, m] + weight[m, j]
                if base >= weight[i, j]:
                    continue
                # the fill winds against the boundary: triangle (j, m, i)
                nx, ny, nz = _cross(points, j, m, i)
                area = np.sqrt(nx * nx + ny * ny + nz * nz)
                w = 0.5 * area * penalty[i, m] * penalty[m, j] * penalty[i, j] + 1e-9
                length = area + 1e-30
                nx, ny, nz = nx / length, ny / length, nz / length
                for e in range(2):
                    p, q = (i, m) if e == 0 else (m, j)
                    o = normal[p, q]
                    if o[0] != 0 or o[1] != 0 or o[2] != 0:
                        side = (points[p, 0] - points[q, 0]) ** 2 + (points[p, 1] - points[q, 1]) ** 2 + (
                            points[p, 2] - points[q, 2]) ** 2
                        bend = 1.0 - (nx * o[0] + ny * o[1] + nz * o[2])
                        w += 0.25 * bend * bend * side
                if i == 0 and j == n - 1:
                    o = rim[n - 1]
                    if o[0] != 0 or o[1] != 0 or o[2] != 0:
                        side = (points[i, 0] - points[j, 0]) ** 2 + (points[i, 1] - points[j, 1]) ** 2 + (
                            points[i, 2] - points[j, 2]) ** 2
                        bend = 1.0 - (nx * o[0] + ny * o[1] + nz * o[2])
                        w += 0.25 * bend * bend * side
                if base + w < weight[i, j]:
                    weight[i, j] = base + w
                    apex[i, j] = m
                    normal[i, j, 0], normal[i, j, 1], normal[i, j, 2] = nx, ny, nz
    if not np.isfinite(weight[0, n - 1]):
        return None
    out = np.empty((n - 2, 3), np.int32)
    stack = [(0, n - 1)]
    k = 0
    while len(stack) > 0:
        i, j = stack.pop()
        if j - i < 2:
            continue
        m = apex[i, j]
        out[k, 0], out[k, 1], out[k, 2] = j, m, i
        k += 1
        stack.append((i, m))
        stack.append((m, j))
    return out


# --- refinement ----------------------------------------------------------------------------------------------------


def refine(mesh: Mesh, target: np.ndarray, factor: float, rounds: int = 8) -> Mesh:
    """Split long edges of seams and fills until they are as dense as the surface around, keeping them Delaunay.

    Only edges between two made triangles are split or flipped, so the measured surface stays untouched.

    Parameters
    ----------
    target : np.ndarray [shape=(V,)]
        Wanted edge length at each vertex [m]; interpolated to new ones.
    factor : float
        Edges longer than this many targets are split.
    """
    vertices, triangles, kind, target = mesh.vertices, mesh.triangles, mesh.kind, target
    made = np.flatnonzero(kind != SURFACE)
    if not len(made):
        return mesh
    fixed = triangles[kind == SURFACE]
    region, region_kind = triangles[made].astype(np.int64), kind[made]
    colors = None if mesh.colors is None else mesh.colors.astype(np.float64)
    parents: list[np.ndarray] = []
    for _ in range(rounds):
        before = len(vertices)
        vertices, region, region_kind, target, added = _split_round(vertices, region, region_kind, target, factor)
        if len(added):
            parents.append(added)
        for _ in range(4):
            region, flipped = _flip_round(vertices, region, fixed)
            if not flipped:
                break
        if len(vertices) == before:
            break
    view = mesh.view
    for added in parents:
        view = np.concatenate((view, np.full(len(added), -1, np.int8)))
        if colors is not None:
            colors = np.concatenate((colors, 0.5 * (colors[added[:, 0]] + colors[added[:, 1]])))
    return Mesh(
        vertices,
        np.concatenate((fixed, region)).astype(np.int32),
        None if colors is None else np.rint(colors).astype(np.uint8),
        view,
        np.concatenate((kind[kind == SURFACE], region_kind)),
    )


def _inner_edges(region: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Corner slots (E, 2) of the edges that two region triangles share: slot 3·t + k is edge k of triangle t."""
    keys = edge_keys(region, count).ravel()
    order = np.argsort(keys, kind="stable")
    same = np.flatnonzero(keys[order][1:] == keys[order][:-1])
    return np.column_stack((order[same], order[same + 1])), keys[order[same]]


def _split_round(vertices, region, kind, target, factor):
    """Split every edge that is long and the longest of both its triangles."""
    none = np.empty((0, 2), np.int64)
    slots, _ = _inner_edges(region, len(vertices))
    if not len(slots):
        return vertices, region, kind, target, none
    a = region.ravel()[slots[:, 0]]
    b = region[slots[:, 0] // 3, (slots[:, 0] % 3 + 1) % 3]
    length = np.linalg.norm(vertices[a] - vertices[b], axis=1)
    score = length / (factor * 0.5 * (target[a] + target[b]))
    long_ = score > 1.0
    rank = np.where(long_, score, 0.0)
    # rank made unique, so that of two equal edges of a triangle one wins
    rank[long_] += 1e-9 * np.arange(long_.sum())
    best = np.zeros(len(region))
    np.maximum.at(best, slots[:, 0] // 3, rank)
    np.maximum.at(best, slots[:, 1] // 3, rank)
    take = long_ & (best[slots[:, 0] // 3] == rank) & (best[slots[:, 1] // 3] == rank)
    if not take.any():
        return vertices, region, kind, target, none
    slots, a, b = slots[take], a[take], b[take]
    middle = len(vertices) + np.arange(len(a))
    extra, extra_kind = [], []
    region = region.copy()
    for side in range(2):
        t, k = slots[:, side] // 3, slots[:, side] % 3
        tail, head, apex = region[t, k], region[t, (k + 1) % 3], region[t, (k + 2) % 3]
        extra.append(np.column_stack((middle, head, apex)))
        extra_kind.append(kind[t])
        region[t, 0], region[t, 1], region[t, 2] = tail, middle, apex
    return (
        np.concatenate((vertices, 0.5 * (vertices[a] + vertices[b]))),
        np.concatenate([region] + extra),
        np.concatenate([kind] + extra_kind),
        np.concatenate((target, 0.5 * (target[a] + target[b]))),
        np.column_stack((a, b)),
    )


def _flip_round(vertices: np.ndarray, region: np.ndarray, fixed: np.ndarray) -> tuple[np.ndarray, bool]:
    """Flip inner edges whose opposite angles sum to more than 180°, at most one a triangle."""
    count = len(vertices)
    slots, _ = _inner_edges(region, count)
    if not len(slots):
        return region, False
    t0, k0, t1, k1 = slots[:, 0] // 3, slots[:, 0] % 3, slots[:, 1] // 3, slots[:, 1] % 3
    a, b = region[t0, k0], region[t0, (k0 + 1) % 3]
    c, d = region[t0, (k0 + 2) % 3], region[t1, (k1 + 2) % 3]
    pa, pb, pc, pd = vertices[a], vertices[b], vertices[c], vertices[d]

    def angle(apex, left, right):
        x, y = left - apex, right - apex
        return np.arctan2(np.linalg.norm(np.cross(x, y), axis=1), np.einsum("ij,ij->i", x, y))

    gain = angle(pc, pa, pb) + angle(pd, pa, pb) - np.pi
    # the flipped pair must face as the old one does
    old = np.cross(pb - pa, pc - pa) + np.cross(pa - pb, pd - pb)
    facing = np.minimum(
        np.einsum("ij,ij->i", np.cross(pd - pc, pb - pc), old), np.einsum("ij,ij->i", np.cross(pc - pd, pa - pd), old)
    )
    wanted = (gain > 0.05) & (facing > 0) & (c != d)
    if not wanted.any():
        return region, False
    existing = np.unique(np.concatenate((edge_keys(region, count).ravel(), edge_keys(fixed, count).ravel())))
    key = np.minimum(c, d) * count + np.maximum(c, d)
    place = np.minimum(np.searchsorted(existing, key), len(existing) - 1)
    wanted &= existing[place] != key
    gain = np.where(wanted, gain + 1e-9 * np.arange(len(gain)), 0.0)
    best = np.zeros(len(region))
    np.maximum.at(best, t0, gain)
    np.maximum.at(best, t1, gain)
    take = wanted & (best[t0] == gain) & (best[t1] == gain)
    # two flips must not make the same edge
    _, first = np.unique(np.where(take, key, -1 - np.arange(len(key))), return_index=True)
    unique = np.zeros(len(key), np.bool_)
    unique[first] = True
    take &= unique
    if not take.any():
        return region, False
    region = region.copy()
    region[t0[take]] = np.column_stack((c, d, b))[take]
    region[t1[take]] = np.column_stack((d, c, a))[take]
    return region, True


# --- fairing -------------------------------------------------------------------------------------------------------


def neighbours(triangles: np.ndarray, vertex_count: int) -> tuple[np.ndarray, np.ndarray]:
    """One-rings as CSR arrays (start (V+1,), neighbour (E,)) of a mesh or part of one."""
    keys = np.unique(edge_keys(triangles, vertex_count))
    a, b = keys // vertex_count, keys % vertex_count
    tails, heads = np.concatenate((a, b)), np.concatenate((b, a))
    order = np.argsort(tails, kind="stable")
    start = np.searchsorted(tails[order], np.arange(vertex_count + 1))
    return start, heads[order]


def fair(vertices: np.ndarray, triangles: np.ndarray, stiffness: np.ndarray, iterations: int = 200) -> np.ndarray:
    """Move vertices so that the surface bends least (thin plate), each held to its place by its stiffness.

    Minimises Σ|L p|² + Σ stiffness²·|p − p₀|² with L the scale-dependent umbrella (Desbrun et al. 1999), by conjugate
    gradients on the normal equations; vertices of infinite stiffness do not move, so that what is filled continues the
    tangent planes around it.

    Parameters
    ----------
    vertices : np.ndarray [shape=(V, 3)]
    triangles : np.ndarray [shape=(T, 3)]
    stiffness : np.ndarray [shape=(V,)]
        0 = free, ∞ = fixed.

    Returns
    -------
    np.ndarray [shape=(V, 3)]
        O(iterations · free vertices) time.
    """
    free = np.isfinite(stiffness)
    if not free.any():
        return vertices
    touched = free[triangles].any(axis=1)
    near = np.zeros(len(vertices), np.bool_)
    near[triangles[touched]] = True
    around = near[triangles].any(axis=1)  # one-rings of the touched vertices are complete here
    used, local = np.unique(triangles[around], return_inverse=True)
    local = local.reshape(-1, 3)
    start, heads = neighbours(local, len(used))
    moved = _fair_kernel(
        vertices[used].copy(), start, heads, free[used], np.where(free[used], stiffness[used], 0.0), near[used], iterations
    )
    out = vertices.copy()
    out[used] = moved
    return out


@njit(cache=True, nogil=True)
def _laplace(p, start, heads, weight, rows, out):
    for i in range(len(rows)):
        if not rows[i]:
            out[i] = 0.0
            continue
        for c in range(3):
            out[i, c] = -p[i, c]
        for e in range(start[i], start[i + 1]):
            for c in range(3):
                out[i, c] += weight[e] * p[heads[e], c]


@njit(cache=True, nogil=True)
def _laplace_transposed(q, start, heads, weight, rows, out):
    out[:] = 0.0
    for i in range(len(rows)):
        if not rows[i]:
            continue
        for c in range(3):
            out[i, c] -= q[i, c]
        for e in range(start[i], start[i + 1]):
            for c in range(3):
                out[heads[e], c] += weight[e] * q[i, c]


@njit(cache=True, nogil=True)
def _fair_kernel(p, start, heads, free, stiffness, rows, iterations):
    count = len(p)
    weight = np.empty(len(heads))
    for i in range(count):
        total = 0.0
        for e in range(start[i], start[i + 1]):
            d = 0.0
            for c in range(3):
                d += (p[i, c] - p[heads[e], c]) ** 2
            weight[e] = 1.0 / (np.sqrt(d) + 1e-5)
            total += weight[e]
        for e in range(start[i], start[i + 1]):
            weight[e] /= total
    lap = np.empty((count, 3))
    gradient = np.empty((count, 3))
    # residual of the normal equations at p0: -LᵀL p0 on the free vertices
    _laplace(p, start, heads, weight, rows, lap)
    _laplace_transposed(lap, start, heads, weight, rows, gradient)
    r = np.zeros((count, 3))
    for i in range(count):
        if free[i]:
            for c in range(3):
                r[i, c] = -gradient[i, c]
    direction = r.copy()
    norm = (r * r).sum()
    first = norm
    step = np.zeros((count, 3))
    for _ in range(iterations):
        if norm <= 1e-8 * first or norm == 0:
            break
        _laplace(direction, start, heads, weight, rows, lap)
        _laplace_transposed(lap, start, heads, weight, rows, gradient)
        curvature = 0.0
        for i in range(count):
            if free[i]:
                for c in range(3):
                    gradient[i, c] += stiffness[i] ** 2 * direction[i, c]
                    curvature += direction[i, c] * gradient[i, c]
        if curvature <= 0:
            break
        alpha = norm / curvature
        new_norm = 0.0
        for i in range(count):
            if free[i]:
                for c in range(3):
                    step[i, c] += alpha * direction[i, c]
                    r[i, c] -= alpha * gradient[i, c]
                    new_norm += r[i, c] ** 2
        beta = new_norm / norm
        norm = new_norm
        for i in range(count):
            if free[i]:
                for c in range(3):
                    direction[i, c] = r[i, c] + beta * direction[i, c]
    return p + step
