"""How noisy depth is, measured: in windows of one frame, and over the frames of a burst."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..numeric.kernels import njit
from ..numeric.threads import each_range


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
    is enough for a median.
    """
    return window_residuals(depth, labels, 3)


def noise_of_windows(variance: np.ndarray, calm: bool = False) -> float:
    """Standard deviation of a reading relative to its z by some of :func:`window_variance`; 0 where all are -1.

    The median window's; with ``calm`` that of the calmest tenth: where relief finer than a window is taken for noise,
    they have the least of it. Noise that is alike everywhere gives the same figure twice.
    """
    percentile, expected = (10, 0.613) if calm else (50, 0.965)  # of chi²/n with n = 19 degrees of freedom
    variance = variance[variance >= 0]
    return float(np.sqrt(np.percentile(variance, percentile) / expected)) if variance.size else 0.0


def window_residuals(depth: np.ndarray, labels: np.ndarray, stride: int) -> np.ndarray:
    """Variance of each full 5×5 window about its quadratic fit, relative to z; -1 elsewhere."""
    out = np.full(depth.shape, -1.0)
    each_range(_residual_kernel, len(depth), depth, labels, stride, out)
    return out


@njit(cache=True, nogil=True)
def _residual_kernel(begin, end, depth, labels, stride, out):
    """:func:`window_residuals` in some rows.

    On a full window 1, u, v, u²-2, v²-2 and uv are orthogonal, so the fit has a closed form.
    """
    height, width = depth.shape
    for v in range(max(begin, 2), min(end, height - 2)):
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


@dataclass(frozen=True)
class BurstNoise:
    """Random error of the subject's readings in one view [m], before anything is smoothed.

    ``frame``: of one frame, by how the frames of the burst differ; None when there is one only. ``expected``: of
    ``frames`` frames, if nothing but chance made them differ: frame / √frames. ``fused``: by how much the fused
    readings differ from the surface: what all frames have in common, a camera's steps and ripples, is in it, and no
    number of frames lowers that.
    """

    frames: int
    frame: float | None
    expected: float | None
    fused: float


def burst_noise(
    frames: int, spread: np.ndarray, fused: np.ndarray, labels: np.ndarray, views: int
) -> tuple[BurstNoise, ...]:
    """How noisy each view is, with one frame and with all.

    Parameters
    ----------
    frames : int
        How many there are.
    spread, fused : np.ndarray [shape=(H, W), dtype=float32]
        Of :func:`.burst_fusion.fuse_burst`.
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel, -1 = not the subject.
    views : int
    """
    variance = window_variance(fused, labels)
    found = []
    for view in range(views):
        mine = labels == view
        z = float(np.median(fused[mine])) if mine.any() else 0.0
        known = spread[mine & (spread > 0)]
        # the median of standard deviations of few frames is too low (Wilson and Hilferty)
        low = (1.0 - 2.0 / (9.0 * (frames - 1))) ** 1.5 if frames > 1 else 1.0
        frame = float(np.median(known)) * z / low if frames > 1 and len(known) else None
        expected = None if frame is None else frame / math.sqrt(frames)
        found.append(BurstNoise(frames, frame, expected, noise_of_windows(variance[mine]) * z))
    return tuple(found)
