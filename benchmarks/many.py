"""From one snapshot to many, part by part: batches of captures, and sequences of a moving person.

``python -m benchmarks --only many [--quick]``; each part is a module of its own, ``many_batch`` and so on.
"""

from __future__ import annotations

from . import many_batch, many_sequence
from .results import Result


def run(quick: bool = False) -> Result:
    """All parts; quick: smaller captures."""
    parts = [module.tables(quick) for module in (many_batch, many_sequence)]
    return Result([t for part in parts for t in part.tables], [f for part in parts for f in part.findings])
