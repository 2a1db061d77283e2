"""A reconstruction to .blend, .glb, .fbx and .usd, for the command line and for scripts.

Each writer builds its own scene and takes it away again: what is open in this Blender is neither saved nor changed.
Files appear under their name only when they are complete.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ...core.errors import OutputError
from ...core.io import write_mesh
from ...core.io.atomic_files import final_stem, replacing, replacing_with_companions
from ...core.io.images import image_of_bytes
from ...core.mesh import Texture
from ..language.texts import say
from . import avatar_objects as avatar_scene
from . import cloth as scene_cloth
from .armature import action_of, add_armature, add_clip, read_avatar
from .avatar_texture import name_image, read_texture, set_texture, texture_image
from .blender_files import (
    check_built_with,
    enabled,
    image_name,
    quiet,
    reason_of,
    removed_again,
    shown,
    silent,
    temporary_scene,
)
from .export_colors import bake_colors, colors_above_bytes, colors_to_corners, keep_colors, shows_otherwise
from .scan_records import armature_of
from .studio import VIEW_ANGLE, add_studio
from .units import metres_per_unit

if TYPE_CHECKING:
    from ...core.avatar.avatar_file import Avatar
    from ...core.avatar.clip import Clip
    from ...core.avatar.garment import Garment
    from ...core.pipeline import Reconstruction

    Rigged = Reconstruction | Avatar

VIEWPORT_LENS = 50.0  # [mm]


def write_blend(
    path: str | os.PathLike, reconstruction: Rigged, *, own_process: bool = False, clip: Clip | None = None
) -> None:
    """Write a .blend with the avatar in a studio, see :mod:`.studio`.

    Parameters
    ----------
    path : path
        Ends in .blend.
    reconstruction : Reconstruction or Avatar
        A reconstruction's report is kept with the object.
    clip : Clip, optional
        Becomes the skeleton's action.
    own_process : bool
        True says that nobody works in this Blender (the command line): the file then starts from factory settings, so
        that it opens with the avatar framed and coloured in every 3D viewport. What was open in this process is gone
        afterwards. False leaves it alone and writes the scene without windows, which open as the reader's own.

    Raises
    ------
    OutputError
        When the file cannot be written or the mesh is none.
    """
    with replacing(path) as temporary:
        if own_process:
            bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
            target = bpy.context.scene
            avatar = _stage(target, reconstruction, clip)
            for viewport in _viewports():
                _frame_viewport(viewport, avatar)
            with quiet():
                bpy.ops.wm.save_as_mainfile(filepath=str(temporary), copy=True, compress=True)
        else:
            with temporary_scene() as target:
                _stage(target, reconstruction, clip)
                bpy.data.libraries.write(str(temporary), {target}, compress=True)


def write_glb(path: str | os.PathLike, reconstruction: Rigged) -> None:
    """Write binary glTF 2.0: metres, Y up, colours as ``COLOR_0`` (linear, as glTF wants them).

    Raises
    ------
    OutputError
        When the file cannot be written, or Blender's glTF exporter is missing or fails.
    """
    with replacing(path) as temporary, temporary_scene() as target:
        _add_avatar(target, reconstruction)
        _export(
            target,
            "io_scene_gltf2",
            "gltf",
            filepath=str(temporary),
            export_format="GLB",
            use_active_scene=True,
            export_yup=True,
            export_vertex_color="MATERIAL",
            export_all_vertex_colors=False,
            export_animations=False,
            export_extras=False,
            export_skins=reconstruction.skeleton is not None,
        )
        _check_holds_faces(path, temporary, "GLB")


def write_fbx(path: str | os.PathLike, reconstruction: Rigged, *, clip: Clip | None = None) -> None:
    """Write FBX in metres, with sRGB vertex colours, skeleton and ``clip`` where there are such.

    The unit goes into the file's unit factor, not into a scale of the object, so that programs that know metres and
    programs that count centimetres both show a person of the right height.

    Raises
    ------
    OutputError
        When the file cannot be written, or Blender's FBX exporter is missing or fails.
    """
    with replacing(path) as temporary, temporary_scene() as target:
        _bake_all(_add_avatar(target, reconstruction, clip))
        _export(
            target,
            "io_scene_fbx",
            "fbx",
            filepath=str(temporary),
            object_types={"MESH", "ARMATURE"},
            apply_scale_options="FBX_SCALE_ALL",
            colors_type="SRGB",
            prioritize_active_color=True,
            add_leaf_bones=False,
            bake_anim=clip is not None,
            bake_anim_use_nla_strips=False,
            bake_anim_use_all_actions=False,
            bake_anim_simplify_factor=0.0,
            path_mode="COPY",
            embed_textures=True,
        )
        _check_holds_faces(path, temporary, "FBX")


def write_usd(path: str | os.PathLike, reconstruction: Rigged, *, clip: Clip | None = None) -> None:
    """Write USD in metres, Z up, with colours, skeleton and ``clip`` where there are such.

    Raises
    ------
    OutputError
        When the file cannot be written, or Blender's exporter fails.
    """
    check_built_with(path)
    with replacing_with_companions(path) as temporary, temporary_scene() as target:
        avatar = _add_avatar(target, reconstruction, clip)
        image = f"{image_name(final_stem(path))}_texture"
        if not _bake_all(avatar, image):
            name_image(avatar, image)
        with shown(target), silent():
            try:
                bpy.ops.wm.usd_export(filepath=str(temporary), export_animation=clip is not None)
            except RuntimeError as error:
                text = say("{path}: Blender cannot write it: {reason}")
                raise OutputError(text.format(path=path, reason=reason_of(str(error)))) from error
        _check_holds_faces(path, temporary, "USDC")


def write_object(path: str | os.PathLike, avatar: bpy.types.Object, kind: str, as_shown: bool = False) -> bool:
    """Write an object of the open file by Blender's own exporter; selection and scene stay as they are.

    What is written is a copy in a scene of its own, so that nothing which hides an object, or keeps it from being
    selected, keeps it from being written. Faces point outwards in the file whatever mirrors the object.

    Parameters
    ----------
    path : path
        With the ending the format has.
    avatar : bpy.types.Object
        A mesh in the context's scene.
    kind : {"GLB", "GLTF", "FBX", "OBJ", "PLY", "STL", "3MF", "USDC", "ABC", "BLEND", "VRM"}
    as_shown : bool
        With the colours that *Colour By* shows instead of the capture's.

    Returns
    -------
    bool
        Whether the file lacks the object's skeleton although the format could hold it: an object that is mirrored or
        sheared is written in its final shape.

    Notes
    -----
    An avatar's file carries the colours of the capture and no others of ours. FBX, OBJ and USD have no material that
    shows colours of vertices: without a texture the file has a small one made of them, see :mod:`.export_colors`.

    Files are in metres, STL and 3MF in millimetres, whatever the scene's unit is: only Blender's FBX exporter heeds
    it, so for the others the object is scaled while it is written. A .blend keeps Blender units, as appending and
    linking do.

    Raises
    ------
    OutputError
        When there is nothing to write, the file cannot be written, or the exporter is missing or fails.
    """
    check_built_with(path)
    avatar_scene.check_finite(avatar, np.array(avatar.matrix_world))
    size = 1.0 if kind in ("FBX", "BLEND") else metres_per_unit(bpy.context.scene)
    stiff = False
    with (replacing_with_companions if kind in _WITH_COMPANIONS else replacing)(path) as temporary:
        file = str(temporary)
        try:
            if kind == "BLEND":
                with _own(avatar, as_shown) as kept:
                    bpy.data.libraries.write(file, {kept}, compress=True, fake_user=True)
            else:
                bones = armature_of(avatar) if kind in _WITH_SKELETON else None
                with _copy_alone(avatar, size, bones, as_shown) as (target, copy), shown(target), quiet():
                    stiff = bones is not None and armature_of(copy) is None
                    image = f"{image_name(Path(path).stem)}_texture"
                    baked = kind in _WITHOUT_VERTEX_COLORS and _bake_all(copy, image)
                    if kind in _PREPARED:
                        _PREPARED[kind](copy)
                    if kind in _WITH_COMPANIONS and not baked:
                        name_image(copy, image)
                    _EXPORTERS[kind](file, copy)
        # What an operator reports reaches scripts as RuntimeError; without the format there is no such operator.
        except (RuntimeError, AttributeError) as error:
            text = say("{path}: Blender cannot write it: {reason}")
            raise OutputError(text.format(path=path, reason=reason_of(str(error)))) from error
        _check_holds_faces(path, temporary, kind)
    return stiff


def _write_gltf(file: str, copy: bpy.types.Object) -> None:
    """Binary or as text, by the ending. Colours of vertices only where the material shows them: viewers multiply a
    texture by them."""
    moves = _moves(copy)
    with enabled("io_scene_gltf2"):
        bpy.ops.export_scene.gltf(
            filepath=file, export_format="GLB" if file.endswith(".glb") else "GLTF_SEPARATE", use_selection=True,
            use_active_scene=True, export_yup=True, export_vertex_color="MATERIAL", export_all_vertex_colors=False,
            export_animations=moves,
            export_animation_mode="ACTIVE_ACTIONS", export_extras=False,
            export_nla_strips_merged_animation_name=action_of(armature_of(copy)).name if moves else "Animation",
            export_apply=copy.data.shape_keys is None, export_rest_position_armature=True,
        )  # fmt: skip


def _write_fbx(file: str, copy: bpy.types.Object) -> None:
    with enabled("io_scene_fbx"):
        bpy.ops.export_scene.fbx(
            filepath=file, use_selection=True, apply_scale_options="FBX_SCALE_ALL", colors_type="SRGB",
            prioritize_active_color=True, add_leaf_bones=False, bake_anim=_moves(copy), bake_anim_use_nla_strips=False,
            bake_anim_use_all_actions=False, bake_anim_simplify_factor=0.0, path_mode="COPY", embed_textures=True,
        )  # fmt: skip


def _write_obj(file: str, copy: bpy.types.Object) -> None:
    """Its material and image stand beside the file, under its name."""
    image = texture_image(copy.data)
    materials = any(slot.material is not None for slot in copy.material_slots)
    bpy.ops.wm.obj_export(
        filepath=file, export_selected_objects=True, export_colors=True, export_materials=materials, path_mode="STRIP"
    )
    if image is not None:
        path = Path(file)
        path.with_suffix(".png").write_bytes(image.packed_file.data)
        material = path.with_suffix(".mtl")
        lines = material.read_text("utf-8").splitlines()
        lines = [f"map_Kd {path.stem}.png" if line.startswith("map_Kd") else line for line in lines]
        material.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _write_3mf(file: str, copy: bpy.types.Object) -> None:
    """The shape as it stands, with its texture, or the colours of its vertices."""
    shape = _final_shape(copy, bpy.context.view_layer)
    shape.transform(copy.matrix_world)
    surface = avatar_scene.surface_of(shape, np.ones(3))
    image, uv = texture_image(copy.data), shape.uv_layers.active
    texture = None
    if image is not None and uv is not None:
        places, corners = np.empty((len(shape.loops), 2), np.float32), np.empty((len(surface.triangles), 3), np.int32)
        uv.uv.foreach_get("vector", places.ravel())
        shape.loop_triangles.foreach_get("loops", corners.ravel())
        islands = np.zeros(len(corners), np.int32)
        texture = Texture(places[corners], image_of_bytes(image.packed_file.data), islands)
    write_mesh(file, surface, texture)


def _write_vrm(file: str, copy: bpy.types.Object) -> None:
    """As the core does: the body in its rest pose, its bones by VRM's names, and what it wears; no motion."""
    from ...core.avatar.avatar_file import write_avatar

    if armature_of(copy) is None:
        text = say("{name}: VRM is for avatars with a skeleton that are neither mirrored nor sheared; add a skeleton")
        raise OutputError(text.format(name=copy.name), code="no_skeleton")
    unit = float(avatar_scene.even_size_of(copy, 1.0).mean())
    garments = scene_cloth.read_garments(copy, unit)
    whole = dataclasses.replace(read_avatar(copy, unit), texture=read_texture(copy), garments=garments)
    write_avatar(file, whole, vrm=True)


_WITH_COMPANIONS = ("OBJ", "USDC", "GLTF")
_PREPARED = {"ABC": colors_to_corners, "PLY": colors_above_bytes}
_WITHOUT_VERTEX_COLORS = ("FBX", "OBJ", "USDC")
_MILLIMETRES = 1000.0  # in a metre: slicers take an STL's numbers for millimetres
_WITH_SKELETON = ("GLB", "GLTF", "FBX", "USDC", "VRM")
_EXPORTERS: dict[str, Callable[[str, bpy.types.Object], object]] = {
    "GLB": _write_gltf,
    "GLTF": _write_gltf,
    "3MF": _write_3mf,
    "VRM": _write_vrm,
    "FBX": _write_fbx,
    "OBJ": _write_obj,
    "PLY": lambda file, copy: bpy.ops.wm.ply_export(filepath=file, export_selected_objects=True, export_colors="SRGB"),
    "STL": lambda file, copy: bpy.ops.wm.stl_export(
        filepath=file, export_selected_objects=True, global_scale=_MILLIMETRES
    ),
    "USDC": lambda file, copy: bpy.ops.wm.usd_export(
        filepath=file, selected_objects_only=True, export_animation=_moves(copy)
    ),
    "ABC": lambda file, copy: bpy.ops.wm.alembic_export(
        filepath=file, selected=True, vcolors=True, as_background_job=False
    ),
}


def _moves(copy: bpy.types.Object) -> bool:
    """Whether a motion goes into the file with the object."""
    bones = armature_of(copy)
    return bones is not None and action_of(bones) is not None


def _check_holds_faces(path: str | os.PathLike, file: Path, kind: str) -> None:
    """Refuse what an exporter wrote to ``file`` without the avatar; that it wrote none is told by others."""
    if file.is_file() and not _holds_faces(file, kind):
        raise OutputError(
            say("{path}: Blender wrote no mesh into it, so the file was deleted; check the avatar's modifiers").format(
                path=path
            )
        )


def _holds_faces(file: Path, kind: str) -> bool:
    """Whether a file that Blender wrote has a mesh in it."""
    with open(file, "rb") as stream:
        head = stream.read(1 << 16)
    if kind == "PLY":
        return re.search(rb"element face [1-9]", head) is not None
    if kind == "STL":
        return len(head) > 84 and head[80:84] != bytes(4)
    if kind in ("GLB", "VRM"):
        with open(file, "rb") as stream:
            return b'"primitives"' in stream.read(20 + int.from_bytes(head[12:16], "little"))
    if kind == "OBJ":
        return b"\nf " in file.read_bytes()
    if kind in ("BLEND", "3MF"):  # core writes the latter, and refuses what has no face
        return True
    if kind == "GLTF":
        return b'"primitives"' in file.read_bytes()
    content = file.read_bytes()
    if content.startswith(b"PXR-USDC"):  # its words are packed
        return len(content) > _USDC_WITHOUT_MESH
    return {"FBX": b"PolygonVertexIndex", "USDC": b"faceVertexIndices", "ABC": b".faceIndices"}[kind] in content


_USDC_WITHOUT_MESH = 1200
"""Bytes: it is 770 to 940 without any, and 1400 with a triangle."""


@contextlib.contextmanager
def _own(avatar: bpy.types.Object, as_shown: bool) -> Iterator[bpy.types.Object]:
    """The object, or one of this file that is as it, where it is linked from another, for a link is no copy, or shows
    other colours."""
    if avatar.library is None and avatar.data.library is None and (as_shown or not shows_otherwise(avatar)):
        yield avatar
        return
    name, data_name = avatar.name, avatar.data.name
    with _renamed(avatar), _renamed(avatar.data), removed_again():
        own = avatar.copy()
        own.name = name
        own.data = avatar.data.copy()
        own.data.name = data_name
        if not as_shown:
            keep_colors(own)
        for slot in own.material_slots:
            if slot.material is not None and slot.material.library is not None:
                slot.material = slot.material.copy()
        yield own


@contextlib.contextmanager
def _copy_alone(
    avatar: bpy.types.Object, size: float, bones: bpy.types.Object | None = None, as_shown: bool = False
) -> Iterator[tuple[bpy.types.Scene, bpy.types.Object]]:
    """A scene with nothing but a copy of the object, selected, ``size`` times as large seen from the world's origin.

    The copy has the object's name, and its modifiers unless it is mirrored or sheared: then it has its final shape.
    With its armature ``bones`` it hangs on a copy of that, which has the scene's range of frames to move in.
    """
    scene, name, bones_name = bpy.context.scene, avatar.name, bones.name if bones else ""
    data_name = avatar.data.name
    with contextlib.ExitStack() as kept:
        for item in (avatar, avatar.data, *((bones,) if bones else ())):
            kept.enter_context(_renamed(item))
        target = kept.enter_context(temporary_scene())
        for setting in ("fps", "fps_base"):
            setattr(target.render, setting, getattr(scene.render, setting))
        target.frame_start, target.frame_end = scene.frame_start, scene.frame_end
        for setting in ("system", "scale_length", "length_unit"):
            setattr(target.unit_settings, setting, getattr(scene.unit_settings, setting))
        target.frame_set(scene.frame_current, subframe=scene.frame_subframe)
        copy = avatar.copy()
        copy.name, copy.data = name, avatar.data.copy()
        copy.data.name = data_name
        keep_colors(copy, as_shown)
        copy.hide_select = copy.hide_viewport = copy.hide_render = False
        target.collection.objects.link(copy)
        layer = target.view_layers[0]
        layer.update()
        # where its parents and constraints put it, also when it is hidden and Blender has not looked for long
        placed = Matrix.Scale(size, 4) @ copy.matrix_world
        avatar_scene.check_finite(avatar, np.array(placed))
        if placed.determinant() == 0.0:
            text = say("{name}: has no extent along an axis, since its scale there is 0; change it first")
            raise OutputError(text.format(name=name), code="avatar")
        # an armature that is left behind would pose a copy of another size from where it stands
        posed = bones is None and armature_of(avatar) is not None
        stiff = posed or placed.is_negative or not _is_orthogonal(placed)
        shape = _final_shape(copy, layer) if stiff else None
        copy.animation_data_clear()
        copy.parent = None
        copy.constraints.clear()
        if shape is None and bones is not None:
            own = _hang(copy, bones, placed, target)
            own.name = bones_name
            _wear_copies(scene_cloth.garments_of(avatar), bones, own, target)
        elif shape is None:
            copy.matrix_world = placed
        else:
            shape.transform(placed)
            if placed.is_negative:
                shape.flip_normals()
            copy.modifiers.clear()
            copy.data = shape
            copy.matrix_world = Matrix()
        layer.update()
        if not copy.evaluated_get(layer.depsgraph).data.polygons:
            raise OutputError(
                say("{name}: its modifiers leave no faces; turn them off, or change them").format(name=name),
                code="avatar",
            )
        copy.select_set(True, view_layer=layer)
        layer.objects.active = copy
        yield target, copy


def _hang(copy: bpy.types.Object, bones: bpy.types.Object, placed: Matrix, target: bpy.types.Scene) -> bpy.types.Object:
    """Have a copy of the armature move the copied object, both at ``placed``."""
    own = bones.copy()
    if _moves(copy):
        target.name = action_of(bones).name  # FBX names a motion after the scene
    own.hide_select = own.hide_viewport = own.hide_render = False
    own.parent = None
    own.constraints.clear()
    target.collection.objects.link(own)
    own.matrix_world = placed
    for modifier in copy.modifiers:
        if modifier.type == "ARMATURE" and modifier.object == bones:
            modifier.object = own
    copy.parent = own
    copy.matrix_parent_inverse.identity()
    copy.matrix_basis.identity()
    own.select_set(True, view_layer=target.view_layers[0])
    return own


def _wear_copies(
    garments: Sequence[bpy.types.Object], bones: bpy.types.Object, own: bpy.types.Object, target: bpy.types.Scene
) -> None:
    """Copies of garments, selected, which a copy of the armature moves; no file format knows how cloth falls."""
    for garment in garments:
        copy = garment.copy()
        copy.data = garment.data.copy()
        copy.hide_select = copy.hide_viewport = copy.hide_render = False
        copy.animation_data_clear()
        copy.constraints.clear()
        for modifier in list(copy.modifiers):
            if modifier.type == "ARMATURE" and modifier.object == bones:
                modifier.object = own
            elif modifier.type in ("CLOTH", "SHRINKWRAP"):
                copy.modifiers.remove(modifier)
        target.collection.objects.link(copy)
        copy.parent = own
        target.view_layers[0].update()
        copy.select_set(True, view_layer=target.view_layers[0])


def _final_shape(copy: bpy.types.Object, layer: bpy.types.ViewLayer) -> bpy.types.Mesh:
    """The mesh as its modifiers leave it, along its own axes."""
    graph = layer.depsgraph
    shape = bpy.data.meshes.new_from_object(copy.evaluated_get(graph), preserve_all_data_layers=True, depsgraph=graph)
    shape.name = copy.data.name
    return shape


def _is_orthogonal(matrix: Matrix) -> bool:
    """Whether location, rotation and scale say all of it."""
    axes = np.array(matrix)[:3, :3]
    lengths = np.linalg.norm(axes, axis=0)
    return bool(np.abs(np.triu(axes.T @ axes, 1)).max() <= 1e-5 * lengths.max() ** 2)


@contextlib.contextmanager
def _renamed(avatar: bpy.types.ID) -> Iterator[None]:
    """Have another object be able to take its name."""
    name = avatar.name
    if avatar.library is not None:  # names of another file are no names here
        yield
        return
    try:
        avatar.name = "Mirror Scan exports this"
        yield
    finally:
        avatar.name = name


def _bake_all(avatar: bpy.types.Object, image: str = "") -> bool:
    """:func:`.export_colors.bake_colors` of an avatar and of the garments that hang on its armature as it does."""
    for item in avatar.parent.children if avatar.parent is not None else ():
        if item != avatar and item.type == "MESH":
            bake_colors(item, f"{image}_{image_name(item.name)}" if image else "")
    return bake_colors(avatar, image)


def _add_avatar(
    target: bpy.types.Scene, reconstruction: Rigged, clip: Clip | None = None, cloth: bool = False
) -> bpy.types.Object:
    """The avatar with skeleton, motion and what it wears, which falls as cloth where ``cloth`` says so."""
    report = getattr(reconstruction, "report", None)
    if report is not None:
        report = report | {"warnings": list(reconstruction.warnings)}
    avatar = avatar_scene.create_avatar(reconstruction.mesh, collection=target.collection, report=report)
    if reconstruction.texture is not None:
        set_texture(avatar, reconstruction.texture)
    layer = target.view_layers[0]
    layer.update()
    if reconstruction.skeleton is not None and reconstruction.weights is not None:
        with shown(target):
            bones = add_armature(avatar, reconstruction.skeleton, reconstruction.weights, target.collection)
        if clip is not None:
            add_clip(bones, clip)
            target.render.fps_base = 1.0 if clip.rate == round(clip.rate) else math.ceil(clip.rate) / clip.rate
            target.render.fps = math.ceil(clip.rate)
            target.frame_start, target.frame_end = 0, len(clip.rotations) - 1
        _add_garments(target, avatar, getattr(reconstruction, "garments", ()), cloth)
        bones.select_set(True, view_layer=layer)
    avatar.select_set(True, view_layer=layer)
    layer.objects.active = avatar
    return avatar


def _add_garments(
    target: bpy.types.Scene, avatar: bpy.types.Object, garments: Sequence[Garment], cloth: bool
) -> None:  # fmt: skip
    layer = target.view_layers[0]
    for garment in garments:
        made = scene_cloth.add_garment(avatar, garment, target.collection)
        if cloth and not garment.tight:
            if scene_cloth.collider_of(avatar) is None:
                scene_cloth.add_collider(avatar, target.collection, target)
            scene_cloth.make_cloth(made, avatar, target)
        layer.update()
        made.select_set(True, view_layer=layer)


def _stage(target: bpy.types.Scene, reconstruction: Rigged, clip: Clip | None = None) -> bpy.types.Object:
    """The avatar in a studio, in an empty scene: ready to render."""
    avatar = _add_avatar(target, reconstruction, clip, cloth=True)
    add_studio(target, avatar)
    return avatar


def _bounds(avatar: bpy.types.Object) -> tuple[Vector, float]:
    """Centre of the bounding box and half its diagonal [m]; the object is not moved from the origin."""
    corners = np.array(avatar.bound_box)
    low, high = corners.min(axis=0), corners.max(axis=0)
    return Vector((low + high) / 2), float(np.linalg.norm(high - low) / 2)


def _view_rotation() -> Matrix:
    """Camera axes of a look at the front (the avatar faces −Y), from the side by ``VIEW_ANGLE``, level."""
    return Matrix.Rotation(VIEW_ANGLE, 3, "Z") @ Matrix.Rotation(math.radians(90), 3, "X")


def _viewports() -> Iterator[bpy.types.SpaceView3D]:
    for screen in bpy.data.screens:
        for area in screen.areas:
            if area.type == "VIEW_3D":
                yield area.spaces.active


def _frame_viewport(viewport: bpy.types.SpaceView3D, avatar: bpy.types.Object) -> None:
    center, radius = _bounds(avatar)
    viewport.shading.color_type = "VERTEX" if texture_image(avatar.data) is None else "TEXTURE"
    viewport.shading.light = "FLAT"
    viewport.lens = VIEWPORT_LENS
    region = viewport.region_3d
    region.view_perspective = "PERSP"
    region.view_rotation = _view_rotation().to_quaternion()
    region.view_location = center
    region.view_distance = 2.6 * radius


def _export(target: bpy.types.Scene, module: str, operator: str, **options) -> None:
    """Call one of the exporters that come with Blender as add-ons, in the scene ``target``."""
    with enabled(module), shown(target), quiet():
        try:
            getattr(bpy.ops.export_scene, operator)(**options)
        except RuntimeError as error:  # what an operator reports as an error reaches scripts so
            text = say("Blender's {module} failed: {reason}")
            raise OutputError(text.format(module=module, reason=reason_of(str(error)))) from error
