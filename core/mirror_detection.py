"""Mirrors found without a click: straight rims before farther depth, paired to rectangles, proved by what they show.

A depth camera does not see glass; it sees the frame (or the wall around) at the mirror's plane and, inside, what the
glass shows, laid straight on behind it. So (1) pixels with a jump to farther readings (or none) at one side are
collected for each of the four sides, (2) chained and split into straight segments, (3) a standing and a lying segment
that meet in space, or two standing ones, span a plane and a rectangle, and (4) the readings in the rectangle, flipped
over the plane, must make sense: nothing may end up where the camera looks through, and a part must lie on, or close
behind, what is seen directly. A doorway, a table's legs or a window fail there.

Where a mirror has no frame and no wall about it, see :mod:`.frameless`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from .camera import Intrinsics, project
from .capture import MirrorPicks
from .errors import MirrorError
from .frameless import find_frameless
from .mirror import Mirror, at_border, person_before, reflection_matrix, reflection_shift, with_outline
from .mirror_refinement import fit_frame

LEFT, RIGHT, TOP, BOTTOM = 0, 1, 2, 3
"""Side of the glass a rim is on; at a LEFT rim it gets farther to the right, and so on."""


_OPEN_SHOWN = 0.07  # with a side missing, this share of all readings must lie on or close behind what is seen directly


_PLAIN = 0.15  # a mirror that shows so much needs less of a rim
_WHOLE, _FEW_SHOWN = 0.95, (15, 8)  # with so much of a rim on 3 or 4 sides, and nothing against it, so few must show
_CONTRADICTED = 0.15  # share of what a mirror shows that nothing but a wrong plane puts before what is seen
_HIT = 0.35  # share of the picks that say which mirror is meant, where they fit no plane together
_STANDS, _MOSTLY = 0.6, 0.9  # of its outline, of all and of what can be judged, something must stand in its plane
_MISSING = 10, 0.005  # readings, and share of them, that noise may make look as if a mirror did not show them
_BLIND, _IN_REACH = 0.05, 0.8  # a glass of which less is read must be nearer than this share of the farthest reading
_AT_BORDER = 0.02  # sides nearer to the image's border, as a share of its size, are cut off by it


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


def find_rims(depth: np.ndarray, intrinsics: Intrinsics, settings: DetectionSettings) -> list[Segment]:
    """Straight pieces of near-side depth edges of all four sides, broken pieces joined.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    """
    segments: list[Segment] = []
    focal = 0.5 * (intrinsics.fx + intrinsics.fy)
    for turned in (False, True):
        grid = np.ascontiguousarray(depth.T) if turned else depth
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
            pieces = _pieces(rows, columns, disparity, chain, settings, focal)

            def placed(piece, side=side, turned=turned) -> Segment | None:
                return _segment(side, *piece, turned, intrinsics)

            for piece in _joined(pieces, settings.straightness, grid, placed, settings.max_size):
                segment = placed(piece)
                if segment is not None and segment.length >= settings.min_side:
                    segments.append(segment)
    return segments


def _pieces(rows, columns, disparity, chain, settings, focal) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    order = np.argsort(chain, kind="stable")  # pixels are in the order of their rows
    rows, columns, disparity, chain = rows[order], columns[order], disparity[order], chain[order]
    bounds = np.flatnonzero(np.diff(chain, prepend=-1, append=chain[-1] + 1))
    start, stop = bounds[:-1], bounds[1:]
    # the shortest piece worth having: less than half of what a side needs, in pixels at that distance
    minimum = np.maximum(8, (0.4 * settings.min_side * focal * disparity[(start + stop) // 2]).astype(np.int64))
    long = np.flatnonzero(rows[stop - 1] - rows[start] >= minimum)
    cuts = np.empty((64, 2), np.int64)
    out = []
    for i in long:
        found = _split_kernel(
            rows, columns, disparity, start[i], stop[i], settings.straightness, minimum[i], cuts
        )  # fmt: skip
        for a, b in cuts[:found]:
            out.append((rows[a:b].astype(float), columns[a:b].astype(float), disparity[a:b]))
    return out


def _joined(
    pieces: list, tolerance: float, depth: np.ndarray, placed: Callable[[tuple], Segment | None], longest: float
) -> list:
    """Pieces of one line, parted by something in front of it, as one; the longest first. Where the camera sees beyond
    the line between them it ends there, and where together they were longer [m] than a mirror is: images of images
    continue the lines of frames."""
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
            fits = ~taken & (gap > -3) & (gap < 0.6 * both)
            fits &= np.abs(au + bu * v - u) < stray * tolerance
            fits &= np.abs((ad + bd * v) / d - 1.0) < 0.03 * stray
            joined = False
            for j in np.flatnonzero(fits):
                v, u, d = pieces[j]
                between = np.arange(*((high + 1, ends[j, 0]) if ends[j, 0] > high else (ends[j, 1] + 1, low)))
                if _ended(between, au + bu * between, ad + bd * between, depth):
                    continue
                if np.abs(au + bu * v - u).mean() >= stray[j] * tolerance:
                    continue
                both = tuple(np.concatenate(pair) for pair in zip(mine, pieces[j], strict=True))
                if len(between) and ((whole := placed(both)) is None or whole.length > longest):
                    continue
                mine, taken[j], joined = both, True, True
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


def rim_share(
    guess: Hypothesis,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    least: float = 0.3,
    known: Iterable[Mirror] = (),
) -> float:
    """Share of the rectangle's circumference, as far as nothing hides it, just outside of which something stands in
    the plane: a frame or a wall; 0 when that is less than ``least`` of it all. A thin frame is only seen close by."""
    shares = []
    for outward in (0.015, 0.007):
        on, beyond = circumference(
            guess.point, guess.basis, guess.rectangle, depth, intrinsics, outward, known
        )
        shares.append(on / (on + beyond) if on >= least else 0.0)
    return max(shares)


def circumference(
    point: np.ndarray,
    basis: np.ndarray,
    rectangle: np.ndarray,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    outward: float = 0.015,
    known: Iterable[Mirror] = (),
) -> tuple[float, float]:
    """Shares of a mirror's circumference where, ``outward`` of its rectangle [m], something stands in its plane, and
    where the camera sees beyond; of what the glass of ``known`` mirrors hides neither."""
    (left, right), (top, bottom) = rectangle + np.array((-outward, outward))
    along = np.linspace(0.0, 1.0, 41)[1:-1]
    corners = np.array(((left, top), (right, top), (right, bottom), (left, bottom), (left, top)))
    at = np.concatenate([a + along[:, None] * (b - a) for a, b in zip(corners[:-1], corners[1:], strict=True)])
    weight = np.repeat(np.linalg.norm(np.diff(corners, axis=0), axis=1), len(along))
    points = point + at @ basis[:, :2].T
    u, v = project(points, intrinsics).T
    inside = (u > 0) & (v > 0) & (u < intrinsics.width - 1) & (v < intrinsics.height - 1)  # false where NaN
    inside[inside] = ~_behind(points[inside], known)
    read = np.zeros(len(points))
    read[inside] = depth[np.rint(v[inside]).astype(int), np.rint(u[inside]).astype(int)]
    apart = read - points[:, 2]
    slack = 0.02 * points[:, 2] + 0.02
    on = inside & (np.abs(apart) < slack)
    beyond = inside & (read > 0) & (apart >= slack)
    return float(weight[on].sum() / weight.sum()), float(weight[beyond].sum() / weight.sum())


def verify(
    guess: Hypothesis,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    floor: float,
    settings: DetectionSettings,
    known: Iterable[Mirror] = (),
) -> Hypothesis | None:
    """The hypothesis with its evidence, or None when what it shows cannot be a reflection.

    Every third reading in the rectangle is flipped over the plane. Where it lands nearer than what the camera sees in
    that direction, the camera would have looked through it: a violation. Where it lands on, or up to 0.7 m behind, what
    is seen directly, it is shown. What lies outside the picture says nothing. Behind the glass of mirrors that are
    ``known`` a rim is hidden.
    """
    before, on, none, outside, violated, shown, hidden, ground = _count(guess, depth, intrinsics, floor)
    behind = outside + violated + shown + hidden + ground
    total = behind + on + none
    if total < 60 or behind + none < 0.5 * total or behind < min(_FEW_SHOWN):
        return None
    if TOP not in guess.sides and BOTTOM not in guess.sides:
        # two uprights alone, such as legs or door posts, must leave the picture where the lying side would be
        if min(s.ends[0, 1] for s in guess.sides.values()) > 0.04 * intrinsics.height:
            return None
    if behind < _BLIND * total and guess.point[2] > _IN_REACH * float(depth[::8, ::8].max()):
        return None  # the end of what the camera reaches looks like a rim, too
    judged = violated + shown + hidden + ground
    violation = violated / max(judged, 1.0)
    plain = shown > _PLAIN * total and violation < 0.02
    if len(guess.sides) == 2 and min(s.length for s in guess.sides.values()) < (0.3 if plain else 0.5):
        return None  # a leg and the edge of its shadow, a table and one of its legs
    least = 0.2 if plain else 0.3
    rim = rim_share(guess, depth, intrinsics, least, known)
    made = replace(guess, shown=shown, violated=violation, behind=behind / total, score=rim * (1.0 - violation))
    if rim < settings.min_rim + (0.13 if len(guess.sides) == 2 else 0.0):
        return None
    if violation > settings.max_violation:
        return None
    if settings.empty_rig:
        return made if len(guess.sides) >= 3 or shown >= 30.0 else None
    # a rim of which a side is missing may be a wall's, seen past a mirror that stands before it
    open_rim = _OPEN_SHOWN * (behind + on) if _open_sides(guess, intrinsics) else 0.0
    if rim > _WHOLE and violated == 0.0 and (len(guess.sides) >= 3 or known):
        few = _FEW_SHOWN[len(guess.sides) == 4]
        return made if shown >= max(few, settings.min_shown * judged, open_rim) else None
    if behind + none < 0.8 * total:  # something is in its plane, such as somebody right before the glass, or a wall
        return None
    if before > behind:  # something stands there, and little is seen beyond: it may be the image in another mirror
        return None
    return made if shown >= max(30.0, settings.min_shown * behind, open_rim) else None


def _count(guess: Hypothesis, depth: np.ndarray, intrinsics: Intrinsics, floor: float) -> list[float]:
    """What becomes of the readings in the rectangle, see :func:`_verify_kernel`; all 0 when it reaches behind the
    camera."""
    mirror = Mirror("", guess.point, guess.basis[:, 2], guess.basis)
    corners = np.array([(x, y) for x in guess.rectangle[0] for y in guess.rectangle[1]])
    pixels = project(guess.point + corners @ guess.basis[:, :2].T, intrinsics)
    counts = np.zeros(8, np.int64)
    if np.isfinite(pixels).all():
        low = np.clip(np.floor(pixels.min(axis=0)), 0, None).astype(np.int64)
        high = np.clip(np.ceil(pixels.max(axis=0)) + 1, 0, (intrinsics.width, intrinsics.height)).astype(np.int64)
        _verify_kernel(
            depth, intrinsics.lens, guess.basis, guess.point, guess.rectangle, reflection_matrix(mirror), low, high,
            floor, counts,
        )  # fmt: skip
    return [float(count) for count in counts]


def _open_sides(guess: Hypothesis, intrinsics: Intrinsics) -> int:
    """How many sides have no rim where the image would show it: its border cuts off the others."""
    margin = _AT_BORDER * np.array((intrinsics.width, intrinsics.height))
    count = 0
    for side in range(4):
        if side in guess.sides:
            continue
        axis, end = {LEFT: (0, 1), RIGHT: (0, 0), TOP: (1, 0), BOTTOM: (1, 1)}[side]  # basis[:, 0] points left
        at = np.empty(2)
        at[axis], at[1 - axis] = guess.rectangle[axis, end], guess.rectangle[1 - axis].mean()
        place = project(guess.point + guess.basis[:, :2] @ at, intrinsics)[axis]
        size = (intrinsics.width, intrinsics.height)[axis]
        count += bool(margin[axis] < place < size - 1 - margin[axis])
    return count


@njit(cache=True, nogil=True)
def _verify_kernel(depth, camera, basis, point, rectangle, flip, low, high, floor, counts):
    """Counts of sampled pixels: before the plane, on it, no reading, then flipped outside, violating, shown, hidden,
    ground."""
    height, width = depth.shape
    fx, fy, cx, cy = camera
    d = 0.0
    for c in range(3):
        d += basis[c, 2] * point[c]
    ray, p, q = np.empty(3), np.empty(3), np.empty(3)
    step = 3 if (high[0] - low[0]) * (high[1] - low[1]) > 9000 else 2
    for v in range(low[1], high[1], step):
        for u in range(low[0], high[0], step):
            ray[0], ray[1], ray[2] = (u - cx) / fx, (v - cy) / fy, 1.0
            slope = basis[0, 2] * ray[0] + basis[1, 2] * ray[1] + basis[2, 2]
            if slope >= -1e-6:
                continue
            at = d / slope
            inside = True
            for k in range(2):
                s = 0.0
                for c in range(3):
                    s += basis[c, k] * (ray[c] * at - point[c])
                if s < rectangle[k, 0] + 0.015 or s > rectangle[k, 1] - 0.015:
                    inside = False
            if not inside:
                continue
            z = depth[v, u]
            if z == 0:
                counts[2] += 1
                continue
            if z < at * 0.97 - 0.02:
                counts[0] += 1
                continue
            if z < at * 1.02 + 0.04:
                counts[1] += 1
                continue
            drop = 0.0
            for r in range(3):
                p[r] = ray[r] * z
                drop += basis[r, 1] * p[r]
            for r in range(3):
                q[r] = flip[r, 3]
                for c in range(3):
                    q[r] += flip[r, c] * p[c]
            if q[2] < 0.3:
                counts[3] += 1
                continue
            x, y = int(np.rint(q[0] / q[2] * fx + cx)), int(np.rint(q[1] / q[2] * fy + cy))
            # a reading's error points sideways once it is flipped: look about the place by what noise at z may be
            reach = int(fx * (0.01 + 0.003 * z * z) / q[2]) + 2
            if x < 2 or y < 2 or x >= width - 2 or y >= height - 2:
                counts[3] += 1
                continue
            nearest, farthest = np.inf, 0.0
            for ky in range(-3, 4):
                for kx in range(-3, 4):
                    row = min(max(y + ky * reach // 3, 0), height - 1)
                    seen = depth[row, min(max(x + kx * reach // 3, 0), width - 1)]
                    if seen > 0:
                        nearest, farthest = min(nearest, seen), max(farthest, seen)
            if farthest == 0.0:
                counts[3] += 1
                continue
            slack = 0.05 + 0.02 * z
            if q[2] < nearest - slack:
                counts[4] += 1
            elif drop > floor:
                counts[7] += 1
            elif q[2] < nearest + 0.7:
                counts[5] += 1
            else:
                counts[6] += 1


def _missing(mirror: Mirror, depth: np.ndarray, intrinsics: Intrinsics) -> bool:
    """What stands before the plane would be seen in the glass, and is not: it is a door, whoever stands behind it."""
    flip = reflection_matrix(mirror)
    missing, there = _missing_kernel(
        depth, intrinsics.lens, mirror.basis, mirror.point, mirror.rectangle, flip, 3
    )  # fmt: skip
    return missing > max(_MISSING[0], _MISSING[1] * (missing + there))


@njit(cache=True, nogil=True)
def _missing_kernel(depth, camera, basis, point, rectangle, flip, stride):
    """Of what stands before the plane and, flipped, would be seen in the glass: how much is not, since what is read
    there is farther; and how much is, or may be hidden."""
    height, width = depth.shape
    fx, fy, cx, cy = camera
    d = 0.0
    for c in range(3):
        d += basis[c, 2] * point[c]
    p, q = np.empty(3), np.empty(3)
    missing, there = 0, 0
    for v in range(0, height, stride):
        for u in range(0, width, stride):
            z = depth[v, u]
            if z == 0:
                continue
            p[0], p[1], p[2] = (u - cx) / fx * z, (v - cy) / fy * z, z
            ahead = -d
            for c in range(3):
                ahead += basis[c, 2] * p[c]
            if ahead < 0.15:
                continue
            for r in range(3):
                q[r] = flip[r, 3]
                for c in range(3):
                    q[r] += flip[r, c] * p[c]
            if q[2] < 0.3:
                continue
            x, y = int(np.rint(q[0] / q[2] * fx + cx)), int(np.rint(q[1] / q[2] * fy + cy))
            if x < 3 or y < 3 or x >= width - 3 or y >= height - 3:
                continue
            slope = 0.0
            for c in range(3):
                slope += basis[c, 2] * q[c]
            at, inside = d / slope, True
            for k in range(2):
                s = 0.0
                for c in range(3):
                    s += basis[c, k] * (q[c] * at - point[c])
                if s < rectangle[k, 0] + 0.08 or s > rectangle[k, 1] - 0.08:
                    inside = False
            if not inside:
                continue
            nearest = np.inf
            for i in range(-3, 4, 3):
                for j in range(-3, 4, 3):
                    if depth[y + i, x + j] == 0.0:
                        nearest = 0.0
                    nearest = min(nearest, depth[y + i, x + j])
            if nearest == 0.0:
                continue
            if nearest > q[2] + 0.08 + 0.01 * q[2] * q[2]:
                missing += 1
            else:
                there += 1
    return missing, there


def find_mirrors(
    depth: np.ndarray,
    intrinsics: Intrinsics,
    color: np.ndarray | None = None,
    settings: DetectionSettings = DetectionSettings(),
    glass_offset: float = 0.0,
) -> list[Mirror]:
    """All mirrors of a scene, from the left, without a click.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        Fused depth, flying pixels removed; z [m], 0 = no reading.
    intrinsics : Intrinsics
    glass_offset : float
        How far the reflecting glass lies behind the front of the frame [m].

    Returns
    -------
    list of Mirror
        ``source`` "found"; named left, right, or mirror 1, 2 … from the left. Empty when there is none.

    Notes
    -----
    O(H W) and the square of the number of straight rims; deterministic.
    """
    lenient = replace(settings, max_violation=2.0 * settings.max_violation)
    proposed = propose(find_rims(depth, intrinsics, settings), settings)
    guesses = _verified(proposed, depth, intrinsics, lenient)
    found: list[Mirror] = []
    while guesses:
        new = []
        for guess in _apart(guesses, intrinsics, found)[: settings.max_mirrors - len(found)]:
            mirror = _settled(guess, depth, intrinsics, settings, glass_offset, found)
            if mirror is not None:
                new.append(mirror)
        found += new
        if not new or len(found) == settings.max_mirrors:
            break
        # a mirror through another one: its rim is not where the other's glass is before it
        proposed = [guess for guess in proposed if _partly_behind(guess, found)]
        guesses = _verified(proposed, depth, intrinsics, lenient, found)
    doubt = [doubtful(m, depth, intrinsics) for m in found]
    sure = [m for m, doubted in zip(found, doubt, strict=True) if not doubted]
    if len(sure) < settings.max_mirrors and not settings.empty_rig:
        better = _frameless(depth, intrinsics, settings, sure)
        found = [m for m, doubted in zip(found, doubt, strict=True) if not (doubted and _overlaps(m, better))] + better
    found.sort(key=lambda m: m.point[0] / m.point[2])
    return [replace(m, name=name) for m, name in zip(found, _names(found), strict=True)]


def doubtful(mirror: Mirror, depth: np.ndarray, intrinsics: Intrinsics) -> bool:
    """More of its glass is hidden than shows anything: its rim may be a wall's, seen past mirrors without a frame."""
    if mirror.rectangle is None:
        return False
    guess = Hypothesis(mirror.point, mirror.basis, mirror.rectangle, {})
    before, _, _, *behind = _count(guess, depth, intrinsics, _ground(depth, intrinsics, mirror.basis))
    return before > sum(behind)


def _overlaps(mirror: Mirror, others: Iterable[Mirror]) -> bool:
    """Whether it shares more than a quarter of the smaller one's place in the picture with one of the others."""
    for other in others:
        low = np.maximum(mirror.outline.min(axis=0), other.outline.min(axis=0))
        size = np.minimum(mirror.outline.max(axis=0), other.outline.max(axis=0)) - low
        smaller = min(np.prod(np.ptp(m.outline, axis=0)) for m in (mirror, other))
        if size.min() > 0 and np.prod(size) > 0.25 * smaller:
            return True
    return False


def _frameless(
    depth: np.ndarray, intrinsics: Intrinsics, settings: DetectionSettings, known: list[Mirror]
) -> list[Mirror]:
    """Mirrors that only the figure in them tells of, as far as the rest of what they show may be a reflection too.

    Where something stands beside the glass it must be a frame in its plane, which then tells that better.
    """
    good = []
    for mirror, beside in find_frameless(depth, intrinsics, known, settings.max_mirrors - len(known)):
        if beside:
            framed = fit_frame(mirror, depth, intrinsics)
            off = framed and reflection_shift(person_before(mirror), framed, mirror)
            if off is None or off > 3.0 * mirror.displacement(person_before(mirror)):
                continue
            mirror = with_outline(framed, intrinsics)
        guess = Hypothesis(mirror.point, mirror.basis, mirror.rectangle, {})
        if beside and rim_share(guess, depth, intrinsics, 0.2, known) < settings.min_rim:
            continue
        _, _, _, _, violated, shown, hidden, ground = _count(
            guess, depth, intrinsics, _ground(depth, intrinsics, mirror.basis)
        )
        bad = violated > settings.max_violation * (violated + shown + hidden + ground)
        if shown >= 30 and not bad and not _missing(mirror, depth, intrinsics):
            good.append(mirror)
    return good


def find_mirror_at(
    picks: MirrorPicks,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    settings: DetectionSettings = DetectionSettings(),
    glass_offset: float = 0.0,
) -> Mirror:
    """The mirror whose rim is nearest to one or two picked pixels, too few for a plane of their own.

    That a mirror is there is the user's word: it need not show anybody.

    Parameters
    ----------
    picks : MirrorPicks
        One pixel or more on the mirror's frame; in the glass will do.

    Raises
    ------
    MirrorError
        No rim is near.
    """
    trusting = replace(settings, empty_rig=True, max_violation=max(2.0 * settings.max_violation, 0.3))
    pixels = np.asarray(picks.frame_pixels, dtype=np.float64).reshape(-1, 2)
    guesses = hypotheses(depth, intrinsics, trusting)
    settled = [_settled(guess, depth, intrinsics, trusting, glass_offset) for guess in guesses]
    best = _nearest([mirror for mirror in settled if mirror is not None], pixels, 0.5)
    if best is None and (bare := find_frameless_at(picks, depth, intrinsics, settings, 0.5)) is not None:
        return bare
    if best is None:
        u, v = pixels[0]
        raise MirrorError(
            f"{picks.name}: no straight frame is seen near ({u:g}, {v:g}), and {len(pixels)} pick(s) are too few for a "
            "plane; pick at least 3 points on its frame, on two sides"
        )
    return replace(best, name=picks.name, source="picked")


def find_better_at(
    picks: MirrorPicks,
    mirror: Mirror | None,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    settings: DetectionSettings = DetectionSettings(),
    glass_offset: float = 0.0,
) -> Mirror | None:
    """The mirror that picks mean where that of the plane through them, ``mirror``, cannot be, or there is none: they
    missed its frame, or it has none. Else ``mirror``."""
    if mirror is None or contradicted(mirror, depth, intrinsics):
        pixels = np.asarray(picks.frame_pixels, dtype=np.float64).reshape(-1, 2)
        guesses = hypotheses(depth, intrinsics, settings)
        settled = [_settled(guess, depth, intrinsics, settings, glass_offset) for guess in guesses]
        better = _nearest([found for found in settled if found is not None], pixels, 0.05)
        if better is not None:
            return replace(better, name=picks.name, source="picked")
    elif not doubtful(mirror, depth, intrinsics):
        return mirror
    return find_frameless_at(picks, depth, intrinsics, settings) or mirror


def contradicted(mirror: Mirror, depth: np.ndarray, intrinsics: Intrinsics, known: Iterable[Mirror] = ()) -> bool:
    """Much of what is seen in its glass would, flipped over its plane, stand where the camera looks through; or along
    its outline, as far as other mirrors that are ``known`` do not hide it, hardly anything stands in its plane."""
    if mirror.rectangle is None or mirror.polygon is not None:
        return False
    guess = Hypothesis(mirror.point, mirror.basis, mirror.rectangle, {})
    _, _, _, _, violated, *other = _count(guess, depth, intrinsics, _ground(depth, intrinsics, mirror.basis))
    if violated > max(_CONTRADICTED * (violated + sum(other)), 50.0):
        return True
    rims = [
        circumference(mirror.point, mirror.basis, mirror.rectangle, depth, intrinsics, outward, known)
        for outward in (-0.015, 0.015)
    ]
    return all(on < _STANDS and on < _MOSTLY * (on + beyond) for on, beyond in rims)


def find_frameless_at(
    picks: MirrorPicks,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    settings: DetectionSettings = DetectionSettings(),
    reach: float = 0.15,
) -> Mirror | None:
    """The mirror without a frame along whose edges picks were made, which no reading there can place; None when there
    is none within ``reach`` of its size. Its ``source`` stays "found": the picks say only which."""
    pixels = np.asarray(picks.frame_pixels, dtype=np.float64).reshape(-1, 2)
    mirror = _nearest(_frameless(depth, intrinsics, settings, []), pixels, reach)
    return None if mirror is None else replace(mirror, name=picks.name)


def _nearest(mirrors: list[Mirror], pixels: np.ndarray, reach: float) -> Mirror | None:
    """The mirror whose outline is nearest to the better part of pixels (K, 2), within ``reach`` of its lesser size."""
    best, nearest = None, np.inf
    for mirror in mirrors:
        corners = np.nan_to_num(mirror.outline)
        distance = np.quantile([_to_outline(pixel, corners) for pixel in pixels], _HIT)
        if distance < nearest and distance < reach * np.ptp(corners, axis=0).min():
            best, nearest = mirror, distance
    return best


def _to_outline(pixel: np.ndarray, corners: np.ndarray) -> float:
    """Distance of a pixel from the outline [px]."""
    start, along = corners, np.roll(corners, -1, axis=0) - corners
    share = ((pixel - start) * along).sum(axis=1) / np.maximum((along * along).sum(axis=1), 1e-9)
    return float(np.linalg.norm(start + np.clip(share, 0.0, 1.0)[:, None] * along - pixel, axis=1).min())


def _partly_behind(guess: Hypothesis, mirrors: list[Mirror]) -> bool:
    """The glass of known mirrors hides some of the rectangle's corners or the middles of its sides, but not its own
    middle: there it would be one of them, or an image in one."""
    (left, right), (top, bottom) = guess.rectangle
    x, y = np.meshgrid((left, 0.5 * (left + right), right), (top, 0.5 * (top + bottom), bottom))
    points = guess.point + np.column_stack((x.ravel(), y.ravel())) @ guess.basis[:, :2].T
    hidden = _behind(points, mirrors)
    return bool(hidden.any() and not hidden[4])


def _behind(points: np.ndarray, mirrors: Iterable[Mirror]) -> np.ndarray:
    """Which of some points (N, 3) are on or hidden by the glass or frame of a mirror before them."""
    hidden = np.zeros(len(points), np.bool_)
    for m in mirrors:
        share = (m.normal @ m.point) / (points @ m.normal)
        place = (points * share[:, None] - m.point) @ m.basis[:, :2]
        on = ((m.rectangle[:, 0] - 0.03 < place) & (place < m.rectangle[:, 1] + 0.03)).all(axis=1)
        hidden |= on & (share > 0.0) & (share < 1.02)
    return hidden


def _settled(
    guess: Hypothesis,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    settings: DetectionSettings,
    glass_offset: float,
    known: Iterable[Mirror] = (),
) -> Mirror | None:
    """The hypothesis as a mirror on its frame's plane; None when what it shows makes no sense with that plane."""
    mirror = Mirror("", guess.point, guess.basis[:, 2], guess.basis, guess.rectangle, source="found")
    fitted = fit_frame(mirror, depth, intrinsics, seeds=_along(guess.sides.values()))
    if fitted is None:
        return None
    final = replace(guess, point=fitted.point, basis=fitted.basis)
    if verify(final, depth, intrinsics, _ground(depth, intrinsics, fitted.basis), settings, known) is None:
        return None
    if _missing(fitted, depth, intrinsics):
        return None
    behind = replace(fitted, point=fitted.point - glass_offset * fitted.normal)
    return at_border(behind, intrinsics, _unseen(guess))


def _along(sides: Iterable[Segment]) -> np.ndarray:
    """Pixels (K, 2), every few along the rims."""
    return np.concatenate([np.linspace(*s.ends, max(int(np.abs(s.ends[1] - s.ends[0]).max()) // 8, 2)) for s in sides])


def _unseen(guess: Hypothesis) -> np.ndarray:
    """Which ends of the rectangle have no rim, (2, 2): only those may be cut off by the image's border."""
    return np.array(
        ((RIGHT not in guess.sides, LEFT not in guess.sides), (TOP not in guess.sides, BOTTOM not in guess.sides))
    )


def _names(mirrors: list[Mirror]) -> list[str]:
    if len(mirrors) == 2:
        return ["left", "right"]
    if len(mirrors) == 1:
        return ["left" if mirrors[0].point[0] < 0 else "right"]
    return [f"mirror {k}" for k in range(1, len(mirrors) + 1)]


def _apart(good: list[Hypothesis], intrinsics: Intrinsics, known: list[Mirror]) -> list[Hypothesis]:
    """The best of those that share a part of the picture, with each other or a known mirror; images of mirrors in a
    mirror go."""
    taken = [(m.outline.min(axis=0), m.outline.max(axis=0)) for m in known if np.isfinite(m.outline).all()]
    boxes = []
    for h in good:
        corners = np.array([(x, y) for x in h.rectangle[0] for y in h.rectangle[1]])
        pixels = project(h.point + corners @ h.basis[:, :2].T, intrinsics)
        boxes.append((pixels.min(axis=0), pixels.max(axis=0)))
    chosen: list[int] = []
    for i in range(len(good)):
        for low, high in taken + [boxes[j] for j in chosen]:
            size = np.minimum(boxes[i][1], high) - np.maximum(boxes[i][0], low)
            smaller = min(np.prod(boxes[i][1] - boxes[i][0]), np.prod(high - low))
            if size.min() > 0 and np.prod(size) > 0.25 * smaller:
                break
        else:
            chosen.append(i)
    return [good[i] for i in chosen]


def hypotheses(depth: np.ndarray, intrinsics: Intrinsics, settings: DetectionSettings) -> list[Hypothesis]:
    """Verified rectangles, the best first."""
    return _verified(propose(find_rims(depth, intrinsics, settings), settings), depth, intrinsics, settings)


def _verified(
    proposed: list[Hypothesis],
    depth: np.ndarray,
    intrinsics: Intrinsics,
    settings: DetectionSettings,
    known: Iterable[Mirror] = (),
) -> list[Hypothesis]:
    good, points = [], _some(depth, intrinsics) if proposed else None
    for guess in proposed:
        checked = verify(guess, depth, intrinsics, _lowest(points, guess.basis), settings, known)
        if checked is not None:
            good.append(checked)
    good.sort(key=lambda h: -h.score)
    return good


def _ground(depth: np.ndarray, intrinsics: Intrinsics, basis: np.ndarray) -> float:
    """How far down, along the rectangle, readings may belong to a floor [m]."""
    return _lowest(_some(depth, intrinsics), basis)


def _some(depth: np.ndarray, intrinsics: Intrinsics) -> np.ndarray:
    """Every eighth reading along rows and columns as a point, (3, N)."""
    z = depth[::8, ::8]
    v, u = np.nonzero(z)
    z = z[v, u].astype(np.float64)
    return np.stack(((8.0 * u - intrinsics.cx) / intrinsics.fx * z, (8.0 * v - intrinsics.cy) / intrinsics.fy * z, z))


def _lowest(points: np.ndarray, basis: np.ndarray) -> float:
    """:func:`_ground` of points (3, N)."""
    drop = basis[:, 1] @ points
    k = int(0.97 * (len(drop) - 1))
    return float(np.partition(drop, k)[k]) - 0.15 if len(drop) else 0.0
