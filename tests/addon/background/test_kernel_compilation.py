"""Kernels compiled beforehand: shared out among processes, each once, and the list of them true."""

from __future__ import annotations

import importlib
import inspect
from pathlib import Path

import pytest

pytest.importorskip("bpy")


@pytest.fixture
def shared(monkeypatch):
    """The module, with a list of six kernels that are only counted."""
    from mirror_scan.mirror_scan_addon.background import kernel_compilation

    made = []
    listed = tuple(
        kernel_compilation.Entry(stage, "core.none", f"kernel_{k}", [], 1.0 + k)
        for k, stage in enumerate(("load", "load", "mirrors", "subject", "build", "build"))
    )
    monkeypatch.setattr(kernel_compilation, "entries", lambda: listed)
    monkeypatch.setattr(kernel_compilation, "_compile", lambda entry: made.append(entry.kernel))
    return kernel_compilation, made


def test_processes_share_the_list_and_wait_for_each_other(shared, tmp_path):
    compiling, made = shared
    claims, stamp = tmp_path / "claims", tmp_path / "stamp"
    claims.mkdir()
    helper = compiling.compile_steps(str(claims), "build", str(stamp))
    errand = compiling.compile_steps(str(claims), "mirrors", str(stamp))
    shares, ended = [], []
    running = [helper, errand]
    while running:
        for job in tuple(running):
            try:
                shares.append((job is helper, next(job)[0]))
            except StopIteration as end:
                ended.append((job is helper, end.value))
                running.remove(job)
    assert sorted(made) == [f"kernel_{k}" for k in range(6)]  # each once
    assert ended[0][0] is False and dict(ended)[True] + dict(ended)[False] == 6
    for which in (True, False):
        mine = [share for who, share in shares if who is which]
        assert mine == sorted(mine) and mine[0] < mine[-1] <= 1.0
    assert stamp.exists()


def test_what_an_ended_process_had_claimed_is_done_by_another(shared, tmp_path, monkeypatch):
    compiling, made = shared
    stopped = compiling.compile_steps(str(tmp_path), "load")
    next(stopped)
    (tmp_path / "claimed_1").write_text("4711")
    compiling.give_up(str(tmp_path), 4711)
    assert not (tmp_path / "claimed_1").exists()
    (tmp_path / "claimed_0").write_text("4712")  # and one of which nobody says that it ended
    monkeypatch.setattr(compiling, "LOST_S", 0.2)
    assert list(compiling.compile_steps(str(tmp_path), "load")) and sorted(made) == ["kernel_0", "kernel_1"]


def test_an_errand_compiles_what_it_needs_first(addon, tmp_path, monkeypatch):
    from mirror_scan.mirror_scan_addon.background import kernel_compilation, numba_setup, second_process

    begun = []

    class Worker:
        warming = False

        def __init__(self, patient=False):
            self.process, self.patient = type("Process", (), {"pid": 0}), patient
            self.said, self.ready = [], True

        def begin(self, function, arguments, last=False):
            begun.append((function.__name__, arguments, last))

        def heard(self):
            said, self.said = self.said, []
            return said

        def result(self):
            return "result"

        def alive(self):
            return True

        def close(self):
            pass

    second_process.stop()
    monkeypatch.setattr(second_process, "Worker", Worker)
    monkeypatch.setattr(numba_setup, "cache_folder", lambda: str(tmp_path))
    try:

        def load_steps():
            yield

        errand = second_process.Errand(load_steps, ("capture",))
        errand.start()
        *helpers, own = begun
        assert helpers and all(name == "compile_steps" and last for name, _, last in helpers)
        assert own[0] == "compile_steps" and own[1][1] == "load" and not own[2]
        claims = Path(own[1][0])
        assert claims.is_dir() and all(arguments[0] == str(claims) for _, arguments, _ in helpers)
        errand._worker.said = [{"fraction": 0.5, "message": "x"}, {"compiling": 3}]
        half = second_process.COMPILING_SHARE * 0.5  # the bar goes over the task as well
        assert errand.is_alive() and errand.progress == (half, "Compiling for this computer, once")
        errand._worker.said = [{"done": True}]
        assert errand.is_alive() and begun[-1] == ("load_steps", ("capture",), False)
        errand._worker.said = [{"done": True}]
        assert not errand.is_alive() and errand.result == "result"
        (tmp_path / kernel_compilation.stamp_name()).touch()  # all is compiled: nothing comes before the task any more
        again = second_process.Errand(load_steps, ("capture",))
        again.start()
        assert begun[-1][0] == "load_steps" and not claims.exists()
    finally:
        second_process.stop()


def test_what_does_not_fit_a_kernel_any_more_is_passed_over(caplog):
    from mirror_scan.mirror_scan_addon.background import kernel_compilation

    entry = kernel_compilation.entries()[0]
    for types in (entry.types[:-1], ["float32"] * len(entry.types)):
        kernel_compilation._compile(entry._replace(types=types))
        assert f"{entry.kernel}: not compiled beforehand" in caplog.text
        caplog.clear()
    for name in ({"kernel": "was_renamed"}, {"module": "core.was_removed"}):
        kernel_compilation._compile(entry._replace(**name))
        assert "not compiled beforehand" in caplog.text
        caplog.clear()


def test_ways_beside_the_main_one_are_their_own():
    from mirror_scan.mirror_scan_addon.background import kernel_compilation
    from mirror_scan.mirror_scan_addon.background.kernel_compilation import AVATAR, RIG, last_of, needs, stamp_name

    assert needs("subject") == ("load", "mirrors", "subject")
    assert needs(RIG) == ("load", RIG) and needs(AVATAR) == (AVATAR,)
    assert [last_of(stage) for stage in ("load", RIG, AVATAR)] == ["build", RIG, AVATAR]
    assert len({stamp_name(), stamp_name(RIG), stamp_name(AVATAR)}) == 3
    assert set(kernel_compilation.STAGE_OF.values()) == {*kernel_compilation.STAGES, RIG, AVATAR}


def test_the_list_names_kernels_and_types_that_are_there():
    from mirror_scan.mirror_scan_addon.background import kernel_compilation

    listed = kernel_compilation.entries()
    stages = (*kernel_compilation.STAGES, *kernel_compilation.SIDE_WAYS)
    assert set(kernel_compilation.STAGES) <= {entry.stage for entry in listed} <= set(stages) and len(listed) > 50
    assert [stages.index(entry.stage) for entry in listed] == sorted(stages.index(entry.stage) for entry in listed)
    missing = 0
    for entry in listed:
        try:
            kernel = getattr(importlib.import_module(f"mirror_scan.{entry.module}"), entry.kernel, None)
        except ModuleNotFoundError:
            kernel = None
        missing += kernel is None or len(inspect.signature(kernel.py_func).parameters) != len(entry.types)
        for described in entry.types:
            assert kernel_compilation.describe(kernel_compilation._type(described)) == described
    # The list may lag behind a little: what it lacks is compiled when it is called. Run tools/signatures.py.
    assert missing <= len(listed) // 10


def test_the_list_is_what_a_build_calls(bpy, loaded):
    from mirror_scan.mirror_scan_addon.background import kernel_compilation

    assert bpy.ops.mirror_scan.find_mirrors() == {"FINISHED"}
    assert bpy.ops.mirror_scan.build_avatar() == {"FINISHED"}
    way = [entry for entry in kernel_compilation.entries() if entry.stage in kernel_compilation.STAGES]
    listed = {(entry.module, entry.kernel) for entry in way}
    called = {
        (module, kernel)
        for module, kernel, types in kernel_compilation.called("mirror_scan")
        if "simulation" not in module and not any("Literal" in str(kind) for kind in types)
    }
    # tests that ran before may have called a few kernels of which no build knows
    assert len(listed & called) > 0.9 * len(listed), sorted(listed - called)
