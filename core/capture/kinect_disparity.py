"""Kinect v1: raw 11-bit disparity to metres, and the calibrations that were published.

Which formula is right matters: at a raw value of 800 they differ by 50 mm, and beyond 3.8 m they part again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera import Intrinsics

NO_READING = 2047
WIDTH, HEIGHT = 640, 480
MAX_DEPTH_M = 10.0  # the driver's own limit

#: Published by N. Burrus for one unit, and in wide use; depth in metres, lens model in OpenCV's order.
BURRUS_DEPTH = Intrinsics(640, 480, 594.21, 591.04, 339.5, 242.7, (-0.26386, 0.99966, -0.00076275, 0.0050350, -1.30536))
BURRUS_COLOR = Intrinsics(640, 480, 529.22, 525.56, 328.94, 267.48, (0.26452, -0.83991, -0.0019922, 0.0014372, 0.91192))
#: Colour camera of an unregistered stream, between the published calibrations (Burrus; NYU Depth v2's toolbox). It
#: looks lower than the infrared camera by some 17 px.
NOMINAL_COLOR = Intrinsics(640, 480, 525.0, 525.0, 328.0, 257.0)


@dataclass(frozen=True)
class ZeroPlane:
    """Factory calibration that the device stores; the defaults are those of the driver.

    ``reference_distance`` [mm] and ``pixel_size`` [mm] at the infrared sensor as the driver counts it,
    ``emitter_distance`` and ``color_distance`` [cm] from the infrared camera, ``const_shift`` [px].
    """

    reference_distance: float = 120.0
    pixel_size: float = 0.1042
    emitter_distance: float = 7.5
    color_distance: float = 2.3
    const_shift: float = 200.0


def depth_of_disparity(formula: str = "factory", plane: ZeroPlane | None = None) -> np.ndarray:
    """Depth [m] of each raw value 0 … 2047, as a table (2048,) float32; 0 where there is none.

    Parameters
    ----------
    formula : {"factory", "linear", "tangent"}
        ``factory``: the driver's (libfreenect, OpenNI2), from the device's zero plane. ``linear``: 1 / (a raw + b) as
        fitted by the OpenKinect community; 50 mm short at 1.2 m. ``tangent``: S. Magnenat's fit, good to 3.8 m.
    plane : ZeroPlane or None
        For ``factory``; None takes the defaults.
    """
    raw = np.arange(2048, dtype=np.float64)
    with np.errstate(divide="ignore"):
        if formula == "linear":
            depth = 1.0 / (-0.0030711016 * raw + 3.3309495161)
        elif formula == "tangent":
            depth = 0.1236 * np.tan(raw / 2842.5 + 1.1863)
        else:
            plane = plane or ZeroPlane()
            shift = ((raw - 4 * plane.const_shift) / 4 - 0.375) * plane.pixel_size
            depth = (
                shift * plane.reference_distance / (plane.emitter_distance - shift) + plane.reference_distance
            ) / 100
    depth[~(np.isfinite(depth) & (depth > 0) & (depth <= MAX_DEPTH_M))] = 0
    depth[NO_READING] = 0
    return depth.astype(np.float32)


def factory_camera(plane: ZeroPlane | None = None) -> Intrinsics:
    """Pinhole of the depth stream by the factory's zero plane: f = reference distance / (2 pixel size), 575.8 px."""
    plane = plane or ZeroPlane()
    focal = plane.reference_distance / (2 * plane.pixel_size)
    return Intrinsics(WIDTH, HEIGHT, focal, focal, WIDTH / 2, HEIGHT / 2)


def calibration(name: str = "factory", plane: ZeroPlane | None = None) -> tuple[Intrinsics, Intrinsics, np.ndarray]:
    """Depth intrinsics, colour intrinsics and depth-to-colour (4, 4) [m] of an unregistered Kinect v1."""
    pose = np.eye(4)
    if name == "burrus":
        # His T is where the colour camera stands: to the right of the infrared one, as the device is built.
        pose[:3, 3] = -0.019985, 0.000744, 0.010917
        return BURRUS_DEPTH, BURRUS_COLOR, pose
    plane = plane or ZeroPlane()
    pose[0, 3] = -plane.color_distance / 100
    return factory_camera(plane), NOMINAL_COLOR, pose
