"""The folder where compiled kernels are kept between sessions: how large it is, and clearing it."""

from __future__ import annotations

import os
import time

from ...core.errors import OutputError
from ..language.texts import say
from . import numba_setup

FRESH_S = 2.0  # how long a size that was measured is shown before it is measured again

_measured: list[tuple[float, str, int, int]] = []  # when, which folder, bytes and files; at most one


def elsewhere() -> bool:
    """Whether the compiled code is not ours to clear: an environment variable says where it is, or numba's default."""
    return not numba_setup.cache_folder()


def size() -> tuple[int, int]:
    """Bytes and number of the files that are kept; measured again after :data:`FRESH_S`, for panels ask often."""
    folder = numba_setup.cache_folder()
    if not _measured or _measured[0][1] != folder or time.monotonic() - _measured[0][0] > FRESH_S:
        files = list(_files(folder))
        _measured[:] = [(time.monotonic(), folder, sum(entry.stat().st_size for entry in files), len(files))]
    return _measured[0][2:]


def clear() -> int:
    """Delete what is kept; returns how many bytes that were. Nothing else in this session may be compiling.

    Raises
    ------
    OutputError
        When a file cannot be deleted; those before it are gone.
    """
    from . import second_process

    second_process.stop()  # what it has loaded would be taken for kept
    folder, freed = numba_setup.cache_folder(), 0
    _measured.clear()
    try:
        for entry in list(_files(folder)):
            freed += entry.stat().st_size
            os.unlink(entry.path)
    except OSError as error:
        text = say("{folder}: cannot be cleared: {reason}; close other Blenders and try again")
        raise OutputError(text.format(folder=folder, reason=error.strerror or error)) from error
    for below, folders, files in os.walk(folder, topdown=False):
        if not folders and not files and below != folder:
            os.rmdir(below)
    return freed


def _files(folder: str):
    """Every file below a folder; none where there is no folder."""
    if not folder or not os.path.isdir(folder):
        return
    with os.scandir(folder) as found:
        for entry in found:
            if entry.is_dir(follow_symlinks=False):
                yield from _files(entry.path)
            else:
                yield entry
