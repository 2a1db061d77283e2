"""Help: the pages that are shipped with the extension, and a report of a problem for the clipboard."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import EnumProperty

from ...core.errors import OutputError
from ..background import job_operators
from ..extension_root import ADDON_FOLDER, ROOT_FOLDER
from ..language.texts import CONTEXT, say

PAGES = (
    ("blender", "In Blender", "Every step, from installing to export"),
    ("live", "Live View", "What to change before the shutter, and a burst that is taken by itself"),
    ("formats", "Capture Formats", "Which cameras' files can be opened, and what they need"),
    ("motion", "Skeleton and Motion", "Skeletons, motion files, clips and trackers"),
    ("look", "Look", "Texture, fewer triangles, printing, measurements, clothes"),
    ("how_it_works", "How It Works", "From the capture to the avatar, in pictures"),
)

WIDTH = 600  # of the dialog [px at 100 % scale]


class MIRRORSCAN_OT_help(bpy.types.Operator):
    """Open the help pages in your web browser. They came with Mirror Scan; nothing is downloaded"""

    bl_idname = "mirror_scan.help"
    bl_label = "Help"
    bl_translation_context = CONTEXT

    page: EnumProperty(
        name="Page", description="Which page to open", items=PAGES, options={"SKIP_SAVE"}, translation_context=CONTEXT
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            page = page_of(self.page)
        except OutputError as error:
            self.report({"ERROR"}, job_operators.in_words(error))
            return {"CANCELLED"}
        bpy.ops.wm.url_open(url=page.as_uri())
        self.report({"INFO"}, say("Opened in your web browser: {path}").format(path=page))
        return {"FINISHED"}


def page_of(name: str):
    """Path of a help page: of the extension's, or in a checkout of the text that it is made of.

    Raises
    ------
    OutputError
        When this copy of the add-on has no help pages.
    """
    for page in (ADDON_FOLDER / "help" / f"{name}.html", ROOT_FOLDER / "docs" / f"{name}.md"):
        if page.is_file():
            return page
    raise OutputError(say("This copy of Mirror Scan has no help pages; install the extension's zip to have them"))


class MIRRORSCAN_OT_report_problem(bpy.types.Operator):
    """Copy what helps to find the cause of a problem: versions, the last error, and the numbers of the last avatar's report. It shows all that it copies; there are no pictures, paths or names in it"""  # noqa: E501 - Blender shows it as the tooltip

    bl_idname = "mirror_scan.report_problem"
    bl_label = "Report a Problem"
    bl_translation_context = CONTEXT

    _text = ""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        from ..scene.problem_report import problem_report

        self._text = problem_report(context)
        return context.window_manager.invoke_props_dialog(
            self, width=WIDTH, title=say("Report a Problem"), confirm_text=say("Copy")
        )

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.label(text=say("This will be copied. Paste it where you write about the problem"), translate=False)
        box = layout.box().column(align=True)
        box.scale_y = 0.7
        for line in self._text.splitlines():
            box.label(text=line, translate=False)

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..scene.problem_report import problem_report

        context.window_manager.clipboard = self._text or problem_report(context)
        self.report({"INFO"}, say("Copied to the clipboard"))
        return {"FINISHED"}


CLASSES = (MIRRORSCAN_OT_help, MIRRORSCAN_OT_report_problem)
