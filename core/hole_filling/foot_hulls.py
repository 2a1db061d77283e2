"""Feet of which little was read: the least solid that stands on the floor and holds what was, to fill what was not."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..mesh import FILL, Mesh
from ..mesh.normals import triangle_normals, vertex_normals
from ..mesh.triangle_mesh import merge
from ..numeric.point_products import distances, dot
from ..patches.grid_triangulation import clean_patch
from ..views.free_space import FreeSpace, reach_before_empty

GUESSED = -2
"""View of vertices whose place is a guess: fairing may move them, but not as freely as what fills a hole."""

_LEVELS = np.array((0.008, 0.02, 0.03, 0.04, 0.05, 0.06, 0.075, 0.09, 0.105, 0.12))  # heights of a hull's rings [m]
_INSTEP = 7  # ring up to which a foot slopes evenly: nothing is hollow between its toes and its ankle
_ANKLE = (0.1, 0.17)  # between these heights above the floor the legs stand apart [m]
_SLANTS, _ABOVE = 0.06, 0.04  # what lies higher, and so much above a ring, says nothing of it: a leg slants [m]
_LEG = 0.18  # a leg is nowhere so wide there [m]
_LINK = 0.04  # so near in the plan readings are one leg's [m]
_SHIN = 0.3  # height up to which a leg tells how it slants [m]
_SLANTED = 0.09  # above this height a leg slants as a whole [m]
_STEEPEST = 0.5  # a leg slants by no more: its way aside over its height
_ARCH = (0.22, 0.68)  # shares of a foot's length, from its heel, between which it is hollow on the inner side
_HOLLOW = (0.024, 0.03)  # so far in, and up to this height: half of what a bare foot is, as shoes are less so [m]
_LONG = 0.3  # a foot reaches no farther from the middle of its ankle [m]
_RAYS = 96  # of a ring
_FEWEST = 30  # readings of an ankle, and of what lies below it
_MEASURED, _BESIDE = 0.012, 0.008  # a hull is left out so near to what was read that faces the same way, or any way [m]
_SAME_WAY = 0.3  # cosine
_SPECK, _LEAST = 20, 0.0015  # triangles of a piece, and area [m²] of all, below which nothing was missed


def foot_hulls(patches: list[Mesh], free_space: FreeSpace, up: np.ndarray, floor: float) -> Mesh | None:
    """What was not read of feet that stand on the floor, as far as what was read of them tells; None where all was.

    A foot overhangs nowhere but at its arch, and is convex seen from above: at each height it is at least the convex
    hull of what was read of it at that height and above, where a leg that slants is followed. What lies beside a
    reading, and what was seen to be empty, is left out.

    Parameters
    ----------
    patches : list of Mesh
        One a view, camera frame.
    free_space : FreeSpace
    up : np.ndarray [shape=(3,)]
        Vertical.
    floor : float
        Height of the floor along ``up`` [m].

    Returns
    -------
    Mesh or None
        Open above and below; of no view, of kind ``FILL``.

    Notes
    -----
    O(P) of P readings near the floor.
    """
    some = [patch for patch in patches if len(patch.triangles)]
    points = np.concatenate([patch.vertices for patch in some])
    height = dot(points, up) - floor
    east = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    east /= np.linalg.norm(east)
    north = np.cross(up, east)
    every = np.column_stack((dot(points, east), dot(points, north), height))
    shin = every[(height > _ANKLE[0]) & (height < _SHIN)]
    low = np.flatnonzero((height > 0.0) & (height < _ANKLE[1]))
    if len(low) < _FEWEST:
        return None
    normals = np.concatenate([vertex_normals(patch.vertices, patch.triangles) for patch in some])[low]
    colors = [patch.colors for patch in some if patch.colors is not None]
    color = np.concatenate(colors)[low] if len(colors) == len(some) else None
    points, height, plan = points[low], height[low], every[low, :2]
    ankles = _ankles(plan[height > _ANKLE[0]])
    if not len(ankles):
        return None
    nearest = distances(plan, ankles)
    leg, away = nearest.argmin(axis=1), nearest.min(axis=1)
    hulls = []
    for k, ankle in enumerate(ankles):
        mine = (leg == k) & (away < _LONG)
        if mine.sum() < 2 * _FEWEST:
            continue
        levels = np.repeat(_LEVELS, _RAYS)[:, None] + floor
        axis = ankle[0] * east + ankle[1] * north + levels * up
        rings = _rings(plan[mine] - ankle, height[mine], _slant(shin, ankle))
        if len(ankles) > 1:
            rings = _with_arch(rings, ankles[np.argsort(np.linalg.norm(ankles - ankle, axis=1))[1]] - ankle)
        hull = Mesh(axis + rings @ np.stack((east, north)), _RING_TRIANGLES)
        missed = _not_read(hull, points[mine], normals[mine])
        missed &= reach_before_empty(axis, hull.vertices, free_space) >= 1.0
        rest = np.flatnonzero(missed[hull.triangles].all(axis=1))
        kind = np.full(len(rest), FILL, np.int8)
        hulls.append(replace(hull, triangles=hull.triangles[rest], view=_OF_NO_VIEW, kind=kind))
    missing = clean_patch(merge(hulls), _SPECK) if hulls else None
    if missing is None:
        return None
    area = 0.5 * np.linalg.norm(triangle_normals(missing.vertices, missing.triangles), axis=1).sum()
    if area < _LEAST:
        return None
    if color is not None:
        away = distances(missing.vertices, points)
        missing = replace(missing, colors=color[away.argmin(axis=1)])
    return missing


def _ankles(plan: np.ndarray) -> np.ndarray:
    """Middles (K, 2) of the legs that readings (N, 2) in the plan are of; none where they are no legs."""
    if len(plan) < _FEWEST:
        return np.empty((0, 2))
    cells, of = np.unique(np.floor(plan / _LINK).astype(np.int64), axis=0, return_inverse=True)
    label = np.arange(len(cells))
    beside = (np.abs(cells[:, None] - cells[None]) <= 1).all(axis=2)
    for _ in range(len(cells)):
        least = np.where(beside, label[None], len(cells)).min(axis=1)
        if (least == label).all():
            break
        label = least
    ankles = []
    for k in np.unique(label):
        leg = plan[label[of.ravel()] == k]
        if len(leg) < _FEWEST:
            continue
        if np.ptp(leg, axis=0).max() > _LEG:  # both legs, or what they are dressed in
            return np.empty((0, 2))
        ankles.append(0.5 * (leg.min(axis=0) + leg.max(axis=0)))
    return np.array(ankles).reshape(-1, 2)


def _slant(shin: np.ndarray, ankle: np.ndarray) -> np.ndarray:
    """By how much the leg over an ankle (2,) goes aside as it goes up (2,); ``shin``: readings of the legs (N, 3)."""
    parts = np.linspace(_ANKLE[0], _SHIN, 5)
    middles, heights, at = [], [], ankle
    for low, high in pairwise(parts):
        part = shin[(shin[:, 2] >= low) & (shin[:, 2] < high), :2]
        part = part[(np.abs(part - at) < 0.5 * _LEG).all(axis=1)]
        if len(part) < _FEWEST:
            break
        at = 0.5 * (part.min(axis=0) + part.max(axis=0))
        middles.append(at)
        heights.append(0.5 * (low + high))
    if len(middles) < 2:
        return np.zeros(2)
    return np.clip(np.polyfit(heights, np.array(middles), 1)[0], -_STEEPEST, _STEEPEST)


def _with_arch(rings: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """Rings (K · R, 2) that are hollow below the middle of the foot, on the side to which ``inner`` (2,) points."""
    levels = rings.reshape(len(_LEVELS), _RAYS, 2)
    toes = levels[0][np.argmax(np.linalg.norm(levels[0], axis=1))]
    toes = toes / np.linalg.norm(toes)
    aside = np.array((-toes[1], toes[0]))
    aside *= np.sign(aside @ inner)
    along, out = levels @ toes, levels @ aside
    share = (along - along[0].min()) / np.ptp(along[0])
    hollow = np.sin(np.pi * np.clip((share - _ARCH[0]) / (_ARCH[1] - _ARCH[0]), 0.0, 1.0))
    hollow *= _HOLLOW[0] * np.clip(1.0 - _LEVELS / _HOLLOW[1], 0.0, 1.0)[:, None]
    return (levels - np.minimum(hollow, np.maximum(out, 0.0))[:, :, None] * aside).reshape(-1, 2)


def _rings(plan: np.ndarray, height: np.ndarray, slant: np.ndarray) -> np.ndarray:
    """The hull (K · R, 2) at each of the levels, about the middle of the ankle, of readings (N, 2) at heights (N,)."""
    angle = 2.0 * np.pi * np.arange(_RAYS) / _RAYS
    way = np.column_stack((np.cos(angle), np.sin(angle)))
    reach = (plan - np.maximum(height - _SLANTED, 0.0)[:, None] * slant) @ way.T
    facing = way @ way.T
    rings = []
    for level in _LEVELS:
        above = (height >= level) & (height < max(_SLANTS, level + _ABOVE))  # a leg slants
        here = reach[above] + max(level - _SLANTED, 0.0) * (way @ slant)
        least = np.maximum(here.max(axis=0, initial=0.0), _BESIDE)  # of each ray's half plane
        with np.errstate(divide="ignore"):
            radius = np.where(facing > 1e-6, least[:, None] / np.maximum(facing, 1e-6), np.inf).min(axis=0)
        rings.append(radius)
    radii = np.stack(rings)
    for low in range(_INSTEP):  # as the steepest way to a higher ring
        share = (_LEVELS[low : _INSTEP + 1] - _LEVELS[low])[:, None]
        for high in range(low + 2, _INSTEP + 1):
            part = share[: high - low + 1] / share[high - low]
            radii[low : high + 1] = np.maximum(radii[low : high + 1], radii[low] + part * (radii[high] - radii[low]))
    return (radii[:, :, None] * way).reshape(-1, 2)


def _not_read(hull: Mesh, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Which vertices (V,) of a hull have no reading (N, 3) beside them or, facing the same way, below."""
    outwards = vertex_normals(hull.vertices, hull.triangles)
    away = distances(hull.vertices, points)
    below = (away < _MEASURED) & (outwards @ normals.T > _SAME_WAY)
    return ~((away < _BESIDE) | below).any(axis=1)


def _ring_triangles() -> np.ndarray:
    """Triangles (T, 3) between the rings, facing outwards."""
    here = np.arange(_RAYS)
    after = (here + 1) % _RAYS
    strips = [
        k * _RAYS + np.concatenate((
            np.column_stack((here, after, here + _RAYS)), np.column_stack((after, after + _RAYS, here + _RAYS))
        ))
        for k in range(len(_LEVELS) - 1)
    ]  # fmt: skip
    return np.concatenate(strips).astype(np.int32)


_RING_TRIANGLES = _ring_triangles()
_OF_NO_VIEW = np.full(len(_LEVELS) * _RAYS, GUESSED, np.int8)
