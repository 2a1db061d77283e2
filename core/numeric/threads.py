"""Independent pieces of work at the same time: kernels that release the interpreter lock run in parallel."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

Item = TypeVar("Item")
Answer = TypeVar("Answer")

_RANGES = 4
"""A thread, so that none waits long for one that had the harder part."""


def thread_count() -> int:
    """How many threads work is shared out to: what ``NUMBA_NUM_THREADS`` says, else the cores this process may use."""
    wanted = os.environ.get("NUMBA_NUM_THREADS", "")
    if wanted.isdigit() and int(wanted) > 0:
        return int(wanted)
    if hasattr(os, "sched_getaffinity"):  # Linux; a container or a scheduler may have given it a part of the machine
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def each(function: Callable[[Item], Answer], items: Iterable[Item]) -> list[Answer]:
    """``[function(item) for item in items]``, on :func:`thread_count` threads; the first error is raised.

    ``function`` may call this again. It should not call kernels compiled with ``parallel=True``: where numba's threads
    are its own, those take turns (:mod:`.kernels`).
    """
    items = list(items)
    threads = min(len(items), thread_count())
    if threads < 2:
        return [function(item) for item in items]
    answers: dict[int, Answer] = {}
    errors: dict[int, BaseException] = {}
    waiting, turn = iter(enumerate(items)), threading.Lock()

    def work() -> None:
        while not errors:
            with turn:
                place, item = next(waiting, (-1, None))
            if place < 0:
                return
            try:
                answers[place] = function(item)  # type: ignore[arg-type]  # there is one
            except BaseException as error:  # raised below
                errors[place] = error

    # This thread works too and waits only for those that have begun: where all others are busy, it does it all.
    helpers = [_pool().submit(work) for _ in range(threads - 1)]
    work()
    for helper in helpers:
        if not helper.cancel():
            helper.result()
    if errors:
        raise errors[min(errors)]
    return [answers[place] for place in range(len(items))]


def each_range(kernel: Callable[..., None], count: int, *arguments: object, least: int = 1) -> None:
    """``kernel(first, last, *arguments)`` for ranges that together are ``range(count)``, on several threads.

    A range has at least ``least`` items but where there are fewer in all; work that is so small stays in this thread.
    Kernels compiled with ``parallel=True`` take seconds more to compile.
    """
    step = max(least, -(-count // (_RANGES * thread_count())), 1)
    each(lambda first: kernel(first, min(first + step, count), *arguments), range(0, count, step))


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(thread_count(), thread_name_prefix="mirror_scan")


if hasattr(os, "register_at_fork"):  # a fork has the pool but not its threads
    os.register_at_fork(after_in_child=_pool.cache_clear)
