"""Seams tell how well the mirrors fit: across a gap the skin goes on as it ends, or a mirror is off.

The first Kinect reads no skin twice, so its patches never overlap, and how far a frame stands proud of its glass shows
in nothing but the seams. Over a gap so narrow that the skin bends evenly, the chord between its two ends makes the
same angle with both: it is at right angles to the sum of their normals. What it has along that sum is a step, and
all seams' steps together say how the mirrors should move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
from numba import njit

from .mesh import SEAM, Mesh
from .mirrors import Mirror
from .mirrors.mirror import (
    expected_error,
    moved,
    person_before,
    reflect,
    reflection_matrix,
    reflection_moves,
    reflection_shift,
    with_reason,
)
from .numeric.point_products import transform
from .views.view_maps import ViewMaps


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


_WINDOW = 4  # px to each side over which a normal is averaged
_SAME = 0.05  # readings that lie farther apart are of other surfaces [m]
_TWICE = 0.015  # so near to what another view reads, it is the same skin [m]
_BLOCK, _ALIKE = 16, 0.7  # px across a block of skin that is read twice, and least cosine between both normals
_ROUND = 1.0  # least length of the sum of two ends' normals: across sharper bends nothing is known
_EVEN = 0.7  # cosine between that sum and the way against both lines of sight
_APART = 0.2  # least length of the sum of both lines of sight, beside the seam: of opposite ones nothing is known
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
"""Patches and maps → one mesh with seams, as :func:`.zippering.zip_patches` after :func:`.overlap.part_overlaps`."""


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


@dataclass(frozen=True)
class SeamPieces:
    """Pieces of seams: where their two ends are, and how they face.

    ``low`` and ``high`` (K, 3) the middle of each end [m], ``views`` (K, 2) which views they are of, the lower first,
    ``along`` (K, 3) the unit vectors half way against both lines of sight, beside the seam: where the skin faces, free
    of the normals' noise. ``step`` (K,) the chord's part along the sum of the ends' normals [m], ``gap`` (K,) the
    chord's length [m], ``bend`` (K,) half the angle between the ends' normals [rad]. Of skin that is read twice, too
    (``twice`` (K,)): then ``along`` is its normal, and there is no gap to be bridged and no bend.
    """

    low: np.ndarray
    high: np.ndarray
    views: np.ndarray
    along: np.ndarray
    step: np.ndarray
    gap: np.ndarray
    bend: np.ndarray
    twice: np.ndarray

    def and_also(self, other: SeamPieces) -> SeamPieces:
        """Both together."""
        return SeamPieces(*(np.concatenate((getattr(self, f.name), getattr(other, f.name))) for f in fields(self)))


def seam_pieces(mesh: Mesh, maps: ViewMaps, piece: float = 0.12) -> SeamPieces:
    """Cut the zippered seams into pieces and measure each.

    Seams between skin that both views read are left out: overlaps were brought to one surface and parted, whatever
    the mirrors.

    Parameters
    ----------
    mesh : Mesh
        As :func:`.zippering.zip_patches` leaves it: a seam's triangles follow each other.
    maps : ViewMaps
    piece : float
        Length of a piece [m].

    Notes
    -----
    O(seam triangles).
    """
    seam = mesh.triangles[mesh.kind == SEAM]
    view = mesh.view[seam]
    low, high = view.min(axis=1), view.max(axis=1)
    seam, view = seam[(low >= 0) & (low < high)], view[(low >= 0) & (low < high)]
    low, high = view.min(axis=1), view.max(axis=1)
    two = ((view == low[:, None]) | (view == high[:, None])).all(axis=1)
    seam, view, low, high = seam[two], view[two], low[two], high[two]
    used, seam = np.unique(seam, return_inverse=True)
    seam = seam.reshape(-1, 3)
    points = mesh.vertices[used]
    normals, twice = _ends_kernel(
        points, mesh.view[used], maps.depth, maps.labels, maps.normals, maps.to_view, maps.lens, _WINDOW
    )
    # of each triangle one vertex is at one end and the edge across from it at the other
    at_low = (view == low[:, None]).astype(np.float64)
    weight = [at / at.sum(axis=1, keepdims=True) for at in (at_low, 1.0 - at_low)]
    ends = [np.einsum("tk,tkc->tc", w, points[seam]) for w in weight]
    faces = [np.einsum("tk,tkc->tc", w, normals[seam]) for w in weight]
    known = (np.linalg.norm(normals, axis=1) > 0.5)[seam].all(axis=1) & ~twice[seam].any(axis=1)
    number = _numbered(seam, low, high, 0.5 * (ends[0] + ends[1]), piece)
    number[~known] = -1
    count = np.bincount(number + 1, minlength=2)[1:]

    def mean(values: np.ndarray) -> np.ndarray:
        sums = [np.bincount(number + 1, column, len(count) + 1)[1:] for column in values.T]
        return np.column_stack(sums) / np.maximum(count, 1)[:, None]

    p, q, n, m = (mean(values) for values in (*ends, *faces))
    first = np.full(len(count), -1)
    first[number[known][::-1]] = np.flatnonzero(known)[::-1]
    last = np.full(len(count), -1)
    last[number[known]] = np.flatnonzero(known)
    middle = 0.5 * (ends[0] + ends[1])
    enough = count >= 6
    p, q, n, m, first, last = p[enough], q[enough], n[enough], m[enough], first[enough], last[enough]
    n, m = _unit(n), _unit(m)
    chord, facing = q - p, n + m
    size = np.linalg.norm(facing, axis=1)
    facing = facing / np.maximum(size, 1e-9)[:, None]
    views = np.column_stack((low, high))[first].astype(np.int64)
    # both views lose the skin where it turns away from them: half way between it faces against both lines of sight
    tangent = _unit(middle[last] - middle[first])
    against = -sum(_sight(end, side, maps) for end, side in ((p, views[:, 0]), (q, views[:, 1])))
    against -= (against * tangent).sum(axis=1)[:, None] * tangent
    against *= np.sign((against * facing).sum(axis=1))[:, None]
    even = np.linalg.norm(against, axis=1)
    good = (size > _ROUND) & (even > _APART) & ((against * facing).sum(axis=1) > _EVEN * even)
    bend = 0.5 * np.arccos(np.clip((n * m).sum(axis=1), -1.0, 1.0))
    return SeamPieces(
        p[good],
        q[good],
        views[good],
        _unit(against)[good],
        (chord * facing).sum(axis=1)[good],
        np.linalg.norm(chord, axis=1)[good],
        bend[good],
        np.zeros(int(good.sum()), np.bool_),
    )


def skin_read_twice(maps: ViewMaps, least: int = 12) -> SeamPieces:
    """Blocks of skin that two views read, and how far apart they place it: where patches overlap there is no gap.

    Parameters
    ----------
    maps : ViewMaps
    least : int
        Readings that a block of ``_BLOCK`` × ``_BLOCK`` pixels must have.

    Notes
    -----
    O(pixels of the subject).
    """
    low, high, normal, step, views = _twice_kernel(
        maps.depth, maps.labels, maps.normals, maps.to_view, np.linalg.inv(maps.to_view), maps.lens, least
    )
    none = np.zeros(len(step))
    return SeamPieces(low, high, views, _unit(normal), step, none, none, np.ones(len(step), np.bool_))


def _sight(points: np.ndarray, views: np.ndarray, maps: ViewMaps) -> np.ndarray:
    """Unit vectors (N, 3) along which each point is seen by its view, where the subject really is."""
    turn = maps.to_view[views, :3, :3]
    laid = np.einsum("nij,nj->ni", turn, points) + maps.to_view[views, :3, 3]
    return np.einsum("nji,nj->ni", turn, _unit(laid))


def _numbered(seam: np.ndarray, low: np.ndarray, high: np.ndarray, middle: np.ndarray, piece: float) -> np.ndarray:
    """The piece that each seam triangle belongs to: runs of triangles side by side, cut into equal lengths."""
    if not len(seam):
        return np.empty(0, np.int64)
    shared = (seam[1:, :, None] == seam[:-1, None, :]).sum(axis=(1, 2))
    begins = np.concatenate(([True], (shared < 2) | (low[1:] != low[:-1]) | (high[1:] != high[:-1])))
    run = np.cumsum(begins) - 1
    start = np.flatnonzero(begins)
    far = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(middle, axis=0), axis=1))))
    far -= far[start][run]
    end = np.concatenate((start[1:], [len(seam)])) - 1
    length = far[end]
    parts = np.maximum(np.rint(length / piece), 1.0)
    at = np.minimum(far / np.maximum(length, 1e-9)[run] * parts[run], parts[run] - 1).astype(np.int64)
    first = np.concatenate(([0], np.cumsum(parts[:-1]))).astype(np.int64)
    return first[run] + at


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


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-9)[:, None]


@njit(cache=True, nogil=True)
def _ends_kernel(points, view, depth, labels, normals, to_view, lens, window):
    """Unit normals (N, 3), averaged over the readings around each point in its own view, 0 where there are too few; and
    (N,) whether another view reads the same skin there."""
    height, width = depth.shape
    out, twice = np.zeros((len(points), 3)), np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        for k in range(len(to_view)):
            M = to_view[k]
            x = M[0, 0] * points[i, 0] + M[0, 1] * points[i, 1] + M[0, 2] * points[i, 2] + M[0, 3]
            y = M[1, 0] * points[i, 0] + M[1, 1] * points[i, 1] + M[1, 2] * points[i, 2] + M[1, 3]
            z = M[2, 0] * points[i, 0] + M[2, 1] * points[i, 1] + M[2, 2] * points[i, 2] + M[2, 3]
            if z <= 0.0:
                continue
            u, v = int(np.rint(x / z * lens[k, 0] + lens[k, 2])), int(np.rint(y / z * lens[k, 1] + lens[k, 3]))
            reach = window if k == view[i] else 0
            for row in range(max(v - reach, 0), min(v + reach + 1, height)):
                for column in range(max(u - reach, 0), min(u + reach + 1, width)):
                    if labels[row, column] != k:
                        continue
                    off = abs(depth[row, column] - z)
                    if k != view[i]:
                        twice[i] |= off < _TWICE
                    elif off < _SAME:
                        for c in range(3):
                            out[i, c] += normals[row, column, c]
        length = np.sqrt(out[i, 0] ** 2 + out[i, 1] ** 2 + out[i, 2] ** 2)
        for c in range(3):
            out[i, c] = out[i, c] / length if length > 3.0 else 0.0
    return out, twice


@njit(cache=True, nogil=True)
def _twice_kernel(depth, labels, normals, to_view, from_view, lens, least):
    """Means over blocks of pixels of a view and over what a later view reads of the same skin: both places (K, 3), the
    sums of both normals (K, 3), how far the latter lies before the former along these (K,), and the views (K, 2)."""
    height, width = depth.shape
    count = len(to_view)
    rows, columns = (height + _BLOCK - 1) // _BLOCK, (width + _BLOCK - 1) // _BLOCK
    room = rows * columns * count
    low, high, normal = np.empty((room, 3)), np.empty((room, 3)), np.empty((room, 3))
    steps = np.empty(room)
    views = np.empty((room, 2), np.int64)
    sums, number = np.empty((count, count, 10)), np.empty((count, count), np.int64)
    p, laid = np.empty(3), np.empty(3)
    n = 0
    for block in range(rows * columns):
        top, left = block // columns * _BLOCK, block % columns * _BLOCK
        sums[:], number[:] = 0.0, 0
        for v in range(top, min(top + _BLOCK, height), 2):
            for u in range(left, min(left + _BLOCK, width), 2):
                a = labels[v, u]
                if a < 0 or a >= count - 1:
                    continue
                z = depth[v, u]
                x, y = (u - lens[a, 2]) / lens[a, 0] * z, (v - lens[a, 3]) / lens[a, 1] * z
                for r in range(3):
                    p[r] = from_view[a, r, 0] * x + from_view[a, r, 1] * y + from_view[a, r, 2] * z + from_view[a, r, 3]
                for b in range(a + 1, count):
                    for r in range(3):
                        laid[r] = to_view[b, r, 3]
                        for c in range(3):
                            laid[r] += to_view[b, r, c] * p[c]
                    if laid[2] <= 0.0:
                        continue
                    column = int(np.rint(laid[0] / laid[2] * lens[b, 0] + lens[b, 2]))
                    row = int(np.rint(laid[1] / laid[2] * lens[b, 1] + lens[b, 3]))
                    if row < 0 or column < 0 or row >= height or column >= width or labels[row, column] != b:
                        continue
                    other = depth[row, column]
                    if abs(other - laid[2]) > _SAME:
                        continue
                    alike = 0.0
                    for c in range(3):
                        alike += normals[v, u, c] * normals[row, column, c]
                    if alike < _ALIKE:
                        continue
                    x, y = (column - lens[b, 2]) / lens[b, 0] * other, (row - lens[b, 3]) / lens[b, 1] * other
                    number[a, b] += 1
                    ahead, size = 0.0, 0.0
                    for r in range(3):
                        q = (
                            from_view[b, r, 0] * x + from_view[b, r, 1] * y + from_view[b, r, 2] * other
                            + from_view[b, r, 3]
                        )  # fmt: skip
                        facing = normals[v, u, r] + normals[row, column, r]
                        ahead += (q - p[r]) * facing
                        size += facing * facing
                        sums[a, b, r] += p[r]
                        sums[a, b, 3 + r] += q
                        sums[a, b, 6 + r] += facing
                    sums[a, b, 9] += ahead / np.sqrt(size)
        for a in range(count):
            for b in range(a + 1, count):
                if number[a, b] < least:
                    continue
                for r in range(3):
                    low[n, r], high[n, r] = sums[a, b, r] / number[a, b], sums[a, b, 3 + r] / number[a, b]
                    normal[n, r] = sums[a, b, 6 + r]
                steps[n] = sums[a, b, 9] / number[a, b]
                views[n, 0], views[n, 1] = a, b
                n += 1
    return low[:n], high[:n], normal[:n], steps[:n], views[:n]
