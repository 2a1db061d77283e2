"""libfreenect's recordings (``fakenect``): ``INDEX.txt``, depth .pgm, colour .ppm, ``device.json``.

Depth is 640×480 raw 11-bit values, written in the machine's byte order behind a PGM header that promises the other.
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np

from ...camera import Intrinsics
from ...errors import CaptureError
from ...io.json_files import text_of
from ..capture import Capture, ReadOptions, stored_capture
from ..decoding.binary import read_limited
from ..frames import FrameChoice, apart_note, chosen_frames, empty_burst
from ..kinect_disparity import HEIGHT, NO_READING, WIDTH, ZeroPlane, calibration, depth_of_disparity
from .tum import inside

FORMAT = "fakenect recording"
MAX_INDEX = 64_000_000
_NAME = re.compile(r"^([dr])-([0-9.]{1,40})-([0-9]{1,20})\.(pgm|ppm)$")


def recognises(path: Path) -> bool:
    """Whether ``path`` is a folder with a recording's index."""
    return path.is_dir() and (path / "INDEX.txt").is_file()


def read(path: Path, frames: FrameChoice, options: ReadOptions) -> Capture:
    """Read a recording: the device's own calibration where ``device.json`` holds it, else the factory's defaults."""
    depth_files, color_files = _index(path)
    chosen = chosen_frames(path / "INDEX.txt", frames, len(depth_files))
    plane, notes = _zero_plane(path)
    table = depth_of_disparity(options.disparity, plane)
    depth = empty_burst(path, len(chosen), HEIGHT, WIDTH)
    millimetres = False
    for i, number in enumerate(chosen):
        values = np.frombuffer(_pixels(inside(path, depth_files[number][1]), b"P5", 2), "<u2").reshape(HEIGHT, WIDTH)
        millimetres = millimetres or int(values.max()) > NO_READING + 1
        # FREENECT_DEPTH_MM and _REGISTERED are written by the same program; they go to 10 m and know no 2047
        depth[i] = values / np.float32(1000) if millimetres else table[np.minimum(values, NO_READING)]
    if millimetres:
        notes.append("depth is in millimetres: taken for registered to colour")
        camera, color_camera, pose = Intrinsics(WIDTH, HEIGHT, 525.0, 525.0, 319.5, 239.5), None, None
    else:
        camera, color_camera, pose = calibration(options.kinect_calibration, plane)
    color = None
    if options.color and color_files:
        time = depth_files[chosen[0]][0]
        nearest = min(color_files, key=lambda entry: abs(entry[0] - time))
        notes += apart_note(nearest[0] - time)
        color = np.frombuffer(_pixels(inside(path, nearest[1]), b"P6", 3), np.uint8).reshape(HEIGHT, WIDTH, 3)
    return stored_capture(
        path, FORMAT, depth, color, camera, color_camera, pose, sensor="kinect_v1", sensor_from="format", notes=notes
    )


def _index(path: Path) -> tuple[list[tuple[float, str]], list[tuple[float, str]]]:
    """Times [s] and names of the depth and of the colour frames."""
    text = text_of(read_limited(path / "INDEX.txt", MAX_INDEX))
    found: dict[str, list[tuple[float, str]]] = {"d": [], "r": []}
    for line in text.splitlines():
        match = _NAME.match(line.strip())
        if match:
            try:
                time = float(match[2])
            except ValueError:
                time = math.inf
            if math.isfinite(time):
                found[match[1]].append((time, match[0]))
    if not found["d"]:
        if any(path.glob("*.avi")) or "ffmpeg" in text:
            raise CaptureError(f"{path}: was recorded as lossy video, which spoils depth; record without -ffmpeg")
        raise CaptureError(
            f"{path / 'INDEX.txt'}: lists no depth frame (d-….pgm); record with the depth stream on", code="empty"
        )
    return found["d"], found["r"]


def _pixels(path: Path, magic: bytes, size: int) -> bytes:
    """Body of a PGM or PPM of the camera's size."""
    if not path.is_file():
        raise CaptureError(f"{path}: is listed in INDEX.txt but missing; copy the whole recording")
    body = WIDTH * HEIGHT * size
    data = read_limited(path, body + 1000)
    match = re.match(magic + rb"\s+(\d{1,5})\s+(\d{1,5})\s+\d{1,5}\s", data[:200])
    if match is None or (int(match[1]), int(match[2])) != (WIDTH, HEIGHT):
        raise CaptureError(f"{path}: has no header of a {WIDTH}×{HEIGHT} {'PGM' if size == 2 else 'PPM'}; record again")
    if len(data) - match.end() < body:
        raise CaptureError(f"{path}: is truncated; copy or record it again")
    return data[match.end() : match.end() + body]


def _zero_plane(path: Path) -> tuple[ZeroPlane | None, list[str]]:
    """The device's factory calibration from ``device.json``, if the recording has it."""
    file = path / "device.json"
    if not file.is_file():
        return None, ["no device.json: the factory's default calibration is used"]
    try:
        content = json.loads(text_of(read_limited(file, 1_000_000), "strict"))
        section = content["zero_plane_info"] if "zero_plane_info" in content else content["reg_info"]["zero_plane_info"]
        shift = content.get("const_shift", content.get("reg_info", {}).get("const_shift", 200))
        values = [
            float(section[key])
            for key in (
                "reference_distance", "reference_pixel_size", "dcmos_emitter_distance", "dcmos_rcmos_distance"
            )
        ] + [float(shift)]  # fmt: skip
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise CaptureError(
            f"{file}: does not hold the calibration that libfreenect writes ({type(error).__name__}); "
            "remove it to go by the factory's defaults"
        ) from error
    low, high = (50, 0.02, 2, 0, 50), (300, 0.5, 20, 10, 500)
    if not all(a <= v <= b for v, a, b in zip(values, low, high, strict=True)):
        raise CaptureError(f"{file}: its calibration is that of no Kinect; remove it to go by the factory's defaults")
    return ZeroPlane(*values), []
