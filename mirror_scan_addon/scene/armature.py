"""Skeletons as Blender armatures: bones, vertex groups, clips, and back.

Bones have Mixamo's names and axes, so that its clips play by name alone.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import bpy
import numpy as np
from mathutils import Vector

from ...core.avatar.avatar_file import PREFIX, Avatar, bone_named
from ...core.avatar.bone_axes import rest_axes
from ...core.avatar.clip import Clip
from ...core.avatar.pose import Pose, SkinWeights, relative_to_parents
from ...core.avatar.skeleton import BONES, END_BONES, PARENTS, Skeleton
from ...core.errors import CaptureError
from ...core.numeric.rotations import continuous, quaternions
from ..language.texts import say
from .avatar_objects import read_surface, size_of
from .scan_records import CONTROL, armature_of
from .units import metres_per_unit

_NOT_BODY = ("mirror_scan_garment", "mirror_scan_collider")  # custom properties that :mod:`.cloth` gives
_SHORTEST = 0.002  # Blender removes bones without length [m]


def add_armature(
    avatar: bpy.types.Object, skeleton: Skeleton, weights: SkinWeights, collection: bpy.types.Collection,
    unit: float = 1.0,
) -> bpy.types.Object:  # fmt: skip
    """An armature for a mesh object, which it moves by vertex groups from now on; linked to ``collection``.

    Bones stand in front of the mesh. The collection must be in the context's view layer: Blender makes bones only
    there, in edit mode.

    Parameters
    ----------
    avatar : bpy.types.Object
        The armature takes its place, under its parent, and it hangs on the armature from then on.
    skeleton : Skeleton
        In the mesh's frame [m].
    weights : SkinWeights
        Of the mesh's vertices.
    collection : bpy.types.Collection
    unit : float
        Metres in a Blender unit.
    """
    data = bpy.data.armatures.new(f"{avatar.name} Skeleton")
    armature = bpy.data.objects.new(data.name, data)
    armature.show_in_front = True
    collection.objects.link(armature)
    layer = bpy.context.view_layer
    layer.update()
    with edit_mode(armature):
        _place_bones(data, skeleton, unit)
    data["confidence"] = skeleton.confidence.tolist()
    use_quaternions(armature)
    set_weights(avatar, weights)
    for left in [m for m in avatar.modifiers if m.type == "ARMATURE" and m.object is None]:
        avatar.modifiers.remove(left)  # of an armature that was deleted
    modifier = avatar.modifiers.new("Armature", "ARMATURE")
    modifier.object = armature
    armature.parent, armature.parent_type = avatar.parent, avatar.parent_type
    armature.parent_bone = avatar.parent_bone
    armature.matrix_parent_inverse = avatar.matrix_parent_inverse
    layer.update()
    armature.matrix_world = avatar.matrix_world
    layer.update()
    avatar.parent, avatar.parent_type = armature, "OBJECT"
    avatar.matrix_parent_inverse.identity()
    avatar.matrix_basis.identity()
    return armature


def use_quaternions(armature: bpy.types.Object) -> None:
    """Have the bones turn by quaternions, which poses and clips are made of."""
    for bone in armature.pose.bones:
        if not bone.name.startswith(CONTROL):
            bone.rotation_mode = "QUATERNION"


def _place_bones(data: bpy.types.Armature, skeleton: Skeleton, unit: float) -> None:
    """In edit mode: the bones where ``skeleton`` has them; those that are missing are made."""
    axes, tails = rest_axes(skeleton), skeleton.tails()
    for bone, (name, parent) in enumerate(zip(BONES, PARENTS, strict=True)):
        made = data.edit_bones.get(PREFIX + name) or data.edit_bones.new(PREFIX + name)
        length = max(float(np.linalg.norm(tails[bone] - skeleton.joints[bone])), _SHORTEST)
        made.head = Vector(skeleton.joints[bone] / unit)
        made.tail = Vector((skeleton.joints[bone] + length * axes[bone][:, 1]) / unit)
        made.align_roll(Vector(axes[bone][:, 2]))
        if parent >= 0:
            made.parent = data.edit_bones[PREFIX + BONES[parent]]
        control = data.edit_bones.get(CONTROL + name)
        if control is not None:
            control.head, control.tail, control.roll = made.head, made.tail, made.roll


def set_weights(avatar: bpy.types.Object, weights: SkinWeights) -> None:
    """Weights as vertex groups, which replace those of the same names."""
    for name in BONES:
        old = avatar.vertex_groups.get(PREFIX + name)
        if old is not None:
            avatar.vertex_groups.remove(old)
    groups = [avatar.vertex_groups.new(name=PREFIX + name) for name in BONES]
    for column in range(weights.index.shape[1]):
        held = np.flatnonzero(weights.weight[:, column] > 0)
        held_by, share = weights.index[held, column].tolist(), weights.weight[held, column].tolist()
        for vertex, bone, weight in zip(held.tolist(), held_by, share, strict=True):
            groups[bone].add((vertex,), weight, "REPLACE")


def add_clip(armature: bpy.types.Object, clip: Clip, unit: float = 1.0, start: int = 0) -> bpy.types.Action:
    """A clip as an action of the armature, a key a frame, from frame ``start`` on; it becomes the armature's own.

    A loop repeats for ever; what it walks over the floor it walks on.
    """
    frames = len(clip.rotations)
    use_quaternions(armature)
    places, turns = _in_bones(armature, clip.rotations, clip.translations, unit)
    turns = continuous(turns)
    action = bpy.data.actions.new(clip.name or "Motion")
    armature.animation_data_create().action = action
    slot = action.slots.new("OBJECT", armature.name)
    armature.animation_data.action_slot = slot
    curves = action.layers.new("Layer").strips.new(type="KEYFRAME").channelbag(slot, ensure=True).fcurves
    tracks = {f'pose.bones["{PREFIX}{BONES[0]}"].location': places}
    tracks |= {f'pose.bones["{PREFIX}{name}"].rotation_quaternion': turns[:, bone] for bone, name in enumerate(BONES)}
    for path, values in tracks.items():
        for index in range(values.shape[1]):
            curve = curves.new(path, index=index)
            curve.keyframe_points.add(frames)
            keys = np.column_stack((start + np.arange(frames), values[:, index])).astype(np.float32)
            curve.keyframe_points.foreach_set("co", keys.ravel())
            curve.keyframe_points.foreach_set("interpolation", np.ones(frames, np.uint8))  # linear
            if clip.loops:
                cycle = curve.modifiers.new("CYCLES")
                if values is places:
                    cycle.mode_before = cycle.mode_after = "REPEAT_OFFSET"
            curve.update()
    return action


def show_pose(armature: bpy.types.Object, pose: Pose, unit: float = 1.0) -> None:
    """Have the armature, whose bones turn by quaternions, stand in ``pose``; it gets no keys."""
    places, turns = _in_bones(armature, pose.rotations[None], pose.translation[None], unit)
    bones = armature.pose.bones
    bones[PREFIX + BONES[0]].location = places[0]
    for name, turn in zip(BONES, turns[0], strict=True):
        bones[PREFIX + name].rotation_quaternion = turn


def _in_bones(
    armature: bpy.types.Object, rotations: np.ndarray, translations: np.ndarray, unit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Poses as the bones have them: places (F, 3) of the hips, turns (F, 22, 4) w x y z relative to the parent."""
    bones = armature.data.bones
    axes = np.array([bones[PREFIX + name].matrix_local.to_3x3() for name in BONES])
    turns = quaternions(np.swapaxes(axes, 1, 2) @ relative_to_parents(rotations) @ axes)[..., [3, 0, 1, 2]]
    return translations @ axes[0] / unit, turns


def make_own(item: bpy.types.Object) -> bool:
    """Give an object a mesh or armature of its own where others have the same; whether they did."""
    others = [other for other in bpy.data.objects if other != item and other.data == item.data]
    if others:
        name = item.data.name
        item.data = item.data.copy()
        item.data.name = name  # Blender adds a number, for the others keep it
    return bool(others)


def move_rest(
    avatar: bpy.types.Object, armature: bpy.types.Object, vertices: np.ndarray, skeleton: Skeleton, unit: float
) -> None:
    """Another rest pose: vertices (V, 3) and joints [m] where they shall rest. The armature's motion is taken off."""
    avatar.data.attributes["position"].data.foreach_set("vector", (vertices / unit).astype(np.float32).ravel())
    avatar.data.update()
    if armature.animation_data is not None:
        armature.animation_data.action = None
    for bone in armature.pose.bones:
        bone.matrix_basis.identity()
    with edit_mode(armature):
        _place_bones(armature.data, skeleton, unit)


@contextlib.contextmanager
def edit_mode(armature: bpy.types.Object) -> Iterator[None]:
    """An armature of the context's view layer in edit mode, in which alone bones can be made and placed."""
    objects = bpy.context.view_layer.objects
    active = objects.active
    objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        yield
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")
        objects.active = active


@contextlib.contextmanager
def object_mode(context: bpy.types.Context, target: bpy.types.Scene) -> Iterator[None]:
    """Object mode in ``target``, whichever scene and mode the user is in by now."""
    if context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    if target == context.scene:
        yield
        return
    with context.temp_override(scene=target, view_layer=target.view_layers[0]):
        yield


def action_of(armature: bpy.types.Object) -> bpy.types.Action | None:
    """The motion that an armature has."""
    return armature.animation_data.action if armature.animation_data is not None else None


def unit_of(item: bpy.types.Object, scene: bpy.types.Scene) -> float:
    """Metres in one of an object's own units, the mean along its axes."""
    return float(size_of(item, metres_per_unit(scene)).mean())


def body_of(item: bpy.types.Object) -> bpy.types.Object:
    """The mesh that an armature moves, or the mesh object itself.

    Raises
    ------
    CaptureError
        When the armature moves none.
    """
    if item.type == "MESH":
        return item
    for child in item.children_recursive:
        if child.type == "MESH" and armature_of(child) == item and not set(_NOT_BODY).intersection(child.keys()):
            if child.users_scene:  # one that was deleted may still be of use to others, such as its garments
                return child
    raise CaptureError(
        say("{name} moves no mesh; select an avatar with a skeleton").format(name=item.name), code="no_skeleton"
    )


def read_skeleton(armature: bpy.types.Object, unit: float = 1.0) -> Skeleton:
    """The skeleton of an armature, in its own frame [m]."""
    bones = {bone_named(bone.name): bone for bone in armature.data.bones}
    joints = unit * np.array([bones[bone].head_local for bone in range(len(BONES))])
    ends = unit * np.array([bones[bone].tail_local for bone in END_BONES])
    confidence = armature.data.get("confidence")
    known = np.ones(len(BONES)) if confidence is None else np.array(confidence, dtype=np.float64)
    return Skeleton(joints, ends, known)


def read_avatar(avatar: bpy.types.Object, unit: float = 1.0) -> Avatar:
    """A mesh object with skeleton, weights and the armature's motion, in metres, in its rest pose.

    Raises
    ------
    CaptureError
        When no armature with Mixamo's bones moves it.
    """
    armature = armature_of(avatar)
    if armature is None:
        raise CaptureError(say("{name} has no skeleton; add one first").format(name=avatar.name), code="no_skeleton")
    mesh = read_surface(avatar, np.full(3, unit))
    return Avatar(mesh, read_skeleton(armature, unit), read_weights(avatar), ())


def read_weights(avatar: bpy.types.Object) -> SkinWeights:
    """Weights of a mesh object's vertex groups: the four largest a vertex, their sum 1."""
    bone_of = {group.index: bone_named(group.name) for group in avatar.vertex_groups}
    dense = np.zeros((len(avatar.data.vertices), len(BONES)), np.float32)
    for row, vertex in zip(dense, avatar.data.vertices, strict=True):
        for member in vertex.groups:
            bone = bone_of.get(member.group)
            if bone is not None:
                row[bone] += member.weight
    index = np.argsort(-dense, axis=1, kind="stable")[:, :4]
    weight = np.take_along_axis(dense, index, axis=1)
    total = weight.sum(axis=1, keepdims=True)
    weight = np.where(total > 0, weight / np.maximum(total, 1e-9), np.float32([1, 0, 0, 0]))
    return SkinWeights(np.where(weight > 0, index, 0).astype(np.uint8), weight.astype(np.float32))
