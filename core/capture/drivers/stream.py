"""What a running camera gives: :class:`Stream`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...camera import Intrinsics


@dataclass(frozen=True)
class Stream:
    """A camera that is running.

    Parameters
    ----------
    intrinsics : Intrinsics
        Pinhole of the depth frames.
    sensor : str
        As in :class:`..capture.Capture`: ``realsense_d435``, …, or ``unknown``.
    frames : iterator of (depth, color)
        ``depth`` (H, W) float32 z [m], 0 = no reading; ``color`` (H, W, 3) uint8 sRGB aligned to depth, or None.
        Endless; ends when the camera is gone.
    color_intrinsics : Intrinsics or None
        Given where ``color`` is not aligned to depth but the colour camera's own image, (Hc, Wc, 3): its intrinsics,
        distorted or not.
    depth_to_color : np.ndarray [shape=(4, 4)] or None
        Then: takes points [m] of the depth camera's frame into the colour camera's.
    """

    intrinsics: Intrinsics
    sensor: str
    frames: Iterator[tuple[np.ndarray, np.ndarray | None]]
    color_intrinsics: Intrinsics | None = None
    depth_to_color: np.ndarray | None = None


def straight_stream(camera: Intrinsics, sensor: str, frames: Iterator[tuple[np.ndarray, np.ndarray | None]]) -> Stream:
    """The stream of a camera whose depth images have its lens's distortion: each is straightened as it comes.

    Parameters
    ----------
    camera : Intrinsics
        Of the depth frames as they come.
    sensor : str
    frames : iterator of (depth, color)
        Colour aligned to depth, or None.
    """
    if camera.is_pinhole:
        return Stream(camera, sensor, frames)
    from ...camera.image_registration import straightened, undistort_color, undistort_depth  # brings numba

    straight = straightened(camera)
    return Stream(straight, sensor, (
        (undistort_depth(depth[None], camera, straight)[0],
         None if color is None else undistort_color(color, camera, straight))
        for depth, color in frames
    ))  # fmt: skip
