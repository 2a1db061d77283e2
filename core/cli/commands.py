"""What each command does."""

from __future__ import annotations

import argparse
import json
import math
import os
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import CaptureError, OutputError
from .outputs import (
    PRINT_SUFFIXES,
    AvatarFiles,
    Print,
    Writers,
    check_targets,
    level_paths,
    make_folder,
    plain,
    plan_outputs,
    read_surface,
    stand,
    write_outputs,
    write_simulation,
    writers_of,
)
from .terminal import advance, complain, distance_lines, progress_bar, say, stage_of, summary_line

if TYPE_CHECKING:
    from ..camera import Intrinsics
    from ..capture import Capture, MirrorPicks, ReadOptions
    from ..capture.frames import FrameChoice
    from ..cluster import WorkerSettings
    from ..mirrors import Mirror
    from ..mirrors.picked_mirror import MirrorSettings
    from ..pipeline import Reconstruction, Settings
    from .outputs import Write


DEMO_COLOR_SCALE = 2
"""The demo's colour image is that many times as wide as its depth image."""
CLEANING: dict[str, dict[str, float]] = {
    "outliers": {"burst_tolerance": math.inf},
    "flying": {"support": 0},
    "gaps": {"close_gaps": 0},
    "steps": {"dequantise": False},
    "smoothing": {"smoothing": 0.0},
}
"""Steps of cleaning that can be left out, and the :class:`.settings.DepthSettings` that do so."""
RIVALS = ("turntable", "cameras")
"""Experiments whose picture shows each mesh's distance to the body."""


def run_reconstruct(options: argparse.Namespace, writers: Writers) -> None:
    """``reconstruct``: make an avatar of one or several captures."""
    result, planned = avatar_to_files(options, writers)
    if not options.quiet:
        say(summary_line(result))
        for path in planned:
            say(f"  {path}")


def avatar_to_files(options: argparse.Namespace, writers: Writers) -> tuple[Reconstruction, list[Path]]:
    """Make an avatar as the options of ``reconstruct`` say; it, and the files it was written to."""
    files, outputs, levels = planned_files(options, writers)
    planned = [path for plan in (outputs, *levels) for path, _ in plan]
    result, read_ms = _reconstructed(options)
    for warning in result.warnings:
        complain("warning", warning)
    if options.measure and result.measurements is None:
        for path in [path for path in planned if path.suffix.lower() == ".csv"]:
            complain("warning", f"{path}: not written, since the body could not be measured")
            planned.remove(path)
            outputs = [(other, write) for other, write in outputs if other != path]
    if files.prints is not None and any(path.suffix.lower() in PRINT_SUFFIXES for path in options.outputs):
        for problem in files.prints.problems(result):
            complain("warning", f"print: {problem}")
    for level, plan in zip(_levels_of(result, options.levels), levels, strict=True):
        outputs += [(path, _of_level(write, level)) for path, write in plan]
    write_outputs(result, outputs, options.report, read_ms)
    return result, planned


def planned_files(
    options: argparse.Namespace, writers: Writers
) -> tuple[AvatarFiles, list[tuple[Path, Write]], list[list[tuple[Path, Write]]]]:
    """What the options of ``reconstruct`` have written, whole and by level of detail, each file with what writes it.

    Raises
    ------
    OutputError
        Something cannot be written, or nothing would come of an option.
    """
    options.skeleton = options.skeleton or options.vrm
    files = AvatarFiles(options.vrm, print_of(options), bool(options.texture), options.measure)
    outputs = plan_outputs(options.outputs, writers, files)
    levels = [
        plan_outputs(level_paths(options.outputs, number), writers, replace(files, prints=None))
        for number in range(1, len(options.levels) + 1)
    ]
    planned = [path for plan in (outputs, *levels) for path, _ in plan]
    check_targets([*planned, *([options.report] if options.report else [])])
    check_wishes(options)
    return files, outputs, levels


def check_wishes(options: argparse.Namespace) -> None:
    """Refuse options that nothing would come of."""
    printed = any(path.suffix.lower() in PRINT_SUFFIXES for path in options.outputs)
    for name in ("print_height", "hollow", "base"):
        if getattr(options, name) is not None and not printed:
            raise OutputError(f"--{name.replace('_', '-')}: is for .stl and .3mf; give such a file with -o")
    if options.remove_light and not options.texture:
        raise OutputError("--remove-light: is for textures; ask for one with --texture")
    if options.measure and options.object:
        raise OutputError("--measure: is for persons; leave out --object")


def _levels_of(result: Reconstruction, counts: Sequence[int]) -> list[Reconstruction]:
    """The avatar with fewer triangles, once for each of ``counts``."""
    if not counts:
        return []
    from ..decimation import levels_of_detail

    found = levels_of_detail(result.mesh, counts, result.texture, result.weights)
    for level, count in zip(found, counts, strict=True):
        for note in level.notes:
            complain("warning", f"level of {count} triangles: {note}")
    return [replace(result, mesh=level.mesh, texture=level.texture, weights=level.weights) for level in found]


def _of_level(write: Write, level: Reconstruction) -> Write:
    """What writes a level of detail where the others write the whole avatar."""
    return lambda target, _: write(target, level)


def known_mirrors(options: argparse.Namespace, intrinsics: Intrinsics) -> tuple[MirrorPicks | Mirror, ...] | None:
    """The mirrors of ``--mirrors``, or of ``--rig``, which counts more; None where neither is given."""
    mirrors: tuple[MirrorPicks | Mirror, ...] | None = None
    if options.mirrors:
        from ..capture.folders.rgbd_folder import read_mirrors

        mirrors = read_mirrors(options.mirrors, intrinsics)
    if options.rig:
        from ..mirrors.rig_file import mirrors_for, read_rig

        mirrors = mirrors_for(read_rig(options.rig), intrinsics)
    return mirrors


def _reconstructed(options: argparse.Namespace) -> tuple[Reconstruction, float]:
    """What the captures of a command line give, and the milliseconds that reading them took."""
    started = time.perf_counter()
    first = options.captures[0]
    if vars(options).get("register"):
        return _registered(options)
    if vars(options).get("register_step") is not None:
        raise CaptureError("--step: is for captures without poses; ask for that with --register")
    if options.poses or len(options.captures) > 1 or (first / "poses.json").is_file():
        if options.mirrors or options.rig:
            raise CaptureError("--mirrors and --rig are for one camera; keep mirrors.json with its capture")
        if options.subject:
            raise CaptureError("--subject is for one camera; with poses the subject is where the cameras' axes cross")
        from ..capture.camera_poses import open_posed_captures
        from ..pipeline.multi_camera import reconstruct_views

        captures, poses = open_posed_captures(options.captures, options.poses, *reading_of(options))
        read_ms = (time.perf_counter() - started) * 1e3
        for capture in captures:
            for note in capture.notes:
                complain("note", f"{capture.name}: {note}")
        with progress_bar(options.quiet) as progress:
            result = reconstruct_views(
                captures, poses, settings=settings_of(options), progress=progress, frame=options.frame
            )
            return result, read_ms
    capture = _open(first, options)
    mirrors = known_mirrors(options, capture.intrinsics)
    read_ms = (time.perf_counter() - started) * 1e3

    from ..pipeline import reconstruct  # brings numba; a capture that cannot be read is reported before that

    for note in capture.notes:
        complain("note", note)
    with progress_bar(options.quiet) as progress:
        return reconstruct(capture, mirrors, settings_of(options), progress=progress, frame=options.frame), read_ms


def _registered(options: argparse.Namespace) -> tuple[Reconstruction, float]:
    """:func:`_reconstructed` of captures without poses."""
    if options.poses or options.mirrors or options.rig or options.subject:
        raise CaptureError("--register finds the poses itself; leave out --poses, --mirrors, --rig and --subject")
    if len(options.captures) < 2:
        raise CaptureError("--register: one capture has nothing to be registered with; give several")
    from ..registration.pairwise import find_backend

    started = time.perf_counter()
    find_backend()  # before anything is read
    captures = [replace(_open(path, options), name=path.absolute().name) for path in options.captures]
    read_ms = (time.perf_counter() - started) * 1e3
    for capture in captures:
        for note in capture.notes:
            complain("note", f"{capture.name}: {note}")

    from ..pipeline.multi_camera import reconstruct_registered

    with progress_bar(options.quiet) as progress:
        result = reconstruct_registered(
            captures, options.register_step, settings=settings_of(options), progress=progress, frame=options.frame
        )
    if not options.quiet:
        found = result.report["registration"]
        corrected = max(pair["corrected_mm"] for pair in found["pairs"])
        say(
            f"{len(captures)} captures registered: residual {found['residual_mm']:.1f} mm, pairs corrected by up to "
            f"{corrected:.1f} mm"
        )
    return result, read_ms


def run_calibrate(options: argparse.Namespace, writers: Writers) -> None:
    """``calibrate``: place the mirrors of a rig and write a rig file."""
    check_targets([options.rig])

    from ..capture import open_capture
    from ..capture.folders.rgbd_folder import read_mirrors
    from ..mirrors.rig_file import write_rig
    from ..pipeline.rig_calibration import calibrate

    capture = open_capture(options.capture)
    known = read_mirrors(options.mirrors, capture.intrinsics) if options.mirrors else None
    rig = calibrate(capture, known, glass_of(options))
    write_rig(options.rig, rig)
    if options.quiet:
        return
    for mirror in rig.mirrors:
        error = mirror.displacement(mirror.point + 1.5 * mirror.normal)
        expected = "" if error is None else f", expected error {1000.0 * error:.1f} mm at a person 1.5 m in front of it"
        say(f"{mirror.name}: {mirror.source}, residual {1000.0 * mirror.residual:.1f} mm{expected}")
    say(f"  {options.rig}")


def run_demo(options: argparse.Namespace, writers: Writers) -> None:
    """``demo``: simulate a scan, reconstruct it and compare the result with the truth."""
    folder: Path = options.folder
    make_folder(folder)
    targets, left_out = [folder / "avatar.ply"], ""
    for name in ("avatar.blend", "avatar.glb"):
        try:
            writers_of(folder / name, writers)
            targets.append(folder / name)
        except OutputError as error:
            left_out = str(error)
    outputs = plan_outputs(targets, writers)
    report = folder / "report.json"
    check_targets([*targets, report, folder / "preview.png"])

    from ..capture import ReadOptions, open_capture
    from ..io import read_mesh
    from ..mesh.surface_distance import evaluate
    from ..pipeline import Settings, reconstruct
    from ..preview.mesh_views import render_preview
    from ..texture import TextureSettings

    with progress_bar(options.quiet) as progress:
        advance(progress, 0.0, "making a mannequin and scanning it")
        capture_folder = folder / "capture"
        write_simulation(
            capture_folder, sensor="azure_kinect", frames=10, seed=0, mirrors=2, body=None,
            optics=options.optics, frequencies=options.frequencies, color_scale=DEMO_COLOR_SCALE,
        )  # fmt: skip
        started = time.perf_counter()
        capture = open_capture(capture_folder, options=ReadOptions(native_color=True))
        read_ms = (time.perf_counter() - started) * 1e3
        settings = Settings(skeleton=True, measure=True, texture=TextureSettings())
        result = reconstruct(capture, settings=settings, progress=stage_of(progress, 0.3, 0.8))
        advance(progress, 0.8, "writing")
        write_outputs(result, outputs, report, read_ms)
        render_preview(result.mesh, folder / "preview.png", result.skeleton, result.weights, result.texture)
        advance(progress, 0.95, "comparing with the truth")
        truth = read_mesh(capture_folder / "truth" / "body.ply").transformed(result.camera_to_avatar)
        distances = evaluate(result.mesh, truth)
    for warning in result.warnings:
        complain("warning", warning)
    if options.quiet:
        return
    say(summary_line(result))
    for line in distance_lines(distances):
        say(line)
    if result.skeleton is not None:
        seconds = 1e-3 * result.report["timings_ms"]["skeleton"]
        say(f"skeleton of {len(result.skeleton.joints)} bones and skin weights in {seconds:.1f} s")
    if result.texture is not None:
        size, seconds = len(result.texture.image), 1e-3 * result.report["timings_ms"]["texture"]
        say(f"texture of {size} × {size} pixels in {seconds:.1f} s")
    say(f"written to {folder}{os.sep}")
    for path in (*targets, folder / "preview.png", report, capture_folder):
        say(f"  {path.name}{os.sep if path.is_dir() else ''}")
    if left_out:
        say(f"  without .blend and .glb: {left_out}")


def run_simulate(options: argparse.Namespace, writers: Writers) -> None:
    """``simulate``: write an RGB-D folder of a virtual scan."""
    parent = options.folder.absolute().parent
    if not parent.is_dir():
        raise OutputError(f"{options.folder}: the folder {parent} does not exist; create it first")
    with progress_bar(options.quiet) as progress:
        advance(progress, 0.0, "scanning a virtual body")
        write_simulation(
            options.folder, sensor=options.sensor, frames=options.frames, seed=options.seed, mirrors=options.mirrors,
            body=options.body, optics=options.optics, frequencies=options.frequencies, color_scale=options.color_scale,
        )  # fmt: skip
    if not options.quiet:
        say(f"{options.folder}: {options.sensor}, {options.frames} frames, {options.mirrors} mirrors, truth in truth/")


def run_inspect(options: argparse.Namespace, writers: Writers) -> None:
    """``inspect``: report what a capture holds."""
    if options.preview:
        if options.preview.suffix.lower() != ".png":
            raise OutputError(f"{options.preview}: the preview is a PNG; give a name that ends in .png")
        check_targets([options.preview])

    from ..io.images import write_png

    capture = _open(options.capture, options)
    from ..pipeline.inspection import inspect_capture, inspection_picture  # brings numba, as above

    found = inspect_capture(capture, settings_of(options))
    if options.preview:
        write_png(options.preview, inspection_picture(capture, found.cleaned))
    for line in found.lines:
        say(line)
    if options.preview:
        say(f"  {options.preview}")
    for warning in found.warnings:
        complain("warning", warning)


def run_convert(options: argparse.Namespace, writers: Writers) -> None:
    """``convert``: write a capture of any format as an RGB-D folder."""
    from ..capture.rgbd_writer import write_folder
    from ..io.atomic_files import fresh_folder

    with fresh_folder(options.folder) as fresh:
        capture = _open(options.capture, options)
        warnings = list(write_folder(fresh, capture))
    from ..pipeline.inspection import inspect_capture  # brings numba; what cannot be written is reported before that

    for note in capture.notes:
        complain("note", note)
    for warning in (*warnings, *inspect_capture(capture).warnings):
        complain("warning", warning)
    if not options.quiet:
        frames = f"{len(capture.depth)} frame{'s' if len(capture.depth) > 1 else ''}"
        say(f"{options.folder}: {frames} of {capture.format}, {capture.intrinsics.width}×{capture.intrinsics.height}")


def run_record(options: argparse.Namespace, writers: Writers) -> None:
    """``record``: record a burst of a connected camera."""
    from ..capture.live_camera import DRIVERS, record

    if options.native_color and options.camera != "realsense":
        raise CaptureError("--native-color: is for RealSense cameras; leave it out", code="camera")
    wanted: dict[str, Any] = {"native_color": True} if options.native_color else {}  # a driver need not have it
    wanted |= {"size": options.size} if options.size else {}
    with (
        progress_bar(options.quiet) as progress,
        DRIVERS[options.camera](rate=options.rate, serial=options.serial, **wanted) as stream,
    ):
        record(stream, options.folder, options.frames, progress=progress)
    if not options.quiet:
        say(f"{options.folder}: {options.frames} frames; look at it with “mirror-scan inspect {options.folder}”")


def _open(path: Path, options: argparse.Namespace) -> Capture:
    """The capture at ``path``, read as the options of :func:`.parser._add_reading` say."""
    from ..capture import open_capture

    return open_capture(path, *reading_of(options))


def reading_of(options: argparse.Namespace) -> tuple[FrameChoice, ReadOptions]:
    """Which frames to read, and what the options of :func:`.parser._add_reading` say of the file."""
    from ..capture import ReadOptions
    from ..capture.folders.lens_file import lens_options

    lens = lens_options(options.intrinsics) if options.intrinsics else {}
    reading = ReadOptions(
        depth_unit_m=options.depth_unit, disparity=options.disparity,
        kinect_calibration=options.kinect_calibration, turn_degrees=options.turn, mirrored=options.mirrored,
        min_confidence=options.min_confidence, color=not options.no_color,
        native_color=bool(vars(options).get("texture", True)), mirrors=not vars(options).get("mirrors"), **lens,
    )  # fmt: skip
    return (1 if getattr(options, "single_frame", False) else options.frames), reading


def worker_settings(options: argparse.Namespace, log: Path | None = None) -> WorkerSettings:
    """Who does the work, as ``batch`` and ``sequence`` are told; ``log``: of what workers of our own print.

    Raises
    ------
    OutputError
        Of a cluster that is there, what only workers of our own have was asked for.
    """
    from ..cluster import WorkerSettings

    memory = getattr(options, "memory", 0.0)
    if options.scheduler and (options.workers or memory):
        raise OutputError("--workers and --memory: are for this machine; a cluster has its own, leave them out")
    return WorkerSettings(
        workers=options.workers, threads=getattr(options, "threads", 0), memory_gb=memory, scheduler=options.scheduler,
        patience_s=60.0 * options.wait, log=log,
    )  # fmt: skip


def glass_of(options: argparse.Namespace) -> MirrorSettings:
    """Settings with what the options of :func:`.parser._add_glass` say, where a command has them."""
    from ..mirrors.picked_mirror import MirrorSettings

    given = vars(options)
    return MirrorSettings(
        glass_offset=given.get("glass_offset", 0.0) / 1000.0, glass_thickness=given.get("glass_thickness", 0.0) / 1000.0
    )


def settings_of(options: argparse.Namespace) -> Settings:
    """Settings with what :func:`.parser._add_cleaning` leaves out, and what a command says of subject and optics."""
    from ..closing.mesh_closing import ClosingSettings
    from ..depth.settings import DepthSettings
    from ..light.two_way_light import LightSettings
    from ..mirror_alignment.glass_alignment import BowSettings
    from ..pipeline import Settings
    from ..subject.subject_views import ViewSettings
    from ..texture import TextureSettings

    given = vars(options)
    changes: dict = {"sensor": options.sensor}
    for step in options.without:
        changes |= CLEANING[step]
    return Settings(
        depth=DepthSettings(**changes),
        mirror=glass_of(options),
        bow=BowSettings(use=given.get("bow") != "off"),
        light=LightSettings(given.get("two_way_light", "auto"), given.get("frequencies", ())),
        views=ViewSettings(click=given.get("subject"), object=given.get("object", False)),
        closing=ClosingSettings(keep_islands=given.get("keep_islands", False)),
        skeleton=given.get("skeleton", False),
        measure=given.get("measure", False),
        triangles=given.get("triangles"),
        texture=TextureSettings(given["texture"], given["remove_light"]) if given.get("texture") else None,
    )


def print_of(options: argparse.Namespace) -> Print | None:
    """What the options of :func:`.parser._add_print` say; None when they say nothing."""
    wanted = {"height_mm": options.print_height, "wall_mm": options.hollow, "base_mm": options.base}
    given = {name: value for name, value in wanted.items() if value is not None}
    if not given:
        return None
    from ..printing import PrintSettings

    return Print(PrintSettings(**given))


def run_evaluate(options: argparse.Namespace, writers: Writers) -> None:
    """``evaluate``: measure a mesh against the true one."""
    from ..mesh.surface_distance import evaluate

    distances = evaluate(read_surface(options.mesh), read_surface(options.truth))
    if options.json:
        say(json.dumps(plain(distances), indent=1))
    else:
        for line in distance_lines(distances):
            say(line)


def run_experiment_zippering(options: argparse.Namespace, writers: Writers) -> None:
    """``experiment zippering``: what zippering costs."""
    make_folder(options.folder)
    check_targets([options.folder / name for name in ("table.csv", "result.png", "plot.png")])

    from ..experiments.zippering import run, table, write_results
    from ..simulation.mannequin import mannequin

    with progress_bar(options.quiet) as progress:
        advance(progress, 0.0, "reading the body" if options.mesh else "making a mannequin")
        body = read_surface(options.mesh) if options.mesh else mannequin()
        bridge = options.find_bridge() if options.find_bridge else None
        steps = run(body, options.steps, options.matching, progress=stage_of(progress, 0.05, 0.95), bridge=bridge)
        advance(progress, 0.95, "writing")
        paths, note = write_results(steps, body, options.folder)
    for step in steps:
        for warning in step.notes:
            complain("warning", f"{step.decimation:g} %: {warning}")
    if options.quiet:
        return
    lines = [
        *table(steps, body),
        "distances between the surfaces, of both directions the larger; % of the body's height",
    ]
    if bridge is None:
        lines.append(
            "without Blender's Bridge Edge Loops for comparison: bpy cannot be imported here; “pip install bpy”"
        )
    _say_results(lines, paths, note)


def run_experiment_capture(options: argparse.Namespace, writers: Writers) -> None:
    """``experiment reflection``, ``distance``, ``turntable`` and ``cameras``: with virtual captures of a body."""
    import importlib

    make_folder(options.folder)
    check_targets([options.folder / name for name in ("table.csv", "result.png", "plot.png")])
    experiment = importlib.import_module(f"..experiments.{options.experiment}", __package__)

    from ..simulation.mannequin import mannequin
    from ..simulation.optics import IDEAL, real

    own = {}
    if options.experiment == "turntable":
        own = {"sways": [1e-3 * sway for sway in options.sways], "scans": options.scans}
    with progress_bar(options.quiet) as progress:
        advance(progress, 0.0, "reading the body" if options.mesh else "making a mannequin")
        body = stand(read_surface(options.mesh), options.mesh) if options.mesh else mannequin()
        optics = real(options.sensor, options.frequencies, options.seed) if options.optics == "real" else IDEAL
        outcome = experiment.run(
            body, options.sensor, options.frames, options.seed, optics=optics, progress=stage_of(progress, 0.05, 0.95),
            **own,
        )  # fmt: skip
        advance(progress, 0.95, "writing")
        drawn_on = (body,) if options.experiment in RIVALS else ()
        paths, note = experiment.write_results(outcome, *drawn_on, options.folder)
    if not options.quiet:
        _say_results(experiment.table(outcome), paths, note)


def _say_results(lines: list[str], paths: list[Path], note: str) -> None:
    """An experiment's table, and the files it was written to; the note says why one is missing."""
    for line in (*lines, *(f"  {path}" for path in paths)):
        say(line)
    if note:
        say(f"  {note}")
