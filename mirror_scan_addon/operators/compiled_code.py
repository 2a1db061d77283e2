"""Clear the compiled code that is kept between sessions."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy

from ..background import compiled_code, job_operators
from ..language.texts import CONTEXT, say
from ..scene import scan_records


class MIRRORSCAN_OT_clear_compiled_code(bpy.types.Operator):
    """Delete the compiled code that Mirror Scan keeps on disk. It is compiled again when it is needed next, which takes about a minute, once"""  # noqa: E501 - Blender shows it as the tooltip

    bl_idname = "mirror_scan.clear_compiled_code"
    bl_label = "Clear Compiled Code"
    bl_translation_context = CONTEXT

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = ""
        if job_operators.running(context):
            problem = say("Mirror Scan is busy; wait or press Esc")
        elif compiled_code.elsewhere():
            problem = say(
                "It is in the folder that the environment variable NUMBA_CACHE_DIR names; clear that folder yourself"
            )
        elif not compiled_code.size()[1]:
            problem = say("Nothing is kept yet")
        return scan_records.allows(cls, problem)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return context.window_manager.invoke_confirm(
            self, event, title=say("Clear the compiled code?"), confirm_text=say("Clear"),
            message=say("It is compiled again when it is needed next, which takes about a minute"),
        )  # fmt: skip

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            freed = compiled_code.clear()
        except job_operators.REPORTED as error:
            self.report({"ERROR"}, job_operators.in_words(error))
            return {"CANCELLED"}
        self.report({"INFO"}, say("{size:.0f} MB freed").format(size=freed / 1e6))
        return {"FINISHED"}


CLASSES = (MIRRORSCAN_OT_clear_compiled_code,)
