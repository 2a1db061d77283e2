"""Colours of face corners as a texture, for formats whose materials cannot show them: FBX, OBJ, USD.

Each face gets a block of 2×2 texels with its corners at the middles of the texels, so that a viewer which blends texels
linearly shows the corners' exact colours, and over a triangle what it would blend between them. Blocks of faces that
are near each other lie near each other, both along a Z-order curve (Morton 1966): then the smaller copies of the image
that viewers use from afar blend neighbours only.
"""

from __future__ import annotations

import numpy as np

_CORNERS = np.array(((0, 0), (1, 0), (1, 1), (0, 1)))
"""Column and row, in its block, of each corner of a face."""

_STEPS = 1 << 10
"""Of the grid along each axis, in whose cells faces are sorted."""


def atlas_of_corners(middles: np.ndarray, sizes: np.ndarray, colors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A small texture that shows given colours at the corners of a mesh's faces.

    Parameters
    ----------
    middles : np.ndarray [shape=(F, 3)]
        A place on each face, in any unit; all finite.
    sizes : np.ndarray [shape=(F,), dtype=int]
        How many corners each face has, at least 3. One of more than 4 gets the mean of its corners all over.
    colors : np.ndarray [shape=(C, 3), dtype=uint8]
        sRGB of all corners, face after face; C is the sum of ``sizes``.

    Returns
    -------
    uv : np.ndarray [shape=(C, 2), dtype=float32]
        Place of each corner in the image, 0..1, exactly the middle of a texel: u to the right, v upwards.
    image : np.ndarray [shape=(H, W, 3), dtype=uint8]
        sRGB, the upper row first; sides are powers of two and hold at most twice the blocks that are needed.

    Raises
    ------
    ValueError
        When there is no face, or the counts contradict each other.
    """
    sizes, colors = np.asarray(sizes, np.int64), np.asarray(colors)
    if not len(sizes) or sizes.min() < 3 or sizes.sum() != len(colors) or len(middles) != len(sizes):
        raise ValueError(f"{len(sizes)} faces, {len(middles)} places and {len(colors)} corners do not fit")
    first = np.cumsum(sizes) - sizes
    large = sizes > 4
    blocks = np.empty((len(sizes), 4, 3), np.int32)
    blocks[:, :3] = colors[first[:, None] + np.arange(3)]
    blocks[:, 3] = blocks[:, 0] + blocks[:, 2] - blocks[:, 1]  # as a triangle goes on
    four = sizes == 4
    blocks[four, 3] = colors[first[four] + 3]
    if large.any():
        means = np.add.reduceat(colors.astype(np.float64), first) / sizes[:, None]
        blocks[large] = np.rint(means[large])[:, None]
    place = np.empty(len(sizes), np.int64)
    place[np.argsort(_z_order(middles), kind="stable")] = np.arange(len(sizes))
    bits = max(int(len(sizes) - 1).bit_length(), 1)
    width, height = 2 << (bits + 1) // 2, 2 << bits // 2
    corner = np.stack((_every_second_bit(place), _every_second_bit(place >> 1)), axis=1) * 2  # upper left texel
    image = np.empty((height, width, 3), np.uint8)
    image[:] = np.rint(colors.mean(axis=0))
    column, row = (corner[:, None] + _CORNERS).transpose(2, 0, 1)
    image[row, column] = np.clip(blocks, 0, 255)
    number = np.arange(len(colors)) - np.repeat(first, sizes)
    texel = np.repeat(corner, sizes, axis=0) + _CORNERS[np.where(np.repeat(large, sizes), 0, number % 4)]
    uv = (texel + 0.5) / (width, height)
    uv[:, 1] = 1.0 - uv[:, 1]
    return uv.astype(np.float32), image


def _z_order(points: np.ndarray) -> np.ndarray:
    """Places of points (N, 3) along a Z-order curve through their bounding cube, int64."""
    points = np.asarray(points, np.float64)
    low = points.min(axis=0)
    extent = max(float(np.ptp(points, axis=0).max()), np.finfo(np.float64).tiny)
    cells = np.minimum((points - low) / extent * _STEPS, _STEPS - 1).astype(np.int64)
    key = np.zeros(len(points), np.int64)
    for bit in range(_STEPS.bit_length() - 1):
        for axis in range(3):
            key |= (cells[:, axis] >> bit & 1) << (3 * bit + axis)
    return key


def _every_second_bit(values: np.ndarray) -> np.ndarray:
    """The bits 0, 2, 4, … of int64, side by side."""
    found = np.zeros_like(values)
    for bit in range(31):
        found |= (values >> 2 * bit & 1) << bit
    return found
