"""Independent pieces of work at the same time: kernels that release the interpreter lock run in parallel."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Answer = TypeVar("Answer")


def each(function: Callable[[Item], Answer], items: Iterable[Item]) -> list[Answer]:
    """``[function(item) for item in items]``, on as many threads as there are cores; the first error is raised.

    ``function`` should not call kernels compiled with ``parallel=True``: where numba's threads are its own, those take
    turns (:mod:`.kernels`).
    """
    items = list(items)
    threads = min(len(items), os.cpu_count() or 1)
    if threads < 2:
        return [function(item) for item in items]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(function, items))
