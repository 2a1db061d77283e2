"""Organized ``.ply``: a cloud whose vertices lie in the grid of pixels (PCL's range grid, or one vertex a pixel)."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import CaptureError
from ..capture import Capture, ReadOptions, stored_capture
from ..decoding.binary import blaming, read_limited, starts_with
from ..frames import FrameChoice, chosen_frames
from .organized_cloud import depth_of_cloud

FORMAT = "organized .ply"
MAX_BYTES = 1_000_000_000
MAX_POINTS = 16_000_000
TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
#: Depth images that cameras make, for clouds that have one vertex a pixel and do not say how wide the grid is.
SIZES = (
    (640, 480), (512, 424), (640, 576), (320, 288), (320, 240), (512, 512), (1024, 1024), (848, 480), (1280, 720),
    (640, 360), (424, 240), (480, 270), (1280, 800), (256, 192), (960, 720), (1024, 768), (1920, 1080), (1280, 960),
    (160, 120), (640, 400), (608, 456), (224, 172), (480, 640), (424, 512), (576, 640), (192, 256),
)  # fmt: skip


@dataclass
class _Element:
    name: str
    count: int
    properties: list[tuple[str, str, str | None]]  # name, type, type of the list's count


def recognises(path: Path) -> bool:
    """Whether ``path`` begins as a .ply does."""
    return starts_with(path, b"ply\n", b"ply\r\n")


def read(path: Path, frames: FrameChoice, options: ReadOptions) -> Capture:
    """Read one organized cloud; its camera is fitted from the points."""
    chosen_frames(path, frames, 1)
    data = read_limited(path, MAX_BYTES)
    with blaming(path, "a .ply"), np.errstate(all="ignore"):
        kind, elements, said, start = _header(data)
        vertices, position = _vertices(path, data, start, kind, elements)
        missing = {"x", "y", "z"} - set(vertices)
        if missing:
            raise ValueError(f"vertices have no {', '.join(sorted(missing))}")
        points = np.stack([vertices[axis].astype(np.float64) for axis in "xyz"], axis=-1)
        size = int(said.get("num_cols", 0)), int(said.get("num_rows", 0))
        pixels = _range_grid(data, position, kind, elements, size, len(points))
        color = None
        if options.color and {"red", "green", "blue"} <= set(vertices):
            color = np.stack([vertices[name] for name in ("red", "green", "blue")], axis=-1)
            if color.dtype != np.uint8:
                color = np.clip(
                    np.nan_to_num(color.astype(np.float64)) * (255 if color.dtype.kind == "f" else 1), 0, 255
                )
                color = color.astype(np.uint8)
    if pixels is not None:
        grid = np.zeros((size[1] * size[0], 3))
        grid[pixels >= 0] = points[pixels[pixels >= 0]]
        colors = None
        if color is not None:
            colors = np.zeros((size[1] * size[0], 3), np.uint8)
            colors[pixels >= 0] = color[pixels[pixels >= 0]]
        points, color, sizes = grid, colors, [size]
    else:
        sizes = [size] if size[0] * size[1] == len(points) > 0 else [s for s in SIZES if s[0] * s[1] == len(points)]
    if not sizes:
        raise CaptureError(
            f"{path}: its {len(points)} points lie in no grid of pixels; save the cloud organized, with one vertex for "
            "each pixel (those without a reading as nan or 0 0 0)",
            code="not_a_capture",
        )
    problem: CaptureError | None = None
    for width, height in sizes:
        try:
            depth, camera, notes = depth_of_cloud(path, points.reshape(height, width, 3), options.depth_unit_m)
        except CaptureError as error:
            problem = error
            continue
        if color is not None:
            color = color.reshape(height, width, 3)
        return stored_capture(path, FORMAT, depth, color, options.intrinsics or camera, notes=notes)
    assert problem is not None  # there is at least one size, and none was returned
    raise problem


def _header(data: bytes) -> tuple[str, list[_Element], dict[str, str], int]:
    """Format, elements, ``obj_info`` entries, and where the body begins."""
    kind, elements, said, position = "", [], {}, 0
    for _ in range(300):
        end = data.index(b"\n", position, position + 65536)
        words = data[position:end].decode("ascii").split()
        position = end + 1
        if not words or words[0] in ("ply", "comment"):
            continue
        if words[0] == "format":
            kind = words[1]
        elif words[0] == "obj_info" and len(words) >= 3:
            said[words[1]] = words[2]
        elif words[0] == "element":
            elements.append(_Element(words[1], int(words[2]), []))
        elif words[0] == "property" and words[1] == "list":
            elements[-1].properties.append((words[4], TYPES[words[3]], TYPES[words[2]]))
        elif words[0] == "property":
            elements[-1].properties.append((words[2], TYPES[words[1]], None))
        elif words[0] == "end_header":
            if kind not in ("ascii", "binary_little_endian", "binary_big_endian"):
                raise ValueError(f"format {kind[:30]}")
            return kind, elements, said, position
    raise ValueError("the header has no end")


def _vertices(
    path: Path, data: bytes, start: int, kind: str, elements: list[_Element]
) -> tuple[dict[str, np.ndarray], int]:
    """Columns of the vertex element, which must be the first that has rows, and where what follows begins."""
    element = next((e for e in elements if e.count), None)
    if element is None or element.name != "vertex" or any(counts for *_, counts in element.properties):
        raise ValueError("vertices do not come first")
    if not 0 < element.count <= MAX_POINTS:
        raise CaptureError(f"{path}: no depth camera gives {element.count} points")
    names = [name for name, *_ in element.properties]
    if not names or len(names) > 64 or len(set(names)) != len(names):
        raise ValueError("vertices have no properties, or one twice")
    if kind == "ascii":
        total = len(names) * element.count
        if len(data) - start < 2 * total - 1:
            raise ValueError("the list of vertices is cut short")
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # what numpy says of text that is no number
            try:
                numbers = np.fromstring(data[start:], np.float64, total, sep=" ")
            except DeprecationWarning as error:
                raise ValueError("a value is no number") from error
        if len(numbers) < total:
            raise ValueError("the list of vertices is cut short")
        rows = numbers.reshape(element.count, len(names))
        columns = {}
        for i, (name, type_, _) in enumerate(element.properties):
            column = rows[:, i]
            whole = type_[0] != "f"
            columns[name] = np.clip(np.nan_to_num(column), 0, 255).astype(np.uint8) if whole else column.astype(type_)
        return columns, len(data)
    order = "<" if kind == "binary_little_endian" else ">"
    record = np.dtype([(name, order + type_) for name, type_, _ in element.properties])
    if len(data) - start < record.itemsize * element.count:
        raise ValueError("the list of vertices is cut short")
    records = np.frombuffer(data, record, element.count, start)
    return {name: records[name].astype(record[name].newbyteorder("=")) for name in names}, (
        start + record.itemsize * element.count
    )


def _range_grid(
    data: bytes, position: int, kind: str, elements: list[_Element], size: tuple[int, int], points: int
) -> np.ndarray | None:
    """Vertex of each pixel (W H,) int64, -1 for none, where the file has a ``range_grid``."""
    element = next((e for e in elements if e.name == "range_grid"), None)
    if element is None or element.count != size[0] * size[1] or not element.count:
        return None
    if kind == "ascii" or element.count > MAX_POINTS:
        raise ValueError("a range grid is read from binary files only")
    for between in elements[: elements.index(element)]:  # PCL writes its camera there
        if between.name != "vertex":
            if any(counts for *_, counts in between.properties):
                raise ValueError(f"{between.name[:30]} comes before the range grid")
            position += between.count * sum(np.dtype(type_).itemsize for _, type_, _ in between.properties)
    if len(element.properties) != 1 or element.properties[0][2] is None:
        raise ValueError("the range grid is no list")
    order = "<" if kind == "binary_little_endian" else ">"
    _, type_, counts = element.properties[0]
    index_type = np.dtype(order + type_)
    if np.dtype(counts).itemsize != 1 or index_type.kind == "f":
        raise ValueError("the range grid is not of whole numbers, counted by bytes")
    places = _places(data[position:], element.count, index_type.itemsize)
    pixels = np.full(element.count, -1, np.int64)
    bytes_ = np.frombuffer(data, np.uint8)[position:]
    seen = places >= 0
    spread = places[seen][:, None] + np.arange(index_type.itemsize)
    pixels[seen] = np.ascontiguousarray(bytes_[spread]).view(index_type)[:, 0]
    if (pixels >= points).any() or (pixels < -1).any():
        raise ValueError("the range grid names vertices that are not there")
    return pixels


def _places(data: bytes, count: int, size: int) -> np.ndarray:
    """Where each pixel's index stands (count,) int64 in a list of lists with none or one; -1 for none."""
    places, position, end = [], 0, len(data)
    for _ in range(count):
        if position >= end:
            raise ValueError("the range grid is cut short")
        length = data[position]
        position += 1
        if length == 1:
            places.append(position)
            position += size
        elif length == 0:
            places.append(-1)
        else:
            raise ValueError("a pixel of the range grid has more than one vertex")
    if position > end:
        raise ValueError("the range grid is cut short")
    return np.array(places, np.int64)
