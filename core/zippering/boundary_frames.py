"""Boundary loops with the directions in which the surface would go on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mesh import Mesh
from ..mesh.boundary_loops import loops_of
from ..mesh.normals import vertex_normals
from ..numeric.kernels import njit


@dataclass(frozen=True)
class Boundary:
    """All boundary vertices of a mesh, loop after loop.

    ``vertex`` (B,) mesh index; ``loop`` (B,) loop number; ``start`` (L+1,) first entry of each loop; ``point``,
    ``tangent``, ``normal``, ``outward`` (B, 3): ``outward`` is the direction in which the surface would continue.
    ``arc`` (B,) length along the loop up to each vertex, ``length`` (L,) of each loop [m].
    """

    vertex: np.ndarray
    loop: np.ndarray
    start: np.ndarray
    point: np.ndarray
    tangent: np.ndarray
    normal: np.ndarray
    outward: np.ndarray
    arc: np.ndarray
    length: np.ndarray


def boundary_of(mesh: Mesh, edges: np.ndarray) -> Boundary:
    """Boundary loops with the directions that matching needs, from the mesh's :func:`~.half_edges.open_edges`.

    O(V + T).
    """
    loops = loops_of(edges, len(mesh.vertices))
    start = np.concatenate(([0], np.cumsum([len(loop) for loop in loops]))).astype(np.int64)
    vertex = np.concatenate(loops) if loops else np.empty(0, np.int32)
    on_boundary = np.zeros(len(mesh.vertices), np.bool_)
    on_boundary[vertex] = True
    normals = vertex_normals(mesh.vertices, mesh.triangles, on_boundary)
    point = mesh.vertices[vertex]
    tangent, normal, outward, arc = _frames_kernel(point, normals[vertex], start)
    loop = np.repeat(np.arange(len(loops)), np.diff(start)).astype(np.int64)
    last, first = start[1:] - 1, start[:-1]
    length = arc[last] + np.linalg.norm(point[first] - point[last], axis=1)
    return Boundary(vertex, loop, start, point, tangent, normal, outward, arc, length)


@njit(cache=True, nogil=True)
def _set_unit(out, x, y, z):
    """``out`` = (x, y, z) scaled to length 1; left as it is for a zero vector."""
    length = np.sqrt(x * x + y * y + z * z)
    if length > 0:
        out[0], out[1], out[2] = x / length, y / length, z / length


@njit(cache=True, nogil=True)
def _frames_kernel(point, vertex_normal, start):
    """Directions along each loop, averaged over two neighbours on either side so that teeth do not rotate them."""
    count = len(point)
    t, m = np.empty(3), np.empty(3)
    tangent, normal, outward = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3))
    arc = np.zeros(count)
    for loop in range(len(start) - 1):
        a, n = start[loop], start[loop + 1] - start[loop]
        half = min(3, (n - 1) // 2)
        total = 0.0
        for k in range(n):
            i = a + k
            arc[i] = total
            nxt = a + (k + 1) % n
            ahead, behind = a + (k + half) % n, a + (k - half) % n
            step = 0.0
            for c in range(3):
                step += (point[nxt, c] - point[i, c]) ** 2
                t[c] = point[ahead, c] - point[behind, c]
                m[c] = 0.0
                for s in range(-half, half + 1):
                    m[c] += vertex_normal[a + (k + s) % n, c]
            total += np.sqrt(step)
            _set_unit(tangent[i], t[0], t[1], t[2])
            _set_unit(normal[i], m[0], m[1], m[2])
            # the surface lies on the left of the boundary's direction, so its continuation on the right
            along, across = tangent[i], normal[i]
            x = along[1] * across[2] - along[2] * across[1]
            y = along[2] * across[0] - along[0] * across[2]
            z = along[0] * across[1] - along[1] * across[0]
            _set_unit(outward[i], x, y, z)
    return tangent, normal, outward, arc
