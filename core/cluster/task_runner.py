"""Many tasks over workers that Dask starts or finds: :func:`start_workers` and :class:`TaskRunner`.

What is Dask's: starting processes ("spawn"), restarting those that end or take more memory than is theirs, giving the
task of a lost worker to another, and carrying arguments and results. What is ours: as many threads a task as leave no
core with two, kernels compiled once a host before the tasks start, and results handed on as they come.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import signal
import threading
import time
import uuid
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import MirrorScanError
from ..numeric.threads import thread_count
from .code_version import program_version
from .worker_process import (
    OTHER_VERSION,
    Threads,
    WarmUp,
    get_ready,
    host_of,
    packed,
    quiet_worker,
    run_task,
    unpacked_there,
)

TASK_GB = 1.5
"""Memory that one reconstruction may need [GB]; more workers than memory has room for are not started by default."""
CONNECT_S = 30
LOOK_S, POLL_S = 1.0, 0.005
TELL_S = 5.0
"""How long no worker is there before that is told: one of our own that was lost is started again sooner."""
LOST = "the connection to the Dask scheduler was lost; start again to go on"


class ClusterError(MirrorScanError):
    """The workers cannot be had, or were lost."""


@dataclass(frozen=True)
class WorkerSettings:
    """Who does the work.

    Parameters
    ----------
    workers : int
        Processes on this machine, each with one task at a time; 0: as many as cores and memory allow.
    threads : int
        Threads a task; 0: the cores shared out to all tasks that run at the same time, at least one.
    memory_gb : float
        Memory of a worker [GB]; one that takes more is ended and started again. 0: an equal share of the machine's.
    scheduler : str
        Address of a Dask scheduler, as ``tcp://10.0.0.1:8786``, whose workers are used instead; "" for this machine.
    retries : int
        How often a task whose worker was lost is tried again. A scheduler that runs already has its own rule.
    patience_s : float
        How long to wait for workers when all are gone [s]. Own ones are started again; those of a scheduler may come
        back, or others may.
    processes : bool
        False runs the workers as threads of this process; for tests.
    log : Path or None
        File to which workers of our own print; None for nowhere.
    """

    workers: int = 0
    threads: int = 0
    memory_gb: float = 0.0
    scheduler: str = ""
    retries: int = 2
    patience_s: float = 1800.0
    processes: bool = True
    log: Path | None = None


class Outcome(NamedTuple):
    """What became of a task.

    ``number``: its place among the tasks, from 0. ``value``: what its function returned. ``error``: what it raised, or
    a :class:`ClusterError` when its workers were lost; None when all went well.
    """

    number: int
    value: Any
    error: Exception | None


@contextlib.contextmanager
def start_workers(
    settings: WorkerSettings = WorkerSettings(),
    warm_up: Callable[[], object] | None = None,
    tell: Callable[[str], None] | None = None,
) -> Iterator[TaskRunner]:
    """Start workers, or connect to a scheduler; they are ended, or left alone, when the block ends, however it ends.

    A script that calls this needs ``if __name__ == "__main__":`` around what it does: each worker imports it.

    Parameters
    ----------
    settings : WorkerSettings
    warm_up : function() or None
        A module's function, or a partial of one. Each worker calls it before its first task, one a host first and
        alone, so that kernels are compiled once a host. What it returns is dropped.
    tell : function(text) or None
        Given a sentence when all workers are gone, and when there are some again.

    Raises
    ------
    ClusterError
        Without Dask; when nobody answers at ``settings.scheduler``; when a worker cannot be started, or has another
        version of this program.
    """
    try:
        from distributed import Client
        from distributed.utils import silence_logging_cmgr
    except ImportError as error:
        raise ClusterError(
            "many captures at a time need Dask, which is not installed; install it with "
            "“pip install 'mirror_scan[cluster]'”"
        ) from error
    began = time.perf_counter()
    with contextlib.ExitStack() as stack:
        for name in ("distributed", "distributed.client"):  # what matters of it becomes an error of ours
            stack.enter_context(silence_logging_cmgr(logging.CRITICAL, name))
        if settings.scheduler:
            try:
                client = stack.enter_context(Client(settings.scheduler, timeout=CONNECT_S, set_as_default=False))
                client.wait_for_workers(1, timeout=CONNECT_S)
            except (OSError, ValueError, TypeError) as error:  # of them TimeoutError, and TLS without certificates
                raise ClusterError(
                    "{address}: no Dask scheduler with workers answers there; start “dask scheduler” and "
                    "“dask worker {address}”, or correct the address",
                    address=settings.scheduler,
                ) from error
            each = settings.threads
        else:
            count, each = _shares(settings)
            try:
                client = stack.enter_context(_local(settings, count, each))
            except (OSError, RuntimeError) as error:
                raise ClusterError(
                    "the workers could not be started: {reason}", reason=str(error) or type(error).__name__
                ) from error
        runner = TaskRunner(client, each if settings.processes else -1, warm_up, settings.patience_s, tell)
        runner.start_s = time.perf_counter() - began
        runner._prepare()
        yield runner


def _shares(settings: WorkerSettings) -> tuple[int, int]:
    """How many workers this machine gets, and how many threads each of their tasks."""
    from distributed.system import MEMORY_LIMIT

    cores = thread_count()
    count = settings.workers
    if not count:
        room = int(MEMORY_LIMIT / 1e9 / (settings.memory_gb or TASK_GB))
        count = max(1, min(cores // (settings.threads or 1), room))
    return count, settings.threads or max(1, cores // count)


@contextlib.contextmanager
def _local(settings: WorkerSettings, count: int, each: int) -> Iterator[Any]:
    """A client of a cluster of our own on this machine."""
    import dask
    from distributed import Client, LocalCluster
    from distributed.system import MEMORY_LIMIT

    memory = int(1e9 * settings.memory_gb) or MEMORY_LIMIT // count
    own = {
        "distributed.scheduler.allowed-failures": settings.retries,
        "distributed.worker.multiprocessing-method": "spawn",
        "distributed.nanny.pre-spawn-environ.NUMBA_NUM_THREADS": each,
        # Dask's has glibc give memory back at once and ask for it again: a quarter more time for a reconstruction.
        "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
        # Dask looks at what a worker is doing a hundred times a second, which costs a tenth of its time.
        "distributed.worker.profile.enabled": False,
        "distributed.admin.system-monitor.interval": "5s",
        # A worker that was large once stays so; one that pauses for that never goes on. There is nothing to spill.
        "distributed.worker.memory.pause": False,
        "distributed.worker.memory.spill": False,
        "distributed.worker.memory.target": False,
        "logging": {"distributed": "critical"},
    }
    with contextlib.ExitStack() as stack:
        with _interrupts_held():
            stack.enter_context(dask.config.set(own if settings.processes else {}))
            cluster = stack.enter_context(
                LocalCluster(
                    n_workers=count,
                    threads_per_worker=1,
                    processes=settings.processes,
                    memory_limit=memory if settings.processes else 0,
                    dashboard_address=None,
                    scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # not the same for all
                    silence_logs=logging.CRITICAL,
                )
            )
            client = stack.enter_context(Client(cluster, timeout=CONNECT_S, set_as_default=False))
            if settings.processes:
                client.register_plugin(quiet_worker(str(settings.log.absolute()) if settings.log else ""))
        yield client


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Ctrl-C or SIGTERM within the block is heard at its end: Dask leaves a half started cluster in disorder.

    Threads and processes that the block starts never hear of Ctrl-C, where the system can do that. SIGTERM they do:
    Dask ends its workers by it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    held: dict[int, Any] = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    handlers = {number: signal.signal(number, lambda number, frame: came.append(number)) for number in held}
    mask = None
    if hasattr(signal, "pthread_sigmask"):
        from multiprocessing import resource_tracker

        resource_tracker.ensure_running()  # as it starts, it would have SIGINT through again
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:  # also after an error: a worker heard it, too, and did not start
        if mask is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number, handler in handlers.items():
            signal.signal(number, held[number] if handler is None else handler)
        for number in came[:1]:
            signal.raise_signal(number)


class TaskRunner:
    """Workers that are ready; made by :func:`start_workers`.

    Attributes
    ----------
    start_s : float
        Seconds until all workers had started.
    compile_s : float
        Seconds until all had called ``warm_up``: of the compiling of kernels, or of loading them.
    """

    def __init__(
        self,
        client: Any,
        each: int,
        warm_up: Callable[[], object] | None,
        patience_s: float = WorkerSettings.patience_s,
        tell: Callable[[str], None] | None = None,
    ) -> None:
        self._patience_s, self._tell = patience_s, tell or (lambda text: None)
        self._client, self._each, self._call = client, each, unpacked_there(program_version())
        self._warm_up = None if warm_up is None else WarmUp(uuid.uuid4().hex, warm_up)
        self._known_hosts: dict[str, int] = {}
        self._hosts_at = float("-inf")
        self.start_s = self.compile_s = 0.0

    @property
    def slots(self) -> int:
        """How many tasks run at the same time; changes as workers come and go."""
        return sum(self._hosts().values())

    def run(self, function: Callable[..., Any], tasks: Iterable[tuple]) -> Generator[Outcome, None, None]:
        """``function(*arguments)`` for each of ``tasks``, handed on as they end, in no order.

        Closing the iterator, or an error within its loop, cancels what has not ended.

        Parameters
        ----------
        function : function
            Of a module, so that a worker can import it. What it returns is sent back.
        tasks : iterable of tuple
            Arguments, which can be pickled. Taken only as workers become free: it may be long, and make its items late.

        Yields
        ------
        Outcome

        Raises
        ------
        ClusterError
            When the scheduler is lost; when no worker is there for longer than ``patience_s``.
        """
        from distributed import as_completed

        waiting = enumerate(tasks)
        batch = uuid.uuid4().hex[:8]
        numbers: dict[str, int] = {}
        running: dict[str, Any] = {}
        ended = as_completed(loop=self._client.loop)
        try:
            while True:
                hosts = self._hosts()
                # One for each worker: what waited behind a task that takes all the memory would be blamed, too.
                free = max(0, max(1, sum(hosts.values())) - len(running))  # workers may have gone
                for number, arguments in itertools.islice(waiting, free):
                    future = self._client.submit(
                        self._call, packed(run_task, function, arguments, Threads(self._each, hosts), self._warm_up),
                        key=f"mirror_scan-{batch}-{number}", pure=False,
                    )  # fmt: skip
                    numbers[future.key], running[future.key] = number, future
                    ended.add(future)
                if not running:
                    return
                self._wait(ended.has_ready)
                future = next(ended)
                del running[future.key]
                yield Outcome(numbers.pop(future.key), *_result(future))
                future.release()
        finally:
            if running and self._client.status != "closed":
                self._client.cancel(list(running.values()), force=True)

    def _wait(self, is_ready: Callable[[], bool]) -> None:
        """Wait until ``is_ready()``, and tell when that cannot be because no worker is there.

        Raises
        ------
        ClusterError
            None came for so long that it is given up.
        """
        gone: float | None = None
        told = False
        while not is_ready():
            time.sleep(POLL_S)
            if self._hosts():
                if told:
                    self._tell("there are workers again")
                gone, told = None, False
                continue
            gone = time.monotonic() if gone is None else gone
            waited = time.monotonic() - gone
            if waited > self._patience_s:
                raise ClusterError(
                    "all workers are gone, and none came within {minutes:g} minutes; start workers, and the same "
                    "command goes on from here",
                    minutes=round(self._patience_s / 60, 1),
                )
            if waited > TELL_S and not told:
                minutes = self._patience_s / 60
                self._tell(f"all workers are gone; start some: they are waited for, {minutes:g} minutes at most")
                told = True

    def _hosts(self) -> dict[str, int]:
        """Host → tasks that its workers run at the same time; asked for again after a second."""
        if time.monotonic() - self._hosts_at < LOOK_S:
            return self._known_hosts
        found: dict[str, int] = {}
        for address, slots in self._workers().items():
            found[host_of(address)] = found.get(host_of(address), 0) + slots
        self._known_hosts, self._hosts_at = found, time.monotonic()
        return found

    def _workers(self) -> dict[str, int]:
        """Address of each worker → tasks that it runs at the same time."""
        try:
            return self._client.nthreads()
        except OSError as error:
            raise ClusterError(LOST) from error

    def _prepare(self) -> None:
        """Have one worker of each host compile kernels, then the others load them."""
        began = time.perf_counter()
        hosts = self._hosts()
        first: dict[str, str] = {}
        workers = self._workers()
        for address in workers:
            first.setdefault(host_of(address), address)
        others = [address for address in workers if address not in first.values()]
        for addresses in (list(first.values()), others):
            futures = [
                self._client.submit(
                    self._call, packed(get_ready, Threads(self._each, hosts), self._warm_up, False),
                    workers=[address], allow_other_workers=True, pure=False,
                )
                for address in addresses
            ]  # fmt: skip
            for future, address in zip(futures, addresses, strict=True):
                self._wait(future.done)
                _check(_result(future)[1], address)
        self.compile_s = time.perf_counter() - began


def _check(error: Exception | None, address: str) -> None:
    """Refuse a worker that cannot do our tasks, or would do them otherwise."""
    if isinstance(error, ClusterError) and isinstance(error.__cause__, ImportError):  # as _result has it
        raise ClusterError(
            "the worker {address} has another version of this program; install the same version there", address=address
        ) from error
    if isinstance(error, ImportError):
        raise ClusterError(
            "the worker {address} cannot import this program: {error}; install the same version there",
            address=address, error=error,
        ) from error  # fmt: skip
    if error is not None:
        raise error


def _result(future: Any) -> tuple[Any, Exception | None]:
    """Value and error of a task that ended, or will."""
    from concurrent.futures import CancelledError

    from distributed import KilledWorker

    try:
        return future.result(), None
    except KilledWorker as error:
        lost = ClusterError(
            "the worker was lost {count} times while it worked on this, as happens where memory is too small; use "
            "fewer workers, or give each more memory",
            count=error.allowed_failures + 1,
        )
        lost.__cause__ = error
        return None, lost
    except CancelledError as error:
        raise ClusterError(LOST) from error
    except ImportError as error:
        if error.msg != OTHER_VERSION:
            return None, error
        late = ClusterError(
            "a worker that came later has another version of this program; install the same version there"
        )
        late.__cause__ = error
        return None, late
    except Exception as error:  # the task's own; who asked for it decides
        return None, error
