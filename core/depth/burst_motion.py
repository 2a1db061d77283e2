"""A burst: whether the subject stood still while it was recorded, and how much its frames lowered the noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..numeric.kernels import njit
from ..numeric.threads import each_range
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
_CERTAIN_MOVE = 0.025  # m: an outline goes no farther by noise
_MUCH = 0.3  # of the subject's blocks: more do not move by chance
_TOGETHER, _FEWEST_PAIRS = 0.8, 20  # of at least so many pairs of blocks side by side, when it is no chance
_AS_FAR = 0.9  # of the largest change: frames that differ hardly less are as far apart
_WHOLE, _ALIKE_MOVES = 0.15, 0.5  # share of the subject's lines that move, and by how much half of them may differ
_MISMATCHED = 3.0  # of the usual motion: a line that tells of more took one thing for another
_BOTH = 0.4  # rows and columns tell of a slanting motion when neither tell of so much less
_THINNED = 5  # rows and columns between those that frames are compared by
_FEWEST_LINES, _LINES = 12, 0.06  # rows or columns, and the share of the subject's, that must tell of a motion


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

    Surfaces are compared by their depth, silhouettes by the area they swept over; where whole outlines went, by how far
    their middles went between the two frames that differ most. A block counts when it went further
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
    moved, together = _compare(depth, labels, order[:size], order[frames - size :], pixel_angle)
    share = float((moved > _LEAST_MOVE).mean()) if len(moved) else 0.0
    first, last = _farthest_apart(depth, labels)
    far = _outline_motion(depth, labels, first, last, pixel_angle)
    if far is not None and far[0] > _CERTAIN_MOVE and far[2] > _WHOLE:  # no noise moves a whole outline so far
        return Motion(max(share, far[2]), far[0], max(far[0], far[1]))
    if frames >= 6 and least < share < _MUCH and together < _TOGETHER:
        # pairs from both ends inwards: one frame of a pair to each group, in turn, so that their mean times agree
        ends = [(k, frames - 1 - k) for k in range(frames // 2)]
        a, b = (np.array([f for pair in ends[k::2] for f in pair][:size]) for k in (0, 1))
        chance, _ = _compare(depth, labels, a, b[: len(a)], pixel_angle)
        share -= float((chance > _LEAST_MOVE).mean()) if len(chance) else 0.0
    if share <= 0:
        return Motion(0.0, 0.0, 0.0)
    if far is not None and far[0] > _LEAST_MOVE and far[3]:
        return Motion(share, far[0], max(far[0], far[1]))
    went = moved[moved > _LEAST_MOVE]
    steady = (frames - 1) / (frames - size)  # from the distance of the groups' mean times to the whole burst's
    return Motion(share, steady * float(np.median(went)), steady * float(np.percentile(went, 95)))


def _farthest_apart(depth: np.ndarray, labels: np.ndarray) -> tuple[int, int]:
    """The two frames between which most has changed; the first and last of a steady motion."""
    some = depth[(slice(None), *(slice(low, high, _THINNED) for low, high in _about(labels)))]
    inverse = np.divide(1.0, some, out=np.zeros_like(some), where=some > 0)
    if not inverse.any():
        return 0, len(depth) - 1
    most = _JUMP * np.median(inverse[inverse > 0])

    def far_ones(frame: int) -> np.ndarray:
        """Frames that differ most from a frame; where all that moved is elsewhere they hardly differ in that."""
        change = np.minimum(np.abs(inverse - inverse[frame]), most).sum(axis=(1, 2))
        return np.flatnonzero(change >= _AS_FAR * change.max())

    last = int(far_ones(0)[-1])
    others = far_ones(last)
    first = int(others[0] if others[0] < last else others[-1])
    return min(first, last), max(first, last)


def _about(labels: np.ndarray) -> list[tuple[int, int]]:
    """First and last row and column to look at (2, 2): the subject's, and twice as much to every side."""
    out = []
    for axis in (1, 0):
        at = np.flatnonzero((labels >= 0).any(axis=axis))
        more = 2 * (at[-1] - at[0] + 1)
        out.append((max(int(at[0] - more), 0), min(int(at[-1] + more + 1), labels.shape[1 - axis])))
    return out


def _outline_motion(
    depth: np.ndarray, labels: np.ndarray, first: int, last: int, pixel_angle: float
) -> tuple[float, float, float, bool] | None:
    """How far what stands before something else went from one frame to another, by its outline.

    In each row, and in each column, the stretches of one surface that the two frames have are matched: how far their
    middles went aside, and how much farther or nearer they are. None where too few lines tell of it, or do not agree.

    Returns
    -------
    median, largest : float
        [m]
    share : float
        Of the subject's rows, or columns, that tell of it.
    sideways : bool
        It went aside rather than nearer or farther, which a surface's depth tells better.
    """
    subject = labels == 0 if (labels == 0).any() else labels >= 0
    told = []
    for turned in (False, True):
        one, other, mine = (
            np.ascontiguousarray(image.T if turned else image) for image in (depth[first], depth[last], subject)
        )
        moves = _stretch_kernel(one, other, mine, pixel_angle)
        extent = np.count_nonzero(mine.any(axis=1))
        number = len(np.unique(moves[:, 0]))
        if number >= max(_FEWEST_LINES, _LINES * extent):
            told.append((min(number / extent, 1.0), moves))
    if not told:
        return None
    share, moves = max(told, key=lambda one: one[0])
    middle = np.median(moves[:, 1:], axis=0)
    if np.median(np.hypot(*(moves[:, 1:] - middle).T)) > _ALIKE_MOVES * np.hypot(*middle):
        return None  # it went in all directions
    aside = [float(np.median(some[:, 1])) for part, some in told if part >= _BOTH * share]
    ahead = float(middle[1])
    went = np.hypot(moves[:, 1], moves[:, 2])
    largest = float(np.percentile(went[went <= _MISMATCHED * np.median(went)], 95))
    across = float(np.hypot(aside[0], aside[-1] if len(aside) > 1 else 0.0))
    return float(np.hypot(across, ahead)), largest, share, across > abs(ahead)


def _compare(
    depth: np.ndarray, labels: np.ndarray, a: np.ndarray, b: np.ndarray, pixel_angle: float
) -> tuple[np.ndarray, float]:
    """How far each block of the subject moved between two groups of frames [m]; 0 where noise explains it.

    And which share of the moved blocks side by side went the same way: half by chance.
    """
    rows, columns = (size // _CELL_PIXELS for size in labels.shape)
    cells = np.zeros((7, rows, columns))
    each_range(_cell_kernel, rows, depth, labels, a, b, cells)
    views = cells[0]
    moved, alike = [], []
    for k in np.unique(views[views >= 0]):
        inside = views == k
        box = tuple(_extent(inside.any(axis=axis)) for axis in (1, 0))
        signed, mine = _view_motion(np.where(inside[box], cells[1:, *box], 0.0), pixel_angle)
        moved.append(np.abs(signed[mine]))
        way = np.where(mine & (np.abs(signed) > _LEAST_MOVE), np.sign(signed), 0.0)
        beside = np.concatenate(((way[1:] * way[:-1]).ravel(), (way[:, 1:] * way[:, :-1]).ravel()))
        alike.append(beside[beside != 0])
    if not moved:
        return np.zeros(0), 0.0
    pairs = np.concatenate(alike)
    return np.concatenate(moved), float((pairs > 0).mean()) if len(pairs) >= _FEWEST_PAIRS else 0.0


def _extent(inside: np.ndarray) -> slice:
    """Where ``inside`` (N,) bool holds, widened to whole blocks, whichever size they will have."""
    first, last = np.flatnonzero(inside)[[0, -1]]
    step = math.lcm(*_BLOCKS)
    return slice(first // step * step, (last // step + 1) * step)


def _view_motion(cells: np.ndarray, pixel_angle: float) -> tuple[np.ndarray, np.ndarray]:
    """How far the blocks (A, B) of one view moved [m], nearer or larger is positive, and which are the subject's.

    From the sums over its cells; those of other views are 0.
    """
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
    toward = np.divide(blocks(mean), count, out=np.zeros_like(count), where=count > 0)
    # a stereo camera's noise is alike over its matching window, so that a block's mean is no more accurate than a pixel
    alike = _roughness(toward, mine & (count >= 0.5 * side * side))
    toward[np.abs(toward) < _NOT_CHANCE * np.maximum(noise / np.sqrt(np.maximum(count, 1.0)), alike)] = 0
    # Pixels that noise flips between near and far cancel within a cell; those that a silhouette sweeps over agree.
    swept = blocks(np.abs(net) - 0.8 * np.sqrt(flips))  # E|net| of n fair coins is 0.8 sqrt(n)
    swept[swept < _NOT_CHANCE * 0.6 * np.sqrt(blocks(flips))] = 0
    far = np.divide(blocks(subject), blocks(near), out=np.zeros_like(count), where=mine)
    ahead, aside = toward * far * far, swept / (side * _CELL_PIXELS) * far * pixel_angle
    return np.where(np.abs(ahead) >= aside, ahead, np.copysign(aside, blocks(net))), mine


def _roughness(values: np.ndarray, known: np.ndarray) -> float:
    """Standard deviation of noise in ``values`` (A, B), where ``known``: how far each is off the middle of two others.

    What changes evenly, as the shift of something that turns, is no noise.
    """
    off = [
        (one[1:-1] - 0.5 * (one[:-2] + one[2:]))[sure[1:-1] & sure[:-2] & sure[2:]]
        for one, sure in ((values, known), (values.T, known.T))
    ]
    every = np.abs(np.concatenate(off))
    return float(np.median(every)) / (0.6745 * np.sqrt(1.5)) if len(every) >= _FEWEST_LINES else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _cell_kernel(begin, end, depth, labels, a, b, out):
    """Sums over some rows of cells, into ``out`` (7, H / 4, W / 4).

    View, subject pixels, Σ 1/z, surface pixels, Σ shift of 1/z, flips, net flips.
    A pixel flips when it is the subject's in one group of frames and another surface or nothing in the other; +1 to
    nearer, -1 to farther. A cell counts the pixels of the first view found in it.
    """
    for r in range(begin, end):
        for c in range(out.shape[2]):
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


_GAP = 2  # px without a reading inside a stretch
_SHORTEST, _CHANGED = 6, 2  # px: of a stretch, and of it that another surface or nothing was before or is later
_ALIKE = 0.6  # two stretches are of one thing when the shorter is so long, of the longer one
_STEP = 0.02  # of z: from one pixel of a stretch to the next


@njit(cache=True, nogil=True, error_model="numpy")
def _stretches(row, found):
    """Stretches of one surface in a row: first and last pixel and mean z, written to ``found``; how many."""
    count = 0
    start, last, total, number = -1, -1, 0.0, 0
    for u in range(len(row) + 1):
        z = row[u] if u < len(row) else 0.0
        if z > 0 and start >= 0 and u - last <= _GAP + 1 and abs(z - row[last]) <= _STEP * row[last] * (u - last):
            last, total, number = u, total + z, number + 1
            continue
        if z <= 0 and u < len(row) and (start < 0 or u - last <= _GAP):
            continue
        if start >= 0 and last - start + 1 >= _SHORTEST and count < len(found):
            found[count, 0], found[count, 1], found[count, 2] = start, last, total / number
            count += 1
        if z > 0:
            start, last, total, number = u, u, z, 1
        else:
            start = -1
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def _gone(row, other, first, last):
    """Pixels of a stretch where the other frame reads something clearly farther, or nothing."""
    count = 0
    for u in range(first, last + 1):
        if row[u] > 0 and (other[u] <= 0 or other[u] > row[u] * (1.0 + _JUMP)):
            count += 1
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def _any_of(marked, row, first, last):
    for u in range(first, last + 1):
        if marked[row, u]:
            return True
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def _stretch_kernel(one, other, subject, pixel_angle):
    """How stretches went from one frame to another (N, 3): row, aside and ahead [m].

    A stretch counts that the other frame does not show where it was, if it is or becomes the ``subject``'s.
    """
    before, after = np.empty((64, 3)), np.empty((64, 3))
    moves, count = np.empty((2 * len(before) * len(one), 3)), 0
    for v in range(len(one)):
        if not _any_of(subject, v, 0, subject.shape[1] - 1):
            continue
        count_a, count_b = _stretches(one[v], before), _stretches(other[v], after)
        for way in range(2):
            mine, theirs = (before, after) if way == 0 else (after, before)
            count_mine, count_theirs = (count_a, count_b) if way == 0 else (count_b, count_a)
            row, rest = (one[v], other[v]) if way == 0 else (other[v], one[v])
            for k in range(count_mine):
                first, last, z = int(mine[k, 0]), int(mine[k, 1]), mine[k, 2]
                if first == 0 or last == len(row) - 1 or _gone(row, rest, first, last) < _CHANGED:
                    continue
                length, middle = last - first + 1, 0.5 * (first + last)
                best, which = np.inf, -1
                for j in range(count_theirs):
                    other_length = theirs[j, 1] - theirs[j, 0] + 1
                    # as long in space
                    ratio = other_length * theirs[j, 2] / (length * z)
                    if theirs[j, 0] == 0 or theirs[j, 1] == len(row) - 1 or min(ratio, 1.0 / ratio) < _ALIKE:
                        continue
                    off = abs(0.5 * (theirs[j, 0] + theirs[j, 1]) - middle) + abs(theirs[j, 2] - z) / pixel_angle / z
                    if off < best:
                        best, which = off, j
                if which >= 0 and (
                    _any_of(subject, v, first, last)
                    or _any_of(subject, v, int(theirs[which, 0]), int(theirs[which, 1]))
                ):
                    aside = (0.5 * (theirs[which, 0] + theirs[which, 1]) - middle) * pixel_angle
                    aside *= 0.5 * (z + theirs[which, 2])
                    ahead = theirs[which, 2] - z
                    moves[count, 0] = v
                    moves[count, 1], moves[count, 2] = (aside, ahead) if way == 0 else (-aside, -ahead)
                    count += 1
    return moves[:count].copy()
