"""Views of one body brought to one brightness and tint, by the colours on both sides of their seams."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..mesh import SEAM, Mesh

_DARKEST, _BRIGHTEST = 16.0, 245.0  # sRGB levels outside of these say nothing of the exposure
_UNSURE = 0.15  # standard deviation of a view's log gain before anything is known
_TOGETHER = 20  # so many neighbouring pairs say one thing
_MOST = 0.5  # largest log gain


def match_exposures(mesh: Mesh, mirrored: np.ndarray) -> Mesh:
    """The zippered mesh with the colours of every view multiplied so that they agree over the seams.

    A mirror swallows a part of the light and tints the rest; cameras choose their exposure themselves. Either is one
    factor a view and channel. Where two views meet, a seam joins a vertex of one with one of the other that shows
    almost the same spot: the factors make the logarithms of their levels agree, by weighted least squares with the
    factors expected near 1. On the mean, the views without a mirror keep their brightness.

    Parameters
    ----------
    mesh : Mesh
        With seams, before it is closed. Without colours it is returned as it is.
    mirrored : np.ndarray [shape=(N,), dtype=bool]
        Of each view.

    Notes
    -----
    O(V + T).
    """
    if mesh.colors is None or mesh.view is None or mesh.kind is None or len(mirrored) < 2:
        return mesh
    gain = exposure_gains(mesh, mirrored)
    if not gain.any():
        return mesh
    seen = np.flatnonzero((mesh.view >= 0) & gain.any(axis=1)[mesh.view])
    colors = mesh.colors.copy()
    bright = colors[seen] * np.exp(gain[mesh.view[seen]])
    colors[seen] = np.clip(np.rint(bright), 0, 255).astype(np.uint8)
    return replace(mesh, colors=colors)


def exposure_gains(mesh: Mesh, mirrored: np.ndarray) -> np.ndarray:
    """Natural logarithms (N, 3) of what each view's colours are to be multiplied with. See :func:`match_exposures`."""
    assert mesh.view is not None and mesh.kind is not None and mesh.colors is not None
    views = len(mirrored)
    strips = mesh.triangles[mesh.kind == SEAM]
    pairs = np.concatenate([strips[:, [k, (k + 1) % 3]] for k in range(3)])
    at = mesh.view[pairs]
    pairs = pairs[(at[:, 0] >= 0) & (at[:, 1] >= 0) & (at[:, 0] != at[:, 1])]
    pairs = np.where((mesh.view[pairs[:, 0]] > mesh.view[pairs[:, 1]])[:, None], pairs[:, ::-1], pairs)
    levels = mesh.colors[pairs].astype(np.float64)
    told = ((levels > _DARKEST) & (levels < _BRIGHTEST)).all(axis=(1, 2))
    pairs, levels = pairs[told], levels[told]
    gain = np.zeros((views, 3))
    if not len(pairs):
        return gain
    ratio = np.log(levels[:, 1] / levels[:, 0])
    number = mesh.view[pairs[:, 0]].astype(np.int64) * views + mesh.view[pairs[:, 1]]
    for channel in range(3):
        A, b = np.eye(views) / _UNSURE**2, np.zeros(views)
        for pair in np.unique(number):
            some = ratio[number == pair, channel]
            middle = float(np.median(some))
            spread = 1.4826 * float(np.median(np.abs(some - middle))) + 0.02
            weight = max(len(some) / _TOGETHER, 0.0) / spread**2
            i, j = divmod(int(pair), views)
            A[i, i] += weight
            A[j, j] += weight
            A[i, j] -= weight
            A[j, i] -= weight
            b[i] += weight * middle
            b[j] -= weight * middle
        gain[:, channel] = np.linalg.solve(A, b)
    kept = ~mirrored if not mirrored.all() else np.ones(views, np.bool_)
    gain -= gain[kept].mean(axis=0)
    return np.clip(gain, -_MOST, _MOST)
