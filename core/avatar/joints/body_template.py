"""A body of numbers: points of the surface, joints and weights, and the ways in which people differ from the mean.

``body_template.npz`` is made by ``tools/train_body_template.py`` from people of MakeHuman's shape space (CC0), bare and
clothed, in units of body height.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np

from ...numeric.rotations import from_vectors
from ..pose import chained_joints
from ..skeleton import BONES, END_BONES, PARENTS

_FILE = "body_template.npz"  # beside this module
_BELOW = np.eye(len(BONES), dtype=np.bool_)
for _bone in reversed(range(1, len(BONES))):
    _BELOW[PARENTS[_bone]] |= _BELOW[_bone]


@dataclass(frozen=True)
class BodyTemplate:
    """N points, 22 joints and 5 ends in the rest pose (arms some 45° down), hips at the origin, body height 1.

    Parameters
    ----------
    mean : np.ndarray [shape=(N + 27, 3), dtype=float64]
        Points, joints in the order of ``BONES``, ends in the order of ``ENDS``.
    basis : np.ndarray [shape=(K, N + 27, 3), dtype=float64]
        One standard deviation of each main component.
    normals : np.ndarray [shape=(N, 3), dtype=float64]
        Of the points, outward.
    weights : np.ndarray [shape=(N, 22), dtype=float64]
        How far each bone moves a point; rows sum to 1.
    """

    mean: np.ndarray
    basis: np.ndarray
    normals: np.ndarray
    weights: np.ndarray


@dataclass(frozen=True)
class BodyState:
    """A body of the template: where it stands, how large it is, its shape and its pose.

    Parameters
    ----------
    hips : np.ndarray [shape=(3,)]
        Joint Hips [m].
    height : float
        Body height [m].
    shape : np.ndarray [shape=(K,)]
        Of each component, in standard deviations.
    turns : np.ndarray [shape=(22, 3, 3)]
        Each bone's turn against its parent, from the rest pose.
    """

    hips: np.ndarray
    height: float
    shape: np.ndarray
    turns: np.ndarray


@dataclass(frozen=True)
class PosedBody:
    """What :func:`posed` makes of a state: N points with normals, joints and ends [m], and each bone's turn."""

    points: np.ndarray
    normals: np.ndarray
    joints: np.ndarray
    ends: np.ndarray
    turns: np.ndarray


@cache
def body_template() -> BodyTemplate:
    """The template that is shipped."""
    with files(__package__).joinpath(_FILE).open("rb") as file, np.load(file) as stored:
        weights = np.zeros((len(stored["normals"]), len(BONES)))
        np.put_along_axis(weights, stored["index"].astype(np.int64), stored["weight"].astype(np.float64), axis=1)
        normals = stored["normals"].astype(np.float64)
        return BodyTemplate(
            stored["mean"] / 20000.0,
            stored["basis"] * stored["step"].astype(np.float64)[:, None, None],
            normals / np.linalg.norm(normals, axis=1, keepdims=True),
            weights / weights.sum(axis=1, keepdims=True),
        )


def posed(template: BodyTemplate, state: BodyState) -> PosedBody:
    """The template's points in a state, by linear blend skinning."""
    count = len(template.weights)
    rest = state.height * (template.mean + np.tensordot(state.shape, template.basis, 1))
    at = rest[:count]
    turns, joints = _chain(rest[count : count + len(BONES)], state)
    offset = joints - np.einsum("bij,bj->bi", turns, rest[count : count + len(BONES)])
    blend = (template.weights @ turns.reshape(len(BONES), 9)).reshape(-1, 3, 3)
    points = np.einsum("vij,vj->vi", blend, at) + template.weights @ offset
    normals = np.einsum("vij,vj->vi", blend, template.normals)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    bones = list(END_BONES)
    ends = np.einsum("bij,bj->bi", turns[bones], rest[count + len(BONES) :]) + offset[bones]
    return PosedBody(points, normals, joints, ends, turns)


def _chain(rest_joints, state):
    turns = state.turns.copy()
    for bone in range(1, len(BONES)):
        turns[bone] = turns[PARENTS[bone]] @ state.turns[bone]
    return turns, chained_joints(rest_joints, turns, state.hips)


def derivatives(template: BodyTemplate, state: BodyState, body: PosedBody) -> tuple[np.ndarray, np.ndarray]:
    """How points (N, 3, P) and joints (22, 3, P) move with the P = 4 + K + 66 numbers of a state.

    They are: the hips' place [m], the logarithm of the height, the shape, and for each bone a small turn about the
    world's axes through its joint, which carries along what hangs on it [rad].
    """
    count, size, bones = len(template.weights), len(state.shape), len(BONES)
    points, joints = np.zeros((count, 3, 4 + size + 3 * bones)), np.zeros((bones, 3, 4 + size + 3 * bones))
    for moved, at in ((points, body.points), (joints, body.joints)):
        moved[:, :, :3] = np.eye(3)
        moved[:, :, 3] = at - state.hips

    grown = state.height * template.basis.transpose(1, 2, 0)  # (N + 27, 3, K)
    rest = grown[count : count + bones]
    for bone in range(1, bones):
        parent = PARENTS[bone]
        step = body.turns[parent] @ (rest[bone] - rest[parent])
        joints[bone, :, 4 : 4 + size] = joints[parent, :, 4 : 4 + size] + step
    carried = joints[:, :, 4 : 4 + size] - np.einsum("bij,bjk->bik", body.turns, rest)
    blend = (template.weights @ body.turns.reshape(bones, 9)).reshape(-1, 3, 3)
    points[:, :, 4 : 4 + size] = blend @ grown[:count]
    points[:, :, 4 : 4 + size] += (template.weights @ carried.reshape(bones, -1)).reshape(count, 3, size)

    # where each bone alone would put a point, times its weight; then all of what hangs on a bone together
    rest_at = state.height * (template.mean + np.tensordot(state.shape, template.basis, 1))
    alone = np.einsum("bij,vj->vbi", body.turns, rest_at[:count])
    alone += body.joints - np.einsum("bij,bj->bi", body.turns, rest_at[count : count + bones])
    alone *= template.weights[:, :, None]
    arms = np.einsum("jb,vbi->vji", _BELOW.astype(np.float64), alone)
    arms -= (template.weights @ _BELOW.T)[:, :, None] * body.joints
    _cross(points[:, :, 4 + size :], arms)
    arms = np.where(_BELOW.T[:, :, None], body.joints[:, None] - body.joints, 0.0)
    _cross(joints[:, :, 4 + size :], arms)
    return points, joints


def _cross(out: np.ndarray, arms: np.ndarray) -> None:
    """Derivative of ``turn × arm`` by the turn, arms (V, 22, 3), into ``out`` (V, 3, 66)."""
    x, y, z = arms[:, :, 0], arms[:, :, 1], arms[:, :, 2]
    out[:, 0, 1::3], out[:, 0, 2::3] = z, -y
    out[:, 1, 0::3], out[:, 1, 2::3] = -z, x
    out[:, 2, 0::3], out[:, 2, 1::3] = y, -x


def moved(state: BodyState, body: PosedBody, step: np.ndarray) -> BodyState:
    """The state after a ``step`` (P,) in the numbers of :func:`derivatives`."""
    size = len(state.shape)
    turns = state.turns.copy()
    world = from_vectors(step[4 + size :].reshape(-1, 3))
    for bone, parent in enumerate(PARENTS):
        frame = np.eye(3) if parent < 0 else body.turns[parent]
        turns[bone] = frame.T @ world[bone] @ frame @ state.turns[bone]
    return BodyState(
        state.hips + step[:3], state.height * float(np.exp(step[3])), state.shape + step[4 : 4 + size], turns
    )
