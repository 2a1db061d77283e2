"""A pose of the skeleton, and the mesh moved by it: linear blend skinning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .skeleton import BONES, END_BONES, PARENTS, Skeleton


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


def chained_joints(rest: np.ndarray, rotations: np.ndarray, hips: np.ndarray) -> np.ndarray:
    """Joints (..., 22, 3) of bones that keep their lengths [m].

    Parameters
    ----------
    rest : np.ndarray [shape=(22, 3)]
        Joints in the rest pose [m].
    rotations : np.ndarray [shape=(..., 22, 3, 3)]
        As of :class:`Pose`.
    hips : np.ndarray [shape=(..., 3)]
        Where the joint Hips is [m].
    """
    joints = np.empty((*rotations.shape[:-2], 3))
    joints[..., 0, :] = hips
    for bone in range(1, len(BONES)):
        parent = PARENTS[bone]
        joints[..., bone, :] = joints[..., parent, :] + rotations[..., parent, :, :] @ (rest[bone] - rest[parent])
    return joints


def relative_to_parents(rotations: np.ndarray) -> np.ndarray:
    """Rotations (..., 22, 3, 3) in the avatar frame → each relative to its parent bone's; the hips' stay."""
    above = np.swapaxes(rotations[..., list(PARENTS[1:]), :, :], -1, -2)
    return np.concatenate((rotations[..., :1, :, :], above @ rotations[..., 1:, :, :]), axis=-3)


def posed_joints(skeleton: Skeleton, pose: Pose) -> np.ndarray:
    """Joints (22, 3) in ``pose`` [m]; every bone keeps its length."""
    return chained_joints(skeleton.joints, pose.rotations, skeleton.joints[0] + pose.translation)


def posed_skeleton(skeleton: Skeleton, pose: Pose) -> Skeleton:
    """Joints and ends in ``pose``."""
    at = bone_matrices(skeleton, pose)[list(END_BONES)]
    moved = np.einsum("eij,ej->ei", at[:, :3, :3], skeleton.ends) + at[:, :3, 3]
    return Skeleton(posed_joints(skeleton, pose), moved, skeleton.confidence)


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
