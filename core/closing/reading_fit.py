"""A closed surface that follows the readings once more, where light of two ways falsified them.

What the zipper got was corrected by what readings themselves said of the surface, or left out. The closed surface knows
better which light reaches it: by that all readings are corrected anew, also those that were left out, and the surface
is drawn to them, as far as they are certain and agree with it. What is certain already stays.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..hole_filling.thin_plate_fairing import neighbours
from ..light.surface_light import LightOnSurface, PlacedReadings, light_on_surface, shown_surfaces
from ..mesh import Mesh
from ..mesh.normals import vertex_normals
from ..mesh.self_intersections import self_intersections
from ..mesh.submesh import triangles_touching
from ..numeric.kernels import njit
from ..views.free_space import FreeSpace, reach_before_empty
from .self_intersection_repair import COLLISION_REACH, vertices_within

_FEWEST = 50  # readings that tell the noise of a view
_LEAST_NOISE, _USUAL_NOISE = 0.001, 0.01  # of a reading, and where too few tell it [m]
_MAD = 1.4826
_STEEP = 0.3  # cosine of incidence below which readings count less
_GRAZING = 0.15  # cosine below which their error across the surface does not get smaller
_FADE = 10  # rings about surface that light of two ways reaches, over which what borders on it gets more certain
_SOLE = 0.012  # surface so low over the floor is flat, and stays [m]
_CG_ERROR, _CG_ROUNDS = 0.03, 40  # of conjugate gradients
_MATTERS = 0.002  # so far outwards empty space is asked about [m]
_HELD_BACK = 3  # rings about what stops before empty space, that go less far
_REPAIRS = 4  # times that what runs through itself is moved back, three rings more each time


@dataclass(frozen=True)
class ReadingFitSettings:
    """How a surface follows readings where light comes two ways.

    Parameters
    ----------
    rounds : int
        Each predicts the light anew from the surface of the last.
    stiffness : float
        How smooth the displacement is: the square of that by which a vertex may leave the mean of its neighbours [m].
    certain, free : float
        How far surface moves that only light of one way reaches, and any other [m]; standard deviations.
    clean : float
        Ratio of the other ways' light to the own below which readings are as certain as their noise.
    outlier : float
        Deviations from which a reading counts less in the last round.
    wider : float
        Times that as many in each round before: a surface that was made where nothing was read may lie far from what
        is right, and what seems an outlier to it may not be one to the surface of the last round.
    farthest : float
        That surface moves in a round [m].
    even_normals : int
        Times that normals are averaged with those around: the noise of a surface is not its shape.
    """

    rounds: int = 4
    stiffness: float = 0.00055
    certain: float = 0.001
    free: float = 0.01
    clean: float = 0.02
    outlier: float = 4.0
    wider: float = 1.6
    farthest: float = 0.03
    even_normals: int = 4


DEFAULTS = ReadingFitSettings()


def fit_to_readings(
    mesh: Mesh,
    readings: PlacedReadings,
    up: np.ndarray,
    floor: float | None,
    settings: ReadingFitSettings = DEFAULTS,
    free_space: FreeSpace | None = None,
) -> Mesh:
    """The mesh drawn along its normals to readings that are corrected by the light which reaches it.

    Minimises Σ w (δ - h)² + |L δ|² / s² + Σ δ² / σ² over the displacement δ of each vertex: h from it to the readings
    about it, w their certainty (Cauchy's weight, squared, of what lies far off), L the mean of the neighbours less the
    vertex, and σ by how certain the vertex was. The weight forgives more in the first rounds (graduated non-convexity,
    Blake and Zisserman 1987).

    Parameters
    ----------
    mesh : Mesh
        Closed; camera frame.
    readings : PlacedReadings
    up : np.ndarray [shape=(3,)]
    floor : float or None
        Height of the floor along ``up`` [m].
    settings : ReadingFitSettings
    free_space : FreeSpace, optional
        What the views have seen to be empty: nothing is drawn outwards into it.

    Returns
    -------
    Mesh
        With the triangles of ``mesh``; no more of them run through each other. ``mesh`` itself where the camera's
        response is not known, or where that cannot be kept.

    Notes
    -----
    A round takes O(V + N) for V vertices and N readings, and 30 to 60 steps of conjugate gradients.
    """
    if readings.response is None or not len(readings.view):
        return mesh
    triangles = np.ascontiguousarray(mesh.triangles, np.int32)
    first = np.ascontiguousarray(mesh.vertices, np.float64)
    start, heads = neighbours(triangles, len(first))
    stiff = 1.0 / settings.stiffness**2
    held, moved, vertices = np.zeros(0), np.zeros(len(first)), first
    for ahead in reversed(range(settings.rounds)):
        normals = even_normals(vertices, triangles, start, heads, settings.even_normals)
        shown = shown_surfaces(vertices, triangles, readings)
        light = light_on_surface(readings, vertices, triangles, normals, shown)
        outlier = settings.outlier * settings.wider**ahead
        pull, weight, clean = _pulls(readings, light, triangles, len(first), settings.clean, outlier)
        if not len(held):
            held = 1.0 / settings.free**2 + _spread_least(clean, start, heads, _FADE) ** 2 / settings.certain**2
            if floor is not None:
                held[first @ up - floor < _SOLE] = 1.0 / settings.certain**2
        step = _smooth_kernel(start, heads, stiff, weight + held, weight * pull - held * moved, _CG_ERROR, _CG_ROUNDS)
        step = np.clip(step, -settings.farthest, settings.farthest)
        if free_space is not None:
            step *= _free_share(vertices, step[:, None] * normals, step > _MATTERS, free_space, start, heads)
        moved = moved + step
        vertices = vertices + step[:, None] * normals
    return _uncrossed(mesh, vertices, start, heads)


def even_normals(
    vertices: np.ndarray, triangles: np.ndarray, start: np.ndarray, heads: np.ndarray, rounds: int
) -> np.ndarray:
    """Unit vertex normals (V, 3), averaged with those of their one-rings ``rounds`` times."""
    normals = np.ascontiguousarray(vertex_normals(vertices, triangles).T)
    for _ in range(rounds):
        for part in normals:
            part[:] = 0.5 * (part + _around(part, start, heads))
    return np.ascontiguousarray((normals / np.maximum(np.linalg.norm(normals, axis=0), 1e-12)).T)


def _around(values: np.ndarray, start: np.ndarray, heads: np.ndarray) -> np.ndarray:
    """Mean over the one-ring of each vertex (V,)."""
    bent = np.empty(len(values))
    _bend(start, heads, values, bent)
    return bent + values


def _pulls(
    readings: PlacedReadings,
    light: LightOnSurface,
    triangles: np.ndarray,
    count: int,
    least: float,
    outlier: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each vertex: where readings about it lie along its normal [m], their weight [1/m²], which share is clean."""
    off = light.behind - light.bias
    alone = light.known & (light.total < least) & ~readings.spoiled
    noise = np.full(len(off), _USUAL_NOISE)
    for view in range(len(readings.sources)):
        mine = readings.view == view
        if (mine & alone).sum() > _FEWEST:
            noise[mine] = max(_MAD * float(np.median(np.abs(off[mine & alone]))), _LEAST_NOISE)
    noise = np.hypot(noise, light.uncertain)
    across = np.maximum(light.facing, _GRAZING)
    weight = np.where(light.known, 1.0 / (noise * across) ** 2, 0.0)
    weight *= np.clip(light.facing / _STEEP, 0.0, 1.0) / (1.0 + (off / (outlier * noise)) ** 2) ** 2
    corners = triangles[np.where(light.known, light.triangle, 0)].ravel()

    def total(values: np.ndarray) -> np.ndarray:
        return np.bincount(corners, (values[:, None] * light.shares).ravel(), minlength=count)

    weights, pulled = total(weight), total(-weight * light.facing * off)
    every, clean = total(light.known.astype(float)), total((alone & (np.abs(off) < 3.0 * noise)).astype(float))
    return pulled / np.maximum(weights, 1e-9), weights, clean / np.maximum(every, 1e-9)


def _free_share(
    vertices: np.ndarray,
    way: np.ndarray,
    asked: np.ndarray,
    free_space: FreeSpace,
    start: np.ndarray,
    heads: np.ndarray,
) -> np.ndarray:
    """Which share (V,) of their way (V, 3) vertices go: those ``asked`` about (V,) stop before empty space."""
    share = np.ones(len(vertices))
    share[asked] = reach_before_empty(vertices[asked], vertices[asked] + way[asked], free_space)
    return share if share.min() == 1.0 else _spread_least(share, start, heads, _HELD_BACK)


def _spread_least(share: np.ndarray, start: np.ndarray, heads: np.ndarray, rings: int) -> np.ndarray:
    """The share (V,) where it is not larger than around: what borders on the uncertain is less certain."""
    for _ in range(rings):
        share = np.minimum(share, 0.5 * (share + _around(share, start, heads)))
    return share


def _uncrossed(mesh: Mesh, vertices: np.ndarray, start: np.ndarray, heads: np.ndarray) -> Mesh:
    """The mesh with ``vertices``, those moved back whose triangles run through others; ``mesh`` if that is in vain."""
    before, share = np.ascontiguousarray(mesh.vertices, np.float64), np.ones(len(vertices))
    part, pairs, last = np.arange(len(mesh.triangles)), np.empty((0, 2), np.int32), share
    for repair in range(_REPAIRS):
        placed = before + share[:, None] * (vertices - before)
        if repair:  # elsewhere nothing crossed, and nothing was moved back
            changed = np.flatnonzero(share < last)
            changed = np.concatenate((changed, mesh.triangles[np.unique(pairs)].ravel()))
            near = vertices_within(placed, placed[changed], COLLISION_REACH)
            part = np.flatnonzero(triangles_touching(mesh.triangles, near))
        pairs = part[self_intersections(placed, mesh.triangles[part])]
        if not len(pairs):
            return replace(mesh, vertices=placed)
        last, back = share.copy(), np.zeros(len(share), np.bool_)
        back[mesh.triangles[np.unique(pairs)]] = True
        for _ in range(3 * repair + 3):
            back |= _around(back.astype(float), start, heads) > 0
        share[back] = 0.0
        for _ in range(4):
            share = np.minimum(share, 0.5 * (share + _around(share, start, heads)))
    # what the same part had before is known in a fraction of the time, and mostly enough
    kept = any(len(pairs) <= len(self_intersections(before, some)) for some in (mesh.triangles[part], mesh.triangles))
    return replace(mesh, vertices=placed) if kept else mesh


@njit(cache=True, nogil=True, error_model="numpy")
def _bend(start, heads, values, out):
    """Mean of the neighbours less the vertex."""
    for v in range(len(out)):
        total = 0.0
        for e in range(start[v], start[v + 1]):
            total += values[heads[e]]
        out[v] = total / max(start[v + 1] - start[v], 1) - values[v]


@njit(cache=True, nogil=True, error_model="numpy")
def _product(one, other):
    total = 0.0
    for v in range(len(one)):
        total += one[v] * other[v]
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _smooth_kernel(start, heads, stiff, diagonal, rhs, error, rounds):
    """Solve (stiff LᵀL + D) x = b by conjugate gradients (Hestenes and Stiefel 1952), scaled by the diagonal."""
    count = len(rhs)
    x, rest, bent, product = np.zeros(count), rhs.copy(), np.empty(count), np.empty(count)
    shared = np.empty(count)  # what of each vertex its neighbours have
    scale = np.empty(count)
    for v in range(count):
        scale[v] = 1.0 + diagonal[v] / stiff
        for e in range(start[v], start[v + 1]):
            scale[v] += 1.0 / (start[heads[e] + 1] - start[heads[e]]) ** 2
        scale[v] = 1.0 / (stiff * scale[v])
    ahead = scale * rest
    along, size = ahead.copy(), _product(rest, ahead)
    least = error * error * size
    for _ in range(rounds):
        if size <= least:
            break
        _bend(start, heads, along, bent)
        for v in range(count):
            shared[v] = bent[v] / (start[v + 1] - start[v])
        for v in range(count):  # Lᵀ
            total = 0.0
            for e in range(start[v], start[v + 1]):
                total += shared[heads[e]]
            product[v] = stiff * (total - bent[v]) + diagonal[v] * along[v]
        step = size / _product(along, product)
        for v in range(count):
            x[v] += step * along[v]
            rest[v] -= step * product[v]
            ahead[v] = scale[v] * rest[v]
        after = _product(rest, ahead)
        for v in range(count):
            along[v] = ahead[v] + after / size * along[v]
        size = after
    return x
