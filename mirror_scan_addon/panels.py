"""The “Mirror Scan” tab of the 3D viewport's sidebar, top to bottom the way the work goes."""

from __future__ import annotations

import bpy

from . import jobs, scene
from .operators.build_avatar import MIRRORSCAN_OT_build_avatar


class _Panel:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Mirror Scan"


class MIRRORSCAN_PT_capture(_Panel, bpy.types.Panel):
    bl_label = "Capture"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.mirror_scan
        layout.prop(settings, "capture_path", text="Folder", placeholder="Choose a folder")
        layout.prop(settings, "mirrors_path", placeholder="From the capture")
        layout.prop(settings, "frames", text="Frames (0 = all)")


class MIRRORSCAN_PT_build(_Panel, bpy.types.Panel):
    bl_label = "Avatar"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        if jobs.running(context):
            progress = context.window_manager.mirror_scan
            layout.progress(factor=progress.fraction, text=progress.message)
            layout.label(text="Press Esc to cancel")
            return
        chosen = bool(context.scene.mirror_scan.capture_path)
        row = layout.row()
        row.enabled = chosen
        row.scale_y = 1.5
        row.operator_context = "INVOKE_DEFAULT"
        row.operator(MIRRORSCAN_OT_build_avatar.bl_idname, icon="OUTLINER_OB_ARMATURE")
        if not chosen:
            layout.label(text="Choose a capture folder first", icon="INFO")


class MIRRORSCAN_PT_check(_Panel, bpy.types.Panel):
    bl_label = "Check"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.avatar_report(context.object) is not None

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        report = scene.avatar_report(context.object)
        column = layout.column(align=True)
        for label, value in summary(report):
            row = column.split(factor=0.45)
            row.label(text=label)
            row.label(text=value)
        for warning in report.get("warnings", ()):
            layout.label(text=str(warning), icon="ERROR")


def summary(report: dict) -> list[tuple[str, str]]:
    """What a report says of its mesh, as label and value in words; leaves out what the report does not have."""
    mesh = report.get("mesh", {})
    lines = []
    if "height_m" in mesh:
        lines.append(("Height", f"{mesh['height_m']:.2f} m"))
    if "volume_l" in mesh:
        lines.append(("Volume", f"{mesh['volume_l']:.1f} l"))
    if "vertices" in mesh:
        lines.append(("Vertices", f"{mesh['vertices']:,}"))
    if "watertight" in mesh:
        lines.append(("Surface", "closed" if mesh["watertight"] else "has holes"))
    for mirror in report.get("mirrors", ()):
        if mirror.get("residual_mm") is not None:
            lines.append((f"Mirror {mirror.get('name', '')}", f"fits to {mirror['residual_mm']:.1f} mm"))
    timings = report.get("timings_ms", {})
    if timings:
        lines.append(("Time", f"{timings.get('total', sum(timings.values())) / 1000:.1f} s"))
    return lines


register, unregister = bpy.utils.register_classes_factory(
    (MIRRORSCAN_PT_capture, MIRRORSCAN_PT_build, MIRRORSCAN_PT_check)
)
