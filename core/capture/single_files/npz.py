"""Mirror Scan's own file, ``.npz``: an opened capture as numpy arrays, quick to write and to read.

Members: ``depth`` (F, H, W) float32 m, ``camera`` (6,) float64 width, height, fx, fy, cx, cy, ``color`` (H, W, 3)
uint8 and ``confidence`` (F, H, W) uint8 where there are any, and ``about``, a JSON text with name, format, sensor,
notes and mirrors. Where the colour camera's own pixels were kept and are others than ``color``: ``native_color``
(Hc, Wc, 3) uint8, ``color_camera`` (6,) float64 as ``camera``, and ``depth_to_color`` (4, 4) float64; they are read
only when they are asked for.
"""

from __future__ import annotations

import json
import math
import os
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from ...camera import Intrinsics
from ...camera.pinhole import is_rigid
from ...errors import CaptureError, OutputError
from ...io.atomic_files import replacing
from ..capture import Capture, ReadOptions
from ..decoding.binary import blaming, npy_header, starts_with
from ..decoding.file_indices import index_of
from ..folders.rgbd_folder import mirrors_from, mirrors_to
from ..frames import FrameChoice, chosen_frames, empty_burst

FORMAT = "Mirror Scan .npz"
MAX_TEXT = 4_000_000


def recognises(path: Path) -> bool:
    """Whether ``path`` is a zip archive with a depth and a camera array."""
    if not starts_with(path, b"PK\x03\x04"):
        return False
    try:
        return index_of(path, FORMAT, lambda: {"depth.npy", "camera.npy"} <= _names(path))
    except (zipfile.BadZipFile, ValueError, NotImplementedError):
        return path.suffix.lower() == ".npz"


def write_npz(path: str | os.PathLike, capture: Capture) -> None:
    """Write an opened capture; a file already there is replaced only when the new one is complete.

    Raises
    ------
    OutputError
        When the file cannot be written, or the capture is not one that was opened.
    """
    path, camera = Path(path), capture.intrinsics
    own, own_camera, pose = capture.native_color, capture.color_intrinsics, capture.depth_to_color
    straight = camera.is_pinhole and (own_camera is None or own_camera.is_pinhole)
    if not straight or (own is None) != (own_camera is None) or (own is None) != (pose is None):
        raise OutputError(f"{path}: holds opened captures only; straighten and align this one first")
    arrays: dict[str, np.ndarray | None] = {
        "depth": np.asarray(capture.depth, np.float32),
        "camera": _six(camera),
        "color": capture.color,
        "confidence": capture.confidence,
    }
    if own is not None and own is not capture.color and own_camera is not None:
        arrays |= {
            "native_color": own,
            "color_camera": _six(own_camera),
            "depth_to_color": np.asarray(pose, np.float64),
        }
    about = {
        "name": capture.name,
        "format": capture.format,
        "sensor": capture.sensor,
        "sensor_from": capture.sensor_from,
        "notes": capture.notes,
        "mirrors": mirrors_to(capture.mirrors),
    }
    with replacing(path) as temporary, open(temporary, "wb") as file:
        np.savez(
            file,
            about=np.frombuffer(json.dumps(about).encode(), np.uint8),
            **{name: np.ascontiguousarray(array) for name, array in arrays.items() if array is not None},
        )


def _names(path: Path) -> set[str]:
    with zipfile.ZipFile(path) as archive:
        return set(archive.namelist())


def read(path: Path, frames: FrameChoice, options: ReadOptions) -> Capture:
    """Read what :func:`write_npz` wrote; member sizes are checked before anything is unpacked."""
    with blaming(path, "a capture of Mirror Scan"):
        try:
            with zipfile.ZipFile(path) as archive:
                intrinsics = _camera(archive, path, "camera")
                width, height = intrinsics.width, intrinsics.height
                stored = _member(archive, path, "depth", ("f4",), 3)
                if stored.shape[1:] != (height, width):
                    raise ValueError("depth is not of the camera's size")
                chosen = chosen_frames(path, frames, len(stored))
                depth = empty_burst(path, len(chosen), height, width)
                depth[:] = stored[chosen.start : chosen.stop : chosen.step]
                np.copyto(depth, 0, where=~(np.isfinite(depth) & (depth > 0)))
                color = _member(archive, path, "color", ("u1",), 3) if "color.npy" in archive.namelist() else None
                confidence = None
                if "confidence.npy" in archive.namelist():
                    confidence = _member(archive, path, "confidence", ("u1",), 3)
                    if confidence.shape != stored.shape:
                        raise ValueError("confidence is not of the depth's shape")
                    confidence = confidence[chosen.start : chosen.stop : chosen.step]
                if color is not None and color.shape != (height, width, 3):
                    raise ValueError("colour is not of the depth's size")
                own = _native(archive, path) if options.native_color and options.color and color is not None else {}
                about = json.loads(_member(archive, path, "about", ("u1",), 1).tobytes())
        except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RecursionError, RuntimeError) as error:
            raise CaptureError(f"{path}: is damaged ({error}); copy or save it again") from error
        return Capture(
            depth,
            color,
            intrinsics,
            mirrors_from(path, about, intrinsics),
            name=str(about["name"])[:200],
            format=FORMAT,
            sensor=str(about["sensor"])[:40],
            sensor_from=str(about.get("sensor_from", "file"))[:40],
            confidence=confidence,
            notes=tuple(str(note)[:400] for note in list(about["notes"])[:20]),
            **own,
        )


def _six(camera: Intrinsics) -> np.ndarray:
    return np.array((camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy), np.float64)


def _camera(archive: zipfile.ZipFile, path: Path, name: str) -> Intrinsics:
    camera = _member(archive, path, name, ("f8",), 1)
    if camera.shape != (6,) or not np.isfinite(camera).all():
        raise ValueError(f"{name} is not six numbers")
    width, height = (int(n) for n in camera[:2])
    fx, fy, cx, cy = (float(v) for v in camera[2:])
    return Intrinsics(width, height, fx, fy, cx, cy)


def _native(archive: zipfile.ZipFile, path: Path) -> dict[str, Any]:
    """The fields of native colour, where the file has it."""
    if "native_color.npy" not in archive.namelist():
        return {}
    camera = _camera(archive, path, "color_camera")
    pose = _member(archive, path, "depth_to_color", ("f8",), 2)
    if pose.shape != (4, 4) or not is_rigid(pose):
        raise ValueError("depth_to_color is not a rotation and a shift")
    color = _member(archive, path, "native_color", ("u1",), 3)
    if color.shape != (camera.height, camera.width, 3):
        raise ValueError("native_color is not of its camera's size")
    return {"native_color": color, "color_intrinsics": camera, "depth_to_color": pose}


def _member(archive: zipfile.ZipFile, path: Path, name: str, kinds: tuple[str, ...], dimensions: int) -> np.ndarray:
    """One array, its header checked against the size the archive states."""
    entry = archive.getinfo(f"{name}.npy")
    if name == "about" and entry.file_size > MAX_TEXT:
        raise CaptureError(f"{path}: {name} is far too large for what it should hold")
    if entry.compress_type != zipfile.ZIP_STORED and entry.file_size > 1100 * max(entry.compress_size, 1):
        raise CaptureError(f"{path}: {name} unpacks to more than it can hold; save it again")
    with archive.open(entry) as file:
        shape, dtype, _ = npy_header(file)
        if dtype.str[1:] not in kinds or len(shape) != dimensions:
            raise ValueError(f"{name} is {dtype} with {len(shape)} dimensions")
        size = math.prod(shape) * dtype.itemsize
        if size != entry.file_size - file.tell():
            raise ValueError(f"{name} states another size than it has")
        if size > 4 * 256_000_000:
            raise CaptureError(f"{path}: {name} is more than memory should hold; save fewer frames", code="memory")
        data = file.read(size)
        if len(data) != size:
            raise ValueError(f"{name} is cut short")
    return np.frombuffer(data, dtype).reshape(shape)
