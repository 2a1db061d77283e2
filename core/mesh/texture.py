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
