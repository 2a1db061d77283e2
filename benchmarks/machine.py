"""What the figures were measured on, and how time is taken."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

PACKAGES = ("numpy", "numba", "open3d", "pymeshlab", "librosa", "dtaidistance", "tslearn", "aeon", "trimesh", "bpy")


def installed(module: str) -> bool:
    return importlib.util.find_spec(module) is not None


def describe() -> list[str]:
    """Processor, Python and package versions, one line each."""
    version = importlib.metadata.version
    versions = [f"{name} {version(name) if installed(name) else 'not installed'}" for name in PACKAGES]
    load = f"; load average at the start {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    return [
        f"{_processor()}, {os.cpu_count()} cores, {platform.system()}{load}",
        f"Python {platform.python_version()}, " + ", ".join(versions),
        "Times are medians of warm runs, kernels compiled before.",
    ]


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def milliseconds(call: Callable[[], Any]) -> tuple[float, Any]:
    """How long one call takes, and what it returns."""
    start = time.perf_counter()
    value = call()
    return 1000.0 * (time.perf_counter() - start), value


def medians(calls: dict[str, Callable[[], Any]], runs: int) -> tuple[dict[str, float], dict[str, Any]]:
    """Median time [ms] and last value of each call. They take turns, so that a busy machine slows all alike."""
    values = {name: call() for name, call in calls.items()}  # warm
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(runs):
        for name, call in calls.items():
            spent, values[name] = milliseconds(call)
            times[name].append(spent)
    return {name: median(spent) for name, spent in times.items()}, values


def say(message: str) -> None:
    """Print progress, separately from the tables."""
    print(message, file=sys.stderr, flush=True)
