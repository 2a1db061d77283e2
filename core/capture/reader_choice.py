"""What a camera wrote, as one data type: :class:`.capture.Capture`. ``open_capture(path)`` picks the reader.

A reader is a module with ``recognises(path) -> bool``, by content, and ``read(path, frames, options) -> Capture``,
which yields the frames as they are stored; what all formats share (distortion, colour's alignment, rotation,
mirrored streams) is done afterwards, here.
"""

from __future__ import annotations

import importlib
import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..camera.image_resampling import area_resampled
from ..errors import CaptureError, MirrorScanError, Notice
from .capture import Capture, ReadOptions
from .depth_units import SCENE_DEPTH_M, background_limit
from .folders.lens_file import check_principal_point
from .folders.rgbd_folder import holds_scaled
from .frames import BEYOND, FrameChoice, NoSuchFrames, parse_frames

MAX_MESSAGE = 400  # characters of an error beside the path

# In the order they are tried, the most specific first. Imported one by one: some bring numba.
READERS = (
    "single_files.npz",
    "recordings.azure_mkv",
    "recordings.realsense_bag",
    "recordings.realsense_db3",
    "recordings.oni",
    "single_files.pcd",
    "single_files.ply",
    "recordings.record3d",
    "folders.stray_scanner",
    "folders.tum",
    "folders.sun",
    "single_files.pclzf",
    "folders.fakenect",
    "folders.rgbd_folder",
    "single_files.single_image",
)


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
        Upright, right-handed, undistorted; colour aligned to depth, and with ``ReadOptions(native_color=True)`` as its
        own camera took it, too.

    Raises
    ------
    CaptureError, MirrorError
        When nothing is there, no reader knows it, or its content is faulty.
    """
    path = Path(path)
    options = options or ReadOptions()
    parse_frames(path, frames)
    if not path.exists():
        raise CaptureError(f"{path}: there is no such file or folder", code="gone")
    for name in READERS:
        reader = importlib.import_module(f".{name}", __package__)
        try:
            if reader.recognises(path):
                return _prepared(path, reader.read(path, frames, options), options)
        except OSError as error:
            culprit = error.filename if str(path) in str(error.filename) else path
            raise CaptureError(f"{culprit}: cannot be read: {error.strerror or error}", code="gone") from error
        except MirrorScanError as error:
            # quoted names from a file may hold any characters: keep one printable line that names the file
            text = "".join(c if c.isprintable() else "?" for c in str(error))
            longest = len(str(path)) + MAX_MESSAGE
            text = text if len(text) <= longest else text[: longest - 1] + "…"
            if text == str(error) and str(path) in text:
                raise
            said = error.notice if text == str(error) else text
            if str(path) in text:
                raise type(error)(said) from error
            raise type(error)("{path}: {reason}", path=path, reason=said) from error
    raise CaptureError(
        f"{path}: is not a capture; give a folder that holds intrinsic.json and depth/*.png, or a recording "
        "(.mkv, .bag, .oni, .pcd, .ply, .r3d; see docs/formats.md)",
        code="not_a_capture",
    )


def frame_count(path: str | os.PathLike, options: ReadOptions | None = None) -> int:
    """How many depth frames a capture has; no pixel of them is read. ``options``: what the file cannot say.

    Raises
    ------
    CaptureError
        When it is no capture, or has none.
    """
    options = options or ReadOptions()
    try:
        return len(open_capture(path, f"{BEYOND}:", replace(options, color=False, mirrors=False)).depth)
    except NoSuchFrames as error:
        return error.total


def is_capture(path: str | os.PathLike) -> bool:
    """Whether a reader recognises what is at ``path``, by its content; whether it can be read shows only then.

    Raises
    ------
    OSError
        When it cannot be looked at.
    """
    return any(importlib.import_module(f".{name}", __package__).recognises(Path(path)) for name in READERS)


def _prepared(path: Path, capture: Capture, options: ReadOptions) -> Capture:
    """What every format needs after reading: checks, confidence, distortion, alignment, rotation."""
    camera = options.intrinsics or capture.intrinsics
    height, width = capture.depth.shape[1:]
    if (camera.width, camera.height) != (width, height):
        if (camera.height, camera.width) == (width, height):
            raise CaptureError(
                f"{path}: depth is {width}×{height} pixels, the intrinsics are for {camera.width}×{camera.height}; "
                "width and height are exchanged, or the picture was rotated; give the intrinsics of this resolution",
                code="rotation",
            )
        raise CaptureError(
            f"{path}: depth is {width}×{height} pixels, the intrinsics are for {camera.width}×{camera.height}; give "
            "the intrinsics of this resolution",
            code="rotation",
        )
    if options.intrinsics or not capture.format.startswith("organized"):  # fitted to the points, it is where it is
        check_principal_point(path, camera)
    capture = _without_background(capture)
    depth = capture.depth
    if capture.confidence is not None and options.min_confidence > 0:
        depth = np.where(capture.confidence >= options.min_confidence, depth, np.float32(0))
    if not any(frame.any() for frame in depth):  # as a rule the first one answers
        frames = f"{len(depth)} frame{'s' if len(depth) > 1 else ''}"
        raise CaptureError(
            f"{path}: no pixel of {frames} has a depth reading; check that the depth stream was on and record again",
            code="empty",
        )
    color = capture.color if options.color else None
    capture = replace(capture, depth=depth, color=color, intrinsics=camera)
    capture = replace(capture, notes=(*options.notes, *capture.notes))
    if color is not None and capture.native_color is None and capture.depth_to_color is None:
        capture = _scaled_to_depth(path, capture, options.native_color)
    elsewhere = color is not None and capture.native_color is None and capture.color_intrinsics is not None
    if elsewhere or not (camera.is_pinhole and (capture.color_intrinsics or camera).is_pinhole):
        from .upright_grid import align  # brings numba, which a plain RGB-D folder does not need

        capture = align(capture, options.native_color)
        if not capture.depth.any():
            raise CaptureError(
                f"{path}: no reading is left after straightening; check the distortion coefficients", code="lens_wrong"
            )
    if options.native_color and capture.color is not None and capture.native_color is None:
        capture = replace(
            capture, native_color=capture.color, color_intrinsics=capture.intrinsics, depth_to_color=np.eye(4)
        )
    mirrored = capture.mirrored if options.mirrored is None else options.mirrored
    degrees = capture.turn_degrees if options.turn_degrees is None else options.turn_degrees
    if capture.sensor == "kinect_v2" and options.mirrored is None and not capture.mirrored:
        hint = (
            "Kinect v2's SDK exchanges left and right, and no file says so: if this picture is mirrored, say so "
            "(option “mirrored”)"
        )
        capture = replace(capture, notes=(*capture.notes, hint))
    if mirrored or degrees:
        from .upright_grid import turned, unmirrored

        capture = turned(unmirrored(capture) if mirrored else capture, degrees)
    capture = replace(capture, turn_degrees=0, mirrored=False)
    return capture if capture.native_color is not None else replace(capture, color_intrinsics=None, depth_to_color=None)


def _scaled_to_depth(path: Path, capture: Capture, native: bool) -> Capture:
    """``capture`` with colour of depth's size, where a larger image is aligned to depth, or nothing says otherwise.

    Raises
    ------
    CaptureError
        When colour is smaller than depth or of another shape, so that it cannot be aligned.
    """
    color, camera = capture.color, capture.intrinsics
    assert color is not None  # the caller has looked
    height, width = capture.depth.shape[1:]
    if color.shape[:2] == (height, width):
        return replace(capture, color_intrinsics=None)
    if not holds_scaled(color, camera):
        raise CaptureError(
            f"{path}: colour is {color.shape[1]}×{color.shape[0]} pixels, but depth has {width}×{height}; their "
            "alignment is unknown; align colour to depth when recording, or leave colour out",
            code="color",
        )
    if capture.color_intrinsics is None:
        note = Notice(
            "colour of {color_width}×{color_height} pixels is taken as aligned to depth of {width}×{height}, only "
            "larger: nothing says where its camera is",
            color_width=color.shape[1], color_height=color.shape[0], width=width, height=height,
        )  # fmt: skip
        capture = replace(capture, notes=(*capture.notes, note))
    capture = replace(capture, color=area_resampled(color, width, height), color_intrinsics=None)
    if not native:
        return capture
    own = camera.scaled(color.shape[1], color.shape[0])
    return replace(capture, native_color=color, color_intrinsics=own, depth_to_color=np.eye(4))


def _without_background(capture: Capture) -> Capture:
    """The capture without what renderers write where nothing was hit: a huge number, or their far plane."""
    depth, dropped, farthest = capture.depth, 0, 0.0
    for i, frame in enumerate(capture.depth):
        top = float(frame.max(initial=0.0))
        if not top >= SCENE_DEPTH_M:
            continue
        limit = background_limit(frame, SCENE_DEPTH_M)
        if np.isfinite(limit):
            if depth is capture.depth:
                depth = depth.copy()
            dropped, farthest = dropped + int((frame >= limit).sum()), max(farthest, top)
            depth[i][frame >= limit] = 0
    if not dropped:
        return capture
    note = Notice(
        "{share:.0%} of the pixels hold a distance of {far:.4g} m and nothing lies near it: background, no reading",
        share=dropped / depth.size, far=farthest,
    )  # fmt: skip
    return replace(capture, depth=depth, notes=(*capture.notes, note))
