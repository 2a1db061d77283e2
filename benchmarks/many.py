"""From one snapshot to many, part by part: batches of captures, and sequences of a moving person.

``python -m benchmarks --only many [--quick] --markdown docs/figures_many.md``; each part is a module of its own,
``many_batch`` and so on. Progress goes to stderr.
"""

from __future__ import annotations

import time
import traceback

from . import many_batch, many_sequence
from .machine import say
from .results import Finding, Result

PARTS = {"sequences": many_sequence.tables, "batches": many_batch.tables}


def run(quick: bool = False) -> Result:
    """All parts; quick: fewer frames and smaller captures. A part that breaks down is a limit that does not hold."""
    whole = Result()
    for name, tables in PARTS.items():
        began = time.perf_counter()
        try:
            part = tables(quick)
        except Exception as error:  # the other part's figures, which took minutes, are worth having
            traceback.print_exc()
            part = Result([], [Finding(f"{name}: measured to the end", f"{type(error).__name__}: {error}", False)])
        say(f"{name}: {time.perf_counter() - began:.0f} s")
        whole.tables += part.tables
        whole.findings += part.findings
    return whole
