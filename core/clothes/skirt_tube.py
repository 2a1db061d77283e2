"""A skirt's surface: a tube from the waist to the knees around trunk and both legs, which never narrows below hips."""

from __future__ import annotations

import numpy as np

from ..avatar.skin_weights import unique_edges
from ..mesh import Mesh

_DIRECTIONS = 128


def skirt_tube(mesh: Mesh, levels: np.ndarray, ease: np.ndarray, spacing: float) -> tuple[Mesh, np.ndarray]:
    """A tube of convex sections around a mesh, open at both ends, with the place (V, 2) of each vertex on it.

    The section at a level is the convex hull of the mesh's sections from the top down to it, each ``ease`` wider: what
    hangs does not follow the body back in. Places are shares of the way around, from the middle of the back, and down.

    Parameters
    ----------
    mesh : Mesh
        Trunk and legs, upright [m].
    levels : np.ndarray [shape=(L,)]
        Heights, from the top down [m].
    ease : np.ndarray [shape=(L,)]
        Distance from the mesh at each level; must not fall [m].
    spacing : float
        Of vertices around the hem [m].
    """
    directions = np.linspace(0.0, 2 * np.pi, _DIRECTIONS, endpoint=False)
    normals = np.stack((np.cos(directions), np.sin(directions)), axis=1)
    edges = unique_edges(mesh)
    ends = mesh.vertices[edges]
    heights = ends[:, :, 2]
    support = np.full((len(levels), _DIRECTIONS), -np.inf)
    for row, level in enumerate(levels):
        crossing = (heights[:, 0] < level) != (heights[:, 1] < level)
        if crossing.any():
            a, b = ends[crossing, 0], ends[crossing, 1]
            share = ((level - a[:, 2]) / (b[:, 2] - a[:, 2]))[:, None]
            points = (a + share * (b - a))[:, :2]
            support[row] = (points @ normals.T).max(axis=0)
    support = np.maximum.accumulate(support, axis=0) + ease[:, None]
    middle = _middle(support[0], normals)
    support -= normals @ middle

    # The radius of a convex section in a direction: the nearest of its tangents there.
    cosine = np.cos(directions[:, None] - directions[None])
    sections = []
    around = np.linspace(0.0, 2 * np.pi, 4 * _DIRECTIONS, endpoint=False) + np.pi / 2  # from the back
    for row in support:
        inverse = np.where(cosine > 1e-3, cosine / row[None], 0.0).max(axis=1)
        radius = np.interp(around % (2 * np.pi), directions, 1.0 / inverse, period=2 * np.pi)
        sections.append(radius[:, None] * np.stack((np.cos(around), np.sin(around)), axis=1) + middle)
    rings = _smooth(np.array(sections))
    count = max(16, round(float(_lengths(rings[-1]).sum()) / spacing))
    return _grid(np.array([_spaced(ring, count) for ring in rings]), levels)


def _middle(support: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """The middle (2,) of a convex section of that support."""
    half = len(support) // 2
    way = (support[:half] - support[half:]) / 2
    return np.linalg.lstsq(normals[:half], way, rcond=None)[0]


def _smooth(rings: np.ndarray) -> np.ndarray:
    """Sections (L, N, 2) a little smoother around and from level to level; the top one stays."""
    for _ in range(8):
        rings = 0.5 * rings + 0.25 * (np.roll(rings, 1, axis=1) + np.roll(rings, -1, axis=1))
    for _ in range(4):
        inner = 0.5 * rings[1:-1] + 0.25 * (rings[:-2] + rings[2:])
        rings = np.concatenate((rings[:1], inner, rings[-1:]))
    return rings


def _lengths(ring: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)


def _spaced(ring: np.ndarray, count: int) -> np.ndarray:
    """``count`` points evenly spread along a closed curve, the first stays."""
    way = np.concatenate(([0.0], np.cumsum(_lengths(ring))))
    closed = np.concatenate((ring, ring[:1]))
    places = np.linspace(0.0, way[-1], count, endpoint=False)
    return np.stack([np.interp(places, way, closed[:, k]) for k in (0, 1)], axis=1)


def _grid(rings: np.ndarray, levels: np.ndarray) -> tuple[Mesh, np.ndarray]:
    """Triangles between rings (L, N, 2) at ``levels``, diagonals in turn, so that cloth has no grain."""
    rows, count = rings.shape[:2]
    vertices = np.concatenate((rings, np.broadcast_to(levels[:, None, None], (rows, count, 1))), axis=2)
    row, column = np.meshgrid(np.arange(rows - 1), np.arange(count), indexing="ij")
    following = (column + 1) % count
    a, b = row * count + column, row * count + following
    c, d = a + count, b + count  # below a and b
    even = ((row + column) % 2 == 0)[..., None]
    first = np.where(even, np.stack((a, c, d), axis=-1), np.stack((a, c, b), axis=-1))
    second = np.where(even, np.stack((a, d, b), axis=-1), np.stack((b, c, d), axis=-1))
    triangles = np.concatenate((first.reshape(-1, 3), second.reshape(-1, 3))).astype(np.int32)
    down = np.broadcast_to(np.linspace(0.0, 1.0, rows)[:, None], (rows, count))
    across = np.broadcast_to(np.arange(count) / count, (rows, count))
    return Mesh(vertices.reshape(-1, 3), triangles), np.stack((across, down), axis=-1).reshape(-1, 2)
