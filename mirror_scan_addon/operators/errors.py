"""The error that the panel keeps: dismissed by its cross."""

from __future__ import annotations

import bpy

from ..background import job_operators
from ..language.texts import CONTEXT
from ..scene import kept_errors


class MIRRORSCAN_OT_dismiss_error(bpy.types.Operator):
    """Remove this message from the panel"""

    bl_idname = "mirror_scan.dismiss_error"
    bl_label = "Dismiss"
    bl_translation_context = CONTEXT
    bl_options = {"INTERNAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        kept_errors.forget(context)
        job_operators.redraw(context, panels_only=True)
        return {"FINISHED"}


CLASSES = (MIRRORSCAN_OT_dismiss_error,)
