"""The command line, one parser for ``mirror-scan …`` and ``blender --command mirror_scan …``.

Heavy modules are imported inside the commands, so that ``--help`` answers at once. Formats that need Blender come in
from outside as ``writers``; nothing here knows bpy.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .errors import CaptureError, MirrorScanError, OutputError

if TYPE_CHECKING:
    from .capture import Capture, FrameChoice, ReadOptions
    from .mesh import Mesh
    from .pipeline import Progress, Reconstruction, Settings

Writers = Mapping[str, Callable[["Path", "Reconstruction"], object]]

BLENDER_SUFFIXES = (".blend", ".glb", ".fbx")
PLAIN_SUFFIXES = (".ply", ".obj", ".stl")
SENSORS = ("ideal", "kinect_v1", "azure_kinect", "femto_bolt", "realsense_d455")
CAMERAS = ("realsense",)
DEMO_FOLDER = "mirror_scan_demo"
EXPERIMENT_FOLDER = "{}_experiment"
CLEANING = {"outliers": {"burst_tolerance": math.inf}, "flying": {"support": 0}, "gaps": {"close_gaps": 0},
            "steps": {"dequantise": False}, "smoothing": {"smoothing": 0.0}}  # fmt: skip
"""Steps of cleaning that can be left out, and the :class:`.depth.DepthSettings` that do so."""
SIMULATION_ENTRIES = {"intrinsic.json", "mirrors.json", "depth", "color", "truth"}


def main(
    argv: Sequence[str] | None = None,
    *,
    prog: str = "mirror-scan",
    writers: Writers | None = None,
    find_bridge: Callable[[], Callable[[Mesh], Mesh] | None] | None = None,
) -> int:
    """Run one command.

    Parameters
    ----------
    argv : sequence of str or None
        Arguments after the program's name; None takes them from the process.
    prog : str
        How the user called it, for help and usage.
    writers : mapping or None
        Suffix (".blend") → ``function(path, reconstruction)`` for formats core cannot write; looking one up may raise
        :class:`OutputError` to say why it cannot be had.
    find_bridge : function() or None
        Gives Blender's way of closing patches, for the zippering experiment; None where there is no Blender.

    Returns
    -------
    int
        0 done; 1 the input or the scene is at fault, told in one line on stderr; 2 usage; 130 interrupted; 141 its
        reader went away.
    """
    try:
        options = build_parser(prog).parse_args(argv)
    except SystemExit as stop:  # argparse has said what there is to say
        return stop.code if isinstance(stop.code, int) else 2
    options.find_bridge = find_bridge
    try:
        options.run(options, writers or {})
    except MirrorScanError as error:
        _complain("error", str(error))
        return 1
    except KeyboardInterrupt:
        _complain("error", "interrupted; nothing was written")
        return 130
    except BrokenPipeError:  # the reader of a pipe had enough; keep Python from stumbling over it again at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    return 0


def build_parser(prog: str) -> argparse.ArgumentParser:
    """The parser of all commands; each sets ``run`` to its function."""
    parser = argparse.ArgumentParser(
        prog=prog, description="One depth camera, two mirrors, one snapshot: a closed, coloured avatar."
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    command = commands.add_parser("reconstruct", help="make an avatar of a capture")
    command.add_argument(
        "captures", metavar="CAPTURE", type=Path, nargs="+",
        help="folder with intrinsic.json and depth/*.png; several with --poses, or one folder of them with poses.json",
    )  # fmt: skip
    command.add_argument(
        "-o", dest="outputs", metavar="OUT", type=Path, action="append", required=True,
        help="file to write, by suffix: .ply .obj .stl, with Blender also .blend .glb .fbx; may be given several times",
    )  # fmt: skip
    command.add_argument("--mirrors", metavar="FILE", type=Path, help="mirrors.json to use instead of the capture's")
    command.add_argument("--rig", metavar="FILE", type=Path, help="rig file of “calibrate” to take the mirrors from")
    command.add_argument("--poses", metavar="FILE", type=Path, help="poses.json of several cameras, by capture")
    command.add_argument(
        "--subject", metavar="U,V", type=_pixel, help="pixel of the depth image on the subject, where another is chosen"
    )
    command.add_argument("--object", action="store_true", help="the subject is any thing: cut off what it stands on")
    command.add_argument("--keep-islands", action="store_true", help="keep pieces that nothing connects to the body")
    command.add_argument("--report", metavar="FILE", type=Path, help="write what was found and measured, as JSON")
    command.add_argument("--frame", choices=("avatar", "camera"), default="avatar", help="coordinates (default avatar)")
    command.add_argument("--single-frame", action="store_true", help="use only the first depth frame of a burst")
    _add_reading(command)
    _add_cleaning(command)
    command.add_argument("--quiet", action="store_true", help="say nothing but warnings and errors")
    command.set_defaults(run=_reconstruct)

    command = commands.add_parser("calibrate", help="place the mirrors of a rig once, for all its later captures")
    command.add_argument("capture", metavar="CAPTURE", type=Path, help="capture of the rig, best with nobody in it")
    command.add_argument(
        "-o", dest="rig", metavar="RIG", type=Path, required=True, help="rig file to write, for “reconstruct --rig”"
    )
    command.add_argument("--mirrors", metavar="FILE", type=Path, help="mirrors.json to use instead of the capture's")
    command.add_argument("--quiet", action="store_true", help="say nothing but warnings and errors")
    command.set_defaults(run=_calibrate)

    command = commands.add_parser("demo", help="scan a virtual person and reconstruct it")
    command.add_argument(
        "folder", metavar="DIR", type=Path, nargs="?", default=Path(DEMO_FOLDER),
        help=f"where to put everything (default {DEMO_FOLDER})",
    )  # fmt: skip
    command.add_argument("--quiet", action="store_true", help="say nothing but warnings and errors")
    command.set_defaults(run=_demo)

    command = commands.add_parser("simulate", help="write an RGB-D folder of a virtual scan, with its truth")
    command.add_argument("folder", metavar="DIR", type=Path, help="folder to write; an earlier simulation is replaced")
    command.add_argument("--sensor", choices=SENSORS, default="azure_kinect", help="depth camera, default azure_kinect")
    command.add_argument("--frames", metavar="N", type=_whole(1, 300), default=10, help="of the burst, default 10")
    command.add_argument("--seed", metavar="N", type=_whole(0, 2**32 - 1), default=0, help="of the noise, default 0")
    command.add_argument("--mirrors", metavar="N", type=_whole(1, 8), default=2, help="number of mirrors, default 2")
    command.add_argument("--body", metavar="FILE", type=Path, help="mesh to scan, Z up, in metres; default a mannequin")
    command.add_argument("--quiet", action="store_true", help="say nothing but warnings and errors")
    command.set_defaults(run=_simulate)

    command = commands.add_parser("inspect", help="say what a capture holds, and whether it can be right")
    command.add_argument("capture", metavar="CAPTURE", type=Path, help="folder or file of a depth camera")
    _add_reading(command)
    _add_cleaning(command)
    command.add_argument(
        "-o", dest="preview", metavar="PNG", type=Path, help="write a picture of depth, colour and cleaned depth"
    )
    command.set_defaults(run=_inspect)

    command = commands.add_parser("convert", help="write a capture of any format as an RGB-D folder")
    command.add_argument("capture", metavar="CAPTURE", type=Path, help="folder or file of a depth camera")
    _add_reading(command)
    command.add_argument("folder", metavar="DIR", type=Path, help="folder to make")
    command.add_argument("--quiet", action="store_true", help="say nothing but warnings and errors")
    command.set_defaults(run=_convert)

    command = commands.add_parser("record", help="record a burst of a camera that is connected")
    command.add_argument("folder", metavar="DIR", type=Path, help="folder to make")
    command.add_argument("--camera", choices=CAMERAS, default=CAMERAS[0], help=f"driver, default {CAMERAS[0]}")
    command.add_argument("--serial", metavar="NUMBER", help="of the camera, where there are several")
    command.add_argument("--frames", metavar="N", type=_whole(1, 300), default=30, help="of the burst, default 30")
    command.add_argument(
        "--size", metavar="WxH", type=_size, default=(848, 480), help="of the depth picture, default 848x480"
    )
    command.add_argument("--rate", metavar="HZ", type=_whole(1, 120), default=30, help="frames a second, default 30")
    command.add_argument("--quiet", action="store_true", help="say nothing but warnings and errors")
    command.set_defaults(run=_record)

    command = commands.add_parser("evaluate", help="measure a mesh against the true one")
    command.add_argument("mesh", metavar="MESH", type=Path, help=".ply, .obj or .stl")
    command.add_argument("truth", metavar="TRUTH", type=Path, help="the true surface, in the same frame and unit")
    command.add_argument("--json", action="store_true", help="print JSON instead of a table")
    command.set_defaults(run=_evaluate)

    experiments = commands.add_parser("experiment", help="repeat an experiment of the paper").add_subparsers(
        title="experiments", metavar="EXPERIMENT", required=True
    )
    command = experiments.add_parser("zippering", help="what zippering costs: cut a body in three, thin its back, sew")
    command.add_argument(
        "mesh", metavar="MESH", type=Path, nargs="?",
        help="closed body, Z up, facing -Y, in metres; default a mannequin",
    )  # fmt: skip
    command.add_argument(
        "-o", dest="folder", metavar="DIR", type=Path, default=Path(EXPERIMENT_FOLDER.format("zippering")),
        help=f"where to put table.csv, result.png and plot.png (default {EXPERIMENT_FOLDER.format('zippering')})",
    )  # fmt: skip
    command.add_argument(
        "--steps", metavar="PERCENT", type=_percentages, default=(0, 10, 20, 30, 40, 50),
        help="vertices to take from the back, separated by commas (default 0,10,20,30,40,50)",
    )  # fmt: skip
    command.add_argument(
        "--matching", choices=("auto", "planes", "facing"), default="auto",
        help="begin with the paper's planes, never use them, or let the figure decide (default)",
    )  # fmt: skip
    command.add_argument("--quiet", action="store_true", help="say nothing but warnings and errors")
    command.set_defaults(run=_experiment_zippering)

    for name, words in (
        ("reflection", "what a mirror costs: the same back by way of a mirror and directly, over the same path"),
        ("distance", "what distance costs: the same figure from 3 to 5 m"),
    ):
        command = experiments.add_parser(name, help=words)
        command.add_argument(
            "mesh", metavar="MESH", type=Path, nargs="?", help="body, Z up, in metres; default a mannequin"
        )
        command.add_argument(
            "-o", dest="folder", metavar="DIR", type=Path, default=Path(EXPERIMENT_FOLDER.format(name)),
            help=f"where to put table.csv, result.png and plot.png (default {EXPERIMENT_FOLDER.format(name)})",
        )  # fmt: skip
        command.add_argument(
            "--sensor", choices=SENSORS, default="kinect_v1", help="depth camera, default the paper's kinect_v1"
        )
        command.add_argument(
            "--frames", metavar="N", type=_whole(1, 100), default=10, help="of each burst, default the paper's 10"
        )
        command.add_argument("--seed", metavar="N", type=_whole(0, 2**32 - 1), default=0, help="of the noise")
        command.add_argument("--quiet", action="store_true", help="say nothing but warnings and errors")
        command.set_defaults(run=_experiment_capture, experiment=name)
    return parser


def _add_reading(command: argparse.ArgumentParser) -> None:
    """What a file cannot say of itself."""
    group = command.add_argument_group("reading", "what the file cannot say, or says wrongly")
    group.add_argument("--frames", metavar="A:B", help="frames to read: 5 the sixth alone, 10: from the eleventh on")
    group.add_argument("--intrinsics", metavar="FILE", type=Path, help="intrinsic.json of the depth camera")
    group.add_argument("--depth-unit", metavar="METRES", type=float, help="what one unit of depth means (0.001 = 1 mm)")
    group.add_argument("--turn", type=int, choices=(0, 90, 180, 270), help="clockwise degrees that make it upright")
    group.add_argument(
        "--mirrored", action=argparse.BooleanOptionalAction, default=None, help="left and right are exchanged, or not"
    )
    group.add_argument(
        "--disparity", choices=("factory", "linear", "tangent"), default="factory",
        help="formula of raw Kinect v1 values (default factory)",
    )  # fmt: skip
    group.add_argument(
        "--kinect-calibration", choices=("factory", "burrus"), default="factory", help="of a Kinect v1 that brings none"
    )
    group.add_argument(
        "--min-confidence", type=int, choices=(0, 1, 2), default=1, help="drop what the camera trusts less, default 1"
    )
    group.add_argument("--no-color", action="store_true", help="go without colour")


def _add_cleaning(command: argparse.ArgumentParser) -> None:
    group = command.add_argument_group("cleaning")
    group.add_argument(
        "--sensor", default="auto", help="noise model to use: auto (default), unknown, or a sensor's name, as kinect_v1"
    )
    group.add_argument(
        "--without", metavar="STEP", action="append", choices=tuple(CLEANING), default=[],
        help=f"leave out a step: {', '.join(CLEANING)}; may be given several times",
    )  # fmt: skip


# --- commands --------------------------------------------------------------------------------------------------------


def _reconstruct(options: argparse.Namespace, writers: Writers) -> None:
    outputs = _plan_outputs(options.outputs, writers)
    _check_targets([*options.outputs, *([options.report] if options.report else [])])

    result, read_ms = _reconstructed(options)
    for warning in result.warnings:
        _complain("warning", warning)
    _write_outputs(result, outputs, options.report, read_ms)
    if not options.quiet:
        _say(_summary(result))
        for path, _ in outputs:
            _say(f"  {path}")


def _reconstructed(options: argparse.Namespace) -> tuple[Reconstruction, float]:
    """What the captures of a command line give, and the milliseconds that reading them took."""
    from .capture.rgbd_folder import read_mirrors

    started = time.perf_counter()
    first = options.captures[0]
    if options.poses or len(options.captures) > 1 or (first / "poses.json").is_file():
        if options.mirrors or options.rig:
            raise CaptureError("--mirrors and --rig are for one camera; keep mirrors.json beside the capture it is of")
        if options.subject:
            raise CaptureError("--subject is for one camera; with poses the subject is where the cameras' axes cross")
        from .poses import open_posed_captures, reconstruct_views

        captures, poses = open_posed_captures(options.captures, options.poses, *_reading(options))
        read_ms = (time.perf_counter() - started) * 1e3
        for capture in captures:
            for note in capture.notes:
                _complain("note", f"{capture.name}: {note}")
        with _progress(options.quiet) as progress:
            result = reconstruct_views(
                captures, poses, settings=_settings(options), progress=progress, frame=options.frame
            )
            return result, read_ms
    capture = _open(first, options)
    mirrors = read_mirrors(options.mirrors, capture.intrinsics) if options.mirrors else None
    if options.rig:
        from .rig_file import mirrors_for, read_rig

        mirrors = mirrors_for(read_rig(options.rig), capture.intrinsics)
    read_ms = (time.perf_counter() - started) * 1e3

    from .pipeline import reconstruct  # brings numba; a capture that cannot be read is told before that

    for note in capture.notes:
        _complain("note", note)
    with _progress(options.quiet) as progress:
        return reconstruct(capture, mirrors, _settings(options), progress=progress, frame=options.frame), read_ms


def _calibrate(options: argparse.Namespace, writers: Writers) -> None:
    _check_targets([options.rig])

    from .capture import open_capture
    from .capture.rgbd_folder import read_mirrors
    from .rig_file import calibrate, write_rig

    capture = open_capture(options.capture)
    rig = calibrate(capture, read_mirrors(options.mirrors, capture.intrinsics) if options.mirrors else None)
    write_rig(options.rig, rig)
    if options.quiet:
        return
    for mirror in rig.mirrors:
        sure = mirror.displacement(mirror.point + 1.5 * mirror.normal)
        expected = "" if sure is None else f", expected error {1000.0 * sure:.1f} mm at a person 1.5 m before it"
        _say(f"{mirror.name}: {mirror.source}, residual {1000.0 * mirror.residual:.1f} mm{expected}")
    _say(f"  {options.rig}")


def _demo(options: argparse.Namespace, writers: Writers) -> None:
    folder: Path = options.folder
    _make_folder(folder)
    targets, left_out = [folder / "avatar.ply"], ""
    for name in ("avatar.blend", "avatar.glb"):
        try:
            _writer(folder / name, writers)
            targets.append(folder / name)
        except OutputError as error:
            left_out = str(error)
    outputs = _plan_outputs(targets, writers)
    report = folder / "report.json"
    _check_targets([*targets, report, folder / "preview.png"])

    from .capture import open_capture
    from .io import read_mesh
    from .metrics import evaluate
    from .pipeline import reconstruct
    from .preview import render_preview

    with _progress(options.quiet) as progress:
        _advance(progress, 0.0, "making a mannequin and scanning it")
        capture_folder = folder / "capture"
        _write_simulation(capture_folder, sensor="azure_kinect", frames=10, seed=0, mirrors=2, body=None)
        started = time.perf_counter()
        capture = open_capture(capture_folder)
        read_ms = (time.perf_counter() - started) * 1e3
        result = reconstruct(capture, progress=_part(progress, 0.3, 0.8))
        _advance(progress, 0.8, "writing")
        _write_outputs(result, outputs, report, read_ms)
        render_preview(result.mesh, folder / "preview.png")
        _advance(progress, 0.95, "comparing with the truth")
        truth = read_mesh(capture_folder / "truth" / "body.ply").transformed(result.camera_to_avatar)
        distances = evaluate(result.mesh, truth)
    for warning in result.warnings:
        _complain("warning", warning)
    if options.quiet:
        return
    _say(_summary(result))
    for line in _distance_lines(distances):
        _say(line)
    _say(f"written to {folder}{os.sep}")
    for path in (*targets, folder / "preview.png", report, capture_folder):
        _say(f"  {path.name}{os.sep if path.is_dir() else ''}")
    if left_out:
        _say(f"  without .blend and .glb: {left_out}")


def _simulate(options: argparse.Namespace, writers: Writers) -> None:
    parent = options.folder.absolute().parent
    if not parent.is_dir():
        raise OutputError(f"{options.folder}: the folder {parent} does not exist; create it first")
    with _progress(options.quiet) as progress:
        _advance(progress, 0.0, "scanning a virtual body")
        _write_simulation(
            options.folder, sensor=options.sensor, frames=options.frames, seed=options.seed, mirrors=options.mirrors,
            body=options.body,
        )  # fmt: skip
    if not options.quiet:
        _say(f"{options.folder}: {options.sensor}, {options.frames} frames, {options.mirrors} mirrors, truth in truth/")


def _inspect(options: argparse.Namespace, writers: Writers) -> None:
    if options.preview:
        if options.preview.suffix.lower() != ".png":
            raise OutputError(f"{options.preview}: the preview is a PNG; give a name that ends in .png")
        _check_targets([options.preview])

    from .images import write_png

    capture = _open(options.capture, options)
    from .inspection import inspect_capture, inspection_picture  # brings numba, as above

    found = inspect_capture(capture, _settings(options))
    if options.preview:
        write_png(options.preview, inspection_picture(capture, found.cleaned))
    for line in found.lines:
        _say(line)
    if options.preview:
        _say(f"  {options.preview}")
    for warning in found.warnings:
        _complain("warning", warning)


def _convert(options: argparse.Namespace, writers: Writers) -> None:
    from .capture.writing import write_folder
    from .files import fresh_folder

    with fresh_folder(options.folder) as fresh:
        capture = _open(options.capture, options)
        write_folder(fresh, capture)
    for note in capture.notes:
        _complain("note", note)
    if not options.quiet:
        frames = f"{len(capture.depth)} frame{'s' if len(capture.depth) > 1 else ''}"
        _say(f"{options.folder}: {frames} of {capture.format}, {capture.intrinsics.width}×{capture.intrinsics.height}")


def _record(options: argparse.Namespace, writers: Writers) -> None:
    from .record import DRIVERS, record

    with (
        _progress(options.quiet) as progress,
        DRIVERS[options.camera](options.size, options.rate, options.serial) as stream,
    ):
        record(stream, options.folder, options.frames, progress=progress)
    if not options.quiet:
        _say(f"{options.folder}: {options.frames} frames; look at it with “mirror-scan inspect {options.folder}”")


def _open(path: Path, options: argparse.Namespace) -> Capture:
    """The capture at ``path``, read as the options of :func:`_add_reading` say."""
    from .capture import open_capture

    return open_capture(path, *_reading(options))


def _reading(options: argparse.Namespace) -> tuple[FrameChoice, ReadOptions]:
    """Which frames to read, and what the options of :func:`_add_reading` say of the file."""
    from .capture import ReadOptions
    from .capture.rgbd_folder import read_intrinsics

    lens = read_intrinsics(options.intrinsics)[0] if options.intrinsics else None
    reading = ReadOptions(
        intrinsics=lens, depth_unit_m=options.depth_unit, disparity=options.disparity,
        kinect_calibration=options.kinect_calibration, turn_degrees=options.turn, mirrored=options.mirrored,
        min_confidence=options.min_confidence, color=not options.no_color,
    )  # fmt: skip
    return (1 if getattr(options, "single_frame", False) else options.frames), reading


def _settings(options: argparse.Namespace) -> Settings:
    """Settings with what :func:`_add_cleaning` leaves out, and what a command says of the subject."""
    from .closing import ClosingSettings
    from .depth import DepthSettings
    from .pipeline import Settings
    from .views import ViewSettings

    given = vars(options)
    changes: dict = {"sensor": options.sensor}
    for step in options.without:
        changes |= CLEANING[step]
    return Settings(
        depth=DepthSettings(**changes),
        views=ViewSettings(click=given.get("subject"), object=given.get("object", False)),
        closing=ClosingSettings(keep_islands=given.get("keep_islands", False)),
    )


def _evaluate(options: argparse.Namespace, writers: Writers) -> None:
    from .io import read_mesh
    from .metrics import evaluate

    mesh, truth = read_mesh(options.mesh), read_mesh(options.truth)
    for path, surface in ((options.mesh, mesh), (options.truth, truth)):
        if not len(surface.triangles):
            raise CaptureError(f"{path}: holds points but no faces; distances need surfaces")
    distances = evaluate(mesh, truth)
    if options.json:
        _say(json.dumps(_plain(distances), indent=1))
    else:
        for line in _distance_lines(distances):
            _say(line)


def _experiment_zippering(options: argparse.Namespace, writers: Writers) -> None:
    _make_folder(options.folder)
    _check_targets([options.folder / name for name in ("table.csv", "result.png", "plot.png")])

    from .experiments.zippering import run, table, write_results
    from .io import read_mesh
    from .simulation.mannequin import mannequin

    with _progress(options.quiet) as progress:
        _advance(progress, 0.0, "reading the body" if options.mesh else "making a mannequin")
        body = read_mesh(options.mesh) if options.mesh else mannequin()
        bridge = options.find_bridge() if options.find_bridge else None
        steps = run(body, options.steps, options.matching, progress=_part(progress, 0.05, 0.95), bridge=bridge)
        _advance(progress, 0.95, "writing")
        paths, note = write_results(steps, body, options.folder)
    for step in steps:
        for warning in step.notes:
            _complain("warning", f"{step.decimation:g} %: {warning}")
    if options.quiet:
        return
    for line in table(steps, body):
        _say(line)
    _say("distances between the surfaces, of both directions the larger; % of the body's height")
    if bridge is None:
        _say("without Blender's Bridge Edge Loops beside it: bpy cannot be imported here; “pip install bpy”")
    for path in paths:
        _say(f"  {path}")
    if note:
        _say(f"  {note}")


def _experiment_capture(options: argparse.Namespace, writers: Writers) -> None:
    import importlib

    _make_folder(options.folder)
    _check_targets([options.folder / name for name in ("table.csv", "result.png", "plot.png")])
    experiment = importlib.import_module(f".experiments.{options.experiment}", __package__)

    from .io import read_mesh
    from .simulation.mannequin import mannequin

    with _progress(options.quiet) as progress:
        _advance(progress, 0.0, "reading the body" if options.mesh else "making a mannequin")
        body = _stand(read_mesh(options.mesh), options.mesh) if options.mesh else mannequin()
        outcome = experiment.run(
            body, options.sensor, options.frames, options.seed, progress=_part(progress, 0.05, 0.95)
        )
        _advance(progress, 0.95, "writing")
        paths, note = experiment.write_results(outcome, options.folder)
    if options.quiet:
        return
    for line in experiment.table(outcome):
        _say(line)
    for path in paths:
        _say(f"  {path}")
    if note:
        _say(f"  {note}")


# --- outputs ---------------------------------------------------------------------------------------------------------


def _writer(path: Path, writers: Writers) -> Callable[[Path, Reconstruction], object]:
    """What writes ``path``, by its suffix."""
    suffix = path.suffix.lower()
    if suffix in PLAIN_SUFFIXES:
        from .io import write_mesh

        return lambda target, result: write_mesh(target, result.mesh)
    if suffix in writers:
        return writers[suffix]
    if suffix in BLENDER_SUFFIXES:
        raise OutputError(
            f"{path}: {suffix} needs Blender's Python module; “pip install bpy==5.0.1” (Python 3.11), bpy==5.2.3 "
            f"(Python 3.13) or bpy 4.5 LTS (Python 3.11); this is Python {sys.version_info[0]}.{sys.version_info[1]}. "
            "Without it, write .ply, .obj or .stl"
        )
    known = ", ".join((*PLAIN_SUFFIXES, *BLENDER_SUFFIXES))
    raise OutputError(f"{path}: unknown format “{path.suffix}”; use one of {known}")


def _plan_outputs(paths: Iterable[Path], writers: Writers) -> list[tuple[Path, Callable]]:
    return [(path, _writer(path, writers)) for path in paths]


def _check_targets(paths: Sequence[Path]) -> None:
    """Refuse, before any work is done, what could not be written at its end."""
    seen: dict[str, Path] = {}
    for path in paths:
        parent = path.absolute().parent
        if not parent.is_dir():
            raise OutputError(f"{path}: the folder {parent} does not exist; create it first")
        if path.exists() and not path.is_file():
            raise OutputError(f"{path}: is not a regular file; give the name of a file to write")
        if not os.access(parent, os.W_OK | os.X_OK):
            raise OutputError(f"{path}: the folder {parent} cannot be written to; choose another")
        real = os.path.realpath(path)
        if real in seen:
            raise OutputError(f"{path}: is to be written twice; give each output its own name")
        seen[real] = path


def _write_outputs(
    result: Reconstruction, outputs: list[tuple[Path, Callable]], report: Path | None, read_ms: float
) -> None:
    """Write all files under temporary names, then put them in place together."""
    from .files import replacing

    started = time.perf_counter()
    with contextlib.ExitStack() as stack:
        temporaries = [stack.enter_context(replacing(path)) for path, _ in outputs]
        report_temporary = stack.enter_context(replacing(report)) if report else None
        for (path, write), temporary in zip(outputs, temporaries, strict=True):
            with _blaming(path):
                write(temporary, result)
        if report and report_temporary:
            timings = {"read": read_ms, **result.report.get("timings_ms", {})}
            timings["write"] = (time.perf_counter() - started) * 1e3
            text = json.dumps(_plain({**result.report, "timings_ms": timings}), indent=1, ensure_ascii=False)
            with _blaming(report):
                report_temporary.write_text(text + "\n", encoding="utf-8")


@contextlib.contextmanager
def _blaming(path: Path) -> Iterator[None]:
    """Name the file an :class:`OSError` is about by the name the user gave it."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made a folder: {error.strerror or error}") from error


def _write_simulation(folder: Path, *, sensor: str, frames: int, seed: int, mirrors: int, body: Path | None) -> None:
    """Simulate into a folder beside ``folder``, then swap; only a simulation may be replaced, never a recording."""
    from .files import fresh_folder
    from .io import read_mesh
    from .simulation.mannequin import mannequin
    from .simulation.scene import default_rig
    from .simulation.simulate import simulate, write_simulation

    if folder.exists():
        entries = {entry.name for entry in folder.iterdir()} if folder.is_dir() else None
        if entries is None or (entries and not ("truth" in entries and entries <= SIMULATION_ENTRIES)):
            raise OutputError(f"{folder}: exists and is not an earlier simulation; choose another name or remove it")
    subject = _stand(read_mesh(body), body) if body else mannequin()
    simulation = simulate(subject, default_rig(sensor=sensor, mirrors=mirrors, frames=frames, seed=seed))
    with fresh_folder(folder, replace=True) as fresh:
        write_simulation(simulation, fresh)


def _stand(subject: Mesh, path: Path) -> Mesh:
    """A mesh from a file, put on the floor where the rig expects it."""
    import numpy as np

    low, high = subject.vertices.min(axis=0), subject.vertices.max(axis=0)
    if not 0.2 <= high[2] - low[2] <= 3.0:
        raise CaptureError(f"{path}: is {high[2] - low[2]:.3g} m tall; give a body of 0.2 to 3 m, in metres, Z up")
    move = np.eye(4)
    move[:3, 3] = -(low[0] + high[0]) / 2, -(low[1] + high[1]) / 2, -low[2]
    return subject.transformed(move)


# --- words -----------------------------------------------------------------------------------------------------------


def _summary(result: Reconstruction) -> str:
    mesh = result.report["mesh"]
    closed = "watertight" if mesh["watertight"] else "NOT watertight"
    return (
        f"avatar: {mesh['height_m']:.2f} m tall, {mesh['volume_l']:.1f} l, {mesh['vertices']} vertices, "
        f"{mesh['triangles']} triangles, {closed}"
    )


def _distance_lines(distances: dict) -> Iterator[str]:
    """The figures of :func:`metrics.evaluate` as a table."""
    yield "distances in mm        mean     95 %      max"
    for title, key in (("mesh to truth", "accuracy"), ("truth to mesh", "complete")):
        mean, p95, largest = (distances[f"{key}_{column}"] for column in ("mean", "p95", "max"))
        yield f"{title:<18}{mean:9.2f}{p95:9.2f}{largest:9.2f}"
    closed = "watertight" if distances["watertight"] else f"{distances['boundary_edges']} open edges"
    pieces = f"{distances['components']} component{'' if distances['components'] == 1 else 's'}"
    yield f"mesh: {distances['vertices']} vertices, {distances['faces']} faces, {pieces}, {closed}"
    yield (
        f"{distances['nonmanifold_edges']} non-manifold edges, "
        f"{distances['self_intersecting_faces']} faces that intersect others"
    )
    if distances["volume_error_pct"] is not None:
        yield f"volume {distances['volume_error_pct']:+.1f} %"
    yield f"measured after moving the mesh {distances['icp_shift_mm']:.1f} mm to where it fits best"


def _plain(value: object) -> object:
    """Values JSON can hold: numpy scalars unwrapped, not-a-number as null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _say(text: str) -> None:
    _print(text, sys.stdout)


def _complain(kind: str, text: str) -> None:
    """One line on stderr, whatever line breaks the text has."""
    _print(f"{kind}: {' '.join(text.split())}", sys.stderr)


def _print(text: str, stream) -> None:
    """Print what the stream's encoding has, and ``?`` for the rest."""
    encoding = getattr(stream, "encoding", None) or "utf-8"
    print(text.encode(encoding, "replace").decode(encoding), file=stream, flush=True)


@contextlib.contextmanager
def _progress(quiet: bool) -> Iterator[Progress | None]:
    """A progress bar on a terminal; None elsewhere, or where tqdm is not (Blender's own Python)."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    try:
        from tqdm import tqdm
    except ImportError:
        yield None
        return
    with tqdm(total=100, leave=False, bar_format="{desc:<36.36}|{bar}| {percentage:3.0f} %  {elapsed}") as bar:

        def show(fraction: float, message: str) -> None:
            bar.set_description_str(message, refresh=False)
            bar.n = 100 * min(max(fraction, 0.0), 1.0)
            bar.refresh()

        yield show


def _advance(progress: Progress | None, fraction: float, message: str) -> None:
    if progress:
        progress(fraction, message)


def _part(progress: Progress | None, start: float, end: float) -> Progress | None:
    """``progress`` for a stage that is only part of the whole."""
    if progress is None:
        return None
    return lambda fraction, message: progress(start + (end - start) * fraction, message)


def _whole(low: int, high: int) -> Callable[[str], int]:
    """argparse type: a whole number within bounds."""

    def whole_number(text: str) -> int:
        value = int(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"must be from {low} to {high}, not {value}")
        return value

    return whole_number


def _size(text: str) -> tuple[int, int]:
    """argparse type: width and height, as 848x480."""
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and 0 < int(width) <= 4096 and 0 < int(height) <= 4096):
        raise argparse.ArgumentTypeError(f"must be as 848x480, not {text}")
    return int(width), int(height)


def _pixel(text: str) -> tuple[float, float]:
    """argparse type: a pixel as column,row."""
    u, v = (float(part) for part in text.split(","))
    if not math.isfinite(u) or not math.isfinite(v):
        raise argparse.ArgumentTypeError(f"must be two numbers, column,row, not {text}")
    return u, v


_pixel.__name__ = "pixel as column,row"  # argparse names the type when it cannot be read


def _percentages(text: str) -> tuple[float, ...]:
    """argparse type: percentages from 0 to below 100, separated by commas."""
    values = tuple(float(part) for part in text.split(","))
    if not all(0 <= value < 100 for value in values):
        raise argparse.ArgumentTypeError(f"must be from 0 to below 100, separated by commas, not {text}")
    return values


_percentages.__name__ = "list of percentages"  # argparse names the type when a number cannot be read
