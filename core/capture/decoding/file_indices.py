"""Tables of contents of recordings, kept while their frames are read one after the other.

To read one frame of a recording a reader walks through the whole file to find where its frames are. Who reads frame by
frame would do that for each: in time that grows with the square of the length.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TypeVar

Index = TypeVar("Index")


class FileIndices:
    """What readers found in the files that were read within :meth:`kept`, as long as these files do not change."""

    def __init__(self) -> None:
        self._found: dict[tuple[str, str], tuple[tuple[int, ...], Any]] = {}
        self._lock = threading.Lock()

    @contextlib.contextmanager
    def kept(self) -> Iterator[None]:
        """Within this block readers of this thread look here first."""
        before = _IN_USE.set(self)
        try:
            yield
        finally:
            _IN_USE.reset(before)

    def _of(self, path: Path, what: str, make: Callable[[], Index]) -> Index:
        state = os.stat(path)
        stamp = state.st_size, state.st_mtime_ns, state.st_ino
        with self._lock:
            known = self._found.get((os.path.realpath(path), what))
        if known is not None and known[0] == stamp:
            return known[1]
        index = make()
        with self._lock:
            self._found[os.path.realpath(path), what] = stamp, index
        return index


_IN_USE: ContextVar[FileIndices | None] = ContextVar("file_indices", default=None)


def index_of(path: Path, what: str, make: Callable[[], Index]) -> Index:
    """What ``make()`` finds in a file, or found there before, where :class:`FileIndices` are in use.

    Parameters
    ----------
    path : Path
    what : str
        Kind of index; a file may have several.
    make : function()
        Its result must hold none of the file's bytes, and nobody may change it.
    """
    indices = _IN_USE.get()
    return make() if indices is None else indices._of(path, what, make)


def are_kept() -> bool:
    """Whether what is found now is looked at again, so that an open file may be kept for it."""
    return _IN_USE.get() is not None
