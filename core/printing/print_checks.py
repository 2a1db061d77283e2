"""Whether a mesh can be printed: closed, in one piece, thick enough, standing firmly, with nothing in mid-air."""

from __future__ import annotations

import numpy as np

from ..errors import Notice
from ..mesh import Mesh
from ..mesh.bvh import build_bvh, raycast
from ..mesh.half_edges import edge_keys
from ..mesh.normals import triangle_normals
from ..mesh.self_intersections import self_intersections
from ..mesh.soundness import connectivity, volume
from ..mesh.submesh import triangle_components
from .polygons import convex_hull, inside
from .print_settings import PrintLimits

_MM = 1000.0
_RAYS = 20_000  # places at which the thickness is measured
_SKIN = 1e-4  # [mm]
_OPPOSITE = 0.5  # cosine: the other side of a wall looks the other way within 60°; where a ray leaves aslant is no wall
_THIN_SHARE = 0.002  # of the surface; less is noise
_ON_BED = 0.05  # [mm]
_LEAST_BED = 0.02  # of the bottom's hull that must touch the bed


def check_print(mesh: Mesh, limits: PrintLimits = PrintLimits()) -> list[Notice]:
    """What stands in the way of printing a mesh as it is; empty when nothing does.

    Parameters
    ----------
    mesh : Mesh
        At the size of the print, Z up [m].
    limits : PrintLimits

    Returns
    -------
    list of Notice
        Each says what, where [mm] and what to do.

    Notes
    -----
    The thickness at a place is the way straight into the body to a surface that looks the other way.
    """
    notices = _soundness(mesh)
    vertices = _MM * mesh.vertices
    size = np.ptp(vertices, axis=0)
    if limits.volume_mm is not None and (size > np.array(limits.volume_mm)).any():
        fits = float((np.array(limits.volume_mm) / size).min())
        notices.append(Notice(
            "the print is {size} mm, and the printer has room for {room} mm; scale it by {fits:.2f} or less",
            size=_by(size), room=_by(np.array(limits.volume_mm)), fits=np.floor(100 * fits) / 100,
        ))  # fmt: skip
    share, thinnest, at = _thin(vertices, mesh.triangles, limits.wall_mm)
    if share > _THIN_SHARE:
        notices.append(Notice(
            "{share:.1%} of the surface is thinner than {limit:g} mm, down to {least:.2f} mm at {at} mm; print it "
            "larger or with a finer nozzle",
            share=share, limit=limits.wall_mm, least=thinnest, at=_place(at),
        ))  # fmt: skip
    notices += _stand(vertices, mesh.triangles)
    starts = mid_air_starts(vertices, mesh.triangles, limits.step_mm)
    if len(starts):
        lowest = starts[starts[:, 2].argmin()]
        notices.append(Notice(
            "{count} places begin in mid-air, the lowest at {at} mm; let the slicer put supports there",
            count=len(starts), at=_place(lowest),
        ))  # fmt: skip
    return notices


def _soundness(mesh: Mesh) -> list[Notice]:
    """Notices of holes, pieces and crossings."""
    notices, report = [], connectivity(mesh)
    if not report["watertight"]:
        notices.append(Notice(
            "the mesh is not closed: {count} edges are open or branch; close it first",
            count=report["boundary_edges"] + report["nonmanifold_edges"],
        ))  # fmt: skip
    else:
        label, count = triangle_components(mesh.triangles, len(mesh.vertices))
        volumes = [volume(Mesh(mesh.vertices, mesh.triangles[label == k])) for k in range(count)]
        solid = sum(v > 0 for v in volumes)
        if solid > 1:
            notices.append(Notice(
                "the print is in {count} separate pieces; join them or remove the small ones", count=solid
            ))  # fmt: skip
        elif not solid:
            notices.append(Notice("the mesh is inside out; turn its faces around"))
    crossing = len(np.unique(self_intersections(mesh.vertices, mesh.triangles)))
    if crossing:
        notices.append(Notice(
            "{count} triangles run through others; a slicer may fill or leave out what lies between", count=crossing
        ))  # fmt: skip
    return notices


def _thin(vertices: np.ndarray, triangles: np.ndarray, limit: float) -> tuple[float, float, np.ndarray]:
    """Share of the surface that is thinner than ``limit`` [mm], the thinnest there and where it is (3,)."""
    normals = triangle_normals(vertices, triangles)
    twice = np.linalg.norm(normals, axis=1)
    rng = np.random.default_rng(0)
    total = float(twice.sum())
    chosen = np.searchsorted(np.cumsum(twice), total * (np.arange(_RAYS) + rng.random(_RAYS)) / _RAYS)
    chosen = np.minimum(chosen, len(triangles) - 1)
    root, along = np.sqrt(rng.random(_RAYS)), rng.random(_RAYS)
    shares = np.column_stack((1 - root, root * (1 - along), root * along))
    points = np.einsum("ni,nij->nj", shares, vertices[triangles[chosen]])
    units = normals / np.maximum(twice, 1e-300)[:, None]
    inward = -units[chosen]
    length, hit, _ = raycast(build_bvh(vertices, triangles), points + _SKIN * inward, inward)  # past where it begins
    opposite = (hit >= 0) & (np.einsum("ni,ni->n", units[hit], inward) > _OPPOSITE)
    thickness = np.where(opposite, length + _SKIN, np.inf)
    worst = int(thickness.argmin())
    return float((thickness < limit).mean()), float(thickness[worst]), points[worst]


def _stand(vertices: np.ndarray, triangles: np.ndarray) -> list[Notice]:
    """Whether it stands on the bed, and on enough of it."""
    bed = vertices[:, 2].min()
    flat = (vertices[triangles][:, :, 2] < bed + _ON_BED).all(axis=1)
    touching = np.unique(triangles[flat])
    if len(touching) < 3:
        return [Notice("it touches the bed only in a point; give it a plate, or cut the soles flat")]
    hull = convex_hull(vertices[touching, :2])
    area = 0.5 * np.abs(triangle_normals(vertices, triangles[flat])[:, 2]).sum()
    foot = convex_hull(vertices[vertices[:, 2] < bed + 0.02 * np.ptp(vertices[:, 2]), :2])
    notices = []
    share = area / max(_area(foot), 1e-9)
    if share < _LEAST_BED:
        notices.append(Notice(
            "only {area:.0f} mm² touch the bed; give it a plate, or let the slicer add a brim", area=area
        ))  # fmt: skip
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    parts = np.einsum("ij,ij->i", a, np.cross(b, c))
    middle = (parts[:, None] * (a + b + c)).sum(axis=0) / (4 * parts.sum())
    if len(hull) < 3 or not inside(middle[None, :2], [hull])[0]:
        notices.append(Notice("its centre of mass is not above what touches the bed, so it tips over; give it a plate"))
    return notices


def _area(ring: np.ndarray) -> float:
    x, y = ring.T
    return float(0.5 * np.abs((x * np.roll(y, -1) - np.roll(x, -1) * y).sum()))


def mid_air_starts(vertices: np.ndarray, triangles: np.ndarray, step: float) -> np.ndarray:
    """Where layers begin that hang on nothing below, (N, 3) [mm].

    Lowest points of the surface with material above them, by at least ``step`` lower than the way to anything lower
    (their persistence, Edelsbrunner et al. 2002); those on the bed do not count.
    """
    keys = np.unique(edge_keys(triangles, len(vertices)))
    a, b = keys // len(vertices), keys % len(vertices)
    order = np.lexsort((np.arange(len(vertices)), vertices[:, 2]))
    rank = np.empty(len(vertices), np.int64)
    rank[order] = np.arange(len(vertices))
    low, high = np.where(rank[a] < rank[b], a, b), np.where(rank[a] < rank[b], b, a)
    by = np.argsort(rank[high], kind="stable")
    bed, heights = vertices[:, 2].min(), vertices[:, 2].tolist()
    parent = list(range(len(vertices)))
    lasting: list[int] = []

    def root(v: int) -> int:
        while parent[v] != v:
            parent[v] = parent[parent[v]]
            v = parent[v]
        return v

    ranks = rank.tolist()
    for one, other in zip(low[by].tolist(), high[by].tolist(), strict=True):
        r, s = root(one), root(other)
        if r == s:
            continue
        if ranks[r] > ranks[s]:
            r, s = s, r
        parent[s] = r  # the deeper one goes on
        if heights[other] - heights[s] >= step and heights[s] > bed + _ON_BED:
            lasting.append(s)
    if not lasting:
        return np.empty((0, 3))
    normals = triangle_normals(vertices, triangles)
    faces = np.zeros(len(vertices))
    for k in range(3):
        faces += np.bincount(triangles[:, k], normals[:, 2], len(vertices))
    found = np.array(lasting)
    return vertices[found[faces[found] < 0]]


def _by(size: np.ndarray) -> str:
    return " × ".join(f"{value:.0f}" for value in size)


def _place(at: np.ndarray) -> str:
    return f"({', '.join(str(round(value)) for value in at.tolist())})"
