"""Noise of depth cameras, as data: one :class:`NoiseModel` a camera. Cleaning and simulation read the same table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class NoiseModel:
    """Random error and quantisation of one reading.

    To add a camera, add an entry to :data:`SENSORS`; a figure that is not known stays 0.

    Parameters
    ----------
    title : str
        For people.
    min_range, max_range : float
        Where it reads well [m], as its maker says.
    axial : tuple of float
        a, b: standard deviation a + b · z² [m], for cameras that measure time.
    baseline : float
        Between its two viewpoints [m], for cameras that measure disparity f · baseline / z.
    disparity_noise, disparity_step : float
        Standard deviation and quantum of that disparity [px].
    lateral : tuple of float
        s, t: standard deviation s + t · θ / (π/2 - θ) [px] of the place a reading is taken from; θ = incidence.
    phase : bool
        It measures the phase of modulated light: light that comes two ways falsifies it (see :mod:`..light`).
    """

    title: str
    min_range: float
    max_range: float
    axial: tuple[float, float] = (0.0, 0.0)
    baseline: float = 0.0
    disparity_noise: float = 0.0
    disparity_step: float = 0.0
    lateral: tuple[float, float] = (0.0, 0.0)
    phase: bool = False

    def step(self, focal: float) -> float:
        """Quantum of 1/z [1/m] at ``focal`` [px]; 0 when it is finer than the noise."""
        return self.disparity_step / (focal * self.baseline) if self.baseline else 0.0

    def sigma(self, z: float | np.ndarray, focal: float) -> float | np.ndarray:
        """Standard deviation [m] of a reading at ``z`` [m], rounding included."""
        variance = (self.axial[0] + self.axial[1] * z * z) ** 2
        if self.baseline:
            scale = z * z / (focal * self.baseline)
            variance = variance + scale * scale * (self.disparity_noise**2 + self.disparity_step**2 / 12.0)
        return np.sqrt(variance)


def _azure(title: str) -> NoiseModel:
    """Azure Kinect's camera, NFOV unbinned: σ ≤ 17 mm by its maker."""
    return NoiseModel(title, 0.5, 3.86, axial=(0.0012, 0.0003), phase=True)


def _d4xx(title: str, baseline: float) -> NoiseModel:
    """Active stereo of the D400 family: RMS = z² · subpixel / (f · baseline)."""
    return NoiseModel(title, 0.4, 6.0, baseline=baseline, disparity_noise=0.08)


SENSORS: dict[str, NoiseModel] = {
    # Nguyen, Izadi and Lovell 2012: axial 1.2 mm + 1.9 mm (z - 0.4)², lateral as here. 0.056 px before the 1/8 px
    # quantum gives that axial noise within 10 % from 1.5 to 5 m. Baseline and quantum as in the OpenNI and ROS drivers.
    "kinect_v1": NoiseModel(
        "Kinect v1 (structured light)", 0.8, 4.0, baseline=0.075, disparity_noise=0.056, disparity_step=0.125,
        lateral=(0.8, 0.035),
    ),
    # about 1 to 2 mm up to 3 m (Wasenmüller and Stricker 2016)
    "kinect_v2": NoiseModel("Kinect v2 (time of flight)", 0.5, 4.5, axial=(0.0008, 0.00015), phase=True),
    "azure_kinect": _azure("Azure Kinect DK (time of flight)"),
    "femto_bolt": _azure("Orbbec Femto Bolt (time of flight)"),
    "realsense_d415": _d4xx("RealSense D415 (active stereo)", 0.055),
    "realsense_d435": _d4xx("RealSense D435 (active stereo)", 0.050),
    "realsense_d455": _d4xx("RealSense D455 (active stereo)", 0.095),
}  # fmt: skip
