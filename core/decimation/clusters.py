"""What vertices carry, handed on to those that are left after edges have collapsed.

A *cluster* is the vertices that became one. What the vertex left carries is looked up on the full mesh, on the
triangles around its own cluster: a surface that lies near by chance, such as an arm at the hip, is never asked.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..avatar.pose import SkinWeights
from ..mesh import Mesh
from ..numeric.srgb import from_linear, to_linear


class Footpoints(NamedTuple):
    """Where N vertices lie on the full mesh.

    Attributes
    ----------
    corners : np.ndarray [shape=(N, 3), dtype=int32]
        Vertices of the triangle.
    shares : np.ndarray [shape=(N, 3), dtype=float64]
        Barycentric coordinates, 0 to 1.
    triangle : np.ndarray [shape=(N,), dtype=int64]
        Its number.
    """

    corners: np.ndarray
    shares: np.ndarray
    triangle: np.ndarray


def clusters(into: np.ndarray) -> np.ndarray:
    """The vertex (V,) that each became one with in the end, of what it became one with first."""
    while True:
        further = into[into]
        if np.array_equal(further, into):
            return into
        into = further


def footpoints(mesh: Mesh, cluster: np.ndarray, used: np.ndarray, points: np.ndarray) -> Footpoints:
    """The points nearest to ``points`` on the triangles that touch each point's cluster. O(T log T).

    Parameters
    ----------
    mesh : Mesh
        The full one.
    cluster : np.ndarray [shape=(V,)]
        Of :func:`clusters`.
    used : np.ndarray [shape=(N,)]
        Clusters, ascending.
    points : np.ndarray [shape=(N, 3)]
        A point each [m].
    """
    row = np.full(len(mesh.vertices), -1, np.int64)
    row[used] = np.arange(len(used))
    touching = np.sort(row[cluster[mesh.triangles]], axis=1)
    fresh = touching >= 0
    fresh[:, 1:] &= touching[:, 1:] != touching[:, :-1]
    triangle, _ = np.nonzero(fresh)
    asked = touching[fresh]
    corners = mesh.triangles[triangle]
    shares, squared = _nearest_in_triangle(mesh.vertices[corners], points[asked])
    order = np.lexsort((squared, asked))
    first = order[np.concatenate(([True], np.diff(asked[order]) > 0))]
    return Footpoints(corners[first], shares[first], triangle[first])


def _nearest_in_triangle(corners: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Barycentric coordinates (N, 3) of the point of each triangle nearest to its point, and the squared distance."""
    a, b, c = np.moveaxis(corners, 1, 0)
    best = np.full(len(points), np.inf)
    shares = np.zeros((len(points), 3))

    def offer(u: np.ndarray, v: np.ndarray, where: np.ndarray) -> None:
        at = a + u[:, None] * (b - a) + v[:, None] * (c - a)
        squared = np.where(where, ((points - at) ** 2).sum(axis=1), np.inf)
        nearer = squared < best
        best[nearer] = squared[nearer]
        shares[nearer] = np.column_stack((1 - u - v, u, v))[nearer]

    x, y, p = b - a, c - a, points - a
    xx, xy, yy = (x * x).sum(axis=1), (x * y).sum(axis=1), (y * y).sum(axis=1)
    px, py = (p * x).sum(axis=1), (p * y).sum(axis=1)
    det = xx * yy - xy * xy
    safe = np.where(det > 0, det, 1.0)
    u, v = (yy * px - xy * py) / safe, (xx * py - xy * px) / safe
    offer(u, v, (det > 0) & (u >= 0) & (v >= 0) & (u + v <= 1))
    everywhere, zero = np.ones(len(points), np.bool_), np.zeros(len(points))
    along = np.clip(px / np.maximum(xx, 1e-300), 0, 1)
    offer(along, zero, everywhere)
    along = np.clip(py / np.maximum(yy, 1e-300), 0, 1)
    offer(zero, along, everywhere)
    edge, q = c - b, points - b
    along = np.clip((q * edge).sum(axis=1) / np.maximum((edge * edge).sum(axis=1), 1e-300), 0, 1)
    offer(1 - along, along, everywhere)
    return shares, best


def mean_colors(colors: np.ndarray, cluster: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Mean light of each cluster, since its vertex stands for all of it, as sRGB (N, 3) uint8."""
    light = to_linear(colors / 255.0)
    count = np.bincount(cluster, minlength=len(colors))[used]
    mean = np.column_stack([np.bincount(cluster, light[:, k], len(colors))[used] / count for k in range(3)])
    return np.rint(255 * from_linear(mean)).astype(np.uint8)


def nearest_values(values: np.ndarray, at: Footpoints) -> np.ndarray:
    """What the corner nearest to each footpoint has, of ``values`` (V,)."""
    return values[at.corners[np.arange(len(at.corners)), at.shares.argmax(axis=1)]]


def blended_weights(weights: SkinWeights, at: Footpoints) -> SkinWeights:
    """Skin weights interpolated in the triangles: the four largest, their sum 1."""
    count = len(at.corners)
    bones = int(weights.index.max(initial=0)) + 1
    dense = np.zeros(count * bones)
    rows = np.arange(count)[:, None] * bones
    for k in range(3):
        share = weights.weight[at.corners[:, k]] * at.shares[:, k, None]
        dense += np.bincount((rows + weights.index[at.corners[:, k]]).ravel(), share.ravel(), count * bones)
    dense = dense.reshape(count, bones)
    index = np.argsort(-dense, axis=1, kind="stable")[:, :4]
    if index.shape[1] < 4:
        index = np.pad(index, ((0, 0), (0, 4 - index.shape[1])))
    weight = np.take_along_axis(dense, index, axis=1)
    weight[:, bones:] = 0
    weight /= weight.sum(axis=1, keepdims=True)
    return SkinWeights(np.where(weight > 0, index, 0).astype(np.uint8), weight.astype(np.float32))


def settled_places(
    uv: np.ndarray, wedge: np.ndarray, rows: np.ndarray, inner: np.ndarray, at: Footpoints, full: np.ndarray
) -> np.ndarray:
    """Places in the texture (W, 2) of inner vertices looked up where they lie on the full mesh.

    What was interpolated step by step on the way has drifted. A vertex keeps its place where a triangle would turn
    over in the texture.

    Parameters
    ----------
    uv : np.ndarray [shape=(W, 2)]
        Places of the wedges.
    wedge, rows : np.ndarray [shape=(T, 3)]
        Of the corners left: their wedge, and their vertex as a row of ``at``.
    inner : np.ndarray [shape=(N,), dtype=bool]
        Vertices that lie on no seam.
    at : Footpoints
    full : np.ndarray [shape=(T', 3, 2)]
        Places of the full mesh's corners.
    """
    places = np.einsum("nk,nkc->nc", at.shares, full[at.triangle].astype(np.float64))
    moves = inner.copy()
    area = _areas(uv[wedge])
    while True:
        moved = np.where(moves[rows][:, :, None], places[rows], uv[wedge])
        bad = _areas(moved) * area <= 0.02 * area * area
        if not (bad & moves[rows].any(axis=1)).any():
            out = uv.copy()
            out[wedge.ravel()] = moved.reshape(-1, 2)
            return out
        moves[rows[bad]] = False


def _areas(places: np.ndarray) -> np.ndarray:
    """Twice the signed areas of triangles (T, 3, 2)."""
    one, other = places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]
    return one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
