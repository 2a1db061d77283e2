"""Peak memory of one reconstruction; run as ``python -m benchmarks.memory CAPTURE.pickle``, prints JSON [MB].

Arrays that numba's kernels allocate escape Python's tracemalloc, so the process's own resident memory is read.
"""

from __future__ import annotations

import ctypes
import gc
import json
import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.pipeline import reconstruct

STATUS, CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def resident(field: str) -> float:
    """``VmRSS`` (now) or ``VmHWM`` (highest since it was reset) [MB]."""
    line = next(line for line in STATUS.read_text().splitlines() if line.startswith(f"{field}:"))
    return int(line.split()[1]) * 1024 / 1e6


def extra_peak(call: Callable[[], Any]) -> float:
    gc.collect()
    try:
        ctypes.CDLL(None).malloc_trim(0)  # else a warm run hides in what glibc kept from the first
    except AttributeError:
        pass  # another libc
    CLEAR.write_text("5")  # resets VmHWM
    before = resident("VmRSS")
    call()
    return resident("VmHWM") - before


def main(file: str) -> dict:
    if not CLEAR.exists():
        return {"missing": "Memory is measured on Linux only."}
    capture = pickle.loads(Path(file).read_bytes())
    try:
        first = extra_peak(lambda: reconstruct(capture))
        warm = extra_peak(lambda: reconstruct(capture))
    except MirrorScanError as error:
        return {"failed": str(error)}
    return {"held": capture.depth.nbytes / 1e6, "first": first, "warm": warm, "peak": resident("VmHWM")}


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1])))
