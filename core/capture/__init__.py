"""What a camera wrote, as one data type: :class:`Capture`. ``open_capture(path)`` picks the reader."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..camera import Intrinsics
from ..errors import CaptureError


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


def open_capture(path: str | os.PathLike, frames: int | None = None) -> Capture:
    """Read what a depth camera wrote, whatever the format; the content decides, not the name.

    Parameters
    ----------
    path : path
        An RGB-D folder (:mod:`.rgbd_folder`).
    frames : int or None
        Read only that many depth frames from the start of a burst; None reads all.

    Raises
    ------
    CaptureError, MirrorError
        When nothing is there, no reader knows it, or its content is at fault.
    """
    from . import rgbd_folder  # readers import this module for its types

    readers = (rgbd_folder,)  # a reader has recognises(path) and read(path, frames)
    path = Path(path)
    if frames is not None and frames < 1:
        raise CaptureError(f"{path}: at least one frame must be read, not {frames}")
    if not path.exists():
        raise CaptureError(f"{path}: there is no such file or folder")
    for reader in readers:
        if reader.recognises(path):
            return reader.read(path, frames)
    raise CaptureError(f"{path}: is not a capture; give a folder that holds intrinsic.json and depth/*.png")
