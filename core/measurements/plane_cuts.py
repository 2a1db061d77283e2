"""A mesh cut by a plane: where it is crossed, and which crossings hang together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..numeric.point_products import dot
from ..numeric.rotations import unit
from ..numeric.union_find import connected_labels


@dataclass(frozen=True)
class PlaneCut:
    """Segments in which a plane crosses triangles; a closed mesh gives closed loops.

    Parameters
    ----------
    points : np.ndarray [shape=(P, 3), dtype=float64]
        Where edges are crossed, each edge once [m].
    segments : np.ndarray [shape=(S, 2), dtype=int64]
        Ends of each segment, by the place in ``points``.
    triangle : np.ndarray [shape=(S,), dtype=int64]
        Which triangle each segment lies in.
    edge : np.ndarray [shape=(P, 2), dtype=int64]
        The vertices of each crossed edge.
    at : np.ndarray [shape=(P,), dtype=float64]
        Where on its edge a point lies: 0 at the first vertex, 1 at the second.
    """

    points: np.ndarray
    segments: np.ndarray
    triangle: np.ndarray
    edge: np.ndarray
    at: np.ndarray

    def values(self, of_vertices: np.ndarray) -> np.ndarray:
        """Values (V,) of vertices at the points (P,), linear along edges."""
        first, second = of_vertices[self.edge[:, 0]], of_vertices[self.edge[:, 1]]
        return first + self.at * (second - first)

    def loops(self) -> np.ndarray:
        """Which loop each point (P,) belongs to, numbered from 0."""
        label = connected_labels(self.segments[:, 0], self.segments[:, 1], len(self.points))
        return np.unique(label, return_inverse=True)[1].reshape(-1)

    def loop_about(self, point: np.ndarray, normal: np.ndarray, loops: np.ndarray) -> int:
        """The largest of ``loops`` (P,) that runs round ``point`` (3,), a point of the plane; -1 when there is none.

        One runs round it when a ray from there crosses it an odd number of times.
        """
        first, second = plane_axes(normal)
        offset = self.points - point
        x, y = ((offset * axis).sum(axis=1)[self.segments].T for axis in (first, second))
        crosses = (y[0] >= 0.0) != (y[1] >= 0.0)
        where = x[0] - y[0] * (x[1] - x[0]) / np.where(crosses, y[1] - y[0], 1.0)
        crossings = np.bincount(loops[self.segments[crosses & (where > 0.0), 0]], minlength=loops.max(initial=-1) + 1)
        around = crossings % 2 == 1
        return int(np.where(around, np.bincount(loops, minlength=len(around)), 0).argmax()) if around.any() else -1

    def is_closed(self) -> bool:
        """Whether there are points and each has its two segments, so that no loop is open."""
        return bool(len(self.points) and (np.bincount(self.segments.ravel(), minlength=len(self.points)) == 2).all())

    def part(self, kept: np.ndarray) -> PlaneCut:
        """The cut with the points ``kept`` (P,) bool, and the segments between two of them."""
        place = np.cumsum(kept) - 1
        inside = kept[self.segments].all(axis=1)
        return PlaneCut(
            self.points[kept], place[self.segments[inside]], self.triangle[inside], self.edge[kept], self.at[kept]
        )


def plane_axes(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors square to ``normal`` (3,) and to each other."""
    normal = unit(np.asarray(normal, dtype=np.float64))
    helper = np.zeros(3)
    helper[np.abs(normal).argmin()] = 1.0
    first = unit(np.cross(helper, normal))
    return first, np.cross(normal, first)


def cut_by_plane(vertices: np.ndarray, triangles: np.ndarray, point: np.ndarray, normal: np.ndarray) -> PlaneCut:
    """The cut of a mesh by a plane. O(V + T).

    A vertex on the plane counts as above it, so that no loop is open and no segment without length is missing.

    Parameters
    ----------
    vertices : np.ndarray [shape=(V, 3)]
        In metres.
    triangles : np.ndarray [shape=(T, 3), dtype=int]
        All, or those that matter.
    point, normal : np.ndarray [shape=(3,)]
        Of the plane; the normal has any length but 0.
    """
    height = dot(vertices - point, normal)
    above = height >= 0.0
    first = above[triangles[:, 0]]
    crossed = np.flatnonzero((above[triangles[:, 1]] != first) | (above[triangles[:, 2]] != first))
    corners = triangles[crossed].astype(np.int64)
    sides = above[corners]
    ahead = np.roll(sides, -1, axis=1)
    rows = np.arange(len(crossed))
    ends = []
    for changes in (sides & ~ahead, ~sides & ahead):  # each once round a triangle
        side = changes.argmax(axis=1)
        ends.append(np.sort(np.stack((corners[rows, side], corners[rows, (side + 1) % 3]), axis=1), axis=1))
    both = np.concatenate(ends)
    keys, place = np.unique(both[:, 0] * len(vertices) + both[:, 1], return_inverse=True)
    edge = np.stack((keys // len(vertices), keys % len(vertices)), axis=1)
    low, high = height[edge[:, 0]], height[edge[:, 1]]
    at = low / np.where(low == high, 1.0, low - high)
    points = vertices[edge[:, 0]] + at[:, None] * (vertices[edge[:, 1]] - vertices[edge[:, 0]])
    return PlaneCut(points, place.reshape(2, -1).T, crossed, edge, at)
