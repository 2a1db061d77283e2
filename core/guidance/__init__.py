"""Before the shutter: what to change while it can still be changed, and the burst taken by itself when all is well.

``playback`` plays a recording as if it were a camera, ``live_scene`` finds the mirrors once and looks at each frame,
``advice`` says what to do, by way of ``standing_place`` and ``posture``; ``shutter`` decides when the burst is taken,
and ``session`` puts them together.
"""

from __future__ import annotations

from .advice import Advice, Arrow
from .live_scene import LiveFrame, LiveScene, LiveSettings
from .session import LiveUpdate, guide
from .shutter import Shutter, ShutterSettings

__all__ = [
    "Advice",
    "Arrow",
    "LiveFrame",
    "LiveScene",
    "LiveSettings",
    "LiveUpdate",
    "Shutter",
    "ShutterSettings",
    "advice",
    "guide",
    "playback",
    "shutter",
]
