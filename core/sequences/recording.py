"""A recording read frame by frame, whatever its format; only one frame is in memory, and where the others are."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

from ..capture import Capture, FileIndices, ReadOptions, chosen_frames, frame_count, open_capture
from ..capture.frames import FrameChoice
from ..errors import CaptureError


@dataclass(frozen=True)
class Recording:
    """Some frames of a recording.

    Parameters
    ----------
    path : Path
        Any of the formats of ``docs/formats.md``.
    numbers : tuple of int
        Of the depth frames, counted from 0 in the file, in the order of time.
    options : ReadOptions
        What the file cannot say.
    indices : FileIndices
        Where in the file the frames are, found by the first that is read.
    """

    path: Path
    numbers: tuple[int, ...]
    options: ReadOptions = ReadOptions()
    indices: FileIndices = field(default_factory=FileIndices, repr=False, compare=False)

    def __len__(self) -> int:
        return len(self.numbers)

    def read(self, number: int) -> Capture:
        """One frame, with the colour image nearest to it in time, as :func:`..capture.open_capture` gives it.

        Raises
        ------
        CaptureError, MirrorError
        """
        with self.indices.kept():
            return open_capture(self.path, str(number), self.options)

    def sample(self, count: int) -> tuple[int, ...]:
        """At most ``count`` of the numbers, evenly over the recording."""
        count = min(count, len(self.numbers))
        return tuple(self.numbers[(2 * k + 1) * len(self.numbers) // (2 * count)] for k in range(count))


def open_recording(
    path: str | os.PathLike, frames: FrameChoice = None, every: int = 1, options: ReadOptions | None = None
) -> Recording:
    """The recording at ``path``: its frames are counted, none is read.

    Parameters
    ----------
    path : path
    frames : int, str or None
        As :func:`..capture.open_capture` has it.
    every : int
        Of those frames every so many-th is taken.
    options : ReadOptions, optional

    Raises
    ------
    CaptureError, MirrorError
        There is no recording, no frame is chosen, or ``every`` is below 1.
    """
    if every < 1:
        raise CaptureError(f"every {every}th frame cannot be taken; give 1 or more")
    options = options or ReadOptions()
    path = Path(path)
    indices = FileIndices()
    with indices.kept():
        total = frame_count(path, options)
    return Recording(path, tuple(chosen_frames(path, frames, total)[::every]), options, indices)
