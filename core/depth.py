"""A burst of depth frames → one depth map; flying pixels dropped, drop-outs closed, noise measured.

Everything averages in inverse depth: a stereo or structured-light camera measures disparity, so its error is even
there, and a plane in space is a linear function of (u, v) there, so local fits do not bend slanted surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange

from .errors import CaptureError


@dataclass(frozen=True)
class DepthSettings:
    """How a burst becomes one clean depth map. Every step can be turned off.

    Parameters
    ----------
    min_depth, max_depth : float
        Readings outside are dropped [m].
    burst_tolerance : float
        A frame's reading farther than this from the pixel's median is left out of the mean [relative, 1 = 100 %];
        ``inf`` takes the mean of all.
    burst_share : float
        A pixel needs a reading in at least this share of the frames [0..1].
    still_share : float
        Share of the subject that may have moved during a burst before that is told [0..1]; 1 does not look.
    sensor : str
        Name in :data:`.noise_models.SENSORS` of the camera whose noise model helps; "auto" takes what the capture says,
        or what steps in the readings betray; "unknown" goes by the readings alone.
    dequantise : bool
        Treat coarse disparity steps that noise does not average out as intervals.
    support : int
        Of its 8 neighbours, how many must continue a pixel's surface for it to stay; 0 keeps flying pixels.
    smoothing : float
        Multiplies the smoothing radius that the noise asks for; 0 turns smoothing off.
    max_radius : int
        Largest smoothing radius [px].
    close_gaps : int
        Drop-outs inside a surface up to this many pixels wide are closed; 0 leaves them.
    """

    min_depth: float = 0.2
    max_depth: float = 12.0
    burst_tolerance: float = 0.06
    burst_share: float = 0.3
    still_share: float = 0.08
    sensor: str = "auto"
    dequantise: bool = True
    support: int = 4
    smoothing: float = 1.0
    max_radius: int = 9
    close_gaps: int = 2


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
        raise CaptureError(f"depth must be frames × height × width, got an array of shape {depth.shape}")
    needed = max(1, int(np.ceil(settings.burst_share * len(depth))))
    fused, spread = _fuse_kernel(
        np.ascontiguousarray(depth), settings.min_depth, settings.max_depth, settings.burst_tolerance, needed
    )
    if not fused.any():
        raise CaptureError(
            f"no depth reading between {settings.min_depth:g} and {settings.max_depth:g} m in any of {len(depth)} "
            "frames; "
            "check that the depth images are 16-bit millimetres and the camera was not covered"
        )
    return fused, spread


@njit(cache=True, nogil=True, parallel=True, error_model="numpy")
def _fuse_kernel(depth, low, high, tolerance, needed):
    frames, height, width = depth.shape
    fused = np.zeros((height, width), np.float32)
    spread = np.zeros((height, width), np.float32)
    for v in prange(height):
        readings = np.empty(frames, np.float32)
        # Sums over the row a frame at a time: most pixels need no more, and this the compiler vectorises.
        number = np.zeros(width, np.int32)
        nearest_of, farthest_of = np.full(width, np.inf, np.float32), np.zeros(width, np.float32)
        total_of, squares_of = np.zeros(width), np.zeros(width)
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
    return fused, spread


def remove_flying_pixels(
    depth: np.ndarray, pixel_angle: float, settings: DepthSettings = DepthSettings()
) -> np.ndarray:
    """Drop readings that float between a surface and what is behind it.

    A reading stays when at least ``settings.support`` of its 8 neighbours continue its surface: lie within what a
    surface seen at up to 80° from head-on would span over that distance, and the noise measured on the map itself.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    pixel_angle : float
        1/f [1/px]: a pixel's width on a plane at 1 m.

    Returns
    -------
    np.ndarray [shape=(H, W), dtype=float32]
    """
    if settings.support <= 0:
        return depth
    variance = _residual_kernel(depth, np.where(depth > 0, 0, -1).astype(np.int8), 8)[::8]  # a sample of rows
    known = variance >= 0
    # noise relative to z grows in proportion to z for triangulating cameras; for others this is on the safe side
    growth = float(np.median(np.sqrt(variance[known]) / depth[::8][known])) if known.any() else 0.0
    return _flying_kernel(depth, pixel_angle * np.tan(np.radians(80.0)), 3.0 * growth, settings.support)


@njit(cache=True, nogil=True, parallel=True, error_model="numpy")
def _flying_kernel(depth, slope, noise, support):
    height, width = depth.shape
    out = np.empty_like(depth)
    framed = np.zeros((height + 2, width + 2), np.float32)  # no pixel needs to ask whether it lies at the border
    framed[1:-1, 1:-1] = depth
    beside, across = np.float32(slope + 0.003), np.float32(slope * np.sqrt(2.0) + 0.003)
    growth, most = np.float32(noise), np.float32(0.99)  # so that no reading is never near
    for v in prange(height):
        above, here, below = framed[v], framed[v + 1], framed[v + 2]
        for u in range(width):
            z = here[u + 1]
            far = min(beside + growth * z, most) * z
            farther = min(across + growth * z, most) * z
            near = np.int32(abs(here[u] - z) <= far) + np.int32(abs(here[u + 2] - z) <= far)
            near += np.int32(abs(above[u + 1] - z) <= far) + np.int32(abs(below[u + 1] - z) <= far)
            near += np.int32(abs(above[u] - z) <= farther) + np.int32(abs(above[u + 2] - z) <= farther)
            near += np.int32(abs(below[u] - z) <= farther) + np.int32(abs(below[u + 2] - z) <= farther)
            out[v, u] = z if near >= support else np.float32(0.0)
    return out


def close_dropouts(depth: np.ndarray, labels: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Give pixels without a reading the mean disparity of their surroundings, where one view surrounds them.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel, -1 = none.
    width : int
        Drop-outs up to this many pixels across are closed, a ring of pixels a round.

    Returns
    -------
    depth, labels : np.ndarray
        Copies with the closed pixels filled in.
    """
    for _ in range((width + 1) // 2):
        depth, labels = _close_kernel(depth, labels)
    return depth, labels


@njit(cache=True, nogil=True, parallel=True)
def _close_kernel(depth, labels):
    height, width = depth.shape
    new_depth, new_labels = depth.copy(), labels.copy()
    for v in prange(1, height - 1):
        for u in range(1, width - 1):
            if labels[v, u] >= 0:
                continue
            if labels[v, u - 1] < 0 and labels[v, u + 1] < 0 and labels[v - 1, u] < 0:
                continue  # three of 8 are none already: as nearly everywhere
            view = -1
            count = 0
            total = 0.0
            low, high = np.inf, 0.0
            for dv in range(-1, 2):
                for du in range(-1, 2):
                    k = labels[v + dv, u + du]
                    if k >= 0 and (view < 0 or k == view):
                        view = k
                        count += 1
                        z = depth[v + dv, u + du]
                        total += 1.0 / z
                        low, high = min(low, z), max(high, z)
            # 6 of 8: the pixel is inside the surface, not at its silhouette
            if count >= 6 and high - low < 0.02 * low:
                new_depth[v, u] = count / total
                new_labels[v, u] = view
    return new_depth, new_labels


def measure_noise(depth: np.ndarray, labels: np.ndarray, views: int) -> np.ndarray:
    """Noise of each view, measured on the data: :func:`noise_of_windows` over all of it.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel.
    views : int
        How many there are.

    Returns
    -------
    np.ndarray [shape=(views,), dtype=float64]
        Standard deviation of a reading relative to its z, a view; 0 for a view without a full window.
    """
    variance = window_variance(depth, labels)
    return np.array([noise_of_windows(variance[labels == view]) for view in range(views)])


def window_variance(depth: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Variance (H, W) of each 5×5 window's readings about the quadratic surface fitted to their disparity.

    Relative to z²; -1 where a window holds other labels than its middle's, and in two of three rows, for the third
    tells enough for a median.
    """
    return _residual_kernel(depth, labels, 3)


def noise_of_windows(variance: np.ndarray, calm: bool = False) -> float:
    """Standard deviation of a reading relative to its z by some of :func:`window_variance`; 0 where all are -1.

    The median window's; with ``calm`` that of the calmest tenth: where relief finer than a window is taken for noise,
    they have the least of it. Noise that is alike everywhere gives the same figure twice.
    """
    percentile, expected = (10, 0.613) if calm else (50, 0.965)  # of chi²/n with n = 19 degrees of freedom
    variance = variance[variance >= 0]
    return float(np.sqrt(np.percentile(variance, percentile) / expected)) if variance.size else 0.0


@njit(cache=True, nogil=True, parallel=True)
def _residual_kernel(depth, labels, stride):
    """Variance of each full 5×5 window about its quadratic fit, relative to z; -1 elsewhere.

    On a full window 1, u, v, u²-2, v²-2 and uv are orthogonal, so the fit has a closed form.
    """
    height, width = depth.shape
    out = np.full((height, width), -1.0)
    for v in prange(2, height - 2):
        if v % stride:  # every row, or a sample of them
            continue
        for u in range(2, width - 2):
            k = labels[v, u]
            if k < 0:
                continue
            ok = True
            s = su = sv = suu = svv = suv = ss = 0.0
            zc = depth[v, u]
            for dv in range(-2, 3):
                for du in range(-2, 3):
                    if labels[v + dv, u + du] != k:
                        ok = False
                        break
                    d = zc / depth[v + dv, u + du] - 1.0
                    s += d
                    su += d * du
                    sv += d * dv
                    suu += d * (du * du - 2)
                    svv += d * (dv * dv - 2)
                    suv += d * du * dv
                    ss += d * d
                if not ok:
                    break
            if ok:
                rss = (
                    ss
                    - s * s / 25.0
                    - su * su / 50.0
                    - sv * sv / 50.0
                    - suu * suu / 70.0
                    - svv * svv / 70.0
                    - suv * suv / 100.0
                )
                out[v, u] = max(rss, 0.0) / 19.0
    return out
