"""Pictures: written and read back, damage is named."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
from mirror_scan.core.errors import CaptureError
from mirror_scan.core.io.images import read_image, write_png


@pytest.mark.parametrize("dtype, shape", [(np.uint16, (5, 7)), (np.uint8, (5, 7)), (np.uint8, (5, 7, 3))])
def test_png_round_trip(tmp_path, dtype, shape):
    image = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)
    write_png(tmp_path / "a.png", image)
    back = read_image(tmp_path / "a.png")
    assert back.dtype == dtype
    np.testing.assert_array_equal(back, image)


def test_png_damage_is_named_and_nothing_is_printed(tmp_path, capfd):
    path = tmp_path / "a.png"
    write_png(path, np.random.default_rng(0).integers(0, 65536, (48, 64), dtype=np.uint16))
    good = path.read_bytes()
    huge = bytearray(good)
    huge[16:24] = struct.pack(">II", 2**31 - 1, 2**31 - 1)
    huge[29:33] = struct.pack(">I", zlib.crc32(huge[12:29]))
    for content, words in (
        (good[: len(good) // 2], "truncated"),
        (good[:8], "truncated"),
        (good[:2000] + bytes([good[2000] ^ 1]) + good[2001:], "damaged"),
        (b"", "not a PNG"),
        (bytes(huge), "."),
    ):
        path.write_bytes(content)
        with pytest.raises(CaptureError, match=words):
            read_image(path)
    assert capfd.readouterr() == ("", "")
