"""The second process: what it is told, what comes back, and what happens when it dies."""

from __future__ import annotations

import os
import sys
import time

import pytest

pytest.importorskip("bpy")

ERRANDS = '''
"""Tasks for the tests; no bpy."""
import os, sys, time


def count(n):
    for k in range(n):
        yield k / n, f"Step {k}"
    return {"sum": sum(range(n)), "process": os.getpid(), "bpy": "bpy" in sys.modules}


def refuse(text):
    from mirror_scan.core.errors import CaptureError

    yield 0.0, "Reading"
    raise CaptureError(text)


def refuse_in_parts(share):
    from mirror_scan.core.errors import MirrorError
    from mirror_scan.core.errors import Notice

    yield 0.0, "Reading"
    mirror = Notice("the mirror “{name}”", name="left", mirrors=["left"])
    raise MirrorError("{mirror}: {share:.0%}", mirror=mirror, share=share)


def warn(share):
    from mirror_scan.core.errors import Notice

    yield 0.0, "Reading"
    return [Notice("{share:.0%} is seen", share=share), "a plain text"]


def damaged_cache():
    from mirror_scan.core.errors import Notice
    from mirror_scan.core.numeric import kernels

    yield 0.0, "Compiling"
    kernels.LOG.warning("%s", Notice("Compiled code in {folder} is damaged", folder="/x"))
    return "done"


def stumble():
    yield 0.0, "Dividing"
    return 1 / 0


class Unkept:
    def __reduce__(self):
        raise OSError(28, "No space left on device")


def overflow():
    yield 0.5, "Filling"
    return Unkept()


def read(path):
    yield 0.5, "Reading"
    return open(path).read()


def end(code):
    yield 0.5, "Ending"
    print("out of luck", flush=True)
    os._exit(code)


def sleep(marker):
    yield 0.5, "Sleeping"
    time.sleep(60)
    open(marker, "w").close()


def compile_something():
    import numpy as np
    from numba import njit

    yield 0.25, "Adding"
    njit(lambda x: x + 1)(np.float32(1))
    time.sleep(0.2)
    yield 0.75, "Added"
    return None
'''


@pytest.fixture
def errands(addon, tmp_path, monkeypatch):
    """The module of tasks, and no process left over before or after."""
    import importlib

    from mirror_scan.mirror_scan_addon.background import second_process

    (tmp_path / "errands_of_tests.py").write_text(ERRANDS)
    monkeypatch.syspath_prepend(str(tmp_path))
    second_process.stop()
    yield importlib.import_module("errands_of_tests")
    second_process.stop()
    sys.modules.pop("errands_of_tests", None)


def run(function, *arguments, until=lambda errand: False):
    """An errand that has ended, or of which ``until`` holds; and all it said on its way."""
    from mirror_scan.mirror_scan_addon.background.second_process import Errand

    errand = Errand(function, arguments)
    errand.start()
    said, limit = [], time.monotonic() + 60
    while errand.is_alive() and not until(errand):
        assert time.monotonic() < limit, errand.progress
        if errand.progress not in said:
            said.append(errand.progress)
        time.sleep(0.005)
    return errand, said


def test_results_come_back_and_the_process_is_kept(errands):
    errand, said = run(errands.count, 3)
    assert errand.error is None and errand.result["sum"] == 3
    assert errand.result["process"] != os.getpid() and errand.result["bpy"] is False
    assert said[0] == (0.0, "Starting")
    folder = errand._worker.folder
    again, _ = run(errands.count, 4)
    assert again.result["process"] == errand.result["process"] and again.result["sum"] == 6
    assert sorted(path.name for path in folder.iterdir()) == ["messages", "output"]  # nothing is left lying about
    from mirror_scan.mirror_scan_addon.background import second_process

    second_process.stop()
    assert not folder.exists()
    with pytest.raises(ProcessLookupError):
        os.kill(errand.result["process"], 0)


def test_what_is_wrong_with_the_cache_of_compiled_code_comes_back(errands, monkeypatch):
    from mirror_scan.mirror_scan_addon.background import numba_setup

    monkeypatch.setattr(numba_setup, "warnings", [])
    errand, _ = run(errands.damaged_cache)
    assert errand.result == "done" and errand.error is None
    assert numba_setup.warnings == ["Compiled code in /x is damaged"]
    assert numba_setup.warnings[0].values == {"folder": "/x"}


def test_errors_keep_their_kind(errands):
    from mirror_scan.core.errors import CaptureError

    errand, _ = run(errands.refuse, "x: “is” not a capture")
    assert type(errand.error) is CaptureError and str(errand.error) == "x: “is” not a capture"
    process = errand._worker.process.pid
    errand, _ = run(errands.stumble)
    assert type(errand.error) is RuntimeError and "ZeroDivisionError" in str(errand.error)
    errand, _ = run(errands.overflow)
    assert "No space left on device; make room" in str(errand.error)
    errand, _ = run(errands.read, "/no/such/file")
    assert str(errand.error) == "/no/such/file: No such file or directory"
    assert run(errands.count, 1)[0].result["process"] == process


def test_errors_and_warnings_keep_their_parts(errands):
    from mirror_scan.core.errors import MirrorError, Notice

    error = run(errands.refuse_in_parts, 0.25)[0].error
    assert type(error) is MirrorError and str(error) == "the mirror “left”: 25%"
    assert error.notice.template == "{mirror}: {share}" and error.notice.mirrors == ("left",)
    assert error.notice.values["mirror"].template == "the mirror “{name}”"
    warning, plain = run(errands.warn, 0.5)[0].result
    assert warning == "50% is seen" and warning.values == {"share": "50%"} and not isinstance(plain, Notice)


def test_a_process_that_dies_is_told_and_replaced(errands, caplog):
    from mirror_scan.core.errors import MirrorScanError

    errand, _ = run(errands.end, 7)
    assert isinstance(errand.error, MirrorScanError)
    assert "code 7" in str(errand.error) and errand.error.code == "worker"
    assert "out of luck" in caplog.text  # what it printed is for who looks for the cause
    assert not errand._worker.folder.exists()
    assert run(errands.count, 2)[0].result["sum"] == 1


def test_stopping_ends_the_work_at_once(errands, tmp_path):
    errand, _ = run(errands.sleep, str(tmp_path / "woke"), until=lambda errand: errand.progress[1] == "Sleeping")
    start = time.perf_counter()
    errand.ask_to_stop()
    assert time.perf_counter() - start < 0.5 and not errand.is_alive()
    assert errand.result is None and errand.error is None and errand._worker.process.poll() is not None
    assert not (tmp_path / "woke").exists()


def test_compiling_is_told(errands):
    _, said = run(errands.compile_something)
    words = [text for fraction, text in said if fraction == 0.25]
    assert any(text.startswith("Compiling for this computer, once: part") for text in words), said


def test_without_a_python_it_says_so(errands, monkeypatch):
    from mirror_scan.mirror_scan_addon.background.second_process import Errand, Unavailable

    with monkeypatch.context() as patch:
        patch.setattr(sys, "executable", "/missing/python")
        with pytest.raises(Unavailable):
            Errand(errands.count, (1,)).start()
    # One that cannot import numba ends before it has begun.
    monkeypatch.setattr(sys, "path", [path for path in sys.path if "site-packages" not in path])
    errand, _ = run(errands.count, 1)
    assert isinstance(errand.error, Unavailable)


def test_unregistering_ends_it(errands, addon):
    process = run(errands.count, 1)[0].result["process"]
    addon.unregister()
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
    addon.register()
