"""What is drawn over a planned rig: distances, angles, ticks for each mirror, and what its camera sees, in a corner.

Everything is drawn from the scene's objects and from the last check. In a Blender without a window nothing is drawn.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import bpy
from mathutils import Vector

from . import live_picture, overlay, panel_states
from .viewport import add_drawing, remove_drawing

LINE = (0.95, 0.75, 0.25)  # of distances
PICTURE = 0.26  # height of the picture, of the viewport's
_MARGIN = 14  # round it [px at 100 % scale]

_handlers: list[object] = []
_texture: dict[str, object] = {}  # the picture on the graphics card, and its number


def rig_lines(
    scene: bpy.types.Scene, mirrors: Iterable[str] | None = None
) -> tuple[list[tuple[Vector, Vector]], list[tuple[Vector, str]]]:
    """Lines of a scene's rig in the world, and labels with their places: distances on the floor, and angles.

    From the camera to the person, from it to the middle of each mirror, and on to the person; and by how much each
    mirror is turned from facing the camera's way. Empty without a rig. ``mirrors``: names of objects that were mirrors
    when they were last looked for; all of the scene's are looked through otherwise.
    """
    from ..language.texts import say
    from ..scene import live_rig, virtual_rig
    from ..scene.units import length_text, metres_per_unit

    camera = live_rig.planned_camera(scene)
    if camera is None:
        return [], []
    unit = metres_per_unit(scene)
    person = live_rig.person_of(scene)
    middle = Vector((0.0, 0.0))
    if person is not None:
        middle = Vector(virtual_rig.standing_place(person))
    eye = camera.matrix_world.translation.to_2d()
    ahead = (camera.matrix_world.to_3x3() @ Vector((0.0, 0.0, -1.0))).to_2d()
    lines, labels = [], []

    def measured(one: Vector, other: Vector, share: float = 0.5) -> None:
        start, end = one.to_3d(), other.to_3d()
        lines.append((start, end))
        labels.append((start.lerp(end, share), length_text((end - start).length * unit, scene)))

    measured(eye, middle)
    items = scene.objects if mirrors is None else filter(None, map(scene.objects.get, mirrors))
    for item in items:
        if not item.mirror_scan.is_mirror or item.hide_render or not item.visible_get():
            continue
        centre = item.matrix_world.translation
        measured(eye, centre.to_2d(), 0.36)
        measured(centre.to_2d(), middle)
        facing = (item.matrix_world.to_3x3() @ Vector((0.0, 0.0, 1.0))).to_2d()
        if facing.length > 1e-6 and ahead.length > 1e-6:
            angle = math.degrees(facing.angle(-ahead))
            text = say("{name}: {angle:.0f}°").format(name=virtual_rig.mirror_title(item), angle=angle)
            top = max(Vector(corner).y for corner in item.bound_box)
            labels.append((item.matrix_world @ Vector((0.0, top, 0.0)), text))
    return lines, labels


# --- drawing ---------------------------------------------------------------------------------------------------------


def _shown(context: bpy.types.Context) -> bpy.types.Scene | None:
    settings = getattr(context.scene, "mirror_scan", None)
    if settings is None or settings.rig_camera is None or not context.space_data.overlay.show_overlays:
        return None
    if live_picture.shown() is not None:  # a real camera is looked at live
        return None
    from ..scene import live_rig

    return None if live_rig.planned_camera(context.scene) is None else context.scene


def _mirrors(context: bpy.types.Context) -> tuple[str, ...]:
    """Names of the objects that are marked as mirrors; a large scene is not looked through at every redraw."""
    return panel_states.looked_up(
        "mirrors", context, lambda: tuple(item.name for item in context.scene.objects if item.mirror_scan.is_mirror)
    )


def _draw_view() -> None:
    """Draw the lines in 3D, after the scene."""
    context = bpy.context
    scene = _shown(context)
    if scene is None or not scene.mirror_scan.rig_show:
        return
    import gpu
    from gpu_extras.batch import batch_for_shader

    lines, _ = rig_lines(scene, _mirrors(context))
    if not lines:
        return
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    shader.bind()
    shader.uniform_float("viewportSize", (context.region.width, context.region.height))
    shader.uniform_float("lineWidth", 1.5 * context.preferences.system.ui_scale)
    shader.uniform_float("color", (*LINE, 0.9))
    batch_for_shader(shader, "LINES", {"pos": [place for line in lines for place in line]}).draw(shader)
    gpu.state.blend_set("NONE")


def _draw_text() -> None:
    """Draw the labels and the picture in 2D, on top of everything."""
    context = bpy.context
    scene = _shown(context)
    if scene is None or context.region_data is None:
        return
    import blf
    from bpy_extras.view3d_utils import location_3d_to_region_2d

    scale = context.preferences.system.ui_scale
    if scene.mirror_scan.rig_show:
        for place, text in rig_lines(scene, _mirrors(context))[1]:
            at = location_3d_to_region_2d(context.region, context.region_data, place)
            if at is not None:
                overlay.label(blf, text, at, LINE, scale)
    if scene.mirror_scan.rig_picture:
        _draw_picture(context, scene, scale)


def _draw_picture(context: bpy.types.Context, scene: bpy.types.Scene, scale: float) -> None:
    """What the rig's camera sees, in the lower right corner; the last operation's settings stand in the left."""
    from ..scene import live_rig

    found = live_rig.picture(scene)
    if found is None:
        return
    import gpu
    from gpu_extras.presets import draw_texture_2d

    number, image = found
    key = (scene.session_uid, number)
    if _texture.get("key") != key:
        _texture["key"], _texture["texture"] = key, _texture_of(image)
    high = PICTURE * context.region.height
    wide = high * image.shape[1] / image.shape[0]
    left, right = overlay.visible_range(context)
    if wide > 0.5 * (right - left):
        return  # no room beside the sidebar
    gpu.state.blend_set("NONE")
    draw_texture_2d(_texture["texture"], (right - wide - _MARGIN * scale, _MARGIN * scale), wide, high)


def _texture_of(image):
    """An image (H, W, 3) uint8, sRGB, on the graphics card; its first row above."""
    import gpu
    import numpy as np

    height, width = image.shape[:2]
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = image[::-1] / np.float32(255.0)
    buffer = gpu.types.Buffer("FLOAT", height * width * 4, rgba.ravel())
    return gpu.types.GPUTexture((width, height), format="RGBA32F", data=buffer)


def register() -> None:
    add_drawing(_handlers, _draw_view, _draw_text)


def unregister() -> None:
    remove_drawing(_handlers)
    _texture.clear()
