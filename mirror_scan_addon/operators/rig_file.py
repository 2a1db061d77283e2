"""Calibrate a rig once and use it for every later capture, until a part of it moves."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import os

import bpy
from bpy.props import BoolProperty, StringProperty

from ...core.errors import MirrorError, OutputError
from ..background import job_operators
from ..language.texts import CONTEXT, say, tell
from ..scene import scan_records
from .mirrors import replace_mirrors


class _RigFileOperator(job_operators.FileJobOperator):
    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context) or scan_records.no_cloud(context))

    def proposal(self, context: bpy.types.Context) -> str:
        """A rig file next to the capture's folder: it serves other captures too."""
        root = scan_records.capture_place(context.scene.mirror_scan)
        return os.path.join(os.path.dirname(os.path.normpath(root)) if root else "", "rig.json")

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        from ..scene import point_cloud

        if not self.filepath:
            raise OutputError(say("Enter the name of a rig file"), code="rig_file")
        arrays = point_cloud.read_cloud(point_cloud.cloud_of(context.scene))
        return self.task(arrays, scan_records.absolute(self.filepath), context.scene.mirror_scan)


class MIRRORSCAN_OT_calibrate_rig(_RigFileOperator, bpy.types.Operator):
    """Place the mirrors once for all later captures of this rig and write them to a rig file. Best done without a person, with a long burst and a flat board where people will stand, visible directly and in the mirrors"""  # noqa: E501 - Blender shows it as the tooltip

    bl_idname = "mirror_scan.calibrate_rig"
    bl_label = "Calibrate Rig"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(
        name="Rig File", description="JSON file to write", subtype="FILE_PATH",
        options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    filter_glob: StringProperty(default="*.json", options={"HIDDEN", "SKIP_SAVE"})
    check_existing: BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})

    def task(self, arrays, path: str, settings: bpy.types.PropertyGroup) -> job_operators.Task:
        records = scan_records.placed_mirrors(settings) if settings.mirrors else []
        glass = settings.quality.glass_offset_m, settings.quality.glass_thickness_m
        return job_operators.Task("calibrate_steps", (arrays, records, glass[0], path, glass[1]))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        replace_mirrors(target, result)
        names = ", ".join(record["name"] for record in result.mirrors)
        self.report({"INFO"}, say("Rig written to {path}: {names}").format(path=self.filepath, names=names))


class MIRRORSCAN_OT_use_rig(_RigFileOperator, bpy.types.Operator):
    """Load the mirrors from a rig file. Replaces the current mirrors, and warns if one has moved since calibration"""

    bl_idname = "mirror_scan.use_rig"
    bl_label = "Use Rig File"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(
        name="Rig File", description="JSON file written by Calibrate Rig or the command line", subtype="FILE_PATH",
        options={"SKIP_SAVE", "PATH_SUPPORTS_BLEND_RELATIVE"}, translation_context=CONTEXT,
    )  # fmt: skip
    filter_glob: StringProperty(default="*.json", options={"HIDDEN", "SKIP_SAVE"})

    def task(self, arrays, path: str, settings: bpy.types.PropertyGroup) -> job_operators.Task:
        if os.path.isdir(path):
            raise MirrorError(say("{path}: is a folder; choose a rig file").format(path=path), code="rig_file")
        return job_operators.Task("rig_steps", (arrays, path))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        replace_mirrors(target, result)
        for warning in result.warnings:
            self.report({"WARNING"}, tell(warning))
        names = ", ".join(record["name"] for record in result.mirrors)
        self.report({"INFO"}, say("Mirrors of the rig: {names}").format(names=names))


CLASSES = (MIRRORSCAN_OT_calibrate_rig, MIRRORSCAN_OT_use_rig)
