"""OpenNI's two codecs of depth: 16-bit differences in nibbles, of the values themselves or of a table's indices.

A stream begins with one whole value. Then, byte by byte: below 0xE0, two differences of -6 … 6 in its nibbles (0xD: no
second one; 0xF: what follows is as after 0xFF); 0xE0 + n, the last value 2 n times; 0xFF, one value in full: a byte
with its top bit set is a difference plus 192, else it and the next are the value, high byte first.
"""

from __future__ import annotations

import numpy as np

from ...numeric.kernels import njit


def decode_16z(data: bytes | memoryview, count: int, table: bool) -> np.ndarray:
    """``count`` values (uint16) of a frame in codec 16zP, or 16zT (``table``), where the used values come first.

    Raises
    ------
    ValueError
        When the frame is cut or damaged, or holds another number of values.
    """
    source = np.frombuffer(data, np.uint8)
    values = np.zeros(0, np.uint16)
    if table:
        if len(source) < 2:
            raise ValueError("a depth frame is cut short")
        size = int(source[0]) | int(source[1]) << 8
        if len(source) < 2 + 2 * size:
            raise ValueError("a depth frame is cut short")
        values = np.frombuffer(data, "<u2", size, 2).astype(np.uint16)
        source = source[2 + 2 * size :]
    if count > 30 * len(source):  # one byte codes 28 values at most
        raise ValueError(f"{count} values cannot come from {len(source)} bytes")
    out = np.empty(count, np.uint16)
    if _decode(source, values, table, out) != count:
        raise ValueError("a depth frame is damaged")
    return out


@njit(cache=True, nogil=True)
def _decode(data, values, table, out):
    if len(data) < 2 or len(out) < 1:
        return -1
    last = np.int64(data[0]) | np.int64(data[1]) << 8
    i, o = 2, 0
    if not _put(last, values, table, out, o):
        return -1
    o = 1
    while i < len(data):
        byte = np.int64(data[i])
        i += 1
        whole = byte == 0xFF
        if byte < 0xE0:
            last = (last - ((byte >> 4) - 6)) & 0xFFFF
            if not _put(last, values, table, out, o):
                return -1
            o += 1
            second = byte & 15
            whole = second == 15
            if not whole and second != 13:
                last = (last - (second - 6)) & 0xFFFF
                if not _put(last, values, table, out, o):
                    return -1
                o += 1
        elif not whole:
            for _ in range(2 * (byte - 0xE0)):
                if not _put(last, values, table, out, o):
                    return -1
                o += 1
        if whole:
            if i >= len(data):
                return -1
            byte = np.int64(data[i])
            i += 1
            if byte & 0x80:
                last = (last - (byte - 192)) & 0xFFFF
            else:
                if i >= len(data):
                    return -1
                last = byte << 8 | np.int64(data[i])
                i += 1
            if not _put(last, values, table, out, o):
                return -1
            o += 1
    return o


@njit(cache=True, nogil=True)
def _put(value, values, table, out, o):
    if o >= len(out) or (table and value >= len(values)):
        return False
    out[o] = values[value] if table else value
    return True
