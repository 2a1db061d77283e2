"""The subject's pixels, sorted by view: :class:`Views`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ViewSettings:
    """How the subject is separated from the room.

    Parameters
    ----------
    depth_limit : float
        What lies farther along the (folded) path is dropped [m]; 0 = automatic, by where the subject can be.
    near : float
        What lies nearer is dropped [m]; 0 = automatic.
    floor_clearance : float
        Height threshold: readings up to this far above the floor are the floor's in any case [m]; above, what is seen
        decides.
    reach : float
        Radius about the vertical axis through the subject inside which it is looked for [m].
    max_height : float
        Height above the floor up to which a person is looked for [m].
    min_pixels : int
        A view with fewer pixels of the subject shows nobody.
    click : tuple of float or None
        Pixel (u, v) on the subject, in whichever view: chooses it where the rig's own choice is wrong.
    object : bool
        The subject may be any object, of any height, on the floor, a table or a plinth: what it stands on is cut off.
    """

    depth_limit: float = 0.0
    near: float = 0.0
    floor_clearance: float = 0.002
    reach: float = 1.15
    max_height: float = 2.4
    min_pixels: int = 150
    click: tuple[float, float] | None = None
    object: bool = False


@dataclass(frozen=True)
class Views:
    """The capture sorted into views.

    Parameters
    ----------
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel of the subject: 0 direct, 1..N through mirror N; -1 = not the subject.
    seen : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel with a reading, subject or not; -1 = none or seen by two reflections.
    points : np.ndarray [shape=(H, W, 3), dtype=float64]
        Every reading where it really is: mirrored ones flipped back, camera frame [m].
    up : np.ndarray [shape=(3,)]
        Unit vertical, camera frame.
    floor : float or None
        Height along ``up`` of what the subject stands on [m]; None when nothing of it is seen.
    floor_noise : float
        Standard deviation of floor readings about it [m].
    axis : np.ndarray [shape=(3,)]
        A point of the vertical line through the subject.
    warnings : tuple of str
    limits : np.ndarray [shape=(N+1, 2)] or None
        Nearest and farthest z of the subject in each view, with a margin [m]; NaN where it is not seen.
    disagreement_deg : float or None
        Between the mirrors' vertical and the floor's.
    """

    labels: np.ndarray
    seen: np.ndarray
    points: np.ndarray
    up: np.ndarray
    floor: float | None
    floor_noise: float
    axis: np.ndarray
    warnings: tuple[str, ...]
    limits: np.ndarray | None = None
    disagreement_deg: float | None = None
