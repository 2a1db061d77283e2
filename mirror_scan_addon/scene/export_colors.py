"""The colours that go into a file with an avatar: those of the capture, whatever is shown, by a material that shows
them. All of it is done to a copy that goes again."""

from __future__ import annotations

import bpy
import numpy as np

from ...core.io.color_atlas import atlas_of_corners
from ...core.numeric.srgb import to_linear
from .avatar_objects import COLOR, DERIVED, MATERIAL_TAG, OWNER, avatar_material, new_material, set_colors, show_colors
from .avatar_texture import UV_MAP, baked_material, material_of
from .scan_records import TEXTURED
from .virtual_rig import COVERAGE

MADE_TO_SHOW = (*DERIVED.values(), COVERAGE)
OURS = (COLOR, *MADE_TO_SHOW)
"""Names of colour attributes that Mirror Scan makes."""


def shows_otherwise(avatar: bpy.types.Object) -> bool:
    """Whether a mesh object has colours of ours other than the capture's."""
    return any(name in avatar.data.color_attributes for name in MADE_TO_SHOW)


def keep_colors(copy: bpy.types.Object, as_shown: bool = False) -> None:
    """Have an object with a mesh of its own show the capture's colours and have no others of ours.

    ``as_shown``: what *Colour By* shows instead. What a user painted stays, and a material of his own.
    """
    data = copy.data
    shown = data.color_attributes.active_color_name
    wanted = shown if as_shown and shown in OURS else COLOR
    for name in OURS:
        if name != wanted and (attribute := data.attributes.get(name)) is not None:
            data.attributes.remove(attribute)
    if shown and shown not in OURS:
        return
    if wanted in data.color_attributes:
        show_colors(copy, wanted)
        return
    for slot in _our_slots(copy):  # it was built without colours
        slot.material = avatar_material("", copy.get(OWNER, ""), copy.name)


def bake_colors(copy: bpy.types.Object, file_name: str = "") -> bool:
    """Have the material of an object with a mesh of its own show its colours without reading them from the mesh, which
    FBX, OBJ and USD cannot say: by a small texture, or in one colour where there is only one.

    Only materials of ours are touched, and a mesh that has a UV map already gets no other.

    ``file_name`` is what the image is called, without an ending, where the file that is written names it.

    Returns
    -------
    bool
        Whether it was given a texture.
    """
    data = copy.data
    slots = [
        slot for slot in _our_slots(copy) if slot.material[MATERIAL_TAG] == data.color_attributes.active_color_name
    ]
    attribute = data.color_attributes.active_color
    if not slots or attribute is None or not len(data.polygons) or material_of(data) is not None:
        return False
    colors = _corner_colors(data, attribute)
    if (colors == colors[0]).all():
        material = new_material(slots[0].material.name, "", "", [])
        color = (*map(float, to_linear(colors[0] / 255)), 1.0)
        material.diffuse_color = color
        shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
        shader.inputs["Base Color"].default_value = color
    elif len(data.uv_layers):
        return False
    else:
        sizes, middles = np.empty(len(data.polygons), np.int32), np.empty((len(data.polygons), 3), np.float32)
        data.polygons.foreach_get("loop_total", sizes)
        data.polygons.foreach_get("center", middles.ravel())
        uv, image = atlas_of_corners(middles, sizes, colors)
        material = baked_material(copy.name, image, file_name)
        layer = data.uv_layers.new(name=UV_MAP, do_init=False)
        layer.uv.foreach_set("vector", uv.ravel())
        data[TEXTURED] = material
    for slot in slots:
        slot.material = material
    return TEXTURED in data


def colors_to_corners(copy: bpy.types.Object) -> None:
    """Have the capture's colours of an object with a mesh of its own lie at the corners of its faces: Blender writes no
    others to Alembic."""
    data = copy.data
    attribute = data.color_attributes.active_color
    if attribute is None or attribute.domain == "CORNER":
        return
    name, colors = attribute.name, _corner_colors(data, attribute)
    data.attributes.remove(attribute)
    set_colors(data, name, colors, "CORNER")
    data.color_attributes.active_color_name = name
    data.color_attributes.render_color_index = data.color_attributes.find(name)


def colors_above_bytes(copy: bpy.types.Object) -> None:
    """Have the colours of vertices of an object with a mesh of its own lie a little above whole bytes: Blender's PLY
    exporter cuts their fractions off, and rounding on the way would leave it the byte below."""
    data = copy.data
    attribute = data.color_attributes.active_color
    if attribute is None or attribute.domain != "POINT" or attribute.data_type != "BYTE_COLOR":
        return
    name = attribute.name
    rgba = np.empty((len(attribute.data), 4), np.float32)
    attribute.data.foreach_get("color_srgb", rgba.ravel())
    data.attributes.remove(attribute)
    fine = data.color_attributes.new(name, "FLOAT_COLOR", "POINT")
    rgba[:, :3] = (np.rint(rgba[:, :3] * 255) + 0.25) / 255
    fine.data.foreach_set("color_srgb", rgba.ravel())
    data.color_attributes.active_color_name = name


def _our_slots(copy: bpy.types.Object) -> list[bpy.types.MaterialSlot]:
    """The slots of an object whose material is one of ours."""
    return [slot for slot in copy.material_slots if slot.material is not None and MATERIAL_TAG in slot.material]


def _corner_colors(data: bpy.types.Mesh, attribute: bpy.types.Attribute) -> np.ndarray:
    """sRGB (C, 3) uint8 of a colour attribute at the corners of the faces."""
    rgba = np.empty((len(attribute.data), 4), np.float32)
    attribute.data.foreach_get("color_srgb", rgba.ravel())
    colors = np.rint(np.clip(rgba[:, :3], 0, 1) * 255).astype(np.uint8)
    if attribute.domain == "CORNER":
        return colors
    corners = np.empty(len(data.loops), np.int32)
    data.loops.foreach_get("vertex_index", corners)
    return colors[corners]
