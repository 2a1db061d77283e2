"""Long work as a generator, with two drivers: blocking for scripts, a modal timer for people.

The generator yields ``(fraction, message)`` between pieces of work and returns its result. It holds arrays, never bpy
data: the user may undo, delete or switch scenes between two pieces.
"""

from __future__ import annotations

import time
from collections.abc import Generator

import bpy

from ..core.errors import MirrorScanError

Job = Generator[tuple[float, str], None, object]

TICK_S = 0.05  # how often a job gets its turn, and how long it goes on beginning new pieces then


class JobOperator:
    """Base of operators that run a job; subclasses give :meth:`start` and :meth:`finish`.

    ``execute`` (scripts, background) runs the job to its end. ``invoke`` (a click) runs it piece by piece, with
    progress in the status bar and the panel, until it is done or Esc is pressed. Only :meth:`finish` changes the file,
    so what is cancelled or fails leaves it as it was. A :class:`MirrorScanError` becomes a report; any other error
    propagates.
    """

    _job: Job | None = None
    _timer: bpy.types.Timer | None = None
    _scene_name = ""

    def start(self, context: bpy.types.Context) -> Job:
        """Check the input and return the job; raises :class:`MirrorScanError`."""
        raise NotImplementedError

    def finish(self, context: bpy.types.Context, scene: bpy.types.Scene, result: object) -> None:
        """Put the result into ``scene``; raises :class:`MirrorScanError`."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        manager = context.window_manager
        manager.progress_begin(0, 100)
        try:
            job = self.start(context)
            while True:
                try:
                    fraction, _ = next(job)
                except StopIteration as end:
                    self.finish(context, context.scene, end.value)
                    return {"FINISHED"}
                manager.progress_update(round(100 * fraction))
        except MirrorScanError as error:
            return self._fail(error)
        finally:
            manager.progress_end()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.app.background:
            return self.execute(context)
        try:
            self._job = self.start(context)
        except MirrorScanError as error:
            return self._fail(error)
        self._scene_name = context.scene.name
        self._timer = context.window_manager.event_timer_add(TICK_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        self._show(context, 0.0, "Starting")
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            self.report({"INFO"}, f"{self.bl_label}: cancelled, nothing was changed")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            deadline = time.perf_counter() + TICK_S
            while time.perf_counter() < deadline:
                fraction, message = next(self._job)
            self._show(context, fraction, message)
            return {"PASS_THROUGH"}
        except StopIteration as end:
            self.cancel(context)
            return self._deliver(context, end.value)
        except MirrorScanError as error:
            self.cancel(context)
            return self._fail(error)
        except BaseException:
            self.cancel(context)
            raise

    def cancel(self, context: bpy.types.Context) -> None:
        """Stop the job and clear its traces from the window; Blender calls this too, when it loads another file."""
        if self._job is not None:
            self._job.close()
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
        self._job = self._timer = None
        context.workspace.status_text_set(None)
        redraw(context)

    def _deliver(self, context: bpy.types.Context, result: object) -> set[str]:
        scene = bpy.data.scenes.get(self._scene_name)
        if scene is None:
            self.report({"ERROR"}, f"The scene “{self._scene_name}” was removed or renamed meanwhile; build again")
            return {"CANCELLED"}
        try:
            self.finish(context, scene, result)
        except MirrorScanError as error:
            return self._fail(error)
        return {"FINISHED"}

    def _fail(self, error: MirrorScanError) -> set[str]:
        self.report({"ERROR"}, str(error))
        return {"CANCELLED"}

    def _show(self, context: bpy.types.Context, fraction: float, message: str) -> None:
        progress = context.window_manager.mirror_scan
        progress.fraction, progress.message = fraction, message
        context.workspace.status_text_set(f"{self.bl_label}: {message}  {fraction:.0%}    [Esc] Cancel")
        redraw(context)


def running(context: bpy.types.Context) -> bool:
    """Whether a modal operator of this add-on is under way in any window."""
    return any(
        operator.bl_idname.startswith("MIRROR_SCAN_OT_")  # Blender's form of “mirror_scan.…”, not our class names
        for window in context.window_manager.windows
        for operator in window.modal_operators
    )


def redraw(context: bpy.types.Context) -> None:
    """Have every 3D viewport, and with it our panels, drawn again."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
