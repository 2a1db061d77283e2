"""Quantised readings: finding the quantum, and the smooth surface that fits the intervals.

A Kinect v1 knows disparity to an eighth of a pixel only: at 4.8 m they are 65 mm from each other. Such a reading is not
a value but an interval, and the surface is the smoothest one that passes through all of them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..numeric.kernels import njit
from .disparity_smoothing import smooth_view
from .settings import DepthSettings

_WINDOWS = (8.0, 5.0, 3.0)  # sigma [px]
_MAX_RADIUS = 20  # px: of the smoothing windows
_MILLIMETRE = 0.001  # m: what files are written in


def find_step(depth: np.ndarray) -> float:
    """Quantum of 1/z [1/m] that the readings of a frame show; 0 when they show none.

    Values that lie evenly spaced in 1/z, with nothing between them, come from a camera that measures disparity in
    coarse steps. Looked for from 1.5 to 8 m, where a step is wider than the millimetres files are written in.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W)]
        z [m], 0 = no reading.
    """
    counts = _count_kernel(np.ascontiguousarray(depth[::3], np.float32), _MILLIMETRE, 8000)
    counts[:1500] = 0
    occupied = np.flatnonzero(counts)
    if not 12 <= len(occupied) <= 2000:  # almost no readings, or no gaps
        return 0.0
    # a value on the border of two bins fills both
    starts = np.flatnonzero(np.diff(occupied, prepend=-2) > 1)
    lengths = np.diff(starts, append=len(occupied))
    if len(starts) < 12 or lengths.max() > 3:
        return 0.0
    weights = counts[occupied]
    z = (np.add.reduceat(occupied * weights, starts) / np.add.reduceat(weights, starts) + 0.5) * _MILLIMETRE
    inverse = 1.0 / z
    gaps = -np.diff(inverse)
    step = float(np.median(gaps))
    for _ in range(3):  # gaps may span several steps where the scene is empty
        times = np.maximum(np.rint(gaps / step), 1)
        step = float((gaps * times).sum() / (times * times).sum())
    slack = _MILLIMETRE * (inverse[1:] ** 2) + 0.02 * step  # the rounding of the file
    times = np.maximum(np.rint(gaps / step), 1)
    even = np.abs(gaps - times * step) <= np.minimum(slack, 0.3 * step)
    return step if even.mean() > 0.8 else 0.0


@njit(cache=True, nogil=True)
def _count_kernel(depth, width, bins):
    counts = np.zeros(bins, np.int64)
    for z in depth.ravel():
        if 0 < z < bins * width:
            counts[int(z / width)] += 1
    return counts


def dequantise(depth: np.ndarray, labels: np.ndarray, view: int, step: float, settings: DepthSettings) -> np.ndarray:
    """Smooth surface through readings that are known to within half a step of 1/z.

    Projections in turn, onto the locally quadratic surfaces by ever smaller windows
    (:func:`.disparity_smoothing.smooth_view`) and onto the intervals, as for any point that convex sets share (Bregman
    1965).

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel, -1 = none.
    view : int
        The one whose readings are treated.
    step : float
        Quantum of 1/z [1/m].

    Returns
    -------
    np.ndarray [shape=(H, W), dtype=float32]
    """
    mine = labels == view
    if not mine.any():
        return depth
    with np.errstate(divide="ignore"):
        inverse = 1.0 / depth[mine].astype(np.float64)
    low, high = 1.0 / (inverse + 0.5 * step), 1.0 / np.maximum(inverse - 0.5 * step, 1e-3)
    noise = 0.5 * step * float(np.median(depth[mine]))
    for sigma in _WINDOWS:
        depth = smooth_view(depth, labels, view, noise, sigma, replace(settings, max_radius=_MAX_RADIUS))
        depth[mine] = np.clip(depth[mine], low, high)
    return depth
