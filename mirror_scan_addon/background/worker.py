"""The second Python, in which long work is done: it takes one task after the other and says how far it is.

Started by :mod:`.second_process` as a script of Blender's own Python, it is no part of Blender and never imports bpy.
Its standard input gives one JSON object a line; the first describes the place, each other one is a task. What it has to
say goes, one JSON object a line, into the file ``messages``; results are pickled into files of their own. It ends with
its input, so that it never outlives Blender for longer than its task.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import logging
import os
import pickle
import sys
import traceback
import types
from collections.abc import Callable, Iterator
from pathlib import Path


def main() -> None:
    place = json.loads(sys.stdin.readline())
    folder = Path(place["folder"])
    # A process of its own: this is what Blender's Python finds its packages by, our wheels among them.
    sys.path[:] = place["path"]
    with open(folder / "messages", "a", encoding="utf-8", buffering=1) as messages:

        def say(**message: object) -> None:
            messages.write(json.dumps(message) + "\n")

        try:
            _make_package(place["package"], place["root"])
            importlib.import_module(place["package"] + ".core.io.images").openimageio()
            _tell_compilations(say)
            _tell_warnings(say, place["package"])
        except Exception:
            say(unable=traceback.format_exc())
            return
        say(ready=True)
        for line in sys.stdin:
            task = json.loads(line)
            _do(task, place["package"], folder, say)
            if task["last"]:
                return


def _make_package(package: str, root: str) -> None:
    """Have the extension importable under the name it has in Blender: numba's cache and pickle go by that."""
    *parents, _ = package.split(".")
    for depth in range(1, len(parents) + 1):
        parent = types.ModuleType(".".join(parents[:depth]))
        parent.__path__ = []
        sys.modules[parent.__name__] = parent
    spec = importlib.util.spec_from_file_location(
        package, os.path.join(root, "__init__.py"), submodule_search_locations=[root]
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules[package] = module
    spec.loader.exec_module(module)


def _tell_compilations(say: Callable) -> None:
    from numba.core import event

    class Listener(event.Listener):
        """A kernel that comes from the cache makes no such event."""

        count = 0

        def on_start(self, event) -> None:
            self.count += 1
            say(compiling=self.count)

        def on_end(self, event) -> None:
            pass

    event.register("numba:compile", Listener())


def _tell_warnings(say: Callable, package: str) -> None:
    """Hand over what is wrong with the cache of compiled code."""

    class Handler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            say(warning=record.args[0].parts())

    logging.getLogger(package + ".core.numeric.kernels").addHandler(Handler())


def _do(task: dict, package: str, folder: Path, say: Callable) -> None:
    errors = importlib.import_module(package + ".core.errors")
    try:
        with open(folder / task["arguments"], "rb") as file:
            arguments = pickle.load(file)
        os.unlink(folder / task["arguments"])
        function = getattr(importlib.import_module(task["module"]), task["function"])
        result = _drain(function(*arguments), say)
        try:
            with open(folder / task["result"], "wb") as file:
                pickle.dump(result, file, protocol=5)
        except OSError as error:
            (folder / task["result"]).unlink(missing_ok=True)
            reason = error.strerror or error
            raise errors.OutputError(
                "{folder}: the result cannot be kept there: {reason}; make room on the disk",
                folder=folder,
                reason=reason,
            ) from error
        say(done=True)
    except errors.MirrorScanError as error:
        _tell_error(say, error)
    except OSError as error:
        reason = error.strerror or error
        path, code = error.filename or folder, errors.code_of(error)
        _tell_error(say, errors.MirrorScanError("{path}: {reason}", path=path, reason=reason, code=code))
    except MemoryError:
        _tell_error(
            say,
            errors.MirrorScanError("There is not enough memory for this; close other files or programs", code="memory"),
        )
    except Exception:
        say(fault=traceback.format_exc())


def _tell_error(say: Callable, error: Exception) -> None:
    """Hand over a :class:`.errors.MirrorScanError`, whole."""
    say(error=type(error).__name__, code=error.code, notice=error.notice.parts())


def _drain(job: Iterator, say: Callable) -> object:
    while True:
        try:
            fraction, message = next(job)
        except StopIteration as end:
            return end.value
        say(fraction=fraction, message=message)
