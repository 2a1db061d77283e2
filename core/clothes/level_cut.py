"""Meshes cut along the curve where a function of their vertices is 0: hems, necklines, waists."""

from __future__ import annotations

import numpy as np

from ..mesh import Mesh
from ..mesh.half_edges import edge_keys
from ..mesh.submesh import compact


def cut_at_level(mesh: Mesh, values: np.ndarray) -> Mesh:
    """The part of a mesh where ``values`` (V,) of its vertices are positive; triangles that 0 crosses are cut.

    Where a value is 0 the cut goes through that vertex. Only vertices and triangles are kept.
    """
    vertices, triangles = mesh.vertices, mesh.triangles
    count = len(vertices)
    own = values[triangles]
    following = np.roll(own, -1, axis=1)
    crossed = ((own > 0) & (following < 0)) | ((own < 0) & (following > 0))
    keys, place = np.unique(edge_keys(triangles, count)[crossed], return_inverse=True)
    a, b = keys // count, keys % count
    share = (values[a] / (values[a] - values[b]))[:, None]
    made = vertices[a] + share * (vertices[b] - vertices[a])

    ring = np.full((len(triangles), 6), -1, np.int64)  # corner, crossing behind it, next corner …
    ring[:, ::2] = np.where(own >= 0, triangles, -1)
    crossing = np.full(crossed.shape, -1, np.int64)
    crossing[crossed] = count + place
    ring[:, 1::2] = crossing
    ring = ring[(own > 0).any(axis=1)]
    ring = np.take_along_axis(ring, np.argsort(ring < 0, axis=1, kind="stable"), axis=1)[:, :4]
    first = ring[ring[:, 2] >= 0][:, :3]
    second = ring[ring[:, 3] >= 0][:, (0, 2, 3)]
    return compact(Mesh(np.concatenate((vertices, made)), np.concatenate((first, second)).astype(np.int32)))


def snapped(values: np.ndarray, mesh: Mesh, normal: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and values (V,), those within ``reach`` of a plane moved onto it: a cut leaves no slivers.

    Parameters
    ----------
    values : np.ndarray [shape=(V,)]
        Distance from the plane; inf where there is none [m].
    normal : np.ndarray [shape=(3,)]
        Unit, towards positive values.
    reach : float
        [m]
    """
    near = np.abs(values) < reach
    vertices = mesh.vertices.copy()
    vertices[near] -= values[near, None] * normal
    return vertices, np.where(near, 0.0, values)
