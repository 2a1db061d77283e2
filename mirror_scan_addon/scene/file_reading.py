"""Avatars of .blend files and motions of .fbx files, read by Blender for the command line.

What is open in this Blender is gone afterwards.
"""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import bpy
import numpy as np

from ...core.avatar.avatar_file import Avatar
from ...core.errors import CaptureError
from ...core.motion import Motion
from ..language.texts import say
from .armature import armature_of, read_avatar
from .units import metres_per_unit


def read_blend_avatar(path: Path) -> Avatar:
    """The avatar with a skeleton in a .blend file: the active object if it is one, else the first.

    Raises
    ------
    CaptureError
        When the file cannot be read or holds none.
    """
    _open(path, bpy.ops.wm.open_mainfile)
    scene = bpy.context.scene
    active = bpy.context.view_layer.objects.active
    objects = sorted((item for item in scene.objects if item.type == "MESH"), key=lambda item: item != active)
    avatar = next((item for item in objects if armature_of(item) is not None), None)
    if avatar is None:
        text = say("{path}: no mesh in it has a skeleton; make it with “reconstruct --skeleton”")
        raise CaptureError(text.format(path=path))
    return read_avatar(avatar, metres_per_unit(scene))


def read_fbx_motion(path: Path) -> Motion:
    """The motion of the first skeleton in an FBX file, frame by frame.

    Raises
    ------
    CaptureError
        When the file cannot be read, or holds no skeleton that moves.
    """
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    _open(path, bpy.ops.import_scene.fbx)
    scene = bpy.context.scene
    armature = next((item for item in scene.objects if item.type == "ARMATURE"), None)
    action = None if armature is None or armature.animation_data is None else armature.animation_data.action
    if action is None:
        raise CaptureError(say("{path}: holds no skeleton that moves").format(path=path))
    bones = _parents_first(armature.data.bones)
    names = [bone.name for bone in bones]
    parents = np.array([-1 if bone.parent is None else names.index(bone.parent.name) for bone in bones])
    placed = np.array(armature.matrix_world)
    rest = placed @ np.array([bone.matrix_local for bone in bones])
    first, last = (int(round(value)) for value in action.frame_range)
    posed = np.empty((last - first + 1, len(bones), 4, 4))
    for frame in range(first, last + 1):
        scene.frame_set(frame)
        moved = np.array(armature.matrix_world)
        posed[frame - first] = moved @ np.array([armature.pose.bones[name].matrix for name in names])
    rotations = _rotation(posed) @ np.swapaxes(_rotation(rest), -1, -2)
    up = np.array([0.0, 0.0, 1.0])
    rate = float(scene.render.fps / scene.render.fps_base)
    return Motion(path.name, tuple(names), parents, posed[..., :3, 3], rotations, rest[:, :3, 3], rate, up)


def _parents_first(bones: bpy.types.ArmatureBones) -> list[bpy.types.Bone]:
    return [bone for root in bones if root.parent is None for bone in (root, *root.children_recursive)]


def _rotation(matrices: np.ndarray) -> np.ndarray:
    """The nearest rotations (..., 3, 3) of matrices that scale, too."""
    left, _, right = np.linalg.svd(matrices[..., :3, :3])
    return left @ right


def _open(path: Path, operator: bpy.types.Operator) -> None:
    if not path.is_file():
        raise CaptureError(say("{path}: no such file").format(path=path))
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            operator(filepath=str(path))
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise CaptureError(say("{path}: Blender cannot read it: {reason}").format(path=path, reason=reason)) from error
