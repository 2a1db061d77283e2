"""How strongly the camera's light reaches a surface: directly, and by way of each mirror."""

from __future__ import annotations

import numpy as np

from ..camera import Intrinsics
from ..mirrors import Mirror
from ..mirrors.mirror import reflect
from ..numeric.kernels import njit
from ..numeric.threads import each

_OCCLUDED = 0.15  # so much nearer than a point, the subject seen in its line of sight hides it [m]
_MARGIN = 0.01  # rays that pass the glass nearer to its edge than this are taken to miss it [m]
_PIECES = 4  # the points are looked at in so many pieces, side by side


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
    count = len(mirrors)
    planes, axes = np.empty((count, 4)), np.empty((count, 2, 3))
    limits = np.empty((count, 2, 2))  # of the glass along its axes
    for k, mirror in enumerate(mirrors):
        planes[k, :3], planes[k, 3] = mirror.normal, mirror.normal @ mirror.point
        axes[k] = mirror.basis[:, :2].T
        limits[k] = (-np.inf, np.inf)
        if mirror.rectangle is not None:
            limits[k] = mirror.rectangle + (axes[k] @ mirror.point)[:, None]
    points, normals = np.ascontiguousarray(points), np.ascontiguousarray(normals)
    light, lengths = np.empty((len(points), count + 1)), np.empty((len(points), count + 1))
    step = max((len(points) + _PIECES - 1) // _PIECES, 1)

    def shine(start: int) -> None:
        part = slice(start, start + step)
        _irradiance_kernel(
            points[part], normals[part], own[part], depth, labels, planes, axes, limits, reflectivity,
            intrinsics.packed, light[part], lengths[part],
        )  # fmt: skip

    each(shine, range(0, len(points), step))
    return light, lengths


@njit(cache=True, nogil=True)
def _passes(planes, axes, limits, k, x, y, z):
    """Whether a point's sight line to the camera's image in mirror ``k`` passes the glass."""
    far = planes[k, 3]
    ahead = x * planes[k, 0] + y * planes[k, 1] + z * planes[k, 2] - far
    if ahead <= 0.0:
        return False
    share = ahead / max(ahead - far, 1e-9)
    for axis in range(2):
        place = x * axes[k, axis, 0] + y * axes[k, axis, 1] + z * axes[k, axis, 2]
        place -= share * place  # the image of the camera lies on the normal through it
        if not limits[k, axis, 0] + _MARGIN < place < limits[k, axis, 1] - _MARGIN:
            return False
    return True


@njit(cache=True, nogil=True)
def _hidden(depth, labels, view, x, y, z, camera):
    """Whether a point, where a view shows it, lies outside of the image or behind what it shows of the subject."""
    height, width = depth.shape
    if z <= 0.05:
        return True
    column, row = np.rint(x / z * camera[0] + camera[2]), np.rint(y / z * camera[1] + camera[3])
    if column < 0 or column >= width or row < 0 or row >= height:
        return True
    v, u = int(row), int(column)
    return (labels[v, u] == 0 or labels[v, u] == view) and 0.0 < depth[v, u] < z - _OCCLUDED


@njit(cache=True, nogil=True)
def _irradiance_kernel(points, normals, own, depth, labels, planes, axes, limits, reflectivity, camera, light, lengths):
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for view in range(len(planes) + 1):
            # the point as the view's camera sees it: in a mirror, its image
            px, py, pz, nx, ny, nz = x, y, z, normals[i, 0], normals[i, 1], normals[i, 2]
            if view > 0:
                a, b, c, d = planes[view - 1]
                off = 2.0 * (a * x + b * y + c * z - d)
                px, py, pz = x - off * a, y - off * b, z - off * c
                off = 2.0 * (a * nx + b * ny + c * nz)
                nx, ny, nz = nx - off * a, ny - off * b, nz - off * c
            length = np.sqrt(px * px + py * py + pz * pz)
            lengths[i, view], light[i, view] = length, 0.0
            facing = -(px * nx + py * ny + pz * nz) / max(length, 1e-9)
            if not facing > 0.0:
                continue
            if own[i] != view and (
                (view > 0 and not _passes(planes, axes, limits, view - 1, x, y, z))
                or _hidden(depth, labels, view, px, py, pz, camera)
            ):
                continue
            light[i, view] = facing / length**2
            if view > 0:
                light[i, view] *= reflectivity[view - 1]


def ratio_to_own(light: np.ndarray, own: np.ndarray) -> np.ndarray:
    """The other sources' light (N, S) relative to that of each point's ``own`` view; 0 for the own one itself."""
    every = np.arange(len(light))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = light / light[every, own][:, None]
    ratio[every, own] = 0.0
    return np.nan_to_num(ratio, nan=0.0, posinf=1e6)
