"""BLAS works with one thread in a block, and with all of its own afterwards, however blocks overlap."""

from __future__ import annotations

import pytest
from mirror_scan.core.numeric import blas_threads
from mirror_scan.core.numeric.blas_threads import one_blas_thread


def threads() -> int:
    functions = blas_threads._openblas()
    if functions is None:
        pytest.skip("numpy's BLAS is not OpenBLAS")
    return functions[0]()


def test_one_thread_within_and_as_before_outside():
    before = threads()
    first, second = one_blas_thread(), one_blas_thread()
    first.__enter__()
    second.__enter__()
    assert threads() == 1
    first.__exit__(None, None, None)
    assert threads() == 1
    second.__exit__(None, None, None)
    assert threads() == before
    with pytest.raises(ValueError), one_blas_thread():
        raise ValueError
    assert threads() == before


def test_another_blas_is_left_alone(monkeypatch):
    monkeypatch.setattr(blas_threads, "_openblas", lambda: None)
    with one_blas_thread():
        pass
