"""A live camera → an RGB-D folder.

The seam for other cameras: a driver is one function ``open_…(size, rate, serial)``, a context manager that yields a
:class:`Stream`, entered in :data:`DRIVERS` under the name the command line knows it by. All else (which frames to
keep, the folder, stopping) is :func:`record`, for every camera alike.
"""

from __future__ import annotations

import contextlib
import itertools
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..camera import Intrinsics
from ..errors import CaptureError, MirrorScanError
from ..io.atomic_files import fresh_folder
from .capture import MirrorPicks
from .drivers.azure_kinect import open_azure_kinect
from .drivers.orbbec import open_orbbec
from .drivers.stream import Stream as Stream
from .folders.rgbd_folder import mirrors_to, sensor_named
from .rgbd_writer import FolderWriter

SETTLE = 15  # frames until exposure and laser have settled
TIMEOUT_MS = 5000
COLOR_SIZES = ((1920, 1080), (1280, 800), (1280, 720), (640, 480))  # of RealSense's colour cameras, the best first


def record(
    stream: Stream,
    folder: str | os.PathLike,
    frames: int = 30,
    settle: int = SETTLE,
    progress: Callable[[float, str], None] | None = None,
    mirrors: tuple[MirrorPicks, ...] = (),
) -> Path:
    """Save a burst of a running camera as an RGB-D folder, which appears only when it is whole.

    Parameters
    ----------
    stream : Stream
    folder : path
        Must not exist, or be empty.
    frames : int
        Depth frames to keep; of colour the last one is kept.
    settle : int
        Frames to skip before that.
    progress : callable(fraction, message) or None
        Called at each frame; an exception it raises stops the recording, and nothing is written.
    mirrors : tuple of MirrorPicks
        Where they are known: written beside the frames.

    Raises
    ------
    CaptureError
        When the camera stops too early, or no pixel has a reading.
    OutputError
        When the folder cannot be written.
    """
    folder = Path(folder)
    if frames < 1:
        raise CaptureError(f"at least one frame must be recorded, not {frames}", code="frames")
    with fresh_folder(folder) as fresh:
        writer = _save(stream, fresh, frames, settle, progress)
        if mirrors:
            writer.write_json("mirrors.json", {"mirrors": mirrors_to(mirrors)})
    return folder


def _save(stream: Stream, folder: Path, frames: int, settle: int, progress) -> FolderWriter:
    # kept in memory first: writing PNGs takes longer than a frame lasts
    kept = np.zeros((frames, stream.intrinsics.height, stream.intrinsics.width), np.float32)
    color = None
    taken = 0
    for number, (depth, picture) in enumerate(itertools.islice(stream.frames, settle + frames)):
        if progress:
            waiting = number < settle
            message = "the camera settles" if waiting else f"recording, frame {number - settle + 1} of {frames}"
            progress(0.8 * number / (settle + frames), message)
        if number >= settle:
            kept[number - settle] = depth
            color = picture if picture is not None else color
            taken += 1
    if taken < frames:
        raise CaptureError(
            f"the camera stopped after {taken} of {frames} frames; check its cable and record again", code="camera"
        )
    if not kept.any():
        raise CaptureError(
            "the camera sees nothing: no pixel of any frame has a depth reading; uncover and aim it", code="camera"
        )
    writer = FolderWriter(folder, stream.intrinsics, stream.sensor)
    for number, depth in enumerate(kept):
        if progress:
            progress(0.8 + 0.2 * number / frames, "writing")
        writer.add(depth)
    if color is not None:
        writer.set_color(color, stream.color_intrinsics, stream.depth_to_color)
    return writer


# --- RealSense -------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def open_realsense(
    size: tuple[int, int] = (848, 480), rate: int = 30, serial: str | None = None, native_color: bool = False
) -> Iterator[Stream]:
    """A RealSense camera by Intel's SDK.

    Colour is aligned to depth; with ``native_color`` it is the colour camera's own image, of the largest size of
    :data:`COLOR_SIZES` that the camera has at this rate.

    Raises
    ------
    CaptureError
        When no camera is connected, or it has not this size or rate.
    MirrorScanError
        When pyrealsense2 is missing.
    """
    rs = realsense()
    if not len(rs.context().query_devices()):  # to start would wait 15 s for one
        raise CaptureError(
            "no RealSense camera is connected; plug it into a USB 3 port, with a cable made for that", code="camera"
        )
    pipeline = rs.pipeline()

    def wanted(*color_size: int) -> Any:
        config = rs.config()
        if serial:
            config.enable_device(serial)
        config.enable_stream(rs.stream.depth, *size, rs.format.z16, rate)
        config.enable_stream(rs.stream.color, *color_size, rs.format.rgb8, rate)
        return config

    config = wanted()
    if native_color:
        larger = (wanted(*color_size) for color_size in COLOR_SIZES)
        config = next((c for c in larger if c.can_resolve(rs.pipeline_wrapper(pipeline))), config)
    try:
        profile = pipeline.start(config)
    except RuntimeError as error:
        raise CaptureError(
            f"the RealSense camera cannot be started ({' '.join(str(error).split())}); connect it to USB 3, close "
            f"other programs that use it, and choose a size and rate it has, not {size[0]}×{size[1]} at {rate} Hz",
            code="camera",
        ) from error
    try:
        device = profile.get_device()
        name = device.get_info(rs.camera_info.name) if device.supports(rs.camera_info.name) else ""
        scale = device.first_depth_sensor().get_depth_scale()
        depth, color = (profile.get_stream(s).as_video_stream_profile() for s in (rs.stream.depth, rs.stream.color))
        own = (color.get_intrinsics(), depth.get_extrinsics_to(color)) if native_color else None
        yield realsense_stream(
            lambda: pipeline.wait_for_frames(TIMEOUT_MS), depth.get_intrinsics(), scale, name, own
        )  # fmt: skip
    finally:
        pipeline.stop()


def realsense_stream(
    wait: Callable[[], Any], intrinsics: Any, scale: float, name: str = "", color: tuple[Any, Any] | None = None
) -> Stream:
    """A :class:`Stream` of what librealsense delivers.

    Parameters
    ----------
    wait : callable
        Returns the next ``rs.composite_frame``; raises RuntimeError when none comes.
    intrinsics : rs.intrinsics
        Of the depth stream.
    scale : float
        Metres a unit of depth.
    name : str
        What the camera calls itself.
    color : tuple of rs.intrinsics and rs.extrinsics, or None
        Of the colour stream, and from depth to it; None aligns colour to depth.
    """
    if any(abs(k) > 1e-9 for k in intrinsics.coeffs):
        raise CaptureError(
            f"the depth stream of {name or 'this camera'} is distorted; choose a rectified stream", code="camera"
        )
    camera = Intrinsics(
        intrinsics.width, intrinsics.height, intrinsics.fx, intrinsics.fy, intrinsics.ppx, intrinsics.ppy
    )
    if color is None:
        return Stream(camera, sensor_named(name), _realsense_frames(wait, scale, aligned=True))
    pose = np.eye(4)
    pose[:3, :3] = np.reshape(color[1].rotation, (3, 3)).T  # librealsense counts column by column
    pose[:3, 3] = color[1].translation
    frames = _realsense_frames(wait, scale, aligned=False)
    return Stream(camera, sensor_named(name), frames, _realsense_color(color[0]), pose)


def _realsense_color(intrinsics: Any) -> Intrinsics:
    """The colour camera with its distortion.

    ``rs2_project_point_to_pixel`` distorts by Brown's formula for each of the three models that bear his name, the
    inverse one too, and ``rs2_deproject_pixel_to_point`` is the inverse of that (librealsense's issue 7734, pull
    request 8523); so what the SDK aligns and what we align agree.
    """
    models = realsense().distortion
    coefficients = tuple(float(k) for k in intrinsics.coeffs)
    if intrinsics.model == models.none or max(map(abs, coefficients)) <= 1e-9:
        coefficients = ()
    elif intrinsics.model not in (
        models.brown_conrady, models.modified_brown_conrady, models.inverse_brown_conrady
    ):  # fmt: skip
        raise CaptureError(
            f"the colour camera's lens is {str(intrinsics.model)[:40]}, which is not supported; record with colour "
            "aligned to depth",
            code="color",
        )
    return Intrinsics(
        intrinsics.width, intrinsics.height, intrinsics.fx, intrinsics.fy, intrinsics.ppx, intrinsics.ppy, coefficients
    )


def _realsense_frames(
    wait: Callable[[], Any], scale: float, aligned: bool
) -> Iterator[tuple[np.ndarray, np.ndarray | None]]:
    rs = realsense()
    align = rs.align(rs.stream.depth)
    while True:
        try:
            frames = wait()
        except RuntimeError:  # librealsense's only exception: nothing came in time
            return
        if not frames.get_depth_frame():
            continue
        if aligned and frames.get_color_frame():
            frames = align.process(frames)
        depth = np.asanyarray(frames.get_depth_frame().get_data())
        color = frames.get_color_frame()
        picture = np.asanyarray(color.get_data()).copy() if color else None
        yield depth.astype(np.float32) * np.float32(scale), picture


def realsense():
    """The module pyrealsense2.

    Raises
    ------
    MirrorScanError
        When it is missing.
    """
    try:
        import pyrealsense2
    except ImportError as error:
        raise MirrorScanError(
            f"recording from a RealSense camera needs pyrealsense2, which cannot be imported ({error}); install it "
            "with “pip install pyrealsense2”",
            code="camera",
        ) from error
    return pyrealsense2


DRIVERS: dict[str, Callable[..., contextlib.AbstractContextManager[Stream]]] = {
    "realsense": open_realsense, "azure_kinect": open_azure_kinect, "femto": open_orbbec,
}  # fmt: skip
