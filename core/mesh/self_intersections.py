"""Which triangles of a mesh run through others, on a tree of their boxes."""

from __future__ import annotations

import numpy as np

from ..numeric.kernels import njit
from ..numeric.threads import each_range
from .bvh import STACK, build_bvh
from .half_edges import boundary_vertices


@njit(cache=True, nogil=True, error_model="numpy")
def _height(corners, normals, i, j, k):
    """Distance of corner k of triangle j from the plane of triangle i, times the length of i's normal.

    What rounding alone may make of a corner in the plane counts as none: flat neighbours would else seem to cross.
    """
    x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
    dx = corners[j, k, 0] - corners[i, 0, 0]
    dy = corners[j, k, 1] - corners[i, 0, 1]
    dz = corners[j, k, 2] - corners[i, 0, 2]
    height = x * dx + y * dy + z * dz
    if height * height <= 1e-24 * (x * x + y * y + z * z) * (dx * dx + dy * dy + dz * dz):
        return 0.0
    return height


@njit(cache=True, nogil=True, error_model="numpy")
def _apart(corners, normals, i, j):
    """Whether triangle j lies wholly on one side of the plane of triangle i."""
    u, v = _height(corners, normals, i, j, 0), _height(corners, normals, i, j, 1)
    if not ((u > 0.0 and v > 0.0) or (u < 0.0 and v < 0.0)):
        return False
    w = _height(corners, normals, i, j, 2)
    return (u > 0.0 and w > 0.0) or (u < 0.0 and w < 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _pierces(corners, i, k, m, j, strict):
    """Whether the edge from corner k to m of triangle i, known to reach across the plane of j, goes through j.

    By the signs of the volumes the edge spans with each edge of j; ``strict`` leaves out the border of j.
    """
    px, py, pz = corners[i, k, 0], corners[i, k, 1], corners[i, k, 2]
    dx, dy, dz = corners[i, m, 0] - px, corners[i, m, 1] - py, corners[i, m, 2] - pz
    ux, uy, uz = corners[j, 2, 0] - px, corners[j, 2, 1] - py, corners[j, 2, 2] - pz
    positive, negative = 0, 0
    for n in range(3):
        vx, vy, vz = corners[j, n, 0] - px, corners[j, n, 1] - py, corners[j, n, 2] - pz
        spanned = dx * (uy * vz - uz * vy) + dy * (uz * vx - ux * vz) + dz * (ux * vy - uy * vx)
        if spanned > 0.0:
            positive += 1
        elif spanned < 0.0:
            negative += 1
        ux, uy, uz = vx, vy, vz
    if strict:
        return positive == 3 or negative == 3
    return positive == 0 or negative == 0


@njit(cache=True, nogil=True, error_model="numpy")
def _turn(corners, i, k, m, j, n, x, y):
    """Twice the area of corners k, m of triangle i and corner n of triangle j, seen in the axes x and y."""
    ax, ay = corners[i, k, x], corners[i, k, y]
    return (corners[i, m, x] - ax) * (corners[j, n, y] - ay) - (corners[i, m, y] - ay) * (corners[j, n, x] - ax)


@njit(cache=True, nogil=True, error_model="numpy")
def _flat_overlap(corners, normals, i, j):
    """Whether two triangles of one plane overlap or touch: no edge of either has the other wholly outside it."""
    n0, n1, n2 = abs(normals[i, 0]), abs(normals[i, 1]), abs(normals[i, 2])
    x, y = 0, 1
    if n0 >= n1 and n0 >= n2:
        x, y = 1, 2
    elif n1 >= n2:
        x, y = 2, 0
    for edge in range(6):
        a, b = (i, j) if edge < 3 else (j, i)
        k = edge % 3
        inside = _turn(corners, a, k, (k + 1) % 3, a, (k + 2) % 3, x, y)
        separates = True
        for n in range(3):
            side = _turn(corners, a, k, (k + 1) % 3, b, n, x, y)
            separates = separates and (side < 0.0 if inside > 0.0 else side > 0.0)
        if separates:
            return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _triangles_meet(corners, normals, i, j):
    """Whether two triangles without a common vertex overlap or touch.

    Signs of float64 determinants, zero within rounding. A triangle without area counts only where it pierces the other.
    """
    if _apart(corners, normals, i, j) or _apart(corners, normals, j, i):
        return False
    i_has_area = normals[i, 0] != 0.0 or normals[i, 1] != 0.0 or normals[i, 2] != 0.0
    j_has_area = normals[j, 0] != 0.0 or normals[j, 1] != 0.0 or normals[j, 2] != 0.0
    if i_has_area and j_has_area:
        h0, h1 = _height(corners, normals, i, j, 0), _height(corners, normals, i, j, 1)
        if h0 == 0.0 and h1 == 0.0 and _height(corners, normals, i, j, 2) == 0.0:
            return _flat_overlap(corners, normals, i, j)
    # They meet exactly if an edge of one that reaches across the other's plane goes through the other. An edge
    # within that plane needs no test of its own: its ends belong to edges that are tested, and where it crosses
    # the border, the border's edge is the one that pierces.
    for edge in range(6):
        a, b = (i, j) if edge < 3 else (j, i)
        if not (i_has_area if edge < 3 else j_has_area):
            continue
        k, m = edge % 3, (edge + 1) % 3
        u, v = _height(corners, normals, a, b, k), _height(corners, normals, a, b, m)
        if u * v <= 0.0 and (u != 0.0 or v != 0.0) and _pierces(corners, b, k, m, a, False):
            return True
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def _fan_meets(corners, normals, i, i_at, j, j_at):
    """Whether triangles with a common vertex, corner i_at of one and j_at of the other, meet in more than it.

    They then share a piece of the line their planes meet in, which runs from the vertex to the opposite edge of
    the one or the other; so that edge goes through the inside of the other triangle.
    """
    j0, j1, i0, i1 = (j_at + 1) % 3, (j_at + 2) % 3, (i_at + 1) % 3, (i_at + 2) % 3
    if _height(corners, normals, i, j, j0) * _height(corners, normals, i, j, j1) >= 0.0:
        return False
    if _height(corners, normals, j, i, i0) * _height(corners, normals, j, i, i1) >= 0.0:
        return False
    return _pierces(corners, j, j0, j1, i, True) or _pierces(corners, i, i0, i1, j, True)


@njit(cache=True, nogil=True, error_model="numpy")
def _folded(corners, normals, i, i_at, j, j_at):
    """Whether triangles with a common edge, opposite corners i_at and j_at, lie flat on the same side of it."""
    if _height(corners, normals, i, j, j_at) != 0.0:
        return False
    k, m = (i_at + 1) % 3, (i_at + 2) % 3
    # by projections onto the normal of i: the free corners turn the same way about the edge
    px, py, pz = corners[i, k, 0], corners[i, k, 1], corners[i, k, 2]
    ux, uy, uz = corners[i, m, 0] - px, corners[i, m, 1] - py, corners[i, m, 2] - pz
    vx, vy, vz = corners[j, j_at, 0] - px, corners[j, j_at, 1] - py, corners[j, j_at, 2] - pz
    return (
        normals[i, 0] * (uy * vz - uz * vy) + normals[i, 1] * (uz * vx - ux * vz) + normals[i, 2] * (ux * vy - uy * vx)
    ) > 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _pair_meets(corners, normals, index, spread, i, j):
    """Whether two triangles of a mesh meet anywhere but in what they share by index.

    ``normals`` (T, 3) are as long as twice the area; ``index`` (T, 3) names the vertices of ``corners`` (T, 3, 3);
    triangles around a vertex of :func:`_spread_out` ``spread`` (V,) do not meet.
    """
    # counted without branches: which corners agree is as good as random
    a0, a1, a2, b0, b1, b2 = index[i, 0], index[i, 1], index[i, 2], index[j, 0], index[j, 1], index[j, 2]
    i0 = np.int64(a0 == b0) + np.int64(a0 == b1) + np.int64(a0 == b2)
    i1 = np.int64(a1 == b0) + np.int64(a1 == b1) + np.int64(a1 == b2)
    i2 = np.int64(a2 == b0) + np.int64(a2 == b1) + np.int64(a2 == b2)
    j1 = np.int64(b1 == a0) + np.int64(b1 == a1) + np.int64(b1 == a2)
    j2 = np.int64(b2 == a0) + np.int64(b2 == a1) + np.int64(b2 == a2)
    common = i0 + i1 + i2
    i_at, j_at = i1 + 2 * i2, j1 + 2 * j2  # sums of the numbers of the corners that agree
    if common == 0:
        return _triangles_meet(corners, normals, i, j)
    if common == 1:
        return not spread[index[i, i_at]] and _fan_meets(corners, normals, i, i_at, j, j_at)
    if common == 2:
        i_free, j_free = 3 - i_at, 3 - j_at
        if not (0 <= i_free <= 2 and 0 <= j_free <= 2) or spread[index[i, (i_free + 1) % 3]]:
            return False
        return _folded(corners, normals, i, i_free, j, j_free)
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _by_place(bvh, triangles):
    """Per place in the order: box (T, 6) float32, normal (T, 3), vertices (T, 3)."""
    corners, order = bvh.corners, bvh.order
    total = order.shape[0]
    box, normals = np.empty((total, 6), dtype=np.float32), np.empty((total, 3))
    index = np.empty((total, 3), dtype=np.int32)
    for i in range(total):
        for k in range(3):
            index[i, k] = triangles[order[i], k]
            a, b, c = corners[i, 0, k], corners[i, 1, k], corners[i, 2, k]
            box[i, k], box[i, k + 3] = min(a, b, c), max(a, b, c)
        px, py, pz = corners[i, 0, 0], corners[i, 0, 1], corners[i, 0, 2]
        ux, uy, uz = corners[i, 1, 0] - px, corners[i, 1, 1] - py, corners[i, 1, 2] - pz
        vx, vy, vz = corners[i, 2, 0] - px, corners[i, 2, 1] - py, corners[i, 2, 2] - pz
        normals[i, 0], normals[i, 1], normals[i, 2] = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return box, normals, index


@njit(cache=True, nogil=True, error_model="numpy")
def _spread_out(corners, normals, index, inner):
    """Around which of the ``inner`` vertices (V,) bool the triangles lie side by side, seen along their mean normal.

    All face that way and together they go round once. So no two of them meet but in what they share.
    """
    count = len(inner)
    mean = np.zeros((count, 3))
    for t in range(len(index)):
        for k in range(3):
            v = index[t, k]
            for c in range(3):
                mean[v, c] += normals[t, c]
    turns = np.zeros(count, np.int8)
    for t in range(len(index)):
        long2 = normals[t, 0] ** 2 + normals[t, 1] ** 2 + normals[t, 2] ** 2
        for k in range(3):
            v = index[t, k]
            x, y, z = mean[v, 0], mean[v, 1], mean[v, 2]
            facing = normals[t, 0] * x + normals[t, 1] * y + normals[t, 2] * z
            if not (facing > 0.0 and facing * facing > 1e-12 * long2 * (x * x + y * y + z * z)):
                turns[v] = 100  # more than its triangles make up for
                continue
            # a direction across the normal, away from the axis that the normal is farthest from
            if abs(x) <= abs(y) and abs(x) <= abs(z):
                x, y, z = 0.0, z, -y
            elif abs(y) <= abs(z):
                x, y, z = -z, 0.0, x
            else:
                x, y, z = y, -x, 0.0
            here = x * corners[t, k, 0] + y * corners[t, k, 1] + z * corners[t, k, 2]
            n, m = (k + 1) % 3, (k + 2) % 3
            begin = x * corners[t, n, 0] + y * corners[t, n, 1] + z * corners[t, n, 2] - here
            end = x * corners[t, m, 0] + y * corners[t, m, 1] + z * corners[t, m, 2] - here
            if begin < 0.0 and end >= 0.0 and turns[v] < 2:
                turns[v] += 1
    return (turns == 1) & inner


@njit(cache=True, nogil=True, error_model="numpy")
def _boxes_meet(boxes, i, j):
    return (  # & rather than and: one branch instead of six
        (boxes[i, 0] <= boxes[j, 3])
        & (boxes[j, 0] <= boxes[i, 3])
        & (boxes[i, 1] <= boxes[j, 4])
        & (boxes[j, 1] <= boxes[i, 4])
        & (boxes[i, 2] <= boxes[j, 5])
        & (boxes[j, 2] <= boxes[i, 5])
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _halves(boxes, child, count, a, b, stack, depth):
    """Push those pairs of nodes whose boxes meet that the pair (a, b), not two leaves, falls into.

    Returns the stack's new depth.
    """
    if a == b:
        left, right = child[a], child[a] + 1
        stack[depth, 0], stack[depth, 1] = right, right
        stack[depth + 1, 0], stack[depth + 1, 1] = left, left
        depth += 2
        if _boxes_meet(boxes, left, right):
            stack[depth, 0], stack[depth, 1] = left, right
            depth += 1
        return depth
    if count[a] > 0 or (count[b] == 0 and b < a):  # of two inner nodes the one nearer to the root is opened
        a, b = b, a
    for half in range(child[a], child[a] + 2):
        if _boxes_meet(boxes, half, b):
            stack[depth, 0], stack[depth, 1] = half, b
            depth += 1
    return depth


@njit(cache=True, nogil=True, error_model="numpy")
def _node_pairs(boxes, child, count, wanted):
    """About ``wanted`` pairs of nodes (K, 2) that together hold all pairs of triangles whose boxes meet."""
    if len(count) == 0:
        return np.empty((0, 2), np.int32)
    now, after = np.zeros((1, 2), np.int32), np.empty((3, 2), np.int32)
    while True:
        n, opened = 0, False
        for k in range(len(now)):
            a, b = now[k, 0], now[k, 1]
            if count[a] > 0 and count[b] > 0:
                after[n, 0], after[n, 1] = a, b
                n += 1
            else:
                n = _halves(boxes, child, count, a, b, after, n)
                opened = True
        now = after[:n].copy()
        if not opened or n >= wanted:
            return now
        after = np.empty((3 * n, 2), np.int32)


@njit(cache=True, nogil=True, error_model="numpy")
def _pairs_below(bvh, boxes, box, normals, index, spread, a, b, pairs):
    """Pairs of triangles, one below node a and one below b, that meet, by descending both at once.

    Writes as many as fit into ``pairs`` (room, 2); returns how many there are.
    """
    child, count, corners, order = bvh.child, bvh.count, bvh.corners, bvh.order
    stack = np.empty((4 * STACK, 2), dtype=np.int32)
    stack[0, 0], stack[0, 1] = a, b
    depth = 1
    held = 0
    while depth > 0:
        depth -= 1
        a, b = stack[depth, 0], stack[depth, 1]
        if count[a] == 0 or count[b] == 0:
            depth = _halves(boxes, child, count, a, b, stack, depth)
            continue
        for i in range(child[a], child[a] + count[a]):
            for j in range(i + 1 if a == b else child[b], child[b] + count[b]):
                if _boxes_meet(box, i, j) and _pair_meets(corners, normals, index, spread, i, j):
                    if held < pairs.shape[0]:
                        pairs[held, 0], pairs[held, 1] = min(order[i], order[j]), max(order[i], order[j])
                    held += 1
    return held


@njit(cache=True, nogil=True, error_model="numpy")
def _self_intersection_kernel(begin, end, bvh, boxes, box, normals, index, spread, nodes, pairs, found):
    """For some of the pairs of ``nodes`` (K, 2): ``pairs`` (K, room, 2), ``found`` (K,)."""
    for task in range(begin, end):
        a, b = nodes[task, 0], nodes[task, 1]
        found[task] = _pairs_below(bvh, boxes, box, normals, index, spread, a, b, pairs[task])


def self_intersections(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Pairs of triangles that run through each other.

    Two triangles without a common vertex intersect where they overlap or touch, in one plane or not; with one
    common vertex, where the edge opposite to it goes through the other triangle; with a common edge, where one is
    folded exactly onto the other. This is the reading of MeshLab's filter, whose faces it agrees with, plus the folds.

    Time O(T log T + K) for meshes whose triangles have few neighbours, on all cores.

    Parameters
    ----------
    vertices : np.ndarray [shape=(V, 3)]
        Positions [m].
    triangles : np.ndarray [shape=(T, 3)]
        Vertex indices.

    Returns
    -------
    np.ndarray [shape=(K, 2), dtype=int32]
        Triangle indices, the lesser first, in lexical order.

    Raises
    ------
    MirrorScanError
        When an index is out of range, or a used vertex is not finite.
    """
    triangles = np.ascontiguousarray(triangles, dtype=np.int32).reshape(-1, 3)
    bvh = build_bvh(np.ascontiguousarray(vertices, dtype=np.float64), triangles, True)
    # Rounding keeps order: boxes that meet still do in float32, and those of a whole figure fit the processor's cache.
    boxes, (box, normals, index) = bvh.boxes.astype(np.float32), _by_place(bvh, triangles)
    spread = _spread_out(bvh.corners, normals, index, ~boundary_vertices(triangles, len(vertices)))
    nodes = _node_pairs(boxes, bvh.child, bvh.count, min(128, len(triangles) // 64))
    if not len(nodes):
        return np.empty((0, 2), dtype=np.int32)
    room = 64
    while True:
        pairs, found = np.empty((len(nodes), room, 2), dtype=np.int32), np.empty(len(nodes), dtype=np.int64)
        each_range(_self_intersection_kernel, len(nodes), bvh, boxes, box, normals, index, spread, nodes, pairs, found)
        if found.max() <= room:
            break
        room = int(found.max())
    result = np.concatenate([task[:k] for task, k in zip(pairs, found, strict=True)])
    return result[np.lexsort((result[:, 1], result[:, 0]))]
