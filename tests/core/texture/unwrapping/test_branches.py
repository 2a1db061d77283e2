"""Islands that branch are cut into compact ones; nothing is lost, and every part is a disk."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.texture.unwrapping.branches import FlatIsland, without_branches
from mirror_scan.core.texture.unwrapping.disks import is_disk
from mirror_scan.core.texture.unwrapping.packing import pack


def island(inside, first=0, cells=60, seed=0) -> FlatIsland:
    """The cells of a grid that ``inside`` (N, 2) -> (N,) bool wants, two triangles each, shaken a little."""
    corners = np.stack(np.meshgrid(np.arange(cells + 1), np.arange(cells + 1), indexing="ij"), -1).reshape(-1, 2)
    flat = corners / cells + np.random.default_rng(seed).uniform(-0.2, 0.2, corners.shape) / cells
    i, j = (a.ravel() for a in np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij"))
    keep = inside((np.column_stack((i, j)) + 0.5) / cells)
    a = (i * (cells + 1) + j)[keep]
    b, c, d = a + cells + 1, a + cells + 2, a + 1
    triangles = np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d)))).astype(np.int32)
    used, rows = np.unique(triangles, return_inverse=True)
    return FlatIsland(first + np.arange(len(triangles)), flat[used], rows.reshape(-1, 3).astype(np.int32))


def person(at):
    """A trunk, two legs and two arms, spread."""
    x, y = at[:, 0] - 0.5, at[:, 1]
    trunk = (np.abs(x) < 0.12) & (y > 0.4)
    legs = (y <= 0.45) & (np.abs(np.abs(x) - 0.05 - 0.7 * (0.45 - y)) < 0.06)
    return trunk | legs | ((np.abs(y - 0.8) < 0.05) & (np.abs(x) < 0.49))


def area(flat, triangles):
    a, b, c = (flat[triangles[:, k]] for k in range(3))
    return 0.5 * float(((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).sum())


def used(islands) -> float:
    """Share of the square by the islands once packed."""
    places = pack([one.flat for one in islands], [one.triangles for one in islands], 0.002)
    return sum(area(place, one.triangles) for place, one in zip(places, islands, strict=True))


def test_figures_are_cut_at_their_limbs_and_take_more_of_the_image():
    whole = [island(person, first=10_000 * k, seed=k) for k in range(4)]
    parts = without_branches(whole)
    assert 8 <= len(parts) <= 32
    pieces = [np.sort(np.concatenate([one.piece for one in islands])) for islands in (parts, whole)]
    np.testing.assert_array_equal(*pieces)
    assert all(is_disk(part.triangles, len(part.flat)) for part in parts)
    areas = [sum(area(one.flat, one.triangles) for one in islands) for islands in (parts, whole)]
    assert areas[0] == pytest.approx(areas[1])
    assert used(parts) > 1.2 * used(whole)


@pytest.mark.parametrize(
    "shape", [lambda at: np.ones(len(at), bool), lambda at: np.linalg.norm(at - 0.5, axis=1) < 0.45]
)
def test_compact_islands_stay_whole(shape):
    whole = [island(shape, first=10_000 * k, seed=k) for k in range(4)]
    parts = without_branches(whole)
    assert [part.piece[0] for part in parts] == [one.piece[0] for one in whole]


def test_there_are_never_too_many():
    figures = [island(person, first=10_000 * k, seed=k) for k in range(5)]
    small = [island(person, first=10_000 * k, seed=k, cells=20) for k in range(5, 36)]
    whole = figures + [one._replace(flat=0.02 * one.flat) for one in small]
    parts = without_branches(whole)
    assert 36 < len(parts) <= 38
    assert sum(len(part.piece) for part in parts) == sum(len(one.piece) for one in whole)
