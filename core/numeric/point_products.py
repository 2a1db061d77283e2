"""Products of many points with one vector or matrix, and a pinhole's depth grid as points, without BLAS.

numpy hands long products to a threaded BLAS, whose idle threads go on spinning for a while and take the cores from
our own parallel kernels: a stage that follows took up to twice as long.
"""

from __future__ import annotations

import numpy as np

from .kernels import njit


def dot(points: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """``points @ vector`` of points (..., 3), float64 (...)."""
    points = np.asarray(points, dtype=np.float64)
    vector = np.ascontiguousarray(vector, dtype=np.float64)
    return _dot_kernel(points.reshape(-1, 3), vector).reshape(points.shape[:-1])


def transform(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Points (..., 3) moved by an affine ``matrix`` (3, 4) or (4, 4), float64 (..., 3)."""
    points = np.asarray(points, dtype=np.float64)
    return _transform_kernel(points.reshape(-1, 3), np.asarray(matrix, dtype=np.float64)).reshape(points.shape)


def cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """``np.cross(first, second)`` of vectors (..., 3), to the last bit: numpy turns the axes about for each call."""
    a, b, c = first[..., 0], first[..., 1], first[..., 2]
    x, y, z = second[..., 0], second[..., 1], second[..., 2]
    along = b * z - c * y
    out = np.empty((*along.shape, 3), along.dtype)
    out[..., 0], out[..., 1], out[..., 2] = along, c * x - a * z, a * y - b * x
    return out


def lengths(vectors: np.ndarray) -> np.ndarray:
    """``np.linalg.norm(vectors, axis=-1)`` of vectors (..., 3) or (..., 2), to the last bit, and faster."""
    total = vectors[..., 0] * vectors[..., 0]
    for k in range(1, vectors.shape[-1]):
        total += vectors[..., k] * vectors[..., k]
    return np.sqrt(total)


def distances(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Distance (N, K) of each of points (N, 3) or (N, 2) from each of ``others`` (K, 3) or (K, 2)."""
    total = np.zeros((len(points), len(others)))
    for k in range(points.shape[1]):
        apart = np.subtract.outer(points[:, k], others[:, k])
        apart *= apart
        total += apart
    return np.sqrt(total, out=total)


@njit(cache=True, nogil=True)
def _dot_kernel(points, vector):
    out = np.empty(len(points))
    x, y, z = vector[0], vector[1], vector[2]
    for i in range(len(points)):
        out[i] = points[i, 0] * x + points[i, 1] * y + points[i, 2] * z
    return out


@njit(cache=True, nogil=True)
def _transform_kernel(points, matrix):
    out = np.empty((len(points), 3))
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for r in range(3):
            out[i, r] = matrix[r, 0] * x + matrix[r, 1] * y + matrix[r, 2] * z + matrix[r, 3]
    return out


@njit(cache=True, nogil=True)
def lay_grid(depth, fx, fy, cx, cy):
    """Points (H, W, 3) float64 of a depth map (H, W) seen by a pinhole: :func:`.pinhole.unproject` checks and calls."""
    height, width = depth.shape
    points = np.empty((height, width, 3))
    for v in range(height):
        y = (v - cy) / fy
        for u in range(width):
            z = np.float64(depth[v, u])
            points[v, u, 0] = (u - cx) / fx * z
            points[v, u, 1] = y * z
            points[v, u, 2] = z
    return points
