"""A burst: whether the subject stood still while it was recorded, and how much its frames lowered the noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..numeric.kernels import njit, prange
from .settings import DepthSettings


def still_warning(depth: np.ndarray, labels: np.ndarray, focal: float, settings: DepthSettings) -> str | None:
    """A warning when the subject moved while the burst was recorded; None when it stood still.

    Parameters
    ----------
    depth : np.ndarray [shape=(F, H, W), dtype=float32]
        z [m], 0 = no reading.
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel, -1 = not the subject.
    focal : float
        fx [px].
    settings : DepthSettings
        ``still_share`` is used.
    """
    if settings.still_share >= 1 or len(depth) < 2:
        return None
    motion = burst_motion(depth, labels, 1.0 / focal, settings.still_share)
    if motion.share <= settings.still_share:
        return None
    return (
        f"the subject moved during the burst: between its first and last frames {motion.share:.0%} of what is seen of "
        f"it moved by {1e3 * motion.median:.0f} mm (up to {1e3 * motion.largest:.0f} mm); hold still while recording, "
        "record fewer frames, or use a single frame"
    )


_CELL_PIXELS = 4  # px: the smallest square whose noise is looked at
_BLOCKS = (2, 4)  # cells: the side of a block that moves as one; the larger one where noise is high
_LEAST_MOVE = 0.006  # m: less does no noticeable harm later
_NOT_CHANCE = 3.5  # standard deviations that noise alone does not reach
_JUMP = 0.04  # of 1/z: more is another surface


@dataclass(frozen=True)
class Motion:
    """What moved from the first frame of a burst to its last.

    ``share`` of the subject's blocks of 8 or 16 px that are elsewhere, beyond what differs by chance [0..1];
    ``median`` and ``largest`` (95th percentile) of how far they went [m], taken as steady.
    """

    share: float
    median: float
    largest: float


def burst_motion(depth: np.ndarray, labels: np.ndarray, pixel_angle: float, least: float = 0.0) -> Motion:
    """Whether the subject stood still: the burst's first third against its last.

    Surfaces are compared by their depth, silhouettes by the area they swept over. A block counts when it went further
    than its noise explains, which is measured in space (how differently cells of 4 × 4 px go that touch each other)
    and so needs no frames to spare; from six frames on what two groups mixed in time differ by is taken off as well.
    Motion along a surface that stays where it is (a turning cylinder) cannot be seen.

    Parameters
    ----------
    depth : np.ndarray [shape=(F, H, W), dtype=float32]
        z [m], 0 = no reading.
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel, -1 = not the subject.
    pixel_angle : float
        1/f [1/px].
    least : float
        Share of the subject that must seem to have moved for chance to be asked.

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
    steady = (frames - 1) / (frames - size)  # from the distance of the groups' mean times to the whole burst's
    moved = steady * _compare(depth, labels, order[:size], order[frames - size :], pixel_angle)
    share = float((moved > _LEAST_MOVE).mean()) if len(moved) else 0.0
    if frames >= 6 and share > least:
        # pairs from both ends inwards: one frame of a pair to each group, in turn, so that their mean times agree
        ends = [(k, frames - 1 - k) for k in range(frames // 2)]
        a, b = (np.array([f for pair in ends[k::2] for f in pair][:size]) for k in (0, 1))
        chance = steady * _compare(depth, labels, a, b[: len(a)], pixel_angle)
        share -= float((chance > _LEAST_MOVE).mean()) if len(chance) else 0.0
    if share <= 0:
        return Motion(0.0, 0.0, 0.0)
    went = moved[moved > _LEAST_MOVE]
    return Motion(share, float(np.median(went)), float(np.percentile(went, 95)))


def _compare(depth: np.ndarray, labels: np.ndarray, a: np.ndarray, b: np.ndarray, pixel_angle: float) -> np.ndarray:
    """How far each block of the subject moved between two groups of frames [m]; 0 where noise explains it."""
    cells = _cell_kernel(depth, labels, a, b)
    views = cells[0]
    moved = []
    for k in np.unique(views[views >= 0]):
        inside = views == k
        box = tuple(_extent(inside.any(axis=axis)) for axis in (1, 0))
        moved.append(_view_motion(np.where(inside[box], cells[1:, *box], 0.0), pixel_angle))
    return np.concatenate(moved) if moved else np.zeros(0)


def _extent(inside: np.ndarray) -> slice:
    """Where ``inside`` (N,) bool holds, widened to whole blocks, whichever size they will have."""
    first, last = np.flatnonzero(inside)[[0, -1]]
    step = math.lcm(*_BLOCKS)
    return slice(first // step * step, (last // step + 1) * step)


def _view_motion(cells: np.ndarray, pixel_angle: float) -> np.ndarray:
    """:func:`_compare` of one view, from the sums over its cells; those of other views are 0."""
    subject, near, surface, shift, flips, net = cells
    z = float(subject.sum() / near.sum())
    whole = surface >= _CELL_PIXELS * _CELL_PIXELS / 2
    mean = np.divide(shift, surface, out=np.zeros_like(shift), where=whole)
    # cells side by side go together, whatever the motion; what they differ by is noise
    beside = np.concatenate(
        [
            np.abs(mean[1:] - mean[:-1])[whole[1:] & whole[:-1]],
            np.abs(mean[:, 1:] - mean[:, :-1])[whole[:, 1:] & whole[:, :-1]],
        ]
    )
    noise = float(np.median(beside)) / (0.6745 * np.sqrt(2)) if len(beside) else 0.0
    small, large = _BLOCKS
    side = small if _NOT_CHANCE * noise * z * z <= _LEAST_MOVE * small else large
    height, width = (n // side * side for n in subject.shape)

    def blocks(values: np.ndarray) -> np.ndarray:
        return values[:height, :width].reshape(height // side, side, width // side, side).sum(axis=(1, 3))

    mine = blocks(subject) >= (side * _CELL_PIXELS) ** 2 / 4
    count = blocks(whole.astype(float))
    toward = np.divide(np.abs(blocks(mean)), count, out=np.zeros_like(count), where=count > 0)
    toward[toward * np.sqrt(count) < _NOT_CHANCE * noise] = 0
    # Pixels that noise flips between near and far cancel within a cell; those that a silhouette sweeps over agree.
    swept = blocks(np.abs(net) - 0.8 * np.sqrt(flips))  # E|net| of n fair coins is 0.8 sqrt(n)
    swept[swept < _NOT_CHANCE * 0.6 * np.sqrt(blocks(flips))] = 0
    return np.maximum(toward * z * z, swept / (side * _CELL_PIXELS) * z * pixel_angle)[mine]


@njit(cache=True, nogil=True, parallel=True, error_model="numpy")
def _cell_kernel(depth, labels, a, b):
    """Sums over cells (7, H / 4, W / 4): view, subject pixels, Σ 1/z, surface pixels, Σ shift of 1/z, flips, net flips.

    A pixel flips when it is the subject's in one group of frames and another surface or nothing in the other; +1 to
    nearer, -1 to farther. A cell counts the pixels of the first view found in it.
    """
    height, width = labels.shape
    rows, columns = height // _CELL_PIXELS, width // _CELL_PIXELS
    out = np.zeros((7, rows, columns))
    for r in prange(rows):
        for c in range(columns):
            view = -1
            subject = surface = flips = net = 0
            near = shift = 0.0
            for v in range(r * _CELL_PIXELS, (r + 1) * _CELL_PIXELS):
                for u in range(c * _CELL_PIXELS, (c + 1) * _CELL_PIXELS):
                    if labels[v, u] < 0 or (view >= 0 and labels[v, u] != view):
                        continue
                    inverse_a, count_a = _mean(depth, a, v, u)
                    inverse_b, count_b = _mean(depth, b, v, u)
                    # most frames of a group must say the same
                    read_a, read_b = 2 * count_a > len(a), 2 * count_b > len(b)
                    if not (read_a or read_b):
                        continue
                    view = labels[v, u]
                    subject += 1
                    near += max(inverse_a if read_a else 0.0, inverse_b if read_b else 0.0)
                    if read_a and read_b and abs(inverse_a - inverse_b) <= _JUMP * inverse_a:
                        surface += 1
                        shift += inverse_b - inverse_a
                    else:
                        flips += 1
                        net += 1 if read_b and (not read_a or inverse_b > inverse_a) else -1
            out[0, r, c] = view
            out[1, r, c], out[2, r, c], out[3, r, c] = subject, near, surface
            out[4, r, c], out[5, r, c], out[6, r, c] = shift, flips, net
    return out


@njit(cache=True, nogil=True)
def _mean(depth, frames, v, u):
    """Mean of 1/z of the readings that a group of frames has at a pixel, and their number."""
    total = 0.0
    count = 0
    for f in frames:
        z = depth[f, v, u]
        if z > 0:
            total += 1.0 / z
            count += 1
    return (total / count if count else 0.0), count
