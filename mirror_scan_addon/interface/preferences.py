"""The add-on's preferences: what operators begin with, the compiled code that is kept, help."""

# No “from __future__ import annotations”: Blender would have to compile each property's annotation when it starts.
import bpy
from bpy.props import EnumProperty, StringProperty

from ..background import compiled_code
from ..extension_root import ROOT_PACKAGE
from ..language.texts import CONTEXT, say
from ..scene.preferred import DEFAULTS
from ..scene.properties import SENSORS, TEXTURE_SIZES


class MIRRORSCAN_AP_preferences(bpy.types.AddonPreferences):
    bl_idname = ROOT_PACKAGE

    sensor: EnumProperty(
        name="Depth Camera", description="The depth camera you have. New virtual rigs and scans begin with it",
        items=SENSORS, default=DEFAULTS["sensor"], translation_context=CONTEXT,
    )  # fmt: skip
    on_drop: EnumProperty(
        name="Dropped Captures", description="What happens when a capture is dropped into a 3D viewport",
        items=(
            ("ASK", "Ask", "Choose each time"),
            ("AVATAR", "Make Avatar", "Load the capture and build an avatar of it"),
            ("LOOK", "Only Look", "Load the capture and show its points"),
        ),
        default=DEFAULTS["on_drop"], translation_context=CONTEXT,
    )  # fmt: skip
    texture_size: EnumProperty(
        name="Texture Size", description="Width and height of textures in scenes where nothing else is chosen",
        items=TEXTURE_SIZES, default=DEFAULTS["texture_size"], translation_context=CONTEXT,
    )  # fmt: skip
    export_folder: StringProperty(
        name="Export Folder",
        description="Where the file browser begins when an avatar is exported. Leave empty for the folder of the "
        ".blend file",
        subtype="DIR_PATH", default=DEFAULTS["export_folder"], translation_context=CONTEXT,
    )  # fmt: skip

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        column = layout.column()
        column.use_property_split = True
        for name in ("sensor", "on_drop", "texture_size", "export_folder"):
            column.prop(self, name)
        column.separator()
        row = column.split(factor=0.4)
        row.alignment = "RIGHT"
        row.label(text="Compiled Code", text_ctxt=CONTEXT)
        row = row.row()
        row.label(text=_size_in_words(), translate=False)
        row.operator("mirror_scan.clear_compiled_code", text="Clear", text_ctxt=CONTEXT)
        row = layout.row()
        row.operator("mirror_scan.help", icon="HELP", text_ctxt=CONTEXT)
        row.operator("mirror_scan.report_problem", icon="COPYDOWN", text_ctxt=CONTEXT)
        row.operator("mirror_scan.sample_capture", icon="OUTLINER_OB_POINTCLOUD", text_ctxt=CONTEXT)


def _size_in_words() -> str:
    if compiled_code.elsewhere():
        return say("in a folder of your own (NUMBA_CACHE_DIR)")
    size, count = compiled_code.size()
    if not count:
        return say("none yet")
    return say("{size:.0f} MB on disk").format(size=max(1.0, size / 1e6))


register, unregister = bpy.utils.register_classes_factory((MIRRORSCAN_AP_preferences,))
