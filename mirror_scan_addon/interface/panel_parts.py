"""What every panel is made of: settings beside or above their names, sentences that wrap, tables, the bar of a job."""

from __future__ import annotations

import bpy

from ..background import job_operators
from ..language.texts import CONTEXT, say, wrapped

NARROW = 250  # width of the sidebar below which labels are above their fields, not beside them [px at 100 % scale]
MARGIN, ICON = 64, 20  # width of tabs and panel borders, and of an icon [px at 100 % scale]
ICONS = {"GOOD": "CHECKMARK", "USABLE": "ERROR", "BAD": "CANCEL", "NONE": "DOT", "OK": "CHECKMARK", "WARN": "ERROR",
         "": "BLANK1"}  # fmt: skip


class Panel:
    """In the tab Mirror Scan of the sidebar."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Mirror Scan"
    bl_translation_context = CONTEXT


def width() -> float:
    """Width of the sidebar that is drawn [px at 100 % scale]; elsewhere the default width of a sidebar."""
    region = bpy.context.region
    if region is None or region.type != "UI":
        return 280.0
    return region.width / bpy.context.preferences.system.ui_scale


def icon_if_wide(name: str) -> str:
    """An icon for a button in a row of several, if there is room for it."""
    return name if width() >= NARROW else "NONE"


def sentence(layout: bpy.types.UILayout, text: str, icon: str = "NONE", beside: int = 0) -> None:
    """A sentence on as many lines as it needs in the sidebar's width; Blender's labels do not wrap.

    ``beside``: how many icons stand at its right.
    """
    import blf

    style = bpy.context.preferences.ui_styles[0].widget
    blf.size(0, style.points)
    room = width() - MARGIN - ICON * ((icon != "NONE") + beside)
    column = layout.column(align=True)
    column.scale_y = 0.8
    below = "BLANK1" if icon != "NONE" else "NONE"
    for number, part in enumerate(wrapped(text, room, lambda part: blf.dimensions(0, part)[0])):
        column.label(text=part, icon=below if number else icon, translate=False)


def fields(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """A column for settings; see :func:`field`."""
    column = layout.column()
    column.use_property_split = width() >= NARROW
    column.use_property_decorate = False
    return column


def field(column: bpy.types.UILayout, owner: bpy.types.bpy_struct, name: str, text: str = "") -> None:
    """A setting with its name beside it, or above it if the sidebar is too narrow for both."""
    known = owner.bl_rna.properties[name]
    text = text or known.name
    if width() >= NARROW or known.type == "BOOLEAN":
        column.prop(owner, name, text=text, text_ctxt=CONTEXT)
        return
    column = column.column(align=True)
    column.label(text=text, text_ctxt=CONTEXT)
    column.prop(owner, name, text="")


def table(layout: bpy.types.UILayout, lines: list[tuple[str, str, str]]) -> None:
    """Label, value and a mark for each line; the value below the label if the sidebar is too narrow for both."""
    import blf

    blf.size(0, bpy.context.preferences.ui_styles[0].widget.points)
    room = width() - MARGIN
    column = layout.column(align=True)
    for label, value, mark in lines:
        wide = blf.dimensions(0, value)[0] + (ICON if mark else 0)
        if wide > 0.58 * room or blf.dimensions(0, label)[0] > 0.42 * room:
            sentence(column, label)
            sentence(column, value, ICONS[mark] if mark else "BLANK1")
            continue
        row = column.split(factor=0.42)
        row.label(text=label, translate=False)
        row.label(text=value, icon=ICONS[mark] if mark else "NONE", translate=False)


def progress(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The bar of the job that runs, with the time it still takes; nothing when none does."""
    shown = context.window_manager.mirror_scan
    if not shown.operator or shown.picking or not job_operators.running(context):
        return
    column = layout.column(align=True)
    row = column.row(align=True)
    row.progress(factor=shown.fraction, text=f"{shown.fraction:.0%}", translate=False)
    row.operator("mirror_scan.cancel_job", text="", icon="X")
    sentence(column, say(shown.message) or say("Starting"), "SORTTIME")
    left = say("{left}; press Esc to cancel").format(left=shown.left) if shown.left else say("Press Esc to cancel")
    sentence(column, left, "BLANK1")


def on_one_line(layout: bpy.types.UILayout, text: str) -> None:
    """What the header of a folded panel says of it, at its right end; nothing if the sidebar is too narrow."""
    import blf

    blf.size(0, bpy.context.preferences.ui_styles[0].widget.points)
    room = 0.62 * (width() - MARGIN)
    if width() < NARROW or not text:
        return
    if blf.dimensions(0, text)[0] > room:
        while text and blf.dimensions(0, f"{text}…")[0] > room:
            text = text[:-1]
        text = f"{text}…"
    row = layout.row()
    row.active = False
    row.label(text=text, translate=False)
