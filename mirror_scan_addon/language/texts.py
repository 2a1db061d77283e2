"""Translation of everything that the add-on shows: its context and its look-up."""

from __future__ import annotations

from collections.abc import Callable

import bpy

from ...core.errors import MirrorScanError
from ..extension_root import ADDON_FOLDER

CONTEXT = "MirrorScan"
"""Translation context (msgctxt) of our labels, tooltips and reports."""


def say(text: str) -> str:
    """``text`` in the user's language; the placeholders in it are filled in afterwards."""
    return bpy.app.translations.pgettext_rpt(text, CONTEXT)


def language() -> str:
    """Blender's, such as "de_DE"; "" where it has none but English."""
    return bpy.app.translations.locale


def tell(text: object) -> str:
    """An error or a warning of core in Blender's words and the user's language; other texts come back as they are."""
    if isinstance(text, MirrorScanError):
        text = text.notice
    elif not isinstance(text, str):
        text = str(text)
    from .messages import translate  # reads a list, which Blender's start must not wait for

    return without_options(translate(text, in_blender))


def in_blender(template: str) -> str:
    """One of core's templates, or a whole text, in Blender's words and the user's language."""
    from .blender_words import IN_BLENDER

    words = IN_BLENDER.get(template)
    return say(template) if words is None else words()


def as_sentence(text: str) -> str:
    """With a capital letter, if it begins with an ordinary word: names of files and mirrors stay as they are."""
    return text[:1].upper() + text[1:] if text.partition(" ")[0].isalpha() else text


def wrapped(text: str, room: float, width_of: Callable[[str], float]) -> list[str]:
    """A text as lines that are at most ``room`` wide, if their words allow it."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".lstrip()
        if lines[-1] and width_of(longer) > room:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def without_options(text: str) -> str:
    """A message of core without what it says of the command line's options and of files that only the checkout has."""
    import re

    return re.sub(r" \((?:--[a-z-]+(?:; [^)]*)?|option “[a-z_]+”)\)|; see docs/[a-z_]+\.md", "", text)


LANGUAGES = "languages"
"""Folder of the add-on with a .po file for each language, named as Blender calls it: ``de_DE.po``. English is what
the code says. ``tools/messages.py --pot`` writes what there is to translate: texts of the context ``CONTEXT``, and of
the context "*" tooltips, since Blender looks these up without one."""


def translations() -> dict[str, dict[tuple[str, str], str]]:
    """Locale → (context, English) → translation, as ``bpy.app.translations`` wants it, of all languages there are."""
    import os

    folder = os.path.join(ADDON_FOLDER, LANGUAGES)
    if not os.path.isdir(folder):
        return {}
    found = {}
    for name in sorted(os.listdir(folder)):
        locale, kind = os.path.splitext(name)
        if kind == ".po":
            with open(os.path.join(folder, name), encoding="utf-8") as file:
                found[locale] = read_translation(file.read())
    return found


def read_translation(text: str) -> dict[tuple[str, str], str]:
    """(context, English) → translation of a .po file; what is not translated, or marked as fuzzy, is left out."""
    import ast

    found = {}
    for block in text.replace("\r\n", "\n").split("\n\n"):
        parts: dict[str, str] = {}
        name = ""
        for line in block.splitlines():
            if line.startswith("#"):
                if line.startswith("#,") and "fuzzy" in line:
                    parts.clear()
                    break
                continue
            word, quote, rest = line.partition('"')
            name = word.strip() or name
            parts[name] = parts.get(name, "") + ast.literal_eval(quote + rest)
        if parts.get("msgid") and parts.get("msgstr"):
            found[parts.get("msgctxt", "*"), parts["msgid"]] = parts["msgstr"]
    return found


def register() -> None:
    bpy.app.translations.register(__name__, translations())


def unregister() -> None:
    bpy.app.translations.unregister(__name__)
