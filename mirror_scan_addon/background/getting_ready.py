"""Kernels compiled before anything is asked for: from when the tab is first drawn, at low priority, with a line there.

Never in ``register()`` and never without a window: nothing starts for somebody who does not look at the tab.
"""

from __future__ import annotations

import bpy

from ..language.texts import say
from . import job_operators, remaining_time, second_process

STAGE = "build"
FIRST_S, TURN_S = 0.5, 1.0  # after the tab was drawn; between two looks at how far it is

_asked: list[bool] = []  # once in a session


def tab_shown() -> None:
    """Called by the tab whenever it is drawn; the first time it has the compiling begin."""
    if not _asked and not bpy.app.background:
        _asked.append(True)
        bpy.app.timers.register(_begin, first_interval=FIRST_S)


def stop() -> None:
    """End the processes that compile; what is needed is then compiled when it is called."""
    second_process.stop_compiling()
    _say("")


def _begin() -> float | None:
    seconds = second_process.compile_ahead(STAGE)
    if seconds is None:
        _say("")  # what a file brought along
        second_process.warm_up(STAGE)
        return None
    _say(remaining_time.in_words(seconds))
    clock = remaining_time.Clock()

    def turn() -> float | None:
        share = second_process.compiled_share()
        if share is None:
            _say("")
            return None
        _say(clock.left(share) or remaining_time.in_words(seconds))
        return TURN_S

    bpy.app.timers.register(turn, first_interval=TURN_S)
    return None


def _say(left: str) -> None:
    """What the tab shows: ``left`` is the time left in words, "" when there is nothing to wait for."""
    shown = getattr(bpy.context.window_manager, "mirror_scan", None)
    text = say("Getting ready, once: {left}").format(left=left) if left else ""
    if shown is not None and shown.getting_ready != text:
        shown.getting_ready = text
        job_operators.redraw(bpy.context, panels_only=True)


class MIRRORSCAN_OT_stop_getting_ready(bpy.types.Operator):
    """Stop getting ready. The first capture then takes longer"""

    bl_idname = "mirror_scan.stop_getting_ready"
    bl_label = "Stop Getting Ready"
    bl_translation_context = "MirrorScan"
    bl_options = {"INTERNAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        stop()
        return {"FINISHED"}


def register() -> None:
    bpy.utils.register_class(MIRRORSCAN_OT_stop_getting_ready)


def unregister() -> None:
    if bpy.app.timers.is_registered(_begin):
        bpy.app.timers.unregister(_begin)
    _asked.clear()
    bpy.utils.unregister_class(MIRRORSCAN_OT_stop_getting_ready)
