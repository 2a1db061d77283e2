"""Our entries in Blender's own menus; Blender's search (F3) finds them there."""

from __future__ import annotations

import bpy

from ..language.texts import CONTEXT


def _draw_import(self, context: bpy.types.Context) -> None:
    self.layout.operator_context = "INVOKE_DEFAULT"
    self.layout.operator("mirror_scan.load_capture", text="Mirror Scan Capture", text_ctxt=CONTEXT)
    self.layout.operator("mirror_scan.import_sequence", text="Mirror Scan Sequence", text_ctxt=CONTEXT)


def _draw_export(self, context: bpy.types.Context) -> None:
    self.layout.operator_context = "INVOKE_DEFAULT"
    self.layout.operator("mirror_scan.export_avatar", text="Mirror Scan Avatar", text_ctxt=CONTEXT)


def _draw_add(self, context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.operator_context = "INVOKE_DEFAULT"
    self.layout.operator("mirror_scan.add_rig", text="Mirror Scan Rig", icon="OUTLINER_OB_CAMERA", text_ctxt=CONTEXT)
    self.layout.operator(
        "mirror_scan.sample_capture", text="Mirror Scan Sample", icon="OUTLINER_OB_POINTCLOUD", text_ctxt=CONTEXT
    )


def _draw_help(self, context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.operator_context = "INVOKE_DEFAULT"
    self.layout.operator("mirror_scan.help", text="Mirror Scan Help", icon="HELP", text_ctxt=CONTEXT)
    self.layout.operator("mirror_scan.report_problem", text="Report a Mirror Scan Problem", text_ctxt=CONTEXT)


def draw_header_buttons(layout: bpy.types.UILayout) -> None:
    """Help and the report of a problem, for the right end of a panel's header."""
    row = layout.row(align=True)
    row.operator_context = "INVOKE_DEFAULT"
    row.emboss = "NONE"
    row.operator("mirror_scan.help", text="", icon="HELP")
    row.operator("mirror_scan.report_problem", text="", icon="COPYDOWN")


MENUS = (
    ("TOPBAR_MT_file_import", _draw_import),
    ("TOPBAR_MT_file_export", _draw_export),
    ("VIEW3D_MT_add", _draw_add),
    ("TOPBAR_MT_help", _draw_help),
)


def register() -> None:
    for name, draw in MENUS:
        getattr(bpy.types, name).append(draw)


def unregister() -> None:
    for name, draw in MENUS:
        getattr(bpy.types, name).remove(draw)
