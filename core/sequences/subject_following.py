"""Where the subject is in each frame, followed from one to the next, so that it may walk about."""

from __future__ import annotations

import numpy as np

from ..camera import Intrinsics, unproject
from ..pipeline import KnownScene
from ..views.ray_sorting import sort_rays

_FAR = 100.0  # m: what a ray goes through before that, it goes through
_STRIDE = 3  # of the pixels looked at
_BEFORE = 0.05  # m: what is so far before the background is not of it
_NEAR = 0.6  # m: nobody goes so far between two frames; where nobody is that near, it is looked for as in one snapshot
_ABOVE = 0.3  # m: what is lower may be the floor, or a thing on it
_FEWEST = 100  # pixels looked at that show somebody


class SubjectFollower:
    """Follows the subject through the frames of a recording: ``follower.next(depth)``.

    What is seen directly near the last place, and is not of the background, shows the next one. Where there is none,
    or the subject stood still in all frames that the background was made of, the place stays.

    Parameters
    ----------
    scene : KnownScene
        Mirrors, vertical and floor; its ``subject`` is the first place.
    intrinsics : Intrinsics
    background : np.ndarray [shape=(H, W), dtype=float32]
        Depth of what stands still in the whole recording [m], 0 elsewhere.
    reach : float
        Of the subject in one snapshot [m], as of :class:`..subject.ViewSettings`.
    """

    def __init__(self, scene: KnownScene, intrinsics: Intrinsics, background: np.ndarray, reach: float) -> None:
        self._reach = reach
        self._camera, self._ground, self._place = intrinsics, scene.ground, scene.subject
        far = unproject(np.full(background.shape, _FAR, np.float32), intrinsics)
        self._direct = sort_rays(far, list(scene.mirrors))[0] == 0
        self._nearest = np.where(background > 0, background - np.float32(_BEFORE), np.float32(np.inf))

    def next(self, depth: np.ndarray) -> np.ndarray | None:
        """A point (3,) of the vertical through the subject in the next frame (H, W) [m]; None where none is known."""
        place, ground, camera = self._place, self._ground, self._camera
        if place is None or depth.shape != self._direct.shape:
            return place
        there = self._direct & (depth > 0) & (depth < self._nearest)
        rows, columns = _STRIDE * np.argwhere(there[::_STRIDE, ::_STRIDE]).T
        z = depth[rows, columns].astype(np.float64)
        points = np.column_stack(((columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z))
        if ground.floor is not None:
            points = points[points @ ground.up > ground.floor + _ABOVE]
        away = points - place
        off = (away**2).sum(axis=1) - (away @ ground.up) ** 2
        for reach in (_NEAR, self._reach):
            if (off < reach**2).sum() >= _FEWEST:
                self._place = np.median(points[off < reach**2], axis=0)
                break
        return self._place
