"""Pinhole camera: intrinsics, unproject and project. Camera frame: x right, y down, z forward."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .errors import CaptureError


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole intrinsics in pixels; integer coordinates are pixel centres.

    Parameters
    ----------
    width, height : int
        Image size the values below belong to.
    fx, fy, cx, cy : float
        Focal lengths and principal point [px].

    Raises
    ------
    CaptureError
        When a size or focal length is not positive, or a value is not finite.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise CaptureError(f"intrinsics: image size {self.width}×{self.height} is not positive")
        if not np.isfinite((self.fx, self.fy, self.cx, self.cy)).all() or self.fx <= 0 or self.fy <= 0:
            raise CaptureError(
                f"intrinsics: focal lengths must be positive numbers, got fx={self.fx}, fy={self.fy}, "
                f"cx={self.cx}, cy={self.cy}"
            )

    def scaled(self, width: int, height: int) -> Intrinsics:
        """The same camera sampled at another resolution (pixel centres at integers)."""
        sx, sy = width / self.width, height / self.height
        return Intrinsics(
            width,
            height,
            self.fx * sx,
            self.fy * sy,
            (self.cx + 0.5) * sx - 0.5,
            (self.cy + 0.5) * sy - 0.5,
        )


def unproject(depth: np.ndarray, intrinsics: Intrinsics) -> np.ndarray:
    """Points of a depth map in the camera frame.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W)]
        z of each pixel [m]; 0 where there is no reading.
    intrinsics : Intrinsics
        Of the same size as ``depth``.

    Returns
    -------
    np.ndarray [shape=(H, W, 3), dtype=float64]
        Camera-frame points [m]; the origin where there is no reading.

    Raises
    ------
    CaptureError
        When the sizes differ.
    """
    height, width = depth.shape
    if (width, height) != (intrinsics.width, intrinsics.height):
        raise CaptureError(
            f"the depth map is {width}×{height}, its intrinsics are for {intrinsics.width}×{intrinsics.height}; "
            "use the intrinsics of this resolution"
        )
    z = depth.astype(np.float64)
    points = np.empty((height, width, 3))
    points[..., 0] = (np.arange(width) - intrinsics.cx) / intrinsics.fx * z
    points[..., 1] = ((np.arange(height) - intrinsics.cy) / intrinsics.fy)[:, None] * z
    points[..., 2] = z
    return points


def project(points: np.ndarray, intrinsics: Intrinsics) -> np.ndarray:
    """Pixel coordinates (u, v) of camera-frame points.

    Parameters
    ----------
    points : np.ndarray [shape=(..., 3)]
        Camera-frame points [m], in front of the camera (z > 0).
    intrinsics : Intrinsics
        The camera.

    Returns
    -------
    np.ndarray [shape=(..., 2), dtype=float64]
        Pixels; NaN for points not in front of the camera.
    """
    points = np.asarray(points, dtype=np.float64)
    z = np.where(points[..., 2] > 0, points[..., 2], np.nan)
    return np.stack(
        (points[..., 0] / z * intrinsics.fx + intrinsics.cx, points[..., 1] / z * intrinsics.fy + intrinsics.cy),
        axis=-1,
    )
