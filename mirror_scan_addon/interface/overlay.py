"""What is drawn over the 3D viewport: the capture's points, the mirrors, and the problem shown last.

Everything is drawn from data in the file. Batches on the graphics card are kept while the data has the same stamp, and
made again after undo, reload or a change. In a Blender without a window nothing is drawn.
"""

from __future__ import annotations

import bpy

from . import live_picture
from .viewport import add_drawing, remove_drawing, show_colors_again

COLORS = {"GOOD": (0.25, 0.8, 0.35), "USABLE": (0.95, 0.7, 0.15), "BAD": (0.92, 0.22, 0.2), "NONE": (0.6, 0.6, 0.62)}
"""sRGB of a mirror by :func:`.scan_records.quality_of`: green, amber, red, grey."""

UNLIMITED = ((-0.5, 0.5), (-1.0, 1.0))  # rectangle drawn for a plane of unknown extent [m]
LIFT = 0.01  # the glass is drawn so far in front of its plane, where an object of a virtual rig may lie [m]
ARROW = 0.3  # drawn length of a mirror's normal [m]

_handlers: list[object] = []
_batches: dict[object, tuple[object, object]] = {}  # what is on the graphics card: name → (key, batch)
_hover: list[tuple[float, float, float]] = []  # the point under the mouse while picking


def cloud_key(cloud: bpy.types.Object, settings: bpy.types.PropertyGroup, only_reflected: bool = False) -> tuple:
    """Everything that :func:`cloud_arrays` depends on, quick to compare."""
    from ..scene.point_cloud import STAMP

    mesh, mode = cloud.data, settings.cloud_colors
    key = (mesh.session_uid, mesh.get(STAMP), len(mesh.vertices), mode, only_reflected)
    if settings.fold or only_reflected:
        key += tuple(item.plane for item in settings.mirrors)
    if mode == "PART":
        subject = settings.subject
        key += (subject.depth_limit_m, subject.floor_clearance_m, subject.max_height_m)
    return (*key, settings.fold)


def cloud_arrays(cloud: bpy.types.Object, settings: bpy.types.PropertyGroup, only_reflected: bool = False):
    """Points (N, 3) float32 in the cloud's own frame and their colours (N, 4) uint8, as chosen in the panel.

    Edited points are shown where they are now; colours that are not known yet fall back to distance.
    """
    import numpy as np

    from ...core.preview import palette
    from ..scene import point_cloud as clouds
    from ..scene import scan_records

    mesh, mode = cloud.data, settings.cloud_colors
    points = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.attributes["position"].data.foreach_get("vector", points.ravel())
    depth = points[:, 2].copy()
    seen = clouds.values(mesh, clouds.SEEN, np.int8)
    colors = None
    if mode == "PART":
        view, height = clouds.values(mesh, clouds.VIEW, np.int8), clouds.values(mesh, clouds.HEIGHT, np.float32)
        if view is not None and height is not None:
            subject = settings.subject
            colors = palette.part_colors(
                palette.sort_parts(
                    view, height, depth, subject.floor_clearance_m, subject.max_height_m, subject.depth_limit_m
                )
            )
    elif mode == "VIEW" and seen is not None:
        colors = palette.view_colors(seen)
    elif mode == "CAPTURE":
        colors = clouds.colors_of(mesh)
    if colors is None:
        colors = palette.depth_colors(depth)
    rgba = np.full((len(points), 4), 255, np.uint8)
    rgba[:, :3] = colors
    if (settings.fold or only_reflected) and seen is not None:
        for number, item in enumerate(settings.mirrors, start=1):
            plane = scan_records.plane_of(item)
            if plane is not None:
                mine = seen == number
                normal = np.array(plane["normal"], np.float32)
                off = (points[mine] - np.array(plane["point"], np.float32)) @ normal
                points[mine] -= 2 * off[:, None] * normal
    if only_reflected:
        mine = np.zeros(len(points), bool) if seen is None else seen > 0
        points, rgba = points[mine], rgba[mine]
        rgba[:, :3] = palette.view_colors(seen[mine]) if seen is not None else 0
    return points, rgba


def mirror_corners(plane: dict) -> list[tuple[float, float, float]]:
    """The corners of a mirror's glass in the camera frame [m]; of a plane of unknown extent, those of a part of it."""
    (left, right), (top, bottom) = plane.get("rectangle") or UNLIMITED
    point, basis = plane["point"], plane["basis"]
    return [
        tuple(point[k] + a * basis[k][0] + b * basis[k][1] for k in range(3))
        for a, b in ((left, top), (right, top), (right, bottom), (left, bottom))
    ]


def pick_positions(cloud: bpy.types.Object, settings: bpy.types.PropertyGroup) -> list[list[tuple]]:
    """Positions of the picks of each mirror in the camera frame [m]; a pick without a reading near it is left out."""
    import numpy as np

    from ..scene.point_cloud import read_cloud

    arrays = read_cloud(cloud)
    intrinsics = arrays.intrinsics
    width, height = intrinsics.width, intrinsics.height
    depth = arrays.depth
    places = []
    for item in settings.mirrors:
        mine = []
        for pick in item.picks:
            u, v = round(pick.pixel[0]), round(pick.pixel[1])
            low_u, low_v = max(u - 3, 0), max(v - 3, 0)
            window = depth[low_v : min(v + 4, height), low_u : min(u + 4, width)]
            rows, columns = np.nonzero(window)
            if len(rows):
                nearest = np.argmin((rows + low_v - v) ** 2 + (columns + low_u - u) ** 2)
                z = float(window[rows[nearest], columns[nearest]])
                mine.append(((u - intrinsics.cx) / intrinsics.fx * z, (v - intrinsics.cy) / intrinsics.fy * z, z))
        places.append(mine)
    return places


def set_hover(point) -> None:
    """Mark a point under the mouse, in the cloud's frame; None removes the mark."""
    _hover[:] = [] if point is None else [tuple(map(float, point))]


def hovered() -> tuple | None:
    """The point that is marked under the mouse."""
    return _hover[0] if _hover else None


# --- drawing ---------------------------------------------------------------------------------------------------------


def _visible_cloud(context: bpy.types.Context) -> bpy.types.Object | None:
    from ..scene.point_cloud import cloud_of

    settings = getattr(context.scene, "mirror_scan", None)
    if settings is None or settings.cloud is None:
        return None
    cloud = cloud_of(context.scene)
    if cloud is None or cloud.mode == "EDIT" or not cloud.visible_get():
        return None
    return cloud


def _draw_view() -> None:
    """Draw points and mirrors in 3D, after the scene."""
    import gpu

    context = bpy.context
    if live_picture.draw_view(context):  # in place of what is in the file
        return
    cloud = _visible_cloud(context)
    if cloud is None:
        _batches.clear()
        return
    settings = context.scene.mirror_scan
    picking = context.window_manager.mirror_scan.picking
    gpu.matrix.push()
    try:
        gpu.matrix.multiply_matrix(cloud.matrix_world)
        gpu.state.depth_test_set("LESS_EQUAL")
        if settings.show_cloud:
            gpu.state.depth_mask_set(True)
            _draw_points("cloud", cloud, settings, False)
            if picking and not settings.fold:
                _draw_points("reflected", cloud, settings, True)
            gpu.state.depth_mask_set(False)
        if settings.show_mirrors and (picking or context.space_data.overlay.show_overlays):
            _draw_mirrors(cloud, settings, context.region)
    finally:
        gpu.matrix.pop()
        gpu.state.depth_test_set("NONE")
        gpu.state.depth_mask_set(False)
        gpu.state.blend_set("NONE")


def _draw_points(name: str, cloud, settings, only_reflected: bool) -> None:
    import gpu

    key = cloud_key(cloud, settings, only_reflected)
    kept = _batches.get(name)
    if kept is None or kept[0] != key:
        points, rgba = cloud_arrays(cloud, settings, only_reflected)
        layout = gpu.types.GPUVertFormat()
        layout.attr_add(id="pos", comp_type="F32", len=3, fetch_mode="FLOAT")
        layout.attr_add(id="color", comp_type="U8", len=4, fetch_mode="INT_TO_FLOAT_UNIT")
        batch = None
        if len(points):
            buffer = gpu.types.GPUVertBuf(len=len(points), format=layout)
            buffer.attr_fill(id="pos", data=points)
            buffer.attr_fill(id="color", data=rgba)
            batch = gpu.types.GPUBatch(type="POINTS", buf=buffer)
        kept = _batches[name] = (key, batch)
    if kept[1] is not None:
        shader = point_shader("FLAT", settings.point_size * bpy.context.preferences.system.ui_scale)
        kept[1].draw(shader)


def point_shader(kind: str, size: float):
    """The built-in shader for points of that size; in Blender 4.5 the size is set separately."""
    import gpu

    gpu.state.point_size_set(size)
    try:
        shader = gpu.shader.from_builtin(f"POINT_{kind}_COLOR")
    except ValueError:
        shader = gpu.shader.from_builtin(f"{kind}_COLOR")
        shader.bind()
        return shader
    shader.bind()
    shader.uniform_float("size", size)
    return shader


def _draw_mirrors(cloud, settings, region) -> None:
    import gpu
    from gpu_extras.batch import batch_for_shader

    from ..scene import scan_records
    from ..scene.point_cloud import STAMP

    scale = bpy.context.preferences.system.ui_scale
    plain, line = gpu.shader.from_builtin("UNIFORM_COLOR"), gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    for number, item in enumerate(settings.mirrors):
        plane = scan_records.plane_of(item)
        if plane is None:
            continue
        color, active = COLORS[scan_records.quality_of(item)], number == settings.mirror_index
        a, b, c, d = corners = mirror_corners(plane)
        gpu.state.depth_test_set("LESS_EQUAL")
        plain.bind()
        plain.uniform_float("color", (*color, 0.2 if active else 0.1))
        lifted = [tuple(p[k] + LIFT * plane["normal"][k] for k in range(3)) for p in (a, b, c, a, c, d)]
        batch_for_shader(plain, "TRIS", {"pos": lifted}).draw(plain)
        point = plane["point"]
        tip = tuple(point[k] + ARROW * plane["normal"][k] for k in range(3))
        segments = [*_closed(corners), point, tip, *_arrow_head(plane, tip)]
        gpu.state.depth_test_set("NONE")
        line.bind()
        line.uniform_float("viewportSize", (region.width, region.height))
        line.uniform_float("lineWidth", (2.5 if active else 1.5) * scale)
        line.uniform_float("color", (*color, 1.0))
        batch_for_shader(line, "LINES", {"pos": segments}).draw(line)

    key = (cloud.data.session_uid, cloud.data.get(STAMP), *(tuple(p.pixel) for m in settings.mirrors for p in m.picks))
    kept = _batches.get("picks")
    if kept is None or kept[0] != key:
        kept = _batches["picks"] = (key, _safe_pick_positions(cloud, settings))
    gpu.state.depth_test_set("NONE")
    for number, places in enumerate(kept[1]):
        if not places or number >= len(settings.mirrors):
            continue
        active = number == settings.mirror_index
        for size, color in ((11, (0, 0, 0, 1)), (7, (*COLORS[scan_records.quality_of(settings.mirrors[number])], 1))):
            shader = point_shader("UNIFORM", (size if active else size - 3) * scale)
            shader.uniform_float("color", color)
            batch_for_shader(shader, "POINTS", {"pos": places}).draw(shader)
    if _hover:
        shader = point_shader("UNIFORM", 8 * scale)
        shader.uniform_float("color", (1, 1, 1, 1))
        batch_for_shader(shader, "POINTS", {"pos": _hover}).draw(shader)


def _safe_pick_positions(cloud, settings) -> list:
    from ...core.errors import CaptureError

    try:
        return pick_positions(cloud, settings)
    except CaptureError:  # edits left no depth map; the operators report that when they are called
        return []


def _closed(corners: list) -> list:
    return [corner for k in range(len(corners)) for corner in (corners[k], corners[(k + 1) % len(corners)])]


def _arrow_head(plane: dict, tip: tuple) -> list:
    basis, normal = plane["basis"], plane["normal"]
    barbs = []
    for side in (-1, 1):
        barb = tuple(tip[k] - 0.06 * normal[k] + side * 0.03 * basis[k][0] for k in range(3))
        barbs += [tip, barb]
    return barbs


def _draw_text() -> None:
    """Draw the mirrors' names and residuals, and the problem, in 2D on top of everything."""
    import blf
    from bpy_extras.view3d_utils import location_3d_to_region_2d
    from mathutils import Vector

    from ..language.texts import say, tell
    from ..scene import scan_records

    context = bpy.context
    region, space, scale = context.region, context.region_data, context.preferences.system.ui_scale
    if space is None:
        return
    if live_picture.draw_text(context, *visible_range(context)):
        return
    cloud = _visible_cloud(context)
    shown = context.space_data.overlay.show_overlays or context.window_manager.mirror_scan.picking
    if cloud is not None and shown and context.scene.mirror_scan.show_mirrors:
        settings = context.scene.mirror_scan
        for item in settings.mirrors:
            plane = scan_records.plane_of(item)
            if plane is None:
                continue
            corners = mirror_corners(plane)
            top = [0.5 * (corners[0][k] + corners[1][k]) for k in range(3)]
            at = location_3d_to_region_2d(region, space, cloud.matrix_world @ Vector(top))
            if at is None:
                continue
            text = say("{name}: {word}").format(name=item.name, word=scan_records.quality_word(item))
            if item.message:
                text = tell(item.message)
            label(blf, text, at, COLORS[scan_records.quality_of(item)], scale)
    _draw_problem(context, region, space, scale)


def visible_range(context: bpy.types.Context) -> tuple[float, float]:
    """Left and right end of the part of the viewport that toolbar and sidebar do not cover [px]."""
    region, left, right = context.region, 0.0, float(context.region.width)
    for other in context.area.regions:
        if other.type in ("TOOLS", "UI") and other.width > 1 and other.x < region.x + region.width:
            if other.alignment == "LEFT" and other.x + other.width > region.x:
                left = max(left, other.x + other.width - region.x)
            elif other.alignment == "RIGHT" and other.x > region.x:
                right = min(right, other.x - region.x)
    return left, right


def label(blf, text: str, at, color, scale: float) -> None:
    """Draw text above a place, moved aside if a sidebar would cover part of it; nothing if it covers the place."""
    blf.size(0, 13 * scale)
    width, height = blf.dimensions(0, text)
    left, right = visible_range(bpy.context)
    if not left <= at[0] <= right:
        return
    blf.enable(0, blf.SHADOW)
    blf.shadow(0, 3, 0, 0, 0, 0.9)
    margin = 6 * scale
    x = max(min(at[0] - width / 2, right - width - margin), left + margin)
    blf.position(0, x, at[1] + 0.6 * height, 0)
    blf.color(0, *color, 1)
    blf.draw(0, text)
    blf.disable(0, blf.SHADOW)


def _draw_problem(context, region, space, scale: float) -> None:
    import blf
    import gpu
    from bpy_extras.view3d_utils import location_3d_to_region_2d
    from gpu_extras.presets import draw_circle_2d
    from mathutils import Vector

    from ..language.texts import say
    from ..scene import report_text

    number = context.scene.mirror_scan.problem_index
    report = report_text.avatar_report(context.object) if number and context.object is not None else None
    problems = report_text.problems_of(report) if report else []
    if not 0 < number <= len(problems) or not context.object.visible_get():
        return
    place = problems[number - 1]
    at = location_3d_to_region_2d(region, space, context.object.matrix_world @ Vector(place["point"]))
    if at is None:
        return
    gpu.state.line_width_set(2.5 * scale)
    draw_circle_2d(at, (*COLORS["BAD"], 1), 26 * scale, segments=48)
    gpu.state.line_width_set(1)
    problem = report_text.problem_text(place, context.scene)
    text = say("{number} of {count}: {problem}").format(number=number, count=len(problems), problem=problem)
    label(blf, text, at + Vector((0, 30 * scale)), COLORS["BAD"], scale)


def register() -> None:
    add_drawing(_handlers, _draw_view, _draw_text)
    bpy.app.handlers.undo_post.append(show_colors_again)


def unregister() -> None:
    remove_drawing(_handlers)
    if show_colors_again in bpy.app.handlers.undo_post:
        bpy.app.handlers.undo_post.remove(show_colors_again)
    _batches.clear()
    _hover.clear()
    live_picture.show(None)
