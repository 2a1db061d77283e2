"""Which point of a cloud a click on a picture of it means."""

from __future__ import annotations

import numpy as np


def project_to_picture(points: np.ndarray, matrix: np.ndarray, size: tuple[float, float]) -> np.ndarray:
    """Where points appear in a picture.

    Parameters
    ----------
    points : np.ndarray [shape=(N, 3)]
        In the frame ``matrix`` takes them from.
    matrix : np.ndarray [shape=(4, 4)]
        Points → clip space, as OpenGL has it: x and y within ±w are in the picture.
    size : (width, height)
        Of the picture [px].

    Returns
    -------
    np.ndarray [shape=(N, 2), dtype=float32]
        Pixels from the lower left corner; NaN for points behind the viewer.
    """
    matrix = np.asarray(matrix, dtype=np.float32)
    clip = np.asarray(points, dtype=np.float32) @ matrix[(0, 1, 3), :3].T + matrix[(0, 1, 3), 3]
    scale = np.where(clip[:, 2] > 0, clip[:, 2], np.nan)[:, None]
    return (clip[:, :2] / scale + 1.0) * np.array((0.5 * size[0], 0.5 * size[1]), np.float32)


def pick_point(
    points: np.ndarray,
    view: np.ndarray,
    projection: np.ndarray,
    size: tuple[float, float],
    at: tuple[float, float],
    radius: float = 12.0,
    depth_tolerance: float = 0.15,
) -> int | None:
    """The point that a click means: the nearest in the picture among those of the front-most surface around it.

    The nearest in the picture alone would reach through gaps between points to what lies behind; the front-most alone
    slides along a slanted surface towards the viewer. So points within ``radius`` compete, those deeper than the
    front-most of them by more than ``depth_tolerance`` are out, and of the rest the nearest to the click wins.

    Parameters
    ----------
    points : np.ndarray [shape=(N, 3)]
    view : np.ndarray [shape=(4, 4)]
        Points → eye: the viewer looks along -z.
    projection : np.ndarray [shape=(4, 4)]
        Eye → clip space.
    size : (width, height)
        Of the picture [px].
    at : (x, y)
        The click [px], from the lower left corner.
    radius : float
        How far from the click a point may appear [px].
    depth_tolerance : float
        How much deeper than the front-most point a point may lie, in the units of eye space.

    Returns
    -------
    int or None
        Index of the point; None when there is none within ``radius``.

    Notes
    -----
    O(N): about 5 ms for 300 000 points; 40 bytes a point.
    """
    points, view = np.asarray(points), np.asarray(view, dtype=np.float64)
    matrix = np.asarray(projection, dtype=np.float64) @ view
    # |x / w - a| ≤ r for all points without dividing: |x - a w| ≤ r w
    half = 0.5 * np.asarray(size, dtype=np.float64)
    rows = np.stack((*(matrix[:2] - (np.asarray(at) / half - 1.0)[:, None] * matrix[3]), matrix[3])).astype(np.float32)
    x, y, w = rows[:, :3] @ np.asarray(points, np.float32).T + rows[:, 3:]
    np.abs(x, out=x)
    near = np.flatnonzero(x <= np.float32(radius / half[0]) * w)  # false for NaN
    near = near[np.abs(y[near]) <= np.float32(radius / half[1]) * w[near]]
    squared = ((project_to_picture(points[near], matrix, size) - np.asarray(at, np.float32)) ** 2).sum(axis=1)
    near, squared = near[squared <= radius * radius], squared[squared <= radius * radius]
    if not len(near):
        return None
    depth = -(points[near].astype(np.float64) @ view[2, :3] + view[2, 3])
    squared[depth > depth.min() + depth_tolerance] = np.inf
    return int(near[np.argmin(squared)])
