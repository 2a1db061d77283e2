"""The avatar's skeleton: the 22 joints Mixamo names, how they hang together, and where each bone points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import MirrorScanError
from ..numeric.point_products import transform

# Bone: parent. In this order everywhere; a parent stands before its children. Mixamo's names without their prefix.
_HIERARCHY = {
    "Hips": None,
    "Spine": "Hips",
    "Spine1": "Spine",
    "Spine2": "Spine1",
    "Neck": "Spine2",
    "Head": "Neck",
    "LeftShoulder": "Spine2",
    "LeftArm": "LeftShoulder",
    "LeftForeArm": "LeftArm",
    "LeftHand": "LeftForeArm",
    "RightShoulder": "Spine2",
    "RightArm": "RightShoulder",
    "RightForeArm": "RightArm",
    "RightHand": "RightForeArm",
    "LeftUpLeg": "Hips",
    "LeftLeg": "LeftUpLeg",
    "LeftFoot": "LeftLeg",
    "LeftToeBase": "LeftFoot",
    "RightUpLeg": "Hips",
    "RightLeg": "RightUpLeg",
    "RightFoot": "RightLeg",
    "RightToeBase": "RightFoot",
}
BONES = tuple(_HIERARCHY)
PARENTS = tuple(-1 if parent is None else BONES.index(parent) for parent in _HIERARCHY.values())
# The bone of the other side; those of the middle are their own.
OTHER_SIDE = tuple(
    BONES.index(name.replace("Left", "R_").replace("Right", "Left").replace("R_", "Right")) for name in BONES
)
# Where bones without a child end.
ENDS = ("HeadTop_End", "LeftHand_End", "RightHand_End", "LeftToe_End", "RightToe_End")
END_BONES = tuple(BONES.index(name) for name in ("Head", "LeftHand", "RightHand", "LeftToeBase", "RightToeBase"))
"""The bone that each of ``ENDS`` is the end of."""

# The one child that a bone with several points at.
_POINTS_AT = {"Hips": "Spine", "Spine2": "Neck"}


@dataclass(frozen=True)
class Skeleton:
    """Joints of an avatar. A bone begins at the joint of its name.

    Parameters
    ----------
    joints : np.ndarray [shape=(22, 3), dtype=float64]
        One of each name in ``BONES``, in the mesh's frame [m].
    ends : np.ndarray [shape=(5, 3), dtype=float64]
        Crown, tips of the middle fingers and of the toes, in the order of ``ENDS``, same frame [m].
    confidence : np.ndarray [shape=(22,), dtype=float64]
        0 (a guess) to 1 (certain), a joint.
    """

    joints: np.ndarray
    ends: np.ndarray
    confidence: np.ndarray

    def __post_init__(self) -> None:
        for name, shape in (("joints", (len(BONES), 3)), ("ends", (len(ENDS), 3)), ("confidence", (len(BONES),))):
            value = getattr(self, name)
            if value.shape != shape or not np.isfinite(value).all():
                raise MirrorScanError(f"skeleton: {name} must be finite numbers of shape {shape}, got {value.shape}")

    def transformed(self, matrix: np.ndarray) -> Skeleton:
        """The skeleton moved by a rigid or similarity ``matrix`` (4, 4)."""
        return replace(self, joints=transform(self.joints, matrix), ends=transform(self.ends, matrix))

    def tails(self) -> np.ndarray:
        """Where each bone ends (22, 3): at the next joint of its limb, or at its end [m]."""
        tails = np.empty((len(BONES), 3))
        for bone, name in enumerate(BONES):
            if bone not in END_BONES:
                child = BONES.index(_POINTS_AT[name]) if name in _POINTS_AT else PARENTS.index(bone)
                tails[bone] = self.joints[child]
        tails[list(END_BONES)] = self.ends
        return tails
