"""One thread for numpy's BLAS while our own kernels have the cores.

OpenBLAS, which numpy's wheels hold, shares out products of a few thousand numbers already. Its threads go on spinning
for a while, and take the cores from whatever follows; for products so small they gain nothing.
"""

from __future__ import annotations

import contextlib
import ctypes
import threading
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np

_NAMES = "openblas_{}_num_threads64_", "scipy_openblas_{}_num_threads64_", "openblas_{}_num_threads"
_lock = threading.Lock()
_within = 0  # blocks that are being run
_before = 0  # threads outside of them


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Products within the block are done by one thread, where the BLAS is OpenBLAS; results stay the same to the bit.

    Blocks of several threads may overlap: the last to end gives BLAS its threads back.
    """
    global _within, _before
    threads = _openblas()
    if threads is None:
        yield
        return
    count, choose = threads
    with _lock:
        if _within == 0:
            _before = count()
            choose(1)
        _within += 1
    try:
        yield
    finally:
        with _lock:
            _within -= 1
            if _within == 0:
                choose(_before)


@cache
def _openblas() -> tuple[Any, Any] | None:
    """OpenBLAS's functions that tell and choose its number of threads, or None."""
    linear_algebra: Any = np.linalg._umath_linalg  # type: ignore[attr-defined]
    try:
        library = ctypes.CDLL(linear_algebra.__file__)  # finds what it is linked to as well
    except OSError:
        return None
    for name in _NAMES:
        with contextlib.suppress(AttributeError):
            return getattr(library, name.format("get")), getattr(library, name.format("set"))
    return None
