"""A texture of corner colours shows the colours that it was made of, by linear blending as viewers do it."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.io.color_atlas import atlas_of_corners


def shown(image, uv):
    """What a viewer shows of an image (H, W, 3) at places (N, 2): texels blended linearly, v upwards."""
    height, width = image.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    column = np.clip(np.floor(x).astype(int), 0, width - 2)
    row = np.clip(np.floor(y).astype(int), 0, height - 2)
    a, b = (x - column)[:, None], (y - row)[:, None]
    texel = image.astype(float)
    upper = texel[row, column] * (1 - a) + texel[row, column + 1] * a
    lower = texel[row + 1, column] * (1 - a) + texel[row + 1, column + 1] * a
    return upper * (1 - b) + lower * b


@pytest.mark.parametrize("count", [1, 2, 3, 500])
def test_triangles_show_the_colours_of_their_corners(count):
    rng = np.random.default_rng(count)
    vertices, triangles = rng.normal(size=(count + 2, 3)), rng.integers(0, count + 2, (count, 3))
    colors = rng.integers(0, 256, (count + 2, 3)).astype(np.uint8)
    sizes, middles = np.full(count, 3), vertices[triangles].mean(axis=1)
    uv, image = atlas_of_corners(middles, sizes, colors[triangles].reshape(-1, 3))
    np.testing.assert_allclose(shown(image, uv.astype(float)), colors[triangles].reshape(-1, 3), atol=1e-3)
    assert image.shape[0] * image.shape[1] <= max(8 * count, 8)
    # inside a triangle too, where the fourth texel need not be clipped
    mild = (100 + colors // 8).astype(np.uint8)
    uv, image = atlas_of_corners(middles, sizes, mild[triangles].reshape(-1, 3))
    shares = rng.dirichlet((1, 1, 1), count)
    inside = np.einsum("tk,tkc->tc", shares, uv.reshape(-1, 3, 2).astype(float))
    expected = np.einsum("tk,tkc->tc", shares, mild[triangles].astype(float))
    np.testing.assert_allclose(shown(image, inside), expected, atol=1e-3)


def test_faces_of_any_number_of_corners_have_a_place():
    sizes = np.array([4, 3, 6, 4])
    colors = np.random.default_rng(0).integers(0, 256, (17, 3)).astype(np.uint8)
    uv, image = atlas_of_corners(np.arange(12.0).reshape(4, 3), sizes, colors)
    found = shown(image, uv.astype(float))
    few = np.r_[0:7, 13:17]
    np.testing.assert_allclose(found[few], colors[few], atol=1e-3)
    np.testing.assert_allclose(found[7:13], np.tile(colors[7:13].mean(axis=0), (6, 1)), atol=0.5)


def test_a_smaller_copy_of_the_image_blends_neighbours_only():
    """On a smooth field of colours every aligned square of the image has nearly one colour."""
    rng = np.random.default_rng(1)
    middles = rng.uniform(size=(4096, 3))
    colors = np.repeat((255 * middles).astype(np.uint8), 3, axis=0)
    _, image = atlas_of_corners(middles, np.full(4096, 3), colors)
    assert image.shape == (128, 128, 3)
    squares = image.reshape(16, 8, 16, 8, 3).transpose(0, 2, 1, 3, 4).reshape(256, 64, 3).astype(float)
    assert np.median(squares.std(axis=1)) < 25 and colors.std() > 70


def test_what_does_not_fit_is_refused():
    for sizes, colors in ((np.zeros(0, int), np.zeros((0, 3))), ([3], np.zeros((4, 3))), ([2], np.zeros((2, 3)))):
        with pytest.raises(ValueError, match="do not fit"):
            atlas_of_corners(np.zeros((len(sizes), 3)), sizes, colors)
