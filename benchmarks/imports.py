"""What Blender's start waits for: ``import mirror_scan`` and ``register()``, each in a fresh process."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from statistics import median

from .machine import installed, say
from .results import Finding, Result, Table, number, yes

RUNS = 9
REGISTER_RUNS = 3
MAX_MS = 50.0
ROOT = Path(__file__).resolve().parents[1]
IMPORT = """
import json, sys, time
start = time.perf_counter()
import mirror_scan
spent = time.perf_counter() - start
print(json.dumps([1000 * spent, "numba" in sys.modules]))
"""
REGISTER = """
import json, sys, time
import bpy, mirror_scan
start = time.perf_counter()
mirror_scan.register()
spent = time.perf_counter() - start
print("\\n" + json.dumps([1000 * spent, "numba" in sys.modules]))
"""


def run() -> Result:
    table = Table("Import, fresh processes", ("what", "runs", "median ms", "max ms", "imports numba"))
    say("import")
    spent, numba = _fresh(IMPORT, RUNS)
    table.rows.append(_row("import mirror_scan", spent, numba))
    found = [Finding(f"import mirror_scan < {MAX_MS:g} ms", f"{median(spent):.1f} ms", median(spent) < MAX_MS)]
    limit = "register() without importing numba"
    if installed("bpy"):
        spent, numba = _fresh(REGISTER, REGISTER_RUNS)
        table.rows.append(_row("register()", spent, numba))
        found.append(Finding(limit, "numba is imported" if numba else "numba is not imported", not numba))
    else:
        table.rows.append(("register(): bpy not installed", *["–"] * 4))
        found.append(Finding(limit, "bpy is not installed", None))
    table.notes = ["The statement alone, in a process that has just started; bpy is there before register() is timed."]
    return Result([table], found)


def _fresh(script: str, runs: int) -> tuple[list[float], bool]:
    """Times [ms], and whether numba was there afterwards in any of the runs."""
    spent, numba = [], False
    for _ in range(runs):
        done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
        took, imported = next(json.loads(line) for line in reversed(done.stdout.splitlines()) if line.startswith("["))
        spent.append(took)
        numba |= imported
    return spent, numba


def _row(what: str, spent: list[float], numba: bool) -> tuple[str, ...]:
    return what, str(len(spent)), number(median(spent), 1), number(max(spent), 1), yes(numba)
