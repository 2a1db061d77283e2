"""Rectangles that straight depth edges may belong to."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .edge_segments import BOTTOM, LEFT, RIGHT, TOP, DetectionSettings, Segment


@dataclass(frozen=True)
class Hypothesis:
    """A rectangle that may be a mirror, and what speaks for it.

    ``basis`` columns are right, down and the normal towards the camera; ``rectangle`` ((right min, max), (down min,
    max)) about ``point`` [m]; ``sides`` the edges by side; ``shown`` and ``violated`` shares of the readings in it.
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
    """Rectangles that two edges span: a standing and a lying one that meet, or two that run side by side."""
    if len(segments) < 2:
        return []
    edges = _Edges(segments)
    place = {id(segment): k for k, segment in enumerate(segments)}
    out, seen = [], set()
    pairs = _pairs(edges, settings, LEFT, RIGHT) | _pairs(edges, settings, TOP, BOTTOM)
    together = np.zeros_like(pairs)  # edges that are sides of one rectangle by now
    for which in (_corners(edges), pairs):
        for i, j in np.argwhere(which):
            if which is pairs and together[i, j]:
                continue
            guess = _hypothesis({segments[i].side: segments[i], segments[j].side: segments[j]})
            guess = guess and _completed(guess, segments, edges, settings)
            if guess is not None and (key := tuple(sorted(place[id(s)] for s in guess.sides.values()))) not in seen:
                seen.add(key)  # the same rectangle comes from each of its corners
                together[np.ix_(key, key)] = True
                out.append(guess)
    return out


class _Edges:
    """Segments as arrays: side (N,), points (N, 2, 3), direction (N, 3), length (N,)."""

    def __init__(self, segments: list[Segment]) -> None:
        self.side = np.array([s.side for s in segments])
        self.points = np.array([s.points for s in segments])
        self.direction = np.array([s.direction for s in segments])
        self.length = np.array([s.length for s in segments])


def _corners(edges: _Edges) -> np.ndarray:
    """(N, N): row is a left or right edge, column a top or bottom one, and they meet in space at a right angle."""
    upright = (edges.side == LEFT) | (edges.side == RIGHT)
    down, right = edges.direction[:, None], edges.direction[None, :]
    top = (edges.side == TOP)[None, :]
    corner = np.where(top[..., None], edges.points[:, None, 0], edges.points[:, None, 1])
    left = (edges.side == LEFT)[:, None]
    other = np.where(left[..., None], edges.points[None, :, 0], edges.points[None, :, 1])
    normal = np.cross(right, down)
    size = np.linalg.norm(normal, axis=2)
    offset = other - corner
    along_down, along_right = (offset * down).sum(axis=2), (offset * right).sum(axis=2)
    middle = edges.points.mean(axis=1)
    inside = middle[None, :] - middle[:, None]
    fits = upright[:, None] & ~upright[None, :] & (size > 0.977)
    fits &= ((inside * right).sum(axis=2) > 0) == left
    fits &= ((inside * down).sum(axis=2) < 0) == top
    # the lines pass each other closely; where each ends may be hidden
    fits &= np.abs((normal * offset).sum(axis=2)) < 0.03 * corner[..., 2] * size
    fits &= np.abs(along_down) < 0.10 + 0.25 * edges.length[:, None]
    return fits & (np.abs(along_right) < 0.10 + 0.25 * edges.length[None, :])


def _pairs(edges: _Edges, settings: DetectionSettings, one: int, other: int) -> np.ndarray:
    """(N, N): row is an edge on side ``one``, column one on the other side, parallel and side by side."""
    down = edges.direction[:, None] + edges.direction[None, :]
    down /= np.maximum(np.linalg.norm(down, axis=2, keepdims=True), 1e-9)
    middle = edges.points.mean(axis=1)
    across = middle[None, :] - middle[:, None]
    across = across - (across * down).sum(axis=2, keepdims=True) * down
    width = np.linalg.norm(across, axis=2)
    start = np.einsum("nc,nmc->nm", edges.points[:, 0], down), np.einsum("mc,nmc->nm", edges.points[:, 0], down)
    stop = np.einsum("nc,nmc->nm", edges.points[:, 1], down), np.einsum("mc,nmc->nm", edges.points[:, 1], down)
    shared = np.minimum(*stop) - np.maximum(*start)
    fits = (edges.side == one)[:, None] & (edges.side == other)[None, :]
    fits &= edges.direction @ edges.direction.T > 0.985
    fits &= (settings.min_size < width) & (width < settings.max_size) & (across[..., 0 if one == LEFT else 1] > 0)
    return fits & (shared > 0.6 * np.maximum(edges.length[:, None], edges.length[None, :]))


def _hypothesis(sides: dict[int, Segment]) -> Hypothesis | None:
    """Plane through the sides' ends, each weighing by its length.

    Down is where those that stand point, or across those that lie.
    """
    points = np.concatenate([np.linspace(s.points[0], s.points[1], max(2, int(20 * s.length))) for s in sides.values()])
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
    guess: Hypothesis, segments: list[Segment], edges: _Edges, settings: DetectionSettings
) -> Hypothesis | None:
    """The rectangle with all edges that lie on it, refitted; None when it is no mirror's size."""
    for _ in range(2):
        missing = [side for side in range(4) if side not in guess.sides]
        added = {side: _fourth(side, guess, segments, edges, settings) for side in missing}
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
    side: int, guess: Hypothesis, segments: list[Segment], edges: _Edges, settings: DetectionSettings
) -> Segment | None:
    """The segment on the guessed plane that best ends at the corners with the sides that are known."""
    axis = 0 if side in (LEFT, RIGHT) else 1  # basis column that the side stands across
    inward = -1.0 if side in (LEFT, BOTTOM) else 1.0  # along that column; it points left, or down
    tolerance = 0.015 * guess.point[2] + 0.01
    opposite = guess.sides.get(_OPPOSITE[side])
    across = [guess.sides[k] for k in ((TOP, BOTTOM) if axis == 0 else (LEFT, RIGHT)) if k in guess.sides]
    best, cost = None, np.inf
    flat = np.abs((edges.points - guess.point) @ guess.basis[:, 2]).max(axis=1) < tolerance
    along = np.abs(edges.direction @ guess.basis[:, 1 - axis]) > 0.985
    for k in np.flatnonzero((edges.side == side) & flat & along):
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
