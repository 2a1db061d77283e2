"""LZF, LZ4 and LZFSE against their authors' libraries."""

from __future__ import annotations

import numpy as np
import pytest
import writers
from mirror_scan.core.capture.decoding.lz4 import lz4_decompress
from mirror_scan.core.capture.decoding.lzf import lzf_decompress
from mirror_scan.core.capture.decoding.lzfse import lzfse_decompress


def test_compressions_against_their_authors_libraries():
    rng = np.random.default_rng(0)
    blocks = [
        bytes(300_000), rng.bytes(70_000), bytes(range(256)) * 900,
        np.cumsum(rng.integers(-2, 3, 90_000)).astype("<i2").tobytes(),
        np.sin(np.arange(50_000) / 50).astype("<f4").tobytes(),
    ]  # fmt: skip
    for data in blocks:
        assert lzf_decompress(writers.lzf_compress(data), len(data)).tobytes() == data
    lz4 = pytest.importorskip("lz4.frame")
    for data in blocks:
        for level, linked, checked in ((0, True, False), (9, False, True)):
            packed = lz4.compress(
                data, compression_level=level, block_linked=linked, content_checksum=checked, block_checksum=checked
            )
            assert lz4_decompress(packed, len(data)).tobytes() == data
    liblzfse = pytest.importorskip("liblzfse")
    for data in blocks:
        assert lzfse_decompress(liblzfse.compress(data), len(data)).tobytes() == data
