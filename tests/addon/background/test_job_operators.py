"""The drivers of long work: at once, beside the window, and what the window sees of it."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

pytest.importorskip("bpy")


class Window:
    """What the modal driver uses of a context, recorded."""

    def __init__(self, bpy):
        self.status, self.timers, self.handlers = [], 0, 0
        self.scene = bpy.context.scene
        self.window, self.mode = None, "OBJECT"
        self.workspace = SimpleNamespace(status_text_set=self.tell)
        self.window_manager = SimpleNamespace(
            windows=[], mirror_scan=SimpleNamespace(fraction=0.0, message="", operator=""),
            event_timer_add=self.add, event_timer_remove=self.remove, modal_handler_add=self.handle,
        )  # fmt: skip

    def tell(self, draws):
        """What draws the status bar of all workspaces; a text would be that of one."""
        if draws is not None:
            layout = Mock()
            draws(SimpleNamespace(layout=layout), None)
            draws = layout.label.call_args.kwargs["text"]
        self.status.append(draws)

    def add(self, step, window):
        self.timers += 1
        return object()

    def remove(self, timer):
        self.timers -= 1

    def handle(self, operator):
        self.handlers += 1


class Worker:
    """Work beside the window that goes on when the test says so."""

    def __init__(self):
        self.progress, self.result, self.error = (0.0, "Starting"), None, None
        self.alive, self.stopped = True, False

    def is_alive(self):
        return self.alive

    def ask_to_stop(self):
        self.stopped = True

    def end(self, result=None, error=None):
        self.result, self.error, self.alive = result, error, False


@pytest.fixture
def job(bpy, monkeypatch):
    """A running modal job, its window, and the workers that were begun (``True`` for threads)."""
    from mirror_scan.mirror_scan_addon.background import job_operators

    class Operator(job_operators.JobOperator):
        bl_idname, bl_label = "mirror_scan.build_avatar", "Build"

        def __init__(self):
            self.reports, self.results = [], []

        def report(self, kind, text):
            self.reports.append((kind.copy().pop(), text))

        def start(self, context):
            return job_operators.Task("build_steps", ())

        def finish(self, context, scene, result):
            self.results.append((scene.name, result))

    begun = []

    def begin(task, thread=False):
        worker = Worker()
        begun.append((worker, thread))
        return worker

    monkeypatch.setattr(job_operators, "begin", begin)
    monkeypatch.setattr(job_operators, "SHOW_S", 0.0)
    operator, window = Operator(), Window(bpy)
    app = SimpleNamespace(background=False, translations=bpy.app.translations)
    fake = SimpleNamespace(app=app, ops=bpy.ops, data=bpy.data, types=bpy.types)
    monkeypatch.setattr(job_operators, "bpy", fake)
    assert operator.invoke(window, None) == {"RUNNING_MODAL"} and window.timers == window.handlers == 1
    return SimpleNamespace(operator=operator, window=window, begun=begun, worker=begun[0][0])


TIMER, ESC, MOUSE = (SimpleNamespace(type=kind, value="PRESS") for kind in ("TIMER", "ESC", "MOUSEMOVE"))


def clean(job) -> bool:
    return job.window.timers == 0 and job.window.status[-1] is None


def test_progress_is_shown_then_the_result_is_delivered(job):
    operator, window = job.operator, job.window
    assert operator.modal(window, MOUSE) == {"PASS_THROUGH"}
    for turn in range(3):
        job.worker.progress = (turn / 4, f"Stage {turn}")
        assert operator.modal(window, TIMER) == {"PASS_THROUGH"}
        assert window.window_manager.mirror_scan.message == f"Stage {turn}"
        assert "Esc" in window.status[-1] and f"Stage {turn}" in window.status[-1]
    job.worker.end("done")
    assert operator.modal(window, TIMER) == {"FINISHED"}
    assert operator.results == [("Scene", "done")] and clean(job)


def test_what_is_wrong_with_the_cache_of_compiled_code_is_reported_once(job, monkeypatch):
    from mirror_scan.core.errors import Notice
    from mirror_scan.core.numeric import kernels
    from mirror_scan.mirror_scan_addon.background import numba_setup

    monkeypatch.setattr(numba_setup, "warnings", [])
    with numba_setup.listening():
        kernels.LOG.warning("%s", Notice("Compiled code in {folder} is damaged", folder="/x"))
    assert not kernels.LOG.handlers
    job.worker.end("done")
    assert job.operator.modal(job.window, TIMER) == {"FINISHED"}
    assert job.operator.reports == [("WARNING", "Compiled code in /x is damaged")] and not numba_setup.warnings


def test_a_quick_job_is_not_slowed_by_drawing_its_progress(job, monkeypatch):
    from mirror_scan.mirror_scan_addon.background import job_operators

    monkeypatch.setattr(job_operators, "SHOW_S", 60.0)
    for turn in range(3):
        job.worker.progress = (turn / 4, f"Stage {turn}")
        job.operator.modal(job.window, TIMER)
    assert job.window.status == []


def test_escape_stops_it_and_changes_nothing(job):
    assert job.operator.modal(job.window, ESC) == {"CANCELLED"}
    assert job.worker.stopped and job.operator.results == [] and clean(job)
    assert job.operator.reports[-1][0] == "INFO"


def test_the_button_beside_the_bar_does_as_escape(job):
    from mirror_scan.mirror_scan_addon.background import job_operators

    job.operator.bl_idname = "MIRROR_SCAN_OT_build_avatar"
    windows = [SimpleNamespace(modal_operators=[]), SimpleNamespace(modal_operators=[None, job.operator])]
    job_operators.ask_to_stop(SimpleNamespace(window_manager=SimpleNamespace(windows=windows)))
    assert job.operator.modal(job.window, TIMER) == {"CANCELLED"}
    assert job.worker.stopped and job.operator.results == [] and clean(job)


@pytest.mark.parametrize("error", [MemoryError(), OSError("disk gone"), None])
def test_what_fails_is_a_line(job, error):
    from mirror_scan.core.errors import ReconstructionError

    job.worker.end(error=error or ReconstructionError("nobody there"))
    assert job.operator.modal(job.window, TIMER) == {"CANCELLED"}
    ((kind, text),) = job.operator.reports
    assert kind == "ERROR" and text and job.operator.results == [] and clean(job)


def test_a_fault_of_ours_is_shown_as_one(job):
    job.worker.end(error=ZeroDivisionError("ours"))
    with pytest.raises(ZeroDivisionError):
        job.operator.modal(job.window, TIMER)
    assert clean(job)


def test_without_a_second_process_a_thread_takes_over(job):
    from mirror_scan.mirror_scan_addon.background import second_process

    job.worker.end(error=second_process.Unavailable("no Python"))
    assert job.operator.modal(job.window, TIMER) == {"PASS_THROUGH"}
    assert [thread for _, thread in job.begun] == [False, True] and job.window.timers == 1
    job.begun[1][0].end("done")
    assert job.operator.modal(job.window, TIMER) == {"FINISHED"}
    assert job.operator.results == [("Scene", "done")] and clean(job)


def test_a_renamed_scene_gets_its_result_a_removed_one_is_told(job, bpy):
    job.window.scene.name = "Renamed"
    job.worker.end("done")
    assert job.operator.modal(job.window, TIMER) == {"FINISHED"}
    assert job.operator.results == [("Renamed", "done")]
    assert job.operator.invoke(job.window, None) == {"RUNNING_MODAL"}
    bpy.data.scenes.remove(bpy.data.scenes["Renamed"]) if len(bpy.data.scenes) > 1 else None
    job.operator._scene_uid = -1
    job.begun[-1][0].end("done")
    assert job.operator.modal(job.window, TIMER) == {"CANCELLED"}
    assert "gone" in job.operator.reports[-1][1] and len(job.operator.results) == 1


def test_a_result_finds_object_mode(job, bpy):
    """Else Blender would keep the old mesh of what is edited, without a word."""
    mesh = bpy.data.objects.new("m", bpy.data.meshes.new("m"))
    bpy.context.collection.objects.link(mesh)
    bpy.context.view_layer.objects.active = mesh
    bpy.ops.object.mode_set(mode="EDIT")
    job.window.mode = bpy.context.mode
    job.worker.end("done")
    assert job.operator.modal(job.window, TIMER) == {"FINISHED"}
    assert bpy.context.mode == "OBJECT" and job.operator.results


def test_what_a_result_starts_is_not_told_that_we_are_busy(job):
    """A burst that was taken becomes an avatar while the operator that took it is still in the window's list."""
    from mirror_scan.mirror_scan_addon.background import job_operators

    job.operator.bl_idname = "MIRROR_SCAN_OT_live_view"
    job.window.window_manager.windows = [
        SimpleNamespace(modal_operators=[job.operator], screen=SimpleNamespace(areas=[]))
    ]
    assert job_operators.running(job.window)
    busy = []
    job.operator.finish = lambda *given: busy.append(job_operators.running(job.window))
    job.worker.end("done")
    assert job.operator.modal(job.window, TIMER) == {"FINISHED"} and busy == [False]


def test_a_thread_does_one_task_after_the_other_and_stops_when_asked(addon, monkeypatch):
    from mirror_scan.core.errors import CaptureError
    from mirror_scan.mirror_scan_addon import tasks
    from mirror_scan.mirror_scan_addon.background import job_operators

    entered, go = threading.Event(), threading.Event()

    def endless(log):
        log.append("begun")
        try:
            while True:
                yield 0.5, "Waiting"
                entered.set()
                go.wait(5)
        finally:
            log.append("closed")

    def refuse(log):
        log.append("second")
        yield 0.0, "Reading"
        raise CaptureError("no")

    monkeypatch.setattr(tasks, "endless", endless, raising=False)
    monkeypatch.setattr(tasks, "refuse", refuse, raising=False)
    log: list[str] = []
    first = job_operators.begin(job_operators.Task("endless", (log,)), thread=True)
    assert entered.wait(5)
    second = job_operators.begin(job_operators.Task("refuse", (log,)), thread=True)
    first.ask_to_stop()
    go.set()
    first.join(5)
    second.join(5)
    assert log == ["begun", "closed", "second"] and not first.is_alive() and not second.is_alive()
    assert first.result is None and first.error is None and first.progress == (0.5, "Waiting")
    assert isinstance(second.error, CaptureError)
    job_operators.stop_threads()
    assert job_operators._threads == []
