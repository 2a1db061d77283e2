"""Whether the subject stood still while a burst was recorded, and how far it went if not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange

_BLOCK = 4  # px: readings that are averaged before frames are compared
_LEAST_MOVE = 0.006  # m: less does no harm that the rest of the job would notice


@dataclass(frozen=True)
class Motion:
    """What moved between the first and the last third of a burst.

    ``share`` of the subject's blocks of 4 × 4 px that are elsewhere, beyond what differs by chance [0..1]; ``median``
    and ``largest`` (95th percentile) of how far they went [m].
    """

    share: float
    median: float
    largest: float


def burst_motion(depth: np.ndarray, labels: np.ndarray, pixel_angle: float) -> Motion:
    """Whether the subject stood still: the burst's first third against its last.

    Surfaces are compared by their depth, silhouettes by the area they swept over. Noise is allowed for by comparing
    also two groups of frames that are as large but mixed in time. Motion along a surface that stays where it is (a
    turning cylinder) cannot be seen.

    Parameters
    ----------
    depth : np.ndarray [shape=(F, H, W), dtype=float32]
        z [m], 0 = no reading.
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel, -1 = not the subject.
    pixel_angle : float
        1/f [1/px].

    Returns
    -------
    Motion
        All 0 for a single frame.

    Notes
    -----
    O(subject pixels · F).
    """
    frames = len(depth)
    if frames < 2 or not (labels >= 0).any():
        return Motion(0.0, 0.0, 0.0)
    size = max(1, frames // 3)
    order = np.arange(frames)
    first, last = order[:size], order[frames - size :]
    # pairs from both ends inwards: one frame of a pair to each group, in turn, so that their mean times agree
    ends = [(k, frames - 1 - k) for k in range(frames // 2)]
    mixed_a = np.array([f for pair in ends[0::2] for f in pair][:size])
    mixed_b = np.array([f for pair in ends[1::2] for f in pair][:size])
    moved = _compare(depth, labels, first, last, pixel_angle)
    if len(mixed_a) < size or len(mixed_b) < size:  # a burst of two to five frames has no frames to spare
        mixed_a, mixed_b = order[:0], order[:0]
    chance = _compare(depth, labels, mixed_a, mixed_b, pixel_angle) if len(mixed_a) else None
    floor = _LEAST_MOVE if chance is None else max(_LEAST_MOVE, 1.5 * float(np.percentile(chance, 95)))
    far = moved > floor
    by_chance = 0.0 if chance is None else float((chance > floor).mean())
    share = max(float(far.mean()) - by_chance, 0.0)
    if not far.any() or share == 0:
        return Motion(0.0, 0.0, 0.0)
    return Motion(share, float(np.median(moved[far])), float(np.percentile(moved[far], 95)))


def _compare(depth: np.ndarray, labels: np.ndarray, a: np.ndarray, b: np.ndarray, pixel_angle: float) -> np.ndarray:
    """How far each block of the subject went between two groups of frames [m]."""
    moved = _motion_kernel(depth, labels, a, b, pixel_angle)
    moved = moved[moved >= 0]
    return moved if len(moved) else np.zeros(1)


@njit(cache=True, nogil=True, parallel=True)
def _motion_kernel(depth, labels, a, b, pixel_angle):
    """Distance [m] a block, -1 where there is no subject."""
    height, width = labels.shape
    rows, columns = height // _BLOCK, width // _BLOCK
    out = np.full((rows, columns), -1.0)
    for r in prange(rows):
        for c in range(r % 2, columns, 2):  # every other block tells enough
            subject = flips = surface = 0
            shift = 0.0
            near = np.inf
            for v in range(r * _BLOCK, (r + 1) * _BLOCK):
                for u in range(c * _BLOCK, (c + 1) * _BLOCK):
                    if labels[v, u] < 0:
                        continue
                    subject += 1
                    mean_a, count_a = _mean(depth, a, v, u)
                    mean_b, count_b = _mean(depth, b, v, u)
                    # most frames of a group must say the same
                    if 2 * count_a <= len(a) and 2 * count_b <= len(b):
                        continue
                    if 2 * count_a <= len(a) or 2 * count_b <= len(b) or abs(mean_a - mean_b) > 0.04 * mean_a:
                        flips += 1
                        near = min(near, mean_a if mean_a > 0 else np.inf, mean_b if mean_b > 0 else np.inf)
                    else:
                        surface += 1
                        shift += 1.0 / mean_b - 1.0 / mean_a
                        near = min(near, mean_a)
            if subject < _BLOCK * _BLOCK // 2 or surface + flips == 0:
                continue
            toward = abs(shift) / surface * near * near if surface else 0.0
            sideways = flips / _BLOCK * near * pixel_angle
            out[r, c] = max(toward, sideways)
    return out


@njit(cache=True, nogil=True)
def _mean(depth, frames, v, u):
    """Harmonic mean of the readings that a group of frames has at a pixel, and their number."""
    total = 0.0
    count = 0
    for f in frames:
        z = depth[f, v, u]
        if z > 0:
            total += 1.0 / z
            count += 1
    return (count / total if count else 0.0), count
