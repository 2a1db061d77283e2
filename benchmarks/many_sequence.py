"""Sequences: a body that dances, turns and raises its arms before the virtual rig; every frame a closed avatar.

Bodies of ``../shared/data/rigged`` are moved by ``../shared/data/motion`` at 15 frames a second, with real optics.
``python -m benchmarks.many_sequence [--sensors kinect_v1 …] [--frames N] [--pictures DIR]`` prints the table alone.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mirror_scan.core.avatar.pose import bone_matrices, skinned
from mirror_scan.core.capture import open_capture
from mirror_scan.core.capture.folders.rgbd_folder import mirrors_to
from mirror_scan.core.capture.rgbd_writer import FolderWriter
from mirror_scan.core.io import read_mesh
from mirror_scan.core.io.images import write_png
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.bvh import build_bvh, closest_point
from mirror_scan.core.mesh.normals import vertex_normals
from mirror_scan.core.mesh.surface_distance import evaluate
from mirror_scan.core.motion import Clip, read_bvh, retarget
from mirror_scan.core.pipeline import reconstruct
from mirror_scan.core.preview.mesh_views import render_views
from mirror_scan.core.sequences import (
    FilterSettings,
    SequenceRig,
    SequenceSettings,
    SurfaceFilterSettings,
    open_recording,
    place_rig,
    reconstruct_sequence,
)
from mirror_scan.core.sequences.skeleton_tracking import best_frame, track
from mirror_scan.core.simulation.scene import default_rig, with_real_optics
from mirror_scan.core.simulation.simulate import simulate

from .machine import say
from .results import Finding, Result, Table, number
from .rig_motion import DATA, Body

SENSORS = ("kinect_v1", "azure_kinect")
RATE = 15.0
FRAMES, QUICK = 60, 12
PARTS = (("squat_armsup_apose_m", 30), ("dance_rokoko_cm", 0), ("jumps_turn_cgspeed", 150))
"""Motions that follow each other, and the frame that each begins with: arms are raised; a dance; a turn."""
DISTANCE, PATH = 2.7, 4.8
"""Camera to subject, and by way of a mirror [m]: raised arms are in the picture."""
SAMPLES = 4000
"""Points of the skin that are followed."""
MAX_RATIO, MAX_FLICKER, MAX_FLICKER_RATIO, MAX_JOINTS, MAX_SECONDS = 1.3, 2.0, 0.5, 20.0, 0.5
MAX_GROWTH = 60.0
"""Memory that the second half of a sequence may take beyond the first [MB]."""


@dataclass(frozen=True)
class Moving:
    """A recording with its truth: bodies in the camera's frame, all of the same triangles, and joints."""

    folder: Path
    bodies: list[Mesh]
    joints: np.ndarray
    camera_to_avatar: np.ndarray


def clips_of(body: Body, frames: int) -> list[tuple[Clip, int]]:
    """Clip and frame of each frame of the recording; the parts share the frames out."""
    chosen: list[tuple[Clip, int]] = []
    for part, (name, first) in enumerate(PARTS):
        clip = retarget(read_bvh(DATA / "motion" / f"{name}.bvh"), body.skeleton, in_place=True, soles=body.soles)
        count = (part + 1) * frames // len(PARTS) - part * frames // len(PARTS)
        chosen += [(clip, min(first + round(k * clip.rate / RATE), len(clip) - 1)) for k in range(count)]
    return chosen


def record(sensor: str, name: str, frames: int, folder: Path) -> Moving:
    """A recording of the body ``name`` in motion, written as an RGB-D folder with a colour image a frame."""
    body, mesh = Body(name), read_mesh(DATA / "rigged" / name / "body.ply")
    mesh = replace(mesh, colors=_painted(mesh.vertices))
    rig = with_real_optics(default_rig(sensor, DISTANCE, path_length=PATH, frames=1, seed=11))
    writer = FolderWriter(folder, rig.intrinsics, sensor)
    (folder / "color").mkdir()
    bodies, joints = [], []
    for k, (clip, frame) in enumerate(clips_of(body, frames)):
        pose = clip.pose(frame)
        vertices = skinned(mesh.vertices, body.weights, bone_matrices(body.skeleton, pose))
        simulation = simulate(replace(mesh, vertices=vertices), replace(rig, seed=1000 + k))
        writer.add(simulation.capture.depth[0])
        write_png(folder / "color" / f"{k:06d}.png", simulation.capture.color)
        if k == 0:
            writer.write_json("mirrors.json", {"mirrors": mirrors_to(simulation.capture.mirrors)})
        bodies.append(simulation.truth.body)
        joints.append(clip.joints(body.skeleton)[frame])
    return Moving(folder, bodies, np.array(joints), rig.camera_to_avatar)


def _painted(vertices: np.ndarray) -> np.ndarray:
    """Colours that show where a point of the skin is."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    waves = 0.5 + 0.25 * np.sin(40.0 * (vertices - low) / (high - low))
    return np.clip(255 * waves, 0, 255).astype(np.uint8)


def material_errors(bodies: Sequence[Mesh], made: dict[int, Mesh]) -> np.ndarray:
    """Of points of the skin, how far the surface lies outside of them in each frame (F, SAMPLES) [m]; NaN where not
    made, or farther than 4 cm."""
    chosen = np.random.default_rng(5).permutation(len(bodies[0].vertices))[:SAMPLES]
    errors = np.full((len(bodies), len(chosen)), np.nan)
    for place, mesh in made.items():
        truth = bodies[place]
        normals = vertex_normals(truth.vertices, truth.triangles)[chosen]
        tree = build_bvh(mesh.vertices, mesh.triangles)
        points = truth.vertices[chosen]
        distance, _, nearest = closest_point(tree, points, 0.04)
        found = np.isfinite(distance)
        errors[place, found] = np.einsum("ni,ni->n", nearest[found] - points[found], normals[found])
    return errors


def flicker(errors: np.ndarray) -> float:
    """Median over points and frames of how much the surface's error changes from frame to frame [mm]."""
    return 1000.0 * float(np.nanmedian(np.abs(np.diff(errors, axis=0))))


@dataclass(frozen=True)
class Made:
    """A sequence as it was made: meshes in the camera's frame, by place."""

    meshes: dict[int, Mesh]
    sound: bool
    bridged: int
    seconds: float
    steadied: float
    growth: float


def make(moving: Moving, rig: SequenceRig, use: bool) -> Made:
    """The sequence with or without the filter."""
    recording, meshes, sound, bridged, steadied = open_recording(moving.folder), {}, True, 0, []
    to_camera, memory = np.linalg.inv(rig.to_avatar), []
    started = time.perf_counter()
    for frame in reconstruct_sequence(
        recording, rig, sequence=SequenceSettings(FilterSettings(use=use), SurfaceFilterSettings(use=use))
    ):
        memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
        if frame.mesh is None or frame.report is None:
            bridged += 1
            continue
        sound &= frame.report["mesh"]["watertight"] and frame.report["mesh"]["manifold"]
        steadied.append(frame.steadied)
        meshes[frame.place] = frame.mesh.transformed(to_camera)
    seconds = (time.perf_counter() - started) / len(recording)
    own = sum(m.vertices.nbytes + m.triangles.nbytes for m in list(meshes.values())[len(meshes) // 2 :]) / 2**20
    growth = memory[-1] - memory[len(memory) // 2] - own  # what the benchmark itself keeps aside
    return Made(meshes, sound, bridged, seconds, float(np.mean(steadied)), growth)


def joint_error(moving: Moving, made: Made, rig: SequenceRig) -> float:
    """Mean distance of the joints that were followed from the true ones [mm]."""
    places = sorted(made.meshes)

    def mesh_at(place: int) -> Mesh:
        return made.meshes[place].transformed(rig.to_avatar)

    rigged = best_frame(places, mesh_at)
    clip, _ = track(rigged, places, mesh_at, RATE)
    followed = clip.joints(rigged.skeleton) - rigged.shift
    # both in the avatar frame of the virtual rig
    between = moving.camera_to_avatar @ np.linalg.inv(rig.to_avatar)
    followed = followed @ between[:3, :3].T + between[:3, 3]
    true = moving.joints[places[0] : places[-1] + 1]
    return 1000.0 * float(np.linalg.norm(followed - true, axis=2).mean())


def tables(
    quick: bool = False, sensors: Sequence[str] = SENSORS, frames: int = 0, pictures: Path | None = None
) -> Result:
    """The table, and the limits; quick: fewer frames."""
    if not (DATA / "motion").is_dir():
        say("No ../shared/data beside the checkout: no sequence is made.")
        return Result([], [Finding("sequences: every frame closed and manifold", "–", None)])
    columns = ("sensor", "frames", "bridged", "closed", "error [mm]", "alone [mm]", "flicker [mm]", "unfiltered [mm]",
               "steadied", "joints [mm]", "s a frame", "growth [MB]")  # fmt: skip
    table, findings = Table("Sequences: a moving body, every frame an avatar", columns), []
    for sensor in sensors:
        with tempfile.TemporaryDirectory() as folder:
            say(f"sequence: {sensor}")
            moving = record(sensor, "s006", frames or (QUICK if quick else FRAMES), Path(folder) / "recording")
            row, found = _measured(sensor, moving, pictures)
        table.rows.append(row)
        findings += found
    table.notes += [
        "error: mean distance, mesh to truth; alone: the same frames reconstructed as single snapshots.",
        "flicker: by how much the surface's distance from a point of the skin changes from frame to frame, median.",
    ]
    return Result([table], findings)


def _measured(sensor: str, moving: Moving, pictures: Path | None) -> tuple[tuple[str, ...], list[Finding]]:
    """A row of the table, and what it says of the limits."""
    rig = place_rig(open_recording(moving.folder))
    with_filter, without = make(moving, rig, True), make(moving, rig, False)
    checked = [place for place in sorted(with_filter.meshes) if place % 4 == 1]
    error = _mean_error(moving, {place: with_filter.meshes[place] for place in checked})
    alone = _mean_error(
        moving, {place: reconstruct(open_capture(moving.folder, str(place)), frame="camera").mesh for place in checked}
    )
    steady, plain = (flicker(material_errors(moving.bodies, made.meshes)) for made in (with_filter, without))
    joints = joint_error(moving, with_filter, rig)
    if pictures is not None:
        _picture(pictures / f"sequence_{sensor}.png", with_filter, rig)
    sound = with_filter.sound and without.sound
    row = (
        sensor, str(len(moving.bodies)), str(with_filter.bridged), "yes" if sound else "NO", number(error),
        number(alone), number(steady), number(plain), f"{with_filter.steadied:.0%}", number(joints, 1),
        number(with_filter.seconds), number(with_filter.growth, 0),
    )  # fmt: skip
    if sensor == "kinect_v1":
        limit = Finding(
            "sequence, kinect_v1: flicker ≤ 0.5 × unfiltered",
            number(steady / plain),
            steady <= MAX_FLICKER_RATIO * plain,
        )
    else:
        limit = Finding(f"sequence, {sensor}: flicker ≤ {MAX_FLICKER:g} mm", f"{steady:.2f} mm", steady <= MAX_FLICKER)
    return row, [
        Finding(f"sequence, {sensor}: every frame closed and manifold", row[3], sound),
        Finding(f"sequence, {sensor}: error ≤ {MAX_RATIO} × alone", number(error / alone), error <= MAX_RATIO * alone),
        limit,
        Finding(f"sequence, {sensor}: joints ≤ {MAX_JOINTS:g} mm", f"{joints:.1f} mm", joints <= MAX_JOINTS),
        Finding(
            f"sequence, {sensor}: ≤ {MAX_SECONDS} s a frame", f"{with_filter.seconds:.2f} s",
            with_filter.seconds <= MAX_SECONDS,
        ),
        Finding(
            f"sequence, {sensor}: memory constant", f"{with_filter.growth:.0f} MB more",
            with_filter.growth <= MAX_GROWTH,
        ),
    ]  # fmt: skip


def _mean_error(moving: Moving, meshes: dict[int, Mesh]) -> float:
    """Mean distance from the mesh to the true body over some frames [mm]."""
    return float(np.mean([evaluate(mesh, moving.bodies[place])["accuracy_mean"] for place, mesh in meshes.items()]))


def _picture(path: Path, made: Made, rig: SequenceRig) -> None:
    """Some frames side by side, from in front, from the side and from behind."""
    columns = []
    for place in sorted(made.meshes)[:: max(1, len(made.meshes) // 8)]:
        mesh = made.meshes[place].transformed(rig.to_avatar)
        strip = render_views(mesh, mesh.colors, ((0, -1, 0), (0.9, -0.4, 0), (0, 1, 0)), 180, 280)
        columns.append(np.concatenate(np.split(strip, 3, axis=1)))
    write_png(path, np.concatenate(columns, axis=1))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--sensors", nargs="+", default=SENSORS)
    parser.add_argument("--frames", type=int, default=QUICK)
    parser.add_argument("--pictures", type=Path)
    options = parser.parse_args()
    result = tables(True, options.sensors, options.frames, options.pictures)
    for shown in result.tables:
        print(f"\n{shown.text()}")
    for finding in result.findings:
        print(finding.limit, finding.measured, finding.passed)
