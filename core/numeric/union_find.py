"""Union-find for kernels."""

from __future__ import annotations

import numpy as np

from .kernels import njit


@njit(cache=True, nogil=True)
def root_of(parent: np.ndarray, i: int) -> int:
    """Root of ``i`` in a union-find forest, halving the path to it."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i
