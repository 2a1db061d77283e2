"""What a camera wrote, as one data type: :class:`Capture`. ``open_capture(path)`` picks the reader."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..camera import Intrinsics


@dataclass(frozen=True)
class MirrorPicks:
    """What is known of one mirror before it is fitted, as ``mirrors.json`` holds it.

    Either points picked on its frame (``frame_pixels`` (K, 2) float64, (u, v) [px]) or a known plane
    (``point`` (3,), ``normal`` (3,), camera frame [m]).
    """

    name: str
    frame_pixels: np.ndarray | None = None
    point: np.ndarray | None = None
    normal: np.ndarray | None = None


@dataclass(frozen=True)
class Capture:
    """One snapshot (or a burst of a still subject) of one depth camera.

    Parameters
    ----------
    depth : np.ndarray [shape=(F, H, W), dtype=float32]
        z of each pixel [m], 0 = no reading.
    color : np.ndarray [shape=(H, W, 3), dtype=uint8] or None
        sRGB, aligned to the depth map.
    intrinsics : Intrinsics
        Of the depth map.
    mirrors : tuple of MirrorPicks
        What the capture itself says about its mirrors; empty when it says nothing.
    name, format : str
        For messages and reports.
    """

    depth: np.ndarray
    color: np.ndarray | None
    intrinsics: Intrinsics
    mirrors: tuple[MirrorPicks, ...] = field(default=())
    name: str = "capture"
    format: str = "unknown"
