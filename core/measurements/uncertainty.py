"""How far a length may be off: noise and bias of each view, surface that nobody saw, joints that are not certain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..avatar.skeleton import BONES
from ..numeric.rotations import unit
from .body import Body, measured
from .girths import Girth
from .lengths import Length
from .tape import DIRECTIONS

_COVERED = 1.96  # standard deviations that hold 95 %


@dataclass(frozen=True)
class ViewError:
    """What is known of one view's errors, standard deviations.

    Parameters
    ----------
    viewer : np.ndarray [shape=(3,), dtype=float64]
        The camera, or its mirror image, in the mesh's frame [m].
    noise : float
        Of one reading, independent of its neighbours [m].
    shift : float
        Of the whole view along its lines of sight [m].
    """

    viewer: np.ndarray
    noise: float
    shift: float


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations [m] from which errors of lengths follow; calibrated on scans of simulated mannequins.

    Parameters
    ----------
    shift : float
        Of any view, whatever its mirror: bias of the sensor and of what skin and glass do to its light.
    skin : float
        Of surface anywhere, as it is smoothed by meshing, in proportion to nothing; correlated along a tape.
    filled : float
        Of surface that no view saw, beside what was seen.
    joint : float
        Of a joint, beside what its confidence says, as a share of body height.
    """

    shift: float = 0.0015
    skin: float = 0.0007
    filled: float = 0.006
    joint: float = 0.005


def view_errors(report: dict) -> tuple[ViewError, ...]:
    """The views of a ``report.json``, in the order in which :attr:`.Mesh.view` counts them, in the avatar frame.

    A mirror's displacement is stated by the report; one whose displacement is not known counts as exact, as the shift of
    every view is added.
    """
    to_avatar = np.array(report["camera_to_avatar"], dtype=np.float64)
    mirrors = {mirror["name"]: mirror for mirror in report["mirrors"]}
    found = []
    for view in report["views"]:
        viewer, shift = np.array([0.0, 0.0, 0.0, 1.0]), 0.0
        if (mirror := mirrors.get(view["name"])) is not None:
            normal = unit(np.array(mirror["normal"], dtype=np.float64))
            viewer[:3] = 2.0 * (normal @ np.array(mirror["point"], dtype=np.float64)) * normal  # of the camera, at 0
            shift = (mirror["displacement_mm"] or 0.0) / 1000.0
        found.append(ViewError((to_avatar @ viewer)[:3], (view["noise_mm"] or 0.0) / 1000.0, shift))
    return tuple(found)


def joint_spread(body: Body, errors: Uncertainty, *joints: str) -> float:
    """How far the worst of these joints may be off, 95 % [m]; the confidence of a joint is exp(-spread / 2 % of
    height)."""
    confidence = np.array([body.skeleton.confidence[BONES.index(name)] for name in joints])
    if (confidence >= 1.0).all():
        return 0.0
    spread = -0.02 * np.log(np.maximum(confidence, 1e-3)).max()
    return float(_COVERED * np.hypot(spread, errors.joint) * body.height)


def girth_error(body: Body, girth: Girth, views: Sequence[ViewError], errors: Uncertainty) -> float:
    """A 95 % bound of a girth [m].

    A tape's length is the integral of its tangents' distance over all directions (Cauchy), so an error of the surface
    counts by the angle over which the tape rests on it: a view that is off along its line of sight by the cosine
    between that line and the direction, surface that nobody saw by its whole angle.
    """
    step = 2.0 * np.pi / DIRECTIONS
    tape, cut = girth.tape, girth.cut
    seen_triangle = measured(body.mesh)[cut.triangle]
    seen_point = np.ones(len(cut.points), np.bool_)
    np.logical_and.at(seen_point, cut.segments.ravel(), np.repeat(seen_triangle, 2))
    seen = seen_point[tape.rests_on]
    variance = (errors.filled * step * (~seen).sum()) ** 2 + (errors.skin * 2.0 * np.pi) ** 2
    view = np.zeros(DIRECTIONS, np.int64) if body.mesh.view is None else _views_of(body, girth)
    for number, one in enumerate(views):
        mine = seen & (view == number)
        if mine.any():
            towards = one.viewer - cut.points[tape.rests_on[mine]]
            cosine = (tape.outward[mine] * towards).sum(axis=1) / np.linalg.norm(towards, axis=1)
            count = len(np.unique(tape.rests_on[mine]))
            variance += (np.hypot(errors.shift, one.shift) * step * cosine.sum()) ** 2
            variance += (one.noise * step * mine.sum()) ** 2 / count
    return float(np.hypot(_COVERED * np.sqrt(variance), girth.placement))


def _views_of(body: Body, girth: Girth) -> np.ndarray:
    """Which view saw what the tape rests on in each direction (DIRECTIONS,); -1 = none."""
    assert body.mesh.view is not None
    return body.mesh.view[girth.cut.edge[girth.tape.rests_on]].max(axis=1).astype(np.int64)


def length_error(
    body: Body, length: Length, joints: Sequence[str], views: Sequence[ViewError], errors: Uncertainty
) -> float:
    """A 95 % bound of a length that ends on the mesh, the floor and at joints [m]."""
    shift = max((np.hypot(errors.shift, one.shift) for one in views), default=errors.shift)
    ends = [0.0 if measured(body.mesh)[triangle] else errors.filled for triangle in length.triangles]
    surface = np.sqrt(2.0 * shift**2 + sum(end**2 for end in ends) + 2.0 * errors.skin**2)
    return float(np.hypot(_COVERED * surface, joint_spread(body, errors, *joints) if joints else 0.0))
