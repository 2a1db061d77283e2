"""Where a capture stands in the world before anybody knows where its subject is."""

from __future__ import annotations

import numpy as np

from ..camera import Intrinsics, unproject
from .floor_and_vertical import find_floor

DISTANCE = 2.5
"""How far in front of the camera a subject is expected [m]: at the world's origin."""

HEIGHT = 0.9
"""How high the camera is taken to stand where no floor is seen [m]."""

_MOST_READINGS = 20000  # that the floor is searched among


def upright_frame(depth: np.ndarray, intrinsics: Intrinsics) -> np.ndarray:
    """Camera frame → a frame with Z up, the floor on z = 0, the camera ``DISTANCE`` from the origin, looking along +Y.

    Up is the normal of the floor where one is seen, else the camera is taken to stand level. It is the avatar's frame
    as well as it can be known before the subject is found.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.

    Returns
    -------
    np.ndarray [shape=(4, 4)]
        Rigid.
    """
    up, floor = np.array((0.0, -1.0, 0.0)), -HEIGHT
    points = unproject(depth, intrinsics)[depth > 0]
    found = find_floor(points[:: len(points) // _MOST_READINGS + 1], up)
    if found is not None:
        up, floor, _ = found
    away = np.array((0.0, 0.0, 1.0)) - up[2] * up
    away /= np.linalg.norm(away)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack((np.cross(away, up), away, up))
    matrix[:3, 3] = (0.0, -DISTANCE, -floor)
    return matrix
