"""How well each colour view shows each vertex (not hidden, away from outlines, facing, near); which shows it best."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..camera import Intrinsics
from ..mesh import Mesh
from ..mesh.normals import vertex_normals
from ..numeric.kernels import njit
from .color_cameras import ColorView

_WIDEST = 1600  # longest side of the depth buffers [px]
_JUMP = 0.02, 4.0  # neighbours at a larger distance are an outline: [m], and pixels that steep skin spans
_TOLERANCE = 0.006  # a vertex so far behind the depth buffer is still what is seen there [m]
_NEAREST = 0.05  # what is nearer than this to a camera is behind it [m]
_RIM, _INSIDE = 1.0, 6.0  # nothing is taken so near to an outline; from there on colours are worth their all [px]
_AT_RIM, _CERTAIN = 0.02, 0.15  # what colours at the rim are worth; and where nothing is mixed with filled skin
# Of the cosine: twice for pixels a square metre, and twice since errors of the surface move colours by its tangent.
_POWER = 4.0
_GRAZING = 0.08  # cosine below which nothing is taken
_ROUNDS = 8
_LOYALTY = 0.35  # by how much a view is worth more where a triangle's three neighbours take it


class Seen(NamedTuple):
    """What K views show of V vertices.

    Attributes
    ----------
    score : np.ndarray [shape=(V, K), dtype=float32]
        Pixels a square metre of skin, times the cosine's cube, less near outlines; 0 = not seen.
    pixels : np.ndarray [shape=(V, K, 2), dtype=float32]
        Where in the image [px].
    cosine : np.ndarray [shape=(V, K), dtype=float32]
        Of the angle between the normal and the way to the camera; 0 where it is not seen.
    worth : np.ndarray [shape=(V, K), dtype=float32]
        0..1: how far from outlines; 0 where it is not seen.
    """

    score: np.ndarray
    pixels: np.ndarray
    cosine: np.ndarray
    worth: np.ndarray


class DepthBuffer(NamedTuple):
    """What a view sees of a mesh: z of each pixel (h, w) float32, inf for nothing, and the image's scale."""

    depth: np.ndarray
    scale: float


def seen_vertices(mesh: Mesh, views: Sequence[ColorView], shifts: np.ndarray) -> Seen:
    """How well each view shows each vertex.

    Parameters
    ----------
    mesh : Mesh
    views : sequence of ColorView
    shifts : np.ndarray [shape=(K, 2)]
        By how much each view's image lies beside where its camera sees the mesh [px].

    Notes
    -----
    O(T + pixels) a view.
    """
    normals = vertex_normals(mesh.vertices, mesh.triangles)
    score = np.zeros((len(mesh.vertices), len(views)), np.float32)
    pixels = np.zeros((len(mesh.vertices), len(views), 2), np.float32)
    cosines, worths = np.zeros(score.shape, np.float32), np.zeros(score.shape, np.float32)
    for k, view in enumerate(views):
        points = mesh.vertices @ view.from_avatar[:3, :3].T + view.from_avatar[:3, 3]
        z = np.maximum(points[:, 2], _NEAREST)
        lens = view.intrinsics
        at = points[:, :2] / z[:, None] * (lens.fx, lens.fy) + (lens.cx, lens.cy)
        pixels[:, k] = at + shifts[k]
        buffer = depth_buffer(mesh, view.from_avatar, lens)
        worth = _worth(mesh, view, buffer)
        towards = np.linalg.inv(view.from_avatar)[:3, 3] - mesh.vertices
        cosine = np.einsum("vi,vi->v", normals, towards) / np.linalg.norm(towards, axis=1)
        u, v = np.rint((at + 0.5) * buffer.scale - 0.5).astype(np.int64).T
        inside = (u >= 0) & (v >= 0) & (u < worth.shape[1]) & (v < worth.shape[0]) & (points[:, 2] > _NEAREST)
        u, v = np.clip(u, 0, worth.shape[1] - 1), np.clip(v, 0, worth.shape[0] - 1)
        pixel = z / (lens.fx * buffer.scale)
        slack = _TOLERANCE + 1.5 * pixel * np.sqrt(1 - np.clip(cosine, 0, 1) ** 2) / np.maximum(cosine, _GRAZING)
        shown = inside & (cosine > _GRAZING) & (z <= buffer.depth[v, u] + slack)
        within = (pixels[:, k] > 1).all(axis=1) & (pixels[:, k] < (lens.width - 2, lens.height - 2)).all(axis=1)
        score[:, k] = np.where(shown & within, worth[v, u] * lens.fx * lens.fy * cosine**_POWER / (z * z), 0.0)
        cosines[:, k] = np.where(score[:, k] > 0, cosine, 0.0)
        worths[:, k] = np.where(score[:, k] > 0, worth[v, u], 0.0)
    return Seen(score, pixels, cosines, worths)


def choose_views(seen: Seen, triangles: np.ndarray, twin: np.ndarray) -> np.ndarray:
    """The view (T,) int64 that shows each triangle best; -1 where none shows all its corners.

    Borders between views run where both are as good, and straight: a view is worth a little more where the neighbours
    take it (iterated conditional modes, Besag 1986).
    """
    score = seen.score[triangles]
    score = np.where((score > 0).all(axis=1), score.mean(axis=1), 0.0)
    neighbour = np.where(twin >= 0, twin // 3, np.arange(len(twin)) // 3).reshape(-1, 3)
    for _ in range(3):  # borders follow the body, not its triangles
        around = (score[neighbour] > 0) * score[neighbour]
        score = np.where(score > 0, 0.25 * score + 0.25 * around.sum(axis=1), 0.0)
    label = np.where(score.max(axis=1) > 0, score.argmax(axis=1), -1)
    views = np.arange(score.shape[1])
    for _ in range(_ROUNDS):
        alike = (label[neighbour][:, :, None] == views).mean(axis=1)
        worth = score * (1.0 + _LOYALTY * alike)
        new = np.where(score.max(axis=1) > 0, worth.argmax(axis=1), -1)
        if (new == label).all():
            break
        label = new
    return label


def view_weights(label: np.ndarray, seen: Seen, triangles: np.ndarray) -> np.ndarray:
    """Share (V, K + 1) float32 of each view at each vertex, the last of filled skin; rows sum to 1.

    That of the triangles around it that take the view, and none of views that do not show it: views pass into each
    other within the triangles along their border, and into filled skin towards outlines.
    """
    count, views = seen.score.shape
    weight = np.zeros((count, views + 1))
    taken = np.where(label < 0, views, label)
    for k in range(3):
        weight += np.bincount(triangles[:, k] * (views + 1) + taken, minlength=count * (views + 1)).reshape(
            count, views + 1
        )
    weight[:, :views][seen.score <= 0] = 0.0
    certain = np.clip((seen.worth - _AT_RIM) / (_CERTAIN - _AT_RIM), 0.0, 1.0)
    weight[:, views] += (weight[:, :views] * (1.0 - certain)).sum(axis=1)
    weight[:, :views] *= certain
    weight[weight.sum(axis=1) == 0, views] = 1.0
    return (weight / weight.sum(axis=1, keepdims=True)).astype(np.float32)


def depth_buffer(mesh: Mesh, from_avatar: np.ndarray, intrinsics: Intrinsics) -> DepthBuffer:
    """Z of the nearest surface in each pixel of an image at most ``_WIDEST`` px wide."""
    scale = min(1.0, _WIDEST / max(intrinsics.width, intrinsics.height))
    width, height = (max(1, round(scale * n)) for n in (intrinsics.width, intrinsics.height))
    points = mesh.vertices @ from_avatar[:3, :3].T + from_avatar[:3, 3]
    z = np.maximum(points[:, 2], 1e-6)
    corners = np.empty((len(points), 3))
    corners[:, 0] = (points[:, 0] / z * intrinsics.fx + intrinsics.cx + 0.5) * scale - 0.5
    corners[:, 1] = (points[:, 1] / z * intrinsics.fy + intrinsics.cy + 0.5) * scale - 0.5
    corners[:, 2] = np.where(points[:, 2] > _NEAREST, 1.0 / z, -1.0)
    inverse = np.zeros((height, width), np.float32)
    _depth_kernel(corners, mesh.triangles, inverse)
    with np.errstate(divide="ignore"):
        return DepthBuffer(1.0 / inverse, scale)


def hidden_pixels(mesh: Mesh, view: ColorView, depth: np.ndarray, scale: float) -> np.ndarray:
    """Pixels, bool (h, w), that do not show the view: outside of the glass, or behind what stands before the mirror."""
    hidden = np.zeros(depth.shape, np.bool_)
    if view.outline is not None:
        hidden |= ~_inside_polygon((view.outline + 0.5) * scale - 0.5, depth.shape[1], depth.shape[0])
    if view.mirrored:
        hidden |= np.isfinite(depth_buffer(mesh, view.camera, view.intrinsics).depth)
    return hidden


def distance_to(place: np.ndarray) -> np.ndarray:
    """Distance (h, w) float32 of each pixel to the nearest where ``place`` (h, w) is true [px]."""
    distance = np.where(place, 0.0, 1e6).astype(np.float32)
    _distance_kernel(distance)
    return distance


def _worth(mesh: Mesh, view: ColorView, buffer: DepthBuffer) -> np.ndarray:
    """0..1 (h, w) float32: how much the colours of each pixel of a view are worth."""
    depth = buffer.depth
    edge = ~np.isfinite(depth) | hidden_pixels(mesh, view, depth, buffer.scale)
    steep = _JUMP[1] / (view.intrinsics.fx * buffer.scale)
    for axis in (0, 1):
        low, high = [slice(None)] * 2, [slice(None)] * 2
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        with np.errstate(invalid="ignore"):
            jump = np.abs(depth[tuple(high)] - depth[tuple(low)]) > _JUMP[0] + steep * depth[tuple(low)]
        edge[tuple(low)] |= jump
        edge[tuple(high)] |= jump
    # an outline's own pixels are half outside
    distance = distance_to(edge) / buffer.scale - 0.5
    share = np.clip((distance - _RIM) / (_INSIDE - _RIM), 0.0, 1.0)
    return np.where(distance > _RIM, _AT_RIM + (1 - _AT_RIM) * share, 0.0).astype(np.float32)


def _inside_polygon(polygon: np.ndarray, width: int, height: int) -> np.ndarray:
    """Pixels, bool (height, width), whose middle lies in a polygon (K, 2), by the even-odd rule."""
    x, y = np.arange(width)[None], np.arange(height)[:, None]
    inside = np.zeros((height, width), np.bool_)
    for (ax, ay), (bx, by) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if ay != by:
            crosses = (ay > y) != (by > y)
            inside ^= crosses & (x < (bx - ax) * (y - ay) / (by - ay) + ax)
    return inside


@njit(cache=True, nogil=True, error_model="numpy")
def _depth_kernel(corners, triangles, inverse):
    """Largest 1/z in each pixel; corners (V, 3) are pixels and 1/z, triangles with a corner behind are left out."""
    height, width = inverse.shape
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ax, ay, az = corners[a, 0], corners[a, 1], corners[a, 2]
        bx, by, bz = corners[b, 0], corners[b, 1], corners[b, 2]
        cx, cy, cz = corners[c, 0], corners[c, 1], corners[c, 2]
        if az < 0.0 or bz < 0.0 or cz < 0.0:
            continue
        doubled = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if doubled == 0.0:
            continue
        u0, u1 = max(int(np.ceil(min(ax, bx, cx))), 0), min(int(np.floor(max(ax, bx, cx))), width - 1)
        v0, v1 = max(int(np.ceil(min(ay, by, cy))), 0), min(int(np.floor(max(ay, by, cy))), height - 1)
        for v in range(v0, v1 + 1):
            for u in range(u0, u1 + 1):
                wb = ((u - ax) * (cy - ay) - (v - ay) * (cx - ax)) / doubled
                wc = ((bx - ax) * (v - ay) - (by - ay) * (u - ax)) / doubled
                if wb >= 0.0 and wc >= 0.0 and wb + wc <= 1.0:
                    z = az + wb * (bz - az) + wc * (cz - az)
                    if z > inverse[v, u]:
                        inverse[v, u] = z


@njit(cache=True, nogil=True)
def _distance_kernel(distance):
    """Chamfer distance (H, W) to where it is 0, in place, in pixels: Borgefors 1986, steps of 1 and √2."""
    height, width = distance.shape
    across = np.float32(np.sqrt(2.0))
    one = np.float32(1.0)
    for v in range(height):
        for u in range(width):
            d = distance[v, u]
            if v > 0:
                d = min(d, distance[v - 1, u] + one)
                if u > 0:
                    d = min(d, distance[v - 1, u - 1] + across)
                if u < width - 1:
                    d = min(d, distance[v - 1, u + 1] + across)
            if u > 0:
                d = min(d, distance[v, u - 1] + one)
            distance[v, u] = d
    for v in range(height - 1, -1, -1):
        for u in range(width - 1, -1, -1):
            d = distance[v, u]
            if v < height - 1:
                d = min(d, distance[v + 1, u] + one)
                if u > 0:
                    d = min(d, distance[v + 1, u - 1] + across)
                if u < width - 1:
                    d = min(d, distance[v + 1, u + 1] + across)
            if u < width - 1:
                d = min(d, distance[v, u + 1] + one)
            distance[v, u] = d
