"""PCL's image grabber: ``NAME_depth.pclzf`` (LZF, 16 bits), ``NAME_rgb.pclzf`` and ``NAME.xml``, or TIFFs beside it.

A file, or the folder that holds a sequence of them.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np

from ...camera import Intrinsics
from ...errors import CaptureError, Notice
from ...io.images import MAX_PIXELS
from ...io.json_files import text_of
from ..capture import Capture, ReadOptions, stored_capture
from ..decoding.binary import blaming, read_limited, starts_with, yuv_to_rgb
from ..depth_units import metres
from ..frames import FrameChoice, chosen_frames, empty_burst
from ..nominal_intrinsics import nominal_camera

FORMAT = "PCL image grabber"
MAGIC = b"PCLZF"
HEADER = struct.Struct("<5sII16sII")  # magic, width, height, kind, size packed and unpacked
BYTES = {"depth16": 2, "rgb24": 3, "yuv422": 2, "bayer8": 1}


def recognises(path: Path) -> bool:
    """Whether ``path`` is a .pclzf file or a folder of them."""
    if path.is_dir():
        return next(path.glob("*_depth.pclzf"), None) is not None
    return starts_with(path, MAGIC)


def read(path: Path, frames: FrameChoice, options: ReadOptions) -> Capture:
    """Read one frame or a sequence; colour and intrinsics of the first chosen frame."""
    files = sorted(path.glob("*_depth.pclzf")) if path.is_dir() else [path]
    chosen = chosen_frames(path, frames, len(files))
    depth, notes = None, []
    for i, number in enumerate(chosen):
        kind, values = read_pclzf(files[number])
        if kind != "depth16":
            raise CaptureError(
                f"{files[number]}: holds {kind}, not depth; open the file whose name ends in _depth.pclzf",
                code="not_a_capture",
            )
        if depth is None:
            depth = empty_burst(path, len(chosen), *values.shape)
        if values.shape != depth.shape[1:]:
            raise CaptureError(f"{files[number]}: is of another size than the first frame")
        depth[i] = metres(values, options.depth_unit_m or 0.001)[0]
    first = files[chosen[0]]
    xml_file, rgb_file = companions(first)
    base = xml_file.stem
    assert depth is not None  # chosen_frames gives at least one
    height, width = depth.shape[1:]
    camera = options.intrinsics
    if camera is None and xml_file.is_file():
        camera = _parameters(xml_file, width, height)
    if camera is None:
        nominal = nominal_camera(width, height)
        if nominal is None:
            raise CaptureError(
                f"{first}: {base}.xml with its intrinsics is missing; put it beside the file", code="lens_missing"
            )
        camera, _, note = nominal
        notes.append(note)
    color = None
    if options.color and rgb_file.is_file() and rgb_file != first:
        kind, image = read_pclzf(rgb_file)
        color = image if image.ndim == 3 else None
        if color is None:
            notes.append(Notice("{name} is left out: {kind} is no colour image", name=rgb_file.name, kind=kind))
    return stored_capture(path, FORMAT, depth, color, camera, sensor="kinect_v1", sensor_from="size", notes=notes)


def companions(path: Path) -> tuple[Path, Path]:
    """Files that belong to a frame and lie beside it: its intrinsics and its colour image; they need not exist."""
    base = path.name.removesuffix(".pclzf").removesuffix("_depth")
    return path.with_name(f"{base}.xml"), path.with_name(f"{base}_rgb.pclzf")


def read_pclzf(path: Path) -> tuple[str, np.ndarray]:
    """Kind and pixels of one file: depth (H, W) uint16, colour (H, W, 3) uint8, or a Bayer pattern (H, W) uint8."""
    data = read_limited(path, 8 * MAX_PIXELS)
    with blaming(path, "a .pclzf"):
        magic, width, height, kind, packed, unpacked = HEADER.unpack_from(data)
        kind = kind.split(b"\0")[0].split(b" ")[0].decode("ascii")
        if magic != MAGIC or kind not in BYTES or not 0 < width * height <= MAX_PIXELS:
            raise ValueError(f"{width}×{height} {kind[:16]}")
        if unpacked != width * height * BYTES[kind] or packed > len(data) - HEADER.size:
            raise ValueError("the size of the image is not what the header says")
        if kind == "yuv422" and width % 2:
            raise ValueError("yuv422 of odd width")

        from ..decoding.lzf import lzf_decompress  # brings numba

        raw = lzf_decompress(data[HEADER.size : HEADER.size + packed], unpacked)
    if kind == "depth16":
        return kind, raw.view("<u2").reshape(height, width)
    if kind == "rgb24":  # plane by plane
        return kind, np.ascontiguousarray(raw.reshape(3, height, width).transpose(1, 2, 0))
    if kind == "yuv422":  # u, y and v one after the other, u and v at half the width
        half = width * height // 2
        u, y, v = raw[:half], raw[half : 3 * half], raw[3 * half :]
        u, v = (np.repeat(plane.reshape(height, -1), 2, axis=1) for plane in (u, v))
        return kind, yuv_to_rgb(y.reshape(height, width), u, v)
    return kind, raw.reshape(height, width)


def _parameters(path: Path, width: int, height: int) -> Intrinsics | None:
    """The depth camera of the grabber's XML; read by its four fixed names, so that no entity is ever expanded."""
    text = text_of(read_limited(path, 100_000))
    section = re.search(r"<depth>(.*?)</depth>", text, re.DOTALL)
    if section is None:
        raise CaptureError(f"{path}: has no section <depth> with the camera's parameters", code="lens_missing")
    values = []
    for name in ("focal_length_x", "focal_length_y", "principal_point_x", "principal_point_y"):
        number = re.search(rf"<{name}>\s*([-+0-9.eE]{{1,40}})\s*</{name}>", section[1])
        try:
            values.append(float(number[1]) if number else np.nan)
        except ValueError:
            values.append(np.nan)
    fx, fy, cx, cy = values
    return Intrinsics(width, height, fx, fy, cx, cy)
