"""Where somebody walks to is known from frame to frame, whoever else is there."""

from __future__ import annotations

import numpy as np
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.pipeline import KnownScene
from mirror_scan.core.sequences.subject_following import SubjectFollower
from mirror_scan.core.views.floor_and_vertical import Ground

CAMERA = Intrinsics(160, 120, 130.0, 130.0, 79.5, 59.5)
WALL = np.full((120, 160), 4.0, np.float32)


def picture(*people):
    """Depth (H, W) of a wall, and of people, half a metre wide, each at (x, z) [m]."""
    depth = WALL.copy()
    for x, z in sorted(people, key=lambda one: -one[1]):
        left, right = (int(round(CAMERA.fx * (x + side) / z + CAMERA.cx)) for side in (-0.25, 0.25))
        depth[20:100, max(left, 0) : max(right, 0)] = z
    return depth


def test_who_walks_is_followed_past_who_stands():
    scene = KnownScene((), (), None, Ground(np.array((0.0, -1.0, 0.0)), None, 0.0, None),  # type: ignore[arg-type]
                       subject=np.array((0.0, 0.0, 2.5)))  # fmt: skip
    follower = SubjectFollower(scene, CAMERA, WALL, 1.15)
    way = [(0.1 * k, 2.5 + 0.02 * k) for k in range(10)]
    for x, z in way:
        place = follower.next(picture((x, z), (-1.0, 2.5)))
        assert np.hypot(place[0] - x, place[2] - z) < 0.05
    stays = follower.next(WALL)
    np.testing.assert_array_equal(stays, place)
    # after frames that nobody saw
    assert abs(follower.next(picture((way[-1][0] - 0.9, 2.7)))[0] - way[-1][0] + 0.9) < 0.05
