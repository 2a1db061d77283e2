"""Extras of an armature: bones that hands and feet follow (IK), and Rigify's metarig placed on the joints."""

from __future__ import annotations

import addon_utils
import bpy
from mathutils import Vector

from ...core.avatar.avatar_file import PREFIX
from ...core.avatar.skeleton import BONES, Skeleton
from ...core.errors import OutputError
from ..language.texts import say
from .armature import edit_mode
from .scan_records import CONTROL

_LIMBS = {"LeftHand": "LeftForeArm", "RightHand": "RightForeArm", "LeftFoot": "LeftLeg", "RightFoot": "RightLeg"}


def add_controls(armature: bpy.types.Object) -> None:
    """A bone for each hand and foot, which the two bones of the arm or leg follow; elbows and knees bend one way."""
    with edit_mode(armature):
        bones = armature.data.edit_bones
        for end in _LIMBS:
            made = bones.new(CONTROL + end)
            own = bones[PREFIX + end]
            made.head, made.tail, made.roll = own.head, own.tail, own.roll
            made.use_deform = False
    for end, lower in _LIMBS.items():
        bone = armature.pose.bones[PREFIX + lower]
        bone.lock_ik_y = bone.lock_ik_z = True
        reach = bone.constraints.new("IK")
        reach.target, reach.subtarget, reach.chain_count = armature, CONTROL + end, 2
        turn = armature.pose.bones[PREFIX + end].constraints.new("COPY_ROTATION")
        turn.target, turn.subtarget = armature, CONTROL + end


def switch_controls(armature: bpy.types.Object, on: bool) -> bool:
    """Have limbs follow their control bones, or their own keys. Returns whether control bones led them before."""
    led = False
    for bone in armature.pose.bones:
        for constraint in bone.constraints:
            if getattr(constraint, "subtarget", "").startswith(CONTROL):
                led |= constraint.enabled
                constraint.enabled = on
    return led


def add_metarig(avatar: bpy.types.Object, skeleton: Skeleton, unit: float) -> bpy.types.Object:
    """Rigify's human metarig with its bones on the joints of ``skeleton`` [m], beside the avatar's armature.

    Raises
    ------
    OutputError
        When this Blender has no Rigify.
    """
    if addon_utils.enable("rigify", default_set=True) is None:
        raise OutputError(
            say("Rigify is not installed in this Blender; add the skeleton without its metarig"), code="other"
        )
    bpy.ops.object.armature_human_metarig_add()
    metarig = bpy.context.object
    metarig.name = f"{avatar.name} Metarig"
    metarig.matrix_world = avatar.matrix_world
    with edit_mode(metarig):
        bones = metarig.data.edit_bones
        _remove_fine_bones(bones)
        for name, (head, tail) in _metarig_places(skeleton, unit).items():
            bone = bones.get(name)
            if bone is not None:
                bone.head, bone.tail = head, tail
    return metarig


def _metarig_places(skeleton: Skeleton, unit: float) -> dict[str, tuple[Vector, Vector]]:
    """Head and tail of each of the metarig's bones that a skeleton says something of."""
    at = {name: Vector(joint / unit) for name, joint in zip(BONES, skeleton.joints, strict=True)}
    crown, left_tip, right_tip, left_toe, right_toe = (Vector(end / unit) for end in skeleton.ends)
    chain = [at[name] for name in ("Hips", "Spine", "Spine1", "Spine2", "Neck")]
    middle = chain[4].lerp(at["Head"], 0.5)
    stops = [*chain, middle, at["Head"], crown]
    names = ["spine", "spine.001", "spine.002", "spine.003", "spine.004", "spine.005", "spine.006"]
    ways = dict(zip(names, zip(stops[:-1], stops[1:], strict=True), strict=True))
    for side, end, tip, toe in (("Left", ".L", left_tip, left_toe), ("Right", ".R", right_tip, right_toe)):
        ways |= {
            f"shoulder{end}": (at[f"{side}Shoulder"], at[f"{side}Arm"]),
            f"upper_arm{end}": (at[f"{side}Arm"], at[f"{side}ForeArm"]),
            f"forearm{end}": (at[f"{side}ForeArm"], at[f"{side}Hand"]),
            f"hand{end}": (at[f"{side}Hand"], at[f"{side}Hand"].lerp(tip, 0.5)),
            f"pelvis{end}": (at["Hips"], at[f"{side}UpLeg"]),
            f"thigh{end}": (at[f"{side}UpLeg"], at[f"{side}Leg"]),
            f"shin{end}": (at[f"{side}Leg"], at[f"{side}Foot"]),
            f"foot{end}": (at[f"{side}Foot"], at[f"{side}ToeBase"]),
            f"toe{end}": (at[f"{side}ToeBase"], toe),
        }
        heel = Vector((at[f"{side}Foot"].x, at[f"{side}Foot"].y, 0.0))
        wide = 0.03 / unit
        ways[f"heel.02{end}"] = (heel - Vector((wide, 0, 0)), heel + Vector((wide, 0, 0)))
        chest = at["Spine2"].lerp(at[f"{side}Arm"], 0.5)
        ways[f"breast{end}"] = (chest, chest + Vector((0.0, -0.1 / unit, 0.0)))
    return ways


def _remove_fine_bones(bones: bpy.types.ArmatureEditBones) -> None:
    """Take away the metarig's face and fingers, of which a scan's skeleton says nothing."""
    for root in ("face", "palm.01.L", "palm.02.L", "palm.03.L", "palm.04.L", "palm.01.R", "palm.02.R", "palm.03.R",
                 "palm.04.R"):  # fmt: skip
        bone = bones.get(root)
        if bone is not None:
            for child in [*bone.children_recursive, bone]:
                bones.remove(child)
