"""How a person who stands as still as people can comes to stand a little otherwise from one scan to the next."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import MirrorScanError
from ..mesh import Mesh
from ..numeric.rotations import from_vectors

ANKLES, HIPS, NECK = 0.047, 0.53, 0.86
"""Heights of joints, of the body's (Winter, "Biomechanics and motor control of human movement", 2009)."""

_BLEND = 0.05  # of the height: the skin about a joint bends over this much
_PARTS = {ANKLES: 0.78, HIPS: 0.58, NECK: 0.23}  # of the sway, what bending there moves the crown by; squares add to 1
_ARMS, _KNEES = (0.15, 0.18), 0.29  # of the height: what is so far aside and above the knees is an arm
_TWIST = 0.25  # m: a hand or shoulder this far from the vertical is moved by the sway when the trunk twists


def swayed(body: Mesh, sway: float, rng: np.random.Generator) -> Mesh:
    """The body as it stands at another moment.

    Quiet standing sways about the ankles like a pendulum and, for what that does not balance, about the hips (Horak and
    Nashner 1986, Winter 1995). Each is drawn as a small rotation about a horizontal axis of any direction, what is
    above it follows; the head nods a little, the trunk twists about the vertical. The soles stay. So the shift grows
    with the height and is no rigid motion.

    Parameters
    ----------
    body : Mesh
        Avatar frame, soles on z = 0 [m].
    sway : float
        Root mean square shift of the crown along the floor [m].
    rng : np.random.Generator

    Raises
    ------
    MirrorScanError
        When it is negative, not finite, or more than a person can sway without a step.
    """
    if not 0.0 <= sway <= 0.1:
        raise MirrorScanError(f"sway: a crown moves by 0 to 0.1 m while a person stands, not by {sway} m")
    if sway == 0.0:
        return body
    height = float(body.vertices[:, 2].max())
    points = np.array(body.vertices, np.float64)
    start = points[:, 2].copy()
    for joint in (NECK, HIPS, ANKLES):
        low = joint * height
        shift = sway * _PARTS[joint] * rng.standard_normal(2) / np.sqrt(2.0)
        axis = np.array([-shift[1], shift[0], 0.0]) / (height - low)
        if joint == HIPS:
            axis[2] = sway / _TWIST * rng.standard_normal() / 2.0
        share = np.clip((start - low) / (_BLEND * height) + 0.5, 0.0, 1.0)
        if joint == HIPS:  # hanging arms follow the trunk, however low they reach
            beside = np.clip((np.abs(body.vertices[:, 0]) / height - _ARMS[0]) / (_ARMS[1] - _ARMS[0]), 0.0, 1.0)
            share = np.maximum(share, np.where(start > _KNEES * height, beside, 0.0))
        share = share**2 * (3.0 - 2.0 * share)
        at = np.array([0.0, 0.0, low])
        points = at + np.einsum("nij,nj->ni", from_vectors(share[:, None] * axis), points - at)
    return replace(body, vertices=points.astype(body.vertices.dtype))
