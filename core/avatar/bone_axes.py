"""Rest axes of bones as Mixamo has them, so that its clips play by name alone.

Y runs along the bone. In a T-pose, facing −Y: the trunk's X points to the subject's left and its Z ahead; a leg's X to
the subject's right and its Z ahead; an arm's Z down. What hangs on a limb has its parent's axes, turned the shortest
way into its own direction.
"""

from __future__ import annotations

import numpy as np

from ..numeric.rotations import shortest_turn
from .skeleton import BONES, PARENTS, Skeleton

_LEFT, _UP, _AHEAD = np.eye(3)[0], np.eye(3)[2], -np.eye(3)[1]
_TRUNK = np.column_stack((_LEFT, _UP, _AHEAD))
# Where a limb begins its axes are those of a T-pose, turned the shortest way.
_LIMB_STARTS = {
    "LeftShoulder": np.column_stack((-_AHEAD, _LEFT, -_UP)),
    "RightShoulder": np.column_stack((_AHEAD, -_LEFT, -_UP)),
    "LeftUpLeg": np.column_stack((-_LEFT, -_UP, _AHEAD)),
    "RightUpLeg": np.column_stack((-_LEFT, -_UP, _AHEAD)),
}


def rest_axes(skeleton: Skeleton) -> np.ndarray:
    """Axes of each bone in the rest pose (22, 3, 3): columns X, Y, Z in the avatar frame, right-handed.

    The arms' axes are those of a T-pose turned with the upper arm, so that they do not depend on how the shoulder
    blades stand.
    """
    directions = skeleton.tails() - skeleton.joints
    lengths = np.linalg.norm(directions, axis=1)
    axes = np.empty((len(BONES), 3, 3))
    for bone, (name, parent) in enumerate(zip(BONES, PARENTS, strict=True)):
        start = _LIMB_STARTS.get(name, _TRUNK if parent < 0 else axes[parent])
        along = directions[bone] / lengths[bone] if lengths[bone] > 1e-6 else start[:, 1]
        axes[bone] = shortest_turn(start[:, 1], along) @ start
    return axes
