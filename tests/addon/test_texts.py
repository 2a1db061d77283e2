"""Every text a user may read can be translated: it is a whole sentence, looked up before anything is filled in."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2] / "mirror_scan_addon"
ELSEWHERE = {"tasks.py", "worker.py", "compiling.py", "bridging.py", "command.py"}
"""What runs without Blender's window or without bpy; its texts are looked up where they arrive."""

ERRORS = {"MirrorScanError", "CaptureError", "MirrorError", "OutputError"}

def sources():
    return [path for path in sorted(ROOT.rglob("*.py")) if path.name not in ELSEWHERE]


def literal(node) -> bool:
    """Whether a text is written in place, letters among it, and not looked up."""
    if isinstance(node, ast.JoinedStr):
        parts = [part.value for part in node.values if isinstance(part, ast.Constant)]
        return any(len(word) > 2 and word.isalpha() for part in parts for word in part.split())
    if isinstance(node, ast.BinOp):
        return literal(node.left) or literal(node.right)
    return isinstance(node, ast.Constant) and isinstance(node.value, str) and any(map(str.isalpha, node.value))


@pytest.mark.parametrize("path", sources(), ids=lambda path: path.name)
def test_no_text_is_said_without_being_looked_up(path):
    wrong = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        name = ast.unparse(node.func).rpartition(".")[2]
        given = {keyword.arg: keyword.value for keyword in node.keywords}
        if name in ERRORS and any(map(literal, node.args)):
            wrong.append(node)
        elif name == "report" and len(node.args) == 2 and literal(node.args[1]):
            wrong.append(node)
        elif name in ("_text", "status_text_set", "poll_message_set") and any(map(literal, node.args[:2])):
            wrong.append(node)
        elif name in ("label", "operator", "prop", "progress") and literal(given.get("text")):
            if "text_ctxt" not in given and ast.unparse(given.get("translate", ast.Constant(True))) != "False":
                wrong.append(node)
            elif "translate" in given and name == "label":
                wrong.append(node)
        elif literal(given.get("placeholder")):
            wrong.append(node)
        elif name == "say" and isinstance(node.args[0], ast.JoinedStr | ast.BinOp):
            wrong.append(node)  # filled in before it is looked up
        elif name.endswith("Property") and name != "PointerProperty" and "translation_context" not in given:
            if literal(given.get("name")) and "SKIP_SAVE" not in ast.unparse(node):
                wrong.append(node)
    assert not wrong, [f"line {node.lineno}: {ast.unparse(node)}" for node in wrong]


BUTTONS = (
    ("load_capture", {}, ""), ("load_capture", {"filepath": "/a/b"}, "Load /a/b again"), ("pick_mirror_points", {}, ""),
    ("pick_mirror_points", {"add": True}, "Add a mirror"), ("color_by", {"mode": "KIND"}, "seam between two views red"),
    ("export_avatar", {}, ""), ("export_avatar", {"format": "STL"}, "For 3D printing"),
    ("jump_to_problem", {"direction": "PREVIOUS"}, "before this one"), ("jump_to_problem", {}, "next problem"),
)  # fmt: skip


@pytest.mark.parametrize("name, values, words", BUTTONS)
def test_a_button_tells_what_it_does(bpy, name, values, words):
    given = bpy.context.window_manager.operator_properties_last(f"mirror_scan.{name}")
    for key in ("filepath", "add", "mode", "format", "direction"):
        if key in given.bl_rna.properties:
            given.property_unset(key)
    for key, value in values.items():
        setattr(given, key, value)
    text = getattr(bpy.types, f"MIRROR_SCAN_OT_{name}").description(bpy.context, given)
    assert words in text and bool(words) == bool(text) and not text.endswith(".")
