"""A texture for a finer mesh of the same surface."""

from __future__ import annotations

import numpy as np

from ..mesh import Mesh, Texture
from ..mesh.bvh import build_bvh, closest_point


def refined_texture(mesh: Mesh, texture: Texture, refined: Mesh) -> Texture:
    """The ``texture`` of ``mesh`` on ``refined``, whose triangles are parts of the mesh's.

    Each triangle takes its place in the image from the triangle that is nearest to its middle. O(T log T).
    """
    corners = refined.vertices[refined.triangles]
    tree = build_bvh(mesh.vertices, mesh.triangles)
    origin = closest_point(tree, np.ascontiguousarray(corners.mean(axis=1)))[1]
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles[origin]], 1, 0)[:, :, None, :]
    x, y, p = b - a, c - a, corners - a
    xx, xy, yy = (x * x).sum(axis=-1), (x * y).sum(axis=-1), (y * y).sum(axis=-1)
    px, py = (p * x).sum(axis=-1), (p * y).sum(axis=-1)
    det = np.maximum(xx * yy - xy * xy, 1e-30)
    along, across = (yy * px - xy * py) / det, (xx * py - xy * px) / det
    shares = np.clip(np.stack((1.0 - along - across, along, across), axis=-1), 0.0, 1.0)
    shares /= shares.sum(axis=-1, keepdims=True)
    uv = np.einsum("tcs,tsk->tck", shares, texture.uv[origin])
    return Texture(uv.astype(np.float32), texture.image, texture.island[origin])
