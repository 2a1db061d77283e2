"""Depth steadied in time: readings of one surface in successive frames are averaged, readings of what moved are not.

A recursive mean a pixel. A new reading joins the mean where it lies within the noise of it, and where its
neighbourhood does so, too: the mean difference of a window is known far better than one reading, so that a surface
which moves by less than the noise of a reading still restarts the mean.
All is done in inverse depth, as everywhere in :mod:`..depth`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera.noise_models import NoiseModel
from ..numeric.kernels import njit
from ..numeric.threads import each_range


@dataclass(frozen=True)
class FilterSettings:
    """How depth is steadied.

    Parameters
    ----------
    use : bool
    memory : int
        Frames that the mean goes back at most.
    deviations : float
        Of the noise: what differs by more has moved.
    window : int
        Half the side of the neighbourhood [px].
    """

    use: bool = True
    memory: int = 6
    deviations: float = 2.5
    window: int = 2


class DepthFilter:
    """Filters the frames of a recording one after the other: ``filter.next(depth)``.

    Parameters
    ----------
    focal : float
        fx [px].
    model : NoiseModel or None
        Of the camera; without one the noise is measured on what stands still.
    settings : FilterSettings

    Attributes
    ----------
    shares : list of float
        Of each frame's readings, the share that was averaged with those before [0..1].
    """

    def __init__(self, focal: float, model: NoiseModel | None = None, settings: FilterSettings = FilterSettings()):
        self._focal, self._model, self._settings = focal, model, settings
        self._mean: np.ndarray | None = None  # of 1/z [1/m], 0 = none
        self._count: np.ndarray | None = None
        self.shares: list[float] = []

    def next(self, depth: np.ndarray) -> np.ndarray:
        """The next frame's depth (H, W) float32 [m], steadied; where there is no reading there is none after."""
        settings = self._settings
        if not settings.use:
            return depth
        inverse = np.zeros(depth.shape, np.float32)
        np.divide(np.float32(1.0), depth, out=inverse, where=depth > 0)
        if self._mean is None or self._count is None or self._mean.shape != depth.shape:
            self._mean, self._count = inverse, (depth > 0).astype(np.uint8)
            self.shares.append(0.0)
            return depth
        sigma = self._sigma(inverse)
        out, count = np.zeros_like(inverse), np.zeros(depth.shape, np.uint8)
        each_range(
            _steady_kernel, len(depth), inverse, self._mean, self._count, np.float32(sigma),
            np.float32(settings.deviations), settings.window, settings.memory, out, count,
        )  # fmt: skip
        self._mean, self._count = out, count
        read = max(int((depth > 0).sum()), 1)
        self.shares.append(float((count > 1).sum()) / read)
        steady = np.zeros_like(depth)
        np.divide(np.float32(1.0), out, out=steady, where=out > 0)
        return steady

    def _sigma(self, inverse: np.ndarray) -> float:
        """Standard deviation of a reading's inverse depth [1/m]: of the model, or of the quieter half of the frame."""
        assert self._mean is not None
        both = (inverse > 0) & (self._mean > 0)
        if not both.any():
            return 0.0
        middle = 1.0 / float(np.median(inverse[both]))
        if self._model is not None:
            return float(self._model.sigma(middle, self._focal)) / middle**2
        change = np.abs(inverse[both] - self._mean[both])
        return float(np.percentile(change, 25)) / 0.3186 / np.sqrt(2.0)  # a quarter of a normal's values lie within


@njit(cache=True, nogil=True, error_model="numpy")
def _steady_kernel(begin, end, inverse, mean, count, sigma, deviations, window, memory, out, number):
    height, width = inverse.shape
    for v in range(begin, end):
        for u in range(width):
            d = inverse[v, u]
            if d == 0.0:
                continue
            out[v, u], number[v, u] = d, 1
            before = mean[v, u]
            if before == 0.0:
                continue
            n = np.float32(count[v, u])
            if abs(d - before) > deviations * sigma * np.sqrt(np.float32(1.0) + np.float32(1.0) / n):
                continue
            total, found = np.float32(0.0), np.float32(0.0)
            for y in range(max(v - window, 0), min(v + window + 1, height)):
                for x in range(max(u - window, 0), min(u + window + 1, width)):
                    if inverse[y, x] > 0.0 and mean[y, x] > 0.0:
                        total += inverse[y, x] - mean[y, x]
                        found += np.float32(1.0)
            if abs(total) > deviations * sigma * np.sqrt(found * (np.float32(1.0) + np.float32(1.0) / n)):
                continue
            weight = np.float32(1.0) / min(n + np.float32(1.0), np.float32(memory))
            out[v, u] = before + weight * (d - before)
            number[v, u] = min(count[v, u] + 1, memory)
