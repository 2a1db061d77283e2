"""16-bit gray PNG, what depth frames are: decoded straight into metres, in half the time of a general library.

W3C, Portable Network Graphics (Second Edition) 2003, sections 7, 9 and 10. Anything but plain 16-bit gray is left to
:func:`.images.read_image`, and so is saying what is wrong with a file.
"""

from __future__ import annotations

import struct
import zlib

import numpy as np

from ...numeric.kernels import njit

_HEADER = struct.Struct(">IIBBBBB")  # width, height, bits, colour type, compression, filter, interlace


def decode_metres(data: bytes, scale: float, out: np.ndarray) -> bool:
    """Decode a PNG into ``out``.

    Parameters
    ----------
    data : bytes
        The file; its chunks are whole (:func:`.images.checked_png`).
    scale : float
        Units a metre.
    out : np.ndarray [shape=(H, W), dtype=float32]
        Filled with values / scale.

    Returns
    -------
    bool
        False, with anything in ``out``, when the file is not 16-bit gray of that size or its content is damaged.
    """
    height, width = out.shape
    packed, position = [], 8
    while position < len(data):
        length, kind = struct.unpack_from(">I4s", data, position)
        if kind == b"IHDR" and (
            length != 13 or _HEADER.unpack_from(data, position + 8) != (width, height, 16, 0, 0, 0, 0)
        ):
            return False
        if kind == b"IDAT":
            packed.append(data[position + 8 : position + 8 + length])
        position += 12 + length
    size = height * (1 + 2 * width)
    inflate = zlib.decompressobj()
    try:
        raw = inflate.decompress(b"".join(packed), size)
    except zlib.error:
        return False
    # one more byte than the picture needs would be another picture
    if len(raw) != size or not (inflate.eof or inflate.decompress(inflate.unconsumed_tail, 1) == b""):
        return False
    rows = np.frombuffer(bytearray(raw), np.uint8).reshape(height, 1 + 2 * width)
    return _unfilter(rows, np.float32(scale), out)


@njit(cache=True, nogil=True, error_model="numpy")
def _unfilter(rows, scale, out):
    """Undo the filters in place, two bytes a pixel; False for a filter there is none of."""
    height, width = out.shape
    size = 2 * width
    above = np.zeros(size, np.uint8)
    for v in range(height):
        kind, row = rows[v, 0], rows[v, 1:]
        if kind == 1:
            for i in range(2, size):
                row[i] += row[i - 2]
        elif kind == 2:
            for i in range(size):
                row[i] += above[i]
        elif kind == 3:
            for i in range(size):
                left = np.int32(row[i - 2]) if i > 1 else np.int32(0)
                row[i] += np.uint8((left + above[i]) >> 1)
        elif kind == 4:
            for i in range(size):
                a = np.int32(row[i - 2]) if i > 1 else np.int32(0)
                b = np.int32(above[i])
                c = np.int32(above[i - 2]) if i > 1 else np.int32(0)
                from_a, from_b, from_c = abs(b - c), abs(a - c), abs(a + b - 2 * c)
                nearest = a if from_a <= from_b and from_a <= from_c else (b if from_b <= from_c else c)
                row[i] += np.uint8(nearest)
        elif kind != 0:
            return False
        above = row
        for u in range(width):
            out[v, u] = np.float32((np.int32(row[2 * u]) << 8) | np.int32(row[2 * u + 1])) / scale
    return True
