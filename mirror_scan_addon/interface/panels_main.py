"""The panel that is always open: one press from capture to avatar, what went wrong, the next steps, and the export."""

from __future__ import annotations

import bpy

from ..background import getting_ready, job_operators
from ..language.texts import CONTEXT, say
from ..scene import live_rig, room, scan_records
from ..scene.blender_files import missing_library
from . import panel_states
from .menus import draw_header_buttons
from .panel_errors import error_box
from .panel_parts import NARROW, Panel, icon_if_wide, progress, sentence, width


class MIRRORSCAN_PT_main(Panel, bpy.types.Panel):
    bl_label = "Mirror Scan"
    bl_order = 0

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        draw_header_buttons(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        getting_ready.tab_shown()
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        busy = job_operators.running(context)
        if context.window_manager.mirror_scan.picking:
            _picking(layout)
            return
        if not busy:
            error_box(layout, context)
            _ready_line(layout, context)
        _one_press(layout, context, busy)
        progress(layout, context)
        _build(layout, context)
        if not busy:
            _room(layout, context)
        if panel_states.shown_avatar(context) is not None:
            _next_steps(layout, context)
        _export(layout)


def _ready_line(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    text = context.window_manager.mirror_scan.getting_ready
    if text:
        row = layout.row()
        sentence(row.column(), text, "SORTTIME", 2)
        row.operator("mirror_scan.stop_getting_ready", text="", icon="X", emboss=False)


def _one_press(layout: bpy.types.UILayout, context: bpy.types.Context, busy: bool) -> None:
    settings = context.scene.mirror_scan
    manager = context.window_manager.mirror_scan
    row = layout.row()
    row.scale_y = 1.6
    button = row.operator("mirror_scan.scan_to_avatar", icon="OUTLINER_OB_ARMATURE", text_ctxt=CONTEXT)
    if settings.capture_path and panel_states.cloud_of(context) is None:
        button.filepath = settings.capture_path  # one that was typed
    if panel_states.cloud_of(context) is None and not busy and not manager.error:
        sentence(layout, say("Choose a capture, or drop one of its files into the viewport"), "INFO")
        layout.operator("mirror_scan.sample_capture", icon=icon_if_wide("OUTLINER_OB_POINTCLOUD"), text_ctxt=CONTEXT)


def _build(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    settings = context.scene.mirror_scan
    layout.operator("mirror_scan.build_avatar", icon=icon_if_wide("MOD_REMESH"), text_ctxt=CONTEXT)
    bad = [item.name for item in settings.mirrors if scan_records.quality_of(item) in ("BAD", "NONE")]
    if bad:
        sentence(layout, say("Check these mirrors first: {names}").format(names=", ".join(bad)), "ERROR")


def _room(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Buttons that hide what is in the way, and show what was hidden."""
    row = layout.row(align=True)
    count = panel_states.looked_up("in the way", context, lambda: _count_in_the_way(context))
    if count:
        text = say("Hide 1 Object in the Way") if count == 1 else say("Hide {count} Objects in the Way")
        row.operator("mirror_scan.make_room", text=text.format(count=count), icon="HIDE_ON", translate=False)
    elif hidden := panel_states.looked_up("hidden", context, lambda: len(room.hidden(context.scene))):
        text = say("Show 1 Hidden Object") if hidden == 1 else say("Show {count} Hidden Objects")
        button = row.operator("mirror_scan.make_room", text=text.format(count=hidden), icon="HIDE_OFF", translate=False)
        button.show = True
    if panel_states.cloud_of(context) is not None and panel_states.shown_avatar(context) is not None:
        shown = room.setup_shown(context.scene)
        text = "Hide Scan Setup" if shown else "Show Scan Setup"
        row = layout.row(align=True)
        button = row.operator("mirror_scan.show_setup", text=text, icon="OUTLINER_OB_POINTCLOUD", text_ctxt=CONTEXT)
        button.show = not shown


def _count_in_the_way(context: bpy.types.Context) -> int:
    """How many objects hide the person."""
    person = panel_states.shown_avatar(context) or panel_states.cloud_of(context) or live_rig.person_of(context.scene)
    return 0 if person is None else len(room.in_the_way(context.scene, context.view_layer, person))


def _next_steps(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """What is made of an avatar, as buttons."""
    look = context.scene.mirror_scan.look
    flow = layout.grid_flow(row_major=True, columns=3 if width() >= NARROW else 2, even_columns=True, align=True)
    button = flow.operator("mirror_scan.texture", text="Texture", text_ctxt=CONTEXT)
    button.size, button.remove_light = look.texture_size, look.remove_light
    flow.operator("mirror_scan.add_skeleton", text="Skeleton", text_ctxt=CONTEXT)
    if scan_records.editable(context) or scan_records.no_skeleton(context):
        # Blender greys out what a menu holds, but not the menu; a plain button says why it is disabled
        flow.operator("mirror_scan.apply_motion", text="Motion", text_ctxt=CONTEXT)
        flow.operator("mirror_scan.dress", text="Dress", text_ctxt=CONTEXT)
    else:
        flow.operator_menu_enum("mirror_scan.apply_motion", "clip", text="Motion", text_ctxt=CONTEXT)
        dress = flow.operator_menu_enum("mirror_scan.dress", "kind", text="Dress", text_ctxt=CONTEXT)
        dress.ease, dress.tight = look.ease, look.tight
    flow.operator("mirror_scan.measure", text="Measure", text_ctxt=CONTEXT)
    flow.operator("mirror_scan.reduce", text="Reduce", text_ctxt=CONTEXT).triangles = look.triangles


def _export(layout: bpy.types.UILayout) -> None:
    column = layout.column(align=True)
    column.label(text="Export", text_ctxt=CONTEXT)
    flow = column.grid_flow(row_major=True, columns=4, even_columns=True, align=True)
    for kind in ("GLB", "GLTF", "FBX", "USDC", "OBJ", "PLY", "ABC", "BLEND", "STL", "3MF", "VRM"):
        cell = flow.row(align=True)
        cell.enabled = not missing_library(f".{kind}")
        cell.operator("mirror_scan.export_avatar", text=kind, translate=False).format = kind


def _picking(layout: bpy.types.UILayout) -> None:
    """What the mouse and the keys do while frames are clicked; nothing else is offered then."""
    sentence(layout, say("Click the frame of each mirror, once"), "EYEDROPPER")
    column = layout.box().column(align=True)
    column.scale_y = 0.8
    for keys, meaning in (
        (say("Click"), say("pick a point, or drag one")),
        (say("Right click"), say("remove a point")),
        (say("Backspace"), say("remove the last point")),
        (say("Tab"), say("next mirror")),
        (say("Enter"), say("accept")),
        (say("Esc"), say("cancel")),
    ):
        row = column.split(factor=0.36)
        row.label(text=keys, translate=False)
        row.label(text=meaning, translate=False)
    row = layout.row()
    row.scale_y = 1.6
    row.operator("mirror_scan.finish_picking", icon="CHECKMARK", text_ctxt=CONTEXT)
