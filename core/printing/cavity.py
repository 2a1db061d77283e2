"""The hollow inside of a print: the surface a wall's thickness below that of the body, and holes to drain it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..mesh.bvh import Bvh, closest_point
from ..mesh.self_intersections import self_intersections
from ..mesh.soundness import volume
from ..mesh.submesh import compact, triangle_components
from ..mesh.triangle_mesh import Mesh
from ..numeric.isosurface import split_quads, surface_nets

_CELLS_A_WALL = 3.0
_MOST_CELLS = 12_000_000
_APART = 0.05  # of a cell: no point of the grid lies nearer to the cavity's surface, so that files keep vertices apart
_LEAST_WIDTH = 3.0  # a cavity smaller than a cube of that many walls is not worth its risks


class Grid(NamedTuple):
    """Points in space: ``low`` + index · ``cell`` [mm], ``shape`` of them."""

    low: np.ndarray
    cell: float
    shape: tuple[int, int, int]

    def points(self, index: np.ndarray) -> np.ndarray:
        """Where the points with ``index`` (N, 3) are."""
        return self.low + self.cell * index


def grid_around(vertices: np.ndarray, wall: float) -> Grid:
    """A grid with room around a mesh, fine enough for a wall, of at most about 12 million points."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    cell = max(wall / _CELLS_A_WALL, float((np.prod(high - low) / _MOST_CELLS) ** (1 / 3)))
    shape = np.ceil((high - low) / cell).astype(int) + 6
    return Grid(low - cell * np.array((2.513, 2.487, 2.531)), cell, tuple(shape.tolist()))


def solid_points(vertices: np.ndarray, triangles: np.ndarray, grid: Grid) -> np.ndarray:
    """Which points of the grid lie within a closed mesh: its surface winds around them, bool of the grid's shape.

    Each triangle is drawn onto the columns of the grid. An edge is judged by the same arithmetic from both its
    triangles, and a column that meets it exactly as if it were moved by next to nothing (simulation of simplicity,
    Edelsbrunner and Mücke 1990), so that none passes between triangles or meets two.
    """
    xy = (vertices[:, :2] - grid.low[:2]) / grid.cell
    height = (vertices[:, 2] - grid.low[2]) / grid.cell
    corners = xy[triangles]
    first = np.maximum(np.ceil(corners.min(axis=1)), 0).astype(np.int64)
    last = np.minimum(np.floor(corners.max(axis=1)), np.array(grid.shape[:2]) - 1).astype(np.int64)
    wide = np.maximum(last - first + 1, 0)
    count = wide[:, 0] * wide[:, 1]
    triangle = np.repeat(np.arange(len(triangles)), count)
    number = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count)
    i = first[triangle, 0] + number // np.maximum(wide[triangle, 1], 1)
    j = first[triangle, 1] + number % np.maximum(wide[triangle, 1], 1)

    left = np.empty((3, len(triangle)))  # twice the areas against the three edges
    side = np.empty((3, len(triangle)), np.int8)
    for k in range(3):
        a, b = triangles[triangle, (k + 1) % 3], triangles[triangle, (k + 2) % 3]
        turned = a > b
        p, q = xy[np.where(turned, b, a)], xy[np.where(turned, a, b)]
        dx, dy = (q - p).T
        area = dx * (j - p[:, 1]) - dy * (i - p[:, 0])
        # a column on an edge counts as if it stood a little to the right of it, and much less behind it
        beside = np.where(dy != 0, -np.sign(dy), np.sign(dx))
        sign = np.where(turned, -1, 1)
        left[k] = sign * area
        side[k] = sign * np.where(area == 0, beside, np.sign(area))
    hit = (side == side[0]).all(axis=0) & (side[0] != 0)
    triangle, i, j, left, up = triangle[hit], i[hit], j[hit], left[:, hit], side[0, hit]
    total = left.sum(axis=0)
    z = (left * height[triangles[triangle]].T).sum(axis=0) / np.where(total == 0, 1, total)
    k = np.clip(np.ceil(z), 0, grid.shape[2] - 1).astype(np.int64)
    steps = np.zeros(grid.shape, np.int16)
    np.add.at(steps, (i, j, k), -up.astype(np.int16))  # upwards through a face that looks down one comes in
    return np.cumsum(steps, axis=2, dtype=np.int16) > 0


def cavity_field(tree: Bvh, wall: float, grid: Grid, solid: np.ndarray) -> np.ndarray:
    """Negative where the surface is more than ``wall`` away inside, float32 of the grid's shape [mm]."""
    reach = wall + 2 * grid.cell
    at = np.argwhere(solid)
    distance, _, _ = closest_point(tree, grid.points(at), reach)
    field = np.full(grid.shape, np.float32(wall))
    field[solid] = wall - np.minimum(distance, reach)
    return field


def drains(
    tree: Bvh, grid: Grid, solid: np.ndarray, field: np.ndarray, bottom: float,
    radius: float, wall: float,
) -> np.ndarray:  # fmt: skip
    """Where to drill from below, (N ≤ 2, 3): x, y and up to which height [mm]; where the cavity is low and roomy.

    All around a hole, and half a wall beyond it, the body goes down to the bottom without a gap.
    """
    hollow = field < 0
    floor = int(np.ceil((bottom - grid.low[2]) / grid.cell))
    reached = hollow.any(axis=2)
    if not reached.any():
        return np.empty((0, 3))
    first = np.where(reached, hollow.argmax(axis=2), grid.shape[2])
    gap = np.where((~solid[:, :, floor:]).any(axis=2), floor + (~solid[:, :, floor:]).argmax(axis=2), grid.shape[2])
    n = int(np.ceil((radius + wall / 2) / grid.cell))
    low = np.full(gap.shape, 0, gap.dtype)
    padded = np.pad(gap, n, constant_values=0)
    low[:] = grid.shape[2]
    for di in range(-n, n + 1):
        for dj in range(-n, n + 1):
            if di * di + dj * dj <= n * n:
                low = np.minimum(low, padded[n + di : n + di + gap.shape[0], n + dj : n + dj + gap.shape[1]])
    able = np.argwhere(reached & (low > first))
    if not len(able):
        return np.empty((0, 3))
    heights = first[able[:, 0], able[:, 1]]
    lowest = heights <= heights.min() + 0.15 * (grid.shape[2] - floor)
    able, heights = able[lowest], heights[lowest]
    points = grid.points(np.column_stack((able, heights + np.ceil(radius / grid.cell))))
    room, _, _ = closest_point(tree, points)
    best = [int(room.argmax())]
    away = np.linalg.norm(points[:, :2] - points[best[0], :2], axis=1) > 6 * radius
    if away.any():
        best.append(int(np.where(away, room, -1).argmax()))
    return points[best]


def drill(field: np.ndarray, grid: Grid, holes: np.ndarray, radius: float) -> None:
    """Join upright cylinders from below the grid to the field, in place; the outermost layer stays outside."""
    x = grid.low[0] + grid.cell * np.arange(grid.shape[0])[:, None, None]
    y = grid.low[1] + grid.cell * np.arange(grid.shape[1])[None, :, None]
    z = grid.low[2] + grid.cell * np.arange(grid.shape[2])[None, None, :]
    for hole in holes:
        cylinder = np.maximum(np.hypot(x - hole[0], y - hole[1]) - radius, z - hole[2])
        np.minimum(field, cylinder.astype(np.float32), out=field)
    field[:, :, 0] = np.maximum(field[:, :, 0], np.float32(grid.cell))


def cavity_surface(field: np.ndarray, grid: Grid, wall: float, below: float | None) -> Mesh | None:
    """The closed surface of the cavity, looking out of it; pieces too small to matter are left out.

    With ``below`` [mm] only pieces that go down there are kept: what cannot be drained stays solid.
    """
    if not (field < 0).any():
        return None
    points, quads = surface_nets(field, _APART * grid.cell)
    mesh = Mesh(grid.points(points), split_quads(points, quads))
    label, count = triangle_components(mesh.triangles, len(mesh.vertices))
    keep = np.zeros(count, np.bool_)
    for k in range(count):
        piece = Mesh(mesh.vertices, mesh.triangles[label == k])
        down = below is None or mesh.vertices[piece.triangles.ravel(), 2].min() < below
        keep[k] = down and volume(piece) > (_LEAST_WIDTH * wall) ** 3
    if not keep.any():
        return None
    return compact(Mesh(mesh.vertices, mesh.triangles[keep[label]]))


def moved_off(inner: Mesh, tree: Bvh, grid: Grid, wall: float, holes: np.ndarray, radius: float) -> Mesh:
    """The cavity's surface where it has its distance to the body's, which the grid blurs in narrow places.

    What a drill has made stays, and so does what would run through itself.
    """
    distance, _, nearest = closest_point(tree, inner.vertices, wall)
    near = distance < wall
    for hole in holes:
        near &= np.linalg.norm(inner.vertices[:, :2] - hole[:2], axis=1) > radius + 2 * grid.cell
    step = np.minimum(wall - distance[near], grid.cell) / np.maximum(distance[near], 1e-9)
    vertices = inner.vertices.copy()
    vertices[near] += step[:, None] * (vertices[near] - nearest[near])
    for _ in range(3):
        crossing = self_intersections(vertices, inner.triangles)
        if not len(crossing):
            return Mesh(vertices, inner.triangles)
        at = inner.triangles[np.unique(crossing)].ravel()
        vertices[at] = inner.vertices[at]
    return inner
