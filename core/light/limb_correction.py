"""The subject corrected where light reaches it two ways, from the middle of each limb outwards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .irradiance import ratio_to_own
from .lit_scene import LitScene, grown, ray_lengths
from .phase_response import CORRECTABLE, PhaseResponse, predicted_bias

DEVIATIONS = 3.0
"""Standard deviations of the noise by which sound readings may differ."""

_SEED = 0.15  # share of a limb's half width, from its middle, that light of one way is taken to reach alone
_LIMB_STEP = 0.03  # of z between neighbours: more is the edge of a limb
_ROUNDS, _REACH = 16, 2  # so often, and so far each time, the surface is followed outwards [px]
_DAMPING = 0.25  # of a correction that is made again: it depends on the surface, which depends on it
_CONSISTENT = 0.008  # a corrected reading may lie so far off the surface's way on [m], besides noise


@dataclass(frozen=True)
class Corrected:
    """The subject's readings as far as they could be followed outwards.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        Corrected z [m].
    trusted : np.ndarray [shape=(H, W), dtype=bool]
        Readings of the subject that are right, as far as the surface's way on tells.
    edge : np.ndarray [shape=(H, W)]
        How far out in its limb each pixel lies: 0 in the middle, 1 at the edge.
    rows, columns : np.ndarray [shape=(N,)]
        The subject's readings.
    bias, total : np.ndarray [shape=(N,)]
        What was taken off each, along the ray [m], and the other ways' light relative to its own view's.
    """

    depth: np.ndarray
    trusted: np.ndarray
    edge: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    bias: np.ndarray
    total: np.ndarray


def correct_limbs(scene: LitScene, response: PhaseResponse | None) -> Corrected:
    """The surface so far, from the middle of each limb outwards, tells which light the next pixels get.

    A reading that light of two ways falsified bends the surface, so that it seems to turn away from that light.
    Therefore only what is corrected already says how the surface goes on.
    """
    rows, columns = np.nonzero((scene.labels >= 0) & (scene.depth > 0))
    length = ray_lengths(rows, columns, scene.intrinsics)
    measured, (edge, middle) = scene.depth[rows, columns], places_in_limbs(scene)
    depth, trusted = scene.depth.copy(), middle & (scene.labels >= 0) & (scene.depth > 0)
    noise = reading_noise(scene, rows, columns)
    bias, total = np.zeros(len(rows)), np.full(len(rows), np.inf)
    good, settled = np.zeros(len(rows), np.bool_), np.zeros(len(rows), np.bool_)
    for _ in range(_ROUNDS):
        some = np.flatnonzero(grown(trusted, _REACH)[rows, columns] & ~settled)
        if not len(some):
            break
        surface = scene.surface(depth, trusted, rows[some], columns[some], _REACH)
        light, lengths = scene.light(surface.points, surface.normals, surface.view)
        ratio = ratio_to_own(light, surface.view)
        longer = lengths - lengths[np.arange(len(some)), surface.view][:, None]
        known, before = surface.z > 0, total[some]
        total[some] = np.where(known, ratio.sum(axis=1), np.inf)
        predicted, uncertain = predicted_bias(response, ratio, longer, known)
        step = np.where(np.isinf(before), 1.0, _DAMPING)
        bias[some] = np.where(known, bias[some] + step * (predicted - bias[some]), bias[some])
        value = measured[some] - bias[some] / length[some]
        depth[rows[some], columns[some]] = np.maximum(value, 0.0)
        good[some] = (
            known
            & (uncertain < CORRECTABLE)
            & (np.abs(value - surface.z) * length[some] < _CONSISTENT + DEVIATIONS * noise[some])
        )
        settled[some] = good[some] & (total[some] == 0) & (before == 0) & (bias[some] == 0)
        trusted = np.zeros(depth.shape, np.bool_)
        trusted[rows[good], columns[good]] = True
    return Corrected(depth, trusted, edge, rows, columns, bias, total)


def reading_noise(scene: LitScene, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Standard deviation of some readings [m], by the second differences along the rows of their view."""
    left = scene.depth[rows, np.maximum(columns - 1, 0)]
    right = scene.depth[rows, np.minimum(columns + 1, scene.depth.shape[1] - 1)]
    here, bend = scene.depth[rows, columns], np.zeros(len(rows))
    known = (left > 0) & (right > 0)
    bend[known] = np.abs(left[known] + right[known] - 2.0 * here[known])
    noise = np.zeros(len(rows))
    for view in range(len(scene.sources)):
        mine = scene.labels[rows, columns] == view
        if (mine & known).any():
            noise[mine] = 1.4826 * float(np.median(bend[mine & known])) / np.sqrt(6.0)
    return noise


def places_in_limbs(scene: LitScene) -> tuple[np.ndarray, np.ndarray]:
    """How far out in its limb each pixel of a row lies (H, W), 0 in the middle, 1 at the edge; and the middles."""
    labels, depth = scene.labels, scene.depth
    starts = np.ones(labels.shape, np.bool_)
    starts[:, 1:] = (labels[:, 1:] != labels[:, :-1]) | (
        np.abs(depth[:, 1:] - depth[:, :-1]) > _LIMB_STEP * depth[:, 1:]
    )
    first = np.flatnonzero(starts.ravel())
    run = np.cumsum(starts.ravel()) - 1
    size = np.diff(np.append(first, labels.size))
    place = (np.arange(labels.size) - first[run] + 0.5) / size[run]
    share = np.abs(2.0 * place - 1.0)
    share = np.where(size[run] >= 3, share, 1.0)
    middle = share < np.maximum(_SEED, 1.01 / size[run])
    return share.reshape(labels.shape), middle.reshape(labels.shape)
