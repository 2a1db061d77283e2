"""Straight depth edges in front of farther depth, and the rectangles they span: what may be a mirror.

A depth camera does not see glass; it sees the frame (or the wall around) at the mirror's plane and, inside, what the
glass shows, placed straight behind it. So (1) pixels with a jump to farther readings (or none) at one side are
collected for each of the four sides, (2) chained and split into straight segments, and (3) a standing and a lying
segment that meet in space, or two standing ones, span a plane and a rectangle. :mod:`.detection` says which of
these are mirrors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..camera import RgbdImage
from ..numeric.kernels import njit

LEFT, RIGHT, TOP, BOTTOM = 0, 1, 2, 3
"""Side of the glass a depth edge is on; at a LEFT edge it gets farther to the right, and so on."""


@dataclass(frozen=True)
class DetectionSettings:
    """What counts as a mirror.

    Parameters
    ----------
    jump : float
        The glass shows depth at least this much farther than its frame [m]; never less than 2 % of z², because
        triangulating cameras err with z².
    min_side : float
        A side of the frame must be seen over this length [m] to count.
    min_size, max_size : float
        Width and height of a mirror [m].
    straightness : float
        How far an edge's pixels may stray from a line [px].
    min_shown : float
        A mirror must show at least this share of its readings on or close behind what is seen directly; the floor does
        not count.
    min_rim : float
        Share of the circumference, as far as nothing hides it, where frame or wall must stand in the mirror's plane;
        0.13 more when only two sides are seen.
    max_violation : float
        Share of the readings in the glass that may, flipped, end up where the camera looks through.
    empty_rig : bool
        Nobody is there: a frame edge of three sides and a floor that fits are enough. For calibration only.
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
    """A straight piece of a depth edge.

    Side, end pixels (2, 2) and end points (2, 3), from the top or left; unit direction and length [m].
    """

    side: int
    ends: np.ndarray
    points: np.ndarray
    direction: np.ndarray
    length: float


@njit(cache=True, nogil=True)
def _edge_kernel(depth, step, jump, rows, columns, disparity):
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
            # beyond: farther, or nothing for four pixels; after a missing reading the surface goes on
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


def find_edge_segments(image: RgbdImage, settings: DetectionSettings) -> list[Segment]:
    """Straight pieces of near-side depth edges of all four sides, broken pieces joined.

    Parameters
    ----------
    image : RgbdImage
        z [m], 0 = no reading. Black and glossy frames are read here and there only: what is read of them counts even
        where it is short, and is joined over wide gaps, along the lines of the colour picture.
    """
    depth, intrinsics, color = image.depth, image.intrinsics, image.color
    segments: list[Segment] = []
    focal = 0.5 * (intrinsics.fx + intrinsics.fy)
    for turned in (False, True):
        grid = np.ascontiguousarray(depth.T) if turned else depth
        lines = None if color is None else _lines(color.swapaxes(0, 1) if turned else color)
        for step in (1, -1):
            side = (TOP if step > 0 else BOTTOM) if turned else (LEFT if step > 0 else RIGHT)
            room = 24 * grid.shape[0]
            rows, columns, disparity = np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room)
            n = _edge_kernel(grid, step, settings.jump, rows, columns, disparity)
            if n < 8:
                continue
            rows, columns, disparity = rows[:n], columns[:n], disparity[:n]
            chain = np.empty(n, np.int32)
            _chain_kernel(rows, columns, disparity, 4, chain)
            pieces = _pieces(rows, columns, disparity, chain, settings, focal, lines)

            def placed(piece: tuple[np.ndarray, ...], side=side, turned=turned) -> Segment | None:
                along, across, d = piece
                return _segment(side, along, across, d, turned, intrinsics)

            for piece in _joined(pieces, settings.straightness, grid, placed, settings.max_size, lines):
                segment = placed(piece)
                if segment is not None and segment.length >= settings.min_side:
                    segments.append(segment)
    return segments


_COLOR_REACH, _COLOR_CHANGE = 2, 16  # px to each side of a line in the picture, and how much a channel changes there
_ALONG_COLOR_LINE = 0.8  # of a piece, or of a gap, such a line has to run along


def _lines(color: np.ndarray) -> np.ndarray:
    """Where the colour picture (H, W, 3) changes along its rows: on upright lines, (H, W) bool."""
    out = np.zeros(color.shape[:2], np.bool_)
    wide = color.astype(np.int16)
    out[:, _COLOR_REACH:-_COLOR_REACH] = (
        np.abs(wide[:, 2 * _COLOR_REACH :] - wide[:, : -2 * _COLOR_REACH]).max(axis=2) > _COLOR_CHANGE
    )
    return out


def _on_line(lines: np.ndarray, v: np.ndarray, u: np.ndarray) -> bool:
    """Whether a line runs along most of the pixels (v, u), or right beside them."""
    inside = (u >= 1) & (u < lines.shape[1] - 2)
    row, column = v[inside].astype(np.int64), np.rint(u[inside]).astype(np.int64)
    near = lines[row, column] | lines[row, column - 1] | lines[row, column + 1]
    return bool(near.sum() > _ALONG_COLOR_LINE * len(v))


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
    """Pieces of one line, separated by something in front of it, as one; the longest first.

    Where the camera sees beyond the line between them it ends there, and where together they were longer [m] than a
    mirror is: images of images continue the lines of frames. Along a line of the colour picture gaps may be wide.
    """
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
                if gap[j] >= 0.6 * both[j] and (lines is None or not _on_line(lines, between, au + bu * between)):
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
    """U = a + b v and disparity = c + e v of a piece."""
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
