"""Hide what is in the person's way, and show or hide what belongs to the scan."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import BoolProperty

from ..language.texts import CONTEXT, say
from ..scene import room, scan_records


class MIRRORSCAN_OT_make_room(bpy.types.Operator):
    """Hide the objects that stand where the person stands"""

    bl_idname = "mirror_scan.make_room"
    bl_label = "Hide Objects in the Way"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    show: BoolProperty(
        name="Show Again", description="Show the objects that were hidden for the person", options={"SKIP_SAVE"},
        translation_context=CONTEXT,
    )  # fmt: skip

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        """Tooltip of the button under the mouse."""
        return say("Show the objects that were hidden for the person") if properties.show else ""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scan_records.allows(cls, scan_records.editable(context))

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene, layer = context.scene, context.view_layer
        if self.show:
            room.show(room.hidden(scene), layer)
            return {"FINISHED"}
        person = scan_records.person_of(context)
        if person is None:
            self.report({"ERROR"}, say("Load a capture first"))
            return {"CANCELLED"}
        count = room.hide(room.in_the_way(scene, layer, person), layer)
        self.report({"INFO"}, say("Objects hidden: {count}").format(count=count))
        return {"FINISHED"}


class MIRRORSCAN_OT_show_setup(bpy.types.Operator):
    """Show the points of the capture and the mirrors, or hide them"""

    bl_idname = "mirror_scan.show_setup"
    bl_label = "Show Scan Setup"
    bl_translation_context = CONTEXT
    bl_options = {"REGISTER", "UNDO"}

    show: BoolProperty(
        name="Show", description="Show what belongs to the scan; else hide it", default=True, options={"SKIP_SAVE"},
        translation_context=CONTEXT,
    )  # fmt: skip

    poll = MIRRORSCAN_OT_make_room.poll

    def execute(self, context: bpy.types.Context) -> set[str]:
        room.show_setup(context.scene, context.view_layer, self.show)
        return {"FINISHED"}


CLASSES = (MIRRORSCAN_OT_make_room, MIRRORSCAN_OT_show_setup)
