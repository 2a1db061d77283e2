"""What runs in a worker: getting ready, once a process, and one task."""

from __future__ import annotations

import contextlib
import os
import platform
import signal
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from ..numeric.threads import thread_count
from .code_version import program_version

_CORES = thread_count()
"""Of this process, before :func:`_share` says how many of them a task may use."""

OTHER_VERSION = "it has another version of this program"

_warm: set[str] = set()  # tokens of what has been called to compile kernels


class Threads(NamedTuple):
    """How many threads a task may use: ``each``, or, where that is 0, the cores of its host shared out to its slots.

    ``slots``: host → tasks that its workers run at the same time. ``each`` < 0: as many as the process would use.
    """

    each: int
    slots: Mapping[str, int]


class WarmUp(NamedTuple):
    """``function()`` compiles kernels; a process calls it once for each ``token``."""

    token: str
    function: Callable[[], object]


def unpacked_there(version: str) -> Callable[[bytes], Any]:
    """``function(packed)`` for Dask: in the worker, calls what :func:`packed` holds.

    What a worker cannot import would break its connection, over and over, if Dask unpacked it; here that is the task's
    own error. So the function is one that goes to the worker by its code, not by its name; it asks for the ``version``
    before it unpacks what another one may understand otherwise.
    """
    module, words = program_version.__module__, OTHER_VERSION

    def call(packed: bytes) -> Any:
        import importlib
        import pickle

        if importlib.import_module(module).program_version() != version:
            raise ImportError(words)
        function, arguments = pickle.loads(packed)
        return function(*arguments)

    return call


def packed(function: Callable[..., Any], *arguments: Any) -> bytes:
    """A call, as bytes."""
    import cloudpickle  # Dask brings it

    return cloudpickle.dumps((function, arguments))


def get_ready(threads: Threads, warm_up: WarmUp | None, turns: bool = True) -> None:
    """Set the number of threads and call ``warm_up``, unless this process has done so.

    ``turns``: one process of a host after the other, so that the first compiles and the others load.
    """
    _share(threads)
    if warm_up is not None and warm_up.token not in _warm:
        with _turn() if turns else contextlib.nullcontext():
            warm_up.function()
        _warm.add(warm_up.token)


def run_task(function: Callable[..., Any], arguments: tuple, threads: Threads, warm_up: WarmUp | None) -> Any:
    """One task, in a worker that may have started only now."""
    get_ready(threads, warm_up)
    return function(*arguments)


def _share(threads: Threads) -> None:
    """Have :mod:`..numeric.threads` use what is this task's."""
    if threads.each < 0:
        return
    from distributed import get_worker

    worker = get_worker()
    slots = max(threads.slots.get(host_of(worker.address), 0), worker.state.nthreads)
    os.environ["NUMBA_NUM_THREADS"] = str(threads.each or max(1, _CORES // slots))


def host_of(address: str) -> str:
    """The machine's part of an address as ``tcp://10.0.0.1:4711``."""
    return address.partition("://")[2].rpartition(":")[0]


def _turn() -> contextlib.AbstractContextManager:
    """A lock that the workers of a host share."""
    from distributed import Lock

    return Lock(f"mirror_scan kernels {platform.node()}")


def quiet_worker(log: str) -> Any:
    """A Dask plugin for workers of our own: what they print goes to a file, and Ctrl-C is left to the program.

    ``log``: the file; "" for nowhere.
    """
    from distributed import WorkerPlugin

    class QuietWorker(WorkerPlugin):
        name = "mirror_scan quiet worker"

        def setup(self, worker: Any) -> None:
            """Called in each worker as it starts, in its main thread."""
            with contextlib.suppress(ValueError):
                signal.signal(signal.SIGINT, signal.SIG_IGN)
            handle = os.open(log or os.devnull, os.O_WRONLY | os.O_APPEND | (os.O_CREAT if log else 0), 0o644)
            for stream in (1, 2):
                os.dup2(handle, stream)
            os.close(handle)

    return QuietWorker()
