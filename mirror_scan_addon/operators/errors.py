"""The error that the panel keeps: dismissed by its cross, or cured by another unit of depth."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import FloatProperty

from ..background import job_operators
from ..language.texts import CONTEXT, say
from ..scene import kept_errors, scan_records


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


class MIRRORSCAN_OT_set_depth_unit(bpy.types.Operator):
    """Set the depth unit. It counts when the capture is loaded again"""

    bl_idname = "mirror_scan.set_depth_unit"
    bl_label = "Set Depth Unit"
    bl_translation_context = CONTEXT
    bl_options = {"INTERNAL", "UNDO"}

    millimetres: FloatProperty(
        name="Millimetres", description="Millimetres per unit of the depth images", default=1.0, min=0.0, max=1e6,
        options={"SKIP_SAVE"}, translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Tooltip of the button under the mouse."""
        text = say("One unit of the depth images is {size:g} mm. It counts when the capture is loaded again")
        return text.format(size=properties.millimetres)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context))

    def execute(self, context: bpy.types.Context) -> set[str]:
        context.scene.mirror_scan.reading.depth_unit_mm = self.millimetres
        job_operators.redraw(context, panels_only=True)
        return {"FINISHED"}


CLASSES = (MIRRORSCAN_OT_dismiss_error, MIRRORSCAN_OT_set_depth_unit)
