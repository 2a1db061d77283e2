"""Triangle mesh as plain arrays: edges, boundary loops, components, manifold checks, clean-up."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

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
        return replace(self, vertices=self.vertices @ matrix[:3, :3].T + matrix[:3, 3])
