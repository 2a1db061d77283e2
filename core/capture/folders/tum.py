"""TUM RGB-D: ``depth.txt`` and ``rgb.txt`` list 16-bit PNGs (5000 = 1 m) and colour images with their times."""

from __future__ import annotations

import math
import re
from pathlib import Path, PurePosixPath

import numpy as np

from ...camera import Intrinsics
from ...errors import CaptureError, Notice
from ...io.images import read_image
from ...io.json_files import text_of
from ..capture import Capture, ReadOptions, stored_capture
from ..decoding.binary import read_limited, rgb
from ..depth_units import metres, recognise_unit
from ..frames import FrameChoice, chosen_frames, empty_burst
from ..single_files.single_image import read_values

FORMAT = "TUM RGB-D"
UNIT_M = 1 / 5000
MAX_APART_S = 0.02  # between a depth and a colour image that belong together, as the benchmark's own script has it
MAX_LIST = 64_000_000
_ENOUGH = 500  # readings before a pattern counts as one
#: The benchmark's calibrations of its three Kinects, by the name of the sequence.
CAMERAS = {
    "freiburg1": Intrinsics(640, 480, 517.3, 516.5, 318.6, 255.3),
    "freiburg2": Intrinsics(640, 480, 520.9, 521.0, 325.1, 249.7),
    "freiburg3": Intrinsics(640, 480, 535.4, 539.2, 320.1, 247.6),
}
DEFAULT = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)


def recognises(path: Path) -> bool:
    """Whether ``path`` is a folder with the benchmark's list of depth images."""
    return path.is_dir() and (path / "depth.txt").is_file()


def read(path: Path, frames: FrameChoice, options: ReadOptions) -> Capture:
    """Read a sequence; colour is the image nearest in time to the first chosen frame."""
    listed = read_list(path / "depth.txt")
    chosen = chosen_frames(path / "depth.txt", frames, len(listed))
    depth, unit, notes = None, options.depth_unit_m, []
    for i, number in enumerate(chosen):
        values = read_values(inside(path, listed[number][1]))[0]
        if depth is None:
            depth = empty_burst(path, len(chosen), *values.shape)
        if values.shape != depth.shape[1:]:
            raise CaptureError(f"{inside(path, listed[number][1])}: is of another size than the first frame")
        unit = unit or _unit(values)
        depth[i] = metres(values, unit)[0]
    assert depth is not None  # chosen_frames gives at least one
    height, width = depth.shape[1:]
    known = [camera for name, camera in CAMERAS.items() if name in path.resolve().name.lower()]
    camera = options.intrinsics or (known or [DEFAULT])[0]
    if options.intrinsics is None and (width, height) != (640, 480):
        raise CaptureError(
            f"{path}: the intrinsics of these {width}×{height} pixels are unknown; give them", code="lens_missing"
        )
    color = None
    if unit == 0.001 and options.depth_unit_m is None:
        notes.append("depth is taken for millimetres: its values are no multiples of 5, as those of TUM RGB-D are")
    if not known and options.intrinsics is None:
        notes.append("no intrinsics in the folder: those the benchmark recommends are used (f 525 px)")
    if options.color and (path / "rgb.txt").is_file():
        times = read_list(path / "rgb.txt")
        nearest = min(times, key=lambda entry: abs(entry[0] - listed[chosen[0]][0]), default=None)
        if nearest is not None and abs(nearest[0] - listed[chosen[0]][0]) <= MAX_APART_S:
            color = rgb(read_image(inside(path, nearest[1])))
        else:
            notes.append(Notice("no colour image within {seconds:g} s of the first frame", seconds=MAX_APART_S))
    sensor = "kinect_v1" if unit == UNIT_M else "unknown"  # others have taken over the layout
    return stored_capture(path, FORMAT, depth, color, camera, sensor=sensor, sensor_from="format", notes=notes)


def _unit(values: np.ndarray) -> float | None:
    """Metres in a unit: the benchmark's, unless the pattern of whole numbers is plainly that of millimetres.

    Recorders of other cameras write millimetres in this layout. The benchmark's numbers were made from millimetres and
    are multiples of 5; others' that are not would lie within 1 m if they were 5000 to a metre.
    """
    if values.dtype.kind == "f":
        return recognise_unit(values).metres
    read = values[(values > 0) & (values < 65535)]
    plain = read.size >= _ENOUGH and (read % 5 == 0).mean() < 0.9 and np.median(read) < 1 / UNIT_M
    return 0.001 if plain else UNIT_M


def read_list(path: Path) -> list[tuple[float, str]]:
    """Times [s] and file names of a list, in its order."""
    entries = []
    text = text_of(read_limited(path, MAX_LIST))
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        words = re.split(r"[\s,;]+", line.strip(), maxsplit=1)
        try:
            time = float(words[0])
        except ValueError:
            time = math.nan
        if len(words) != 2 or not math.isfinite(time):
            raise CaptureError(f"{path}: line {number} must be a time and a file name, not {line[:60]!r}")
        entries.append((time, words[1].strip().strip('"')))
    return entries


def inside(folder: Path, name: str) -> Path:
    """The file of that name, as either system writes it, which must not lead out of the folder."""
    if "\\" in name and "\0" not in name and not (folder / name).exists():
        name = name.replace("\\", "/")
    if re.match(r"/|[A-Za-z]:/", name) and "\0" not in name and not (folder / name).exists():
        parts = PurePosixPath(name).parts  # where the folder once was
        tails = (str(PurePosixPath(*parts[k:])) for k in range(1, len(parts)))
        name = next((tail for tail in tails if ".." not in tail and (folder / tail).is_file()), name)
    if "\0" in name or not (folder / name).resolve().is_relative_to(folder.resolve()):
        raise CaptureError(f"{folder}: names a file outside the folder, {name[:60]!r}")
    return folder / name
