"""The surface where a field on a grid changes sign: surface nets (Gibson 1998)."""

from __future__ import annotations

import numpy as np

CORNERS = np.array([(i >> 2 & 1, i >> 1 & 1, i & 1) for i in range(8)])
"""Of a cell, in the order of the bits of its code."""


def surface_nets(values: np.ndarray, least: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Vertices in grid units (V, 3) and outward quads (Q, 4) int32 where ``values`` changes sign; manifold, closed.

    ``values`` (nx, ny, nz) is negative inside, positive on the grid's outermost layer; it is changed in place at
    the corners of cells that would hold two sheets, and where it is smaller than ``least``, to that. With a ``least``
    above 0 no two vertices are in one place: around a point of the grid that lies on the surface all would be.
    """
    if least:
        near = np.abs(values) < least
        values[near] = np.where(values[near] < 0, -least, least)
    codes = _codes(values < 0)
    bad = _two_sheets()
    while len(cells := np.argwhere(bad[codes])):
        corners = cells[:, None, :] + CORNERS
        at = values[tuple(np.moveaxis(corners, -1, 0))]
        shallow = np.where(at < 0, np.inf, at).argmin(axis=1)
        values[tuple(corners[np.arange(len(cells)), shallow].T)] = -max(least, 1e-6)
        codes = _codes(values < 0)

    active = (codes != 0) & (codes != 255)
    cells = np.argwhere(active)
    index = np.full(active.shape, -1, dtype=np.int32)
    index[active] = np.arange(len(cells), dtype=np.int32)

    at = values[tuple(np.moveaxis(cells[:, None, :] + CORNERS, -1, 0))].astype(np.float64)
    total, crossed = np.zeros((len(cells), 3)), np.zeros(len(cells))
    for a in range(8):
        for b in (a | 1, a | 2, a | 4):
            if b != a:
                cut = (at[:, a] < 0) != (at[:, b] < 0)
                s = np.where(cut, at[:, a] / np.where(cut, at[:, a] - at[:, b], 1.0), 0.0)[:, None]
                total += np.where(cut[:, None], CORNERS[a] + s * (CORNERS[b] - CORNERS[a]), 0.0)
                crossed += cut
    vertices = cells + total / crossed[:, None]

    inside = values < 0
    quads = []
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        head = np.take(inside, range(values.shape[axis] - 1), axis=axis)
        tail = np.take(inside, range(1, values.shape[axis]), axis=axis)
        edge = np.argwhere(head != tail)
        step_one, step_two = np.eye(3, dtype=int)[one], np.eye(3, dtype=int)[two]
        ring = [edge - step_one - step_two, edge - step_two, edge, edge - step_one]
        quad = np.stack([index[tuple(cell.T)] for cell in ring], axis=1)
        leaving = head[tuple(edge.T)]
        quads.append(np.where(leaving[:, None], quad, quad[:, ::-1]))
    return vertices, np.concatenate(quads)


def split_quads(points: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Two triangles a quad, along its shorter diagonal: (Q, 4) -> (2 Q, 3) int32."""
    p = points[quads]
    short = ((p[:, 0] - p[:, 2]) ** 2).sum(axis=1) <= ((p[:, 1] - p[:, 3]) ** 2).sum(axis=1)
    turned = np.where(short[:, None], quads, np.roll(quads, -1, axis=1))
    return np.ascontiguousarray(np.concatenate((turned[:, [0, 1, 2]], turned[:, [0, 2, 3]])), dtype=np.int32)


def _codes(inside: np.ndarray) -> np.ndarray:
    """Per cell one bit a corner, set inside: (nx, ny, nz) bool -> (nx-1, ny-1, nz-1) uint8."""
    nx, ny, nz = inside.shape
    codes = np.zeros((nx - 1, ny - 1, nz - 1), dtype=np.uint8)
    for bit, (i, j, k) in enumerate(CORNERS):
        codes |= inside[i : nx - 1 + i, j : ny - 1 + j, k : nz - 1 + k].view(np.uint8) << np.uint8(bit)
    return codes


def _two_sheets() -> np.ndarray:
    """Whether the inside or the outside corners of each of the 256 cell codes are unconnected along cell edges."""

    def connected(corners: set[int]) -> bool:
        reached, front = set(), list(corners)[:1]
        while front:
            corner = front.pop()
            if corner not in reached:
                reached.add(corner)
                front += [corner ^ bit for bit in (1, 2, 4) if corner ^ bit in corners]
        return reached == corners

    split = [{b for b in range(8) if code >> b & 1} for code in range(256)]
    return np.array([not (connected(s) and connected(set(range(8)) - s)) for s in split])
