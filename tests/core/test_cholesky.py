"""Systems solved outright: as numpy's dense solver does, in any order of the unknowns."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.cholesky import _order, solve


def rows_of(matrix):
    """CSR arrays of the entries that are not zero."""
    at, heads = np.nonzero(matrix)
    return np.searchsorted(at, np.arange(len(matrix) + 1)), heads, matrix[at, heads]


def stencil(height, width, rng):
    """A positive definite matrix over a grid whose unknowns are numbered at random: squared Laplacian, and springs."""
    count = height * width
    number = rng.permutation(count).reshape(height, width)
    plate = -np.eye(count)
    for a, b in ((number[1:], number[:-1]), (number[:, 1:], number[:, :-1])):
        for i, j in zip(a.ravel(), b.ravel(), strict=True):
            plate[i, j] += 0.25
            plate[j, i] += 0.25
    return plate.T @ plate + np.diag(rng.uniform(1e-3, 0.1, count))


@pytest.mark.parametrize(("height", "width"), [(1, 1), (1, 30), (9, 12), (20, 20)])
def test_against_a_dense_solver(height, width):
    rng = np.random.default_rng(height)
    matrix, rhs = stencil(height, width, rng), rng.normal(size=(height * width, 3))
    expected = np.linalg.solve(matrix, rhs)
    np.testing.assert_allclose(solve(*rows_of(matrix), rhs), expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())


def test_unknowns_that_have_nothing_to_do_with_each_other():
    rng = np.random.default_rng(0)
    matrix = np.zeros((60, 60))
    shuffled = rng.permutation(60)
    for k in range(6):
        block = shuffled[10 * k : 10 * k + 10]
        root = rng.normal(size=(10, 10))
        matrix[np.ix_(block, block)] = root @ root.T + np.eye(10)
    matrix[shuffled[0]], matrix[:, shuffled[0]] = 0.0, 0.0
    matrix[shuffled[0], shuffled[0]] = 2.0
    rhs = rng.normal(size=(60, 2))
    np.testing.assert_allclose(solve(*rows_of(matrix), rhs), np.linalg.solve(matrix, rhs), rtol=1e-8, atol=1e-10)
    assert solve(np.zeros(1, np.int64), np.empty(0, np.int64), np.empty(0), np.empty((0, 3))).shape == (0, 3)


def test_strips_keep_a_narrow_envelope():
    """However its unknowns are numbered, a strip is ordered from one end to the other."""
    matrix = stencil(4, 60, np.random.default_rng(1))
    order = _order(*rows_of(matrix)[:2])
    assert sorted(order.tolist()) == list(range(240))
    at, heads = np.nonzero(matrix[np.ix_(order, order)])
    assert (at - heads).max() <= 4 * 4
