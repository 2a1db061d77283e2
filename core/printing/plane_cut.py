"""A closed mesh cut at a height: what is above, and the loops where it is open then."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..mesh.boundary_loops import boundary_loops

_CLEAR = 1e-3  # vertices nearer to the plane are lifted to that [mm], so that no cut edge has no length


class Cut(NamedTuple):
    """What is above a horizontal plane.

    Attributes
    ----------
    vertices : np.ndarray [shape=(V, 3), dtype=float64]
    triangles : np.ndarray [shape=(T, 3), dtype=int32]
    ends : np.ndarray [shape=(V, 2), dtype=int64]
        Vertices of the whole mesh on whose edge each lies; twice the same where it is one of them.
    share : np.ndarray [shape=(V,), dtype=float64]
        Of the way from the first to the second.
    loops : list of np.ndarray
        Vertices on the plane, each loop in the direction of the triangles above: seen from above, material is to the
        left.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    ends: np.ndarray
    share: np.ndarray
    loops: list[np.ndarray]


def cut_above(vertices: np.ndarray, triangles: np.ndarray, height: float) -> Cut:
    """Keep what of a closed mesh is above z = ``height``.

    Parameters
    ----------
    vertices : np.ndarray [shape=(V, 3)]
        [mm].
    triangles : np.ndarray [shape=(T, 3)]
    height : float
        [mm].
    """
    vertices = vertices.copy()
    near = np.abs(vertices[:, 2] - height) < _CLEAR
    vertices[near, 2] = height + _CLEAR
    above = vertices[:, 2] > height
    count = above[triangles].sum(axis=1)
    whole = triangles[count == 3].astype(np.int64)

    one = _first(triangles[count == 1], above)  # corner 0 is the one above
    two = _first(triangles[count == 2], ~above)  # corner 0 is the one below
    edges = np.concatenate((one[:, [0, 1]], one[:, [0, 2]], two[:, [1, 0]], two[:, [2, 0]]))  # above, below
    edges, inverse = np.unique(edges, axis=0, return_inverse=True)
    new = np.split(len(vertices) + inverse.ravel(), np.cumsum((len(one), len(one), len(two))))
    made = [
        np.column_stack((one[:, 0], new[0], new[1])),
        np.column_stack((two[:, 1], two[:, 2], new[3])),
        np.column_stack((two[:, 1], new[3], new[2])),
    ]
    share = (vertices[edges[:, 0], 2] - height) / (vertices[edges[:, 0], 2] - vertices[edges[:, 1], 2])
    points = vertices[edges[:, 0]] + share[:, None] * (vertices[edges[:, 1]] - vertices[edges[:, 0]])
    points[:, 2] = height
    itself = np.arange(len(vertices))
    used, corners = np.unique(np.concatenate((whole, *made)), return_inverse=True)
    corners = corners.reshape(-1, 3).astype(np.int32)
    ends = np.concatenate((np.column_stack((itself, itself)), edges))[used]
    return Cut(
        np.concatenate((vertices, points))[used],
        corners,
        ends,
        np.concatenate((np.zeros(len(vertices)), share))[used],
        [loop for loop in boundary_loops(corners, len(used)) if len(loop) > 2],
    )


def _first(triangles: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Triangles turned so that the corner that is ``chosen`` comes first."""
    at = chosen[triangles].argmax(axis=1)
    return np.take_along_axis(triangles, (at[:, None] + np.arange(3)) % 3, axis=1).astype(np.int64)
