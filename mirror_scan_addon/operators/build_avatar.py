"""Build an avatar in the scene from a capture."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import os

import bpy
from bpy.props import BoolProperty, IntProperty, StringProperty

from ...core.errors import CaptureError
from ..background import job_operators
from ..interface.viewport import look_at, show_colors_again, viewport
from ..language.texts import CONTEXT, say, tell
from ..scene import room, scan_collections, scan_records
from ..scene.units import metres_per_unit


class MIRRORSCAN_OT_build_avatar(job_operators.JobOperator, bpy.types.Operator):
    """Build the avatar of the loaded capture: a closed, coloured mesh of the person"""

    bl_idname = "mirror_scan.build_avatar"
    bl_label = "Build Avatar"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    filepath: StringProperty(
        name="Capture", description="Folder or file of the capture. Leave empty to use the one loaded in the scene",
        subtype="FILE_PATH", options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    mirrors_filepath: StringProperty(
        name="Mirrors",
        description="File with points picked on the mirrors' frames. Leave empty to use the mirrors of the scene",
        subtype="FILE_PATH", options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    frames: IntProperty(
        name="Frames",
        description="How many depth frames of the burst are averaged. 0 = all. Taken from the scene unless given",
        default=0, min=0, soft_max=60, options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip

    keep_version: BoolProperty(
        name="Keep Last Version",
        description="Keep the avatar that was built from this capture before, hidden in a collection of its own, "
        "instead of replacing it. Taken from the scene unless given",
        default=False, options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip

    _frame_view = False
    _turn = None  # the view is turned so when it frames the avatar; None leaves it as it is

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = scan_records.editable(context)
        settings, region = context.scene.mirror_scan, context.region
        # scripts may name a capture, which the panel's button does not
        if not problem and region is not None and region.type == "UI":
            if not settings.capture_path and settings.cloud is None:
                problem = say("Load a capture first")
        return scan_records.allows(cls, problem)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self._frame_view = True
        return self.run(context)

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        from ..scene import point_cloud

        settings = context.scene.mirror_scan
        frames = self.frames if self.properties.is_property_set("frames") else settings.frames
        mirrors_path = scan_records.absolute(self.mirrors_filepath)
        if self.filepath:
            path, points, mirrors = scan_records.absolute(scan_records.capture_root(self.filepath)), None, None
        else:
            points = point_cloud.cloud_of(context.scene)
            path = scan_records.capture_root(settings.capture_path)
            if not path and points is None:
                raise CaptureError(
                    say("No capture is loaded; choose one in the Mirror Scan tab of the sidebar"), code="not_loaded"
                )
            mirrors = scan_records.placed_mirrors(settings) if settings.mirrors and not mirrors_path else None
            for item in settings.mirrors if mirrors else ():
                if complaint := scan_records.complaint_of(item):
                    self.report({"WARNING"}, tell(complaint))
        self._aligns = not self.filepath and points is not None
        arrays = None
        if points is not None:
            try:
                missing = not path or not os.path.exists(scan_records.absolute(path))
            except CaptureError:  # relative to a .blend that is not saved
                missing = True
            if missing:
                if path:
                    text = say("{path}: no longer exists; the avatar is built from the points kept in this file")
                    self.report({"WARNING"}, text.format(path=path))
                path, arrays = "", point_cloud.read_cloud(points)
        path = scan_records.absolute(path)
        options, reading = scan_records.build_settings(settings), scan_records.reading_of(settings)
        self._built_from = path, frames, reading
        place = path or (str(point_cloud.cloud_info(points).get("path", "")) if arrays is not None else "")
        name = scan_collections.capture_name(place) if place else _name_of(points)
        self._source = {"path": place, "name": name}
        given = self.properties.is_property_set("keep_version")
        self._keep = self.keep_version if given else settings.keep_versions
        return job_operators.Task("build_steps", (path, frames, mirrors, mirrors_path, options, arrays, reading))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        import numpy as np

        from ..scene import avatar_objects, avatar_places, capture_source, point_cloud

        # The user may be in another scene by now; the avatar goes to the scene in which the button was pressed.
        here = target == context.scene
        unit = metres_per_unit(target)
        avatar = avatar_places.put_avatar(target, self._source, result.mesh, result.report, unit, self._keep)
        settings = target.mirror_scan
        settings.problem_index = 0
        capture_source.keep_source(avatar, *self._built_from, result.mirrors, self._source["name"])
        points = point_cloud.cloud_of(target)
        camera_to_avatar = np.array(result.report.get("camera_to_avatar") or np.eye(4))
        if self._aligns and points is not None and points.library is None:
            point_cloud.place(points, avatar_places.pose_of(avatar, target, unit) @ camera_to_avatar, unit)
            settings.show_cloud = False  # the points lie on the avatar now and would hide it
            if not settings.mirrors:
                scan_records.set_records(settings, result.mirrors)
        if here:
            avatar_objects.select_only(context, avatar)
            if self._frame_view:
                _make_room(self, context, avatar)
                _show_colors(context)
                show_colors_again()  # a rebuilt avatar has lost its texture
                look_at(context, avatar, self._turn)
        dropped = len(result.mesh.triangles) - len(avatar.data.polygons)
        if dropped:
            text = say("{name}: Blender removed {count} degenerate or duplicate faces")
            self.report({"WARNING"}, text.format(name=avatar.name, count=dropped))
        for warning in result.warnings:
            self.report({"WARNING"}, tell(warning))
        text = say("Avatar built: {name}, {count:,} vertices").format(name=avatar.name, count=len(avatar.data.vertices))
        self.report({"INFO"}, text)


def _make_room(operator: bpy.types.Operator, context: bpy.types.Context, avatar: bpy.types.Object) -> None:
    """Hide what would hide the avatar: what belongs to the scan, and objects where it stands."""
    context.view_layer.update()  # the avatar's place in the world
    room.show_setup(context.scene, context.view_layer, False)
    count = room.hide(room.in_the_way(context.scene, context.view_layer, avatar), context.view_layer)
    if count:
        text = say("Objects hidden that stood where the avatar stands: {count}")
        operator.report({"INFO"}, text.format(count=count))


def _name_of(cloud: bpy.types.Object) -> str:
    """Of the capture whose points an object holds."""
    from ..scene import point_cloud

    return str(point_cloud.cloud_info(cloud).get("name", "")) or "Scan"


def _show_colors(context: bpy.types.Context) -> None:
    """Have a viewport in Solid mode show the colours of the mesh instead of those of its materials, without light of
    its own: the colours hold the light of the capture."""
    area = viewport(context)
    space = None if area is None else area.spaces.active
    if space is not None and space.shading.type == "SOLID":
        if space.shading.color_type == "MATERIAL":
            space.shading.color_type, space.shading.light = "VERTEX", "FLAT"


CLASSES = (MIRRORSCAN_OT_build_avatar,)
