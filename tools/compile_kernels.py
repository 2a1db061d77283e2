"""Compile the kernels of mirror_scan_addon/signatures.json into numba's cache, shared out among processes.

    [NUMBA_CACHE_DIR=.venv/numba_cache] python tools/compile_kernels.py

``make test`` does this first: tests in two processes would compile most kernels twice, and one after the other. What
the list lacks is compiled by the first test that calls it. A file in NUMBA_CACHE_DIR says when nothing is left to do;
without that variable numba's cache lies beside the modules, and each kernel is looked up in it.
"""

from __future__ import annotations

import importlib.metadata
import os
import runpy
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROCESSES = 2


def main() -> int:
    runpy.run_path(str(ROOT / "tests" / "conftest.py"))  # makes mirror_scan importable
    from mirror_scan.mirror_scan_addon.background import kernel_compilation

    stages = (kernel_compilation.STAGES[-1], *kernel_compilation.SIDE_WAYS)
    if len(sys.argv) == 2:
        for stage in stages:
            for _ in kernel_compilation.compile_steps(sys.argv[1], stage):
                pass
        return 0
    cache = os.environ.get("NUMBA_CACHE_DIR")
    names = map(kernel_compilation.stamp_name, stages)
    name = "_".join((*names, sys.implementation.cache_tag, importlib.metadata.version("numba")))
    if cache and (Path(cache) / name).exists():
        return 0
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as claims:
        running = [subprocess.Popen([sys.executable, __file__, claims]) for _ in range(PROCESSES)]
        failed = [process.wait() for process in running]
    print(f"kernels compiled in {time.perf_counter() - begin:.0f} s")
    if any(failed):
        return 1
    if cache:
        Path(cache).mkdir(parents=True, exist_ok=True)
        (Path(cache) / name).touch()
    return 0


if __name__ == "__main__":
    sys.exit(main())
