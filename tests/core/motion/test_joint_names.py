"""Joints are recognised whatever program named them, left and right never exchanged."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.motion import JOINT_SETS
from mirror_scan.core.motion.joint_names import match_joints, side_and_part

LIMBS = ("Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot")
# Convention: hips, trunk …, neck, head; then the pattern of a side's limbs with # for the side.
CONVENTIONS = {
    "mixamo": ("Hips Spine Spine1 Spine2 Neck Head",
               "#Shoulder #Arm #ForeArm #Hand #UpLeg #Leg #Foot #ToeBase", "Left"),
    "cmu": ("Hips lowerback Chest lowerneck Head", "#Collar #Shoulder #Elbow #Wrist #Hip #Knee #Ankle #Toe", "Left"),
    "asf": ("root lowerback thorax lowerneck head", "#clavicle #humerus #radius #wrist #femur #tibia #foot #toes", "l"),
    "xsens": ("Pelvis L5 T8 Neck Head", "#Shoulder #UpperArm #ForeArm #Hand #UpperLeg #LowerLeg #Foot #Toe", "Left"),
    "vrm": ("hips spine chest neck head",
            "#Shoulder #UpperArm #LowerArm #Hand #UpperLeg #LowerLeg #Foot #Toes", "left"),
    "vroid": ("J_Bip_C_Hips J_Bip_C_Spine J_Bip_C_Chest J_Bip_C_Neck J_Bip_C_Head",
              "J_Bip_#_Shoulder J_Bip_#_UpperArm J_Bip_#_LowerArm J_Bip_#_Hand J_Bip_#_UpperLeg J_Bip_#_LowerLeg "
              "J_Bip_#_Foot J_Bip_#_ToeBase", "L"),
    "rigify": ("spine spine.001 spine.003 spine.004 spine.006",
               "shoulder.# upper_arm.# forearm.# hand.# thigh.# shin.# foot.# toe.#", "L"),
    "unreal": ("pelvis spine_01 spine_03 neck_01 head",
               "clavicle_# upperarm_# lowerarm_# hand_# thigh_# calf_# foot_# ball_#",
               "l"),
    "biped": ("Bip01_Pelvis Bip01_Spine Bip01_Spine1 Bip01_Neck Bip01_Head",
              "Bip01_#_Clavicle Bip01_#_UpperArm Bip01_#_Forearm Bip01_#_Hand Bip01_#_Thigh Bip01_#_Calf Bip01_#_Foot "
              "Bip01_#_Toe0", "L"),
    "smpl": ("Pelvis Spine1 Spine3 Neck Head", "#_Collar #_Shoulder #_Elbow #_Wrist #_Hip #_Knee #_Ankle #_Foot", "L"),
    "makehuman": ("root spine05 spine01 neck01 head",
                  "clavicle.# upperarm01.# lowerarm01.# wrist.# upperleg01.# lowerleg01.# foot.# toe1-1.#", "L"),
    "arkit": ("hips_joint spine_1_joint spine_7_joint neck_1_joint head_joint",
              "#_shoulder_1_joint #_arm_joint #_forearm_joint #_hand_joint #_upLeg_joint #_leg_joint #_foot_joint "
              "#_toes_joint", "left"),
}  # fmt: skip


def _skeleton(convention: str, prefix: str = ""):
    middle, pattern, left = CONVENTIONS[convention]
    right = {"Left": "Right", "left": "right", "L": "R", "l": "r"}[left]
    middle = middle.split()
    names, parents = list(middle), [place - 1 for place in range(len(middle))]
    chest = len(middle) - 3
    for side in (left, right):
        for k, part in enumerate(pattern.replace("#", side).split()):
            parents.append(chest if k == 0 else 0 if k == 4 else len(names) - 1)
            names.append(part)
    return [prefix + name for name in names], np.array(parents), chest


@pytest.mark.parametrize("prefix", ["", "mixamorig:", "mixamorig1:", "mixamorig_", "Armature|Actor_"])
@pytest.mark.parametrize("convention", CONVENTIONS)
@pytest.mark.parametrize("tree", [True, False])
def test_conventions(convention, prefix, tree):
    if prefix.startswith("Armature") and convention in ("asf", "biped", "vroid"):
        pytest.skip("nobody names them so")
    names, parents, chest = _skeleton(convention, prefix)
    found = match_joints("motion", names, parents if tree else np.full(len(names), -1))
    first = len(names) - 16
    for side, start in (("Left", first), ("Right", first + 8)):
        for k, part in enumerate(("Shoulder", "Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot", "ToeBase")):
            assert names[found.joints[side + part]] == names[start + k], part
    if tree:
        assert found.joints["Hips"] == 0 and found.trunk == tuple(range(1, chest + 1))
        assert (found.joints["Neck"], found.joints["Head"]) == (chest + 1, chest + 2)
    else:
        assert found.joints["Hips"] == 0 and found.joints["Head"] == chest + 2


@pytest.mark.parametrize(
    ("name", "count"), [("kinect_v1", 20), ("kinect_v2", 25), ("azure_kinect", 32), ("arkit", 91), ("mediapipe", 33)]
)
def test_trackers(name, count):
    joints = JOINT_SETS[name]
    assert len(joints) == len(set(joints)) == count
    found = match_joints(name, joints, np.full(count, -1)).joints
    for bone, place in found.items():
        for side, other in (("Left", "right"), ("Right", "left")):
            if bone.startswith(side):
                assert side.lower() in joints[place].lower() and other not in joints[place].lower()
    assert {f"{side}{part}" for side in ("Left", "Right") for part in LIMBS} <= found.keys()


@pytest.mark.parametrize(
    ("names", "bones"),
    [
        ("Hip Ab Chest Neck Head LShoulder LUArm LFArm LHand RShoulder RUArm RFArm RHand LThigh LShin LFoot LToe "
         "RThigh RShin RFoot RToe",
         "LeftShoulder=LShoulder LeftArm=LUArm RightForeArm=RFArm RightToeBase=RToe Hips=Hip"),
        ("pelvis lThighBend lThighTwist lShin lFoot lToe rThighBend rThighTwist rShin rFoot rToe chestUpper lCollar "
         "lShldrBend lShldrTwist lForearmBend lForearmTwist lHand rCollar rShldrBend rForearmBend rHand neckLower head",
         "LeftUpLeg=lThighBend LeftArm=lShldrBend RightForeArm=rForearmBend Neck=neckLower LeftShoulder=lCollar"),
        ("Nose Neck RShoulder RElbow RWrist LShoulder LElbow LWrist MidHip RHip RKnee RAnkle LHip LKnee LAnkle LBigToe "
         "LSmallToe LHeel RBigToe RSmallToe RHeel",
         "LeftArm=LShoulder RightHand=RWrist LeftToeBase=LBigToe Hips=MidHip"),
        ("Character1_Hips Character1_LeftArm Character1_LeftForeArm Character1_LeftHand Character1_RightArm "
         "Character1_RightForeArm Character1_RightHand Character1_LeftUpLeg Character1_LeftLeg Character1_LeftFoot "
         "Character1_RightUpLeg Character1_RightLeg Character1_RightFoot", "LeftLeg=Character1_LeftLeg"),
        ("DEF-spine DEF-upper_arm.L DEF-upper_arm.L.001 DEF-forearm.L DEF-hand.L DEF-thigh.L DEF-thigh.L.001 "
         "DEF-shin.L DEF-foot.L "
         "MCH-foot.L DEF-upper_arm.R DEF-forearm.R DEF-hand.R DEF-thigh.R DEF-shin.R DEF-foot.R",
         "LeftArm=DEF-upper_arm.L LeftUpLeg=DEF-thigh.L LeftFoot=DEF-foot.L"),
    ],
)  # fmt: skip
def test_more_programs(names, bones):
    names = names.split()
    found = match_joints("motion", names, np.full(len(names), -1)).joints
    for pair in bones.split():
        bone, name = pair.split("=")
        assert names[found[bone]] == name


def test_zero_bones_and_split_necks_of_cgspeed():
    names = (
        "Hips LHipJoint LeftUpLeg LeftLeg LeftFoot LeftToeBase RHipJoint RightUpLeg RightLeg RightFoot RightToeBase "
        "LowerBack Spine Spine1 Neck Neck1 Head "
        "LeftShoulder LeftArm LeftForeArm LeftHand LeftFingerBase LFingers LThumb "
        "RightShoulder RightArm RightForeArm RightHand RightFingerBase RFingers RThumb"
    ).split()
    parents = [-1, 0, 1, 2, 3, 4, 0, 6, 7, 8, 9, 0, 11, 12, 13, 14, 15, 13, 17, 18, 19, 20, 21, 20]
    parents += [13, 24, 25, 26, 27, 28, 27]
    found = match_joints("cgspeed", names, np.array(parents))
    assert [names[k] for k in found.trunk] == ["LowerBack", "Spine", "Spine1"]
    assert names[found.joints["Neck"]] == "Neck1"
    assert {k: names[v] for k, v in found.fingers.items()} == {
        "LeftTip": "LFingers", "LeftThumb": "LThumb", "RightTip": "RFingers", "RightThumb": "RThumb"}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "side", "part"),
    [
        ("mixamorig:LeftArm", "Left", "arm"),
        ("mixamorigRightUpLeg", "Right", "upleg"),
        ("LHipJoint", "Left", "hipjoint"),
        ("rfemur", "Right", "femur"),
        ("lThighBend", "Left", "thighbend"),
        ("DEF-upper_arm.L", "Left", "upperarm"),
        ("HandTipLeft", "Left", "handtip"),
        ("K4ABT_JOINT_WRIST_RIGHT", "Right", "wrist"),
        ("leg", "", "leg"),
        ("upperarm_twist_01_l", "", ""),
        ("hand_ik.R", "", ""),
        ("Head", "", "head"),
    ],
)
def test_names_taken_apart(name, side, part):
    assert side_and_part(name) == (side, part)


def test_an_unknown_skeleton_is_one_message_with_what_is_missing():
    with pytest.raises(MirrorScanError) as error:
        match_joints("dog.bvh", ["Root", "Tail", "LeftPaw"], np.array([-1, 0, 0]))
    assert "dog.bvh" in str(error.value) and "LeftForeArm" in str(error.value) and "\n" not in str(error.value)
    names, parents, _ = _skeleton("mixamo")
    names[names.index("LeftForeArm")] = "LeftGizmo"
    with pytest.raises(MirrorScanError, match="not found: LeftForeArm\\."):
        match_joints("odd.bvh", names, parents)
