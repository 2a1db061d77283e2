"""LZF, M. Lehmann's fast compression, as PCL uses it in .pcd and .pclzf."""

from __future__ import annotations

import numpy as np

from ...numeric.kernels import njit


def lzf_decompress(data: bytes | memoryview, size: int) -> np.ndarray:
    """``size`` bytes (uint8) of the LZF stream ``data``.

    A control byte below 32 starts a run of that many bytes plus one; any other a copy of what came before: length in
    its top three bits (7: one more byte follows) plus two, distance in its low five and the next byte, plus one.

    Raises
    ------
    ValueError
        When the stream is cut, points before its start, or does not fill ``size`` exactly.
    """
    if size < 0 or size > 264 * max(len(data), 1):  # the best a copy of three bytes can do
        raise ValueError(f"{size} bytes cannot come from {len(data)}")
    out = np.empty(size, np.uint8)
    if _decompress(np.frombuffer(data, np.uint8), out) != size:
        raise ValueError("the LZF stream is damaged")
    return out


@njit(cache=True, nogil=True)
def _decompress(data, out):
    i, o = 0, 0
    while i < len(data):
        control = data[i]
        i += 1
        if control < 32:
            length = np.int64(control) + 1
            if i + length > len(data) or o + length > len(out):
                return -1
            for k in range(length):
                out[o + k] = data[i + k]
            i += length
        else:
            length = np.int64(control >> 5)
            if length == 7:
                if i >= len(data):
                    return -1
                length += np.int64(data[i])
                i += 1
            if i >= len(data):
                return -1
            source = o - (np.int64(control & 31) << 8) - np.int64(data[i]) - 1
            i += 1
            length += 2
            if source < 0 or o + length > len(out):
                return -1
            for k in range(length):  # byte by byte: a copy may run into what it writes
                out[o + k] = out[source + k]
        o += length
    return o
