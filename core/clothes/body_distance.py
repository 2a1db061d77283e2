"""Signed distances to a body: how far cloth is outside its skin, or inside it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import MirrorScanError
from ..mesh import Mesh
from ..mesh.bvh import build_bvh, closest_point
from ..mesh.half_edges import twins
from ..mesh.normals import triangle_normals
from ..mesh.triangle_mesh import barycentric
from ..numeric.rotations import unit

_AT_CORNER = 1e-9  # a share of a corner below this counts as none


class SkinPoints(NamedTuple):
    """The nearest skin of each of N points.

    Signed distance (N,) [m], its triangle (N,), where it is and its unit normal (N, 3), and the shares (N, 3) of the
    triangle's corners there.
    """

    distance: np.ndarray
    triangle: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    shares: np.ndarray


class BodyDistance:
    """Answers how far points are from a body's skin: positive outside, negative inside.

    The sign is that of the angle-weighted normal of the nearest face, edge or vertex: exact for a closed mesh that
    does not cross itself (Bærentzen and Aanæs, "Signed distance computation using the angle weighted pseudonormal",
    2005).

    Parameters
    ----------
    mesh : Mesh
        Closed, in metres.

    Raises
    ------
    MirrorScanError
        When the mesh has no triangles, or is not finite.
    """

    def __init__(self, mesh: Mesh) -> None:
        if not len(mesh.triangles):
            raise MirrorScanError("clothes: the body has no triangles; give a closed mesh", code="no_person")
        vertices = np.ascontiguousarray(mesh.vertices, np.float64)
        self.triangles = np.ascontiguousarray(mesh.triangles, np.int32)
        self._tree = build_bvh(vertices, self.triangles)
        self._corners = vertices[self.triangles]
        face = unit(triangle_normals(vertices, self.triangles))
        twin = twins(self.triangles, len(vertices)).reshape(-1, 3)
        # edge k runs from corner k to corner k + 1; without a neighbour its normal is the face's own
        across = np.where((twin >= 0)[..., None], face[np.maximum(twin, 0) // 3], face[:, None])
        sides = unit(np.roll(self._corners, -1, axis=1) - self._corners)
        cosines = -np.einsum("tki,tki->tk", sides, np.roll(sides, 1, axis=1))
        angles = np.arccos(np.clip(cosines, -1.0, 1.0))
        at_vertex = np.stack(
            [
                np.bincount(self.triangles.ravel(), (angles * face[:, i, None]).ravel(), len(vertices))
                for i in range(3)
            ],
            axis=1,
        )  # fmt: skip
        self._normals = np.concatenate(
            (face[:, None], unit(face[:, None] + across), unit(at_vertex)[self.triangles]), axis=1
        )

    def at(self, points: np.ndarray, reach: float = np.inf) -> SkinPoints:
        """The nearest skin of points (N, 3); beyond ``reach`` [m] the distance is inf and nothing else is said."""
        distance, triangle, nearest = closest_point(self._tree, points, reach)
        found = np.maximum(triangle, 0)
        corners = self._corners[found]
        shares = _shares(nearest, corners)
        low = shares < _AT_CORNER
        count = low.sum(axis=1)
        # 0: the face; 1 + k: the edge opposite to the corner without a share; 4 + k: the one corner with a share
        feature = np.where(count == 1, 1 + (low.argmax(axis=1) + 1) % 3, 0)
        feature = np.where(count == 2, 4 + shares.argmax(axis=1), feature)
        normal = self._normals[found, feature]
        inside = np.einsum("ni,ni->n", points - nearest, normal) < 0
        return SkinPoints(np.where(inside, -distance, distance), triangle, nearest, normal, shares)


def _shares(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Shares (N, 3), sum 1 and none negative, of triangles' corners (N, 3, 3) at points (N, 3) on them."""
    shares = np.maximum(barycentric(points, corners), 0.0)
    return shares / shares.sum(axis=1, keepdims=True)
