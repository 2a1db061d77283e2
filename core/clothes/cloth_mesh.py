"""Meshes fit for cloth: even edges, borders without jags, no vertex in the body."""

from __future__ import annotations

import numpy as np

from ..avatar.skin_weights import unique_edges
from ..mesh import Mesh
from ..mesh.bvh import build_bvh, closest_point
from ..mesh.half_edges import open_edges
from ..mesh.normals import vertex_normals
from ..mesh.self_intersections import self_intersections
from ..numeric.rotations import unit
from .body_distance import BodyDistance

_TAUBIN = (1.0, -1.04)  # of the way to the neighbours' mean, twice what a step takes, in turn
_LEAST_WAY = 1e-7  # a point nearer than that to skin is moved along the skin's normal [m]


class NeighbourMeans:
    """Means of neighbours' values over the edges of a mesh of V vertices; on the border, of border neighbours only."""

    def __init__(self, mesh: Mesh) -> None:
        self.count = len(mesh.vertices)
        borders = open_edges(mesh.triangles, self.count)[:, :2].astype(np.int64)
        self.border = np.zeros(self.count, np.bool_)
        self.border[borders] = True
        edges = unique_edges(mesh)
        both = np.concatenate((edges, edges[:, ::-1]))
        both = both[~self.border[both[:, 0]]]
        self._pairs = np.concatenate((both, borders, borders[:, ::-1]))
        self._degree = np.maximum(np.bincount(self._pairs[:, 0], minlength=self.count), 1)

    def of(self, values: np.ndarray) -> np.ndarray:
        """Mean (V, K) of the neighbours' ``values`` (V, K)."""
        at, other = self._pairs[:, 0], self._pairs[:, 1]
        sums = [np.bincount(at, column[other], self.count) for column in values.T]
        return np.stack(sums, axis=1) / self._degree[:, None]


def relaxed(mesh: Mesh, shell: Mesh, rounds: int) -> Mesh:
    """The mesh with more even edges: vertices slide along the surface ``shell``, on the border along the border.

    The border loses its jags, not its length (Taubin, "A signal processing approach to fair surface design", 1995).

    Parameters
    ----------
    mesh : Mesh
        Of shared vertices, lying on ``shell`` [m].
    shell : Mesh
        The surface that it is a part of.
    rounds : int
    """
    means, tree = NeighbourMeans(mesh), build_bvh(shell.vertices, shell.triangles)
    vertices, border = mesh.vertices.copy(), means.border
    for number in range(rounds):
        way = means.of(vertices) - vertices
        normal = vertex_normals(vertices, mesh.triangles)
        along = unit(_border_directions(mesh, vertices))
        straight = np.einsum("vi,vi->v", way, along)[:, None] * along
        way = np.where(
            border[:, None],
            straight + _TAUBIN[number % 2] * (way - straight),
            way - np.einsum("vi,vi->v", way, normal)[:, None] * normal,
        )
        vertices += 0.5 * way
        vertices[~border] = closest_point(tree, vertices[~border])[2]
    return Mesh(vertices, mesh.triangles)


def _border_directions(mesh: Mesh, vertices: np.ndarray) -> np.ndarray:
    """Directions (V, 3) of the border at its vertices, 0 elsewhere."""
    edges = open_edges(mesh.triangles, len(vertices))[:, :2]
    ways = vertices[edges[:, 1]] - vertices[edges[:, 0]]
    out = np.zeros(vertices.shape)
    for end in (0, 1):
        np.add.at(out, edges[:, end], ways)
    return out


def pushed_out(mesh: Mesh, body: BodyDistance, gap: float, rounds: int = 6) -> Mesh:
    """The mesh with no vertex nearer than ``gap`` to the body, nor in it; what is around follows a little.

    Between two pieces of skin that are nearer to each other than twice the gap, vertices keep to neither.

    Parameters
    ----------
    mesh : Mesh
        Garment [m].
    body : BodyDistance
    gap : float
        [m]
    rounds : int
        At most.
    """
    means, vertices = NeighbourMeans(mesh), mesh.vertices.copy()
    for number in range(rounds):
        skin = body.at(vertices, reach=np.inf)
        near = skin.distance < gap
        if not near.any():
            break
        way = (vertices - skin.point) * np.sign(skin.distance)[:, None]
        outwards = np.where(np.abs(skin.distance)[:, None] > _LEAST_WAY, unit(way), skin.normal)
        moves = np.where(near[:, None], skin.point + 1.02 * gap * outwards - vertices, 0.0)
        if number < rounds - 2:  # the last rounds only see to the gap
            spread = moves
            for _ in range(3):
                spread = 0.5 * spread + 0.5 * means.of(spread)
            moves = np.where(near[:, None], moves, spread)
        vertices += moves
    return Mesh(vertices, mesh.triangles)


def smoothed_where_crossing(mesh: Mesh, body: BodyDistance, gap: float, rounds: int = 4) -> Mesh:
    """The mesh with less of it crossing itself: smoothed where it does, and off the body again by ``gap`` [m].

    What crosses because the body's own skin touches there may stay so.
    """
    means, best = NeighbourMeans(mesh), mesh
    least = None
    for _ in range(rounds + 1):
        crossing = np.unique(self_intersections(mesh.vertices, mesh.triangles))
        if least is None or len(crossing) < least:
            least, best = len(crossing), mesh
        if not len(crossing):
            break
        share = np.zeros((len(mesh.vertices), 1))
        share[mesh.triangles[crossing]] = 1.0
        for _ in range(2):  # rings around it
            share = np.maximum(share, means.of(share) > 0)
        share[means.border] = 0.0
        vertices = mesh.vertices
        for _ in range(6):
            vertices = vertices + 0.5 * share * (means.of(vertices) - vertices)
        mesh = pushed_out(Mesh(vertices, mesh.triangles), body, gap)
    return best
