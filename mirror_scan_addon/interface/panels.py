"""The “Mirror Scan” tab of the 3D viewport's sidebar: one panel that is always open, and below it the steps, folded.

The header of each step says on one line how it stands; the tooltip of a disabled button says why it is disabled
(``poll`` messages).
"""

from __future__ import annotations

import bpy

from . import panels_avatar, panels_capture, panels_check, panels_main

register, unregister = bpy.utils.register_classes_factory(
    (panels_main.MIRRORSCAN_PT_main, *panels_capture.CLASSES, *panels_avatar.CLASSES, *panels_check.CLASSES)
)
