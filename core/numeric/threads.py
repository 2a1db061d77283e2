"""Independent pieces of work at the same time: kernels that release the interpreter lock run in parallel."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Answer = TypeVar("Answer")


def each_range(kernel: Callable[..., None], count: int, *arguments: object, least: int = 1) -> None:
    """``kernel(first, last, *arguments)`` for ranges that together are ``range(count)``, on all cores.

    A range has at least ``least`` items but where there are fewer in all; work that is so small stays in this thread.
    Kernels compiled with ``parallel=True`` take seconds more to compile.
    """
    step = max(least, -(-count // (_RANGES * (os.cpu_count() or 1))), 1)
    each(lambda first: kernel(first, min(first + step, count), *arguments), range(0, count, step))


_RANGES = 4
"""A thread, so that none waits long for one that had the harder part."""


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
