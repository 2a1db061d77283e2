"""Orbbec's Femto Bolt and Mega by pyorbbecsdk.

Never run on a camera itself: tested against a camera made of arrays with the SDK's own names.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from ...camera import Intrinsics
from ...errors import CaptureError, MirrorScanError
from .stream import Stream, straight_stream

TIMEOUT_MS = 5000
_TRIES = 5  # waits for the first frames, each as long


@contextlib.contextmanager
def open_orbbec(size: tuple[int, int] | None = None, rate: int = 30, serial: str | None = None) -> Iterator[Stream]:
    """A Femto; colour is aligned to depth by the SDK, and both are straightened.

    Raises
    ------
    CaptureError
        When no camera is connected, or it has not this size or rate.
    MirrorScanError
        When pyorbbecsdk is missing.
    """
    ob = pyorbbecsdk()
    devices = ob.Context().query_devices()
    if not devices.get_count():
        raise CaptureError(
            "no Orbbec camera is connected; plug it into a USB 3 port, and connect its power supply", code="camera"
        )
    try:
        pipeline = ob.Pipeline(devices.get_device_by_serial_number(serial)) if serial else ob.Pipeline()
        config = ob.Config()
        depth = pipeline.get_stream_profile_list(ob.OBSensorType.DEPTH_SENSOR)
        config.enable_stream(
            depth.get_default_video_stream_profile() if size is None
            else depth.get_video_stream_profile(*size, ob.OBFormat.Y16, rate)
        )  # fmt: skip
        color = pipeline.get_stream_profile_list(ob.OBSensorType.COLOR_SENSOR)
        config.enable_stream(color.get_video_stream_profile(1280, 0, ob.OBFormat.RGB, rate))
        config.set_frame_aggregate_output_mode(ob.OBFrameAggregateOutputMode.FULL_FRAME_REQUIRE)
        pipeline.start(config)
    except ob.OBError as error:
        wanted = "" if size is None else f", not {size[0]}×{size[1]} at {rate} Hz"
        raise CaptureError(
            f"the Orbbec camera cannot be started ({' '.join(str(error).split())}); connect it to USB 3 and power, "
            f"close other programs that use it, and choose a size and rate it has{wanted}",
            code="camera",
        ) from error
    try:
        yield orbbec_stream(pipeline)
    finally:
        pipeline.stop()


def orbbec_stream(pipeline: Any) -> Stream:
    """A :class:`Stream` of what the SDK delivers.

    Parameters
    ----------
    pipeline : pyorbbecsdk.Pipeline
        Started, with depth (Y16) and colour (RGB).

    Raises
    ------
    CaptureError
        When no frame comes.
    """
    # what the camera's lens is holds for the streams that run, and is known when a frame has come
    for _ in range(_TRIES):
        if pipeline.wait_for_frames(TIMEOUT_MS):
            break
    else:
        raise CaptureError("the Orbbec camera sends no frames; check its cable and its power supply", code="camera")
    parameters = pipeline.get_camera_param()
    lens, bent = parameters.depth_intrinsic, parameters.depth_distortion
    distortion = tuple(float(getattr(bent, name)) for name in ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"))
    camera = Intrinsics(
        lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy, distortion if any(distortion) else ()
    )  # fmt: skip
    return straight_stream(camera, "femto_bolt", _frames(pipeline))


def _frames(pipeline: Any) -> Iterator[tuple[np.ndarray, np.ndarray | None]]:
    ob = pyorbbecsdk()
    align = ob.AlignFilter(align_to_stream=ob.OBStreamType.DEPTH_STREAM)
    while True:
        frames = pipeline.wait_for_frames(TIMEOUT_MS)
        if not frames:  # nothing came in time: the camera is gone
            return
        both = align.process(frames)
        frames = both.as_frame_set() if both else frames
        depth, color = frames.get_depth_frame(), frames.get_color_frame()
        if not depth:
            continue
        shape = depth.get_height(), depth.get_width()
        values = np.frombuffer(depth.get_data(), np.uint16).reshape(shape)
        picture = None
        if color and (color.get_height(), color.get_width()) == shape:
            picture = np.frombuffer(color.get_data(), np.uint8).reshape(*shape, 3).copy()
        # the scale is in millimetres
        yield values.astype(np.float32) * np.float32(1e-3 * depth.get_depth_scale()), picture


def pyorbbecsdk() -> Any:
    """The module pyorbbecsdk.

    Raises
    ------
    MirrorScanError
        When it is missing.
    """
    try:
        import pyorbbecsdk as module
    except ImportError as error:
        raise MirrorScanError(
            f"recording from an Orbbec camera needs pyorbbecsdk, which cannot be imported ({error}); install it with "
            "“pip install pyorbbecsdk2”",
            code="camera",
        ) from error
    return module
