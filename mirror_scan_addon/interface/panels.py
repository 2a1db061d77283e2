"""The “Mirror Scan” tab of the 3D viewport's sidebar: the steps of the work from top to bottom.

The header of each step shows whether it is done, the panel what is missing; the tooltip of a disabled button says why
it is disabled (``poll`` messages).
"""

from __future__ import annotations

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from ..background import job_operators
from ..language.texts import CONTEXT, say, tell
from ..scene import live_subject, report_text, scan_records
from ..scene.avatar_objects import shown_mode
from ..scene.properties import QUALITY_KEPT
from ..scene.scan_records import armature_of, has_controls, no_mesh

NARROW = 250  # width of the sidebar below which labels are above their fields, not beside them [px at 100 % scale]
MARGIN, ICON = 64, 20  # width of tabs and panel borders, and of an icon [px at 100 % scale]
ICONS = {"GOOD": "CHECKMARK", "USABLE": "ERROR", "BAD": "CANCEL", "NONE": "DOT", "OK": "CHECKMARK", "WARN": "ERROR",
         "": "BLANK1"}  # fmt: skip


class _Panel:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Mirror Scan"
    bl_translation_context = CONTEXT


def _width() -> float:
    """Width of the sidebar that is drawn [px at 100 % scale]; elsewhere the default width of a sidebar."""
    region = bpy.context.region
    if region is None or region.type != "UI":
        return 280.0
    return region.width / bpy.context.preferences.system.ui_scale


def _icon(name: str) -> str:
    """An icon for a button in a row of several, if there is room for it."""
    return name if _width() >= NARROW else "NONE"


def _text(layout: bpy.types.UILayout, text: str, icon: str = "NONE") -> None:
    """A sentence on as many lines as it needs in the sidebar's width; Blender's labels do not wrap."""
    import blf

    style = bpy.context.preferences.ui_styles[0].widget
    blf.size(0, style.points)
    room = _width() - MARGIN - (ICON if icon != "NONE" else 0)
    column = layout.column(align=True)
    column.scale_y = 0.8
    line, lines = "", []
    for word in text.split():
        longer = f"{line} {word}".strip()
        if line and blf.dimensions(0, longer)[0] > room:
            lines.append(line)
            line = word
        else:
            line = longer
    below = "BLANK1" if icon != "NONE" else "NONE"
    for number, part in enumerate([*lines, line]):
        column.label(text=part, icon=below if number else icon, translate=False)


def _fields(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """A column for settings; see :func:`_field`."""
    column = layout.column()
    column.use_property_split = _width() >= NARROW
    column.use_property_decorate = False
    return column


def _field(column: bpy.types.UILayout, owner: bpy.types.bpy_struct, name: str, text: str = "") -> None:
    """A setting with its name beside it, or above it if the sidebar is too narrow for both."""
    known = owner.bl_rna.properties[name]
    text = text or known.name
    if _width() >= NARROW or known.type == "BOOLEAN":
        column.prop(owner, name, text=text, text_ctxt=CONTEXT)
        return
    column = column.column(align=True)
    column.label(text=text, text_ctxt=CONTEXT)
    column.prop(owner, name, text="")


def _table(layout: bpy.types.UILayout, lines: list[tuple[str, str, str]]) -> None:
    """Label, value and a mark for each line; the value below the label if the sidebar is too narrow for both."""
    import blf

    blf.size(0, bpy.context.preferences.ui_styles[0].widget.points)
    room = _width() - MARGIN
    column = layout.column(align=True)
    for label, value, mark in lines:
        wide = blf.dimensions(0, value)[0] + (ICON if mark else 0)
        if wide > 0.58 * room or blf.dimensions(0, label)[0] > 0.42 * room:
            column.label(text=label, translate=False)
            _text(column, value, ICONS[mark] if mark else "BLANK1")
            continue
        row = column.split(factor=0.42)
        row.label(text=label, translate=False)
        row.label(text=value, icon=ICONS[mark] if mark else "NONE", translate=False)


def _draw_step_mark(layout: bpy.types.UILayout, done: bool) -> None:
    layout.label(text="", icon="CHECKMARK" if done else "DOT")


def _cloud(context: bpy.types.Context) -> bpy.types.Object | None:
    target = context.scene.mirror_scan.cloud
    return target if target is not None and target.name in context.scene.objects else None


class MIRRORSCAN_PT_capture(_Panel, bpy.types.Panel):
    bl_label = "Capture"

    def draw_header(self, context: bpy.types.Context) -> None:
        _draw_step_mark(self.layout, _cloud(context) is not None)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings = context.scene.mirror_scan
        row = layout.row(align=True)
        row.operator_context = "INVOKE_DEFAULT"
        row.operator("mirror_scan.load_capture", icon=_icon("FILE_FOLDER"), text_ctxt=CONTEXT)
        if settings.capture_path:
            again = row.operator("mirror_scan.load_capture", text="", icon="FILE_REFRESH")
            again.filepath = settings.capture_path
        row.operator("mirror_scan.record", text="", icon="RADIOBUT_ON")
        _draw_progress(layout, context, "mirror_scan.load_capture", "mirror_scan.record")
        column = _fields(layout)
        column.prop(settings, "capture_path", text="Path", text_ctxt=CONTEXT, placeholder=say("Folder or file"))
        _field(column, settings, "frames", "Frames (0 = all)")
        cloud = _cloud(context)
        if cloud is None:
            _text(layout, say("Load a capture, or drop one of its files here"), "INFO")
            return
        _draw_pictures(layout, settings)
        _draw_facts(layout, cloud)
        column = _fields(layout)
        column.prop(settings, "show_cloud")
        column = column.column()
        column.active = settings.show_cloud
        _field(column, settings, "cloud_colors")
        _field(column, settings, "point_size")


def _draw_pictures(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    row = layout.row(align=True)
    for image in (settings.color_image, settings.depth_image):
        if image is not None and image.preview is not None:
            # so large that two fit side by side; Blender leaves the height of a larger one empty
            scale = min(6.0, (_width() - MARGIN) / 2 / ICON)
            row.template_icon(icon_value=image.preview.icon_id, scale=scale)


def _draw_facts(layout: bpy.types.UILayout, cloud: bpy.types.Object) -> None:
    from ..scene.point_cloud import cloud_info

    try:
        info = cloud_info(cloud)
    except job_operators.REPORTED as error:
        _text(layout, str(error), "ERROR")
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
    _table(layout, lines)


def _draw_progress(layout: bpy.types.UILayout, context: bpy.types.Context, *operators: str) -> None:
    """Progress of the running job, below the button that started it; nothing for the jobs of other operators."""
    progress = context.window_manager.mirror_scan
    if progress.operator not in operators or progress.picking or not job_operators.running(context):
        return
    column = layout.column(align=True)
    column.progress(factor=progress.fraction, text=f"{progress.fraction:.0%}", translate=False)
    _text(column, say(progress.message), "SORTTIME")
    _text(column, say("Press Esc to cancel"), "BLANK1")


class MIRRORSCAN_PT_reading(_Panel, bpy.types.Panel):
    bl_label = "Load Options"
    bl_parent_id = "MIRRORSCAN_PT_capture"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        reading = context.scene.mirror_scan.reading
        column = _fields(self.layout)
        for name in scan_records.READING:
            _field(column, reading, name)
        text = say("For what the capture's files lack, or have wrong. Load the capture again after a change")
        _text(self.layout, text, "INFO")


class MIRRORSCAN_UL_mirrors(bpy.types.UIList):
    bl_idname = "MIRRORSCAN_UL_mirrors"

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flag=0) -> None:
        quality = scan_records.quality_of(item)
        if quality == "NONE":
            figure = say("{count} picked").format(count=len(item.picks))
        elif item.message:
            figure = say("not placed")
        elif item.source == "given":
            figure = say("given")
        else:
            figure = f"{item.residual_mm:.1f} mm"
        # Side by side if there is room for both, else only the name: the figure is also shown below the list.
        row = layout.split(factor=0.62) if _width() >= NARROW else layout
        row.prop(item, "name", text="", emboss=False, icon=ICONS[quality])
        if row is not layout:
            row = row.row()
            row.alignment = "RIGHT"
            row.label(text=figure, translate=False)


class MIRRORSCAN_PT_mirrors(_Panel, bpy.types.Panel):
    bl_label = "Mirrors"

    def draw_header(self, context: bpy.types.Context) -> None:
        mirrors = context.scene.mirror_scan.mirrors
        _draw_step_mark(
            self.layout, bool(mirrors) and all(scan_records.quality_of(item) in ("GOOD", "USABLE") for item in mirrors)
        )

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings = context.scene.mirror_scan
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("mirror_scan.find_mirrors", icon="VIEWZOOM", text_ctxt=CONTEXT)
        _draw_progress(layout, context, "mirror_scan.find_mirrors")
        row = layout.row(align=True)
        label = "Pick Mirror Points" if _width() >= NARROW else "Pick Points"
        row.operator("mirror_scan.pick_mirror_points", text=label, icon=_icon("EYEDROPPER"), text_ctxt=CONTEXT)
        row.operator("mirror_scan.pick_mirror_points", text="", icon="ADD").add = True
        row = layout.row(align=True)
        row.operator("mirror_scan.use_rig", icon=_icon("FILE_FOLDER"), text_ctxt=CONTEXT)
        row.operator("mirror_scan.calibrate_rig", text="", icon="FILE_TICK")
        _draw_progress(layout, context, "mirror_scan.use_rig", "mirror_scan.calibrate_rig")
        if context.window_manager.mirror_scan.picking:
            _draw_keys(layout)
        if not settings.mirrors:
            _text(layout, say("No mirrors yet. Find them, or click points on their frames"), "INFO")
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
        column = _fields(layout)
        column.prop(settings, "show_mirrors")
        column.prop(settings, "fold")
        _field(column, settings.quality, "glass_offset")


class MIRRORSCAN_PT_optics(_Panel, bpy.types.Panel):
    bl_label = "Glass and Light"
    bl_parent_id = "MIRRORSCAN_PT_mirrors"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        settings = context.scene.mirror_scan
        column = _fields(self.layout)
        for name in ("glass_thickness", "bowed", "two_ways"):
            _field(column, settings.quality, name)
        problem = scan_records.no_two_ways(settings)
        column = _fields(self.layout)
        column.enabled = not problem
        _field(column, settings.quality, "frequencies")
        if problem:
            _text(self.layout, problem, "INFO")


def _draw_keys(layout: bpy.types.UILayout) -> None:
    box = layout.box()
    column = box.column(align=True)
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


def _draw_mirror(layout: bpy.types.UILayout, item: bpy.types.PropertyGroup) -> None:
    quality = scan_records.quality_of(item)
    plane = scan_records.plane_of(item)
    if item.message:
        _text(layout, tell(item.message), "CANCEL")
    elif plane is None:
        _text(layout, say("Pick points on its frame, not on the glass; 8 on all four sides are best"), "INFO")
    elif item.source != "given":
        words = {
            "GOOD": say("Good: the frame is flat to {residual:.1f} mm"),
            "USABLE": say("Usable: the frame is flat to {residual:.1f} mm; a longer burst helps"),
            "BAD": say("Poor: the frame is {residual:.1f} mm off a plane. Are all points on the frame, not the glass?"),
        }[quality]
        _text(layout, words.format(residual=item.residual_mm), ICONS[quality])
        if not plane.get("refined", True):
            _text(layout, say("The frame was not found around the points; pick more points"), "ERROR")


class MIRRORSCAN_PT_subject(_Panel, bpy.types.Panel):
    bl_label = "Subject"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context: bpy.types.Context) -> None:
        subject = context.scene.mirror_scan.subject
        _draw_step_mark(self.layout, bool(subject.message) and not subject.stale)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings = context.scene.mirror_scan
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("mirror_scan.find_subject", icon="OUTLINER_OB_ARMATURE", text_ctxt=CONTEXT)
        _draw_progress(layout, context, "mirror_scan.find_subject")
        row = layout.row(align=True)
        row.operator("mirror_scan.pick_subject", icon=_icon("EYEDROPPER"), text_ctxt=CONTEXT)
        if settings.subject.clicked:
            row.prop(settings.subject, "clicked", text="", icon="X", invert_checkbox=True)
        column = _fields(layout)
        for name in ("depth_limit", "floor_clearance", "max_height", "reach", "object"):
            _field(column, settings.subject, name)
        subject = settings.subject
        if live_subject.searching(context.scene) and not job_operators.running(context):
            _text(layout, say("Searching for the person"), "SORTTIME")
        elif subject.stale:
            _text(layout, say("The settings have changed; press Find Subject again"), "FILE_REFRESH")
        elif subject.problem:
            _text(layout, tell(subject.problem), "ERROR")
        elif subject.message:
            _text(layout, subject.message, "CHECKMARK")
            _text(layout, say("Person orange, floor green, too far red, room grey"))
        else:
            _text(layout, say("Optional: Build Avatar does this too. Use it if furniture becomes part of the avatar"))


class MIRRORSCAN_PT_build(_Panel, bpy.types.Panel):
    bl_label = "Build"

    def draw_header(self, context: bpy.types.Context) -> None:
        _draw_step_mark(self.layout, report_text.avatar_report(context.object) is not None)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings = context.scene.mirror_scan
        ready = bool(settings.capture_path) or settings.cloud is not None
        row = layout.row()
        row.enabled = ready
        row.scale_y = 1.5
        row.operator_context = "INVOKE_DEFAULT"
        row.operator("mirror_scan.build_avatar", icon="OUTLINER_OB_ARMATURE", text_ctxt=CONTEXT)
        _draw_progress(layout, context, "mirror_scan.build_avatar")
        if not ready:
            _text(layout, say("Load a capture first"), "INFO")
        elif not settings.mirrors:
            _text(layout, say("No mirrors yet: those of the capture are used, or they are found automatically"), "INFO")
        else:
            bad = [item.name for item in settings.mirrors if scan_records.quality_of(item) in ("BAD", "NONE")]
            if bad:
                _text(layout, say("Check these mirrors first: {names}").format(names=", ".join(bad)), "ERROR")


class MIRRORSCAN_OT_add_quality_preset(AddPresetBase, bpy.types.Operator):
    """Save the quality settings as a preset, or remove a preset"""

    bl_idname = "mirror_scan.add_quality_preset"
    bl_label = "Add Quality Preset"
    bl_translation_context = CONTEXT
    preset_menu = "MIRRORSCAN_PT_quality_presets"
    preset_defines = ["quality = bpy.context.scene.mirror_scan.quality"]
    preset_values = [f"quality.{name}" for name in QUALITY_KEPT]
    preset_subdir = "mirror_scan/quality"


class MIRRORSCAN_PT_quality_presets(PresetPanel, bpy.types.Panel):
    bl_label = "Quality Presets"
    bl_translation_context = CONTEXT
    preset_subdir = "mirror_scan/quality"
    preset_operator = "script.execute_preset"
    preset_add_operator = "mirror_scan.add_quality_preset"


class MIRRORSCAN_PT_quality(_Panel, bpy.types.Panel):
    bl_label = "Quality"
    bl_parent_id = "MIRRORSCAN_PT_build"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        MIRRORSCAN_PT_quality_presets.draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        quality = context.scene.mirror_scan.quality
        column = _fields(layout)
        for name in ("preset", *QUALITY_KEPT):
            _field(column, quality, name)


class MIRRORSCAN_PT_check(_Panel, bpy.types.Panel):
    bl_label = "Check"

    def draw_header(self, context: bpy.types.Context) -> None:
        report = report_text.avatar_report(context.object) or {}
        if report_text.problems_of(report):
            self.layout.label(text="", icon="ERROR")
        else:
            _draw_step_mark(self.layout, "problems" in report)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        avatar = context.object
        report = report_text.avatar_report(avatar)
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("mirror_scan.check", icon="VIEWZOOM", text_ctxt=CONTEXT)
        _draw_progress(layout, context, "mirror_scan.check")
        if report is None:
            _text(layout, say("Select an avatar to see its report"), "INFO")
            return
        _table(layout, report_text.summary(report, context.scene))
        lines = report_text.distances(report)
        if lines:
            layout.separator(factor=0.5)
            _table(layout, lines)
        for warning in report.get("warnings", ()):
            _text(layout, tell(warning), "ERROR")
        column = layout.column(align=True)
        column.label(text="Colour By", text_ctxt=CONTEXT)
        row = column.row(align=True)
        shown = shown_mode(avatar) if avatar.type == "MESH" else ""
        for mode, label in (("CAPTURE", "Capture"), ("VIEW", "View"), ("KIND", "Kind")):
            row.operator("mirror_scan.color_by", text=label, text_ctxt=CONTEXT, depress=mode == shown).mode = mode
        if "problems" in report:
            _draw_problems(layout, context, report)


def _draw_problems(layout: bpy.types.UILayout, context: bpy.types.Context, report: dict) -> None:
    problems = report_text.problems_of(report)
    if not problems:
        layout.label(text=say("No problems found"), icon="CHECKMARK", translate=False)
        return
    number = context.scene.mirror_scan.problem_index
    row = layout.row(align=True)
    row.operator("mirror_scan.jump_to_problem", text="", icon="TRIA_LEFT").direction = "PREVIOUS"
    middle = row.row(align=True)
    middle.alignment = "CENTER"
    count = say("Problems: {count}").format(count=len(problems))
    middle.label(text=f"{number} / {len(problems)}" if 0 < number <= len(problems) else count, translate=False)
    row.operator("mirror_scan.jump_to_problem", text="", icon="TRIA_RIGHT").direction = "NEXT"
    if 0 < number <= len(problems):
        _text(layout, report_text.problem_text(problems[number - 1], context.scene), "ERROR")


class MIRRORSCAN_PT_avatar(_Panel, bpy.types.Panel):
    bl_label = "Avatar"

    def draw_header(self, context: bpy.types.Context) -> None:
        _draw_step_mark(self.layout, armature_of(context.object) is not None)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        if armature_of(context.object) is None:
            layout.operator("mirror_scan.add_skeleton", icon="ARMATURE_DATA", text_ctxt=CONTEXT)
            _draw_progress(layout, context, "mirror_scan.add_skeleton")
            problem = no_mesh(context)
            _text(layout, problem or say("A skeleton lets motions move the avatar"), "INFO")
            return
        layout.operator("mirror_scan.apply_motion", icon="FILE_MOVIE", text_ctxt=CONTEXT).clip = "FILE"
        flow = layout.grid_flow(columns=3, even_columns=True, align=True)
        clips = bpy.ops.mirror_scan.apply_motion.get_rna_type().properties["clip"].enum_items
        for item in clips[1:]:
            button = flow.operator("mirror_scan.apply_motion", text=item.name, text_ctxt=CONTEXT)
            button.clip = item.identifier
        _draw_progress(layout, context, "mirror_scan.apply_motion")
        live = job_operators.running(context, "mirror_scan.follow_stream")
        layout.operator(
            "mirror_scan.follow_stream", text="Stop Following" if live else "Follow Stream",
            icon="PAUSE" if live else "RADIOBUT_ON", text_ctxt=CONTEXT,
        )  # fmt: skip
        bones = armature_of(context.object)
        if has_controls(bones):
            leads = any(c.enabled for c in bones.pose.bones["mixamorig:LeftForeArm"].constraints)
            text = "Follow the Motion" if leads else "Use IK Controls"
            layout.operator(
                "mirror_scan.use_controls", text=text, icon="CON_KINEMATIC", text_ctxt=CONTEXT
            ).on = not leads
        layout.operator("mirror_scan.rest_in_t_pose", icon="OUTLINER_DATA_ARMATURE", text_ctxt=CONTEXT)


class _AvatarPart(_Panel):
    """What else is made of an avatar, folded below it."""

    bl_parent_id = "MIRRORSCAN_PT_avatar"
    bl_options = {"DEFAULT_CLOSED"}


class MIRRORSCAN_PT_look(_AvatarPart, bpy.types.Panel):
    bl_label = "Look"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        look = context.scene.mirror_scan.look
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.row(align=True)
        button = row.operator("mirror_scan.texture", icon=_icon("TEXTURE"), text_ctxt=CONTEXT)
        button.size, button.remove_light = look.texture_size, look.remove_light
        row.prop(look, "texture_size", text="")
        _draw_progress(layout, context, "mirror_scan.texture")
        layout.prop(look, "remove_light", text_ctxt=CONTEXT)
        texture = (report_text.avatar_report(context.object) or {}).get("texture")
        if texture is not None:
            _table(layout, report_text.texture_lines(texture))
        row = layout.row(align=True)
        row.operator("mirror_scan.reduce", icon=_icon("MOD_DECIM"), text_ctxt=CONTEXT).triangles = look.triangles
        row.prop(look, "triangles", text="")
        _draw_progress(layout, context, "mirror_scan.reduce")
        row = layout.row(align=True)
        row.operator("mirror_scan.add_studio", icon=_icon("LIGHT_AREA"), text_ctxt=CONTEXT)
        row.operator("mirror_scan.remove_studio", text="", icon="X")
        layout.operator("mirror_scan.mark_as_asset", icon="ASSET_MANAGER", text_ctxt=CONTEXT)
        _draw_progress(layout, context, "mirror_scan.mark_as_asset")


class MIRRORSCAN_PT_measurements(_AvatarPart, bpy.types.Panel):
    bl_label = "Measurements"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.row(align=True)
        row.operator("mirror_scan.measure", icon=_icon("CON_DISTLIMIT"), text_ctxt=CONTEXT)
        row.operator("mirror_scan.save_measurements", text="", icon="FILE_TICK")
        _draw_progress(layout, context, "mirror_scan.measure")
        lines = report_text.measures(report_text.avatar_report(context.object) or {}, context.scene)
        if lines:
            _table(layout, lines)
        else:
            _text(layout, say("Girths, lengths and height as a tape would give them"), "INFO")


class MIRRORSCAN_PT_clothes(_AvatarPart, bpy.types.Panel):
    bl_label = "Clothes"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        look = context.scene.mirror_scan.look
        layout.operator_context = "INVOKE_DEFAULT"
        flow = layout.grid_flow(columns=3, even_columns=True, align=True)
        for item in bpy.ops.mirror_scan.dress.get_rna_type().properties["kind"].enum_items:
            button = flow.operator("mirror_scan.dress", text=item.name, text_ctxt=CONTEXT)
            button.kind, button.ease, button.tight = item.identifier, look.ease, look.tight
        _draw_progress(layout, context, "mirror_scan.dress")
        column = _fields(layout)
        _field(column, look, "ease")
        column.prop(look, "tight", text_ctxt=CONTEXT)
        layout.operator("mirror_scan.prepare_for_cloth", icon="MOD_CLOTH", text_ctxt=CONTEXT)
        _draw_progress(layout, context, "mirror_scan.prepare_for_cloth")
        _text(layout, say("Your own garment: select it, then the avatar, and press Prepare for Cloth"), "INFO")


class MIRRORSCAN_PT_export(_Panel, bpy.types.Panel):
    bl_label = "Export"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        problem = no_mesh(context)
        if problem:
            _text(layout, problem, "INFO")
        column = _fields(layout)
        column.prop(context.scene.mirror_scan, "export_folder", placeholder=say("Ask each time"))
        flow = layout.grid_flow(columns=4, even_columns=True, align=True)
        for kind in ("GLB", "FBX", "OBJ", "PLY", "STL", "USDC", "ABC", "BLEND"):
            flow.operator("mirror_scan.export_avatar", text=kind, translate=False).format = kind


class MIRRORSCAN_PT_rig(_Panel, bpy.types.Panel):
    bl_label = "Virtual Rig"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("mirror_scan.add_rig", icon="OUTLINER_OB_CAMERA", text_ctxt=CONTEXT)
        layout.operator("mirror_scan.simulate", icon="PLAY", text_ctxt=CONTEXT)
        _draw_progress(layout, context, "mirror_scan.simulate")
        active = context.object
        if active is not None and active.type == "MESH":
            column = _fields(layout)
            column.prop(active.mirror_scan, "is_mirror")
            if active.mirror_scan.is_mirror:
                _field(column, active.mirror_scan, "frame_width")
                _field(column, active.mirror_scan, "frame_depth")
        advice = say("Try a rig before you buy mirrors: select a body, add a rig, run a virtual scan")
        _text(layout, context.scene.mirror_scan.rig_message or advice, "INFO")


register, unregister = bpy.utils.register_classes_factory(
    (
        MIRRORSCAN_UL_mirrors,
        MIRRORSCAN_OT_add_quality_preset,
        MIRRORSCAN_PT_quality_presets,
        MIRRORSCAN_PT_capture,
        MIRRORSCAN_PT_reading,
        MIRRORSCAN_PT_mirrors,
        MIRRORSCAN_PT_optics,
        MIRRORSCAN_PT_subject,
        MIRRORSCAN_PT_build,
        MIRRORSCAN_PT_quality,
        MIRRORSCAN_PT_avatar,
        MIRRORSCAN_PT_look,
        MIRRORSCAN_PT_measurements,
        MIRRORSCAN_PT_clothes,
        MIRRORSCAN_PT_check,
        MIRRORSCAN_PT_export,
        MIRRORSCAN_PT_rig,
    )
)
