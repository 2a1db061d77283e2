"""Binary glTF 2.0 (.glb) as a container: its JSON, and arrays in one buffer. Khronos Group, glTF 2.0 specification."""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path

import numpy as np

from ..errors import CaptureError, OutputError
from .atomic_files import replacing

_MAGIC, _VERSION, _JSON, _BINARY = 0x46546C67, 2, 0x4E4F534A, 0x004E4942
_CODES = {"b": 5120, "B": 5121, "h": 5122, "H": 5123, "I": 5125, "f": 5126}  # numpy's letters: component types
_TYPES = {"SCALAR": (), "VEC2": (2,), "VEC3": (3,), "VEC4": (4,), "MAT4": (4, 4)}
VERTICES, INDICES = 34962, 34963
"""What a buffer view is for: ``target`` of :meth:`Gltf.add`."""


class Gltf:
    """A file's JSON and its arrays.

    Parameters
    ----------
    content : dict
        The JSON; ``accessors``, ``bufferViews`` and ``buffers`` are made by :meth:`add` and :meth:`to_bytes`.
    binary : bytes
        The buffer.
    """

    def __init__(self, content: dict, binary: bytes = b"") -> None:
        self.content = content
        self.binary = bytearray(binary)

    def add(self, array: np.ndarray, target: int | None = None, bounds: bool = False) -> int:
        """Append an array (N,), (N, 2..4) or (N, 4, 4), and give the number of its accessor.

        Matrices are taken as rows of columns, as numpy has them, and stored column by column. ``bounds`` writes the
        least and largest values, which positions and times must have.
        """
        if array.dtype.char not in _CODES and array.dtype != np.uint32:
            raise OutputError(f"glTF has no numbers of type {array.dtype}")
        code = 5125 if array.dtype == np.uint32 else _CODES[array.dtype.char]
        kind = next(name for name, shape in _TYPES.items() if shape == array.shape[1:])
        stored = np.swapaxes(array, 1, 2) if kind == "MAT4" else array
        rows = np.ascontiguousarray(stored.reshape(len(array), -1))
        room = -rows.shape[1] * rows.itemsize % 4  # a vertex attribute's rows begin at multiples of four bytes
        view: dict = {"buffer": 0}
        if room and target == VERTICES:
            rows = np.pad(rows.view(np.uint8).reshape(len(rows), -1), ((0, 0), (0, room)))
            view["byteStride"] = rows.shape[1]
        self.binary += bytes(-len(self.binary) % 4)
        view |= {"byteOffset": len(self.binary), "byteLength": rows.nbytes}
        if target is not None:
            view["target"] = target
        self.binary += rows.tobytes()
        views = self.content.setdefault("bufferViews", [])
        views.append(view)
        accessor = {"bufferView": len(views) - 1, "componentType": code, "count": len(array), "type": kind}
        if bounds:
            flat = array.reshape(len(array), -1)
            accessor |= {"min": flat.min(axis=0).tolist(), "max": flat.max(axis=0).tolist()}
        accessors = self.content.setdefault("accessors", [])
        accessors.append(accessor)
        return len(accessors) - 1

    def array(self, number: int) -> np.ndarray:
        """The array of an accessor, as :meth:`add` took it; whole numbers that stand for shares become those.

        Raises
        ------
        CaptureError
            When it is not within the file, or of a kind that this reader does not know.
        """
        try:
            accessor = self.content["accessors"][number]
            view = self.content["bufferViews"][accessor["bufferView"]]
            letter = next(name for name, code in _CODES.items() if code == accessor["componentType"])
            shape, count = _TYPES[accessor["type"]], int(accessor["count"])
            dtype = np.dtype("<" + letter)
            width = int(np.prod(shape, dtype=int))
            stride = int(view.get("byteStride", width * dtype.itemsize))
            start = int(view.get("byteOffset", 0)) + int(accessor.get("byteOffset", 0))
        except (KeyError, IndexError, StopIteration, TypeError, ValueError) as error:
            raise CaptureError(f"array {number} of the glTF file is missing or of an unknown kind") from error
        length = width * dtype.itemsize
        if min(start, count) < 0 or stride < length or start + stride * max(count - 1, 0) + length > len(self.binary):
            raise CaptureError(f"array {number} of the glTF file is not within it; it is truncated or damaged")
        if start % dtype.itemsize or stride % dtype.itemsize:
            raise CaptureError(f"array {number} of the glTF file does not lie at a whole number; the file is damaged")
        octets = np.frombuffer(self.binary, np.uint8)
        rows = np.lib.stride_tricks.as_strided(octets[start:], (count, length), (stride, 1))
        values = np.array(rows).view(dtype).reshape(count, *shape)
        if accessor.get("normalized"):
            values = np.maximum(values / np.float32(np.iinfo(dtype).max), np.float32(-1.0))
        return np.swapaxes(values, 1, 2) if accessor["type"] == "MAT4" else values

    def add_bytes(self, data: bytes) -> int:
        """Append what is no array, such as an image's file, and give the number of its buffer view."""
        self.binary += bytes(-len(self.binary) % 4)
        views = self.content.setdefault("bufferViews", [])
        views.append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)})
        self.binary += data
        return len(views) - 1

    def view_bytes(self, number: int) -> bytes:
        """The bytes of a buffer view.

        Raises
        ------
        CaptureError
            When it is not within the file.
        """
        try:
            view = self.content["bufferViews"][number]
            start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise CaptureError(f"part {number} of the glTF file is missing") from error
        if min(start, length) < 0 or start + length > len(self.binary):
            raise CaptureError(f"part {number} of the glTF file is not within it; it is truncated or damaged")
        return bytes(self.binary[start : start + length])

    def to_bytes(self) -> bytes:
        """The file's bytes."""
        self.binary += bytes(-len(self.binary) % 4)
        self.content["buffers"] = [{"byteLength": len(self.binary)}]
        text = json.dumps(self.content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode("utf-8")
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + len(self.binary)
        return b"".join(
            (
                struct.pack("<III", _MAGIC, _VERSION, total),
                struct.pack("<II", len(text), _JSON), text,
                struct.pack("<II", len(self.binary), _BINARY), bytes(self.binary),
            )
        )  # fmt: skip


def write_gltf(path: str | os.PathLike, gltf: Gltf) -> None:
    """Write a .glb, which appears under its name when it is complete.

    Raises
    ------
    OutputError
    """
    with replacing(path) as temporary:
        temporary.write_bytes(gltf.to_bytes())


def read_gltf(path: str | os.PathLike) -> Gltf:
    """Read a .glb whose arrays lie in its own buffer.

    Raises
    ------
    CaptureError
        Missing, truncated, or no binary glTF 2.0.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise CaptureError(f"{path}: cannot be read: {error.strerror or error}") from error
    if len(data) < 20 or struct.unpack_from("<I", data)[0] != _MAGIC:
        raise CaptureError(f"{path}: is not a binary glTF file (.glb)")
    if struct.unpack_from("<I", data, 4)[0] != _VERSION:
        raise CaptureError(f"{path}: is glTF of version {struct.unpack_from('<I', data, 4)[0]}; only 2 can be read")
    chunks: dict[int, bytes] = {}
    at = 12
    while at + 8 <= len(data):
        length, kind = struct.unpack_from("<II", data, at)
        if at + 8 + length > len(data):
            raise CaptureError(f"{path}: ends too early; it is truncated")
        chunks.setdefault(kind, data[at + 8 : at + 8 + length])
        at += 8 + length
    try:
        content = json.loads(chunks[_JSON].decode("utf-8"))
    except (KeyError, ValueError, RecursionError) as error:
        raise CaptureError(f"{path}: its JSON cannot be read; the file is damaged") from error
    if not isinstance(content, dict):
        raise CaptureError(f"{path}: its JSON is no object; the file is damaged")
    return Gltf(content, chunks.get(_BINARY, b""))
