"""Light and shade taken out of colours, as far as they depend on how the skin is turned.

The logarithm of a level is that of the skin's own colour, plus a smooth function of the normal (spherical harmonics of
the second order: Ramamoorthi and Hanrahan 2001), plus a function of the angle under which a camera sees it. Skin's own
colour changes in few places, so neighbouring vertices tell the first (as Land and McCann's retinex, 1971); views that
see the same skin under two angles tell the second.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from .surface_diffusion import diffuse

_DARKEST = 12.0  # levels below say nothing
_STRONGEST = 0.7  # largest logarithm of a factor
_ROUNDS = 8  # of reweighting, towards least absolute differences
_RIDGE = 1e-3  # of the equations' own weight, against functions that nothing speaks for
_ENOUGH = 100  # equations


def light_factors(
    graph: tuple[np.ndarray, np.ndarray],
    normals: np.ndarray,
    levels: np.ndarray,
    cosines: np.ndarray,
    weight: np.ndarray,
) -> np.ndarray:
    """By what each vertex's colours are multiplied (V,) so that light and shade are gone.

    Parameters
    ----------
    graph
        Of the mesh, from :func:`.surface_diffusion.neighbours`.
    normals : np.ndarray [shape=(V, 3)]
        Unit.
    levels : np.ndarray [shape=(V, K, 3)]
        sRGB, 0..255, brought to one brightness.
    cosines : np.ndarray [shape=(V, K)]
        Of the angle between normal and the way to each view's camera; 0 where it does not see the vertex.
    weight : np.ndarray [shape=(V, K + 1)]
        From :func:`.visibility.view_weights`.

    Returns
    -------
    np.ndarray [shape=(V,), dtype=float32]
        On the mean over seen vertices, of its logarithm, 1.
    """
    bright = levels.mean(axis=2)
    known = (cosines > 0) & (bright > _DARKEST)
    logs = np.log(np.maximum(bright, 1.0))
    facing = _facing_light(logs, cosines, known)
    own = weight[:, :-1] * known
    total = own.sum(axis=1)
    towards = (own * (_polynomial(cosines) @ facing)).sum(axis=1) / np.maximum(total, 1e-9)
    plain = (own * logs).sum(axis=1) / np.maximum(total, 1e-9) - towards
    basis = _harmonics(normals)
    start, heads = graph
    tail = np.repeat(np.arange(len(start) - 1), np.diff(start))
    pairs = (tail < heads) & (total[tail] > 0.99) & (total[heads] > 0.99)
    # where no view is, light is as around
    towards = diffuse(graph, towards[:, None], (total > 0.5).astype(np.float64), np.ones(len(towards), np.bool_), 120)[
        :, 0
    ]
    turned = _robust(basis[tail[pairs]] - basis[heads[pairs]], plain[tail[pairs]] - plain[heads[pairs]])
    light = basis @ turned + towards
    light -= light[total > 0].mean() if (total > 0).any() else 0.0
    return np.exp(-np.clip(light, -_STRONGEST, _STRONGEST)).astype(np.float32)


def _facing_light(logs: np.ndarray, cosines: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Coefficients (2,) of the function of the cosine, by vertices that two views see."""
    shape = _polynomial(cosines)
    rows, values = [], []
    for a, b in combinations(range(logs.shape[1]), 2):
        both = known[:, a] & known[:, b]
        rows.append(shape[both, a] - shape[both, b])
        values.append(logs[both, a] - logs[both, b])
    return _robust(np.concatenate(rows), np.concatenate(values)) if rows else np.zeros(2)


def _polynomial(cosines: np.ndarray) -> np.ndarray:
    """Functions (..., 2) of the cosine, 0 where a camera looks straight at the skin."""
    return np.stack((cosines - 1.0, (cosines - 1.0) ** 2), axis=-1)


def _harmonics(normals: np.ndarray) -> np.ndarray:
    """Spherical harmonics (V, 8) of the first and second order, of unit normals (V, 3)."""
    x, y, z = normals.T
    return np.stack((x, y, z, x * y, y * z, x * z, x * x - y * y, 3.0 * z * z - 1.0), axis=1)


def _robust(rows: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Coefficients (C,) with least absolute differences, by reweighted least squares; none of few equations."""
    width = rows.shape[1]
    found = np.zeros(width)
    if len(rows) < _ENOUGH:
        return found
    weight = np.ones(len(rows))
    for _ in range(_ROUNDS):
        normal = (rows * weight[:, None]).T @ rows
        ridge = _RIDGE * max(float(np.trace(normal)) / width, 1e-12)
        found = np.linalg.solve(normal + ridge * np.eye(width), rows.T @ (weight * values))
        weight = 1.0 / np.maximum(np.abs(values - rows @ found), 1e-3)
    return found
