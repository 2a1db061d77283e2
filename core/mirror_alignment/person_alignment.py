"""Views of a person must agree: mirrors moved until silhouettes touch and skin coincides, all of them together.

Each two views say something of the mirrors between them: what one shows of the body touches the other's outline
(:mod:`..views.silhouette_contact`), and skin that both show is in one place. A frame in the noise of a few images, or
of which one side is in the picture, leaves its mirror's turn open; the person does not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..camera import Intrinsics, RgbdImage
from ..mirror_detection.person_images import Room, glass_pixels, rooms_about_persons, views_of_person
from ..mirrors import Mirror
from ..mirrors.glass_extent import with_outline
from ..mirrors.mirror import behind_glass, expected_error, moved, reflection_matrix, reflection_moves, with_reason
from ..views.silhouette_contact import Outline, contact_cost, contacts, outline_of
from ..views.view_correspondences import Surfaces, find_correspondences, noise_of, surfaces
from .pose_solver import (
    NormalEquations,
    PoseFit,
    cauchy_weights,
    columns_of,
    corrected,
    solve_pose,
    weighted_equations,
)


@dataclass(frozen=True)
class PersonSettings:
    """When what the views show of a person may move the mirrors.

    Parameters
    ----------
    use : bool
        Off leaves the planes where their frames are.
    uncertainty : float
        Only mirrors that are expected to misplace a person by more than this are moved [m].
    gate : float
        Skin at a larger distance from each other than this is not paired [m]; in the end half of it.
    skin : bool
        Skin that two views show must coincide. Off, only silhouettes say where mirrors are: where light that comes two
        ways falsifies the readings of skin that is seen twice.
    """

    use: bool = True
    uncertainty: float = 0.006
    gate: float = 0.08
    skin: bool = True


_ROUNDS = (3.0, 3.0, 2.0, 1.5, 1.5, 1.0, 1.0, 1.0, 1.0, 1.0)  # times the spread of outlines, each round
_SMALL_TURN, _MOST_TURN, _TURN_STEP = 0.002, 0.05, 0.0015  # [rad]: tried where less is not known, so far, in steps
_SETTLED = 3e-5  # of slopes [rad] and shifts [m]
_MOST_WRONG = 0.15  # share of an image where the camera looks through it
_PIECES = 8000  # of the surface of each view
_FEWEST = 12  # pieces of a surface, rows of an outline that touch, or pairs of skin that say something
_TOUCHING = 0.35  # share of an outline's rows that touch
_SPREAD, _REACH = 1.2, 2.5  # px by which rows stray, and times that from which they do not touch
_ALIKE = 5.0  # neighbouring rows, or pieces, that count as one
_MATCHED, _TIMED = 0.8, 0.3  # px by which all outlines of a camera that matches pictures, or times light, are off,
_OWN, _SHADOWED = 0.35, 0.55  # each of itself, and one beside a shadow: one standard deviation
_OWN_OF_WINDOW, _COMMON_OF_WINDOW = 0.1, 0.2  # the same as shares of a matching window, where that is seen to be wide
_CONTRADICTED = 4.0  # squared distance, in standard deviations, from which a frame is less sure than it says


def align_persons(
    image: RgbdImage, mirrors: list[Mirror], settings: PersonSettings | None = None, baseline: float | None = None
) -> tuple[list[Mirror], tuple[str, ...]]:
    """Mirrors moved until all views of a person agree, weighed against what their frames say.

    Mirrors are solved for together: two slopes and a shift each, the frames' covariances as prior. Of each two views
    the outermost pieces of one's surface beside the other's outline are observations, row by row, and the distances of
    skin that both show. By how much outlines are off, all of them and each of itself, is solved for too. A frame that
    the person contradicts counts as less sure than it says.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m].
    mirrors : list of Mirror
        Those that are sure stay, and are witnesses for the others.
    baseline : float, optional
        Between the camera's two viewpoints [m], 0 where it has one; its shadows tell where that is not known.

    Returns
    -------
    mirrors : list of Mirror
    notes : tuple of str
        None: the mirrors move within what their frames leave open.

    Notes
    -----
    O(H W); nothing is done while every mirror is certain enough.
    """
    settings = settings or PersonSettings()
    unsure = [_movable(m) and expected_error(m) > settings.uncertainty for m in mirrors]
    if not settings.use or not any(unsure):
        return list(mirrors), ()
    image = image.without_color()
    for room in rooms_about_persons(image, baseline):
        if behind_glass(room.figure.middle[None], mirrors)[0]:
            continue  # the person's image
        seen, shows = _seen(mirrors, room)
        free = [k for k, shown in enumerate(shows) if shown and unsure[k]]
        if free:
            return _moved(image, mirrors, free, seen, room.shadow, settings), ()
    return list(mirrors), ()


def _movable(mirror: Mirror) -> bool:
    return mirror.covariance is not None and mirror.rectangle is not None and mirror.source in ("picked", "found")


def _seen(mirrors: list[Mirror], room: Room) -> tuple[np.ndarray, list[bool]]:
    """View of each pixel of the person (H, W) int8, -1 elsewhere, and which mirrors show them."""
    seen = np.full(room.image.depth.shape, -1, np.int8)
    seen[room.person] = 0
    shows = []
    for k, mirror in enumerate(mirrors):
        image = None
        if mirror.rectangle is not None:
            glass = glass_pixels(mirror, room.image.intrinsics)
            image = views_of_person(mirror, glass, room, _MOST_WRONG)
        if image is not None:
            seen[(image == 1) & (seen < 0)] = k + 1
        shows.append(image is not None)
    return seen, shows


def _moved(
    image: RgbdImage, mirrors: list[Mirror], free: list[int], seen: np.ndarray, shadow: float, settings: PersonSettings
) -> list[Mirror]:
    """The mirrors, those ``free`` moved to where views agree, if they are surer then or their frames contradicted."""
    noise = noise_of(image.depth, seen)
    views = range(len(mirrors) + 1)
    shown = [surfaces(image, seen, view, noise, _PIECES) for view in views]
    outlines = [outline_of(image.depth, seen == view, shadow) if (seen == view).any() else None for view in views]
    agreement = _Agreement(
        mirrors, columns_of(free), shown, outlines, image.intrinsics, settings.gate * settings.skin, noise.alike
    )
    solved = agreement.solve(max(_MATCHED if shadow else _TIMED, _COMMON_OF_WINDOW * noise.alike))
    if solved is None:
        return list(mirrors)
    fit, contradicted = solved
    size = 3 * len(free)
    better = corrected(mirrors, agreement.columns, fit.correction[:size], fit.covariance[:size, :size])
    out = list(mirrors)
    for n, k in enumerate(free):
        if contradicted[n] or mirrors[k].turn_by_frame or expected_error(better[k]) < expected_error(mirrors[k]):
            out[k] = with_outline(with_reason(better[k], mirrors[k], "person"), image.intrinsics)
    return out


def _by_frame(mirror: Mirror) -> np.ndarray:
    """The covariance (3, 3) as it was before a person turned the mirror: they must not count twice."""
    covariance = mirror.covariance
    assert covariance is not None  # only such mirrors move
    way = covariance[:, 0] / covariance[0, 0]
    return covariance + np.outer(way, way) * max(mirror.turn_by_frame - covariance[0, 0], 0.0)


@dataclass(frozen=True)
class _Agreement:
    """What views show of a person, as it depends on the mirrors' ``columns`` of a correction.

    A correction (P,) holds two slopes and a shift of each, then by how much all outlines are off, then each side of the
    outline of each pair of views [px]. Readings in a square of so many px as are ``alike`` err alike.
    """

    mirrors: list[Mirror]
    columns: dict[int, slice]
    shown: list[Surfaces]
    outlines: list[Outline | None]
    intrinsics: Intrinsics
    gate: float
    alike: float

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Views of whose surface, by whose outline."""
        views = range(len(self.shown))
        return [
            (of, by) for of in views for by in views
            if of != by and self.outlines[by] is not None and len(self.shown[of].points) >= _FEWEST
            and (of - 1 in self.columns or by - 1 in self.columns)
        ]  # fmt: skip

    def solve(self, bias: float) -> tuple[PoseFit, list[bool]] | None:
        """The most likely correction, and which frames it contradicts; ``bias`` is what all outlines may be off."""
        frames = [np.linalg.inv(_by_frame(self.mirrors[k])) for k in self.columns]
        own = [
            1.0 / max(
                _SHADOWED if side == 0 and outline is not None and outline.shadow else _OWN,
                _OWN_OF_WINDOW * self.alike,
            ) ** 2
            for outline in (self.outlines[by] for _, by in self.pairs) for side in (0, 1)
        ]  # fmt: skip
        size = 3 * len(frames)
        prior = np.diag(np.concatenate((np.zeros(size), (1.0 / bias**2,), own)))
        start, contradicted = np.zeros(len(prior)), [False] * len(frames)
        for mirror, part in self.columns.items():
            start[part] = self._first_turn(mirror)
        for last in (False, True):
            for n, information in enumerate(frames):
                prior[3 * n : 3 * n + 3, 3 * n : 3 * n + 3] = information
            fit = solve_pose(self._observe, prior, _ROUNDS, _SETTLED, start)
            if fit is None or last:
                break
            start = fit.correction
            steps = start[:size].reshape(-1, 3)
            off = [float(step @ information @ step) for step, information in zip(steps, frames, strict=True)]
            contradicted = [distance > _CONTRADICTED for distance in off]
            if not any(contradicted):
                break
            frames = [f / max(1.0, distance / _CONTRADICTED) for f, distance in zip(frames, off, strict=True)]
        return None if fit is None else (fit, contradicted)

    def _first_turn(self, mirror: int) -> np.ndarray:
        """The correction (3,) by which a mirror's image and the direct view touch best: from afar rows mislead."""
        covariance = _by_frame(self.mirrors[mirror])
        deviation = float(np.sqrt(covariance[0, 0]))
        if deviation < _SMALL_TURN:
            return np.zeros(3)
        way, reach = covariance[:, 0] / covariance[0, 0], min(3.0 * deviation, _MOST_TURN)
        turns = np.linspace(-reach, reach, 2 * int(np.ceil(reach / _TURN_STEP)) + 1)
        costs = []
        for turn in turns:
            flip = reflection_matrix(moved(self.mirrors[mirror], way * turn))
            cost = 0.5 * (turn / deviation) ** 2
            for of, by in ((0, mirror + 1), (mirror + 1, 0)):
                outline = self.outlines[by]
                if outline is not None:
                    met = contacts(self.shown[of], flip, outline, self.intrinsics)
                    cost += contact_cost(met.gaps) / max(_ALIKE, self.alike)
            costs.append(cost)
        return way * turns[int(np.argmin(costs))]

    def _observe(self, correction: np.ndarray, widening: float) -> list[NormalEquations] | None:
        at = corrected(self.mirrors, self.columns, correction)
        out = [*self._touching(at, correction, widening), *self._coinciding(at, len(correction), widening)]
        return out or None

    def _touching(self, at: list[Mirror], correction: np.ndarray, widening: float) -> Iterator[NormalEquations]:
        """Equations of the outermost pieces of surfaces beside outlines."""
        flips = [np.eye(4), *(reflection_matrix(m) for m in at)]
        spread, common = widening * _SPREAD, 3 * len(self.columns)
        for n, (of, by) in enumerate(self.pairs):
            outline = self.outlines[by]
            assert outline is not None  # as pairs are chosen
            met = contacts(self.shown[of], flips[by] @ flips[of], outline, self.intrinsics)
            for side in (0, 1):
                own = common + 1 + 2 * n + side
                which = met.rightward == bool(side)
                residuals = met.gaps[which] - correction[common] - correction[own]
                touching = (np.abs(residuals) < _REACH * spread).sum()
                if touching < max(_FEWEST, _TOUCHING * len(residuals)):
                    continue
                jacobian = np.zeros((len(residuals), len(correction)))
                jacobian[:, (common, own)] = 1.0
                points = self.shown[of].points[met.pieces[which]]
                for part, moves in self._across(points, of, by, at, flips):
                    jacobian[:, part] += moves if side else -moves  # gaps are right - u, u - left
                weights = cauchy_weights(residuals, spread**2, max(_ALIKE, self.alike))
                yield weighted_equations(jacobian, residuals, weights)

    def _across(
        self, points: np.ndarray, of: int, by: int, at: list[Mirror], flips: list[np.ndarray]
    ) -> Iterator[tuple[slice, np.ndarray]]:
        """How columns [px] of points (N, 3) of one view, as another sees them, move with the mirrors: (N, 3) each."""
        real = points @ flips[of][:3, :3].T + flips[of][:3, 3]
        x, _, z = (real @ flips[by][:3, :3].T + flips[by][:3, 3]).T
        along = self.intrinsics.fx * np.column_stack((1.0 / z, np.zeros(len(z)), -x / z**2))
        if of - 1 in self.columns:
            moves = reflection_moves(at[of - 1], points)
            yield self.columns[of - 1], np.einsum("nc,nci->ni", along @ flips[by][:3, :3], moves)
        if by - 1 in self.columns:
            yield self.columns[by - 1], np.einsum("nc,nci->ni", along, reflection_moves(at[by - 1], real))

    def _coinciding(self, at: list[Mirror], size: int, widening: float) -> Iterator[NormalEquations]:
        """Equations of skin that two views show both."""
        if not self.gate:
            return
        gate = self.gate * (1.0 if widening > 1.5 else 0.5)
        for m in find_correspondences(at, self.shown, self.intrinsics, gate):
            if not len(m.gaps):
                continue
            jacobian = np.zeros((len(m.gaps), size))
            for view, points, sign in ((m.of, m.here, 1.0), (m.by, m.there, -1.0)):
                if view - 1 in self.columns:
                    moves = np.einsum("nci,nc->ni", reflection_moves(at[view - 1], points), m.normals)
                    jacobian[:, self.columns[view - 1]] += sign * moves
            yield weighted_equations(jacobian, m.gaps, cauchy_weights(m.gaps, m.variances, _ALIKE))
