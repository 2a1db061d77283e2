"""Published intrinsics by image size, for captures that hold none: better than a refusal, worse than the camera's own.

Values: Open3D's PrimeSense default; libfreenect2 and iai_kinect2 for Kinect v2; an Azure Kinect DK's factory
calibration; Apple's LiDAR map scaled from 1920 × 1440; for a D455 a listing in librealsense's issue 15609.
"""

from __future__ import annotations

from ..camera import Intrinsics
from ..errors import CaptureError, Notice

_KINECT_V2_LENS = (0.0905474, -0.26819, 0.0, 0.0, 0.0950862)
_AZURE_LENS = (0.5479, -0.02097, 0.0, 0.0, -0.00265, 0.88968, 0.08613, -0.01391)

CAMERAS = {
    (640, 480): ("kinect_v1", Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)),
    (320, 240): ("kinect_v1", Intrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)),
    (512, 424): ("kinect_v2", Intrinsics(512, 424, 365.456, 365.456, 254.878, 205.395, _KINECT_V2_LENS)),
    (640, 576): ("azure_kinect", Intrinsics(640, 576, 504.0, 504.0, 323.0, 330.0, _AZURE_LENS)),
    (320, 288): ("azure_kinect", Intrinsics(320, 288, 252.0, 252.0, 161.25, 164.75, _AZURE_LENS)),
    (256, 192): ("phone", Intrinsics(256, 192, 212.0, 212.0, 127.5, 95.5)),
}


_OTHER_LENSES = {
    "realsense_d455": (
        Intrinsics(848, 480, 428.0, 428.0, 423.5, 239.5),
        Intrinsics(1280, 720, 646.0, 646.0, 639.5, 359.5),
    )
}
"""Of sensors that their size alone does not tell from others."""


def published_lenses(sensor: str) -> tuple[Intrinsics, ...]:
    """Published intrinsics of a sensor, one for each size of its depth maps.

    Raises
    ------
    CaptureError
        None are known of this sensor.
    """
    found = tuple(lens for name, lens in CAMERAS.values() if name == sensor) + _OTHER_LENSES.get(sensor, ())
    if not found:
        names = ", ".join(dict.fromkeys([name for name, _ in CAMERAS.values()] + list(_OTHER_LENSES)))
        raise CaptureError(
            "{sensor}: no lens of it is known; choose one of {names}", sensor=sensor, names=names, code="lens_wrong"
        )
    return found


def nominal_camera(width: int, height: int) -> tuple[Intrinsics, str, str] | None:
    """Intrinsics, sensor name and a note for the user, for the depth maps of one camera; None for other sizes."""
    known = CAMERAS.get((width, height))
    if known is None:
        return None
    sensor, camera = known
    note = Notice(
        "no intrinsics in the capture: published ones of a {sensor} are used (f {fx:g} px); give your camera's own for "
        "a true scale",
        sensor=sensor,
        fx=camera.fx,
    )
    return camera, sensor, note
