"""One depth image or array: PNG, TIFF, EXR, PGM or .npy, with its colour image beside it where the names agree.

Raw Kinect v1 disparity is recognised by its values, and so are TUM's and SUN RGB-D's units (:mod:`.depth_units`).
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...errors import CaptureError, Notice
from ...io.images import MAX_PIXELS, read_image
from ..capture import Capture, ReadOptions, stored_capture
from ..decoding.binary import blaming, npy_header, read_limited, rgb, starts_with
from ..depth_units import doubt, is_raw_disparity, metres
from ..folders.lens_file import read_lens_file
from ..folders.rgbd_folder import COLOR_INTRINSIC_NAME, INTRINSIC_NAMES, color_camera_of, sensor_named
from ..frames import MAX_BURST_PIXELS, FrameChoice, chosen_frames
from ..kinect_disparity import calibration, depth_of_disparity
from ..nominal_intrinsics import nominal_camera

FORMAT = "depth image"
SIGNATURES = (b"\x89PNG\r\n\x1a\n", b"II*\x00", b"MM\x00*", b"v/1\x01", b"P5", b"P2", b"\x93NUMPY")
COLOR_SUFFIXES = (".png", ".jpg", ".jpeg", ".ppm", ".tiff", ".tif")


def recognises(path: Path) -> bool:
    """Whether ``path`` is an image or array file that can hold depth."""
    return starts_with(path, *SIGNATURES)


def read(path: Path, frames: FrameChoice, options: ReadOptions) -> Capture:
    """Read one depth image, or an array of frames (F, H, W) from ``.npy``."""
    values = read_values(path, frames)
    height, width = values.shape[1:]
    notes: list[str] = []
    raw = is_raw_disparity(values) if options.raw_disparity is None else options.raw_disparity
    color_camera, pose, sensor, sensor_from, camera = None, None, "unknown", "file", None
    stated = options.depth_unit_m if options.depth_unit_m is not None else options.lens_unit_m
    beside = next((path.parent / name for name in INTRINSIC_NAMES if (path.parent / name).is_file()), None)
    if beside is not None:
        lens = read_lens_file(beside, options.intrinsics is None)
        fits = lens.intrinsics is None or (lens.intrinsics.width, lens.intrinsics.height) == (width, height)
        if fits:
            options = replace(options, intrinsics=options.intrinsics or lens.intrinsics)
            stated = lens.unit_m if stated is None else stated
            sensor, sensor_from = sensor_named(lens.sensor), lens.sensor_from
            notes += lens.notes
        elif options.intrinsics is None and lens.intrinsics is not None:
            notes.append(
                Notice(
                    "{name} is for {lens_width}×{lens_height} pixels, depth has {width}×{height}: it was not used",
                    name=beside.name, lens_width=lens.intrinsics.width, lens_height=lens.intrinsics.height,
                    width=width, height=height,
                )
            )  # fmt: skip
    if raw:
        if values.dtype.kind not in "ui" or (width, height) != (640, 480):
            raise CaptureError(
                f"{path}: is {width}×{height} {values.dtype}; raw Kinect v1 disparity is 640×480 integers"
            )
        depth = depth_of_disparity(options.disparity)[np.clip(values, 0, 2047)]
        camera, color_camera, pose = calibration(options.kinect_calibration)
        sensor, sensor_from = "kinect_v1", "format"
        notes.append(Notice("raw Kinect v1 disparity, by the {formula} formula", formula=options.disparity))
    else:
        depth, note = metres(values, stated)
        notes += [note] if note else []
        if stated is not None and options.depth_unit_m is None:
            notes += doubt(values, stated)
        nominal = nominal_camera(width, height)
        if options.intrinsics is None and nominal is None:
            raise CaptureError(
                f"{path}: the intrinsics of these {width}×{height} pixels are unknown; give them, or put an "
                f"{INTRINSIC_NAMES[0]} beside the file",
                code="lens_missing",
            )
        if options.intrinsics is None and nominal is not None:
            camera, sensor, note = nominal
            sensor_from = "size"
            notes.append(note)
    color = None
    if options.color:
        found = color_beside(path)
        if found is not None:
            color = rgb(read_image(found))
            intrinsics = options.intrinsics or camera
            described = (found.parent / COLOR_INTRINSIC_NAME).is_file()
            if described and intrinsics is not None:
                color_camera, pose, said = color_camera_of(found.parent, found, color, intrinsics)
                notes += said
            elif color_camera is None and color.shape[:2] != (height, width):
                notes.append(
                    Notice(
                        "{name} is left out: it is {width}×{height}, not aligned to depth",
                        name=found.name, width=color.shape[1], height=color.shape[0],
                    )
                )  # fmt: skip
                color = None
            elif color_camera is not None and color.shape[:2] != (color_camera.height, color_camera.width):
                color_camera = color_camera.scaled(color.shape[1], color.shape[0])
    intrinsics = options.intrinsics or camera
    assert intrinsics is not None  # either branch above gives a camera or raises
    return stored_capture(
        path, FORMAT, depth, color, intrinsics, color_camera, pose, sensor=sensor, sensor_from=sensor_from, notes=notes
    )


def read_values(path: Path, frames: FrameChoice = None) -> np.ndarray:
    """The numbers of a depth image or array, as they are stored (F, H, W)."""
    if starts_with(path, b"\x93NUMPY"):
        return _read_npy(path, frames)
    values = _read_pgm(path) if starts_with(path, b"P5") else read_image(path, ("depth", "z"))
    if values.ndim == 3 and values.dtype == np.float32:
        values = values[..., 0]  # EXR writers repeat gray, or add alpha
    if values.ndim != 2 or values.dtype.itemsize == 1:
        raise CaptureError(
            f"{path}: is an 8-bit or colour picture; depth must be 16-bit gray or floating point. "
            "Save the frame again without converting it",
            code="not_a_capture",
        )
    chosen_frames(path, frames, 1)
    return values[None]


def _read_npy(path: Path, frames: FrameChoice) -> np.ndarray:
    with blaming(path, "an array of numpy"):
        with open(path, "rb") as file:
            shape, dtype, columns = npy_header(file, columns=True)
            stored_shape = shape
            if len(shape) > 2 and shape[-1] == 1:  # a single channel
                shape = shape[:-1]
            if len(shape) not in (2, 3) or 0 in shape:
                raise ValueError(f"{dtype} of shape {shape}")
            start = file.tell()
        if path.stat().st_size - start != math.prod(shape) * dtype.itemsize:
            raise ValueError(f"shape {shape} is not what the file holds")
        shape = shape if len(shape) == 3 else (1, *shape)
        chosen = chosen_frames(path, frames, shape[0])
        if len(chosen) * shape[1] * shape[2] > MAX_BURST_PIXELS:
            raise CaptureError(f"{path}: is more than memory should hold; choose fewer frames", code="memory")
        stored = np.memmap(path, dtype, "r", start, stored_shape, order="F" if columns else "C").reshape(shape)
        return np.array(stored[chosen.start : chosen.stop : chosen.step]).astype(dtype.newbyteorder("="), copy=False)


def _read_pgm(path: Path) -> np.ndarray:
    """Binary PGM of 16 bits in whichever byte order makes the picture smooth: libfreenect writes the wrong one."""
    data = read_limited(path, 2 * MAX_PIXELS + 4096)
    match = re.match(
        rb"P5(?:\s|#[^\n]*\n)+(\d{1,6})(?:\s|#[^\n]*\n)+(\d{1,6})(?:\s|#[^\n]*\n)+(\d{1,5})\s", data[:4096]
    )
    if match is None:
        raise CaptureError(f"{path}: has no header of a PGM, or one of an impossible size; copy or record it again")
    width, height, largest = (int(n) for n in match.groups())
    size = width * height
    if largest < 256:
        raise CaptureError(
            f"{path}: is an 8-bit picture; depth must have 16 bits. Record the depth stream itself",
            code="not_a_capture",
        )
    if not size or len(data) - match.end() < 2 * size:
        raise CaptureError(f"{path}: is truncated: {width}×{height} pixels are not all there; copy it again")
    orders = [np.frombuffer(data, order, size, match.end()).reshape(height, width) for order in ("<u2", ">u2")]
    little, big = orders
    rough = [float(np.abs(np.diff(v.astype(np.float32), axis=1)).mean()) if width > 1 else 0.0 for v in orders]
    return (little if rough[0] < rough[1] else big).astype(np.uint16)


def color_beside(path: Path) -> Path | None:
    """The colour image whose name differs from the depth image's only by the word for its kind."""
    if "depth" not in path.stem.lower():
        return None
    for word in ("color", "colour", "rgb", "image"):
        stem = re.sub("depth", word, path.stem, flags=re.IGNORECASE)
        for suffix in COLOR_SUFFIXES:
            candidate = path.with_name(stem + suffix)
            if candidate.is_file():
                return candidate
    return None
