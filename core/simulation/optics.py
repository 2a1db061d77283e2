"""What light, glass and surfaces do to a depth camera, as data: :class:`Optics`, one switch an effect.

:data:`IDEAL` leaves everything out; :func:`real` is what applies to one sensor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import MirrorScanError
from .sensors import find_sensor

TRIPLES = ((200.0, 180.0, 90.0), (100.0, 80.0, 16.0), (165.0, 140.0, 60.0), (120.0, 80.0, 16.0))
"""Modulation frequencies [MHz] that phase-measuring cameras might use; the last are about the Kinect v2's."""


@dataclass(frozen=True)
class Optics:
    """Which effects a virtual snapshot shows. Each field's 0, False or () switches its effect off.

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
    """

    multipath: bool = False
    frequencies: tuple[float, ...] = TRIPLES[0]
    disagreement: float = 0.04
    pulse_length: float = 0.15

    def __post_init__(self) -> None:
        if not self.frequencies or not all(np.isfinite(f) and 1.0 <= f <= 1000.0 for f in self.frequencies):
            raise MirrorScanError(f"optics: frequencies = {self.frequencies}; give one or more from 1 to 1000 MHz")
        for name in ("disagreement", "pulse_length"):
            if not 0 < getattr(self, name) < np.inf:
                raise MirrorScanError(f"optics: {name} = {getattr(self, name)} m; give a positive number")


IDEAL = Optics()
"""Nothing but geometry and the sensor's noise."""


def real(sensor: str, frequencies: tuple[float, ...] | None = None) -> Optics:
    """Everything that applies to a sensor, in its usual size.

    Parameters
    ----------
    sensor : str
        A name of :data:`~.sensors.SENSORS`.
    frequencies : tuple of float or None
        Of a phase-measuring camera [MHz]; None = some that are near to the sensor's.
    """
    principle = find_sensor(sensor).principle
    if principle == "exact":
        return IDEAL
    usual = TRIPLES[3] if sensor == "kinect_v2" else TRIPLES[0]
    return Optics(multipath=principle in ("phase", "pulse"), frequencies=frequencies or usual)
