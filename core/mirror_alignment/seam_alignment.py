"""Seams tell how well the mirrors fit: across a gap the skin goes on as it ends, or a mirror is off.

The first Kinect reads no skin twice, so its patches never overlap, and how far a frame stands proud of its glass shows
in nothing but the seams. Over a gap so narrow that the skin bends evenly, the chord between its two ends makes the
same angle with both: it is at right angles to the sum of their normals. What it has along that sum is a step, and
all seams' steps together say how the mirrors should move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..mesh import Mesh
from ..mirrors import Mirror
from ..mirrors.mirror import (
    expected_error,
    moved,
    person_before,
    reflect,
    reflection_matrix,
    reflection_moves,
    reflection_shift,
    with_reason,
)
from ..numeric.point_products import transform
from ..views.view_maps import ViewMaps
from .seam_offsets import SeamPieces, seam_pieces, skin_read_twice


@dataclass(frozen=True)
class SeamSettings:
    """When the seams may move the mirrors.

    Parameters
    ----------
    use : bool
        Off leaves the planes where they are.
    unsure : float
        A mirror that is expected to misplace a person by more than this [m] goes where the seams say; one that its
        frame places better must be shown to be off.
    offset : float
        How far the glass may well lie off the frame's plane, one standard deviation [m].
    max_shift, max_slope : float
        Bounds of the whole step [m], [rad].
    sure : float
        A mirror that is not unsure is moved only when that moves a person by so many times as much as it leaves
        unsure.
    min_pieces : int
        Of seams, each about ``piece`` [m] long.
    piece : float
        Over this length the noise of normals is averaged [m].
    rounds : int
        How often mirrors are moved and zippered anew at most.
    """

    use: bool = True
    unsure: float = 0.008
    offset: float = 0.01
    max_shift: float = 0.03
    max_slope: float = 0.02
    sure: float = 2.5
    min_pieces: int = 12
    piece: float = 0.12
    rounds: int = 4


_STEP, _BEND = 0.003, 0.25  # noise of a piece's step: of itself [m], and as a share of its gap
_SHARED = 2.0  # neighbouring pieces share so much of their errors that this many count as one
_BIAS, _UNEVEN = 0.002, 0.2  # what all steps between two views may have in common [m], and as a share of gap and bend
_SETTLED = 5e-4  # of slopes [rad] and shifts [m]
_CHANCE = 0.1  # so few steps may be larger than their noise: then there is nothing to gain
_FITS = 1.5  # times their noise: by more the steps must not be off in the end, else it is not the mirrors
_BEGUN = 0.6  # of what makes a step sure, each round must show
_BEFORE = 0.004  # so far a glass may lie before the front of its frame: stuck onto a board [m]
_MOVED = 1e-6  # at the person, else it is where it was [m]
_FEWEST = 4  # pieces that can be halved
_SUREST, _LEAST_SURE = 1e-6, 1.0  # of slopes [rad] and shifts [m], one standard deviation


Joiner = Callable[[list[Mesh], ViewMaps], Mesh]
"""Patches and maps → one mesh with seams, as :func:`.zipper.zip_patches` after :func:`.overlap.part_overlaps`."""


def align_seams(
    mirrors: list[Mirror],
    patches: list[Mesh],
    maps: ViewMaps,
    mesh: Mesh,
    join: Joiner,
    settings: SeamSettings | None = None,
    glass_offset: float = 0.0,
) -> tuple[list[Mirror], tuple[str, ...]]:
    """Mirrors moved until the seams between their patches show no steps; as they were when that is not sure to help.

    All mirrors are solved for together: two slopes and a shift each, the frames' covariances (and ``offset``) as
    prior, the steps of the seams' pieces as observations. What all steps between two views have in common, of itself
    or in proportion to how sharply the gap bends, counts as the views' own: silhouettes are read unevenly. A mirror
    that its frame places well is judged by itself: if it is not shown to be off, or its glass would lie clear before
    its frame, both count as level, and the others are solved for anew. The mirrors are moved, the patches zippered
    anew, and so on. Two halves of the pieces are set against each other: what one asks for must lessen the other's
    steps; and in the end they must fit. Where silhouettes are read so badly that no seam fits, skin that is read twice
    is asked alone.

    Parameters
    ----------
    mirrors : list of Mirror
        In the order of the views that ``maps`` says are reflected.
    patches : list of Mesh
        One a view, before overlaps are parted; camera frame.
    maps : ViewMaps
    mesh : Mesh
        What ``join`` makes of them.
    join : callable(patches, maps)
        Called once a round, and only when the first round shows that the mirrors are off.
    glass_offset : float
        How far behind the front of its frame each glass was taken to be [m].

    Returns
    -------
    mirrors : list of Mirror
        Not moved, too, when several cameras take part: how they stand to each other would show in the seams as well.
    notes : tuple of str
        What was moved, for the user.
    """
    settings = settings or SeamSettings()
    behind = mirrored_views(maps)
    free = [k for k, m in enumerate(mirrors) if _movable(m)]
    if not settings.use or not free or len(maps.to_view) - len(behind) != 1:
        return list(mirrors), ()
    frames = [replace(mirrors[k], covariance=_proper(mirrors[k].covariance)) for k in free]
    doubted = np.array([expected_error(m) > settings.unsure for m in frames])
    framed = np.array([_by_its_frame(m) for m in frames])
    column = np.full(len(maps.to_view), -1)
    column[behind[free]] = 3 * np.arange(len(free))
    parts = [slice(3 * n, 3 * n + 3) for n in range(len(free))]

    def prior(proud: np.ndarray) -> np.ndarray:
        out = np.zeros((3 * len(free),) * 2)
        for part, m, off in zip(parts, frames, proud, strict=True):
            out[part, part] = np.linalg.inv(m.covariance + np.diag((0.0, 0.0, off * settings.offset**2)))
        return out

    def placed(step: np.ndarray, covariance: np.ndarray, free_to_move: np.ndarray) -> list[Mirror]:
        out = list(mirrors)
        for k, part, moves in zip(free, parts, free_to_move, strict=True):
            if moves:
                out[k] = replace(moved(mirrors[k], step[part]), covariance=covariance[part, part])
        return out

    def sureness(at: list[Mirror]) -> np.ndarray:
        """How far each mirror moves people, in units of what is left unsure."""
        apart = [reflection_shift(person_before(mirrors[k]), at[k], mirrors[k]) for k in free]
        return np.array([a / expected_error(at[k]) if a > 0.0 else 0.0 for a, k in zip(apart, free, strict=True)])

    def settled(seams: bool) -> list[Mirror] | None:
        """The mirrors where all evidence, or only skin that is read twice, wants them; None when that is not sure."""
        step, at, costs, moving, seen, sewn = np.zeros(3 * len(free)), list(mirrors), [], patches, maps, mesh
        proud = framed
        for turn in range(settings.rounds):
            pieces = skin_read_twice(seen)
            if seams:
                pieces = seam_pieces(sewn, seen, settings.piece).and_also(pieces)
            if len(pieces.gap) < max(settings.min_pieces, _FEWEST):
                return None
            left = np.abs(pieces.step) / _noise(pieces)
            if turn == 0 and not doubted.any() and np.mean(left > 1.0) < _CHANCE:
                return None
            costs.append(np.log1p(left**2).mean())
            rows = _moves(pieces, at, behind, column, len(step))
            done, old = step, at
            while True:
                change, covariance = _solve(pieces, rows, prior(proud), done)
                step = (done + change) * np.repeat(doubted | proud, 3)
                at = placed(step, covariance, doubted | proud)
                ahead = [-_depth(mirrors[k], at[k]) - glass_offset > _BEFORE for k in free]
                flush = proud & ~doubted & (np.array(ahead) | (sureness(at) < _BEGUN * settings.sure))
                if not flush.any():
                    break
                proud = proud & ~flush
            if not (doubted | proud).any() or (turn == 0 and not _agreed(pieces, rows, prior(proud))):
                return None
            if (np.abs(step.reshape(-1, 3)) > (settings.max_slope, settings.max_slope, settings.max_shift)).any():
                return None
            if turn == settings.rounds - 1 or np.abs(step - done).max() < _SETTLED:
                break
            motions = [reflection_matrix(new) @ reflection_matrix(m) for new, m in zip(at, old, strict=True)]
            moving, seen = move_views(moving, seen, behind, motions)
            sewn = join(moving, seen) if seams else sewn
        if costs[-1] >= costs[0] or np.median(left) > _FITS:
            return None
        last = step - done
        at = placed(step, covariance + np.outer(last, last), doubted | proud)  # what still changed is not settled
        for k, sure in zip(free, doubted | (sureness(at) >= settings.sure), strict=True):
            # no seam of its view told anything, or not enough
            if not sure or reflection_shift(person_before(mirrors[k]), at[k], mirrors[k]) < _MOVED:
                at[k] = mirrors[k]
        return at if any(new is not old for new, old in zip(at, mirrors, strict=True)) else None

    # some cameras read silhouettes so badly that no seam fits: what they read twice may still do
    at = settled(seams=True) or settled(seams=False)
    if at is None:
        return list(mirrors), ()
    notes = []
    for k, unsure in zip(free, doubted, strict=True):
        if at[k] is not mirrors[k]:
            apart = reflection_shift(person_before(mirrors[k]), at[k], mirrors[k])
            notes.append(_note(mirrors[k], at[k], apart, unsure, glass_offset))
            at[k] = with_reason(at[k], mirrors[k], "seams")
    return at, tuple(notes)


def _depth(old: Mirror, new: Mirror) -> float:
    """How far behind the middle of one mirror the plane of another lies [m]."""
    middle = person_before(old).mean(axis=0) - 1.5 * old.normal
    return float((middle - new.point) @ new.normal)


def _note(old: Mirror, new: Mirror, apart: float, unsure: bool, glass_offset: float) -> str:
    """What the user is told of a move by ``apart`` [m] at a person; from where the glass was taken to be."""
    depth = _depth(old, new)
    if unsure:
        return (
            f"{old.name}: the seams between its reflection and the other views show a step; its plane, which is not "
            f"known well from what is seen of its frame, was moved by {1000.0 * apart:.0f} mm at the person"
        )
    if old.moved_by or 2.0 * abs(depth) < 0.7 * apart:  # it is not where its frame is; or it is turned above all
        return (
            f"{old.name}: the seams between its reflection and the other views show a step; its plane was moved by "
            f"{1000.0 * apart:.0f} mm at the person"
        )
    depth += glass_offset
    return (
        f"{old.name}: the seams between its reflection and the other views show a step; its plane was moved by "
        f"{1000.0 * apart:.0f} mm at the person, as if its glass lay {1000.0 * abs(depth):.0f} mm "
        f"{'behind' if depth > 0.0 else 'before'} the front of its frame"
    )


def _movable(mirror: Mirror) -> bool:
    known = mirror.covariance is not None and bool(np.isfinite(mirror.covariance).all())
    return known and mirror.source in ("picked", "found")


def _by_its_frame(mirror: Mirror) -> bool:
    """It was placed by its frame, of which the glass may lie behind, and not by the figure in it alone."""
    return mirror.refined or mirror.source == "picked"


def _proper(covariance: np.ndarray) -> np.ndarray:
    """The covariance made symmetric, with no direction surer than a fit can be, nor less sure than any mirror."""
    values, axes = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return (axes * np.clip(values, _SUREST**2, _LEAST_SURE**2)) @ axes.T


def mirrored_views(maps: ViewMaps) -> np.ndarray:
    """Indices (M,) of the views that are reflections, in the order of the mirrors."""
    return np.flatnonzero(np.linalg.det(maps.to_view[:, :3, :3]) < 0)


def move_views(
    patches: list[Mesh], maps: ViewMaps, behind: np.ndarray, motions: list[np.ndarray]
) -> tuple[list[Mesh], ViewMaps]:
    """Patches and maps of the views ``behind`` moved rigidly (4, 4), as when their mirrors are."""
    patches, to_view, normals = list(patches), maps.to_view.copy(), maps.normals.copy()
    for view, motion in zip(behind, motions, strict=True):
        patches[view] = patches[view].transformed(motion)
        to_view[view] = to_view[view] @ np.linalg.inv(motion)
        turn = np.eye(4)
        turn[:3, :3] = motion[:3, :3]
        mine = maps.labels == view
        normals[mine] = transform(maps.normals[mine], turn)
    return patches, replace(maps, to_view=to_view, normals=normals)


def _moves(pieces: SeamPieces, mirrors: list[Mirror], behind: np.ndarray, column: np.ndarray, count: int) -> np.ndarray:
    """How the pieces' steps change with the free mirrors' slopes and shifts (K, ``count``)."""
    rows = np.zeros((len(pieces.gap), count))
    for mirror, view in zip(mirrors, behind, strict=True):
        if column[view] < 0:
            continue
        for side, points, sign in ((0, pieces.low, -1.0), (1, pieces.high, 1.0)):
            mine = pieces.views[:, side] == view
            moves = reflection_moves(mirror, reflect(points[mine], mirror))
            part = slice(column[view], column[view] + 3)
            rows[mine, part] += sign * np.einsum("nci,nc->ni", moves, pieces.along[mine])
    return rows


def _solve(
    pieces: SeamPieces, rows: np.ndarray, prior: np.ndarray, done: np.ndarray, chosen: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The further step that lessens the (``chosen``) pieces' steps most, ``done`` the one so far; and its covariance.

    Least squares with Cauchy's weights; what the steps between two views have in common is solved for as well."""
    if chosen is None:
        chosen = np.ones(len(pieces.gap), np.bool_)
    kinds = np.column_stack((pieces.views, pieces.twice))[chosen]
    _, pair = np.unique(kinds, axis=0, return_inverse=True)
    pair = np.eye(pair.max() + 1)[pair.ravel()]
    uneven = pair * (pieces.gap * np.sin(pieces.bend))[chosen, None]
    noise = _noise(pieces)[chosen]
    A = np.hstack((rows[chosen], pair, uneven)) / noise[:, None]
    b = pieces.step[chosen] / noise
    count, pairs = len(prior), pair.shape[1]
    weak = np.zeros((A.shape[1],) * 2)
    weak[:count, :count] = prior
    weak[range(count, len(weak)), range(count, len(weak))] = np.repeat((_BIAS**-2, _UNEVEN**-2), pairs)
    start = np.zeros(len(weak))
    start[:count] = -done
    x = np.zeros(len(weak))
    for _ in range(10):
        weight = 1.0 / (1.0 + ((A @ x + b) / 2.0) ** 2) / _SHARED
        information = (A * weight[:, None]).T @ A + weak
        x = np.linalg.solve(information, weak @ start - (A * weight[:, None]).T @ b)
    scale = max(1.0, 1.4826 * float(np.median(np.abs(A @ x + b))))  # some cameras read silhouettes worse than others
    return x[:count], scale**2 * np.linalg.inv(information)[:count, :count]


def _noise(pieces: SeamPieces) -> np.ndarray:
    return np.hypot(_STEP, _BEND * pieces.gap)


def _agreed(pieces: SeamPieces, rows: np.ndarray, prior: np.ndarray) -> bool:
    """What each half of the pieces asks for lessens the steps of the other."""
    half = np.arange(len(pieces.gap)) // 2 % 2 == 0
    nothing = np.zeros(len(prior))
    for mine in (half, ~half):
        step = _solve(pieces, rows, prior, nothing, mine)[0]
        apart = [
            np.log1p((s / _noise(pieces))[~mine] ** 2).sum() for s in (pieces.step, pieces.step + rows @ step)
        ]  # fmt: skip
        if apart[1] >= apart[0]:
            return False
    return True
