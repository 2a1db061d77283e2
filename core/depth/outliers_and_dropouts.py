"""Flying pixels are removed, small gaps of missing readings are filled."""

from __future__ import annotations

import numpy as np

from ..numeric.kernels import njit
from ..numeric.threads import each_range
from .noise_estimate import window_residuals
from .settings import DepthSettings

_STEEPEST_DEG = 80.0  # from head-on: a surface at a steeper slant is not read
_SIGMAS, _OFFSET = 3.0, 0.003  # neighbours on a surface differ by no more, in standard deviations, and of z besides
_SURROUNDED, _ONE_SURFACE = 6, 0.02  # of 8 neighbours, in a gap inside a surface; of z: how far these differ at most


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
    variance = window_residuals(depth, np.where(depth > 0, 0, -1).astype(np.int8), 8)[::8]  # a sample of rows
    known = variance >= 0
    # noise relative to z grows in proportion to z for triangulating cameras; for others this is on the safe side
    growth = float(np.median(np.sqrt(variance[known]) / depth[::8][known])) if known.any() else 0.0
    slope = pixel_angle * np.tan(np.radians(_STEEPEST_DEG))
    framed, out = np.pad(depth, 1), np.empty_like(depth)  # no pixel needs to ask whether it lies at the border
    each_range(_flying_kernel, len(depth), framed, slope, _SIGMAS * growth, settings.support, out)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _flying_kernel(begin, end, framed, slope, noise, support, out):
    width = out.shape[1]
    beside, across = np.float32(slope + _OFFSET), np.float32(slope * np.sqrt(2.0) + _OFFSET)
    growth, most = np.float32(noise), np.float32(0.99)  # so that no reading is never near
    for v in range(begin, end):
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


def close_dropouts(depth: np.ndarray, labels: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Give pixels without a reading the mean disparity of their surroundings, where one view surrounds them.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel, -1 = none.
    width : int
        Gaps up to this many pixels across are filled, a ring of pixels a round.

    Returns
    -------
    depth, labels : np.ndarray
        Copies with these gaps filled.
    """
    for _ in range((width + 1) // 2):
        closed = depth.copy(), labels.copy()
        each_range(_close_kernel, len(depth), depth, labels, *closed)
        depth, labels = closed
    return depth, labels


@njit(cache=True, nogil=True)
def _close_kernel(begin, end, depth, labels, new_depth, new_labels):
    height, width = depth.shape
    for v in range(max(begin, 1), min(end, height - 1)):
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
            # else the pixel is not inside the surface, but at its silhouette
            if count >= _SURROUNDED and high - low < _ONE_SURFACE * low:
                new_depth[v, u] = count / total
                new_labels[v, u] = view
