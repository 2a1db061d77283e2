"""The texture: the skin cut into islands and laid flat, and colours of all views painted on it."""

from __future__ import annotations

from .color_cameras import ColorView, color_views
from .refinement import refined_texture
from .texturing import TextureSettings, TextureSummary, make_texture, texture_steps

__all__ = [
    "ColorView",
    "TextureSettings",
    "TextureSummary",
    "color_views",
    "make_texture",
    "refined_texture",
    "texture_steps",
    "unwrapping",
]
