"""The avatar that moves, part by part: joints.

``python -m benchmarks --only rig [--quick]``; each part is a module of its own, ``rig_joints`` and so on.
"""

from __future__ import annotations

from pathlib import Path

from . import rig_joints
from .results import Result


def run(quick: bool = False, pictures: Path | None = None) -> Result:
    """All parts; quick: three bodies, one arm angle."""
    parts = [_joints(quick, pictures)]
    return Result([t for part in parts for t in part.tables], [f for part in parts for f in part.findings])


def _joints(quick: bool, pictures: Path | None) -> Result:
    if quick:
        return rig_joints.run(bodies=(0, 3, 7), angles=(55.0,), pictures=pictures)
    return rig_joints.run(pictures=pictures)
