"""Poses move bones rigidly and blend skin between them."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.avatar.pose import Pose, SkinWeights, bone_matrices, posed_joints, skinned
from mirror_scan.core.avatar.skeleton import BONES, OTHER_SIDE, PARENTS, Skeleton
from mirror_scan.core.errors import MirrorScanError
from scipy.spatial.transform import Rotation


def _skeleton(rng: np.random.Generator) -> Skeleton:
    return Skeleton(rng.normal(size=(22, 3)), rng.normal(size=(5, 3)), np.ones(22))


def test_bones_have_parents_before_them_and_partners_on_the_other_side():
    assert len(BONES) == 22
    assert all(parent < bone for bone, parent in enumerate(PARENTS))
    for bone, partner in enumerate(OTHER_SIDE):
        assert OTHER_SIDE[partner] == bone
        assert PARENTS[partner] in (OTHER_SIDE[PARENTS[bone]], PARENTS[bone])


def test_bone_matrices_carry_joints_and_keep_lengths():
    rng = np.random.default_rng(4)
    skeleton = _skeleton(rng)
    pose = Pose(Rotation.random(22, random_state=5).as_matrix(), rng.normal(size=3))
    joints, matrices = posed_joints(skeleton, pose), bone_matrices(skeleton, pose)
    own = np.einsum("bij,bj->bi", matrices[:, :3, :3], skeleton.joints) + matrices[:, :3, 3]
    np.testing.assert_allclose(own, joints, atol=1e-12)
    for bone, parent in enumerate(PARENTS):
        if parent >= 0:
            by_parent = matrices[parent, :3, :3] @ skeleton.joints[bone] + matrices[parent, :3, 3]
            np.testing.assert_allclose(by_parent, joints[bone], atol=1e-12)


def test_skin_follows_one_bone_or_lies_between_two():
    rng = np.random.default_rng(6)
    skeleton = _skeleton(rng)
    matrices = bone_matrices(skeleton, Pose(Rotation.random(22, random_state=7).as_matrix(), rng.normal(size=3)))
    points = rng.normal(size=(50, 3))
    index = np.zeros((50, 4), np.uint8)
    index[:, 0], index[:, 1] = 3, 7
    weight = np.tile(np.array([0.75, 0.25, 0, 0], np.float32), (50, 1))
    moved = [points @ matrices[b, :3, :3].T + matrices[b, :3, 3] for b in (3, 7)]
    np.testing.assert_allclose(skinned(points, SkinWeights(index, weight), matrices), 0.75 * moved[0] + 0.25 * moved[1])


def test_skeletons_of_wrong_shape_are_refused():
    with pytest.raises(MirrorScanError, match="joints must be finite numbers"):
        Skeleton(np.zeros((21, 3)), np.zeros((5, 3)), np.ones(22))
