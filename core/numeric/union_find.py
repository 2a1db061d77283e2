"""Which things hang together: union-find for kernels, labels of a graph for arrays."""

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


def connected_labels(first: np.ndarray, second: np.ndarray, count: int) -> np.ndarray:
    """The smallest node (N,) of each node's piece, where edges join ``first`` (E,) to ``second`` (E,).

    By spreading the smallest number and jumping pointers: a few rounds of whole arrays, no kernel to compile.
    """
    label = np.arange(count)
    while True:
        low = np.minimum(label[first], label[second])
        new = label.copy()
        np.minimum.at(new, label[first], low)
        np.minimum.at(new, label[second], low)
        new = new[new]
        if np.array_equal(new, label):
            return label
        label = new
