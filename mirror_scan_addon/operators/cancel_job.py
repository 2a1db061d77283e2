"""Cancel what is under way by a click, from any window; Esc does it in the window where it was begun."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy

from ..background import job_operators
from ..language.texts import CONTEXT, say
from ..scene import scan_records


class MIRRORSCAN_OT_cancel_job(bpy.types.Operator):
    """Cancel what is under way, as Esc does. Nothing is changed"""

    bl_idname = "mirror_scan.cancel_job"
    bl_label = "Cancel"
    bl_translation_context = CONTEXT
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, "" if job_operators.running(context) else say("Nothing is under way"))

    def execute(self, context: bpy.types.Context) -> set[str]:
        job_operators.ask_to_stop(context)
        return {"FINISHED"}


CLASSES = (MIRRORSCAN_OT_cancel_job,)
