"""List the messages that core may say, for translators: mirror_scan_addon/messages.json.

    python tools/messages.py

Core speaks English and knows of no translation; ``mirror_scan_addon/messages.py`` recognises what it said by this list.
What is filled in stands in braces, under the name it has in the code. To be run again when a text came, went or
changed; ``tests/addon/test_texts.py`` says when.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIST = ROOT / "mirror_scan_addon" / "messages.json"
ELSEWHERE = ("core/cli/", "core/inspection.py", "core/experiments")
"""What only the command line says."""

BESIDE = ("tasks.py", "worker.py", "compiling.py")
"""Of the add-on, what runs in the second Python."""

NOT_SAID = {"compile", "execute", "debug", "print"}
"""Functions whose arguments are patterns, queries or the log's."""

SENTENCE = re.compile(r"[A-Za-z’'–-]{2,}[,;:]? +[A-Za-z“(–-]{2,}")
"""Two words: a single one is a key, a format or a file name, not a message."""

LANGUAGE = re.compile(r"%s|(SELECT|comment|element|property|format) ")
"""How texts begin that programs read: the log's, a database's and PLY's."""


def sources() -> list[Path]:
    paths = [*sorted((ROOT / "core").rglob("*.py")), *(ROOT / "mirror_scan_addon" / name for name in BESIDE)]
    return [path for path in paths if not path.relative_to(ROOT).as_posix().startswith(ELSEWHERE)]


def messages() -> list[str]:
    """Templates for ``str.format`` in order; of those that differ in the names in braces alone the first."""
    found = {text for path in sources() for text in texts_of(ast.parse(path.read_text(encoding="utf-8")))}
    return sorted({skeleton(text): text for text in sorted(found, reverse=True)}.values())


def skeleton(template: str) -> str:
    """A template without the names in its braces."""
    return re.sub(r"\{\w+\}", "{}", template)


def texts_of(tree: ast.Module) -> Iterator[str]:
    """What is written in a module as text with words in it, apart from its documentation."""
    documentation = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    parts, stages = set(), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func).rpartition(".")[2] in NOT_SAID:
            parts |= {id(inner) for argument in node.args for inner in ast.walk(argument)}
        elif isinstance(node, ast.JoinedStr):  # its constants are pieces of it, not texts
            parts |= {id(value) for value in node.values}
        elif isinstance(node, ast.Yield) and isinstance(node.value, ast.Tuple):
            stages |= {id(value) for value in node.value.elts}
        elif isinstance(node, ast.FormattedValue) and node.format_spec is not None:
            parts.add(id(node.format_spec))
    for node in ast.walk(tree):
        if id(node) in documentation or id(node) in parts:
            continue
        if isinstance(node, ast.JoinedStr):
            text, words = template(node)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            text, words = node.value.replace("{", "{{").replace("}", "}}"), node.value
        else:
            continue
        if (SENTENCE.search(words) or id(node) in stages) and not LANGUAGE.match(words):
            yield text.strip()


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


def main() -> None:
    listed = messages()
    LIST.write_text(json.dumps(listed, indent=0, ensure_ascii=False) + "\n", encoding="utf-8")
    print(f"{len(listed)} messages")


if __name__ == "__main__":
    main()
