"""Compiling ahead: when it begins, what is said meanwhile, how it is stopped; and how time left is told."""

from __future__ import annotations

import os
from types import SimpleNamespace

import pytest

pytest.importorskip("bpy")


@pytest.fixture
def window(bpy, addon, monkeypatch):
    """Blender as with a window: its timers are kept in a list and called by hand."""
    from mirror_scan.mirror_scan_addon.background import getting_ready

    timers: list = []
    app = SimpleNamespace(
        background=False,
        timers=SimpleNamespace(register=lambda turn, first_interval=0.0: timers.append(turn)),
        translations=bpy.app.translations,
    )
    monkeypatch.setattr(getting_ready, "bpy", SimpleNamespace(app=app, context=bpy.context))
    monkeypatch.setattr(getting_ready, "_asked", [])
    yield SimpleNamespace(timers=timers, app=app, module=getting_ready, shown=bpy.context.window_manager.mirror_scan)
    bpy.context.window_manager.mirror_scan.getting_ready = ""


def test_nothing_begins_without_a_window_and_once_with_one(window):
    window.app.background = True
    window.module.tab_shown()
    assert window.timers == []
    window.app.background = False
    for _ in range(5):  # every redraw
        window.module.tab_shown()
    assert len(window.timers) == 1


def test_the_tab_says_how_long_it_takes_until_it_is_done(window, monkeypatch):
    from mirror_scan.mirror_scan_addon.background import second_process

    shares = [0.0, 0.5, None]
    monkeypatch.setattr(second_process, "compile_ahead", lambda stage: 58.0)
    monkeypatch.setattr(second_process, "compiled_share", lambda: shares.pop(0))
    window.module.tab_shown()
    assert window.timers.pop()() is None
    assert window.shown.getting_ready == "Getting ready, once: about 60 s left"
    turn = window.timers.pop()
    assert turn() and turn() and "left" in window.shown.getting_ready
    assert turn() is None and window.shown.getting_ready == ""


def test_where_all_is_compiled_only_the_process_starts(window, monkeypatch):
    from mirror_scan.mirror_scan_addon.background import second_process

    warm: list = []
    monkeypatch.setattr(second_process, "compile_ahead", lambda stage: None)
    monkeypatch.setattr(second_process, "warm_up", warm.append)
    window.module.tab_shown()
    assert window.timers.pop()() is None and warm == ["build"] and window.shown.getting_ready == ""


def test_it_can_be_stopped_and_what_was_claimed_is_free_again(bpy, addon, monkeypatch, tmp_path):
    from mirror_scan.mirror_scan_addon.background import kernel_compilation, second_process

    class Helper:
        share, closed = 0.4, False
        process = SimpleNamespace(pid=os.getpid())

        def alive(self):
            return not self.closed

        def heard(self):
            return [{"fraction": 0.6, "message": "Compiling"}]

        def close(self):
            self.closed = True

    helper = Helper()
    monkeypatch.setattr(second_process, "_helpers", {"build": [helper]})
    monkeypatch.setattr(second_process, "_claims", [str(tmp_path)])
    assert kernel_compilation._claim(str(tmp_path), 7) and not kernel_compilation._claim(str(tmp_path), 7)
    assert second_process.compiled_share() == 0.6
    assert bpy.ops.mirror_scan.stop_getting_ready() == {"FINISHED"}
    assert helper.closed and second_process.compiled_share() is None
    assert kernel_compilation._claim(str(tmp_path), 7)  # a task compiles it itself


def test_time_left_follows_from_the_time_spent_and_the_share(addon):
    from mirror_scan.mirror_scan_addon.background import remaining_time

    now = [100.0]
    clock = remaining_time.Clock(lambda: now[0])
    assert clock.left(0.0) == "" and clock.seconds(0.5) is None  # too early to say
    now[0] = 110.0
    assert clock.seconds(0.01) is None and clock.seconds(0.25) == pytest.approx(30.0)
    now[0] = 120.0
    assert clock.seconds(0.5) == pytest.approx(20.0) and clock.left(0.5) == "about 20 s left"
    now[0] = 140.0
    assert clock.seconds(1.0) == 0.0
    said = [remaining_time.in_words(seconds) for seconds in (0.2, 4.4, 12.0, 61.0, 260.0)]
    assert said == [f"about {text} left" for text in ("1 s", "4 s", "10 s", "60 s", "4 min")]


def test_one_bar_goes_over_compiling_and_the_task(addon):
    from mirror_scan.mirror_scan_addon.background import second_process

    errand = second_process.Errand(len, ())
    errand._compiles, errand._compiling_share = True, 0.9
    fractions = [errand._whole(share) for share in (0.0, 0.5, 1.0)]
    errand._compiles = False
    fractions += [errand._whole(share) for share in (0.0, 0.5, 1.0)]
    assert fractions == pytest.approx([0.0, 0.45, 0.9, 0.9, 0.95, 1.0])
    errand._compiling_share = 0.0  # nothing was left to compile
    assert errand._whole(0.3) == pytest.approx(0.3)


def test_a_task_waits_until_the_process_has_loaded_what_it_needs(addon, monkeypatch):
    from mirror_scan.mirror_scan_addon.background import kernel_compilation, numba_setup, second_process

    class Worker:
        ready, warming = True, True

        def __init__(self):
            self.begun, self.said, self.results = [], [], ["loaded", "result"]

        def begin(self, function, arguments, last=False):
            self.begun.append(function.__name__)

        def heard(self):
            said, self.said = self.said, []
            return said

        def result(self):
            return self.results.pop(0)

        def alive(self):
            return True

        def close(self):
            pass

    def measure_steps():
        yield

    monkeypatch.setattr(numba_setup, "cache_folder", lambda: "")
    for ending in ({"done": True}, {"fault": "a damaged cache"}):
        worker = Worker()
        worker.results = worker.results[len(ending.get("fault", "")) > 0 :]
        monkeypatch.setattr(second_process, "_idle", [worker])
        errand = second_process.Errand(measure_steps, ())
        errand.start()
        worker.said = [{"fraction": 0.3, "message": "x"}]
        assert errand.is_alive() and worker.begun == [] and errand.progress == (0.0, "Loading the program")
        worker.said = [ending]
        assert errand.is_alive() and worker.begun == ["measure_steps"] and not worker.warming
        worker.said = [{"fraction": 0.5, "message": "Measuring"}]
        assert errand.is_alive() and errand.progress == (0.5, "Measuring")
        worker.said = [{"done": True}]
        assert not errand.is_alive() and errand.result == "result" and errand.error is None
    steps = list(kernel_compilation.loading_steps("load"))
    assert steps and all(0 <= share < 1 for share, _ in steps)
