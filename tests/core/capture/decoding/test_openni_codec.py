"""OpenNI's codecs of depth undo what an encoder made."""

from __future__ import annotations

import numpy as np
import writers
from mirror_scan.core.capture.decoding.openni_codec import decode_16z


def test_openni_codecs_on_hard_values():
    rng = np.random.default_rng(1)
    for values in (
        np.array([7]), np.zeros(5000, int), np.full(31, 9000), rng.integers(0, 10001, 3000), np.arange(4000) % 97,
        np.repeat(rng.integers(0, 3000, 200), rng.integers(1, 80, 200)), np.cumsum(rng.integers(-7, 8, 3000)) + 3000,
        np.cumsum(rng.integers(-64, 65, 3000)) + 6000, np.array([0, 32767, 0, 32767]),
    ):  # fmt: skip
        for table in (True, False):
            np.testing.assert_array_equal(decode_16z(writers.encode_16z(values, table), len(values), table), values)
