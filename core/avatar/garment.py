"""A garment on an avatar: a single open surface that the avatar's skeleton moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mesh import Mesh
from .pose import SkinWeights


@dataclass(frozen=True)
class Garment:
    """What an avatar wears.

    Parameters
    ----------
    name : str
    mesh : Mesh
        Of V vertices and T triangles, in the avatar's frame and rest pose; open, the outside seen from outside [m].
    weights : SkinWeights
        Of its vertices, for the avatar's skeleton.
    pinned : np.ndarray [shape=(V,), dtype=float32]
        1 where cloth keeps to what the skeleton says, 0 where it falls freely.
    tight : bool
        The skeleton alone moves it; it is not meant to fall as cloth.
    uv : np.ndarray [shape=(T, 3, 2), dtype=float32] or None
        Place of each corner in an image, 0..1, v upwards.
    """

    name: str
    mesh: Mesh
    weights: SkinWeights
    pinned: np.ndarray
    tight: bool = False
    uv: np.ndarray | None = None
