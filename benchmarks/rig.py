"""The avatar that moves, part by part: joints, skin weights, motions, and a tracker that is followed in Blender.

``python -m benchmarks --only rig [--quick]``; each part is a module of its own, ``rig_joints`` and so on.
"""

from __future__ import annotations

from pathlib import Path

from . import rig_follow, rig_joints, rig_motion, rig_weights
from .results import Result


def run(quick: bool = False, pictures: Path | None = None) -> Result:
    """All parts; quick: three bodies, one arm angle, one body for motions."""
    parts = [_joints(quick, pictures), _weights(quick), _motion(quick), rig_follow.run()]
    return Result([t for part in parts for t in part.tables], [f for part in parts for f in part.findings])


def _joints(quick: bool, pictures: Path | None) -> Result:
    if quick:
        return rig_joints.run(bodies=(0, 3, 7), angles=(55.0,), pictures=pictures)
    return rig_joints.run(pictures=pictures)


def _weights(quick: bool) -> Result:
    return rig_weights.run(tuple(rig_weights.BODIES)[:2]) if quick else rig_weights.run()


def _motion(quick: bool) -> Result:
    return rig_motion.run(rig_motion.BODIES[:1]) if quick else rig_motion.run()
