"""Avatars of .blend files, read by Blender for the command line.

What is open in this Blender is gone afterwards.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy

from ...core.avatar.avatar_file import Avatar
from ...core.errors import CaptureError
from ..language.texts import say
from . import cloth
from .armature import armature_of, read_avatar
from .avatar_objects import even_size_of
from .avatar_texture import read_texture
from .blender_files import quiet, silent
from .units import metres_per_unit


def read_blend_avatar(path: Path) -> Avatar:
    """The avatar with a skeleton in a .blend file: the active object if it is one, else the first.

    Raises
    ------
    CaptureError, OutputError
        When the file cannot be read or holds none, or one that is scaled unevenly.
    """
    _open(path, bpy.ops.wm.open_mainfile)
    scene = bpy.context.scene
    active = bpy.context.view_layer.objects.active
    meshes = [item for item in scene.objects if item.type == "MESH" and not _belongs_to_one(item)]
    objects = sorted(meshes, key=lambda item: item != active)
    avatar = next((item for item in objects if armature_of(item) is not None), None)
    if avatar is None:
        text = say("{path}: no mesh in it has a skeleton; make it with “reconstruct --skeleton”")
        raise CaptureError(text.format(path=path), code="no_skeleton")
    unit = float(even_size_of(avatar, metres_per_unit(scene)).mean())
    garments = cloth.read_garments(avatar, unit)
    return replace(read_avatar(avatar, unit), texture=read_texture(avatar), garments=garments)


def _belongs_to_one(item: bpy.types.Object) -> bool:
    """Whether a mesh is what an avatar wears, or what its cloth falls on."""
    return cloth.is_worn(item) or bool(item.get(cloth.COLLIDER))


def _open(path: Path, operator: bpy.types.Operator) -> None:
    if not path.is_file():
        raise CaptureError(say("{path}: no such file").format(path=path), code="gone")
    try:
        with quiet(), silent():
            operator(filepath=str(path))
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise CaptureError(say("{path}: Blender cannot read it: {reason}").format(path=path, reason=reason)) from error
