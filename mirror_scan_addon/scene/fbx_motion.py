"""The motion of an FBX file, read by Blender's own importer, as core takes it."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ...core.errors import MirrorScanError, OutputError
from ...core.motion import Motion
from ..language.texts import say
from .armature import action_of
from .blender_files import enabled, quiet, reason_of, shown, temporary_scene

_UP = np.array([0.0, 0, 1])


def read_fbx_motion(path: str | Path) -> Motion:
    """The longest motion of the armature with the most bones in an FBX file; what is open in this Blender stays so.

    Frames are those of the file, at its rate. Leaf bones' tips become joints named after their bone with ``_End``.

    Raises
    ------
    MirrorScanError
        The file cannot be read, or nothing in it moves a skeleton.
    """
    path = Path(path)
    if not path.is_file():
        raise MirrorScanError(say("{path}: there is no such file").format(path=path), code="gone")
    with temporary_scene() as scene, enabled("io_scene_fbx"), shown(scene), quiet():
        before = set(bpy.data.actions)
        try:
            bpy.ops.import_scene.fbx(filepath=str(path), ignore_leaf_bones=False, automatic_bone_orientation=False)
        except (RuntimeError, OutputError) as error:
            said = reason_of(str(error))
            text = say("{path}: Blender cannot read it: {reason}")
            raise MirrorScanError(text.format(path=path, reason=said), code="motion") from error
        moved = [thing for thing in scene.objects if thing.type == "ARMATURE" and action_of(thing) is not None]
        if not moved:
            text = say("{path}: nothing in it moves a skeleton; export it with its animation")
            raise MirrorScanError(text.format(path=path), code="motion")
        armature = max(moved, key=lambda thing: len(thing.data.bones))
        _take_longest(armature, [action for action in bpy.data.actions if action not in before])
        return _motion(path.name, scene, armature)


def _take_longest(armature: bpy.types.Object, actions: list[bpy.types.Action]) -> None:
    """Have the armature move by the longest of the ``actions`` that are of it: the importer gives it the first.

    The importer begins an action's name with that of the object.
    """
    own = [action for action in actions if action.name.startswith(f"{armature.name}|") and action.slots]
    longest = max(own, key=lambda action: float(np.ptp(action.frame_range)), default=armature.animation_data.action)
    if longest != armature.animation_data.action:
        armature.animation_data.action = longest
        armature.animation_data.action_slot = longest.slots[0]


def _motion(name: str, scene: bpy.types.Scene, armature: bpy.types.Object) -> Motion:
    """Every frame of the armature's action."""
    bones = list(armature.data.bones)  # parents come first
    places = {bone.name: place for place, bone in enumerate(bones)}
    parents = [places[bone.parent.name] if bone.parent else -1 for bone in bones]
    leaves = [place for place, bone in enumerate(bones) if not bone.children]
    joints = (*places, *(f"{bones[place].name}_End" for place in leaves))
    frames = _frames(armature.animation_data.action, scene.render.fps_base)
    matrices = np.empty((len(frames), len(bones), 4, 4))
    for row, frame in enumerate(frames):
        scene.frame_set(int(frame // 1), subframe=float(frame % 1))
        world = np.array(armature.matrix_world)
        matrices[row] = [world @ np.array(armature.pose.bones[bone.name].matrix) for bone in bones]
    # The rest pose stands as the armature does in the first frame.
    scene.frame_set(round(frames[0]))
    world = np.array(armature.matrix_world)
    rest = np.array([world @ np.array(bone.matrix_local) for bone in bones])
    tips = np.array([world[:3, :3] @ np.array(bone.tail_local) + world[:3, 3] for bone in bones])[leaves]
    turns = _unscaled(matrices[..., :3, :3]) @ np.swapaxes(_unscaled(rest[:, :3, :3]), -1, -2)
    lengths = np.array([[0, bones[place].length, 0, 1] for place in leaves])
    ends = np.einsum("fbij,bj->fbi", matrices[:, leaves, :3], lengths)
    return Motion(
        name,
        joints,
        np.array([*parents, *leaves]),
        np.concatenate([matrices[..., :3, 3], ends], axis=1),
        np.concatenate([turns, turns[:, leaves]], axis=1),
        np.concatenate([rest[:, :3, 3], tips]),
        scene.render.fps / scene.render.fps_base,
        _UP,
    )


def _frames(action: bpy.types.Action, base: float) -> np.ndarray:
    """Blender's frames (F,) at which the file's frames are.

    At rates that are no whole numbers Blender 5.0's importer keeps the rate in ``fps_base`` but leaves it out of the
    keys' times.
    """
    curves = [curve for layer in action.layers for strip in layer.strips for bag in strip.channelbags
              for curve in bag.fcurves]  # fmt: skip
    times = np.unique(np.concatenate([[key.co[0] for key in curve.keyframe_points] for curve in curves]))
    off = {step: np.abs((times - times[0]) / step - np.round((times - times[0]) / step)).max() for step in (1.0, base)}
    step = min(off, key=lambda each: off[each])
    return times[0] + step * np.arange(round((times[-1] - times[0]) / step) + 1)


def _unscaled(matrices: np.ndarray) -> np.ndarray:
    """The rotations (..., 3, 3) in matrices with scale."""
    u, _, vt = np.linalg.svd(matrices)
    return u @ vt
