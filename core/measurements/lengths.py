"""Lengths: body height, inside leg, arm, and across the back of the shoulders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import MirrorScanError
from ..numeric.rotations import unit
from .body import SIDES, UP, Body, measured
from .plane_cuts import cut_by_plane, plane_axes
from .tape import lay_tape

_LEG = 0.9925  # cosine of thigh and shin from the vertical in the body template's standing pose
_LEG_BONES = (("UpLeg", "Leg"), ("Leg", "Foot"))
_CAP, _SECTIONS = 0.035, 30  # of body height: the top of the head, and level sections of it
_SECTION = (0.07, 0.17)  # girths of those that are used, of body height
_FLATTENED = 0.0055  # of body height: by so much is a top too low that nobody saw at all
_FACE = 0.26  # of body height: girth of a head ``_CAP`` below its top is more, or its back is missing
_HAIRLINE = 0.012  # of body height: how far below the crown
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
    unseen : float
        Which share of the surface that an end was taken from no view saw.
    """

    length: float
    line: np.ndarray
    unseen: float = 0.0


def height(body: Body) -> Length:
    """From the floor to the top of the head, as the person stands in the scan.

    Near its top a head is a paraboloid, whose level sections grow linearly in area: they say where it begins, and a
    spike on it counts for nothing. What nobody saw of it was filled flatter than it is, so that the top is expected a
    little higher. Hair that gave no reading leaves a face without the back of the head: the crown then lies above its
    highest reading, as hairlines do below crowns.
    """
    vertices, triangles = body.mesh.vertices, body.mesh.triangles
    top = float(vertices[:, 2].max())
    near = triangles[(vertices[triangles, 2] > top - _CAP * body.height).any(axis=1)]
    middle, squares, levels = [], [], np.linspace(top, top - _CAP * body.height, _SECTIONS + 1)[1:]
    for level in levels:
        cut = cut_by_plane(vertices, near, np.array([0.0, 0.0, level]), UP)
        loop = cut.loops()
        cut = cut.part(loop == np.bincount(loop).argmax())
        tape = lay_tape(cut.points, UP)
        squares.append(tape.length**2)
        middle.append(tape.loop.mean(axis=0))
    size = np.sqrt(squares) / body.height
    used = (size > _SECTION[0]) & (size < _SECTION[1])
    if used.sum() < 3:  # flat, or a tip
        used, start = np.ones(len(levels), np.bool_), top
    else:
        start = np.polyfit(np.array(squares)[used], levels[used], 1)[1]
    crown = np.array(middle)[used][0] * (1.0, 1.0, 0.0) + (0.0, 0.0, start)
    seen = measured(body.mesh)
    unseen = 1.0 - float(seen[(vertices[triangles, 2] > top - _CAP * body.height).all(axis=1)].mean())
    if unseen > 0.0 and size[-1] < _FACE:
        start, unseen = vertices[triangles[seen], 2].max() + _HAIRLINE * body.height, 1.0
    else:
        start += _FLATTENED * unseen * body.height
    crown[2] = start
    return Length(float(start), np.stack((crown * (1.0, 1.0, 0.0), crown)), unseen)


def straightening(body: Body) -> float:
    """How much taller the person would be upright: legs as in the body template's rest pose, trunk and head up [m]."""
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
    """From the level of the crotch to the floor, as the person stands in the scan."""
    middle = 0.5 * (body.joint("LeftUpLeg") + body.joint("RightUpLeg"))
    line = np.array([[middle[0], middle[1], 0.0], [middle[0], middle[1], crotch]])
    return Length(float(crotch), line)


def acromion(body: Body, side: int) -> np.ndarray:
    """The skin's point (3,) above the joint of an arm, along the trunk [m]."""
    joint = body.joint(f"{SIDES[side]}Arm")
    up = unit(body.joint("Neck") - body.joint("Hips"))
    corners = body.mesh.vertices[body.mesh.triangles] - joint
    x, y = (corners @ axis for axis in plane_axes(up))
    area = np.roll(x, -1, 1) * np.roll(y, -2, 1) - np.roll(x, -2, 1) * np.roll(y, -1, 1)  # against each corner
    total = area.sum(axis=1)
    hit = np.flatnonzero(((area >= 0).all(axis=1) | (area <= 0).all(axis=1)) & (np.abs(total) > 1e-14))
    shares = area[hit] / total[hit, None]
    above = (shares * (corners[hit] @ up)).sum(axis=1)
    reach = (above > 0) & (above < _SHOULDER * body.height)
    if not reach.any():
        raise MirrorScanError(
            f"measurements: there is no skin above the {SIDES[side].lower()} shoulder's joint; "
            "check that the skeleton fits the mesh",
            code="no_person",
        )
    return joint + above[reach].min() * up


def arm_length(body: Body, side: int) -> Length:
    """From the acromion by the elbow to the wrist, along the bones."""
    shoulder = acromion(body, side)
    line = np.stack((shoulder, body.joint(f"{SIDES[side]}ForeArm"), body.joint(f"{SIDES[side]}Hand")))
    return Length(float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()), line)


def shoulder_width(body: Body) -> Length:
    """The shortest tape across the back from acromion to acromion, over a plane through both that may tilt."""
    right, left = (acromion(body, side) for side in (1, 0))
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
        tape = lay_tape(np.concatenate((right[None], kept, left[None])), normal)
        if tape.length - span < best.length:
            start = int(np.linalg.norm(tape.loop - right, axis=1).argmin())
            line = np.roll(tape.loop, -start, axis=0)
            if np.linalg.norm(line[1] - left) < 1e-9:  # the straight way first
                line = np.roll(line[::-1], 1, axis=0)
            best = Length(tape.length - span, line)
    return best
