"""The pose a body is dressed in: arms off the trunk and legs apart, so that no skin lies against other skin."""

from __future__ import annotations

import numpy as np

from ..avatar.pose import Pose, SkinWeights
from ..avatar.skeleton import BONES, Skeleton
from ..numeric.rotations import shortest_turn

_ARMS = np.radians((-22.0, 0.0))  # of upper arms above the horizontal, at least and at most
_LEGS = np.radians((26.0, 32.0))  # of thighs from the vertical, outwards, at least and at most
_LEGS_TOGETHER = np.radians((2.0, 8.0))  # under a shirt or a skirt


def dressing_pose(skeleton: Skeleton, legs_apart: bool = True) -> Pose:
    """The pose in which garments are cut out; as near to the rest pose as the limbs allow.

    Parameters
    ----------
    skeleton : Skeleton
        Of the rest pose, avatar frame (Z up, facing −Y).
    legs_apart : bool
        False lets the legs hang nearly straight, as under a shirt or a skirt.
    """
    rotations = np.tile(np.eye(3), (len(BONES), 1, 1))
    tails = skeleton.tails()
    for side, out in (("Left", 1.0), ("Right", -1.0)):
        bone = BONES.index(f"{side}Arm")
        along = tails[bone] - skeleton.joints[bone]
        lift = np.clip(np.arctan2(along[2], out * along[0]), *_ARMS)
        turn = shortest_turn(along, np.array((out * np.cos(lift), 0.0, np.sin(lift))))
        rotations[bone : bone + 3] = turn  # forearm and hand with it
        bone = BONES.index(f"{side}UpLeg")
        along = tails[bone] - skeleton.joints[bone]
        spread = np.clip(np.arctan2(out * along[0], -along[2]), *(_LEGS if legs_apart else _LEGS_TOGETHER))
        wanted = np.array((out * np.sin(spread), 0.0, -np.cos(spread)))
        for name in ("UpLeg", "Leg"):
            bone = BONES.index(side + name)
            rotations[bone] = shortest_turn(tails[bone] - skeleton.joints[bone], wanted)
        rotations[bone + 1 : bone + 3] = rotations[bone]  # foot and toes with the shin
    return Pose(rotations, np.zeros(3))


def brought_back(vertices: np.ndarray, weights: SkinWeights, matrices: np.ndarray) -> np.ndarray:
    """Where vertices (V, 3) rest that ``matrices`` (22, 4, 4) bring to where they are: linear blend skinning undone."""
    blend = np.einsum("vk,vkij->vij", weights.weight.astype(np.float64), matrices[weights.index][:, :, :3])
    return np.linalg.solve(blend[:, :, :3], (vertices - blend[:, :, 3])[..., None])[..., 0]
