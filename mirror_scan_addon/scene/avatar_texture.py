"""Textures of avatars: UV map, packed image and the material that shows it, from arrays and back."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ...core.errors import OutputError
from ...core.io.images import write_png
from ...core.mesh import Texture
from ..language.texts import say
from .avatar_objects import COLOR, MATERIAL_TAG, discard_on_error, new_material, show_colors
from .blender_files import image_name
from .scan_records import TEXTURED

UV_MAP, ISLAND = "UVMap", "island"
"""Of the UV map, and of the attribute of faces that says which island of it each lies in."""


def material_of(data: bpy.types.Mesh) -> bpy.types.Material | None:
    """The material with the texture of an avatar's mesh; None when it has none."""
    material = data.get(TEXTURED)
    return material if isinstance(material, bpy.types.Material) else None


def texture_image(data: bpy.types.Mesh) -> bpy.types.Image | None:
    """The packed image of an avatar's texture; None when it has none."""
    material = material_of(data)
    images = [] if material is None else _images(material)
    return next((image for image in images if image.packed_file is not None), None)


def check_triangles(avatar: bpy.types.Object) -> None:
    """Refuse a mesh with faces of more than three corners: a texture is laid on triangles.

    Raises
    ------
    OutputError
    """
    if len(avatar.data.loops) != 3 * len(avatar.data.polygons):
        text = say("{name}: has faces with more than three corners; triangulate them first (Ctrl T in Edit Mode)")
        raise OutputError(text.format(name=avatar.name), code="avatar")


def set_texture(avatar: bpy.types.Object, texture: Texture) -> None:
    """Lay a texture on an avatar, in place of the one it has; its colours by vertex stay.

    Parameters
    ----------
    avatar : bpy.types.Object
        A mesh of T triangles.
    texture : Texture
        Of the same triangles, in the same order.

    Raises
    ------
    OutputError
        When the triangles are others.
    """
    data = avatar.data
    check_triangles(avatar)
    if len(texture.uv) != len(data.polygons):
        text = say("{name}: the texture is of another mesh ({count} triangles)")
        raise OutputError(text.format(name=avatar.name, count=len(texture.uv)), code="avatar")
    old = material_of(data)
    with discard_on_error() as made:
        material = _material(avatar.name, _image(avatar.name, texture.image, made), made)
    put_uv(data, texture, material)
    if not avatar.material_slots:
        data.materials.append(material)
    for slot in avatar.material_slots:
        if slot.material is None or slot.material == old or slot.material.get(MATERIAL_TAG) == COLOR:
            slot.material = material
    if data.color_attributes.get(COLOR) is not None:
        show_colors(avatar, COLOR)
    data.update()
    if old is not None:
        remove_unused(old)


def remove_unused(material: bpy.types.Material) -> None:
    """Take a texture's material and its images out of the file where nothing uses them any more."""
    if not material.users:
        images = _images(material)
        bpy.data.materials.remove(material)
        bpy.data.batch_remove([image for image in images if not image.users])


def put_uv(data: bpy.types.Mesh, texture: Texture, material: bpy.types.Material) -> None:
    """Say of a mesh of the texture's triangles where they lie in its image, which ``material`` shows."""
    uv = data.uv_layers.get(UV_MAP) or data.uv_layers.new(name=UV_MAP, do_init=False)
    uv.active = uv.active_render = True
    uv.uv.foreach_set("vector", np.ascontiguousarray(texture.uv, np.float32).ravel())
    if (island := data.attributes.get(ISLAND)) is None:
        island = data.attributes.new(ISLAND, "INT", "FACE")
    island.data.foreach_set("value", np.ascontiguousarray(texture.island, np.int32))
    data[TEXTURED] = material


def baked_material(name: str, pixels: np.ndarray, file_name: str = "") -> bpy.types.Material:
    """A material like that of a texture, with an image (H, W, 3) uint8 sRGB of its own, called ``file_name``."""
    with discard_on_error() as made:
        image = _image(name, pixels, made)
        if file_name:
            _call(image, file_name)
        return _material(name, image, made)


def name_image(avatar: bpy.types.Object, name: str) -> None:
    """Have an object that is about to be exported show an image of its own, under a name that only its file has."""
    material = material_of(avatar.data)
    if material is None:
        return
    own = material.copy()
    for node in own.node_tree.nodes:
        if node.type == "TEX_IMAGE" and node.image is not None:
            node.image = node.image.copy()
            _call(node.image, name)
    for slot in avatar.material_slots:
        if slot.material == material:
            slot.link, slot.material = "OBJECT", own


def _call(image: bpy.types.Image, name: str) -> None:
    """Give a packed image a name, under which it is written as a file too."""
    image.name, image.filepath_raw = name, f"//{name}.png"
    for packed in image.packed_files:
        packed.filepath = f"{name}.png"


def drop_texture(avatar: bpy.types.Object) -> None:
    """Show an avatar by its colours by vertex again; its mesh is another one, on which the texture has no place."""
    material = material_of(avatar.data)
    if material is None:
        return
    del avatar.data[TEXTURED]
    if avatar.data.color_attributes.get(COLOR) is not None:
        show_colors(avatar, COLOR)


def read_places(avatar: bpy.types.Object) -> Texture | None:
    """Where an avatar's triangles lie in the texture that :func:`set_texture` laid on it, with one grey pixel for an
    image; None when there is no texture."""
    data = avatar.data
    uv, island = data.uv_layers.get(UV_MAP), data.attributes.get(ISLAND)
    if material_of(data) is None or uv is None or len(data.loops) != 3 * len(data.polygons):
        return None
    corners = np.empty((len(data.polygons), 3, 2), np.float32)
    uv.uv.foreach_get("vector", corners.ravel())
    numbers = np.zeros(len(data.polygons), np.int32)
    if island is not None:  # lost where Blender made the mesh anew
        island.data.foreach_get("value", numbers)
    return Texture(corners, np.full((1, 1, 3), 128, np.uint8), numbers)


def read_texture(avatar: bpy.types.Object) -> Texture | None:
    """The texture that :func:`set_texture` laid on an avatar; None when there is none, or only part of it."""
    places, material = read_places(avatar), material_of(avatar.data)
    images = [] if places is None or material is None else _images(material)
    if not images:
        return None
    image = images[0]
    pixels = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
    if not pixels.size:  # its file is gone
        return None
    image.pixels.foreach_get(pixels)
    rows = pixels.reshape(image.size[1], image.size[0], image.channels)[::-1, :, :3]
    return replace(places, image=np.rint(np.clip(rows, 0, 1) * 255).astype(np.uint8))


def _image(name: str, pixels: np.ndarray, made: list[bpy.types.ID]) -> bpy.types.Image:
    """An image (H, W, 3) uint8 sRGB, packed into the file."""
    with tempfile.TemporaryDirectory(prefix="mirror_scan_") as folder:
        # the packed file keeps this name, under which USD writes it again
        path = Path(folder) / f"{image_name(f'{name} Texture')}.png"
        write_png(path, pixels)
        image = bpy.data.images.load(str(path))
        made.append(image)
        image.pack()
    image.name = f"{name} Texture"
    image.filepath_raw = f"//{path.name}"  # where unpacking puts it
    return image


def _material(name: str, image: bpy.types.Image, made: list[bpy.types.ID]) -> bpy.types.Material:
    """A material that shows the image where the UV map puts it; its node is what Solid mode shows and is baked to."""
    material = new_material(f"{name} Texture", COLOR, "ShaderNodeTexImage", made)
    material[TEXTURED] = True
    material.node_tree.nodes.active.image = image
    return material


def _images(material: bpy.types.Material) -> list[bpy.types.Image]:
    """The images that a material shows."""
    nodes = material.node_tree.nodes if material.node_tree is not None else ()
    return [node.image for node in nodes if node.type == "TEX_IMAGE" and node.image is not None]
