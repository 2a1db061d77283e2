"""Before the shutter: live guidance, the best place for a rig, and the paper's rivals; what there is of them."""

from __future__ import annotations

import importlib
import importlib.util

from .results import Result

PARTS = ("shutter_live", "shutter_placement", "shutter_rivals")


def run(quick: bool = False) -> Result:
    """The tables of all parts; ``quick``: a few cases of each."""
    result = Result()
    for name in PARTS:
        if importlib.util.find_spec(f".{name}", __package__) is None:
            continue
        part = importlib.import_module(f".{name}", __package__).run(quick=quick)
        result.tables += part.tables
        result.findings += part.findings
    return result
