"""Tasks over Dask's workers: all of them done, errors told apart, threads shared out, lost workers made up for."""

from __future__ import annotations

import importlib.util
import operator
import os
import signal
import subprocess
import sys
import time
import types
from dataclasses import replace
from pathlib import Path

import pytest
from mirror_scan.core.cluster import (
    ClusterError,
    WorkerSettings,
    code_version,
    program_version,
    start_workers,
    task_runner,
)

pytest.importorskip("distributed", reason="Dask is not installed")

IN_PROCESS = WorkerSettings(workers=2, processes=False)
calls: list[str] = []


def note_call() -> None:
    calls.append("warm up")


def test_every_task_is_done_once_and_an_error_stays_its_own(monkeypatch):
    calls.clear()
    taken = []

    def tasks():
        for k in range(-5, 6):
            taken.append(k)
            yield 60, k

    with start_workers(IN_PROCESS, note_call) as runner:
        assert runner.slots == 2 and runner.start_s > 0
        outcomes = runner.run(operator.floordiv, tasks())
        first = next(outcomes)
        assert len(taken) <= 4, "tasks are taken as workers become free, not all at once"
        found = {one.number: one for one in (first, *outcomes)}
    assert calls == ["warm up"]
    assert sorted(found) == list(range(11))
    for number, k in enumerate(range(-5, 6)):
        if k:
            assert found[number].value == 60 // k and found[number].error is None
        else:
            assert isinstance(found[number].error, ZeroDivisionError)


def test_what_is_left_is_cancelled_when_nobody_asks_any_more():
    began = time.monotonic()
    with start_workers(IN_PROCESS) as runner:
        outcomes = runner.run(time.sleep, ((0.2,) for _ in range(1000)))
        next(outcomes)
        outcomes.close()
        assert [one.value for one in runner.run(operator.neg, [(3,)])] == [-3]
    assert time.monotonic() - began < 60


def test_workers_may_go_while_tasks_run(monkeypatch):
    with start_workers(IN_PROCESS) as runner:
        outcomes = runner.run(operator.neg, [(k,) for k in range(6)])
        found = [next(outcomes)]
        monkeypatch.setattr(runner, "_hosts", dict)  # none is there for the moment
        found += outcomes
    assert sorted(one.value for one in found) == [-5, -4, -3, -2, -1, 0]


def test_it_is_told_when_all_workers_are_gone_and_given_up_in_the_end(monkeypatch):
    monkeypatch.setattr(task_runner, "TELL_S", 0.0)
    said = []
    with start_workers(replace(IN_PROCESS, patience_s=60.0), tell=said.append) as runner:
        real = runner._hosts
        monkeypatch.setattr(runner, "_hosts", lambda: real() if said else {})
        assert [one.number for one in runner.run(time.sleep, [(0.5,)])] == [0]
        assert [text.partition(";")[0] for text in said] == ["all workers are gone", "there are workers again"]
        monkeypatch.setattr(runner, "_hosts", dict)
        monkeypatch.setattr(runner, "_patience_s", 0.1)
        with pytest.raises(ClusterError, match="all workers are gone, and none came within"):
            list(runner.run(time.sleep, [(1.0,)]))


def test_nobody_at_the_address_is_one_line(monkeypatch):
    monkeypatch.setattr("mirror_scan.core.cluster.task_runner.CONNECT_S", 1)
    with (
        pytest.raises(ClusterError, match="127.0.0.1:9: no Dask scheduler"),
        start_workers(WorkerSettings(scheduler="tcp://127.0.0.1:9")),
    ):
        pass  # pragma: no cover


def test_another_version_is_refused_whenever_it_comes(monkeypatch):
    with start_workers(IN_PROCESS) as runner:
        monkeypatch.setattr(code_version, "program_version", lambda: "another")
        (late,) = runner.run(operator.neg, [(1,)])
        assert isinstance(late.error, ClusterError) and "came later has another version" in str(late.error)
    with pytest.raises(ClusterError, match="inproc.* has another version"), start_workers(IN_PROCESS):
        pass  # pragma: no cover


def test_a_lost_scheduler_is_one_line(monkeypatch):
    with start_workers(IN_PROCESS) as runner:

        def lost():
            raise ConnectionError("Timed out trying to connect")

        monkeypatch.setattr(runner._client, "nthreads", lost)
        monkeypatch.setattr(runner, "_hosts_at", float("-inf"))
        with pytest.raises(ClusterError, match="scheduler was lost"):
            next(runner.run(operator.neg, [(1,)]))


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ClusterError, match=r"mirror_scan\[cluster\]"), start_workers():
        pass  # pragma: no cover


def test_importing_brings_neither_dask_nor_numba():
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parents[2])!r}); import conftest\n"
        "sys.modules['numba'] = sys.modules['dask'] = sys.modules['distributed'] = None\n"
        "import mirror_scan.core.cluster"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_version_is_that_of_the_code():
    assert len(program_version()) == 16 and program_version() == program_version()


@pytest.mark.slow
def test_processes_share_the_threads_and_lost_ones_are_made_up_for(tmp_path, capfd, monkeypatch):
    import dask.config

    if importlib.util.find_spec("mirror_scan").loader is None:
        pytest.skip("mirror_scan is not installed, so that workers cannot import it")
    monkeypatch.setenv("NUMBA_NUM_THREADS", "6")  # taken for the cores of the machine
    log = tmp_path / "workers of Zoë.log"
    with start_workers(WorkerSettings(workers=2, retries=1, log=log)) as runner:
        assert [one.value for one in runner.run(os.getenv, [("NUMBA_NUM_THREADS",)])] == ["3"]
        assert [one.value for one in runner.run(dask.config.get, [("distributed.worker.memory.pause",)])] == [False]
        list(runner.run(os.write, [(2, b"noise of a worker")]))
        victim = next(runner.run(os.getpid, [()])).value
        outcomes = runner.run(time.sleep, [(0.4,)] * 6)
        found = [next(outcomes)]
        os.kill(victim, signal.SIGKILL)
        found += outcomes
        assert sorted(one.number for one in found) == list(range(6)) and not any(one.error for one in found)
        ghost = types.ModuleType("ghost")
        exec("def answer(): pass", ghost.__dict__)
        monkeypatch.setitem(sys.modules, "ghost", ghost)
        (unknown,) = runner.run(ghost.answer, [()])
        assert isinstance(unknown.error, ModuleNotFoundError), "a worker that lacks a module says so"
        (ended,) = runner.run(os._exit, [(9,)])
        assert isinstance(ended.error, ClusterError) and "lost 2 times" in str(ended.error)
    assert victim != os.getpid()
    assert log.read_text() == "noise of a worker"
    assert capfd.readouterr() == ("", "")
