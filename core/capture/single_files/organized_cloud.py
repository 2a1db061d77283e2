"""Organized point clouds: the grid of pixels is kept, the camera is not; it is fitted from the points."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np

from ...camera import Intrinsics
from ...errors import CaptureError, Notice
from ..depth_units import background_limit

_SAMPLE = 40_000
_MIN_POINTS = 200


def depth_of_cloud(
    path: Path, points: np.ndarray, unit_m: float | None
) -> tuple[np.ndarray, Intrinsics, tuple[str, ...]]:
    """Depth map and camera of an organized cloud.

    A pinhole images x/z to u = fx x/z + cx. Which axis is z, and where the others point, is tried: the arrangement
    with the smallest median error is taken, so clouds with z up or backward are read like any other.

    Parameters
    ----------
    points : np.ndarray [shape=(H, W, 3), float]
        NaN, infinite or all zero where there is no reading.
    unit_m : float or None
        Metres of one unit; None takes millimetres when the median depth is beyond 100, else metres.

    Returns
    -------
    depth : np.ndarray [shape=(1, H, W), dtype=float32]
        z [m].
    camera : Intrinsics
    notes : tuple of str

    Raises
    ------
    CaptureError
        When the points are no view through a pinhole.
    """
    height, width = points.shape[:2]
    with np.errstate(all="ignore"):
        good = np.isfinite(points).all(axis=2) & (np.abs(points) < 1e9).all(axis=2) & points.any(axis=2)
    flat = np.flatnonzero(good)
    if len(flat) < _MIN_POINTS:
        raise CaptureError(
            f"{path}: has {len(flat)} points with a reading; check that the depth stream was on", code="empty"
        )
    chosen = flat[:: max(1, len(flat) // _SAMPLE)]
    sample = points.reshape(-1, 3)[chosen].astype(np.float64)
    v, u = np.divmod(chosen, width)
    best = None
    for right, down, forward in itertools.permutations(range(3)):
        sign = np.sign(np.median(sample[:, forward])) or 1.0
        z = sample[:, forward] * sign
        ahead = z > 1e-6 * np.abs(sample).max()
        if ahead.mean() < 0.99:
            continue
        across = _line(sample[ahead, right] / z[ahead], u[ahead])
        along = _line(sample[ahead, down] / z[ahead], v[ahead])
        if across is None or along is None:
            continue
        error = across[2] + along[2]
        if best is None or error < best[0]:
            best = error, (right, down, forward), sign, across, along
    if best is None or best[0] > 1.0:
        fit = "no camera" if best is None else f"within {best[0]:.1f} px"
        raise CaptureError(
            f"{path}: its points are not what one camera sees pixel by pixel ({fit}); "
            "save the cloud organized and in the camera's own frame",
            code="not_a_capture",
        )
    _, axes, sign, (fx, cx, _), (fy, cy, _) = best
    if not (0.1 * width <= abs(fx) <= 50 * width and 0.1 * height <= abs(fy) <= 50 * height):
        raise CaptureError(
            f"{path}: its points give no focal length a depth camera has ({fx:.0f}, {fy:.0f} px)", code="lens_wrong"
        )
    z = points[..., axes[2]] * sign
    depth = np.where(good & (np.where(good, z, 0) > 0), z, 0).astype(np.float32)
    notes: list[str] = [Notice("intrinsics fitted from the points, within {error:.2f} px", error=best[0] / 2)]
    # The rotation from the cloud's axes to right, down, forward: a reflection means that left and right are exchanged.
    rotation = np.zeros((3, 3))
    rotation[0, axes[0]], rotation[1, axes[1]], rotation[2, axes[2]] = np.sign(fx), np.sign(fy), sign
    if np.linalg.det(rotation) < 0:
        notes.append("the cloud's axes are left-handed; if left and right are exchanged, set mirrored")
    if unit_m is None:
        unit_m = 0.001 if np.median(depth[(depth > 0) & (depth < background_limit(depth))]) > 100 else 1.0
        if unit_m == 0.001:
            notes.append("coordinates taken for millimetres")
    depth = depth if unit_m == 1 else depth * np.float32(unit_m)
    return depth[None], Intrinsics(width, height, abs(fx), abs(fy), cx, cy), tuple(notes)


def _line(ratio: np.ndarray, pixel: np.ndarray) -> tuple[float, float, float] | None:
    """Slope and offset of pixel = f ratio + c, least squares after one rejection, and the median error [px]."""
    keep = np.ones(len(ratio), bool)
    for _ in range(2):
        r, p = ratio[keep], pixel[keep]
        spread = r.var() if len(r) > 10 else 0.0
        if not np.isfinite(spread) or spread < 1e-12 or not p.var():
            return None
        slope = ((r - r.mean()) * (p - p.mean())).mean() / spread
        offset = p.mean() - slope * r.mean()
        error = np.abs(slope * ratio + offset - pixel)
        keep = error <= 5 * np.median(error) + 1e-9
    # coordinates stored as float32 leave some 1e-4 px; round values that lie within reach are what was meant
    slope, offset = (round(n * 2) / 2 if abs(n - round(n * 2) / 2) < 2e-3 else n for n in (slope, offset))
    return float(slope), float(offset), float(np.median(error))
