"""Where the picture ends: the subject cut off by the image's border, or by that of what the camera reads in it."""

from __future__ import annotations

import numpy as np

SIDES = ("top", "bottom", "left", "right")

_EDGE = 3  # px: the last ones of an image, or of what is read in it, often have no reading
FEWEST = 6  # px of the subject at a border that mean it is cut
_BESIDE = 40  # px to either side of it, where the border of what is read must go on
_FEW_BESIDE, _SUPPORTED = 8, 0.4  # columns of those that are read, and the share of them that lie on its line
_ON_LINE, _BEYOND = 2.5, 0.1  # px: so straight is that border; the share of columns read that may lie beyond it
_NEAR = 15  # px: of the columns beside it, those right beside it
_SLOPES = np.linspace(-1.5, 1.5, 61)  # of that border


def cut_sides(depth: np.ndarray, mine: np.ndarray) -> dict[str, int]:
    """Sides on which the picture ends at the subject, and how far inside of the image that is [px].

    A picture may end before the image does: a lens with a field of another shape, an image that was undistorted or
    warped to another camera's, rows without readings. There nothing is read beyond the subject, nor, along the same
    line, beside it. Where only the background is too far or too dark to be read, the room beside the subject ends
    elsewhere.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W)]
        0 = no reading.
    mine : np.ndarray [shape=(H, W), dtype=bool]
        Where the subject is seen directly.

    Returns
    -------
    dict of str to int
        Among :data:`SIDES`; 0 px: at the image's own border.

    Notes
    -----
    O(H W).
    """
    read = depth > 0
    found = {}
    for side in SIDES:
        margin = _margin(_side_up(read, side), _side_up(mine, side))
        if margin is not None:
            found[side] = margin
    return found


def _side_up(image: np.ndarray, side: str) -> np.ndarray:
    """The image turned until the side is its first row."""
    return {"top": image, "bottom": image[::-1], "left": image.T, "right": image.T[::-1]}[side]


def _margin(read: np.ndarray, mine: np.ndarray) -> int | None:
    """How many rows from the first one the picture ends at the subject; None where it does not."""
    if mine[:_EDGE].any(axis=0).sum() >= FEWEST:
        return 0
    columns = np.flatnonzero(mine.any(axis=0))
    if not len(columns):
        return None
    low, high = max(columns[0] - _BESIDE, 0), columns[-1] + _BESIDE + 1
    read, mine = read[:, low:high], mine[:, low:high]
    first = np.where(read.any(axis=0), np.argmax(read, axis=0), len(read))
    own = np.where(mine.any(axis=0), np.argmax(mine, axis=0), 2 * len(read))
    ends = np.flatnonzero(own - first < _EDGE)
    for run in np.split(ends, np.flatnonzero(np.diff(ends) > _EDGE) + 1):
        if len(run) < FEWEST:
            continue
        for beside in (np.arange(run[0] - _BESIDE, run[0]), np.arange(run[-1] + 1, run[-1] + 1 + _BESIDE)):
            beside = beside[(beside >= 0) & (beside < len(first))]
            beside = beside[(first[beside] < own[beside]) & (first[beside] < len(read))]
            if _end_on_one_line(first, run, beside):
                return int(first[run].min())
    return None


def _end_on_one_line(first: np.ndarray, run: np.ndarray, beside: np.ndarray) -> bool:
    """Whether what is read of the subject and beside it ends on one straight line, and nothing is read beyond that.

    Parameters
    ----------
    first : np.ndarray [shape=(W,)]
        First row that is read in each column.
    run, beside : np.ndarray [shape=(K,)]
        Columns of the subject, and of the room on one side of it.
    """
    if len(beside) < _FEW_BESIDE:
        return False
    columns = np.concatenate((run, beside))
    level = first[columns] - _SLOPES[:, None] * (columns - run[0])  # above lines of each slope
    level -= np.quantile(level, _BEYOND, axis=1)[:, None]
    on, mine = np.abs(level) < _ON_LINE, len(run)
    near = np.abs(beside - np.clip(beside, run[0], run[-1])) <= _NEAR
    if near.sum() < _FEW_BESIDE:
        return False
    right = (
        (on[:, :mine].sum(axis=1) >= FEWEST)
        & ((level[:, :mine] < -_ON_LINE).mean(axis=1) <= _BEYOND)
        & (on[:, mine:].mean(axis=1) > _SUPPORTED)
        & (on[:, mine:][:, near].mean(axis=1) > _SUPPORTED)
    )
    return bool(right.any())
