"""Views that show the same surface must agree: mirrors moved until they do.

Neighbouring mirrors show much of a person's back twice, and some of it shows directly too. A mirror whose frame is
narrow, noisy or half hidden may be known to a few centimetres only; what it shares with another view fixes it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera import Intrinsics, RgbdImage, unproject
from ..mirrors import Mirror
from ..mirrors.mirror import expected_error, reflection_moves, with_reason
from ..views.ray_sorting import sort_rays
from ..views.view_correspondences import Correspondences, Surfaces, find_correspondences, noise_of, surfaces_of_views
from .pose_solver import (
    ALL,
    NormalEquations,
    PoseFit,
    cauchy_weights,
    columns_of,
    confirmed_fit,
    corrected,
    each_gains,
    frames_prior,
    gain,
    solve_pose,
    weighted_equations,
)

_GATES = (1.0, 1.0, 0.6, 0.6, 0.6, 0.6)  # times the gate, each round: the first two bring the surfaces near
_SETTLED = 1e-4  # of slopes [rad] and shifts [m]
_LEAST_VARIANCE = 1e-6  # of a distance of two surfaces [m²]


@dataclass(frozen=True)
class AgreementSettings:
    """When what two views show of the same surface may move the mirrors.

    Parameters
    ----------
    use : bool
        Off leaves the planes where their frames are.
    uncertainty : float
        Mirrors are only moved when one is expected to misplace a person by more than this [m].
    gate : float
        Surfaces at a larger distance from each other than this are not paired [m].
    gain : float
        The correction is made only when the log likelihood of pairs it was not fitted to grows by this much.
    min_pairs : int
        Of surface points seen both ways.
    """

    use: bool = True
    uncertainty: float = 0.005
    gate: float = 0.10
    gain: float = 0.5
    min_pairs: int = 40


def align_views(
    image: RgbdImage, mirrors: list[Mirror], settings: AgreementSettings | None = None
) -> tuple[list[Mirror], tuple[str, ...]]:
    """Mirrors moved until the views agree on what they show twice, weighed against what their frames say.

    Mirrors are solved for together: two slopes and a shift each, the frames' covariances as prior, the distances of
    surfaces seen twice as observations. The pairs are split into two sets of image blocks; what one asks for must make
    the other more likely, or all stay. A mirror that shares too little with the direct view and with mirrors that are
    sure stays: two that are unsure could agree with each other at the body's expense.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m].

    Returns
    -------
    mirrors : list of Mirror
        With what they are now known to in their covariances; as they were when that cannot be shown to help.
    notes : tuple of str
        None: the mirrors move within what their frames leave open.

    Notes
    -----
    O(pixels behind glass); nothing is done while every frame is certain enough.
    """
    depth, intrinsics = image.depth, image.intrinsics
    settings = settings or AgreementSettings()
    if not settings.use or not any(_movable(m) and expected_error(m) > settings.uncertainty for m in mirrors):
        return list(mirrors), ()
    seen = sort_rays(unproject(depth, intrinsics), mirrors)[0]
    shown = surfaces_of_views(image, mirrors, seen, noise_of(depth, seen))
    out = list(mirrors)
    free = {k for k, m in enumerate(mirrors) if _movable(m)}
    while True:  # a mirror that is sure now is a witness for the next
        sure = [not expected_error(m) > settings.uncertainty for m in out]
        columns = columns_of(k for k in _witnessed(out, sure, shown, intrinsics, settings) if k in free)
        free -= set(columns)
        if all(sure[k] for k in columns):
            break
        better = _agreed(_Pairs(out, columns, shown, intrinsics, sure), settings)
        if better is None:
            break
        out = better
    return [m if m is old else with_reason(m, old, "views") for m, old in zip(out, mirrors, strict=True)], ()


def _movable(mirror: Mirror) -> bool:
    return mirror.covariance is not None and mirror.rectangle is not None and mirror.source != "rig file"


def _witnessed(
    mirrors: list[Mirror], sure: list[bool], shown: list[Surfaces], intrinsics: Intrinsics, settings: AgreementSettings
) -> list[int]:
    """The mirrors that may move.

    Two that are both unsure can agree with each other and be both wrong: each must share enough surface with a witness,
    the direct view or a mirror that is sure.
    """
    witnesses = {0, *(k + 1 for k, known in enumerate(sure) if known)}
    pairs = dict.fromkeys(range(1, len(mirrors) + 1), 0)
    for m in find_correspondences(mirrors, shown, intrinsics, settings.gate):
        for view, other in ((m.of, m.by), (m.by, m.of)):
            if other in witnesses and view > 0:
                pairs[view] += len(m.gaps)
    return [k for k in range(len(mirrors)) if pairs[k + 1] >= settings.min_pairs]


def _agreed(pairs: _Pairs, settings: AgreementSettings) -> list[Mirror] | None:
    """The mirrors moved until they agree; None where that cannot be shown to help."""
    prior = frames_prior([pairs.mirrors[k] for k in pairs.columns])
    gates = [settings.gate * share for share in _GATES]

    def fit(which: int, whole: PoseFit | None) -> PoseFit | None:
        def observe(correction: np.ndarray, gate: float) -> list[NormalEquations] | None:
            return pairs.equations(correction, gate, which, settings.min_pairs)

        if whole is None:
            return solve_pose(observe, prior, gates, _SETTLED)
        return solve_pose(observe, prior, gates[_GATES.count(1.0) :], _SETTLED, whole.correction)

    def cost(correction: np.ndarray, half: int) -> float:
        return pairs.cost(correction, settings.gate, half)

    found = confirmed_fit(
        fit,
        cost,
        lambda before, after: each_gains(before, after, settings.gain),
        lambda before, after: gain(before, after) >= settings.gain,
    )
    if found is None:
        return None
    whole, _ = found
    return corrected(pairs.mirrors, pairs.columns, whole.correction, whole.covariance)


@dataclass(frozen=True)
class _Pairs:
    """Pieces of surface that two views show both, as they depend on the mirrors' ``columns`` of a correction."""

    mirrors: list[Mirror]
    columns: dict[int, slice]
    shown: list[Surfaces]
    intrinsics: Intrinsics
    sure: list[bool]

    def equations(self, correction: np.ndarray, gate: float, which: int, fewest: int) -> list[NormalEquations] | None:
        """Normal equations of the pairs of one half, or ``ALL``, about a correction (P,); None of fewer pairs."""
        at = corrected(self.mirrors, self.columns, correction)
        out, count = [], 0
        for m in find_correspondences(at, self.shown, self.intrinsics, gate):
            mine = slice(None) if which == ALL else m.half == which
            gaps = m.gaps[mine]
            if not len(gaps) or not self._tied(m):
                continue
            count += len(gaps)
            jacobian = np.zeros((len(gaps), len(correction)))
            for view, points, sign in ((m.of, m.here[mine], 1.0), (m.by, m.there[mine], -1.0)):
                if view - 1 in self.columns:
                    moves = np.einsum("nci,nc->ni", reflection_moves(at[view - 1], points), m.normals[mine])
                    jacobian[:, self.columns[view - 1]] += sign * moves
            weights = cauchy_weights(gaps, m.variances[mine], self._correlated(m))
            out.append(weighted_equations(jacobian, gaps, weights))
        return out if count >= fewest else None

    def cost(self, correction: np.ndarray, gate: float, half: int) -> float:
        """How unlikely the pairs of a half are after a correction (P,): their negative log likelihood."""
        total = 0.0
        for m in find_correspondences(
            corrected(self.mirrors, self.columns, correction), self.shown, self.intrinsics, gate
        ):
            if not self._tied(m):
                continue
            mine = m.half == half
            total += float(np.log1p(m.gaps[mine] ** 2 / m.variances[mine]).sum()) / self._correlated(m)
            if len(m.variances):  # a pair that is lost to the gate counts as one at it
                lost = np.log1p(gate**2 / max(np.median(m.variances), _LEAST_VARIANCE))
                total += m.before / 2 * lost / self._correlated(m)
        return total

    def _tied(self, m: Correspondences) -> bool:
        """Whether nothing but what moves, the direct view and mirrors that are sure have part in it."""
        return not any(view > 0 and view - 1 not in self.columns and not self.sure[view - 1] for view in (m.of, m.by))

    def _correlated(self, m: Correspondences) -> float:
        """How many neighbouring pieces, which share pixels and errors, count as one."""
        s, t = self.shown[m.of], self.shown[m.by]
        return 2.0 * max((2 * s.radius + 1) / s.stride, (2 * t.radius + 1) / t.stride) ** 2
