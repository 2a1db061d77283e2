"""A burst of depth frames → one depth map.

Everything averages in inverse depth: a stereo or structured-light camera measures disparity, so its error is even
there, and a plane in space is a linear function of (u, v) there, so local fits do not bend slanted surfaces.
"""

from __future__ import annotations

import numpy as np

from ..errors import CaptureError
from ..numeric.kernels import njit
from ..numeric.threads import each_range
from .settings import DepthSettings


def fuse_burst(depth: np.ndarray, settings: DepthSettings = DepthSettings()) -> tuple[np.ndarray, np.ndarray]:
    """One depth map from a burst of a still subject: the mean disparity of the readings that agree with their median.

    Parameters
    ----------
    depth : np.ndarray [shape=(F, H, W)]
        z [m], 0 (or NaN) = no reading.
    settings : DepthSettings
        ``min_depth``, ``max_depth``, ``burst_tolerance`` and ``burst_share`` are used.

    Returns
    -------
    fused : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    spread : np.ndarray [shape=(H, W), dtype=float32]
        Standard deviation over the frames, relative to z; 0 where fewer than two frames agree.

    Raises
    ------
    CaptureError
        When the array is not (F, H, W) or holds no reading at all within the depth limits.

    Notes
    -----
    O(F log F) a pixel, O(H W) memory.
    """
    depth = np.asarray(depth, dtype=np.float32)
    if depth.ndim != 3 or 0 in depth.shape:
        raise CaptureError(
            f"depth must be frames × height × width, got an array of shape {depth.shape}", code="not_a_capture"
        )
    needed = max(1, int(np.ceil(settings.burst_share * len(depth))))
    fused, spread = np.zeros(depth.shape[1:], np.float32), np.zeros(depth.shape[1:], np.float32)
    low, high, tolerance = settings.min_depth, settings.max_depth, settings.burst_tolerance
    each_range(_fuse_kernel, depth.shape[1], np.ascontiguousarray(depth), low, high, tolerance, needed, fused, spread)
    if not fused.any():
        raise CaptureError(
            f"no depth reading between {settings.min_depth:g} and {settings.max_depth:g} m in any of {len(depth)} "
            "frames; "
            "check that the depth images are 16-bit millimetres and the camera was not covered",
            code="unit",
        )
    return fused, spread


@njit(cache=True, nogil=True, error_model="numpy")
def _fuse_kernel(begin, end, depth, low, high, tolerance, needed, fused, spread):
    frames, _, width = depth.shape
    readings, number = np.empty(frames, np.float32), np.empty(width, np.int32)
    nearest_of, farthest_of = np.empty(width, np.float32), np.empty(width, np.float32)
    total_of, squares_of = np.empty(width), np.empty(width)
    for v in range(begin, end):
        # Sums over the row a frame at a time: most pixels need no more, and this the compiler vectorises.
        for u in range(width):
            number[u], nearest_of[u], farthest_of[u], total_of[u], squares_of[u] = 0, np.inf, 0.0, 0.0, 0.0
        for f in range(frames):
            row = depth[f, v]
            for u in range(width):
                z = row[u]
                good = (z >= low) & (z <= high)  # false for NaN
                d = 1.0 / (z if good else np.inf)
                number[u] += np.int32(good)
                nearest_of[u] = min(nearest_of[u], z if good else np.float32(np.inf))
                farthest_of[u] = max(farthest_of[u], z if good else np.float32(0.0))
                total_of[u] += d
                squares_of[u] += d * d
        for u in range(width):
            n = number[u]
            if n < needed:
                continue
            nearest, farthest, total, squares = nearest_of[u], farthest_of[u], total_of[u], squares_of[u]
            kept = n
            if farthest > (1.0 + tolerance) * nearest:  # else all agree with their median, whichever it is
                n = 0
                for f in range(frames):
                    z = depth[f, v, u]
                    if low <= z <= high:
                        readings[n] = z
                        n += 1
                for f in range(1, n):  # insertion sort: bursts are short
                    z = readings[f]
                    k = f
                    while k > 0 and readings[k - 1] > z:
                        readings[k] = readings[k - 1]
                        k -= 1
                    readings[k] = z
                median = readings[n // 2]
                total = squares = 0.0
                kept = 0
                for k in range(n):
                    d = 1.0 / readings[k]
                    if abs(d * median - 1.0) <= tolerance:
                        total += d
                        squares += d * d
                        kept += 1
                if kept < needed:
                    continue
            mean = total / kept
            fused[v, u] = 1.0 / mean
            if kept > 1:
                spread[v, u] = np.sqrt(max(squares / kept - mean * mean, 0.0) * kept / (kept - 1)) / mean
