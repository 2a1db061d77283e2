"""ROS 1 bags (format 2.0), as much as captures need: topics, and the messages of each by number.

Chunks are unpacked only when a message in them is wanted; the index records that follow each chunk say where they are.
A bag that was never closed has no index at its end, and is read all the same.
"""

from __future__ import annotations

import bz2
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...errors import CaptureError

SIGNATURE = b"#ROSBAG V2.0\n"
MAX_CHUNK = 256_000_000
MAX_MESSAGES = 2_000_000


@dataclass
class Topic:
    """One connection: its name, message type, and (time [ns], chunk, offset in it) of each message."""

    name: str
    kind: str
    messages: list[tuple[int, int, int]] = field(default_factory=list)


class BagIndex(NamedTuple):
    """What a walk through a bag finds: chunks, topics by the number of their connection, whether it was cut off."""

    chunks: list[tuple[str, int, int, int]]
    topics: dict[int, Topic]
    truncated: bool


class RosBag:
    """The messages of a bag whose bytes are ``data``; with the ``index`` of another one of the same, at once.

    Raises
    ------
    ValueError, KeyError, struct.error, CaptureError
        When the bytes make no sense.
    """

    def __init__(self, data: memoryview, path: Path, index: BagIndex | None = None) -> None:
        self._data, self._path = data, path
        self._chunks: list[tuple[str, int, int, int]] = []  # compression, unpacked size, extent
        self._unpacked: tuple[int, np.ndarray] | None = None
        self.topics: dict[int, Topic] = {}
        self.truncated = False
        self._count = 0
        if index is not None:
            self._chunks, self.topics, self.truncated = index
            return
        if bytes(data[: len(SIGNATURE)]) != SIGNATURE:
            raise CaptureError(f"{path}: is no ROS bag of version 2.0")
        indexed: set[int] = set()
        for header, first, last in self._records(data, len(SIGNATURE)):
            kind = header["op"][0]
            if kind == 0x05:
                (size,) = struct.unpack("<I", header["size"])
                if size > MAX_CHUNK:
                    raise CaptureError(f"{path}: has a chunk of {size} bytes, more than recorders write; record again")
                self._chunks.append((header["compression"].decode("ascii"), size, first, last))
            elif kind == 0x07:
                self._connect(header, data[first:last])
            elif kind == 0x04 and self._chunks:
                self._index(header, data[first:last])
                indexed.add(len(self._chunks) - 1)
        for number in range(len(self._chunks)):
            if number not in indexed or not all(topic.name for topic in self.topics.values()):
                self._walk(number, number not in indexed)

    @property
    def index(self) -> BagIndex:
        """What the walk through the bag found; it holds none of its bytes."""
        return BagIndex(self._chunks, self.topics, self.truncated)

    def find(self, name_ends: str, kind: str) -> Topic | None:
        """The first topic with messages whose name ends so, of a message type."""
        return next(
            (t for t in self.topics.values() if t.name.endswith(name_ends) and t.kind == kind and t.messages), None
        )

    def message(self, topic: Topic, number: int) -> memoryview:
        """Bytes of one message, valid until the next is read."""
        _, chunk, offset = topic.messages[number]
        raw = memoryview(self._chunk(chunk))  # type: ignore[arg-type]
        for header, first, last in self._records(raw, offset):
            if header["op"][0] == 0x02:
                return raw[first:last]
            break
        raise ValueError("the index points at no message")

    def _records(self, data: memoryview, position: int):
        """Header fields and extent of the data of each record."""
        while position < len(data):
            if position + 4 > len(data):
                self.truncated = True
                return
            (size,) = struct.unpack_from("<I", data, position)
            start = position + 4 + size
            if start + 4 > len(data):
                self.truncated = True
                return
            (length,) = struct.unpack_from("<I", data, start)
            if start + 4 + length > len(data):
                self.truncated = True
                return
            yield _fields(data[position + 4 : start]), start + 4, start + 4 + length
            position = start + 4 + length

    def _connect(self, header: dict[str, bytes], body: memoryview) -> None:
        (number,) = struct.unpack("<I", header["conn"])
        if number not in self.topics:
            kind = _fields(body).get("type", b"").decode("utf-8", "replace")
            self.topics[number] = Topic(header["topic"].decode("utf-8", "replace"), kind)
        else:
            topic = self.topics[number]
            topic.name = topic.name or header["topic"].decode("utf-8", "replace")
            topic.kind = topic.kind or _fields(body).get("type", b"").decode("utf-8", "replace")

    def _index(self, header: dict[str, bytes], body: memoryview) -> None:
        (number,) = struct.unpack("<I", header["conn"])
        entries = np.frombuffer(body, "<u4")
        topic = self.topics.setdefault(number, Topic("", ""))  # its connection record may stand at the end
        chunk = len(self._chunks) - 1
        self._more(len(entries) // 3)
        for seconds, nanoseconds, offset in entries[: len(entries) // 3 * 3].reshape(-1, 3).tolist():
            topic.messages.append((seconds * 1_000_000_000 + nanoseconds, chunk, offset))

    def _walk(self, number: int, messages: bool) -> None:
        """Connections of a chunk and, where there is no index, its messages."""
        raw = memoryview(self._chunk(number))  # type: ignore[arg-type]
        position = 0
        for header, first, last in self._records(raw, 0):
            kind = header["op"][0]
            if kind == 0x07:
                self._connect(header, raw[first:last])
            elif kind == 0x02 and messages:
                (connection,) = struct.unpack("<I", header["conn"])
                seconds, nanoseconds = struct.unpack("<II", header["time"])
                self._more(1)
                topic = self.topics.setdefault(connection, Topic("", ""))
                topic.messages.append((seconds * 1_000_000_000 + nanoseconds, number, position))
            position = last

    def _more(self, count: int) -> None:
        self._count += count
        if self._count > MAX_MESSAGES:
            raise CaptureError(f"{self._path}: has more than {MAX_MESSAGES} messages; cut the recording", code="frames")

    def _chunk(self, number: int) -> np.ndarray:
        """Unpacked bytes of a chunk; the last one is kept."""
        if self._unpacked is None or self._unpacked[0] != number:
            compression, size, first, last = self._chunks[number]
            packed = bytes(self._data[first:last])
            if compression == "lz4":
                from .lz4 import lz4_decompress  # brings numba

                raw = lz4_decompress(packed, size)
            elif compression == "bz2":
                raw = np.frombuffer(bz2.BZ2Decompressor().decompress(packed, size), np.uint8)
            elif compression == "none":
                raw = np.frombuffer(packed, np.uint8)
            else:
                raise ValueError(f"compression {compression[:20]}")
            if len(raw) != size:
                raise ValueError("a chunk holds another size than stated")
            self._unpacked = number, raw
        return self._unpacked[1]


def _fields(data: memoryview) -> dict[str, bytes]:
    """The name=value fields of a record's header."""
    fields, position = {}, 0
    while position < len(data):
        (size,) = struct.unpack_from("<I", data, position)
        if position + 4 + size > len(data):
            raise ValueError("a field reaches beyond its header")
        name, found, value = bytes(data[position + 4 : position + 4 + size]).partition(b"=")
        if not found:
            raise ValueError("a field without a name")
        fields[name.decode("ascii")] = value
        position += 4 + size
    return fields
