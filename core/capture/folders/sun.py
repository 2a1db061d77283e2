"""SUN RGB-D: ``intrinsics.txt``, one ``depth*/…png`` with its bits rotated by three, one ``image/…jpg``.

Also SUN3D's and Mirror3D's relatives: a folder with ``intrinsics.txt`` of nine numbers, row by row.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...camera import Intrinsics
from ...errors import CaptureError
from ...io.images import read_image
from ...io.json_files import text_of
from ..capture import Capture, ReadOptions, stored_capture
from ..decoding.binary import read_limited, rgb
from ..depth_units import metres
from ..frames import FrameChoice, chosen_frames, empty_burst, paired_color
from ..single_files.single_image import read_values
from .rgbd_folder import sensor_named

FORMAT = "SUN RGB-D"
DEPTH_FOLDERS = ("depth", "depth_bfx")  # as read, then with holes filled by the data set's makers


def recognises(path: Path) -> bool:
    """Whether ``path`` is a folder with ``intrinsics.txt`` and a folder of depth."""
    return path.is_dir() and (path / "intrinsics.txt").is_file() and any((path / d).is_dir() for d in DEPTH_FOLDERS)


def read(path: Path, frames: FrameChoice, options: ReadOptions) -> Capture:
    """Read one scene."""
    folder = next(path / d for d in DEPTH_FOLDERS if (path / d).is_dir())
    files = sorted(folder.glob("*.png"))
    chosen = chosen_frames(folder, frames, len(files))
    depth = None
    for i, number in enumerate(chosen):
        values = read_values(files[number])[0]
        if depth is None:
            depth = empty_burst(path, len(chosen), *values.shape)
        if values.shape != depth.shape[1:] or values.dtype != np.uint16:
            raise CaptureError(f"{files[number]}: must be 16-bit gray and of the size of the first frame")
        unrotated = (values >> 3) | (values << 13) if options.depth_unit_m is None else values
        depth[i] = metres(unrotated, options.depth_unit_m or 0.001)[0]
    assert depth is not None  # chosen_frames gives at least one
    height, width = depth.shape[1:]
    camera = options.intrinsics or _intrinsics(path / "intrinsics.txt", width, height)
    color, notes = None, []
    if options.color and (path / "image").is_dir():
        images = sorted(p for p in (path / "image").iterdir() if p.suffix.lower() in (".jpg", ".jpeg", ".png"))
        if images:
            place, note = paired_color(files, chosen[0], images)
            color = rgb(read_image(images[place]))
            notes += [note] if note else []
    sensor = next((s for part in path.resolve().parts[::-1] if (s := sensor_named(part)) != "unknown"), "unknown")
    return stored_capture(path, FORMAT, depth, color, camera, sensor=sensor, sensor_from="name", notes=notes)


def _intrinsics(path: Path, width: int, height: int) -> Intrinsics:
    text = text_of(read_limited(path, 100_000))
    try:
        fx, skew, cx, below, fy, cy, *last = (float(word) for word in text.split()[:9])
    except ValueError:
        fx = skew = cx = below = fy = cy = np.nan
        last = []
    if last != [0, 0, 1] or skew or below:
        raise CaptureError(f"{path}: must hold nine numbers, fx 0 cx 0 fy cy 0 0 1", code="lens_wrong")
    return Intrinsics(width, height, fx, fy, cx, cy)
