"""Tracked joints become poses: exact where joints say all, steady where they say nothing, quick."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.avatar.pose import Pose, posed_joints
from mirror_scan.core.avatar.skeleton import BONES
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.motion import JOINT_SETS, Motion, PoseFollower, make_clip, retarget
from motion_figures import angles, apart, gymnastics, skeleton
from scipy.spatial.transform import Rotation

LIMBS = [
    BONES.index(side + part) for side in ("Left", "Right") for part in ("ForeArm", "Hand", "Leg", "Foot", "ToeBase")
]
AZURE = {
    "PELVIS": "Hips", "SPINE_NAVEL": "Spine1", "SPINE_CHEST": "Spine2", "NECK": "Neck", "HEAD": "Head",
    **{f"{theirs}_{side.upper()}": f"{side}{ours}" for side in ("Left", "Right") for theirs, ours in (
        ("CLAVICLE", "Shoulder"), ("SHOULDER", "Arm"), ("ELBOW", "ForeArm"), ("WRIST", "Hand"), ("HIP", "UpLeg"),
        ("KNEE", "Leg"), ("ANKLE", "Foot"), ("FOOT", "ToeBase"))},
}  # fmt: skip


def _bones(joints: np.ndarray) -> np.ndarray:
    parents = [BONES.index(bone) for side in ("Left", "Right") for bone in
               (f"{side}Arm", f"{side}ForeArm", f"{side}UpLeg", f"{side}Leg", f"{side}Foot")]  # fmt: skip
    return joints[..., LIMBS, :] - joints[..., parents, :]


@pytest.mark.parametrize("name", ["walk", "squat", "arms_up", "turn"])
def test_our_own_joints_give_our_own_pose(name):
    person = skeleton()
    clip = make_clip(name, person)
    follower = PoseFollower(person)
    for joints in clip.joints(person):
        posed = posed_joints(person, follower.follow(joints))
        assert angles(_bones(posed), _bones(joints)).max() < 1e-4
        assert np.abs(posed - joints).max() < 0.03


def test_no_limb_turns_about_itself_where_it_is_straight():
    person = skeleton()
    clip = retarget(gymnastics(200), person)
    joints = clip.joints(person)
    arm, fore, hand = (BONES.index(f"Left{part}") for part in ("Arm", "ForeArm", "Hand"))
    straight = joints.copy()
    way = straight[:, fore] - straight[:, arm]
    straight[:, hand] = straight[:, fore] + 0.9 * way + 1e-6 * np.random.default_rng(1).normal(size=way.shape)
    follower = PoseFollower(person)
    turns = np.array([follower.follow(frame).rotations for frame in straight])
    assert (
        apart(turns[1:, arm], turns[:-1, arm]).max()
        < apart(clip.rotations[1:, arm], clip.rotations[:-1, arm]).max() + 5
    )


def _azure(joints: np.ndarray) -> np.ndarray:
    """As Azure Kinect sends them: millimetres, Y down, the person before the camera."""
    out = np.full((len(joints), len(JOINT_SETS["azure_kinect"]), 3), np.nan)
    for place, name in enumerate(JOINT_SETS["azure_kinect"]):
        if name in AZURE:
            out[:, place] = joints[:, BONES.index(AZURE[name])]
    axes = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # x right, y down, z away from the camera
    return 1000 * (0.9 * out @ axes.T + [0.1, 0.4, 2.5])


def test_a_sensor_s_joints_in_its_axes_and_unit():
    person = skeleton()
    clip = make_clip("walk", person)
    joints = clip.joints(person)
    follower = PoseFollower(person, JOINT_SETS["azure_kinect"])
    for frame, sent in zip(joints, _azure(joints), strict=True):
        posed = posed_joints(person, follower.follow(sent))
        assert angles(_bones(posed), _bones(frame)).max() < 3  # the first pelvis faces a degree or two aside
        assert np.abs(posed - frame).max() < 0.09
    way = follower.pose.translation
    np.testing.assert_allclose(way[:2], clip.translations[-1, :2], atol=0.06)


@pytest.mark.parametrize("axes", [np.diag([-1.0, 1, 1]), np.array([[-1.0, 0, 0], [0, 0, 1], [0, -1, 0]])])
def test_left_handed_axes_exchange_no_sides(axes):
    person = skeleton()
    joints = make_clip("walk", person).joints(person)
    follower = PoseFollower(person, BONES)
    for frame in joints[::4]:
        posed = posed_joints(person, follower.follow(frame @ axes.T))
        assert angles(_bones(posed), _bones(frame)).max() < 2


def test_landmarks_without_hips_or_neck():
    """MediaPipe: Y down, hips between the thighs at the origin, no more of the trunk than shoulders and hips."""
    person = skeleton()
    names = JOINT_SETS["mediapipe"]
    ours = {"shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand", "hip": "UpLeg", "knee": "Leg", "ankle": "Foot",
            "foot_index": "ToeBase"}  # fmt: skip
    follower = PoseFollower(person, names)
    for joints in make_clip("squat", person).joints(person)[::6]:
        sent = np.full((33, 3), np.nan)
        for place, name in enumerate(names):
            side, _, part = name.partition("_")
            if part in ours:
                sent[place] = joints[BONES.index(side.capitalize() + ours[part])]
        middle = (sent[names.index("left_hip")] + sent[names.index("right_hip")]) / 2
        posed = posed_joints(
            person, follower.follow((sent - middle) @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]).T)
        )
        assert angles(_bones(posed), _bones(joints)).max() < 1


def test_what_is_not_seen_stays_as_it_was():
    person, names = skeleton(), list(BONES)
    clip = make_clip("walk", person)
    joints = clip.joints(person)
    follower = PoseFollower(person)
    before = follower.follow(joints[0])
    lost = joints[1].copy()
    gone = [names.index(f"Left{part}") for part in ("ForeArm", "Hand", "Leg", "Foot", "ToeBase")]
    lost[gone] = np.nan
    after = follower.follow(lost)
    chest, arm, fore = (names.index(bone) for bone in ("Spine2", "LeftArm", "LeftForeArm"))
    relative = [pose.rotations[chest].T @ pose.rotations[arm] for pose in (before, after)]
    assert apart(relative[0], relative[1]) < 3
    assert apart(*(pose.rotations[arm].T @ pose.rotations[fore] for pose in (before, after))) < 1e-4
    pose = follower.follow(np.full((22, 3), np.nan))
    np.testing.assert_array_equal(pose.translation, after.translation)
    assert apart(pose.rotations, after.rotations).max() < 1e-4
    again = follower.follow(joints[2])
    assert angles(_bones(posed_joints(person, again)), _bones(joints[2])).max() < 1e-4


@pytest.mark.parametrize("place", [[0.0, 0, 0], [310.0, -20, 1500]])
@pytest.mark.parametrize("tracker", [None, "kinect_v1", "kinect_v2", "azure_kinect", "arkit"])
def test_joints_in_one_place_are_not_seen(tracker, place):
    """What many trackers send for a person, or a limb, that they lost."""
    person = skeleton()
    names = None if tracker is None else JOINT_SETS[tracker]
    lost = np.tile(place, (22 if names is None else len(names), 1))
    follower = PoseFollower(person, names)
    np.testing.assert_allclose(follower.follow(lost).rotations, Pose.rest().rotations, atol=1e-9)
    follower = PoseFollower(person)
    joints = make_clip("walk", person).joints(person)
    before = follower.follow(joints[0])
    after = follower.follow(lost[:1].repeat(22, axis=0))
    assert apart(after.rotations, before.rotations).max() < 1e-4
    np.testing.assert_array_equal(after.translation, before.translation)
    arm = joints[1].copy()
    arm[[BONES.index(f"Left{part}") for part in ("ForeArm", "Hand")]] = arm[BONES.index("LeftArm")]
    assert np.isfinite(follower.follow(arm).rotations).all()
    again = follower.follow(joints[2])
    assert angles(_bones(posed_joints(person, again)), _bones(joints[2])).max() < 1e-4


def test_nothing_seen_at_first_is_the_rest_pose():
    follower = PoseFollower(skeleton(), JOINT_SETS["kinect_v2"])
    pose = follower.follow(np.full((25, 3), np.nan))
    np.testing.assert_array_equal(pose.rotations, Pose.rest().rotations)


def test_rotations_are_taken_as_they_are_and_missing_ones_held():
    person = skeleton()
    turns = Rotation.random(22, random_state=1).as_matrix()
    follower = PoseFollower(person)
    pose = follower.follow(1.01 * turns, hips=person.joints[0] + [1, 2, 3])
    np.testing.assert_allclose(pose.rotations, turns, atol=1e-12)
    np.testing.assert_allclose(pose.translation, [1, 2, 3])
    more = Rotation.random(22, random_state=2).as_matrix()
    hand, fore = BONES.index("LeftHand"), BONES.index("LeftForeArm")
    more[hand] = np.nan
    again = follower.follow(more)
    np.testing.assert_allclose(again.rotations[fore].T @ again.rotations[hand], turns[fore].T @ turns[hand], atol=1e-12)
    np.testing.assert_array_equal(again.translation, pose.translation)


def test_feet_are_not_in_the_floor():
    person = skeleton()
    joints = make_clip("walk", person).joints(person) - [0, 0, 0.2]
    follower = PoseFollower(person)
    for frame in joints:
        posed = posed_joints(person, follower.follow(frame))
        assert posed[:, 2].min() > 0.005


def test_wrong_sizes_are_told():
    with pytest.raises(MirrorScanError, match="joints must come as 22 times 3 numbers, or as 22 rotations; got"):
        PoseFollower(skeleton()).follow(np.zeros((25, 3)))


def test_positions_alone_make_a_clip():
    motion = gymnastics()
    around = Rotation.from_euler("y", 70, degrees=True).as_matrix()
    bare = Motion(
        motion.name,
        motion.joints,
        np.full(len(motion.joints), -1),
        motion.positions @ around.T,
        None,
        None,
        motion.rate,
    )
    clip = retarget(bare, skeleton(), lock_feet=False)
    truth = retarget(motion, skeleton(), lock_feet=False)
    ours, theirs = _bones(clip.joints(skeleton())), _bones(truth.joints(skeleton()))
    turn = clip.turned @ around @ truth.turned.T
    assert angles(ours[..., :4, :], theirs[..., :4, :] @ turn.T).max() < 1
