"""The level of the chest's girth: where the front of the chest projects furthest, near where nipples are expected."""

from __future__ import annotations

import numpy as np

from ..errors import MirrorScanError
from ..numeric.rotations import unit
from .body import UP, Body

_EXPECTED, _SPREAD = 0.29, 0.05  # of the way from the joint Spine1 up to Neck: where nipples are, how they vary
_FLAT = 0.001  # of body height: so much must the chest project to outweigh one ``_SPREAD``
_SURE = 0.7  # of its spread: what a level was off by in scans of mannequins and likely places, 95 %
_RANGE = (0.10, 0.45)
_LEVELS = 36
_ASIDE = (0.1, 0.45)  # of the distance of the shoulder joints: where a breast lies, from the middle


def chest_level(body: Body) -> tuple[float, float]:
    """The level [m], and how far it may be off, 95 % [m].

    How far both halves of the chest project in front of the trunk's axis, against how unusual a level is.
    """
    bottom, top = body.joint("Spine1"), body.joint("Neck")
    left_arm, right_arm = body.joint("LeftArm"), body.joint("RightArm")
    across = left_arm - right_arm
    breadth = float(np.linalg.norm(across[:2]))
    across = unit(across * (1.0, 1.0, 0.0))
    ahead = np.cross(across, UP)
    axis = (top - bottom) / (top - bottom)[2]
    place = np.linspace(*_RANGE, _LEVELS)
    score = np.full(_LEVELS, -np.inf)
    part = body.between(*(bottom[2] + np.array(_RANGE) * (top - bottom)[2]))
    for k, share in enumerate(place):
        middle = bottom + share * (top - bottom)[2] * axis
        points = part.trunk(middle[2]).points - middle
        aside, forward = points @ across, points @ ahead
        beside = (np.abs(aside) > _ASIDE[0] * breadth) & (np.abs(aside) < _ASIDE[1] * breadth)
        halves = [forward[beside & (side * aside > 0)] for side in (1, -1)]
        if all(len(half) for half in halves):
            score[k] = np.mean([half.max() for half in halves]) / (_FLAT * body.height)
    if not np.isfinite(score).any():
        raise MirrorScanError(
            "measurements: there is no chest in the mesh; check that the skeleton fits the mesh", code="no_person"
        )
    score -= ((place - _EXPECTED) / _SPREAD) ** 2
    best = float(place[int(score.argmax())])
    likely = np.exp(0.5 * (score - score.max()))
    spread = float(np.sqrt((likely * (place - best) ** 2).sum() / likely.sum()))
    scale = float((top - bottom)[2])
    return float(bottom[2] + best * scale), _SURE * spread * scale
