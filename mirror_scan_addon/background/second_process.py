"""Long work in a second process of Blender's Python, so that the window never waits.

It waits neither for numba to be imported, nor for kernels to be compiled (a thread would not help, since compiling
holds Python's lock), nor for the work itself.

The process (:mod:`.worker`) is kept for the next task and ends with Blender, with the add-on, or when a task is
cancelled. Until everything is compiled, a few more of them do that in the background (:mod:`.kernel_compilation`), and
a task first helps with the part that it needs.
"""

from __future__ import annotations

import atexit
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path

import bpy

from ...core import errors
from ...core.errors import Notice
from ..extension_root import ADDON_FOLDER, ROOT_FOLDER, ROOT_PACKAGE
from ..language.texts import say
from . import kernel_compilation, numba_setup

_START = "import runpy, sys; runpy.run_path(sys.argv[1], run_name='mirror_scan_worker')['main']()"
_MESSAGE_TAIL = 2000  # characters of a dead worker's output that are shown

_idle: list[Worker] = []  # at most one; a process is of this session, not of the file
_helpers: dict[str, list[Worker]] = {}  # those that compile in the background, by the last stage of their way
_claims: list[str] = []  # the folder by which processes agree who compiles what, once there is one
HELPERS = 3  # processes at most that compile in the background
COMPILING_SHARE = 0.9  # of the time of a task that first waits for its kernels: a minute before a few seconds


class Unavailable(Exception):
    """No second Python can be had here."""


class Worker:
    """The process, and the private folder through which it talks.

    Files, since neither Windows' pipes nor Python 3.11 can be read there without waiting.
    """

    def __init__(self, patient: bool = False) -> None:
        """``patient``: the processor is left to others when they need it."""
        if not sys.executable or not os.path.isfile(sys.executable):
            raise Unavailable("this Blender has no Python program of its own")
        import shutil  # 10 to 50 ms together, which Blender's start must not wait for
        import subprocess
        import tempfile

        self.folder = Path(tempfile.mkdtemp(prefix="mirror_scan_worker_"))
        environment = dict(os.environ)
        if cache := numba_setup.cache_folder():
            environment["NUMBA_CACHE_DIR"] = cache
        flags = 0
        if sys.platform == "win32":
            flags = subprocess.CREATE_NO_WINDOW
            if patient:  # elsewhere the process itself does it, by os.nice
                flags |= subprocess.BELOW_NORMAL_PRIORITY_CLASS
        script = ADDON_FOLDER / "background" / "worker.py"
        try:
            with open(self.folder / "output", "wb") as output:
                self.process = subprocess.Popen(
                    [sys.executable, *bpy.app.python_args, "-c", _START, str(script)],
                    stdin=subprocess.PIPE, stdout=output, stderr=subprocess.STDOUT,
                    cwd=self.folder, env=environment, creationflags=flags,
                )  # fmt: skip
            (self.folder / "messages").touch()
            self._messages = open(self.folder / "messages", "rb")
            self._rest = b""
            self._tasks = 0
            self.ready = False  # has imported what it needs
            self.warming = False  # loads what is compiled, until a task comes
            self.share = 0.0  # of what a helper compiles that is done, by whomever
            self._tell(
                package=ROOT_PACKAGE, root=str(ROOT_FOLDER), folder=str(self.folder), path=[p for p in sys.path if p]
            )
        except OSError as error:
            shutil.rmtree(self.folder, ignore_errors=True)
            raise Unavailable(str(error)) from error

    def begin(self, function: Callable, arguments: tuple, last: bool = False) -> None:
        """Hand over a task: a generator function that a Python without bpy can import, arguments that pickle.

        After the ``last`` one the process ends.
        """
        import pickle

        self._tasks += 1
        with open(self.folder / f"arguments{self._tasks}", "wb") as file:
            pickle.dump(arguments, file, protocol=5)
        self._tell(
            module=function.__module__, function=function.__qualname__,
            arguments=f"arguments{self._tasks}", result=f"result{self._tasks}", last=last,
        )  # fmt: skip

    def heard(self) -> list[dict]:
        """Messages since the last call; never waits."""
        *lines, self._rest = (self._rest + self._messages.read()).split(b"\n")
        return [json.loads(line) for line in lines]

    def result(self) -> object:
        """What the last task returned."""
        import pickle

        path = self.folder / f"result{self._tasks}"
        with open(path, "rb") as file:
            value = pickle.load(file)
        path.unlink()
        return value

    def alive(self) -> bool:
        return self.process.poll() is None

    def output(self) -> str:
        """The end of what the process printed."""
        return (self.folder / "output").read_text(encoding="utf-8", errors="replace")[-_MESSAGE_TAIL:].strip()

    def close(self) -> None:
        """End the process, even in the middle of a task, and remove its folder."""
        import shutil

        self.process.kill()
        self.process.wait()
        self.process.stdin.close()
        self._messages.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _tell(self, **message: object) -> None:
        self.process.stdin.write(json.dumps(message).encode() + b"\n")
        self.process.stdin.flush()


class Errand:
    """A task that runs in the second process; it has the same interface as a thread that runs it.

    ``progress`` is the fraction done and a message; ``result`` or ``error`` is set when it has ended.

    Parameters
    ----------
    function : callable
        Generator function at the top of a module that needs no bpy; it yields ``(fraction, message)``.
    arguments : tuple
        These, and what the function returns, must pickle.
    """

    def __init__(self, function: Callable, arguments: tuple) -> None:
        self.progress: tuple[float, str] = (0.0, "Starting")
        self.result: object = None
        self.error: BaseException | None = None
        self._function, self._arguments = function, arguments
        self._worker: Worker | None = None
        self._warms = False  # the process still loads what it was told to when the tab was shown
        self._compiles = False  # before the task itself
        self._compiling_share = 0.0  # of the whole
        self._ended = False

    def start(self) -> None:
        """Hand the task over.

        Raises
        ------
        Unavailable
            There is no second Python here.
        """
        self._worker = _take()
        self._warms = self._worker.warming
        if not self._warms:
            self._begin()

    def _begin(self) -> None:
        """Hand the task over, or first what is to be compiled for it."""
        stage = kernel_compilation.STAGE_OF.get(self._function.__name__)
        share = _share_compiling(stage) if stage else None
        if share is None:
            self._worker.begin(self._function, self._arguments)
        else:
            self._compiles, self._compiling_share = True, COMPILING_SHARE
            self._worker.begin(kernel_compilation.compile_steps, (share[0], stage, share[1]))

    def is_alive(self) -> bool:
        """Whether it goes on; never waits. ``progress``, ``result`` and ``error`` are brought up to date."""
        if self._ended:
            return False
        running = self._worker.alive()  # asked first: what it said before its end is then heard below
        for message in self._worker.heard():
            self._hear(message)
        if not self._ended and not running:
            self._end(error=self._obituary())
        return not self._ended

    def ask_to_stop(self) -> None:
        """Stop at once; nothing comes of it."""
        if not self._ended:
            self._ended = True
            self._worker.close()
            if self._compiles and _claims:
                kernel_compilation.give_up(_claims[0], self._worker.process.pid)

    def _whole(self, fraction: float) -> float:
        """The fraction done of compiling and task together, so that one bar goes over both."""
        if self._compiles:
            return self._compiling_share * fraction
        return self._compiling_share + (1.0 - self._compiling_share) * fraction

    def _hear(self, message: dict) -> None:
        if "ready" in message:
            self._worker.ready = True
        elif self._warms and "unable" not in message:
            self._hear_of_warming(message)
        elif "fraction" in message:
            text = numba_setup.compiling_text() if self._compiles else message["message"]
            self.progress = self._whole(message["fraction"]), text
        elif "warning" in message:
            numba_setup.warnings.append(Notice.of_parts(message["warning"]))
        elif "compiling" in message:
            if not self._compiles:  # what the list of kernels lacks
                text = say("{compiling}: part {number}")
                text = text.format(compiling=numba_setup.compiling_text(), number=message["compiling"])
                self.progress = self.progress[0], text
        elif "done" in message and self._compiles:
            self._compiles = False
            self._worker.result()
            self._worker.begin(self._function, self._arguments)
        elif "done" in message:
            self._end(result=self._worker.result())
        elif "error" in message:
            kind = getattr(errors, message["error"], errors.MirrorScanError)
            self._end(error=kind(Notice.of_parts(message["notice"]), code=message["code"]))
        elif "fault" in message:
            self._end(error=RuntimeError(f"Mirror Scan's second process failed:\n{message['fault']}"))
        elif "unable" in message:
            self._end(error=Unavailable(message["unable"]))

    def _hear_of_warming(self, message: dict) -> None:
        """The task begins when that is over; what went wrong with it goes wrong again where it matters."""
        self.progress = 0.0, "Loading the program"
        if "warning" in message:
            numba_setup.warnings.append(Notice.of_parts(message["warning"]))
        if "done" in message or "error" in message or "fault" in message:
            self._warms = self._worker.warming = False
            if "done" in message:
                self._worker.result()
            try:
                self._begin()
            except Unavailable as error:
                self._end(error=error)

    def _end(self, result: object = None, error: Exception | None = None) -> None:
        self.result, self.error, self._ended = result, error, True
        if self._worker.ready and self._worker.alive() and not _idle:
            _idle.append(self._worker)
        else:
            self._worker.close()

    def _obituary(self) -> Exception:
        code, said = self._worker.process.returncode, self._worker.output()
        if code == -9:  # killed from outside, so that what was printed then is not the reason
            said = ""
        if not self._worker.ready:
            return Unavailable(f"{sys.executable} ended with code {code}: {said}")
        if said:
            import logging

            logging.getLogger(__name__).warning("%s", said)  # for who looks for the cause; it tells a user nothing
        text = say(
            "The work was ended from outside (code {code}); if you did not do that, memory ran out: close other "
            "programs, or use fewer frames"
        )
        return errors.MirrorScanError(text.format(code=code), code="worker")


def _take() -> Worker:
    """The process that waits, or a new one."""
    while _idle:
        worker = _idle.pop()
        if worker.alive():
            return worker
        worker.close()
    return Worker()


def compile_ahead(stage: str) -> float | None:
    """Have what a stage calls compiled in the background, so that it need not wait for it.

    Returns
    -------
    float or None
        About how many seconds that takes; None where there is no second Python, or nothing is left to compile.
    """
    try:
        if _share_compiling(stage) is None:
            return None
    except Unavailable:
        return None  # then a thread compiles what the work calls, when it does
    last = kernel_compilation.last_of(stage)
    wanted = kernel_compilation.needs(last)
    whole = sum(entry.seconds for entry in kernel_compilation.entries() if entry.stage in wanted)
    return whole / max(len(_helpers[last]), 1)


def compiled_share() -> float | None:
    """How much of what is compiled in the background is done; None when nothing is under way."""
    shares = []
    for helpers in _helpers.values():
        for helper in helpers:
            running = helper.alive()  # asked first: what it said before its end is then heard below
            for message in helper.heard():
                helper.share = message.get("fraction", helper.share)
            if running:
                shares.append(helper.share)
    return max(shares, default=None)


def stop_compiling() -> None:
    """End the processes that compile in the background; a task that waits for them goes on by itself."""
    for helpers in _helpers.values():
        for helper in helpers:
            helper.close()
            if _claims:
                kernel_compilation.give_up(_claims[0], helper.process.pid)
    _helpers.clear()


def warm_up(stage: str) -> None:
    """Start the process that does the work, and have it load what a stage calls, so that the first task need not wait
    for either; nothing is loaded that would have to be compiled."""
    if _idle:
        return
    try:
        worker = Worker()
    except Unavailable:
        return  # a task then says so, or a thread does it
    _idle.append(worker)
    folder = numba_setup.cache_folder()
    last = kernel_compilation.last_of(stage)
    if folder and os.path.exists(os.path.join(folder, kernel_compilation.stamp_name(last))):
        worker.begin(kernel_compilation.loading_steps, (stage,))
        worker.warming = True


def _share_compiling(stage: str) -> tuple[str, str] | None:
    """Folder of claims and stamp for :func:`.kernel_compilation.compile_steps`; None when everything is compiled
    already.

    The first call for a way starts the processes that compile it in the background.
    """
    folder = numba_setup.cache_folder()
    if not folder:  # somebody else's cache: what is in it cannot be known
        return None
    last = kernel_compilation.last_of(stage)
    stamp = os.path.join(folder, kernel_compilation.stamp_name(last))
    if os.path.exists(stamp):
        _end_helpers(last)
        return None
    if not _claims:
        import tempfile

        _claims.append(tempfile.mkdtemp(prefix="mirror_scan_claims_"))
    if last not in _helpers:
        _helpers[last] = []
        # one core is the task's that is begun now
        for _ in range(max(1, min(HELPERS, (os.cpu_count() or 2) - 1))):
            helper = Worker(patient=True)
            helper.begin(kernel_compilation.compile_steps, (_claims[0], last, stamp, True), last=True)
            _helpers[last].append(helper)
    return _claims[0], stamp


def _end_helpers(last: str) -> None:
    """End those of one way; with the last of all, the folder by which they agreed goes too."""
    for helper in _helpers.pop(last, ()):
        helper.close()
    if not _helpers:
        import shutil

        while _claims:
            shutil.rmtree(_claims.pop(), ignore_errors=True)


def stop() -> None:
    """End the processes: the one that waits for the next task, and those that compile."""
    while _idle:
        _idle.pop().close()
    for last in (*_helpers, ""):  # the folder too, when there are none any more
        _end_helpers(last)


def register() -> None:
    atexit.register(stop)


def unregister() -> None:
    atexit.unregister(stop)
    stop()
