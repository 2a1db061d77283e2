"""Organized ``.pcd`` of the Point Cloud Library: ascii, binary and binary_compressed."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from ...errors import CaptureError
from ..capture import Capture, ReadOptions, stored_capture
from ..decoding.binary import blaming, read_limited
from ..frames import FrameChoice, chosen_frames
from .organized_cloud import depth_of_cloud

FORMAT = "organized .pcd"
KEYS = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")
MAX_BYTES = 1_000_000_000
MAX_POINTS = 16_000_000


def recognises(path: Path) -> bool:
    """Whether ``path`` begins as a .pcd does, after comments."""
    if not path.is_file():
        return False
    with open(path, "rb") as file:
        lines = file.read(400).split(b"\n")
    first = next((line for line in lines if line.strip() and not line.startswith(b"#")), b"")
    return lines[0].startswith(b"# .PCD") or first.startswith((b"VERSION", b"FIELDS"))


def read(path: Path, frames: FrameChoice, options: ReadOptions) -> Capture:
    """Read one organized cloud; its camera is fitted from the points."""
    chosen_frames(path, frames, 1)
    data = read_limited(path, MAX_BYTES)
    with blaming(path, "a .pcd"), np.errstate(all="ignore"):
        header, start = _header(data)
        fields, points = _layout(path, header)
        width, height = int(header["WIDTH"][0]), int(header["HEIGHT"][0])
        if height < 2 or width < 2:
            raise CaptureError(
                f"{path}: holds {points} points in no grid; save it organized (WIDTH × HEIGHT, with the pixels "
                "that have no reading as nan)",
                code="not_a_capture",
            )
        kind = header["DATA"][0]
        if kind == "ascii":
            columns = _ascii(data, start, fields, points)
        elif kind == "binary":
            columns = _binary(data, start, fields, points)
        elif kind == "binary_compressed":
            columns = _compressed(data, start, fields, points)
        else:
            raise ValueError(f"DATA {kind[:20]}")
        cloud = np.stack([columns[axis].astype(np.float64) for axis in "xyz"], axis=-1).reshape(height, width, 3)
        color = _color(columns, height, width) if options.color else None
    depth, camera, notes = depth_of_cloud(path, cloud, options.depth_unit_m)
    return stored_capture(path, f"{FORMAT} ({kind})", depth, color, options.intrinsics or camera, notes=notes)


def _header(data: bytes) -> tuple[dict[str, list[str]], int]:
    header: dict[str, list[str]] = {}
    position = 0
    for _ in range(100):
        end = data.index(b"\n", position, position + 65536)
        words = data[position:end].decode("ascii").split()
        position = end + 1
        if not words or words[0].startswith("#"):
            continue
        if words[0] not in KEYS:
            raise ValueError(f"{words[0][:20]} is no key of a header")
        header[words[0]] = words[1:]
        if words[0] == "DATA":
            return header, position
    raise ValueError("the header has no end")


def _layout(path: Path, header: dict[str, list[str]]) -> tuple[list[tuple[str, np.dtype, int]], int]:
    """Name, type and count of each field, and the number of points."""
    names, sizes, kinds = header["FIELDS"], header["SIZE"], header["TYPE"]
    counts = header.get("COUNT", ["1"] * len(names))
    fields = []
    for name, size, kind, count in zip(names, sizes, kinds, counts, strict=True):
        if kind not in ("F", "U", "I") or size not in ("1", "2", "4", "8") or not 1 <= int(count) <= 4096:
            raise ValueError(f"field {name[:20]} of type {kind[:4]}{size[:4]}")
        fields.append((name, np.dtype(f"<{kind.lower()}{size}"), int(count)))
    if len(fields) > 64 or not {"x", "y", "z"} <= set(names):
        raise ValueError("fields x, y and z are not all there")
    points = int(header["WIDTH"][0]) * int(header["HEIGHT"][0])
    if "POINTS" in header and int(header["POINTS"][0]) != points:
        raise ValueError("POINTS is not WIDTH × HEIGHT")
    if not 0 < points <= MAX_POINTS or int(header["WIDTH"][0]) < 1:
        raise CaptureError(f"{path}: no depth camera gives {points} points")
    return fields, points


def _ascii(data: bytes, start: int, fields: list, points: int) -> dict[str, np.ndarray]:
    total = sum(count for *_, count in fields)
    if len(data) - start < 2 * total * points - 1:
        raise ValueError("the list of points is cut short")
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # what numpy says of text that is no number
        try:
            numbers = np.fromstring(data[start:], np.float64, total * points, sep=" ")
        except DeprecationWarning as error:
            raise ValueError("a value is no number") from error
    if len(numbers) < total * points:
        raise ValueError("the list of points is cut short")
    columns, position = {}, 0
    for name, kind, count in fields:
        if count == 1:
            # whole numbers pass through float64, which holds 32 bits of them exactly; other widths are not needed
            columns[name] = numbers[position::total].astype(kind if kind.itemsize <= 4 else np.float64)
        position += count
    return columns


def _binary(data: bytes, start: int, fields: list, points: int) -> dict[str, np.ndarray]:
    # two fields may have one name (padding is “_” by convention), which numpy does not allow
    record = np.dtype([(f"{i}", kind, (count,)) for i, (_, kind, count) in enumerate(fields)])
    if len(data) - start < record.itemsize * points:
        raise ValueError("the list of points is cut short")
    rows = np.frombuffer(data, record, points, start)
    return {name: rows[f"{i}"][:, 0] for i, (name, _, count) in enumerate(fields) if count == 1}


def _compressed(data: bytes, start: int, fields: list, points: int) -> dict[str, np.ndarray]:
    packed, unpacked = (int(n) for n in np.frombuffer(data, "<u4", 2, start))
    if unpacked != points * sum(kind.itemsize * count for _, kind, count in fields):
        raise ValueError("the size of the points is not what the header says")
    if packed > len(data) - start - 8:
        raise ValueError("the list of points is cut short")
    from ..decoding.lzf import lzf_decompress  # brings numba

    raw = lzf_decompress(data[start + 8 : start + 8 + packed], unpacked)
    columns, position = {}, 0
    for name, kind, count in fields:  # field by field, unlike the other two
        size = kind.itemsize * count * points
        if count == 1:
            columns[name] = raw[position : position + size].view(kind)
        position += size
    return columns


def _color(columns: dict[str, np.ndarray], height: int, width: int) -> np.ndarray | None:
    packed = next((columns[name] for name in ("rgba", "rgb") if name in columns), None)
    if packed is None or packed.dtype.itemsize != 4:
        return None
    bits = np.ascontiguousarray(packed).view(np.uint32)
    color = np.stack([(bits >> shift).astype(np.uint8) for shift in (16, 8, 0)], axis=-1)
    return color.reshape(height, width, 3) if color.any() else None
