"""The paper's matching (4.2.2).

Boundary loops split where the coronal and sagittal planes meet, every pairing tried.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..numeric.point_products import dot
from .dtw import Warping, dtw

_CHAIN_SAMPLE = 120  # vertices of a chain by which its partner is decided


@dataclass(frozen=True)
class Chain:
    """Half of a patch's outer boundary loop, from one split point to the other.

    ``vertices`` (N,) in the boundary's own direction; ``patch`` is the patch's number.
    """

    patch: int
    vertices: np.ndarray


def split_loop(
    points: np.ndarray, loop: np.ndarray, up: np.ndarray, axis: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Split a loop at its top and bottom: where it comes nearest to the line in which coronal and sagittal plane meet.

    Parameters
    ----------
    points : np.ndarray [shape=(V, 3)]
        Mesh vertices [m].
    loop : np.ndarray [shape=(N,)]
        Boundary loop.
    up, axis : np.ndarray [shape=(3,)]
        Direction of that line, and a point on it.

    Returns
    -------
    (first, second) or None
        Both chains in the loop's direction, sharing their end vertices; None when the loop has no two ends.
    """
    offset = points[loop] - axis
    height = dot(offset, up)
    aside = np.linalg.norm(offset - height[:, None] * up, axis=1)
    reach = np.ptp(height)
    if reach == 0:
        return None
    # near the line counts, and near that end of the figure
    top = int(np.argmin(aside + 2.0 * (height.max() - height)))
    bottom = int(np.argmin(aside + 2.0 * (height - height.min())))
    low, high = sorted((top, bottom))
    if high - low < 2 or low + len(loop) - high < 2:
        return None
    return loop[low : high + 1], np.concatenate((loop[high:], loop[: low + 1]))


def pairings(owners: list[int]) -> Iterator[list[tuple[int, int]]]:
    """Every way to pair all items such that no two of a pair have the same owner."""
    if not owners:
        yield []
        return

    def pair(left: tuple[int, ...]) -> Iterator[list[tuple[int, int]]]:
        if not left:
            yield []
            return
        first, others = left[0], left[1:]
        for k, other in enumerate(others):
            if owners[first] != owners[other]:
                for rest in pair(others[:k] + others[k + 1 :]):
                    yield [(first, other), *rest]

    yield from pair(tuple(range(len(owners))))


def match_chains(points: np.ndarray, chains: list[Chain]) -> list[tuple[Chain, Chain, Warping]]:
    """Try every possible match of the chains and keep the one of least accumulated DTW distance (paper 4.2.2).

    Returns
    -------
    list of (a, b, warping)
        ``warping`` matches a's vertices with b's taken backwards. Empty when the chains cannot all be paired. Which
        go together is judged on some hundred vertices of each: O(C² + C · N²) time for C chains of N vertices.
    """
    thin = [points[chain.vertices[:: max(1, len(chain.vertices) // _CHAIN_SAMPLE)]] for chain in chains]
    pairs = [(i, j) for i, j in combinations(range(len(chains)), 2) if chains[i].patch != chains[j].patch]
    distance = {(i, j): dtw(thin[i], thin[j][::-1]).distance for i, j in pairs}
    best = min(pairings([chain.patch for chain in chains]), key=lambda way: sum(distance[p] for p in way), default=[])
    return [(chains[i], chains[j], dtw(points[chains[i].vertices], points[chains[j].vertices[::-1]])) for i, j in best]


def solidity(labels: np.ndarray, view: int = 0) -> float:
    """Share of a view's silhouette, row by row from its leftmost to its rightmost pixel, that is filled.

    Near 1 for a compact figure; limbs held off the body and spread legs leave gaps in the rows.
    """
    mine = labels == view
    rows = mine.any(axis=1)
    if not rows.any():
        return 0.0
    first, last = mine[rows].argmax(axis=1), mine.shape[1] - mine[rows, ::-1].argmax(axis=1)
    return float(mine.sum() / (last - first).sum())


def outer_chains(
    points: np.ndarray, loops: list[np.ndarray], first: np.ndarray, up: np.ndarray, axis: np.ndarray
) -> list[Chain]:
    """Both chains of every patch's longest boundary loop; none at all if one has no ends.

    Parameters
    ----------
    points : np.ndarray [shape=(V, 3)]
        Vertices of all patches, one after the other [m].
    loops : list of np.ndarray
        All their boundary loops, the longest first.
    first : np.ndarray [shape=(P+1,)]
        Where each patch's vertices begin, and the last one's end.
    up, axis : np.ndarray [shape=(3,)]
        As for :func:`split_loop`.
    """
    owner = np.searchsorted(first, [loop[0] for loop in loops], side="right") - 1
    chains = []
    for number in range(len(first) - 1):
        if first[number] == first[number + 1]:
            continue
        own = np.flatnonzero(owner == number)
        halves = split_loop(points, loops[own[0]], up, axis) if len(own) else None
        if halves is None:
            return []
        chains += [Chain(number, half) for half in halves]
    return chains
