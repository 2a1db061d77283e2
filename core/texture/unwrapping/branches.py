"""Flat islands that branch, such as a trunk with its limbs, cut into parts that leave less of the image empty.

Islands of bones are compact. A thing is cut by the side it faces alone: its front with all that sticks out is one
island, and little of the rectangle around that is used.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...mesh.half_edges import twins
from ...mesh.submesh import remove_bowties, renumbered
from ...mesh.triangle_mesh import Mesh
from .disks import is_disk, without_small

_ANGLES = 12  # of cuts, and of the boxes by which they are judged
_PLACES = 17  # of cuts, along each direction
_MOST = 38  # islands
_WORTH = 0.02  # of all islands' area: a cut must save so much
_LOOKED_AT = 3000  # triangles' middles by which a cut is judged
_SLIVER = 0.02  # of an island: a smaller part stays with its neighbour


class FlatIsland(NamedTuple):
    """Which triangles of the mesh (T,), where their vertices lie (V, 2) [m], and the triangles in these (T, 3)."""

    piece: np.ndarray
    flat: np.ndarray
    triangles: np.ndarray


def without_branches(islands: list[FlatIsland]) -> list[FlatIsland]:
    """Islands cut straight across where that saves most, one after the other, until they are many or little is saved.

    What a cut saves is the difference between the least rectangle around the whole and those around its parts.
    """
    islands = list(islands)
    area = sum(_areas(island).sum() for island in islands)
    saved = [_best_cut(island) for island in islands]
    while len(islands) < _MOST:
        best = int(np.argmax([gain for gain, _ in saved]))
        gain, beyond = saved[best]
        if gain < _WORTH * area:
            break
        parts = _cut(islands[best], beyond)
        if not 1 < len(parts) <= _MOST - len(islands) + 1:
            saved[best] = (0.0, beyond)
            continue
        del islands[best], saved[best]
        islands += parts
        saved += [_best_cut(part) for part in parts]
    return islands


def _areas(island: FlatIsland) -> np.ndarray:
    a, b, c = (island.flat[island.triangles[:, k]] for k in range(3))
    return 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def _best_cut(island: FlatIsland) -> tuple[float, np.ndarray]:
    """What the best straight cut saves [m²], and which triangles (T,) lie beyond it."""
    middle = island.flat[island.triangles].mean(axis=1)
    some = middle[:: max(1, len(middle) // _LOOKED_AT)]
    angle = np.pi * np.arange(_ANGLES) / _ANGLES
    axes = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    along = some @ axes.T  # (N, A)
    around = 2.0 * np.sqrt(_areas(island).sum() / len(some))  # what lies beyond the outermost middles
    whole = _least_box(np.ptp(along, axis=0) + around)
    best, cut = 0.0, None
    for a in range(_ANGLES):
        order = along[:, a].argsort()
        places = along[order, a]
        sorted_along = along[order]
        low, high = np.minimum.accumulate(sorted_along), np.maximum.accumulate(sorted_along)
        low_behind = np.minimum.accumulate(sorted_along[::-1])[::-1]
        high_behind = np.maximum.accumulate(sorted_along[::-1])[::-1]
        levels = places[0] + (places[-1] - places[0]) * (1 + np.arange(_PLACES)) / (_PLACES + 1)
        for level, at in zip(levels, np.searchsorted(places, levels), strict=True):
            if not 0 < at < len(places):
                continue
            one, other = high[at - 1] - low[at - 1], high_behind[at] - low_behind[at]
            parts = _least_box(one + around) + _least_box(other + around)
            if whole - parts > best:
                best, cut = whole - parts, (a, level)
    if cut is None:
        return 0.0, np.zeros(len(middle), np.bool_)
    return best, middle @ axes[cut[0]] > cut[1]


def _least_box(extents: np.ndarray) -> float:
    """Area of the least rectangle by extents (A,) in directions evenly over half a turn."""
    return float((extents * np.roll(extents, -_ANGLES // 2)).min())


def _cut(island: FlatIsland, beyond: np.ndarray) -> list[FlatIsland]:
    """Connected parts on both sides of a cut, slivers joined to what they hang on; the whole where one is no disk."""
    twin = twins(island.triangles, len(island.flat))
    label = without_small(beyond.astype(np.int64), twin, _areas(island), _SLIVER)
    parts = []
    for k in range(int(label.max()) + 1):
        own = label == k
        used, triangles = renumbered(island.triangles[own], len(island.flat))
        if not is_disk(triangles, len(used)):
            return [island]
        places = np.column_stack((island.flat[used], np.zeros(len(used))))
        part = remove_bowties(Mesh(places, triangles))
        parts.append(FlatIsland(island.piece[own], part.vertices[:, :2], part.triangles))
    return parts
