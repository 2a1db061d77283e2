"""A surface at some distance around a body, with creases bridged as cloth bridges them: a closing of the body."""

from __future__ import annotations

import numpy as np

from ..mesh import Mesh
from ..mesh.bvh import build_bvh, closest_point
from ..mesh.submesh import compact

_EDGES = np.array(
    [(0, 1), (0, 2), (0, 4), (1, 3), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 6), (5, 7), (6, 7)]
)  # corners of a cell that differ in one axis; corner = x + 2 y + 4 z


def offset_surface(mesh: Mesh, ease: np.ndarray | float, closing: float, spacing: float) -> Mesh:
    """A closed surface around a closed mesh, an even mesh of about ``spacing`` edges, smooth in creases.

    The mesh is dilated by ease + closing and eroded by closing again (Serra 1982), by distances on a grid: a crease
    narrower than what a ball of the radius ``closing`` fits in is bridged. Only the outermost surface is kept.

    Parameters
    ----------
    mesh : Mesh
        Closed; may cross itself [m].
    ease : float or np.ndarray [shape=(V,)]
        Distance from the mesh, one for all or one a vertex, larger than half of ``spacing`` [m].
    closing : float
        Radius [m].
    spacing : float
        Of the grid [m].
    """
    vertices = np.ascontiguousarray(mesh.vertices, np.float64)
    triangles = np.ascontiguousarray(mesh.triangles, np.int32)
    easing = np.broadcast_to(np.asarray(ease, np.float64), (len(vertices),))
    margin = float(easing.max()) + closing + 2.5 * spacing
    low = vertices.min(axis=0) - margin
    counts = np.ceil((vertices.max(axis=0) + margin - low) / spacing).astype(int) + 1
    axes = [low[k] + spacing * np.arange(counts[k]) for k in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    distance, triangle, _ = closest_point(build_bvh(vertices, triangles), points, margin)
    wide = easing[triangles].mean(axis=1)[np.maximum(triangle, 0)] + closing
    dilated = np.where(triangle < 0, np.inf, distance - wide).reshape(counts)  # positive: outside, or deep inside
    outside = reached_from_border(dilated > 0)
    dilated = np.where(outside, np.minimum(dilated, spacing), -np.minimum(np.abs(dilated), spacing))
    hull = zero_surface(dilated, low, spacing)

    distance, triangle, _ = closest_point(build_bvh(hull.vertices, hull.triangles), points, closing + 2 * spacing)
    distance = np.minimum(distance, closing + 2 * spacing).reshape(counts)
    return zero_surface(closing - np.where(outside, -distance, distance), low, spacing)


def reached_from_border(free: np.ndarray) -> np.ndarray:
    """Which free cells (X, Y, Z) bool hang together with the border of the grid, over faces."""
    reached = np.zeros_like(free)
    for axis in range(3):
        for end in (0, -1):
            place: list = [slice(None)] * 3
            place[axis] = end
            reached[tuple(place)] = free[tuple(place)]
    count = -1
    while count != (count := int(reached.sum())):
        for axis in range(3):
            for backwards in (False, True):
                reached = _swept(reached, free, axis, backwards)
    return reached


def _swept(reached: np.ndarray, free: np.ndarray, axis: int, backwards: bool) -> np.ndarray:
    """What is reached by going on along one axis, through free cells, from what is reached already."""
    if backwards:
        reached, free = np.flip(reached, axis), np.flip(free, axis)
    shape = [1, 1, 1]
    shape[axis] = -1
    place = np.arange(free.shape[axis]).reshape(shape)
    last_reached = np.maximum.accumulate(np.where(reached, place, -1), axis=axis)
    last_blocked = np.maximum.accumulate(np.where(free, -1, place), axis=axis)
    out = reached | (free & (last_reached > last_blocked))
    return np.flip(out, axis) if backwards else out


def zero_surface(values: np.ndarray, low: np.ndarray, spacing: float) -> Mesh:
    """Where values (X, Y, Z) on a grid are 0, negative values inside: surface nets (Gibson 1998).

    One vertex a cell, in the middle of where the surface crosses the cell's edges; quads around the crossed edges of
    the grid, cut along their shorter diagonal.
    """
    inside = values < 0
    shape = np.array(values.shape) - 1
    corners = [
        (slice(x, shape[0] + x), slice(y, shape[1] + y), slice(z, shape[2] + z))
        for z in (0, 1) for y in (0, 1) for x in (0, 1)
    ]  # fmt: skip
    held = sum(inside[corner].astype(np.int8) for corner in corners)
    cells = np.flatnonzero(((held > 0) & (held < 8)).ravel())
    at = np.stack(np.unravel_index(cells, shape), axis=1)
    offsets = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    own = np.stack([values[corner].ravel()[cells] for corner in corners], axis=1)
    first, second = own[:, _EDGES[:, 0]], own[:, _EDGES[:, 1]]
    crossed = (first < 0) != (second < 0)
    share = np.where(crossed, first / np.where(crossed, first - second, 1.0), 0.0)
    places = offsets[_EDGES[:, 0]] + share[..., None] * (offsets[_EDGES[:, 1]] - offsets[_EDGES[:, 0]])
    middle = (places * crossed[..., None]).sum(axis=1) / crossed.sum(axis=1)[:, None]
    vertices = low + spacing * (at + middle)
    number = np.full(int(np.prod(shape)), -1)
    number[cells] = np.arange(len(cells))
    number = number.reshape(shape)
    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        ahead: list = [slice(None)] * 3
        ahead[axis] = slice(1, None)
        behind: list = [slice(None)] * 3
        behind[axis] = slice(None, -1)
        a, b = inside[tuple(behind)], inside[tuple(ahead)]
        edges = np.argwhere(a != b)
        outwards = a[tuple(edges.T)]
        around = []
        for du, dv in ((-1, -1), (0, -1), (0, 0), (-1, 0)):
            cell = edges.copy()
            cell[:, u] += du
            cell[:, v] += dv
            around.append(number[tuple(cell.T)])
        quad = np.stack(around, axis=1)
        quads.append(np.where(outwards[:, None], quad, quad[:, ::-1]))
    return compact(Mesh(vertices, _halved(vertices, np.concatenate(quads))))


def _halved(vertices: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Triangles (2 Q, 3) int32 of quads (Q, 4), cut along the shorter diagonal."""
    corners = vertices[quads]
    first = np.linalg.norm(corners[:, 0] - corners[:, 2], axis=1)
    turned = np.where((first > np.linalg.norm(corners[:, 1] - corners[:, 3], axis=1))[:, None],
                      np.roll(quads, -1, axis=1), quads)  # fmt: skip
    return np.concatenate((turned[:, (0, 1, 2)], turned[:, (0, 2, 3)])).astype(np.int32)
