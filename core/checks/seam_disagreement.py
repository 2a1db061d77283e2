"""Planes that the seams contradict: by how much a mirror would have to move so that the surface goes on across them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..mesh import Mesh
from ..mirror_alignment.pose_solver import MAD, cauchy_weights, weighted_equations
from ..mirror_alignment.seam_alignment import mirrored_views
from ..mirror_alignment.seam_offsets import SeamPieces, seam_pieces, surface_seen_twice
from ..mirrors import Mirror
from ..mirrors.curved_glass import thickness_moves
from ..mirrors.mirror import moved, person_before, reflect, reflection_moves, reflection_shift
from ..views.view_maps import ViewMaps


@dataclass(frozen=True)
class SeamCheckSettings:
    """When seams say that a plane is wrong.

    Parameters
    ----------
    use : bool
    distance : float
        A plane that misplaces a person by less is sound: bow and thickness of glass do as much [m].
    gain : float
        By so much the offsets must be likelier with the plane moved: twice the log of the ratio.
    far, far_gain : float
        The same of a plane that misplaces a person by more than the former, which nothing else explains [m].
    sure : float
        By so much more than another mirror's, else it may as well be that one.
    slope, shift : float
        How far planes may be off, one standard deviation [rad], [m].
    thickness : float
        How thick glass may be whose thickness is not known, one standard deviation [m].
    min_pieces : int
        Of seams with what a mirror shows.
    """

    use: bool = True
    distance: float = 0.014
    gain: float = 8.0
    far: float = 0.028
    far_gain: float = 6.0
    sure: float = 3.0
    slope: float = 0.02
    shift: float = 0.02
    thickness: float = 0.0025
    min_pieces: int = 8


_NOISE, _PER_GAP = 0.003, 0.25  # of a piece's offset: of itself [m], and as a share of its gap
_CORRELATED = 2.0  # neighbouring pieces share so much of their errors that this many count as one
_BIAS, _UNEVEN = 0.003, 0.1  # what all offsets between two views have in common [m], and as a share of gap and bend
_WEIGHINGS = 8
_OUTLIER = 2.0  # deviations, as in ``cauchy_weights``
_LEAST_SCALE = 0.7  # of the noise: neighbouring pieces err alike
_PIECE = 0.12  # length of a piece of a seam [m]


@dataclass(frozen=True)
class SeamDoubt:
    """A plane that seams contradict.

    Parameters
    ----------
    mirror : int
        Its index.
    others : tuple of int
        Mirrors that may as well be the wrong one.
    distance : float
        How far it misplaces a person [m], root mean square.
    gain : float
        How much likelier the offsets are with it moved: twice the log of the ratio.
    """

    mirror: int
    others: tuple[int, ...]
    distance: float
    gain: float


def planes_by_seams(
    mirrors: Sequence[Mirror],
    maps: ViewMaps,
    mesh: Mesh,
    timed: bool | None = False,
    settings: SeamCheckSettings | None = None,
) -> list[SeamDoubt]:
    """The mirrors that seams, and surface that is seen twice, want elsewhere.

    The one that explains most is moved first, another only for what that leaves unexplained: a wrong plane shows in
    the seams of its neighbours, too.

    Parameters
    ----------
    mirrors : sequence of Mirror
        In the order of the views that ``maps`` says are reflected; camera frame.
    maps : ViewMaps
        Of one camera.
    mesh : Mesh
        As :func:`.zipper.zip_patches` leaves it.
    timed : bool or None
        The camera measures time: thick glass delays it; None = not known.

    Notes
    -----
    O(seam triangles), and a few small linear systems.
    """
    settings = settings or SeamCheckSettings()
    behind = mirrored_views(maps)
    if not settings.use or not len(mirrors) or len(maps.to_view) - len(behind) != 1:
        return []
    pieces = seam_pieces(mesh, maps, _PIECE).and_also(surface_seen_twice(maps))
    asked = {k for k, view in enumerate(behind) if (pieces.views == view).sum() >= settings.min_pieces}
    if not asked:
        return []
    evidence = _Evidence(pieces, mirrors, behind, timed is not False, settings)
    chosen: list[int] = []
    cost, x = evidence.fit(chosen)
    found = []
    while asked - set(chosen):
        tried = {k: evidence.fit([*chosen, k]) for k in sorted(asked - set(chosen))}
        gains = {k: cost - fitted[0] for k, fitted in tried.items()}
        best = max(gains, key=lambda k: gains[k])
        far = _moved_by(mirrors[best], tried[best][1][3 * best : 3 * best + 3]) > settings.far
        if gains[best] < (settings.far_gain if far else settings.gain):
            break
        others = tuple(k for k, gain in gains.items() if k != best and gain > gains[best] - settings.sure)
        chosen.append(best)
        found.append((best, others, gains[best]))
        cost, x = tried[best]
    out = []
    for k, others, gain in found:
        distance = _moved_by(mirrors[k], x[3 * k : 3 * k + 3])
        if distance > settings.distance:
            out.append(SeamDoubt(k, others, distance, gain))
    return out


def _moved_by(mirror: Mirror, step: np.ndarray) -> float:
    """How far two slopes and a shift (3,) of a mirror move a person, root mean square [m]."""
    return reflection_shift(person_before(mirror), moved(mirror, step), mirror)


class _Evidence:
    """Offsets of pieces of seams, as they depend on where each of M mirrors is."""

    def __init__(
        self,
        pieces: SeamPieces,
        mirrors: Sequence[Mirror],
        behind: np.ndarray,
        delayed: bool,
        settings: SeamCheckSettings,
    ) -> None:
        self.poses = 3 * len(mirrors)
        moves, thick = np.zeros((len(pieces.gap), self.poses)), np.zeros((len(pieces.gap), 1))
        for k, (mirror, view) in enumerate(zip(mirrors, behind, strict=True)):
            for side, points, sign in ((0, pieces.low, -1.0), (1, pieces.high, 1.0)):
                mine = pieces.views[:, side] == view
                shown, along = reflect(points[mine], mirror), pieces.along[mine]
                moves[mine, 3 * k : 3 * k + 3] += sign * np.einsum("nci,nc->ni", reflection_moves(mirror, shown), along)
                if delayed and mirror.glass_thickness == 0.0:
                    thick[mine, 0] += sign * np.einsum("nc,nc->n", thickness_moves(mirror, points[mine], True), along)
        kinds = np.column_stack((pieces.views, pieces.twice))
        _, pair = np.unique(kinds, axis=0, return_inverse=True)
        pair = np.eye(int(pair.max()) + 1)[pair.ravel()]
        uneven = pair * (pieces.gap * np.sin(pieces.bend))[:, None]
        self.design = np.hstack((moves, pair, uneven, thick))
        self.offset, self.noise = pieces.offset, np.hypot(_NOISE, _PER_GAP * pieces.gap)
        wide = np.tile((settings.slope, settings.slope, settings.shift), len(mirrors))
        shared = np.repeat((_BIAS, _UNEVEN), pair.shape[1])
        self.prior = np.concatenate((wide, shared, (settings.thickness,))) ** -2.0
        # some cameras read silhouettes worse than others
        left = self._left(self.fit(list(range(len(mirrors))))[1])
        self.noise = self.noise * max(MAD * float(np.median(np.abs(left))), _LEAST_SCALE)

    def _left(self, x: np.ndarray) -> np.ndarray:
        return (self.design @ x + self.offset) / self.noise

    def fit(self, free: list[int]) -> tuple[float, np.ndarray]:
        """The least cost with some mirrors ``free`` to move, and the unknowns there (P,)."""
        used = np.arange(self.design.shape[1]) >= self.poses
        for k in free:
            used[3 * k : 3 * k + 3] = True
        A, b = self.design[:, used] / self.noise[:, None], self.offset / self.noise
        x = np.zeros(int(used.sum()))
        for _ in range(_WEIGHINGS):
            equations = weighted_equations(A, -b, cauchy_weights(A @ x + b, 1.0, _CORRELATED))
            x = np.linalg.solve(equations.information + np.diag(self.prior[used]), equations.right)
        whole = np.zeros(len(used))
        whole[used] = x
        unlikely = _OUTLIER**2 * float(np.log1p((self._left(whole) / _OUTLIER) ** 2).sum()) / _CORRELATED
        return unlikely + float(self.prior[used] @ x**2), whole
