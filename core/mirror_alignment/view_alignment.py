"""Views that show the same surface must agree: mirrors moved until they do, and told when they do not.

Neighbouring mirrors show much of a person's back twice, and some of it shows directly too. A mirror whose frame is
narrow, noisy or half hidden may be sure to some centimetres only; what it shows beside another view ties it down.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..camera import Intrinsics, unproject
from ..mirrors import Mirror
from ..mirrors.mirror import expected_error, moved, reflection_moves, with_reason
from ..views.ray_sorting import sort_rays
from ..views.view_correspondences import Meeting, Surfaces, meetings, noise_of, views_of


@dataclass(frozen=True)
class AgreementSettings:
    """When what two views show of the same surface may move the mirrors.

    Parameters
    ----------
    use : bool
        Off leaves the planes where their frames are.
    unsure : float
        Mirrors are only moved when one is expected to misplace a person by more than this [m].
    gate : float
        Surfaces farther apart than this are not taken for one another [m].
    gain : float
        The step is made only when the log likelihood of pairs it was not fitted to grows by this much.
    min_pairs : int
        Of surface points seen both ways.
    """

    use: bool = True
    unsure: float = 0.005
    gate: float = 0.10
    gain: float = 0.5
    min_pairs: int = 40


def agree(
    mirrors: list[Mirror], depth: np.ndarray, intrinsics: Intrinsics, settings: AgreementSettings | None = None
) -> list[Mirror]:
    """Mirrors moved until the views agree on what they show twice, weighed against how sure each frame's plane is.

    All mirrors are solved for together: two slopes and a shift each, the frames' covariances as prior, the distances of
    surfaces seen twice as observations. The pairs are split into two sets of image blocks; what one asks for must make
    the other more likely, or all stay.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        Fused depth, z [m].

    Returns
    -------
    list of Mirror
        With what they are now known to in their covariances; as they were when that cannot be shown to help.

    Notes
    -----
    O(pixels behind glass); nothing is done while every frame is sure enough.
    """
    settings = settings or AgreementSettings()
    free = [m.covariance is not None and m.rectangle is not None and m.source != "rig file" for m in mirrors]
    if not settings.use or not any(
        f and expected_error(m) > settings.unsure for m, f in zip(mirrors, free, strict=True)
    ):
        return list(mirrors)
    seen = sort_rays(unproject(depth, intrinsics), mirrors)[0]
    sigma = noise_of(depth, seen)
    shown = views_of(mirrors, depth, seen, intrinsics, sigma)
    index = np.cumsum([0, *(3 * f for f in free)])
    prior = np.zeros((index[-1], index[-1]))
    for k, mirror in enumerate(mirrors):
        if free[k]:
            prior[index[k] : index[k] + 3, index[k] : index[k] + 3] = np.linalg.inv(mirror.covariance)

    def placed(step: np.ndarray) -> list[Mirror]:
        return [
            moved(m, step[index[k] : index[k] + 3]) if free[k] else m for k, m in enumerate(mirrors)
        ]  # fmt: skip

    nothing = np.zeros(index[-1])

    def solve(half: int, start: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        step = start
        first = 0 if start is nothing else 2
        for turn in range(first, 6):
            at = placed(step)
            gate = settings.gate if turn < 2 else 0.6 * settings.gate
            information, right, count = prior.copy(), -prior @ step, 0
            for m in meetings(at, shown, intrinsics, gate):
                mine = slice(None) if half < 0 else m.half == half
                gaps = m.gaps[mine]
                if not len(gaps):
                    continue
                count += len(gaps)
                rows = np.zeros((len(gaps), index[-1]))
                for view, points, sign in ((m.of, m.here[mine], 1.0), (m.by, m.there[mine], -1.0)):
                    if view and free[view - 1]:
                        moves = np.einsum("nci,nc->ni", reflection_moves(at[view - 1], points), m.normals[mine])
                        rows[:, index[view - 1] : index[view - 1] + 3] += sign * moves
                weight = _weights(gaps, m.variances[mine], shown, m)
                information += (rows * weight[:, None]).T @ rows
                right += (rows * weight[:, None]).T @ gaps
            if count < settings.min_pairs:
                return None
            change = np.linalg.solve(information, right)
            step = step + change
            if turn >= 2 and np.abs(change).max() < 1e-4:
                break
        return step, np.linalg.inv(information)

    def likelihood(step: np.ndarray, half: int) -> float:
        total = 0.0
        for m in meetings(placed(step), shown, intrinsics, settings.gate):
            mine = m.half == half
            r = m.gaps[mine] ** 2 / m.variances[mine]
            # a pair that is lost to the gate counts as one at it
            total -= float(np.log1p(r).sum()) / _shared(shown, m)
            total -= (
                m.before / 2 * np.log1p(settings.gate**2 / max(np.median(m.variances), 1e-6)) / _shared(shown, m)
                if len(m.variances)
                else 0.0
            )
        return total

    whole = solve(-1, nothing)
    if whole is None:
        return list(mirrors)
    before = [likelihood(nothing, half) for half in (0, 1)]
    if sum(likelihood(whole[0], half) - before[half] for half in (0, 1)) < settings.gain:
        return list(mirrors)  # what does not make all pairs together more likely need not be asked of the halves
    halves = [solve(half, whole[0]) for half in (0, 1)]
    if None in halves:
        return list(mirrors)
    gains = [likelihood(halves[1 - half][0], half) - before[half] for half in (0, 1)]
    if sum(gains) < settings.gain or min(gains) < 0.0:
        return list(mirrors)
    step, covariance = whole
    parts = [slice(index[k], index[k + 1]) for k in range(len(mirrors))]
    return [
        with_reason(replace(m, covariance=covariance[part, part]), old, "views") if f else m
        for m, old, f, part in zip(placed(step), mirrors, free, parts, strict=True)
    ]


def _shared(shown: list[Surfaces], m: Meeting) -> float:
    """How many neighbouring pieces, which share pixels and errors, count as one."""
    s, t = shown[m.of], shown[m.by]
    return 2.0 * max((2 * s.radius + 1) / s.stride, (2 * t.radius + 1) / t.stride) ** 2


def _weights(gaps: np.ndarray, variances: np.ndarray, shown: list[Surfaces], m: Meeting) -> np.ndarray:
    return 1.0 / (variances * (1.0 + gaps * gaps / (4.0 * variances))) / _shared(shown, m)
