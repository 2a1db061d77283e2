"""Fewer triangles beside MeshLab's and Blender's, and prints as other programs read them.

``python -m benchmarks.look_reduction [--quick] [--triangles N] [--pictures DIR]``. Subjects are the mannequin as a
virtual rig scans it, and some of the given bodies where they are there. All methods get the same mesh and UV map.
"""

from __future__ import annotations

import argparse
import io
import tempfile
import time
import zipfile
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from mirror_scan.core.avatar.joints.skeleton_search import find_skeleton
from mirror_scan.core.avatar.pose import Pose, SkinWeights, bone_matrices, skinned
from mirror_scan.core.avatar.skeleton import BONES, Skeleton
from mirror_scan.core.avatar.skin_weights import skinned_mesh
from mirror_scan.core.decimation import decimate, levels_of_detail
from mirror_scan.core.io import read_mesh, write_mesh
from mirror_scan.core.io.images import write_png
from mirror_scan.core.mesh import Mesh, Texture
from mirror_scan.core.mesh.bvh import build_bvh, closest_point
from mirror_scan.core.mesh.soundness import mesh_report
from mirror_scan.core.mesh.surface_distance import sample_surface, surface_distance
from mirror_scan.core.mesh.triangle_mesh import barycentric
from mirror_scan.core.numeric.rotations import from_vectors
from mirror_scan.core.pipeline import reconstruct
from mirror_scan.core.preview.mesh_views import render_views
from mirror_scan.core.printing import PrintSettings, check_print, prepare_print
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate
from mirror_scan.core.texture.unwrapping import unwrap

from .isolated import PeerFailed, Worker
from .machine import installed, say
from .results import Finding, Result, Table, limits_table, number, yes
from .rigged_bodies import rigged_bodies

TRIANGLES = 8000
BODIES = 3
MAX_MEAN, MAX_SECONDS = 0.3, 2.0
PIXELS = 2048  # of the image's side: how much gap islands keep
SAMPLES = 60_000


@dataclass(frozen=True)
class Subject:
    """A mesh with all that lies on it."""

    name: str
    mesh: Mesh
    skeleton: Skeleton
    weights: SkinWeights
    texture: Texture


@dataclass(frozen=True)
class Figures:
    """What became of a subject; ``posed`` [mm] is None where a method keeps no weights, ``drift`` without a UV map."""

    subject: str
    method: str
    mesh: Mesh
    seconds: float
    there: float
    back: float
    p95: float
    report: dict
    turned: int | None = None
    drift: float | None = None
    posed: float | None = None


def subjects(quick: bool) -> list[Subject]:
    rig = default_rig("azure_kinect", seed=1)
    mesh = reconstruct(simulate(mannequin(), rig).capture).mesh
    skeleton = find_skeleton(mesh)
    mesh, weights = skinned_mesh(mesh, skeleton)
    found = [_subject("scanned mannequin", mesh, skeleton, weights)]
    for body in () if quick else rigged_bodies()[:BODIES]:
        found.append(_subject(body.name, body.mesh, body.skeleton, body.weights))
    return found


def _subject(name: str, mesh: Mesh, skeleton: Skeleton, weights: SkinWeights) -> Subject:
    uv, island = unwrap(mesh, weights, 4 / PIXELS)
    return Subject(name, mesh, skeleton, weights, Texture(uv, np.zeros((PIXELS, PIXELS, 3), np.uint8), island))


# --- what became of it -----------------------------------------------------------------------------------------------


def figures(subject: Subject, method: str, mesh: Mesh, seconds: float, uv=None, weights=None) -> Figures:
    there, back = surface_distance(mesh, subject.mesh, SAMPLES), surface_distance(subject.mesh, mesh, SAMPLES)
    turned = drift = posed = None
    if uv is not None:
        one, other = np.moveaxis(uv[:, 1:].astype(float) - uv[:, :1], 1, 0)
        turned = int((one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0] <= 0).sum())
        drift = 1000 * texture_drift(subject, mesh, uv)
    if weights is not None:
        matrices = bone_matrices(subject.skeleton, bent(subject.skeleton))
        full = Mesh(skinned(subject.mesh.vertices, subject.weights, matrices), subject.mesh.triangles)
        small = Mesh(skinned(mesh.vertices, weights, matrices), mesh.triangles)
        posed = 1000 * max(surface_distance(small, full, SAMPLES).mean, surface_distance(full, small, SAMPLES).mean)
    return Figures(
        subject.name, method, mesh, seconds, 1000 * there.mean, 1000 * back.mean, 1000 * max(there.p95, back.p95),
        mesh_report(mesh), turned, drift, posed,
    )  # fmt: skip


def texture_drift(subject: Subject, mesh: Mesh, uv: np.ndarray) -> float:
    """Mean distance [m] between points of a mesh and where on the full mesh the same place in the image lies."""
    flat = np.concatenate((subject.texture.uv, np.zeros((*subject.texture.uv.shape[:2], 1))), axis=2).reshape(-1, 3)
    tree = build_bvh(flat, np.arange(len(flat), dtype=np.int32).reshape(-1, 3))
    points, triangle = sample_surface(mesh, SAMPLES)
    corners = mesh.vertices[mesh.triangles[triangle]]
    places = (barycentric(points, corners)[:, :, None] * uv[triangle]).sum(axis=1)
    _, hit, at = closest_point(tree, np.column_stack((places, np.zeros(len(places)))))
    shares = barycentric(at, flat.reshape(-1, 3, 3)[hit])
    meant = (shares[:, :, None] * subject.mesh.vertices[subject.mesh.triangles[hit]]).sum(axis=1)
    return float(np.linalg.norm(meant - points, axis=1).mean())


def bent(skeleton: Skeleton) -> Pose:
    """Elbows, knees and hips bent by 60°."""
    pose = Pose.rest()
    for name, degrees in (("LeftUpLeg", -60), ("RightUpLeg", -60), ("LeftLeg", 0), ("RightLeg", 0)):
        turn = from_vectors(np.radians(degrees) * np.array((1.0, 0, 0)))
        first = BONES.index(name)
        pose.rotations[first : first + (4 if name.endswith("UpLeg") else 3)] = turn
    for side in ("Left", "Right"):
        arm = BONES.index(f"{side}ForeArm")
        pose.rotations[arm : arm + 2] = from_vectors(np.radians(-60) * np.array((1.0, 0, 0)))
    return pose


# --- methods ---------------------------------------------------------------------------------------------------------


def ours(subject: Subject, triangles: int) -> list[Figures]:
    decimate(subject.mesh, triangles)  # compiled, and in the processor's cache as the others'
    found = []
    for method, texture in (("ours", subject.texture), ("ours, no texture", None)):
        start = time.perf_counter()
        less = decimate(subject.mesh, triangles, texture, subject.weights)
        seconds = time.perf_counter() - start
        uv = None if less.texture is None else less.texture.uv
        found.append(figures(subject, method, less.mesh, seconds, uv, less.weights))
    return found


def meshlab(vertices: np.ndarray, triangles: np.ndarray, count: int, path: str) -> float:
    """MeshLab's quadrics to a file; seconds."""
    import pymeshlab

    scene = pymeshlab.MeshSet()
    scene.add_mesh(pymeshlab.Mesh(vertices, triangles))
    start = time.perf_counter()
    scene.meshing_decimation_quadric_edge_collapse(targetfacenum=count, preservetopology=True, optimalplacement=True)
    seconds = time.perf_counter() - start
    scene.save_current_mesh(path, binary=True)
    return seconds


def blender(mesh: Mesh, uv: np.ndarray, count: int) -> tuple[Mesh, np.ndarray, float]:
    """Blender's Decimate modifier: mesh, UV and seconds."""
    import bpy

    data = bpy.data.meshes.new("full")
    data.from_pydata(mesh.vertices.tolist(), [], mesh.triangles.tolist())
    layer = data.uv_layers.new(name="UVMap", do_init=False)
    layer.uv.foreach_set("vector", np.ascontiguousarray(uv, np.float32).ravel())
    item = bpy.data.objects.new("full", data)
    bpy.context.scene.collection.objects.link(item)
    modifier = item.modifiers.new("Decimate", "DECIMATE")
    modifier.ratio, modifier.use_collapse_triangulate = count / len(mesh.triangles), True
    start = time.perf_counter()
    made = item.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    seconds = time.perf_counter() - start
    made.calc_loop_triangles()
    vertices = np.empty((len(made.vertices), 3), np.float32)
    made.vertices.foreach_get("co", vertices.ravel())
    triangles, loops = (
        np.empty((len(made.loop_triangles), 3), np.int32),
        np.empty((len(made.loop_triangles), 3), np.int32),
    )
    made.loop_triangles.foreach_get("vertices", triangles.ravel())
    made.loop_triangles.foreach_get("loops", loops.ravel())
    places = np.empty((len(made.loops), 2), np.float32)
    made.uv_layers[0].uv.foreach_get("vector", places.ravel())
    return Mesh(vertices.astype(np.float64), triangles), places[loops], seconds


def peers(subject: Subject, triangles: int) -> list[Figures]:
    found = []
    mesh = subject.mesh
    if installed("pymeshlab"):
        with tempfile.TemporaryDirectory() as folder:
            path, worker = str(Path(folder) / "small.ply"), Worker()
            try:
                seconds = worker.call(meshlab, mesh.vertices, mesh.triangles, triangles, path)
                found.append(figures(subject, "MeshLab", read_mesh(path), seconds))
            except PeerFailed as failed:
                say(f"MeshLab, {subject.name}: {failed}")
            worker.stop()
    if installed("bpy"):
        worker = Worker()
        try:
            small, uv, seconds = worker.call(blender, mesh, subject.texture.uv, triangles)
            found.append(figures(subject, "Blender", small, seconds, uv))
        except PeerFailed as failed:
            say(f"Blender, {subject.name}: {failed}")
        worker.stop()
    return found


# --- tables ----------------------------------------------------------------------------------------------------------


def reduction(found: list[Figures], full: dict[str, Subject], triangles: int) -> tuple[Table, list[Finding]]:
    columns = ("subject", "method", "full", "left", "→ mean", "← mean", "95 %", "closed", "manifold", "crossings",
               "UV turned", "drift", "posed", "s")  # fmt: skip
    table = Table(f"Reduced to {triangles} triangles [mm]", columns, left=2)
    for f in found:
        table.rows.append((
            f.subject, f.method, str(len(full[f.subject].mesh.triangles)), str(len(f.mesh.triangles)),
            number(f.there, 3), number(f.back, 3), number(f.p95, 2),
            yes(f.report["watertight"]), yes(f.report["manifold"]),
            str(f.report["self_intersections"]), "–" if f.turned is None else str(f.turned), number(f.drift, 2),
            number(f.posed, 3), number(f.seconds, 2),
        ))  # fmt: skip
    table.notes += [
        "→ from the reduced mesh to the full one, ← back; drift: between a point and where its place in the image was;",
        "posed: mean distance when hips and elbows are bent by 60°, the larger of both ways.",
    ]
    of = [f for f in found if f.method == "ours"]
    worst = max(max(f.there, f.back) for f in of)
    slowest = max(f.seconds for f in of)
    sound = all(f.report["watertight"] and f.report["manifold"] for f in of)
    before = {name: mesh_report(subject.mesh)["self_intersections"] for name, subject in full.items()}
    findings = [
        Finding(f"{triangles} triangles: mean from the full mesh ≤ {MAX_MEAN:g} mm", f"{worst:.3f} mm",
                worst <= MAX_MEAN),
        Finding("reduced: closed and manifold", yes(sound), sound),
        Finding("reduced: no triangle turned over in the texture", str(sum(f.turned for f in of)),
                not any(f.turned for f in of)),
        Finding("reduced: no surface runs through surface that did not before",
                str(sum(f.report["self_intersections"] for f in of)),
                all(f.report["self_intersections"] <= before[f.subject] for f in of)),
        Finding(f"posed: mean from the full mesh ≤ {2 * MAX_MEAN:g} mm", f"{max(f.posed for f in of):.3f} mm",
                max(f.posed for f in of) <= 2 * MAX_MEAN),
        Finding(f"reduced in ≤ {MAX_SECONDS:g} s", f"{slowest:.2f} s", slowest <= MAX_SECONDS),
    ]  # fmt: skip
    return table, findings


def prints(subject: Subject) -> tuple[Table, list[Finding]]:
    """A print of 180 mm, plain, on a plate, hollow, drained; and its size in the files."""
    columns = ("print", "triangles", "closed", "crossings", "ml", "s", "STL height mm", "3MF height mm", "notices")
    table, findings = Table(f"Prints of the {subject.name}, 180 mm high", columns), []
    wanted = {
        "plain": PrintSettings(height_mm=180),
        "on a plate": PrintSettings(height_mm=180, base_mm=3),
        "hollow": PrintSettings(height_mm=180, base_mm=3, wall_mm=2),
        "hollow, drained": PrintSettings(height_mm=180, base_mm=3, wall_mm=2, drain_mm=3),
    }
    for name, settings in wanted.items():
        start = time.perf_counter()
        made = prepare_print(subject.mesh, settings)
        seconds = time.perf_counter() - start
        report, notices = mesh_report(made), check_print(made)
        heights = [file_height(made, suffix) for suffix in (".stl", ".3mf")]
        table.rows.append((
            name, str(report["triangles"]), yes(report["watertight"]), str(report["self_intersections"]),
            number(1e6 * (report["volume_m3"] or 0), 1), number(seconds, 2), *(number(h, 2) for h in heights),
            str(len(notices)),
        ))  # fmt: skip
        table.notes += [f"{name}: {notice}" for notice in notices]
        meant = 1000 * np.ptp(made.vertices[:, 2])
        good = report["watertight"] and report["manifold"] and max(abs(h - meant) for h in heights) < 0.01
        findings.append(Finding(f"print, {name}: closed, and of its size in STL and 3MF", yes(good), good))
    return table, findings


def file_height(mesh: Mesh, suffix: str) -> float:
    """Height [mm] of a mesh in a file, as trimesh reads STL and the specification says of 3MF."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"print{suffix}"
        write_mesh(path, mesh)
        if suffix == ".stl":
            import trimesh

            return float(trimesh.load(path).extents[2])
        model = ElementTree.fromstring(zipfile.ZipFile(io.BytesIO(path.read_bytes())).read("3D/3dmodel.model"))
        heights = [float(vertex.get("z")) for vertex in model.iter() if vertex.tag.endswith("}vertex")]
        return (max(heights) - min(heights)) * {"millimeter": 1, "meter": 1000}[model.get("unit")]


def picture(meshes: list[Mesh]) -> np.ndarray:
    """Flat shaded, from front and side, in rows."""
    rows = []
    for mesh in meshes:
        corners = np.arange(3 * len(mesh.triangles), dtype=np.int32).reshape(-1, 3)
        flat = Mesh(mesh.vertices[mesh.triangles].reshape(-1, 3), corners)
        rows.append(render_views(flat, None, ((0, -1, 0), (1, -0.5, 0.1)), 500, 800))
    return np.concatenate(rows, axis=1)


def run(quick: bool = False, triangles: int = TRIANGLES, pictures: Path | None = None) -> Result:
    """All methods on all subjects, and prints of the first."""
    found, full = [], {}
    for subject in subjects(quick):
        say(f"{subject.name}: {len(subject.mesh.triangles)} triangles, {subject.texture.island.max() + 1} islands")
        full[subject.name] = subject
        found += [*ours(subject, triangles), *peers(subject, triangles)]
        if pictures is not None:
            pictures.mkdir(parents=True, exist_ok=True)
            levels = levels_of_detail(subject.mesh, (triangles, triangles // 4))
            sheet = picture([subject.mesh, *(level.mesh for level in levels)])
            write_png(pictures / f"reduced {subject.name}.png", sheet)
    table, findings = reduction(found, full, triangles)
    first = next(iter(full.values()))
    printed, more = prints(first)
    return Result([table, printed], findings + more)


def tables(quick: bool) -> Result:
    """What the benchmark of the look prints; ``quick`` leaves all bodies out but the mannequin."""
    return run(quick)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="only the mannequin")
    parser.add_argument("--triangles", type=int, default=TRIANGLES)
    parser.add_argument("--pictures", type=Path, help="folder for pictures")
    options = parser.parse_args()
    result = run(options.quick, options.triangles, options.pictures)
    for table in (*result.tables, limits_table(result.findings)):
        print(table.text(), end="\n\n")


if __name__ == "__main__":
    main()
