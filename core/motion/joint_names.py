"""Whose joint is it? Names of many programs and sensors become the 22 of our skeleton.

A name is taken apart into side and part, whatever its prefix and spelling. Where a name means different joints in
different programs (``LeftShoulder`` is the collar bone of Mixamo and the upper arm of CMU), the other names of the same
limb decide. Trunk and neck go by the tree, where it is known: their names and numbers differ most.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import MirrorScanError

# Parts by the names programs give them, in small letters; of several that are present, the first is taken.
_LIMBS = {
    "Arm": "upperarm uparm uarm armupper humerus shldrbend shldr upperarm01 armstretch arm",
    "ForeArm": "forearm lowerarm lowarm armlower farm forearmbend elbow radius lowerarm01 forearmstretch",
    "Hand": "wrist hand",
    "UpLeg": "upperleg upleg uleg legupper thigh thighbend femur upperleg01 thighstretch hip hipjoint",
    "Leg": "lowerleg lowleg lleg leglower knee shin calf tibia lowerleg01 legstretch",
    "Foot": "ankle foot",
    "ToeBase": "toebase toe toes ball toe0 toe01 toe11 bigtoe footindex foot",
    "Shoulder": "clavicle collar collarbone shoulder1 shoulder01 shoulder",
}
_MIDDLE = {
    "Hips": "hips pelvis hip hipcenter hipscenter spinebase midhip root spine",
    "Neck": "neck neck1 neck01 lowerneck necklower shouldercenter spineshoulder",
    "Head": "head head1 head01 spine006",
}
_SPINE_NAME = re.compile(r"(spine|chest|upperchest|lowerback|upperback|thorax|torso|abdomen|navel|[lt]\d+$)")
_FINGERS = {"Thumb": "thumb", "Index": "index", "Middle": "mid", "Pinky": "pinky|little", "Tip": "fingers|tip|end"}
_PREFIX = re.compile(
    r"^(mixamorig\d*[_:]?|bip(ed|01|001)?[\s_]+|j_bip_(c_)?|valvebiped[._]|cc_base_|def[-_]|k4abt_joint_|jointtype_?)",
    re.I,
)
_SUFFIX = re.compile(r"[\s_.-](joint|jnt|bone|bind)$", re.I)
_HELPERS = {"ik", "fk", "pole", "target", "twist", "roll", "ctrl", "mch", "org", "vis", "tweak"}
_SIDES = {"l": "Left", "left": "Left", "r": "Right", "right": "Right"}
_LONE_PARTS = set(" ".join(_LIMBS.values()).split()) | {"thumb", "fingers", "collar"}
_NEEDED = (
    "Hips",
    *(side + part for part in ("Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot") for side in ("Left", "Right")),
)


@dataclass(frozen=True)
class JointMap:
    """Which of the file's joints is which of ours.

    Parameters
    ----------
    joints : dict of str to int
        Name in ``BONES`` (without ``Spine``s) to place in the file. The joints of arms and legs are all there, and in
        a tree the hips; neck, head, shoulders and toes as far as the file has them.
    trunk : tuple of int
        Joints from above the hips up to the chest, from which the arms hang.
    fingers : dict of str to int
        Each finger's knuckle, ``LeftThumb``, ``LeftIndex``, ``LeftMiddle``, ``LeftPinky``, or a ``LeftTip`` of the
        whole hand, and the right ones, as far as the file has them.
    ends : dict of str to int
        ``Head`` and the toe bases to the joint in which they end, as far as the file has it.
    """

    joints: dict[str, int]
    trunk: tuple[int, ...]
    fingers: dict[str, int]
    ends: dict[str, int]


def match_joints(name: str, joints: Sequence[str], parents: np.ndarray) -> JointMap:
    """The map of a skeleton's names.

    Parameters
    ----------
    name : str
        Of the motion, for the message.
    joints, parents
        As of :class:`.motion.Motion`; all parents -1 where only names are known.

    Raises
    ------
    MirrorScanError
        Hips, arms or legs are not recognised: lists what was not found.
    """
    joints = _without_common_prefix(joints)
    parts: dict[tuple[str, str], int] = {}
    for place, joint in enumerate(joints):
        side, part = side_and_part(joint)
        if part and not joint.endswith("_End"):
            parts.setdefault((side, part), place)
    found: dict[str, int] = {}
    for side in ("Left", "Right"):
        found |= _limbs(side, {part: place for (of, part), place in parts.items() if of == side})
    middle = {part: place for (of, part), place in parts.items() if not of}
    for bone, names in _MIDDLE.items():
        options = [middle[part] for part in names.split() if part in middle]
        if options:
            found[bone] = options[0]
    above = [_ancestors(place, parents) for place in range(len(joints))]
    tree = bool((np.asarray(parents) >= 0).any())
    if tree and "LeftUpLeg" in found and "RightUpLeg" in found:
        hips = _nearest_common(above[found["LeftUpLeg"]], above[found["RightUpLeg"]])
        found |= {"Hips": hips} if hips >= 0 else {}
    missing = [bone for bone in _NEEDED if bone not in found and (tree or bone != "Hips")]
    if missing and len(missing) <= len(_NEEDED) // 2:
        raise MirrorScanError(
            "{name}: the motion of a whole body is needed; not found: {missing}. Where they are there, name them as "
            "Mixamo does (Hips, LeftArm, LeftForeArm, LeftHand, LeftUpLeg, LeftLeg, LeftFoot)",
            name=name,
            missing=", ".join(missing),
        )
    if missing:
        raise MirrorScanError(
            "{name}: this skeleton's names are not known; not found: {missing}. Name its joints as Mixamo does "
            "(Hips, LeftArm, LeftForeArm, LeftHand, LeftUpLeg, LeftLeg, LeftFoot)",
            name=name,
            missing=", ".join(missing),
            code="motion",
        )
    if tree:
        trunk = _trunk(found, above)
        ends = _add_toes(found, above, joints)
    else:
        trunk = tuple(
            place for part, place in middle.items() if _SPINE_NAME.match(part) and place not in found.values()
        )
        ends = {}
    return JointMap(found, trunk, _fingers(joints, found, above if tree else None), ends)


def _without_common_prefix(joints: Sequence[str]) -> Sequence[str]:
    """Names without the word with which nearly all begin, as a character's name does."""
    if any(_PREFIX.match(joint) for joint in joints):
        return joints
    firsts = [
        found.group() if (found := re.match(r"[^_.\s-]+[_.\s-]+", joint.split("|")[-1])) else "" for joint in joints
    ]
    common = max(set(firsts), key=firsts.count, default="")
    if not common or firsts.count(common) < 0.8 * len(joints):
        return joints
    return [joint.split("|")[-1].removeprefix(common) for joint in joints]


def side_and_part(name: str) -> tuple[str, str]:
    """``"Left"``, ``"Right"`` or ``""``, and the part in small letters: Left and arm for ``mixamorig:LeftArm``.

    An empty part: the joint only helps others (IK, twist).
    """
    bare = _SUFFIX.sub("", _PREFIX.sub("", re.split(r"[:|]", _PREFIX.sub("", name))[-1]))
    bare = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", bare)
    words: list[str] = []
    for word in re.split(r"[^a-z0-9]+", bare.lower()):
        sided = re.fullmatch(r"(left|right)(\w+)|(\w+?)(left|right)", word)
        words.extend(part for part in (sided.groups() if sided else (word,)) if part)
    if _HELPERS & set(words):
        return "", ""
    # First and last word are where a side usually stands.
    places = [0, len(words) - 1, *range(1, len(words) - 1)] if len(words) > 1 else []
    side = next((_SIDES[words.pop(place)] for place in places if words[place] in _SIDES), "")
    part = "".join(words)
    if not side and part not in _LONE_PARTS:  # lhand, rfemur
        if part[:1] in ("l", "r") and part[1:] in _LONE_PARTS:
            return _SIDES[part[0]], part[1:]
        if part[-1:] in ("l", "r") and part[:-1] in _LONE_PARTS:
            return _SIDES[part[-1]], part[:-1]
    return side, part


def _limbs(side: str, parts: dict[str, int]) -> dict[str, int]:
    """Joints of one side's arm and leg."""
    found: dict[str, int] = {}
    for bone, names in _LIMBS.items():
        options = [parts[part] for part in names.split() if part in parts and parts[part] not in found.values()]
        if options:
            found[bone] = options[0]
    # Mixamo's Leg and Arm: the leg is below the knee, the arm above the elbow, unless that has a name of its own.
    if "leg" in parts and parts["leg"] not in found.values():
        found.setdefault("Leg" if "UpLeg" in found else "UpLeg", parts["leg"])
    if "Arm" not in found and "shoulder" in parts:  # CMU, Kinect: the joint in the shoulder, where the arm begins
        found["Arm"] = parts["shoulder"]
        if found.get("Shoulder") == found["Arm"]:
            del found["Shoulder"]
    return {side + bone: place for bone, place in found.items()}


def _ancestors(joint: int, parents: np.ndarray) -> list[int]:
    """The joint and those above it, up to the root."""
    out = []
    while joint >= 0:
        out.append(joint)
        joint = int(parents[joint])
    return out


def _nearest_common(first: list[int], second: list[int]) -> int:
    """The nearest joint that is above both, -1 without one."""
    return next((joint for joint in first[1:] if joint in second[1:]), -1)


def _trunk(found: dict[str, int], above: list[list[int]]) -> tuple[int, ...]:
    """Joints from above the hips up to the chest; puts neck and head right by the tree."""
    chest = _nearest_common(above[found["LeftArm"]], above[found["RightArm"]])
    if chest < 0 or found["Hips"] not in above[chest]:
        return ()
    if "Head" in found and chest in above[found["Head"]][1:]:
        neck = above[found["Head"]][1 : above[found["Head"]].index(chest)]
        found.pop("Neck", None)
        if neck:  # of a neck in parts, the one that carries the head
            found["Neck"] = neck[0]
    return tuple(above[chest][: above[chest].index(found["Hips"])][::-1])


def _add_toes(found: dict[str, int], above: list[list[int]], joints: Sequence[str]) -> dict[str, int]:
    """Toes without a known name, and where head and toes end."""
    ends: dict[str, int] = {}
    for bone in ("LeftFoot", "RightFoot", "LeftToeBase", "RightToeBase", "Head"):
        if bone not in found:
            continue
        below = [place for place in range(len(joints)) if above[place][1:2] == [found[bone]]]
        toe = bone.replace("Foot", "ToeBase")
        if bone.endswith("Foot"):
            if toe not in found and len(below) == 1:
                found[toe] = below[0]
        else:
            at = [place for place in below if len(below) == 1 or joints[place].lower().endswith("end")]
            if at:
                ends[bone] = at[-1]
    return ends


def _fingers(joints: Sequence[str], found: dict[str, int], above: list[list[int]] | None) -> dict[str, int]:
    """Knuckles, or a tip of the whole hand."""
    chains: dict[str, list[int]] = {}
    for place, joint in enumerate(joints):
        side, part = side_and_part(joint)
        if above is not None:
            side = next((s for s in ("Left", "Right") if found[f"{s}Hand"] in above[place][1:]), "")
        if not side or place in found.values():
            continue
        if above is None and "hand" not in part and not re.search("thumb|index|mid|pinky", part):
            continue
        if re.search("foot|toe|eye", part):
            continue
        finger = next((finger for finger, pattern in _FINGERS.items() if re.search(pattern, part)), None)
        if finger:
            chains.setdefault(side + finger, []).append(place)
    # A chain with the bone inside the palm has its knuckle second.
    return {
        finger: chain[1] if len([place for place in chain if not joints[place].endswith("_End")]) > 3 else chain[0]
        for finger, chain in chains.items()
    }


def _sided(text: str) -> list[str]:
    return [name.replace("#", side) for side in ("left", "right") for name in text.split()]


def _split(text: str) -> tuple[str, ...]:
    return tuple(text.split())


_ARKIT_ARM = "#_shoulder_1 #_arm #_forearm #_hand " + " ".join(
    f"#_hand{finger}Start #_hand{finger}_1 #_hand{finger}_2 "
    + (f"#_hand{finger}_3 " if finger != "Thumb" else "")
    + f"#_hand{finger}End"
    for finger in ("Index", "Mid", "Pinky", "Ring", "Thumb")
)
_ARKIT_EYE = "#_eye #_eyeLowerLid #_eyeUpperLid #_eyeball"
_ARKIT_LEG = "#_upLeg #_leg #_foot #_toes #_toesEnd"


def _arkit() -> tuple[str, ...]:
    legs, arms, eyes = _sided(_ARKIT_LEG), _sided(_ARKIT_ARM), _sided(_ARKIT_EYE)
    half, eye = len(arms) // 2, len(eyes) // 2
    names = ["hips", *legs, *(f"spine_{k}" for k in range(1, 8)), *arms[:half], *(f"neck_{k}" for k in range(1, 5))]
    names += ["head", "jaw", "chin", *eyes[:eye], "nose", *eyes[eye:], *arms[half:]]
    return ("root", *(f"{name}_joint" for name in names))


JOINT_SETS = {
    "kinect_v1": _split(
        "HIP_CENTER SPINE SHOULDER_CENTER HEAD SHOULDER_LEFT ELBOW_LEFT WRIST_LEFT HAND_LEFT SHOULDER_RIGHT "
        "ELBOW_RIGHT WRIST_RIGHT HAND_RIGHT HIP_LEFT KNEE_LEFT ANKLE_LEFT FOOT_LEFT HIP_RIGHT KNEE_RIGHT ANKLE_RIGHT "
        "FOOT_RIGHT"
    ),
    "kinect_v2": _split(
        "SpineBase SpineMid Neck Head ShoulderLeft ElbowLeft WristLeft HandLeft ShoulderRight ElbowRight WristRight "
        "HandRight HipLeft KneeLeft AnkleLeft FootLeft HipRight KneeRight AnkleRight FootRight SpineShoulder "
        "HandTipLeft ThumbLeft HandTipRight ThumbRight"
    ),
    "azure_kinect": _split(
        "PELVIS SPINE_NAVEL SPINE_CHEST NECK "
        "CLAVICLE_LEFT SHOULDER_LEFT ELBOW_LEFT WRIST_LEFT HAND_LEFT HANDTIP_LEFT THUMB_LEFT "
        "CLAVICLE_RIGHT SHOULDER_RIGHT ELBOW_RIGHT WRIST_RIGHT HAND_RIGHT HANDTIP_RIGHT THUMB_RIGHT "
        "HIP_LEFT KNEE_LEFT ANKLE_LEFT FOOT_LEFT HIP_RIGHT KNEE_RIGHT ANKLE_RIGHT FOOT_RIGHT "
        "HEAD NOSE EYE_LEFT EAR_LEFT EYE_RIGHT EAR_RIGHT"
    ),
    "arkit": _arkit(),
    "mediapipe": _split(
        "nose left_eye_inner left_eye left_eye_outer right_eye_inner right_eye right_eye_outer left_ear right_ear "
        "mouth_left mouth_right left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist "
        "left_pinky right_pinky left_index right_index left_thumb right_thumb left_hip right_hip left_knee right_knee "
        "left_ankle right_ankle left_heel right_heel left_foot_index right_foot_index"
    ),
}
"""Joints of body trackers in the order in which they number them."""
