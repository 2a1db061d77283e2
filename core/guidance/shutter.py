"""When the burst is taken: all well for a moment, a countdown, the burst while the subject holds still.

:class:`Shutter` is told of each frame, and says what it does; :func:`write_burst` keeps what it took.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..camera import Intrinsics
from ..capture import MirrorPicks
from ..capture.live_camera import Stream, record
from ..depth.burst_motion import Motion, burst_motion, still_warning
from ..depth.settings import DepthSettings
from .advice import Advice
from .live_scene import LiveFrame, stride, thinned_image

ADVISING, WELL, COUNTING, BURST, DONE = "advising", "well", "counting down", "burst", "done"
"""What the shutter does."""

_STILL_PIXELS = 92_160  # of a frame, by which it is judged whether the subject moved
_WATCHED = 8  # frames of the burst between which its motion is measured


@dataclass(frozen=True)
class ShutterSettings:
    """When the burst is taken, and how long it is.

    Parameters
    ----------
    well_s : float
        How long all must be well before the countdown [s].
    countdown_s : float
        How long that is [s].
    frames : int
        Depth frames of the burst.
    ignore : tuple of str
        Kinds of advice that the burst does not wait for.
    retakes : int
        How many times at most a burst in which the subject moved is taken again.
    depth : DepthSettings
        ``still_share`` says what counts as motion.
    """

    well_s: float = 0.5
    countdown_s: float = 3.0
    frames: int = 30
    ignore: tuple[str, ...] = ()
    retakes: int = 3
    depth: DepthSettings = DepthSettings()


class Shutter:
    """Takes the burst by itself: ``shutter.advance(...)`` for each frame, until ``shutter.state`` is ``done``.

    Attributes
    ----------
    state : str
        ``advising``, ``well``, ``counting down``, ``burst`` or ``done``.
    left_s : float
        Of the countdown [s].
    moved_m : float
        How far the subject moved since the burst began [m].
    retaken : int
        How many bursts were dropped because the subject moved.
    warning : str or None
        That the subject moved during the burst that is kept.
    burst : list of np.ndarray
        Depth frames (H, W) [m] taken so far.
    color : np.ndarray or None
        The burst's last colour image.
    began : float
        When the first of these frames was taken [s].
    """

    def __init__(self, intrinsics: Intrinsics, settings: ShutterSettings = ShutterSettings()) -> None:
        self.settings = settings
        self.state = ADVISING
        self.left_s = settings.countdown_s
        self.moved_m = 0.0
        self.retaken = 0
        self.warning: str | None = None
        self.burst: list[np.ndarray] = []
        self.color: np.ndarray | None = None
        self.began = 0.0
        self._camera = intrinsics
        self._step = stride(intrinsics, _STILL_PIXELS)
        self._labels: np.ndarray | None = None
        self._well_since: float | None = None
        self._small: list[np.ndarray] = []

    @property
    def share(self) -> float:
        """How much of the burst is taken, 0 to 1."""
        return len(self.burst) / self.settings.frames

    def blocking(self, advices: Iterable[Advice]) -> list[Advice]:
        """The advice that the burst waits for."""
        return [one for one in advices if one.severity == "warning" and one.code not in self.settings.ignore]

    def take(self, depth: np.ndarray, color: np.ndarray | None) -> None:
        """One frame (H, W) [m] of the burst; the last one ends it, or has it taken again."""
        self.burst.append(np.array(depth, np.float32))
        self.color = color if color is not None else self.color
        self._small.append(thinned_image(self.burst[-1], self._step))
        if len(self._small) % _WATCHED == 0:
            self.moved_m = self._motion().median
        if len(self.burst) >= self.settings.frames:
            self._end()

    def advance(self, frame: LiveFrame, advices: Sequence[Advice]) -> str:
        """What to do after a frame that was looked at: the state.

        Parameters
        ----------
        frame : LiveFrame
        advices : sequence of Advice
            Steadied, of this moment. The burst is not begun while this frame itself has a warning, either.
        """
        if self.state in (BURST, DONE):
            return self.state
        if frame.views is None or self.blocking(advices) or self.blocking(frame.advices):
            if self.blocking(advices) or self.state == ADVISING or frame.views is None:
                self.state, self._well_since, self.left_s = ADVISING, None, self.settings.countdown_s
            return self.state  # one bad frame alone only puts the burst off
        if self._well_since is None:
            self._well_since = frame.seconds
        well = frame.seconds - self._well_since
        self.left_s = min(self.settings.countdown_s, self.settings.well_s + self.settings.countdown_s - well)
        if well < self.settings.well_s:
            self.state = WELL
        elif self.left_s > 0.0:
            self.state = COUNTING
        else:
            self._begin(frame)
        return self.state

    def _begin(self, frame: LiveFrame) -> None:
        assert frame.views is not None  # only then it is called
        self.state, self.began = BURST, frame.seconds
        self.burst, self._small, self.color, self.moved_m, self.left_s = [], [], None, 0.0, 0.0
        rows, columns = (np.arange(size) for size in self._thinned_shape())
        labels = frame.views.labels
        ratio = (labels.shape[0] / len(rows), labels.shape[1] / len(columns))
        at = [np.minimum((one * share).astype(int), size - 1)
              for one, share, size in zip((rows, columns), ratio, labels.shape, strict=True)]  # fmt: skip
        self._labels = np.ascontiguousarray(labels[np.ix_(*at)])

    def _thinned_shape(self) -> tuple[int, int]:
        first = self._step // 2
        return len(range(first, self._camera.height, self._step)), len(range(first, self._camera.width, self._step))

    def _motion(self) -> Motion:
        """Of the last frames of the burst against its first."""
        assert self._labels is not None  # since the burst began
        some = np.stack((*self._small[: _WATCHED // 2], *self._small[-_WATCHED // 2 :]))
        return burst_motion(some, self._labels, self._step / self._camera.fx, self.settings.depth.still_share)

    def _end(self) -> None:
        """The burst is whole: keep it, or have it taken again."""
        assert self._labels is not None  # since the burst began
        focal = self._camera.fx / self._step
        self.warning = still_warning(np.stack(self._small), self._labels, focal, self.settings.depth)
        self._small = []
        if self.warning is not None and self.retaken < self.settings.retakes:
            self.retaken += 1
            self.state, self._well_since, self.burst = ADVISING, None, []
            return
        self.state = DONE


def write_burst(
    folder: str | os.PathLike, stream: Stream, burst: Sequence[np.ndarray], color: np.ndarray | None = None,
    mirrors: Sequence[MirrorPicks] = (),
) -> Path:  # fmt: skip
    """Write a burst as an RGB-D folder, which appears only when it is whole.

    Parameters
    ----------
    folder : path
        Must not exist, or be empty.
    stream : Stream
        That it was taken from; no frame of it is read.
    burst : sequence of np.ndarray [shape=(H, W), dtype=float32]
        [m]
    color : np.ndarray [shape=(Hc, Wc, 3), dtype=uint8] or None
    mirrors : sequence of MirrorPicks
        Written beside it, where they are known.

    Raises
    ------
    CaptureError, OutputError
        As :func:`..capture.live_camera.record`.
    """
    taken = replace(stream, frames=iter([(frame, color) for frame in burst]))
    return record(taken, folder, len(burst), settle=0, mirrors=tuple(mirrors))
