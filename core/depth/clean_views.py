"""A depth map's view of the subject made clean: which camera it was, quantisation, missing readings, noise."""

from __future__ import annotations

import numpy as np

from ..camera.noise_models import NoiseModel
from .dequantisation import dequantise
from .disparity_smoothing import keep_relief, smooth_view, smoothing_sigma
from .noise_estimate import noise_of_windows, window_variance
from .outliers_and_dropouts import close_dropouts
from .settings import DepthSettings

_DITHER = 0.3  # noise below this share of a quantum does not average its intervals out
_ROUNDING = 0.001 / 12**0.5  # m: standard deviation that rounding to millimetres leaves
_RELIEF = (
    1.05,
    1.15,
)  # from where to where noise in the median window over that in the calmest ones says that it is relief


def clean(
    depth: np.ndarray,
    labels: np.ndarray,
    views: int,
    focal: float,
    settings: DepthSettings,
    model: NoiseModel | None = None,
    spread: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Missing readings filled, quantisation undone and noise smoothed, one view at a time.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z of one frame or a fused burst [m], 0 = no reading.
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel, -1 = none.
    views : int
        How many there are.
    focal : float
        fx [px].
    settings : DepthSettings
    model : NoiseModel or None
        Of the camera, where it is known.
    spread : np.ndarray [shape=(H, W), dtype=float32] or None
        Of a burst: standard deviation over the frames, relative to z.

    Returns
    -------
    depth, labels : np.ndarray
    noise : np.ndarray [shape=(views,)]
        What is left, relative to z.
    """
    depth, labels = close_dropouts(depth, labels, settings.close_gaps)
    noise, variance = np.zeros(views), window_variance(depth, labels)
    step = model.step(focal) if model is not None else 0.0
    for view in range(views):
        mine = labels == view
        if not mine.any():
            continue
        windows = variance[mine]
        noise[view] = noise_of_windows(windows)
        z = float(np.median(depth[mine]))
        quantum = step * z  # relative to z
        if quantum and settings.dequantise:
            single = noise[view] if spread is None else float(np.median(spread[mine]))
            if single < _DITHER * quantum:
                depth = dequantise(depth, labels, view, step, settings)
                windows = window_variance(depth, np.where(mine, 0, -1).astype(np.int8))[mine]
                noise[view] = max(noise_of_windows(windows), 0.1 * quantum)
        if noise[view] == 0 and model is not None:  # no window is whole: too thin, too torn
            noise[view] = model.sigma(z, focal) / z
        if settings.smoothing <= 0:
            continue
        calm, relief = _relief(windows, noise[view], z)
        before, sigma = depth, smoothing_sigma(noise[view], z, 1.0 / focal, settings)
        depth = smooth_view(before, labels, view, noise[view], sigma, settings)
        if relief > 0:
            depth = keep_relief(before, depth, labels, view, calm, relief)
        # a Gaussian window averages about 4π·sigma² readings, the quadratic fit half
        noise[view] /= max(1.0, 2.5 * sigma)
    return depth, labels, noise


def _relief(windows: np.ndarray, noise: float, z: float) -> tuple[float, float]:
    """Noise that is certainly left in a view, and how far what exceeds it must be taken for relief [0..1].

    ``windows`` as of :func:`.noise_estimate.window_variance`.

    Only readings as good as their millimetres separate the two: a camera's own noise differs from place to place by
    more than relief does.
    """
    if noise * z > 8 * _ROUNDING:
        return noise, 0.0
    calm = noise_of_windows(windows, calm=True)
    if calm == 0:
        return noise, 0.0
    low, high = _RELIEF
    uneven = min(max((noise / calm - low) / (high - low), 0.0), 1.0)
    if calm * z < 1.3 * _ROUNDING:  # there is no other noise to be had
        uneven = 1.0
    return min(calm, _ROUNDING / z), uneven * min(max(2.0 - calm * z / (2 * _ROUNDING), 0.0), 1.0)
