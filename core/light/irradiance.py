"""How strongly the camera's light reaches a surface: directly, and by way of each mirror."""

from __future__ import annotations

import numpy as np

from ..camera import Intrinsics
from ..mirrors import Mirror
from ..mirrors.mirror import reflect

_OCCLUDED = 0.15  # so much nearer than a point, the subject seen in its line of sight hides it [m]
_MARGIN = 0.01  # rays that pass the glass nearer to its edge than this are taken to miss it [m]


def light_sources(mirrors: list[Mirror]) -> np.ndarray:
    """Where the light is (M + 1, 3): at the camera, and where each mirror shows the camera; camera frame [m]."""
    return np.array([np.zeros(3), *(reflect(np.zeros(3), m) for m in mirrors)])


def path_lengths(points: np.ndarray, sources: np.ndarray) -> np.ndarray:
    """Distance (N, S) of points (N, 3) from each source (S, 3), along the folded path [m]."""
    return np.linalg.norm(points[:, None, :] - sources[None], axis=2)


def through_glass(points: np.ndarray, mirror: Mirror, margin: float = _MARGIN) -> np.ndarray:
    """Which points (N, 3) see the camera in the mirror: their sight line to its image passes the glass."""
    a, b, n = mirror.basis.T
    ahead, far = points @ n - mirror.point @ n, mirror.point @ n  # the image of the camera lies as far behind
    share = np.where(ahead > 0.0, ahead / np.maximum(ahead - far, 1e-9), 0.0)
    passes = ahead > 0.0
    if mirror.rectangle is None:
        return passes
    source = 2.0 * far * n
    for axis, (low, high) in zip((a, b), mirror.rectangle, strict=True):
        place = points @ axis
        place += share * (source @ axis - place) - mirror.point @ axis
        passes &= (place > low + margin) & (place < high - margin)
    return passes


def seen_at(
    points: np.ndarray, view: int, mirrors: list[Mirror], intrinsics: Intrinsics
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Where a view shows points (N, 3): rows, columns, z there [m], and which lie in the image."""
    placed = points if view == 0 else reflect(points, mirrors[view - 1])
    z = placed[:, 2]
    ahead = z > 0.05
    safe = np.where(ahead, z, 1.0)
    columns = np.rint(placed[:, 0] / safe * intrinsics.fx + intrinsics.cx)
    rows = np.rint(placed[:, 1] / safe * intrinsics.fy + intrinsics.cy)
    inside = ahead & (columns >= 0) & (columns < intrinsics.width) & (rows >= 0) & (rows < intrinsics.height)
    return np.where(inside, rows, 0).astype(np.intp), np.where(inside, columns, 0).astype(np.intp), z, inside


def irradiance(
    points: np.ndarray,
    normals: np.ndarray,
    own: np.ndarray,
    depth: np.ndarray,
    labels: np.ndarray,
    mirrors: list[Mirror],
    intrinsics: Intrinsics,
    reflectivity: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Light that arrives at surface points from each source: ρ · cos θ / r² where it is not hidden.

    What hides a point from a source is read from the image: the source stands where the view's camera stands, so what
    the view shows in front of the point is in the light's way, too.

    Parameters
    ----------
    points, normals : np.ndarray [shape=(N, 3)]
        Where they really are, camera frame [m]; unit normals outwards.
    own : np.ndarray [shape=(N,)]
        The view that sees each; its light reaches it. -1 = of no view.
    depth, labels : np.ndarray [shape=(H, W)]
        z [m] and the subject's views: what can hide a point.
    mirrors : list of Mirror
    intrinsics : Intrinsics
    reflectivity : np.ndarray [shape=(M,)]
        Share of the light that each mirror gives back in one pass.

    Returns
    -------
    light : np.ndarray [shape=(N, M + 1)]
        [1/m²], 0 where a source does not reach.
    lengths : np.ndarray [shape=(N, M + 1)]
        :func:`path_lengths` [m].
    """
    sources = light_sources(mirrors)
    lengths = path_lengths(points, sources)
    light = np.zeros_like(lengths)
    for view, source in enumerate(sources):
        facing = ((source - points) * normals).sum(axis=1) / np.maximum(lengths[:, view], 1e-9)
        some = np.flatnonzero(facing > 0.0)
        if view > 0:
            some = some[through_glass(points[some], mirrors[view - 1]) | (own[some] == view)]
        rows, columns, z, inside = seen_at(points[some], view, mirrors, intrinsics)
        there, nearest = labels[rows, columns], depth[rows, columns]
        hidden = ((there == 0) | (there == view)) & (nearest > 0) & (nearest < z - _OCCLUDED)
        reached = some[(inside & ~hidden) | (own[some] == view)]
        light[reached, view] = facing[reached] / lengths[reached, view] ** 2
        if view > 0:
            light[reached, view] *= reflectivity[view - 1]
    return light, lengths


def ratio_to_own(light: np.ndarray, own: np.ndarray) -> np.ndarray:
    """The other sources' light (N, S) relative to that of each point's ``own`` view; 0 for the own one itself."""
    every = np.arange(len(light))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = light / light[every, own][:, None]
    ratio[every, own] = 0.0
    return np.nan_to_num(ratio, nan=0.0, posinf=1e6)
