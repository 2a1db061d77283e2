"""A texture for a finer mesh of the same surface."""

from __future__ import annotations

import numpy as np

from ..mesh import Mesh, Texture
from ..mesh.bvh import build_bvh, closest_point
from ..mesh.triangle_mesh import barycentric


def refined_texture(mesh: Mesh, texture: Texture, refined: Mesh) -> Texture:
    """The ``texture`` of ``mesh`` on ``refined``, whose triangles are parts of the mesh's.

    Each triangle takes its place in the image from the triangle that is nearest to its middle. O(T log T).
    """
    corners = refined.vertices[refined.triangles]
    tree = build_bvh(mesh.vertices, mesh.triangles)
    origin = closest_point(tree, np.ascontiguousarray(corners.mean(axis=1)))[1]
    shares = np.clip(barycentric(corners, mesh.vertices[mesh.triangles[origin]][:, None]), 0.0, 1.0)
    shares /= shares.sum(axis=-1, keepdims=True)
    uv = np.einsum("tcs,tsk->tck", shares, texture.uv[origin])
    return Texture(uv.astype(np.float32), texture.image, texture.island[origin])
