"""3D viewports: find one, have it look from the camera or at an object."""

from __future__ import annotations

import math
from collections.abc import Callable

import bpy
from bpy.app.handlers import persistent
from mathutils import Euler, Matrix, Quaternion, Vector

from ..scene.scan_records import REPORT, TEXTURED

FRONT = Euler((math.radians(78.0), 0.0, 0.0))
"""A view at the person from the camera's side, a little above: a camera that stands there is not before the eye."""


def viewport(context: bpy.types.Context) -> bpy.types.Area | None:
    """The 3D viewport that was clicked in, else the largest of this window."""
    if context.area is not None and context.area.type == "VIEW_3D":
        return context.area
    areas = () if context.screen is None else context.screen.areas
    found = (area for area in areas if area.type == "VIEW_3D")
    return max(found, key=lambda area: area.width * area.height, default=None)


def look_from_camera(context: bpy.types.Context, cloud: bpy.types.Object) -> None:
    """Have the 3D viewport look as the depth camera did, from a little farther back: no point hides another then."""
    area = viewport(context)
    if area is None:
        return
    view = area.spaces.active.region_3d
    view.view_perspective = "PERSP"
    view.view_rotation = (cloud.matrix_world.to_3x3() @ Matrix.Rotation(3.14159265, 3, "X")).to_quaternion()
    view.view_location = cloud.matrix_world @ Vector((0, 0, 2.5))
    view.view_distance = 4.8 * cloud.matrix_world.median_scale
    show_within(area, 0.1 * cloud.matrix_world.median_scale, 50.0 * cloud.matrix_world.median_scale)
    _fit(area, _sample(cloud))


def look_from_front(context: bpy.types.Context) -> None:
    """Have the 3D viewport look at where a person is scanned, and mirrors stand, from the camera's side and a little
    above it."""
    import numpy as np

    area = viewport(context)
    if area is None:
        return
    view = area.spaces.active.region_3d
    view.view_perspective = "PERSP"
    view.view_rotation = FRONT.to_quaternion()
    view.view_location = (0.0, 0.0, 0.9)
    view.view_distance = 5.0
    show_within(area, 0.1, 50.0)
    _fit(area, np.array([(x, y, z) for x in (-1.6, 1.6) for y in (-1.0, 1.0) for z in (0.0, 2.0)], np.float32))


def look_at_whole_capture(context: bpy.types.Context, cloud: bpy.types.Object) -> None:
    """Have the 3D viewport look from the camera, unless all points are in sight already, beside the sidebar."""
    area = viewport(context)
    if area is None or bpy.app.background:
        return
    places = _places(area, _sample(cloud))
    left, right, bottom, top = visible_part(area)
    inside = (places[:, 2] > 0) & (places[:, 0] > left) & (places[:, 0] < right)
    inside &= (places[:, 1] > bottom) & (places[:, 1] < top)
    if inside.mean() < IN_SIGHT:
        look_from_camera(context, cloud)


IN_SIGHT = 0.98
"""Share of a capture's points that makes it all of it: a few stray far away."""
USED = 0.94
"""Share of the visible part of a viewport that a capture may fill."""


def visible_part(area: bpy.types.Area) -> tuple[int, int, int, int]:
    """Left, right, bottom and top of what of a viewport's region no sidebar, toolbar or header covers [px]."""
    window = next(region for region in area.regions if region.type == "WINDOW")
    left, right, bottom, top = 0, window.width, 0, window.height
    for region in area.regions:
        if region.width <= 1 or region.height <= 1:
            continue
        if region.type == "UI" and region.alignment == "RIGHT":
            right = min(right, max(region.x - window.x, 1))
        elif region.type == "TOOLS" and region.alignment == "LEFT":
            left = max(left, region.x + region.width - window.x)
        elif region.type in ("HEADER", "TOOL_HEADER") and region.alignment == "TOP":
            top = min(top, region.y - window.y)
    return left, right, bottom, top


def _sample(cloud: bpy.types.Object):
    """Some of the cloud's points (N, 3) float32, in the world."""
    import numpy as np

    points = np.empty((len(cloud.data.vertices), 3), np.float32)
    cloud.data.attributes["position"].data.foreach_get("vector", points.ravel())
    points = points[:: max(len(points) // 4000, 1)]
    matrix = np.array(cloud.matrix_world, np.float32)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def _places(area: bpy.types.Area, points):
    """Where points are in the viewport's region: (N, 3) column and row [px] and distance in front of the eye."""
    import numpy as np

    window = next(region for region in area.regions if region.type == "WINDOW")
    view = area.spaces.active.region_3d
    turned = np.array(view.view_rotation.to_matrix(), np.float32)
    seen = (points - np.array(view.view_location, np.float32)) @ turned
    depth = np.float32(view.view_distance) - seen[:, 2]
    lens = np.array(view.window_matrix, np.float32)
    scale = np.stack((lens[0, 0] * seen[:, 0], lens[1, 1] * seen[:, 1]), axis=1) / np.maximum(depth, 1e-6)[:, None]
    return np.column_stack(((scale + 1) / 2 * (window.width, window.height), depth))


def _fit(area: bpy.types.Area, points) -> None:
    """Step back and aside until all points (N, 3) float32 in the world lie in the visible part of the viewport."""
    import numpy as np

    view = area.spaces.active.region_3d
    if bpy.app.background or not len(points):
        return
    view.update()
    window = next(region for region in area.regions if region.type == "WINDOW")
    left, right, bottom, top = visible_part(area)
    lens = view.window_matrix
    for _ in range(8):
        places = _places(area, points)
        if not (places[:, 2] > 0).any():
            return
        places = places[places[:, 2] > 0]
        low, high = np.percentile(places[:, :2], (0.5, 99.5), axis=0)
        depth = float(np.median(places[:, 2]))
        share = max((high[0] - low[0]) / (USED * (right - left)), (high[1] - low[1]) / (USED * (top - bottom)))
        view.view_distance += max(share - 1.0, 0.0) * depth
        off = ((low + high) / 2 - ((left + right) / 2, (bottom + top) / 2)) / (window.width / 2, window.height / 2)
        aside = view.view_rotation.to_matrix()
        view.view_location += depth * (
            float(off[0]) / lens[0][0] * aside.col[0] + float(off[1]) / lens[1][1] * aside.col[1]
        )
    view.update()


def show_within(area: bpy.types.Area, near: float, far: float) -> None:
    """Have a 3D viewport show everything between ``near`` and ``far`` from the eye [Blender units]: in a scene in
    millimetres, a room is larger than the default range of a viewport."""
    space = area.spaces.active
    space.clip_start, space.clip_end = min(space.clip_start, near), max(space.clip_end, far)


STEEPEST = 1.2
"""Greatest angle of a look at a place above or below the horizon, 69° [rad]: from there feet are still below."""


def upright_look(outward: Vector, front: Vector) -> Quaternion:
    """Rotation of a view that looks at a surface from where it faces, with the world's up upwards in the picture.

    Straight from above or below that would not say where up is: then it looks from as steep as ``STEEPEST``, and from
    the side of ``front`` where the surface faces no side.
    """
    level = Vector((outward.x, outward.y, 0.0))
    if level.length < 1e-3 * max(outward.length, 1e-12):
        level = Vector((front.x, front.y, 0.0))
    if level.length == 0.0:
        level = Vector((0.0, -1.0, 0.0))
    level.normalize()
    steep = math.asin(max(-1.0, min(1.0, outward.z / outward.length))) if outward.length else 0.0
    steep = max(-STEEPEST, min(STEEPEST, steep))
    back = math.cos(steep) * level + Vector((0.0, 0.0, math.sin(steep)))
    right = Vector((0.0, 0.0, 1.0)).cross(back).normalized()
    return Matrix((right, back.cross(right), back)).transposed().to_quaternion()


def look_at(context: bpy.types.Context, target: bpy.types.Object, turn: Euler | None = None) -> None:
    """Have the 3D viewport frame the selected object, turned so or as it is; nothing happens without a viewport."""
    area = viewport(context)
    region = None if area is None else next((region for region in area.regions if region.type == "WINDOW"), None)
    if region is None or bpy.app.background:
        return
    import numpy as np

    extent = max(target.dimensions, default=0.0)
    show_within(area, max(0.01 * extent, 1e-6), 20.0 * extent)
    if turn is not None:
        area.spaces.active.region_3d.view_rotation = turn.to_quaternion()
    with context.temp_override(area=area, region=region):
        if bpy.ops.view3d.view_selected.poll():
            bpy.ops.view3d.view_selected()
    # beside the sidebar, of which Blender knows nothing there
    chosen = [item for item in context.selected_objects if item.visible_get()]
    _fit(area, np.array([item.matrix_world @ Vector(at) for item in chosen for at in item.bound_box], np.float32))


def show_texture(context: bpy.types.Context) -> None:
    """Have a 3D viewport in Solid mode show textures as they are, without light of its own: they hold the capture's."""
    area = viewport(context)
    if area is not None and area.spaces.active.shading.type == "SOLID":
        area.spaces.active.shading.color_type, area.spaces.active.shading.light = "TEXTURE", "FLAT"


@persistent
def show_colors_again(*_: object) -> None:
    """Undo takes an avatar's texture, but leaves viewports as they are: without one they would show it white."""
    for window in bpy.context.window_manager.windows:
        items = window.scene.objects
        if not any(REPORT in item for item in items):
            continue
        if any(item.type == "MESH" and TEXTURED in item.data for item in items):
            continue
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                shading = area.spaces.active.shading
                if shading.type == "SOLID" and shading.color_type == "TEXTURE":
                    shading.color_type = "VERTEX"


def add_drawing(handlers: list[object], view: Callable[[], None], text: Callable[[], None]) -> None:
    """Draw in all 3D viewports, in the scene and over it; by what is listed Blender takes it away again."""
    if bpy.app.background:
        return
    space = bpy.types.SpaceView3D
    handlers.append(space.draw_handler_add(view, (), "WINDOW", "POST_VIEW"))
    handlers.append(space.draw_handler_add(text, (), "WINDOW", "POST_PIXEL"))


def remove_drawing(handlers: list[object]) -> None:
    """End what :func:`add_drawing` began."""
    while handlers:
        bpy.types.SpaceView3D.draw_handler_remove(handlers.pop(), "WINDOW")
