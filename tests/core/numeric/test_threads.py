"""Work shared out to threads."""

from __future__ import annotations

import os
import threading

import numpy as np
import pytest
from mirror_scan.core.numeric.threads import each, each_range, thread_count


def test_answers_come_in_the_order_of_the_items():
    assert each(lambda k: k * k, range(200)) == [k * k for k in range(200)]
    assert each(str, []) == []


def test_work_that_shares_out_work_of_its_own_ends():
    """Deeper than there are cores, where threads that waited for each other would wait for ever."""

    def deep(level):
        return 1 if level == 0 else sum(each(deep, [level - 1] * 3))

    found: list[int] = []
    outer = threading.Thread(target=lambda: found.append(deep(6)), daemon=True)
    outer.start()
    outer.join(60.0)
    assert found == [3**6]


def test_the_first_error_is_raised_once_all_that_began_has_ended():
    running = [0]
    lock = threading.Lock()

    def fail(k):
        with lock:
            running[0] += 1
        try:
            if k >= 1:
                raise ValueError(f"item {k}")
        finally:
            with lock:
                running[0] -= 1

    for _ in range(50):
        with pytest.raises(ValueError, match="item [1-9]"):
            each(fail, range(40))
        assert running == [0]
    assert each(abs, [-1, -2]) == [1, 2]


@pytest.mark.parametrize("count", [0, 1, 7, 256, 1000, 1001])
@pytest.mark.parametrize("least", [1, 256])
def test_ranges_cover_every_item_once(count, least):
    times = np.zeros(count, int)
    sizes = []

    def kernel(first, last, out):
        sizes.append(last - first)
        out[first:last] += 1

    each_range(kernel, count, times, least=least)
    assert (times == 1).all() and sum(sizes) == count
    assert count < least or all(size >= least for size in sorted(sizes)[1:])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_fork_has_threads_of_its_own():
    each(abs, range(8))
    child = os.fork()
    if child == 0:
        os._exit(0 if each(abs, range(8)) == list(range(8)) else 1)
    assert os.waitpid(child, 0)[1] == 0


def test_threads_are_as_many_as_asked_for(monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    assert thread_count() == 1
    used = set()
    each(lambda k: used.add(threading.get_ident()), range(50))
    assert used == {threading.get_ident()}
    for nonsense in ("", "0", "many"):
        monkeypatch.setenv("NUMBA_NUM_THREADS", nonsense)
        assert 1 <= thread_count() <= (os.cpu_count() or 1)
