"""From a running camera to the burst: :func:`guide` looks at each frame, says what to do, and takes the burst."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass

from ..capture.live_camera import Stream
from ..errors import CaptureError
from .advice import Advice, SteadyAdvice
from .live_scene import LiveFrame, LiveScene
from .shutter import BURST, DONE, Shutter

STEADY_S = 0.4
"""Advice comes and goes within about half of that [s]."""


@dataclass(frozen=True)
class LiveUpdate:
    """What there is to show after one more frame.

    Parameters
    ----------
    number : int
        Of the frame, counted from 0.
    seconds : float
        When it was.
    frame : LiveFrame or None
        As it was looked at; None during the burst, of which frames are only kept.
    advices : tuple of Advice
        To show; empty when all is well.
    state : str
        Of the shutter.
    left_s : float
        Of the countdown [s].
    share : float
        Of the burst that is taken.
    moved_m : float
        How far the subject moved during it [m].
    retaken : int
        How many bursts were dropped because the subject moved.
    """

    number: int
    seconds: float
    frame: LiveFrame | None
    advices: tuple[Advice, ...]
    state: str
    left_s: float
    share: float
    moved_m: float
    retaken: int


def guide(
    stream: Stream, scene: LiveScene, shutter: Shutter, steady_s: float = STEADY_S,
    clock: Callable[[int], float] | None = None,
) -> Generator[LiveUpdate, None, None]:  # fmt: skip
    """Look at a camera's frames until the shutter has taken the burst.

    Parameters
    ----------
    stream : Stream
    scene : LiveScene
        Of the stream's camera.
    shutter : Shutter
        Has the burst, when this ends.
    steady_s : float
        Of :class:`.advice.SteadyAdvice` [s].
    clock : function(number) or None
        When the frame of that number was taken [s]; by default when it came.

    Yields
    ------
    LiveUpdate
        One a frame.

    Raises
    ------
    CaptureError
        The camera, or the recording, ended before the burst was taken.
    """
    steady = SteadyAdvice(steady_s)
    advices: tuple[Advice, ...] = ()
    try:
        for number, (depth, color) in enumerate(stream.frames):
            seconds = time.monotonic() if clock is None else clock(number)
            frame: LiveFrame | None = None
            if shutter.state == BURST:
                shutter.take(depth, color)
            else:
                frame = scene.look(depth, color, seconds)
                advices = steady.hear(frame.advices, seconds)
                shutter.advance(frame, advices)
            yield LiveUpdate(
                number, seconds, frame, advices, shutter.state, shutter.left_s, shutter.share, shutter.moved_m,
                shutter.retaken,
            )  # fmt: skip
            if shutter.state == DONE:
                return
    finally:
        scene.close()
    last = next((one.text for one in advices if one.severity == "warning"), "")
    raise CaptureError(
        "the camera or recording ended before all was well and the burst was taken; {last}",
        last=f"the last advice was: {last}" if last else "stay longer in front of the mirrors", code="camera",
    )  # fmt: skip
