"""STL files: binary and ASCII."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator

import numpy as np

from ..errors import CaptureError
from ..mesh import Mesh
from .json_files import plain_text

# --- STL -------------------------------------------------------------------------------------------------------------

_STL_ROW = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_NAMES = re.compile(rb"\b(?:end)?solid\b[^\r\n]*?(?=\bfacet\s+normal\b|[\r\n]|$)")


_HEADER, _MILLIMETRES = b"Mirror Scan unit=mm", 1000.0  # printing programs take the numbers of an STL for millimetres


def write_stl(mesh: Mesh) -> Iterator[bytes]:
    """The binary file in pieces: in millimetres, which its header says."""
    corners = _MILLIMETRES * mesh.vertices[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    rows = np.zeros(len(corners), _STL_ROW)
    rows["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    rows["corners"] = corners
    yield _HEADER.ljust(80) + struct.pack("<I", len(corners))
    yield rows.tobytes()


def read_stl(data: bytes) -> Mesh:
    """The mesh in the bytes of a file; equal corners become one vertex.

    The format knows no unit: numbers are metres, but millimetres where a binary file's header says ``unit=mm``, as ours
    does. Several solids become one mesh. A binary file may begin with “solid”, as an ASCII file does.
    """
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= 84 else -1
    size = 84 + count * _STL_ROW.itemsize
    text = None if len(data) == size >= 84 else _ascii_stl(data)
    if text is not None:
        words = _NAMES.sub(b" ", text).split()
        at = [i for i, word in enumerate(words) if word == b"vertex"]
        try:
            with np.errstate(over="ignore"):  # what is too large is not finite, which is said below
                corners = np.array([float(w) for i in at for w in words[i + 1 : i + 4]]).astype(np.float32)
        except ValueError as error:
            raise CaptureError("a vertex of the ascii STL file holds something that is not a number") from error
        if corners.size != 3 * len(at) or len(at) % 3:
            raise CaptureError("ascii STL ends within a facet; it is truncated or damaged")
        corners = corners.reshape(-1, 3)
    elif count >= 0 and len(data) >= size:
        corners = np.frombuffer(data, _STL_ROW, count, 84)["corners"].reshape(-1, 3)
    else:
        raise CaptureError("is no STL file, or it is truncated: its length does not fit the number of triangles in it")
    if not np.isfinite(corners).all():
        raise CaptureError("some coordinates are not finite numbers; repair the mesh")
    keys = np.ascontiguousarray(corners + np.float32(0)).view("V12").ravel()  # + 0 makes -0 and 0 one vertex
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    unit = 1 / _MILLIMETRES if text is None and re.search(rb"\bunit=mm\b", data[:80]) else 1.0
    triangles = inverse.reshape(-1, 3).astype(np.int32)
    a, b, c = triangles.T
    return Mesh(unit * corners[first].astype(np.float64), triangles[(a != b) & (b != c) & (c != a)])


def _ascii_stl(data: bytes) -> bytes | None:
    """Text of an ASCII file in small letters; None for a binary one."""
    text = plain_text(data)
    if text[:200].lstrip()[:5].lower() != b"solid":
        return None
    text = text.lower()
    return text if re.search(rb"\bfacet\s+(?:normal|outer)\b|\bendsolid\b", text[:65536]) else None
