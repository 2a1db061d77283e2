"""From one snapshot to many, part by part: batches of captures, and sequences of a moving person.

``python -m benchmarks --only many [--quick] --markdown docs/figures_many.md``; each part is a module of its own,
``many_batch`` and so on. Progress goes to stderr.
"""

from __future__ import annotations

from . import many_batch, many_sequence
from .results import Result, run_parts

PARTS = {"sequences": many_sequence.tables, "batches": many_batch.tables}


def run(quick: bool = False) -> Result:
    """All parts; quick: fewer frames and smaller captures."""
    return run_parts(PARTS, quick)
