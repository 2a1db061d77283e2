"""A sequence of meshes with another topology in each frame: written as Alembic or USD, shown on the timeline."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import bpy
import numpy as np

from ...core.errors import OutputError
from ...core.io.atomic_files import replacing
from ...core.mesh import Mesh
from ..language.texts import say
from .avatar_objects import COLOR, create_avatar, fill_mesh
from .blender_files import check_built_with, shown, silent, temporary_scene

CACHES = (".abc", ".usd", ".usdc")
"""Formats of one file for a whole sequence."""


def write_sequence(
    path: str | os.PathLike, count: int, mesh_at: Callable[[int], Mesh], rate: float, first: int = 1
) -> None:
    """Write a sequence as one file, .abc or .usd, in metres and Z up, with the colours of vertices.

    Parameters
    ----------
    path : path
        Its ending says the format.
    count : int
        Of frames.
    mesh_at : callable(place) -> Mesh
        The mesh of a frame, 0 ≤ place < ``count``; it is called when the frame is written, and kept no longer.
    rate : float
        Frames a second.
    first : int
        Number of the first frame on the timeline.

    Raises
    ------
    OutputError
        Blender's exporter is missing or fails, or the file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in CACHES:
        raise OutputError(say("{path}: a sequence is written as .abc or .usd").format(path=path))
    check_built_with(path)
    with replacing(path) as temporary, temporary_scene() as target:
        body = create_avatar(mesh_at(0), "Body", target.collection)
        # exporters take a mesh without a modifier that changes with time for a still one
        still = body.modifiers.new("In Time", "WAVE")
        still.height, still.use_normal = 0.0, False
        target.frame_start, target.frame_end = first, first + count - 1
        set_rate(target, rate)

        faults: list[Exception] = []

        def change(scene: bpy.types.Scene, *_: object) -> None:
            place = scene.frame_current - first
            if scene.name != target.name or not 0 <= place < count or faults:
                return
            try:
                mesh = mesh_at(place)
            except Exception as error:  # Blender would print it and go on; raised below
                faults.append(error)
                return
            fill_mesh(body.data, mesh)
            if suffix == ".abc":
                _color_corners(body.data, mesh)
            body.data.update_tag()

        bpy.app.handlers.frame_change_pre.append(change)
        try:
            with shown(target), silent():
                target.frame_set(first)
                if suffix == ".abc":
                    bpy.ops.wm.alembic_export(
                        filepath=str(temporary),
                        start=first,
                        end=first + count - 1,
                        vcolors=True,
                        as_background_job=False,
                    )
                else:
                    bpy.ops.wm.usd_export(filepath=str(temporary), export_animation=True)
        except RuntimeError as error:
            text = say("{path}: Blender cannot write it: {reason}")
            raise OutputError(text.format(path=path, reason=error)) from error
        finally:
            bpy.app.handlers.frame_change_pre.remove(change)
        if faults:
            raise faults[0]


def _color_corners(data: bpy.types.Mesh, mesh: Mesh) -> None:
    """Colours at the corners of faces in place of vertices: Alembic's exporter knows no others."""
    if mesh.colors is None or len(data.loops) != 3 * len(mesh.triangles):
        return
    data.color_attributes.remove(data.color_attributes[COLOR])
    rgba = np.ones((3 * len(mesh.triangles), 4), np.float32)
    rgba[:, :3] = mesh.colors[mesh.triangles.ravel()] / np.float32(255.0)
    data.color_attributes.new(COLOR, "BYTE_COLOR", "CORNER").data.foreach_set("color_srgb", rgba.ravel())


def set_rate(scene: bpy.types.Scene, rate: float) -> None:
    """Frames a second of a scene."""
    scene.render.fps = max(1, round(rate))
    scene.render.fps_base = scene.render.fps / rate


def show_frames(
    meshes: Iterable[tuple[str, Mesh]], frames: Sequence[int], collection: bpy.types.Collection, unit: float
) -> list[bpy.types.Object]:
    """An object a frame, each seen from its own frame to the next one's: it is hidden before and after by keyframes.

    The first is seen before, too, and the last after.

    Parameters
    ----------
    meshes : iterable of (name, Mesh)
        In the order of time.
    frames : sequence of int
        Of the timeline, ascending, from which each is seen.
    collection : bpy.types.Collection
        Where the objects are linked.
    unit : float
        Metres in a Blender unit.
    """
    made = []
    for place, (name, mesh) in enumerate(meshes):
        body = create_avatar(mesh, name, collection, unit=unit)
        made.append(body)
        _key_hidden(body, frames[place] - 1, place > 0)
        _key_hidden(body, frames[place], False)
        if place + 1 < len(frames):
            _key_hidden(body, frames[place + 1], True)
    return made


def _key_hidden(body: bpy.types.Object, frame: int, hidden: bool) -> None:
    """Keyframes that hide a body, or show it, from ``frame`` on."""
    body.hide_viewport = body.hide_render = hidden
    body.keyframe_insert("hide_viewport", frame=frame)
    body.keyframe_insert("hide_render", frame=frame)


def import_cache(path: Path) -> list[bpy.types.Object]:
    """The objects of an Alembic or USD file; Blender reads each frame when it is shown.

    Raises
    ------
    RuntimeError
        Of Blender's importer.
    """
    before = set(bpy.data.objects)
    with silent():
        if path.suffix.lower() == ".abc":
            bpy.ops.wm.alembic_import(filepath=str(path), as_background_job=False)
        else:
            bpy.ops.wm.usd_import(filepath=str(path))
    return [body for body in bpy.data.objects if body not in before]
