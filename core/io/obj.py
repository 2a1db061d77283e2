"""OBJ files, with colours behind the coordinates."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..errors import CaptureError
from ..mesh import Mesh, Texture
from ..mesh.triangle_mesh import triangulate_polygons
from .json_files import plain_text

# --- OBJ -------------------------------------------------------------------------------------------------------------


def write_obj(mesh: Mesh, texture: Texture | None = None, stem: str = "") -> Iterator[bytes]:
    """The file in pieces; with a texture it names ``stem``.mtl, which :func:`material` makes."""
    yield b"# Mirror Scan, metres; vertex colours behind the coordinates, 0..1\n"
    if texture is not None:
        yield f"mtllib {stem}.mtl\n".encode()
    yield b"o Avatar\n"
    table, line = mesh.vertices, "v %.6f %.6f %.6f\n"
    if mesh.colors is not None:
        table, line = np.hstack((mesh.vertices, mesh.colors / 255.0)), "v %.6f %.6f %.6f %.4f %.4f %.4f\n"
    yield from _format_rows(line, table)
    if texture is None:
        yield from _format_rows("f %d %d %d\n", mesh.triangles.astype(np.int64) + 1)
        return
    _, places, corners = texture.split(mesh.triangles)
    yield from _format_rows("vt %.6f %.6f\n", places)
    yield b"usemtl Avatar\n"
    pairs = np.stack((mesh.triangles, corners), axis=2).astype(np.int64) + 1
    yield from _format_rows("f %d/%d %d/%d %d/%d\n", pairs.reshape(-1, 6))


def material(stem: str) -> bytes:
    """The file of materials of an OBJ file whose image is ``stem``.png."""
    return f"newmtl Avatar\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {stem}.png\n".encode()


def _format_rows(line: str, table: np.ndarray, block: int = 20_000) -> Iterator[bytes]:
    """Rows of ``table`` through one format string, a block at a time."""
    for start in range(0, len(table), block):
        rows = table[start : start + block]
        yield ((line * len(rows)) % tuple(rows.ravel().tolist())).encode("ascii")


def read_obj(data: bytes) -> Mesh:
    """The mesh in the bytes of a file; polygons become triangles.

    Spellings that other programs read are read: byte order marks, leading blanks, comments behind values, lines that go
    on after a backslash, colours of 0 to 1 or 0 to 255.
    """
    data = plain_text(data)
    if b"\\" in data:
        data = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").replace(b"\\\r", b" ")
    lines = [line.lstrip() for line in data.splitlines()]
    vertex_lines = [i for i, line in enumerate(lines) if line.startswith((b"v ", b"v\t"))]
    face_lines = [i for i, line in enumerate(lines) if line.startswith((b"f ", b"f\t"))]
    words = [_words(lines[i]) for i in vertex_lines]
    widths = np.array([len(row) for row in words], dtype=np.int64)
    if len(widths) and widths.min() < 3:
        raise CaptureError(f"line {vertex_lines[int(widths.argmin())] + 1}: a vertex needs three coordinates")
    try:
        points = np.array([float(w) for row in words for w in row[:3]]).reshape(-1, 3)
        colors = None
        if len(widths) and widths.min() >= 6:
            shades = np.nan_to_num(np.array([float(w) for row in words for w in row[3:6]]).reshape(-1, 3))
            full = 255 if shades.max() > 1.5 else 1
            colors = np.rint(np.clip(shades / full, 0, 1) * 255).astype(np.uint8)
        corners = [_words(lines[i]) for i in face_lines]
        flat = np.array([int(w.partition(b"/")[0]) for row in corners for w in row], dtype=np.int64)
    except (ValueError, OverflowError) as error:
        raise CaptureError("a vertex or face line of the OBJ file holds something that is not a number") from error

    lengths = np.array([len(row) for row in corners], dtype=np.int64)
    starts = np.concatenate(([0], np.cumsum(lengths)))[:-1].astype(np.int64)
    # Positive indices count from 1; negative ones back from the last vertex above the face.
    seen = np.searchsorted(np.array(vertex_lines, dtype=np.int64), np.array(face_lines, dtype=np.int64))
    flat = np.where(flat < 0, flat + np.repeat(seen, lengths), np.where(flat == 0, -1, flat - 1))
    groups = [(r := np.flatnonzero(lengths == n), flat[starts[r, None] + np.arange(n)]) for n in np.unique(lengths)]
    return Mesh(points, triangulate_polygons((lengths, groups), len(points))[0], colors=colors)


def _words(line: bytes) -> list[bytes]:
    """What stands behind the line's first word, without a comment."""
    return (line.partition(b"#")[0] if b"#" in line else line).split()[1:]
