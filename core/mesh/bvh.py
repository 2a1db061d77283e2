"""Bounding volume hierarchy over a mesh's triangles: rays, closest points.

The tree is a tuple of flat arrays, so that any other kernel may take it as an argument and call
:func:`raycast_one` or :func:`closest_one` from inside its own loop.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import MirrorScanError
from ..numeric.kernels import njit
from ..numeric.threads import each_range

STACK = 64
"""Entries a traversal stack needs; :func:`build_bvh` never makes a tree deeper than that."""

_LEAF = 4  # most triangles of a leaf
_BINS = 16  # bins of the surface area heuristic
_HALVE_BELOW = 32  # depth from which ranges are halved, so that 32 + log2(2^31) levels bound the stack
_CHUNK = 256  # queries that one thread takes at least
_ROUND_UP = 1.0 + 1e-15  # lengthens a slab's exit past its rounding error (Ize 2013)


class Bvh(NamedTuple):
    """A binary tree of axis-aligned boxes over T triangles, M < 2 T nodes, root first.

    The two children of a node are neighbours and come after it. ``None`` triangles give M = 0.

    Attributes
    ----------
    boxes : np.ndarray [shape=(M, 6), dtype=float64]
        Lower x, y, z, upper x, y, z of what the node holds [m].
    child : np.ndarray [shape=(M,), dtype=int32]
        Inner node: its first child (the second is the next). Leaf: its first place in ``order``.
    count : np.ndarray [shape=(M,), dtype=int32]
        Triangles of a leaf, 0 for an inner node.
    order : np.ndarray [shape=(T,), dtype=int32]
        Which triangle sits at each place; a subtree's places are contiguous.
    corners : np.ndarray [shape=(T, 3, 3), dtype=float64]
        Corners of the triangles, in ``order`` [m].
    """

    boxes: np.ndarray
    child: np.ndarray
    count: np.ndarray  # type: ignore[assignment]  # tuple has a method of that name
    order: np.ndarray
    corners: np.ndarray


def build_bvh(vertices: np.ndarray, triangles: np.ndarray, quick: bool = False) -> Bvh:
    """Build the tree by a binned surface area heuristic (Wald 2007) on the widest axis.

    ``quick`` halves the triangles along a space-filling curve instead (Lauterbach et al. 2009): built in a third of the
    time, for a tree that is searched once.

    Time O(T log T), memory about 300 bytes a triangle.

    Parameters
    ----------
    vertices : np.ndarray [shape=(V, 3)]
        Positions [m].
    triangles : np.ndarray [shape=(T, 3)]
        Vertex indices.

    Returns
    -------
    Bvh

    Raises
    ------
    MirrorScanError
        When an index is out of range, or a used vertex is not finite.
    """
    return _build_kernel(np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(triangles, np.int32), quick)


@njit(cache=True, nogil=True, error_model="numpy")
def _build_kernel(vertices, triangles, quick):
    total = triangles.shape[0]
    corners = np.empty((total, 3, 3))
    origin = np.full(3, np.inf)
    for i in range(total):
        for k in range(3):
            vertex = triangles[i, k]
            if vertex < 0 or vertex >= vertices.shape[0]:
                raise MirrorScanError("bvh: a triangle names a vertex that does not exist; the mesh is damaged")
            for axis in range(3):
                value = vertices[vertex, axis]
                if not np.isfinite(value):
                    raise MirrorScanError("bvh: a vertex of the mesh is not a finite number; remove it first")
                origin[axis] = min(origin[axis], value)
    # Splits are decided on float32 boxes (half the memory traffic); the boxes kept are float64, fitted at the end.
    bounds = np.empty((total, 6), dtype=np.float32)
    order = np.empty(total, dtype=np.int32)
    for i in range(total):
        order[i] = i
        for axis in range(3):
            a, b, c = vertices[triangles[i, 0], axis], vertices[triangles[i, 1], axis], vertices[triangles[i, 2], axis]
            bounds[i, axis] = min(a, b, c) - origin[axis]
            bounds[i, axis + 3] = max(a, b, c) - origin[axis]

    if quick:
        order = _along_curve(bounds).astype(np.int32)
        bounds = bounds[order]
    capacity = max(2 * total - 1, 0)
    child = np.empty(capacity, dtype=np.int32)
    count = np.empty(capacity, dtype=np.int32)
    todo = np.empty((STACK + 2, 4), dtype=np.int32)  # node, first, end, depth
    used, waiting = 0, 0
    if total > 0:
        todo[0, 0], todo[0, 1], todo[0, 2], todo[0, 3] = 0, 0, total, 0
        used, waiting = 1, 1
    bin_box = np.empty((_BINS, 6), dtype=np.float32)
    bin_count = np.empty(_BINS, dtype=np.int32)
    right_cost = np.empty(_BINS, dtype=np.float32)
    while waiting > 0:
        waiting -= 1
        node, first, end, depth = todo[waiting, 0], todo[waiting, 1], todo[waiting, 2], todo[waiting, 3]
        if end - first <= _LEAF:
            child[node], count[node] = first, end - first
            continue
        middle = (first + end) // 2
        if depth < _HALVE_BELOW and not quick:
            middle = _split(bounds, order, first, end, bin_box, bin_count, right_cost)
        child[node], count[node] = used, 0
        # the second child waits below the first, so that places and nodes run depth-first
        todo[waiting, 0], todo[waiting, 1], todo[waiting, 2], todo[waiting, 3] = used + 1, middle, end, depth + 1
        waiting += 1
        todo[waiting, 0], todo[waiting, 1], todo[waiting, 2], todo[waiting, 3] = used, first, middle, depth + 1
        waiting += 1
        used += 2

    for i in range(total):
        for k in range(3):
            for axis in range(3):
                corners[i, k, axis] = vertices[triangles[order[i], k], axis]
    child, count = child[:used].copy(), count[:used].copy()
    return Bvh(_fit_boxes(child, count, corners), child, count, order, corners)


@njit(cache=True, nogil=True, error_model="numpy")
def _fit_boxes(child, count, corners):
    """Boxes (M, 6) of the nodes: children come after their parents, so the nodes are done in reverse order. O(T)."""
    boxes = np.empty((len(count), 6))
    for node in range(len(count) - 1, -1, -1):
        if count[node] == 0:
            left = child[node]
            for axis in range(3):
                boxes[node, axis] = min(boxes[left, axis], boxes[left + 1, axis])
                boxes[node, axis + 3] = max(boxes[left, axis + 3], boxes[left + 1, axis + 3])
        else:
            for axis in range(3):
                low, high = np.inf, -np.inf
                for i in range(child[node], child[node] + count[node]):
                    for k in range(3):
                        low = min(low, corners[i, k, axis])
                        high = max(high, corners[i, k, axis])
                boxes[node, axis], boxes[node, axis + 3] = low, high
    return boxes


@njit(cache=True, nogil=True, error_model="numpy")
def _along_curve(bounds):
    """Order of boxes (T, 6) by the Morton code of their middles, 10 bits an axis; a radix sort. O(T)."""
    total = len(bounds)
    low, extent = np.full(3, np.inf), 1e-30
    for i in range(total):
        for k in range(3):
            low[k] = min(low[k], bounds[i, k] + bounds[i, k + 3])
    for i in range(total):
        for k in range(3):
            extent = max(extent, bounds[i, k] + bounds[i, k + 3] - low[k])
    code = np.empty(total, np.int64)
    for i in range(total):
        code[i] = 0
        for k in range(3):
            cell = np.int64((bounds[i, k] + bounds[i, k + 3] - low[k]) / extent * 1023.0)
            cell = (cell | (cell << 16)) & 0x030000FF
            cell = (cell | (cell << 8)) & 0x0300F00F
            cell = (cell | (cell << 4)) & 0x030C30C3
            cell = (cell | (cell << 2)) & 0x09249249
            code[i] |= cell << k
    order, moved = np.arange(total), np.empty(total, np.int64)
    for shift in (0, 10, 20):
        begin = np.zeros(1025, np.int64)
        for i in range(total):
            begin[((code[i] >> shift) & 1023) + 1] += 1
        for d in range(1024):
            begin[d + 1] += begin[d]
        for i in order:
            digit = (code[i] >> shift) & 1023
            moved[begin[digit]] = i
            begin[digit] += 1
        order, moved = moved, order
    return order


@njit(cache=True, nogil=True, error_model="numpy")
def _split(bounds, order, first, end, bin_box, bin_count, right_cost):
    """Part places ``first:end`` in two; return where the second part begins (never an empty part)."""
    low0 = low1 = low2 = np.float32(np.inf)
    high0 = high1 = high2 = np.float32(-np.inf)
    for i in range(first, end):
        c0, c1, c2 = bounds[i, 0] + bounds[i, 3], bounds[i, 1] + bounds[i, 4], bounds[i, 2] + bounds[i, 5]
        low0, low1, low2 = min(low0, c0), min(low1, c1), min(low2, c2)
        high0, high1, high2 = max(high0, c0), max(high1, c1), max(high2, c2)
    axis, low, extent = 0, low0, high0 - low0
    if high1 - low1 > extent:
        axis, low, extent = 1, low1, high1 - low1
    if high2 - low2 > extent:
        axis, low, extent = 2, low2, high2 - low2
    middle = (first + end) // 2
    if not extent > 0:
        return middle
    bins = _BINS if end - first > 64 else _BINS // 2  # few triangles do not repay the sweep over many bins
    scale = np.float32(bins * 0.999999) / extent
    if not np.isfinite(scale):
        return middle

    for b in range(bins):
        bin_count[b] = 0
        for k in range(3):
            bin_box[b, k] = np.inf
            bin_box[b, k + 3] = -np.inf
    for i in range(first, end):
        b = min(np.int32((bounds[i, axis] + bounds[i, axis + 3] - low) * scale), np.int32(bins - 1))
        bin_count[b] += 1
        for k in range(3):
            bin_box[b, k] = min(bin_box[b, k], bounds[i, k])
            bin_box[b, k + 3] = max(bin_box[b, k + 3], bounds[i, k + 3])

    l0 = l1 = l2 = np.float32(np.inf)
    h0 = h1 = h2 = np.float32(-np.inf)
    held = 0
    for b in range(bins - 1, 0, -1):
        l0, l1, l2 = min(l0, bin_box[b, 0]), min(l1, bin_box[b, 1]), min(l2, bin_box[b, 2])
        h0, h1, h2 = max(h0, bin_box[b, 3]), max(h1, bin_box[b, 4]), max(h2, bin_box[b, 5])
        held += bin_count[b]
        x, y, z = h0 - l0, h1 - l1, h2 - l2
        right_cost[b] = (x * y + y * z + z * x) * held if held > 0 else np.float32(0.0)
    l0 = l1 = l2 = np.float32(np.inf)
    h0 = h1 = h2 = np.float32(-np.inf)
    held, best, cut = 0, np.float32(np.inf), -1
    for b in range(bins - 1):
        l0, l1, l2 = min(l0, bin_box[b, 0]), min(l1, bin_box[b, 1]), min(l2, bin_box[b, 2])
        h0, h1, h2 = max(h0, bin_box[b, 3]), max(h1, bin_box[b, 4]), max(h2, bin_box[b, 5])
        held += bin_count[b]
        if held == 0 or held == end - first:
            continue
        x, y, z = h0 - l0, h1 - l1, h2 - l2
        cost = (x * y + y * z + z * x) * held + right_cost[b + 1]
        if cost < best:
            best, cut = cost, b
    if cut < 0:
        return middle

    i, j = first, end - 1
    while i <= j:
        if min(np.int32((bounds[i, axis] + bounds[i, axis + 3] - low) * scale), np.int32(bins - 1)) <= cut:
            i += 1
        else:
            order[i], order[j] = order[j], order[i]
            for k in range(6):
                bounds[i, k], bounds[j, k] = bounds[j, k], bounds[i, k]
            j -= 1
    return i


@njit(cache=True, nogil=True, error_model="numpy")
def raycast_one(bvh, ox, oy, oz, dx, dy, dz, t_max, stack):
    """First triangle a ray meets, from inside another kernel.

    Boxes by robust slabs (Ize 2013), triangles by the watertight test of Woop, Benthin and Wald (2013):
    a ray cannot slip between two triangles that share an edge. One piece, as every part of the walk needs most of the
    twenty numbers that are made of the ray beforehand.

    Parameters
    ----------
    bvh : Bvh
    ox, oy, oz, dx, dy, dz : float
        Origin [m] and direction (any length but zero).
    t_max : float
        Hits are sought at 0 <= t < t_max, in lengths of the direction.
    stack : np.ndarray [shape=(STACK,), dtype=int32]
        Scratch; allocate it once a task, not once a ray.

    Returns
    -------
    t, triangle, u, v : float, int, float, float
        The hit is ``origin + t * direction`` and ``(1-u-v) * a + u * b + v * c``; (inf, -1, 0, 0) for none.
    """
    best_t, best, best_u, best_v = t_max, -1, 0.0, 0.0
    ax, ay, az = abs(dx), abs(dy), abs(dz)
    if bvh.boxes.shape[0] == 0 or not (ax + ay + az > 0.0 and ax + ay + az < np.inf):
        return np.inf, -1, 0.0, 0.0
    boxes, child, count, corners = bvh.boxes, bvh.child, bvh.count, bvh.corners
    # a huge finite inverse instead of inf keeps 0 * inf = NaN out of the slabs
    ix = 1.0 / dx if ax > 1e-150 else np.copysign(1e150, dx)
    iy = 1.0 / dy if ay > 1e-150 else np.copysign(1e150, dy)
    iz = 1.0 / dz if az > 1e-150 else np.copysign(1e150, dz)
    nx, ny, nz = (0 if ix > 0 else 3), (1 if iy > 0 else 4), (2 if iz > 0 else 5)
    fx, fy, fz = 3 - nx, 5 - ny, 7 - nz

    # Woop: shear space so that the ray runs along the axis it is longest on
    if ax >= ay and ax >= az:
        kx, ky, kz, main = 1, 2, 0, dx
        sx, sy = dy / dx, dz / dx
    elif ay >= az:
        kx, ky, kz, main = 2, 0, 1, dy
        sx, sy = dz / dy, dx / dy
    else:
        kx, ky, kz, main = 0, 1, 2, dz
        sx, sy = dx / dz, dy / dz
    sz = 1.0 / main
    okx = ox if kx == 0 else (oy if kx == 1 else oz)
    oky = ox if ky == 0 else (oy if ky == 1 else oz)
    okz = ox if kz == 0 else (oy if kz == 1 else oz)

    node, depth = 0, 0
    while True:
        if count[node] > 0:
            first = child[node]
            for i in range(first, first + count[node]):
                a2, b2, c2 = corners[i, 0, kz] - okz, corners[i, 1, kz] - okz, corners[i, 2, kz] - okz
                a0, a1 = corners[i, 0, kx] - okx - sx * a2, corners[i, 0, ky] - oky - sy * a2
                b0, b1 = corners[i, 1, kx] - okx - sx * b2, corners[i, 1, ky] - oky - sy * b2
                c0, c1 = corners[i, 2, kx] - okx - sx * c2, corners[i, 2, ky] - oky - sy * c2
                wa, wb, wc = c0 * b1 - c1 * b0, a0 * c1 - a1 * c0, b0 * a1 - b1 * a0
                if (wa < 0.0 or wb < 0.0 or wc < 0.0) and (wa > 0.0 or wb > 0.0 or wc > 0.0):
                    continue
                det = wa + wb + wc
                if det == 0.0:
                    continue
                t = (wa * a2 + wb * b2 + wc * c2) * sz / det
                if 0.0 <= t < best_t:
                    best_t, best, best_u, best_v = t, i, wb / det, wc / det
        else:
            left = child[node]
            near0 = max((boxes[left, nx] - ox) * ix, (boxes[left, ny] - oy) * iy, (boxes[left, nz] - oz) * iz, 0.0)
            far0 = min((boxes[left, fx] - ox) * ix, (boxes[left, fy] - oy) * iy, (boxes[left, fz] - oz) * iz)
            right = left + 1
            near1 = max((boxes[right, nx] - ox) * ix, (boxes[right, ny] - oy) * iy, (boxes[right, nz] - oz) * iz, 0.0)
            far1 = min((boxes[right, fx] - ox) * ix, (boxes[right, fy] - oy) * iy, (boxes[right, fz] - oz) * iz)
            hit0 = near0 <= far0 * _ROUND_UP and near0 < best_t
            hit1 = near1 <= far1 * _ROUND_UP and near1 < best_t
            if hit0 and hit1:
                if near1 < near0:
                    left, right = right, left
                stack[depth] = right
                depth += 1
                node = left
                continue
            if hit0:
                node = left
                continue
            if hit1:
                node = right
                continue
        if depth == 0:
            break
        depth -= 1
        node = stack[depth]
    if best < 0:
        return np.inf, -1, 0.0, 0.0
    return best_t, bvh.order[best], best_u, best_v


@njit(cache=True, nogil=True, error_model="numpy")
def _raycast_kernel(first, last, bvh, origins, directions, t_max, t, triangle, barycentric):
    stack = np.empty(STACK, dtype=np.int32)
    for i in range(first, last):
        t[i], triangle[i], barycentric[i, 0], barycentric[i, 1] = raycast_one(
            bvh,
            origins[i, 0],
            origins[i, 1],
            origins[i, 2],
            directions[i, 0],
            directions[i, 1],
            directions[i, 2],
            t_max,
            stack,
        )


def raycast(
    bvh: Bvh, origins: np.ndarray, directions: np.ndarray, t_max: float = np.inf
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First triangle each ray meets, on all cores.

    Parameters
    ----------
    bvh : Bvh
        From :func:`build_bvh`.
    origins, directions : np.ndarray [shape=(N, 3) or (3,)]
        Rays; a single origin or direction serves all. Directions need no unit length; a zero or
        non-finite one meets nothing.
    t_max : float
        Hits count below it, in lengths of the direction.

    Returns
    -------
    t : np.ndarray [shape=(N,), dtype=float64]
        Hit at ``origin + t * direction``; inf for none.
    triangle : np.ndarray [shape=(N,), dtype=int32]
        -1 for none.
    barycentric : np.ndarray [shape=(N, 2), dtype=float64]
        Weights of the triangle's second and third corner; 0 for none.

    Raises
    ------
    MirrorScanError
        When the shapes do not fit.
    """
    origins, directions = np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)
    if origins.shape[-1:] != (3,) or directions.shape[-1:] != (3,) or max(origins.ndim, directions.ndim) > 2:
        raise MirrorScanError(
            f"raycast: origins and directions must be (N, 3), got {origins.shape} and {directions.shape}"
        )
    try:
        # copied: what broadcast_arrays gives is read-only, or warns of becoming so
        pair = np.broadcast_arrays(np.atleast_2d(origins), np.atleast_2d(directions))
        origins, directions = (np.array(a, order="C") for a in pair)
    except ValueError as error:
        raise MirrorScanError(
            f"raycast: {len(origins)} origins do not pair with {len(directions)} directions"
        ) from error
    total = len(origins)
    t, triangle, barycentric = np.empty(total), np.empty(total, dtype=np.int32), np.empty((total, 2))
    each_range(_raycast_kernel, total, bvh, origins, directions, float(t_max), t, triangle, barycentric, least=_CHUNK)
    return t, triangle, barycentric


@njit(cache=True, nogil=True, error_model="numpy")
def _segment_nearest(px, py, pz, corners, i, j, k):
    """Nearest point of the edge j-k of triangle i and its squared distance; without length it is its first end."""
    ax, ay, az = corners[i, j, 0], corners[i, j, 1], corners[i, j, 2]
    dx, dy, dz = corners[i, k, 0] - ax, corners[i, k, 1] - ay, corners[i, k, 2] - az
    length = dx * dx + dy * dy + dz * dz
    s = 0.0
    if length > 0.0:
        s = min(1.0, max(0.0, ((px - ax) * dx + (py - ay) * dy + (pz - az) * dz) / length))
    x, y, z = ax + s * dx, ay + s * dy, az + s * dz
    return (x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2, x, y, z


@njit(cache=True, nogil=True, error_model="numpy")
def _triangle_nearest(px, py, pz, corners, i):
    """Nearest point of triangle i and its squared distance; a triangle without area is its edges."""
    ax, ay, az = corners[i, 0, 0], corners[i, 0, 1], corners[i, 0, 2]
    ux, uy, uz = corners[i, 1, 0] - ax, corners[i, 1, 1] - ay, corners[i, 1, 2] - az
    vx, vy, vz = corners[i, 2, 0] - ax, corners[i, 2, 1] - ay, corners[i, 2, 2] - az
    wx, wy, wz = px - ax, py - ay, pz - az
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    wu, wv = wx * ux + wy * uy + wz * uz, wx * vx + wy * vy + wz * vz
    area = uu * vv - uv * uv
    s, t = vv * wu - uv * wv, uu * wv - uv * wu
    # the foot of the perpendicular, where it falls inside and the triangle has an area to speak of
    if s >= 0.0 and t >= 0.0 and s + t <= area and area > 1e-14 * uu * vv:
        s, t = s / area, t / area
        x, y, z = ax + s * ux + t * vx, ay + s * uy + t * vy, az + s * uz + t * vz
        return (x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2, x, y, z
    best, x, y, z = _segment_nearest(px, py, pz, corners, i, 0, 1)
    d, qx, qy, qz = _segment_nearest(px, py, pz, corners, i, 1, 2)
    if d < best:
        best, x, y, z = d, qx, qy, qz
    d, qx, qy, qz = _segment_nearest(px, py, pz, corners, i, 2, 0)
    if d < best:
        best, x, y, z = d, qx, qy, qz
    return best, x, y, z


@njit(cache=True, nogil=True, error_model="numpy")
def _box_distance(boxes, node, px, py, pz):
    """Squared distance from a point to a node's box, 0 inside."""
    x = max(boxes[node, 0] - px, px - boxes[node, 3], 0.0)
    y = max(boxes[node, 1] - py, py - boxes[node, 4], 0.0)
    z = max(boxes[node, 2] - pz, pz - boxes[node, 5], 0.0)
    return x * x + y * y + z * z


class Closest(NamedTuple):
    """A surface point: squared distance to it [m²], its triangle, and where it is [m]."""

    squared: float
    triangle: int
    x: float
    y: float
    z: float


@njit(cache=True, nogil=True, error_model="numpy")
def closest_one(bvh, px, py, pz, max_squared, stack):
    """Closest surface point, from inside another kernel.

    Parameters
    ----------
    bvh : Bvh
    px, py, pz : float
        The point [m].
    max_squared : float
        Only what is nearer than its square root counts [m²].
    stack : np.ndarray [shape=(STACK,), dtype=int32]
        Scratch; allocate it once a task.

    Returns
    -------
    Closest
        (inf, -1, NaN, NaN, NaN) for none.
    """
    best, found, x, y, z = max_squared, -1, np.nan, np.nan, np.nan
    if bvh.boxes.shape[0] == 0 or not np.isfinite(px + py + pz):
        return Closest(np.inf, np.int64(-1), np.nan, np.nan, np.nan)
    boxes, child, count, corners = bvh.boxes, bvh.child, bvh.count, bvh.corners
    node, depth = 0, 0
    while True:
        if count[node] > 0:
            first = child[node]
            for i in range(first, first + count[node]):
                d, qx, qy, qz = _triangle_nearest(px, py, pz, corners, i)
                if d < best:
                    best, found, x, y, z = d, i, qx, qy, qz
        else:
            left = child[node]
            right = left + 1
            d0, d1 = _box_distance(boxes, left, px, py, pz), _box_distance(boxes, right, px, py, pz)
            if d1 < d0:
                left, right, d0, d1 = right, left, d1, d0
            if d1 < best:
                stack[depth] = right
                depth += 1
            if d0 < best:
                node = left
                continue
        # what waits may have been overtaken by a nearer triangle found since
        while depth > 0 and _box_distance(boxes, stack[depth - 1], px, py, pz) >= best:
            depth -= 1
        if depth == 0:
            break
        depth -= 1
        node = stack[depth]
    if found < 0:
        return Closest(np.inf, np.int64(-1), np.nan, np.nan, np.nan)
    return Closest(best, np.int64(bvh.order[found]), x, y, z)


@njit(cache=True, nogil=True, error_model="numpy")
def _closest_kernel(first, last, bvh, points, max_squared, distance, triangle, nearest):
    stack = np.empty(STACK, dtype=np.int32)
    for i in range(first, last):
        found = closest_one(bvh, points[i, 0], points[i, 1], points[i, 2], max_squared, stack)
        distance[i], triangle[i] = np.sqrt(found.squared), found.triangle
        nearest[i, 0], nearest[i, 1], nearest[i, 2] = found.x, found.y, found.z


def closest_point(
    bvh: Bvh, points: np.ndarray, max_distance: float = np.inf
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Closest surface point of each query point, on all cores.

    Parameters
    ----------
    bvh : Bvh
        From :func:`build_bvh`.
    points : np.ndarray [shape=(N, 3)]
        Queries [m]; a non-finite one finds nothing.
    max_distance : float
        Only surface nearer than this counts [m].

    Returns
    -------
    distance : np.ndarray [shape=(N,), dtype=float64]
        [m]; inf for none.
    triangle : np.ndarray [shape=(N,), dtype=int32]
        -1 for none.
    point : np.ndarray [shape=(N, 3), dtype=float64]
        [m]; NaN for none.

    Raises
    ------
    MirrorScanError
        When ``points`` is not (N, 3).
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise MirrorScanError(f"closest_point: points must be (N, 3), got {points.shape}")
    total = len(points)
    distance, triangle, nearest = np.empty(total), np.empty(total, dtype=np.int32), np.empty((total, 3))
    each_range(
        _closest_kernel, len(points), bvh, points, float(max_distance) ** 2, distance, triangle, nearest, least=_CHUNK
    )
    return distance, triangle, nearest
