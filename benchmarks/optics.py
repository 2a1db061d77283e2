"""Real light and real glass: the same rigs with ideal and with real optics side by side.

``python -m benchmarks --only optics``, or alone: ``python -m benchmarks.optics [--rigs 0-7,12] [--columns ideal real
multipath+glass] [--ours] [--pictures DIR]``. A column is one of :data:`COLUMNS`, or effects of
:data:`.optics.EFFECTS` joined by ``+``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean, median

import numpy as np
from mirror_scan.core.camera import unproject
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.io.images import write_png
from mirror_scan.core.mesh import FILL, SEAM, SURFACE, Mesh
from mirror_scan.core.mesh.bvh import Bvh, build_bvh, closest_point, raycast
from mirror_scan.core.mesh.normals import triangle_normals, vertex_normals
from mirror_scan.core.mesh.soundness import connectivity
from mirror_scan.core.mesh.submesh import triangle_components
from mirror_scan.core.mesh.surface_distance import rigid_alignment, sample_surface
from mirror_scan.core.mesh.triangle_mesh import merge
from mirror_scan.core.mirrors.mirror import plane_mirror, reflection_matrix
from mirror_scan.core.patches.grid_triangulation import TriangulationSettings, triangulate_view
from mirror_scan.core.pipeline import reconstruct
from mirror_scan.core.preview.mesh_views import KIND_COLORS, render_views
from mirror_scan.core.simulation.optics import EFFECTS
from mirror_scan.core.simulation.scene import Rig, default_rig, with_real_optics
from mirror_scan.core.simulation.simulate import Simulation, simulate
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from .generated import Recipe, body_of
from .isolated import PeerFailed, Worker
from .machine import installed, milliseconds, say
from .peers import MESHLAB, OPEN3D, POISSON, meshlab_poisson, open3d_poisson
from .results import Finding, Result, Table, limits_table, number
from .scenes import SHARED

RIGS = 48
SEED = 16127
SAMPLES = 20_000
IDEAL, REAL, EVERYTHING = "ideal", "real", "everything"
_LIMITED = ("multipath", "glass", "bow", "attenuation", "color")
COLUMNS: dict[str, tuple[str, ...]] = {IDEAL: (), REAL: _LIMITED, EVERYTHING: (*_LIMITED, "warp", "skin")}
"""Effects of each column. ``everything`` has no limit: nothing in one snapshot tells warp and skin from shape."""
MAX_RATIO, MAX_TIME_RATIO, MIN_NEARER_PCT = 1.8, 2.2, 90.0
FLAP_OUTSIDE, FLAP_AREA = 0.015, 5e-4
"""A piece of surface is a flap where it lies farther outside the body [m] over more than this area [m²]."""
BODIES = (
    ("mh_base_neutral", "A-pose"), ("mannequin", "A-pose"), ("mh_woman_armsdown", "arms down"),
    ("mannequin", "arms down"), ("mh_man_apose", "A-pose"), ("mannequin", "a step"),
    ("mh_man_clothed_apose_closed", "A-pose"), ("mannequin", "arms forward"), ("statue_maria_closed", "statue"),
)  # fmt: skip
"""A name is that of a file of ``../shared/data/bodies``; a mannequin takes its place where there is none."""
WHOLE, FACE, HANDS, FEET, HAIR = "whole body", "face", "hands", "feet", "hair"
REGIONS = (WHOLE, FACE, HANDS, FEET, HAIR)
PANEL = (200, 320)
DIRECTIONS = ((0, -1, 0), (0.8, -0.6, 0), (1, 0, 0), (0.6, 0.8, 0), (0, 1, 0), (-0.6, 0.8, 0), (-1, 0, 0))
SHOWN_MM = 20.0
"""Errors of this size have the full colour."""
WORST = 6
"""Rigs of each column on the picture of the worst."""

_worker = Worker()


# --- rigs ------------------------------------------------------------------------------------------------------------


def draw_triple(rng: np.random.Generator) -> tuple[float, ...]:
    """Three modulation frequencies [MHz] that a camera might use: no two distances up to 9 m give the same phases."""
    while True:
        high = rng.uniform(100.0, 220.0)
        triple = np.array((high, high * rng.uniform(0.65, 0.92), high * rng.uniform(0.13, 0.5)))
        period = 149.896229 / triple
        other = period[0] * np.arange(1, int(9.0 / period[0]) + 1)
        apart = other[:, None] - period * np.rint(other[:, None] / period)
        if np.ptp(apart, axis=1).min() > 0.1:
            return tuple(float(f) for f in np.round(triple, 2))


def draw(number: int) -> tuple[Recipe, tuple[float, ...]]:
    """What makes a rig, with ideal optics, and its camera's frequencies; by the number alone."""
    rng = np.random.default_rng((SEED, number))
    body, pose = BODIES[number % len(BODIES)]
    if body != "mannequin" and not (SHARED / "data" / "bodies" / f"{body}.ply").exists():
        body, pose = "mannequin", "A-pose" if pose == "statue" else pose
    height, tilt, distance = (float(v) for v in rng.uniform((1.5, 0.0, 2.35), (1.88, 5.0, 2.6)))
    right, left = rng.uniform(102.0, 130.0, 2)
    rig = default_rig(
        "azure_kinect", distance, mirrors=(right, -left), path_length=distance + rng.uniform(1.9, 2.4),
        mirror_size=(rng.uniform(0.75, 0.95), rng.uniform(1.75, 2.0)), lean_deg=rng.uniform(-1.0, 1.0, 2),
        roll_deg=rng.uniform(-2.0, 2.0), tilt_deg=tilt,
        camera_height=height / 2 + distance * np.tan(np.radians(tilt)),  # it looks at the middle of the body
        frames=(1, 3, 10)[number % 3], seed=int(rng.integers(1 << 30)),
    )  # fmt: skip
    return Recipe(number, body, pose, height, rig), draw_triple(rng)


def with_column(rig: Rig, frequencies: tuple[float, ...], column: str) -> Rig:
    """The rig as the column has it."""
    effects = COLUMNS.get(column, tuple(column.split("+")))
    return with_real_optics(rig, frequencies, effects) if effects else rig


# --- measures --------------------------------------------------------------------------------------------------------


def region_masks(body: Mesh) -> dict[str, np.ndarray]:
    """Which triangles (T,) of a body, avatar frame, belong to each of :data:`REGIONS`.

    Head: the highest eighth of the height, about its axis; the face is its front below the brow, hair its top and
    back, without what lies within (a mouth). Feet: the lowest 10 cm. Hands: what is within 18 cm of the arms' ends
    over the surface; none where no arm hangs free.
    """
    corners = body.vertices[body.triangles]
    at = corners.mean(axis=1)
    low, high = body.vertices[:, 2].min(), body.vertices[:, 2].max()
    tall = high - low
    crown = body.vertices[body.vertices[:, 2] > high - 0.07 * tall]
    axis = (crown.min(axis=0) + crown.max(axis=0))[:2] / 2.0
    away = at[:, :2] - axis
    head = (at[:, 2] > high - 0.125 * tall) & (np.hypot(*away.T) < 0.085 * tall)
    front = (away[:, 1] < -0.4 * np.hypot(*away.T)) & (at[:, 2] < high - 0.035 * tall)
    head[head] = _open(body, np.flatnonzero(head))
    near = _to_hand_ends(body, low + 0.25 * tall) <= 0.18
    return {
        WHOLE: np.ones(len(at), np.bool_),
        FACE: head & front,
        HANDS: near[body.triangles].all(axis=1),
        FEET: at[:, 2] < low + 0.10,
        HAIR: head & ~front & (at[:, 2] > high - 0.11 * tall),
    }


def _to_hand_ends(body: Mesh, above: float) -> np.ndarray:
    """Way over the surface from each vertex (V,) to the nearest end of an arm [m]; inf where there is none.

    Ends are the vertices above the height ``above`` that are farther from the crown, over the surface, than all within
    12 cm.
    """
    triangles, count = body.triangles, len(body.vertices)
    i, j = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    length = np.linalg.norm(body.vertices[i] - body.vertices[j], axis=1)
    graph = coo_matrix((length, (i, j)), shape=(count, count)).tocsr()  # each edge stands there both ways
    # An edge of two triangles is named once each way, so nothing adds up.
    way = dijkstra(graph, indices=int(body.vertices[:, 2].argmax()))
    beyond = np.zeros(count)
    np.maximum.at(beyond, i, way[j])
    candidates = np.flatnonzero(np.isfinite(way) & (body.vertices[:, 2] > above) & (way > 0.3) & (way >= beyond))
    ends: list[int] = []
    reach = np.full(count, np.inf)
    for v in candidates[np.argsort(-way[candidates])]:
        if len(ends) == 2:
            break
        x, y, z = (np.abs(body.vertices - body.vertices[v]) < 0.12).T
        beside = x & y & z
        if reach[v] > 0.3 and way[v] >= way[beside & np.isfinite(way)].max():
            reach = np.minimum(reach, dijkstra(graph, indices=int(v), limit=0.4))
            ends.append(int(v))
    return reach


_SPREAD = np.random.default_rng(3).standard_normal((16, 3))


def _open(body: Mesh, which: np.ndarray) -> np.ndarray:
    """Of the triangles ``which``: from which ones a ray gets away, of 16 in the directions they face."""
    normals = triangle_normals(body.vertices, body.triangles[which])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    at = body.vertices[body.triangles[which]].mean(axis=1) + 1e-4 * normals
    tree, free = build_bvh(body.vertices, body.triangles), np.zeros(len(which), np.bool_)
    for direction in _SPREAD / np.linalg.norm(_SPREAD, axis=1, keepdims=True):
        side = np.where(normals @ direction >= 0, 1.0, -1.0)[:, None]
        free |= raycast(tree, at, side * direction)[1] < 0
    return free


def outside(points: np.ndarray, body: Mesh, tree: Bvh) -> np.ndarray:
    """Which points (N,) lie outside a body whose triangles face outwards: most of 16 rays meet its outer side or none.

    A few holes in the body do no harm.
    """
    normals = triangle_normals(body.vertices, body.triangles)
    votes = np.zeros(len(points))
    for direction in _SPREAD:
        hit = raycast(tree, points, direction)[1]
        votes += (hit < 0) | (normals[hit] @ direction < 0)
    return votes > len(_SPREAD) / 2


def flaps(mesh: Mesh, body: Mesh, tree: Bvh | None = None) -> np.ndarray:
    """Areas [m²] of the flaps of ``mesh``, largest first.

    A flap is a piece of surface, connected over edges, whose triangles' middles all lie more than
    :data:`FLAP_OUTSIDE` outside the true body, and that is larger than :data:`FLAP_AREA`.

    Parameters
    ----------
    mesh, body : Mesh
        In one frame; the body's triangles face outwards.
    tree : Bvh, optional
        Of the body.
    """
    tree = build_bvh(body.vertices, body.triangles) if tree is None else tree
    at = np.ascontiguousarray(mesh.vertices[mesh.triangles].mean(axis=1))
    far = np.flatnonzero(closest_point(tree, at)[0] > FLAP_OUTSIDE)
    far = far[outside(at[far], body, tree)]
    if not len(far):
        return np.zeros(0)
    piece, count = triangle_components(np.ascontiguousarray(mesh.triangles[far]), len(mesh.vertices))
    area = np.linalg.norm(triangle_normals(mesh.vertices, mesh.triangles[far]), axis=1) / 2.0
    sizes = np.sort(np.bincount(piece, area, minlength=count))[::-1]
    return sizes[sizes > FLAP_AREA]


@dataclass(frozen=True)
class Truth:
    """A true body, avatar frame, with what every score of it needs."""

    body: Mesh
    tree: Bvh
    regions: dict[str, np.ndarray]
    samples: np.ndarray
    triangle: np.ndarray


def truth_of(body: Mesh) -> Truth:
    body = Mesh(np.ascontiguousarray(body.vertices, np.float64), np.ascontiguousarray(body.triangles, np.int32))
    samples, triangle = sample_surface(body, SAMPLES, 2)
    return Truth(body, build_bvh(body.vertices, body.triangles), region_masks(body), samples, triangle)


@dataclass(frozen=True)
class Score:
    """How near one surface is to the truth, after a small rigid alignment.

    ``accuracy``, ``completeness``: mean distance [mm] of each region, None where the body has no such region.
    ``placed``: the surface where it was scored, avatar frame; None where no picture is wanted.
    """

    accuracy: dict[str, float | None]
    completeness: dict[str, float | None]
    placed: Mesh | None


def score(mesh: Mesh, truth: Truth) -> Score:
    """Mean distances from the surface (avatar frame) to the truth and back, region by region of the true body."""
    placed = mesh.transformed(rigid_alignment(mesh, truth.body, SAMPLES // 2))
    samples = sample_surface(placed, SAMPLES, 1)[0]
    there, nearest, _ = closest_point(truth.tree, samples)
    vertices, triangles = (np.ascontiguousarray(a) for a in (placed.vertices, placed.triangles))
    back = closest_point(build_bvh(vertices, triangles), truth.samples)[0]
    found = [
        {name: 1e3 * float(d[mask[of]].mean()) if mask[of].any() else None for name, mask in truth.regions.items()}
        for d, of in ((there, nearest), (back, truth.triangle))
    ]
    return Score(*found, placed)


@dataclass(frozen=True)
class Outcome:
    """What became of one rig with one column's optics.

    ``flaps`` [cm²]; ``sound`` of :func:`.soundness.connectivity`; ``nearer``: peer → whether ours is nearer both ways,
    or in words why the peer made nothing.
    """

    score: Score
    flaps: tuple[float, ...]
    sound: dict
    milliseconds: float
    peers: dict[str, tuple[float, float] | str]

    @property
    def means(self) -> tuple[float, float]:
        """Mean accuracy and completeness [mm]."""
        return self.score.accuracy[WHOLE] or 0.0, self.score.completeness[WHOLE] or 0.0

    def nearer(self, peer: str) -> bool | None:
        """Both ways; None where the peer did not run. A peer that failed is not nearer."""
        found = self.peers.get(peer)
        if found is None or isinstance(found, str):
            return None if found is None else True
        return all(a <= b for a, b in zip(self.means, found, strict=True))


def raw_points(simulation: Simulation) -> tuple[np.ndarray, np.ndarray]:
    """What the peers get: the burst's readings by the true masks and planes, (N, 3) each, avatar frame.

    Points with unit normals of their neighbourhood in the image; flying pixels are removed.
    """
    truth, camera = simulation.truth, simulation.capture.intrinsics
    depth = one_depth_map(simulation.capture)[0]
    labels = np.where(depth > 0, truth.labels, np.int8(-1)).astype(np.int8)
    points, settings = unproject(depth, camera), TriangulationSettings(outline=0.0)
    patches = []
    for view in range(len(truth.mirrors) + 1):
        patch = triangulate_view(depth, labels, view, points, 1.0 / camera.fx, 0.002, None, settings)
        if view:
            known = truth.mirrors[view - 1]
            patch = patch.transformed(reflection_matrix(plane_mirror(known.name, known.point, known.normal)))
            patch = replace(patch, triangles=np.ascontiguousarray(patch.triangles[:, ::-1]))
        patches.append(patch)
    whole = merge(patches).transformed(truth.camera_to_avatar)
    normals = vertex_normals(whole.vertices, whole.triangles)
    used = np.linalg.norm(normals, axis=1) > 0
    return np.ascontiguousarray(whole.vertices[used]), normals[used]


def _open3d(points: np.ndarray, normals: np.ndarray) -> tuple[Mesh, float]:
    return open3d_poisson(points, normals)[0]


def _meshlab(points: np.ndarray, normals: np.ndarray) -> tuple[Mesh, float]:
    return meshlab_poisson(points, normals, threads=1)  # its time does not count here


def _peers(simulation: Simulation, truth: Truth) -> dict[str, tuple[float, float] | str]:
    """Mean accuracy and completeness [mm] of each peer that is installed, or why it made nothing."""
    made: dict[str, tuple[float, float] | str] = {}
    points, normals = raw_points(simulation)
    for name, module, call in ((OPEN3D, "open3d", _open3d), (MESHLAB, "pymeshlab", _meshlab)):
        if not installed(module):
            continue
        try:
            found = score(_worker.call(call, points, normals)[0], truth)
            made[name] = (found.accuracy[WHOLE] or 0.0, found.completeness[WHOLE] or 0.0)
        except (PeerFailed, MirrorScanError) as error:
            made[name] = str(error)
    return made


def judge(simulation: Simulation, truth: Truth, peers: bool, keep: bool = False) -> Outcome | str:
    """One reconstruction against the truth; in words why there is none. ``keep``: with the surface."""
    try:
        spent, scan = milliseconds(lambda: reconstruct(simulation.capture, frame="camera"))
        found = score(scan.mesh.transformed(simulation.truth.camera_to_avatar), truth)
    except MirrorScanError as error:
        return str(error)
    assert found.placed is not None
    areas = tuple(1e4 * float(a) for a in flaps(found.placed, truth.body, truth.tree))
    others = _peers(simulation, truth) if peers else {}
    return Outcome(found if keep else replace(found, placed=None), areas, connectivity(scan.mesh), spent, others)


def _brief(found: Outcome) -> str:
    flapping = f", flaps {' + '.join(f'{a:.0f}' for a in found.flaps)} cm2" if found.flaps else ""
    return f"{found.means[0]:.2f}/{found.means[1]:.2f} mm{flapping}"


# --- all of them -----------------------------------------------------------------------------------------------------

Done = list[tuple[Recipe, dict[str, Outcome | str]]]


def measure(
    numbers: Sequence[int], columns: Sequence[str], peers: bool, pictures: bool
) -> Iterator[tuple[Recipe, dict[str, Outcome | str]]]:
    """Each rig with every column's optics; the peers run where the optics are ``real``."""
    warm = False
    for number_ in numbers:
        recipe, frequencies = draw(number_)
        body = body_of(recipe)
        truth = truth_of(body)
        found: dict[str, Outcome | str] = {}
        for column in columns:
            made = simulate(body, with_column(recipe.rig, frequencies, column))
            if not warm:  # kernels are loaded or compiled now, not while time is taken
                try:
                    reconstruct(made.capture)
                except MirrorScanError:
                    pass  # counted below
                warm = True
            found[column] = judge(made, truth, peers and column == REAL, pictures)
        triple = "/".join(f"{f:.0f}" for f in frequencies)
        say(f"optics: {recipe}, {triple} MHz\n        " + "; ".join(_line(c, o) for c, o in found.items()))
        yield recipe, found


def _line(column: str, found: Outcome | str) -> str:
    if isinstance(found, str):
        return f"{column}: {found}"
    others = ", ".join(
        f"{peer} {f'{other[0]:.2f}/{other[1]:.2f}' if isinstance(other, tuple) else other}"
        for peer, other in found.peers.items()
    )
    sound = "" if found.sound["watertight"] and found.sound["manifold"] else ", not closed or not manifold"
    return f"{column} {_brief(found)}{sound}" + (f" ({others})" if others else "")


def run(
    numbers: Sequence[int] | None = None,
    columns: Sequence[str] = tuple(COLUMNS),
    peers: bool = True,
    pictures: Path | None = None,
) -> Result:
    """The rigs numbered, or all; each is reported as it comes."""
    numbers = tuple(range(RIGS)) if numbers is None else numbers
    done: Done = list(measure(numbers, columns, peers, pictures is not None))
    if pictures is not None:
        _write_worst(done, columns, pictures)
    return Result([_overview(done, columns), _by_region(done, columns), _against(done)], _findings(done, columns))


def _made(done: Done, column: str) -> list[tuple[Recipe, Outcome]]:
    return [(r, found[column]) for r, found in done if isinstance(found.get(column), Outcome)]


def _ratios(done: Done, column: str, value: Callable[[Outcome], float | None]) -> list[float]:
    """Of each rig where there are both: the column's value over that with ideal optics."""
    ratios = []
    for _, found in done:
        pair = [found.get(c) for c in (column, IDEAL)]
        values = [value(o) for o in pair if isinstance(o, Outcome)]
        if len(values) == 2 and None not in values and values[1]:
            ratios.append(values[0] / values[1])
    return ratios


def _mean(done: Done, column: str, value: Callable[[Outcome], float | None]) -> float | None:
    values = [v for _, o in _made(done, column) if (v := value(o)) is not None]
    return mean(values) if values else None


def _times(one: float | None, other: float | None) -> float | None:
    return None if one is None or not other else one / other


def _overview(done: Done, columns: Collection[str]) -> Table:
    table = Table(
        f"Ideal and real optics, {len(done)} rigs, Azure Kinect: distances [mm]",
        ("optics", "rigs", "failed", "accuracy: mean", "median", "worst", "/ ideal", "completeness: mean", "median",
         "worst", "/ ideal", "flaps", "largest [cm²]", "closed", "manifold", "ms", "ms / ideal"),
    )  # fmt: skip
    for column in columns:
        outcomes = [o for _, o in _made(done, column)]
        tried = sum(column in found for _, found in done)
        if not outcomes:
            table.rows.append((column, str(tried), str(tried), *["–"] * (len(table.columns) - 3)))
            continue
        cells: list[str] = []
        for k in (0, 1):
            values = [o.means[k] for o in outcomes]
            ratio = _times(mean(values), _mean(done, IDEAL, lambda o, k=k: o.means[k]))
            cells += [number(v) for v in (mean(values), median(values), max(values), ratio)]
        areas = [a for o in outcomes for a in o.flaps]
        slower = _ratios(done, column, lambda o: o.milliseconds)
        table.rows.append((
            column, str(tried), str(tried - len(outcomes)), *cells, str(len(areas)), number(max(areas, default=0.0), 0),
            *(str(sum(bool(o.sound[key]) for o in outcomes)) for key in ("watertight", "manifold")),
            number(median(o.milliseconds for o in outcomes), 0), number(median(slower) if slower else None),
        ))  # fmt: skip
    table.notes = [
        "Virtual snapshots: people, a statue and mannequins of 1.5 to 1.88 m, two mirrors at 102 to 130°, bursts of 1, "
        "3 and 10, three modulation frequencies drawn for each rig; mirrors by eight picks on each frame; seeded.",
        *(f"{column}: {', '.join(COLUMNS.get(column, column.split('+')))}." for column in columns if column != IDEAL),
        f"Means of {SAMPLES} samples each way after a small rigid alignment; / ideal: of the means over all rigs. ms: "
        "the whole job, one run each; / ideal: median of the rigs' own ratios.",
        f"Flap: a connected piece of surface more than {1e3 * FLAP_OUTSIDE:.0f} mm outside the true body over more "
        f"than {1e4 * FLAP_AREA:.0f} cm².",
    ]
    return table


def _by_region(done: Done, columns: Collection[str]) -> Table:
    heads = [f"{side}, {column}" for side in ("accuracy", "completeness") for column in columns]
    shown = [c for c in columns if c != IDEAL] if IDEAL in columns else []
    table = Table(
        "Ideal and real optics: where on the body, mean distances [mm]",
        ("part", *heads, *(f"{column} / ideal" for column in shown)),
    )
    for region in REGIONS:
        sides: list[Callable[[Outcome], float | None]] = [
            lambda o, r=region: o.score.accuracy[r],
            lambda o, r=region: o.score.completeness[r],
        ]
        cells = [number(_mean(done, column, side)) for side in sides for column in columns]
        ratios = [[_times(_mean(done, c, side), _mean(done, IDEAL, side)) for side in sides] for c in shown]
        table.rows.append((region, *cells, *(" / ".join(number(r) for r in pair) for pair in ratios)))
    table.notes = [
        "Of the true body: the head's front below the brow, 18 cm of the arms' ends, the lowest 10 cm, the head's top "
        "and back. Accuracy counts where the nearest point of the truth is.",
    ]
    return table


def _against(done: Done) -> Table:
    table = Table(
        f"Real optics: ours against peers on the raw readings, {len(done)} rigs, mean distances [mm]",
        ("surface by", "accuracy", "completeness", "ours nearer: accuracy", "completeness", "both ways"),
    )
    ours = _made(done, REAL)
    if ours:
        table.rows.append(("Mirror Scan", *(number(mean(o.means[k] for _, o in ours)) for k in (0, 1)), "", "", ""))
    for peer in POISSON:
        pairs = [(o.means, o.peers[peer]) for _, o in ours if isinstance(o.peers.get(peer), tuple)]
        if not pairs:
            table.rows.append((peer, *["–"] * (len(table.columns) - 1)))
            continue
        means = [number(mean(other[k] for _, other in pairs)) for k in (0, 1)]
        wins = [[a[k] <= b[k] for a, b in pairs] for k in (0, 1)]
        both = [all(w) for w in zip(*wins, strict=True)]
        table.rows.append((peer, *means, *(f"{100 * sum(w) / len(w):.0f} %" for w in (*wins, both))))
    table.notes = [
        "The peers get the burst's readings of the same capture without flying pixels, by the true masks and reflected "
        "by the true planes; ours gets the capture and the picks.",
    ]
    return table


def _findings(done: Done, columns: Collection[str]) -> list[Finding]:
    if REAL not in columns:
        return []
    total, real = len(done), _made(done, REAL)
    lost = [r.name for r, found in done if isinstance(found.get(REAL), str)]
    found: list[Finding] = []
    for k, what in enumerate(("accuracy", "completeness")):
        limit = f"real optics: mean {what} <= {MAX_RATIO:g} x ideal"
        pair = [_mean(done, c, lambda o, k=k: o.means[k]) for c in (REAL, IDEAL)]
        ratio = _times(*pair)
        if ratio is None:
            found.append(Finding(limit, "not run with both", None))
            continue
        each = _ratios(done, REAL, lambda o, k=k: o.means[k])
        text = f"{pair[0]:.2f} / {pair[1]:.2f} = {ratio:.2f}; {sum(r <= MAX_RATIO for r in each)} of {len(each)} rigs"
        found.append(Finding(limit, text, ratio <= MAX_RATIO and not lost))
    for peer in POISSON:
        limit = f"real optics: nearer both ways than {peer} on raw readings in >= {MIN_NEARER_PCT:g} %"
        flags = [flag for _, o in real if (flag := o.nearer(peer)) is not None] + [False] * len(lost)
        if len(flags) == len(lost):
            found.append(Finding(limit, f"{peer} was not run", None))
            continue
        share = 100.0 * sum(flags) / len(flags)
        worse = ", ".join(r.name for r, o in real if o.nearer(peer) is False)
        text = f"{share:.0f} %" + (f"; not {worse}" if worse else "")
        found.append(Finding(limit, text, share >= MIN_NEARER_PCT))

    def every(limit: str, holds: Callable[[Outcome], bool]) -> Finding:
        bad = sorted([r.name for r, o in real if not holds(o)] + lost)
        return Finding(f"real optics: {limit}", f"not {', '.join(bad)}" if bad else f"all {total}", not bad)

    found += [
        every("no flap", lambda o: not o.flaps),
        every("closed", lambda o: o.sound["watertight"]),
        every("manifold", lambda o: o.sound["manifold"]),
        every("no crash", lambda o: True),
    ]
    slower = _ratios(done, REAL, lambda o: o.milliseconds)
    limit = f"real optics: whole job <= {MAX_TIME_RATIO:g} x that with ideal optics"
    if not slower:
        return [*found, Finding(limit, "not run with both", None)]
    text = f"median {median(slower):.2f}, slowest {max(slower):.2f}"
    return [*found, Finding(limit, text, median(slower) <= MAX_TIME_RATIO)]


# --- pictures --------------------------------------------------------------------------------------------------------


def error_colors(signed: np.ndarray) -> np.ndarray:
    """Signed errors (N,) [m] → sRGB (N, 3): red outside, blue inside, grey where there is none."""
    share = np.clip(1e3 * signed / SHOWN_MM, -1.0, 1.0)[:, None]
    grey, out, within = (np.array(c, float) for c in ((215, 215, 215), (215, 20, 20), (20, 50, 215)))
    mixed = grey + np.abs(share) ** 0.7 * (np.where(share > 0, out, within) - grey)
    return np.rint(mixed).astype(np.uint8)


def _picture(placed: Mesh, truth: Truth, caption: str) -> np.ndarray:
    """The surface by its error and by kind, and the true body by its distance to the surface (red: not reached)."""
    distance = closest_point(truth.tree, placed.vertices)[0]
    sign = np.where(outside(placed.vertices, truth.body, truth.tree), 1.0, -1.0)
    vertices, triangles = (np.ascontiguousarray(a) for a in (placed.vertices, placed.triangles))
    back = closest_point(build_bvh(vertices, triangles), truth.body.vertices)[0]
    kinds = np.array([KIND_COLORS[kind] for kind in (SURFACE, SEAM, FILL)], np.uint8)[placed.kind]
    rows = [
        render_views(mesh, colors, DIRECTIONS, *PANEL)
        for mesh, colors in ((placed, error_colors(sign * distance)), (placed, kinds), (truth.body, error_colors(back)))
    ]
    picture = np.concatenate(rows)
    if not installed("PIL"):
        return picture
    from PIL import Image, ImageDraw

    image = Image.fromarray(picture)
    ImageDraw.Draw(image).text((6, 3), caption, fill=(0, 0, 0))
    return np.array(image)


def _write_worst(done: Done, columns: Collection[str], folder: Path) -> None:
    """The rigs of each column with the largest flaps and with the largest errors: one picture each."""
    folder.mkdir(parents=True, exist_ok=True)
    for column in columns:
        made = [(r, o) for r, o in _made(done, column) if o.score.placed is not None]
        by_error = sorted(made, key=lambda pair: -sum(pair[1].means))
        by_flaps = [pair for pair in sorted(made, key=lambda pair: -sum(pair[1].flaps)) if pair[1].flaps]
        chosen = {r.name: (r, o) for r, o in (*by_flaps[: WORST // 2], *by_error)}
        for recipe, outcome in list(chosen.values())[:WORST]:
            assert outcome.score.placed is not None
            caption = f"{recipe.name} {recipe.body} x{recipe.rig.frames} {column}: {_brief(outcome)}"
            picture = _picture(outcome.score.placed, truth_of(body_of(recipe)), caption)
            write_png(folder / f"optics_{column}_{recipe.name}.png", picture)


# --- command line ----------------------------------------------------------------------------------------------------


def rig_numbers(text: str) -> tuple[int, ...]:
    """``"0-3,7"`` → (0, 1, 2, 3, 7)."""
    numbers: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        numbers += range(int(first), int(last or first) + 1)
    return tuple(numbers)


def column_name(text: str) -> str:
    if text not in COLUMNS and not all(name in EFFECTS for name in text.split("+")):
        raise argparse.ArgumentTypeError(f"no column “{text}”; {', '.join(COLUMNS)}, or of {', '.join(EFFECTS)}")
    return text


def main() -> int:
    parser = argparse.ArgumentParser("python -m benchmarks.optics", description="Ideal and real optics alone.")
    parser.add_argument("--rigs", type=rig_numbers, metavar="0-7,12", help=f"these only; all are 0-{RIGS - 1}")
    parser.add_argument("--columns", type=column_name, nargs="+", default=list(COLUMNS), metavar="NAME",
                        help="of ideal, real, everything, or effects joined by +")  # fmt: skip
    parser.add_argument("--ours", action="store_true", help="without the peers")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="write the worst rigs' errors there")
    options = parser.parse_args()
    result = run(options.rigs, options.columns, not options.ours, options.pictures)
    for table in (*result.tables, limits_table(result.findings)):
        print(f"\n{table.text()}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
