"""Noise of virtual depth cameras, as data and one function.

Noise and quantisation are those of :mod:`..noise_models`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera import Intrinsics
from ..camera.noise_models import SENSORS as NOISE_MODELS
from ..errors import MirrorScanError


@dataclass(frozen=True)
class Sensor:
    """A depth camera.

    Parameters
    ----------
    intrinsics : Intrinsics
        Of its depth map.
    min_range, max_range : float
        Readings outside are lost [m]. The folded path counts, so the limits are what bright surfaces still give,
        not those of the data sheet.
    baseline : float
        Second viewpoint (projector or second camera) to the right of the camera [m]; what it does not see is lost.
    disparity_noise, disparity_step : float
        Standard deviation and quantum of the disparity ``f · baseline / z`` [px]; 0 = none.
    axial_noise : tuple of float
        Standard deviation a + b · z² [m].
    lateral_jitter : tuple of float
        Standard deviation s + t · θ / (π/2 - θ) [px] of the place a reading is taken from; θ = incidence.
    flying, dropped : float
        Shares of the pixels on a silhouette that mix fore- and background, and that are lost.
    fattening : int
        Foreground grows over its silhouette by up to this many pixels.
    max_incidence_deg : float
        Surfaces seen at a larger angle return too little light.
    dropout : float
        Share of readings lost at random.
    interference : bool
        Its pattern arriving by two ways spoils the reading.
    principle : str
        How it measures: ``"pattern"`` and ``"stereo"`` triangulate, ``"phase"`` and ``"pulse"`` time the light's way;
        ``"exact"`` = by magic.
    cell : int
        Readings are taken this many pixels apart and interpolated between.
    window : int
        Side of the square over which light is gathered: the matching window of a triangulating camera, otherwise the
        lens's blur [px]; odd.
    faintest : float
        Weakest signal that gives a reading, as albedo · cos(incidence) / distance² [1/m²].
    """

    intrinsics: Intrinsics
    min_range: float
    max_range: float
    baseline: float = 0.0
    disparity_noise: float = 0.0
    disparity_step: float = 0.0
    axial_noise: tuple[float, float] = (0.0, 0.0)
    lateral_jitter: tuple[float, float] = (0.0, 0.0)
    flying: float = 0.0
    dropped: float = 0.0
    fattening: int = 0
    max_incidence_deg: float = 89.9
    dropout: float = 0.0
    interference: bool = False
    principle: str = "exact"
    cell: int = 1
    window: int = 1
    faintest: float = 0.0


def _noise(name: str) -> dict:
    """The fields of :class:`Sensor` that cleaning knows by the same figures."""
    model = NOISE_MODELS[name]
    return {
        "baseline": model.baseline,
        "disparity_noise": model.disparity_noise,
        "disparity_step": model.disparity_step,
        "axial_noise": model.axial,
        "lateral_jitter": model.lateral,
    }


_AZURE = Sensor(
    Intrinsics(640, 576, 504.0, 504.0, 319.5, 287.5), 0.5, 6.0,
    flying=0.2, dropped=0.1, max_incidence_deg=86.0, dropout=0.0005, principle="phase", window=3,
    faintest=0.003, **_noise("azure_kinect"),
)  # fmt: skip

# Weakest signals: what the makers' ranges and reflectances (Azure Kinect: 15 % at 3.86 m, with 17 mm of noise) come to,
# less a factor of 3 to 4, as a camera does not stop there: 15 % at 7 m, 5 % at 4 m. Matching windows: Kinect v1 9 px
# (Konolige and Mihelich 2011), D400 family 7 px.
SENSORS: dict[str, Sensor] = {
    "ideal": Sensor(Intrinsics(640, 480, 585.0, 585.0, 319.5, 239.5), 0.05, 60.0),
    "kinect_v1": Sensor(
        Intrinsics(640, 480, 585.0, 585.0, 319.5, 239.5), 0.5, 6.5, max_incidence_deg=80.0, dropout=0.001,
        interference=True, principle="pattern", window=9, faintest=0.004, **_noise("kinect_v1"),
    ),
    "kinect_v2": Sensor(
        Intrinsics(512, 424, 365.5, 365.5, 255.5, 211.5), 0.5, 6.0, flying=0.3, dropped=0.1, max_incidence_deg=84.0,
        dropout=0.001, principle="phase", window=3, faintest=0.002, **_noise("kinect_v2"),
    ),
    "azure_kinect": _AZURE,
    "femto_bolt": _AZURE,
    "realsense_d455": Sensor(
        Intrinsics(848, 480, 428.0, 428.0, 423.5, 239.5), 0.4, 8.0, fattening=2, max_incidence_deg=84.0,
        dropout=0.002, principle="stereo", window=7, faintest=0.002, **_noise("realsense_d455"),
    ),
    # The depth map that ARKit gives of a phone's or tablet's lidar: few spots, interpolated.
    "phone_dtof": Sensor(
        Intrinsics(256, 192, 205.0, 205.0, 127.5, 95.5), 0.2, 5.0, axial_noise=(0.002, 0.0004), flying=0.4,
        max_incidence_deg=84.0, principle="pulse", cell=3, window=3, faintest=0.004,
    ),
}  # fmt: skip


@dataclass(frozen=True)
class ColorCamera:
    """The colour camera of a device.

    Parameters
    ----------
    intrinsics : Intrinsics
        A pinhole, at the largest size that it records video in.
    offset : tuple of float
        Where it is in the depth camera's frame [m].
    tilt_deg : float
        By how much it looks further down than the depth camera.
    """

    intrinsics: Intrinsics
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt_deg: float = 0.0


# Azure: the calibration of a recording among pyk4a's tests, whose 1280x720 are a third of the size. Kinect v2: unit
# 196605135147 of iai_kinect2. D455: a listing in librealsense's issue 15609 and the data sheet's 59 mm. Kinect v1:
# OpenNI's figures at double size and 23 mm. Phone: ARKit's one camera for both, in the size of Stray Scanner's video.
_AZURE_COLOR = ColorCamera(
    Intrinsics(3840, 2160, 1835.4, 1835.8, 1919.5, 1079.5), (0.0321, 0.0026, -0.0037), tilt_deg=-4.95
)
COLOR_CAMERAS: dict[str, ColorCamera] = {
    "kinect_v1": ColorCamera(Intrinsics(1280, 960, 1050.0, 1050.0, 639.5, 479.5), (0.023, 0.0, 0.0)),
    "kinect_v2": ColorCamera(Intrinsics(1920, 1080, 1059.9, 1053.9, 959.5, 539.5), (0.0521, 0.0005, -0.0009)),
    "azure_kinect": _AZURE_COLOR,
    "femto_bolt": _AZURE_COLOR,
    "realsense_d455": ColorCamera(Intrinsics(1280, 800, 644.4, 643.5, 639.5, 399.5), (0.059, 0.0, 0.0)),
    "phone_dtof": ColorCamera(Intrinsics(1920, 1440, 1430.0, 1430.0, 959.5, 719.5)),
}
"""By the names of :data:`SENSORS`; the ideal sensor has none of its own."""


def find_sensor(name: str) -> Sensor:
    """The sensor of that name; MirrorScanError names those there are."""
    if name not in SENSORS:
        raise MirrorScanError(f"rig: there is no sensor '{name}'; choose one of {', '.join(SENSORS)}")
    return SENSORS[name]


def measure(
    sensor: Sensor, depth: np.ndarray, incidence: np.ndarray, focal: float, frames: int, rng: np.random.Generator,
    *, gain: np.ndarray | None = None, strength: np.ndarray | None = None, fixed: float | None = None,
) -> np.ndarray:  # fmt: skip
    """What the sensor reads of a scene whose true depth is known.

    Noise is drawn anew for each frame; what geometry decides (flying pixels, fattened silhouettes) stays the same
    over the burst, as it does with a still subject. O(frames · H · W) time; five times one frame of extra memory.

    Parameters
    ----------
    sensor : Sensor
    depth : np.ndarray [shape=(H, W)]
        True z [m], 0 where nothing can be read (shadow, interference, nothing there).
    incidence : np.ndarray [shape=(H, W)]
        Angle between ray and surface normal [rad].
    focal : float
        fx of the depth map [px], for disparity.
    frames : int
    rng : np.random.Generator
    gain : np.ndarray [shape=(H, W)] or None
        By how much noise is larger than the sensor's figure.
    strength : np.ndarray [shape=(H, W)] or None
        Light that returns, in parts of the weakest that gives a reading; it flickers by a tenth from frame to frame.
    fixed : float or None
        Noise is correlated over the sensor's window, and this share of its variance is the same in each frame; None =
        each pixel and each frame has noise of its own.

    Returns
    -------
    np.ndarray [shape=(frames, H, W), dtype=float32]
        z [m] in whole millimetres, 0 = no reading.
    """
    scene = np.where(incidence <= np.radians(sensor.max_incidence_deg), depth, 0.0).astype(np.float32)
    if sensor.fattening:
        scene = _fatten(scene, sensor.fattening, rng)
    height, width = scene.shape
    fore, back, edge = _silhouettes(scene)
    kind = rng.random(scene.shape, dtype=np.float32)
    flying = edge & (kind < sensor.flying)
    scene[edge & (kind >= sensor.flying) & (kind < sensor.flying + sensor.dropped)] = 0.0
    share = rng.random(int(flying.sum()), dtype=np.float32)
    slant = np.minimum(incidence, np.radians(80.0)).astype(np.float32)
    jitter = sensor.lateral_jitter[0] + sensor.lateral_jitter[1] * slant / (np.float32(np.pi / 2) - slant)
    rows, columns = np.indices(scene.shape, dtype=np.float32)
    spots = _spots(scene, sensor.cell) if sensor.cell > 1 else None
    larger = np.float32(1.0) if gain is None else gain.astype(np.float32)
    same = None if fixed is None else _smooth_noise(scene.shape, sensor.window, rng)

    burst = np.empty((frames, height, width), dtype=np.float32)
    for frame in burst:
        z = scene.copy()
        if flying.any():
            mix = np.clip(share + 0.05 * rng.standard_normal(len(share), dtype=np.float32), 0, 1)
            z[flying] = mix * fore[flying] + (1 - mix) * back[flying]
        if sensor.lateral_jitter[0] > 0:
            u = columns + jitter * rng.standard_normal(z.shape, dtype=np.float32)
            v = rows + jitter * rng.standard_normal(z.shape, dtype=np.float32)
            z = z[np.clip(np.rint(v), 0, height - 1).astype(np.intp), np.clip(np.rint(u), 0, width - 1).astype(np.intp)]
        read = z > 0
        if sensor.axial_noise != (0.0, 0.0):
            sigma = np.float32(sensor.axial_noise[0]) + np.float32(sensor.axial_noise[1]) * z * z
            z += larger * sigma * _noise_of_frame(z.shape, sensor.window, same, fixed, rng)
        if sensor.disparity_noise > 0 or sensor.disparity_step > 0:
            scale = np.float32(focal * sensor.baseline)
            disparity = scale / np.where(read, z, np.float32(1.0))
            if sensor.disparity_noise > 0:
                noise = _noise_of_frame(z.shape, sensor.window, same, fixed, rng)
                disparity += larger * np.float32(sensor.disparity_noise) * noise
            if sensor.disparity_step > 0:
                disparity = np.rint(disparity / np.float32(sensor.disparity_step)) * np.float32(sensor.disparity_step)
            read &= disparity > 0
            z = scale / np.where(read, disparity, np.float32(1.0))
        if strength is not None:
            read &= strength * (1 + 0.1 * rng.standard_normal(z.shape, dtype=np.float32)) >= 1.0
        if sensor.dropout > 0:
            read &= rng.random(z.shape, dtype=np.float32) >= sensor.dropout
        if spots is not None:
            z = _interpolated(np.where(read, z, np.float32(0.0)), *spots)
            read &= z > 0
        read &= (z >= sensor.min_range) & (z <= sensor.max_range)
        frame[:] = np.where(read, np.rint(z * np.float32(1000.0)) / np.float32(1000.0), np.float32(0.0))
    return burst


def _noise_of_frame(
    shape: tuple[int, ...], window: int, same: np.ndarray | None, fixed: float | None, rng: np.random.Generator
) -> np.ndarray:
    """Noise of variance 1: of each pixel's own, or smooth and partly the ``same`` as in other frames."""
    if same is None or fixed is None:
        return rng.standard_normal(shape, dtype=np.float32)
    moving = _smooth_noise(shape, window, rng)
    return np.float32(np.sqrt(fixed)) * same + np.float32(np.sqrt(1 - fixed)) * moving


def _smooth_noise(shape: tuple[int, ...], window: int, rng: np.random.Generator) -> np.ndarray:
    """Gaussian noise of variance 1, correlated as far as windows of ``window`` pixels overlap (float32)."""
    values = rng.standard_normal((shape[0] + window - 1, shape[1] + window - 1))
    for axis in (0, 1):
        total = np.cumsum(np.insert(values, 0, 0.0, axis=axis), axis=axis)
        size = shape[axis]
        values = np.take(total, range(window, window + size), axis=axis) - np.take(total, range(size), axis=axis)
    return (values / window).astype(np.float32)


def _spots(z: np.ndarray, cell: int) -> tuple[np.ndarray, np.ndarray]:
    """For each pixel the four spots round it, ``cell`` apart: their flat indices and shares (4, H, W).

    Spots on another surface than the pixel's have no share, as interpolation is guided by the colour image.
    """
    height, width = z.shape
    rows, columns = np.indices(z.shape)
    r, c = (np.arange(size, dtype=np.float32) % cell / cell for size in (height, width))
    index, share = np.empty((4, height, width), np.intp), np.empty((4, height, width), np.float32)
    for k in range(4):
        down, right = divmod(k, 2)
        at = (
            np.minimum(rows // cell * cell + down * cell, height - 1),
            np.minimum(columns // cell * cell + right * cell, width - 1),
        )
        index[k] = at[0] * width + at[1]
        weight = (r if down else 1 - r)[:, None] * (c if right else 1 - c)[None, :]
        there = z[at]
        share[k] = np.where((there > 0) & (np.abs(there - z) < 0.03 * z + 0.02), weight, 0.0)
    return index, share


def _interpolated(z: np.ndarray, index: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Readings between spots; a pixel without any spot on its surface keeps its own."""
    there = z.ravel()[index]
    weight = np.where(there > 0, share, np.float32(0.0))
    total = weight.sum(axis=0)
    mean = np.divide((weight * there).sum(axis=0), total, where=total > 0, out=z.copy())
    return np.where(z > 0, mean, np.float32(0.0))


def _silhouettes(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nearest and farthest reading of each pixel's 3x3 neighbours, and whether a step lies between them."""
    near = _lowest(np.where(z > 0, z, np.float32(np.inf)), 1)
    far = -_lowest(-z, 1)
    return near, far, (z > 0) & (far > 1.02 * near + 0.04)


def _fatten(z: np.ndarray, radius: int, rng: np.random.Generator) -> np.ndarray:
    """Grow the foreground by a width that wanders from 0 to ``radius`` along the silhouette."""
    height, width = z.shape
    coarse = rng.integers(0, radius + 1, (height // 3 + 1, width // 3 + 1))
    width_at = np.repeat(np.repeat(coarse, 3, axis=0), 3, axis=1)[:height, :width]
    solid = np.where(z > 0, z, np.float32(np.inf))
    grown = z.copy()
    for r in range(1, radius + 1):
        low = _lowest(solid, r)
        # Only steps are fattened; a slanting surface stays where it is.
        step = (width_at == r) & np.isfinite(low) & (solid > 1.02 * low + 0.04)
        grown[step] = low[step]
    return grown


def _lowest(values: np.ndarray, radius: int) -> np.ndarray:
    """Minimum over a square window, edges repeated."""
    for axis in (0, 1):
        size = values.shape[axis]
        padded = np.take(values, np.clip(np.arange(-radius, size + radius), 0, size - 1), axis=axis)
        windows = [np.take(padded, range(s, s + size), axis=axis) for s in range(2 * radius + 1)]
        values = np.minimum.reduce(windows)
    return values
