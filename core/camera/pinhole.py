"""Camera: intrinsics with lens distortion, unproject and project. Camera frame: x right, y down, z forward."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import CaptureError


@dataclass(frozen=True)
class Intrinsics:
    """Intrinsics in pixels; integer coordinates are pixel centres.

    Parameters
    ----------
    width, height : int
        Image size the values below belong to.
    fx, fy, cx, cy : float
        Focal lengths and principal point [px].
    distortion : tuple of float
        Brown's lens model in OpenCV's order: ``(k1, k2, p1, p2)``, then ``k3``, then ``(k4, k5, k6)`` of the rational
        model (D. C. Brown 1966; OpenCV's calib3d). Empty for a pinhole, which is what every capture that was opened
        has; see :func:`distort` for the formula.

    Raises
    ------
    CaptureError
        When a size or focal length is not positive, a value is not finite, or the distortion has not 0, 4, 5 or 8
        coefficients.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise CaptureError(f"intrinsics: image size {self.width}×{self.height} is not positive", code="lens_wrong")
        if not np.isfinite((self.fx, self.fy, self.cx, self.cy)).all() or self.fx <= 0 or self.fy <= 0:
            raise CaptureError(
                f"intrinsics: focal lengths must be positive numbers, got fx={self.fx}, fy={self.fy}, "
                f"cx={self.cx}, cy={self.cy}",
                code="lens_wrong",
            )
        object.__setattr__(self, "distortion", tuple(float(k) for k in self.distortion))
        if len(self.distortion) not in (0, 4, 5, 8) or not np.isfinite(self.distortion).all():
            raise CaptureError(
                "intrinsics: distortion must be 0, 4, 5 or 8 finite numbers (k1 k2 p1 p2, k3, k4 k5 k6), "
                f"got {len(self.distortion)}",
                code="lens_wrong",
            )

    @property
    def packed(self) -> np.ndarray:
        """Focal lengths and image centre fx, fy, cx, cy [px], for kernels."""
        return np.array((self.fx, self.fy, self.cx, self.cy))

    @property
    def is_pinhole(self) -> bool:
        """Whether straight lines stay straight: no distortion coefficient differs from zero."""
        return not any(self.distortion)

    def pinhole(self) -> Intrinsics:
        """The same camera without its distortion."""
        return replace(self, distortion=())

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
            self.distortion,
        )


def distort(rays: np.ndarray, distortion: tuple[float, ...]) -> np.ndarray:
    """Where a lens images the direction (x, y, 1): ideal to distorted coordinates on the plane z = 1.

    With r² = x² + y² and radial = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶)::

        x' = x radial + 2 p1 x y + p2 (r² + 2 x²)
        y' = y radial + p1 (r² + 2 y²) + 2 p2 x y

    Parameters
    ----------
    rays : np.ndarray [shape=(..., 2)]
        Ideal coordinates x/z, y/z.
    distortion : tuple of float
        As in :class:`Intrinsics`.

    Returns
    -------
    np.ndarray [shape=(..., 2), dtype=float64]
    """
    rays = np.asarray(rays, dtype=np.float64)
    if not any(distortion):
        return rays.copy()
    k1, k2, p1, p2, k3, k4, k5, k6 = padded(distortion)
    x, y = rays[..., 0], rays[..., 1]
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    return np.stack(
        (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y),
        axis=-1,
    )


def undistort(rays: np.ndarray, distortion: tuple[float, ...], iterations: int = 30) -> np.ndarray:
    """Inverse of :func:`distort`, by Newton's method from the undistorted guess.

    Parameters
    ----------
    rays : np.ndarray [shape=(..., 2)]
        Distorted coordinates on the plane z = 1.
    distortion : tuple of float
        As in :class:`Intrinsics`.

    Returns
    -------
    np.ndarray [shape=(..., 2), dtype=float64]
        Ideal coordinates; NaN where none was found: beyond the field the lens model holds for.
    """
    target = np.asarray(rays, dtype=np.float64)
    if not any(distortion):
        return target.copy()
    # Strong rational models fold back beyond their calibrated field. Only the branch through the centre is a lens,
    # so the radius grows from zero with the target: each step aims at a larger fraction of it.
    ideal = np.zeros_like(target)
    with np.errstate(all="ignore"):
        for step in range(iterations):
            fraction = min(1.0, (step + 1) / (0.5 * iterations))
            miss = target * fraction - distort(ideal, distortion)
            along_x, along_y, mixed = _slope(ideal, distortion)
            area = along_x * along_y - mixed * mixed
            ideal = (
                ideal
                + np.stack(
                    (along_y * miss[..., 0] - mixed * miss[..., 1], along_x * miss[..., 1] - mixed * miss[..., 0]),
                    axis=-1,
                )
                / np.where(area > 1e-12, area, np.nan)[..., None]
            )  # beyond the fold there is no way back
        good = np.abs(distort(ideal, distortion) - target).max(axis=-1) < 1e-9
    return np.where(good[..., None], ideal, np.nan)


def padded(distortion: tuple[float, ...]) -> tuple[float, ...]:
    """All eight coefficients (k1, k2, p1, p2, k3, k4, k5, k6)."""
    return tuple(distortion) + (0.0,) * (8 - len(distortion))


def _slope(rays: np.ndarray, distortion: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Jacobian of :func:`distort`, which is symmetric: dx'/dx, dy'/dy and dx'/dy = dy'/dx."""
    k1, k2, p1, p2, k3, k4, k5, k6 = padded(distortion)
    x, y = rays[..., 0], rays[..., 1]
    r2 = x * x + y * y
    over, under = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    radial = over / under
    growth = ((k1 + r2 * (2 * k2 + r2 * 3 * k3)) - radial * (k4 + r2 * (2 * k5 + r2 * 3 * k6))) / under  # d radial/d r²
    return (
        radial + 2 * x * x * growth + 2 * p1 * y + 6 * p2 * x,
        radial + 2 * y * y * growth + 6 * p1 * y + 2 * p2 * x,
        2 * x * y * growth + 2 * p1 * x + 2 * p2 * y,
    )


def brown_of_inverse(inverse: tuple[float, ...], intrinsics: Intrinsics) -> tuple[float, ...]:
    """Brown's coefficients (k1, k2, p1, p2, k3) of a lens whose *inverse* is given so, as RealSense's colour has it.

    Least squares over the image; the model is linear in its coefficients.
    """
    u, v = np.meshgrid(np.linspace(0, intrinsics.width - 1, 33), np.linspace(0, intrinsics.height - 1, 25))
    distorted = np.stack(((u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy), axis=-1).reshape(
        -1, 2
    )
    ideal = distort(distorted, inverse)
    x, y = ideal.T
    r2 = x * x + y * y
    rows = [
        np.column_stack((x * r2, x * r2**2, 2 * x * y, r2 + 2 * x * x, x * r2**3)),
        np.column_stack((y * r2, y * r2**2, r2 + 2 * y * y, 2 * x * y, y * r2**3)),
    ]
    solution = np.linalg.lstsq(np.vstack(rows), (distorted - ideal).T.ravel(), rcond=None)[0]
    return tuple(float(k) for k in solution)


def is_rigid(pose: np.ndarray) -> bool:
    """Whether a matrix is a rotation, within a hundredth, and a shift: (4, 4), finite, last row 0 0 0 1."""
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or np.abs(pose[3] - (0, 0, 0, 1)).max() > 1e-6:
        return False
    rotation = pose[:3, :3]
    return bool(np.abs(rotation @ rotation.T - np.eye(3)).max() <= 1e-2 and np.linalg.det(rotation) > 0)


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
        Camera-frame points [m]; the origin where there is no reading, NaN beyond the field of a distorting lens.

    Raises
    ------
    CaptureError
        When the sizes differ.
    """
    height, width = depth.shape
    if (width, height) != (intrinsics.width, intrinsics.height):
        raise CaptureError(
            f"the depth map is {width}×{height}, its intrinsics are for {intrinsics.width}×{intrinsics.height}; "
            "use the intrinsics of this resolution",
            code="lens_wrong",
        )
    if intrinsics.is_pinhole:
        from ..numeric.point_products import lay_grid  # here: to name intrinsics must not cost the import of numba

        return lay_grid(depth, intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy)
    z = depth.astype(np.float64)
    points = np.empty((height, width, 3))
    points[..., :2] = np.where((z > 0)[..., None], rays_of_pixels(intrinsics) * z[..., None], 0)
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
    x, y = points[..., 0] / z, points[..., 1] / z
    if not intrinsics.is_pinhole:
        x, y = np.moveaxis(distort(np.stack((x, y), axis=-1), intrinsics.distortion), -1, 0)
    return np.stack((x * intrinsics.fx + intrinsics.cx, y * intrinsics.fy + intrinsics.cy), axis=-1)


def rays_of_pixels(intrinsics: Intrinsics) -> np.ndarray:
    """Ideal coordinates x/z, y/z of every pixel centre (H, W, 2) float64; NaN beyond the field of the lens model."""
    rays = np.empty((intrinsics.height, intrinsics.width, 2))
    rays[..., 0] = (np.arange(intrinsics.width) - intrinsics.cx) / intrinsics.fx
    rays[..., 1] = ((np.arange(intrinsics.height) - intrinsics.cy) / intrinsics.fy)[:, None]
    return undistort(rays, intrinsics.distortion)
