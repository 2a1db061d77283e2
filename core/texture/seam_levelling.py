"""Views brought to one brightness and tint: a gain a mirror, then what is left at the borders between views.

The second as Waechter, Moehrle and Goesele 2014, "Let there be color!", section 4.2, with differences that are taken
where two views overlap, and smoothed: patterns that lie a little beside one another must not become shades.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from ..numeric.srgb import from_linear, to_linear
from .color_cameras import ColorView
from .surface_diffusion import diffuse
from .visibility import Seen

_DARK, _BRIGHT = 0.003, 0.95  # linear light outside of these says nothing of a gain
_TOGETHER = 12  # vertices that two views must share
_MOST = 3.0  # largest gain
_PRIOR = 2.0  # as many vertices speak for a gain of 1
_SMOOTHING = 0.03  # pull of each difference against its neighbours': over about six vertices each way
_EXPECTED = 6.0  # differences of so many levels are due to light; larger ones, on the mean, to patterns
_NONE = 0.002  # pull of differences towards none
_FADE = 0.002  # pull of corrections towards none: they fade out over some twenty vertices


def exposure_gains(views: list[ColorView], seen: Seen, light: np.ndarray) -> np.ndarray:
    """Gains (K, 3) of linear light that make views agree where two see the same skin.

    On the mean straight views keep theirs. Sums of light over the skin that both see are compared, which colours that
    lie a little beside the skin leave alone.

    Parameters
    ----------
    views : list of ColorView
    seen : Seen
    light : np.ndarray [shape=(V, K, 3)]
        Linear light, 0..1, that each view shows of each vertex.
    """
    count = len(views)
    gains = np.zeros((count, 3))
    known = (seen.score > 0) & ((light > _DARK) & (light < _BRIGHT)).all(axis=2)
    rows, values, weights = [], [], []
    for a, b in combinations(range(count), 2):
        both = known[:, a] & known[:, b]
        if both.sum() < _TOGETHER:
            continue
        share = np.minimum(seen.score[both, a], seen.score[both, b])[:, None]
        ratio = np.log((share * light[both, b]).sum(axis=0) / (share * light[both, a]).sum(axis=0))
        row = np.zeros(count)
        row[a], row[b] = 1.0, -1.0
        rows.append(row)
        values.append(ratio)
        weights.append(np.sqrt(both.sum()))
    if not rows:
        return np.ones((count, 3))
    straight = np.array([not view.mirrored for view in views], np.float64)
    anchor = straight if straight.any() else np.ones(count)
    matrix = np.vstack((np.array(rows) * np.array(weights)[:, None], 1e3 * anchor, np.sqrt(_PRIOR) * np.eye(count)))
    right = np.vstack((np.array(values) * np.array(weights)[:, None], np.zeros((1 + count, 3))))
    gains = np.linalg.lstsq(matrix, right, rcond=None)[0]
    return np.exp(np.clip(gains, -np.log(_MOST), np.log(_MOST)))


def gain_tables(gains: np.ndarray) -> np.ndarray:
    """What each view's levels become (K, 3, 256) float32, sRGB 0..255."""
    light = to_linear(np.arange(256) / 255.0)
    return (255.0 * from_linear(np.minimum(gains[:, :, None] * light, 1.0))).astype(np.float32)


def level_seams(graph: tuple[np.ndarray, np.ndarray], seen: Seen, colors: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """What is added to each view's colours (V, K, 3) so that views agree at their borders.

    Parameters
    ----------
    graph
        Of the mesh, from :func:`.surface_diffusion.neighbours`.
    seen : Seen
    colors : np.ndarray [shape=(V, K, 3)]
        Levels that each view shows of each vertex, gains applied.
    weight : np.ndarray [shape=(V, K + 1)]
        From :func:`.visibility.view_weights`.
    """
    count, views = seen.score.shape
    taken = weight[:, :views] > 0
    target, pull = np.zeros((count, views, 3)), np.zeros((count, views))
    for a, b in combinations(range(views), 2):
        border = taken[:, a] & taken[:, b]
        both = (seen.score[:, a] > 0) & (seen.score[:, b] > 0)
        if not border.any():
            continue
        trust = np.minimum(seen.score[:, a], seen.score[:, b])
        trust = np.where(both, trust / max(float(np.median(trust[border])), 1e-9), 0.0).clip(0.0, 1.0)
        trust *= np.minimum(seen.worth[:, a], seen.worth[:, b])  # near outlines colours may be the background's
        difference = colors[:, a] - colors[:, b]
        # patterns that lie a little beside one another say little: the more they differ, the more of them count
        scatter = float(np.average(difference[both].var(axis=1), weights=trust[both] + 1e-9))
        scatter += float(np.average((difference[both].mean(axis=1)) ** 2, weights=trust[both] + 1e-9))
        pull_here = _SMOOTHING * trust * min(1.0, _EXPECTED**2 / max(scatter, 1e-9))
        whole = pull_here + _NONE
        apart = diffuse(graph, difference * (pull_here / whole)[:, None], whole, both, 60)
        for view, sign in ((a, -0.5), (b, 0.5)):
            target[border, view] += sign * apart[border]
            pull[border, view] += 1.0
    offset = np.zeros((count, views, 3), np.float32)
    for k in range(views):
        if not (pull[:, k] > 0).any():
            continue
        mean = target[:, k] / np.maximum(pull[:, k], 1.0)[:, None]
        strength = np.where(pull[:, k] > 0, 10.0, _FADE)
        offset[:, k] = diffuse(graph, mean, strength, taken[:, k], 60)
    return offset
