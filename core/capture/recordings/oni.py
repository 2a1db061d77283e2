"""OpenNI recordings, ``.oni``: of Kinect v1, Xtion and other PrimeSense cameras, by OpenNI 1 and 2 and NiTE's tools."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...camera import Intrinsics
from ...errors import CaptureError, Notice
from ..capture import Capture, ReadOptions, stored_capture
from ..decoding.binary import blaming, image_in, mapped, rgb, starts_with, yuyv_to_rgb
from ..decoding.file_indices import index_of
from ..frames import FrameChoice, apart_note, chosen_frames, empty_burst
from ..kinect_disparity import NOMINAL_COLOR, depth_of_disparity

FORMAT = "OpenNI .oni"
SIGNATURE = b"NI10"
MAX_SIDE = 8192
MAX_FRAMES = 200_000
DEFAULT_FOV = (1.0144686707507438, 0.78980943449644714)  # of PrimeSense's depth camera [rad]
DEPTH, IMAGE = 2, 3  # types of nodes
UNITS = {100: 0.001, 101: 0.0001}  # oniPixelFormat -> metres; 102 is raw disparity
_RAW = 102


@dataclass
class _Node:
    kind: int
    codec: bytes
    properties: dict[str, bytes] = field(default_factory=dict)
    frames: list[tuple[int, int, int]] = field(default_factory=list)  # time [µs], extent of the bytes

    def number(self, *names: str) -> int | None:
        """The first of the properties that is there, as a whole number."""
        for name in names:
            raw = self.properties.get(name)
            if raw is not None and 1 <= len(raw) <= 8:
                return int.from_bytes(raw, "little")
        return None


def recognises(path: Path) -> bool:
    """Whether ``path`` begins as OpenNI's recordings do."""
    return starts_with(path, SIGNATURE)


def read(path: Path, frames: FrameChoice, options: ReadOptions) -> Capture:
    """Read depth frames and the colour frame nearest in time to the first of them."""
    with mapped(path) as data, blaming(path, "an OpenNI recording"):
        nodes, truncated = index_of(path, FORMAT, lambda: _nodes(data, path))
        notes = ["the recording was cut off; the frames before that are read"] if truncated else []
        node = next((n for n in nodes if n.kind == DEPTH and n.frames), None)
        if node is None:
            raise CaptureError(f"{path}: holds no depth frame; record with the depth stream on", code="empty")
        width, height = _size(node)
        chosen = chosen_frames(path, frames, len(node.frames))
        unit, table = _unit(node, options)
        depth = empty_burst(path, len(chosen), height, width)
        for i, number in enumerate(chosen):
            _, first, last = node.frames[number]
            values = _depth_values(bytes(data[first:last]), node.codec, width * height).reshape(height, width)
            depth[i] = table[np.minimum(values, 2047)] if table is not None else values / np.float32(1 / unit)
        camera = options.intrinsics or _intrinsics(node, width, height)
        color = color_camera = pose = None
        image = next((n for n in nodes if n.kind == IMAGE and n.frames), None)
        if options.color and image is not None:
            time = node.frames[chosen[0]][0]
            shown, first, last = min(image.frames, key=lambda frame: abs(frame[0] - time))
            notes += apart_note((shown - time) * 1e-6)
            color, problem = _color(bytes(data[first:last]), image, path)
            notes += [problem] if problem else []
            if color is not None:
                registered = node.number("Registration", "oniRegistration")
                if registered == 0:
                    color_camera = NOMINAL_COLOR.scaled(color.shape[1], color.shape[0])
                    pose = np.eye(4)
                    pose[0, 3] = -_real(node, "DCRCDIS", 2.3) / 100
                elif color.shape[:2] != (height, width):
                    # registered depth has the colour camera's view, at its own size
                    color_camera, pose = camera.pinhole().scaled(color.shape[1], color.shape[0]), np.eye(4)
                if registered is None:
                    notes.append("the recording does not say whether depth is registered to colour; taken so")
        mirrored = bool(node.number("xnMirror"))
    return stored_capture(
        path,
        FORMAT,
        depth,
        color,
        camera,
        color_camera,
        pose,
        sensor="kinect_v1",
        sensor_from="format",
        mirrored=mirrored,
        notes=notes,
    )


def _nodes(data: memoryview, path: Path) -> tuple[list[_Node], bool]:
    """Streams with their properties and frames, and whether the file ends in the middle of something."""
    major, minor, maintenance, build = struct.unpack_from("<BBHI", data, 4)
    if major != 1:
        raise CaptureError(
            f"{path}: is an OpenNI recording of version {major}.{minor}, which is not known; record it with OpenNI 2",
            code="not_a_capture",
        )
    # Before 1.0.1 the position of the record to undo had 32 bits.
    size = 28 if (minor, maintenance, build) >= (0, 1, 0) else 24
    nodes: dict[int, _Node] = {}
    position, frames = 24, 0
    while position + size <= len(data):
        magic, kind, number, fields, payload = struct.unpack_from("<4sIIII", data, position)
        if magic != b"NIR\0" or fields < size:
            if not nodes:
                raise ValueError("no record begins where one should")
            return list(nodes.values()), True
        start, end = position + size, position + fields
        if end + payload > len(data):
            return list(nodes.values()), True
        if kind in (0x02, 0x0C, 0x0D):
            _, at = _string(data, start, end)
            node_kind, codec = struct.unpack_from("<i4s", data, at)
            nodes[number] = _Node(node_kind, codec)
        elif kind in (0x03, 0x04, 0x05, 0x06) and number in nodes:
            name, at = _string(data, start, end)
            (length,) = struct.unpack_from("<I", data, at)
            if length <= 4096 and at + 4 + length <= end:
                nodes[number].properties[name] = bytes(data[at + 4 : at + 4 + length])
        elif kind == 0x0A and number in nodes:
            (time,) = struct.unpack_from("<Q", data, start)
            frames += 1
            if frames > MAX_FRAMES:
                raise CaptureError(f"{path}: has more than {MAX_FRAMES} frames; cut the recording", code="frames")
            if payload:
                nodes[number].frames.append((time, end, end + payload))
        elif kind == 0x0B:
            return list(nodes.values()), False
        position = end + payload
    return list(nodes.values()), position != len(data)


def _string(data: memoryview, start: int, end: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", data, start)
    if length > 4096 or start + 4 + length > end:
        raise ValueError("a name reaches beyond its record")
    return bytes(data[start + 4 : start + 4 + length]).split(b"\0")[0].decode("latin-1"), start + 4 + length


def _size(node: _Node) -> tuple[int, int]:
    """Size of the frames: of the crop where one is set, else of the output mode."""
    width, height = struct.unpack_from("<II", node.properties["xnMapOutputMode"])
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise ValueError(f"frames of {width}×{height}")
    crop = _crop(node)
    if crop and (crop[0] + crop[2] > width or crop[1] + crop[3] > height):
        raise ValueError("the crop reaches beyond the frame")
    return (crop[2], crop[3]) if crop else (width, height)


def _crop(node: _Node) -> tuple[int, int, int, int] | None:
    """Corner and size of the crop, if one is on."""
    raw = node.properties.get("xnCropping", b"")
    if len(raw) not in (10, 12):  # the flag is a whole number of four bytes, or was packed to two
        return None
    enabled = int.from_bytes(raw[:-8], "little")
    left, top, width, height = struct.unpack("<4H", raw[-8:])
    return (left, top, width, height) if enabled and width and height else None


def _intrinsics(node: _Node, width: int, height: int) -> Intrinsics:
    """From the field of view, which OpenNI centres on the middle of the whole frame."""
    fov = node.properties.get("xnFOV", b"")
    across, down = struct.unpack("<2d", fov) if len(fov) == 16 else DEFAULT_FOV
    if not (0.1 < across < 3 and 0.1 < down < 3):
        raise ValueError(f"a field of view of {across} × {down} rad")
    whole = struct.unpack_from("<II", node.properties["xnMapOutputMode"])
    left, top = (_crop(node) or (0, 0))[:2]
    return Intrinsics(
        width,
        height,
        whole[0] / (2 * math.tan(across / 2)),
        whole[1] / (2 * math.tan(down / 2)),
        whole[0] / 2 - left,
        whole[1] / 2 - top,
    )


def _real(node: _Node, name: str, default: float) -> float:
    raw = node.properties.get(name, b"")
    value = struct.unpack("<d", raw)[0] if len(raw) == 8 else default
    return value if math.isfinite(value) and 0 <= value < 100 else default


def _unit(node: _Node, options: ReadOptions) -> tuple[float, np.ndarray | None]:
    """Metres per unit, or the table for raw disparity."""
    if options.depth_unit_m is not None:
        return options.depth_unit_m, None
    kind = node.number("oniPixelFormat")
    if kind == _RAW or options.raw_disparity:
        return 0.0, depth_of_disparity(options.disparity)
    if kind is not None and kind not in UNITS:
        raise ValueError(f"depth of pixel format {kind}")
    return (0.001 if kind is None else UNITS[kind]), None


def _depth_values(data: bytes, codec: bytes, count: int) -> np.ndarray:
    if codec in (b"16zP", b"16zT"):
        from ..decoding.openni_codec import decode_16z  # brings numba

        return decode_16z(data, count, table=codec == b"16zT")
    if codec in (b"NONE", b"\0\0\0\0"):
        if len(data) != 2 * count:
            raise ValueError(f"an uncompressed frame of {len(data)} bytes")
        return np.frombuffer(data, "<u2")
    raise ValueError(f"depth in codec {codec!r}")


def _color(data: bytes, node: _Node, path: Path) -> tuple[np.ndarray | None, str]:
    """Colour (H, W, 3) uint8, or None and why."""
    if node.codec == b"JPEG":
        return rgb(image_in(data, path, "a colour frame")), ""
    width, height = _size(node)
    kind = node.number("oniPixelFormat")
    kind = kind if kind is not None else {1: 200, 2: 201, 3: 202, 5: 204}.get(node.number("xnPixelFormat") or 0)
    size = None if kind is None else {200: 3, 201: 2, 205: 2, 202: 1}.get(kind)
    if node.codec in (b"NONE", b"\0\0\0\0") and kind == 204:
        return rgb(image_in(data, path, "a colour frame")), ""
    if node.codec not in (b"NONE", b"\0\0\0\0") or size is None:
        return None, Notice(
            "colour is left out: its codec {codec!r} or pixel format {kind} is not known", codec=node.codec, kind=kind
        )
    if len(data) != width * height * size or (size == 2 and width % 2):
        raise ValueError(f"an uncompressed colour frame of {len(data)} bytes")
    pixels = np.frombuffer(data, np.uint8).reshape(height, width, size)
    if size == 2:
        return yuyv_to_rgb(pixels, luma_first=kind == 205), ""
    return rgb(pixels[..., 0]) if size == 1 else pixels.copy(), ""
