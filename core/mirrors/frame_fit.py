"""The plane of a mirror that is roughly known, fitted anew to its frame, and not to a wall that crosses it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ..camera import RgbdImage, project
from ..numeric.kernels import njit
from ..numeric.point_products import dot
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
from .glass_extent import with_outline
from .glass_kernels import glass_of, in_box, place_on_plane
from .mirror import Mirror, oriented, person_before, reflection_shift
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


_SIDES = ((0, 0), (0, 1), (1, 0))  # left, right and top; below there is the floor
_BESIDE = 0.16  # m: so far beyond a side a wall is looked for
_BAND, _REMOVED = 0.08, 0.3  # m: so far off the mirror's plane it is looked for, and taken away
_STEEP = 0.07  # of a wall against the plane: walls that the mirror hangs on are parallel to it
_STARTS, _MARGIN = 0.035, 0.02  # m: at the side such a wall lies in the plane; so far before it nothing is certain
_GOES_ON = 0.07  # m beyond the side, at least
_CELL = 0.02  # m: of the plane beside the side; readings in one are averaged
_FEWEST, _FEWEST_CELLS = 4, 20  # readings of a cell, and cells of a wall
_ALONG, _PART = 0.5, 0.1  # of the side that the wall must go on beside, by parts so long [m]
_DEVIATIONS = 8.0  # from level
_STRAIGHT = 0.006  # m by which the means of cells are off at most: a wall is flat
_ROUNDS, _MAD, _LEAST_SCALE = 5, 1.4826, 1e-5  # of weighing the cells anew; [m]
_BAND_AGAIN = 0.03  # of z: the plane may have been off by so much
_MOST = 0.15  # m: by more the reflection of a person is not off, or there is no plane without the wall


def without_crossing_walls(image: RgbdImage, mirrors: Sequence[Mirror]) -> tuple[RgbdImage, list[Mirror]]:
    """Mirrors on the planes of their other sides, where a wall crosses their planes at one of them.

    A wall is wider than a frame, and where it crosses the plane it lies in that: a plane through both is neither's.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m], 0 = no reading.
    mirrors : sequence of Mirror
        On what was taken for their frames; those that were not fitted to one stay.

    Returns
    -------
    image : RgbdImage
        Without these walls.
    mirrors : list of Mirror

    Notes
    -----
    O(pixels about the mirrors).
    """
    out = list(mirrors)
    for k, mirror in enumerate(mirrors):
        if mirror.rectangle is None or mirror.polygon is not None or not mirror.refined:
            continue
        rows, columns, place, lift = _about(image, mirror)
        walls = [(_wall_beside(place, lift, mirror, axis, end), axis, end) for axis, end in _SIDES]
        (slope, start), axis, end = max(walls)
        if slope < _STEEP:
            continue
        beyond = (2 * end - 1) * (place[:, axis] - mirror.rectangle[axis, end]) > -max(start, 0.0) / slope - _MARGIN
        depth = image.depth.copy()
        depth[rows[beyond], columns[beyond]] = 0.0
        bare = image.with_depth(depth)
        again = fit_frame(bare, mirror, band=_BAND_AGAIN)
        if again is not None and reflection_shift(person_before(mirror), again, mirror) < _MOST:
            image, out[k] = bare, with_outline(again, image.intrinsics)
    return image, out


def _about(image: RgbdImage, mirror: Mirror) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Readings near the mirror's plane about its glass: rows, columns, places (N, 2) on it, and before it (N,) [m]."""
    intrinsics = image.intrinsics
    assert mirror.rectangle is not None  # it was asked for
    outer = mirror.rectangle + np.array((-_BESIDE, _BESIDE))
    corners = np.array([(x, y) for x in outer[0] for y in outer[1]])
    box = project(mirror.point + corners @ mirror.basis[:, :2].T, intrinsics)
    size = np.array((intrinsics.width, intrinsics.height))
    if not np.isfinite(box).all():
        box = np.array(((0.0, 0.0), size))
    (left, top), (right, bottom) = (
        np.clip(np.floor(box.min(axis=0)), 0, size).astype(int), np.clip(np.ceil(box.max(axis=0)), 0, size).astype(int)
    )  # fmt: skip
    rows, columns = np.nonzero(image.depth[top:bottom, left:right])
    rows, columns = rows + top, columns + left
    z = image.depth[rows, columns].astype(np.float64)
    x, y = (columns - intrinsics.cx) / intrinsics.fx * z, (rows - intrinsics.cy) / intrinsics.fy * z
    offset = np.column_stack((x, y, z)) - mirror.point
    lift = dot(offset, mirror.normal)
    near = np.abs(lift) < _REMOVED
    return rows[near], columns[near], offset[near] @ mirror.basis[:, :2], lift[near]


def _wall_beside(place: np.ndarray, lift: np.ndarray, mirror: Mirror, axis: int, end: int) -> tuple[float, float]:
    """How steeply what lies beside a side rises away from it, and from which height [m]; 0 where it is no such wall."""
    assert mirror.rectangle is not None  # it was asked for
    out = (2 * end - 1) * (place[:, axis] - mirror.rectangle[axis, end])
    low, high = mirror.rectangle[1 - axis]
    mine = (
        (np.abs(lift) < _BAND)
        & (out > 0.0)
        & (out < _BESIDE)
        & (place[:, 1 - axis] > low)
        & (place[:, 1 - axis] < high)
    )
    out, lift, along = out[mine], lift[mine], place[mine, 1 - axis] - low
    cell = (out / _CELL).astype(np.int64) * 1000 + (along / _CELL).astype(np.int64)
    _, member, count = np.unique(cell, return_inverse=True, return_counts=True)
    kept = count >= _FEWEST
    if kept.sum() < _FEWEST_CELLS:
        return 0.0, 0.0
    far, rise, at = (np.bincount(member, value)[kept] / count[kept] for value in (out, lift, along))
    weights = np.ones(len(far))
    for _ in range(_ROUNDS):
        rows = np.column_stack((np.ones(len(far)), far)) * weights[:, None]
        (start, slope), *_ = np.linalg.lstsq(rows, rise * weights, rcond=None)
        left = rise - start - slope * far
        scale = _MAD * float(np.median(np.abs(left))) + _LEAST_SCALE
        weights = 1.0 / np.sqrt(1.0 + (left / (2.0 * scale)) ** 2)
    error = scale / np.sqrt(len(far)) / max(float(far.std()), _LEAST_SCALE)
    beside = len(np.unique((at[far > 0.5 * _GOES_ON] / _PART).astype(np.int64))) * _PART
    crosses = (
        slope > _DEVIATIONS * error and abs(start) < _STARTS and np.ptp(far) > _GOES_ON
        and beside > _ALONG * (high - low) and scale < _STRAIGHT
    )  # fmt: skip
    return (float(slope), float(start)) if crosses else (0.0, 0.0)
