"""All measures of a body by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..avatar.pose import SkinWeights
from ..avatar.skeleton import Skeleton
from ..mesh import Mesh
from .body import SIDES, Body, body_of
from .chest_level import chest_level
from .girths import Girth, at_level, calf, crotch_level, hip, neck, thigh, upper_arm, waist
from .lengths import Length, arm_length, height, inseam, shoulder_width, straightening
from .uncertainty import Uncertainty, ViewError, girth_estimate, joint_spread, length_error

ISO_NAMES = {
    "height": "Stature",
    "height_standing": "Stature",
    "chest": "Bust girth",
    "waist": "Waist girth",
    "hip": "Hip girth",
    "thigh": "Thigh girth",
    "calf": "Calf girth",
    "upper_arm": "Upper-arm girth",
    "neck": "Neck girth",
    "inseam": "Inside leg height",
    "arm_length": "Outer arm length",
    "shoulder_width": "Across back shoulder width",
}
"""Of each measure, in ISO 8559-1:2017; in the order in which they are given."""


_POSTURE = 0.003  # of body height: how people differ in standing upright, 95 %


@dataclass(frozen=True)
class Measurement:
    """One measure of a body.

    Parameters
    ----------
    name : str
        A key of ``ISO_NAMES``.
    iso_name : str
        What ISO 8559-1:2017 calls it.
    mm : float
        [mm]
    error_mm : float
        The true value lies within so much of it in 95 % of cases [mm].
    loops : tuple of np.ndarray [shape=(K, 3), dtype=float64]
        Where the tape runs, in the mesh's frame [m]: closed about limbs and trunk, left and right where both were
        measured.
    closed : bool
        The last point of each loop is followed by the first.
    """

    name: str
    iso_name: str
    mm: float
    error_mm: float
    loops: tuple[np.ndarray, ...]
    closed: bool


Measurements = dict[str, Measurement]
"""By name, in the order of ``ISO_NAMES``."""


def measure(
    mesh: Mesh,
    skeleton: Skeleton,
    weights: SkinWeights,
    views: Sequence[ViewError] = (),
    errors: Uncertainty = Uncertainty(),
) -> Measurements:
    """Measure a standing person as a tape would: girths are lengths of convex hulls of plane cuts, without the arms.

    Of limbs the mean of left and right is given, the more certain one with more weight. All
    is measured on the surface as it is scanned, over what is worn.

    Parameters
    ----------
    mesh : Mesh
        Closed, avatar frame [m]: Z up, facing -Y, soles on the floor.
    skeleton : Skeleton
        In the same frame.
    weights : SkinWeights
        Of the mesh's vertices.
    views : sequence of ViewError
        Of the scan (:func:`.uncertainty.view_errors`); without them a mesh counts as seen without errors of mirrors.
    errors : Uncertainty
        What else the bounds follow from.

    Raises
    ------
    MirrorScanError
        When the weights are not of this mesh, or a part of the body is missing where it is measured.

    Notes
    -----
    Levels as ISO 8559-1:2017 has them, found by the skeleton. Chest: level, at the nipples, estimated from the shape.
    Waist: smallest level girth from 2 % of height below the joint Spine up to Spine1. Hip: largest level girth from the
    crotch to Spine. Upper arm: middle of the bone, square to it. Thigh: square to the bone, highest cut with nothing
    but thigh in it. Calf: largest, square to the bone. Neck: shortest, free to tilt. Height and inside leg: as the
    person stands in the scan; ``height_standing``: with legs, trunk and head straightened. Arm: acromion, elbow, wrist
    along the bones. Shoulders: the shortest way across the back between the acromia. About 2 s for 60 000 triangles.
    """
    body = body_of(mesh, skeleton, weights)
    crotch = crotch_level(body)
    trunk = joint_spread(body, errors, "Spine", "Spine1")
    level, level_spread = chest_level(body)
    girths: dict[str, list[Girth]] = {
        "chest": [at_level(body, level, level_spread, "chest")],
        "waist": [waist(body, trunk)],
        "hip": [hip(body, crotch.level, trunk)],
        "thigh": [thigh(body, side, crotch) for side in (0, 1)],
        "calf": [calf(body, side) for side in (0, 1)],
        "upper_arm": [upper_arm(body, side, joint_spread(body, errors, *_arm(side)[:2])) for side in (0, 1)],
        "neck": [neck(body)],
    }
    tall = height(body)
    upright = Length(tall.length + straightening(body), tall.line, tall.unseen)
    posture = _POSTURE * body.height
    arms, shoulders = (_arm(0) + _arm(1), ("LeftArm", "RightArm"))
    lengths: dict[str, tuple[list[Length], float]] = {
        "height": ([tall], 0.0),
        "height_standing": ([upright], float(np.hypot(0.5 * joint_spread(body, errors, "Hips", "Neck"), posture))),
        "inseam": ([inseam(body, crotch.level)], crotch.spread),
        "arm_length": ([arm_length(body, side) for side in (0, 1)], joint_spread(body, errors, *arms)),
        "shoulder_width": ([shoulder_width(body)], joint_spread(body, errors, *shoulders)),
    }
    found = {name: _of_girths(body, name, of, views, errors) for name, of in girths.items()}
    found |= {name: _of_lengths(name, of, placement, views, errors) for name, (of, placement) in lengths.items()}
    return {name: found[name] for name in ISO_NAMES}


def _arm(side: int) -> tuple[str, ...]:
    return tuple(SIDES[side] + part for part in ("Arm", "ForeArm", "Hand"))


def _of_girths(body: Body, name: str, of: list[Girth], views: Sequence[ViewError], errors: Uncertainty) -> Measurement:
    lengths, bounds = np.array([girth_estimate(body, girth, name, views, errors) for girth in of]).T
    weight = 1.0 / bounds**2 if (bounds > 0.0).all() else np.ones(len(of))
    weight /= weight.sum()
    length, error = float(weight @ lengths), float(weight @ bounds)
    return Measurement(
        name, ISO_NAMES[name], 1000.0 * length, 1000.0 * error, tuple(girth.tape.loop for girth in of), True
    )


def _of_lengths(
    name: str, of: list[Length], placement: float, views: Sequence[ViewError], errors: Uncertainty
) -> Measurement:
    length = float(np.mean([one.length for one in of]))
    error = float(np.mean([length_error(one, placement, views, errors) for one in of]))
    return Measurement(name, ISO_NAMES[name], 1000.0 * length, 1000.0 * error, tuple(one.line for one in of), False)
