"""A seat that the subject sits on, or anything else it is in touch with that stands on the floor: it stays part of it.

A person touches the floor with two feet. Legs of a chair are more places where something stands; a box is larger than
two feet together, and its level top shows beside what is on it.
"""

from __future__ import annotations

import numpy as np

from ..errors import Notice
from ..numeric.point_products import dot
from ..subject.subject_views import Views

_CELL, _SIDE = 0.02, 121  # of the plan about the subject [m], and how many cells it has each way
_FOOT, _SHIN = (0.03, 0.1), (0.18, 0.28)  # heights at which things stand, and reach up beside the shins [m]
_FEWEST, _SMALLEST = 2, 4  # readings of a cell, and cells of what stands there
_LINKED = 3  # cells: what is nearer together stands as one
_FEET, _BROADEST = 2, 0.33  # how many they are, and how broad when they stand close together [m]
_SEAT, _LEVEL, _TOP = (
    (0.25, 0.7),
    0.03,
    0.012,
)  # heights of seats, how even they are [m], and how much of one shows [m²]


def check_seat(views: Views) -> list[Notice]:
    """What to warn of where a person, as it is seen, stands on more than its feet.

    Parameters
    ----------
    views : Views

    Notes
    -----
    O(readings of the subject).
    """
    if views.floor is None:
        return []
    points = views.points[views.labels >= 0]
    height = dot(points, views.up) - views.floor
    cell = _cells_of_plan(points - views.axis, views.up)
    stands, shins = _taken(cell, height, _FOOT), _taken(cell, height, _SHIN)
    seats = (height > _SEAT[0]) & (height < _SEAT[1])
    highest = np.full((_SIDE, _SIDE), -np.inf)
    np.maximum.at(highest.reshape(-1), cell[seats], height[seats])
    highest[_taken(cell, height, (_SEAT[1], np.inf))] = -np.inf
    places = [place for place in _places(stands) if len(place) >= _SMALLEST and shins[_about(place)].sum() >= _SMALLEST]
    if len(places) <= _FEET and not any(
        _is_broad(place) and _has_level_top(highest[_about(place)]) for place in places
    ):
        return []
    return [
        Notice(
            "something that stands on the floor, such as a seat, touches the subject and stays part of it; have the "
            "person stand on nothing but the floor, clear of furniture"
        )
    ]


def _cells_of_plan(offset: np.ndarray, up: np.ndarray) -> np.ndarray:
    """The cell (N,) of the plan that each of some points, by their ``offset`` (N, 3) from its middle, lies over."""
    across = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    across /= np.linalg.norm(across)
    plan = np.floor(offset @ np.column_stack((across, np.cross(up, across))) / _CELL).astype(np.int64) + _SIDE // 2
    row, column = plan.clip(0, _SIDE - 1).T
    return row * _SIDE + column


def _taken(cell: np.ndarray, height: np.ndarray, between: tuple[float, float]) -> np.ndarray:
    """Cells (A, A) of the plan over which there are enough readings between two heights."""
    some = cell[(height > between[0]) & (height < between[1])]
    return np.bincount(some, minlength=_SIDE * _SIDE).reshape(_SIDE, _SIDE) >= _FEWEST


def _places(stands: np.ndarray) -> list[np.ndarray]:
    """The cells (K, 2) of each place at which something stands."""
    cells = np.argwhere(stands)
    near = np.abs(cells[:, None] - cells[None]).max(axis=-1) <= _LINKED
    label = np.arange(len(cells))
    for _ in cells:  # each takes the least label near it, until none changes
        least = np.where(near, label, len(cells)).min(axis=1)
        if np.array_equal(least, label):
            break
        label = least
    return [cells[label == one] for one in np.unique(label)]


def _about(place: np.ndarray) -> tuple[slice, slice]:
    """The box of a place, a cell larger on each side."""
    low, high = np.maximum(place.min(axis=0) - 1, 0), place.max(axis=0) + 2
    return slice(low[0], high[0]), slice(low[1], high[1])


def _is_broad(place: np.ndarray) -> bool:
    """Whether a place is broader than feet are."""
    offset = (place - place.mean(axis=0)) * _CELL
    axes = np.linalg.eigh(offset.T @ offset)[1]
    return float(np.ptp(offset @ axes, axis=0).min()) > _BROADEST


def _has_level_top(highest: np.ndarray) -> bool:
    """Whether many cells of the plan are level, by what is highest in each (A, B) [m]; -inf: not as high as a seat."""
    tops = np.sort(highest[np.isfinite(highest)])
    alike = np.searchsorted(tops, tops + _LEVEL, side="right") - np.arange(len(tops))
    return float(alike.max(initial=0)) * _CELL**2 > _TOP
