"""Translates core's messages, which are in English.

A :class:`.notices.Notice` has a template and values: the template is translated, and the values are filled in. For a
plain text, from a file or an f-string, template and values are recognised first: ``messages.json`` lists the templates
(``tools/messages.py`` writes it from core's code), and the values are taken from the text. So reports and mirrors are
kept in English in the file, and shown in the language that Blender has when they are read.
"""

from __future__ import annotations

import json
import re
import string
from collections.abc import Callable, Mapping
from functools import cache, lru_cache

from ...core.errors import Notice
from ..extension_root import ADDON_FOLDER

LIST = ADDON_FOLDER / "messages.json"


@cache
def templates() -> tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...]:
    """Each with its words and the names between them, the most words first: these are recognised most reliably."""
    listed = []
    for template in json.loads(LIST.read_text(encoding="utf-8")):
        words, names = [""], []
        for literal, name, *_ in string.Formatter().parse(template):
            words[-1] += literal
            if name is not None:
                names.append(name)
                words.append("")
        listed.append((template, tuple(words), tuple(names)))
    return tuple(sorted(listed, key=lambda entry: -sum(map(len, entry[1]))))


@lru_cache(maxsize=256)  # a panel asks again with every redraw
def recognise(text: str) -> tuple[str, dict[str, str]] | None:
    """The template that a message was made of, and what was filled in; None for a text that is not core's."""
    for template, words, names in templates():
        if not (text.startswith(words[0]) and text.endswith(words[-1]) and all(word in text for word in words)):
            continue  # 500 patterns need not be compiled for one message
        found = re.fullmatch("(.*?)".join(map(re.escape, words)), text, re.DOTALL)
        if found is not None:
            return template, dict(zip(names, found.groups(), strict=True))
    return None


def translate(text: str, look_up: Callable[[str], str]) -> str:
    """A message, and those quoted in it, translated; ``look_up`` translates a template."""
    if isinstance(text, Notice) and text.values:
        return _filled(text.template, text.values, look_up)
    whole = look_up(text)
    if whole != text:
        return whole
    found = recognise(text)
    if found is None:
        name, colon, rest = text.partition(": ")  # the name in front says whose message it is
        return text if not colon else f"{name}: {translate(rest, look_up)}"
    return _filled(*found, look_up)


def _filled(template: str, values: Mapping[str, str], look_up: Callable[[str], str]) -> str:
    translated = look_up(template)
    values = {name: translate(value, look_up) if " " in value else value for name, value in values.items()}
    return translated.format(**values)
