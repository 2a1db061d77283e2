"""Before the shutter: live guidance, the best place for a rig, the paper's rivals; each part a module of its own."""

from __future__ import annotations

from . import shutter_live, shutter_placement, shutter_rivals
from .results import Result, run_parts

PARTS = {"live": shutter_live.run, "placement": shutter_placement.tables, "rivals": shutter_rivals.tables}


def run(quick: bool = False) -> Result:
    """The tables of all parts; ``quick``: a few cases of each."""
    return run_parts(PARTS, quick)
