"""Every text a user may read can be translated: it is a whole sentence, looked up before anything is filled in."""

from __future__ import annotations

import ast
import json
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3] / "mirror_scan_addon"
ELSEWHERE = {"tasks", "worker.py", "kernel_compilation.py", "command.py"}
"""What runs without Blender's window or without bpy; its texts are looked up where they arrive."""

ERRORS = {"MirrorScanError", "CaptureError", "MirrorError", "OutputError"}


def sources():
    return [path for path in sorted(ROOT.rglob("*.py")) if not {path.name, path.parent.name} & ELSEWHERE]


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
        elif name in ("sentence", "status_text_set", "poll_message_set") and any(map(literal, node.args[:2])):
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
    ("jump_to_problem", {"direction": "PREVIOUS"}, "previous problem"), ("jump_to_problem", {}, "next problem"),
    ("live_view", {}, ""), ("live_view", {"source": "playback"}, "as if it were a live camera"),
)  # fmt: skip


@pytest.mark.parametrize("name, values, words", BUTTONS)
def test_a_button_tells_what_it_does(bpy, name, values, words):
    given = bpy.context.window_manager.operator_properties_last(f"mirror_scan.{name}")
    for key in ("filepath", "add", "mode", "format", "direction", "source"):
        if key in given.bl_rna.properties:
            given.property_unset(key)
    for key, value in values.items():
        setattr(given, key, value)
    text = getattr(bpy.types, f"MIRROR_SCAN_OT_{name}").description(bpy.context, given)
    assert words in text and bool(words) == bool(text) and not text.endswith(".")


# --- core's messages -------------------------------------------------------------------------------------------------

GERMAN = {
    "{path}: there is no such file or folder": "{path}: Datei oder Ordner nicht gefunden",
    "the click ({u}, {v}) is outside the {width}×{height} depth image":
        "Klick ({u}, {v}) liegt außerhalb des Tiefenbilds, {width}×{height}",
    "{name}: nobody is seen in this mirror, its side of the body is guessed; turn the mirror until the camera sees the "
    "subject's back in it": "Niemand in {name} zu sehen: diese Seite ist geraten; drehe den Spiegel",
    "{path}: cannot be read as a rig file: {reason}": "{path} ist keine Datei eines Aufbaus: {reason}",
    "the index points at no message": "das Verzeichnis zeigt auf nichts",
    "Fitting the mirrors": "Spiegel werden eingepasst",
}  # fmt: skip
"""A sample of what a translator may write."""


@pytest.fixture
def german(bpy, monkeypatch):
    """The bpy module has no languages, so that this stands in for Blender's look-up; ``tests/blender`` asks Blender."""
    from mirror_scan.mirror_scan_addon.background import job_operators
    from mirror_scan.mirror_scan_addon.language import texts

    monkeypatch.setattr(texts, "language", lambda: "de_DE")
    monkeypatch.setattr(texts, "say", lambda text: GERMAN.get(text, text))
    return lambda text: job_operators.tell(text)


def listed():
    return json.loads((ROOT / "messages.json").read_text(encoding="utf-8"))


def test_the_list_of_core_s_messages_is_true():
    """Some may lag behind: what it lacks is told in English. What is shipped is listed anew (``test_extension.py``)."""
    said = set(runpy.run_path(str(ROOT.parent / "tools" / "messages.py"))["messages"]())
    wrong = said ^ set(listed())
    assert len(wrong) <= 0.03 * len(said), ("run python tools/messages.py", sorted(wrong))


def test_what_is_raised_and_warned_of_is_in_the_list():
    """Against another reading of the code: the texts beside “raise” alone."""
    tool = runpy.run_path(str(ROOT.parent / "tools" / "messages.py"))
    known, raised = set(map(tool["skeleton"], tool["messages"]())), 0
    for path in tool["sources"]():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and node.exc.args:
                name, text = ast.unparse(node.exc.func), node.exc.args[0]
                written = isinstance(text, ast.JoinedStr) or (node.exc.keywords and isinstance(text, ast.Constant))
                if name.endswith("Error") and name not in ("TypeError", "KeyError") and written:
                    template = words = tool["without_formats"](text.value) if isinstance(text, ast.Constant) else ""
                    if isinstance(text, ast.JoinedStr):
                        template, words = tool["template"](text)
                    raised += 1
                    said = tool["SENTENCE"].search(words) is not None
                    assert tool["skeleton"](template) in known or not said, (path.name, template)
    assert raised > 150


def test_every_message_is_recognised_with_what_was_filled_in():
    import string

    from mirror_scan.mirror_scan_addon.language.messages import recognise

    other = []
    for template in listed():
        names = [name for _, name, *_ in string.Formatter().parse(template) if name is not None]
        values = {name: f"<{number}>" for number, name in enumerate(names)}
        text = template.format(**values)
        found, said = recognise(text)
        assert found.format(**said) == text
        if (found, said) != (template, values):
            other.append(template)
    assert len(other) <= 2, other  # a template whose own words another one has too


def test_core_s_messages_are_told_in_the_user_s_language(german):
    assert german("/x/a b: there is no such file or folder") == "/x/a b: Datei oder Ordner nicht gefunden"
    assert german("left: the click (7, 900) is outside the 640×576 depth image") == (
        "left: Klick (7, 900) liegt außerhalb des Tiefenbilds, 640×576"
    )
    quoted = "r.json: cannot be read as a rig file: the index points at no message"
    assert german(quoted) == "r.json ist keine Datei eines Aufbaus: das Verzeichnis zeigt auf nichts"
    for other in ("", "?", "ein Satz, den core nie sagt", "{path}: {", "a: b: c: d", "x" * 9999):
        assert german(other) == other


def test_a_message_that_knows_its_parts_needs_no_recognising(german, monkeypatch):
    """What cannot be told from the words: where a value ends, and what a value quotes."""
    from mirror_scan.core.errors import MirrorError, Notice
    from mirror_scan.mirror_scan_addon.language import messages

    monkeypatch.setattr(messages, "templates", tuple)  # nothing is listed
    monkeypatch.setitem(GERMAN, "{one}, {other}: {share} seen, {why}", "{share} von {other}, {one} gesehen: {why}")
    monkeypatch.setitem(GERMAN, "{name} moved by {apart}", "{name} um {apart} bewegt")
    why = Notice("{name} moved by {apart:.0f} mm", name="a, b: c", apart=3.4)
    assert german(why) == "a, b: c moved by 3 mm"  # no such template
    why = Notice("{name} moved by {apart:.0f}", name="a, b: c", apart=3.4)
    whole = Notice("{one}, {other}: {share:.0%} seen, {why}", one="x, y", other="{z}", share=0.5, why=why)
    assert german(whole) == german(MirrorError(whole)) == "50% von {z}, x, y gesehen: a, b: c um 3 bewegt"
    assert german(Notice.of("the index points at no message")) == "das Verzeichnis zeigt auf nichts"


def test_in_blender_nothing_is_said_of_options_and_packages(bpy):
    """Whatever the message: no option of the command line, no inner name, and nothing that pip installs."""
    import re
    import string

    from mirror_scan.core.errors import Notice
    from mirror_scan.mirror_scan_addon.language.blender_words import IN_BLENDER
    from mirror_scan.mirror_scan_addon.language.texts import tell

    def fields(template):
        return {name for _, name, *_ in string.Formatter().parse(template) if name is not None}

    known = set(runpy.run_path(str(ROOT.parent / "tools" / "messages.py"))["messages"]())
    for template, words in IN_BLENDER.items():
        assert template in known and fields(words()) <= fields(template), template
        values = {name: f"<{name}>" for name in fields(template)}
        assert tell(Notice(template, **values)) == words().format(**values)
    elsewhere = ("registration: ", "{paths} captures", "many captures", "{path}: a video", "{folder}: ", "no recording")
    for template in known:
        if not template.startswith(elsewhere):  # several cameras, batches, sequences: only in a terminal
            assert not re.search(r"(^|[ (])--[a-z]|option “|pip install|docs/|(?<!{)\bglass_", tell(template)), template


def test_reports_and_panels_tell_core_s_errors_in_the_user_s_language(german, bpy, tmp_path):
    with pytest.raises(RuntimeError, match="Datei oder Ordner nicht gefunden"):
        bpy.ops.mirror_scan.load_capture(filepath=str(tmp_path / "none"))


# --- a translator's way ----------------------------------------------------------------------------------------------


def test_what_a_translator_writes_is_what_blender_is_given(bpy, tmp_path, monkeypatch):
    """From the template that the tool writes to the table that Blender looks up: every text, whatever stands in it."""
    from mirror_scan.mirror_scan_addon.language import texts

    tool = runpy.run_path(str(ROOT.parent / "tools" / "messages.py"))
    template = tool["template_file"]()
    entries = set(texts.read_translation(template.replace('msgstr ""', 'msgstr "x"')))
    assert {("MirrorScan", text) for text in tool["messages"]()} <= entries
    assert {(context, text) for context, text, _ in tool["own_texts"]()} <= entries and len(entries) > 800
    assert texts.read_translation(template) == {}  # English
    (tmp_path / "de_DE.po").write_text(
        template.replace('msgid "Find Mirrors"\nmsgstr ""', 'msgid "Find Mirrors"\nmsgstr "Spiegel "\n"fin\\"den"')
        + '\n#, fuzzy\nmsgctxt "MirrorScan"\nmsgid "Build"\nmsgstr "Gebäude"\n',
        encoding="utf-8",
    )
    monkeypatch.setattr(texts, "LANGUAGES", str(tmp_path))
    assert texts.translations() == {"de_DE": {("MirrorScan", "Find Mirrors"): 'Spiegel fin"den'}}
    texts.unregister()
    texts.register()


def test_everything_blender_shows_of_ours_can_be_translated(bpy):
    """What is registered, against what the tool read in the code."""
    from mirror_scan.mirror_scan_addon.scene import properties

    known = {(context, text) for context, text, _ in
             runpy.run_path(str(ROOT.parent / "tools" / "messages.py"))["own_texts"]()}  # fmt: skip
    shown = [getattr(bpy.ops.mirror_scan, name).get_rna_type() for name in dir(bpy.ops.mirror_scan)]
    shown += [kind.bl_rna for name, kind in vars(properties).items() if name.startswith("MIRRORSCAN_PG_")]
    lacking = []
    for rna in shown:
        if "_OT_" in rna.identifier:  # a tooltip is one line, as it was read: Blender would show a line's indentation
            told = ("MirrorScan", rna.name), ("*", rna.description)
            lacking += [(rna.identifier, text) for text in told if text not in known]
        for prop in rna.properties:
            if not prop.is_runtime or prop.is_hidden or "_PG_progress" in rna.identifier or "preset" in rna.identifier:
                continue
            if ("MirrorScan", prop.name) not in known or (prop.description and ("*", prop.description) not in known):
                lacking.append((rna.identifier, prop.identifier))
    assert not lacking
