"""Panels of what comes out: the check, the export, and the virtual rig."""

from __future__ import annotations

import bpy

from ..language.texts import CONTEXT, as_sentence, say, tell
from ..scene import live_rig, report_text
from ..scene.scan_records import no_mesh
from . import panel_states
from .panel_parts import Panel, field, fields, sentence, table
from .panel_states import Step


class MIRRORSCAN_PT_check(Panel, Step, bpy.types.Panel):
    bl_label = "Check"
    state = staticmethod(panel_states.check)

    def draw(self, context: bpy.types.Context) -> None:
        from ..scene.avatar_objects import shown_mode  # with what a mesh is: Blender's start does not wait for it

        layout = self.layout
        avatar = context.object
        report = panel_states.report_of(avatar)
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("mirror_scan.check", icon="VIEWZOOM", text_ctxt=CONTEXT)
        if report is None:
            sentence(layout, say("Select an avatar to see its report"), "INFO")
            return
        table(layout, report_text.summary(report, context.scene))
        lines = report_text.distances(report)
        if lines:
            layout.separator(factor=0.5)
            table(layout, lines)
        for warning in report.get("warnings", ()):
            sentence(layout, as_sentence(tell(warning)), "ERROR")
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
        sentence(layout, report_text.problem_text(problems[number - 1], context.scene), "ERROR")


class MIRRORSCAN_PT_export(Panel, Step, bpy.types.Panel):
    bl_label = "Export"
    state = staticmethod(panel_states.export)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        problem = no_mesh(context)
        if problem:
            sentence(layout, problem, "INFO")
        column = fields(layout)
        column.prop(context.scene.mirror_scan, "export_folder", placeholder=say("Ask each time"))


class MIRRORSCAN_PT_rig(Panel, bpy.types.Panel):
    bl_label = "Virtual Rig"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("mirror_scan.add_rig", icon="OUTLINER_OB_CAMERA", text_ctxt=CONTEXT)
        layout.operator("mirror_scan.simulate", icon="PLAY", text_ctxt=CONTEXT)
        layout.operator("mirror_scan.find_rig", icon="VIEWZOOM", text_ctxt=CONTEXT)
        row = layout.row(align=True)
        row.operator("mirror_scan.check_rig", text_ctxt=CONTEXT)
        row.operator("mirror_scan.save_plan", text_ctxt=CONTEXT)
        if live_rig.planned_camera(context.scene) is not None:
            _draw_rig(layout, context.scene)
        active = context.object
        if active is not None and active.type == "MESH":
            column = fields(layout)
            column.prop(active.mirror_scan, "is_mirror")
            if active.mirror_scan.is_mirror:
                field(column, active.mirror_scan, "frame_width")
                field(column, active.mirror_scan, "frame_depth")
        advice = say("Try a rig before you buy mirrors: select a body, add a rig, run a virtual scan")
        sentence(layout, context.scene.mirror_scan.rig_message or advice, "INFO")


def _draw_rig(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """What the planned rig sees: ticks for head, hands and feet in each view, shares, and what to move."""
    settings = scene.mirror_scan
    column = fields(layout)
    column.prop(settings, "rig_sensor")
    for name in ("rig_live", "rig_show", "rig_picture"):
        column.prop(settings, name)
    found = live_rig.checked(scene)
    if found is None:
        if live_rig.stage(scene):
            sentence(layout, say(live_rig.stage(scene)), "INFO")
        return
    if "problem" in found:
        sentence(layout, as_sentence(str(found["problem"])), "ERROR")
        return
    if not settings.rig_live:
        sentence(layout, say("As measured last; press Check Rig after a change"), "INFO")
    grid = layout.box().grid_flow(row_major=True, columns=4, even_columns=True, align=True)
    for title in ("", say("Head"), say("Hands"), say("Feet")):
        grid.label(text=title, translate=False)
    advice = []
    for view in found["views"]:
        grid.label(text=say(view["name"]) if view["name"] == "direct" else view["name"], translate=False)
        for part in ("head", "hands", "feet"):
            grid.label(text="", icon="CHECKMARK" if view[part] else "CANCEL")
        if view["advice"]:
            advice.append(as_sentence(tell(view["advice"])))
    for text in advice:
        sentence(layout, text, "ERROR")
    names = {"head": say("Head Seen"), "hands": say("Hands Seen"), "feet": say("Feet Seen")}
    rows = [(say("Body Seen"), f"{found['seen']:.0%}", "")]
    rows += [(names[part], f"{share:.0%}", "") for part, share in found["parts"].items() if share == share]
    rows.append((say("Predicted Error"), f"{found['error_mm']:.1f} mm", ""))
    if found["lit_twice"] > 0:
        rows.append((say("Two-Way Light"), f"{found['lit_twice']:.0%}, {found['light_mm']:.1f} mm", ""))
    table(layout, rows)


CLASSES = (MIRRORSCAN_PT_check, MIRRORSCAN_PT_export, MIRRORSCAN_PT_rig)
