"""Least squares solved outright: as numpy's dense solver does, in any order of the unknowns."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.numeric.sparse_least_squares import elimination_order, solve_squares


def rows_of(matrix):
    """CSR arrays of the entries that are not zero."""
    at, heads = np.nonzero(matrix)
    return np.searchsorted(at, np.arange(len(matrix) + 1)), heads, matrix[at, heads]


def plate(height, width, rng):
    """Laplacian of a grid whose unknowns are numbered at random, and the springs that hold them."""
    count = height * width
    number = rng.permutation(count).reshape(height, width)
    laplacian = -np.eye(count)
    for a, b in ((number[1:], number[:-1]), (number[:, 1:], number[:, :-1])):
        for i, j in zip(a.ravel(), b.ravel(), strict=True):
            laplacian[i, j] += 0.25
            laplacian[j, i] += 0.25
    return laplacian, rng.uniform(1e-3, 0.1, count)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (1, 30), (9, 12), (20, 20)])
@pytest.mark.parametrize("ordered", [True, False])
def test_against_a_dense_solver(height, width, ordered):
    rng = np.random.default_rng(height)
    laplacian, springs = plate(height, width, rng)
    rhs = rng.normal(size=(height * width, 5))
    rows = rows_of(laplacian)
    order = elimination_order(*rows[:2]) if ordered else None
    expected = np.linalg.solve(laplacian.T @ laplacian + np.diag(springs), rhs)
    found = solve_squares(*rows, springs, rhs, order)
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())


def test_columns_that_do_not_count_are_left_out():
    rng = np.random.default_rng(5)
    laplacian, springs = plate(6, 7, rng)
    held = rng.random(42) < 0.3
    number = np.where(held, -1, np.cumsum(~held) - 1)
    start, columns, values = rows_of(laplacian)
    left = laplacian[:, ~held]
    rhs = rng.normal(size=(left.shape[1], 3))
    expected = np.linalg.solve(left.T @ left + np.diag(springs[~held]), rhs)
    found = solve_squares(start, number[columns], values, springs[~held], rhs)
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-10)


def test_unknowns_that_have_nothing_to_do_with_each_other():
    rng = np.random.default_rng(0)
    matrix = np.zeros((60, 60))
    shuffled = rng.permutation(60)
    for k in range(6):
        block = shuffled[10 * k : 10 * k + 10]
        matrix[np.ix_(block, block)] = rng.normal(size=(10, 10))
    matrix[shuffled[0]] = matrix[:, shuffled[0]] = 0.0
    rows, rhs, springs = rows_of(matrix), rng.normal(size=(60, 2)), np.full(60, 0.5)
    meet = rows_of(matrix + matrix.T)[:2]
    found = solve_squares(*rows, springs, rhs, elimination_order(*meet))
    np.testing.assert_allclose(found, np.linalg.solve(matrix.T @ matrix + np.diag(springs), rhs), rtol=1e-8, atol=1e-10)
    nothing = np.empty(0, np.int64)
    assert solve_squares(np.zeros(1, np.int64), nothing, np.empty(0), np.empty(0), np.empty((0, 3))).shape == (0, 3)


def test_what_fades_away_far_off_becomes_zero():
    """A long chain pulled at one end: numbers too small to be stored in full would take a hundred times as long."""
    count = 4000
    matrix = np.eye(count) - 0.2 * np.eye(count, k=1)
    rhs = np.zeros((count, 1))
    rhs[0] = 1.0
    found = solve_squares(*rows_of(matrix), np.ones(count), rhs)
    size = np.abs(found[found != 0])
    assert size.min() > np.finfo(float).tiny and size.max() > 0.1
    residual = matrix.T @ (matrix @ found) + found - rhs
    assert np.abs(residual).max() < 1e-12


def test_strips_are_ordered_from_end_to_end():
    """However its unknowns are numbered, a strip keeps a narrow envelope."""
    matrix = plate(4, 60, np.random.default_rng(1))[0]
    order = elimination_order(*rows_of(matrix)[:2])
    assert sorted(order.tolist()) == list(range(240))
    at, heads = np.nonzero((matrix.T @ matrix)[np.ix_(order, order)])
    assert (at - heads).max() <= 4 * 4
