"""Long work as a generator, with three drivers: at once for scripts, a second process for people, else a thread.

The generator yields ``(fraction, message)`` between pieces of work and returns its result. It holds arrays, never bpy
data: the user may undo, delete or switch scenes between two pieces, and other threads must not touch bpy.
"""

import threading
import time
from collections.abc import Callable
from typing import NamedTuple

# No “from __future__ import annotations”: Blender would have to compile those of each operator's when it starts.
import bpy

from ...core.errors import MirrorScanError
from ..language.texts import say, tell
from ..scene import kept_errors
from . import last_problem, numba_setup, remaining_time, second_process

TICK_S = 0.05  # how often the window reads the progress of the work
SHOW_S = 0.25  # how often at most it is redrawn: drawing is slow without a graphics card
LEAVE_S = 20.0  # how long Blender waits for a thread when the add-on is unregistered

# Core's parallel kernels may be entered by one thread at a time (numba's “workqueue” layer aborts the process
# otherwise), and a thread that was asked to stop still finishes its piece.
_kernels = threading.Lock()


class Task(NamedTuple):
    """A generator function of :mod:`..tasks` by its name, and plain arguments for it."""

    name: str
    arguments: tuple

    @property
    def function(self) -> Callable:
        from .. import tasks  # numpy, which Blender's start must not wait for

        return getattr(tasks, self.name)

    def now(self, progress: Callable[[float], None] = lambda fraction: None) -> object:
        """Its result, in this thread and process."""
        numba_setup.prepare_kernels()
        with _kernels, numba_setup.listening():
            job = self.function(*self.arguments)
            while True:
                try:
                    fraction, _ = next(job)
                except StopIteration as end:
                    return end.value
                progress(fraction)


class Thread(threading.Thread):
    """Runs a task beside the window where there is no second process; looks like a :class:`.second_process.Errand`."""

    def __init__(self, task: Task) -> None:
        super().__init__(name="Mirror Scan")
        self.progress: tuple[float, str] = (0.0, "Starting")
        self.result: object = None
        self.error: BaseException | None = None
        self._task = task
        self._stop_asked = threading.Event()

    def start(self) -> None:
        numba_setup.prepare_kernels()
        _threads[:] = [thread for thread in _threads if thread.is_alive()]
        _threads.append(self)
        super().start()

    def run(self) -> None:
        with _kernels, numba_setup.listening():
            job = self._task.function(*self._task.arguments)
            try:
                while not self._stop_asked.is_set():
                    self.progress = next(job)
                job.close()
            except StopIteration as end:
                self.result = end.value
            except BaseException as error:
                self.error = error

    def ask_to_stop(self) -> None:
        """At the end of the present piece; what it has made until then is dropped."""
        self._stop_asked.set()


_threads: list[Thread] = []  # those alive; they belong to the session, not to a file


def begin(task: Task, thread: bool = False) -> second_process.Errand | Thread:
    """Have a task done beside the window; ``thread`` says that there is no second process.

    Raises
    ------
    MirrorScanError
        When numba is missing.
    """
    if not thread:
        errand = second_process.Errand(task.function, task.arguments)
        try:
            errand.start()
            return errand
        except second_process.Unavailable:
            pass
    worker = Thread(task)
    worker.start()
    return worker


def stop_threads() -> None:
    """Ask all to stop and wait until they have; when the add-on is unregistered."""
    for thread in _threads:
        thread.ask_to_stop()
    for thread in _threads:
        thread.join(LEAVE_S)
    _threads.clear()


class JobOperator:
    """Base of operators that run a job; subclasses give :meth:`start` and :meth:`finish`.

    ``execute`` (scripts, background) runs the job to its end. ``invoke`` (a click) runs it beside the window, with
    progress in the status bar and the panel, until it is done or Esc is pressed. Only :meth:`finish` changes the file,
    so what is cancelled or fails leaves it as it was. A :class:`.errors.MirrorScanError` becomes a report; any other
    error propagates.
    """

    stop_asked = False  # by a button, see :func:`ask_to_stop`
    over = False  # its work is done: what it starts with its result need not wait for it
    _worker: second_process.Errand | Thread | None = None
    _task: Task | None = None
    _timer: bpy.types.Timer | None = None
    _scene_uid = 0
    _shown = 0.0  # when progress was drawn last
    _clock: remaining_time.Clock | None = None

    def start(self, context: bpy.types.Context) -> Task:
        """Check the input and say what to do; raises :class:`.errors.MirrorScanError`."""
        raise NotImplementedError

    def finish(self, context: bpy.types.Context, scene: bpy.types.Scene, result: object) -> None:
        """Put the result into ``scene``; raises :class:`.errors.MirrorScanError`."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        manager = context.window_manager
        manager.progress_begin(0, 100)
        try:
            result = self.start(context).now(lambda fraction: manager.progress_update(round(100 * fraction)))
            kept_errors.forget(context, self)
            self.finish(context, context.scene, result)
            self._warn()
            return {"FINISHED"}
        except REPORTED as error:
            return self.fail(error, context)
        finally:
            manager.progress_end()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return self.run(context)

    def run(self, context: bpy.types.Context) -> set[str]:
        """What ``invoke`` does once its questions are answered."""
        if bpy.app.background:
            return self.execute(context)
        try:
            self._task = self.start(context)
            self._worker = begin(self._task)
        except REPORTED as error:
            return self.fail(error, context)
        self._scene_uid = context.scene.session_uid
        self.over = self.stop_asked = False
        self._timer = context.window_manager.event_timer_add(TICK_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        progress = context.window_manager.mirror_scan
        progress.fraction, progress.message, progress.operator, progress.left = 0.0, "", type(self).bl_idname, ""
        self._shown = time.monotonic()
        self._clock = remaining_time.Clock()
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.is_cancelled_by(event):
            self.cancel(context)
            self.report({"INFO"}, say("{label}: cancelled, nothing was changed").format(label=say(self.bl_label)))
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        worker = self._worker
        if worker.is_alive():
            self._show(context)
            return {"PASS_THROUGH"}
        if isinstance(worker.error, second_process.Unavailable):
            try:
                self._worker = begin(self._task, thread=True)
                return {"PASS_THROUGH"}
            except REPORTED as error:
                self.cancel(context)
                return self.fail(error, context)
        self.cancel(context)
        if isinstance(worker.error, REPORTED):
            return self.fail(worker.error, context)
        if worker.error is not None:
            last_problem.remember(worker.error)
            raise worker.error
        return self._deliver(context, worker.result)

    def is_cancelled_by(self, event: bpy.types.Event) -> bool:
        """Whether the user wants it to end, by Esc or by the button beside the bar."""
        return self.stop_asked or (event.type == "ESC" and event.value == "PRESS")

    def cancel(self, context: bpy.types.Context) -> None:
        """Stop the job and clear its traces from the window; Blender calls this too, when it loads another file."""
        if self._worker is not None:
            self._worker.ask_to_stop()
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
        self._worker = self._timer = self._task = None
        context.window_manager.mirror_scan.operator = ""  # a bar that is over is not drawn again
        show_status(context, None)
        redraw(context)

    def fail(self, error: Exception, context: bpy.types.Context) -> set[str]:
        """Report an error, keep it for the panel, and return what ``execute`` shall return."""
        self.report({"ERROR"}, kept_errors.keep(context, self, error))
        return {"CANCELLED"}

    def _deliver(self, context: bpy.types.Context, result: object) -> set[str]:
        scene = next((scene for scene in bpy.data.scenes if scene.session_uid == self._scene_uid), None)
        if scene is None:
            self.report({"ERROR"}, say("The scene this was started in is gone; nothing was changed"))
            return {"CANCELLED"}
        kept_errors.forget(context, self)  # before, so that what ``finish`` keeps stays
        if scene == context.scene and context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")  # Blender gives nothing that is edited another mesh
        self.over = True
        try:
            self.finish(context, scene, result)
        except REPORTED as error:
            return self.fail(error, context)
        self._warn()
        return {"FINISHED"}

    def _warn(self) -> None:
        while numba_setup.warnings:
            self.report({"WARNING"}, tell(numba_setup.warnings.pop(0)))

    def _show(self, context: bpy.types.Context) -> None:
        if time.monotonic() - self._shown < SHOW_S:
            return
        self._shown = time.monotonic()
        fraction, message = self._worker.progress
        progress = context.window_manager.mirror_scan
        if (progress.fraction, progress.message) == (fraction, message):
            return
        progress.fraction, progress.message = fraction, message
        progress.left = self._clock.left(fraction)
        label, stage = say(self.bl_label), say(message)
        show_status(context, say("{label}: {stage}  {done:.0%}  {left}    [Esc] Cancel").format(
            label=label, stage=stage, done=fraction, left=progress.left))  # fmt: skip
        redraw(context, panels_only=True)


def in_words(error: Exception) -> str:
    """One of :data:`REPORTED` in the user's language; it is kept for a report of a problem."""
    last_problem.remember(error)
    if isinstance(error, MemoryError):
        return say("Not enough memory; close other programs or use fewer frames")
    if isinstance(error, OSError) and error.filename and error.strerror:
        return say("{path}: {reason}").format(path=error.filename, reason=error.strerror)
    return tell(error)


class FileJobOperator(JobOperator):
    """Base of operators that run a job about a file, ``filepath``; a click without one opens the file browser."""

    _asked = False  # by a click, not by a script

    def proposal(self, context: bpy.types.Context) -> str:
        """What the file browser begins with."""
        return ""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self._asked = True
        if self.filepath:
            return self.run(context)
        self.filepath = self.proposal(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        # The file browser calls this when a file was chosen; people's work goes on beside the window then too.
        if self._asked and not bpy.app.background and self._worker is None:
            return self.run(context)
        return super().execute(context)


UNAVAILABLE = second_process.Unavailable
"""There is no second process; :func:`begin` with ``thread``."""

REPORTED = (MirrorScanError, MemoryError, OSError)
"""What is reported in a line; everything else is a fault of ours and propagates."""


def _ours(window: bpy.types.Window) -> list[bpy.types.Operator]:
    """The modal operators of this add-on in a window."""
    return [
        operator
        for operator in window.modal_operators
        # None is left of one that was disabled meanwhile; ids have Blender's form, not that of our class names
        if operator is not None
        and operator.bl_idname.startswith("MIRROR_SCAN_OT_")
        and not getattr(operator, "over", False)
    ]


def running(context: bpy.types.Context, name: str = "") -> bool:
    """Whether a modal operator of this add-on, or the one of that ``name``, is under way in any window."""
    wanted = name.replace("mirror_scan.", "MIRROR_SCAN_OT_")
    found = (operator for window in context.window_manager.windows for operator in _ours(window))
    return any(not name or operator.bl_idname == wanted for operator in found)


def ask_to_stop(context: bpy.types.Context) -> None:
    """Have the jobs in all windows end at their next tick, as by Esc."""
    for window in context.window_manager.windows:
        for operator in _ours(window):
            if isinstance(operator, JobOperator):
                operator.stop_asked = True


def cancel_all(context: bpy.types.Context) -> None:
    """Cancel what is under way in any window; Blender drops the operators of an add-on that goes without a word."""
    manager = getattr(context, "window_manager", None)
    for window in manager.windows if manager is not None else ():
        for operator in _ours(window):
            with context.temp_override(window=window):
                getattr(operator, "leave", operator.cancel)(context)


def show_status(context: bpy.types.Context, text: str | None) -> None:
    """Write into the status bar of every workspace; None clears it.

    A text would belong to one workspace, and stay there when another is shown by the time the work is over.
    """
    if context.workspace is not None:
        context.workspace.status_text_set(None if text is None else _status_drawn(text))


def _status_drawn(text: str) -> Callable[[bpy.types.Header, bpy.types.Context], None]:
    """What draws the status bar as Blender does, with a text in place of what keys do."""

    def draw(header: bpy.types.Header, context: bpy.types.Context) -> None:  # Blender takes nothing but a function
        layout = header.layout
        layout.label(text=text, translate=False)
        layout.separator_spacer()
        layout.template_reports_banner()
        layout.template_running_jobs()
        layout.separator_spacer()
        layout.template_status_info()

    return draw


def redraw(context: bpy.types.Context, panels_only: bool = False) -> None:
    """Have every 3D viewport, and with it our panels, drawn again; or the panels only, since points take their time."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI" or not panels_only:
                        region.tag_redraw()


def register() -> None:
    """Nothing to add; :func:`unregister` waits for what is under way."""


def unregister() -> None:
    stop_threads()
