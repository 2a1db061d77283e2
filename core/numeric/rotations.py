"""Rotation matrices by the many: from and to Euler angles, vectors, quaternions; blends, and twist about an axis."""

from __future__ import annotations

import numpy as np

_LEAST = 1e-300  # of a length: shorter ones count as 0


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) of length 1; a vector of length 0 stays."""
    lengths = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))[..., None]
    return vectors / np.maximum(lengths, _LEAST)


def cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """``np.cross`` of vectors (..., 3), four times as fast on a few of them."""
    a, b, c = first[..., 0], first[..., 1], first[..., 2]
    x, y, z = second[..., 0], second[..., 1], second[..., 2]
    product = b * z - c * y
    out = np.empty((*product.shape, 3))
    out[..., 0], out[..., 1], out[..., 2] = product, c * x - a * z, a * y - b * x
    return out


def about_axis(axis: int, angles: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) by ``angles`` (...) [rad] about coordinate axis 0, 1 or 2."""
    angles = np.asarray(angles, dtype=np.float64)
    out = np.zeros((*angles.shape, 3, 3))
    j, k = (axis + 1) % 3, (axis + 2) % 3
    out[..., axis, axis] = 1
    out[..., j, j] = out[..., k, k] = np.cos(angles)
    out[..., k, j] = np.sin(angles)
    out[..., j, k] = -out[..., k, j]
    return out


def from_euler(order: str, angles: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) of intrinsic Euler ``angles`` (..., n) [rad] about the axes ``order`` names, as ``"ZYX"``.

    The first axis is the outermost: R = R_Z R_Y R_X.
    """
    out = np.broadcast_to(np.eye(3), (*angles.shape[:-1], 3, 3))
    for place, axis in enumerate(order):
        out = out @ about_axis("XYZ".index(axis), angles[..., place])
    return out


def euler_zyx(matrices: np.ndarray) -> np.ndarray:
    """Angles (..., 3) [rad] about Z, Y, X so that ``from_euler("ZYX", angles)`` gives ``matrices`` (..., 3, 3)."""
    y = np.arcsin(np.clip(-matrices[..., 2, 0], -1, 1))
    locked = np.abs(matrices[..., 2, 0]) > 1 - 1e-12
    z = np.where(
        locked,
        np.arctan2(-matrices[..., 0, 1], matrices[..., 1, 1]),
        np.arctan2(matrices[..., 1, 0], matrices[..., 0, 0]),
    )
    x = np.where(locked, 0.0, np.arctan2(matrices[..., 2, 1], matrices[..., 2, 2]))
    return np.stack([z, y, x], axis=-1)


def from_vectors(vectors: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) of rotation vectors (..., 3): about their direction by their length [rad]."""
    angles = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    # sin(a) / a and (1 - cos(a)) / a², whole at 0.
    return _from_skew(vectors, np.sinc(angles / np.pi), 0.5 * np.square(np.sinc(angles / (2 * np.pi))))


def _from_skew(vectors: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """1 + first [v] + second [v]², [v] the matrix of the cross product with v."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    fx, fy, fz = first * x, first * y, first * z
    sx, sy = second * x, second * y
    xx, yy, zz, xy, xz, yz = sx * x, sy * y, second * z * z, sx * y, sx * z, sy * z
    out = np.empty((*vectors.shape, 3))
    out[..., 0, 0], out[..., 1, 1], out[..., 2, 2] = 1 - yy - zz, 1 - xx - zz, 1 - xx - yy
    out[..., 0, 1], out[..., 1, 0] = xy - fz, xy + fz
    out[..., 0, 2], out[..., 2, 0] = xz + fy, xz - fy
    out[..., 1, 2], out[..., 2, 1] = yz - fx, yz + fx
    return out


def to_vectors(matrices: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3) of ``matrices`` (..., 3, 3), of length 0 to pi [rad]."""
    off = np.stack(
        [
            matrices[..., 2, 1] - matrices[..., 1, 2],
            matrices[..., 0, 2] - matrices[..., 2, 0],
            matrices[..., 1, 0] - matrices[..., 0, 1],
        ],
        axis=-1,
    )
    cosine = (np.trace(matrices, axis1=-2, axis2=-1) - 1) / 2
    sine = np.linalg.norm(off, axis=-1) / 2
    angles = np.arctan2(sine, cosine)
    # Near half a turn the skew part vanishes; the symmetric one less cos(a) is the axis with itself.
    columns = matrices + np.swapaxes(matrices, -1, -2) - 2 * cosine[..., None, None] * np.eye(3)
    largest = np.argmax(np.einsum("...ij,...ij->...j", columns, columns), axis=-1)
    flipped = unit(np.take_along_axis(columns, largest[..., None, None], axis=-1)[..., 0])
    sign = np.where(np.einsum("...i,...i->...", flipped, off) < 0, -1.0, 1.0)
    axis = np.where((cosine < -0.99)[..., None], flipped * sign[..., None], unit(off))
    return axis * angles[..., None]


def between(first: np.ndarray, second: np.ndarray, share: np.ndarray | float) -> np.ndarray:
    """Rotations (..., 3, 3) on the shortest way from ``first`` to ``second``; ``share`` 0 to 1, a number or (...)."""
    way = to_vectors(np.swapaxes(first, -1, -2) @ second)
    return first @ from_vectors(way * np.asarray(share, dtype=np.float64)[..., None])


def shortest_turn(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The smallest rotations (..., 3, 3) that take directions ``start`` (..., 3) to ``end``."""
    start, end = unit(start), unit(end)
    # Two reflections: across the plane square to the middle between both, then across the one square to the end.
    middle = start + end
    square = np.einsum("...i,...i->...", middle, middle)[..., None, None]  # 2 + 2 cos
    turns = end[..., :, None] * start[..., None, :]
    turns -= middle[..., :, None] * middle[..., None, :] / np.maximum(square, _LEAST)
    turns += turns
    turns += np.eye(3)
    if (square < 2e-9).any():
        half = unit(cross(start, _aside(start))) * np.pi
        turns = np.where(square < 2e-9, from_vectors(half), turns)
    return turns


def frames(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Frames (..., 3, 3) whose first column is ``first`` (..., 3), whose second is what of ``second`` is square to it.

    Where ``second`` lies along ``first``, any direction square to it stands in.
    """
    first = unit(first)
    side = second - np.einsum("...i,...i->...", first, second)[..., None] * first
    length = np.sqrt(np.einsum("...i,...i->...", side, side))[..., None]
    if (length < 1e-9).any():
        other = cross(first, _aside(first))
        side = np.where(length < 1e-9, other, side)
        length = np.sqrt(np.einsum("...i,...i->...", side, side))[..., None]
    side = side / length
    out = np.empty((*side.shape, 3))
    out[..., 0], out[..., 1], out[..., 2] = first, side, cross(first, side)
    return out


def _aside(directions: np.ndarray) -> np.ndarray:
    """A vector (..., 3) that is far from along each unit vector."""
    return np.where(np.abs(directions[..., :1]) < 0.9, np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))


def twist_angles(turns: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """How far ``turns`` (..., 3, 3) turn about unit ``axis`` (..., 3), swing aside [rad], -pi to pi.

    The twist of the decomposition into a swing square to the axis and a twist about it.
    """
    off = np.stack(
        [
            turns[..., 2, 1] - turns[..., 1, 2],
            turns[..., 0, 2] - turns[..., 2, 0],
            turns[..., 1, 0] - turns[..., 0, 1],
        ],
        axis=-1,
    )
    # With quaternion (w, v): tan(twist / 2) = v . axis / w, and 4 w v is the skew part, 4 w² is 1 + trace.
    along = np.einsum("...i,...i->...", off, axis)
    return 2 * np.arctan2(along, 1 + np.trace(turns, axis1=-2, axis2=-1))


def mean_rotation(matrices: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """The rotation (3, 3) nearest to all ``matrices`` (N, 3, 3), by least squares."""
    u, _, vt = np.linalg.svd(np.average(matrices, axis=0, weights=weights))
    u[:, 2] *= np.linalg.det(u) * np.linalg.det(vt)
    return u @ vt


def quaternions(rotations: np.ndarray) -> np.ndarray:
    """Unit quaternions (..., 4), x y z w, of rotations (..., 3, 3): the eigenvector of Bar-Itzhack (2000)."""
    m = rotations
    sums = np.empty((*m.shape[:-2], 4, 4))
    for i in range(3):
        for j in range(3):
            sums[..., i, j] = m[..., i, j] + m[..., j, i]
        sums[..., i, i] = 2.0 * m[..., i, i] - np.trace(m, axis1=-2, axis2=-1)
        j, k = (i + 1) % 3, (i + 2) % 3
        sums[..., i, 3] = sums[..., 3, i] = m[..., k, j] - m[..., j, k]
    sums[..., 3, 3] = np.trace(m, axis1=-2, axis2=-1)
    vector = np.linalg.eigh(sums)[1][..., -1]
    return vector * np.where(vector[..., 3:] < 0, -1.0, 1.0)


def from_quaternions(quaternion: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) of quaternions (..., 4), x y z w, of any length."""
    x, y, z, w = np.moveaxis(quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True), -1, 0)
    return np.stack(
        (
            1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
            2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
            2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
        ), axis=-1,
    ).reshape(*x.shape, 3, 3)  # fmt: skip


def continuous(turns: np.ndarray) -> np.ndarray:
    """Quaternions over time (F, ..., 4), each of the two of its rotation that is nearer to the one before."""
    signs = np.where((turns[1:] * turns[:-1]).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
    return np.concatenate((turns[:1], turns[1:] * np.cumprod(signs, axis=0)))
