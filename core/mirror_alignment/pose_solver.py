"""The poses of mirrors by least squares: two slopes and a shift each, held by what their frames say.

Each aligner says how its observations depend on the poses; what they have in common is here: the frames' prior, the
rounds in which observations are looked up and weighed anew, and that two halves of them must confirm each other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from ..mirrors import Mirror
from ..mirrors.mirror import moved

ALL, HALVES = -1, (0, 1)
"""Which observations a fit may use."""

MAD = 1.4826
"""Standard deviation of normal noise over its median absolute deviation."""

_OUTLIER = 2.0  # standard deviations: from there on an observation's weight falls fast

Judgement = TypeVar("Judgement")


@dataclass(frozen=True)
class PoseFit:
    """Slopes [rad] and shifts [m], ``correction`` (P,), and their ``covariance`` (P, P)."""

    correction: np.ndarray
    covariance: np.ndarray


class NormalEquations(NamedTuple):
    """What observations say of the correction: JᵀWJ, ``information`` (P, P), and JᵀWr, ``right`` (P,)."""

    information: np.ndarray
    right: np.ndarray


def weighted_equations(jacobian: np.ndarray, residuals: np.ndarray, weights: np.ndarray) -> NormalEquations:
    """Normal equations of independent observations.

    Parameters
    ----------
    jacobian : np.ndarray [shape=(N, P)]
        How a correction lessens the residuals.
    residuals, weights : np.ndarray [shape=(N,)]
        A weight is 1 / variance, for outliers less.
    """
    weighted = (jacobian * weights[:, None]).T
    return NormalEquations(weighted @ jacobian, weighted @ residuals)


def correlated_equations(jacobian: np.ndarray, residuals: np.ndarray, covariance: np.ndarray) -> NormalEquations:
    """As :func:`weighted_equations`, of a few observations with a ``covariance`` (N, N)."""
    weighted = np.linalg.solve(covariance, jacobian)
    return NormalEquations(jacobian.T @ weighted, weighted.T @ residuals)


def cauchy_weights(residuals: np.ndarray, variances: np.ndarray | float, correlated: float) -> np.ndarray:
    """Weights (N,) of observations of known variances, of which so many neighbours, ``correlated``, count as one."""
    return 1.0 / (variances * (1.0 + residuals * residuals / (_OUTLIER**2 * variances))) / correlated


def scaled_cauchy_weights(residuals: np.ndarray, least_noise: float, correlated: float) -> np.ndarray:
    """As :func:`cauchy_weights`, where the noise is known from the residuals only; it is at least ``least_noise``."""
    noise = max(MAD * float(np.median(np.abs(residuals))), least_noise)
    return 1.0 / (1.0 + (residuals / noise) ** 2) / noise**2 / correlated


def columns_of(free: Iterable[int]) -> dict[int, slice]:
    """Index of each mirror that may move → where its two slopes and its shift are in a correction."""
    return {mirror: slice(3 * n, 3 * n + 3) for n, mirror in enumerate(free)}


def frames_prior(frames: Sequence[Mirror], glass_offsets: Sequence[float] | np.ndarray | None = None) -> np.ndarray:
    """Information matrix (3F, 3F) of what the frames of F mirrors say of their poses.

    Parameters
    ----------
    frames : sequence of Mirror
        With covariances, none of them singular.
    glass_offsets : sequence of float, optional
        How far each glass may lie off the plane of its frame, one standard deviation [m]; 0 by default.
    """
    prior = np.zeros((3 * len(frames), 3 * len(frames)))
    for n, mirror in enumerate(frames):
        offset = 0.0 if glass_offsets is None else glass_offsets[n]
        part = slice(3 * n, 3 * n + 3)
        prior[part, part] = np.linalg.inv(mirror.covariance + np.diag((0.0, 0.0, offset**2)))
    return prior


def corrected(
    mirrors: Sequence[Mirror], columns: dict[int, slice], correction: np.ndarray, covariance: np.ndarray | None = None
) -> list[Mirror]:
    """The mirrors, those in ``columns`` moved by their part of ``correction`` (P,), known to ``covariance`` (P, P)."""
    out = list(mirrors)
    for mirror, part in columns.items():
        out[mirror] = moved(out[mirror], correction[part])
        if covariance is not None:
            out[mirror] = replace(out[mirror], covariance=covariance[part, part])
    return out


def solve_pose(
    observe: Callable[[np.ndarray, float], Iterable[NormalEquations] | None],
    prior: np.ndarray,
    gates: Sequence[float],
    tolerance: float = 0.0,
    start: np.ndarray | None = None,
    linear_after: np.ndarray | None = None,
) -> PoseFit | None:
    """The most likely correction: Gauss-Newton, with outliers weighed anew each round.

    Parameters
    ----------
    observe : callable(correction, gate)
        Normal equations of the observations about ``correction`` (P,), those within ``gate``; None when they are too
        few.
    prior : np.ndarray [shape=(P, P)]
        Information on the correction, of which 0 is most likely.
    gates : sequence of float
        One a round.
    tolerance : float
        With the last gate, when nothing changes by as much, it is done [rad], [m].
    start : np.ndarray [shape=(P,)], optional
        By default no correction.
    linear_after : np.ndarray [shape=(P,)], optional
        The observations are linear: ``observe`` uses ``correction`` for the weights only, and its equations hold about
        none. The prior holds about the correction that was made before this one: what is given here.
    """
    correction = np.zeros(len(prior)) if start is None else start
    for gate in gates:
        observed = observe(correction, gate)
        if observed is None:
            return None
        about = correction if linear_after is None else np.zeros(len(prior))
        information, right = prior.copy(), -prior @ (about if linear_after is None else linear_after)
        for equations in observed:
            information += equations.information
            right += equations.right
        change = np.linalg.solve(information, right)
        correction = about + change
        if gate == gates[-1] and np.abs(change).max() < tolerance:
            break
    return PoseFit(correction, np.linalg.inv(information))


def confirmed_fit(
    fit: Callable[[int, PoseFit | None], PoseFit | None],
    judge: Callable[[np.ndarray, int], Judgement],
    confirms: Callable[[list[Judgement], list[Judgement]], bool],
    promises: Callable[[list[Judgement], list[Judgement]], bool] | None = None,
    before: list[Judgement] | None = None,
) -> tuple[PoseFit, list[PoseFit]] | None:
    """The fit to all observations and those to each half of them; None where the halves do not confirm each other.

    Parameters
    ----------
    fit : callable(which, whole)
        The fit to some of the observations, ``ALL`` or a half; for a half also the fit to all is given, to start from.
        None when they are too few.
    judge : callable(correction, half)
        How well the observations of a half fit after a correction.
    confirms : callable(before, after)
        Of the judgements of both halves: without a correction, and after that which the other half asks for.
    promises : callable(before, after), optional
        The same after the correction that all ask for: where this does not help, the halves need not be asked.
    before : list, optional
        The judgements without a correction, where they are known.
    """
    whole = fit(ALL, None)
    if whole is None:
        return None
    if before is None:
        before = judged(judge, np.zeros(len(whole.correction)))
    if promises is not None and not promises(before, judged(judge, whole.correction)):
        return None
    halves = [found for half in HALVES if (found := fit(half, whole)) is not None]
    if len(halves) < len(HALVES):
        return None
    after = [judge(halves[1 - half].correction, half) for half in HALVES]
    return (whole, halves) if confirms(before, after) else None


def judged(judge: Callable[[np.ndarray, int], Judgement], correction: np.ndarray) -> list[Judgement]:
    """The judgement of each half on one correction."""
    return [judge(correction, half) for half in HALVES]


def gain(before: list[float], after: list[float]) -> float:
    """By how much the costs of both halves together fall."""
    return sum(cost - left for cost, left in zip(before, after, strict=True))


def each_gains(before: list[float], after: list[float], least: float) -> bool:
    """No half's cost grows, and both together fall by ``least``; false where a cost is not a number."""
    gains = [cost - left for cost, left in zip(before, after, strict=True)]
    return min(gains) >= 0.0 and sum(gains) >= least
