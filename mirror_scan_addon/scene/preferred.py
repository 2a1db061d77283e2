"""What the user's preferences say; the values they begin with where the add-on runs without preferences, as a module.

The class that Blender shows is in :mod:`..interface.preferences`.
"""

from __future__ import annotations

import bpy

from ..extension_root import ROOT_PACKAGE

DEFAULTS = {"sensor": "azure_kinect", "export_folder": "", "texture_size": "2048", "on_drop": "ASK"}
"""Preference → what it is until the user changes it."""


def preferred(name: str) -> str:
    """The value of a preference, one of :data:`DEFAULTS`."""
    addon = bpy.context.preferences.addons.get(ROOT_PACKAGE)
    held = None if addon is None else addon.preferences
    return DEFAULTS[name] if held is None else getattr(held, name)


def drop_makes(what: str) -> bool:
    """Whether a capture that is dropped may become "AVATAR", or "LOOK": points to look at; both, and Blender asks."""
    return preferred("on_drop") in ("ASK", what)


def begin_with_preferences(settings: bpy.types.PropertyGroup) -> None:
    """Have a scene's settings that nobody has set yet begin as the user prefers; ``settings`` of the scene."""
    if not settings.look.is_property_set("texture_size"):
        settings.look.texture_size = preferred("texture_size")
