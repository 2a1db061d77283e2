"""PLY files: binary and ASCII, with colours."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..errors import CaptureError
from ..mesh import KIND_NAMES, Mesh
from ..mesh.triangle_mesh import PolygonLists, triangulate_polygons
from .json_files import plain_text

MAX_HEADER_BYTES = 1 << 16


# --- PLY -------------------------------------------------------------------------------------------------------------

_PLY_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8", "int64": "i8", "uint64": "u8",
}  # fmt: skip
_STRUCT_CODES = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "i8": "q", "u8": "Q"}


@dataclass
class _Property:
    name: str
    type: str  # numpy code without byte order
    count_type: str | None = None  # of a list; None for a scalar


@dataclass
class _Element:
    name: str
    count: int
    properties: list[_Property]


def write_ply(mesh: Mesh) -> Iterator[bytes | memoryview]:
    """The binary file in pieces."""
    vertex_fields: list[tuple] = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
    if mesh.colors is not None:
        vertex_fields += [("red", "u1"), ("green", "u1"), ("blue", "u1")]
    if mesh.view is not None:
        vertex_fields += [("view", "i1")]
    face_fields: list[tuple] = [("count", "u1"), ("vertex_indices", "<i4", (3,))]
    if mesh.kind is not None:
        face_fields += [("kind", "u1")]
    names = {"<f4": "float", "u1": "uchar", "i1": "char"}
    header = ["ply", "format binary_little_endian 1.0", "comment Mirror Scan, metres"]
    if mesh.view is not None:
        header.append("comment view: 0 seen directly, N seen through mirror N, -1 made up")
    if mesh.kind is not None:
        header.append("comment kind: " + ", ".join(f"{i} {name}" for i, name in enumerate(KIND_NAMES)))
    header.append(f"element vertex {len(mesh.vertices)}")
    header += [f"property {names[kind]} {name}" for name, kind in vertex_fields]
    header += [f"element face {len(mesh.triangles)}", "property list uchar int vertex_indices"]
    header += ["property uchar kind"] if mesh.kind is not None else []
    yield ("\n".join(header) + "\nend_header\n").encode("ascii")

    vertices = np.empty(len(mesh.vertices), dtype=vertex_fields)
    for axis, name in enumerate("xyz"):
        vertices[name] = mesh.vertices[:, axis]
    if mesh.colors is not None:
        for channel, name in enumerate(("red", "green", "blue")):
            vertices[name] = mesh.colors[:, channel]
    if mesh.view is not None:
        vertices["view"] = mesh.view
    yield vertices.tobytes()

    faces = np.empty(len(mesh.triangles), dtype=face_fields)
    faces["count"] = 3
    faces["vertex_indices"] = mesh.triangles
    if mesh.kind is not None:
        faces["kind"] = mesh.kind
    yield faces.tobytes()


def read_ply(data: bytes) -> Mesh:
    """The mesh in the bytes of a file; polygons and strips become triangles."""
    data = plain_text(data)
    layout, elements, start = _parse_ply_header(data)
    vertices = faces = strips = None
    if layout == "ascii":
        source: _AsciiBody | _BinaryBody = _AsciiBody(data[start:])
    else:
        source = _BinaryBody(data, start, "<" if layout == "binary_little_endian" else ">")
    for element in elements:
        content = source.read(element)
        if element.name == "vertex" and vertices is None:
            vertices = content
        elif element.name == "face" and faces is None:
            faces = content
        elif element.name == "tristrips" and strips is None:
            strips = content
    if vertices is None:
        raise CaptureError("has no element “vertex”; this is not a mesh")
    if not vertices:
        raise CaptureError("holds no vertices")
    missing = [axis for axis in "xyz" if not isinstance(vertices.get(axis), np.ndarray)]
    if missing:
        raise CaptureError(f"vertices have no property {', '.join(missing)}")
    points = np.stack([vertices[axis] for axis in "xyz"], axis=1).astype(np.float64)

    triangles, kind = np.empty((0, 3), np.int32), None
    if faces:
        polygons = _corner_lists(faces)
        if polygons is None:
            raise CaptureError("faces have no list property “vertex_indices”")
        triangles, rows = triangulate_polygons(polygons, len(points))
        kinds = faces.get("kind")
        if isinstance(kinds, np.ndarray):
            kind = kinds[rows].astype(np.int8)
    elif strips and (lists := _corner_lists(strips)) is not None:
        triangles = _triangles_of_strips(lists, len(points))
    view = vertices.get("view")
    return Mesh(
        points, triangles, colors=_ply_colors(vertices), kind=kind,
        view=view.astype(np.int8) if isinstance(view, np.ndarray) else None,
    )  # fmt: skip


def _corner_lists(element: dict) -> PolygonLists | None:
    """The lists of corners of faces or strips: under their usual names, or the only list there is."""
    lists = {name.lower(): content for name, content in element.items() if isinstance(content, tuple)}
    for name in ("vertex_indices", "vertex_index"):
        if name in lists:
            return lists[name]
    return next(iter(lists.values())) if len(lists) == 1 else None


def _triangles_of_strips(strips: PolygonLists, n_vertices: int) -> np.ndarray:
    """Triangles (T, 3) int32 of strips, as Stanford's range scans have them: -1 ends one, every other is turned."""
    pieces = [np.empty((0, 3), np.int64)]
    for _, rows in strips[1]:
        for row in np.asarray(rows, np.int64):
            for strip in np.split(row, np.flatnonzero(row < 0)):
                corners = strip[strip >= 0]
                if len(corners) >= 3:
                    triangles = np.stack((corners[:-2], corners[1:-1], corners[2:]), axis=1)
                    triangles[1::2, :2] = triangles[1::2, 1::-1]
                    pieces.append(triangles)
    a, b, c = np.concatenate(pieces).T
    triangles = np.stack((a, b, c), axis=1)[(a != b) & (b != c) & (c != a)]
    if triangles.size and triangles.max() >= n_vertices:
        raise CaptureError(f"a strip names a vertex outside 0…{n_vertices - 1}; the file is damaged")
    return triangles.astype(np.int32)


def _parse_ply_header(data: bytes) -> tuple[str, list[_Element], int]:
    """Layout, elements and where the body starts."""
    head = data[:MAX_HEADER_BYTES]
    if not re.match(rb"ply[ \t]*(\r\n|\n|\r)", head):
        raise CaptureError("is not a PLY file: it does not begin with “ply”")
    end = re.search(rb"[\n\r][ \t]*end_header[ \t]*(\r\n|\n|\r)", head)
    if end is None:
        raise CaptureError("PLY header has no “end_header”; the file is truncated or damaged")
    layout, elements = "", []
    for number, line in enumerate(head[: end.start()].decode("latin-1").splitlines(), start=1):
        words = line.split()
        match words:
            case [] | ["ply"] | ["comment", *_] | ["obj_info", *_]:
                continue
            case ["format", ("ascii" | "binary_little_endian" | "binary_big_endian") as layout, "1.0"]:
                continue
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) <= 18:
                elements.append(_Element(name, int(count), []))
            case ["property", "list", count_type, value_type, name] if elements and value_type in _PLY_TYPES:
                code = _PLY_TYPES.get(count_type, "")
                if code not in _STRUCT_CODES:
                    raise CaptureError(f"PLY header line {number}: a list cannot be counted in “{count_type}”")
                elements[-1].properties.append(_Property(name, _PLY_TYPES[value_type], code))
            case ["property", value_type, name] if elements and value_type in _PLY_TYPES:
                elements[-1].properties.append(_Property(name, _PLY_TYPES[value_type]))
            case _:
                raise CaptureError(f"PLY header line {number} is not understood: “{line.strip()[:80]}”")
    if not layout:
        raise CaptureError("PLY header has no “format” line")
    for element in elements:
        names = [p.name for p in element.properties]
        if len(set(names)) != len(names):
            raise CaptureError(f"PLY element “{element.name}” has two properties of one name")
        if element.count and not names:
            raise CaptureError(f"PLY element “{element.name}” has no properties")
    return layout, elements, end.end()


class _BinaryBody:
    """Reads elements one after another from the bytes behind the header."""

    def __init__(self, data: bytes, start: int, order: str) -> None:
        self.data, self.position, self.order = data, start, order

    def _dtype(self, element: _Element, lengths: tuple[int, ...]) -> np.dtype:
        """Row of ``element`` when its lists have these lengths."""
        fields: list[tuple] = []
        rest = iter(lengths)
        for i, prop in enumerate(element.properties):
            if prop.count_type is None:
                fields.append((f"p{i}", self.order + prop.type))
            else:
                fields.append((f"n{i}", self.order + prop.count_type))
                fields.append((f"p{i}", self.order + prop.type, (next(rest),)))
        return np.dtype(fields)

    def read(self, element: _Element) -> dict[str, np.ndarray | PolygonLists]:
        lists = [i for i, p in enumerate(element.properties) if p.count_type is not None]
        if not element.count:
            return {}
        least = self._dtype(element, (0,) * len(lists)).itemsize
        if element.count * least > len(self.data) - self.position:
            raise CaptureError(
                f"header promises {element.count} of “{element.name}”, but the file is too short for them; "
                "it is truncated or damaged"
            )
        if not lists:
            rows = np.frombuffer(self.data, self._dtype(element, ()), element.count, self.position)
            self.position += rows.nbytes
            return {p.name: rows[f"p{i}"] for i, p in enumerate(element.properties)}
        return self._read_uniform(element, lists) or self._read_ragged(element, lists)

    def _read_uniform(self, element: _Element, lists: list[int]) -> dict | None:
        """All rows at once when every row's lists are as long as the first row's; None when they are not."""
        lengths = self._row_lengths(element, self.position)[0]
        dtype = self._dtype(element, lengths)
        if element.count * dtype.itemsize > len(self.data) - self.position:
            return None
        rows = np.frombuffer(self.data, dtype, element.count, self.position)
        if any((rows[f"n{i}"] != length).any() for i, length in zip(lists, lengths, strict=True)):
            return None
        self.position += rows.nbytes
        content: dict = {}
        for i, prop in enumerate(element.properties):
            content[prop.name] = rows[f"p{i}"]
            if prop.count_type is not None:
                everything = np.arange(element.count)
                content[prop.name] = (rows[f"n{i}"].astype(np.int64), [(everything, rows[f"p{i}"])])
        return content

    def _row_lengths(self, element: _Element, position: int) -> tuple[tuple[int, ...], int]:
        """List lengths of the row at ``position``, and where the next row starts."""
        lengths = []
        for prop in element.properties:
            if prop.count_type is not None:
                code = self.order + _STRUCT_CODES[prop.count_type]
                if position + struct.calcsize(code) > len(self.data):
                    raise CaptureError(f"ends within “{element.name}”; it is truncated or damaged")
                length = struct.unpack_from(code, self.data, position)[0]
                if length < 0:
                    raise CaptureError(f"“{element.name}” has a list of {length} values; the file is damaged")
                lengths.append(length)
                position += struct.calcsize(code) + length * int(prop.type[1])
            else:
                position += int(prop.type[1])
        if position > len(self.data):
            raise CaptureError(f"ends within “{element.name}”; it is truncated or damaged")
        return tuple(lengths), position

    def _read_ragged(self, element: _Element, lists: list[int]) -> dict:
        """Walk the rows for their starts, then gather rows of like lengths together."""
        groups: dict[tuple[int, ...], list[tuple[int, int]]] = {}
        position = self.position
        for row in range(element.count):
            lengths, following = self._row_lengths(element, position)
            groups.setdefault(lengths, []).append((row, position))
            position = following
        self.position = position

        content: dict = {}
        for prop in element.properties:
            if prop.count_type is None:
                content[prop.name] = np.empty(element.count, self.order + prop.type)
            else:
                content[prop.name] = (np.empty(element.count, np.int64), [])
        octets = np.frombuffer(self.data, np.uint8)
        for lengths, where in groups.items():
            rows, starts = np.array(where).T
            dtype = self._dtype(element, lengths)
            packed = octets[starts[:, None] + np.arange(dtype.itemsize)].view(dtype)[:, 0]
            for i, prop in enumerate(element.properties):
                if prop.count_type is None:
                    content[prop.name][rows] = packed[f"p{i}"]
                else:
                    content[prop.name][0][rows] = lengths[lists.index(i)]
                    content[prop.name][1].append((rows, packed[f"p{i}"]))
        return content


class _AsciiBody:
    """Reads elements one after another from whitespace-separated numbers."""

    def __init__(self, text: bytes) -> None:
        try:
            self.values = np.array(list(map(float, text.split())))
        except ValueError as error:
            raise CaptureError("ascii PLY holds something that is not a number") from error
        self.position = 0

    def read(self, element: _Element) -> dict[str, np.ndarray | PolygonLists]:
        rows, width = element.count, len(element.properties)
        if not rows:
            return {}
        if rows * width > len(self.values) - self.position:
            raise CaptureError(
                f"header promises {rows} of “{element.name}”, but the file is too short for them; "
                "it is truncated or damaged"
            )
        if all(p.count_type is None for p in element.properties):
            table = self.values[self.position : self.position + rows * width].reshape(rows, width)
            self.position += table.size
            return {p.name: table[:, i] for i, p in enumerate(element.properties)}

        columns: list[list[int]] = [[] for _ in element.properties]  # where each value, or each list's count, stands
        position, numbers = self.position, self.values
        for _ in range(rows):
            for column, prop in zip(columns, element.properties, strict=True):
                column.append(position)
                if position >= len(numbers):
                    raise CaptureError(f"ends within “{element.name}”; it is truncated or damaged")
                if prop.count_type is not None:
                    length = numbers[position]
                    if not 0 <= length <= len(numbers) - position - 1:
                        raise CaptureError(f"“{element.name}” has a list longer than the file, or of negative length")
                    position += int(length)
                position += 1
        self.position = position
        content: dict = {}
        for column, prop in zip(columns, element.properties, strict=True):
            starts = np.array(column)
            content[prop.name] = numbers[starts]
            if prop.count_type is not None:
                lengths = numbers[starts].astype(np.int64)
                groups = [(r := np.flatnonzero(lengths == n), numbers[starts[r, None] + 1 + np.arange(n)])
                          for n in np.unique(lengths)]  # fmt: skip
                content[prop.name] = (lengths, groups)
        return content


def _ply_colors(vertices: dict) -> np.ndarray | None:
    for names in (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b")):
        if all(isinstance(vertices.get(name), np.ndarray) for name in names):
            channels = np.stack([vertices[name] for name in names], axis=1)
            # Types give the range; ascii values come as float64 whatever was declared, so look at them.
            if channels.dtype.kind == "f" and channels.size and np.nanmax(channels) <= 1:
                channels = channels * 255.0
            elif channels.dtype.itemsize == 2:
                channels = channels / 257.0
            return np.rint(np.clip(np.nan_to_num(channels), 0, 255)).astype(np.uint8)
    return None
