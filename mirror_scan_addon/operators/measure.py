"""Measure an avatar's body as a tape would, and write the figures to a file."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import os

import bpy
from bpy.props import BoolProperty, StringProperty

from ...core.errors import OutputError
from ..background import job_operators
from ..language.texts import CONTEXT, say
from ..scene import kept_errors, scan_records
from ..scene.blender_files import file_name
from ..scene.scan_records import armature_of, no_mesh, not_ours
from ..scene.units import metres_per_unit


class MIRRORSCAN_OT_measure(job_operators.JobOperator, bpy.types.Operator):
    """Measure the selected avatar as a tape would: girths, lengths and height, drawn on the body"""

    bl_idname = "mirror_scan.measure"
    bl_label = "Measure"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = scan_records.editable(context) or no_mesh(context) or not_ours(context)
        problem = problem or scan_records.rests_otherwise(context)
        return scan_records.allows(cls, problem)

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        from ..scene import armature, avatar_objects, report_text

        avatar = context.object
        size = avatar_objects.even_size_of(avatar, metres_per_unit(context.scene))
        surface = avatar_objects.read_surface(avatar, size)
        avatar_objects.check_finite(avatar, surface.vertices)
        self._uid, self._size = avatar.session_uid, float(size.mean())
        skeleton = weights = None
        if (bones := armature_of(avatar)) is not None:
            skeleton, weights = armature.read_skeleton(bones, self._size), armature.read_weights(avatar)
        report = report_text.avatar_report(avatar) or {}
        seen = {name: report[name] for name in ("camera_to_avatar", "mirrors", "views") if name in report}
        return job_operators.Task("measure_steps", (surface, skeleton, weights, seen if len(seen) == 3 else {}))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        from ..scene import avatar_objects, report_text, tape_curves

        avatar = avatar_objects.avatar_of(self._uid)
        collection = avatar.users_collection[0] if avatar.users_collection else target.collection
        tape_curves.draw_tapes(avatar, result.measurements, collection, self._size)
        report = report_text.avatar_report(avatar) or {}
        report_text.set_report(avatar, report | {"measurements": result.summary})
        text = say("{name}: {count} measures, drawn in the collection “{collection}”")
        shown = tape_curves.tapes_of(avatar).name
        self.report({"INFO"}, text.format(name=avatar.name, count=len(result.summary), collection=shown))


class MIRRORSCAN_OT_save_measurements(bpy.types.Operator):
    """Write the avatar's measurements to a table (CSV) that spreadsheets read"""

    bl_idname = "mirror_scan.save_measurements"
    bl_label = "Save Measurements"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER"}

    filepath: StringProperty(
        name="File", description="CSV file to write", subtype="FILE_PATH",
        options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    filter_glob: StringProperty(default="*.csv", options={"HIDDEN", "SKIP_SAVE"})
    check_existing: BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        from ..scene import report_text

        report = report_text.avatar_report(context.object) or {}
        problem = "" if report_text.measurements_of(report) else say("Measure the avatar first")
        return scan_records.allows(cls, problem)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self.filepath:
            folder = context.scene.mirror_scan.export_folder or os.path.dirname(bpy.data.filepath)
            self.filepath = os.path.join(folder, file_name(context.object.name) + ".csv")
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...core.measurements import Measurement, write_measurements
        from ..scene import report_text

        try:
            if not self.filepath:
                raise OutputError(say("Enter the name of the file to write"))
            path = scan_records.absolute(self.filepath)
            if not path.lower().endswith(".csv"):
                path += ".csv"
            kept = report_text.measurements_of(report_text.avatar_report(context.object))
            write_measurements(
                path, {name: Measurement(name, **one, loops=(), closed=True) for name, one in kept.items()}
            )
        except job_operators.REPORTED as error:
            self.report({"ERROR"}, kept_errors.keep(context, self, error))
            return {"CANCELLED"}
        kept_errors.forget(context, self)
        self.report({"INFO"}, say("{name} written to {path}").format(name=context.object.name, path=path))
        return {"FINISHED"}


CLASSES = (MIRRORSCAN_OT_measure, MIRRORSCAN_OT_save_measurements)
