"""How much light a surface gives back, how deep it went in, and what a depth camera can still make of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..mesh import Mesh
from ..mesh.bvh import Bvh, raycast
from ..numeric.srgb import to_linear
from .multipath import ray_lengths
from .optics import Optics
from .props import together
from .rays import BODY, FLOOR, FRAME, PROP, WALL, Sight
from .scene import Rig
from .sensors import Sensor

PLAIN = 0.5
"""Albedo of surfaces whose colour does not count; noise models are those of such a surface, seen squarely."""
ALBEDO = ((0.0, 0.006, 0.035, 0.07, 0.12, 0.45, 1.0), (0.01, 0.02, 0.04, 0.22, 0.38, 0.65, 0.85))
"""Luminance (of 1) and what near infrared returns. Most dyes are pale there; carbon black and dark hair are not."""
_FIXED = {FLOOR: 0.5, WALL: 0.7, FRAME: 0.35}
_THIN = 0.04
"""How quickly the light that went into skin leaves a thicker part [m]."""


def albedo(sight: Sight, subject: Mesh, props: Sequence[Mesh], optics: Optics) -> np.ndarray:
    """Share of near infrared that each pixel's surface gives back (H, W); 0 = nothing there."""
    result = np.where(sight.object > 0, PLAIN, 0.0)
    if not optics.dark:
        return result
    for kind, value in _FIXED.items():
        result[sight.object == kind] = value
    at = (sight.object == BODY) | (sight.object == PROP)
    linear = to_linear(_triangle_colors(subject, props)[sight.index[at]] / 255.0)
    result[at] = np.interp(linear @ (0.2126, 0.7152, 0.0722), *ALBEDO)
    return result


def signal(sight: Sight, rig: Rig, sensor: Sensor, surface: np.ndarray) -> np.ndarray:
    """Light that returns to each pixel, albedo · cos / r² [1/m²] (H, W).

    Two passes of each mirror on the way take their share, and so do windows that a thin part does not fill.

    Parameters
    ----------
    sight, rig, sensor
    surface : np.ndarray [shape=(H, W)]
        From :func:`albedo`.
    """
    there = sight.depth > 0
    way = np.where(there, sight.depth * ray_lengths(rig.intrinsics), 1.0)
    result = np.where(there, surface * np.cos(sight.incidence.astype(np.float64)) / way**2, 0.0)
    if rig.optics.attenuation:
        reflectivity = np.array([1.0, *(m.reflectivity for m in rig.mirrors)])
        result *= reflectivity[sight.view] ** (2 * sight.bounces.astype(int))
        result *= filled(sight.depth, sensor.window)
    return result


def filled(depth: np.ndarray, window: int) -> np.ndarray:
    """Share of the ``window`` × ``window`` pixels round each one that show its own surface or a nearer one (H, W).

    Nearer pixels count, as it is the far side of a silhouette that takes the near one's reading.
    """
    height, width = depth.shape
    half = window // 2
    padded = np.pad(depth, half, mode="edge")
    limit = 1.03 * depth + 0.03
    count = np.zeros(depth.shape)
    for down in range(window):
        for right in range(window):
            near = padded[down : down + height, right : right + width]
            count += (near > 0) & (near <= limit)
    return count / window**2


def noise_gain(
    strength: np.ndarray | None, sight: Sight, rig: Rig, sensor: Sensor, foreign: np.ndarray | float = 0.0
) -> np.ndarray:
    """By how much noise is larger than the sensor's own figure, at least 1 and at most 5 (H, W).

    Variance goes with (S + B) / S²: photons of the signal S and of a background B, taken to be what the faintest
    signal has (Lange and Seitz 2001). The figure is that of a plain surface at the same distance, seen squarely; so
    strong is a signal whose ``strength`` is None, as of optics that do not weaken it.

    ``foreign`` is light of other cameras that comes back from the same surface (H, W): photons as those of the
    background. Two cameras of which neither knows the other's clock mostly do no more to each other (Brogli, "Kinect
    sensor interference measurement", ETH Zurich 2016, on Kinects v2); now and then their frequencies meet, which is
    left out, and with their clocks wired together none sees the other's light at all.
    """
    way = np.where(sight.depth > 0, sight.depth * ray_lengths(rig.intrinsics), 1.0)
    usual, background = PLAIN / way**2, sensor.faintest
    s = usual if strength is None else np.maximum(strength, 1e-9)
    return np.clip(np.sqrt((s + background + foreign) / s**2 * usual**2 / (usual + background)), 1.0, 5.0)


def skin_delay(sight: Sight, bvh: Bvh, subject: Mesh, optics: Optics) -> np.ndarray:
    """How much too far bare skin is read (H, W) [m]: more where the body is thin, as hands are.

    Skin is what has the colour of skin, light or dark (Kovač, Peer and Solina 2003).
    """
    result = np.zeros(sight.depth.shape)
    if optics.skin == (0.0, 0.0):
        return result
    v, u = np.nonzero(sight.object == BODY)
    r, g, b = _triangle_colors(subject, ())[sight.index[v, u]].T
    bare = (r > 90) & (g > 40) & (b > 20) & (r - g > 12) & (r - b > 15) & (g > b) & (g > 0.6 * r)
    v, u = v[bare], u[bare]
    inward = -sight.normal[v, u]
    thickness = raycast(bvh, sight.point[v, u] + 1e-3 * inward, inward, 1.0)[0] + 1e-3
    result[v, u] = optics.skin[0] + optics.skin[1] * np.exp(-thickness / _THIN)
    return result


def depth_warp(rig: Rig, sensor: Sensor, depth: np.ndarray) -> np.ndarray:
    """A unit's smooth depth error at true depths z (H, W) [m].

    A cubic polynomial over the image that reaches the allowed size somewhere, and a scale, drawn by the unit.
    """
    rng = np.random.default_rng([rig.optics.unit, 4])
    height, width = depth.shape
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    terms = [x**i * y**j for i in range(4) for j in range(4 - i)]
    shape = sum(c * t for c, t in zip(rng.standard_normal(len(terms)), terms, strict=True))
    shape = rig.optics.warp * shape / np.abs(shape).max()
    scale = rig.optics.warp * rng.uniform(-1, 1)
    if sensor.baseline > 0:
        disparity = rig.intrinsics.fx * sensor.baseline / np.where(depth > 0, depth, 1.0)
        return depth * disparity / np.maximum(disparity - 0.1 * shape, 1e-6) - depth
    return np.where(depth > 0, 0.011 * shape + 0.001 * scale * depth, 0.0)


def _triangle_colors(subject: Mesh, props: Sequence[Mesh]) -> np.ndarray:
    """Mean sRGB of each triangle (T, 3), in the order of :attr:`.Sight.index`."""
    whole = together(subject, *props)
    assert whole.colors is not None  # together gives every mesh its colours
    return whole.colors.astype(np.float64)[whole.triangles].mean(axis=1)
