"""Two halves of a tube, one seen through a mirror that swallows light, zippered: how bright each is."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.mesh import SEAM, SURFACE, Mesh
from mirror_scan.core.zippering.exposure import match_exposures

ROWS = 80
MIRRORED = np.array([False, True])


def strips(left, right, joined=True):
    """Columns 0 and 1 of view 0, 2 and 3 of view 1, with a seam between: colours (ROWS, 4, 3)."""
    colors = np.concatenate([np.broadcast_to(np.asarray(c, float), (ROWS, 2, 3)) for c in (left, right)], axis=1)
    y, x = np.mgrid[:ROWS, :4]
    vertices = np.stack([0.01 * x, 0.01 * y, np.zeros_like(x)], axis=-1).reshape(-1, 3).astype(float)
    triangles, kind = [], []
    for column in range(3):
        if column == 1 and not joined:
            continue
        a = 4 * np.arange(ROWS - 1) + column
        triangles += [np.column_stack((a, a + 1, a + 5)), np.column_stack((a, a + 5, a + 4))]
        kind += 2 * (ROWS - 1) * [SEAM if column == 1 else SURFACE]
    view = np.repeat([[0, 0, 1, 1]], ROWS, axis=0).ravel().astype(np.int8)
    colors = np.clip(np.rint(colors), 0, 255).astype(np.uint8).reshape(-1, 3)
    return Mesh(vertices, np.concatenate(triangles).astype(np.int32), colors, view, np.array(kind, np.int8))


def test_a_mirrors_view_is_made_as_bright_as_the_direct_one():
    true = np.random.default_rng(1).uniform(60, 200, (ROWS, 1, 3))
    mesh = strips(true, true * (0.80, 0.88, 0.84))
    matched = match_exposures(mesh, MIRRORED)
    found = matched.colors.reshape(ROWS, 4, 3).astype(float)
    assert np.abs(found[:, :2] / true - 1).max() < 0.04
    assert np.abs(found[:, 2:] / found[:, :2] - 1).max() < 0.04
    np.testing.assert_array_equal(matched.vertices, mesh.vertices)


def factors(mesh, mirrored):
    """By what each of two views, as ``wide`` makes them, was multiplied far from their seam, row by row."""
    before, found = (
        m.colors.reshape(200, -1, 3)[..., 0].astype(float) for m in (mesh, match_exposures(mesh, mirrored))
    )
    return (found / before)[:, [0, -1]].T


def test_a_pattern_on_one_side_of_the_seam_hardly_counts():
    dark = np.full(200, 105.6)
    dark[::4] = 30.0  # a quarter is something else
    direct, mirrored = factors(wide(np.full(200, 120.0), dark), MIRRORED)
    np.testing.assert_allclose(direct, 1.0, atol=0.01)
    np.testing.assert_allclose(np.median(mirrored), 1 / 0.88, rtol=0.03)


def test_views_without_a_mirror_keep_their_brightness_on_the_mean():
    one, other = factors(wide(np.full(200, 100.0), np.full(200, 121.0)), np.array([False, False]))
    np.testing.assert_allclose(one * other, 1.0, atol=0.01)
    np.testing.assert_allclose(one / other, 1.21, rtol=0.02)


def test_what_differs_here_and_there_is_shared_and_fades_out():
    """Light falls on the second view from above: no one factor matches it."""
    mesh = wide(np.full(200, 120.0), 120.0 * np.exp(np.linspace(-0.2, 0.2, 200)))
    found = match_exposures(mesh, np.array([False, False])).colors.reshape(200, -1, 3).astype(float)
    before = mesh.colors.reshape(200, -1, 3).astype(float)
    middle = found.shape[1] // 2
    step = np.abs(np.log(found[:, middle] / found[:, middle - 1]))
    assert step[30:-30].max() < 0.06 and step.max() < 0.15
    assert np.abs(np.log(before[:, middle] / before[:, middle - 1])).max() > 0.19
    assert np.ptp(factors(mesh, np.array([False, False])), axis=1).max() < 0.015  # far off only the factor counts
    assert np.abs(np.diff(found[30:-30], axis=1)).max() < 8  # nowhere a new step


def wide(left, right, columns=200):
    """As ``strips``, half a metre wide: brightness (rows,) of either view."""
    rows, half = len(left), columns // 2
    y, x = np.mgrid[:rows, :columns]
    level = np.where(x < half, left[:, None], right[:, None])
    vertices = np.stack([0.0025 * x, 0.0025 * y, 0 * x], axis=-1).reshape(-1, 3).astype(float)
    a = (columns * y + x)[:-1, :-1].ravel()
    triangles = np.concatenate(
        (np.column_stack((a, a + 1, a + columns + 1)), np.column_stack((a, a + columns + 1, a + columns)))
    )
    kind = np.where(np.tile(x[:-1, :-1].ravel(), 2) == half - 1, SEAM, SURFACE).astype(np.int8)
    colors = np.repeat(np.rint(level).astype(np.uint8).ravel()[:, None], 3, axis=1)
    return Mesh(vertices, triangles.astype(np.int32), colors, (x >= half).ravel().astype(np.int8), kind)


@pytest.mark.parametrize("level", [3, 255])
def test_black_and_burnt_out_colours_say_nothing(level):
    mesh = strips(np.full((ROWS, 1, 3), 120.0), np.full((ROWS, 1, 3), float(level)))
    assert match_exposures(mesh, MIRRORED) is mesh


def test_what_nothing_joins_or_colours_stays():
    apart = strips(np.full((ROWS, 1, 3), 120.0), np.full((ROWS, 1, 3), 60.0), joined=False)
    assert match_exposures(apart, MIRRORED) is apart
    plain = Mesh(apart.vertices, apart.triangles, None, apart.view, apart.kind)
    assert match_exposures(plain, MIRRORED) is plain
