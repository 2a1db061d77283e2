"""Triangle mesh as plain arrays: the data type, polygons into triangles, checks, merging."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import CaptureError, MirrorScanError

# A list property as read: row lengths (N,) and, for each length, (rows, values (len(rows), length)).
PolygonLists = tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]


def triangulate_polygons(polygons: PolygonLists, n_vertices: int) -> tuple[np.ndarray, np.ndarray]:
    """Fans of polygons, in the order of the file: triangles (T, 3) int32 and the row each came from (T,)."""
    fans, origins = [], []
    for rows, indices in polygons[1]:
        sides = indices.shape[1]
        if sides and (~(indices >= 0) | ~(indices < n_vertices)).any():
            raise CaptureError(f"a face names a vertex outside 0…{n_vertices - 1}; the file is damaged")
        if sides < 3:
            continue
        corners = np.arange(1, sides - 1)
        fan = np.empty((len(rows), sides - 2, 3), np.int32)
        fan[..., 0] = indices[:, :1]
        fan[..., 1] = indices[:, corners]
        fan[..., 2] = indices[:, corners + 1]
        fans.append(fan.reshape(-1, 3))
        origins.append(np.repeat(rows, sides - 2))
    if not fans:
        return np.empty((0, 3), np.int32), np.empty(0, np.int64)
    origin = np.concatenate(origins)
    order = np.argsort(origin, kind="stable")
    return np.concatenate(fans)[order], origin[order]


def barycentric(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Shares (..., 3), sum 1, of triangles' corners (..., 3, 3) at points (..., 3) in their planes.

    Negative beyond an edge; a triangle without area gives all to its first corner.
    """
    first, second = corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    way = points - corners[..., 0, :]
    aa, ab, bb = (first * first).sum(axis=-1), (first * second).sum(axis=-1), (second * second).sum(axis=-1)
    wa, wb = (way * first).sum(axis=-1), (way * second).sum(axis=-1)
    area = aa * bb - ab * ab
    there = area > 0
    safe = np.where(there, area, 1.0)
    v, w = np.where(there, (bb * wa - ab * wb) / safe, 0.0), np.where(there, (aa * wb - ab * wa) / safe, 0.0)
    return np.stack((1.0 - v - w, v, w), axis=-1)


SURFACE, SEAM, FILL = 0, 1, 2
KIND_NAMES = ("surface", "seam", "fill")


@dataclass(frozen=True)
class Mesh:
    """Triangles over shared vertices; counter-clockwise seen from outside.

    Parameters
    ----------
    vertices : np.ndarray [shape=(V, 3), dtype=float64]
        Positions [m].
    triangles : np.ndarray [shape=(T, 3), dtype=int32]
        Vertex indices.
    colors : np.ndarray [shape=(V, 3), dtype=uint8] or None
        sRGB.
    view : np.ndarray [shape=(V,), dtype=int8] or None
        0 = seen directly, 1..N = seen through mirror N, -1 = made by us (seam or fill).
    kind : np.ndarray [shape=(T,), dtype=int8] or None
        ``SURFACE`` (measured), ``SEAM`` (zippered) or ``FILL`` (closed).
    """

    vertices: np.ndarray
    triangles: np.ndarray
    colors: np.ndarray | None = None
    view: np.ndarray | None = None
    kind: np.ndarray | None = None

    def transformed(self, matrix: np.ndarray) -> Mesh:
        """The mesh moved by a rigid or similarity ``matrix`` (4, 4)."""
        from ..numeric.point_products import transform  # here: to name a mesh must not cost the import of numba

        return replace(self, vertices=transform(self.vertices, matrix))


def check_mesh(mesh: Mesh, what: str) -> None:
    """Refuse what cannot be zippered or closed, in words that begin with ``what``. O(V + T).

    Raises
    ------
    MirrorScanError
        When ``view`` or ``kind`` are missing, a vertex is not finite, or a triangle names one that does not exist.
    """
    if mesh.view is None or mesh.kind is None:
        raise MirrorScanError(f"{what}: the mesh does not say which view its vertices and what kind its triangles are")
    if not np.isfinite(mesh.vertices).all():
        raise MirrorScanError(f"{what}: a vertex of the mesh is not a finite number; take it out first")
    if len(mesh.triangles) and not 0 <= mesh.triangles.min() <= mesh.triangles.max() < len(mesh.vertices):
        raise MirrorScanError(f"{what}: a triangle names a vertex that does not exist; the mesh is damaged")


def merge(meshes: list[Mesh]) -> Mesh:
    """One mesh holding all, vertices in order."""
    offsets = np.cumsum([0] + [len(m.vertices) for m in meshes])
    has_color = all(m.colors is not None for m in meshes)
    return Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.triangles + o for m, o in zip(meshes, offsets[:-1], strict=True)]).astype(np.int32),
        np.concatenate([m.colors for m in meshes]) if has_color else None,
        np.concatenate([m.view for m in meshes]),
        np.concatenate([m.kind for m in meshes]),
    )
