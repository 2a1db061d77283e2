"""Seams show how well the mirrors fit: across a gap the surface continues as it ends, or a mirror is off.

The first Kinect sees no surface twice, so its patches never overlap, and only the seams reveal how far a frame projects
in front of its glass. Over a gap so narrow that the surface bends evenly, the chord between its two ends makes the same
angle with both: it is at right angles to the sum of their normals. What it has along that sum is an offset, and all
seams' offsets together say how the mirrors should move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..errors import Notice
from ..mesh import Mesh
from ..mirrors import Mirror
from ..mirrors.mirror import (
    expected_error,
    person_before,
    reflect,
    reflection_matrix,
    reflection_moves,
    reflection_shift,
    with_reason,
)
from ..numeric.point_products import transform
from ..views.view_maps import ViewMaps
from .pose_solver import (
    ALL,
    MAD,
    NormalEquations,
    PoseFit,
    cauchy_weights,
    columns_of,
    confirmed_fit,
    corrected,
    frames_prior,
    solve_pose,
    weighted_equations,
)
from .seam_offsets import SeamPieces, seam_pieces, surface_seen_twice


@dataclass(frozen=True)
class SeamSettings:
    """When the seams may move the mirrors.

    Parameters
    ----------
    use : bool
        Off leaves the planes where they are.
    uncertainty : float
        A mirror that is expected to misplace a person by more than this [m] goes where the seams say; one that its
        frame places better must be shown to be off.
    offset : float
        How far the glass may well lie off the frame's plane, one standard deviation [m].
    max_shift, max_slope : float
        Bounds of the whole correction [m], [rad].
    confidence : float
        A mirror that is not so uncertain is moved only when that moves a person by so many times as much as it leaves
        uncertain.
    min_pieces : int
        Of seams, each about ``piece`` [m] long.
    piece : float
        Over this length the noise of normals is averaged [m].
    rounds : int
        How often mirrors are moved and zippered anew at most.
    """

    use: bool = True
    uncertainty: float = 0.008
    offset: float = 0.01
    max_shift: float = 0.03
    max_slope: float = 0.02
    confidence: float = 2.5
    min_pieces: int = 12
    piece: float = 0.12
    rounds: int = 4


_OFFSET_NOISE, _OFFSET_PER_GAP = 0.003, 0.25  # noise of a piece's offset: of itself [m], and as a share of its gap
_CORRELATED = 2.0  # neighbouring pieces share so much of their errors that this many count as one
_BIAS, _UNEVEN = 0.002, 0.2  # what all offsets between two views have in common [m], and as a share of gap and bend
_WEIGHINGS = 10  # rounds in which outliers are weighed anew
_SETTLED = 5e-4  # of slopes [rad] and shifts [m]
_CHANCE = 0.1  # so few offsets may be larger than their noise: then there is nothing to gain
_FITS = 1.5  # times their noise: by more the offsets must not be off in the end, else it is not the mirrors
_EACH_ROUND = 0.6  # of the confidence that a move needs, each round must show
_IN_FRONT = 0.004  # so far a glass may lie in front of its frame: stuck onto a board [m]
_MOVED = 1e-6  # at the person, else it is where it was [m]
_FEWEST = 4  # pieces that can be halved
_LEAST_DEVIATION, _MOST_DEVIATION = 1e-6, 1.0  # of slopes [rad] and shifts [m], one standard deviation
_PERSON_DISTANCE = 1.5  # of a person from the glass, see ``person_before`` [m]
_SHIFTED = 0.7  # of a move at the person that must come from the shift, else the mirror is rotated above all


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
    """Mirrors moved until the seams between their patches show no offsets; as they were when that is not shown to help.

    All mirrors are solved for together: two slopes and a shift each, the frames' covariances (and ``offset``) as
    prior, the offsets of the seams' pieces as observations. What all offsets between two views have in common, of
    itself or in proportion to how sharply the gap bends, counts as the views' own: silhouettes are read unevenly. A
    mirror that its frame places well is judged by itself: if it is not shown to be off, or its glass would lie clearly
    in front of its frame, both count as level, and the others are solved for anew. The mirrors are moved, the patches
    zippered anew, and so on. Two halves of the pieces are set against each other: what one asks for must lessen the
    other's offsets; and in the end they must fit. Where silhouettes are read so badly that no seam fits, only surface
    that is seen twice is used.

    Parameters
    ----------
    mirrors : list of Mirror
        In the order of the views that ``maps`` says are reflected.
    patches : list of Mesh
        One a view, before overlaps are cut; camera frame.
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
        Not moved, too, when several cameras take part: errors of their poses would show in the seams as well.
    notes : tuple of str
        What was moved, for the user.
    """
    settings = settings or SeamSettings()
    behind = mirrored_views(maps)
    free = [k for k, m in enumerate(mirrors) if _movable(m)]
    if not settings.use or not free or len(maps.to_view) - len(behind) != 1:
        return list(mirrors), ()
    rig = _rig(mirrors, free, behind, len(maps.to_view), settings, glass_offset)
    # some cameras read silhouettes so badly that no seam fits: surface that they see twice may still do
    at = _settled(rig, patches, maps, mesh, join) or _settled(rig, patches, maps, None, None)
    if at is None:
        return list(mirrors), ()
    notes = []
    for k, doubted in zip(free, rig.doubted, strict=True):
        if at[k] is not mirrors[k]:
            distance = reflection_shift(person_before(mirrors[k]), at[k], mirrors[k])
            notes.append(_note(mirrors[k], at[k], distance, doubted, glass_offset))
            at[k] = with_reason(at[k], mirrors[k], "seams")
    return at, tuple(notes)


@dataclass(frozen=True)
class _Rig:
    """The mirrors as they were given, and what is known of the F that may move.

    ``free`` (F,) their indices, ``frames`` they with proper covariances, ``doubted`` (F,) which are expected to
    misplace a person, ``framed`` (F,) which were placed by their frames, which may project in front of the glass;
    ``behind`` (M,) the view of each mirror, ``columns`` (V,) where the pose of each view's mirror begins in a
    correction, -1 = it does not move.
    """

    mirrors: list[Mirror]
    free: list[int]
    frames: list[Mirror]
    doubted: np.ndarray
    framed: np.ndarray
    behind: np.ndarray
    columns: np.ndarray
    settings: SeamSettings
    glass_offset: float

    def prior(self, projecting: np.ndarray) -> np.ndarray:
        """What the frames say (3F, 3F), those ``projecting`` (F,) less exactly of the shift of their glass."""
        return frames_prior(self.frames, projecting * self.settings.offset)

    def placed(self, correction: np.ndarray, covariance: np.ndarray, moving: np.ndarray) -> list[Mirror]:
        """All mirrors, those ``moving`` (F,) corrected."""
        columns = {k: part for (k, part), moves in zip(columns_of(self.free).items(), moving, strict=True) if moves}
        return corrected(self.mirrors, columns, correction, covariance)

    def shifts(self, at: list[Mirror]) -> np.ndarray:
        """How far each of the mirrors that may move was moved, at a person (F,) [m]."""
        return np.array([reflection_shift(person_before(self.mirrors[k]), at[k], self.mirrors[k]) for k in self.free])

    def confidence(self, at: list[Mirror]) -> np.ndarray:
        """The same in units of what is left uncertain (F,)."""
        shifts = zip(self.free, self.shifts(at), strict=True)
        return np.array([shift / expected_error(at[k]) if shift > 0.0 else 0.0 for k, shift in shifts])

    def in_front(self, at: list[Mirror]) -> np.ndarray:
        """Whether each glass would lie clearly in front of its frame (F,)."""
        depths = np.array([_depth(self.mirrors[k], at[k]) for k in self.free])
        return -depths - self.glass_offset > _IN_FRONT


def _rig(
    mirrors: list[Mirror], free: list[int], behind: np.ndarray, views: int, settings: SeamSettings, glass_offset: float
) -> _Rig:
    frames = [_with_proper_covariance(mirrors[k]) for k in free]
    columns = np.full(views, -1)
    columns[behind[free]] = 3 * np.arange(len(free))
    return _Rig(
        list(mirrors),
        free,
        frames,
        np.array([expected_error(m) > settings.uncertainty for m in frames]),
        np.array([_by_its_frame(m) for m in frames]),
        behind,
        columns,
        settings,
        glass_offset,
    )


def _settled(
    rig: _Rig, patches: list[Mesh], maps: ViewMaps, mesh: Mesh | None, join: Joiner | None
) -> list[Mirror] | None:
    """The mirrors where all evidence, or without a ``mesh`` only surface that is seen twice, wants them.

    None when that is not shown to help.
    """
    settings = rig.settings
    at, correction, projecting, costs = rig.mirrors, np.zeros(3 * len(rig.free)), rig.framed, []
    for iteration in range(settings.rounds):
        pieces = _evidence(mesh, maps, settings)
        if len(pieces.gap) < max(settings.min_pieces, _FEWEST):
            return None
        left = np.abs(pieces.offset) / _noise(pieces)
        if iteration == 0 and not rig.doubted.any() and np.mean(left > 1.0) < _CHANCE:
            return None
        costs.append(np.log1p(left**2).mean())
        jacobian = _jacobian(pieces, at, rig.behind, rig.columns, len(correction))
        before, old = correction, at
        fit, correction, at, projecting = _joint_fit(rig, pieces, jacobian, before, projecting)
        if not (rig.doubted | projecting).any():
            return None
        if iteration == 0 and not _confirmed(fit, pieces, jacobian, rig.prior(projecting)):
            return None
        if (np.abs(correction.reshape(-1, 3)) > (settings.max_slope, settings.max_slope, settings.max_shift)).any():
            return None
        if iteration == settings.rounds - 1 or np.abs(correction - before).max() < _SETTLED:
            break
        motions = [reflection_matrix(new) @ reflection_matrix(m) for new, m in zip(at, old, strict=True)]
        patches, maps = move_views(patches, maps, rig.behind, motions)
        if mesh is not None:
            assert join is not None  # they are given together
            mesh = join(patches, maps)
    if costs[-1] >= costs[0] or np.median(left) > _FITS:
        return None
    last = correction - before  # what still changed is not settled
    covariance = fit.covariance + np.outer(last, last)
    return _kept(rig, rig.placed(correction, covariance, rig.doubted | projecting))


def _evidence(mesh: Mesh | None, maps: ViewMaps, settings: SeamSettings) -> SeamPieces:
    twice = surface_seen_twice(maps)
    return twice if mesh is None else seam_pieces(mesh, maps, settings.piece).and_also(twice)


def _joint_fit(
    rig: _Rig, pieces: SeamPieces, jacobian: np.ndarray, before: np.ndarray, projecting: np.ndarray
) -> tuple[PoseFit, np.ndarray, list[Mirror], np.ndarray]:
    """The further correction of all mirrors, ``before`` (3F,) made already.

    Solved for anew as long as frames that might be ``projecting`` (F,) turn out to be level with their glass.

    Returns the fit, the whole correction (3F,), the mirrors there, and which frames may still be projecting (F,).
    """
    while True:
        fit = _fit_offsets(pieces, jacobian, rig.prior(projecting), before)
        moving = rig.doubted | projecting
        correction = (before + fit.correction) * np.repeat(moving, 3)
        at = rig.placed(correction, fit.covariance, moving)
        not_shown = rig.in_front(at) | (rig.confidence(at) < _EACH_ROUND * rig.settings.confidence)
        level = projecting & ~rig.doubted & not_shown
        if not level.any():
            return fit, correction, at, projecting
        projecting = projecting & ~level


def _kept(rig: _Rig, at: list[Mirror]) -> list[Mirror] | None:
    """The mirrors of which enough is known where they were moved, the others where they were; None when that is all."""
    at = list(at)
    certain = rig.doubted | (rig.confidence(at) >= rig.settings.confidence)
    for k, known, shift in zip(rig.free, certain, rig.shifts(at), strict=True):
        if not known or shift < _MOVED:  # no seam of its view says anything, or not enough
            at[k] = rig.mirrors[k]
    return at if any(new is not old for new, old in zip(at, rig.mirrors, strict=True)) else None


def _depth(old: Mirror, new: Mirror) -> float:
    """How far behind the middle of one mirror the plane of another lies [m]."""
    middle = person_before(old).mean(axis=0) - _PERSON_DISTANCE * old.normal
    return float((middle - new.point) @ new.normal)


def _note(old: Mirror, new: Mirror, distance: float, doubted: bool, glass_offset: float) -> Notice:
    """What is reported of a move by ``distance`` [m] at a person; from where the glass was taken to be."""
    depth, name, distance_mm, about = _depth(old, new), old.name, 1000.0 * distance, [old.name]
    if doubted:
        return Notice(
            "{name}: the seams between its reflection and the other views show an offset; its plane, which its frame "
            "alone leaves uncertain, was moved by {distance:.0f} mm at the person",
            name=name,
            distance=distance_mm,
            mirrors=about,
        )
    if old.moved_by or 2.0 * abs(depth) < _SHIFTED * distance:  # not where its frame is; or rotated above all
        return Notice(
            "{name}: the seams between its reflection and the other views show an offset; its plane was moved by "
            "{distance:.0f} mm at the person",
            name=name,
            distance=distance_mm,
            mirrors=about,
        )
    depth += glass_offset
    if depth > 0.0:
        return Notice(
            "{name}: the seams between its reflection and the other views show an offset; its plane was moved by "
            "{distance:.0f} mm at the person, as if its glass were {depth:.0f} mm behind the front of its frame",
            name=name, distance=distance_mm, depth=1000.0 * depth, mirrors=about,
        )  # fmt: skip
    return Notice(
        "{name}: the seams between its reflection and the other views show an offset; its plane was moved by "
        "{distance:.0f} mm at the person, as if its glass were {depth:.0f} mm in front of its frame",
        name=name, distance=distance_mm, depth=-1000.0 * depth, mirrors=about,
    )  # fmt: skip


def _movable(mirror: Mirror) -> bool:
    known = mirror.covariance is not None and bool(np.isfinite(mirror.covariance).all())
    return known and mirror.source in ("picked", "found")


def _by_its_frame(mirror: Mirror) -> bool:
    """It was placed by its frame, of which the glass may lie behind, and not by the figure in it alone."""
    return mirror.refined or mirror.source == "picked"


def _with_proper_covariance(mirror: Mirror) -> Mirror:
    """Its covariance made symmetric, with no direction more certain than a fit can be, nor less than any mirror."""
    covariance = mirror.covariance
    assert covariance is not None  # else it is not movable
    values, axes = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return replace(mirror, covariance=(axes * np.clip(values, _LEAST_DEVIATION**2, _MOST_DEVIATION**2)) @ axes.T)


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
        rotation = np.eye(4)
        rotation[:3, :3] = motion[:3, :3]
        mine = maps.labels == view
        normals[mine] = transform(maps.normals[mine], rotation)
    return patches, replace(maps, to_view=to_view, normals=normals)


def _jacobian(
    pieces: SeamPieces, mirrors: list[Mirror], behind: np.ndarray, columns: np.ndarray, count: int
) -> np.ndarray:
    """How the pieces' offsets change with the slopes and shifts of the mirrors that may move (K, ``count``)."""
    rows = np.zeros((len(pieces.gap), count))
    for mirror, view in zip(mirrors, behind, strict=True):
        if columns[view] < 0:
            continue
        for side, points, sign in ((0, pieces.low, -1.0), (1, pieces.high, 1.0)):
            mine = pieces.views[:, side] == view
            moves = reflection_moves(mirror, reflect(points[mine], mirror))
            part = slice(columns[view], columns[view] + 3)
            rows[mine, part] += sign * np.einsum("nci,nc->ni", moves, pieces.along[mine])
    return rows


def _fit_offsets(
    pieces: SeamPieces, jacobian: np.ndarray, prior: np.ndarray, before: np.ndarray, chosen: np.ndarray | None = None
) -> PoseFit:
    """The further correction that lessens the (``chosen``) pieces' offsets most, ``before`` (P,) that made so far.

    What the offsets between two views have in common is solved for as well.
    """
    if chosen is None:
        chosen = np.ones(len(pieces.gap), np.bool_)
    kinds = np.column_stack((pieces.views, pieces.twice))[chosen]
    _, pair = np.unique(kinds, axis=0, return_inverse=True)
    pair = np.eye(pair.max() + 1)[pair.ravel()]
    uneven = pair * (pieces.gap * np.sin(pieces.bend))[chosen, None]
    noise = _noise(pieces)[chosen]
    A = np.hstack((jacobian[chosen], pair, uneven)) / noise[:, None]
    b = pieces.offset[chosen] / noise
    count, pairs = len(prior), pair.shape[1]
    weak = np.zeros((A.shape[1],) * 2)
    weak[:count, :count] = prior
    weak[range(count, len(weak)), range(count, len(weak))] = np.repeat((_BIAS**-2, _UNEVEN**-2), pairs)

    def observe(x: np.ndarray, _: float) -> list[NormalEquations]:
        return [weighted_equations(A, -b, cauchy_weights(A @ x + b, 1.0, _CORRELATED))]

    made = np.append(before, np.zeros(len(weak) - count))
    fit = solve_pose(observe, weak, (np.inf,) * _WEIGHINGS, linear_after=made)
    assert fit is not None  # the observations are never too few
    left = float(np.median(np.abs(A @ fit.correction + b)))
    scale = max(1.0, MAD * left)  # some cameras read silhouettes worse than others
    return PoseFit(fit.correction[:count], scale**2 * fit.covariance[:count, :count])


def _noise(pieces: SeamPieces) -> np.ndarray:
    return np.hypot(_OFFSET_NOISE, _OFFSET_PER_GAP * pieces.gap)


def _confirmed(whole: PoseFit, pieces: SeamPieces, jacobian: np.ndarray, prior: np.ndarray) -> bool:
    """What each half of the pieces asks for lessens the offsets of the other."""
    first = np.arange(len(pieces.gap)) // 2 % 2 == 0
    parts = first, ~first

    def fit(which: int, _: PoseFit | None) -> PoseFit:
        if which == ALL:
            return whole
        return _fit_offsets(pieces, jacobian, prior, np.zeros(len(prior)), parts[which])

    def cost(correction: np.ndarray, half: int) -> float:
        left = (pieces.offset + jacobian @ correction) / _noise(pieces)
        return float(np.log1p(left[parts[half]] ** 2).sum())

    def confirms(before: list[float], after: list[float]) -> bool:
        return all(left < cost for left, cost in zip(after, before, strict=True))

    return confirmed_fit(fit, cost, confirms) is not None
