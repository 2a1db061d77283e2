"""Colour images brought to another size, without numba: a plain RGB-D folder must not cost its import."""

from __future__ import annotations

import math

import numpy as np


def area_resampled(image: np.ndarray, width: int, height: int) -> np.ndarray:
    """The mean of the area that each pixel of a smaller image covers, so that fine patterns do not alias.

    Both images show the same field: pixel centres (u, v) of the smaller one lie where
    :meth:`.pinhole.Intrinsics.scaled` has them. O(Hc · Wc) time; memory of one row beside the result.

    Parameters
    ----------
    image : np.ndarray [shape=(Hc, Wc, 3), dtype=uint8]
        At least as large as the result.
    width, height : int
        Of the result [px].

    Returns
    -------
    np.ndarray [shape=(height, width, 3), dtype=uint8]
    """
    tall, wide = image.shape[:2]
    rows, columns = np.linspace(0, tall, height + 1), np.linspace(0, wide, width + 1)
    left = np.minimum(columns.astype(np.intp), wide - 1)
    part = (columns - left)[:, None]
    total = np.zeros((wide + 1, 3))  # sums of one row from its left end
    out = np.empty((height, width, 3), np.uint8)
    for row in range(height):
        top, bottom = rows[row], rows[row + 1]
        first, last = math.floor(top), min(math.ceil(bottom), tall)
        place = np.arange(first, last)
        weight = np.minimum(place + 1, bottom) - np.maximum(place, top)
        np.cumsum(np.tensordot(weight / weight.sum(), image[first:last], 1), axis=0, out=total[1:])
        covered = np.diff(total[left] + part * (total[left + 1] - total[left]), axis=0)
        out[row] = np.clip(np.rint(covered * (width / wide)), 0, 255)
    return out
