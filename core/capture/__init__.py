"""What a camera wrote, as one data type: :class:`Capture`. ``open_capture(path)`` picks the reader.

A reader is a module with ``recognises(path) -> bool``, by content, and ``read(path, frames, options) -> Capture``,
which yields the frames as they are stored; what all formats share (distortion, colour's alignment, turns, mirrored
streams) is done afterwards, here.
"""

from __future__ import annotations

import importlib
import os
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..camera import Intrinsics
from ..errors import CaptureError, MirrorScanError

MAX_BURST_PIXELS = 256_000_000  # 1 GB as float32; about 800 frames of 640 x 480
MAX_MESSAGE = 400  # characters of an error beside the path
FrameChoice = int | str | None

# In the order they are asked; the narrow ones first. Imported one by one: some bring numba.
READERS = (
    "npz",
    "azure_mkv",
    "realsense_bag",
    "realsense_db3",
    "oni",
    "pcd",
    "ply",
    "record3d",
    "stray_scanner",
    "tum",
    "sun",
    "pclzf",
    "fakenect",
    "rgbd_folder",
    "single_image",
)


@dataclass(frozen=True)
class MirrorPicks:
    """What is known of one mirror before it is fitted, as ``mirrors.json`` holds it.

    Either points picked on its frame (``frame_pixels`` (K, 2) float64, (u, v) [px]) or a known plane
    (``point`` (3,), ``normal`` (3,), camera frame [m]).
    """

    name: str
    frame_pixels: np.ndarray | None = None
    point: np.ndarray | None = None
    normal: np.ndarray | None = None


@dataclass(frozen=True)
class Capture:
    """One snapshot (or a burst of a still subject) of one depth camera.

    Parameters
    ----------
    depth : np.ndarray [shape=(F, H, W), dtype=float32]
        z of each pixel [m], 0 = no reading.
    color : np.ndarray [shape=(H, W, 3), dtype=uint8] or None
        sRGB, aligned to the depth map.
    intrinsics : Intrinsics
        Of the depth map; a pinhole once opened.
    mirrors : tuple of MirrorPicks
        What the capture itself says about its mirrors; empty when it says nothing.
    name, format : str
        For messages and reports.
    color_intrinsics : Intrinsics or None
        Of a colour image not yet aligned; None once opened.
    depth_to_color : np.ndarray [shape=(4, 4)] or None
        Takes camera-frame points [m] into the colour camera's frame; None once opened.
    sensor : str
        What took it, where the file tells: ``kinect_v1``, ``kinect_v2``, ``azure_kinect``, ``realsense_d415``,
        ``realsense_d435``, ``realsense_d455``, ``phone``, or ``unknown``.
    confidence : np.ndarray [shape=(F, H, W), dtype=uint8] or None
        The camera's own trust in each reading, 0 low to 2 high.
    turn_degrees, mirrored : int, bool
        What the file says of the stream as stored: the clockwise turn that makes it upright, and whether left and
        right are exchanged. 0 and False once opened.
    notes : tuple of str
        What the reader had to assume or leave out, one sentence each, for a person.
    """

    depth: np.ndarray
    color: np.ndarray | None
    intrinsics: Intrinsics
    mirrors: tuple[MirrorPicks, ...] = field(default=())
    name: str = "capture"
    format: str = "unknown"
    color_intrinsics: Intrinsics | None = None
    depth_to_color: np.ndarray | None = None
    sensor: str = "unknown"
    confidence: np.ndarray | None = None
    turn_degrees: int = 0
    mirrored: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class ReadOptions:
    """What a file cannot say, or says wrongly. Every default leaves it to the file.

    Parameters
    ----------
    intrinsics : Intrinsics or None
        Of the depth map as it is stored, with its distortion, in place of what the file says.
    depth_unit_m : float or None
        Metres that one stored unit means (0.001 for millimetres), in place of what the file says.
    disparity : {"factory", "linear", "tangent"}
        Formula for the raw 11-bit values of a Kinect v1; see :mod:`.kinect_v1`.
    raw_disparity : bool or None
        Whether a lone image or array holds raw Kinect v1 values; None decides by their range.
    kinect_calibration : {"factory", "burrus"}
        Calibration of a Kinect v1 whose recording holds none.
    turn_degrees : {0, 90, 180, 270} or None
        Clockwise turn that makes the picture upright; None takes what the file says, else 0.
    mirrored : bool or None
        Whether left and right are exchanged in the stream; None takes what the file says, else False.
    min_confidence : int
        Readings the camera trusts less are dropped: 0 keeps all, 1 drops the low, 2 the low and medium.
    color : bool
        Whether to read colour.
    """

    intrinsics: Intrinsics | None = None
    depth_unit_m: float | None = None
    disparity: str = "factory"
    raw_disparity: bool | None = None
    kinect_calibration: str = "factory"
    turn_degrees: int | None = None
    mirrored: bool | None = None
    min_confidence: int = 1
    color: bool = True

    def __post_init__(self) -> None:
        if self.depth_unit_m is not None and not 1e-7 <= self.depth_unit_m <= 1e3:
            raise CaptureError(f"the depth unit must be a positive number of metres, not {self.depth_unit_m}")
        if self.disparity not in ("factory", "linear", "tangent"):
            raise CaptureError(f"the disparity formula is factory, linear or tangent, not {self.disparity!r}")
        if self.kinect_calibration not in ("factory", "burrus"):
            raise CaptureError(f"the Kinect calibration is factory or burrus, not {self.kinect_calibration!r}")
        if self.turn_degrees not in (None, 0, 90, 180, 270):
            raise CaptureError(f"a capture can be turned by 0, 90, 180 or 270 degrees, not {self.turn_degrees}")
        if self.min_confidence not in (0, 1, 2):
            raise CaptureError(f"the least confidence is 0, 1 or 2, not {self.min_confidence}")


def open_capture(path: str | os.PathLike, frames: FrameChoice = None, options: ReadOptions | None = None) -> Capture:
    """Read what a depth camera wrote, whatever the format; the content decides, not the name.

    Parameters
    ----------
    path : path
        Any of the formats of ``docs/formats.md``.
    frames : int, str or None
        None reads all frames, an int that many from the start, ``"a:b"`` or ``"a:b:step"`` a range counted from 0
        as Python slices are, ``"a"`` the one frame with that number.
    options : ReadOptions or None
        What the file cannot say.

    Returns
    -------
    Capture
        Upright, right-handed, undistorted; colour aligned to depth.

    Raises
    ------
    CaptureError, MirrorError
        When nothing is there, no reader knows it, or its content is at fault.
    """
    path = Path(path)
    options = options or ReadOptions()
    _parse_frames(path, frames)
    if not path.exists():
        raise CaptureError(f"{path}: there is no such file or folder")
    for name in READERS:
        reader = importlib.import_module(f".{name}", __package__)
        try:
            if reader.recognises(path):
                return _prepared(path, reader.read(path, frames, options), options)
        except OSError as error:
            culprit = error.filename if str(path) in str(error.filename) else path
            raise CaptureError(f"{culprit}: cannot be read: {error.strerror or error}") from error
        except MirrorScanError as error:
            # files may put anything into names that are quoted: one printable line, that names the file
            text = "".join(c if c.isprintable() else "?" for c in str(error))
            longest = len(str(path)) + MAX_MESSAGE
            text = text if len(text) <= longest else text[: longest - 1] + "…"
            if text == str(error) and str(path) in text:
                raise
            raise type(error)(text if str(path) in text else f"{path}: {text}") from error
    raise CaptureError(
        f"{path}: is not a capture; give a folder that holds intrinsic.json and depth/*.png, or a recording "
        "(.mkv, .bag, .oni, .pcd, .ply, .r3d; see docs/formats.md)"
    )


def chosen_frames(path: Path, frames: FrameChoice, total: int) -> range:
    """Numbers of the frames to read of ``total``.

    Raises
    ------
    CaptureError
        When the choice is not understood or none of the frames is chosen.
    """
    if total < 1:
        raise CaptureError(f"{path}: holds no depth frame; check that the depth stream was on and record again")
    chosen = range(total)[_parse_frames(path, frames)]
    if not len(chosen):
        raise CaptureError(f"{path}: has frames 0 to {total - 1}, of which “{frames}” chooses none")
    return chosen


def empty_burst(path: Path, count: int, height: int, width: int) -> np.ndarray:
    """Zeros (F, H, W) float32 for as many frames as memory should hold.

    Raises
    ------
    CaptureError
        When they are more.
    """
    if count * height * width > MAX_BURST_PIXELS:
        raise CaptureError(
            f"{path}: {count} frames of {width}×{height} are more than memory should hold; "
            f"choose {max(1, MAX_BURST_PIXELS // max(1, width * height))} or fewer"
        )
    return np.zeros((count, height, width), np.float32)


def _parse_frames(path: Path, frames: FrameChoice) -> slice:
    if frames is None:
        return slice(None)
    if isinstance(frames, int | np.integer) and not isinstance(frames, bool):
        if frames < 1:
            raise CaptureError(f"{path}: at least one frame must be read, not {frames}")
        return slice(int(frames))
    try:
        parts = [int(part) if part.strip() else None for part in str(frames)[:80].split(":")]
    except ValueError:
        parts = []
    if len(parts) == 1 and parts[0] is not None and parts[0] >= 0:
        return slice(parts[0], parts[0] + 1)
    if len(parts) in (2, 3) and not (len(parts) == 3 and parts[2] is not None and parts[2] < 1):
        return slice(*parts)
    raise CaptureError(f"{path}: frames are chosen by a count or as “a:b”, “a:b:step” or “a”, not {str(frames)[:40]!r}")


def _prepared(path: Path, capture: Capture, options: ReadOptions) -> Capture:
    """What every format needs after reading: checks, trust, distortion, alignment, turn."""
    camera = options.intrinsics or capture.intrinsics
    height, width = capture.depth.shape[1:]
    if (camera.width, camera.height) != (width, height):
        raise CaptureError(
            f"{path}: depth is {width}×{height} pixels, the intrinsics are for {camera.width}×{camera.height}; "
            "give the intrinsics of this resolution"
        )
    depth = capture.depth
    if capture.confidence is not None and options.min_confidence > 0:
        depth = np.where(capture.confidence >= options.min_confidence, depth, np.float32(0))
    if not any(frame.any() for frame in depth):  # as a rule the first one answers
        frames = f"{len(depth)} frame{'s' if len(depth) > 1 else ''}"
        raise CaptureError(
            f"{path}: no pixel of {frames} has a depth reading; check that the depth stream was on and record again"
        )
    color = capture.color if options.color else None
    capture = replace(capture, depth=depth, color=color, intrinsics=camera)
    if not camera.is_pinhole or (color is not None and capture.color_intrinsics is not None):
        from ..camera.image_registration import align  # brings numba, which a plain RGB-D folder does not need

        capture = align(capture)
        if not capture.depth.any():
            raise CaptureError(f"{path}: no reading is left after straightening; check the distortion coefficients")
    elif color is not None and color.shape[:2] != (height, width):
        raise CaptureError(
            f"{path}: colour is {color.shape[1]}×{color.shape[0]} pixels, but depth has {width}×{height}, and nothing "
            "says how they lie to each other; align colour to depth when recording, or go without colour"
        )
    mirrored = capture.mirrored if options.mirrored is None else options.mirrored
    degrees = capture.turn_degrees if options.turn_degrees is None else options.turn_degrees
    if capture.sensor == "kinect_v2" and options.mirrored is None and not capture.mirrored:
        hint = "Kinect v2's SDK exchanges left and right, and no file says so: if this picture is mirrored, say so"
        capture = replace(capture, notes=(*capture.notes, f"{hint} (option “mirrored”)"))
    if mirrored or degrees:
        from ..camera.image_registration import turned, unmirrored

        capture = turned(unmirrored(capture) if mirrored else capture, degrees)
    return replace(capture, color_intrinsics=None, depth_to_color=None, turn_degrees=0, mirrored=False)
