"""What a phase-measuring camera reads where light arrives by several ways: a weighted mean over its frequencies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..numeric.kernels import njit
from ..numeric.threads import each

LIGHT_SPEED = 299_792_458.0

_LOWEST, _HIGHEST, _SPACING = 10e6, 330e6, 8e6  # frequencies that a camera may modulate its light with [Hz]
_ROUNDS = 3  # of the robust fit
_UNITY = 400.0  # how much the weights' sum is held to 1, relative to the noise of a reading [1/m²]
_PIECES = 2  # readings are predicted in so many pieces, side by side
_SMALLEST = 0.02  # weights below are left out: of no effect
_RATIO_ERROR, _LENGTH_ERROR = 0.15, 0.01  # of what is predicted: share of the ratio, difference of the ways [m]

CORRECTABLE = 0.004
"""What a predicted bias may be wrong by, up to which a reading is corrected [m]."""
UNLEARNT = 0.05
"""Ratio of light beyond which a reading is thrown away when the response could not be learnt."""
NOTICEABLE = 0.025
"""Ratio of light below which the bias stays under the noise."""


@dataclass(frozen=True)
class PhaseResponse:
    """How a camera turns the phases of its modulated light into a distance.

    The camera measures, at each frequency, the phase of the sum of the light of all ways, and takes a weighted mean
    (Bhandari et al. 2014, Freedman et al. 2014: the model of two paths). ``weights`` need not add up to 1: a factor
    common to all stands for what the light's ratio was misjudged by.

    Parameters
    ----------
    frequencies : np.ndarray [shape=(F,)]
        [Hz].
    weights : np.ndarray [shape=(F,)]
    """

    frequencies: np.ndarray
    weights: np.ndarray

    def bias(self, ratio: np.ndarray, longer: np.ndarray) -> np.ndarray:
        """How much too far a reading is, along its ray [m]; (N,).

        Parameters
        ----------
        ratio : np.ndarray [shape=(N, S)]
            Light of each other source relative to the view's own.
        longer : np.ndarray [shape=(N, S)]
            By how much its way to the point is longer than the own one [m].
        """
        total = np.zeros(len(ratio))
        for frequency, weight in zip(self.frequencies, self.weights, strict=True):
            total += weight * _biases(frequency, ratio, longer)
        return total


def weighted_by_frequency(frequencies: tuple[float, ...]) -> PhaseResponse:
    """The response of a camera whose frequencies [Hz] are known: each counts by its precision, the square of it."""
    known = np.asarray(frequencies, dtype=np.float64)
    return PhaseResponse(known, known**2 / np.sum(known**2))


def predicted_bias(
    response: PhaseResponse | None, ratio: np.ndarray, longer: np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Bias of the ``known`` readings (N,) along the ray and what it may be wrong by [m]."""
    predicted, uncertain = np.zeros(len(ratio)), np.zeros(len(ratio))
    lit = np.flatnonzero(known & (ratio.sum(axis=1) > 0))
    if response is None:
        uncertain[lit] = np.where(ratio[lit].sum(axis=1) > UNLEARNT, np.inf, 0.0)
        return predicted, uncertain
    predicted[lit], by_ratio, by_length = _predicted(response, ratio, longer, lit, _RATIO_ERROR, _LENGTH_ERROR)
    uncertain[lit] = np.hypot(by_ratio, by_length)
    return predicted, uncertain


def bias_and_change(
    response: PhaseResponse | None, ratio: np.ndarray, longer: np.ndarray, known: np.ndarray, error: float
) -> tuple[np.ndarray, np.ndarray]:
    """Bias of the ``known`` readings (N,) along the ray [m], and by how much that changes with so much more light.

    ``error``: the share of the ratio by which it grows. Both are 0 without a response.
    """
    predicted, change = np.zeros(len(ratio)), np.zeros(len(ratio))
    if response is None:
        return predicted, change
    lit = np.flatnonzero(known & (ratio.sum(axis=1) > 0))
    predicted[lit], change[lit], _ = _predicted(response, ratio, longer, lit, error, 0.0)
    return predicted, np.abs(change)


def _predicted(
    response: PhaseResponse, ratio: np.ndarray, longer: np.ndarray, some: np.ndarray, error: float, way: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bias of ``some`` readings, and its changes by more light and by ways longer by ``way`` [m]."""
    turns = 2.0 * np.pi * response.frequencies / LIGHT_SPEED
    shares, sines, cosines = response.weights / (2.0 * turns), np.sin(turns * way), np.cos(turns * way)
    found = each(
        lambda part: _predicted_kernel(ratio[part], longer[part], turns, shares, sines, cosines, 1.0 + error),
        np.array_split(some, _PIECES),
    )
    here, by_ratio, by_length = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return here, by_ratio, by_length


@njit(cache=True, nogil=True)
def _predicted_kernel(ratio, longer, turns, shares, sines, cosines, more):
    """:meth:`PhaseResponse.bias` (N,), and how ``more`` times the light, and longer ways, change it (N,).

    ``sines``, ``cosines``: of the phase by which the ways are longer; 0 and 1 where that is not asked.
    """
    count, sources = ratio.shape
    bias, by_ratio, by_length = np.empty(count), np.empty(count), np.empty(count)
    for i in range(count):
        here, brighter, farther = 0.0, 0.0, 0.0
        for k in range(len(turns)):
            across, along = 0.0, 0.0
            for s in range(sources):
                if ratio[i, s] == 0.0:
                    continue
                phase = turns[k] * longer[i, s]
                across += ratio[i, s] * np.sin(phase)
                along += ratio[i, s] * np.cos(phase)
            angle = np.arctan2(across, 1.0 + along)
            here += shares[k] * angle
            brighter += shares[k] * np.arctan2(more * across, 1.0 + more * along)
            if sines[k] != 0.0:  # all ways are longer: their sum is turned
                angle = np.arctan2(across * cosines[k] + along * sines[k], 1.0 + along * cosines[k] - across * sines[k])
            farther += shares[k] * angle
        bias[i], by_ratio[i], by_length[i] = here, brighter - here, farther - here
    return bias, by_ratio, by_length


def _biases(frequency: float, ratio: np.ndarray, longer: np.ndarray) -> np.ndarray:
    turn = 2.0 * np.pi * frequency / LIGHT_SPEED
    if ratio.shape[1] == 1:  # the sums below are slow for a single term
        ratio, longer = ratio[:, 0], longer[:, 0]
        return np.arctan2(ratio * np.sin(turn * longer), 1.0 + ratio * np.cos(turn * longer)) / (2.0 * turn)
    across, along = (ratio * np.sin(turn * longer)).sum(axis=1), 1.0 + (ratio * np.cos(turn * longer)).sum(axis=1)
    return np.arctan2(across, along) / (2.0 * turn)


def fit_response(
    ratio: np.ndarray, longer: np.ndarray, bias: np.ndarray, noise: float, drift: np.ndarray | None = None
) -> tuple[PhaseResponse, float]:
    """The response that explains how much too far some readings of a known surface are.

    No frequency is assumed: of a dictionary of all that cameras use, weights that are not negative are fitted (Lawson
    and Hanson 1974), robustly. Their sum is held near to 1: ways of almost the same length mix whatever the frequency.

    Parameters
    ----------
    ratio, longer : np.ndarray [shape=(N, S)]
        As for :meth:`PhaseResponse.bias`.
    bias : np.ndarray [shape=(N,)]
        What was read less what is there, along the ray [m].
    noise : float
        Standard deviation of ``bias`` where light comes one way [m].
    drift : np.ndarray [shape=(N, D)] or None
        Smooth functions that ``bias`` may hold as well: the surface is not quite known.

    Returns
    -------
    response : PhaseResponse
    explained : float
        Share of the mean square of ``bias``, where light comes two ways, that the response explains [0..1].
    """
    frequencies = np.arange(_LOWEST, _HIGHEST + 1.0, _SPACING)
    table = np.column_stack([_biases(f, ratio, longer) for f in frequencies])
    weights, inlier = np.zeros(len(frequencies)), np.ones(len(bias))
    rest = bias
    for _ in range(_ROUNDS):
        root = np.sqrt(inlier)
        left, right = table * root[:, None], bias * root
        if drift is not None:
            basis = np.linalg.qr(drift * root[:, None])[0]
            left, right = left - basis @ (basis.T @ left), right - basis @ (basis.T @ right)
        gram, moment = left.T @ left, left.T @ right
        stiff = _UNITY * inlier.sum() * noise**2
        weights = nonnegative_least_squares(gram + stiff, moment + stiff)
        rest = bias - table @ weights
        if drift is not None:
            rest = rest - drift @ np.linalg.lstsq(drift * root[:, None], rest * root, rcond=None)[0]
        scale = max(1.4826 * float(np.median(np.abs(rest))), noise)
        inlier = 1.0 / (1.0 + (rest / (3.0 * scale)) ** 2) ** 2
    before = bias if drift is None else bias - drift @ np.linalg.lstsq(drift, bias, rcond=None)[0]
    lit = ratio.sum(axis=1) > 0
    share = np.sum((inlier * rest**2)[lit]) / max(float(np.sum((inlier * before**2)[lit])), 1e-300)
    kept = weights > _SMALLEST
    explained = 1.0 - float(share)
    return PhaseResponse(frequencies[kept], weights[kept]), max(explained, 0.0)


def nonnegative_least_squares(gram: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """The x ≥ 0 that minimises xᵀ·gram·x / 2 − moment·x (Lawson and Hanson 1974, from the normal equations).

    Parameters
    ----------
    gram : np.ndarray [shape=(K, K)]
    moment : np.ndarray [shape=(K,)]
    """
    size = len(moment)
    gram = gram + 1e-9 * np.trace(gram) / size * np.eye(size)  # atoms side by side are almost the same
    x, free = np.zeros(size), np.zeros(size, np.bool_)
    tolerance = 1e-9 * float(np.abs(moment).max(initial=0.0))
    for _ in range(3 * size):
        slope = np.where(free, -np.inf, moment - gram @ x)
        best = int(np.argmax(slope))
        if slope[best] <= tolerance:
            break
        free[best] = True
        while True:
            trial = np.zeros(size)
            some = np.flatnonzero(free)
            trial[some] = np.linalg.solve(gram[np.ix_(some, some)], moment[some])
            negative = free & (trial <= 0.0)
            if not negative.any():
                x = trial
                break
            step = np.min(x[negative] / np.maximum(x[negative] - trial[negative], 1e-300))
            x = x + min(step, 1.0) * (trial - x)
            gone = free & (x <= 1e-12 * max(float(x.max()), 1e-300))
            gone[best] &= bool(negative[best])
            if not gone.any():
                gone = negative
            x[gone] = 0.0
            free &= ~gone
    return x
