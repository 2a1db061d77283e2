"""Panels of the avatar: how it is built, its skeleton and motion, look, measurements and clothes."""

from __future__ import annotations

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from ..background import job_operators
from ..language.texts import CONTEXT, say
from ..scene import report_text
from ..scene.properties import QUALITY_KEPT
from ..scene.scan_records import armature_of, has_controls, no_mesh
from . import panel_states
from .panel_parts import Panel, field, fields, icon_if_wide, sentence, table
from .panel_states import Step


class MIRRORSCAN_PT_build(Panel, Step, bpy.types.Panel):
    bl_label = "Build"
    state = staticmethod(panel_states.build)

    def draw(self, context: bpy.types.Context) -> None:
        if not context.scene.mirror_scan.mirrors:
            text = say("No mirrors yet: those of the capture are used, or they are found automatically")
            sentence(self.layout, text, "INFO")
        field(fields(self.layout), context.scene.mirror_scan, "keep_versions")


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


class MIRRORSCAN_PT_quality(Panel, bpy.types.Panel):
    bl_label = "Quality"
    bl_parent_id = "MIRRORSCAN_PT_build"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        MIRRORSCAN_PT_quality_presets.draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        quality = context.scene.mirror_scan.quality
        column = fields(layout)
        for name in ("preset", *QUALITY_KEPT):
            field(column, quality, name)


class MIRRORSCAN_PT_avatar(Panel, Step, bpy.types.Panel):
    bl_label = "Avatar"
    state = staticmethod(panel_states.avatar)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        if armature_of(context.object) is None:
            layout.operator("mirror_scan.add_skeleton", icon="ARMATURE_DATA", text_ctxt=CONTEXT)
            problem = no_mesh(context)
            sentence(layout, problem or say("A skeleton lets motions move the avatar"), "INFO")
            return
        layout.operator("mirror_scan.apply_motion", icon="FILE_MOVIE", text_ctxt=CONTEXT).clip = "FILE"
        flow = layout.grid_flow(row_major=True, columns=3, even_columns=True, align=True)
        clips = bpy.ops.mirror_scan.apply_motion.get_rna_type().properties["clip"].enum_items
        for item in clips[1:]:
            button = flow.operator("mirror_scan.apply_motion", text=item.name, text_ctxt=CONTEXT)
            button.clip = item.identifier
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


class _AvatarPart(Panel):
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
        button = row.operator("mirror_scan.texture", icon=icon_if_wide("TEXTURE"), text_ctxt=CONTEXT)
        button.size, button.remove_light = look.texture_size, look.remove_light
        row.prop(look, "texture_size", text="")
        layout.prop(look, "remove_light", text_ctxt=CONTEXT)
        texture = (panel_states.report_of(context.object) or {}).get("texture")
        if texture is not None:
            table(layout, report_text.texture_lines(texture))
        row = layout.row(align=True)
        row.operator("mirror_scan.reduce", icon=icon_if_wide("MOD_DECIM"), text_ctxt=CONTEXT).triangles = look.triangles
        row.prop(look, "triangles", text="")
        row = layout.row(align=True)
        row.operator("mirror_scan.add_studio", icon=icon_if_wide("LIGHT_AREA"), text_ctxt=CONTEXT)
        row.operator("mirror_scan.remove_studio", text="", icon="X")
        layout.operator("mirror_scan.mark_as_asset", icon="ASSET_MANAGER", text_ctxt=CONTEXT)


class MIRRORSCAN_PT_measurements(_AvatarPart, bpy.types.Panel):
    bl_label = "Measurements"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.row(align=True)
        row.operator("mirror_scan.measure", icon=icon_if_wide("CON_DISTLIMIT"), text_ctxt=CONTEXT)
        row.operator("mirror_scan.save_measurements", text="", icon="FILE_TICK")
        lines = report_text.measures(panel_states.report_of(context.object) or {}, context.scene)
        if lines:
            table(layout, lines)
        else:
            sentence(layout, say("Girths, lengths and height as a tape would give them"), "INFO")


class MIRRORSCAN_PT_clothes(_AvatarPart, bpy.types.Panel):
    bl_label = "Clothes"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        look = context.scene.mirror_scan.look
        layout.operator_context = "INVOKE_DEFAULT"
        flow = layout.grid_flow(row_major=True, columns=3, even_columns=True, align=True)
        for item in bpy.ops.mirror_scan.dress.get_rna_type().properties["kind"].enum_items:
            button = flow.operator("mirror_scan.dress", text=item.name, text_ctxt=CONTEXT)
            button.kind, button.ease, button.tight = item.identifier, look.ease, look.tight
        column = fields(layout)
        field(column, look, "ease")
        column.prop(look, "tight", text_ctxt=CONTEXT)
        layout.operator("mirror_scan.prepare_for_cloth", icon="MOD_CLOTH", text_ctxt=CONTEXT)
        sentence(layout, say("Your own garment: select it, then the avatar, and press Prepare for Cloth"), "INFO")


CLASSES = (
    MIRRORSCAN_OT_add_quality_preset,
    MIRRORSCAN_PT_quality_presets,
    MIRRORSCAN_PT_build,
    MIRRORSCAN_PT_quality,
    MIRRORSCAN_PT_avatar,
    MIRRORSCAN_PT_look,
    MIRRORSCAN_PT_measurements,
    MIRRORSCAN_PT_clothes,
)
