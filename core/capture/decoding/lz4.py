"""LZ4 frames (Y. Collet's format, version 1.6): what rosbag compresses with."""

from __future__ import annotations

import struct

import numpy as np

from ...numeric.kernels import njit

MAGIC = 0x184D2204


def lz4_decompress(data: bytes | memoryview, size: int) -> np.ndarray:
    """``size`` bytes (uint8) of the LZ4 frame ``data``.

    Raises
    ------
    ValueError, struct.error
        When the frame is cut or damaged, or does not fill ``size`` exactly.
    """
    magic, flags = struct.unpack_from("<IB", data)
    if magic != MAGIC or flags >> 6 != 1:
        raise ValueError("no LZ4 frame of version 1")
    if size > 256 * len(data):
        raise ValueError(f"{size} bytes cannot come from {len(data)}")
    position = 7 + (8 if flags & 0x08 else 0) + (4 if flags & 0x01 else 0)
    out = np.empty(size, np.uint8)
    source = np.frombuffer(data, np.uint8)
    filled = 0
    while True:
        (block,) = struct.unpack_from("<I", data, position)
        position += 4
        if not block:
            break
        length = block & 0x7FFFFFFF
        if position + length > len(source):
            raise ValueError("the LZ4 frame is cut short")
        if block >> 31:  # stored as it is
            if filled + length > size:
                raise ValueError("the LZ4 frame is damaged")
            out[filled : filled + length] = source[position : position + length]
            filled += length
        else:
            filled = _block(source, position, position + length, out, filled)
            if filled < 0:
                raise ValueError("the LZ4 frame is damaged")
        position += length + (4 if flags & 0x10 else 0)
    if filled != size:
        raise ValueError("the LZ4 frame holds another size than stated")
    return out


@njit(cache=True, nogil=True)
def _block(data, i, end, out, o):
    """Decode one block onto ``out[o:]``, which earlier blocks filled up to there; -1 when it is damaged."""
    while i < end:
        token = np.int64(data[i])
        i += 1
        length = token >> 4
        if length == 15:
            while i < end:
                length += np.int64(data[i])
                i += 1
                if data[i - 1] != 255:
                    break
        if i + length > end or o + length > len(out):
            return -1
        for k in range(length):
            out[o + k] = data[i + k]
        i += length
        o += length
        if i == end:  # the last sequence has literals only
            return o
        if i + 2 > end:
            return -1
        source = o - (np.int64(data[i]) | np.int64(data[i + 1]) << 8)
        i += 2
        length = token & 15
        if length == 15:
            while i < end:
                length += np.int64(data[i])
                i += 1
                if data[i - 1] != 255:
                    break
        length += 4
        if source < 0 or source >= o or o + length > len(out):
            return -1
        for k in range(length):
            out[o + k] = out[source + k]
        o += length
    return o
