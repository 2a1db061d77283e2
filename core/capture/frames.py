"""Which frames of a recording are read, and how many memory should hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import CaptureError

MAX_BURST_PIXELS = 256_000_000  # 1 GB as float32; about 800 frames of 640 x 480
FrameChoice = int | str | None


def chosen_frames(path: Path, frames: FrameChoice, total: int) -> range:
    """Numbers of the frames to read of ``total``.

    Raises
    ------
    CaptureError
        When the choice is not understood or none of the frames is chosen.
    """
    if total < 1:
        raise CaptureError(f"{path}: holds no depth frame; check that the depth stream was on and record again")
    chosen = range(total)[parse_frames(path, frames)]
    if not len(chosen):
        raise CaptureError(f"{path}: has frames 0 to {total - 1}, of which “{frames}” chooses none")
    return chosen


def empty_burst(path: Path, count: int, height: int, width: int) -> np.ndarray:
    """Zeros (F, H, W) float32 for as many frames as memory should hold.

    Raises
    ------
    CaptureError
        When they are more.
    """
    if count * height * width > MAX_BURST_PIXELS:
        raise CaptureError(
            f"{path}: {count} frames of {width}×{height} are more than memory should hold; "
            f"choose {max(1, MAX_BURST_PIXELS // max(1, width * height))} or fewer"
        )
    return np.zeros((count, height, width), np.float32)


def parse_frames(path: Path, frames: FrameChoice) -> slice:
    """The choice of frames as a slice; ``path`` is named in errors."""
    if frames is None:
        return slice(None)
    if isinstance(frames, int | np.integer) and not isinstance(frames, bool):
        if frames < 1:
            raise CaptureError(f"{path}: at least one frame must be read, not {frames}")
        return slice(int(frames))
    try:
        parts = [int(part) if part.strip() else None for part in str(frames)[:80].split(":")]
    except ValueError:
        parts = []
    if len(parts) == 1 and parts[0] is not None and parts[0] >= 0:
        return slice(parts[0], parts[0] + 1)
    if len(parts) in (2, 3) and not (len(parts) == 3 and parts[2] is not None and parts[2] < 1):
        return slice(*parts)
    raise CaptureError(f"{path}: frames are chosen by a count or as “a:b”, “a:b:step” or “a”, not {str(frames)[:40]!r}")
