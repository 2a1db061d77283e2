"""Fit the body template to a surface: closest points both ways, damped Gauss-Newton steps in shape and pose.

Non-rigid registration by iterated closest points (Allen et al. 2003; Hirshberg et al. 2012): points pair up by place
and normal together, so that an arm that lies at the trunk does not pair with it.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from ...numeric.kernels import njit
from ...numeric.rotations import to_vectors
from ...numeric.threads import each_range
from ..skeleton import BONES, OTHER_SIDE
from .body_template import BodyState, BodyTemplate, PosedBody, derivatives, moved, posed

TANGENT = 0.1  # weight of the distance along the surface, of that across it
_NOISE = 0.025  # of body height: what one pair of many, which err together, says about the body
# Feet of people who stand point 7° outwards (McIlroy and Maki 1997), those of the template's rest pose 2° inwards.
_OUTWARD = np.radians(9.0)
_SOLE = 12  # points of a lost foot's sole that stand on the floor
# How far bones turn from the rest pose, about x, y, z [deg]; the rest has arms some 45° down and elbows a little bent.
_SPREADS = {
    "Hips": (10, 8, 12), "Spine": (5, 4, 5), "Spine1": (5, 4, 5), "Spine2": (5, 4, 5), "Neck": (6, 5, 12),
    "Head": (8, 5, 12), "Shoulder": (3, 8, 5), "Arm": (30, 40, 30), "ForeArm": (20, 10, 20), "Hand": (10, 10, 10),
    "UpLeg": (15, 10, 10), "Leg": (12, 2, 2), "Foot": (10, 8, 12), "ToeBase": (4, 2, 2),
}  # fmt: skip
SPREAD = np.radians([_SPREADS[name.removeprefix("Left").removeprefix("Right")] for name in BONES])


@dataclass(frozen=True)
class Surface:
    """Samples of a mesh: points (S, 3) [m], outward unit normals (S, 3), and how much each counts (S,), about 1."""

    points: np.ndarray
    normals: np.ndarray
    counts: np.ndarray


@dataclass(frozen=True)
class Fit:
    """A state and what it makes, with how well it meets the surface.

    Parameters
    ----------
    state : BodyState
    body : PosedBody
    to_surface : np.ndarray [shape=(N,)]
        From each of the template's points to its partner [m].
    to_body : np.ndarray [shape=(S,)]
        From each sample to its partner [m].
    partner : np.ndarray [shape=(S,), dtype=int64]
        The template's point of each sample.
    information : np.ndarray [shape=(P, P)]
        Of the last step: the inverse of the numbers' covariance.
    """

    state: BodyState
    body: PosedBody
    to_surface: np.ndarray
    to_body: np.ndarray
    partner: np.ndarray
    information: np.ndarray


def fit(
    template: BodyTemplate,
    surface: Surface,
    state: BodyState,
    reaches: np.ndarray,
    rigid: int = 0,
    lost: Collection[int] = (),
    tangent: float = TANGENT,
    floor: float | None = None,
) -> Fit:
    """As many steps as ``reaches`` has numbers.

    Parameters
    ----------
    template : BodyTemplate
    surface : Surface
    state : BodyState
        To begin with.
    reaches : np.ndarray [shape=(R,)]
        Distances at which a pair counts a quarter, in body heights, from far to near.
    rigid : int
        In so many first steps the shape stays.
    lost : collection of int
        Bones whose skin the surface lacks: nothing pairs with it, and they turn as those of the other side.
    tangent : float
        Weight of a pair's distance along the surface, of that across it: it brings limbs that lie apart together, and
        then hinders them from sliding to where they belong.
    floor : float, optional
        Height of the floor, on which lost feet stand [m].
    """
    size = len(state.shape)
    bone = np.argmax(template.weights, axis=1)
    known = ~np.isin(bone, list(lost))
    soles = _soles(template, bone, lost)
    for step, reach in enumerate(reaches):
        body = posed(template, state)
        to_surface, to_body, forth, back = _pairs(body, surface, 0.5 * reach * state.height)
        pull, push = _pair_terms(body, surface, to_surface, to_body, forth, back, reach * state.height, tangent)
        pull[~known], push[~known] = 1e-9 * np.eye(3), 0.0
        if floor is not None:
            pull[soles, 2, 2] += 1.0
            push[soles, 2] += floor - body.points[soles, 2]
        jacobian, _ = derivatives(template, state, body)
        root = np.linalg.cholesky(pull)
        rows = np.einsum("vij,vip->vjp", root, jacobian).reshape(-1, jacobian.shape[2])
        information = rows.T @ rows
        gradient = np.einsum("vi,vip->p", push, jacobian)
        _add_prior(information, gradient, state, body, _usual_turns(state, lost))
        if step < rigid:
            information[4 : 4 + size, 4 : 4 + size] += 1e6 * np.eye(size)
        state = moved(state, body, np.linalg.solve(information, gradient))
    body = posed(template, state)
    to_surface, to_body, _, back = _pairs(body, surface, 0.5 * reaches[-1] * state.height)
    return Fit(state, body, to_surface, to_body, back, information)


def _pairs(body: PosedBody, surface: Surface, bend: float):
    """Partners by place and normal, a normal turned by 60° counting as far as ``bend`` [m]; how far apart [m]."""
    forth, back = np.empty(len(body.points), np.int64), np.empty(len(surface.points), np.int64)
    first = np.column_stack((body.points, bend * body.normals))
    second = np.column_stack((surface.points, bend * surface.normals))
    each_range(_nearest_kernel, len(first), first, second, forth)
    each_range(_nearest_kernel, len(second), second, first, back)
    to_surface = np.linalg.norm(body.points - surface.points[forth], axis=1)
    return to_surface, np.linalg.norm(surface.points - body.points[back], axis=1), forth, back


def _pair_terms(body, surface, to_surface, to_body, forth, back, reach, tangent):
    """Per point of the template: quadratic form (N, 3, 3) and pull (N, 3) of all of its pairs."""
    count = len(body.points)
    of = np.concatenate((np.arange(count), back))
    to = np.concatenate((forth, np.arange(len(back))))
    apart = np.concatenate((to_surface, to_body))
    normal = surface.normals[to]
    agree = np.clip(np.einsum("si,si->s", normal, body.normals[of]), 0.0, 1.0)
    weight = agree * (reach**2 / (reach**2 + apart**2)) ** 2 * surface.counts[to]
    weight[count:] *= count / len(back)
    offset = surface.points[to] - body.points[of]
    form = weight[:, None, None] * ((1 - tangent) * normal[:, :, None] * normal[:, None, :] + tangent * np.eye(3))
    force = np.einsum("sij,sj->si", form, offset)
    pull, push = np.empty((count, 9)), np.empty((count, 3))
    for k in range(9):
        pull[:, k] = np.bincount(of, form.reshape(-1, 9)[:, k], count)
    for k in range(3):
        push[:, k] = np.bincount(of, force[:, k], count)
    return pull.reshape(count, 3, 3) + 1e-9 * np.eye(3), push


def forearms(sides: Collection[str]) -> list[int]:
    """Bones below the elbow on these sides."""
    return [BONES.index(side + part) for side in sides for part in ("ForeArm", "Hand")]


def feet(sides: Collection[str]) -> list[int]:
    """Bones below the ankle on these sides."""
    return [BONES.index(side + part) for side in sides for part in ("Foot", "ToeBase")]


def _soles(template: BodyTemplate, bone: np.ndarray, lost: Collection[int]) -> np.ndarray:
    """The lowest points of each lost foot, ``bone`` (N,) the strongest of each point."""
    lowest = [np.zeros(0, np.int64)]
    for side in ("Left", "Right"):
        own = np.flatnonzero(np.isin(bone, [number for number in feet([side]) if number in lost]))
        lowest.append(own[np.argsort(template.mean[own, 2])[:_SOLE]])
    return np.concatenate(lowest)


def mirrored_turn(vector: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3) of one side as the other side has them."""
    return vector * (1.0, -1.0, -1.0)


def _usual_turns(state: BodyState, lost: Collection[int]) -> np.ndarray:
    """Rotation vectors (22, 3) about which bones turn: the rest pose's, of a lost bone the other side's.

    Where both feet are lost they point outwards, as people's do.
    """
    usual = np.zeros((len(BONES), 3))
    left, right = BONES.index("LeftFoot"), BONES.index("RightFoot")
    if left in lost and right in lost:
        usual[[left, right], 2] = _OUTWARD, -_OUTWARD
    bones = [bone for bone in lost if OTHER_SIDE[bone] not in lost]
    if bones:
        usual[bones] = mirrored_turn(to_vectors(state.turns[[OTHER_SIDE[bone] for bone in bones]]))
    return usual


def _add_prior(information, gradient, state, body, usual) -> None:
    """What is likely of a body, weighed against ``_NOISE`` of a pair; ``usual`` (22, 3): the turns in the middle."""
    size = len(state.shape)
    noise = (_NOISE * state.height) ** 2
    at = np.arange(4, 4 + size)
    information[at, at] += noise
    gradient[at] -= noise * state.shape
    for bone in range(len(BONES)):
        # the step turns about the world's axes, the spread is about the rest pose's; the parent's turn is between them
        frame = body.turns[bone] @ state.turns[bone].T
        stiff = frame @ np.diag(noise / SPREAD[bone] ** 2) @ frame.T
        rows = slice(4 + size + 3 * bone, 7 + size + 3 * bone)
        information[rows, rows] += stiff
        gradient[rows] -= stiff @ frame @ (to_vectors(state.turns[bone]) - usual[bone])
    # height is free; numbers that no pair speaks of stay
    information[np.diag_indices(len(information))] += 1e-9


@njit(cache=True, nogil=True)
def _nearest_kernel(begin, end, queries, points, nearest):
    """Index of the nearest of ``points`` (M, 6) for some of ``queries`` (N, 6)."""
    for i in range(begin, end):
        best, found = np.inf, 0
        x, y, z, u, v, w = queries[i]
        for j in range(len(points)):
            far = (x - points[j, 0]) ** 2 + (y - points[j, 1]) ** 2 + (z - points[j, 2]) ** 2
            if far < best:
                far += (u - points[j, 3]) ** 2 + (v - points[j, 4]) ** 2 + (w - points[j, 5]) ** 2
                if far < best:
                    best, found = far, j
        nearest[i] = found


def joint_spread(template: BodyTemplate, found: Fit) -> np.ndarray:
    """How far each joint (22,) may lie off, one standard deviation [m].

    From the information of the last step.
    """
    _, joints = derivatives(template, found.state, found.body)
    covariance = (_NOISE * found.state.height) ** 2 * np.linalg.inv(found.information)
    return np.sqrt(np.einsum("bip,pq,biq->b", joints, covariance, joints))
