"""The light that reaches each reading, told from a closed surface instead of from the readings themselves.

What two ways of light make of a reading depends on which way the skin faces and on what shades it. Readings that such
light falsified bend the surface that they show; a closed surface, which also goes on where nothing is read, tells both
more surely.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..camera import Intrinsics, RgbdImage
from ..mirrors import Mirror
from ..mirrors.curved_glass import REFRACTION, flattened, without_delay
from ..mirrors.mirror import reflect
from ..numeric.kernels import njit
from ..numeric.point_products import lengths
from ..numeric.threads import each
from .irradiance import light_sources, ratio_to_own, seen_at, through_glass
from .lit_scene import REFLECTIVITY
from .phase_response import PhaseResponse, bias_and_change

_NEAREST_Z = 0.05  # triangles with a corner nearer than this are not seen [m]
_OCCLUDED = 0.03  # surface so much nearer than a point, in its line of sight, hides it [m]
_LEAST_FACING = 0.05  # cosine of a reading's incidence: it was read, so that it faces its view
_RATIO_ERROR = 0.3  # share of the predicted ratio of light that it may be wrong by


@dataclass(frozen=True)
class LitReadings:
    """The subject's readings as the camera gave them, where light comes two ways.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m], 0 = no reading.
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel of the subject, -1 = none.
    spoiled : np.ndarray [shape=(H, W), dtype=bool]
        Readings that are not to be trusted, by what they show themselves.
    response : PhaseResponse or None
        What the camera makes of light that comes two ways; None when it could not be learnt.
    """

    image: RgbdImage
    labels: np.ndarray
    spoiled: np.ndarray
    response: PhaseResponse | None


@dataclass(frozen=True)
class PlacedReadings:
    """Readings (N,) through mirrors as they are known to be, not corrected; camera frame [m].

    Parameters
    ----------
    view : np.ndarray [shape=(N,)]
    points, rays : np.ndarray [shape=(N, 3)]
        Where they really are, and the unit direction in which more depth would move them.
    spoiled : np.ndarray [shape=(N,), dtype=bool]
    response : PhaseResponse or None
    mirrors : sequence of Mirror
    sources : np.ndarray [shape=(M + 1, 3)]
        :func:`.irradiance.light_sources`; the views are seen from there, too.
    intrinsics : Intrinsics
    shape : tuple of int
        Rows and columns of the image.
    """

    view: np.ndarray
    points: np.ndarray
    rays: np.ndarray
    spoiled: np.ndarray
    response: PhaseResponse | None
    mirrors: Sequence[Mirror]
    sources: np.ndarray
    intrinsics: Intrinsics
    shape: tuple[int, ...]


class ShownSurface(NamedTuple):
    """What a view shows of a mesh: z (H, W) float32, 0 = nothing; triangle (H, W); shares (H, W, 2) of corners 2, 3."""

    z: np.ndarray
    triangle: np.ndarray
    shares: np.ndarray


class LightOnSurface(NamedTuple):
    """What a mesh says of readings (N,).

    Attributes
    ----------
    known : np.ndarray [shape=(N,), dtype=bool]
        The reading's ray meets the mesh.
    triangle, shares : np.ndarray [shape=(N,)], [shape=(N, 3)]
        Where, and the shares of the triangle's corners.
    normals : np.ndarray [shape=(N, 3)]
        Unit.
    facing : np.ndarray [shape=(N,)]
        Cosine of incidence of the ray.
    behind : np.ndarray [shape=(N,)]
        How far the reading, as it was read, lies behind the mesh along its ray [m].
    total : np.ndarray [shape=(N,)]
        The other ways' light relative to that of the reading's own.
    bias, uncertain : np.ndarray [shape=(N,)]
        How much too far it should have been read, and what that may be wrong by [m].
    """

    known: np.ndarray
    triangle: np.ndarray
    shares: np.ndarray
    normals: np.ndarray
    facing: np.ndarray
    behind: np.ndarray
    total: np.ndarray
    bias: np.ndarray
    uncertain: np.ndarray


def placed_readings(lit: LitReadings, mirrors: Sequence[Mirror]) -> PlacedReadings:
    """The subject's readings where ``mirrors``, with the thickness and bow of their glass, place them."""
    image = without_delay(lit.image, mirrors)
    rows, columns = np.nonzero((lit.labels >= 0) & (image.depth > 0))
    view, camera = lit.labels[rows, columns].astype(np.intp), image.intrinsics
    x, y = (columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy
    points = np.column_stack((x, y, np.ones(len(rows)))) * image.depth[rows, columns].astype(np.float64)[:, None]
    for k, mirror in enumerate(mirrors, start=1):
        mine = view == k
        points[mine] = reflect(flattened(points[mine], mirror), mirror)
    sources = light_sources(list(mirrors))
    rays = points - sources[view]
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    return PlacedReadings(
        view, points, rays, lit.spoiled[rows, columns], lit.response, mirrors, sources, camera, image.depth.shape
    )


def shown_surfaces(vertices: np.ndarray, triangles: np.ndarray, readings: PlacedReadings) -> list[ShownSurface]:
    """What each view of the readings shows of a mesh: vertices (V, 3), triangles (T, 3), int32."""

    def show(view: int) -> ShownSurface:
        placed, camera = vertices if view == 0 else reflect(vertices, readings.mirrors[view - 1]), readings.intrinsics
        z = np.maximum(placed[:, 2], 1e-6)
        corners = np.column_stack((
            placed[:, 0] / z * camera.fx + camera.cx, placed[:, 1] / z * camera.fy + camera.cy,
            np.where(placed[:, 2] > _NEAREST_Z, 1.0 / z, -1.0),
        ))  # fmt: skip
        nearness = np.zeros(readings.shape, np.float32)
        triangle, shares = np.full(readings.shape, -1, np.int32), np.zeros((*readings.shape, 2), np.float32)
        _show_kernel(corners, triangles, nearness, triangle, shares)
        nearness[triangle >= 0] = 1.0 / nearness[triangle >= 0]
        return ShownSurface(nearness, triangle, shares)

    return each(show, range(len(readings.sources)))


def light_on_surface(
    readings: PlacedReadings,
    vertices: np.ndarray,
    triangles: np.ndarray,
    normals: np.ndarray,
    shown: Sequence[ShownSurface],
) -> LightOnSurface:
    """What two ways of light make of readings, if a mesh is the skin.

    Parameters
    ----------
    readings : PlacedReadings
    vertices, normals : np.ndarray [shape=(V, 3)]
        Camera frame [m]; unit normals outwards.
    triangles : np.ndarray [shape=(T, 3), dtype=int32]
    shown : sequence of ShownSurface
        :func:`shown_surfaces` of it.

    Notes
    -----
    The sum of paths as in :mod:`.phase_response`: cos θ / r² from each source that nothing hides. O(N) and memory of
    300 bytes a reading.
    """
    count, view = len(readings.view), readings.view
    triangle, shares = np.full(count, -1, np.int32), np.zeros((count, 3))
    for k in range(len(readings.sources)):
        mine = np.flatnonzero(view == k)
        y, x, _, inside = seen_at(readings.points[mine], k, list(readings.mirrors), readings.intrinsics)
        triangle[mine] = np.where(inside, shown[k].triangle[y, x], -1)
        shares[mine, 1:] = shown[k].shares[y, x]
    known = triangle >= 0
    shares[:, 0] = 1.0 - shares[:, 1] - shares[:, 2]
    corners = triangles[np.where(known, triangle, 0)]
    facing = np.einsum("nk,nkc->nc", shares, normals[corners])
    facing /= np.maximum(lengths(facing), 1e-9)[:, None]
    at = np.einsum("nk,nkc->nc", shares, vertices[corners])
    light, longer = np.zeros((count, len(readings.sources))), np.zeros((count, len(readings.sources)))
    for source, place in enumerate(readings.sources):
        away = at - place
        longer[:, source] = length = lengths(away)
        cosine = -np.einsum("nc,nc->n", away, facing) / np.maximum(length, 1e-9)
        y, x, z, inside = seen_at(at, source, list(readings.mirrors), readings.intrinsics)
        before = shown[source].z[y, x]
        reached = (cosine > 0) & inside & ~((before > 0) & (before < z - _OCCLUDED))
        if source > 0:
            mirror = readings.mirrors[source - 1]
            reached &= through_glass(at, mirror)
            longer[:, source] += 2.0 * mirror.glass_thickness * (REFRACTION - 1.0 / REFRACTION)
        own = view == source
        cosine[own] = np.maximum(cosine[own], _LEAST_FACING)
        light[:, source] = np.where(reached | own, cosine / length**2, 0.0) * (REFLECTIVITY if source else 1.0)
    ratio = ratio_to_own(light, view)
    longer -= longer[np.arange(count), view][:, None]
    bias, uncertain = bias_and_change(readings.response, ratio, longer, known, _RATIO_ERROR)
    behind = np.einsum("nc,nc->n", readings.points - at, readings.rays)
    incidence = -np.einsum("nc,nc->n", readings.rays, facing)
    return LightOnSurface(known, triangle, shares, facing, incidence, behind, ratio.sum(axis=1), bias, uncertain)


@njit(cache=True, nogil=True, error_model="numpy")
def _show_kernel(corners, triangles, nearness, triangle, shares):
    """Largest 1/z in each pixel, and whose; corners (V, 3) are pixels and 1/z, negative where they are not seen."""
    height, width = nearness.shape
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ax, ay, az = corners[a, 0], corners[a, 1], corners[a, 2]
        bx, by, bz = corners[b, 0] - ax, corners[b, 1] - ay, corners[b, 2]
        cx, cy, cz = corners[c, 0] - ax, corners[c, 1] - ay, corners[c, 2]
        doubled = bx * cy - by * cx
        if az < 0.0 or bz < 0.0 or cz < 0.0 or doubled == 0.0:
            continue
        left, right = np.ceil(ax + min(0.0, bx, cx)), np.floor(ax + max(0.0, bx, cx))
        top, bottom = np.ceil(ay + min(0.0, by, cy)), np.floor(ay + max(0.0, by, cy))
        for v in range(int(max(top, 0.0)), int(min(bottom, height - 1.0)) + 1):
            for u in range(int(max(left, 0.0)), int(min(right, width - 1.0)) + 1):
                wb = ((u - ax) * cy - (v - ay) * cx) / doubled
                wc = (bx * (v - ay) - by * (u - ax)) / doubled
                if wb >= 0.0 and wc >= 0.0 and wb + wc <= 1.0:
                    near = (1.0 - wb - wc) * az + wb * bz + wc * cz
                    if near > nearness[v, u]:
                        nearness[v, u], triangle[v, u] = near, t
                        shares[v, u, 0], shares[v, u, 1] = wb, wc
