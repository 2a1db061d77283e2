"""Smoothly blended solids on a grid: the field, and the closed surface where it is zero.

A solid is a list of primitives, each one row of :class:`Primitives`; they are joined in order with a polynomial smooth
minimum. Ellipsoids, tapered capsules and *lofts* (a table of oval sections along an axis) are enough for a body.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..numeric.isosurface import CORNERS, split_quads, surface_nets
from ..numeric.kernels import njit
from ..numeric.threads import each_range

ELLIPSOID, CAPSULE, LOFT = 0, 1, 2
FAR = 1.0
TABLE_SAMPLES = 128


class Primitives(NamedTuple):
    """P primitives as arrays. A primitive's own axes are x (side), y (depth) and z (length), starting at its origin.

    Parameters
    ----------
    kind : np.ndarray [shape=(P,), dtype=int64]
        ``ELLIPSOID``, ``CAPSULE`` or ``LOFT``.
    blend : np.ndarray [shape=(P,), dtype=float64]
        Width of the smooth joint with the primitives before it [m]; negative = carve the primitive out instead.
    origin, axes : np.ndarray [shape=(P, 3)], [shape=(P, 3, 3)]
        Local frame; the rows of ``axes`` are the local x, y, z.
    size : np.ndarray [shape=(P, 4)]
        Ellipsoid: three radii. Capsule: length, radius at the start, radius at the end. Loft: length, start cap,
        end cap [m], exponent of the superelliptic section (2 = ellipse).
    table : np.ndarray [shape=(P, S, 6)]
        Lofts only: half-width at +x and at -x, half-depth at -y and at +y, centre x and y, at S even stations.
    low, high : np.ndarray [shape=(P, 3)]
        Box outside of which the primitive has no influence on the surface.
    """

    kind: np.ndarray
    blend: np.ndarray
    origin: np.ndarray
    axes: np.ndarray
    size: np.ndarray
    table: np.ndarray
    low: np.ndarray
    high: np.ndarray


class Solid:
    """Collects primitives; ``build()`` turns them into arrays. Mirror images are made by ``side=-1`` (x -> -x)."""

    def __init__(self) -> None:
        self._rows: list[tuple] = []
        self.names: list[str] = []

    def ellipsoid(self, name, centre, radii, blend, axes=None, side=1) -> None:
        """Add an ellipsoid."""
        axes = np.eye(3) if axes is None else np.asarray(axes, dtype=float)
        extent = np.abs(axes).T @ np.asarray(radii, dtype=float)
        self._add(name, ELLIPSOID, blend, centre, axes, (*radii, 0.0), None, -extent, extent, side)

    def capsule(self, name, start, end, radius_start, radius_end, blend, side=1) -> None:
        """Add a tapered capsule."""
        start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
        axis = end - start
        length = float(np.linalg.norm(axis))
        low = np.minimum(-radius_start, axis - radius_end)
        high = np.maximum(radius_start, axis + radius_end)
        size = (length, radius_start, radius_end, 0.0)
        self._add(name, CAPSULE, blend, start, frame_along(axis), size, None, low, high, side)

    def loft(self, name, start, end, stations, blend, caps, exponent=2.0, axes=None, side=1) -> None:
        """Add a loft.

        ``stations`` are rows (position 0..1, half-width +x, half-width -x, depth -y, depth +y, centre x, centre y).
        """
        start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
        axes = frame_along(end - start) if axes is None else np.asarray(axes, dtype=float)
        table = smooth_table(np.asarray(stations, dtype=float), TABLE_SAMPLES)
        length = float(np.linalg.norm(end - start))
        low = np.array([(table[:, 4] - table[:, 1]).min(), (table[:, 5] - table[:, 2]).min(), -caps[0]])
        high = np.array([(table[:, 4] + table[:, 0]).max(), (table[:, 5] + table[:, 3]).max(), length + caps[1]])
        corners = (low + CORNERS * (high - low)) @ axes
        low, high = corners.min(axis=0), corners.max(axis=0)
        self._add(name, LOFT, blend, start, axes, (length, *caps, exponent), table, low, high, side)

    def rotate(self, first: int, matrix: np.ndarray, pivot: np.ndarray) -> None:
        """Rotate every primitive added from index ``first`` on about ``pivot``."""
        for i in range(first, len(self._rows)):
            kind, blend, origin, axes, size, table, low, high = self._rows[i]
            corners = (low + CORNERS * (high - low)) @ matrix.T
            self._rows[i] = (
                kind,
                blend,
                pivot + matrix @ (origin - pivot),
                axes @ matrix.T,
                size,
                table,
                corners.min(axis=0),
                corners.max(axis=0),
            )

    def _add(self, name, kind, blend, origin, axes, size, table, low, high, side) -> None:
        origin, axes = np.array(origin, dtype=float), np.array(axes, dtype=float)
        if side < 0:
            origin[0] *= -1.0
            axes[:, 0] *= -1.0
            low, high = np.array([-high[0], low[1], low[2]]), np.array([-low[0], high[1], high[2]])
        self._rows.append((kind, blend, origin, axes, size, table, np.asarray(low), np.asarray(high)))
        self.names.append(name)

    def __len__(self) -> int:
        return len(self._rows)

    def build(self) -> Primitives:
        """All primitives added so far, as arrays."""
        kind, blend, origin, axes, size, table, low, high = zip(*self._rows, strict=True)
        blends, origins = np.array(blend, dtype=float), np.array(origin)
        margin = (np.abs(blends) + 0.03)[:, None]
        empty = np.zeros((TABLE_SAMPLES, 6))
        return Primitives(
            np.array(kind, dtype=np.int64),
            blends,
            origins,
            np.array(axes),
            np.array(size, dtype=float),
            np.array([empty if t is None else t for t in table]),
            origins + np.array(low) - margin,
            origins + np.array(high) + margin,
        )


def frame_along(axis: np.ndarray) -> np.ndarray:
    """Rows: a side, depth and length axis, with length along ``axis`` and depth as near world y as it can be."""
    axis = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    depth = np.array([0.0, 1.0, 0.0]) if abs(axis[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    depth -= (depth @ axis) * axis
    depth /= np.linalg.norm(depth)
    side = np.cross(depth, axis)
    return np.array([side if side[0] >= 0 else -side, depth, axis])


def smooth_table(stations: np.ndarray, samples: int) -> np.ndarray:
    """Cubic Hermite curve through ``stations`` (first column: position), sampled evenly over its range."""
    x, y = stations[:, 0], stations[:, 1:]
    slope = np.gradient(y, x, axis=0)
    at = np.linspace(x[0], x[-1], samples)
    i = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    h = (x[i + 1] - x[i])[:, None]
    s = (at - x[i])[:, None] / h
    return (
        (1 + 2 * s) * (1 - s) ** 2 * y[i]
        + s * (1 - s) ** 2 * h * slope[i]
        + s * s * (3 - 2 * s) * y[i + 1]
        - s * s * (1 - s) * h * slope[i + 1]
    )


@njit(cache=True, nogil=True)
def _primitive(kind, origin, axes, size, table, px, py, pz):
    """Distance estimate [m] of one primitive, exact to first order at its surface for ellipsoids."""
    px -= origin[0]
    py -= origin[1]
    pz -= origin[2]
    x = axes[0, 0] * px + axes[0, 1] * py + axes[0, 2] * pz
    y = axes[1, 0] * px + axes[1, 1] * py + axes[1, 2] * pz
    z = axes[2, 0] * px + axes[2, 1] * py + axes[2, 2] * pz
    if kind == CAPSULE:
        length, r0, r1 = size[0], size[1], size[2]
        radial = np.sqrt(x * x + y * y)
        b = (r0 - r1) / length
        a = np.sqrt(1.0 - b * b)
        along = radial * -b + z * a
        if along < 0.0:
            return np.sqrt(radial * radial + z * z) - r0
        if along > a * length:
            return np.sqrt(radial * radial + (z - length) ** 2) - r1
        return radial * a + z * b - r0
    if kind == ELLIPSOID:
        x, y, z = x / size[0], y / size[1], z / size[2]
        rho = np.sqrt(x * x + y * y + z * z)
        steep = np.sqrt((x / size[0]) ** 2 + (y / size[1]) ** 2 + (z / size[2]) ** 2)
        if steep < 1e-9:
            return -min(size[0], size[1], size[2])
        return rho * (rho - 1.0) / steep
    length, exponent = size[0], size[3]
    inside = min(max(z, 0.0), length)
    where = inside / length * (table.shape[0] - 1)
    i = min(int(where), table.shape[0] - 2)
    w = where - i
    x -= table[i, 4] * (1 - w) + table[i + 1, 4] * w
    y -= table[i, 5] * (1 - w) + table[i + 1, 5] * w
    cx, cy = (0 if x > 0 else 1), (2 if y < 0 else 3)
    rx = table[i, cx] * (1 - w) + table[i + 1, cx] * w
    ry = table[i, cy] * (1 - w) + table[i + 1, cy] * w
    over = z - inside
    rz = size[1] if over < 0 else size[2]
    x, y, z = abs(x) / rx, abs(y) / ry, abs(over) / rz
    if exponent == 2.0:  # spares limbs the powers below
        rho = np.sqrt(x * x + y * y + z * z)
        if rho < 1e-6:
            return -min(rx, ry)
        return (rho - 1.0) * rho / np.sqrt((x / rx) ** 2 + (y / ry) ** 2 + (z / rz) ** 2)
    rho = (x**exponent + y**exponent + z**exponent) ** (1.0 / exponent)
    if rho < 1e-6:
        return -min(rx, ry)
    e = exponent - 1.0
    steep = np.sqrt((x**e / rx) ** 2 + (y**e / ry) ** 2 + (z**e / rz) ** 2) / rho**e
    return (rho - 1.0) / steep


@njit(cache=True, nogil=True)
def _blend(a, b, k):
    """Quadratic smooth minimum; for k < 0 the smooth difference a - b."""
    if k < 0.0:
        h = max(-k - abs(a + b), 0.0) / -k
        return max(a, -b) - h * h * k * 0.25
    h = max(k - abs(a - b), 0.0) / k
    return min(a, b) - h * h * k * 0.25


@njit(cache=True, nogil=True)
def _fill_grid(begin, end, solid, start, cell, floor_blend, values):
    """``values`` (nx, ny, nz) float32: the blended field at start + index * cell."""
    for i in range(begin, end):
        _fill_slice(i, solid, start, cell, floor_blend, values)


@njit(cache=True, nogil=True)
def _fill_slice(i, solid, start, cell, floor_blend, values):
    kind, blend, origin, axes, size, table, low, high = solid
    ny, nz = values.shape[1:]
    px = start[0] + i * cell
    values[i] = FAR
    for p in range(kind.shape[0]):
        if px < low[p, 0] or px > high[p, 0]:
            continue
        j0 = max(int(np.ceil((low[p, 1] - start[1]) / cell)), 0)
        j1 = min(int((high[p, 1] - start[1]) / cell) + 1, ny)
        k0 = max(int(np.ceil((low[p, 2] - start[2]) / cell)), 0)
        k1 = min(int((high[p, 2] - start[2]) / cell) + 1, nz)
        for j in range(j0, j1):
            py = start[1] + j * cell
            for k in range(k0, k1):
                d = _primitive(kind[p], origin[p], axes[p], size[p], table[p], px, py, start[2] + k * cell)
                values[i, j, k] = _blend(values[i, j, k], d, blend[p])
    for k in range(nz):
        z = start[2] + k * cell
        if z < 0.03:
            for j in range(ny):
                values[i, j, k] = -_blend(-values[i, j, k], z, floor_blend)


@njit(cache=True, nogil=True)
def _project(begin, end, solid, floor_blend, points, step, limit, normals):
    """One damped Newton step of each point towards the zero set, in place; the field's unit gradient to ``normals``."""
    for i in range(begin, end):
        _project_one(i, solid, floor_blend, points, step, limit, normals)


@njit(cache=True, nogil=True)
def _project_one(i, solid, floor_blend, points, step, limit, normals):
    kind, blend, origin, axes, size, table, low, high = solid
    x, y, z = points[i, 0], points[i, 1], points[i, 2]
    # The field at the corners of a tetrahedron about the point gives value and gradient.
    a = b = c = d = FAR
    for p in range(kind.shape[0]):
        if low[p, 0] <= x <= high[p, 0] and low[p, 1] <= y <= high[p, 1] and low[p, 2] <= z <= high[p, 2]:
            k, o, r, s, t = kind[p], origin[p], axes[p], size[p], table[p]
            a = _blend(a, _primitive(k, o, r, s, t, x + step, y - step, z - step), blend[p])
            b = _blend(b, _primitive(k, o, r, s, t, x - step, y + step, z - step), blend[p])
            c = _blend(c, _primitive(k, o, r, s, t, x - step, y - step, z + step), blend[p])
            d = _blend(d, _primitive(k, o, r, s, t, x + step, y + step, z + step), blend[p])
    a, b = -_blend(-a, z - step, floor_blend), -_blend(-b, z - step, floor_blend)
    c, d = -_blend(-c, z + step, floor_blend), -_blend(-d, z + step, floor_blend)
    gx, gy, gz = (a - b - c + d) / (4 * step), (b - a - c + d) / (4 * step), (c - a - b + d) / (4 * step)
    norm = np.sqrt(gx * gx + gy * gy + gz * gz)
    if norm > 1e-6:
        gx, gy, gz = gx / norm, gy / norm, gz / norm
        move = min(max(-0.25 * (a + b + c + d) / norm, -limit), limit)
        points[i, 0], points[i, 1], points[i, 2] = x + move * gx, y + move * gy, z + move * gz
        normals[i, 0], normals[i, 1], normals[i, 2] = gx, gy, gz


@njit(cache=True, nogil=True)
def _nearest(solid, points, owner, local):
    kind, blend, origin, axes, size, table, low, high = solid
    for i in range(points.shape[0]):
        best = np.inf
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for p in range(kind.shape[0]):
            if blend[p] < 0.0:
                continue
            if low[p, 0] <= x <= high[p, 0] and low[p, 1] <= y <= high[p, 1] and low[p, 2] <= z <= high[p, 2]:
                d = _primitive(kind[p], origin[p], axes[p], size[p], table[p], x, y, z)
                if d < best:
                    best = d
                    owner[i] = p
        for a in range(3):
            q = axes[owner[i], a]
            o = origin[owner[i]]
            local[i, a] = q[0] * (x - o[0]) + q[1] * (y - o[1]) + q[2] * (z - o[2])


def nearest_primitive(solid: Primitives, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which primitive each of ``points`` (V, 3) lies on (V,) int32, and where on it (V, 3), local axes [m]."""
    owner = np.zeros(len(points), dtype=np.int32)
    local = np.empty((len(points), 3))
    _nearest(solid, points, owner, local)
    return owner, local


def surface(solid: Primitives, cell: float, floor_blend: float = 0.004) -> tuple[np.ndarray, np.ndarray]:
    """Closed triangle mesh of the solid above z = 0, by surface nets; its vertices lie on the zero set.

    Surface nets (Gibson 1998) put one vertex into each cell the surface crosses and one quad around each crossed grid
    edge. That is 2-manifold exactly when no cell holds two sheets; grid corners of such cells, which sit in grooves
    narrower than the grid, are filled first, so that the result is 2-manifold whatever the solid.

    Parameters
    ----------
    solid : Primitives
        What to mesh.
    cell : float
        Grid step [m].
    floor_blend : float
        Rounding where the solid is cut flat at z = 0 [m].

    Returns
    -------
    vertices : np.ndarray [shape=(V, 3), dtype=float64]
    triangles : np.ndarray [shape=(T, 3), dtype=int32]
        Counter-clockwise seen from outside.
    """
    start = solid.low.min(axis=0) - 2.013 * cell
    start[2] = -2.513 * cell
    counts = np.ceil((solid.high.max(axis=0) + 2 * cell - start) / cell).astype(int) + 1
    values = np.empty(tuple(counts), dtype=np.float32)
    each_range(_fill_grid, len(values), solid, start, cell, floor_blend, values)
    points, quads = surface_nets(values)
    points = start + points * cell
    edges = np.concatenate((quads[:, :2], quads[:, 1:3], quads[:, 2:], quads[:, ::3]))
    degree = np.bincount(edges.ravel(), minlength=len(points))[:, None]
    normals = np.zeros_like(points)
    for relax in (True, True, False):
        each_range(_project, len(points), solid, floor_blend, points, 0.1 * cell, 0.5 * cell, normals)
        if relax:
            mean = np.empty_like(points)
            for a in range(3):
                mean[:, a] = np.bincount(edges[:, 0], points[edges[:, 1], a], len(points))
                mean[:, a] += np.bincount(edges[:, 1], points[edges[:, 0], a], len(points))
            shift = mean / degree - points
            points += 0.5 * (shift - (shift * normals).sum(axis=1, keepdims=True) * normals)
    each_range(_project, len(points), solid, floor_blend, points, 0.02 * cell, 0.5 * cell, normals)
    return points, split_quads(points, quads)
