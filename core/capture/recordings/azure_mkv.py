"""Azure Kinect and Orbbec Femto .mkv: depth b16g, colour MJPG, BGRA, NV12 or YUY2, calibration attached.

The attached calibration is the sensor's raw one, for the full chips; the modes crop and bin them, by the figures of
the Azure Kinect Sensor SDK.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from ...camera import Intrinsics
from ...errors import CaptureError
from ..capture import Capture, ReadOptions, stored_capture
from ..decoding.binary import blaming, image_in, mapped, rgb, starts_with, yuv_to_rgb, yuyv_to_rgb
from ..decoding.file_indices import index_of
from ..decoding.matroska import SIGNATURE, Track, parse
from ..frames import FrameChoice, apart_note, chosen_frames, empty_burst
from ..nominal_intrinsics import nominal_camera

FORMAT = "Azure Kinect .mkv"
MAX_SIDE = 8192
#: Depth mode by size: binned chip size, and the crop's corner in it [px].
DEPTH_MODES = {
    (640, 576): (1024, 1024, 192, 180),
    (320, 288): (512, 512, 96, 90),
    (1024, 1024): (1024, 1024, 0, 0),
    (512, 512): (512, 512, 0, 0),
}
#: Height of the colour chip's image from which a mode is cut, over its width: 4:3 whole, 16:9 cut in the middle.
_COLOR_CHIP = (4096, 3072)


def recognises(path: Path) -> bool:
    """Whether ``path`` is a Matroska file."""
    return starts_with(path, SIGNATURE)


def read(path: Path, frames: FrameChoice, options: ReadOptions) -> Capture:
    """Read depth frames and the colour frame nearest in time to the first of them."""
    with mapped(path) as data, blaming(path, "a Matroska recording"):
        content = index_of(path, FORMAT, lambda: parse(data, path))
        depth_track = _depth_track(content)
        if depth_track is None:
            names = ", ".join(f"{t.name or t.number} ({_fourcc(t)})" for t in content.tracks[:8]) or "none"
            raise CaptureError(
                f"{path}: has no depth track (its tracks: {names}); record with the depth stream on, "
                "and never convert the recording",
                code="empty",
            )
        width, height = depth_track.width, depth_track.height
        if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
            raise ValueError(f"a depth track of {width}×{height}")
        size = 2 * width * height
        whole = [frame for frame in depth_track.frames if frame[2] - frame[1] == size]
        if depth_track.frames and not whole:
            raise ValueError(f"no frame of the depth track has {width}×{height} pixels of 16 bits")
        chosen = chosen_frames(path, frames, len(whole))
        depth = empty_burst(path, len(chosen), height, width)
        unit = np.float32(1 / (options.depth_unit_m or 0.001))
        for i, number in enumerate(chosen):
            stored = np.frombuffer(data[whole[number][1] : whole[number][2]], ">u2").reshape(height, width)
            np.divide(stored, unit, out=depth[i])
            del stored  # a view of the mapped file
        notes = ["the recording was cut off; the frames before that are read"] if content.truncated else []
        calibration = _calibration(path, content)
        color, color_size = None, None
        if options.color:
            color_track = next((t for t in content.tracks if t is not depth_track and t.name.upper() == "COLOR"), None)
            if color_track is not None and color_track.frames:
                time = whole[chosen[0]][0]
                shown, first, last = min(color_track.frames, key=lambda frame: abs(frame[0] - time))
                notes += apart_note((shown - time) * 1e-9)
                color = decode_color(bytes(data[first:last]), color_track, path)
                color_size = color.shape[1], color.shape[0]
    camera, color_camera, pose = options.intrinsics, None, None
    if calibration is None:
        if camera is None:
            nominal = nominal_camera(width, height)
            if nominal is None:
                raise CaptureError(
                    f"{path}: has no calibration attached; give the intrinsics of these {width}×{height}",
                    code="lens_missing",
                )
            camera, _, note = nominal
            notes.append(note)
        if color is not None and color_size != (width, height):
            notes.append("colour is left out: no calibration says how it is aligned to depth")
            color = None
    else:
        with blaming(path, "an Azure Kinect recording"):
            own, color_camera, pose = calibrated(calibration, (width, height), color_size)
        camera = camera or own
    return stored_capture(
        path, FORMAT, depth, color, camera, color_camera, pose, sensor="azure_kinect", sensor_from="format", notes=notes
    )


def calibrated(
    calibration: dict, depth_size: tuple[int, int], color_size: tuple[int, int] | None
) -> tuple[Intrinsics, Intrinsics | None, np.ndarray]:
    """Depth and colour intrinsics for the sizes recorded, and depth to colour (4, 4) [m], of the attached JSON.

    Raises
    ------
    ValueError, KeyError, TypeError, CaptureError
        When it is not as the device writes it.
    """
    cameras = {
        c["Purpose"].removeprefix("CALIBRATION_CameraPurpose"): c
        for c in calibration["CalibrationInformation"]["Cameras"]
    }
    if depth_size not in DEPTH_MODES:
        raise ValueError(f"{depth_size[0]}×{depth_size[1]} is no depth mode of the device")
    chip_width, chip_height, left, top = DEPTH_MODES[depth_size]
    cx, cy, fx, fy, intrinsics = _parameters(cameras["Depth"])
    depth_camera = Intrinsics(
        *depth_size,
        fx * chip_width,
        fy * chip_height,
        cx * chip_width - left - 0.5,
        cy * chip_height - top - 0.5,
        intrinsics,
    )
    color_camera = None
    if color_size is not None:
        cx, cy, fx, fy, intrinsics = _parameters(cameras["PhotoVideo"])
        if cameras["PhotoVideo"]["SensorWidth"] * 9 == cameras["PhotoVideo"]["SensorHeight"] * 16:
            cy, fy = cy * 0.75 + 0.125, fy * 0.75  # early devices are calibrated for the middle of the chip only
        width, height = color_size
        if not 1 <= width <= MAX_SIDE or not 1 <= height <= MAX_SIDE:
            raise ValueError(f"a colour image of {width}×{height}")
        whole = width * _COLOR_CHIP[1] / _COLOR_CHIP[0]  # height of the uncut picture at this width
        color_camera = Intrinsics(
            width, height, fx * width, fy * whole, cx * width - 0.5, cy * whole - (whole - height) / 2 - 0.5, intrinsics
        )
    # Rt takes points of the depth camera into each camera's frame: it is the identity for depth itself.
    pose = (
        _pose(cameras["PhotoVideo"]) @ np.linalg.inv(_pose(cameras["Depth"])) if "PhotoVideo" in cameras else np.eye(4)
    )
    return depth_camera, color_camera, pose


def decode_color(data: bytes, track: Track, path: Path) -> np.ndarray:
    """One colour frame (H, W, 3) uint8."""
    kind = _fourcc(track)
    width, height = track.width, track.height
    if kind == "MJPG":
        return rgb(image_in(data, path, "a colour frame"))
    sizes = {"BGRA": 4, "NV12": 1.5, "YUY2": 2}
    if kind not in sizes:
        raise CaptureError(
            f"{path}: colour is {kind[:20]}, which is not known; record colour as MJPG, BGRA, NV12 or YUY2",
            code="color",
        )
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE) or len(data) != int(width * height * sizes[kind]):
        raise ValueError(f"a colour frame of {len(data)} bytes is not {width}×{height} {kind}")
    raw = np.frombuffer(data, np.uint8)
    if kind == "BGRA":
        return np.ascontiguousarray(raw.reshape(height, width, 4)[..., 2::-1])
    if kind == "YUY2":
        return yuyv_to_rgb(raw.reshape(height, width, 2))
    luma = raw[: width * height].reshape(height, width)
    chroma = raw[width * height :].reshape(height // 2, width // 2, 2).repeat(2, axis=0).repeat(2, axis=1)
    return yuv_to_rgb(luma, chroma[..., 0], chroma[..., 1])


def _depth_track(content) -> Track | None:
    """The track the recorder tagged as depth, else one named so, else one of 16-bit gray."""
    tagged = content.tags.get("K4A_DEPTH_TRACK") and content.tag_tracks.get("K4A_DEPTH_TRACK")
    for fits in (
        lambda t: tagged and t.uid == tagged,
        lambda t: t.name.upper() == "DEPTH",
        lambda t: _fourcc(t) == "b16g" and t.name.upper() != "IR",
    ):
        track = next((t for t in content.tracks if fits(t)), None)
        if track is not None:
            return track if _fourcc(track) == "b16g" else None
    return None


def _fourcc(track: Track) -> str:
    """Code of an uncompressed or MJPG track, from the bitmap header in its private data."""
    if track.codec == "V_MS/VFW/FOURCC" and len(track.private) >= 20:
        return track.private[16:20].decode("latin-1")
    return {"V_MJPEG": "MJPG"}.get(track.codec, track.codec)


def _calibration(path: Path, content) -> dict | None:
    name = content.tags.get("K4A_CALIBRATION_FILE", "calibration.json")
    raw = content.attachments.get(name) or content.attachments.get("calibration.json")
    if raw is None:
        return None
    try:
        calibration = json.loads(raw.rstrip(b"\0").decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise CaptureError(
            f"{path}: its calibration is not valid JSON ({type(error).__name__}); record again"
        ) from error
    if not isinstance(calibration, dict):
        raise CaptureError(f"{path}: its calibration is not what the device writes; record again")
    return calibration


def _parameters(camera: dict) -> tuple[float, float, float, float, tuple[float, ...]]:
    """cx, cy, fx, fy in parts of the chip, and the lens in OpenCV's order.

    The SDK's rational model (``Rational6KT``) has half of Brown's tangential cross term; at some 1e-4 that is a few
    hundredths of a pixel, and is let be.
    """
    values = [float(v) for v in camera["Intrinsics"]["ModelParameters"]]
    if len(values) < 14 or not np.isfinite(values).all() or max(map(abs, values)) > 1e3:
        raise ValueError("a camera's parameters are not fourteen numbers")
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, _, _, p2, p1 = values[:14]
    return cx, cy, fx, fy, (k1, k2, p1, p2, k3, k4, k5, k6)


def _pose(camera: dict) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = np.asarray(camera["Rt"]["Rotation"], float).reshape(3, 3)
    pose[:3, 3] = np.asarray(camera["Rt"]["Translation"], float).reshape(3)
    if not np.isfinite(pose).all() or abs(np.linalg.det(pose[:3, :3]) - 1) > 0.01 or np.abs(pose[:3, 3]).max() > 1:
        raise ValueError("a camera's place is not a rotation and a shift")
    return pose
