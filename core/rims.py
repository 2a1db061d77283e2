"""Straight rims before farther depth, and the rectangles they span: what may be a mirror.

A depth camera does not see glass; it sees the frame (or the wall around) at the mirror's plane and, inside, what the
glass shows, laid straight on behind it. So (1) pixels with a jump to farther readings (or none) at one side are
collected for each of the four sides, (2) chained and split into straight segments, and (3) a standing and a lying
segment that meet in space, or two standing ones, span a plane and a rectangle. :mod:`.mirror_detection` says which of
these are mirrors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from .camera import Intrinsics

LEFT, RIGHT, TOP, BOTTOM = 0, 1, 2, 3
"""Side of the glass a rim is on; at a LEFT rim it gets farther to the right, and so on."""


@dataclass(frozen=True)
class DetectionSettings:
    """What counts as a mirror.

    Parameters
    ----------
    jump : float
        The glass shows depth at least this much farther than its rim [m]; never less than 2 % of z², because
        triangulating cameras err with z².
    min_side : float
        A side of the rim must be seen over this length [m] to count.
    min_size, max_size : float
        Width and height of a mirror [m].
    straightness : float
        How far a rim's pixels may stray from a line [px].
    min_shown : float
        A mirror must show at least this share of its readings on or close behind what is seen directly; the floor does
        not count.
    min_rim : float
        Share of the circumference, as far as nothing hides it, where frame or wall must stand in the mirror's plane;
        0.13 more when only two sides are seen.
    max_violation : float
        Share of the readings in the glass that may, flipped, end up where the camera looks through.
    empty_rig : bool
        Nobody is there: a rim of three sides and a floor that fits are enough. For calibration only.
    max_mirrors : int
        At most so many, the best.
    """

    jump: float = 0.10
    min_side: float = 0.20
    min_size: float = 0.25
    max_size: float = 3.0
    straightness: float = 2.5
    min_shown: float = 0.02
    min_rim: float = 0.62
    max_violation: float = 0.12
    empty_rig: bool = False
    max_mirrors: int = 8


@dataclass(frozen=True)
class Segment:
    """A straight piece of rim: side, end pixels (2, 2) and end points (2, 3), from the top or left; unit direction and
    length [m]."""

    side: int
    ends: np.ndarray
    points: np.ndarray
    direction: np.ndarray
    length: float


@njit(cache=True, nogil=True)
def _rim_kernel(depth, step, jump, rows, columns, disparity):
    """Pixels of a row-wise scan with a jump to farther readings (or none) at the side ``step`` (+1 right, -1 left)."""
    height, width = depth.shape
    n = 0
    for v in range(height):
        for u in range(2, width - 2):
            z = depth[v, u]
            if z == 0:
                continue
            limit = z + max(jump, 0.02 * z * z)
            x = u + step
            if 0 < depth[v, x] <= limit:
                continue
            # beyond: farther, or nothing for four pixels; a drop-out in a surface goes on behind it
            far, near = False, False
            for k in range(1, 5):
                x = u + k * step
                if x < 0 or x >= width:
                    break
                if depth[v, x] > limit:
                    far = True
                    break
                if depth[v, x] > 0:
                    near = True
                    break
            if near:
                continue
            if not far and (u + 4 * step < 0 or u + 4 * step >= width):
                continue
            total, count = 1.0 / z, 1
            for k in range(1, 3):
                x = u - k * step
                if depth[v, x] > 0 and abs(depth[v, x] - z) < 0.03 * z:
                    total += 1.0 / depth[v, x]
                    count += 1
            if count < 2:
                continue
            if n == len(rows):
                return n
            rows[n], columns[n], disparity[n] = v, u, total / count
            n += 1
    return n


@njit(cache=True, nogil=True)
def _chain_kernel(rows, columns, disparity, reach, chain):
    """Chain number of each pixel, linked from row to row; pixels are in the order of their rows."""
    n = len(rows)
    chains = 0
    first = 0  # oldest pixel that can still be linked to
    for i in range(n):
        while rows[first] < rows[i] - reach:
            first += 1
        best, cost = -1, 1e9
        for j in range(first, i):
            dv = rows[i] - rows[j]
            du = abs(columns[i] - columns[j])
            if dv == 0 or du > 1.5 + dv or abs(disparity[i] - disparity[j]) > (0.02 + 0.01 * dv) * disparity[i]:
                continue
            c = du + 2.0 * dv + 40.0 * abs(disparity[i] / disparity[j] - 1.0)
            if c < cost:
                best, cost = j, c
        if best < 0:
            chain[i] = chains
            chains += 1
        else:
            chain[i] = chain[best]
    return chains


@njit(cache=True, nogil=True)
def _split_kernel(rows, columns, disparity, start, stop, tolerance, minimum, cuts):
    """Split a chain (sorted by row) where it leaves its chord; pieces of at least ``minimum`` rows go to ``cuts``."""
    stack = np.empty((64, 2), np.int64)
    stack[0, 0], stack[0, 1] = start, stop
    top, found = 1, 0
    while top > 0:
        top -= 1
        a, b = stack[top]
        if b - a < 6 or rows[b - 1] - rows[a] < minimum:
            continue
        # chord between the means of both ends: a single frayed pixel does not tilt it
        k = min(4, (b - a) // 3)
        v0 = v1 = u0 = u1 = d0 = d1 = 0.0
        for i in range(k):
            v0 += rows[a + i] / k
            u0 += columns[a + i] / k
            d0 += disparity[a + i] / k
            v1 += rows[b - 1 - i] / k
            u1 += columns[b - 1 - i] / k
            d1 += disparity[b - 1 - i] / k
        if v1 - v0 < 1.0:
            continue
        worst, where = 0.0, -1
        for i in range(a + k, b - k):
            t = (rows[i] - v0) / (v1 - v0)
            off = abs(columns[i] - u0 - t * (u1 - u0)) / tolerance
            off = max(off, abs(disparity[i] / (d0 + t * (d1 - d0)) - 1.0) / 0.04)
            if off > worst:
                worst, where = off, i
        if worst <= 1.0:
            if found < len(cuts):
                cuts[found, 0], cuts[found, 1] = a, b
                found += 1
        elif top + 2 <= len(stack):
            stack[top, 0], stack[top, 1] = a, where
            stack[top + 1, 0], stack[top + 1, 1] = where, b
            top += 2
    return found


def find_rims(
    depth: np.ndarray, intrinsics: Intrinsics, settings: DetectionSettings, color: np.ndarray | None = None
) -> list[Segment]:
    """Straight pieces of near-side depth edges of all four sides, broken pieces joined.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    color : np.ndarray [shape=(H, W, 3), dtype=uint8], optional
        On the depth's grid. Black and glossy frames are read here and there only: what is read of them counts even
        where it is short, and is joined over wide gaps, along the lines that this picture has.
    """
    segments: list[Segment] = []
    focal = 0.5 * (intrinsics.fx + intrinsics.fy)
    for turned in (False, True):
        grid = np.ascontiguousarray(depth.T) if turned else depth
        lines = None if color is None else _lines(color.swapaxes(0, 1) if turned else color)
        for step in (1, -1):
            side = (TOP if step > 0 else BOTTOM) if turned else (LEFT if step > 0 else RIGHT)
            room = 24 * grid.shape[0]
            rows, columns, disparity = np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room)
            n = _rim_kernel(grid, step, settings.jump, rows, columns, disparity)
            if n < 8:
                continue
            rows, columns, disparity = rows[:n], columns[:n], disparity[:n]
            chain = np.empty(n, np.int32)
            _chain_kernel(rows, columns, disparity, 4, chain)
            pieces = _pieces(rows, columns, disparity, chain, settings, focal, lines)

            def placed(piece, side=side, turned=turned) -> Segment | None:
                return _segment(side, *piece, turned, intrinsics)

            for piece in _joined(pieces, settings.straightness, grid, placed, settings.max_size, lines):
                segment = placed(piece)
                if segment is not None and segment.length >= settings.min_side:
                    segments.append(segment)
    return segments


_REACH, _CHANGE = 2, 16  # px to each side of a line in the colour picture, between which a channel changes by so much
_ALONG = 0.8  # of a piece, or of a gap, such a line has to run along


def _lines(color: np.ndarray) -> np.ndarray:
    """Where the colour picture (H, W, 3) changes along its rows: on upright lines, (H, W) bool."""
    out = np.zeros(color.shape[:2], np.bool_)
    wide = color.astype(np.int16)
    out[:, _REACH:-_REACH] = np.abs(wide[:, 2 * _REACH :] - wide[:, : -2 * _REACH]).max(axis=2) > _CHANGE
    return out


def _on_line(lines: np.ndarray, v: np.ndarray, u: np.ndarray) -> bool:
    """Whether a line runs along most of the pixels (v, u), or right beside them."""
    inside = (u >= 1) & (u < lines.shape[1] - 2)
    row, column = v[inside].astype(np.int64), np.rint(u[inside]).astype(np.int64)
    near = lines[row, column] | lines[row, column - 1] | lines[row, column + 1]
    return bool(near.sum() > _ALONG * len(v))


def _pieces(rows, columns, disparity, chain, settings, focal, lines) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    order = np.argsort(chain, kind="stable")  # pixels are in the order of their rows
    rows, columns, disparity, chain = rows[order], columns[order], disparity[order], chain[order]
    bounds = np.flatnonzero(np.diff(chain, prepend=-1, append=chain[-1] + 1))
    start, stop = bounds[:-1], bounds[1:]
    # the shortest piece worth having: less than half of what a side needs, in pixels at that distance
    least = np.maximum(8, (0.4 * settings.min_side * focal * disparity[(start + stop) // 2]).astype(np.int64))
    minimum = least if lines is None else np.maximum(6, least * 2 // 5)
    long = np.flatnonzero(rows[stop - 1] - rows[start] >= minimum)
    cuts = np.empty((64, 2), np.int64)
    out = []
    for i in long:
        found = _split_kernel(
            rows, columns, disparity, start[i], stop[i], settings.straightness, minimum[i], cuts
        )  # fmt: skip
        for a, b in cuts[:found]:
            if rows[b - 1] - rows[a] >= least[i] or _on_line(lines, rows[a:b], columns[a:b]):
                out.append((rows[a:b].astype(float), columns[a:b].astype(float), disparity[a:b]))
    return out


def _joined(
    pieces: list,
    tolerance: float,
    depth: np.ndarray,
    placed: Callable[[tuple], Segment | None],
    longest: float,
    lines: np.ndarray | None,
) -> list:
    """Pieces of one line, parted by something in front of it, as one; the longest first. Where the camera sees beyond
    the line between them it ends there, and where together they were longer [m] than a mirror is: images of images
    continue the lines of frames. Along a line of the colour picture gaps may be wide."""
    pieces = sorted(pieces, key=lambda p: -len(p[0]))
    # what a piece is to another: its rows' ends, and the mean place and disparity at its middle
    ends = np.array([(p[0][0], p[0][-1]) for p in pieces]).reshape(-1, 2)
    middle = np.array([(p[0].mean(), p[1].mean(), p[2].mean()) for p in pieces]).reshape(-1, 3)
    taken = np.zeros(len(pieces), np.bool_)
    out = []
    for i in range(len(pieces)):
        if taken[i]:
            continue
        taken[i] = True
        mine = pieces[i]
        while True:
            (au, bu, ad, bd), low, high = _line(mine), mine[0].min(), mine[0].max()
            gap = np.maximum(ends[:, 0] - high, low - ends[:, 1])
            both = np.maximum(high, ends[:, 1]) - np.minimum(low, ends[:, 0])
            stray = 1.0 + 0.3 * np.maximum(gap, 0.0) / (high - low)
            v, u, d = middle.T
            fits = ~taken & (gap > -3) & (gap < (0.6 if lines is None else 0.9) * both)
            fits &= np.abs(au + bu * v - u) < stray * tolerance
            fits &= np.abs((ad + bd * v) / d - 1.0) < 0.03 * stray
            joined = False
            for j in np.flatnonzero(fits):
                v, u, d = pieces[j]
                between = np.arange(*((high + 1, ends[j, 0]) if ends[j, 0] > high else (ends[j, 1] + 1, low)))
                if _ended(between, au + bu * between, ad + bd * between, depth):
                    continue
                if gap[j] >= 0.6 * both[j] and not _on_line(lines, between, au + bu * between):
                    continue
                if np.abs(au + bu * v - u).mean() >= stray[j] * tolerance:
                    continue
                one = tuple(np.concatenate(pair) for pair in zip(mine, pieces[j], strict=True))
                if len(between) and ((whole := placed(one)) is None or whole.length > longest):
                    continue
                mine, taken[j], joined = one, True, True
                break
            if not joined:
                break
        out.append(mine)
    return out


def _ended(v: np.ndarray, u: np.ndarray, disparity: np.ndarray, depth: np.ndarray) -> bool:
    """Most of a gap in a line, rows ``v``, shows what is farther: the line does not go on behind something."""
    if len(v) < 12:
        return False
    column = np.rint(u).astype(np.int64)
    inside = (column >= 0) & (column < depth.shape[1]) & (disparity > 0.02)
    z = depth[v[inside].astype(np.int64), column[inside]]
    beyond = z * disparity[inside] > 1.06
    return bool(beyond.sum() > 0.5 * len(v))


def _line(piece) -> tuple[float, float, float, float]:
    """u = a + b v and disparity = c + e v of a piece."""
    v, u, d = piece
    center = v.mean()
    w = v - center
    spread = max(float(w @ w), 1.0)
    bu, bd = float(w @ u) / spread, float(w @ d) / spread
    return u.mean() - bu * center, bu, d.mean() - bd * center, bd


def _segment(side, along, across, d, turned, intrinsics) -> Segment | None:
    a, b, c, e = _line((along, across, d))
    ends = np.array((along.min(), along.max()))
    other, disparity = a + b * ends, c + e * ends
    if disparity.min() <= 0.02:
        return None
    uv = np.column_stack((ends, other) if turned else (other, ends))
    rays = np.column_stack(((uv - (intrinsics.cx, intrinsics.cy)) / (intrinsics.fx, intrinsics.fy), np.ones(2)))
    points = rays / disparity[:, None]
    way = points[1] - points[0]
    length = float(np.linalg.norm(way))
    return Segment(side, uv, points, way / length, length)


@dataclass(frozen=True)
class Hypothesis:
    """A rectangle that may be a mirror, and what speaks for it.

    ``basis`` columns are right, down and the normal towards the camera; ``rectangle`` ((right min, max), (down min,
    max)) about ``point`` [m]; ``sides`` the rims by side; ``shown`` and ``violated`` shares of the readings in it.
    """

    point: np.ndarray
    basis: np.ndarray
    rectangle: np.ndarray
    sides: dict[int, Segment]
    shown: float = 0.0
    violated: float = 0.0
    behind: float = 0.0
    score: float = 0.0


_OPPOSITE = {LEFT: RIGHT, RIGHT: LEFT, TOP: BOTTOM, BOTTOM: TOP}


def propose(segments: list[Segment], settings: DetectionSettings) -> list[Hypothesis]:
    """Rectangles that two rims span: a standing and a lying one that meet, or two that run side by side."""
    if len(segments) < 2:
        return []
    rims = _Rims(segments)
    place = {id(segment): k for k, segment in enumerate(segments)}
    out, seen = [], set()
    pairs = _pairs(rims, settings, LEFT, RIGHT) | _pairs(rims, settings, TOP, BOTTOM)
    together = np.zeros_like(pairs)  # rims that are sides of one rectangle by now
    for which in (_corners(rims), pairs):
        for i, j in np.argwhere(which):
            if which is pairs and together[i, j]:
                continue
            guess = _hypothesis({segments[i].side: segments[i], segments[j].side: segments[j]})
            guess = guess and _completed(guess, segments, rims, settings)
            if guess is not None and (key := tuple(sorted(place[id(s)] for s in guess.sides.values()))) not in seen:
                seen.add(key)  # the same rectangle comes from each of its corners
                together[np.ix_(key, key)] = True
                out.append(guess)
    return out


class _Rims:
    """Segments as arrays: side (N,), points (N, 2, 3), direction (N, 3), length (N,)."""

    def __init__(self, segments: list[Segment]) -> None:
        self.side = np.array([s.side for s in segments])
        self.points = np.array([s.points for s in segments])
        self.direction = np.array([s.direction for s in segments])
        self.length = np.array([s.length for s in segments])


def _corners(rims: _Rims) -> np.ndarray:
    """(N, N): row is a left or right rim, column a top or bottom one, and they meet in space at a right angle."""
    upright = (rims.side == LEFT) | (rims.side == RIGHT)
    down, right = rims.direction[:, None], rims.direction[None, :]
    top = (rims.side == TOP)[None, :]
    corner = np.where(top[..., None], rims.points[:, None, 0], rims.points[:, None, 1])
    left = (rims.side == LEFT)[:, None]
    other = np.where(left[..., None], rims.points[None, :, 0], rims.points[None, :, 1])
    normal = np.cross(right, down)
    size = np.linalg.norm(normal, axis=2)
    offset = other - corner
    along_down, along_right = (offset * down).sum(axis=2), (offset * right).sum(axis=2)
    middle = rims.points.mean(axis=1)
    inside = middle[None, :] - middle[:, None]
    fits = upright[:, None] & ~upright[None, :] & (size > 0.977)
    fits &= ((inside * right).sum(axis=2) > 0) == left
    fits &= ((inside * down).sum(axis=2) < 0) == top
    # the lines pass each other closely; where each ends may be hidden
    fits &= np.abs((normal * offset).sum(axis=2)) < 0.03 * corner[..., 2] * size
    fits &= np.abs(along_down) < 0.10 + 0.25 * rims.length[:, None]
    return fits & (np.abs(along_right) < 0.10 + 0.25 * rims.length[None, :])


def _pairs(rims: _Rims, settings: DetectionSettings, one: int, other: int) -> np.ndarray:
    """(N, N): row is a rim on side ``one``, column one on the other side, parallel and side by side."""
    down = rims.direction[:, None] + rims.direction[None, :]
    down /= np.maximum(np.linalg.norm(down, axis=2, keepdims=True), 1e-9)
    middle = rims.points.mean(axis=1)
    across = middle[None, :] - middle[:, None]
    across = across - (across * down).sum(axis=2, keepdims=True) * down
    width = np.linalg.norm(across, axis=2)
    start = np.einsum("nc,nmc->nm", rims.points[:, 0], down), np.einsum("mc,nmc->nm", rims.points[:, 0], down)
    stop = np.einsum("nc,nmc->nm", rims.points[:, 1], down), np.einsum("mc,nmc->nm", rims.points[:, 1], down)
    shared = np.minimum(*stop) - np.maximum(*start)
    fits = (rims.side == one)[:, None] & (rims.side == other)[None, :]
    fits &= rims.direction @ rims.direction.T > 0.985
    fits &= (settings.min_size < width) & (width < settings.max_size) & (across[..., 0 if one == LEFT else 1] > 0)
    return fits & (shared > 0.6 * np.maximum(rims.length[:, None], rims.length[None, :]))


def _hypothesis(sides: dict[int, Segment]) -> Hypothesis | None:
    """Plane through the sides' ends, each weighing by its length; down is where those that stand point, or across those
    that lie."""
    points = np.concatenate([np.linspace(*s.points, max(2, int(20 * s.length))) for s in sides.values()])
    center = points.mean(axis=0)
    normal = np.linalg.svd((points - center).T @ (points - center))[2][2]
    if normal @ center > 0:
        normal = -normal
    if -normal @ center < 0.08 * np.linalg.norm(center):  # seen edge-on: nothing can be seen in it
        return None
    # normal points to the camera: right, as the camera sees it, is normal × down, and down is right × normal
    upright = sum(s.direction * s.length for k, s in sides.items() if k in (LEFT, RIGHT))
    lying = sum(s.direction * s.length for k, s in sides.items() if k in (TOP, BOTTOM))
    down = np.cross(lying, normal) if np.ndim(upright) == 0 else upright - (upright @ normal) * normal
    down /= np.linalg.norm(down)
    right = np.cross(normal, down)
    return Hypothesis(center, np.column_stack((-right, down, normal)), np.zeros((2, 2)), sides)


def _completed(
    guess: Hypothesis, segments: list[Segment], rims: _Rims, settings: DetectionSettings
) -> Hypothesis | None:
    """The rectangle with all rims that lie on it, refitted; None when it is no mirror's size."""
    for _ in range(2):
        missing = [side for side in range(4) if side not in guess.sides]
        added = {side: _fourth(side, guess, segments, rims, settings) for side in missing}
        sides = {**guess.sides, **{side: segment for side, segment in added.items() if segment is not None}}
        refitted = _hypothesis(sides)
        if refitted is None:
            return None
        guess = refitted
    rectangle = np.empty((2, 2))
    for axis, (low_side, high_side) in enumerate(((RIGHT, LEFT), (TOP, BOTTOM))):  # basis[:, 0] points left
        across = (LEFT, RIGHT) if axis == 1 else (TOP, BOTTOM)
        reach = [(s.points - guess.point) @ guess.basis[:, axis] for k, s in sides.items() if k in across]
        for end, side, pick in ((0, low_side, min), (1, high_side, max)):
            if side in sides:
                rectangle[axis, end] = ((sides[side].points - guess.point) @ guess.basis[:, axis]).mean()
            elif reach:
                rectangle[axis, end] = pick(float(pick(r)) for r in reach)
            else:
                return None
    size = rectangle[:, 1] - rectangle[:, 0]
    if size.min() < settings.min_size or size.max() > settings.max_size:
        return None
    return replace(guess, rectangle=rectangle, sides=sides)


def _fourth(
    side: int, guess: Hypothesis, segments: list[Segment], rims: _Rims, settings: DetectionSettings
) -> Segment | None:
    """The segment on the guessed plane that best ends at the corners with the sides that are known."""
    axis = 0 if side in (LEFT, RIGHT) else 1  # basis column that the side stands across
    inward = -1.0 if side in (LEFT, BOTTOM) else 1.0  # along that column; it points left, or down
    tolerance = 0.015 * guess.point[2] + 0.01
    opposite = guess.sides.get(_OPPOSITE[side])
    across = [guess.sides[k] for k in ((TOP, BOTTOM) if axis == 0 else (LEFT, RIGHT)) if k in guess.sides]
    best, cost = None, np.inf
    flat = np.abs((rims.points - guess.point) @ guess.basis[:, 2]).max(axis=1) < tolerance
    along = np.abs(rims.direction @ guess.basis[:, 1 - axis]) > 0.985
    for k in np.flatnonzero((rims.side == side) & flat & along):
        segment = segments[k]
        at = (segment.points - guess.point) @ guess.basis[:, :2]
        place = at[:, axis].mean()
        if opposite is not None:
            distance = ((opposite.points - guess.point) @ guess.basis[:, axis]).mean() - place
            if not settings.min_size < inward * distance < settings.max_size:
                continue
            low, high = np.sort((opposite.points - guess.point) @ guess.basis[:, 1 - axis])
            shared = min(high, at[:, 1 - axis].max()) - max(low, at[:, 1 - axis].min())
            if shared < 0.3 * min(opposite.length, segment.length):
                continue
        misfit = 0.0
        for other in across:
            ends = (other.points - guess.point) @ guess.basis[:, :2]
            end = ends[np.argmin(inward * ends[:, axis])]  # the end at this side
            nearest = np.clip(end[1 - axis], at[:, 1 - axis].min(), at[:, 1 - axis].max())
            gap = np.hypot(end[axis] - place, end[1 - axis] - nearest)
            misfit = max(misfit, gap - 0.10 - 0.25 * max(other.length, segment.length))
            if inward * (ends[:, axis].mean() - place) <= 0:  # the other must run inward from here
                misfit = np.inf
            misfit = misfit if misfit > 0 else 0.0
            cost_here = gap
        value = misfit if not across else cost_here
        if misfit == 0.0 and value < cost:
            best, cost = segment, value
    return best
