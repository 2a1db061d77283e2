"""The plane of a mirror that is roughly known, fitted anew to its frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ..camera import RgbdImage, project
from ..numeric.kernels import njit
from .disparity_plane import (
    DisparityPlane,
    disparity_of_plane,
    disparity_plane,
    fit_core,
    plane_covariance,
    plane_of_disparity,
)
from .frame_pixels import grow_frame
from .frame_sides import WIDEST
from .glass_kernels import glass_of, in_box, place_on_plane
from .mirror import Mirror, oriented
from .wall_behind_frame import separate_wall


def fit_frame(
    image: RgbdImage,
    mirror: Mirror,
    outward: float = 0.12,
    band: float = 0.02,
    inward: float = 0.02,
    seeds: np.ndarray | None = None,
) -> Mirror | None:
    """The plane refitted to every reading on the frame: the ring about the glass, as far as it agrees with itself.

    Parameters
    ----------
    mirror : Mirror
        With the glass's ``rectangle``; its plane is good to ``band``.
    image : RgbdImage
        z [m], 0 = no reading.
    outward : float
        How far about the rectangle the frame is looked for [m]; half as far below it, where a floor may be.
    band : float
        Half thickness of the slab, relative to z.
    inward : float
        How far inside of the rectangle [m].
    seeds : np.ndarray [shape=(K, 2), dtype=int], optional
        Pixels (u, v) that are known to be the frame's; by default all of the ring are taken for it at first.

    Returns
    -------
    Mirror or None
        The plane rotated and moved, its rectangle about the new point and grown to the frame; None when there are fewer
        than 30 pixels or all on one line.
    """
    depth, intrinsics = image.depth, image.intrinsics
    focal = 0.5 * (intrinsics.fx + intrinsics.fy)
    plane = disparity_of_plane(mirror.normal, float(mirror.normal @ mirror.point), intrinsics)
    fitted = None
    for _ in range(2):
        ring_u, ring_v = _ring(image, mirror, plane, outward, band, inward)
        if len(ring_u) < 30:
            return None
        ring = np.zeros_like(depth)
        ring[ring_v, ring_u] = depth[ring_v, ring_u]
        if seeds is None:
            step = len(ring_u) // 1500 + 1
            first = disparity_plane(ring_u[::step], ring_v[::step], depth[ring_v, ring_u][::step])
            if first is None:
                return None
            plane = first.coefficients
            start = np.column_stack((ring_u, ring_v))[:: len(ring_u) // 60 + 1]
        else:
            start = _snapped(seeds, ring)
        grown = grow_frame(ring, start, plane, focal, band) if len(start) >= 3 else None
        if grown is None:
            break
        u, v, fitted = grown
        off = np.abs(fitted.coefficients - plane) @ (intrinsics.width, intrinsics.height, 1.0)
        plane = fitted.coefficients
        if off * mirror.point[2] < 2e-3:  # the ring is in the right place
            break
    if fitted is None:
        return None
    assert mirror.rectangle is not None
    separated = separate_wall(u, v, depth, fitted, intrinsics.packed, mirror.point, mirror.basis, mirror.rectangle)
    placed = _on_frame(image, mirror, separated.u, separated.v, separated.fitted, outward)
    assert placed.covariance is not None
    return replace(placed, covariance=placed.covariance + np.diag((0.0, 0.0, separated.depth_error**2)))


def without_frames(image: RgbdImage, mirrors: Iterable[Mirror]) -> np.ndarray:
    """The depth without what stands in the planes of mirrors about their glass.

    For fitting the frame of another mirror that crosses them: only its own readings may decide its plane.

    Parameters
    ----------
    mirrors : iterable of Mirror
        On the planes of their frames.
    image : RgbdImage
    """
    depth, intrinsics = image.depth, image.intrinsics
    out = depth.copy()
    for mirror in mirrors:
        plane = disparity_of_plane(mirror.normal, float(mirror.normal @ mirror.point), intrinsics)
        band = max(4.0 * mirror.residual, 0.004) / float(mirror.point[2])
        u, v = _ring(image, mirror, plane, 0.02, band, WIDEST)
        out[v, u] = 0.0
    return out


def _snapped(seeds: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """The seeds (K, 2), each on the nearest reading within two pixels; those without are left out."""
    height, width = depth.shape
    kept = []
    for u, v in np.rint(seeds).astype(int):
        u0, v0 = max(u - 2, 0), max(v - 2, 0)
        rows, columns = np.nonzero(depth[v0 : min(v + 3, height), u0 : min(u + 3, width)])
        if len(rows):
            nearest = np.argmin((rows + v0 - v) ** 2 + (columns + u0 - u) ** 2)
            kept.append((columns[nearest] + u0, rows[nearest] + v0))
    return np.array(kept, dtype=np.int64).reshape(-1, 2)


def _on_frame(
    image: RgbdImage, mirror: Mirror, u: np.ndarray, v: np.ndarray, fitted: DisparityPlane, outward: float
) -> Mirror:
    """The mirror on the plane of its frame's pixels, its rectangle grown to them.

    It does not grow on a side where they go on as far as was looked, ``outward`` [m]: that is the wall, not a frame.
    """
    depth, intrinsics = image.depth, image.intrinsics
    assert mirror.rectangle is not None
    kept = fitted.weights > 0.1
    core = fit_core(u, v, depth, fitted)
    normal, d = plane_of_disparity(core.coefficients, intrinsics)
    normal, d = (normal, d) if mirror.normal @ normal > 0 else (-normal, -d)
    point = mirror.point - (normal @ mirror.point - d) * normal
    basis = oriented(normal, point, mirror.basis[:, 1])[1]
    u, v = u[kept], v[kept]
    rays = np.column_stack(((u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy, np.ones(len(u))))
    offset = rays * depth[v, u][:, None] - point
    rectangle = mirror.rectangle.copy()
    extent = np.quantile(offset @ basis[:, :2], (0.005, 0.995), axis=0).T
    for axis in range(2):
        for end, sign in ((0, -1.0), (1, 1.0)):
            beyond = sign * (extent[axis, end] - rectangle[axis, end])
            if 0.0 < beyond < 0.8 * outward / (axis * end + 1):
                rectangle[axis, end] = extent[axis, end]
    return replace(
        mirror,
        point=point,
        normal=basis[:, 2],
        basis=basis,
        rectangle=rectangle,
        residual=float(np.sqrt(np.mean((offset @ basis[:, 2]) ** 2))),
        points_used=int(kept.sum()),
        refined=True,
        covariance=plane_covariance(core, intrinsics, point, basis),
    )


def _ring(
    image: RgbdImage, mirror: Mirror, plane: np.ndarray, outward: float, band: float, inward: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels u, v within ``band`` of the plane (3,) 1/z = a·u + b·v + c, about the rectangle but not inside."""
    depth, intrinsics = image.depth, image.intrinsics
    rectangle = mirror.rectangle
    assert rectangle is not None
    corners = np.array([(x, y) for x in rectangle[0] + (-outward, outward) for y in rectangle[1] + (-outward, outward)])
    box = project(mirror.point + corners @ mirror.basis[:, :2].T, intrinsics)
    size = (intrinsics.width, intrinsics.height)
    if np.isfinite(box).all():
        low = np.clip(np.floor(box.min(axis=0)), 0, size).astype(np.int64)
        high = np.clip(np.ceil(box.max(axis=0)) + 1, 0, size).astype(np.int64)
    else:  # reaches behind the camera
        low, high = np.zeros(2, np.int64), np.array(size)
    pixels = np.empty((max(int(np.prod(np.maximum(high - low, 0))), 1), 2), np.int32)
    around = rectangle + outward * np.array((((-1.0, 1.0), (-1.0, 0.5)),))  # half as far below, where a floor may be
    n = _ring_kernel(depth, intrinsics.packed, glass_of([mirror]), plane, around, inward, band, low, high, pixels)
    u, v = pixels[:n].T.astype(np.int64)
    return u, v


@njit(cache=True, nogil=True)
def _ring_kernel(depth, intrinsics, glass, plane, around, inward, band, low, high, pixels):
    """Write the pixels of the ring about the glass into ``pixels``; how many they are.

    They are within ``band``·z of the plane, in the box ``around`` (1, 2, 2) the glass, and not ``inward`` of its edges.
    """
    fx, fy, cx, cy = intrinsics
    n = 0
    for v in range(low[1], high[1]):
        for u in range(low[0], high[0]):
            z = np.float64(depth[v, u])
            if z == 0 or abs((plane[0] * u + plane[1] * v + plane[2]) * z - 1.0) > band:
                continue
            a, b = place_on_plane(glass, 0, (u - cx) / fx * z, (v - cy) / fy * z, z)
            if in_box(around, 0, a, b, 0.0) and not in_box(glass.limits, 0, a, b, inward):
                pixels[n, 0], pixels[n, 1] = u, v
                n += 1
    return n
