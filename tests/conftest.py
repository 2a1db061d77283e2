"""Make ``mirror_scan`` importable from the checkout when it is not installed, and let processes share numba's cache."""

from __future__ import annotations

import functools
import importlib.util
import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

if importlib.util.find_spec("mirror_scan") is None:
    spec = importlib.util.spec_from_file_location(
        "mirror_scan", ROOT / "__init__.py", submodule_search_locations=[str(ROOT)]
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules["mirror_scan"] = module
    spec.loader.exec_module(module)


def pytest_configure(config):
    if hasattr(config, "workerinput"):  # one of pytest-xdist's processes
        take_turns_at_numbas_cache()


def take_turns_at_numbas_cache() -> None:
    """Let one process at a time read or write what numba's cache holds of a kernel; nothing where there is no fcntl.

    numba reads a kernel's index, enters the next free number, writes the index back and then the code under that
    number. Two processes that compile a kernel for different types at the same moment may take the same number, and one
    that reads in between finds the code of an older source.
    """
    try:
        import fcntl
    except ImportError:
        return
    from numba.core.caching import IndexDataCacheFile

    def locked(method):
        @functools.wraps(method)
        def alone(self, *arguments):
            os.makedirs(self._cache_path, exist_ok=True)
            with open(f"{self._index_path}.lock", "w") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX)  # until the file is closed
                return method(self, *arguments)

        return alone

    IndexDataCacheFile.save = locked(IndexDataCacheFile.save)
    IndexDataCacheFile.load = locked(IndexDataCacheFile.load)
