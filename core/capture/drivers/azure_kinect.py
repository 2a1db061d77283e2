"""Azure Kinect DK by pyk4a, a wrapper of Microsoft's Sensor SDK.

Never run on the camera itself: tested against a camera made of arrays with pyk4a's own names.
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
MODES = {(640, 576): "NFOV_UNBINNED", (320, 288): "NFOV_2X2BINNED", (512, 512): "WFOV_2X2BINNED",
         (1024, 1024): "WFOV_UNBINNED"}  # fmt: skip
"""Depth modes of the camera by the size of their images."""
RATES = (5, 15, 30)
_SLOWER = (1024, 1024)  # px: that mode has 15 frames a second at most


@contextlib.contextmanager
def open_azure_kinect(
    size: tuple[int, int] | None = None, rate: int = 30, serial: str | None = None
) -> Iterator[Stream]:
    """An Azure Kinect; colour is aligned to depth by the SDK, and both are straightened.

    Raises
    ------
    CaptureError
        When no camera is connected, or it has not this size or rate.
    MirrorScanError
        When pyk4a is missing.
    """
    k4a = pyk4a()
    size = size or (640, 576)
    if size not in MODES:
        sizes = ", ".join(f"{w}×{h}" for w, h in MODES)
        raise CaptureError(f"the Azure Kinect has no depth images of {size[0]}×{size[1]}; give one of {sizes}",
                           code="camera")  # fmt: skip
    if rate not in RATES or (size == _SLOWER and rate > 15):
        raise CaptureError(f"the Azure Kinect has not {rate} frames a second at {size[0]}×{size[1]}; give 5, 15 or, "
                           "but for the largest images, 30", code="camera")  # fmt: skip
    camera = _opened(k4a, MODES[size], rate, serial)
    try:
        yield azure_stream(camera, size)
    finally:
        camera.stop()


def azure_stream(camera: Any, size: tuple[int, int]) -> Stream:
    """A :class:`Stream` of what pyk4a delivers.

    Parameters
    ----------
    camera : pyk4a.PyK4A
        Started, with colour as BGRA.
    size : tuple of int
        Width and height of its depth images.
    """
    depth = pyk4a().CalibrationType.DEPTH
    matrix = np.asarray(camera.calibration.get_camera_matrix(depth), np.float64)
    distortion = tuple(float(k) for k in camera.calibration.get_distortion_coefficients(depth))
    lens = Intrinsics(*size, matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], distortion[:8])
    return straight_stream(lens, "azure_kinect", _frames(camera))


def _frames(camera: Any) -> Iterator[tuple[np.ndarray, np.ndarray | None]]:
    late = pyk4a().K4ATimeoutException, pyk4a().K4AException
    while True:
        try:
            capture = camera.get_capture(timeout=TIMEOUT_MS)
        except late:  # nothing came in time: the camera is gone
            return
        if capture.depth is None:
            continue
        aligned = capture.transformed_color
        color = None if aligned is None else np.ascontiguousarray(aligned[..., 2::-1])  # BGRA
        yield capture.depth.astype(np.float32) * np.float32(0.001), color


def _opened(k4a: Any, mode: str, rate: int, serial: str | None) -> Any:
    """The camera of that serial number, or the first one, started."""
    count = k4a.connected_device_count()
    if not count:
        raise CaptureError(
            "no Azure Kinect is connected; plug it into a USB 3 port, and connect its power supply", code="camera"
        )
    config = k4a.Config(
        color_resolution=k4a.ColorResolution.RES_720P, color_format=k4a.ImageFormat.COLOR_BGRA32,
        depth_mode=getattr(k4a.DepthMode, mode), camera_fps=getattr(k4a.FPS, f"FPS_{rate}"),
        synchronized_images_only=True,
    )  # fmt: skip
    try:
        for number in range(count):
            camera = k4a.PyK4A(config, device_id=number)
            camera.open()
            if serial in (None, "", camera.serial):
                try:
                    camera.start()
                except k4a.K4AException:
                    camera.close()
                    raise
                return camera
            camera.close()
    except k4a.K4AException as error:
        raise CaptureError(
            f"the Azure Kinect cannot be started ({' '.join(str(error).split())}); connect it to USB 3 and power, and "
            "close other programs that use it",
            code="camera",
        ) from error
    raise CaptureError(f"no Azure Kinect has the serial number {serial}; leave it out to take the first", code="camera")


def pyk4a() -> Any:
    """The module pyk4a.

    Raises
    ------
    MirrorScanError
        When it is missing.
    """
    try:
        import pyk4a as module
    except ImportError as error:
        raise MirrorScanError(
            f"recording from an Azure Kinect needs pyk4a, which cannot be imported ({error}); install Microsoft's "
            "Azure Kinect Sensor SDK and “pip install pyk4a”",
            code="camera",
        ) from error
    return module
