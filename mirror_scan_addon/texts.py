"""Texts for people: the translation context of everything this add-on says, and its look-up."""

from __future__ import annotations

import bpy

CONTEXT = "MirrorScan"
"""Translation context (msgctxt) of our labels, tooltips and reports."""


def say(text: str) -> str:
    """``text`` in the user's language; the placeholders in it are filled in afterwards."""
    return bpy.app.translations.pgettext_rpt(text, CONTEXT)


def language() -> str:
    """Blender's, such as "de_DE"; "" where it has none but English."""
    return bpy.app.translations.locale


def tell(text: object) -> str:
    """An error or a warning of core in the user's language; other texts come back as they are."""
    text = str(text)
    if language() in ("", "en_US"):
        return text
    from .messages import translate  # reads a list, which Blender's start must not wait for

    return translate(text, say)


TRANSLATIONS: dict[str, dict[tuple[str, str], str]] = {}
"""Locale → (context, English) → translation, as ``bpy.app.translations`` wants it; English is what the code says. The
context is ``CONTEXT``, of tooltips "*": Blender looks these up without one."""


def register() -> None:
    bpy.app.translations.register(__name__, TRANSLATIONS)


def unregister() -> None:
    bpy.app.translations.unregister(__name__)
