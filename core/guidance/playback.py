"""A recording played as if it were a camera: a :class:`..capture.live_camera.Stream` of its frames.

``CAMERAS`` has it beside the drivers of real cameras: a driver is one function ``open_…(size, rate, serial)``, and the
serial number of this one is the path of the recording.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator

import numpy as np

from ..capture import MirrorPicks
from ..capture.live_camera import DRIVERS, Stream
from ..errors import CaptureError
from ..sequences import Recording, open_recording

RATE = 30.0
"""Frames a second of a recording, unless told otherwise: what depth cameras have."""


@contextlib.contextmanager
def open_playback(
    size: tuple[int, int] | None = None, rate: float = RATE, serial: str | os.PathLike | None = None, paced: bool = True
) -> Iterator[Stream]:
    """A recording of any format that is read, as a running camera.

    Parameters
    ----------
    size : tuple of int, optional
        As other drivers have it; the recording's own is what counts.
    rate : float
        Frames a second.
    serial : path
        Of the recording.
    paced : bool
        As a camera has it: who is late misses frames. Else every frame comes as soon as it is asked for.

    Raises
    ------
    CaptureError
        There is no such recording.
    """
    if not serial:
        raise CaptureError("no recording is given to play; name one, in any format of docs/formats.md", code="camera")
    if not rate > 0:
        raise CaptureError(f"a recording cannot be played at {rate:g} frames a second; give more than 0")
    yield played(open_recording(serial), rate, paced)


def played(recording: Recording, rate: float = RATE, paced: bool = True) -> Stream:
    """The stream of a recording; its frames are read as they are played.

    Raises
    ------
    CaptureError
        Its first frame cannot be read.
    """
    first = recording.read(recording.numbers[0])
    return Stream(first.intrinsics, first.sensor, _frames(recording, rate, paced))


def mirrors_of(path: str | os.PathLike) -> tuple[MirrorPicks, ...]:
    """Where a recording says its mirrors are; empty where it does not say.

    Raises
    ------
    CaptureError
        There is no such recording.
    """
    recording = open_recording(path)
    return recording.read(recording.numbers[0]).mirrors


def _frames(recording: Recording, rate: float, paced: bool) -> Iterator[tuple[np.ndarray, np.ndarray | None]]:
    began, place = time.monotonic(), 0
    while place < len(recording):
        capture = recording.read(recording.numbers[place])
        if paced:
            late = time.monotonic() - began - place / rate
            time.sleep(max(-late, 0.0))
        yield capture.depth[0], capture.color
        place += 1
        if paced:  # what came meanwhile is missed, as with a camera
            place = max(place, int((time.monotonic() - began) * rate))


CAMERAS: dict[str, Callable[..., contextlib.AbstractContextManager[Stream]]] = {**DRIVERS, "playback": open_playback}
"""All that can be looked at live, by the name the command line knows it by."""
