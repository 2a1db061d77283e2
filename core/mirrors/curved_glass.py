"""What glass that is bowed or thick shows, as flat and thin glass would have shown it.

Everything else in the program reflects over a plane. This is the one place where the difference between a real mirror
and its plane is undone: on the reading's place, before it is flipped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..camera import RgbdImage
from .mirror import Mirror, long_axis, reflect

REFRACTION = 1.52
"""Refractive index of float glass, soda lime; 1.51 in the near infrared (Rubin 1985)."""

_BEHIND = 0.02  # readings nearer behind the plane are not of the reflection [m]
_STEP = 1e-4  # of the sag or thickness by which derivatives are taken [m]
_MEAN = 2.0 / 3.0  # of 1 - (2 y / L)² over the length L


def bow_profile(mirror: Mirror, along: np.ndarray) -> np.ndarray:
    """How far glass with a sag of 1 m lies in front of its best plane, ``along`` (N,) its longer side [m].

    A strip that is bent evenly: a parabola, 1/3 in the middle and -2/3 at both ends.
    """
    _, middle, length = long_axis(mirror)
    return 1.0 - (2.0 * (along - middle) / length) ** 2 - _MEAN


def flattened(points: np.ndarray, mirror: Mirror, time_of_flight: bool = False) -> np.ndarray:
    """Where flat and thin glass would show what this mirror shows.

    The ray is followed to the bowed surface and reflected there; what flat glass would show is the mirror image of
    where it ends. Glass of the thickness T reflects at its back: like thin glass that lies T cos θ / √(n² - sin² θ)
    behind its front; a camera that measures time reads 2 T (n - 1/n) / cos θ' too much, θ' the angle in the glass.

    Parameters
    ----------
    points : np.ndarray [shape=(N, 3)]
        Readings in the glass, where the camera sees them: behind it [m].
    mirror : Mirror
        Its plane is the best one of the apparent surface, ``glass_thickness`` / n behind the front of the glass.
    time_of_flight : bool
        The camera measures the time of light, not angles.

    Returns
    -------
    np.ndarray [shape=(N, 3)]
        ``points`` themselves where the glass is flat and thin.

    Notes
    -----
    Exact but for the direction in which the hit is looked up on a surface whose slope is below 1 %.
    """
    thickness = mirror.glass_thickness
    if (mirror.sag == 0.0 or mirror.rectangle is None) and thickness == 0.0:
        return points
    return reflect(_through_glass(np.asarray(points, dtype=np.float64), mirror, time_of_flight), mirror)


def without_delay(image: RgbdImage, mirrors: Sequence[Mirror]) -> RgbdImage:
    """The depth without what glass delays light that passes it, for a camera that measures time.

    Readings in thick glass are drawn nearer, each on its ray, by 2 T (n - 1/n) / cos θ'; ``image`` itself where no
    glass is thick.
    """
    thick = [m for m in mirrors if m.glass_thickness != 0.0]
    if not thick:
        return image
    depth, intrinsics = image.depth.copy(), image.intrinsics
    for mirror in thick:
        x = (np.arange(intrinsics.width) - intrinsics.cx) / intrinsics.fx
        y = (np.arange(intrinsics.height) - intrinsics.cy) / intrinsics.fy
        n = mirror.normal
        fall = n[0] * x + (n[1] * y + n[2])[:, None]  # of a ray, for each metre of z
        at = np.where(fall < -1e-6, (n @ mirror.point) / np.where(fall < -1e-6, fall, -1.0), np.inf)
        inside = (at > 0.0) & (depth > at + _BEHIND)
        for axis in range(2) if mirror.rectangle is not None else ():
            along = mirror.basis[:, axis]
            place = at * (along[0] * x + (along[1] * y + along[2])[:, None]) - along @ mirror.point
            inside &= (place > mirror.rectangle[axis, 0]) & (place < mirror.rectangle[axis, 1])  # type: ignore[index]
        rows, columns = np.nonzero(inside)
        length = np.sqrt(1.0 + x[columns] ** 2 + y[rows] ** 2)
        cosine = -fall[rows, columns] / length
        delay = 2.0 * mirror.glass_thickness * (REFRACTION**2 - 1.0) / np.sqrt(REFRACTION**2 - 1.0 + cosine**2)
        depth[rows, columns] -= (delay / length).astype(depth.dtype)
    return image.with_depth(depth)


def _through_glass(points: np.ndarray, mirror: Mirror, time_of_flight: bool) -> np.ndarray:
    """Where the readings (N, 3) really are: their rays reflected by the glass as it is [m]."""
    a, b, n = mirror.basis.T
    reach = np.linalg.norm(points, axis=1)
    rays = points / np.maximum(reach, 1e-9)[:, None]
    fall = np.minimum(rays @ n, -1e-6)  # towards the glass
    height = -(mirror.point @ n)  # of the camera over the plane, along n
    normals = np.broadcast_to(n, rays.shape)
    level = np.zeros(len(rays))  # of the surface over the plane, where the ray meets it
    share = -height / fall
    if mirror.sag != 0.0 and mirror.rectangle is not None:
        axis, middle, length = long_axis(mirror)
        along = (a, b)[axis]
        for _ in range(3):  # the slope is so small that each round brings hundreds of times as near
            place = share * (rays @ along) - mirror.point @ along
            level = mirror.sag * bow_profile(mirror, place)
            share = (level - height) / fall
        slope = 8.0 * mirror.sag * (place - middle) / length**2
        normals = n + slope[:, None] * along
        normals = normals / np.linalg.norm(normals, axis=1)[:, None]
    cosine = -np.einsum("ni,ni->n", rays, normals)
    rest = reach
    if mirror.glass_thickness != 0.0:
        inside = np.sqrt(np.maximum(REFRACTION**2 - 1.0 + cosine**2, 0.0))  # n cos θ'
        share = share + mirror.glass_thickness * (cosine / inside - 1.0 / REFRACTION) / np.maximum(-fall, 1e-6)
        if time_of_flight:
            longer = 2.0 * mirror.glass_thickness * (REFRACTION - 1.0 / REFRACTION)
            rest = reach - longer * REFRACTION / inside
    turned = rays + 2.0 * cosine[:, None] * normals
    return share[:, None] * rays + (rest - share)[:, None] * turned


def bow_moves(mirror: Mirror, points: np.ndarray) -> np.ndarray:
    """How the real places of readings ``points`` (N, 3), where the camera sees them, change with the sag (N, 3)."""
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    more, less = (
        _through_glass(points, replace(mirror, sag=mirror.sag + step), False) for step in (_STEP, -_STEP)
    )  # fmt: skip
    return (more - less) / (2.0 * _STEP)


def thickness_moves(mirror: Mirror, points: np.ndarray, time_of_flight: bool) -> np.ndarray:
    """How the real places of readings ``points`` (N, 3) change with the thickness, behind a front that stays (N, 3)."""
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)

    def at(thickness: float) -> np.ndarray:
        behind = mirror.point - (thickness - mirror.glass_thickness) / REFRACTION * mirror.normal
        return _through_glass(points, replace(mirror, point=behind, glass_thickness=thickness), time_of_flight)

    return (at(mirror.glass_thickness + _STEP) - at(mirror.glass_thickness)) / _STEP


def with_thickness(mirrors: Sequence[Mirror], thickness: float) -> list[Mirror]:
    """The mirrors, those whose glass counts as thin with a given ``thickness`` [m]."""
    return [m if m.glass_thickness or not thickness else replace(m, glass_thickness=thickness) for m in mirrors]


def behind_front(mirror: Mirror, thickness: float) -> Mirror:
    """The mirror, given by the front of its glass, with its plane where glass of a ``thickness`` [m] reflects."""
    if thickness == 0.0:
        return mirror
    return replace(
        mirror,
        point=mirror.point - thickness / REFRACTION * mirror.normal,
        glass_thickness=mirror.glass_thickness + thickness,
    )
