"""Which boundary meets which, and the triangles between them (paper 4.2.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import MirrorScanError
from ..hole_filling.loop_triangulation import fill_loops
from ..hole_filling.soles import is_sole
from ..mesh import Mesh
from ..mesh.boundary_loops import loops_of
from ..mesh.half_edges import check_sheet, extend_open_edges, extend_twins, open_edges, twins
from ..mesh.submesh import components_of, triangles_touching
from ..mesh.triangle_mesh import check_mesh, merge
from ..numeric.kernels import njit
from ..numeric.point_products import dot
from ..views.free_space import bridge_is_free
from ..views.view_maps import ViewMaps
from .boundary_frames import Boundary, boundary_of
from .coronal_matching import match_chains, outer_chains, solidity
from .facing_matching import find_partners, warp_runs
from .seam_strips import Candidates, Seam, begin_weave, weave_seams

_DOWNWARDS = -0.5  # cosine to the vertical below which a boundary's surface goes on down to the floor


@dataclass(frozen=True)
class ZipperSettings:
    """How boundaries are matched.

    Parameters
    ----------
    gaps : tuple of float
        Widest gap bridged in each round [m]; narrow gaps are zippered first.
    min_run : int
        Shortest run of facing vertices that is worth a seam.
    compactness : float
        The paper's split at the coronal and sagittal planes is used when at least this share of the silhouette's rows,
        from end to end, is body: no limbs held off it. Above 1 it is never used, 0 always.
    compact_gap : float
        Where the paper's matching leaves a wider gap than this, the general matching takes over [m].
    compact_share : float
        The paper's matching is discarded when less than this share of a matched pair is that near.
    floor_band : float
        Boundaries lower than this above the floor are soles: only the narrowest gaps are bridged there [m].
    sole_band, sole_reach : float
        A loop that comes lower than the one above the floor, and lies mostly lower than the other, is a sole and no
        hole [m].
    """

    gaps: tuple[float, ...] = (0.03, 0.08, 0.12, 0.2)
    min_run: int = 4
    compactness: float = 0.93
    compact_gap: float = 0.05
    compact_share: float = 0.35
    floor_band: float = 0.05
    sole_band: float = 0.025
    sole_reach: float = 0.09


def zip_patches(
    patches: list[Mesh],
    maps: ViewMaps,
    up: np.ndarray,
    axis: np.ndarray,
    floor: float | None,
    settings: ZipperSettings = ZipperSettings(),
    made: Mesh | None = None,
) -> tuple[Mesh, list[Seam], np.ndarray]:
    """Zipper the patches.

    A compact figure is first zippered as the paper does, then every pair of boundary runs that face each other.

    Narrow gaps come before wide ones, well matched runs before poorly matched ones.

    Parameters
    ----------
    patches : list of Mesh
        One a view, camera frame, consistently wound.
    maps : ViewMaps
        What the views saw: no bridge runs through space seen to be empty.
    up, axis : np.ndarray [shape=(3,)]
        Vertical, and a point of the vertical through the subject, in which coronal and sagittal plane meet.
    floor : float or None
        Height of the floor along ``up`` [m].
    made : Mesh, optional
        What stands for parts of feet that no view shows, of kind ``FILL``: zippered like a patch. Then boundaries near
        the floor are bridged as far as others, unless they go on down to it or under the foot, and soles stay open.

    Returns
    -------
    mesh : Mesh
        With the seams' triangles (kind ``SEAM``); no directed edge occurs twice. Small holes are filled (``FILL``).
    seams : list of Seam
    twin : np.ndarray [shape=(3 T,), dtype=int32]
        :func:`~.half_edges.twins` of the mesh, for :func:`~.mesh_closing.close_mesh`.

    Raises
    ------
    MirrorScanError
        When there is no patch, or one is damaged or no sheet: :func:`~.triangle_mesh.check_mesh`,
        :func:`~.half_edges.check_sheet`.

    Notes
    -----
    O(B²) time in the worst case for B boundary vertices, O(B) memory and one byte a DTW cell.
    """
    if not patches:
        raise MirrorScanError("zippering: no patch is given; give one for each view")
    for number, patch in enumerate(patches):
        check_mesh(patch, f"zippering: patch {number}")
    mesh = merge(patches if made is None else [*patches, made])
    seams: list[Seam] = []
    count = len(mesh.vertices)
    twin = twins(mesh.triangles, count)
    check_sheet(mesh.triangles, twin, "zippering")
    label, pieces = components_of(twin, len(mesh.triangles))
    edges = open_edges(mesh.triangles, count, twin)
    if not len(edges):
        return mesh, seams, twin
    # all that follows asks for triangles at the boundary only: those farther in wait
    shore = np.zeros(count, np.bool_)
    shore[edges[:, 0]] = True
    shore = triangles_touching(mesh.triangles, shore)
    whole, measured = mesh, int(shore.sum())
    edges[:, 2] = (np.cumsum(shore) - 1)[edges[:, 2]]
    assert mesh.kind is not None  # checked above
    mesh = replace(mesh, triangles=mesh.triangles[shore], kind=mesh.kind[shore])
    piece, root = np.zeros(count, np.int64), np.arange(pieces)
    piece[mesh.triangles] = label[shore, None]
    boundary = boundary_of(mesh, edges)
    candidates = _compact_candidates(mesh, patches, boundary, maps, up, axis, floor, settings)
    known = len(mesh.triangles)
    weave = begin_weave(boundary, piece, root)
    mesh, seams = weave_seams(mesh, boundary, weave, candidates, "coronal and sagittal planes")
    for reach in settings.gaps:
        edges = extend_open_edges(edges, mesh.triangles, known, len(mesh.vertices))
        boundary = boundary_of(mesh, edges)
        if not len(boundary.vertex):
            break
        candidates = _facing_candidates(mesh, boundary, maps, reach, up, floor, settings, made is not None)
        known = len(mesh.triangles)
        weave = begin_weave(boundary, piece, root)
        mesh, found = weave_seams(mesh, boundary, weave, candidates, "facing runs")
        seams += found
        # a hole no wider than the gaps just zippered is a hole in one surface, not two boundaries to match
        edges = extend_open_edges(edges, mesh.triangles, known, len(mesh.vertices))
        known = len(mesh.triangles)
        holes = edges if made is None or floor is None else _without_soles(mesh, edges, up, floor, settings)
        mesh = fill_loops(mesh, maps, diameter=reach, edges=holes)
        # a hole closed round a new vertex never meets a boundary again: its piece does not matter
        piece = np.concatenate((piece, np.zeros(len(mesh.vertices) - len(piece), np.int64)))
    assert whole.kind is not None and mesh.kind is not None
    triangles = np.concatenate((whole.triangles, mesh.triangles[measured:]))
    twin = extend_twins(twin, triangles, len(mesh.vertices))
    return replace(mesh, triangles=triangles, kind=np.concatenate((whole.kind, mesh.kind[measured:]))), seams, twin


def _without_soles(mesh: Mesh, edges: np.ndarray, up: np.ndarray, floor: float, settings: ZipperSettings) -> np.ndarray:
    """The open edges (B, 3) without those of soles, which are no holes: what is left of them ends on the floor."""
    sole = np.zeros(len(mesh.vertices), np.bool_)
    for loop in loops_of(edges, len(mesh.vertices)):
        height = dot(mesh.vertices[loop], up) - floor
        if height.min() < settings.sole_band and is_sole(height, settings.sole_reach):
            sole[loop] = True
    return edges[~(sole[edges[:, 0]] & sole[edges[:, 1]])]


def _compact_candidates(
    mesh: Mesh,
    patches: list[Mesh],
    boundary: Boundary,
    maps: ViewMaps,
    up: np.ndarray,
    axis: np.ndarray,
    floor: float | None,
    settings: ZipperSettings,
) -> Candidates:
    """The paper's matching (4.2.2), kept where the boundaries it pairs run along each other.

    Empty for a figure that is not compact, or on which they mostly do not: all is left to the general matching.
    """
    if solidity(maps.labels) < settings.compactness:
        return Candidates.of([])
    entry = np.full(len(mesh.vertices), -1)
    entry[boundary.vertex] = np.arange(len(boundary.vertex))
    candidates = []
    loops = np.split(boundary.vertex, boundary.start[1:-1])
    first = np.concatenate(([0], np.cumsum([len(patch.vertices) for patch in patches])))
    for a, b, warping in match_chains(mesh.vertices, outer_chains(mesh.vertices, loops, first, up, axis)):
        at_a, at_b, path = entry[a.vertices], entry[b.vertices[::-1]], warping.path
        p, q = boundary.point[at_a[path[:, 0]]], boundary.point[at_b[path[:, 1]]]
        near = np.linalg.norm(p - q, axis=1) <= settings.compact_gap
        near &= ~_free_bridges(p, q, maps.free_space)
        standing = np.ones(len(p), np.bool_)
        if floor is not None:  # soles have nothing to be matched with
            standing = (dot(p, up) > floor + settings.floor_band) & (dot(q, up) > floor + settings.floor_band)
        near &= standing
        if near.sum() < settings.compact_share * standing.sum():
            return Candidates.of([])
        candidates += [(at_a, at_b, path[first:last]) for first, last in _runs_of(near, settings.min_run)]
    return Candidates.of(candidates)


def _facing_candidates(
    mesh: Mesh,
    boundary: Boundary,
    maps: ViewMaps,
    reach: float,
    up: np.ndarray,
    floor: float | None,
    settings: ZipperSettings,
    feet: bool,
) -> Candidates:
    """Runs that face each other over gaps up to ``reach``, warped, the best matched and longest first."""
    edge = np.median(np.linalg.norm(np.diff(boundary.point[: boundary.start[1]], axis=0), axis=1))
    limit, low = np.full(len(boundary.vertex), reach), np.zeros(len(boundary.vertex), np.bool_)
    if floor is not None:
        height = dot(boundary.point, up) - floor
        sole = height < settings.floor_band
        if feet:
            sole &= dot(boundary.outward, up) < _DOWNWARDS
            low = (height < settings.sole_reach) & (reach > settings.gaps[0])
        limit[sole] = min(reach, settings.gaps[0])
    assert mesh.view is not None  # checked by zip_patches
    partner, price = find_partners(boundary, limit, up, mesh.view[boundary.vertex], maps, low)
    return warp_runs(boundary, partner, price, edge, settings.min_run)


def _runs_of(mask: np.ndarray, shortest: int) -> list[tuple[int, int]]:
    """Runs (first, behind last) of True that are at least ``shortest`` long."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= shortest]


@njit(cache=True, nogil=True)
def _free_bridges(p, q, free_space):
    free = np.zeros(len(p), np.bool_)
    for i in range(len(p)):
        free[i] = bridge_is_free(p, i, q, i, free_space)
    return free
