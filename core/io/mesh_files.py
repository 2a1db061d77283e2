"""Meshes to and from PLY, OBJ, STL and 3MF files, without Blender.

A file appears under its name only when it is complete (:func:`.atomic_files.replacing`). Whatever is read is taken for
hostile: a header may promise any count, so counts are compared with the bytes that are there before arrays are made.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..errors import CaptureError, MirrorScanError, OutputError
from ..mesh import Mesh, Texture
from .atomic_files import replacing
from .images import png_bytes
from .obj import material, read_obj, write_obj
from .ply import read_ply, write_ply
from .stl import read_stl, write_stl
from .three_mf import packed_3mf


def write_mesh(
    path: str | os.PathLike, mesh: Mesh, texture: Texture | None = None, companions: str | None = None
) -> None:
    """Write ``mesh`` as .ply (binary), .obj (with vertex colours), .stl (binary, geometry only) or .3mf, by suffix.

    PLY and OBJ are in metres; STL and 3MF, which are for printing, in millimetres. PLY holds all a
    :class:`.triangle_mesh.Mesh` has: ``red green blue`` (uchar) and ``view`` (char) per vertex, ``kind`` (uchar) per
    face. Coordinates are float32 in PLY and STL (0.1 µm at 2 m), micrometres in OBJ. 3MF holds colours.

    A ``texture`` of the mesh's triangles goes into 3MF files, and into OBJ files, which then have an .mtl and a .png
    of the same name beside them; the other formats have no place for it. ``companions`` is the stem of those two files
    where the caller writes them (:func:`obj_companion`).

    Raises
    ------
    OutputError
        Unknown suffix, a mesh with nothing to write (no vertices, or no triangles where the format has no points),
        triangles of vertices that do not exist, coordinates that are not finite or too large for the format, or a file
        that cannot be written.
    """
    path = Path(path)
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise OutputError(f"{path}: unknown mesh format “{path.suffix}”; use one of {', '.join(_WRITERS)}")
    count = len(mesh.vertices)
    if not count or (writer in (write_stl, packed_3mf) and not len(mesh.triangles)):
        raise OutputError(f"{path}: the mesh has no {'triangles' if count else 'vertices'}; nothing was written")
    if len(mesh.triangles) and not 0 <= mesh.triangles.min() <= mesh.triangles.max() < count:
        raise OutputError(
            f"{path}: a triangle has a vertex that does not exist (there are {count}); nothing was written"
        )
    fit = np.abs(mesh.vertices) < np.finfo(np.float32).max  # false for NaN too
    if not fit.all():
        bad = int((~fit.all(axis=1)).sum())
        raise OutputError(f"{path}: {bad} of {count} vertices are not finite; nothing was written")
    if texture is not None and len(texture.uv) != len(mesh.triangles):
        raise OutputError(
            f"{path}: the texture is of {len(texture.uv)} triangles, the mesh has {len(mesh.triangles)}; "
            "nothing was written"
        )
    pieces: Iterator[bytes | memoryview]
    if writer is write_obj and texture is not None:
        pieces = write_obj(mesh, texture, companions or path.stem)
        for end in OBJ_COMPANIONS if companions is None else ():
            with replacing(path.with_suffix(end)) as temporary:
                temporary.write_bytes(obj_companion(path.with_suffix(end), texture))
    elif writer is packed_3mf:
        pieces = packed_3mf(mesh, texture)
    else:
        pieces = writer(mesh)
    with replacing(path) as temporary, open(temporary, "wb") as file:
        file.writelines(pieces)


OBJ_COMPANIONS = (".mtl", ".png")
"""What belongs to a textured .obj, under its name: material and image."""


def obj_companion(path: Path, texture: Texture) -> bytes:
    """The content of one of ``OBJ_COMPANIONS``, by the suffix of its final name ``path``."""
    return material(path.stem) if path.suffix == ".mtl" else png_bytes(texture.image)


def read_mesh(path: str | os.PathLike) -> Mesh:
    """Read a .ply (ascii or binary), .obj or .stl (ascii or binary) file; polygons become triangle fans.

    Returns
    -------
    Mesh
        ``colors``, ``view`` and ``kind`` where the file has them. STL vertices that coincide exactly are merged.
        No triangles when the file holds a point cloud.

    Raises
    ------
    CaptureError
        Missing or malformed file, counts the file cannot hold, indices out of range, coordinates that are not finite.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise CaptureError(f"{path}: unknown mesh format “{path.suffix}”; use one of {', '.join(_READERS)}")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise CaptureError(f"{path}: cannot be read: {error.strerror or error}") from error
    try:
        mesh = reader(data)
    except MirrorScanError as error:
        raise CaptureError(f"{path}: {error}") from error
    if not len(mesh.vertices):
        raise CaptureError(f"{path}: holds no vertices")
    if not np.isfinite(mesh.vertices).all():
        bad = int((~np.isfinite(mesh.vertices).all(axis=1)).sum())
        raise CaptureError(f"{path}: {bad} of {len(mesh.vertices)} vertices are not finite numbers; repair the mesh")
    return mesh


_WRITERS = {".ply": write_ply, ".obj": write_obj, ".stl": write_stl, ".3mf": packed_3mf}
_READERS = {".ply": read_ply, ".obj": read_obj, ".stl": read_stl}
MESH_SUFFIXES = tuple(_WRITERS)
