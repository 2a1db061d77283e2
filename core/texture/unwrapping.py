"""The skin cut, laid flat and packed: where each triangle lies in the image."""

from __future__ import annotations

import numpy as np

from ..avatar.pose import SkinWeights
from ..mesh import Mesh
from ..mesh.submesh import remove_bowties, renumbered
from ..numeric.threads import each
from .flattening import flatten, flipped
from .islands import find_islands, halved, is_disk
from .packing import pack


def unwrap(mesh: Mesh, weights: SkinWeights | None, gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Places (T, 3, 2) float32 of the triangles' corners in the image, and their islands (T,) int32.

    No triangle is flipped, and islands neither meet themselves nor one another.

    Parameters
    ----------
    mesh : Mesh
        A manifold, maybe with boundaries.
    weights : SkinWeights or None
        Of its vertices.
    gap : float
        Room that each island keeps about it, in parts of the image's side.
    """
    label = find_islands(mesh, weights)
    waiting = [np.flatnonzero(label == k) for k in range(int(label.max()) + 1)]
    pieces, flats, rows = [], [], []
    while waiting:
        laid = each(lambda piece: _laid_flat(mesh, piece), waiting)
        again = []
        for piece, (flat, triangles) in zip(waiting, laid, strict=True):
            if flat is None:
                again.extend(halved(mesh, piece))
                continue
            pieces.append(piece)
            flats.append(flat)
            rows.append(triangles)
        waiting = again
    places = pack(flats, rows, gap)
    uv = np.empty((len(mesh.triangles), 3, 2), np.float32)
    island = np.empty(len(mesh.triangles), np.int32)
    order = sorted(range(len(pieces)), key=lambda k: int(pieces[k][0]))
    for number, k in enumerate(order):
        uv[pieces[k]] = places[k][rows[k]]
        island[pieces[k]] = number
    return uv, island


def _laid_flat(mesh: Mesh, piece: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:
    """Places (V, 2) of a piece's vertices, None where it must be cut, and its triangles in their numbers."""
    used, own = renumbered(mesh.triangles[piece], len(mesh.vertices))
    part = remove_bowties(Mesh(mesh.vertices[used], own))
    if not is_disk(own, len(used)):
        return None, own
    return flatten(part.vertices, part.triangles), part.triangles


def flipped_count(uv: np.ndarray) -> int:
    """How many of the triangles ``uv`` (T, 3, 2) are clockwise or without area in the image."""
    return int(flipped(uv.reshape(-1, 2).astype(np.float64), np.arange(3 * len(uv)).reshape(-1, 3)).sum())
