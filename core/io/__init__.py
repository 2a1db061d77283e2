"""Files: meshes, images, and safe writing."""

from __future__ import annotations

from .mesh_files import read_mesh, write_mesh

__all__ = ["read_mesh", "write_mesh", "atomic_files", "gltf", "images", "json_files", "three_mf"]
