"""How accurate and how sound the surface is: ours, and the peers' from our own oriented points."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from statistics import median

import numpy as np
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.bvh import build_bvh, closest_point
from mirror_scan.core.mesh.normals import triangle_normals, vertex_normals
from mirror_scan.core.mesh.soundness import mesh_report
from mirror_scan.core.mesh.surface_distance import evaluate
from mirror_scan.core.mesh.triangle_mesh import merge
from mirror_scan.core.pipeline import Reconstruction, reconstruct

from .machine import installed, say
from .peers import BALLS, MAX_HOLE_EDGES, OPEN3D_TRIMMED, POISSON, TRIMMED, surfaces
from .results import Finding, Result, Table, number, yes
from .scenes import SHARED, SIMULATED, Scene, origins, scenes

OURS = "Mirror Scan"
CORE = "core.mesh.surface_distance.evaluate"
RUNS = 3
MAX_CROSSING_PCT = 1.0
PAPER = "The paper (5.1): mean 2.08 mm, max 12.9 mm between a mirrored and a direct capture of a mannequin."


@dataclass(frozen=True)
class Surface:
    """One program's result for one scene: ``score`` as of :func:`.surface_distance.evaluate`, ``sound`` as of
    :func:`.soundness.mesh_report`.

    ``turned``: see :func:`turned_inward`; of peers only.
    """

    score: dict
    sound: dict
    milliseconds: float
    turned: float | None = None

    @property
    def crossing_pct(self) -> float:
        return 100.0 * self.score["self_intersecting_faces"] / max(1, self.score["faces"])


Scorer = Callable[[Mesh, Mesh], dict]


def scorer(samples: int = 100_000) -> tuple[Scorer, str]:
    """The scoring tool kept beside the checkout, or core's own, which gives the same fields; and its name."""
    tool = SHARED / "tools" / "score.py"
    if not tool.exists() or not all(map(installed, ("trimesh", "open3d", "pymeshlab"))):
        return partial(evaluate, samples=samples), CORE
    import trimesh

    spec = importlib.util.spec_from_file_location("score", tool)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    def score(mesh: Mesh, truth: Mesh) -> dict:
        a, b = (trimesh.Trimesh(m.vertices, m.triangles, process=False) for m in (mesh, truth))
        return module.score(a, b, n=samples)

    return score, "../shared/tools/score.py"


def oriented_points(scan: Reconstruction) -> tuple[np.ndarray, np.ndarray]:
    """What went to the zipper, camera frame: vertices of the patches and their outward unit normals (N, 3)."""
    patches = merge(list(scan.patches))
    normals = vertex_normals(patches.vertices, patches.triangles)
    used = np.linalg.norm(normals, axis=1) > 0
    return patches.vertices[used], normals[used]


def turned_inward(mesh: Mesh, points: np.ndarray, normals: np.ndarray) -> float:
    """Share [%] of the points whose normal is against the nearest triangle's; about 100 for a surface inside out."""
    _, triangle, _ = closest_point(build_bvh(mesh.vertices, mesh.triangles), points)
    along = np.einsum("ij,ij->i", triangle_normals(mesh.vertices, mesh.triangles)[triangle], normals)
    return 100.0 * float(np.mean(along < 0))


def measure(scene: Scene, score: Scorer) -> dict[str, Surface | None]:
    """Ours and each peer's; None where a peer is not installed. Raises MirrorScanError when ours fails."""
    reconstruct(scene.capture, frame="camera")
    scans = [reconstruct(scene.capture, frame="camera") for _ in range(RUNS)]
    points, normals = oriented_points(scans[-1])
    step = median(s.report["timings_ms"]["zippering"] + s.report["timings_ms"]["closing"] for s in scans)
    mesh = scans[-1].mesh
    found: dict[str, Surface | None] = {OURS: Surface(score(mesh, scene.truth), mesh_report(mesh), step)}
    for name, made in surfaces(points, normals).items():
        if made is None:
            found[name] = None
            continue
        mesh, spent = made
        turned = turned_inward(mesh, points, normals)
        found[name] = Surface(score(mesh, scene.truth), mesh_report(mesh), spent, turned)
    return found


def run() -> Result:
    score, tool = scorer()
    near = Table(
        "Quality: distances [mm] after a small rigid alignment",
        (
            "capture", "surface by", "accuracy mean", "p95", "max", "completeness mean", "p95", "max", "volume error %",
            "ms",
        ),
        left=2,
    )  # fmt: skip
    sound = Table(
        "Quality: soundness",
        (
            "capture", "surface by", "faces", "watertight", "manifold", "components", "open edges",
            "self-intersecting faces", "%", "by core", "Euler",
        ),
        left=2,
    )  # fmt: skip
    measured: dict[str, dict[str, Surface | None]] = {}
    failed: dict[str, str] = {}
    for scene in scenes():
        say(f"quality: {scene.name}")
        try:
            measured[scene.name] = measure(scene, score)
        except MirrorScanError as error:
            failed[scene.name] = str(error)
            near.rows.append((scene.name, f"{OURS}: failed", *["–"] * (len(near.columns) - 2)))
            sound.rows.append((scene.name, f"{OURS}: failed", *["–"] * (len(sound.columns) - 2)))
            continue
        for name, surface in measured[scene.name].items():
            label = (scene.name if name == OURS else "", name)
            near.rows.append(label + _near_cells(surface, len(near.columns) - 2))
            sound.rows.append(label + _sound_cells(surface, len(sound.columns) - 2))
    near.notes = [
        f"Scored by {tool}. Accuracy: reconstruction to truth; completeness: truth to reconstruction.",
        f"ms: the surface step alone; ours is zippering + closing (median of {RUNS}), the peers' their call (once).",
        "The peers get the points and normals of our patches, with overlaps cut and in place, camera frame.",
        "Open3D's Poisson as it comes, which the limits compare, and trimmed: without the "
        f"{TRIMMED:.0%} of its vertices of lowest density, as is usual, which opens it.",
        f"Ball pivoting: automatic radius, non-manifold parts repaired, holes of up to {MAX_HOLE_EDGES} edges closed.",
        *(_nearer_than(peer, measured) for peer in (OPEN3D_TRIMMED, BALLS)),
        _orientation(measured),
        PAPER,
    ] + [f"{name} failed: {message}" for name, message in failed.items()]
    sound.notes = [
        "Watertight: every edge has two triangles of opposite sense. Manifold: no edge of three, each vertex one fan.",
        f"Self-intersecting faces as {tool} counts them, and as core.mesh does. MeshLab, which score.py asks, also "
        "takes triangles that lie side by side in exactly one plane, as on our soles, for crossing.",
        "Euler characteristic 2 = a sphere; each handle takes 2 away.",
    ]
    findings = [f for origin in origins() for f in _findings(origin, measured, failed)]
    if SIMULATED not in origins():
        findings.insert(0, Finding(f"quality on {SIMULATED}", "there is none beside the checkout", None))
    return Result([near, sound], findings)


def _near_cells(surface: Surface | None, width: int) -> tuple[str, ...]:
    if surface is None:
        return ("not installed", *["–"] * (width - 1))
    s = surface.score
    distances = [f"{side}_{what}" for side in ("accuracy", "complete") for what in ("mean", "p95", "max")]
    cells = [number(s[key], 2 if key.endswith("mean") else 1) for key in distances]
    return (*cells, number(s["volume_error_pct"], 1), number(surface.milliseconds, 0))


def _sound_cells(surface: Surface | None, width: int) -> tuple[str, ...]:
    if surface is None:
        return ("not installed", *["–"] * (width - 1))
    s = surface.score
    counts = (str(s["components"]), str(s["boundary_edges"]), str(s["self_intersecting_faces"]))
    return (
        str(s["faces"]), yes(s["watertight"]), yes(surface.sound["manifold"]), *counts, number(surface.crossing_pct, 2),
        str(surface.sound["self_intersections"]), str(surface.sound["euler_characteristic"]),
    )  # fmt: skip


def _nearer_than(peer: str, measured: dict[str, dict[str, Surface | None]]) -> str:
    """How we stand against a peer that no limit speaks of."""
    pairs = [(found[OURS].score, found[peer].score) for found in measured.values() if found[peer] is not None]
    if not pairs:
        return f"{peer} is not installed."
    accurate, complete = (sum(a[k] <= b[k] for a, b in pairs) for k in ("accuracy_mean", "complete_mean"))
    return (
        f"Against {peer}: ours is as near or nearer in {accurate} of {len(pairs)} by mean accuracy, in {complete} of "
        f"{len(pairs)} by mean completeness."
    )


def _orientation(measured: dict[str, dict[str, Surface | None]]) -> str:
    made = [found[name] for found in measured.values() for name in POISSON if found[name] is not None]
    if not made:
        return "No Poisson reconstruction is installed."
    worst = max(surface.turned for surface in made)
    return (
        f"Orientation of the Poisson surfaces: at most {worst:.1f} % of the points fed have a normal against the "
        "nearest triangle's (100 % would be inside out)."
    )


def _findings(origin: str, measured: dict[str, dict[str, Surface | None]], failed: dict[str, str]) -> list[Finding]:
    names = [scene.name for scene in scenes() if scene.origin == origin]
    ours = {name: measured[name][OURS] for name in names if name in measured}
    lost = [f"{name} failed" for name in names if name in failed]

    def every(limit: str, holds: Callable[[Surface], bool]) -> Finding:
        bad = [name for name, surface in ours.items() if not holds(surface)] + lost
        return Finding(f"{limit}, {origin}", f"not {', '.join(bad)}" if bad else f"all {len(names)}", not bad)

    found = [
        every("watertight", lambda s: s.score["watertight"]),
        every("manifold", lambda s: s.sound["manifold"]),
        every("one component", lambda s: s.score["components"] == 1),
    ]
    worst = max(ours, key=lambda name: ours[name].crossing_pct, default=None)
    text = "nothing" if worst is None else f"worst {ours[worst].crossing_pct:.2f} %, {worst}"
    holds = worst is not None and ours[worst].crossing_pct <= MAX_CROSSING_PCT and not lost
    found.append(Finding(f"self-intersecting faces <= {MAX_CROSSING_PCT:g} %, {origin}", text, holds))
    for key, what in (("accuracy_mean", "mean accuracy"), ("complete_mean", "mean completeness")):
        for peer in POISSON:
            found.append(_no_worse(key, f"{what} <= {peer}, {origin}", peer, names, measured, lost))
    return found


def _no_worse(
    key: str, limit: str, peer: str, names: list[str], measured: dict[str, dict[str, Surface | None]], lost: list[str]
) -> Finding:
    both = {name: (measured[name][OURS], measured[name][peer]) for name in names if name in measured}
    pairs = {name: pair for name, pair in both.items() if pair[1] is not None}
    if not pairs:
        return Finding(limit, f"{peer} is not installed" if measured else "nothing", None if measured else False)
    ratio = {name: ours.score[key] / other.score[key] for name, (ours, other) in pairs.items()}
    worst = max(ratio, key=ratio.get)
    a, b = (surface.score[key] for surface in pairs[worst])
    text = f"{sum(r <= 1 for r in ratio.values())} of {len(names)}; worst {a:.2f} against {b:.2f} mm, {worst}"
    return Finding(limit, text, ratio[worst] <= 1 and not lost)
