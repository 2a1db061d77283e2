"""Which boundary runs face each other.

Mutual partners that follow one another, found without trying every pair of loops.
"""

from __future__ import annotations

import numpy as np

from ..numeric.kernels import njit
from ..numeric.point_products import dot
from ..numeric.threads import each, thread_count
from ..views.free_space import bridge_is_free
from ..views.view_maps import ViewMaps
from .boundary_frames import Boundary
from .dtw import MEMORY, warp
from .seam_strips import Candidates

_AT_ONCE = 256  # vertices whose partners one thread looks for before it takes others
_IN_TURN = 8  # candidates looked at on one side before those on the other
# What keeps two boundary vertices from being partners; cosines are wide, as the frames at a ragged boundary are rough.
_MOST_ALONG = 0.3  # cosine between their directions: boundaries that face each other run against each other, -1
_LEAST_FACING = -0.6  # cosine between their normals, of two views: around a limb's edge these differ much
_LEAST_FACING_IN_VIEW = 0.3  # of one view: across a slot in a surface, not from one side of a limb to the other
_LEAST_FACING_LOW = 0.2  # right above the floor: under a foot there is nothing to bridge
_LEAST_ONWARD = -0.35  # cosine between the bridge and the way on of either surface: not back over the surface itself
_LEAST_ONWARD_IN_VIEW = 0.1  # of one view: the shores of a slot face each other, those of an isthmus do not
_ANY_WAY = 0.01  # bridges shorter than this go any way: so near, the boundary's teeth decide on it [m]
_ROUND_TIP = 2.5  # times the bridge: on one loop the way between its ends along it, or it goes round a slot's tip
_SHORTEST_ROUND = 0.012  # the same, for ends so near that the boundary's teeth decide on it [m]
# How much longer a bridge counts for each of these directions that does not fit.
_PRICE_ALONG, _PRICE_FACING, _PRICE_ONWARD = 0.6, 0.5, 0.4
# Which partners go on in one run.
_MOST_BACK = 1.5  # gaps, and two edges: so near a vertex its partner's partner must be
_MOST_JUMP = 3.0  # times the way of the one boundary, and a gap: so far the partner may go meanwhile
_STEPS_BACK = 3  # vertices that the partner may go in the wrong direction, as it wavers at teeth
_MISSED = 4  # vertices without a partner that a run goes on over
_LONG_RUN = 200  # vertices; longer runs do not go before others by their length


def find_partners(
    boundary: Boundary, limit: np.ndarray, up: np.ndarray, view: np.ndarray, maps: ViewMaps, low: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """For each boundary vertex the one it would best be bridged to.

    A partner is near, its boundary runs the other way, both surfaces would go on towards each other and look to the
    same side, and no view has seen the space between them to be empty.

    Parameters
    ----------
    boundary : Boundary
        B vertices.
    limit : np.ndarray [shape=(B,)]
        Widest bridge allowed at each [m].
    up : np.ndarray [shape=(3,)]
        Direction along which the search is ordered.
    view : np.ndarray [shape=(B,)]
        The view each is from: within one view only gaps across a surface are bridged, not round a limb.
    maps : ViewMaps
    low : np.ndarray [shape=(B,), dtype=bool]
        Right above the floor: from one side of a foot to the other, that is under it, nothing is bridged.

    Returns
    -------
    partner : np.ndarray [shape=(B,), dtype=int64]
        -1 where there is none.
    price : np.ndarray [shape=(B,)]
        Distance weighed by how poorly the directions fit [m].

    Notes
    -----
    Searches outwards along ``up``: O(B · candidates within ``limit``) time, O(B) memory.
    """
    level = dot(boundary.point, up)
    order = np.argsort(level, kind="stable")  # neighbours in the search are neighbours in memory
    fields = [
        field[order]
        for field in (
            boundary.point,
            level,
            boundary.tangent,
            boundary.normal,
            boundary.outward,
            boundary.loop,
            boundary.arc,
            boundary.length[boundary.loop],
            limit,
            view.astype(np.int64),
            low,
        )
    ]
    at, price = np.full(len(order), -1, np.int64), np.full(len(order), np.inf)

    def search(first: int) -> None:
        last = min(first + _AT_ONCE, len(order))
        _partners_kernel(first, last, *fields, maps.free_space, at, price)  # type: ignore[call-arg]  # of a dispatcher

    each(search, range(0, len(order), _AT_ONCE))
    partner, weighed = np.full(len(order), -1, np.int64), np.empty(len(order))
    partner[order], weighed[order] = np.where(at >= 0, order[at], -1), price
    return partner, weighed


def warp_runs(boundary: Boundary, partner: np.ndarray, price: np.ndarray, edge: float, min_run: int) -> Candidates:
    """Runs of vertices whose partners are mutual and follow each other, warped, the best matched and longest first.

    Parameters
    ----------
    boundary : Boundary
    partner, price : np.ndarray [shape=(B,)]
        Of :func:`find_partners`.
    edge : float
        Usual distance of boundary vertices [m].
    min_run : int
        Shorter runs are left out [vertices].

    Notes
    -----
    DTW compares position, and direction and normal scaled to centimetres, so that all have similar weight; at either
    end vertices may stay unmatched, for what they would cost at the run's mean price.
    """
    rows = _runs_kernel(partner, boundary.loop, boundary.start, boundary.point, 2.0 * edge, min_run)
    at_a, at_b = np.empty(rows[:, 2].sum(), np.int64), np.empty(rows[:, 5].sum(), np.int64)
    begin, apart = np.zeros((2, len(rows) + 1), np.int64), np.empty(len(rows))
    kept = _chosen_kernel(rows, boundary.start, price, at_a, at_b, begin, apart)
    size_a, size_b = np.diff(begin[:, : kept + 1])
    room = np.empty((begin[:, kept].sum(), 2), np.int32)
    steps, mean = np.zeros(kept, np.int64), np.empty(kept)

    def warped(tasks: np.ndarray) -> None:
        _warp_kernel(
            tasks, at_a, at_b, begin, apart, boundary.point, boundary.tangent, boundary.normal, edge, room, steps, mean
        )

    falling, shares = np.argsort(-size_a * size_b), thread_count()
    each(warped, [np.ascontiguousarray(falling[k::shares]) for k in range(min(shares, kept))])
    first = begin[:, :kept]
    order = np.lexsort((at_a[first[0]], mean - 1e-4 * np.minimum(size_a, _LONG_RUN)))
    return Candidates(
        *_in_order(at_a, first[0], size_a, order),
        *_in_order(at_b, first[1], size_b, order),
        *_in_order(room, first.sum(axis=0), steps, order),
    )


def _in_order(
    flat: np.ndarray, begin: np.ndarray, length: np.ndarray, order: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Stretches ``flat[begin[k] : begin[k] + length[k]]`` brought into the given order."""
    length = length[order]
    moved = np.concatenate(([0], np.cumsum(length)))
    place = np.arange(moved[-1]) + np.repeat(begin[order] - moved[:-1], length)
    return flat[place], moved


@njit(cache=True, nogil=True, error_model="numpy")
def _chosen_kernel(rows, start, price, at_a, at_b, begin, apart):
    """Boundary vertices of the runs that are no two of one vertex, into ``at_a`` and ``at_b``; how many runs.

    Those of run k begin at ``begin[0, k]`` and ``begin[1, k]``; ``apart`` is how far they are from their partners, on
    average [m].
    """
    on_a = np.zeros(len(price), np.bool_)
    kept = n_a = n_b = 0
    for r in range(len(rows)):
        loop_a, first_a, size_a = rows[r, 0], rows[r, 1], rows[r, 2]
        loop_b, first_b, size_b = rows[r, 3], rows[r, 4], rows[r, 5]
        whole_a, whole_b = start[loop_a + 1] - start[loop_a], start[loop_b + 1] - start[loop_b]
        total, priced = 0.0, 0
        for k in range(size_a):
            i = start[loop_a] + (first_a + k) % whole_a
            at_a[n_a + k] = i
            on_a[i] = True
            if np.isfinite(price[i]):
                total += price[i]
                priced += 1
        shared = False
        for k in range(size_b):
            i = start[loop_b] + (first_b - k) % whole_b
            at_b[n_b + k] = i
            shared = shared or on_a[i]
        for k in range(size_a):
            on_a[at_a[n_a + k]] = False
        if size_b < 2 or shared:
            continue
        n_a, n_b = n_a + size_a, n_b + size_b
        apart[kept] = total / max(priced, 1)
        kept += 1
        begin[0, kept], begin[1, kept] = n_a, n_b
    return kept


@njit(cache=True, nogil=True, error_model="numpy")
def _warp_kernel(tasks, at_a, at_b, begin, apart, point, tangent, normal, edge, room, steps, mean):
    """The runs named by ``tasks`` warped: paths into ``room``, run r from ``begin[0, r] + begin[1, r]``; mean cost."""
    for task in range(len(tasks)):
        r = tasks[task]
        a, b = at_a[begin[0, r] : begin[0, r + 1]], at_b[begin[1, r] : begin[1, r + 1]]
        found, distance = warp(
            _described(a, 1.0, point, tangent, normal), _described(b, -1.0, point, tangent, normal),
            2.0 * edge + apart[r], MEMORY, False,
        )  # fmt: skip
        first = begin[0, r] + begin[1, r]
        for k in range(len(found)):
            room[first + k, 0], room[first + k, 1] = found[k, 0], found[k, 1]
        steps[r] = len(found)
        mean[r] = distance / len(found)


@njit(cache=True, nogil=True, error_model="numpy")
def _described(chosen, sense, point, tangent, normal):
    """What warping compares of the ``chosen`` boundary vertices (9, N): place, direction walked in, and normal."""
    out = np.empty((9, len(chosen)))
    for c in range(3):
        for k in range(len(chosen)):
            i = chosen[k]
            out[c, k], out[3 + c, k], out[6 + c, k] = point[i, c], sense * 0.01 * tangent[i, c], 0.01 * normal[i, c]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _product(vectors, i, j):
    return vectors[i, 0] * vectors[j, 0] + vectors[i, 1] * vectors[j, 1] + vectors[i, 2] * vectors[j, 2]


@njit(cache=True, nogil=True, error_model="numpy")
def _partners_kernel(
    begin,
    end,
    point,
    level,
    tangent,
    normal,
    outward,
    loop,
    arc,
    whole,
    limit,
    view,
    low,
    free_space,
    partner,
    price,
):
    """For each boundary vertex, in the order of ``level``, the one to bridge it to (-1 none) and at what cost [m].

    Those from ``begin`` to ``end``, into ``partner`` and ``price``.
    """
    count = len(point)
    for i in range(begin, end):
        best = np.inf
        which = -1
        # outwards along the sorting axis, so many on either side in turn, until nothing nearer can come
        more_below = more_above = True
        first = 1
        while more_below or more_above:
            for side in (-1, 1):
                if not (more_below if side < 0 else more_above):
                    continue
                for step in range(first, first + _IN_TURN):
                    j = i + side * step
                    if j < 0 or j >= count or abs(level[j] - level[i]) > min(limit[i], best):
                        more_below, more_above = more_below and side > 0, more_above and side < 0
                        break
                    dx, dy, dz = point[j, 0] - point[i, 0], point[j, 1] - point[i, 1], point[j, 2] - point[i, 2]
                    d2 = dx * dx + dy * dy + dz * dz
                    if d2 >= best * best or d2 > min(limit[i], limit[j]) ** 2:
                        continue
                    d = np.sqrt(d2)
                    along = _product(tangent, i, j)
                    if along > _MOST_ALONG:
                        continue
                    facing = _product(normal, i, j)
                    if facing < (_LEAST_FACING_IN_VIEW if view[i] == view[j] else _LEAST_FACING):
                        continue
                    if facing < _LEAST_FACING_LOW and (low[i] or low[j]):
                        continue
                    if loop[i] == loop[j]:  # across a slot, not round its tip
                        run = abs(arc[i] - arc[j])
                        run = min(run, whole[i] - run)
                        if run < _ROUND_TIP * d or run < _SHORTEST_ROUND:
                            continue
                    out_i = (outward[i, 0] * dx + outward[i, 1] * dy + outward[i, 2] * dz) / (d + 1e-9)
                    out_j = -(outward[j, 0] * dx + outward[j, 1] * dy + outward[j, 2] * dz) / (d + 1e-9)
                    least = _LEAST_ONWARD_IN_VIEW if view[i] == view[j] else _LEAST_ONWARD
                    if min(out_i, out_j) < least and d > _ANY_WAY:
                        continue
                    weight = 1.0 + _PRICE_ALONG * (1.0 + along) + _PRICE_FACING * (1.0 - facing)
                    cost = d * (weight + _PRICE_ONWARD * (2.0 - out_i - out_j))
                    if cost >= best:
                        continue
                    if bridge_is_free(point, i, point, j, free_space):
                        continue
                    best = cost
                    which = j
            first += _IN_TURN
        partner[i] = which
        price[i] = best


@njit(cache=True, nogil=True, error_model="numpy")
def _distance(point, i, j):
    dx, dy, dz = point[i, 0] - point[j, 0], point[i, 1] - point[j, 1], point[i, 2] - point[j, 2]
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@njit(cache=True, nogil=True, error_model="numpy")
def _runs_kernel(partner, loop, start, point, tolerance, min_run):
    """Runs of boundary vertices whose partners are mutual and follow each other backwards on one loop.

    Rows: loop A, first place on A, number of vertices; loop B, place of the first partner, number of vertices
    backwards.
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
        gap, back = _distance(point, i, j), _distance(point, i, k)
        good[i] = back <= _MOST_BACK * gap + tolerance
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
                    jump = _distance(point, partner[i2], start[b] + place)
                    moved = _distance(point, i2, base + (first + last_good) % n)
                    gap = _distance(point, partner[i2], i2)
                    ok = step >= -_STEPS_BACK and jump <= _MOST_JUMP * moved + gap + tolerance and span + step < nb
                    if ok and step > 0:
                        place = (place - step) % nb
                        span += step
                if ok:
                    last_good = k
                    missed = 0
                else:
                    missed += 1
                    if missed > _MISSED:
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
