"""A texture: where each triangle lies in an image, and the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Texture:
    """An image laid on a mesh of T triangles.

    Parameters
    ----------
    uv : np.ndarray [shape=(T, 3, 2), dtype=float32]
        Place of each corner in the image, 0..1: u to the right, v upwards from the image's lower edge.
    image : np.ndarray [shape=(S, S, 3), dtype=uint8]
        sRGB, the upper row first.
    island : np.ndarray [shape=(T,), dtype=int32]
        Number of the island, 0.., that each triangle lies in. Within an island corners of one vertex agree.
    """

    uv: np.ndarray
    image: np.ndarray
    island: np.ndarray

    def split(self, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """:func:`split_at_seams` of the mesh's ``triangles`` (T, 3)."""
        return split_at_seams(triangles, self.uv)


def split_at_seams(triangles: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A vertex for each place in the image that a vertex of a mesh has, as most files want it.

    Parameters
    ----------
    triangles : np.ndarray [shape=(T, 3), dtype=int32]
    uv : np.ndarray [shape=(T, 3, 2), dtype=float32]
        Place of each corner, 0..1.

    Returns
    -------
    vertex : np.ndarray [shape=(W,), dtype=int64]
        Which vertex each of them is, ascending.
    place : np.ndarray [shape=(W, 2), dtype=float32]
        Where it lies in the image.
    corners : np.ndarray [shape=(T, 3), dtype=int32]
        The triangles in their numbers.
    """
    bits = np.ascontiguousarray(uv, np.float32).reshape(-1, 2).view(np.uint32).astype(np.uint64)
    key = bits[:, 0] << np.uint64(32) | bits[:, 1]
    flat = triangles.ravel().astype(np.int64)
    order = np.lexsort((key, flat))
    new = np.ones(len(order), np.bool_)
    new[1:] = (np.diff(flat[order]) != 0) | (key[order][1:] != key[order][:-1])
    number = np.empty(len(order), np.int32)
    number[order] = np.cumsum(new) - 1
    first = order[new]
    return flat[first], uv.reshape(-1, 2)[first].astype(np.float32), number.reshape(-1, 3)
