"""Who is the person, what is floor and room."""

from __future__ import annotations

import bpy

from .. import state
from ..background import job_operators
from ..language.texts import CONTEXT, say, tell
from ..units import metres_per_unit


class MIRRORSCAN_OT_find_subject(job_operators.JobOperator, bpy.types.Operator):
    """Tell the person from floor and room, directly and in each mirror, and show it as colours on the points"""

    bl_idname = "mirror_scan.find_subject"
    bl_label = "Find Subject"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return state.allows(cls, state.editable(context) or state.no_cloud(context) or state.no_mirror(context))

    def start(self, context: bpy.types.Context) -> job_operators.Task:
        from .. import cloud

        settings = context.scene.mirror_scan
        arrays = cloud.read_cloud(cloud.cloud_of(context.scene), color=False)
        mirrors = state.placed_mirrors(settings)
        self._views = state.view_settings(settings)
        return job_operators.Task("find_subject_steps", (arrays.depth, arrays.intrinsics, mirrors, self._views))

    def finish(self, context: bpy.types.Context, target: bpy.types.Scene, result) -> None:
        from ...core.errors import CaptureError
        from .. import cloud

        settings = target.mirror_scan
        points = cloud.cloud_of(target)
        if points is None:
            raise CaptureError(say("The points of the capture are gone; load it again"))
        put_subject(target, points, result, self._views)
        cloud.place(points, result.placement, metres_per_unit(target))
        settings.cloud_colors, settings.show_cloud = "PART", True
        if not result.floor:
            self.report({"WARNING"}, say("No floor is seen; heights are counted from the person's lowest point"))
        for warning in result.warnings:
            self.report({"WARNING"}, tell(warning))
        self.report({"INFO"}, settings.subject.message)


def put_subject(target: bpy.types.Scene, points: bpy.types.Object, result, views: dict) -> None:
    """Have a scene's points tell what a search with the settings ``views`` found."""
    from .. import cloud

    settings, subject = target.mirror_scan, target.mirror_scan.subject
    cloud.set_values(points.data, seen=result.seen, view=result.view, height=result.height)
    names = [say("direct"), *(item.name for item in settings.mirrors)]
    counts = ", ".join(f"{name} {pixels:,}" for name, pixels in zip(names, result.pixels, strict=False))
    subject.message = say("Points of the person: {counts}").format(counts=counts)
    subject.problem, subject.searched_with = "", state.key_of(views)


CLASSES = (MIRRORSCAN_OT_find_subject,)
