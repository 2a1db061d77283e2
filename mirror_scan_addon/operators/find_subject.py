"""Find the person and the floor in a capture."""

from __future__ import annotations

import bpy

from ..background import job_operators
from ..language.texts import CONTEXT, say, tell
from ..scene import scan_records
from ..scene.capture_objects import place_on_found
from ..scene.live_subject import put_subject


class MIRRORSCAN_OT_find_subject(job_operators.JobOperator, bpy.types.Operator):
    """Separate the person from the floor and the room, directly and in each mirror, and colour the points by it"""

    bl_idname = "mirror_scan.find_subject"
    bl_label = "Find Subject"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(
            cls, scan_records.editable(context) or scan_records.no_cloud(context) or scan_records.no_mirror(context)
        )

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        from ..scene import point_cloud

        settings = context.scene.mirror_scan
        arrays = point_cloud.read_cloud(point_cloud.cloud_of(context.scene), color=False)
        mirrors = scan_records.placed_mirrors(settings)
        self._views = scan_records.view_settings(settings)
        return job_operators.Task("find_subject_steps", (arrays.depth, arrays.intrinsics, mirrors, self._views))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        from ...core.errors import CaptureError
        from ..scene import point_cloud

        settings = target.mirror_scan
        points = point_cloud.cloud_of(target)
        if points is None:
            raise CaptureError(say("The points of the capture are gone; load it again"), code="not_loaded")
        put_subject(target, points, result, self._views)
        place_on_found(target, points, result.placement)
        settings.cloud_colors, settings.show_cloud = "PART", True
        if not result.floor:
            self.report({"WARNING"}, say("No floor is visible; heights are measured from the person's lowest point"))
        for warning in result.warnings:
            self.report({"WARNING"}, tell(warning))
        self.report({"INFO"}, settings.subject.message)


CLASSES = (MIRRORSCAN_OT_find_subject,)
