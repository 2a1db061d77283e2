"""Triangle meshes as plain arrays, and what is asked of them."""

from __future__ import annotations

from .triangle_mesh import FILL, KIND_NAMES, SEAM, SURFACE, Mesh

__all__ = ["FILL", "KIND_NAMES", "Mesh", "SEAM", "SURFACE"]
