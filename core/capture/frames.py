"""Which frames of a recording are read, how many memory should hold, and which colour image goes with them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..errors import CaptureError, Notice

MAX_BURST_PIXELS = 256_000_000  # 1 GB as float32; about 800 frames of 640 x 480
MAX_APART_S = 0.1  # between a depth and a colour image of one recording, before it is said
_KINDS = re.compile(r"depth|colou?r|rgb|image|img|frame", re.IGNORECASE)
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
FrameChoice = int | str | None
BEYOND = 1 << 60
"""No recording has so many frames."""


class NoSuchFrames(CaptureError):
    """None of the frames is chosen; ``total`` is how many there are."""

    total = 0


def chosen_frames(path: Path, frames: FrameChoice, total: int) -> range:
    """Numbers of the frames to read of ``total``.

    Raises
    ------
    CaptureError
        When the choice is not understood or none of the frames is chosen.
    """
    if total < 1:
        raise CaptureError(
            f"{path}: holds no depth frame; check that the depth stream was on and record again", code="empty"
        )
    chosen = range(total)[parse_frames(path, frames)]
    if not len(chosen):
        error = NoSuchFrames(f"{path}: has frames 0 to {total - 1}, of which “{frames}” chooses none", code="frames")
        error.total = total
        raise error
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
            f"choose {max(1, MAX_BURST_PIXELS // max(1, width * height))} or fewer",
            code="memory",
        )
    return np.zeros((count, height, width), np.float32)


def parse_frames(path: Path, frames: FrameChoice) -> slice:
    """The choice of frames as a slice; ``path`` is named in errors."""
    if frames is None:
        return slice(None)
    if isinstance(frames, int | np.integer) and not isinstance(frames, bool):
        if frames < 1:
            raise CaptureError(f"{path}: at least one frame must be read, not {frames}", code="frames")
        return slice(int(frames))
    try:
        parts = [int(part) if part.strip() else None for part in str(frames)[:80].split(":")]
    except ValueError:
        parts = []
    if len(parts) == 1 and parts[0] is not None and parts[0] >= 0:
        return slice(parts[0], parts[0] + 1)
    if len(parts) in (2, 3) and not (len(parts) == 3 and parts[2] is not None and parts[2] < 1):
        return slice(*parts)
    raise CaptureError(
        f"{path}: frames are chosen by a count or as “a:b”, “a:b:step” or “a”, not {str(frames)[:40]!r}", code="frames"
    )


def paired_color(depth_files: Sequence[Path], chosen: int, color_files: Sequence[Path]) -> tuple[int, str]:
    """The colour image of a depth image, and a note where another frame's stands in for it.

    One colour image is for all. Else the number in the names decides, whatever the number of zeros before it, or the
    time: a whole number or one with decimals that both kinds of names have at one place. Names without numbers are
    paired by their order.

    Parameters
    ----------
    depth_files, color_files : sequence of Path
        Each in the order of recording.
    chosen : int
        Which of the depth images.

    Returns
    -------
    index : int
        In ``color_files``.
    note : str
        Empty where it is the same frame's.
    """
    if len(color_files) == 1:
        return 0, ""
    wanted = depth_files[chosen]
    bare = [_KINDS.sub("", file.stem).strip("-_. ").lower() for file in color_files]
    own = _KINDS.sub("", wanted.stem).strip("-_. ").lower()
    if own and bare.count(own) == 1:
        return bare.index(own), ""
    numbers = _columns(depth_files, color_files)
    if numbers is None:
        if len(color_files) == len(depth_files):
            return chosen, ""
        return 0, Notice(
            "{depth} has no colour image of its own; {color} is taken (no numbers in their names tell them apart)",
            depth=wanted.name,
            color=color_files[0].name,
        )
    depth_numbers, color_numbers = numbers
    mine = depth_numbers[chosen]
    distance = np.abs(color_numbers - mine)
    nearest = int(distance.argmin())
    if distance[nearest] == 0:
        return nearest, ""
    steps = np.diff(np.unique(np.concatenate((depth_numbers, color_numbers))))
    spacing = [float(np.median(np.diff(np.unique(n)))) for n in (depth_numbers, color_numbers) if len(np.unique(n)) > 1]
    times = not np.isin(depth_numbers, color_numbers).any() and bool(steps.size)
    if times and spacing and distance[nearest] <= 0.51 * min(spacing):
        return nearest, ""  # two clocks that run side by side
    return nearest, Notice(
        "{depth} has no colour image of its own; {color}, the nearest, is taken",
        depth=wanted.name,
        color=color_files[nearest].name,
    )


def apart_note(seconds: float) -> list[str]:
    """A note where the colour image nearest in time is of another moment than the depth image."""
    if not abs(seconds) > MAX_APART_S:
        return []
    return [Notice("the nearest colour image is {seconds:.1f} s from the first depth frame", seconds=abs(seconds))]


def _columns(depth_files: Sequence[Path], color_files: Sequence[Path]) -> tuple[np.ndarray, np.ndarray] | None:
    """One number for each name, of the same meaning on both sides; None where the names have none.

    The first number that changes tells images apart. Where it does not tell all of them apart, as the seconds of a
    time with milliseconds behind, those behind it count, too.
    """
    tables = []
    for files in (depth_files, color_files):
        rows = [[float(n) for n in _NUMBER.findall(file.stem)] for file in files]
        if not rows[0] or len({len(row) for row in rows}) != 1:
            return None
        tables.append(np.array(rows))
    firsts = [next((k for k, c in enumerate(t.T) if (c != c[0]).any()), t.shape[1] - 1) for t in tables]
    if tables[0].shape[1] == tables[1].shape[1]:
        firsts = [min(firsts)] * 2
        both = np.concatenate(tables)
        if any(len(np.unique(t[:, firsts[0]])) < len(np.unique(t, axis=0)) for t in tables):
            spans = np.ptp(both, axis=0) + 1
            weights = np.append(np.cumprod(spans[:0:-1])[::-1], 1.0)
            weights[: firsts[0]] = 0
            return tables[0] @ weights, tables[1] @ weights
    return tables[0][:, firsts[0]], tables[1][:, firsts[1]]
