"""Matroska (.mkv), as much as depth recordings need: tracks, their frames in time, attachments and tags.

Elements are walked by their sizes (RFC 8794, RFC 9559); nothing is read that is not asked for, and a recording that
was cut off gives the frames it has.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ...errors import CaptureError

SIGNATURE = b"\x1a\x45\xdf\xa3"
MAX_FRAMES = 200_000
MAX_ATTACHMENT = 16_000_000
MAX_DEPTH = 8

_SEGMENT, _INFO, _TRACKS, _CLUSTER, _ATTACHMENTS, _TAGS = (
    0x18538067, 0x1549A966, 0x1654AE6B, 0x1F43B675, 0x1941A469, 0x1254C367
)  # fmt: skip
_TOP = (_INFO, _TRACKS, _CLUSTER, _ATTACHMENTS, _TAGS, 0x114D9B74, 0x1C53BB6B, 0x1043A770)


@dataclass
class Track:
    """One track; ``frames`` holds time [ns] and the extent of each frame's bytes in the file."""

    number: int
    uid: int = 0
    name: str = ""
    codec: str = ""
    private: bytes = b""
    width: int = 0
    height: int = 0
    frames: list[tuple[int, int, int]] = field(default_factory=list)


@dataclass
class Matroska:
    """What a file holds, without the frames' bytes."""

    tracks: list[Track] = field(default_factory=list)
    attachments: dict[str, bytes] = field(default_factory=dict)
    tags: dict[str, str] = field(default_factory=dict)
    tag_tracks: dict[str, int] = field(default_factory=dict)  # tag -> UID of the track it is said of
    truncated: bool = False


def parse(data: memoryview, path: Path) -> Matroska:
    """Walk through a file.

    Raises
    ------
    CaptureError, ValueError, IndexError, struct.error
        The last three when the bytes make no sense.
    """
    found = Matroska()
    header = next(_elements(data, 0, len(data)), None)
    if header is None or header[0] != 0x1A45DFA3:
        raise CaptureError(f"{path}: is no Matroska file")
    scale = 1_000_000
    for kind, start, end in _elements(data, header[2], len(data)):
        if kind != _SEGMENT:
            continue
        found.truncated |= end > len(data)
        for inner, first, last in _elements(data, start, min(end, len(data))):
            found.truncated |= last > len(data)
            last = min(last, len(data))
            if inner == _INFO:
                scale = _integers(data, first, last).get(0x2AD7B1, scale)
            elif inner == _TRACKS:
                found.tracks += [_track(data, a, b) for k, a, b in _elements(data, first, last) if k == 0xAE]
            elif inner == _ATTACHMENTS:
                _attachments(data, first, last, found, path)
            elif inner == _TAGS:
                _tags(data, first, last, found)
            elif inner == _CLUSTER:
                _cluster(data, first, last, scale, found, path)
    return found


def _elements(data: memoryview, start: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Identifier and extent of each element between two positions; the last may reach beyond the end."""
    while start < end:
        kind, start = _number(data, start, end, keep_marker=True)
        if kind is None:
            return
        size, start = _number(data, start, end)
        if size is None:
            return
        # unknown size (a live recording): a cluster then ends where the next top-level element begins
        stop = _end_of_unknown(data, start, end) if size < 0 else start + size
        yield kind, start, stop
        start = stop


def _number(data: memoryview, start: int, end: int, keep_marker: bool = False) -> tuple[int | None, int]:
    """Number of variable length and what follows; None at the end of the data, -1 for “unknown”."""
    if start >= end or not data[start]:
        return None, end
    length = 9 - data[start].bit_length()
    if start + length > end or (keep_marker and length > 4):
        return None, end
    value = int.from_bytes(data[start : start + length], "big")
    if not keep_marker:
        value &= (1 << (7 * length)) - 1
        if value == (1 << (7 * length)) - 1:
            value = -1
    return value, start + length


def _end_of_unknown(data: memoryview, start: int, end: int) -> int:
    """Where the element of unknown size ends: before the next top-level element that is not nested in it."""
    kind, after = _number(data, start, end, keep_marker=True)
    if kind in _TOP:  # the segment itself
        return end
    while start < end:
        kind, after = _number(data, start, end, keep_marker=True)
        if kind is None or kind in _TOP:
            return start
        size, after = _number(data, after, end)
        if size is None or size < 0:
            return start
        start = after + size
    return end


def _integers(data: memoryview, start: int, end: int) -> dict[int, int]:
    """Elements of at most eight bytes, as unsigned integers."""
    return {
        kind: int.from_bytes(data[first:last], "big")
        for kind, first, last in _elements(data, start, end)
        if 0 <= last - first <= 8 and last <= end
    }


def _text(data: memoryview, first: int, last: int) -> str:
    return bytes(data[first : min(last, first + 4096)]).split(b"\0")[0].decode("utf-8", "replace")


def _track(data: memoryview, start: int, end: int) -> Track:
    numbers = _integers(data, start, end)
    track = Track(numbers.get(0xD7, 0), numbers.get(0x73C5, 0))
    for kind, first, last in _elements(data, start, end):
        if kind == 0x536E:
            track.name = _text(data, first, last)
        elif kind == 0x86:
            track.codec = _text(data, first, last)
        elif kind == 0x63A2:
            track.private = bytes(data[first : min(last, first + 65536)])
        elif kind == 0xE0:
            video = _integers(data, first, min(last, end))
            track.width, track.height = video.get(0xB0, 0), video.get(0xBA, 0)
    return track


def _attachments(data: memoryview, start: int, end: int, found: Matroska, path: Path) -> None:
    for kind, first, last in _elements(data, start, end):
        if kind != 0x61A7:
            continue
        name, content = "", b""
        for inner, a, b in _elements(data, first, min(last, end)):
            if inner == 0x466E:
                name = _text(data, a, b)
            elif inner == 0x465C:
                if b - a > MAX_ATTACHMENT:
                    raise CaptureError(f"{path}: an attachment of {b - a} bytes is no calibration; record it again")
                content = bytes(data[a : min(b, end)])
        found.attachments[name] = content


def _tags(data: memoryview, start: int, end: int, found: Matroska) -> None:
    for kind, first, last in _elements(data, start, end):
        if kind != 0x7373:
            continue
        track = 0
        for inner, a, b in _elements(data, first, min(last, end)):
            if inner == 0x63C0:
                track = _integers(data, a, min(b, end)).get(0x63C5, 0)
            elif inner == 0x67C8:
                name = value = ""
                for item, c, d in _elements(data, a, min(b, end)):
                    if item == 0x45A3:
                        name = _text(data, c, d)
                    elif item == 0x4487:
                        value = _text(data, c, d)
                found.tags[name] = value
                found.tag_tracks[name] = track


def _cluster(data: memoryview, start: int, end: int, scale: int, found: Matroska, path: Path) -> None:
    time = 0
    tracks = {track.number: track for track in found.tracks}
    for kind, first, last in _elements(data, start, end):
        if kind == 0xE7:
            time = int.from_bytes(data[first : min(last, first + 8)], "big")
        blocks = []
        if kind == 0xA3:
            blocks = [(first, last)]
        elif kind == 0xA0:
            blocks = [(a, b) for inner, a, b in _elements(data, first, min(last, end)) if inner == 0xA1]
        for a, b in blocks:
            if b > end:
                found.truncated = True
                continue
            number, body = _number(data, a, b)
            if number not in tracks or body + 3 > b:
                continue
            (offset,) = struct.unpack_from(">h", data, body)
            if data[body + 2] & 0x06:
                raise CaptureError(f"{path}: track {number} is laced, which no depth recorder does; record it again")
            frames = tracks[number].frames
            if len(frames) >= MAX_FRAMES:
                raise CaptureError(f"{path}: has more than {MAX_FRAMES} frames; cut the recording", code="frames")
            frames.append(((time + offset) * scale, body + 3, b))
