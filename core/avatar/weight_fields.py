"""How strongly each bone holds a point, by where the point lies beside the bone: tables learnt from bodies with a rig.

Each bone has a table of log-likelihoods over its own axes; a right bone has its left one's, mirrored. Weights are the
softmax over bones (multinomial logistic regression), so that the tables of neighbours say together where a joint's
blend lies and how wide it is. ``tools/weight_fields.py`` makes the tables.
"""

from __future__ import annotations

import functools
from importlib.resources import files
from typing import NamedTuple

import numpy as np

from ..numeric.kernels import njit
from .bone_axes import rest_axes
from .skeleton import BONES, OTHER_SIDE, Skeleton

TABLES = tuple(bone for bone, name in enumerate(BONES) if not name.startswith("Right"))
"""Bones that have a table of their own."""
_FILE = "weight_fields.npz"  # beside this module


class WeightFields(NamedTuple):
    """Tables of the bones in ``TABLES``, over the axes of :func:`.bone_axes.rest_axes`.

    Across the bone in body sizes (:func:`body_size`), along it in its lengths; points outside count as on the border.

    Parameters
    ----------
    low, high : np.ndarray [shape=(14, 3)]
        What the table spans.
    values : np.ndarray [shape=(14, X, Y, Z)]
        Log-likelihoods at equal steps from ``low`` to ``high``.
    """

    low: np.ndarray
    high: np.ndarray
    values: np.ndarray


@functools.cache
def known_fields() -> WeightFields:
    """The tables that come with the program."""
    with files(__package__).joinpath(_FILE).open("rb") as file, np.load(file) as stored:
        return WeightFields(*(stored[name].astype(np.float64) for name in WeightFields._fields))


def body_size(skeleton: Skeleton) -> float:
    """Half the trunk's length from the hips to the head's joint and half a leg's: what girths go with [m]."""
    lengths = np.linalg.norm(skeleton.tails() - skeleton.joints, axis=1)
    at = {name: lengths[bone] for bone, name in enumerate(BONES)}
    legs = at["LeftUpLeg"] + at["LeftLeg"] + at["RightUpLeg"] + at["RightLeg"]
    trunk = at["Hips"] + at["Spine"] + at["Spine1"] + at["Spine2"] + at["Neck"]
    return float(0.25 * legs + 0.65 * trunk)


def bone_coordinates(points: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Where points (N, 3) lie in the tables of all bones (N, 22, 3)."""
    return _coordinates_kernel(np.ascontiguousarray(points, np.float64), *_frames(skeleton))


def bone_likelihoods(points: np.ndarray, skeleton: Skeleton, fields: WeightFields) -> np.ndarray:
    """Log-likelihood (N, 22) that each bone holds each of the ``points`` (N, 3) [m]."""
    coordinates = bone_coordinates(points, skeleton)
    table = np.array([TABLES.index(bone if bone in TABLES else OTHER_SIDE[bone]) for bone in range(len(BONES))])
    return _look_up_kernel(coordinates, table, *fields)


def _frames(skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joints (22, 3), what turns a point's offset into a table's coordinates (22, 3, 3), bones with two like sides."""
    lengths = np.maximum(np.linalg.norm(skeleton.tails() - skeleton.joints, axis=1), 1e-3)
    into = np.swapaxes(rest_axes(skeleton), 1, 2) / body_size(skeleton)
    into[:, 1] *= (body_size(skeleton) / lengths)[:, None]
    into[[name.startswith("Right") for name in BONES], 0] *= -1.0
    return skeleton.joints, into, np.array([OTHER_SIDE[bone] == bone for bone in range(len(BONES))])


@njit(cache=True, nogil=True, error_model="numpy")
def _coordinates_kernel(points, joints, into, folded):
    out = np.empty((len(points), len(joints), 3))
    for i in range(len(points)):
        for b in range(len(joints)):
            x, y, z = points[i, 0] - joints[b, 0], points[i, 1] - joints[b, 1], points[i, 2] - joints[b, 2]
            for a in range(3):
                out[i, b, a] = into[b, a, 0] * x + into[b, a, 1] * y + into[b, a, 2] * z
            if folded[b]:
                out[i, b, 0] = abs(out[i, b, 0])
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _look_up_kernel(coordinates, table, low, high, values):
    """Trilinear interpolation; outside a table its border counts."""
    count, bones = coordinates.shape[:2]
    nx, ny, nz = values.shape[1:]
    out = np.empty((count, bones))
    for i in range(count):
        for b in range(bones):
            t = table[b]
            u = min(max((coordinates[i, b, 0] - low[t, 0]) / (high[t, 0] - low[t, 0]), 0.0), 1.0) * (nx - 1)
            v = min(max((coordinates[i, b, 1] - low[t, 1]) / (high[t, 1] - low[t, 1]), 0.0), 1.0) * (ny - 1)
            w = min(max((coordinates[i, b, 2] - low[t, 2]) / (high[t, 2] - low[t, 2]), 0.0), 1.0) * (nz - 1)
            x, y, z = min(int(u), nx - 2), min(int(v), ny - 2), min(int(w), nz - 2)
            u, v, w = u - x, v - y, w - z
            near = (1 - v) * ((1 - w) * values[t, x, y, z] + w * values[t, x, y, z + 1])
            near += v * ((1 - w) * values[t, x, y + 1, z] + w * values[t, x, y + 1, z + 1])
            far = (1 - v) * ((1 - w) * values[t, x + 1, y, z] + w * values[t, x + 1, y, z + 1])
            far += v * ((1 - w) * values[t, x + 1, y + 1, z] + w * values[t, x + 1, y + 1, z + 1])
            out[i, b] = (1 - u) * near + u * far
    return out
