"""An object that is not a person: which of its pieces belong together, in all views."""

from __future__ import annotations

import numpy as np

from ..numeric.kernels import njit
from ..numeric.point_products import dot
from .connected_pixels import Pieces, of_pixels

_TOUCH_CELL = 0.03  # cells in space: pieces in the same one or in neighbours are connected [m]
_FEW = 2  # readings, and cells: fewer are noise
_BEHIND = 4  # px: a piece that begins so near to what hides it goes on behind it
_SIDES = 24  # of the polygon about a piece in the plan
_MARGIN = 0.02  # m


def group_pieces(pieces: Pieces, usable: np.ndarray) -> np.ndarray:
    """Which of the pieces that the views show are one object: a number (C,) each, the same for those of one object.

    Pieces are one object when they touch in space, in whichever views they are seen: a leg that a seat hides from the
    camera is seen to hold it in a mirror. And when one begins right where another hides it, below or above that other:
    a lamp's foot and its shade.

    Parameters
    ----------
    pieces : Pieces
        Of all views.
    usable : np.ndarray [shape=(C,), dtype=bool]
        The others are one object each: walls, noise.

    Returns
    -------
    np.ndarray [shape=(C,), dtype=int64]

    Notes
    -----
    O(P log P) of P pixels of usable pieces.
    """
    component, count, points, up = pieces.component, pieces.count, pieces.points, pieces.up
    group = np.arange(count)
    rows, columns = np.nonzero(of_pixels(usable, component))
    if not len(rows):
        return group
    piece, cloud = component[rows, columns], points[rows, columns]
    for a, b in _touching(piece, cloud):
        group[group == group[b]] = group[a]
    first = np.cross(up, (0.0, 0.0, 1.0))
    first /= np.linalg.norm(first)
    angles = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)
    normals = np.outer(np.cos(angles), first) + np.outer(np.sin(angles), np.cross(up, first))
    front, back, at = _hidden_kernel(component, pieces.depth, usable, points)
    reach = _reach_kernel(piece, cloud, normals, count)
    met = np.unique(piece)
    where = np.stack([dot(at, normal) for normal in normals], axis=1)
    while True:
        # about all that is known of the object already, in whichever view
        extent = np.full((count, _SIDES), -np.inf)
        np.maximum.at(extent, group[met], reach[met])
        under = (where < extent[group[front]] + _MARGIN).all(axis=1) & (group[front] != group[back])
        pairs, times = np.unique(
            np.column_stack((group[front[under]], group[back[under]])), axis=0, return_counts=True
        )  # fmt: skip
        hidden = pairs[times >= _FEW]
        if not len(hidden):
            return group
        a, b = hidden[np.argmax(times[times >= _FEW])]
        group[group == b] = a


def _touching(piece: np.ndarray, cloud: np.ndarray) -> np.ndarray:
    """Pairs of pieces (K, 2) that touch in space; which one (P,) each point (P, 3) belongs to."""
    place = np.floor((cloud - cloud.min(axis=0)) / _TOUCH_CELL).astype(np.int64) + 1
    size = place.max(axis=0) + 2
    cell = (place[:, 0] * size[1] + place[:, 1]) * size[2] + place[:, 2]
    most = int(piece.max()) + 1
    both, times = np.unique(cell * most + piece, return_counts=True)
    both = both[times >= _FEW]
    cell, piece = both // most, both % most
    found = []
    for x in (0, 1):
        for y in (-1, 0, 1):
            for z in (-1, 0, 1):
                if (x, y, z) < (0, 0, 0):
                    continue
                other = cell + (x * size[1] + y) * size[2] + z
                start, stop = np.searchsorted(cell, other), np.searchsorted(cell, other, side="right")
                for k in range(int((stop - start).max(initial=0))):
                    met = np.flatnonzero(start + k < stop)
                    found.append(np.column_stack((piece[met], piece[start[met] + k])))
    pairs = np.sort(np.concatenate(found), axis=1) if found else np.zeros((0, 2), np.int64)
    pairs, times = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0, return_counts=True)
    return pairs[times >= _FEW]


@njit(cache=True, nogil=True)
def _reach_kernel(piece, cloud, normals, count):
    """How far each piece reaches (C, K) along each normal (K, 3)."""
    out = np.full((count, len(normals)), -np.inf)
    for i in range(len(piece)):
        x, y, z = cloud[i, 0], cloud[i, 1], cloud[i, 2]
        for k in range(len(normals)):
            out[piece[i], k] = max(out[piece[i], k], normals[k, 0] * x + normals[k, 1] * y + normals[k, 2] * z)
    return out


@njit(cache=True, nogil=True)
def _hidden_kernel(component, depth, usable, points):
    """Where a piece begins at the outline of another one in front of it: both, and the point (K, 3) it begins at."""
    height, width = component.shape
    front, back, at = [0 for _ in range(0)], [0 for _ in range(0)], [(0.0, 0.0, 0.0) for _ in range(0)]
    for v in range(height):
        for u in range(width):
            k = component[v, u]
            if k < 0 or not usable[k]:
                continue
            for dv, du in ((0, 1), (0, -1), (1, 0), (-1, 0)):
                for step in range(1, _BEHIND + 1):
                    y, x = v + step * dv, u + step * du
                    if y < 0 or x < 0 or y >= height or x >= width:
                        break
                    j = component[y, x]
                    if j == k:
                        break
                    if j >= 0:
                        if usable[j] and depth[y, x] < depth[v, u]:
                            front.append(j)
                            back.append(k)
                            at.append((points[v, u, 0], points[v, u, 1], points[v, u, 2]))
                        break
    found = np.empty((len(at), 3))
    for i in range(len(at)):
        found[i, 0], found[i, 1], found[i, 2] = at[i]
    return np.array(front, np.int64), np.array(back, np.int64), found
