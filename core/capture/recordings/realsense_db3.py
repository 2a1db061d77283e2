"""RealSense recordings, ``.db3``, as the SDK writes them since 2.57: an SQLite file of ROS 2 messages.

Images are PNGs inside ``CompressedImage`` messages; everything else is text of ``key=value`` pairs.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np

from ...camera import Intrinsics
from ...errors import CaptureError
from ..capture import Capture, ReadOptions, stored_capture
from ..decoding.binary import blaming, image_in, rgb, starts_with
from ..decoding.file_indices import index_of
from ..depth_units import metres
from ..folders.rgbd_folder import sensor_named
from ..frames import FrameChoice, apart_note, chosen_frames, empty_burst
from .realsense_bag import MAX_SIDE, brown_of_inverse

FORMAT = "RealSense .db3"
SIGNATURE = b"SQLite format 3\0"
MAX_MESSAGE = 64_000_000
MAX_FRAMES = 200_000
MAX_STEPS = 200  # of 100 000 instructions of SQLite's machine each; a forged schema must not run on
DEPTH_ENDS, COLOR_ENDS = "/image/data/compressedDepth", "/image/data/compressed"


def recognises(path: Path) -> bool:
    """Whether ``path`` is an SQLite file."""
    return starts_with(path, SIGNATURE)


def read(path: Path, frames: FrameChoice, options: ReadOptions) -> Capture:
    """Read depth frames and the colour frame nearest in time to the first of them."""
    with _opened(path) as file, blaming(path, "a recording of RealSense's SDK"):
        topics = {str(name): int(number) for number, name in _rows(file, "SELECT id, name FROM topics LIMIT 10000")}
        depth_topic = next((name for name in topics if name.endswith(DEPTH_ENDS)), None)
        if depth_topic is None:
            raise CaptureError(
                f"{path}: has no depth images as RealSense's SDK writes them; record the depth stream", code="empty"
            )
        listed = _messages(file, topics[depth_topic])
        chosen = chosen_frames(path, frames, len(listed))
        base = depth_topic.removesuffix(DEPTH_ENDS)
        stated = _text(file, topics, base.rpartition("/")[0] + "/option/Depth_Units/value", "0.001")
        unit = options.depth_unit_m or float(stated)
        if not 1e-6 <= unit <= 1:
            raise ValueError(f"a depth unit of {unit} m")
        depth = None
        for i, number in enumerate(chosen):
            values = image_in(_png(_message(file, listed[number][1])), path, f"depth frame {number}", ".png")
            if values.dtype != np.uint16 or values.ndim != 2:
                raise ValueError("depth is not of 16 bits")
            if depth is None:
                depth = empty_burst(path, len(chosen), *values.shape)
            if values.shape != depth.shape[1:]:
                raise ValueError("depth frames are not of one size")
            depth[i] = metres(values, unit)[0]
        assert depth is not None  # chosen_frames gives at least one
        camera = options.intrinsics or _intrinsics(_text(file, topics, f"{base}/camera_info"))
        color = color_camera = pose = None
        notes = []
        color_topic = next((name for name in topics if name.endswith(COLOR_ENDS) and "Color" in name), None)
        if options.color and color_topic is not None:
            paint = color_topic.removesuffix(COLOR_ENDS)
            pictures = _messages(file, topics[color_topic])
            if pictures:
                time = listed[chosen[0]][0]
                nearest = min(pictures, key=lambda entry: abs(entry[0] - time))
                notes += apart_note((nearest[0] - time) * 1e-9)
                color = rgb(image_in(_png(_message(file, nearest[1])), path, "a colour frame", ".png"))
                color_camera = _intrinsics(_text(file, topics, f"{paint}/camera_info"))
                depth_place, color_place = (_place(file, topics, prefix) for prefix in (base, paint))
                if depth_place is None or color_place is None:
                    notes.append("colour is left out: the recording does not say how it is aligned to depth")
                    color = color_camera = None
                else:
                    pose = color_place @ np.linalg.inv(depth_place)
        sensor = sensor_named(_text(file, topics, "/device_0/info", ""))
    return stored_capture(path, FORMAT, depth, color, camera, color_camera, pose, sensor=sensor, notes=notes)


class _File(sqlite3.Connection):
    """An open recording that knows its name."""

    path = Path()


@contextmanager
def _opened(path: Path) -> Iterator[_File]:
    steps = 0

    def too_long() -> bool:
        nonlocal steps
        steps += 1
        return steps > MAX_STEPS

    try:
        with closing(
            sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True, factory=_File)
        ) as file:
            file.path = path
            file.set_progress_handler(too_long, 100_000)
            file.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_MESSAGE)
            yield file
    except sqlite3.Error as error:
        raise CaptureError(f"{path}: is a damaged recording ({error}); copy or record it again") from error


def _rows(file: sqlite3.Connection, query: str, values: tuple = ()) -> list[tuple]:
    return file.execute(query, values).fetchall()


def _messages(file: _File, topic: int) -> list[tuple[int, int]]:
    """Time [ns] and row of each message of a topic, in time."""
    query = "SELECT timestamp, id FROM messages WHERE topic_id = ? ORDER BY timestamp LIMIT ?"

    def find() -> list[tuple[int, int]]:
        return [(int(time), int(row)) for time, row in _rows(file, query, (topic, MAX_FRAMES))]

    return index_of(file.path, f"{FORMAT} {topic}", find)


def _message(file: sqlite3.Connection, row: int) -> bytes:
    found = _rows(file, "SELECT data FROM messages WHERE id = ?", (row,))
    if not found or not isinstance(found[0][0], bytes):
        raise ValueError("a message has no data")
    return found[0][0]


def _png(message: bytes) -> bytes:
    """The image in a message; ROS puts a header of its own in front of it."""
    start = message.index(b"\x89PNG\r\n\x1a\n")
    return message[start:]


def _text(file: _File, topics: dict[str, int], name: str, default: str | None = None) -> str:
    """All text messages of a topic, one after the other; ``default`` when there are none."""
    listed = _messages(file, topics[name])[:50] if name in topics else []
    if not listed and default is not None:
        return default
    if not listed:
        raise ValueError(f"{name[-60:]} is missing")
    parts = []
    for _, row in listed:
        message = _message(file, row)
        (length,) = struct.unpack_from("<I", message, 4)
        parts.append(message[8 : 8 + min(length, 4096)].rstrip(b"\0").decode("utf-8", "replace"))
    return ";".join(parts)


def _pairs(text: str) -> dict[str, str]:
    return {name.strip(): value for name, found, value in (part.partition("=") for part in text.split(";")) if found}


def _intrinsics(text: str) -> Intrinsics:
    pairs = _pairs(text)
    width, height = int(pairs["width"]), int(pairs["height"])
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise ValueError(f"images of {width}×{height}")
    distortion = tuple(float(k) for k in pairs.get("coeffs", "").split(",") if k)
    model = pairs.get("model", "").lower()
    if any(distortion) and not ("brown" in model or model in ("", "none")):
        raise CaptureError(
            f"intrinsics: a fisheye lens ({model[:30]}) is not supported; rectify the images", code="lens_wrong"
        )
    fx, fy, cx, cy = (float(pairs[name]) for name in ("fx", "fy", "ppx", "ppy"))
    camera = Intrinsics(width, height, fx, fy, cx, cy, distortion if any(distortion) else ())
    if model.startswith("inverse") and any(distortion):
        return Intrinsics(width, height, fx, fy, cx, cy, brown_of_inverse(distortion, camera.pinhole()))
    return camera


def _place(file: _File, topics: dict[str, int], prefix: str) -> np.ndarray | None:
    """Transform (4, 4) that takes points of the recording's reference into a stream's frame."""
    name = next((n for n in topics if n.startswith(f"{prefix}/tf/")), None)
    if name is None:
        return None
    pairs = _pairs(_text(file, topics, name))
    rotation = np.array([float(v) for v in pairs["rotation"].split(",")]).reshape(3, 3)
    pose = np.eye(4)
    pose[:3, :3] = rotation.T  # librealsense counts column by column
    pose[:3, 3] = [float(v) for v in pairs["translation"].split(",")]
    if not np.isfinite(pose).all() or abs(np.linalg.det(pose[:3, :3]) - 1) > 0.01:
        raise ValueError("a stream's place is not a rotation and a shift")
    return pose
