"""What light, glass and surfaces do to a depth camera, as data: :class:`Optics`, one switch an effect.

:data:`IDEAL` leaves everything out; :func:`real` is what applies to one sensor. What belongs to a mirror (bow,
thickness and reflectivity of its glass) stands in :class:`~.scene.FramedMirror`.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from ..errors import MirrorScanError
from .sensors import find_sensor

TRIPLES = ((200.0, 180.0, 90.0), (100.0, 80.0, 16.0), (165.0, 140.0, 60.0), (120.0, 80.0, 16.0))
"""Modulation frequencies [MHz] that phase-measuring cameras might use; the last are about the Kinect v2's."""

EFFECTS: dict[str, tuple[str, ...]] = {
    "multipath": ("multipath",),
    "glass": (),
    "bow": (),
    "attenuation": ("attenuation",),
    "dark": ("dark",),
    "skin": ("skin",),
    "noise": ("correlated_noise", "fixed_noise"),
    "warp": ("warp",),
    "color": ("color_shift", "color_delay", "sway"),
    "uneven": ("uneven_floor", "uneven_walls"),
}
"""Names by which effects are turned on one by one, with their fields; glass and bow belong to the mirrors."""
_FIXED = {"stereo": 0.5, "pattern": 0.05}
"""Share of the noise that a burst does not average out. A Kinect v1 has little of it beside its steps, as the paper's
means of 10 frames show: 2.1 mm between two captures over 3 m (5.1), a seventh of one frame's noise."""


@dataclass(frozen=True)
class Optics:
    """Which effects a virtual snapshot shows. A field's 0 or False, as by default, switches its effect off.

    Parameters
    ----------
    multipath : bool
        Light that comes two ways. A phase-measuring camera reads the phase of the sum of the paths and gives a pixel
        up where its frequencies disagree; a camera that times pulses takes the strongest peak. Cameras that match
        patterns or pictures are not concerned. Bhandari et al. 2014 (resolving multipath interference in
        time-of-flight imaging); Freedman et al. 2014 (SRA).
    frequencies : tuple of float
        Of the modulation [MHz], one or more; :data:`TRIPLES` names some.
    disagreement : float
        A pixel is given up where the frequencies' distances lie further apart [m].
    pulse_length : float
        Peaks nearer than this merge in a camera that times pulses [m]; 15 cm = 1 ns there and back.
    attenuation : bool
        Light that comes back falls with the cosine of incidence, with the square of the folded way and of the mirrors'
        reflectivity, and with the share of a matching window or lens blur that a thin part fills. Noise grows as it
        does with few photons and a constant background, and below :attr:`.Sensor.faintest` nothing is read. Lange and
        Seitz 2001 (solid-state time-of-flight range camera), equation 8.
    dark : bool
        Dark cloth and hair give little back: the near-infrared albedo follows the colour
        (:data:`.returned_light.ALBEDO`). Azure-Kinect-Sensor-SDK issues 897 and 1394.
    skin : tuple of float
        Light goes into bare skin before it returns, which reads too far by the first number where the body is thick,
        and by both together where it is thin [m]. Time of flight only. 8 to 15 mm on hands in
        Azure-Kinect-Sensor-SDK issue 1341.
    correlated_noise : bool
        A triangulating camera's noise is the same for neighbours as far as their matching windows overlap.
    fixed_noise : float
        Share of that noise's variance that stays the same in all frames of a burst, 0 to 1: the same scene gives the
        same wrong match.
    warp : float
        A unit's smooth depth error, as a share of what its maker allows: 11 mm + 0.1 % in a camera that times light
        (data sheet of the Azure Kinect), 0.1 px of disparity otherwise.
    unit : int
        Which unit of the sensor it is: the shape of its warp.
    color_shift : tuple of float
        The colour image lies this far right and down of the depth map [px].
    color_delay, sway : float
        The colour image is taken this much later [s], and the subject moves to its left by ``sway`` [m/s].
    uneven_floor, uneven_walls : float
        Size of the waves of floor and walls, .7 to 4 m long [m].
    """

    multipath: bool = False
    frequencies: tuple[float, ...] = TRIPLES[0]
    disagreement: float = 0.04
    pulse_length: float = 0.15
    attenuation: bool = False
    dark: bool = False
    skin: tuple[float, float] = (0.0, 0.0)
    correlated_noise: bool = False
    fixed_noise: float = 0.0
    warp: float = 0.0
    unit: int = 0
    color_shift: tuple[float, float] = (0.0, 0.0)
    color_delay: float = 0.0
    sway: float = 0.0
    uneven_floor: float = 0.0
    uneven_walls: float = 0.0

    def __post_init__(self) -> None:
        if not self.frequencies or not all(np.isfinite(f) and 1.0 <= f <= 1000.0 for f in self.frequencies):
            raise MirrorScanError(f"optics: frequencies = {self.frequencies}; give one or more from 1 to 1000 MHz")
        for name in ("disagreement", "pulse_length"):
            if not 0 < getattr(self, name) < np.inf:
                raise MirrorScanError(f"optics: {name} = {getattr(self, name)} m; give a positive number")
        if not 0 <= self.fixed_noise <= 1:
            raise MirrorScanError(f"optics: fixed_noise = {self.fixed_noise}; give a share from 0 to 1")
        if self.fixed_noise and not self.correlated_noise:
            raise MirrorScanError("optics: fixed_noise is a share of the correlated noise; turn correlated_noise on")
        sizes = (*self.skin, self.warp, *self.color_shift, self.color_delay, self.sway)
        if not np.isfinite((*sizes, self.uneven_floor, self.uneven_walls)).all():
            raise MirrorScanError("optics: a size is not a finite number; give metres, pixels and seconds")
        if max(abs(self.uneven_floor), abs(self.uneven_walls)) > 0.05:
            raise MirrorScanError("optics: floor or walls are uneven by more than 0.05 m; give less")

    @property
    def weakens(self) -> bool:
        """Whether the strength of the light that returns matters."""
        return self.attenuation or self.dark


IDEAL = Optics()
"""Nothing but geometry and the sensor's noise."""


def real(
    sensor: str, frequencies: tuple[float, ...] | None = None, unit: int = 0, effects: Collection[str] = tuple(EFFECTS)
) -> Optics:
    """Everything that applies to a sensor, in its usual size or a little more.

    Parameters
    ----------
    sensor : str
        A name of :data:`~.sensors.SENSORS`.
    frequencies : tuple of float or None
        Of a phase-measuring camera [MHz]; None = some that are near to the sensor's.
    unit : int
        Draws the unit's warp, between 0.3 and 1 of what is allowed, and where its colour image lies.
    effects : collection of str
        Names of :data:`EFFECTS` that are turned on, as far as they apply; all by default.

    Raises
    ------
    MirrorScanError
        When a name is not known.
    """
    for name in effects:
        if name not in EFFECTS:
            raise MirrorScanError(f"optics: there is no effect “{name}”; choose of {', '.join(EFFECTS)}")
    principle = find_sensor(sensor).principle
    if principle == "exact":
        return IDEAL
    timed = principle in ("phase", "pulse")
    usual = TRIPLES[3] if sensor == "kinect_v2" else TRIPLES[0]
    rng = np.random.default_rng([unit, 3])
    warp, bearing, shift, sway = rng.uniform((0.3, 0.0, 1.0, -0.1), (1.0, 2 * np.pi, 4.0, 0.1))
    everything = Optics(
        multipath=timed, frequencies=frequencies or usual, attenuation=True, dark=True,
        skin=(0.004, 0.011) if timed else (0.0, 0.0),
        correlated_noise=not timed, fixed_noise=_FIXED.get(principle, 0.0), warp=float(warp), unit=unit,
        color_shift=(float(shift * np.cos(bearing)), float(shift * np.sin(bearing))), color_delay=0.033,
        sway=float(sway), uneven_floor=0.004, uneven_walls=0.008,
    )  # fmt: skip
    off = [field for name, names in EFFECTS.items() if name not in effects for field in names]
    return replace(everything, **{field: getattr(IDEAL, field) for field in off})
