"""Whether a mesh is of a whole standing person; otherwise the reason, in words."""

from __future__ import annotations

import numpy as np

from ...errors import ReconstructionError
from ...mesh import Mesh
from ..skeleton import BONES
from .body_template import BodyTemplate
from .template_fit import Fit

_HEIGHTS = (0.4, 2.7)  # [m]
_BREADTH = 1.25  # of its height: what is broader than that, arms spread, does not stand
_MET, _STRANGE = 0.035, 0.05  # of body height: a sample belongs to the body nearer than that, or is strange beyond
_MOST_STRANGE = 0.1  # share of strange surface that clothes, hair and noise may make up
_MISSING = 0.25  # share of a part's usual surface below which it is not there
_WHOLE = 0.6  # share above which nearly all of a part is there
_STANDS = (0.01, 0.1)  # of body height: who ends so far above the floor stands on it with feet that were not read
_CUT = 0.035  # of body height: so far below the fitted crown the head is cut off
_ODD = 0.75  # standard deviations, all components together: no person's shape is further from the mean
# Bones of each part, and how many samples it gets, next to its share of the template's points, from whole people.
_PARTS = {
    "head": (("Head", "Neck"), 0.9),
    "left upper arm": (("LeftArm",), 0.95), "right upper arm": (("RightArm",), 0.95),
    "left forearm": (("LeftForeArm",), 0.65), "right forearm": (("RightForeArm",), 0.65),
    "left thigh": (("LeftUpLeg",), 1.3), "right thigh": (("RightUpLeg",), 1.3),
    "left lower leg": (("LeftLeg",), 1.6), "right lower leg": (("RightLeg",), 1.6),
    "left foot": (("LeftFoot", "LeftToeBase"), 0.7), "right foot": (("RightFoot", "RightToeBase"), 0.7),
}  # fmt: skip


def check_standing(mesh: Mesh) -> None:
    """Refuse what has not the size of a standing person.

    Raises
    ------
    ReconstructionError
    """
    if not len(mesh.triangles):
        raise ReconstructionError(
            "skeleton: the mesh has no triangles; reconstruct the capture first", code="no_person"
        )
    size = np.ptp(mesh.vertices, axis=0)
    if not _HEIGHTS[0] <= size[2] <= _HEIGHTS[1]:
        raise ReconstructionError(
            "skeleton: the mesh is {height:.2f} m high, no person's height; give one whole person "
            "who stands upright, in metres, Z up", height=float(size[2]), code="no_person",
        )  # fmt: skip
    if max(size[:2]) > _BREADTH * size[2]:
        raise ReconstructionError(
            "skeleton: the mesh is {breadth:.2f} m broad and only {height:.2f} m high, so nobody stands in it; give "
            "one whole person who stands upright, Z up", breadth=float(max(size[:2])), height=float(size[2]),
            code="no_person",
        )  # fmt: skip


def check_person(template: BodyTemplate, found: Fit, bottom: float, top: float) -> None:
    """Refuse a mesh that the template does not fit, or of which a part is missing.

    Parameters
    ----------
    template : BodyTemplate
    found : Fit
    bottom, top : float
        Heights of the mesh's lowest and highest point above the floor [m].

    Raises
    ------
    ReconstructionError
    """
    odd = np.sqrt(np.mean(found.state.shape**2)) > _ODD
    strange = np.mean(found.to_body > _STRANGE * found.state.height)
    shares = part_shares(template, found)
    missing = [name for name, share in shares.items() if share < _MISSING]
    # What a camera lost of one side is taken from the other, with little confidence; feet above a floor stand on it.
    forearms = [side for side in ("Left", "Right") if forearm_missing(shares, side)]
    if len(forearms) == 1:
        missing.remove(f"{forearms[0].lower()} forearm")
    feet = [side for side in ("Left", "Right") if foot_missing(shares, side)]
    if len(feet) == 1 or stands_unread(bottom, found.state.height):
        missing = [name for name in missing if name not in [f"{side.lower()} foot" for side in feet]]
    if found.body.ends[0, 2] > top + _CUT * found.state.height:
        missing = [*missing, "top of the head"]
    if odd or strange > _MOST_STRANGE or len(missing) > 4:
        raise ReconstructionError(
            "skeleton: the mesh has not the shape of a whole person who stands upright and faces -Y; check that "
            "nothing else was reconstructed with the person, and take the whole body from head to feet",
            code="no_person",
        )
    if missing:
        raise ReconstructionError(
            "skeleton: no {parts} found in the mesh; take the snapshot again with the whole person in the picture and "
            "in the mirrors, arms away from the trunk", parts=" and no ".join(missing), code="no_person",
        )  # fmt: skip


def forearm_missing(shares: dict[str, float], side: str) -> bool:
    """Whether the surface of an arm, "Left" or "Right", ends about its elbow."""
    return shares[f"{side.lower()} forearm"] < _MISSING and shares[f"{side.lower()} upper arm"] > _WHOLE


def foot_missing(shares: dict[str, float], side: str) -> bool:
    """Whether the surface of a leg, "Left" or "Right", ends about its ankle."""
    return shares[f"{side.lower()} foot"] < _MISSING and shares[f"{side.lower()} lower leg"] > _WHOLE


def stands_unread(bottom: float, height: float) -> bool:
    """Whether a body stands on the floor z = 0 with feet that were not read: ``bottom`` is its lowest point [m].

    Without a known floor the lowest point is at 0.
    """
    return _STANDS[0] * height < bottom < _STANDS[1] * height


def part_shares(template: BodyTemplate, found: Fit) -> dict[str, float]:
    """Surface that was found of each part of the body, next to what it usually is; 1 = all of it."""
    bone = np.argmax(template.weights, axis=1)
    claimed = bone[found.partner[found.to_body < _MET * found.state.height]]
    shares = {}
    for name, (bones, usual) in _PARTS.items():
        numbers = [BONES.index(b) for b in bones]
        expected = np.isin(bone, numbers).mean() * len(found.to_body)
        shares[name] = float(np.isin(claimed, numbers).sum() / expected / usual)
    return shares
