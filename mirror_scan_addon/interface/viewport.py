"""3D viewports: find one, have it look from the camera or at an object."""

from __future__ import annotations

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy


def viewport(context: bpy.types.Context) -> bpy.types.Area | None:
    """The 3D viewport that was clicked in, else any 3D viewport of this window."""
    if context.area is not None and context.area.type == "VIEW_3D":
        return context.area
    areas = () if context.screen is None else context.screen.areas
    return next((area for area in areas if area.type == "VIEW_3D"), None)


def look_from_camera(context: bpy.types.Context, cloud: bpy.types.Object) -> None:
    """Have the 3D viewport look as the depth camera did, from a little farther back: no point hides another then."""
    from mathutils import Matrix, Vector

    area = viewport(context)
    if area is None:
        return
    view = area.spaces.active.region_3d
    view.view_perspective = "PERSP"
    view.view_rotation = (cloud.matrix_world.to_3x3() @ Matrix.Rotation(3.14159265, 3, "X")).to_quaternion()
    view.view_location = cloud.matrix_world @ Vector((0, 0, 2.5))
    view.view_distance = 4.8 * cloud.matrix_world.median_scale
    show_within(area, 0.1 * cloud.matrix_world.median_scale, 50.0 * cloud.matrix_world.median_scale)


def show_within(area: bpy.types.Area, near: float, far: float) -> None:
    """Have a 3D viewport show everything between ``near`` and ``far`` from the eye [Blender units]: in a scene in
    millimetres, a room is larger than the default range of a viewport."""
    space = area.spaces.active
    space.clip_start, space.clip_end = min(space.clip_start, near), max(space.clip_end, far)


def look_at(context: bpy.types.Context, target: bpy.types.Object) -> None:
    """Have the 3D viewport frame the selected object; nothing happens without a viewport."""
    area = viewport(context)
    region = None if area is None else next((region for region in area.regions if region.type == "WINDOW"), None)
    if region is None or bpy.app.background:
        return
    extent = max(target.dimensions, default=0.0)
    show_within(area, max(0.01 * extent, 1e-6), 20.0 * extent)
    with context.temp_override(area=area, region=region):
        if bpy.ops.view3d.view_selected.poll():
            bpy.ops.view3d.view_selected()


def show_texture(context: bpy.types.Context) -> None:
    """Have a 3D viewport in Solid mode show textures as they are, without light of its own: they hold the capture's."""
    area = viewport(context)
    if area is not None and area.spaces.active.shading.type == "SOLID":
        area.spaces.active.shading.color_type, area.spaces.active.shading.light = "TEXTURE", "FLAT"
