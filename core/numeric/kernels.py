"""``njit`` for kernels: numba's, with a cache that may break.

Compiled code that is damaged, or that cannot be kept, costs compiling again and one line of warning, never an error.
Kernels are never compiled with ``parallel=True``, which takes seconds each, and whose threads neither forks nor several
calling threads get along with: :mod:`.threads` shares out their work.
"""

from __future__ import annotations

import contextlib
import glob
import inspect
import io
import logging
import os
import pickle
import time
import uuid
import zlib
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numba
from numba.core import caching, serialize

from ..errors import Notice
from .kernel_linking import KNOWN, Kernel, rebuilt

__all__ = ["LOG", "njit"]

LOG = logging.getLogger(__name__)
"""Says, at most once a process and as a :class:`.notices.Notice`, that compiled code could not be read or kept. A
program that has its own way of warning adds a handler."""

Function = TypeVar("Function", bound=Callable)

_FOOTER = b"mirror_scan crc32 "  # and four bytes; pickle stops before it, so that plain numba can read such a file

_SETTLED_S = 600.0

_said: list[Notice] = []  # what was warned of in this process


def njit(**options: Any) -> Callable[[Function], Function]:
    """Decorator: compiled by :func:`numba.njit`, whose options it takes.

    Division by zero gives infinity or NaN, as in numpy, unless ``error_model="python"`` asks for an error: each check
    is code to compile, and so is numba's own code once more for each model.
    """
    cached = options.pop("cache", False)
    options.setdefault("error_model", "numpy")

    def decorate(function: Function) -> Any:
        kernel: Any = numba.njit(**options)(function)
        if not hasattr(kernel, "py_func"):  # NUMBA_DISABLE_JIT
            return kernel
        if KNOWN:
            kernel = Kernel.of(kernel)
        if cached:
            kernel._cache = _KernelCache(function)
        return kernel

    return decorate


# --- the cache -------------------------------------------------------------------------------------------------------


class _Damaged(Exception):
    """A file of the cache holds something else than what was written."""


class _FirstChoice:
    """Where numba would keep compiled code if it could, whether or not it can be written to."""

    @staticmethod
    def from_function(function: Callable, file: str) -> Any:
        in_variable, beside_source, *_ = caching.CompileResultCacheImpl._locator_classes
        return (in_variable if _cache_dir() else beside_source)(function, file)


class _Format(caching.CompileResultCacheImpl):
    """What is kept of compiled code, under which name, and where."""

    _locator_classes: Any = [*caching.CompileResultCacheImpl._locator_classes, _FirstChoice]

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        return rebuilt(target_context, payload) if KNOWN else super().rebuild(target_context, payload)


class _KernelCache(caching.FunctionCache):
    """Numba's cache of one function, which warns where that one raises.

    It looks for its place when it is first asked, not when the kernel is defined. The folder that numba would write to
    is read even if it cannot be written to. Code goes into a file of its own name, before the index that names it: of
    two processes that compile at once, none gets the other's code.
    """

    def __init__(self, function: Callable) -> None:
        self._py_func, self._name = function, repr(function)
        self._impl: Any = None
        self._places: list[_Place] | None = None
        self.enable()

    @property
    def cache_path(self) -> str:
        return self._found()[-1].folder

    def flush(self) -> None:
        for place in self._found():
            with contextlib.suppress(OSError):
                place.write_index({})

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        target_context.refresh()
        if not self._enabled:
            return None
        for place in self._found():
            try:
                data = place.load(self._index_key(sig, target_context.codegen()))
                if data is not None:
                    return self._impl.rebuild(target_context, data)
            except Exception:  # what a damaged file makes pickle or numba do is open
                _warn(
                    Notice(
                        "Part of the compiled code kept in {folder} is damaged; it is compiled again", folder=place.top
                    )
                )
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        place = self._found()[-1]
        if not self._enabled or not self._impl.check_cachable(data):
            return
        chosen = _cache_dir()
        if chosen and not place.folder.startswith(chosen):
            _warn(
                Notice(
                    "Compiled code cannot be kept in {folder}; it is kept in {place}", folder=chosen, place=place.folder
                )
            )
        try:
            place.save(self._index_key(sig, data.codegen), self._impl.reduce(data))
        except OSError as error:
            _warn(
                Notice(
                    "Compiled code cannot be kept in {folder} ({reason}), so that it is compiled again in each run; "
                    "make room there, let it be written to, or set NUMBA_CACHE_DIR to another folder",
                    folder=place.top,
                    reason=error.strerror or error,
                )
            )

    def _index_key(self, sig: Any, codegen: Any) -> tuple:
        """Other than in an index that numba wrote, or this program before it kept code in this form."""
        key = super()._index_key(sig, codegen)
        return ("linked", *key) if KNOWN else key

    def _found(self) -> list[_Place]:
        """Where to look, the place to write to last."""
        if self._places is None:
            self._impl = _Format(self._py_func)
            folders = [self._impl.locator.get_cache_path()]
            wanted = _FirstChoice.from_function(self._py_func, inspect.getfile(self._py_func)).get_cache_path()
            if wanted not in folders and os.path.isdir(wanted):
                folders.insert(0, wanted)
            name, stamp = self._impl.filename_base, self._impl.locator.get_source_stamp()
            self._places = [_Place(folder, name, stamp) for folder in folders]
        return self._places


class _Place:
    """The files of one kernel in one folder: an index, and the code of each signature in a file of its own.

    The index is numba's: its version, then the stamp of the source and the file names by key, both pickled. Each file
    ends with a checksum, because damaged machine code would end the process.
    """

    def __init__(self, folder: str, base: str, stamp: object) -> None:
        self.folder, self._base, self._stamp = folder, base, stamp
        self._index = os.path.join(folder, f"{base}.nbi")

    @property
    def top(self) -> str:
        """The folder as users know it."""
        chosen = _cache_dir()
        return chosen if chosen and self.folder.startswith(chosen) else self.folder

    def load(self, key: object) -> Any:
        """What was saved under ``key``, or None.

        Raises
        ------
        _Damaged or any other exception
            When the files cannot be read, or were damaged.
        """
        name = self._read_index().get(key)
        if name is None:
            return None
        try:
            with open(os.path.join(self.folder, name), "rb") as file:
                data = file.read()
        except FileNotFoundError:
            return None
        return pickle.loads(_checked(data))

    def save(self, key: object, data: object) -> None:
        """Raises :class:`OSError` when it cannot be written; what was there can still be read then."""
        os.makedirs(self.folder, exist_ok=True)
        name = f"{self._base}.{uuid.uuid4().hex[:12]}.nbc"
        self._write(os.path.join(self.folder, name), serialize.dumps(data))
        try:
            with _alone(self.folder):
                stale = self._enter(key, name)
        except OSError:
            stale = [name]
            raise
        finally:
            for other in stale:
                with contextlib.suppress(OSError):
                    os.unlink(os.path.join(self.folder, other))

    def _enter(self, key: object, name: str) -> list[str]:
        """Have the index name the file of ``key``; the files that no key has any more."""
        try:
            names = self._read_index()
        except Exception:  # damaged
            names = {}
        kept = {other for known, other in names.items() if known != key} | {name}
        self.write_index(names | {key: name})
        if key not in names and names:
            return []
        pattern = os.path.join(glob.escape(self.folder), f"{glob.escape(self._base)}.*.nbc")
        old = time.time() - _SETTLED_S  # what is newer, another process may be about to enter
        paths = [path for path in glob.glob(pattern) if os.stat(path).st_mtime < old]
        return [other for other in map(os.path.basename, paths) if other not in kept]

    def write_index(self, names: dict) -> None:
        if os.path.isdir(self._index):  # goes only when nothing is in it
            os.rmdir(self._index)
        self._write(self._index, pickle.dumps(numba.__version__) + serialize.dumps((self._stamp, names)))

    def _read_index(self) -> dict:
        try:
            with open(self._index, "rb") as file:
                data = file.read()
        except FileNotFoundError:
            return {}
        whole = data[-len(_FOOTER) - 4 : -4] == _FOOTER  # else written by numba itself, for another source, or cut
        content = io.BytesIO(_checked(data) if whole else data)
        if pickle.load(content) != numba.__version__:
            return {}
        stamp, names = pickle.load(content)
        if not whole and stamp == self._stamp:
            raise _Damaged
        return names if stamp == self._stamp else {}

    def _write(self, path: str, data: bytes) -> None:
        """The file appears whole or not at all."""
        temporary = f"{path}.tmp.{uuid.uuid4().hex[:12]}"
        try:
            with open(temporary, "wb") as file:
                file.write(data + _FOOTER + zlib.crc32(data).to_bytes(4, "little"))
            os.replace(temporary, path)
        except OSError:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
            raise


@contextlib.contextmanager
def _alone(folder: str) -> Iterator[None]:
    """One process at a time, where the system and the disk can do that; else an entry may get lost, no more."""
    try:
        import fcntl

        handle = os.open(folder, os.O_RDONLY)
    except (ImportError, OSError):
        yield
        return
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _checked(data: bytes) -> bytes:
    """What stands before the checksum."""
    content, footer, checksum = data[: -len(_FOOTER) - 4], data[-len(_FOOTER) - 4 : -4], data[-4:]
    if footer != _FOOTER or zlib.crc32(content).to_bytes(4, "little") != checksum:
        raise _Damaged
    return content


def _cache_dir() -> str:
    """NUMBA_CACHE_DIR, or what a program set instead; "" leaves the place to numba."""
    return getattr(numba.config, "CACHE_DIR", "")


def _warn(notice: Notice) -> None:
    """Once a process: what comes later has the same cause, or matters as little."""
    if not _said:
        _said.append(notice)
        LOG.warning("%s", notice)
