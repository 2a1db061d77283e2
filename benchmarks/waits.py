"""The waits a user has: code compiled once for this computer, the first demo, and a command when all is compiled.

Every figure is of fresh processes, from their start to their end.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from .machine import say
from .results import Finding, Result, Table, number

ROOT = Path(__file__).resolve().parents[1]
RUNS = 7
PROCESSES = 2
MAX_COMPILE_S, MAX_TOGETHER_S = 70.0, 35.0
MAX_DEMO_S = 90.0  # 60 to the avatar, 30 more for its skeleton and texture
MAX_WARM_S, MAX_BESIDE_S, MAX_MB = 1.5, 0.8, 350.0
COMPILE = """
import sys
from mirror_scan.mirror_scan_addon.background import kernel_compilation as kernels
for stage in sys.argv[2:]:
    for _ in kernels.compile_steps(sys.argv[1], stage):
        pass
"""
COMMAND = "from mirror_scan.core.cli import main; raise SystemExit(main())"


@dataclass(frozen=True)
class Run:
    """Of a process from start to end: seconds that passed, seconds of one core, peak of its resident memory [MB]."""

    wall: float
    processor: float
    peak: float


def run() -> Result:
    """Tables and findings; takes some minutes, in which nothing else should run."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        compiled, findings = _compiling(place)
        commands, more = _commands(place)
    return Result([compiled, commands], findings + more)


def _compiling(place: Path) -> tuple[Table, list[Finding]]:
    from mirror_scan.mirror_scan_addon.background.kernel_compilation import AVATAR, RIG, STAGES, entries, needs

    table = Table("Waits: compiling, once for a computer", ("what", "kernels", "processes", "seconds", "of one core"))
    ways = {"from a capture to an avatar": STAGES[-1], "its skeleton and texture": AVATAR, "a virtual rig": RIG}
    total, plain = 0.0, needs(STAGES[-1])
    for what, stage in ways.items():
        say(f"compiling: {what}")
        done = _run("-c", COMPILE, _claims(place, stage), stage, cache=place / "alone")
        count = sum(entry.stage in (plain if stage == STAGES[-1] else (stage,)) for entry in entries())
        table.rows.append((what, str(count), "1", number(done.wall, 1), number(done.processor, 1)))
        if stage == STAGES[-1]:
            total = done.processor
    say(f"compiling in {PROCESSES} processes")
    start, claims = time.perf_counter(), _claims(place, "together")
    running = [_start("-c", COMPILE, claims, STAGES[-1], cache=place / "together") for _ in range(PROCESSES)]
    together = [_end(process, start) for process in running]
    spent = max(one.wall for one in together), sum(one.processor for one in together)
    table.rows.append((next(iter(ways)), table.rows[0][1], str(PROCESSES), *(number(s, 1) for s in spent)))
    table.notes = ["Into an empty cache; the start of each process and its imports are counted."]
    limit = f"{next(iter(ways))}: compiled in <= {MAX_COMPILE_S:g} s of one core"
    both = f"the same in {PROCESSES} processes <= {MAX_TOGETHER_S:g} s"
    return table, [
        Finding(limit, f"{total:.1f} s", total <= MAX_COMPILE_S),
        Finding(both, f"{spent[0]:.1f} s", spent[0] <= MAX_TOGETHER_S),
    ]


def _commands(place: Path) -> tuple[Table, list[Finding]]:
    table = Table("Waits: commands, from start to end", ("what", "runs", "seconds", "of one core", "not the job", "MB"))
    cache, capture, avatar = place / "together", place / "capture", place / "avatar.ply"
    rows = {}
    for what in ("mirror-scan demo, nothing compiled", "mirror-scan demo again"):
        say(what)
        rows[what] = done = _run("-c", COMMAND, "demo", str(place / "demo"), "--quiet", cache=place / "demo_cache")
        table.rows.append((what, "1", number(done.wall, 1), number(done.processor, 1), "–", number(done.peak, 0)))
    say("mirror-scan reconstruct")
    _run("-c", COMMAND, "simulate", str(capture), "--sensor", "kinect_v1", "--frames", "10", "--quiet", cache=cache)
    warm, beside = [], []
    for _ in range(RUNS + 1):  # the first loads what later ones have in the disk's cache
        report = place / "report.json"
        for old in (avatar, report):
            old.unlink(missing_ok=True)
        words = ("reconstruct", str(capture), "-o", str(avatar), "--report", str(report), "--quiet")
        warm.append(_run("-c", COMMAND, *words, cache=cache))
        job = sum(json.loads(report.read_text())["timings_ms"].values()) / 1000.0
        beside.append(warm[-1].wall - job)
    warm, beside = warm[1:], beside[1:]
    wall, peak = median(one.wall for one in warm), max(one.peak for one in warm)
    cells = (number(wall, 2), number(median(one.processor for one in warm), 2), number(median(beside), 2))
    table.rows.append(("mirror-scan reconstruct, 640x480, 10 frames", str(RUNS), *cells, number(peak, 0)))
    table.notes = [
        "The demo simulates a capture, builds the avatar, its skeleton and its texture, writes five files, and draws.",
        "Not the job: what remains without the stages that the report times.",
    ]
    demo = rows["mirror-scan demo, nothing compiled"].wall
    return table, [
        Finding(f"first mirror-scan demo <= {MAX_DEMO_S:g} s", f"{demo:.0f} s", demo <= MAX_DEMO_S),
        Finding(f"warm mirror-scan reconstruct <= {MAX_WARM_S:g} s", f"{wall:.2f} s", wall <= MAX_WARM_S),
        Finding(f"of it not the job <= {MAX_BESIDE_S:g} s", f"{median(beside):.2f} s", median(beside) <= MAX_BESIDE_S),
        Finding(f"its peak memory <= {MAX_MB:g} MB", f"{peak:.0f} MB", peak <= MAX_MB),
    ]


def _claims(place: Path, name: str) -> str:
    folder = place / f"claims_{name}"
    folder.mkdir()
    return str(folder)


def _run(*arguments: str, cache: Path) -> Run:
    start = time.perf_counter()
    return _end(_start(*arguments, cache=cache), start)


def _start(*arguments: str, cache: Path) -> subprocess.Popen:
    changed = {"NUMBA_CACHE_DIR": str(cache)}
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return subprocess.Popen(
        [sys.executable, *arguments], cwd=ROOT, env=kept | changed, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )


def _end(process: subprocess.Popen, start: float) -> Run:
    """Wait for a process, and say what it took.

    Raises
    ------
    RuntimeError
        When it fails, with the end of what it said.
    """
    assert process.stderr is not None
    said = process.stderr.read()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{process.args} failed: {said.decode(errors='replace')[-600:]}")
    return Run(time.perf_counter() - start, used.ru_utime + used.ru_stime, used.ru_maxrss * 1024 / 1e6)
