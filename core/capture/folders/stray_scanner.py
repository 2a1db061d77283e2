"""Stray Scanner (iPhone, iPad): ``depth/``, ``confidence/``, ``camera_matrix.csv``, ``odometry.csv``, ``rgb.mp4``.

The matrix is for the video's 1920 × 1440 pixels and is scaled to the 256 × 192 of depth. Gravity, from the poses,
shows how the phone was held. Colour needs PyAV, an optional extra.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ...camera import Intrinsics
from ...errors import CaptureError, Notice
from ...io.images import read_image
from ...io.json_files import text_of
from ..capture import Capture, ReadOptions, stored_capture
from ..decoding.binary import read_limited
from ..depth_units import metres
from ..frames import FrameChoice, chosen_frames, empty_burst
from ..single_files.single_image import read_values

FORMAT = "Stray Scanner"
VIDEO_SIZE = (1920, 1440)  # what camera_matrix.csv is for
MAX_CSV = 256_000_000


def recognises(path: Path) -> bool:
    """Whether ``path`` is a folder with the app's camera matrix and depth."""
    return path.is_dir() and (path / "camera_matrix.csv").is_file() and (path / "depth").is_dir()


def read(path: Path, frames: FrameChoice, options: ReadOptions) -> Capture:
    """Read depth, its confidence, and the colour image of the first chosen frame."""
    files = sorted((int(p.stem), p) for p in (path / "depth").iterdir() if re.fullmatch(r"\d{1,9}\.(npy|png)", p.name))
    chosen = [files[i] for i in chosen_frames(path / "depth", frames, len(files))]
    depth = confidence = None
    for i, (number, file) in enumerate(chosen):
        values = read_values(file)[0]
        if depth is None:
            depth = empty_burst(path, len(chosen), *values.shape)
            if (path / "confidence" / f"{number:06d}.png").is_file():
                confidence = np.zeros(depth.shape, np.uint8)
        if values.shape != depth.shape[1:]:
            raise CaptureError(f"{file}: is of another size than the first frame")
        depth[i] = metres(values, options.depth_unit_m or (0.001 if values.dtype.kind in "ui" else None))[0]
        if confidence is not None:
            trust = read_image(path / "confidence" / f"{number:06d}.png")
            if trust.shape != values.shape:
                raise CaptureError(f"{path / 'confidence'}: frame {number} is not of the size of depth")
            confidence[i] = np.minimum(trust, 2)
    assert depth is not None  # chosen_frames gives at least one
    height, width = depth.shape[1:]
    camera = options.intrinsics or _intrinsics(path / "camera_matrix.csv").scaled(width, height)
    color, notes = None, []
    if options.color and (path / "rgb.mp4").is_file():
        color, note = video_frame(path / "rgb.mp4", chosen[0][0])
        notes += [note] if note else []
    color_camera = camera.pinhole().scaled(color.shape[1], color.shape[0]) if color is not None else None
    rotation = _turn(path / "odometry.csv", chosen[0][0])
    return stored_capture(
        path, FORMAT, depth, color, camera, color_camera, np.eye(4), sensor="phone", sensor_from="format",
        confidence=confidence, turn_degrees=rotation, notes=notes,
    )  # fmt: skip


def video_frame(path: Path, number: int) -> tuple[np.ndarray | None, str]:
    """Frame ``number`` of a video (H, W, 3) uint8, or None and why there is none."""
    try:
        import av
    except ImportError:
        return None, "colour is left out: reading video needs PyAV; install it with “pip install mirror_scan[video]”"
    try:
        with av.open(str(path)) as video:
            for i, frame in enumerate(video.decode(video=0)):
                if i == number:
                    return np.ascontiguousarray(frame.to_ndarray(format="rgb24")), ""
    except (av.FFmpegError, IndexError, ValueError) as error:
        raise CaptureError(f"{path}: cannot be decoded ({error}); copy it again or remove it") from error
    return None, Notice("colour is left out: {name} ends before frame {number}", name=path.name, number=number)


def _intrinsics(path: Path) -> Intrinsics:
    """Of the video, from a matrix of three rows."""
    text = text_of(read_limited(path, 100_000))
    try:
        k = [float(word) for word in re.split(r"[,\s]+", text.strip())]
    except ValueError:
        k = []
    if len(k) != 9:
        raise CaptureError(f"{path}: must hold the nine numbers of a camera matrix, row by row", code="lens_wrong")
    return Intrinsics(*VIDEO_SIZE, k[0], k[4], k[2], k[5])


def _turn(path: Path, number: int) -> int:
    """Clockwise rotation [degrees] that makes the picture upright; 0 where it is unknown.

    The poses take camera-frame points (x right, y down, z forward) into ARKit's world, whose y axis points up.
    """
    if not path.is_file():
        return 0
    lines = text_of(read_limited(path, MAX_CSV)).splitlines()
    if len(lines) < 2:
        return 0
    names = [name.strip() for name in lines[0].split(",")]
    words = lines[min(1 + number, len(lines) - 1)].split(",")
    try:
        x, y, z, w = (float(words[names.index(n)]) for n in ("qx", "qy", "qz", "qw"))
    except (ValueError, IndexError) as error:
        raise CaptureError(
            f"{path}: has no pose qx, qy, qz, qw of frame {number}; remove the file to read without poses"
        ) from error
    length = np.sqrt(x * x + y * y + z * z + w * w)
    if not 0.5 < length < 2:
        raise CaptureError(f"{path}: the pose of frame {number} is no rotation; remove the file to read without poses")
    x, y, z, w = (value / length for value in (x, y, z, w))
    down = -np.array((2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)))  # minus the matrix's row y
    if abs(down[2]) > 0.8:  # the phone looked at the floor or the ceiling
        return 0
    across, along = down[:2]
    if abs(across) > abs(along):
        return 90 if across > 0 else 270
    return 0 if along > 0 else 180
