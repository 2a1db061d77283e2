"""The avatar frame: Z up, facing −Y, soles on z = 0."""

from __future__ import annotations

import numpy as np

from ..numeric.point_products import transform

_STANDS = 0.1  # of its height above the floor: what begins higher does not stand on that floor
_FEET = 0.1  # of its height: so far up from the soles its feet are looked for


def avatar_frame(vertices: np.ndarray, up: np.ndarray, axis: np.ndarray, floor: float | None) -> np.ndarray:
    """Camera frame → avatar frame: Z up, facing −Y (towards the camera), soles on z = 0, between the feet x = y = 0.

    What does not stand on the floor has its lowest point on z = 0.

    Parameters
    ----------
    vertices : np.ndarray [shape=(N, 3)]
        Points of the subject, N > 0, camera frame [m].
    up : np.ndarray [shape=(3,)]
        Unit vertical, camera frame.
    axis : np.ndarray [shape=(3,)]
        A point of the vertical line through the subject, not above or below the camera [m].
    floor : float or None
        Height along ``up`` of what the subject stands on [m]; None when it is not known.

    Returns
    -------
    np.ndarray [shape=(4, 4), dtype=float64]
        Rigid transformation.
    """
    away = axis - (axis @ up) * up
    away /= np.linalg.norm(away)
    rotation = np.stack((np.cross(away, up), away, up))
    placed = transform(vertices, np.column_stack((rotation, np.zeros(3))))
    low, high = placed[:, 2].min(), placed[:, 2].max()
    if floor is not None and low < floor + _STANDS * (high - floor):
        low = floor
    feet = placed[placed[:, 2] <= low + _FEET * (high - low)]
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -0.5 * (feet.min(axis=0) + feet.max(axis=0))
    matrix[2, 3] = -low
    return matrix
