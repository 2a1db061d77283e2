"""How the subject stands: its feet in sight, its arms off the trunk; by what is seen of it directly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..numeric.point_products import dot
from ..subject.subject_views import Views

FEWEST = 60
"""Readings of the subject from which its posture is judged."""

_KNEES, _SHOULDERS = 0.3, 0.86  # of the height: arms that matter are between these
_REACH = 0.2
"""Of the height: hands nearer to the body's middle than that hang beside the hips, where they hide the trunk."""
_WIDE = 0.3  # of the height: where hands are in an A-pose
_ANKLES = 0.1  # m above the floor: where the lowest reading of somebody whose feet are seen is
_TALL = 0.9  # m: lower figures sit, or are not seen whole


@dataclass(frozen=True)
class Posture:
    """What is seen of how the subject stands.

    Parameters
    ----------
    height : float
        Of the highest reading above the floor [m].
    lowest : float
        Of the lowest reading above the floor [m].
    middle : np.ndarray [shape=(3,)]
        Camera frame [m].
    hands : np.ndarray [shape=(2, 3)]
        The outermost reading on the image's left and right, camera frame [m].
    reach : np.ndarray [shape=(2,)]
        How far these are from the middle, across the line of sight [m].
    right : np.ndarray [shape=(3,)]
        Level unit vector across the line of sight, to the image's right.
    """

    height: float
    lowest: float
    middle: np.ndarray
    hands: np.ndarray
    reach: np.ndarray
    right: np.ndarray

    @property
    def arms_close(self) -> np.ndarray:
        """Which hands (2,) hang at the body."""
        return self.reach < _REACH * self.height

    @property
    def feet_hidden(self) -> bool:
        """Nothing of the feet is seen."""
        return self.lowest > _ANKLES

    def arms_out(self) -> np.ndarray:
        """By how much (2,) each hand is to go outwards [m]."""
        return np.maximum(_WIDE * self.height - self.reach, 0.0)


def posture_of(views: Views) -> Posture | None:
    """The posture of the subject; None where too little is seen of it, or no floor.

    Parameters
    ----------
    views : Views
        Of :func:`..subject.subject_search.find_subject`.
    """
    points = views.points[views.labels == 0]
    if len(points) < FEWEST or views.floor is None:
        return None
    up = views.up
    right = level_right(up, views.axis)
    height = dot(points, up) - views.floor
    across = dot(points - views.axis, right)
    top = float(np.quantile(height, 0.995))
    if top < _TALL:
        return None
    arms = (height > _KNEES * top) & (height < _SHOULDERS * top)
    if not arms.any():
        return None
    middle = float(np.median(across[arms]))
    sides = [np.quantile(sign * (across[arms] - middle), 0.995) for sign in (-1.0, 1.0)]
    outermost = [int(np.argmin(np.abs(sign * (across - middle) - reach) + ~arms * 9.0))
                 for sign, reach in zip((-1.0, 1.0), sides, strict=True)]  # fmt: skip
    return Posture(
        top, float(np.quantile(height, 0.005)), views.axis + middle * right, points[outermost], np.array(sides), right
    )


def level_right(up: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Level unit vector to the image's right of who looks from the camera to a place (3,)."""
    right = np.cross(place, up)
    length = np.linalg.norm(right)
    return right / length if length > 1e-9 else np.array((1.0, 0.0, 0.0))
