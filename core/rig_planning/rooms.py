"""Rooms that a rig is planned for, and sizes of mirrors as they are sold."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..errors import MirrorScanError


@dataclass(frozen=True)
class Room:
    """A room without furniture.

    Parameters
    ----------
    width, depth, height : float
        Clear, wall to wall and floor to ceiling [m].
    """

    width: float
    depth: float
    height: float = 2.4

    def __post_init__(self) -> None:
        sizes = (self.width, self.depth, self.height)
        if not all(map(math.isfinite, sizes)) or min(sizes) <= 0 or max(sizes) > 50:
            raise MirrorScanError(
                f"room: {self.width:g} × {self.depth:g} × {self.height:g} m; give sizes from 0 to 50 m"
            )


ROOMS: dict[str, Room] = {
    "small": Room(3.0, 3.5, 2.4),
    "bedroom": Room(3.2, 4.0, 2.4),
    "living_room": Room(4.0, 5.0, 2.5),
    "garage": Room(3.0, 6.0, 2.3),
    "studio": Room(6.0, 7.5, 2.8),
}
"""Rooms as people have them."""

MIRRORS: dict[str, tuple[float, float]] = {
    "door": (0.4, 1.6),
    "wardrobe": (0.6, 1.7),
    "standing": (0.8, 1.75),
    "gym": (1.2, 2.0),
}
"""Width and height of mirrors that shops have [m]."""
