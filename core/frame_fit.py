"""The plane of a mirror's frame from its pixels: robust, in inverse depth, sure only of what its noise allows.

A frame is a thin band of some thousand noisy pixels; beside it stand walls, floors, the person, and the frames of other
mirrors that touch or cross it. Neighbouring pixels share errors (edges, quantisation, smoothing inside the camera), so
they are pooled to blocks: a block's mean is so much surer than a pixel that what belongs to another surface stands out,
and the scatter of the blocks says how sure the plane is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

BLOCK = 10
"""Side of a block [px]."""

_EDGE = 0.25  # share of the edges' effect, squared, in the covariance
_BAR = 0.03  # of a pixel's noise, that a bar of the frame errs in common


@dataclass(frozen=True)
class DisparityPlane:
    """1/z = a·u + b·v + c.

    Parameters
    ----------
    coefficients : np.ndarray [shape=(3,)]
    covariance : np.ndarray [shape=(3, 3)]
        Of the coefficients.
    weights : np.ndarray [shape=(K,)]
        Of the pixels, 0 to 1.
    scale : float
        Standard deviation of a pixel's 1/z about the plane [1/m].
    common : float
        Variance of the part of it that neighbouring pixels share [1/m²].
    """

    coefficients: np.ndarray
    covariance: np.ndarray
    weights: np.ndarray
    scale: float
    common: float


def disparity_plane(
    u: np.ndarray, v: np.ndarray, z: np.ndarray, start: np.ndarray | None = None
) -> DisparityPlane | None:
    """Robust plane 1/z = a·u + b·v + c; None when all pixels are (nearly) on a line.

    A depth camera's error is even in 1/z, and a plane is linear there. Pixels are re-weighted (Tukey), then pooled to
    blocks of :data:`BLOCK` pixels, whose means are re-weighted in turn. A block's variance is that of its pixels'
    mean plus a share that all its pixels have in common, which is estimated from the blocks (a random effect;
    DerSimonian and Laird 1986); the covariance is that of clustered data (Liang and Zeger 1986).

    Parameters
    ----------
    u, v, z : np.ndarray [shape=(K,)]
        Pixels and readings [m].
    start : np.ndarray [shape=(3,)], optional
        Coefficients to weigh the pixels by at first; by default all weigh the same.
    """
    u, v = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
    found, solution, normal, scores, weights, center, scale, noise, common = _fit_kernel(
        u, v, 1.0 / z.astype(np.float64), np.zeros(3) if start is None else start, start is not None, BLOCK
    )
    if not found:
        return None
    bread = np.linalg.inv(normal)
    covariance = bread @ scores @ bread
    unscale = np.diag(1.0 / scale)
    unscale[2, :2] = -center[:2] / scale[:2]
    return DisparityPlane(unscale @ solution, unscale @ covariance @ unscale.T, weights, noise, common)


@njit(cache=True, nogil=True)
def _fit_kernel(u, v, d, start, started, block):
    """Found, solution (3,) over ((u, v) - centre) / scale and 1, the matrix (3, 3) of its equations and that of its
    scores, weights (K,), centre, scale (3,) and a pixel's standard deviation."""
    count = len(d)
    center, scale = np.zeros(3), np.ones(3)
    center[0], center[1] = u.mean(), v.mean()
    scale[0], scale[1] = max(np.abs(u - center[0]).max(), 1.0), max(np.abs(v - center[1]).max(), 1.0)
    weights, residual, row = np.ones(count), np.empty(count), np.ones(3)
    solution, normal, right, nothing = np.zeros(3), np.zeros((3, 3)), np.zeros(3), np.zeros((3, 3))
    sigma = 0.0
    for turn in range(12):
        previous = solution.copy()
        if turn == 0 and started:
            solution[0], solution[1] = start[0] * scale[0], start[1] * scale[1]
            solution[2] = start[0] * center[0] + start[1] * center[1] + start[2]
        else:
            normal[:] = 0.0
            right[:] = 0.0
            for i in range(count):
                row[0], row[1] = (u[i] - center[0]) / scale[0], (v[i] - center[1]) / scale[1]
                for a in range(3):
                    right[a] += weights[i] * row[a] * d[i]
                    for b in range(3):
                        normal[a, b] += weights[i] * row[a] * row[b]
            found, solution = _solve_3x3(normal, right)
            if not found:  # all on one line
                return False, previous, nothing, nothing, weights, center, scale, sigma, 0.0
        for i in range(count):
            x, y = (u[i] - center[0]) / scale[0], (v[i] - center[1]) / scale[1]
            residual[i] = d[i] - (solution[0] * x + solution[1] * y + solution[2])
        sigma = 1.4826 * np.median(np.abs(residual[:: count // 2000 + 1])) + 1e-9
        for i in range(count):
            r = residual[i] / (4.7 * sigma)
            weights[i] = (1.0 - r * r) ** 2 if abs(r) < 1.0 else 0.0
        if turn > 0 and np.abs(solution - previous).max() < 1e-5 * np.abs(solution).max():
            break

    # blocks of neighbouring pixels, each at the mean of what weighs in it
    left, top = u.min(), v.min()
    columns = int((u.max() - left) // block) + 1
    rows = int((v.max() - top) // block) + 1
    sums, member = np.zeros((rows * columns, 4)), np.empty(count, np.int32)
    for i in range(count):
        member[i] = int((v[i] - top) // block) * columns + int((u[i] - left) // block)
        cell = sums[member[i]]
        cell[0] += weights[i]
        cell[1] += weights[i] * (u[i] - center[0]) / scale[0]
        cell[2] += weights[i] * (v[i] - center[1]) / scale[1]
        cell[3] += weights[i] * residual[i]
    used = np.flatnonzero(sums[:, 0] > 3.0)
    n = len(used)
    if n < 6:
        return _few(solution, normal, weights, center, scale, sigma, nothing)
    pooled = np.empty((n, 4))  # x, y, residual, weight of its pixels
    for k in range(n):
        cell = sums[used[k]]
        pooled[k, 0], pooled[k, 1], pooled[k, 2] = cell[1] / cell[0], cell[2] / cell[0], cell[3] / cell[0]
        pooled[k, 3] = cell[0]
    trust, gap, deviation = np.ones(n), np.empty(n), np.empty(n)
    change, common = np.zeros(3), 0.0
    for _ in range(8):
        for k in range(n):
            gap[k] = pooled[k, 2] - (change[0] * pooled[k, 0] + change[1] * pooled[k, 1] + change[2])
        # what the pixels of a block err in common: what their scatter does not explain of the blocks'
        common = 2.198 * np.median(gap * gap - 0.4549 * sigma * sigma / pooled[:, 3])
        common = max(common, 0.0)
        deviation[:] = np.sqrt(sigma * sigma / pooled[:, 3] + common) + 1e-9
        normal[:] = 0.0
        right[:] = 0.0
        for k in range(n):
            r = gap[k] / (4.7 * deviation[k])
            trust[k] = (1.0 - r * r) ** 2 if abs(r) < 1.0 else 0.0
            w = trust[k] / (deviation[k] * deviation[k])
            row[0], row[1] = pooled[k, 0], pooled[k, 1]
            for a in range(3):
                right[a] += w * row[a] * pooled[k, 2]
                for b in range(3):
                    normal[a, b] += w * row[a] * row[b]
        found, step = _solve_3x3(normal, right)
        if not found:
            return False, solution, nothing, nothing, weights, center, scale, sigma, 0.0
        moved = np.abs(step - change).max()
        change = step
        if moved < 1e-6 * np.abs(solution).max():
            break
    scores, kept, bars = np.zeros((3, 3)), 0.0, np.zeros((4, 3))
    for k in range(n):
        row[0], row[1] = pooled[k, 0], pooled[k, 1]
        gap[k] = pooled[k, 2] - (change[0] * row[0] + change[1] * row[1] + change[2])
        w = trust[k] / (deviation[k] * deviation[k])
        bar = int((np.arctan2(row[1], row[0]) / (2.0 * np.pi) + 0.625) * 4.0) % 4
        for a in range(3):
            bars[bar, a] += w * row[a]
        w *= gap[k]
        kept += trust[k]
        for a in range(3):
            for b in range(3):
                scores[a, b] += w * w * row[a] * row[b]
    scores *= kept / max(kept - 3.0, 1.0)
    # what a whole bar of the frame errs in common shows in no residual: a share of a pixel's noise
    for bar in range(4):
        for a in range(3):
            for b in range(3):
                scores[a, b] += (_BAR * sigma) ** 2 * bars[bar, a] * bars[bar, b]
    place = np.full(rows * columns, -1, np.int32)
    for k in range(n):
        place[used[k]] = k
    for i in range(count):
        k = place[member[i]]
        weights[i] *= trust[k] if k >= 0 else 0.0
    row[2] = 1.0
    return True, solution + change, normal, scores, weights, center, scale, sigma, common


@njit(cache=True, nogil=True)
def _few(solution, normal, weights, center, scale, sigma, nothing):
    """The fit when there are too few blocks to pool: its pixels taken as independent, four as one."""
    if not weights.sum() > 3.0 or sigma == 0.0:
        return False, solution, nothing, nothing, weights, center, scale, sigma, 0.0
    return True, solution, normal, 4.0 * sigma * sigma * normal, weights, center, scale, sigma, 0.0


@njit(cache=True, nogil=True)
def _solve_3x3(matrix, right):
    """Cramer's rule, and whether the determinant is far enough from 0; numba's own solver needs scipy, which Blender
    has not."""
    a, b, c = matrix[0], matrix[1], matrix[2]
    minors = np.empty((3, 3))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        minors[0, k] = b[i] * c[j] - b[j] * c[i]
        minors[1, k] = c[i] * a[j] - c[j] * a[i]
        minors[2, k] = a[i] * b[j] - a[j] * b[i]
    determinant = a[0] * minors[0, 0] + a[1] * minors[0, 1] + a[2] * minors[0, 2]
    trace = a[0] + b[1] + c[2]
    solution = np.zeros(3)
    if determinant < 1e-10 * trace * trace * trace:
        return False, solution
    for k in range(3):
        for row in range(3):
            solution[k] += minors[row, k] * right[row] / determinant
    return True, solution


def grow_frame(
    depth: np.ndarray, seeds: np.ndarray, plane: np.ndarray, focal: float, band: float = 0.02
) -> tuple[np.ndarray, np.ndarray, DisparityPlane] | None:
    """The frame's pixels around picked ones, and the plane through them.

    First the picks' own neighbourhoods, then what is connected to them between the picks, then beyond: as far as the
    blocks of it agree with the plane so far, within what their noise and the plane's uncertainty there allow. So the
    frame of another mirror, which meets this one at an angle, is left a few centimetres behind the crease, and a floor,
    which cuts through the plane, is left out.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    seeds : np.ndarray [shape=(K, 2), dtype=int]
        Pixels (u, v) with a reading.
    plane : np.ndarray [shape=(3,)]
        First guess, 1/z = a·u + b·v + c.
    focal : float
        [px]
    band : float
        No pixel farther from the plane than this is the frame's, relative to z.

    Returns
    -------
    u, v : np.ndarray [shape=(K,), dtype=int]
        The pixels; not all weigh.
    fitted : DisparityPlane
        Of all of them.
    None when there are fewer than 30 pixels or all are on a line.

    Notes
    -----
    O(pixels of the box about the frame).
    """
    height, width = depth.shape
    seeds = np.asarray(seeds, dtype=np.int64)
    u, v = _near_seeds(depth, seeds, plane, band)
    fitted = disparity_plane(u, v, depth[v, u]) if len(u) >= 12 else None
    if fitted is None:
        return None
    z = float(np.median(depth[seeds[:, 1], seeds[:, 0]]))
    low, high = seeds.min(axis=0), seeds.max(axis=0)
    for reach in (0.08, 0.4, np.inf):
        apart = min(reach * focal / z + 4.0, width + height)
        box = np.clip(np.concatenate((low - apart, high + apart + 1)), 0, (width, height, width, height))
        box = box.astype(np.int64)
        for _ in range(4):
            more_u, more_v = _gather_kernel(
                depth, seeds, fitted.coefficients, fitted.covariance, fitted.scale, fitted.common, band, box
            )
            again = None
            if len(more_u) >= 12:
                again = disparity_plane(more_u, more_v, depth[more_v, more_u], fitted.coefficients)
            if again is None:
                break
            moved = np.abs(again.coefficients - fitted.coefficients) @ (width, height, 1.0) * z
            u, v, fitted = more_u, more_v, again
            if moved < 5e-4:
                break
        # nothing reaches the box's sides but where the image ends there
        open_sides = (u.min() < box[0] + 3 > 3, v.min() < box[1] + 3 > 3,
                      u.max() > box[2] - 4 < width - 4, v.max() > box[3] - 4 < height - 4)  # fmt: skip
        if not any(open_sides):
            break
    return (u, v, fitted) if len(u) >= 30 else None


def fit_core(u: np.ndarray, v: np.ndarray, depth: np.ndarray, fitted: DisparityPlane) -> DisparityPlane:
    """The plane through a frame's pixels without its edges, which cameras smear.

    What leaving one more ring of pixels out, or one fewer, does to the plane tells what edges do to it, and goes into
    its covariance.
    """
    left, top = u.min(), v.min()
    mask = np.zeros((v.max() - top + 1, u.max() - left + 1), np.bool_)
    mask[v - top, u - left] = True
    ring = erosion(mask)
    count = np.cumsum(np.bincount(ring.ravel(), minlength=4)[::-1])[::-1]  # pixels with at least so many rings
    edge = 2 if count[3] > max(0.25 * count[1], 200) else 1 if count[2] > max(0.25 * count[1], 200) else 0

    def fit(level: int) -> DisparityPlane | None:
        rows, columns = np.nonzero(ring > level)
        rows, columns = rows + top, columns + left
        return disparity_plane(columns, rows, depth[rows, columns], fitted.coefficients)

    core = fit(edge) if edge else fitted
    if core is None:
        return fitted
    beside = (fitted if edge == 1 else fit(edge - 1)) if edge else fit(1) if count[2] > 100 else None
    if beside is None:
        return core
    apart = beside.coefficients - core.coefficients
    return replace(core, covariance=core.covariance + _EDGE * np.outer(apart, apart))


WIDEST = 0.15
"""More than a frame is wide [m]: what goes on in its plane is a wall."""

_LINES = 48  # across each side


def frame_sides(
    depth: np.ndarray,
    lens: np.ndarray,
    plane: np.ndarray,
    tolerance: float,
    point: np.ndarray,
    basis: np.ndarray,
    rectangle: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Where a mirror's frame begins and ends on each side, and how it is turned in its plane.

    Lines run from the middle of the rectangle outwards, across each side. In the glass they meet readings beyond the
    plane, or none; the first stretch on the plane is the frame, until it is beyond (or before) it again. A line that
    comes to the frame from something before it, such as a person, tells nothing.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    lens : np.ndarray [shape=(4,)]
        fx, fy, cx, cy.
    plane : np.ndarray [shape=(3,)]
        1/z = a·u + b·v + c.
    tolerance : float
        Readings whose 1/z is this near are on it [1/m].
    point, basis : np.ndarray [shape=(3,)], [shape=(3, 3)]
        See :class:`.mirror.Mirror`.
    rectangle : np.ndarray [shape=(2, 2)]
        First guess of the extent along a and b.

    Returns
    -------
    inner, outer : np.ndarray [shape=(2, 2)]
        The frame's edges as ``rectangle``; NaN where there is no evidence. ``outer`` is ``inner`` where the plane goes
        on for more than :data:`WIDEST`.
    cut : np.ndarray [shape=(2, 2), dtype=bool]
        Most lines leave the picture through the glass there.
    turn : float
        By which angle the sides are turned from a towards b [rad].

    Notes
    -----
    O(pixels across the frame).
    """
    return _sides_kernel(depth, lens, plane, tolerance, point, basis, np.ascontiguousarray(rectangle), WIDEST)


THICK = 0.01
"""How far a mirror's glass may stand before the wall it hangs on, one standard deviation [m]."""
_DEEP = 0.035  # farther before the wall than that nobody takes a frame for it [m]
_STEP = 4.0  # standard deviations by which a frame must stand before the wall to be told from it
_PARTS = 6  # of each side, asked one by one
_FEW = 5  # readings of a part that say too little


@dataclass(frozen=True)
class Parted:
    """A frame without the wall about it: its pixels, their plane, and how far the glass may well be off it, one
    standard deviation [m]: 0 but where the plane is the wall's."""

    u: np.ndarray
    v: np.ndarray
    fitted: DisparityPlane
    unsure: float


def part_wall(
    u: np.ndarray,
    v: np.ndarray,
    depth: np.ndarray,
    fitted: DisparityPlane,
    lens: np.ndarray,
    point: np.ndarray,
    basis: np.ndarray,
    rectangle: np.ndarray,
) -> Parted:
    """The frame of a mirror that hangs on a wall, told from the wall behind it.

    A frame is a few pixels wide, and a wall a centimetre behind it is, pixel by pixel, on its plane. Over the length of
    the sides the step between them shows: readings are sorted by how far outside of the glass they are, the step is
    where they part best in two, and parts of the sides must agree on it. Where there is none the plane is the wall's
    (or that of a frame flush with it), and the glass before it by its unknown thickness.

    Parameters
    ----------
    u, v : np.ndarray [shape=(K,), dtype=int]
        What was taken for the frame.
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    fitted : DisparityPlane
        Of these pixels.
    lens, point, basis, rectangle
        As for :func:`frame_sides`; ``point`` and ``basis`` are near the plane.

    Notes
    -----
    O(pixels of the box about the frame); nothing is done where no wall goes on in the plane.
    """
    z = float(point[2])
    tolerance = min(max(4.0 * np.hypot(fitted.scale, np.sqrt(fitted.common)), 0.004 / z**2), 0.02 / z)
    plane, rectangle = fitted.coefficients, np.ascontiguousarray(rectangle)
    limit = _DEEP / z**2
    inner, outer, _, _ = frame_sides(depth, lens, plane, tolerance, point, basis, rectangle)
    if np.isnan(inner).all():  # the frame may be too far before the plane
        inner, outer, _, _ = frame_sides(depth, lens, plane, limit, point, basis, rectangle)
    goes_on = outer == inner  # false where NaN
    if not goes_on.any():
        return Parted(u, v, fitted, 0.0)
    wall = Parted(u, v, fitted, THICK if goes_on.sum() > 1 else 0.0)
    pixel = z / (0.5 * (lens[0] + lens[1]))
    count, total = _beside_kernel(depth, lens, plane, point, basis, inner, limit, pixel, int(WIDEST / pixel), _PARTS)
    below, above = np.cumsum(count, axis=1), np.cumsum(count[:, ::-1], axis=1)[:, ::-1]
    near, far = np.cumsum(total, axis=1), np.cumsum(total[:, ::-1], axis=1)[:, ::-1]
    best, step = 0.0, 0
    for k in range(1, int(0.6 * WIDEST / pixel)):  # readings at least 1 and less than 1 + k pixels outside, or beyond
        few, many = below[:, k - 1].sum(), above[:, k].sum()
        if few > 0 and many > 0:
            parted = few * many / (few + many) * (near[:, k - 1].sum() / few - far[:, k].sum() / many) ** 2
            best, step = (parted, k) if parted > best else (best, step)
    told = (below[:, step - 1] > _FEW) & (above[:, step] > _FEW) if step else np.zeros(len(count), np.bool_)
    if told.sum() < _PARTS:
        return wall
    few, many = below[told, step - 1], above[told, step]
    rise = near[told, step - 1] / few - far[told, step] / many
    weight = few * many / (few + many)
    mean = (weight * rise).sum() / weight.sum()
    error = np.sqrt((weight**2 * (rise - mean) ** 2).sum()) / weight.sum()
    if mean < _STEP * error:
        return wall
    ends = max(step, 2) * pixel  # a pixel less than where it steps
    level = near[told, step - 1].sum() / few.sum()
    mine_u, mine_v = _frame_kernel(depth, lens, plane, point, basis, inner, level, tolerance, ends)
    again = disparity_plane(mine_u, mine_v, depth[mine_v, mine_u]) if len(mine_u) >= 30 else None
    return wall if again is None else Parted(mine_u, mine_v, again, 0.0)


@njit(cache=True, nogil=True)
def _outside(lens, plane, point, basis, inner, u, v, at):
    """How far outside of the sides that are known a pixel lies on the plane [m], -1 inside, and its side; ``at`` (2,)
    is its place."""
    there = plane[0] * u + plane[1] * v + plane[2]
    if there <= 0.0:
        return -1.0, 0
    x, y, z = (
        (u - lens[2]) / lens[0] / there - point[0],
        (v - lens[3]) / lens[1] / there - point[1],
        1.0 / there - point[2],
    )
    best, side = -1.0, 0
    for axis in range(2):
        at[axis] = basis[0, axis] * x + basis[1, axis] * y + basis[2, axis] * z
        for end in range(2):
            beyond = (2 * end - 1) * (at[axis] - inner[axis, end])
            if beyond > best:  # false where NaN
                best, side = beyond, 2 * axis + end
    return best, side


@njit(cache=True, nogil=True)
def _beside_kernel(depth, lens, plane, point, basis, inner, limit, pixel, bins, parts):
    """Counts of readings near the plane, and sums of how much nearer they are in 1/z, by part of the sides and by how
    many pixels outside of the sides they are, from 1 on: (4·parts, bins) each."""
    count, total, at = np.zeros((4 * parts, bins)), np.zeros((4 * parts, bins)), np.empty(2)
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = depth[v, u]
            if z == 0.0:
                continue
            apart = 1.0 / z - (plane[0] * u + plane[1] * v + plane[2])
            if abs(apart) > limit:
                continue
            outside, side = _outside(lens, plane, point, basis, inner, u, v, at)
            k = int(outside / pixel) - 1
            if outside < pixel or k >= bins:
                continue
            other = 1 - side // 2
            share = (at[other] - inner[other, 0]) / (inner[other, 1] - inner[other, 0])
            if not 0.0 <= share < 1.0:  # about a corner, or where a side is not known
                continue
            part = side * parts + int(share * parts)
            count[part, k] += 1.0
            total[part, k] += apart
    return count, total


@njit(cache=True, nogil=True)
def _frame_kernel(depth, lens, plane, point, basis, inner, level, tolerance, ends):
    """Pixels (u, v) up to ``ends`` outside of the sides [m] that are ``level`` nearer than the plane in 1/z."""
    height, width = depth.shape
    columns, rows, at = np.empty(height * width, np.int64), np.empty(height * width, np.int64), np.empty(2)
    n = 0
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            if z == 0.0 or abs(1.0 / z - (plane[0] * u + plane[1] * v + plane[2]) - level) > tolerance:
                continue
            outside, _ = _outside(lens, plane, point, basis, inner, u, v, at)
            if 0.0 <= outside < ends:
                columns[n], rows[n] = u, v
                n += 1
    return columns[:n].copy(), rows[:n].copy()


_MET, _LEFT_IMAGE = 1, 2
_BLIND = 6  # px without a reading beside something that stands before a mirror are that thing's shadow, more the glass


@njit(cache=True, nogil=True)
def _sides_kernel(depth, lens, plane, tolerance, point, basis, rectangle, widest):
    """Inner and outer edges (2, 2), sides that the image cuts off, and the turn."""
    inner, outer, cut = np.full((2, 2), np.nan), np.full((2, 2), np.nan), np.zeros((2, 2), np.bool_)
    slope, weight = 0.0, 0.0
    places, edges = np.empty(_LINES), np.empty((_LINES, 2))
    for axis in range(2):
        low, high = rectangle[1 - axis]
        for end in range(2):
            told, gone = 0, 0
            for i in range(_LINES):
                place = low + (0.06 + 0.88 * i / (_LINES - 1)) * (high - low)
                state, begins, ends = _walk(
                    depth, lens, plane, tolerance, point, basis, axis, end, rectangle[axis], place, widest
                )
                if state == _MET:
                    places[told], edges[told, 0], edges[told, 1] = place, begins, ends
                    told += 1
                elif state == _LEFT_IMAGE:
                    gone += 1
            cut[axis, end] = gone > max(2 * told, _LINES // 6)
            if told < max(6, gone // 2):
                continue
            x, y = places[:told] - places[:told].mean(), edges[:told, 0]
            half = told // 2
            tilt = np.median((y[half : 2 * half] - y[:half]) / (x[half : 2 * half] - x[:half]))
            level = np.median(y - tilt * x)
            near = np.abs(y - tilt * x - level) < 0.015
            if near.sum() < max(6.0, 0.4 * told):
                continue
            inner[axis, end] = level + tilt * (0.5 * (low + high) - places[:told].mean())
            width = np.median(np.abs(edges[:told, 1] - y)[near])
            outer[axis, end] = inner[axis, end] + (2 * end - 1) * width
            # seen along b a side drifts along a by the tangent of the turn, the other way round against it
            share = near.sum() * (x[near].max() - x[near].min()) ** 2
            slope += share * (tilt if axis == 1 else -tilt)
            weight += share
    return inner, outer, cut, np.arctan(slope / weight) if weight > 0.0 else 0.0


@njit(cache=True, nogil=True)
def _walk(depth, lens, plane, tolerance, point, basis, axis, end, extent, place, widest):
    """What a line across a side meets, and the frame's inner and outer edge on it along ``axis`` [m]."""
    height, width = depth.shape
    sign = 2.0 * end - 1.0
    stop = extent[end] + sign * 0.4
    s = 0.5 * (extent[0] + extent[1]) + sign * 0.15 * (extent[1] - extent[0])
    began, last, gap, before, glass = np.nan, np.nan, 0, False, 0
    while sign * (stop - s) > 0.0 or not np.isnan(began):
        x = point[0] + basis[0, axis] * s + basis[0, 1 - axis] * place
        y = point[1] + basis[1, axis] * s + basis[1, 1 - axis] * place
        z = point[2] + basis[2, axis] * s + basis[2, 1 - axis] * place
        if z < 0.1:
            break
        u, v = int(np.floor(x / z * lens[0] + lens[2] + 0.5)), int(np.floor(y / z * lens[1] + lens[3] + 0.5))
        step = 0.8 * z / lens[0]
        if u < 0 or v < 0 or u >= width or v >= height:
            if np.isnan(began):
                return 0 if before or glass < 4 else _LEFT_IMAGE, s, s
            break
        reading = depth[v, u]
        apart = 1.0 / reading - (plane[0] * u + plane[1] * v + plane[2]) if reading > 0.0 else -np.inf
        if abs(apart) < tolerance:
            if np.isnan(began):
                began = s
            last, gap = s, 0
            if sign * (last - began) > widest:
                break
        else:
            gap += 1
            if gap > 1 and not np.isnan(began):
                if sign * (last - began) > 1.2 * step:
                    break
                began = np.nan  # a stray pixel
            if np.isnan(began) and (reading > 0.0 or gap > _BLIND):
                before = reading > 0.0 and apart > 0.0
            glass += apart < 0.0
        s += sign * step
    if np.isnan(began) or before or glass < 4 or sign * (last - began) <= 1.0e-3:
        return 0, s, s
    return _MET, began, began if sign * (last - began) > widest else last


@njit(cache=True, nogil=True)
def erosion(mask):
    """0 off the mask, else 1 + how many rings of 8-neighbours are all on it, up to 3."""
    height, width = mask.shape
    out = np.zeros(mask.shape, np.uint8)
    for v in range(height):
        for u in range(width):
            if not mask[v, u]:
                continue
            rings = 0
            while rings < 2:
                r = rings + 1
                if v < r or u < r or v >= height - r or u >= width - r:
                    break
                whole = True
                for k in range(-r, r + 1):
                    if not (mask[v - r, u + k] and mask[v + r, u + k] and mask[v + k, u - r] and mask[v + k, u + r]):
                        whole = False
                        break
                if not whole:
                    break
                rings = r
            out[v, u] = 1 + rings
    return out


@njit(cache=True, nogil=True)
def _near_seeds(depth, seeds, plane, band):
    """The pixels about picked ones that read the same depth as they."""
    height, width = depth.shape
    columns, rows = np.empty(81 * len(seeds), np.int64), np.empty(81 * len(seeds), np.int64)
    n = 0
    for k in range(len(seeds)):
        u, v = seeds[k]
        z = depth[v, u]
        if abs((plane[0] * u + plane[1] * v + plane[2]) * z - 1.0) > band:
            continue
        for y in range(max(v - 4, 0), min(v + 5, height)):
            for x in range(max(u - 4, 0), min(u + 5, width)):
                there = plane[0] * x + plane[1] * y + plane[2]
                same = depth[y, x] > 0 and abs(depth[y, x] / z - 1.0) < 2.0 * band
                if same and abs(there * depth[y, x] - 1.0) < band:
                    columns[n], rows[n] = x, y
                    n += 1
    return columns[:n], rows[:n]


@njit(cache=True, nogil=True)
def _spread(covariance, u, v):
    """Variance of the plane's 1/z at a pixel."""
    return max(
        covariance[0, 0] * u * u + covariance[1, 1] * v * v + covariance[2, 2]
        + 2.0 * (covariance[0, 1] * u * v + covariance[0, 2] * u + covariance[1, 2] * v), 0.0,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _connect(state, i, j, stack, top):
    """Take a block and its eight neighbours, where they are on the plane, for connected; the stack's new height."""
    for y in range(max(i - 1, 0), min(i + 2, state.shape[0])):
        for x in range(max(j - 1, 0), min(j + 2, state.shape[1])):
            if state[y, x] == 1:
                state[y, x] = 2
                stack[top, 0], stack[top, 1] = y, x
                top += 1
    return top


@njit(cache=True, nogil=True)
def _gather_kernel(depth, seeds, plane, covariance, sigma, common, band, box):
    """Pixels inside the box (u0, v0, u1, v1) on the plane, in blocks that are connected to the seeds'.

    A block is left out when its mean is off the plane by more than noise and the plane's own uncertainty explain, or
    when its surface cuts through it, as a floor does.
    """
    columns, rows = (box[2] - box[0]) // BLOCK + 1, (box[3] - box[1]) // BLOCK + 1
    sums = np.zeros((rows, columns, 8))  # 1, x, y, xx, yy, r, rx, ry of its pixels
    near, spread = np.empty((rows, columns)), np.empty((rows, columns))
    for i in range(rows):
        for j in range(columns):
            u, v = box[0] + (j + 0.5) * BLOCK, box[1] + (i + 0.5) * BLOCK
            there = plane[0] * u + plane[1] * v + plane[2]
            spread[i, j] = _spread(covariance, u, v)
            near[i, j] = min(4.0 * sigma + 3.0 * np.sqrt(spread[i, j]), band * there)
    on = np.zeros((box[3] - box[1], box[2] - box[0]), np.bool_)
    for v in range(box[1], box[3]):
        i = (v - box[1]) // BLOCK
        base = plane[1] * v + plane[2]
        for u in range(box[0], box[2]):
            z = depth[v, u]
            if z == 0.0:
                continue
            j = (u - box[0]) // BLOCK
            r = 1.0 / z - (base + plane[0] * u)
            if abs(r) > near[i, j]:
                continue
            on[v - box[1], u - box[0]] = True
            cell = sums[i, j]
            x, y = u - box[0] - (j + 0.5) * BLOCK, v - box[1] - (i + 0.5) * BLOCK
            cell[0] += 1.0
            cell[1] += x
            cell[2] += y
            cell[3] += x * x
            cell[4] += y * y
            cell[5] += r
            cell[6] += r * x
            cell[7] += r * y
    state = np.zeros((rows, columns), np.uint8)  # 1 on the plane, 2 and connected
    for i in range(rows):
        for j in range(columns):
            cell = sums[i, j]
            n = cell[0]
            if n == 0.0:
                continue
            mean, own = cell[5] / n, sigma * sigma / n + common
            good = mean * mean < 12.0 * (own + spread[i, j])
            for k in range(1, 3):
                across = cell[2 + k] - cell[k] * cell[k] / n
                tilt = cell[5 + k] - cell[k] * mean
                good = good and tilt * tilt <= 25.0 * across * own * n
            state[i, j] = 1 if good else 0
    stack = np.empty((rows * columns, 2), np.int64)
    top = 0
    for k in range(len(seeds)):
        top = _connect(state, (seeds[k, 1] - box[1]) // BLOCK, (seeds[k, 0] - box[0]) // BLOCK, stack, top)
    while top > 0:
        top = _connect(state, stack[top - 1, 0], stack[top - 1, 1], stack, top - 1)
    total = 0
    for i in range(rows):
        for j in range(columns):
            if state[i, j] == 2:
                total += int(sums[i, j, 0])
    out_u, out_v = np.empty(total, np.int64), np.empty(total, np.int64)
    n = 0
    for y in range(box[3] - box[1]):
        for x in range(box[2] - box[0]):
            if on[y, x] and state[y // BLOCK, x // BLOCK] == 2:
                out_u[n], out_v[n] = box[0] + x, box[1] + y
                n += 1
    return out_u, out_v
