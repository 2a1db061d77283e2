"""Which sensor took a depth map, by the file or by the quantum of its values."""

from __future__ import annotations

from ..camera.noise_models import SENSORS, NoiseModel
from ..capture import Capture
from ..errors import MirrorScanError
from .dequantisation import find_step
from .settings import DepthSettings


def recognise(capture: Capture, settings: DepthSettings) -> tuple[str, NoiseModel | None]:
    """Name and noise model of the camera: by the settings, else by the capture, else by the quantum of its readings.

    A Kinect v1, or another camera of its make, is known by steps of an eighth of a pixel at a baseline of 7.5 cm.

    Returns
    -------
    name : str
        "unknown" when it is none of those in :data:`.noise_models.SENSORS`.
    model : NoiseModel or None

    Raises
    ------
    MirrorScanError
        When the settings name a sensor that is not in the table.
    """
    if settings.sensor not in ("auto", "unknown") and settings.sensor not in SENSORS:
        raise MirrorScanError(f"there is no sensor “{settings.sensor}”; choose auto, unknown, {', '.join(SENSORS)}")
    if settings.sensor != "auto":
        return settings.sensor, SENSORS.get(settings.sensor)
    if capture.sensor in SENSORS:
        return capture.sensor, SENSORS[capture.sensor]
    step = find_step(capture.depth[0])
    kinect = SENSORS["kinect_v1"].step(capture.intrinsics.fx)
    if (
        step and 0.8 < step / kinect < 1.25
    ):  # registered to colour its readings keep their quantum but not the focal length
        return "kinect_v1", SENSORS["kinect_v1"]
    return "unknown", None


_TIME_OF_FLIGHT = {(640, 576), (320, 288), (512, 512), (1024, 1024), (512, 424)}
"""Sizes of depth maps that only cameras which measure time have: Azure Kinect and Femto, Kinect v2."""


def measures_time(capture: Capture, settings: DepthSettings) -> bool | None:
    """Whether the camera measures time, which glass delays, and not angles; None when that is not known."""
    model = recognise(capture, settings)[1]
    if model is not None:
        return model.baseline == 0.0
    size = capture.intrinsics.width, capture.intrinsics.height
    return True if size in _TIME_OF_FLIGHT else None
