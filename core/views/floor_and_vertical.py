"""The vertical and the floor: from the mirrors that stand on it, and from what is seen of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mirrors import Mirror
from ..numeric.kernels import njit
from ..numeric.point_products import dot

_CAMERA_UP = np.array((0.0, -1.0, 0.0))
_MOST_TILT, _MOST_CAMERA_TILT = 15.0, 25.0  # of the floor from the mirrors' vertical, and from the camera's [degrees]
_LEAST_CROSS = 0.1  # length of the normals' summed cross products from which they fix the vertical
_UPRIGHT = 0.5  # part of a normal along the camera's vertical from which a mirror lies on floor or ceiling
_FEWEST_READINGS = 200  # fewer show no floor
_SAMPLE, _TRIPLES = 4000, 80  # readings that planes are searched among, and planes that are tried
_LOWEST = 0.4  # share of the readings, the lowest, of which planes are made
_LEAST_AREA = 4e-4  # twice that of a triple of readings: smaller ones fix no plane [m²]
_LEAST_SCORE = 0.02  # share of the readings that a floor must have
_ON, _UNDER = 0.02, 0.06  # so near a reading is on a plane, so far below it under it [m]
_UNDER_COST = 3  # readings on a plane that one under it costs
_FIRST_BAND, _LEAST_BAND, _NOISES = 0.06, 0.015, 4  # about the plane, first and at least [m]; later times the noise
_MOST_READINGS = 8000  # of a room: enough to find its floor


@dataclass(frozen=True)
class Ground:
    """Which way is up, and where the floor is.

    Parameters
    ----------
    up : np.ndarray [shape=(3,)]
        Unit vertical, camera frame.
    floor : float or None
        Height of the floor along ``up`` [m]; None when none is seen.
    noise : float
        Standard deviation of directly seen floor readings about it [m].
    disagreement_deg : float or None
        Between the vertical of the mirrors and the floor's; None when one of them is not known.
    """

    up: np.ndarray
    floor: float | None
    noise: float
    disagreement_deg: float | None


def find_ground(points: np.ndarray, seen: np.ndarray, mirrors: list[Mirror]) -> Ground:
    """Vertical and floor. What is seen of the floor decides; without it the mirrors' vertical is taken.

    Parameters
    ----------
    points : np.ndarray [shape=(H, W, 3)]
        Placed readings, camera frame [m].
    seen : np.ndarray [shape=(H, W), dtype=int8]
        View of each, -1 = none.
    """
    rig, known = mirrors_vertical(mirrors)
    flat, cloud = seen.reshape(-1), points.reshape(-1, 3)
    found = None
    # the floor as seen directly, else what the mirrors show of it
    for chosen in (np.flatnonzero(flat == 0), np.flatnonzero(flat > 0)):
        if not len(chosen):
            continue
        some = cloud[chosen[:: len(chosen) // _MOST_READINGS + 1]]
        found = find_floor(some, rig)
        if found is None and known:  # mirrors that lean would point away from the floor
            found = find_floor(some, _CAMERA_UP, _MOST_CAMERA_TILT)
        if found is not None:
            break
    if found is None:
        return Ground(rig, None, 0.0, None)
    up, height, noise = found
    angle = float(np.degrees(np.arccos(np.clip(up @ rig, -1.0, 1.0)))) if known else None
    return Ground(up, height, noise, angle)


def vertical(mirrors: list[Mirror]) -> np.ndarray:
    """Up from the rig, see :func:`mirrors_vertical`."""
    return mirrors_vertical(mirrors)[0]


def mirrors_vertical(mirrors: list[Mirror]) -> tuple[np.ndarray, bool]:
    """Up from the rig: mirrors stand vertically, so the cross product of two normals is vertical (paper 4.2.2).

    With one mirror, or parallel ones, the camera is taken to stand upright but for what the mirror says; the second
    answer says whether two mirrors fixed it.
    """
    up = np.zeros(3)
    for i, a in enumerate(mirrors):
        for b in mirrors[:i]:
            cross = np.cross(a.normal, b.normal)
            up += cross if cross[1] < 0 else -cross
    length = np.linalg.norm(up)
    if length > _LEAST_CROSS:
        return up / length, True
    up = _CAMERA_UP.copy()
    if mirrors and abs(mirrors[0].normal[1]) < _UPRIGHT:  # not on floor or ceiling
        up -= (up @ mirrors[0].normal) * mirrors[0].normal
        up /= np.linalg.norm(up)
    return up, False


def leans(mirrors: list[Mirror], up: np.ndarray) -> list[float]:
    """How far each mirror's top leans towards the camera's side, out of the vertical [degrees]."""
    return [float(-np.degrees(np.arcsin(np.clip(m.normal @ up, -1.0, 1.0)))) for m in mirrors]


def find_floor(
    points: np.ndarray, up: np.ndarray, tilt_limit: float = _MOST_TILT
) -> tuple[np.ndarray, float, float] | None:
    """The floor among placed readings: the lowest large plane that is level to within ``tilt_limit`` degrees.

    Parameters
    ----------
    points : np.ndarray [shape=(N, 3)]
        Directly seen readings, camera frame [m].
    up : np.ndarray [shape=(3,)]
        First guess of the vertical.

    Returns
    -------
    (up, height, noise) or None
        The floor's normal, its height along it and the standard deviation of its points [m].
    """
    if len(points) > _MOST_READINGS:
        points = points[:: len(points) // _MOST_READINGS + 1]
    if len(points) < _FEWEST_READINGS:
        return None
    rng = np.random.default_rng(0)
    sample = points[:: len(points) // _SAMPLE + 1]
    height = dot(sample, up)
    low = sample[height <= np.quantile(height, _LOWEST)]
    a, b, c = low[rng.integers(0, len(low), (3, _TRIPLES))]
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    normals /= np.where(length > 0, length, 1.0)[:, None]
    normals *= np.where(dot(normals, up) < 0, -1.0, 1.0)[:, None]
    level = (length > _LEAST_AREA) & (dot(normals, up) > np.cos(np.radians(tilt_limit)))
    if not level.any():
        return None
    normals, offsets = normals[level], np.einsum("ij,ij->i", normals, a)[level]
    score = _floor_scores(sample, normals, offsets)
    winner = int(np.argmax(score))
    if score[winner] < _LEAST_SCORE * len(sample):
        return None
    n, d = normals[winner], offsets[winner]
    band = _FIRST_BAND
    for _ in range(5):
        inliers = points[np.abs(dot(points, n) - d) < band]
        center = inliers.mean(axis=0)
        fitted = np.linalg.svd(_scatter(inliers, center))[2][2]
        n = fitted if fitted @ up > 0 else -fitted
        d = n @ center
        noise = 1.4826 * np.median(np.abs(dot(inliers, n) - d))
        band = max(_NOISES * noise, _LEAST_BAND)
    return (n, float(d), float(noise)) if n @ up > np.cos(np.radians(tilt_limit)) else None


@njit(cache=True, nogil=True)
def _floor_scores(points, normals, offsets):
    """Points within 2 cm of each plane, less three for each 6 cm under it: nothing of substance lies under a floor."""
    score = np.zeros(len(normals), np.int64)
    for k in range(len(normals)):
        x, y, z, offset = normals[k, 0], normals[k, 1], normals[k, 2], offsets[k]
        total = 0
        for i in range(len(points)):
            distance = points[i, 0] * x + points[i, 1] * y + points[i, 2] * z - offset
            total += (abs(distance) < _ON) - _UNDER_COST * (distance < -_UNDER)
        score[k] = total
    return score


@njit(cache=True, nogil=True)
def _scatter(points, center):
    """Scatter matrix (3, 3) of points (N, 3) about ``center``."""
    out = np.zeros((3, 3))
    for i in range(len(points)):
        for a in range(3):
            for b in range(3):
                out[a, b] += (points[i, a] - center[a]) * (points[i, b] - center[b])
    return out
