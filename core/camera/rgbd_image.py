"""A depth map with its colour and intrinsics: what most of the way works on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .pinhole import Intrinsics


@dataclass(frozen=True)
class RgbdImage:
    """One picture of a depth camera.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z of each pixel [m], camera frame; 0 = no reading.
    intrinsics : Intrinsics
        Of the depth map; a pinhole.
    color : np.ndarray [shape=(H, W, 3), dtype=uint8] or None
        sRGB, aligned to the depth map.
    """

    depth: np.ndarray
    intrinsics: Intrinsics
    color: np.ndarray | None = None

    def with_depth(self, depth: np.ndarray) -> RgbdImage:
        """The same picture with another depth map (H, W)."""
        return replace(self, depth=depth)

    def without_color(self) -> RgbdImage:
        """The depth map and its intrinsics alone."""
        return replace(self, color=None)
