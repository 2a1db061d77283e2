"""Surfaces across a gap: flat strips, quadratic Bézier strips, or ours, by their distance to the truth.

All three span the same rungs, those of our own matching; only what was not measured is looked at.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mirror_scan.core.closing.mesh_closing import close_mesh
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.mesh import SEAM, Mesh
from mirror_scan.core.mesh.bvh import build_bvh, closest_point
from mirror_scan.core.mesh.half_edges import open_edges
from mirror_scan.core.mesh.surface_distance import rigid_alignment, sample_surface
from mirror_scan.core.mesh.triangle_mesh import merge
from mirror_scan.core.numeric.point_products import transform
from mirror_scan.core.patches.overlap import part_overlaps
from mirror_scan.core.pipeline import Settings, finish
from mirror_scan.core.pipeline.scan import Clock, scan_steps
from mirror_scan.core.zippering.boundary_frames import boundary_of
from mirror_scan.core.zippering.zipper import zip_patches

from .generated import QUICK, make, recipes
from .machine import say
from .results import Finding, Result, Table, number

FLAT, BEZIER, OURS = "flat strips", "quadratic Bézier strips", "Mirror Scan (thin plate)"
WIDTHS = ((0.0, 0.01), (0.01, 0.025), (0.025, np.inf))
"""Classes of gaps [m]."""
DENSITY = 1.0e6
"""Samples a square metre: one a square millimetre."""


@dataclass(frozen=True)
class Strips:
    """Triangles between two boundaries: ``a`` → ``a1`` on one of them and the apex ``b`` on the other, as positions
    (T, 3), with the directions ``at_a``, ``at_a1``, ``at_b`` (T, 3) in which the surfaces there would go on."""

    a: np.ndarray
    a1: np.ndarray
    b: np.ndarray
    at_a: np.ndarray
    at_a1: np.ndarray
    at_b: np.ndarray

    @property
    def width(self) -> np.ndarray:
        """Length of the longer rung of each (T,) [m]."""
        return np.maximum(*(np.linalg.norm(end - self.b, axis=1) for end in (self.a, self.a1)))


def run() -> Result:
    found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {FLAT: [], BEZIER: [], OURS: []}
    scenes = 0
    for recipe in recipes(QUICK):
        say(f"seams: {recipe}")
        try:
            for name, samples in _measure(recipe).items():
                found[name].append(samples)
            scenes += 1
        except MirrorScanError as error:
            say(f"        failed: {error}")
    classes = [_class_name(low, high) for low, high in WIDTHS]
    columns = [f"{name}: {what}" for name in classes for what in ("mean", "p95")]
    table = Table(f"Seams of {scenes} scenes: distance to the truth by the gap's width [mm]", ("surface", *columns))
    means: dict[str, list[float]] = {}
    for name, parts in found.items():
        if not parts:
            table.rows.append((name, *["–"] * len(columns)))
            continue
        distance, width = (1e3 * np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        cells, means[name] = [], []
        for low, high in WIDTHS:
            within = distance[(width >= 1e3 * low) & (width < 1e3 * high)]
            mean, p95 = (float(within.mean()), float(np.percentile(within, 95))) if len(within) else (np.nan, np.nan)
            means[name].append(mean)
            cells += [number(mean), number(p95, 1)]
        table.rows.append((name, *cells))
    table.notes = [
        "Same scenes, matching and alignment; what was measured is left out, and so are fills.",
        "Flat: the strips as zippered. Bézier: a curve over each rung whose control point is where the two surfaces' "
        "directions at its ends come nearest to each other. Ours: refined and faired with the surface around.",
    ]
    limit = f"seams over gaps {classes[-1]}: ours nearer the truth than flat and Bézier strips"
    if OURS not in means:
        return Result([table], [Finding(limit, "nothing", False)])
    text = ", ".join(f"{name} {values[-1]:.2f}" for name, values in means.items()) + " mm"
    return Result([table], [Finding(limit, text, means[OURS][-1] <= min(means[FLAT][-1], means[BEZIER][-1]))])


def _class_name(low: float, high: float) -> str:
    if low == 0.0:
        return f"up to {1e3 * high:g} mm"
    return f"over {1e3 * low:g} mm" if np.isinf(high) else f"{1e3 * low:g} to {1e3 * high:g} mm"


def _measure(recipe) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """For each surface, samples' distances to the truth and the widths of the gaps they lie in [m]."""
    scene = make(recipe)
    settings = Settings()
    scan = finish(scan_steps(scene.capture, scene.capture.mirrors, settings, Clock(), (0.0, 1.0)), None)
    patches = part_overlaps(scan.patches, scan.maps, settings.overlap)
    zipped, _, twin = zip_patches(patches, scan.maps, scan.up, scan.axis, scan.floor, settings.zipper)
    closed, _ = close_mesh(zipped, scan.maps, scan.up, scan.floor, settings.closing, twin)
    strips = strips_of(zipped, merge(patches))
    truth = scene.truth.body
    tree = build_bvh(np.ascontiguousarray(truth.vertices, np.float64), np.ascontiguousarray(truth.triangles, np.int32))
    moved = rigid_alignment(closed, truth)

    def distance(points: np.ndarray) -> np.ndarray:
        return closest_point(tree, transform(points, moved))[0]

    corners = np.stack((strips.a, strips.a1, strips.b), axis=1).reshape(-1, 3)
    flat = Mesh(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))
    points, triangle, u, t = _spread(strips)
    width = strips.width
    curved = bezier(strips, triangle, u, t)
    seam = Mesh(closed.vertices, closed.triangles[closed.kind == SEAM])
    area = np.linalg.norm(np.cross(*(seam.vertices[seam.triangles[:, k]] - seam.vertices[seam.triangles[:, 0]]
                                     for k in (1, 2))), axis=1).sum() / 2  # fmt: skip
    ours = sample_surface(seam, max(1, int(area * DENSITY)))[0]
    _, nearest, _ = closest_point(build_bvh(flat.vertices, flat.triangles), ours)
    return {
        FLAT: (distance(points), width[triangle]),
        BEZIER: (distance(curved), width[triangle]),
        OURS: (distance(ours), width[nearest]),
    }


def strips_of(zipped: Mesh, patches: Mesh) -> Strips:
    """The seams' triangles with one edge on a patch's boundary; the ``patches``' vertices come first in ``zipped``."""
    count = len(patches.vertices)
    edges = open_edges(patches.triangles, count)
    boundary = boundary_of(patches, edges)
    outward = np.zeros((count, 3))
    outward[boundary.vertex] = boundary.outward
    rim = set(map(tuple, np.sort(edges[:, :2], axis=1).tolist()))
    triangles = zipped.triangles[zipped.kind == SEAM].astype(np.int64)
    triangles = triangles[(triangles < count).all(axis=1)]
    rows = []
    for corners in triangles.tolist():
        on = [k for k in range(3) if tuple(sorted((corners[k], corners[k - 2]))) in rim]
        if len(on) == 1:
            rows.append([corners[(on[0] + k) % 3] for k in range(3)])
    a, a1, b = np.array(rows, np.int64).reshape(-1, 3).T
    points = zipped.vertices
    return Strips(points[a], points[a1], points[b], outward[a], outward[a1], outward[b])


def _spread(strips: Strips) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points spread evenly over the flat strips: positions, triangle, place ``u`` along the edge and ``t`` across."""
    area = np.linalg.norm(np.cross(strips.a1 - strips.a, strips.b - strips.a), axis=1) / 2
    rng = np.random.default_rng(0)
    triangle = rng.choice(len(area), max(1, int(area.sum() * DENSITY)), p=area / area.sum())
    # rungs meet in the apex, so an even spread thins out towards it
    t, u = 1.0 - np.sqrt(rng.random(len(triangle))), rng.random(len(triangle))
    start = strips.a[triangle] + u[:, None] * (strips.a1 - strips.a)[triangle]
    return start + t[:, None] * (strips.b[triangle] - start), triangle, u, t


def bezier(strips: Strips, triangle: np.ndarray, u: np.ndarray, t: np.ndarray) -> np.ndarray:
    """The same places on strips of quadratic Bézier curves, one over each rung (N, 3)."""
    u, t = u[:, None], t[:, None]
    start = strips.a[triangle] + u * (strips.a1 - strips.a)[triangle]
    along = strips.at_a[triangle] + u * (strips.at_a1 - strips.at_a)[triangle]
    end, back = strips.b[triangle], strips.at_b[triangle]
    control = control_points(start, along, end, back)
    return (1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end


def control_points(start: np.ndarray, along: np.ndarray, end: np.ndarray, back: np.ndarray) -> np.ndarray:
    """Middle between the nearest points of the lines from ``start`` along ``along`` and from ``end`` along ``back``.

    Neither is followed backwards or farther than the rung is long; where they are parallel it is the rung's middle.
    """
    across = end - start
    length = np.linalg.norm(across, axis=1)
    p, q = (v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12) for v in (along, back))
    cosine = np.einsum("ij,ij->i", p, q)
    to_p, to_q = np.einsum("ij,ij->i", across, p), np.einsum("ij,ij->i", across, q)
    sine2 = 1.0 - cosine**2
    parallel = sine2 < 1e-3
    safe = np.where(parallel, 1.0, sine2)
    s = np.clip((to_p - cosine * to_q) / safe, 0.0, length)
    r = np.clip((cosine * to_p - to_q) / safe, 0.0, length)
    middle = (start + s[:, None] * p + end + r[:, None] * q) / 2
    return np.where(parallel[:, None], (start + end) / 2, middle)
