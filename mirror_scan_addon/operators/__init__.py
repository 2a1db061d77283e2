"""Operators, one a file."""

from __future__ import annotations

import bpy

from .build_avatar import MIRRORSCAN_OT_build_avatar

register, unregister = bpy.utils.register_classes_factory((MIRRORSCAN_OT_build_avatar,))
