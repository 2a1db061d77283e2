"""A closed mesh of a person's size, as arrays."""

from __future__ import annotations

import numpy as np


def capsule(around: int, along: int) -> tuple[np.ndarray, ...]:
    """Vertices (V, 3), triangles, colours, views and kinds; 1.70 m tall on z = 0, with all colour values."""
    radius, height = 0.2, 1.7
    angle = np.linspace(0, np.pi, along + 2)[1:-1]
    profile_z = -np.cos(angle) * radius + np.where(angle > np.pi / 2, height - radius, radius)
    turn = np.arange(around) * (2 * np.pi / around)
    rings = np.stack(
        (
            np.sin(angle)[:, None] * radius * np.cos(turn),
            np.sin(angle)[:, None] * radius * np.sin(turn),
            np.broadcast_to(profile_z[:, None], (along, around)),
        ),
        axis=-1,
    ).reshape(-1, 3)
    vertices = np.concatenate((rings, [[0, 0, 0], [0, 0, height]]))
    here = np.arange(around)
    there = (here + 1) % around
    triangles = [np.stack((there, here, np.full(around, len(rings))), axis=1)]
    for ring in range(along - 1):
        low, high = ring * around, (ring + 1) * around
        triangles.append(np.stack((low + here, low + there, high + there), axis=1))
        triangles.append(np.stack((low + here, high + there, high + here), axis=1))
    top = (along - 1) * around
    triangles.append(np.stack((top + here, top + there, np.full(around, len(rings) + 1)), axis=1))
    triangles = np.concatenate(triangles).astype(np.int32)
    index = np.arange(len(vertices))
    colors = np.stack((index % 256, (index * 7) % 256, 255 - index % 256), axis=1).astype(np.uint8)
    return (
        vertices,
        triangles,
        colors,
        (index % 4 - 1).astype(np.int8),
        (np.arange(len(triangles)) % 3).astype(np.int8),
    )
