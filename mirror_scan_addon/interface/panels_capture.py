"""Panels of what was captured: the capture, its mirrors, and who stands between them."""

from __future__ import annotations

import bpy

from ..background import job_operators
from ..language.texts import CONTEXT, as_sentence, say, tell
from ..scene import live_subject, scan_records
from . import panel_states
from .panel_parts import ICON, ICONS, MARGIN, NARROW, Panel, field, fields, icon_if_wide, sentence, table, width
from .panel_states import Step


class MIRRORSCAN_PT_capture(Panel, Step, bpy.types.Panel):
    bl_label = "Capture"
    state = staticmethod(panel_states.capture)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings = context.scene.mirror_scan
        row = layout.row(align=True)
        row.operator_context = "INVOKE_DEFAULT"
        row.operator("mirror_scan.load_capture", icon=icon_if_wide("FILE_FOLDER"), text_ctxt=CONTEXT)
        if settings.capture_path:
            again = row.operator("mirror_scan.load_capture", text="", icon="FILE_REFRESH")
            again.filepath = settings.capture_path
        row.operator("mirror_scan.record", text="", icon="RADIOBUT_ON")
        row = layout.row(align=True)
        row.operator_context = "INVOKE_DEFAULT"
        icon = icon_if_wide("CAMERA_DATA")
        row.operator_menu_enum("mirror_scan.live_view", "source", text="Live View", text_ctxt=CONTEXT, icon=icon)
        row.operator("mirror_scan.live_view", text="", icon="PLAY").source = "playback"
        column = fields(layout)
        column.prop(settings, "capture_path", text="Path", text_ctxt=CONTEXT, placeholder=say("Folder or file"))
        field(column, settings, "frames", "Frames (0 = all)")
        cloud = panel_states.cloud_of(context)
        if cloud is None:
            sentence(layout, say("Load a capture, or drop one of its files here"), "INFO")
            return
        _draw_pictures(layout, settings)
        _draw_facts(layout, cloud)
        column = fields(layout)
        column.prop(settings, "show_cloud")
        column = column.column()
        column.active = settings.show_cloud
        field(column, settings, "cloud_colors")
        field(column, settings, "point_size")


def _draw_pictures(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    row = layout.row(align=True)
    for image in (settings.color_image, settings.depth_image):
        if image is not None and image.preview is not None:
            # so large that two fit side by side; Blender leaves the height of a larger one empty
            scale = min(6.0, (width() - MARGIN) / 2 / ICON)
            row.template_icon(icon_value=image.preview.icon_id, scale=scale)


def _draw_facts(layout: bpy.types.UILayout, cloud: bpy.types.Object) -> None:
    from ..scene.point_cloud import cloud_info

    try:
        info = cloud_info(cloud)
    except job_operators.REPORTED as error:
        sentence(layout, str(error), "ERROR")
        return
    width, height = info.get("size", (0, 0))
    frames = info.get("frames", 0)
    sensor = str(info.get("sensor", "unknown"))
    lines = [
        (say("Format"), str(info.get("format", "")), ""),
        (say("Camera"), say("unknown") if sensor == "unknown" else sensor, ""),
        (say("Size"), f"{width} × {height} px", ""),
        (say("Frames"), str(frames), ""),
        (say("Points"), f"{len(cloud.data.vertices):,}", ""),
    ]
    table(layout, lines)


class MIRRORSCAN_PT_reading(Panel, bpy.types.Panel):
    bl_label = "Load Options"
    bl_parent_id = "MIRRORSCAN_PT_capture"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        reading = context.scene.mirror_scan.reading
        column = fields(self.layout)
        for name in scan_records.READING:
            field(column, reading, name)
        text = say("For what the capture's files do not say, or say wrongly. After a change, load the capture again")
        sentence(self.layout, text, "INFO")


class MIRRORSCAN_UL_mirrors(bpy.types.UIList):
    bl_idname = "MIRRORSCAN_UL_mirrors"

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flag=0) -> None:
        quality = scan_records.quality_of(item)
        # Side by side if there is room for both, else only the name: the word is also shown below the list.
        row = layout.split(factor=0.62) if width() >= NARROW else layout
        row.prop(item, "name", text="", emboss=False, icon=ICONS[quality])
        if row is not layout:
            row = row.row()
            row.alignment = "RIGHT"
            word = scan_records.quality_word(item)
            row.operator("mirror_scan.select_mirror", text=word, emboss=False, translate=False).index = index


class MIRRORSCAN_PT_mirrors(Panel, Step, bpy.types.Panel):
    bl_label = "Mirrors"
    state = staticmethod(panel_states.mirrors)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings = context.scene.mirror_scan
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("mirror_scan.find_mirrors", icon="VIEWZOOM", text_ctxt=CONTEXT)
        row = layout.row(align=True)
        label = "Click the Frames" if width() >= NARROW else "Click Frames"
        row.operator("mirror_scan.pick_mirror_points", text=label, icon=icon_if_wide("EYEDROPPER"), text_ctxt=CONTEXT)
        row.operator("mirror_scan.pick_mirror_points", text="", icon="ADD").add = True
        row = layout.row(align=True)
        row.operator("mirror_scan.use_rig", icon=icon_if_wide("FILE_FOLDER"), text_ctxt=CONTEXT)
        row.operator("mirror_scan.calibrate_rig", text="", icon="FILE_TICK")
        if not settings.mirrors:
            sentence(layout, say("No mirrors yet. Find them, or click points on their frames"), "INFO")
            return
        row = layout.row()
        row.template_list("MIRRORSCAN_UL_mirrors", "", settings, "mirrors", settings, "mirror_index", rows=3)
        column = row.column(align=True)
        column.operator("mirror_scan.remove_mirror", text="", icon="REMOVE")
        column.operator("mirror_scan.clear_mirrors", text="", icon="X")
        column.separator()
        column.operator("mirror_scan.save_mirrors", text="", icon="FILE_TICK")
        item = settings.mirrors[min(settings.mirror_index, len(settings.mirrors) - 1)]
        _draw_mirror(layout, item)
        column = fields(layout)
        column.prop(settings, "show_mirrors")
        column.prop(settings, "fold")
        field(column, settings.quality, "glass_offset")


class MIRRORSCAN_PT_optics(Panel, bpy.types.Panel):
    bl_label = "Glass and Light"
    bl_parent_id = "MIRRORSCAN_PT_mirrors"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        settings = context.scene.mirror_scan
        column = fields(self.layout)
        for name in ("glass_thickness", "bowed", "two_ways"):
            field(column, settings.quality, name)
        problem = scan_records.no_two_ways(settings)
        column = fields(self.layout)
        column.enabled = not problem
        field(column, settings.quality, "frequencies")
        if problem:
            sentence(self.layout, problem, "INFO")


def _draw_mirror(layout: bpy.types.UILayout, item: bpy.types.PropertyGroup) -> None:
    quality = scan_records.quality_of(item)
    plane = scan_records.plane_of(item)
    if item.message:
        sentence(layout, tell(item.message), "CANCEL")
    elif plane is None:
        sentence(
            layout,
            say("Click its frame, not the glass; if one click is not enough, 8 on all four sides are best"),
            "INFO",
        )
    else:
        said = as_sentence(tell(item.reason)) if item.reason else scan_records.quality_word(item).capitalize()
        sentence(layout, said, ICONS[quality])
        if not plane.get("refined", True):
            sentence(layout, say("The frame was not found around the points; pick more points"), "ERROR")


class MIRRORSCAN_PT_subject(Panel, Step, bpy.types.Panel):
    bl_label = "Subject"
    state = staticmethod(panel_states.subject)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings = context.scene.mirror_scan
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("mirror_scan.find_subject", icon="OUTLINER_OB_ARMATURE", text_ctxt=CONTEXT)
        row = layout.row(align=True)
        row.operator("mirror_scan.pick_subject", icon=icon_if_wide("EYEDROPPER"), text_ctxt=CONTEXT)
        if settings.subject.clicked:
            row.prop(settings.subject, "clicked", text="", icon="X", invert_checkbox=True)
        column = fields(layout)
        for name in ("depth_limit", "floor_clearance", "max_height", "reach", "object"):
            field(column, settings.subject, name)
        subject = settings.subject
        if live_subject.searching(context.scene) and not job_operators.running(context):
            sentence(layout, say("Searching for the person"), "SORTTIME")
        elif subject.stale:
            sentence(layout, say("The settings have changed; press Find Subject again"), "FILE_REFRESH")
        elif subject.problem:
            sentence(layout, as_sentence(tell(subject.problem)), "ERROR")
        elif subject.message:
            sentence(layout, subject.message, "CHECKMARK")
            sentence(layout, say("Person orange, floor green, too far red, room grey"))
        else:
            sentence(
                layout, say("Optional: Build Avatar does this too. Use it if furniture becomes part of the avatar")
            )


CLASSES = (
    MIRRORSCAN_UL_mirrors,
    MIRRORSCAN_PT_capture,
    MIRRORSCAN_PT_reading,
    MIRRORSCAN_PT_mirrors,
    MIRRORSCAN_PT_optics,
    MIRRORSCAN_PT_subject,
)
