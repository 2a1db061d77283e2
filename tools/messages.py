"""List what is said to people, for translators.

    python tools/messages.py                   core's messages, into mirror_scan_addon/messages.json
    python tools/messages.py --pot FILE.pot    everything, as a template for gettext's tools

Core speaks English and knows of no translation: it gives templates with values (``core/errors/notices.py``), or
f-strings, whose texts ``mirror_scan_addon/language/messages.py`` recognises by this list. What is filled in stands in
braces,
under the name it has in the code. To be run again when a text came, went or changed;
``tests/addon/language/test_texts.py`` says when.
"""

from __future__ import annotations

import argparse
import ast
import functools
import json
import re
import runpy
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIST = ROOT / "mirror_scan_addon" / "messages.json"
ELSEWHERE = ("core/cli/", "core/pipeline/inspection.py", "core/experiments")
"""What only the command line says."""

BESIDE = ("tasks/", "background/worker.py", "background/kernel_compilation.py")
"""Of the add-on, what runs in the second Python."""

CONTEXT = "MirrorScan"
"""As in ``mirror_scan_addon/language/texts.py``."""

NOT_SAID = {"compile", "execute", "debug", "print"}
"""Functions whose arguments are patterns, queries or the log's."""

without_formats = runpy.run_path(str(ROOT / "core" / "errors" / "notices.py"))["without_formats"]

SENTENCE = re.compile(r"[A-Za-z’'–-]{2,}[,;:]? +[A-Za-z“(–-]{2,}")
"""Two words: a single one is a key, a format or a file name, not a message."""

FIELD = re.compile(r"\{\w+[^{}]*\}")
"""What is filled into a template."""

LANGUAGE = re.compile(r"%s|\s*(<|\w+=\")|(SELECT|comment|element|property|format) ")
"""How texts begin that programs read: the log's, XML, a database's and PLY's."""


def sources() -> list[Path]:
    core = [path for path in sorted((ROOT / "core").rglob("*.py")) if not place(path).startswith(ELSEWHERE)]
    return core + [path for path in sorted((ROOT / "mirror_scan_addon").rglob("*.py")) if runs_beside(path)]


def place(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def runs_beside(path: Path) -> bool:
    return place(path).removeprefix("mirror_scan_addon/").startswith(BESIDE)


def messages() -> list[str]:
    """Templates for ``str.format`` in order; of those that differ in the names in braces alone the first."""
    found = {text for path in sources() for text in texts_in(path.read_text(encoding="utf-8"))}
    return sorted({skeleton(text): text for text in sorted(found, reverse=True)}.values())


def write_list(path: Path) -> int:
    """Write the list that the add-on reads; returns how long it is."""
    listed = messages()
    path.write_text(json.dumps(listed, indent=0, ensure_ascii=False) + "\n", encoding="utf-8")
    return len(listed)


def skeleton(template: str) -> str:
    """A template without the names in its braces."""
    return re.sub(r"\{\w+\}", "{}", template)


@functools.cache
def texts_in(source: str) -> frozenset[str]:
    """:func:`texts_of` a module's source; zips for several platforms ask for the same."""
    return frozenset(texts_of(ast.parse(source)))


def texts_of(tree: ast.Module) -> Iterator[str]:
    """What is written in a module as text with words in it, apart from its documentation."""
    nodes = list(ast.walk(tree))
    documentation = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    parts, stages, templates = set(), set(), set()
    for node in nodes:
        if isinstance(node, ast.Call) and is_notice(node):
            templates.add(id(node.args[0]))
        if isinstance(node, ast.Call) and called_name(node) in NOT_SAID:
            parts |= {id(inner) for argument in node.args for inner in ast.walk(argument)}
        elif isinstance(node, ast.JoinedStr):  # its constants are pieces of it, not texts
            parts |= {id(value) for value in node.values}
        elif isinstance(node, ast.Yield) and isinstance(node.value, ast.Tuple):
            stages |= {id(value) for value in node.value.elts}
        elif isinstance(node, ast.FormattedValue) and node.format_spec is not None:
            parts.add(id(node.format_spec))
    for node in nodes:
        if id(node) in documentation or id(node) in parts:
            continue
        if isinstance(node, ast.JoinedStr):
            text, words = template(node)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            text, words = node.value.replace("{", "{{").replace("}", "}}"), node.value
            if id(node) in templates:
                text, words = without_formats(node.value), FIELD.sub("\0", node.value)
        else:
            continue
        if (SENTENCE.search(words) or id(node) in stages) and not LANGUAGE.match(words):
            yield text.strip()


def called_name(call: ast.Call) -> str:
    """The last name of what is called; "" for what has none."""
    return getattr(call.func, "attr", getattr(call.func, "id", ""))


def is_notice(call: ast.Call) -> bool:
    """Whether a call makes a message of a template and values: ``Notice(…)``, or an error with values."""
    name = called_name(call)
    values = any(keyword.arg != "code" for keyword in call.keywords)
    return bool(call.args) and (name == "Notice" or (name.endswith("Error") and values))


def template(node: ast.JoinedStr) -> tuple[str, str]:
    """An f-string as a template, and its own words alone."""
    text, words, taken = "", "", []
    for value in node.values:
        if isinstance(value, ast.Constant):
            text += value.value.replace("{", "{{").replace("}", "}}")
            words += value.value
            continue
        name = name_of(value.value)
        taken.append(name)
        text += f"{{{name}{taken.count(name)}}}" if taken.count(name) > 1 else f"{{{name}}}"
        words += "\0"
    return text, words


def name_of(node: ast.expr) -> str:
    """What a translator may call the value of an expression: the last name that it ends with."""
    if isinstance(node, ast.Name):
        return node.id.strip("_")
    if isinstance(node, ast.Attribute):
        return node.attr
    if isinstance(node, ast.Subscript | ast.Starred):
        return name_of(node.value)
    if isinstance(node, ast.Call):
        inside = [name_of(item) for item in node.args]
        return next((name for name in inside if name != "value"), name_of(node.func))
    if isinstance(node, ast.BoolOp | ast.BinOp | ast.IfExp | ast.UnaryOp | ast.GeneratorExp):
        names = [name_of(child) for child in ast.iter_child_nodes(node) if isinstance(child, ast.expr)]
        return next((name for name in names if name != "value"), "value")
    return "value"


# --- the add-on's own texts ------------------------------------------------------------------------------------------


def own_texts() -> Iterator[tuple[str, str, str]]:
    """Context, text and file of what the add-on says: looked up by ``say``, on buttons and panels, and in tooltips.

    Blender looks up tooltips in no context, for which it writes "*"; an operator's name on its button in ours.
    """
    for path in sorted((ROOT / "mirror_scan_addon").rglob("*.py")):
        where = place(path)
        if runs_beside(path):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and node.name.startswith("MIRRORSCAN_OT_") and ast.get_docstring(node):
                yield "*", " ".join(ast.get_docstring(node).split()), where
            elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "bl_label":
                yield CONTEXT, node.value.value, where
            elif isinstance(node, ast.Call):
                for context, text in said_by(node):
                    yield context, text, where


def said_by(call: ast.Call) -> Iterator[tuple[str, str]]:
    """Context and text of what a call says."""
    name = ast.unparse(call.func).rpartition(".")[2]
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    if name == "say":
        yield from ((CONTEXT, text) for text in literals(call.args[0]))
    elif name.endswith("Property"):
        yield from ((CONTEXT, text) for text in literals(given.get("name")))
        yield from (("*", text) for text in literals(given.get("description")))
        items = given.get("items")
        for item in items.elts if isinstance(items, ast.Tuple) else ():
            yield from ((CONTEXT, text) for text in literals(item.elts[1]))
            yield from (("*", text) for text in literals(item.elts[2]))
    elif name == "_length":
        yield from ((CONTEXT, text) for text in literals(call.args[1]))
        yield from (("*", text) for text in literals(call.args[2]))
    elif name == "_room_length":
        yield from ((CONTEXT, text) for text in literals(call.args[0]))
        yield from (("*", text) for text in literals(call.args[1]))
    elif name == "_field" and len(call.args) == 4:
        yield from ((CONTEXT, text) for text in literals(call.args[3]))
    elif "text_ctxt" in given:
        yield from ((CONTEXT, text) for text in literals(given.get("text")))


def literals(node: ast.expr | None) -> Iterator[str]:
    if isinstance(node, ast.IfExp):
        yield from (*literals(node.body), *literals(node.orelse))
    elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value:
        yield node.value


def template_file() -> str:
    """All of it in gettext's form."""
    found: dict[tuple[str, str], list[str]] = {}
    for context, text, where in own_texts():
        found.setdefault((context, text), []).append(where)
    for text in messages():
        found.setdefault((CONTEXT, text), []).append("core")
    lines = ['msgid ""', 'msgstr ""', '"Content-Type: text/plain; charset=UTF-8\\n"']
    for (context, text), places in sorted(found.items()):
        lines += ["", *(f"#: {place}" for place in dict.fromkeys(places))]
        if "{" in text:
            lines.append("#, python-brace-format")
        lines += [f"msgctxt {quoted(context)}", f"msgid {quoted(text)}", 'msgstr ""']
    return "\n".join(lines) + "\n"


def quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pot", type=Path, metavar="FILE", help="write a template of everything there")
    options = parser.parse_args()
    if options.pot is not None:
        options.pot.write_text(template_file(), encoding="utf-8")
        return
    print(f"{write_list(LIST)} messages")


if __name__ == "__main__":
    main()
