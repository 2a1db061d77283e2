"""Settings of the depth stage."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DepthSettings:
    """How a burst becomes one clean depth map. Every step can be turned off.

    Parameters
    ----------
    min_depth, max_depth : float
        Readings outside are dropped [m].
    burst_tolerance : float
        A frame's reading farther than this from the pixel's median is left out of the mean [relative, 1 = 100 %];
        ``inf`` takes the mean of all.
    burst_share : float
        A pixel needs a reading in at least this share of the frames [0..1].
    still_share : float
        Share of the subject that may have moved during a burst before that is reported [0..1]; 1 does not look.
    sensor : str
        Name in :data:`.noise_models.SENSORS` of the camera whose noise model helps; "auto" takes what the capture says,
        or what steps in the readings betray; "unknown" goes by the readings alone.
    dequantise : bool
        Treat coarse disparity steps that noise does not average out as intervals.
    support : int
        Of its 8 neighbours, how many must continue a pixel's surface for it to stay; 0 keeps flying pixels.
    smoothing : float
        Multiplies the smoothing radius that the noise asks for; 0 turns smoothing off.
    max_radius : int
        Largest smoothing radius [px].
    close_gaps : int
        Gaps of missing readings inside a surface up to this many pixels wide are filled; 0 leaves them.
    """

    min_depth: float = 0.2
    max_depth: float = 12.0
    burst_tolerance: float = 0.06
    burst_share: float = 0.3
    still_share: float = 0.08
    sensor: str = "auto"
    dequantise: bool = True
    support: int = 4
    smoothing: float = 1.0
    max_radius: int = 9
    close_gaps: int = 2
