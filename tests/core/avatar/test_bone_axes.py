"""Rest axes: right-handed, Y along the bone, and in a T-pose as Mixamo's characters have them."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.avatar.bone_axes import rest_axes
from mirror_scan.core.avatar.skeleton import BONES, OTHER_SIDE, PARENTS, Skeleton
from mirror_scan.core.numeric.rotations import shortest_turn

LEFT, UP, AHEAD = np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), np.array([0, -1.0, 0])
# What the FBX files of Mixamo's characters have, in our frame: Y, Z of bones of a T-pose.
MIXAMO = {
    "Hips": (UP, AHEAD), "Spine": (UP, AHEAD), "Neck": (UP, AHEAD), "Head": (UP, AHEAD),
    "LeftShoulder": (LEFT, -UP), "LeftArm": (LEFT, -UP), "LeftForeArm": (LEFT, -UP), "LeftHand": (LEFT, -UP),
    "RightArm": (-LEFT, -UP), "RightHand": (-LEFT, -UP),
    "LeftUpLeg": (-UP, AHEAD), "LeftLeg": (-UP, AHEAD), "RightUpLeg": (-UP, AHEAD),
    "LeftFoot": (AHEAD, UP), "RightToeBase": (AHEAD, UP),
}  # fmt: skip


def t_pose() -> Skeleton:
    """Straight bones: trunk and head up, arms out, legs down, feet ahead."""
    steps = {"Shoulder": 0.05, "Arm": 0.15, "ForeArm": 0.28, "Hand": 0.25, "UpLeg": 0.1, "Leg": 0.42, "Foot": 0.4}
    joints = np.zeros((22, 3))
    for bone, (name, parent) in enumerate(zip(BONES, PARENTS, strict=True)):
        side = LEFT if name.startswith("Left") else -LEFT
        plain = name.removeprefix("Left").removeprefix("Right")
        if parent < 0:
            joints[bone] = UP
        elif plain == "ToeBase":
            joints[bone] = joints[parent] + 0.13 * AHEAD
        elif plain in ("Leg", "Foot"):
            joints[bone] = joints[parent] - steps[plain] * UP
        else:
            joints[bone] = joints[parent] + (steps[plain] * side if plain in steps else 0.1 * UP)
    hand, toe = [BONES.index(f"Left{name}") for name in ("Hand", "ToeBase")]
    other = [OTHER_SIDE[hand], OTHER_SIDE[toe]]
    ends = [joints[5] + 0.2 * UP, joints[hand] + 0.18 * LEFT, joints[other[0]] - 0.18 * LEFT]
    ends += [joints[toe] + 0.06 * AHEAD, joints[other[1]] + 0.06 * AHEAD]
    return Skeleton(joints, np.array(ends), np.ones(22))


@pytest.mark.parametrize("name", MIXAMO)
def test_a_t_pose_has_mixamos_axes(name):
    axes = rest_axes(t_pose())[BONES.index(name)]
    np.testing.assert_allclose(axes[:, 1], MIXAMO[name][0], atol=1e-12)
    np.testing.assert_allclose(axes[:, 2], MIXAMO[name][1], atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_axes_are_right_handed_along_the_bone_and_alike_on_both_sides(seed):
    rng = np.random.default_rng(seed)
    skeleton = t_pose()
    half = rng.normal(0, 0.04, (22, 3))
    other = half[list(OTHER_SIDE)] * (-1, 1, 1)
    ends = rng.normal(0, 0.02, (5, 3))
    ends = 0.5 * (ends + ends[[0, 2, 1, 4, 3]] * (-1, 1, 1))
    skeleton = Skeleton(skeleton.joints + 0.5 * (half + other), skeleton.ends + ends, np.ones(22))
    axes = rest_axes(skeleton)
    np.testing.assert_allclose(axes @ np.swapaxes(axes, 1, 2), np.tile(np.eye(3), (22, 1, 1)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(axes), 1.0)
    along = skeleton.tails() - skeleton.joints
    np.testing.assert_allclose(axes[:, :, 1], along / np.linalg.norm(along, axis=1, keepdims=True), atol=1e-9)
    mirrored = axes[list(OTHER_SIDE)] * np.array([-1.0, 1, 1])[:, None] * np.array([-1.0, 1, 1])
    np.testing.assert_allclose(mirrored, axes, atol=1e-9)


def test_bones_without_length_have_their_parents_axes():
    skeleton = t_pose()
    joints = skeleton.joints.copy()
    joints[BONES.index("Head")] = joints[BONES.index("Neck")]
    axes = rest_axes(Skeleton(joints, skeleton.ends, np.ones(22)))
    assert np.isfinite(axes).all()
    np.testing.assert_allclose(axes[BONES.index("Neck")], axes[BONES.index("Spine2")], atol=1e-12)


def test_half_a_turn_is_a_rotation():
    for axis in np.eye(3):
        turn = shortest_turn(axis, -axis)
        np.testing.assert_allclose(turn @ axis, -axis, atol=1e-12)
        np.testing.assert_allclose(np.linalg.det(turn), 1.0)
