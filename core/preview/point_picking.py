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
    half = 0.5 * np.asarray(size, dtype=np.float64)
    # the picture's scale goes into the matrix: x and y of clip space come in pixels from the middle, times w
    rows = (np.asarray(matrix, dtype=np.float64)[(0, 1, 3), :] * np.array((*half, 1.0))[:, None]).astype(np.float32)
    with np.errstate(invalid="ignore", divide="ignore"):  # points that are no numbers are in no picture
        x, y, w = rows[:, :3] @ np.asarray(points, dtype=np.float32).T + rows[:, 3:]
        w[~(w > 0)] = np.nan
        return np.stack((x / w + np.float32(half[0]), y / w + np.float32(half[1])), axis=1)


class Picture:
    """Points projected into one picture once, for many queries: one at each move of the mouse.

    Parameters
    ----------
    points : np.ndarray [shape=(N, 3)]
    view : np.ndarray [shape=(4, 4)]
        Points → eye: the viewer looks along -z.
    projection : np.ndarray [shape=(4, 4)]
        Eye → clip space.
    size : (width, height)
        Of the picture [px].

    Notes
    -----
    O(N): 10 ms and 20 bytes a point for 300 000 points, a question then takes half a millisecond.
    """

    def __init__(self, points: np.ndarray, view: np.ndarray, projection: np.ndarray, size: tuple[float, float]) -> None:
        self._points, self._view = np.asarray(points), np.asarray(view, dtype=np.float64)
        matrix = np.asarray(projection, dtype=np.float64) @ self._view
        self._x, self._y = np.ascontiguousarray(project_to_picture(self._points, matrix, size).T)

    def pick(self, at: tuple[float, float], radius: float = 12.0, depth_tolerance: float = 0.15) -> int | None:
        """The point that a click means: the nearest in the picture among those of the front-most surface around it.

        The nearest in the picture alone would reach through gaps between points to what lies behind; the front-most
        alone slides along a slanted surface towards the viewer. So points within ``radius`` compete, those deeper than
        the front-most of them by more than ``depth_tolerance`` are out, and of the rest the nearest to the click wins.

        Parameters
        ----------
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
        """
        x, y = np.float32(at[0]), np.float32(at[1])
        near = np.flatnonzero(np.abs(self._x - x) <= np.float32(radius))  # false for NaN
        near = near[np.abs(self._y[near] - y) <= np.float32(radius)]
        squared = (self._x[near] - x) ** 2 + (self._y[near] - y) ** 2
        near, squared = near[squared <= radius * radius], squared[squared <= radius * radius]
        if not len(near):
            return None
        depth = -(self._points[near].astype(np.float64) @ self._view[2, :3] + self._view[2, 3])
        squared[depth > depth.min() + depth_tolerance] = np.inf
        return int(near[np.argmin(squared)])
