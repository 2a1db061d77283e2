"""The arguments of each command and their help texts."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from ..rig_planning.rooms import MIRRORS, ROOMS
from . import batch, commands, live, planning, rigged_avatars, sequence
from .argument_types import (
    EFFECTS,
    OPTICS,
    TEXTURE_SIZE,
    counts,
    frequencies,
    gigabytes,
    glass_size,
    image_size,
    millimetres,
    optics,
    percentages,
    pixel,
    room_size,
    seconds,
    sways,
    texture_size,
    turn,
    whole_number,
)
from .terminal import show

SENSORS = ("ideal", "kinect_v1", "kinect_v2", "azure_kinect", "femto_bolt", "realsense_d455", "phone_dtof")
CAMERAS = ("realsense", "azure_kinect", "femto")
BATCH_FORMATS = ("glb", "ply", "obj", "stl", "3mf")
GARMENTS = ("tshirt", "trousers", "skirt")
DEMO_FOLDER = "mirror_scan_demo"
EXPERIMENT_FOLDER = "{}_experiment"

if TYPE_CHECKING:
    _Commands = argparse._SubParsersAction[argparse.ArgumentParser]


class _Parser(argparse.ArgumentParser):
    """Its help and its complaints are spelled in the characters that the terminal has."""

    def _print_message(self, message: str, file: Any = None) -> None:
        show(message or "", file or sys.stderr)

    def error(self, message: str) -> NoReturn:
        show(self.format_usage(), sys.stderr)  # argparse's own would go to stdout where there is no stderr
        self.exit(2, f"{self.prog}: error: {message}\n")


def build_parser(prog: str) -> argparse.ArgumentParser:
    """The parser of all commands; each sets ``run`` to its function."""
    parser: argparse.ArgumentParser = _Parser(
        prog=prog, description="One depth camera, two mirrors, one snapshot: a closed, coloured avatar."
    )
    subparsers = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    _add_reconstruct(subparsers)
    _add_sequence(subparsers)
    _add_batch(subparsers)
    _add_animate(subparsers)
    _add_dress(subparsers)
    _add_calibrate(subparsers)
    _add_demo(subparsers)
    _add_simulate(subparsers)
    _add_plan(subparsers)
    _add_inspect(subparsers)
    _add_convert(subparsers)
    _add_record(subparsers)
    _add_live(subparsers)
    _add_evaluate(subparsers)
    experiments = subparsers.add_parser("experiment", help="repeat an experiment of the paper").add_subparsers(
        title="experiments", metavar="EXPERIMENT", required=True
    )
    _add_zippering_experiment(experiments)
    words = "what a mirror costs: the same back via a mirror and directly, over the same path length"
    _add_capture_experiment(experiments, "reflection", words)
    _add_capture_experiment(experiments, "distance", "what distance costs: the same figure from 3 to 5 m")
    _add_turntable_experiment(experiments)
    words = "the paper's other rival: three cameras round the person, and what it costs when one, or a mirror, moved"
    _add_capture_experiment(experiments, "cameras", words)
    return parser


def _add_reconstruct(subparsers: _Commands) -> None:
    command = subparsers.add_parser("reconstruct", help="make an avatar from a capture")
    command.add_argument(
        "captures", metavar="CAPTURE", type=Path, nargs="+",
        help="folder with intrinsic.json and depth/*.png; several with --poses or --register, or one folder of them "
        "with poses.json",
    )  # fmt: skip
    command.add_argument(
        "-o", dest="outputs", metavar="OUT", type=Path, action="append", required=True,
        help="file to write, by suffix: .glb .ply .obj .stl .3mf, with --measure .csv, with Blender .blend .fbx .usd; "
        "may be given several times",
    )  # fmt: skip
    command.add_argument(
        "--poses", metavar="FILE", type=Path, help="poses.json with the pose of each camera, by capture"
    )
    command.add_argument(
        "--register", action="store_true",
        help="several captures without poses, in the order in which the subject turned or the camera went round it; "
        "the first shows the front; needs small_gicp or open3d",
    )  # fmt: skip
    command.add_argument(
        "--step", metavar="DEG", type=turn, dest="register_step",
        help="with --register: by how much the subject turned to its left from one capture to the next, or the camera "
        "went round it with the clock; negative the other way (default: once round, either way)",
    )  # fmt: skip
    command.add_argument("--report", metavar="FILE", type=Path, help="write what was found and measured, as JSON")
    _add_reconstruction(command)
    _add_quiet(command)
    command.set_defaults(run=commands.run_reconstruct)


def _add_reconstruction(command: argparse.ArgumentParser) -> None:
    """Options for how an avatar is made, whether of one capture or of many."""
    command.add_argument("--mirrors", metavar="FILE", type=Path, help="mirrors.json to use instead of the capture's")
    command.add_argument(
        "--rig", metavar="FILE", type=Path, help="rig file written by “calibrate”, with the mirrors to use"
    )
    command.add_argument(
        "--subject", metavar="U,V", type=pixel, help="pixel of the depth image on the subject, if another is found"
    )
    command.add_argument("--object", action="store_true", help="the subject is any object: cut off what it stands on")
    command.add_argument("--keep-islands", action="store_true", help="keep pieces that are not connected to the body")
    command.add_argument("--frame", choices=("avatar", "camera"), default="avatar", help="coordinates (default avatar)")
    command.add_argument("--single-frame", action="store_true", help="use only the first depth frame of a burst")
    _add_avatar(command)
    _add_print(command)
    _add_reading(command)
    _add_cleaning(command)
    _add_glass(command)
    _add_light(command)


def _add_batch(subparsers: _Commands) -> None:
    command = subparsers.add_parser(
        "batch", help="make an avatar of each of many captures, on all cores or on a cluster (docs/batch.md)"
    )
    command.add_argument(
        "captures", metavar="CAPTURE", nargs="+",
        help="capture or recording, folder to search for them, or pattern as “scans/**/*.mkv”",
    )  # fmt: skip
    command.add_argument(
        "-o", dest="folder", metavar="DIR", type=Path, required=True,
        help="folder to write to: a new one, or that of an earlier batch, to go on with it",
    )  # fmt: skip
    command.add_argument(
        "--format", dest="formats", metavar="SUFFIX", action="append", choices=BATCH_FORMATS,
        help=f"format of the avatars: {', '.join(BATCH_FORMATS)}; default glb; may be given several times",
    )  # fmt: skip
    command.add_argument(
        "--every-frames", metavar="N", type=whole_number(1, 1000), default=0,
        help="make an avatar of every N frames of a recording, instead of one of all",
    )  # fmt: skip
    group = _add_workers(command, "as many as cores and memory allow")
    group.add_argument(
        "--threads", metavar="N", type=whole_number(1, 1024), default=0,
        help="threads of each; by default the cores are shared out to the workers",
    )  # fmt: skip
    group.add_argument(
        "--memory", metavar="GB", type=gigabytes, default=0.0,
        help="memory of each; one that takes more is started again. By default an equal share of the machine's",
    )  # fmt: skip
    _add_reconstruction(command)
    _add_quiet(command)
    command.set_defaults(run=batch.run_batch)


def _add_workers(command: argparse.ArgumentParser, usual: str) -> argparse._ArgumentGroup:
    """Options for who does the work; ``usual``: what it is when none is given."""
    group = command.add_argument_group("workers", "who does the work; needs Dask: pip install 'mirror_scan[cluster]'")
    group.add_argument(
        "--workers", metavar="N", type=whole_number(1, 1024), default=0,
        help=f"processes on this machine; by default {usual}",
    )  # fmt: skip
    group.add_argument(
        "--scheduler", metavar="ADDRESS", default="",
        help="use the workers of a Dask scheduler, as tcp://10.0.0.1:8786, instead of this machine",
    )  # fmt: skip
    group.add_argument(
        "--wait", metavar="MINUTES", type=whole_number(0, 10_000), default=30,
        help="how long to wait for workers when all are gone, default 30 minutes",
    )  # fmt: skip
    return group


def _add_avatar(command: argparse.ArgumentParser) -> None:
    """Options for what the closed mesh becomes."""
    group = command.add_argument_group("avatar", "what the closed mesh becomes")
    group.add_argument(
        "--skeleton", action="store_true", help="give the avatar joints and skin weights, so that it can be posed"
    )
    group.add_argument("--vrm", action="store_true", help="name the bones of VRM's humanoid in .glb, too")
    group.add_argument(
        "--texture", metavar="SIZE", type=texture_size, nargs="?", const=TEXTURE_SIZE,
        help="lay an image of the colour camera's own pixels on the avatar, SIZE pixels wide and high "
        f"(256 to 8192, or 1K to 8K; default {TEXTURE_SIZE})",
    )  # fmt: skip
    group.add_argument(
        "--remove-light", action="store_true", help="with --texture: take the capture's light out of the colours"
    )
    group.add_argument(
        "--measure", action="store_true",
        help="measure the body as a tape would; written to the report, and to OUT.csv if that is given with -o",
    )  # fmt: skip
    group.add_argument(
        "--triangles", metavar="N", type=whole_number(100, 10_000_000), help="reduce the avatar to N triangles"
    )
    group.add_argument(
        "--levels", metavar="N,N", type=counts, default=(),
        help="write levels of detail, too, of so many triangles: OUT.lod1, OUT.lod2 and so on",
    )  # fmt: skip


def _add_print(command: argparse.ArgumentParser) -> None:
    """Options for .stl and .3mf, which are printed."""
    group = command.add_argument_group("print", "for .stl and .3mf, which are written in millimetres")
    group.add_argument(
        "--print-height", metavar="MM", type=millimetres(10, 3000), help="height of the print; default life size"
    )
    group.add_argument("--hollow", metavar="MM", type=millimetres(0.4, 100), help="make it hollow, with walls of MM")
    group.add_argument("--base", metavar="MM", type=millimetres(0.4, 100), help="stand it on a base plate, MM thick")


def _add_sequence(subparsers: _Commands) -> None:
    command = subparsers.add_parser("sequence", help="make an avatar of every frame of a recording")
    command.add_argument(
        "recording",
        metavar="RECORDING",
        type=Path,
        help="of a camera that stands still: .mkv .bag .oni .r3d, or a folder",
    )
    command.add_argument(
        "-o", dest="outputs", metavar="OUT", type=Path, action="append", required=True,
        help="folder to make for the frames; may be given again for files of the whole sequence: .mp4 .webp, with "
        "--skeleton .glb, with Blender .abc .usd",
    )  # fmt: skip
    command.add_argument(
        "--format", dest="formats", metavar="FORMAT", action="append", choices=("ply", "glb"),
        help="of the frames: ply (default) or glb; may be given twice",
    )  # fmt: skip
    command.add_argument("--every", metavar="N", type=whole_number(1, 1000), default=1, help="take every N-th frame")
    command.add_argument(
        "--fps",
        metavar="N",
        type=whole_number(1, 240),
        default=30,
        help="frames a second of what is written, default 30",
    )
    command.add_argument("--mirrors", metavar="FILE", type=Path, help="mirrors.json to use instead of the recording's")
    command.add_argument("--rig", metavar="FILE", type=Path, help="rig file written by “calibrate”")
    command.add_argument("--unfiltered", action="store_true", help="do not steady depth in time")
    command.add_argument(
        "--skeleton", action="store_true", help="follow the joints: -o NAME.glb gets one avatar and its motion"
    )
    command.add_argument("--resume", action="store_true", help="go on with a sequence that was interrupted")
    command.add_argument("--object", action="store_true", help="the subject is any object: cut off what it stands on")
    _add_workers(command, "none: this process makes two frames at a time")
    _add_reading(command)
    _add_cleaning(command)
    _add_glass(command)
    _add_light(command)
    _add_quiet(command)
    command.set_defaults(run=sequence.run_sequence)


def _add_animate(subparsers: _Commands) -> None:
    command = subparsers.add_parser("animate", help="give an avatar with a skeleton a motion")
    command.add_argument(
        "avatar", metavar="AVATAR", type=Path, help=".glb, or with Blender .blend, written by “reconstruct --skeleton”"
    )
    command.add_argument(
        "motion", metavar="MOTION",
        help="file of a motion: .bvh, or with Blender .fbx; or one of our own: idle, walk, arms_up, squat, turn",
    )  # fmt: skip
    command.add_argument(
        "-o", dest="outputs", metavar="OUT", type=Path, action="append", required=True,
        help="file to write, by suffix: .glb, with Blender also .blend .fbx .usd; may be given several times",
    )  # fmt: skip
    command.add_argument("--in-place", action="store_true", help="leave out the way over the floor")
    command.add_argument("--loop", action="store_true", help="make it repeat without a jump")
    command.add_argument("--vrm", action="store_true", help="name the bones of VRM's humanoid in .glb, too")
    _add_quiet(command)
    command.set_defaults(run=rigged_avatars.run_animate)


def _add_dress(subparsers: _Commands) -> None:
    command = subparsers.add_parser("dress", help="give an avatar with a skeleton clothes")
    command.add_argument(
        "avatar", metavar="AVATAR", type=Path, help=".glb, or with Blender .blend, written by “reconstruct --skeleton”"
    )
    command.add_argument(
        "garments", metavar="GARMENT", nargs="+", choices=GARMENTS, help=f"one or several of {', '.join(GARMENTS)}"
    )
    command.add_argument(
        "-o", dest="outputs", metavar="OUT", type=Path, action="append", required=True,
        help="file to write, by suffix: .glb, with Blender also .blend (as cloth) .fbx .usd; may be repeated",
    )  # fmt: skip
    command.add_argument(
        "--ease", metavar="MM", type=millimetres(2, 80), default=15.0,
        help="distance from skin to cloth, 2 to 80 mm (default 15)",
    )  # fmt: skip
    command.add_argument(
        "--tight", action="store_true", help="nowhere wider than the ease; the skeleton alone moves it"
    )
    _add_quiet(command)
    command.set_defaults(run=rigged_avatars.run_dress)


def _add_calibrate(subparsers: _Commands) -> None:
    command = subparsers.add_parser("calibrate", help="place the mirrors of a rig once, for all its later captures")
    command.add_argument(
        "capture", metavar="CAPTURE", type=Path, help="capture of the rig, best without a person in it"
    )
    command.add_argument(
        "-o", dest="rig", metavar="RIG", type=Path, required=True, help="rig file to write, for “reconstruct --rig”"
    )
    command.add_argument("--mirrors", metavar="FILE", type=Path, help="mirrors.json to use instead of the capture's")
    _add_glass(command)
    _add_quiet(command)
    command.set_defaults(run=commands.run_calibrate)


def _add_demo(subparsers: _Commands) -> None:
    command = subparsers.add_parser("demo", help="scan a virtual person and reconstruct it")
    command.add_argument(
        "folder", metavar="DIR", type=Path, nargs="?", default=Path(DEMO_FOLDER),
        help=f"where to put everything (default {DEMO_FOLDER})",
    )  # fmt: skip
    _add_optics(command, one_by_one=True)
    _add_quiet(command)
    command.set_defaults(run=commands.run_demo)


def _add_simulate(subparsers: _Commands) -> None:
    command = subparsers.add_parser("simulate", help="write an RGB-D folder of a virtual scan, with its truth")
    command.add_argument("folder", metavar="DIR", type=Path, help="folder to write; an earlier simulation is replaced")
    command.add_argument("--sensor", choices=SENSORS, default="azure_kinect", help="depth camera, default azure_kinect")
    command.add_argument(
        "--frames", metavar="N", type=whole_number(1, 300), default=10, help="frames in the burst, default 10"
    )
    command.add_argument(
        "--seed", metavar="N", type=whole_number(0, 2**32 - 1), default=0, help="seed of the noise, default 0"
    )
    command.add_argument(
        "--mirrors", metavar="N", type=whole_number(1, 8), default=2, help="number of mirrors, default 2"
    )
    command.add_argument("--body", metavar="FILE", type=Path, help="mesh to scan, Z up, in metres; default a mannequin")
    command.add_argument(
        "--color-scale", metavar="N", type=whole_number(1, 8), default=1,
        help="colour image N times as wide and high as depth, default 1",
    )  # fmt: skip
    _add_optics(command, one_by_one=True)
    _add_quiet(command)
    command.set_defaults(run=commands.run_simulate)


def _add_plan(subparsers: _Commands) -> None:
    command = subparsers.add_parser("plan", help="find the best place for camera, person and mirrors in a room")
    rooms = ", ".join(ROOMS)
    command.add_argument(
        "--room", metavar="SIZE", type=room_size, required=True,
        help=f"width x depth x height in metres, such as 3x3.5x2.4, or one of {rooms}",
    )  # fmt: skip
    command.add_argument("--sensor", choices=SENSORS, default="azure_kinect", help="depth camera, default azure_kinect")
    command.add_argument(
        "--mirrors", metavar="SIZE", nargs="+", type=glass_size, default=[(0.8, 1.75), (0.8, 1.75)],
        help=f"width x height of each glass in metres, or one of {', '.join(MIRRORS)}; default two of 0.8x1.75",
    )  # fmt: skip
    command.add_argument(
        "--frame", metavar="M", type=float, default=0.035, help="width of the mirrors' frames in metres, default 0.035"
    )
    command.add_argument(
        "--frames", metavar="N", type=whole_number(1, 300), default=10, help="frames of the burst, default 10"
    )
    command.add_argument("--person", metavar="M", type=float, default=1.7, help="the person's height, default 1.7 m")
    command.add_argument("--body", metavar="FILE", type=Path, help="mesh of the person instead, Z up, in metres")
    command.add_argument(
        "-o", dest="folder", metavar="DIR", type=Path, help="folder for plan.svg, rig.json and preview.png"
    )
    _add_quiet(command)
    command.set_defaults(run=planning.run_plan)


def _add_optics(command: argparse.ArgumentParser, one_by_one: bool = False) -> None:
    words = "real: light by two ways, and whatever else real glass and cameras do; default ideal: noise only"
    if one_by_one:
        words += f"; or effects separated by commas, of {', '.join(EFFECTS)}"
        command.add_argument("--optics", metavar="WHICH", type=optics, default="ideal", help=words)
    else:
        command.add_argument("--optics", choices=OPTICS, default="ideal", help=words)
    command.add_argument(
        "--frequencies", metavar="F,F,F", type=frequencies,
        help="modulation [MHz] of a camera that measures phase, with real optics; default 200,180,90",
    )  # fmt: skip


def _add_inspect(subparsers: _Commands) -> None:
    command = subparsers.add_parser("inspect", help="report what a capture holds and whether it is plausible")
    command.add_argument("capture", metavar="CAPTURE", type=Path, help="folder or file of a depth camera")
    _add_reading(command)
    _add_cleaning(command)
    command.add_argument(
        "-o", dest="preview", metavar="PNG", type=Path, help="write a picture of depth, colour and cleaned depth"
    )
    command.set_defaults(run=commands.run_inspect)


def _add_convert(subparsers: _Commands) -> None:
    command = subparsers.add_parser("convert", help="write a capture of any format as an RGB-D folder")
    command.add_argument("capture", metavar="CAPTURE", type=Path, help="folder or file of a depth camera")
    _add_reading(command)
    command.add_argument("folder", metavar="DIR", type=Path, help="folder to make")
    _add_quiet(command)
    command.set_defaults(run=commands.run_convert)


def _add_record(subparsers: _Commands) -> None:
    command = subparsers.add_parser("record", help="record a burst with a connected camera")
    command.add_argument("folder", metavar="DIR", type=Path, help="folder to make")
    command.add_argument(
        "--frames", metavar="N", type=whole_number(1, 300), default=30, help="frames in the burst, default 30"
    )
    _add_camera(command)
    command.add_argument(
        "--native-color", action="store_true", help="keep the colour camera's own, larger images, for textures"
    )
    _add_quiet(command)
    command.set_defaults(run=commands.run_record)


def _add_camera(command: argparse.ArgumentParser) -> None:
    """Options for a connected camera."""
    command.add_argument("--camera", choices=CAMERAS, default=CAMERAS[0], help=f"driver, default {CAMERAS[0]}")
    command.add_argument("--serial", metavar="NUMBER", help="serial number of the camera, if several are connected")
    command.add_argument(
        "--size",
        metavar="WxH",
        type=image_size,
        help="size of the depth image; default the camera's own, RealSense's 848x480",
    )
    command.add_argument(
        "--rate", metavar="HZ", type=whole_number(1, 120), default=30, help="frames a second, default 30"
    )


def _add_live(subparsers: _Commands) -> None:
    command = subparsers.add_parser(
        "live", help="say what to change before the shutter, take the burst when all is well, and make an avatar"
    )
    command.add_argument(
        "-o", dest="outputs", metavar="OUT", type=Path, action="append", required=True,
        help="file to write, as “reconstruct” has it; with --capture-only the folder for the burst",
    )  # fmt: skip
    _add_camera(command)
    command.add_argument(
        "--play", metavar="RECORDING", type=Path, help="play a recording of any format as if it were a camera"
    )
    command.add_argument("--fast", action="store_true", help="with --play: look at every frame, as fast as possible")
    command.add_argument(
        "--countdown", metavar="S", type=seconds, default=3.0, help="seconds to count down when all is well, default 3"
    )
    command.add_argument(
        "--burst", metavar="N", type=whole_number(1, 300), default=30, help="frames in the burst, default 30"
    )
    command.add_argument(
        "--capture", metavar="DIR", type=Path, help="folder to make for the burst, default OUT_capture beside OUT"
    )
    command.add_argument("--capture-only", action="store_true", help="make no avatar: -o is the folder for the burst")
    command.add_argument(
        "--mirror-count", metavar="N", type=whole_number(1, 8), default=2,
        help="how many mirrors to find, default 2; the burst waits for them",
    )  # fmt: skip
    command.add_argument(
        "--ignore", metavar="KIND", action="append", default=[],
        help="advice that the burst does not wait for, as mirror_small; may be given several times (docs/live.md)",
    )  # fmt: skip
    command.add_argument("--report", metavar="FILE", type=Path, help="write what was found and measured, as JSON")
    _add_reconstruction(command)
    _add_quiet(command)
    command.set_defaults(run=live.run_live)


def _add_evaluate(subparsers: _Commands) -> None:
    command = subparsers.add_parser("evaluate", help="measure a mesh against the true one")
    command.add_argument("mesh", metavar="MESH", type=Path, help=".ply, .obj or .stl")
    command.add_argument("truth", metavar="TRUTH", type=Path, help="the true surface, in the same frame and unit")
    command.add_argument("--json", action="store_true", help="print JSON instead of a table")
    command.set_defaults(run=commands.run_evaluate)


def _add_zippering_experiment(experiments: _Commands) -> None:
    command = experiments.add_parser(
        "zippering", help="what zippering costs: cut a body in three, decimate its back, zipper it again"
    )
    command.add_argument(
        "mesh", metavar="MESH", type=Path, nargs="?",
        help="closed body, Z up, facing -Y, in metres; default a mannequin",
    )  # fmt: skip
    _add_result_folder(command, "zippering")
    command.add_argument(
        "--steps", metavar="PERCENT", type=percentages, default=(0, 10, 20, 30, 40, 50),
        help="vertices to remove from the back, separated by commas (default 0,10,20,30,40,50)",
    )  # fmt: skip
    command.add_argument(
        "--matching", choices=("auto", "planes", "facing"), default="auto",
        help="start with the paper's planes, never use them, or decide by the figure (default)",
    )  # fmt: skip
    _add_quiet(command)
    command.set_defaults(run=commands.run_experiment_zippering)


def _add_turntable_experiment(experiments: _Commands) -> None:
    words = "the paper's rival: a person who sways on a turntable before one camera without mirrors"
    command = _add_capture_experiment(experiments, "turntable", words)
    command.add_argument(
        "--scans", metavar="N", type=whole_number(3, 36), default=8, help="scans in one turn of the plate (default 8)"
    )
    command.add_argument(
        "--sway", metavar="MM", type=sways, default=(0.0, 2.5, 5.0, 10.0, 15.0, 20.0), dest="sways",
        help="how far the crown moves from scan to scan, in millimetres, separated by commas (default "
        "0,2.5,5,10,15,20)",
    )  # fmt: skip


def _add_capture_experiment(experiments: _Commands, name: str, words: str) -> argparse.ArgumentParser:
    command = experiments.add_parser(name, help=words)
    command.add_argument(
        "mesh", metavar="MESH", type=Path, nargs="?", help="body, Z up, in metres; default a mannequin"
    )
    _add_result_folder(command, name)
    command.add_argument(
        "--sensor", choices=SENSORS, default="kinect_v1", help="depth camera, default the paper's kinect_v1"
    )
    command.add_argument(
        "--frames",
        metavar="N",
        type=whole_number(1, 100),
        default=10,
        help="frames in each burst, default the paper's 10",
    )
    command.add_argument(
        "--seed", metavar="N", type=whole_number(0, 2**32 - 1), default=0, help="seed of the noise, default 0"
    )
    _add_optics(command)
    _add_quiet(command)
    command.set_defaults(run=commands.run_experiment_capture, experiment=name)
    return command


def _add_result_folder(command: argparse.ArgumentParser, name: str) -> None:
    folder = EXPERIMENT_FOLDER.format(name)
    command.add_argument(
        "-o", dest="folder", metavar="DIR", type=Path, default=Path(folder),
        help=f"where to put table.csv, result.png and plot.png (default {folder})",
    )  # fmt: skip


def _add_quiet(command: argparse.ArgumentParser) -> None:
    command.add_argument("--quiet", action="store_true", help="print only warnings and errors")


def _add_reading(command: argparse.ArgumentParser) -> None:
    """Options for what a file does not say about itself."""
    group = command.add_argument_group("reading", "what the file does not say, or says wrongly")
    group.add_argument(
        "--frames", metavar="A:B", help="frames to read: “5” is the sixth alone, “10:” from the eleventh on"
    )
    group.add_argument("--intrinsics", metavar="FILE", type=Path, help="intrinsic.json of the depth camera")
    group.add_argument("--depth-unit", metavar="METRES", type=float, help="what one unit of depth means (0.001 = 1 mm)")
    group.add_argument(
        "--turn", type=int, choices=(0, 90, 180, 270), help="clockwise rotation that makes the image upright [degrees]"
    )
    group.add_argument(
        "--mirrored", action=argparse.BooleanOptionalAction, default=None, help="left and right are exchanged, or not"
    )
    group.add_argument(
        "--disparity", choices=("factory", "linear", "tangent"), default="factory",
        help="formula of raw Kinect v1 values (default factory)",
    )  # fmt: skip
    group.add_argument(
        "--kinect-calibration",
        choices=("factory", "burrus"),
        default="factory",
        help="calibration of a Kinect v1 whose recording has none",
    )
    group.add_argument(
        "--min-confidence", type=int, choices=(0, 1, 2), default=1, help="drop readings of lower confidence, default 1"
    )
    group.add_argument("--no-color", action="store_true", help="leave colour out")


def _add_cleaning(command: argparse.ArgumentParser) -> None:
    group = command.add_argument_group("cleaning")
    group.add_argument(
        "--sensor", default="auto", help="noise model to use: auto (default), unknown, or a sensor's name, as kinect_v1"
    )
    group.add_argument(
        "--without", metavar="STEP", action="append", choices=tuple(commands.CLEANING), default=[],
        help=f"leave out a step: {', '.join(commands.CLEANING)}; may be given several times",
    )  # fmt: skip


def _add_glass(command: argparse.ArgumentParser) -> None:
    """Options for what the picture may not show of the mirrors."""
    group = command.add_argument_group("mirrors", "what was measured on them")
    group.add_argument(
        "--glass-offset", metavar="MM", type=millimetres(-100, 100), default=0.0,
        help="how far the front of the glass lies behind the front of the frames, default 0",
    )  # fmt: skip
    group.add_argument(
        "--glass-thickness", metavar="MM", type=millimetres(0, 25), default=0.0,
        help="thickness of the glass; by default it is found where readings show it",
    )  # fmt: skip


def _add_light(command: argparse.ArgumentParser) -> None:
    """Options for light and mirrors that are not as in the textbook."""
    group = command.add_argument_group("optics")
    group.add_argument(
        "--bow", choices=("on", "off"), default="on",
        help="on: mirrors are bowed where readings confirm it (default); off: all are flat",
    )  # fmt: skip
    group.add_argument(
        "--two-way-light", choices=("auto", "on", "off"), default="auto",
        help="undo what light that comes two ways, directly and by a mirror, does to a camera that measures phase; "
        "auto: where camera and readings show it (default); on: the camera measures phase; off: never",
    )  # fmt: skip
    group.add_argument(
        "--frequencies", metavar="F,F,F", type=frequencies, default=(),
        help="modulation [MHz] of the camera, which then measures phase; by default the floor shows what matters of it",
    )  # fmt: skip
