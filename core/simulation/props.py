"""Objects that may stand in the room: boxes, a chair, a table, a plinth, an open door. Avatar frame, metres."""

from __future__ import annotations

import numpy as np

from ..mesh import Mesh
from .scene import FramedMirror

WOOD = (150, 112, 74)
STONE = (176, 174, 168)


def box(low: tuple[float, float, float], high: tuple[float, float, float], color=WOOD) -> Mesh:
    """An axis-aligned box; its faces do not share vertices, so that each is shaded flat."""
    lower, upper = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    faces: list[np.ndarray] = []
    triangles: list[tuple[int, int, int]] = []
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        for end, order in ((lower, (0, 3, 2, 1)), (upper, (0, 1, 2, 3))):
            corners = np.empty((4, 3))
            corners[:, axis] = end[axis]
            corners[:, i] = (lower[i], upper[i], upper[i], lower[i])
            corners[:, j] = (lower[j], lower[j], upper[j], upper[j])
            first = 4 * len(faces)
            faces.append(corners[list(order)])
            triangles += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    vertices = np.concatenate(faces)
    return Mesh(vertices, np.array(triangles, np.int32), np.tile(np.array(color, np.uint8), (len(vertices), 1)))


def together(*parts: Mesh) -> Mesh:
    """Several props as one mesh."""
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.triangles + k for part, k in zip(parts, offsets, strict=True)]).astype(np.int32),
        np.concatenate([_colors(part) for part in parts]),
    )


def _colors(part: Mesh) -> np.ndarray:
    return np.full((len(part.vertices), 3), 190, np.uint8) if part.colors is None else part.colors[:, :3]


def placed(prop: Mesh, x: float, y: float, turn_deg: float = 0.0, z: float = 0.0) -> Mesh:
    """The prop rotated about the vertical, then moved."""
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    matrix = np.eye(4)
    matrix[:2, :2] = (c, -s), (s, c)
    matrix[:3, 3] = x, y, z
    return prop.transformed(matrix)


def chair() -> Mesh:
    """A wooden chair, 45 cm square with a seat at 45 cm and a back at 90 cm, looking along -Y."""
    legs = [box((x, y, 0), (x + 0.04, y + 0.04, 0.43)) for x in (-0.22, 0.18) for y in (-0.22, 0.18)]
    return together(
        *legs, box((-0.225, -0.225, 0.43), (0.225, 0.225, 0.46)), box((-0.22, 0.18, 0.46), (0.22, 0.22, 0.9))
    )


def table(width: float = 1.2, depth: float = 0.7, height: float = 0.72) -> Mesh:
    """A table about the origin."""
    w, d = width / 2, depth / 2
    legs = [
        box((x - 0.03, y - 0.03, 0), (x + 0.03, y + 0.03, height - 0.03))
        for x in (0.05 - w, w - 0.05) for y in (0.05 - d, d - 0.05)
    ]  # fmt: skip
    return together(*legs, box((-w, -d, height - 0.03), (w, d, height)))


def plinth(width: float = 0.5, height: float = 0.6) -> Mesh:
    """A square block about the origin."""
    return box((-width / 2, -width / 2, 0), (width / 2, width / 2, height), STONE)


def open_door(width: float = 0.9, height: float = 2.05) -> Mesh:
    """A wall 5 m wide with an opening in its middle, across the Y axis."""
    half = width / 2
    return together(
        box((-2.5, -0.06, 0.0), (-half, 0.06, 2.7), STONE),
        box((half, -0.06, 0.0), (2.5, 0.06, 2.7), STONE),
        box((-half, -0.06, height), (half, 0.06, 2.7), STONE),
    )


def wall_behind(mirror: FramedMirror, gap: float = 0.001, margin: float = 0.7) -> Mesh:
    """A piece of wall that a mirror hangs on, ``gap`` behind its glass, from the floor to ``margin`` above it [m]."""
    _, up, normal = mirror.axes
    half = mirror.width / 2 + margin
    wall = box((-half, -mirror.centre[2], -0.02), (half, mirror.height / 2 + margin, 0.0), STONE)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack((np.cross(up, normal), up, normal))
    matrix[:3, 3] = np.array(mirror.centre) - gap * normal
    return wall.transformed(matrix)
