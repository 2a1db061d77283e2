"""The last error, kept in the panel with the buttons that cure it (:mod:`..scene.kept_errors`)."""

from __future__ import annotations

from collections.abc import Callable

import bpy

from ..language.texts import CONTEXT, say
from ..scene import kept_errors
from .panel_parts import field, fields, sentence

UNITS_MM = ((0.1, "0.1 mm"), (0.2, "0.2 mm"), (1.0, "1 mm"), (1000.0, "1 m"))
"""Units of depth that cameras and programs write."""


def error_box(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Message, cures, and a cross that takes it away; nothing when nothing went wrong."""
    found = kept_errors.kept(context)
    if found is None:
        return
    box = layout.box()
    row = box.row()
    sentence(row.column(), found.text, "ERROR", 2)
    row.operator("mirror_scan.dismiss_error", text="", icon="X", emboss=False)
    column = box.column(align=True)
    column.operator_context = "INVOKE_DEFAULT"
    for cure in found.kind.cures:
        CURES[cure](column, context, found)


def _again(layout, context, found) -> None:
    _set(_button(layout, found.operator, say("Try Again"), "FILE_REFRESH"), found.options)


def _choose(layout, context, found) -> None:
    name = "mirror_scan.load_capture"
    if found.operator == "mirror_scan.scan_to_avatar":
        name = found.operator
    _button(layout, name, say("Choose Another"), "FILE_FOLDER")


def _other_file(layout, context, found) -> None:
    options = {name: value for name, value in found.options.items() if name != "filepath"}
    _set(_button(layout, found.operator, say("Choose Another File"), "FILE_FOLDER"), options)


def _lens(layout, context, found) -> None:
    column = fields(layout)
    field(column, context.scene.mirror_scan.reading, "lens")
    field(column, context.scene.mirror_scan.reading, "intrinsics", "Lens File")


def _unit(layout, context, found) -> None:
    field(fields(layout), context.scene.mirror_scan.reading, "depth_unit_mm", "Depth Unit (mm)")
    row = layout.row(align=True)
    for value, text in UNITS_MM:
        row.operator("mirror_scan.set_depth_unit", text=text, translate=False).millimetres = value


def _turn(layout, context, found) -> None:
    column = fields(layout)
    field(column, context.scene.mirror_scan.reading, "turn")
    field(column, context.scene.mirror_scan.reading, "mirrored")


def _frames(layout, context, found) -> None:
    field(fields(layout), context.scene.mirror_scan, "frames", "Frames (0 = all)")


def _no_color(layout, context, found) -> None:
    fields(layout).prop(context.scene.mirror_scan.reading, "color")


def _no_mirror_file(layout, context, found) -> None:
    fields(layout).prop(context.scene.mirror_scan.reading, "own_mirrors")


def _subject(layout, context, found) -> None:
    column = fields(layout)
    for name in ("depth_limit", "reach", "object"):
        field(column, context.scene.mirror_scan.subject, name)


def _remove(layout, context, found) -> None:
    names = [item.name for item in context.scene.mirror_scan.mirrors]
    if found.mirror in names:
        button = layout.operator(
            "mirror_scan.remove_mirror", text=say("Remove {name}").format(name=found.mirror), icon="REMOVE",
            translate=False,
        )  # fmt: skip
        button.index = names.index(found.mirror)


def _apply_scale(layout, context, found) -> None:
    button = layout.operator("object.transform_apply", text="Apply Scale", text_ctxt=CONTEXT)
    button.location, button.rotation, button.scale = False, False, True


def _simple(operator: str, text: Callable[[], str], icon: str) -> Callable:
    def draw(layout, context, found) -> None:
        _button(layout, operator, text(), icon)

    return draw


def _button(layout, operator: str, text: str, icon: str) -> bpy.types.OperatorProperties:
    return layout.operator(operator, text=text, icon=icon, translate=False)


def _set(button: bpy.types.OperatorProperties, options: dict) -> None:
    for name, value in options.items():
        setattr(button, name, value)


CURES: dict[str, Callable] = {
    "again": _again,
    "choose": _choose,
    "other file": _other_file,
    "lens": _lens,
    "unit": _unit,
    "turn": _turn,
    "frames": _frames,
    "no color": _no_color,
    "no mirror file": _no_mirror_file,
    "subject": _subject,
    "remove": _remove,
    "apply scale": _apply_scale,
    "find": _simple("mirror_scan.find_mirrors", lambda: say("Find Mirrors"), "VIEWZOOM"),
    "pick": _simple("mirror_scan.pick_mirror_points", lambda: say("Click the Frames"), "EYEDROPPER"),
    "click person": _simple("mirror_scan.pick_subject", lambda: say("Click the Person"), "EYEDROPPER"),
    "choose rig": _simple("mirror_scan.use_rig", lambda: say("Choose Another Rig File"), "FILE_FOLDER"),
    "build": _simple("mirror_scan.build_avatar", lambda: say("Build Avatar"), "OUTLINER_OB_ARMATURE"),
    "skeleton": _simple("mirror_scan.add_skeleton", lambda: say("Add Skeleton"), "ARMATURE_DATA"),
    "save": _simple("wm.save_mainfile", lambda: say("Save the File"), "FILE_TICK"),
}
"""How each cure is drawn, by the names in :data:`.kept_errors.KINDS`."""
