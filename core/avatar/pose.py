"""A pose of the skeleton, and the mesh moved by it: linear blend skinning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .skeleton import BONES, PARENTS, Skeleton


@dataclass(frozen=True)
class SkinWeights:
    """Which bones move a vertex, and how much.

    Parameters
    ----------
    index : np.ndarray [shape=(V, 4), dtype=uint8]
        Bones, by their place in ``BONES``; 0 where the weight is 0.
    weight : np.ndarray [shape=(V, 4), dtype=float32]
        0 to 1, largest first; each row sums to 1.
    """

    index: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True)
class Pose:
    """Each bone's turn from the rest pose, and where the hips are. Free of any convention of bone axes.

    Parameters
    ----------
    rotations : np.ndarray [shape=(22, 3, 3), dtype=float64]
        In the order of ``BONES``: the rotation in the avatar frame (not relative to the parent) that takes the bone
        from the skeleton's rest pose to this one.
    translation : np.ndarray [shape=(3,), dtype=float64]
        Of the joint Hips, from the rest pose, avatar frame [m].
    """

    rotations: np.ndarray
    translation: np.ndarray

    @classmethod
    def rest(cls) -> Pose:
        """The pose in which nothing is moved."""
        return cls(np.tile(np.eye(3), (len(BONES), 1, 1)), np.zeros(3))


def posed_joints(skeleton: Skeleton, pose: Pose) -> np.ndarray:
    """Joints (22, 3) in ``pose`` [m]; every bone keeps its length."""
    joints = np.empty((len(BONES), 3))
    for bone, parent in enumerate(PARENTS):
        if parent < 0:
            joints[bone] = skeleton.joints[bone] + pose.translation
        else:
            offset = skeleton.joints[bone] - skeleton.joints[parent]
            joints[bone] = joints[parent] + pose.rotations[parent] @ offset
    return joints


def bone_matrices(skeleton: Skeleton, pose: Pose) -> np.ndarray:
    """Matrices (22, 4, 4), rest to posed, of the avatar frame [m]: a vertex moves to the weighted sum of M v."""
    matrices = np.tile(np.eye(4), (len(BONES), 1, 1))
    matrices[:, :3, :3] = pose.rotations
    turned = np.einsum("bij,bj->bi", pose.rotations, skeleton.joints)
    matrices[:, :3, 3] = posed_joints(skeleton, pose) - turned
    return matrices


def skinned(vertices: np.ndarray, weights: SkinWeights, matrices: np.ndarray) -> np.ndarray:
    """Vertices (V, 3) moved by linear blend skinning with ``matrices`` (22, 4, 4) [m]."""
    blend = np.zeros((len(vertices), 3, 4))
    for k in range(weights.index.shape[1]):
        blend += weights.weight[:, k, None, None] * matrices[weights.index[:, k], :3]
    return np.einsum("vij,vj->vi", blend[:, :, :3], vertices) + blend[:, :, 3]
