"""RealSense recordings, ``.bag`` of the SDK and its viewer; other ROS 1 bags with a depth image and its camera info."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...camera import Intrinsics
from ...camera.pinhole import brown_of_inverse
from ...errors import CaptureError
from ..capture import Capture, ReadOptions, stored_capture
from ..decoding.binary import blaming, image_in, mapped, rgb, starts_with, yuyv_to_rgb
from ..decoding.file_indices import index_of
from ..decoding.rosbag import SIGNATURE, RosBag, Topic
from ..depth_units import metres
from ..folders.rgbd_folder import sensor_named
from ..frames import FrameChoice, apart_note, chosen_frames, empty_burst

FORMAT = "RealSense .bag"
MAX_SIDE = 8192
IMAGE, CAMERA_INFO = "sensor_msgs/Image", "sensor_msgs/CameraInfo"
DEPTH_ENCODINGS = {"mono16": "<u2", "16uc1": "<u2", "z16": "<u2", "32fc1": "<f4"}


@dataclass
class _Image:
    width: int
    height: int
    encoding: str
    big_endian: bool
    step: int
    data: memoryview


def recognises(path: Path) -> bool:
    """Whether ``path`` is a ROS 1 bag."""
    return starts_with(path, SIGNATURE)


def read(path: Path, frames: FrameChoice, options: ReadOptions) -> Capture:
    """Read depth frames and the colour frame nearest in time to the first of them."""
    with mapped(path) as data, blaming(path, "a ROS bag"):
        bag = RosBag(data, path, index_of(path, FORMAT, lambda: RosBag(data, path).index))
        depth_topic = _depth_topic(bag, path)
        chosen = chosen_frames(path, frames, len(depth_topic.messages))
        notes = ["the recording was cut off; the frames before that are read"] if bag.truncated else []
        unit = options.depth_unit_m or _depth_unit(bag, depth_topic)
        depth = None
        for i, number in enumerate(chosen):
            values = _depth_values(_image(bag.message(depth_topic, number)))
            if depth is None:
                depth = empty_burst(path, len(chosen), *values.shape)
            if values.shape != depth.shape[1:]:
                raise ValueError("depth frames are not of one size")
            depth[i] = metres(values, unit)[0]
        assert depth is not None  # chosen_frames gives at least one
        camera = options.intrinsics or _intrinsics(bag, _info_topic(bag, depth_topic), path)
        color = color_camera = pose = None
        if options.color:
            color_topic = _color_topic(bag, depth_topic)
            if color_topic is not None:
                time = depth_topic.messages[chosen[0]][0]
                nearest = min(range(len(color_topic.messages)), key=lambda i: abs(color_topic.messages[i][0] - time))
                notes += apart_note((color_topic.messages[nearest][0] - time) * 1e-9)
                color = _color(_image(bag.message(color_topic, nearest)), path)
                if "aligned_depth_to_color" not in depth_topic.name:
                    color_camera = _intrinsics(bag, _info_topic(bag, color_topic), path)
                    pose = _depth_to_color(bag, depth_topic, color_topic)
                    if pose is None:
                        notes.append("colour is left out: the bag does not say how it is aligned to depth")
                        color = color_camera = None
        sensor = _sensor(bag)
        del bag, depth_topic  # releases the mapped file
    return stored_capture(path, FORMAT, depth, color, camera, color_camera, pose, sensor=sensor, notes=notes)


def _depth_topic(bag: RosBag, path: Path) -> Topic:
    images = [t for t in bag.topics.values() if t.kind == IMAGE and t.messages]
    depth = [t for t in images if "depth" in t.name.lower() or _first(bag, t).encoding in ("16uc1", "32fc1", "z16")]
    depth = [t for t in depth if _first(bag, t).encoding in DEPTH_ENCODINGS]
    if not depth:
        names = ", ".join(t.name for t in images[:6]) or "none"
        raise CaptureError(
            f"{path}: has no depth images (images: {names[:200]}); record with the depth stream on", code="empty"
        )
    return min(depth, key=lambda t: (not t.name.startswith("/device_"), "aligned_depth_to_color" not in t.name))


def _first(bag: RosBag, topic: Topic) -> _Image:
    return _image(bag.message(topic, 0))


def _color_topic(bag: RosBag, depth_topic: Topic) -> Topic | None:
    for topic in bag.topics.values():
        if topic.kind == IMAGE and topic.messages and topic is not depth_topic:
            if any(word in topic.name.lower() for word in ("color", "rgb")) and "depth" not in topic.name.lower():
                return topic
    return None


def _image(message: memoryview) -> _Image:
    position = 12
    (size,) = struct.unpack_from("<I", message, position)  # frame_id
    position += 4 + size
    height, width = struct.unpack_from("<II", message, position)
    (size,) = struct.unpack_from("<I", message, position + 8)
    if size > 64 or not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise ValueError(f"an image of {width}×{height}")
    position += 12
    encoding = bytes(message[position : position + size]).decode("ascii", "replace").lower().rstrip("\0")
    big, step, length = struct.unpack_from("<BII", message, position + size)
    start = position + size + 9
    if start + length > len(message):
        raise ValueError("an image is cut short")
    return _Image(width, height, encoding, bool(big), step, message[start : start + length])


def _rows(image: _Image, bytes_per_pixel: int) -> np.ndarray:
    """Pixels (H, W, bytes) without the padding at the end of rows."""
    used = image.width * bytes_per_pixel
    step = image.step or used
    if step < used or len(image.data) < step * (image.height - 1) + used:
        raise ValueError(f"an image of {len(image.data)} bytes is not {image.width}×{image.height} {image.encoding}")
    raw = np.frombuffer(image.data, np.uint8)
    rows = np.lib.stride_tricks.as_strided(raw, (image.height, used), (step, 1))
    return np.ascontiguousarray(rows).reshape(image.height, image.width, bytes_per_pixel)


def _depth_values(image: _Image) -> np.ndarray:
    if image.encoding not in DEPTH_ENCODINGS:
        raise ValueError(f"depth is {image.encoding[:20]}")
    kind = np.dtype(DEPTH_ENCODINGS[image.encoding])
    values = _rows(image, kind.itemsize).view(kind.newbyteorder(">") if image.big_endian else kind)[..., 0]
    return values.astype(kind.newbyteorder("="))


def _color(image: _Image, path: Path) -> np.ndarray:
    kind = image.encoding
    if kind in ("rgb8", "bgr8", "rgba8", "bgra8"):
        pixels = _rows(image, 4 if "a" in kind else 3)[..., :3]
        return np.ascontiguousarray(pixels[..., ::-1] if kind.startswith("bgr") else pixels)
    if kind in ("mono8", "8uc1", "y8"):
        return rgb(_rows(image, 1)[..., 0])
    if kind in ("yuyv", "yuv422_yuy2", "uyvy", "yuv422") and image.width % 2 == 0:
        return yuyv_to_rgb(_rows(image, 2), luma_first=kind in ("yuyv", "yuv422_yuy2"))
    if kind == "mjpeg":
        return rgb(image_in(image.data, path, "a colour frame"))
    raise CaptureError(
        f"{path}: colour is {kind[:20]!r}, which is not known; record colour as RGB8 or YUYV", code="color"
    )


def _info_topic(bag: RosBag, topic: Topic) -> Topic | None:
    """Camera info of an image topic: …/image/data has …/info/camera_info, …/image_raw has …/camera_info."""
    name = topic.name
    prefix = name.removesuffix("/image/data") + "/info" if name.endswith("/image/data") else name.rpartition("/")[0]
    return bag.find(f"{prefix}/camera_info", CAMERA_INFO)


def _intrinsics(bag: RosBag, topic: Topic | None, path: Path) -> Intrinsics:
    if topic is None:
        raise CaptureError(
            f"{path}: has no camera_info beside its images; give the intrinsics, or record it along",
            code="lens_missing",
        )
    message = bag.message(topic, 0)
    (size,) = struct.unpack_from("<I", message, 12)
    position = 16 + size
    height, width, size = struct.unpack_from("<III", message, position)
    position += 12
    model = bytes(message[position : position + min(size, 64)]).decode("ascii", "replace").lower()
    position += size
    (count,) = struct.unpack_from("<I", message, position)
    if count > 14:
        raise ValueError(f"a lens of {count} coefficients")
    intrinsics = struct.unpack_from(f"<{count}d", message, position + 4)
    k = struct.unpack_from("<9d", message, position + 4 + 8 * count)
    if (
        not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE)
        or not np.isfinite(intrinsics).all()
        or not np.isfinite(k).all()
    ):
        raise ValueError("the camera info makes no sense")
    if model.startswith(("ftheta", "kannala", "equidistant", "fisheye")) and any(intrinsics):
        raise CaptureError(
            f"{path}: its images are of a fisheye lens ({model}), which is not supported; rectify them",
            code="lens_wrong",
        )
    if len(intrinsics) not in (0, 4, 5, 8):
        intrinsics = intrinsics[:8] if len(intrinsics) > 8 and not any(intrinsics[8:]) else ()
    camera = Intrinsics(width, height, k[0], k[4], k[2], k[5], tuple(intrinsics) if any(intrinsics) else ())
    if model.startswith("inverse") and not camera.is_pinhole:
        pinhole = camera.pinhole()
        return Intrinsics(width, height, k[0], k[4], k[2], k[5], brown_of_inverse(camera.distortion, pinhole))
    return camera


def _depth_unit(bag: RosBag, depth_topic: Topic) -> float | None:
    """Metres per unit: the SDK's option; ROS knows millimetres for 16 bits and metres for floats."""
    topic = bag.find("/option/Depth_Units/value", "std_msgs/Float32")
    if topic is not None:
        (unit,) = struct.unpack_from("<f", bag.message(topic, 0))
        if not 1e-6 <= unit <= 1:
            raise ValueError(f"a depth unit of {unit} m")
        return round(unit, 9)
    return 0.001 if _first(bag, depth_topic).encoding != "32fc1" else 1.0


def _depth_to_color(bag: RosBag, depth_topic: Topic, color_topic: Topic) -> np.ndarray | None:
    """Transform (4, 4) between the two streams, each of whose /tf takes points of one reference into its frame."""
    poses = []
    for topic in (depth_topic, color_topic):
        prefix = topic.name.removesuffix("/image/data")
        found = next(
            (
                t
                for t in bag.topics.values()
                if t.name.startswith(f"{prefix}/tf/") and t.kind == "geometry_msgs/Transform" and t.messages
            ),
            None,
        )
        if found is None:
            return None
        values = struct.unpack_from("<7d", bag.message(found, 0))
        poses.append(_pose(np.array(values[:3]), np.array(values[3:])))
    return poses[1] @ np.linalg.inv(poses[0])


def _pose(shift: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """(4, 4) of a shift [m] and a quaternion x, y, z, w."""
    length = np.linalg.norm(quaternion)
    if not np.isfinite(shift).all() or np.abs(shift).max() > 10 or not 0.5 < length < 2:
        raise ValueError("a stream's place is not a rotation and a shift")
    x, y, z, w = quaternion / length
    pose = np.eye(4)
    pose[:3, :3] = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    pose[:3, 3] = shift
    return pose


def _sensor(bag: RosBag) -> str:
    """What the device calls itself, among the key-value pairs the SDK records."""
    for topic in bag.topics.values():
        if topic.kind == "diagnostic_msgs/KeyValue" and topic.name.endswith("/info"):
            for i in range(min(len(topic.messages), 20)):
                name = sensor_named(bytes(bag.message(topic, i)[:200]).decode("latin-1"))
                if name.startswith("realsense"):
                    return name
    return "unknown"
