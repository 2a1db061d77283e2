"""Normals of triangles and vertices."""

from __future__ import annotations

import numpy as np

from ..numeric.kernels import njit
from ..numeric.point_products import cross


def triangle_normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Cross products (T, 3): normal times twice the area."""
    first = vertices.take(triangles[:, 0], axis=0)
    b, c = (vertices.take(triangles[:, k], axis=0) - first for k in (1, 2))
    return cross(b, c)


def vertex_normals(vertices: np.ndarray, triangles: np.ndarray, wanted: np.ndarray | None = None) -> np.ndarray:
    """Unit vertex normals (V, 3): area-weighted mean of the triangles around; zero where unused.

    With ``wanted`` (V,) bool only these are computed, the others mean nothing.
    """
    if wanted is None:
        wanted = np.ones(len(vertices), np.bool_)
    return _vertex_normals_kernel(vertices, triangles, wanted)


@njit(cache=True, nogil=True)
def _vertex_normals_kernel(vertices, triangles, wanted):
    normals = np.zeros(vertices.shape)
    for t in range(len(triangles)):
        i, j, k = triangles[t]
        if not (wanted[i] or wanted[j] or wanted[k]):
            continue
        ax, ay, az = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
        bx, by, bz = vertices[k, 0] - vertices[i, 0], vertices[k, 1] - vertices[i, 1], vertices[k, 2] - vertices[i, 2]
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        for m in (i, j, k):
            normals[m, 0] += nx
            normals[m, 1] += ny
            normals[m, 2] += nz
    for i in range(len(vertices)):
        length = np.sqrt(normals[i, 0] ** 2 + normals[i, 1] ** 2 + normals[i, 2] ** 2)
        if length > 0:
            for c in range(3):
                normals[i, c] /= length
    return normals
