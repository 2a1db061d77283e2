"""What goes wrong with the cache of compiled code, heard without importing numba."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import logging


@contextlib.contextmanager
def kernel_warnings(hear: Callable[[logging.LogRecord], None]) -> Iterator[None]:
    """Have ``hear`` called with what :data:`.kernels.LOG` says meanwhile, and nobody else."""
    import logging  # not at Blender's start

    class Handler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            hear(record)

    log = logging.getLogger(f"{__package__}.kernels")
    handler, passes_on = Handler(), log.propagate
    log.addHandler(handler)
    log.propagate = False
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.propagate = passes_on
