"""Find mirrors, set them by scripts, remove them, write them to a file."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import BoolProperty, FloatVectorProperty, IntProperty, StringProperty

from ...core.errors import MirrorError, OutputError
from ..background import job_operators
from ..language.texts import CONTEXT, say, tell
from ..scene import kept_errors, scan_records


class _MirrorOperator(job_operators.JobOperator):
    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context) or scan_records.no_cloud(context))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        replace_mirrors(target, result)


def replace_mirrors(target: bpy.types.Scene, fitted) -> None:
    """Replace a scene's mirrors by fitted ones, and discard the results of the old ones."""
    from ..scene import point_cloud

    scan_records.set_records(target.mirror_scan, fitted.mirrors)
    points = point_cloud.cloud_of(target)
    if points is None:
        raise MirrorError(say("The points of the capture are gone; load it again"), code="not_loaded")
    point_cloud.forget_values(points.data, point_cloud.VIEW, point_cloud.HEIGHT)
    if fitted.seen is None:
        point_cloud.forget_values(points.data, point_cloud.SEEN)
    else:
        point_cloud.set_values(points.data, seen=fitted.seen)
    scan_records.forget_subject(target.mirror_scan)


class MIRRORSCAN_OT_find_mirrors(_MirrorOperator, bpy.types.Operator):
    """Find the mirrors by their frames and by what they reflect. Replaces the current mirrors"""

    bl_idname = "mirror_scan.find_mirrors"
    bl_label = "Find Mirrors"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        from ..scene import point_cloud

        arrays = point_cloud.read_cloud(point_cloud.cloud_of(context.scene))
        offset = scan_records.behind_frame(context.scene.mirror_scan)
        sensor = str(arrays.info.get("sensor", ""))
        return job_operators.Task("find_mirrors_steps", (arrays.depth, arrays.color, arrays.intrinsics, offset, sensor))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        if not result.mirrors:
            raise MirrorError(
                say(
                    "No mirror was found; pick points on their frames instead. A mirror is found automatically if its "
                    "frame is at least 3 cm wide and 10 cm in front of the wall, and the glass shows the person"
                ),
                code="no_mirror",
            )
        super().finish(context, target, result)
        names = ", ".join(record["name"] for record in result.mirrors)
        self.report({"INFO"}, say("Mirrors found: {names}").format(names=names))


class MIRRORSCAN_OT_set_mirror(_MirrorOperator, bpy.types.Operator):
    """Place one mirror from points on its frame or from a known plane; for scripts"""

    bl_idname = "mirror_scan.set_mirror"
    bl_label = "Set Mirror"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    index: IntProperty(
        name="Index", description="Index of the mirror, counted from 0. -1, or one past the last, adds a mirror",
        default=-1, min=-1, options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    points: StringProperty(
        name="Points",
        description="List of at least 3 points on the frame, as text: pairs are pixels of the depth image, triples are "
        "points in the world",
        options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    name: StringProperty(
        name="Name", description="Name of the mirror", options={"SKIP_SAVE"}, translation_context=CONTEXT
    )
    point: FloatVectorProperty(
        name="Point", description="A point on the mirror's plane in the camera's frame, in metres; needs a normal",
        size=3, subtype="XYZ", options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    normal: FloatVectorProperty(
        name="Normal", description="Direction that the mirror faces in the camera's frame: x right, y down, z forward",
        size=3, subtype="XYZ", options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        from ..scene import point_cloud

        settings = context.scene.mirror_scan
        records = scan_records.records_of(settings)
        index = len(records) if self.index < 0 else self.index
        if index > len(records):
            text = say("index: {index} is too large; {count} adds a mirror")
            raise MirrorError(text.format(count=len(records), index=index))
        if index == len(records):
            records.append(scan_records.new_record(settings, self.name.strip()))
        elif self.name.strip():
            records[index]["name"] = self.name.strip()
        points = point_cloud.cloud_of(context.scene)
        arrays = point_cloud.read_cloud(points)
        if self.points:
            picks = scan_records.parse_points(self.points)
            if len(picks[0]) == 3:
                picks = _pixels_of(picks, point_cloud.camera_to_world(points), arrays.intrinsics)
            records[index] |= {"picks": picks, "plane": "", "source": "picked"}
        elif any(self.normal):
            records[index] |= {"picks": [], "plane": _given_plane(records[index]["name"], self.point, self.normal)}
        else:
            raise MirrorError(say("Give points on the mirror's frame, or a point and the normal of its plane"))
        self._index = index
        offset = scan_records.behind_frame(settings)
        sensor = str(arrays.info.get("sensor", ""))
        return job_operators.Task("fit_steps", (arrays.depth, arrays.intrinsics, records, offset, None, sensor))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        record = result.mirrors[self._index]
        if record["message"]:
            raise MirrorError(record["message"])
        super().finish(context, target, result)
        target.mirror_scan.mirror_index = self._index
        item = target.mirror_scan.mirrors[self._index]
        name = item.name
        if complaint := scan_records.complaint_of(item):
            self.report({"WARNING"}, tell(complaint))
        text = say("{name}: flat to {residual:.1f} mm") if record["picks"] else say("{name}: placed as given")
        self.report({"INFO"}, text.format(name=name, residual=record["residual_mm"]))


def _pixels_of(points: list, camera_to_world, intrinsics) -> list:
    """Pixels at which the camera sees points in the world."""
    import numpy as np

    from ...core.camera import project

    world_to_camera = np.linalg.inv(camera_to_world)
    pixels = project(np.array(points) @ world_to_camera[:3, :3].T + world_to_camera[:3, 3], intrinsics)
    if not np.isfinite(pixels).all():
        raise MirrorError(say("points: at least one lies behind the camera"))
    return pixels.tolist()


def _given_plane(name: str, point, normal) -> str:
    """A plane given by a script, as it is kept with a mirror."""
    from ..background import numba_setup

    numba_setup.prepare_kernels()
    from ...core.mirrors.mirror import plane_mirror
    from ..tasks import record_of

    return record_of(plane_mirror(name, list(point), list(normal)))["plane"]


class MIRRORSCAN_OT_select_mirror(bpy.types.Operator):
    """Make a mirror the active one"""

    bl_idname = "mirror_scan.select_mirror"
    bl_label = "Select Mirror"
    bl_translation_context = CONTEXT
    bl_options = {"INTERNAL"}

    index: IntProperty(
        name="Index", description="Index of the mirror, counted from 0", default=0, min=0, options={"SKIP_SAVE"},
        translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Tooltip of the button under the mouse: how good the mirror is, and by what figures."""
        mirrors = context.scene.mirror_scan.mirrors
        if properties.index >= len(mirrors):
            return ""
        item = mirrors[properties.index]
        said = item.message or item.reason
        parts = (tell(said) if said else "", scan_records.mirror_figures(item))
        return ".\n".join(part for part in parts if part)

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.mirror_scan
        if self.index >= len(settings.mirrors):
            return {"CANCELLED"}
        settings.mirror_index = self.index
        return {"FINISHED"}


class MIRRORSCAN_OT_remove_mirror(bpy.types.Operator):
    """Remove a mirror from the list"""

    bl_idname = "mirror_scan.remove_mirror"
    bl_label = "Remove Mirror"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    index: IntProperty(
        name="Index", description="Index of the mirror, counted from 0. -1 = the active one", default=-1, min=-1,
        options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context) or scan_records.no_mirror(context))

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.mirror_scan
        index = settings.mirror_index if self.index < 0 else self.index
        if index >= len(settings.mirrors):
            text = say("There is no mirror with index {index}; the last one has index {last}")
            self.report({"ERROR"}, text.format(last=len(settings.mirrors) - 1, index=index))
            return {"CANCELLED"}
        settings.mirrors.remove(index)
        settings.mirror_index = max(0, min(settings.mirror_index, len(settings.mirrors) - 1))
        _forget_views(context.scene)
        kept_errors.forget(context, self)
        return {"FINISHED"}


class MIRRORSCAN_OT_clear_mirrors(bpy.types.Operator):
    """Remove all mirrors from the list"""

    bl_idname = "mirror_scan.clear_mirrors"
    bl_label = "Clear Mirrors"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    poll = MIRRORSCAN_OT_remove_mirror.poll

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.mirror_scan
        settings.mirrors.clear()
        settings.mirror_index = 0
        _forget_views(context.scene)
        kept_errors.forget(context, self)
        return {"FINISHED"}


def _forget_views(target: bpy.types.Scene) -> None:
    """Discard what depends on the numbers of the views, which have changed."""
    from ..scene import point_cloud

    points = point_cloud.cloud_of(target)
    if points is not None and points.data.library is None:
        point_cloud.forget_values(points.data, point_cloud.SEEN, point_cloud.VIEW, point_cloud.HEIGHT)
    scan_records.forget_subject(target.mirror_scan)


class MIRRORSCAN_OT_save_mirrors(bpy.types.Operator):
    """Write the mirrors to a file: mirrors.json in the capture's folder, or one for later captures of the same rig"""

    bl_idname = "mirror_scan.save_mirrors"
    bl_label = "Save Mirrors"
    bl_translation_context = CONTEXT

    filepath: StringProperty(
        name="File", description="JSON file to write", subtype="FILE_PATH",
        options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    filter_glob: StringProperty(default="*.json", options={"HIDDEN", "SKIP_SAVE"})
    check_existing: BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.no_mirror(context))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        import os

        place = scan_records.capture_place(context.scene.mirror_scan)
        self.filepath = self.filepath or os.path.join(place, "mirrors.json")
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        import json

        from ...core.io.atomic_files import replacing

        entries = []
        for item in context.scene.mirror_scan.mirrors:
            plane = scan_records.plane_of(item)
            if len(item.picks) >= 3:
                pixels = [[round(value, 2) for value in pick.pixel] for pick in item.picks]
                entries.append({"name": item.name, "frame_pixels": pixels})
            elif plane is not None:
                entries.append({"name": item.name, "plane": {"point": plane["point"], "normal": plane["normal"]}})
        try:
            if not self.filepath:
                raise OutputError(say("Enter the name of the file to write"))
            if not entries:
                raise OutputError(say("No mirror is placed yet; there is nothing to write"), code="no_mirror")
            path = scan_records.absolute(self.filepath)
            with replacing(path) as temporary:
                temporary.write_text(json.dumps({"mirrors": entries}, indent=1, ensure_ascii=False), encoding="utf-8")
        except job_operators.REPORTED as error:
            self.report({"ERROR"}, kept_errors.keep(context, self, error))
            return {"CANCELLED"}
        kept_errors.forget(context, self)
        names = ", ".join(entry["name"] for entry in entries)
        self.report({"INFO"}, say("Mirrors written to {path}: {names}").format(path=path, names=names))
        return {"FINISHED"}


CLASSES = (
    MIRRORSCAN_OT_find_mirrors,
    MIRRORSCAN_OT_set_mirror,
    MIRRORSCAN_OT_select_mirror,
    MIRRORSCAN_OT_remove_mirror,
    MIRRORSCAN_OT_clear_mirrors,
    MIRRORSCAN_OT_save_mirrors,
)
