"""Triangle meshes as plain arrays, and queries on them."""

from __future__ import annotations

from .texture import Texture
from .triangle_mesh import FILL, KIND_NAMES, SEAM, SURFACE, Mesh

__all__ = [
    "FILL",
    "KIND_NAMES",
    "Mesh",
    "SEAM",
    "SURFACE",
    "Texture",
    "boundary_loops",
    "bvh",
    "edge_lists",
    "half_edges",
    "normals",
    "self_intersections",
    "soundness",
    "submesh",
    "surface_distance",
    "texture",
    "triangle_mesh",
]
