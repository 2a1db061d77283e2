"""A small textured mesh: each triangle a patch of the image of its own colour."""

from __future__ import annotations

import numpy as np
import trimesh
from mirror_scan.core.mesh import Mesh, Texture

SIZE = 256


def textured_ball() -> tuple[Mesh, Texture, np.ndarray]:
    """A ball of 80 triangles, its texture, and the colour (80, 3) that each triangle has in the image.

    Triangles lie in cells of their own but the first two pairs of neighbours, which share theirs.
    """
    ball = trimesh.creation.icosphere(subdivisions=1)
    rng = np.random.default_rng(8)
    count = len(ball.faces)
    mesh = Mesh(
        np.asarray(ball.vertices, np.float64) + (0, 0, 1), np.asarray(ball.faces, np.int32),
        rng.integers(0, 256, (len(ball.vertices), 3)).astype(np.uint8), kind=rng.integers(0, 3, count).astype(np.int8),
    )  # fmt: skip
    colors = rng.integers(30, 226, (count, 3)).astype(np.uint8)
    image = np.zeros((SIZE, SIZE, 3), np.uint8)
    uv = np.empty((count, 3, 2), np.float32)
    cell = SIZE // 10
    for t in range(count):
        row, column = divmod(t, 10)
        image[row * cell : (row + 1) * cell, column * cell : (column + 1) * cell] = colors[t]
        corner = np.array(((3, cell - 3), (cell - 3, cell - 3), (3, 3))) + (column * cell, row * cell)
        uv[t] = corner / SIZE * (1, -1) + (0, 1)
    return mesh, Texture(uv, image, np.arange(count, dtype=np.int32)), colors


def colors_at(uv: np.ndarray, image: np.ndarray) -> np.ndarray:
    """The image's colours at places (N, 2), v upwards."""
    height, width = image.shape[:2]
    column = np.clip((uv[:, 0] * width).astype(int), 0, width - 1)
    row = np.clip(((1 - uv[:, 1]) * height).astype(int), 0, height - 1)
    return np.asarray(image)[row, column, :3]
