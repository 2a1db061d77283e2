"""Which sensor took a depth map, by the file or by the quantum of its values, and how it measures."""

from __future__ import annotations

from dataclasses import dataclass

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


_PHASE = {(640, 576), (320, 288), (512, 512), (1024, 1024), (512, 424)}
"""Sizes of depth maps of cameras which measure phase, and no others': Azure Kinect and Femto, Kinect v2."""

_PULSES = {"phone"}
"""Cameras without a noise model that time pulses."""


@dataclass(frozen=True)
class Principle:
    """How a camera measures depth.

    Parameters
    ----------
    sensor : str
        As :func:`recognise` names it.
    time : bool or None
        It times light, which glass delays, and does not measure angles; None when that is not known.
    phase : bool or None
        It does so by the phase of modulated light, which light that comes two ways falsifies; None when that is not
        known, so that its readings must show it.
    by : str
        Who says so, the first of: "option"; "file", "format", "name" or "size", as
        :attr:`.capture.Capture.sensor_from`; "steps" of the readings; "size" of the image; "readings" that light of
        two ways falsified; "nobody".
    """

    sensor: str
    time: bool | None
    phase: bool | None
    by: str

    @property
    def measures(self) -> str:
        """In one word: phase, pulses, time (one of these), angles, or unknown."""
        if self.time is None:
            return "unknown"
        return {True: "phase", False: "pulses", None: "time"}[self.phase] if self.time else "angles"


def measuring_principle(capture: Capture, settings: DepthSettings, phase_said: bool = False) -> Principle:
    """How the camera measures depth: the option says so, else the file, else evidence; else it is not known.

    Parameters
    ----------
    capture : Capture
    settings : DepthSettings
        Its ``sensor`` is an option, unless it is "auto"; "unknown" means that what the file says does not count.
    phase_said : bool
        Another option says that the camera measures phase, whichever it is.

    Raises
    ------
    MirrorScanError
        As :func:`recognise`.
    """
    sensor, model = recognise(capture, settings)
    if phase_said:
        return Principle(sensor, True, True, "option")
    if model is not None:
        named = capture.sensor_from if capture.sensor == sensor else "steps"
        by = named if settings.sensor == "auto" else "option"
        return Principle(sensor, model.baseline == 0.0, model.phase, by)
    if settings.sensor == "auto" and capture.sensor in _PULSES:
        return Principle(sensor, True, False, capture.sensor_from)
    if (capture.intrinsics.width, capture.intrinsics.height) in _PHASE:
        return Principle(sensor, True, True, "size")
    return Principle(sensor, None, None, "nobody")


def measures_time(capture: Capture, settings: DepthSettings) -> bool | None:
    """Whether the camera measures time, which glass delays, and not angles; None when that is not known."""
    return measuring_principle(capture, settings).time
