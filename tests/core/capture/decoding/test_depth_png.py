"""Depth frames stored as PNG, against OpenImageIO."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from mirror_scan.core.capture.decoding.depth_png import decode_metres
from mirror_scan.core.io.images import read_image
from writers import HEIGHT, WIDTH


def test_depth_frames_are_decoded_as_openimageio_does(tmp_path):
    """Each of PNG's filters, on smooth and on random pixels; what is not such a picture is left to OpenImageIO."""
    rng = np.random.default_rng(0)
    smooth = (2000 + 3 * np.arange(WIDTH) + 7 * np.arange(HEIGHT)[:, None]).astype(np.uint16)

    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    def png(body, bits=16, interlace=0):
        header = struct.pack(">IIBBBBB", WIDTH, HEIGHT, bits, 0, 0, 0, interlace)
        half = len(body) // 2
        parts = (b"IHDR", header), (b"tEXt", b"a\0b"), (b"IDAT", body[:half]), (b"IDAT", body[half:]), (b"IEND", b"")
        return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)

    path = tmp_path / "a.png"
    out = np.empty((HEIGHT, WIDTH), np.float32)
    for image in (smooth, rng.integers(0, 65536, smooth.shape).astype(np.uint16)):
        bytes_of = image.astype(">u2").view(np.uint8).astype(int)
        left, above, corner = (np.zeros_like(bytes_of) for _ in range(3))
        left[:, 2:], above[1:], corner[1:, 2:] = bytes_of[:, :-2], bytes_of[:-1], bytes_of[:-1, :-2]
        guess = left + above - corner
        misses = [np.abs(guess - n) for n in (left, above, corner)]
        paeth = np.choose(np.argmin(misses, axis=0), (left, above, corner))  # argmin takes the first, as PNG does
        filtered = [bytes_of - p for p in (0 * left, left, above, (left + above) // 2, paeth)]
        rows = [bytes([v % 5]) + (filtered[v % 5][v] % 256).astype(np.uint8).tobytes() for v in range(HEIGHT)]
        data = png(zlib.compress(b"".join(rows)))
        path.write_bytes(data)
        np.testing.assert_array_equal(read_image(path), image)
        assert decode_metres(data, 1000.0, out)
        np.testing.assert_array_equal(out, image / np.float32(1000))
        assert not decode_metres(data, 1000.0, np.empty((HEIGHT, WIDTH + 1), np.float32))
    body = b"".join(rows)
    for bad in (png(zlib.compress(body), bits=8), png(zlib.compress(body), interlace=1), png(zlib.compress(body[:-1])),
                png(zlib.compress(body + b"x")), png(b"nothing"), png(zlib.compress(b"\x05" + body[1:]))):  # fmt: skip
        assert not decode_metres(bad, 1000.0, out)
