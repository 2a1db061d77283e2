"""Lengths: body height, inside leg, arm, and across the back of the shoulders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import MirrorScanError
from ..numeric.rotations import unit
from .body import SIDES, UP, Body
from .tape import lay_tape, plane_axes

_LEG = 0.9925  # cosine of thigh and shin from the vertical in the body template's standing pose
_LEG_BONES = (("UpLeg", "Leg"), ("Leg", "Foot"))
_SHOULDER = 0.1  # of body height: the acromion lies no higher above the joint of the arm
_TILTS = np.radians(np.linspace(-10.0, 70.0, 33))  # of the tape across the back, up from level


@dataclass(frozen=True)
class Length:
    """A straight or bent line.

    Parameters
    ----------
    length : float
        [m]
    line : np.ndarray [shape=(K, 3), dtype=float64]
        Its points in order [m].
    triangles : tuple of int
        Of the mesh, on which its ends rest; empty for an end on the floor or in the body.
    """

    length: float
    line: np.ndarray
    triangles: tuple[int, ...] = ()


def height(body: Body) -> Length:
    """From the floor to the top of the head, as the person stands in the scan."""
    top = int(np.where(body.head > 0.5, body.mesh.vertices[:, 2], -np.inf).argmax())
    point = body.mesh.vertices[top]
    foot = np.array([point[0], point[1], body.floor])
    return Length(float(point[2] - body.floor), np.stack((foot, point)), (_triangle_at(body, top),))


def straightening(body: Body) -> float:
    """How much taller the person would be upright [m]: legs as in the body template's standing pose, trunk and head
    upright."""
    gained = [_rise(body, "Hips", "Neck", 1.0)]
    crown, head = body.skeleton.ends[0], body.joint("Head")
    gained.append(float(np.linalg.norm(crown - head) - (crown - head)[2]))
    for side in SIDES:
        gained += [0.5 * _rise(body, side + start, side + end, -_LEG) for start, end in _LEG_BONES]
    return float(sum(gained))


def _rise(body: Body, start: str, end: str, wanted: float) -> float:
    """What is gained in height by turning a bone until it points up by ``wanted``, a cosine [m]."""
    along = body.joint(end) - body.joint(start)
    return float(abs(wanted) * np.linalg.norm(along) - np.sign(wanted) * along[2])


def inseam(body: Body, crotch: float) -> Length:
    """From the level at which the legs part to the floor, as the person stands in the scan."""
    middle = 0.5 * (body.joint("LeftUpLeg") + body.joint("RightUpLeg"))
    line = np.array([[middle[0], middle[1], body.floor], [middle[0], middle[1], crotch]])
    return Length(float(crotch - body.floor), line)


def acromion(body: Body, side: int) -> tuple[np.ndarray, int]:
    """The skin's point above the joint of an arm, along the trunk, and its triangle."""
    joint = body.joint(f"{SIDES[side]}Arm")
    up = unit(body.joint("Neck") - body.joint("Hips"))
    first, second = plane_axes(up)
    corners = body.mesh.vertices[body.mesh.triangles] - joint
    x, y = corners @ first, corners @ second
    # the origin's barycentric coordinates in each triangle seen from above
    area = np.stack([np.roll(x, -1, 1)[:, k] * np.roll(y, -2, 1)[:, k] - np.roll(x, -2, 1)[:, k] * np.roll(y, -1, 1)[:, k]
                     for k in range(3)], axis=1)  # fmt: skip
    total = area.sum(axis=1)
    hit = np.flatnonzero(((area >= 0).all(axis=1) | (area <= 0).all(axis=1)) & (np.abs(total) > 1e-14))
    shares = area[hit] / total[hit, None]
    above = (shares * (corners[hit] @ up)).sum(axis=1)
    reach = (above > 0) & (above < _SHOULDER * body.height)
    if not reach.any():
        raise MirrorScanError(
            f"measurements: there is no skin above the {SIDES[side].lower()} shoulder's joint; "
            "check that the skeleton fits the mesh"
        )
    best = int(np.where(reach, above, np.inf).argmin())
    return joint + above[best] * up, int(hit[best])


def arm_length(body: Body, side: int) -> Length:
    """From the acromion by the elbow to the wrist, along the bones."""
    shoulder, triangle = acromion(body, side)
    line = np.stack((shoulder, body.joint(f"{SIDES[side]}ForeArm"), body.joint(f"{SIDES[side]}Hand")))
    return Length(float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()), line, (triangle,))


def shoulder_width(body: Body) -> Length:
    """The shortest tape across the back from acromion to acromion, over a plane through both that may tilt."""
    ends = [acromion(body, side) for side in (1, 0)]
    (right, _), (left, _) = ends
    across = unit(left - right)
    up = unit(UP - (UP @ across) * across)
    back = np.cross(up, across)  # +y where the left is +x
    span = float(np.linalg.norm(left - right))
    best = Length(np.inf, np.empty((0, 3)))
    for tilt in _TILTS:
        behind = np.cos(tilt) * back + np.sin(tilt) * up
        normal = np.cross(across, behind)
        points = body.cut(right, normal).points
        u, w = (points - right) @ across, (points - right) @ behind
        kept = points[(u > 0) & (u < span) & (w > 0) & (w < span)]
        tape = lay_tape(np.concatenate((ends[0][0][None], kept, ends[1][0][None])), normal)
        if tape.length - span < best.length:
            start = int(np.linalg.norm(tape.loop - right, axis=1).argmin())
            line = np.roll(tape.loop, -start, axis=0)
            if np.linalg.norm(line[1] - left) < 1e-9:  # the straight way first
                line = np.roll(line[::-1], 1, axis=0)
            best = Length(tape.length - span, line, (ends[0][1], ends[1][1]))
    return best


def _triangle_at(body: Body, vertex: int) -> int:
    return int(np.flatnonzero((body.mesh.triangles == vertex).any(axis=1))[0])
