"""LZFSE, Apple's compression, which Record3D stores depth with: a decoder of its blocks bvx1, bvx2 and bvx-.

A compressed block holds literals, entropy-coded in four interleaved streams, and triples of literal length, match
length and distance. Both are finite-state entropy codes (J. Duda 2013, Y. Collet's FSE) read from their end backward.
Layout after Apple's published reference (github.com/lzfse/lzfse). LZVN blocks, made of data below 4 kB, are not read.
"""

from __future__ import annotations

import struct

import numpy as np

from ...numeric.kernels import njit

L_STATES, M_STATES, D_STATES, LITERAL_STATES = 64, 64, 256, 1024
L_SYMBOLS, M_SYMBOLS, D_SYMBOLS, LITERALS = 20, 20, 64, 256
MAX_LITERALS, MAX_MATCHES = 40_000, 10_000

_L_BITS = np.array([0] * 16 + [2, 3, 5, 8], np.int64)
_M_BITS = np.array([0] * 16 + [3, 5, 8, 11], np.int64)
_D_BITS = np.repeat(np.arange(16), 4)


def _bases(bits: np.ndarray) -> np.ndarray:
    """Each symbol's first value: symbols cover the whole numbers one after the other."""
    return np.concatenate(((0,), np.cumsum(1 << bits)[:-1])).astype(np.int64)


_L_BASE, _M_BASE, _D_BASE = _bases(_L_BITS), _bases(_M_BITS), _bases(_D_BITS)


def lzfse_decompress(data: bytes, size: int) -> np.ndarray:
    """``size`` bytes (uint8) of the LZFSE stream ``data``.

    Raises
    ------
    ValueError, struct.error
        When the stream is cut or damaged, or does not fill ``size`` exactly.
    """
    if size > 4_000 * len(data):
        raise ValueError(f"{size} bytes cannot come from {len(data)}")
    out = np.empty(size, np.uint8)
    source = np.frombuffer(data, np.uint8)
    position = filled = 0
    while True:
        magic = data[position : position + 4]
        if magic == b"bvx$":
            break
        (raw,) = struct.unpack_from("<I", data, position + 4)
        if filled + raw > size:
            raise ValueError("the LZFSE stream holds more than it should")
        if magic == b"bvx-":
            position += 8
            if position + raw > len(data):
                raise ValueError("the LZFSE stream is cut short")
            out[filled : filled + raw] = source[position : position + raw]
            position += raw
        elif magic in (b"bvx1", b"bvx2"):
            header, frequencies, start = _header(data, source, position, magic == b"bvx2")
            literals_end = start + header[2]
            position = literals_end + header[3]
            if position > len(data):
                raise ValueError("the LZFSE stream is cut short")
            literals = np.empty(header[0], np.uint8)
            tables = [
                _table(frequencies[a:b], states)
                for a, b, states in (
                    (0, 20, L_STATES),
                    (20, 40, M_STATES),
                    (40, 104, D_STATES),
                    (104, 360, LITERAL_STATES),
                )
            ]
            good = _literals(source, start, literals_end, header[4], np.array(header[5:9]), tables[3], literals)
            if good:
                good = _matches(
                    source, literals_end, position, header[9], np.array(header[10:13]), tables[0], tables[1], tables[2],
                    _L_BITS, _L_BASE, _M_BITS, _M_BASE, _D_BITS, _D_BASE, literals, header[1],
                    out, filled, filled + raw,
                )  # fmt: skip
            if not good:
                raise ValueError("the LZFSE stream is damaged")
        else:
            raise ValueError(f"an LZFSE block of kind {magic!r}")
        filled += raw
    if filled != size:
        raise ValueError(f"the LZFSE stream holds {filled} bytes, not {size}")
    return out


def _header(data: bytes, source: np.ndarray, position: int, packed: bool) -> tuple[tuple[int, ...], np.ndarray, int]:
    """Counts and states of a block, the frequencies of its 360 symbols, and where its payload begins.

    Literals, matches, bytes of literals, bytes of triples, bits off the literals' end, four literal states, bits off
    the triples' end, and the states of the three codes.
    """
    if packed:
        first, second, third = struct.unpack_from("<3Q", data, position + 8)
        size = third & 0xFFFFFFFF
        if size < 32 or position + size > len(data):
            raise ValueError("a block's header is cut short")
        states = [second >> shift & 1023 for shift in (0, 10, 20, 30)]
        fields = (
            first & 0xFFFFF, first >> 40 & 0xFFFFF, first >> 20 & 0xFFFFF, second >> 40 & 0xFFFFF,
            (first >> 60 & 7) - 7, *states, (second >> 60 & 7) - 7, third >> 32 & 1023, third >> 42 & 1023,
            third >> 52 & 1023,
        )  # fmt: skip
        frequencies = np.zeros(360, np.int64)
        if size > 32 and not _frequencies(source[position + 32 : position + size], frequencies):
            raise ValueError("a block's frequencies are damaged")
        start = position + size
    else:
        values = struct.unpack_from("<5I i4H i3H", data, position + 8)
        _, literals, matches, literal_bytes, triple_bytes = values[:5]
        fields = (literals, matches, literal_bytes, triple_bytes, *values[5:])
        frequencies = np.frombuffer(data, "<u2", 360, position + 50).astype(np.int64)
        start = position + 772  # the structure ends in two bytes of padding
    literals, matches = fields[:2]
    if literals > MAX_LITERALS or matches > MAX_MATCHES or literals % 4:
        raise ValueError("a block of impossible size")
    if not (-7 <= fields[4] <= 0 and -7 <= fields[9] <= 0) or max(fields[5:9]) >= LITERAL_STATES:
        raise ValueError("a block's states are damaged")
    if fields[10] >= L_STATES or fields[11] >= M_STATES or fields[12] >= D_STATES:
        raise ValueError("a block's states are damaged")
    return fields, frequencies, start


@njit(cache=True, nogil=True)
def _frequencies(data, out):
    """Frequencies in their prefix code; False when it does not end with the data."""
    bits, count, position = 0, 0, 0
    for i in range(len(out)):
        while position < len(data) and count <= 24:
            bits |= np.int64(data[position]) << count
            count += 8
            position += 1
        low = bits & 31
        if low & 1 == 0:  # 00: 0, 10: 1
            length, value = 2, low >> 1 & 1
        elif low & 2 == 0:  # 001: 2, 101: 3
            length, value = 3, 2 + (low >> 2 & 1)
        elif low & 4 == 0:  # ..011: 4 to 7
            length, value = 5, 4 + (low >> 3 & 3)
        elif low & 8 == 0:
            length, value = 8, 8 + (bits >> 4 & 15)
        else:
            length, value = 14, 24 + (bits >> 4 & 1023)
        if length > count:
            return False
        out[i] = value
        bits >>= length
        count -= length
    return count < 8 and position == len(data)


def _table(frequencies: np.ndarray, states: int) -> np.ndarray:
    """Of each state its symbol, the bits to read, and what they are added to (states, 3) int64.

    States that no symbol has are left with symbol -1.
    """
    if frequencies.sum() > states:
        raise ValueError("a block's frequencies are damaged")
    table = np.full((states, 3), -1, np.int64)
    at = 0
    for symbol in np.flatnonzero(frequencies):
        f = int(frequencies[symbol])
        k = states.bit_length() - f.bit_length()  # states <= f 2^k < 2 states
        many = (2 * states >> k) - f
        j = np.arange(f)
        table[at : at + f, 0] = symbol
        table[at : at + f, 1] = np.where(j < many, k, k - 1)
        table[at : at + f, 2] = np.where(j < many, (f + j << k) - states, j - many << max(k - 1, 0))
        at += f
    return table


@njit(cache=True, nogil=True)
def _pull(source, start, position, count):
    """The ``count`` bits before bit ``position``; -1 when they would begin before byte ``start``."""
    position -= count
    if position < 8 * start:
        return -1
    value, got = 0, 0
    byte, shift = position >> 3, position & 7
    while got < count:
        value |= (np.int64(source[byte]) >> shift) << got
        got += 8 - shift
        shift = 0
        byte += 1
    return value & ((1 << count) - 1)


@njit(cache=True, nogil=True)
def _literals(source, start, end, bits, states, table, out):
    position = 8 * end + bits
    for i in range(len(out)):
        state = states[i & 3]
        if table[state, 0] < 0:
            return False
        value = _pull(source, start, position, table[state, 1])
        if value < 0:
            return False
        position -= table[state, 1]
        out[i] = table[state, 0]
        state = table[state, 2] + value
        if state < 0 or state >= len(table):
            return False
        states[i & 3] = state
    return True


@njit(cache=True, nogil=True)
def _matches(
    source, start, end, bits, states, l_table, m_table, d_table, l_bits, l_base, m_bits, m_base, d_bits, d_base,
    literals, matches, out, first, last,
):  # fmt: skip
    position = 8 * end + bits
    values = np.zeros(3, np.int64)
    distance = 0
    taken, o = 0, first
    for _ in range(matches):
        for code in range(3):
            if code == 0:
                table, extra, base = l_table, l_bits, l_base
            elif code == 1:
                table, extra, base = m_table, m_bits, m_base
            else:
                table, extra, base = d_table, d_bits, d_base
            state = states[code]
            symbol = table[state, 0]
            if symbol < 0:
                return False
            total = table[state, 1] + extra[symbol]
            value = _pull(source, start, position, total)
            if value < 0:
                return False
            position -= total
            values[code] = base[symbol] + (value & ((1 << extra[symbol]) - 1))
            state = table[state, 2] + (value >> extra[symbol])
            if state < 0 or state >= len(table):
                return False
            states[code] = state
        length, match = values[0], values[1]
        if values[2]:
            distance = values[2]
        if taken + length > len(literals) or o + length + match > last:
            return False
        for k in range(length):
            out[o + k] = literals[taken + k]
        taken += length
        o += length
        if match and (distance <= 0 or distance > o):
            return False
        for k in range(match):
            out[o + k] = out[o + k - distance]
        o += match
    return o == last
