"""Sequences: a body that dances, turns and raises its arms before the virtual rig; every frame a closed avatar.

Bodies of ``../shared/data/rigged`` are moved by ``../shared/data/motion`` at 15 frames a second, with real optics.
``python -m benchmarks.many_sequence [--sensors kinect_v1 …] [--frames N] [--pictures DIR]`` prints the table alone.
"""

from __future__ import annotations

import argparse
import mmap
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mirror_scan.core.avatar.pose import Pose, bone_matrices, posed_joints, skinned
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.capture import open_capture
from mirror_scan.core.capture.folders.rgbd_folder import mirrors_to
from mirror_scan.core.capture.rgbd_writer import FolderWriter
from mirror_scan.core.io import read_mesh
from mirror_scan.core.io.images import write_png
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.bvh import build_bvh, closest_point
from mirror_scan.core.mesh.normals import vertex_normals
from mirror_scan.core.mesh.surface_distance import evaluate
from mirror_scan.core.motion import read_bvh, retarget
from mirror_scan.core.numeric.rotations import between
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

from .machine import installed, say
from .results import Finding, Result, Table, number
from .rig_motion import DATA, Body

SENSORS = ("kinect_v1", "azure_kinect")
RATE = 15.0
FRAMES, QUICK = 60, 10
LONG, QUICK_LONG = 300, 100
"""Frames over which memory is watched."""
PARTS = (("squat_armsup_apose_m", 30), ("dance_rokoko_cm", 0), ("jumps_turn_cgspeed", 150))
"""Motions that follow each other, and the frame that each begins with: arms are raised; a dance; a turn."""
SHORTEST, CHANGE = 15, 8
"""Frames of a part at least; and those in which the body goes over from one part to the next."""
DISTANCE, PATH = 2.7, 4.8
"""Camera to subject, and by way of a mirror [m]: raised arms are in the picture."""
SAMPLES = 4000
"""Points of the skin that are followed."""
MAX_RATIO, MAX_FLICKER, MAX_FLICKER_RATIO, MAX_JOINTS, MAX_SECONDS = 1.3, 2.0, 0.5, 20.0, 0.5
MAX_GROWTH = 60.0
"""Memory that the end of a long sequence may take beyond its beginning [MB]."""


@dataclass(frozen=True)
class Moving:
    """A recording with its truth: bodies in the camera's frame, all of the same triangles, and joints."""

    folder: Path
    bodies: list[Mesh]
    joints: np.ndarray
    camera_to_avatar: np.ndarray


def poses_of(body: Body, frames: int) -> list[Pose]:
    """The body's pose in each frame of the recording.

    The parts share the frames out; a short recording has the first part alone. From part to part the body moves within
    half a second, as nobody jumps from one pose to another.
    """
    poses: list[Pose] = []
    parts = PARTS[: max(1, min(len(PARTS), frames // SHORTEST))]
    for part, (name, first) in enumerate(parts):
        clip = retarget(read_bvh(DATA / "motion" / f"{name}.bvh"), body.skeleton, in_place=True, soles=body.soles)
        count = (part + 1) * frames // len(parts) - part * frames // len(parts)
        last = poses[-1] if poses else None
        for k in range(count):
            pose = clip.pose(min(first + round(k * clip.rate / RATE), len(clip) - 1))
            if last is not None and k < CHANGE:
                share = (k + 1) / (CHANGE + 1)
                share *= share * (3.0 - 2.0 * share)
                pose = Pose(
                    between(last.rotations, pose.rotations, share),
                    last.translation + share * (pose.translation - last.translation),
                )
            poses.append(pose)
    return poses


def record(sensor: str, name: str, frames: int, folder: Path) -> Moving:
    """A recording of the body ``name`` in motion, written as an RGB-D folder with a colour image a frame."""
    body, mesh = Body(name), read_mesh(DATA / "rigged" / name / "body.ply")
    mesh = replace(mesh, colors=_painted(mesh.vertices))
    rig = with_real_optics(default_rig(sensor, DISTANCE, path_length=PATH, frames=1, seed=11))
    writer = FolderWriter(folder, rig.intrinsics, sensor)
    (folder / "color").mkdir()
    bodies, joints = [], []
    for k, pose in enumerate(poses_of(body, frames)):
        vertices = skinned(mesh.vertices, body.weights, bone_matrices(body.skeleton, pose))
        simulation = simulate(replace(mesh, vertices=vertices), replace(rig, seed=1000 + k))
        writer.add(simulation.capture.depth[0])
        write_png(folder / "color" / f"{k:06d}.png", simulation.capture.color)
        if k == 0:
            writer.write_json("mirrors.json", {"mirrors": mirrors_to(simulation.capture.mirrors)})
        bodies.append(simulation.truth.body)
        joints.append(posed_joints(body.skeleton, pose))
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
    """A sequence as it was made: meshes in the camera's frame, by place; seconds of the clock, and of the processor."""

    meshes: dict[int, Mesh]
    sound: bool
    bridged: int
    seconds: float
    cpu: float
    steadied: float


def settings_of(use: bool) -> SequenceSettings:
    """With the filters, or without."""
    return SequenceSettings(FilterSettings(use=use), SurfaceFilterSettings(use=use))


def make(moving: Moving, rig: SequenceRig, use: bool) -> Made:
    """The sequence with or without the filter."""
    recording, meshes, sound, bridged, steadied = open_recording(moving.folder), {}, True, 0, []
    to_camera = np.linalg.inv(rig.to_avatar)
    list(
        reconstruct_sequence(replace(recording, numbers=recording.numbers[:2]), rig, sequence=settings_of(use))
    )  # warm
    started, started_cpu = time.perf_counter(), time.process_time()
    for frame in reconstruct_sequence(recording, rig, sequence=settings_of(use)):
        if frame.mesh is None or frame.report is None:
            bridged += 1
            continue
        sound &= frame.report["mesh"]["watertight"] and frame.report["mesh"]["manifold"]
        steadied.append(frame.steadied)
        meshes[frame.place] = frame.mesh.transformed(to_camera)
    seconds, cpu = time.perf_counter() - started, time.process_time() - started_cpu
    count = len(recording)
    return Made(meshes, sound, bridged, seconds / count, cpu / count, float(np.mean(steadied)))


def by_workers(moving: Moving, rig: SequenceRig) -> float | None:
    """Seconds a frame with two worker processes of one thread each, kernels loaded before; None without Dask."""
    if not installed("distributed"):
        return None
    from mirror_scan.core.cluster import WorkerSettings, start_workers

    recording = open_recording(moving.folder)
    with start_workers(WorkerSettings(workers=2, threads=1)) as runner:
        first = replace(recording, numbers=recording.numbers[:4])
        list(reconstruct_sequence(first, rig, sequence=settings_of(True), runner=runner))
        started = time.perf_counter()
        list(reconstruct_sequence(recording, rig, sequence=settings_of(True), runner=runner))
        return (time.perf_counter() - started) / len(recording)


def growth(moving: Moving, rig: SequenceRig, frames: int, folder: Path) -> float | None:
    """Memory that the last fifth of a long recording takes beyond its second fifth [MB]; None where it is not told.

    The frames go to and fro, every other pixel of them, which makes a long recording cheap: what a frame leaves behind
    does not depend on how large it is.
    """
    statm = Path("/proc/self/statm")
    if not statm.is_file():
        return None
    camera = open_capture(moving.folder, "0").intrinsics
    small = Intrinsics(
        camera.width // 2, camera.height // 2, camera.fx / 2, camera.fy / 2, camera.cx / 2, camera.cy / 2
    )
    writer = FolderWriter(folder, small, rig.scene.principle.sensor)
    (folder / "color").mkdir()
    count = len(moving.bodies)
    for k in range(frames):
        there = k % (2 * count - 2) if count > 1 else 0
        shown = open_capture(moving.folder, str(min(there, 2 * count - 2 - there)))
        writer.add(shown.depth[0][: 2 * small.height : 2, : 2 * small.width : 2])
        write_png(folder / "color" / f"{k:06d}.png", shown.color[: 2 * small.height : 2, : 2 * small.width : 2])
    still = replace(
        rig,
        background=np.ascontiguousarray(rig.background[: 2 * small.height : 2, : 2 * small.width : 2]),
        color=None,
    )
    memory, page = [], mmap.PAGESIZE / 2**20
    for frame in reconstruct_sequence(open_recording(folder), still, sequence=settings_of(True)):
        memory.append(int(statm.read_text().split()[1]) * page)
        if frame.place % 50 == 49:
            say(f"  {frame.place + 1} of {frames} frames, {memory[-1]:.0f} MB")
    fifth = len(memory) // 5
    return float(np.median(memory[-fifth:]) - np.median(memory[fifth : 2 * fifth]))


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
    """The tables, and the limits; quick: fewer frames."""
    if not (DATA / "motion").is_dir():
        say("No ../shared/data beside the checkout: no sequence is made.")
        return Result([], [Finding("sequences: every frame closed and manifold", "–", None)])
    columns = ("sensor", "frames", "bridged", "closed", "error [mm]", "alone [mm]", "flicker [mm]", "unfiltered [mm]",
               "steadied", "joints [mm]")  # fmt: skip
    table = Table("Sequences: a moving body, every frame an avatar", columns)
    times = Table("Sequences: seconds a frame", ("sensor", "frames", "two threads", "two workers", "of the processor"))
    findings: list[Finding] = []
    for k, sensor in enumerate(sensors):
        with tempfile.TemporaryDirectory() as folder:
            count = frames or (QUICK if quick else FRAMES)
            say(f"sequence, {sensor}: recording {count} frames")
            moving = record(sensor, "s006", count, Path(folder) / "recording")
            say(f"sequence, {sensor}: placing the mirrors")
            rig = place_rig(open_recording(moving.folder))
            row, found, made = _measured(sensor, moving, rig, pictures)
            say(f"sequence, {sensor}: two workers")
            by_two = by_workers(moving, rig)
            if k == 0:
                long = QUICK_LONG if quick else LONG
                say(f"sequence, {sensor}: memory over {long} frames")
                more = growth(moving, rig, long, Path(folder) / "long")
                found.append(
                    Finding(
                        f"sequence: memory constant over {long} frames", f"{number(more, 0)} MB more",
                        None if more is None else more <= MAX_GROWTH,
                    )
                )  # fmt: skip
        table.rows.append(row)
        times.rows.append((sensor, str(count), number(made.seconds), number(by_two), number(made.cpu)))
        found.append(_speed(sensor, made.seconds, by_two))
        findings += found
    table.notes += [
        "error: mean distance, mesh to truth; alone: the same frames reconstructed as single snapshots.",
        "flicker: by how much the surface's distance from a point of the skin changes from frame to frame, median.",
    ]
    times.notes.append("With the filters, warm; of the processor: of one core, with two threads.")
    return Result([table, times], findings)


def _speed(sensor: str, threads: float, workers: float | None) -> Finding:
    seconds = min(threads, threads if workers is None else workers)
    return Finding(f"sequence, {sensor}: ≤ {MAX_SECONDS} s a frame", f"{seconds:.2f} s", seconds <= MAX_SECONDS)


def _measured(
    sensor: str, moving: Moving, rig: SequenceRig, pictures: Path | None
) -> tuple[tuple[str, ...], list[Finding], Made]:
    """A row of the table, what it says of the limits, and the sequence."""
    say(f"sequence, {sensor}: with the filters")
    with_filter = make(moving, rig, True)
    say(f"sequence, {sensor}: without")
    without = make(moving, rig, False)
    say(f"sequence, {sensor}: frames alone, errors")
    checked = [place for place in sorted(with_filter.meshes) if place % 4 == 1]
    error = _mean_error(moving, {place: with_filter.meshes[place] for place in checked})
    alone = _mean_error(
        moving, {place: reconstruct(open_capture(moving.folder, str(place)), frame="camera").mesh for place in checked}
    )
    steady, plain = (flicker(material_errors(moving.bodies, made.meshes)) for made in (with_filter, without))
    say(f"sequence, {sensor}: joints")
    joints = joint_error(moving, with_filter, rig)
    if pictures is not None:
        _picture(pictures / f"sequence_{sensor}.png", with_filter, rig)
    sound = with_filter.sound and without.sound
    row = (
        sensor, str(len(moving.bodies)), str(with_filter.bridged), "yes" if sound else "NO", number(error),
        number(alone), number(steady), number(plain), f"{with_filter.steadied:.0%}", number(joints, 1),
    )  # fmt: skip
    if sensor == "kinect_v1":
        limit = Finding(
            "sequence, kinect_v1: flicker ≤ 0.5 × unfiltered",
            f"{steady / plain:.2f} ×",
            steady <= MAX_FLICKER_RATIO * plain,
        )
    else:
        limit = Finding(f"sequence, {sensor}: flicker ≤ {MAX_FLICKER:g} mm", f"{steady:.2f} mm", steady <= MAX_FLICKER)
    return (
        row,
        [
            Finding(f"sequence, {sensor}: every frame closed and manifold", row[3], sound),
            Finding(
                f"sequence, {sensor}: error ≤ {MAX_RATIO} × alone", f"{error / alone:.2f} ×", error <= MAX_RATIO * alone
            ),
            limit,
            Finding(f"sequence, {sensor}: joints ≤ {MAX_JOINTS:g} mm", f"{joints:.1f} mm", joints <= MAX_JOINTS),
        ],
        with_filter,
    )


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
