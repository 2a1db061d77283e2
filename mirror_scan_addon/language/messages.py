"""Core's messages in other languages: core says them in English and knows nothing of that.

A :class:`.notices.Notice` brings its template and values: the template is looked up, and the values are put into what
it is in the user's language. For a plain text, such as a file keeps or an f-string makes, they are found out first:
``messages.json`` lists the templates (``tools/messages.py`` writes it from core's code), and what was filled in is
taken out of the text again. So reports and mirrors keep English in the file, and are read in whatever language Blender
speaks later.
"""

from __future__ import annotations

import json
import re
import string
from collections.abc import Callable, Mapping
from functools import cache

from ...core.errors import Notice
from ..extension_root import ADDON_FOLDER

LIST = ADDON_FOLDER / "messages.json"


@cache
def templates() -> tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...]:
    """Each with its own words and the names between them, the one with most words first: it is the surest."""
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


def recognise(text: str) -> tuple[str, dict[str, str]] | None:
    """The template that a message was made of, and what was filled in; None for what core did not say."""
    for template, words, names in templates():
        if not (text.startswith(words[0]) and text.endswith(words[-1]) and all(word in text for word in words)):
            continue  # 500 patterns need not be compiled for one message
        found = re.fullmatch("(.*?)".join(map(re.escape, words)), text, re.DOTALL)
        if found is not None:
            return template, dict(zip(names, found.groups(), strict=True))
    return None


def translate(text: str, look_up: Callable[[str], str]) -> str:
    """A message, and those that it quotes, by what ``look_up`` makes of a template."""
    if isinstance(text, Notice) and text.values:
        return _filled(text.template, text.values, look_up)
    whole = look_up(text)
    if whole != text:
        return whole
    found = recognise(text)
    if found is None:
        name, colon, rest = text.partition(": ")  # whose message it is stands before it
        return text if not colon else f"{name}: {translate(rest, look_up)}"
    return _filled(*found, look_up)


def _filled(template: str, values: Mapping[str, str], look_up: Callable[[str], str]) -> str:
    told = look_up(template)
    values = {name: translate(value, look_up) if " " in value else value for name, value in values.items()}
    return told.format(**values)
