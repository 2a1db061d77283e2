"""Which pixel is seen through what: directly, through which mirror, or by two reflections."""

from __future__ import annotations

import numpy as np

from ..mirrors import Mirror
from ..mirrors.glass_kernels import (
    NEVER,
    before_plane,
    crossing,
    glass_of,
    in_box,
    in_glass,
    place_on_plane,
    reflected,
)
from ..numeric.kernels import njit
from ..numeric.threads import each_range


def sort_rays(
    points: np.ndarray, mirrors: list[Mirror], depth_limit: float = 0.0, near: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Direct or through which mirror: decided by whether a pixel's ray passes a mirror's glass before its reading.

    What stands in front of a mirror is seen directly; a reading behind the glass is somewhere in the room, and if the
    path from the glass to there passes another glass, it was seen by two reflections and belongs to no view.

    Parameters
    ----------
    points : np.ndarray [shape=(H, W, 3)]
        Unprojected readings, camera frame [m]; z = 0 where there is none.
    mirrors : list of Mirror
    depth_limit, near : float
        Readings with larger or smaller z are dropped [m]; 0 = no limit.

    Returns
    -------
    seen : np.ndarray [shape=(H, W), dtype=int8]
        0 direct, i through mirror i (1-based), -1 no reading, on a mirror's frame, or reflected twice.
    placed : np.ndarray [shape=(H, W, 3)]
        The readings where they really are.
    """
    limit = depth_limit if depth_limit > 0 else np.inf
    seen, placed = np.full(points.shape[:2], -1, np.int8), np.empty_like(points)
    each_range(_sort_kernel, len(points), points, glass_of(mirrors), near, limit, seen, placed)
    return seen, placed


_ON_PLANE = 0.01, 0.01  # readings so near to a mirror's plane, times z and [m], are on it: noise
_FRAME_MARGIN = 0.02  # so far about the glass they are its frame's [m]; farther out they are a wall, seen directly


@njit(cache=True, nogil=True)
def _sort_kernel(begin, end, points, glass, near, far, seen, placed):
    count = len(glass.planes)
    at_glass = np.empty(3)
    for v in range(begin, end):
        for u in range(points.shape[1]):
            x, y, z = points[v, u, 0], points[v, u, 1], points[v, u, 2]
            placed[v, u, 0], placed[v, u, 1], placed[v, u, 2] = x, y, z
            if z == 0 or z > far or z < near:
                continue
            margin = _ON_PLANE[0] * z + _ON_PLANE[1]
            best, which = NEVER, -1
            on_frame = False
            for i in range(count):
                off = before_plane(glass, i, x, y, z)
                if off >= margin:  # in front of the mirror
                    continue
                if off > -margin:
                    a, b = place_on_plane(glass, i, x, y, z)
                    on_frame = on_frame or (glass.sides[i] > 0 and in_box(glass.limits, i, a, b, -_FRAME_MARGIN))
                    continue
                d = glass.planes[i, 3]
                if d >= 0:  # the camera is behind it
                    continue
                t = d / (d + off)
                if t < best:
                    a, b = place_on_plane(glass, i, t * x, t * y, t * z)
                    if in_glass(glass, i, a, b):
                        best, which = t, i
            if which < 0:
                if not on_frame:
                    seen[v, u] = 0
                continue
            placed[v, u, 0], placed[v, u, 1], placed[v, u, 2] = reflected(glass, which, x, y, z)
            at_glass[0], at_glass[1], at_glass[2] = best * x, best * y, best * z
            twice = False
            for j in range(count):
                if j != which and crossing(glass, j, at_glass, placed[v, u], margin) < 1.0:
                    twice = True
            if not twice:
                seen[v, u] = which + 1
