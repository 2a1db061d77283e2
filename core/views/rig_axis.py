"""Where the subject is meant to stand: the vertical line where the reflected lines of sight meet."""

from __future__ import annotations

import numpy as np

from ..camera import Intrinsics, project
from ..mirrors import Mirror
from ..mirrors.mirror import reflect

_LEVEL = 1e-3  # how much the answer is kept at the camera's height: any height of the vertical line would do
_GRID = 65  # points each way over a mirror of which a side is beside or behind the camera


def rig_axis(mirrors: list[Mirror], up: np.ndarray, intrinsics: Intrinsics) -> np.ndarray | None:
    """A point of the vertical line where the reflected lines of sight meet: where the subject is meant to stand.

    The line of sight to the middle of what the image shows of each mirror is reflected; the answer is the point
    nearest to all of them and to the camera's own line of sight, seen from above. None with no mirror of known extent.
    """
    A, b = np.zeros((3, 3)), np.zeros(3)
    lines = [(np.zeros(3), np.array((0.0, 0.0, 1.0))), *reflected_sight(mirrors, intrinsics)]
    if len(lines) < 2:
        return None
    A += _LEVEL * np.outer(up, up)
    for origin, direction in lines:
        level = direction - (direction @ up) * up
        level /= np.linalg.norm(level)
        P = np.eye(3) - np.outer(level, level) - np.outer(up, up)
        A += P
        b += P @ origin
    return np.linalg.solve(A, b)


def reflected_sight(mirrors: list[Mirror], intrinsics: Intrinsics) -> list[tuple[np.ndarray, np.ndarray]]:
    """The line of sight to the middle of what is seen of each mirror of known extent, reflected: point, unit vector."""
    lines = []
    for m in mirrors:
        if m.outline is not None:
            middle = visible_middle(m, intrinsics)
            direction = reflect(middle * 2, m) - middle
            lines.append((middle, direction / np.linalg.norm(direction)))
    return lines


def visible_middle(mirror: Mirror, intrinsics: Intrinsics) -> np.ndarray:
    """Point of the mirror's plane in the middle of its outline, as far as that is in the image."""
    corners = mirror.outline
    assert corners is not None
    size = np.array((intrinsics.width - 1, intrinsics.height - 1))
    if not np.isfinite(corners).all():  # a side is beside or behind the camera
        assert mirror.rectangle is not None  # the outline is its
        a, b = (np.linspace(low, high, _GRID) for low, high in mirror.rectangle)
        grid = np.stack(np.meshgrid(a, b), axis=-1).reshape(-1, 2)
        pixels = project(mirror.point + grid @ mirror.basis[:, :2].T, intrinsics)
        corners = pixels[((pixels >= 0) & (pixels <= size)).all(axis=1)]
        if not len(corners):
            return mirror.point
    u, v = 0.5 * (np.clip(corners.min(axis=0), 0, size) + np.clip(corners.max(axis=0), 0, size))
    ray = np.array(((u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy, 1.0))
    return ray * (mirror.normal @ mirror.point) / (mirror.normal @ ray)
