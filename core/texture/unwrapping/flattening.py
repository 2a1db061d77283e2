"""An island laid flat: least squares conformal maps, then as rigid as possible.

Lévy et al. 2002; Liu, Zhang, Xu, Gotsman and Gortler 2008, "A local/global approach to mesh parameterization".
"""

from __future__ import annotations

import numpy as np

from ...mesh.boundary_loops import boundary_loops
from ...mesh.half_edges import edge_keys
from ...numeric.sparse_least_squares import elimination_order, solve_squares

_THINNEST = 0.02  # least height of a triangle in parts of its longest edge, as it is laid flat
_ITERATIONS, _LONG = 4, 12  # local and global steps from a conformal map, and from a circle
_FLOOR, _STIFFER = 0.3, 3.0  # least weight of a triangle, of the mean area; and by how much flipped ones gain
_UNEVEN = 4.0  # areas may differ so much from those of the skin, at the 5th and 95th percentile of it
_CREASED = 50.0  # as much where it is creased, and cannot be laid flat otherwise
_REPAIRS = 12  # rounds in which vertices round flipped triangles move to the middle of their neighbours


def flatten(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray | None:
    """Places (V, 2) of a disk's vertices in the plane, with lengths as on the surface.

    Parameters
    ----------
    vertices : np.ndarray [shape=(V, 3)]
        Each in use [m].
    triangles : np.ndarray [shape=(T, 3), dtype=int32]
        A topological disk.

    Returns
    -------
    np.ndarray [shape=(V, 2), dtype=float64] or None
        [m]; every triangle is counter-clockwise. None when some remain flipped, or much larger or smaller than on the
        surface, or lie on one another.
    """
    gradients, area, frame = _gradients(vertices, triangles)
    order = _order(triangles, len(vertices))
    if len(triangles) == 1:
        flat = np.empty((3, 2))
        flat[triangles[0]] = frame[0]
        return flat
    start = _conformal(vertices, triangles, gradients, area, order)
    for steps in (_ITERATIONS, _LONG):
        flat = _rigid(start, triangles, gradients, area, order, steps)
        if _repaired(flat, triangles) and _untangled(flat, triangles) and _is_even(flat, triangles, area):
            return flat
    flat = _guarded(_in_circle(vertices, triangles, order), triangles, gradients, area, order)
    return flat if _is_even(flat, triangles, area, _CREASED) else None


def crosses_itself(flat: np.ndarray, triangles: np.ndarray) -> bool:
    """Whether the border of a disk crosses itself in the plane.

    If it does not, and no triangle is flipped, no two triangles of the disk lie on one another.
    """
    return bool(_crossings(flat[boundary_loops(triangles, len(flat))[0]]).any())


def _crossings(loop: np.ndarray) -> np.ndarray:
    """Which sides of a polygon (K, 2) cross, bool (K, K)."""
    after = np.roll(loop, -1, axis=0)
    along = after - loop

    def side(points: np.ndarray) -> np.ndarray:
        """On which side (K, M) of each piece of the border each point lies."""
        apart = points[None] - loop[:, None]
        return along[:, None, 0] * apart[..., 1] - along[:, None, 1] * apart[..., 0]

    parted = side(loop) * side(after) < 0
    return parted & parted.T


def _is_even(flat: np.ndarray, triangles: np.ndarray, area: np.ndarray, limit: float = _UNEVEN) -> bool:
    """Whether most of the skin is about as large in the plane as it is."""
    a, b, c = (flat[triangles[:, k]] for k in range(3))
    u, v = b - a, c - a
    ratio = 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / area
    order = ratio.argsort()
    share = np.cumsum(area[order]) / area.sum()
    low, high = ratio[order][np.searchsorted(share, (0.05, 0.95)).clip(0, len(order) - 1)]
    return bool(1.0 / limit < low and high < limit)


def flipped(flat: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Which triangles, bool (T,), are clockwise or without area in the plane."""
    a, b, c = (flat[triangles[:, k]] for k in range(3))
    u, v = b - a, c - a
    doubled = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    longest = np.maximum((u * u).sum(axis=1), (v * v).sum(axis=1))
    return ~(doubled > 1e-6 * longest)


def _gradients(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gradients (T, 2, 3) of the corners' hat functions, areas (T,), corners (T, 3, 2), in each triangle's own plane.

    Triangles that are almost lines are taken as a little less thin.
    """
    corner = vertices[triangles]
    u, v = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    longest = np.sqrt(np.maximum((u * u).sum(axis=1), ((v - u) ** 2).sum(axis=1)).clip(1e-18))
    base = np.maximum(np.linalg.norm(u, axis=1), _THINNEST * longest)
    x = np.einsum("ti,ti->t", u, v) / base
    y = np.maximum(np.sqrt(np.maximum((v * v).sum(axis=1) - x * x, 0.0)), _THINNEST * longest)
    frame = np.zeros((len(triangles), 3, 2))
    frame[:, 1, 0], frame[:, 2, 0], frame[:, 2, 1] = base, x, y
    doubled = base * y
    gradient = np.empty((len(triangles), 2, 3))
    for k in range(3):
        across = frame[:, (k + 2) % 3] - frame[:, (k + 1) % 3]
        gradient[:, 0, k], gradient[:, 1, k] = -across[:, 1] / doubled, across[:, 0] / doubled
    return gradient, 0.5 * doubled, frame


def _order(triangles: np.ndarray, count: int) -> np.ndarray:
    """Order (V,) in which vertices are eliminated."""
    keys = np.unique(edge_keys(triangles, count))
    ends = np.concatenate((np.stack((keys // count, keys % count), 1), np.stack((keys % count, keys // count), 1)))
    ends = ends[ends[:, 0].argsort(kind="stable")]
    start = np.zeros(count + 1, np.int64)
    np.cumsum(np.bincount(ends[:, 0], minlength=count), out=start[1:])
    return elimination_order(start, np.ascontiguousarray(ends[:, 1]))


def _conformal(vertices, triangles, gradients, area, order) -> np.ndarray:
    """Least squares conformal map (V, 2), two vertices far apart held."""
    count = len(vertices)
    middle = vertices.mean(axis=0)
    first = int(((vertices - middle) ** 2).sum(axis=1).argmax())
    second = int(((vertices - vertices[first]) ** 2).sum(axis=1).argmax())
    fixed = np.zeros(2 * count)
    fixed[2 * second] = np.linalg.norm(vertices[second] - vertices[first])
    # each triangle's two Cauchy–Riemann equations: du/dx = dv/dy, du/dy = -dv/dx
    root = np.sqrt(area)[:, None]
    dx, dy = gradients[:, 0] * root, gradients[:, 1] * root
    columns = np.empty((len(triangles), 2, 6), np.int64)
    columns[:, :, 0:3], columns[:, :, 3:6] = 2 * triangles[:, None], 2 * triangles[:, None] + 1
    values = np.stack((np.hstack((dx, -dy)), np.hstack((dy, dx))), axis=1)
    held = np.zeros(2 * count, np.bool_)
    held[[2 * first, 2 * first + 1, 2 * second, 2 * second + 1]] = True
    right = -(values * fixed[columns]).sum(axis=2)
    rhs = np.zeros(2 * count)
    free = ~held[columns]
    np.add.at(rhs, columns[free], (values * right[:, :, None])[free])
    columns = np.where(free, columns, -1)
    diagonal = np.where(held, 1.0, 1e-10)
    start = np.arange(0, columns.size + 1, 6)
    both = np.stack((2 * order, 2 * order + 1), axis=1).ravel()
    flat = solve_squares(start, columns.ravel(), values.ravel(), diagonal, rhs[:, None], both)[:, 0]
    flat = np.where(held, fixed, flat).reshape(-1, 2)
    if (flipped(flat, triangles)).mean() > 0.5:
        flat = flat * (1.0, -1.0)
    return flat


def _in_circle(vertices, triangles, order) -> np.ndarray:
    """Harmonic map (V, 2) into a circle, all weights one: no triangle flips (Tutte 1963)."""
    count = len(vertices)
    loop = boundary_loops(triangles, count)[0]
    steps = np.linalg.norm(vertices[loop] - vertices[np.roll(loop, 1)], axis=1) + 1e-9
    angle = 2 * np.pi * np.cumsum(steps) / steps.sum()
    fixed = np.zeros((count, 2))
    fixed[loop] = steps.sum() / (2 * np.pi) * np.stack((np.cos(angle), np.sin(angle)), axis=1)
    held = np.zeros(count, np.bool_)
    held[loop] = True
    keys = np.unique(edge_keys(triangles, count))
    columns = np.stack((keys // count, keys % count), axis=1)
    values = np.tile((1.0, -1.0), (len(columns), 1))
    right = -(values[..., None] * fixed[columns]).sum(axis=1)
    rhs = np.zeros((count, 2))
    for k in range(2):
        free = ~held[columns[:, k]]
        np.add.at(rhs, columns[free, k], values[free, k, None] * right[free])
    columns = np.where(held[columns], -1, columns)
    start = np.arange(0, columns.size + 1, 2)
    flat = solve_squares(start, columns.ravel(), values.ravel(), np.where(held, 1.0, 1e-10), rhs, order)
    return np.where(held[:, None], fixed, flat)


def _rigid(flat, triangles, gradients, area, order, steps: int) -> np.ndarray:
    """As rigid as possible from where ``flat`` (V, 2) is: each triangle turned, then all joined, by turns.

    Small triangles, which flip most easily, weigh more than their area, and more each time that they are flipped.
    """
    weight = np.maximum(area, _FLOOR * area.mean())
    for _ in range(steps):
        flat = _joined(flat, triangles, gradients, weight, order)
        weight = weight * np.where(flipped(flat, triangles), _STIFFER, 1.0)
    return flat


def _guarded(flat, triangles, gradients, area, order) -> np.ndarray:
    """As rigid as can be without that a triangle flips or the border crosses itself."""
    weight = np.maximum(area, _FLOOR * area.mean())
    for _ in range(_LONG):
        rigid = _joined(flat, triangles, gradients, weight, order)
        for share in (1.0, 0.5, 0.25, 0.12, 0.06, 0.03):
            some = flat + share * (rigid - flat)
            if not (flipped(some, triangles).any() or crosses_itself(some, triangles)):
                break
        else:
            break
        flat = some
    return flat


def _joined(flat, triangles, gradients, weight, order) -> np.ndarray:
    """Places (V, 2) at which triangles are as near as possible to what they are in ``flat`` without their stretch."""
    count = len(flat)
    root = np.sqrt(weight)
    rows = gradients * root[:, None, None]
    target = _turns(flat, triangles, gradients) * root[:, None, None]  # rows d/dx, d/dy; columns u, v
    rhs = np.zeros((count, 2))
    for c in range(2):
        for k in range(3):
            rhs[:, c] += np.bincount(triangles[:, k], (rows[:, :, k] * target[:, :, c]).sum(axis=1), count)
    rhs[0] += flat[0]
    diagonal = np.full(count, 1e-10)
    diagonal[0] = 1.0
    columns = np.repeat(triangles.astype(np.int64)[:, None], 2, axis=1).ravel()
    start = np.arange(0, len(columns) + 1, 3)
    return solve_squares(start, columns, np.ascontiguousarray(rows).ravel(), diagonal, rhs, order)


def _turns(flat, triangles, gradients) -> np.ndarray:
    """The rotation (T, 2, 2) nearest to each triangle's map; its rows are the images of the two axes."""
    jacobian = np.einsum("tdk,tkc->tdc", gradients, flat[triangles])
    cosine = jacobian[:, 0, 0] + jacobian[:, 1, 1]
    sine = jacobian[:, 0, 1] - jacobian[:, 1, 0]
    length = np.maximum(np.hypot(cosine, sine), 1e-12)
    cosine, sine = cosine / length, sine / length
    return np.stack((np.stack((cosine, sine), -1), np.stack((-sine, cosine), -1)), axis=1)


def _repaired(flat: np.ndarray, triangles: np.ndarray) -> bool:
    """Move inner vertices of flipped triangles to the middle of their neighbours, in place; whether that helped."""
    count = len(flat)
    keys = np.unique(edge_keys(triangles, count))
    a, b = keys // count, keys % count
    degree = np.bincount(a, minlength=count) + np.bincount(b, minlength=count)
    inner = np.ones(count, np.bool_)
    for loop in boundary_loops(triangles, count):
        inner[loop] = False
    for attempt in range(_REPAIRS):
        bad = flipped(flat, triangles)
        if not bad.any():
            return True
        near = np.zeros(count, np.bool_)
        near[triangles[bad]] = True
        for _ in range(attempt // 3):
            near[triangles[near[triangles].any(axis=1)]] = True
        near &= inner
        for _ in range(10):
            total = np.stack(
                [np.bincount(a, flat[b, c], count) + np.bincount(b, flat[a, c], count) for c in range(2)], axis=1
            )
            flat[near] = total[near] / degree[near, None]
    return not flipped(flat, triangles).any()


def _untangled(flat: np.ndarray, triangles: np.ndarray) -> bool:
    """Smooth the border where it crosses itself between places close together, in place; whether that helped."""
    loop = boundary_loops(triangles, len(flat))[0]
    count = len(loop)
    for _ in range(_REPAIRS):
        one, other = np.nonzero(np.triu(_crossings(flat[loop])))
        if not len(one):
            return not flipped(flat, triangles).any()
        near = np.zeros(count, np.bool_)
        for i, j in zip(one, other, strict=True):
            apart = int(min(j - i, count - j + i))
            if apart > max(8, count // 12):
                return False
            first = int(i if j - i <= count - j + i else j)
            near[np.arange(first - 1, first + apart + 3) % count] = True
        for _ in range(3):
            middle = 0.5 * (flat[np.roll(loop, 1)] + flat[np.roll(loop, -1)])
            flat[loop[near]] = 0.5 * (flat[loop[near]] + middle[near])
        if flipped(flat, triangles).any() and not _repaired(flat, triangles):
            return False
    return False
