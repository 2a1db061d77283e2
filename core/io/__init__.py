"""Files: meshes, images, and safe writing."""

from __future__ import annotations

from .mesh_files import OBJ_COMPANIONS, obj_companion, read_mesh, write_mesh

__all__ = [
    "OBJ_COMPANIONS",
    "obj_companion",
    "read_mesh",
    "write_mesh",
    "atomic_files",
    "color_atlas",
    "frame_files",
    "gltf",
    "images",
    "json_files",
    "three_mf",
]
