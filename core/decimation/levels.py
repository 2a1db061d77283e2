"""A mesh of fewer triangles, alone or as levels of detail, with all that it carries."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from ..errors import MirrorScanError, Notice
from ..mesh import Mesh, Texture
from .clusters import Footpoints, blended_weights, clusters, footpoints, mean_colors, nearest_values, settled_places

if TYPE_CHECKING:
    from ..avatar.pose import SkinWeights
    from .edge_collapse import Collapse

FEWEST = 100
"""Triangles below which nothing is left of a body."""

_ROUNDS = 3  # how often at most edges are collapsed anew because surface ran through surface
_DEARER = 50.0  # by how much an edge costs more, a round, where that happened


@dataclass(frozen=True)
class Reduced:
    """A mesh of fewer triangles.

    Parameters
    ----------
    mesh : Mesh
        With colours, ``view`` and ``kind`` where the full mesh has them.
    texture : Texture or None
        The same image; places and islands of the triangles that are left.
    weights : SkinWeights or None
    notes : tuple of Notice
        What is to be known of it: that fewer triangles could not be reached.
    origin : np.ndarray [shape=(T,), dtype=int64] or None
        The triangle of the full mesh that each was; None where the mesh is unchanged.
    footpoints : Footpoints or None
        Where each vertex lies on the full mesh: whatever else its vertices carry can be interpolated there.
    """

    mesh: Mesh
    texture: Texture | None = None
    weights: SkinWeights | None = None
    notes: tuple[Notice, ...] = ()
    origin: np.ndarray | None = None
    footpoints: Footpoints | None = None


def decimate(mesh: Mesh, triangles: int, texture: Texture | None = None, weights: SkinWeights | None = None) -> Reduced:
    """The mesh with ``triangles`` triangles or one fewer, the surface and what lies on it as near to it as can be.

    Edges collapse by quadrics (Garland and Heckbert 1997). A closed manifold stays one, in as many pieces and with as
    many holes through it. Seams of the texture are thinned along themselves, alike on both sides, and no triangle turns
    over in the texture, so the image stays where it is. Skin weights are interpolated on the full mesh, colours are the
    mean of what a vertex stands for. Where surface comes to run through surface, more triangles are spent on the place.

    O(T log T); about 1 s and 400 bytes a triangle for 65 000.

    Parameters
    ----------
    mesh : Mesh
        In metres. Boundaries keep their course; edges of more than two triangles stay as they are.
    triangles : int
        How many to leave, at least ``FEWEST``. With as many or fewer the mesh comes back unchanged.
    texture : Texture, optional
        Of the mesh.
    weights : SkinWeights, optional
        Of the mesh.

    Returns
    -------
    Reduced
        With a note when more triangles are left, since no edge could be collapsed without breaking the mesh.

    Raises
    ------
    MirrorScanError
        When too few triangles are asked for, texture or weights do not fit the mesh, or the mesh is damaged.
    """
    return levels_of_detail(mesh, (triangles,), texture, weights)[0]


def levels_of_detail(
    mesh: Mesh,
    counts: Sequence[int],
    texture: Texture | None = None,
    weights: SkinWeights | None = None,
) -> list[Reduced]:
    """Several meshes of fewer triangles, each :func:`decimate`'s, from one pass over the mesh.

    Parameters
    ----------
    mesh, texture, weights
        As of :func:`decimate`.
    counts : sequence of int
        Triangles of each, in any order.

    Returns
    -------
    list of Reduced
        In the order of ``counts``.

    Raises
    ------
    MirrorScanError
        As :func:`decimate`.
    """
    _check(mesh, counts, texture, weights)
    wanted = sorted({count for count in counts if count < len(mesh.triangles)}, reverse=True)
    found = {count: Reduced(mesh, texture, weights) for count in counts if count >= len(mesh.triangles)}
    if wanted:
        wedge, places = (None, None) if texture is None else _wedges(mesh, texture)
        factor = np.ones(len(mesh.vertices))
        best: tuple[int, dict[int, Reduced]] | None = None

        @cache
        def crossing_before() -> np.ndarray:
            """Vertices of the full mesh where surface runs through surface already."""
            from ..mesh.self_intersections import self_intersections

            return np.unique(mesh.triangles[self_intersections(mesh.vertices, mesh.triangles).ravel()])

        for _ in range(_ROUNDS):
            levels, crossed, crossings = _one_pass(
                mesh, wanted, texture, weights, wedge, places, factor, crossing_before
            )
            if best is None or crossings < best[0]:
                best = crossings, levels
            if not crossed.any():
                break
            factor[crossed] *= _DEARER
        assert best is not None
        found |= best[1]
    return [found[count] for count in counts]


def _check(mesh: Mesh, counts: Sequence[int], texture: Texture | None, weights: SkinWeights | None) -> None:
    if not len(counts):
        raise MirrorScanError("no number of triangles was given; name at least one")
    if min(counts) < FEWEST:
        raise MirrorScanError(
            "{count} triangles are too few to show a body; ask for {least} or more", count=min(counts), least=FEWEST
        )
    triangles = mesh.triangles
    if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(mesh.vertices):
        raise MirrorScanError("a triangle names a vertex that does not exist; the mesh is damaged, make it again")
    if not np.isfinite(mesh.vertices).all():
        raise MirrorScanError("a vertex of the mesh is not a finite number; take it out first")
    if texture is not None and len(texture.uv) != len(triangles):
        raise MirrorScanError(
            "the texture is of {found} triangles, and the mesh has {count}; give the texture of this mesh",
            found=len(texture.uv), count=len(triangles),
        )  # fmt: skip
    if weights is not None and len(weights.index) != len(mesh.vertices):
        raise MirrorScanError(
            "the skin weights are of {found} vertices, and the mesh has {count}; give the weights of this mesh",
            found=len(weights.index), count=len(mesh.vertices),
        )  # fmt: skip


def _wedges(mesh: Mesh, texture: Texture) -> tuple[np.ndarray, np.ndarray]:
    """Corners of one vertex, island and place are one wedge: its number for each corner (T, 3), and places (W, 2)."""
    vertex, island = mesh.triangles.ravel(), np.repeat(texture.island, 3)
    place = np.ascontiguousarray(texture.uv.reshape(-1, 2) + np.float32(0), np.float32).view(np.int64).ravel()
    order = np.lexsort((place, island, vertex))
    differs = np.zeros(len(order), np.bool_)
    for values in (vertex, island, place):
        differs[1:] |= np.diff(values[order]) != 0
    number = np.empty(len(order), np.int32)
    number[order] = np.cumsum(differs)
    first = order[np.concatenate(([True], differs[1:]))]
    return number.reshape(-1, 3), texture.uv.reshape(-1, 2)[first].astype(np.float64)


def _one_pass(
    mesh: Mesh, wanted: list[int], texture: Texture | None, weights: SkinWeights | None,
    wedge: np.ndarray | None, places: np.ndarray | None, factor: np.ndarray,
    crossing_before: Callable[[], np.ndarray],
) -> tuple[dict[int, Reduced], np.ndarray, int]:  # fmt: skip
    """Each level; vertices (V,) where surface came to run through surface, and at how many pairs."""
    from ..mesh.self_intersections import self_intersections
    from .edge_collapse import begin_collapse, collapse_until

    state = begin_collapse(mesh.vertices, mesh.triangles, wedge, places, factor)
    levels, crossed, crossings = {}, np.zeros(len(mesh.vertices), np.bool_), 0
    for count in wanted:
        collapse_until(state, count)
        cluster = clusters(state.into)
        kept = np.flatnonzero(state.alive)
        corners = state.triangles[kept]
        pairs = self_intersections(state.points, corners)
        if len(pairs):
            excused = np.zeros(len(mesh.vertices), np.bool_)
            excused[cluster[crossing_before()]] = True
            fresh = ~excused[corners[pairs]].any(axis=(1, 2))
            crossings += int(fresh.sum())
            at = np.zeros(len(mesh.vertices), np.bool_)
            at[corners[pairs[fresh].ravel()].ravel()] = True
            crossed |= at[cluster]
        levels[count] = _level(mesh, state, count, kept, cluster, texture, weights)
    return levels, crossed, crossings


def _level(
    mesh: Mesh, state: Collapse, count: int, kept: np.ndarray, cluster: np.ndarray,
    texture: Texture | None, weights: SkinWeights | None,
) -> Reduced:  # fmt: skip
    """What is left of the mesh now, with all that it carries."""
    used, triangles = np.unique(state.triangles[kept], return_inverse=True)
    triangles = triangles.reshape(-1, 3).astype(np.int32)
    vertices = state.points[used] + mesh.vertices.mean(axis=0)
    at = footpoints(mesh, cluster, used, vertices)
    smaller = Mesh(
        vertices,
        triangles,
        None if mesh.colors is None else mean_colors(mesh.colors, cluster, used),
        None if mesh.view is None else nearest_values(mesh.view, at),
        None if mesh.kind is None else mesh.kind[kept],
    )
    smaller_texture = None
    if texture is not None:
        uv = settled_places(state.uv, state.wedge[kept], triangles, state.seams[used] == 0, at, texture.uv)
        smaller_texture = Texture(uv[state.wedge[kept]].astype(np.float32), texture.image, texture.island[kept])
    notes = []
    if len(kept) > count:
        notes.append(Notice(
            "the mesh could be reduced to {found} triangles but not to {count}: every further step would fold it, tear "
            "it or shift its texture; ask for more triangles, or reduce before the texture is made",
            found=len(kept), count=count,
        ))  # fmt: skip
    blended = None if weights is None else blended_weights(weights, at)
    return Reduced(smaller, smaller_texture, blended, tuple(notes), kept, at)
