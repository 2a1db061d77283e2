"""How far a length may be off: noise and bias of each view, surface that nobody saw, joints that are not certain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..avatar.skeleton import BONES
from ..numeric.rotations import unit
from .body import Body, measured
from .girths import Girth
from .lengths import Length
from .tape import DIRECTIONS

_COVERED = 1.96  # standard deviations that hold 95 %
# By how much a tape is too short, and the spread of that, as a share of its length, where half of it nobody saw.
_SHORT = {"neck": (0.042, 0.032), "thigh": (0.006, 0.0)}
# Girths that follow from what was seen alone: by how much they come out too short, as a share of the girth and of the
# standard deviation expected of them, since views lose the edges of what they see; where half or more is unseen.
_ROUND = {"upper_arm": (0.058, 0.6), "calf": (0.01, 0.4)}
_EXPECTED, _ROUND_SPREAD = 0.65, 0.025  # of their spread: of what is expected, and beside it of the girth
_SMEARED = 2.0 * np.pi * 0.5  # noise makes limbs that are a few pixels wide thicker, by about half of it
_MOST_UNSEEN = 4.0  # unseen directions, as a multiple of the seen: what is more is reckoned as this
_HAIR_AND_SOLES = 2.0  # thicknesses of cloth
_FILL_REACH = np.radians(30.0)  # over which filled surface errs alike
_DIRECTIONS = 72  # in which a cross-section is looked at; a divisor of ``DIRECTIONS``
_ANY_PLACE = 2.0  # of a cross-section whose size and place follow from nothing but what was seen, in mean radii
_LEAST_SEEN = 6  # directions from which the size of a cross-section can follow
_ROUNDS = 4  # until size and expectation agree
_LONGEST = 3.0  # tapes: what is seen of a narrow strip may be of anything
# Of the Fourier coefficients (cosine and sine alike) of cross-sections' tangent distance, from order 0, in mean radii.
_SHAPE = (0.5, 0.3, 0.07, 0.02, 0.015, 0.006, 0.006, 0.004, 0.004, 0.002, 0.002, 0.001, 0.001)


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

    def total(self, errors: Uncertainty) -> float:
        """Standard deviation of the whole view along its lines of sight, whatever the reason [m]."""
        alike = self.noise * (errors.correlated + self.noise / errors.smeared)
        return float(np.sqrt(errors.shift**2 + self.shift**2 + alike**2))


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations [m] from which errors of lengths follow; calibrated on scans of simulated mannequins.

    Parameters
    ----------
    shift : float
        Of any view, whatever its mirror: bias of the sensor and of what skin and glass do to its light.
    correlated : float
        Of a view, beside that, as a share of the noise of its readings: neighbours err alike.
    smeared : float
        Noise of so much adds once more as much again: a camera that is so noisy smears edges [m].
    skin : float
        Of surface anywhere, all round a tape alike.
    end : float
        Of the top of a head that nobody saw.
    rough : float
        Of any reading, beside its noise, independent in directions 5° apart.
    filled : float
        Of surface that no view saw, beside what was seen.
    cloth : float
        Of what is worn, beside 0: then the bounds are about the body beneath, and hair and soles count. Some 0.011 for
        everyday clothes.
    joint : float
        Of a joint, beside what its confidence says, as a share of body height.
    """

    shift: float = 0.0012
    correlated: float = 0.6
    smeared: float = 0.009
    skin: float = 0.0005
    end: float = 0.018
    rough: float = 0.001
    filled: float = 0.0095
    joint: float = 0.003
    cloth: float = 0.0


def view_errors(report: dict) -> tuple[ViewError, ...]:
    """The views of a ``report.json``, in the order in which :attr:`.Mesh.view` counts them, in the avatar frame.

    A mirror's displacement is stated by the report; one that is not known counts as 0.
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
    """How far the worst of these joints may be off, 95 % [m]; from their confidence, calibrated on mannequins."""
    confidence = np.array([body.skeleton.confidence[BONES.index(name)] for name in joints])
    if (confidence >= 1.0).all():
        return 0.0
    spread = -0.010 * np.log(np.maximum(confidence, 1e-3)).max()
    return float(_COVERED * np.hypot(spread, errors.joint) * body.height)


class TapeEstimate(NamedTuple):
    """Length of a tape and its 95 % bound [m]."""

    length: float
    error: float


def girth_estimate(
    body: Body, girth: Girth, name: str, views: Sequence[ViewError], errors: Uncertainty
) -> TapeEstimate:
    """A girth, with what is known of cross-sections where nobody saw the surface, and its 95 % bound.

    A tape's length is the integral of its tangents' distance h over all directions (Cauchy). h is taken for a Gaussian
    process on the circle whose Fourier coefficients have the spread that cross-sections of people have. Where the tape
    rests on surface that a view saw, h is read with the view's noise and its shift along the line of sight; where it
    rests on filled surface, with a large error that neighbouring directions share. Seen directions keep what was read;
    the others get the expected value. The error follows by propagation through both.

    Of upper arms and calves what is filled counts for nothing, and size and place of the cross-section are free: a
    round limb follows from an arc of it, while what closes the gap of an arm whose back nobody saw is flat. Views lose
    the edges of limbs and necks, so that too little is expected even then: what is missing grew in scans of mannequins
    and bodies with the standard deviation, of necks with the ratio of unseen to seen directions.
    """
    tape, cut = girth.tape, girth.cut
    chosen = np.arange(0, DIRECTIONS, DIRECTIONS // _DIRECTIONS)
    rests_on, outward = tape.rests_on[chosen], tape.outward[chosen]
    points = cut.points[rests_on]
    seen_point = np.ones(len(cut.points), np.bool_)
    np.logical_and.at(seen_point, cut.segments.ravel(), np.repeat(measured(body.mesh)[cut.triangle], 2))
    seen = seen_point[rests_on]
    read = (outward * (points - cut.points.mean(axis=0))).sum(axis=1)
    radius = tape.length / (2.0 * np.pi)
    prior = radius**2 * _SHAPES
    noise = _reading_errors(body, girth, chosen, seen, views, errors)
    step = 2.0 * np.pi / _DIRECTIONS
    everywhere = (errors.skin**2 + errors.cloth**2) * (2.0 * np.pi) ** 2
    if name in _ROUND and seen.sum() >= _LEAST_SEEN:
        length, variance = _of_seen(read, seen, noise, tape.length)
        share, deviations = _ROUND[name]
        missing = min(2.0 * float((~seen).mean()), 1.0)
        length += share * missing * length + deviations * np.sqrt(variance)
        known = (
            _EXPECTED * np.sqrt(variance),
            _ROUND_SPREAD * missing * length,
            _SMEARED * _mean_noise(body, girth, chosen, views),
        )
        spread = np.sqrt(np.square(known).sum() + everywhere)
        return TapeEstimate(length + girth.extra, float(np.hypot(_COVERED * spread, girth.placement)))
    gain = np.linalg.solve(prior + noise, prior).T  # readings → expected values
    of_readings = np.where(seen, step, 0.0) + step * gain[~seen].sum(axis=0)
    correction = (of_readings - step) @ (read - radius)
    left = of_readings - step
    variance = left @ prior @ left + of_readings @ noise @ of_readings + everywhere
    short, spread = _SHORT.get(name, (0.0, 0.0))
    unseen = tape.length * min(float((~seen).sum() / max(seen.sum(), 1)), _MOST_UNSEEN)
    correction += short * unseen + girth.extra
    variance += (spread * unseen) ** 2
    return TapeEstimate(tape.length + correction, float(np.hypot(_COVERED * np.sqrt(variance), girth.placement)))


def _of_seen(read: np.ndarray, seen: np.ndarray, noise: np.ndarray, tape: float) -> tuple[float, float]:
    """A girth [m] and its variance [m²] from the seen directions alone, whose readings stay as they are.

    Of the others h is expected as of a cross-section that may be of any size and anywhere; how far it may differ from a
    circle grows with its size, so that size and expectation take turns.
    """
    step = 2.0 * np.pi / _DIRECTIONS
    length = tape
    for _ in range(_ROUNDS):
        radius = length / (2.0 * np.pi)
        prior = radius**2 * _SHAPES_ANYWHERE
        gain = np.linalg.solve((prior + noise)[np.ix_(seen, seen)], prior[seen]).T
        expected = radius + gain @ (read[seen] - radius)
        length = float(np.clip(step * np.where(seen, read, expected).sum(), tape / _LONGEST, tape * _LONGEST))
    left = prior - gain @ prior[seen]
    return length, float(step**2 * left.sum())


def _shapes(spread: tuple[float, ...]) -> np.ndarray:
    """Covariance of h between directions, for a mean radius of 1; of Fourier coefficients with this ``spread``."""
    angle = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    apart = angle[:, None] - angle[None]
    orders = np.arange(len(spread))
    return (np.square(spread)[:, None, None] * np.cos(orders[:, None, None] * apart)).sum(axis=0)


_SHAPES = _shapes(_SHAPE)
_SHAPES_ANYWHERE = _shapes((_ANY_PLACE, _ANY_PLACE, *_SHAPE[2:]))


def _alike() -> np.ndarray:
    """Correlation of filled surface between directions."""
    angle = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    apart = np.abs(np.angle(np.exp(1j * (angle[:, None] - angle[None]))))
    return np.exp(-0.5 * (apart / _FILL_REACH) ** 2)


_ALIKE = _alike()


def _reading_errors(
    body: Body, girth: Girth, chosen: np.ndarray, seen: np.ndarray, views: Sequence[ViewError], errors: Uncertainty
) -> np.ndarray:
    """Covariance of what is read in the ``chosen`` directions [m²]."""
    rests_on, outward = girth.tape.rests_on[chosen], girth.tape.outward[chosen]
    size = len(chosen)
    fill = np.where(seen, 0.0, errors.filled)
    covariance = fill[:, None] * fill[None] * _ALIKE + np.eye(size) * errors.rough**2
    view = np.zeros(size, np.int64)
    if body.mesh.view is not None:
        view = body.mesh.view[girth.cut.edge[rests_on]].max(axis=1).astype(np.int64)
    for number, one in enumerate(views):
        mine = seen & (view == number)
        if not mine.any():
            continue
        towards = one.viewer - girth.cut.points[rests_on[mine]]
        effect = np.zeros(size)
        effect[mine] = (outward[mine] * towards).sum(axis=1) / np.linalg.norm(towards, axis=1)
        effect *= one.total(errors)
        covariance += effect[:, None] * effect[None] + np.diag(np.where(mine, one.noise**2, 0.0))
    return covariance


def _mean_noise(body: Body, girth: Girth, chosen: np.ndarray, views: Sequence[ViewError]) -> float:
    """Of the readings on which a tape rests in the ``chosen`` directions, without filled surface [m]."""
    if body.mesh.view is None or not views:
        return 0.0
    view = body.mesh.view[girth.cut.edge[girth.tape.rests_on[chosen]]].max(axis=1).astype(np.int64)
    noise = np.array([one.noise for one in views])
    known = (view >= 0) & (view < len(noise))
    return float(noise[view[known]].mean()) if known.any() else float(noise.max())


def length_error(length: Length, placement: float, views: Sequence[ViewError], errors: Uncertainty) -> float:
    """A 95 % bound of a length that ends on the mesh and at places known to ``placement``, 95 % [m]."""
    shift = max((one.total(errors) for one in views), default=errors.shift)
    variance = (
        errors.skin**2 + (_HAIR_AND_SOLES * errors.cloth) ** 2 + 0.5 * shift**2 + (length.unseen * errors.end) ** 2
    )
    return float(np.hypot(_COVERED * np.sqrt(variance), placement))
