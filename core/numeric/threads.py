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

    ``function`` must not call kernels compiled with ``parallel=True``: numba's fallback threading layer, the only one
    on some machines, may be entered by one thread at a time.
    """
    items = list(items)
    threads = min(len(items), os.cpu_count() or 1)
    if threads < 2:
        return [function(item) for item in items]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(function, items))
