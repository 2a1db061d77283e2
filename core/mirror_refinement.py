"""A mirror's plane from all of its frame's pixels, and how sure it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numba import njit

from .camera import Intrinsics, project
from .mirror import Mirror, disparity_plane, frame_core, oriented, plane_covariance, plane_of_disparity


def fit_frame(
    mirror: Mirror,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    outward: float = 0.12,
    band: float = 0.02,
    inward: float = 0.02,
) -> Mirror | None:
    """The plane refitted to every reading on the frame: the ring about the glass, inside a thin slab about the plane.

    Parameters
    ----------
    mirror : Mirror
        With the glass's ``rectangle``; its plane is good to ``band``.
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    outward : float
        How far about the rectangle the frame is looked for [m]; half as far below it, where a floor may be.
    band : float
        Half thickness of the slab, relative to z.
    inward : float
        How far inside of the rectangle [m].

    Returns
    -------
    Mirror or None
        The plane turned and moved, its rectangle about the new point and grown to the frame; None when there are fewer
        than 30 pixels or all on one line.
    """
    rectangle = mirror.rectangle
    corners = np.array([(x, y) for x in rectangle[0] + (-outward, outward) for y in rectangle[1] + (-outward, outward)])
    box = project(mirror.point + corners @ mirror.basis[:, :2].T, intrinsics)
    size = (intrinsics.width, intrinsics.height)
    if np.isfinite(box).all():
        low = np.clip(np.floor(box.min(axis=0)), 0, size).astype(np.int64)
        high = np.clip(np.ceil(box.max(axis=0)) + 1, 0, size).astype(np.int64)
    else:  # reaches behind the camera
        low, high = np.zeros(2, np.int64), np.array(size)
    camera = np.array((intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy))
    normal, d = mirror.normal, float(mirror.normal @ mirror.point)
    pixels = np.empty((max(int(np.prod(np.maximum(high - low, 0))), 1), 2), np.int32)
    for turn in range(4):
        n = _ring_kernel(
            depth, camera, mirror.basis, mirror.point, normal, d, rectangle, outward, inward, band, low, high, pixels
        )  # fmt: skip
        if n < 30:
            return None
        u, v = pixels[:n].T
        z = depth[v, u]
        part = slice(None, None, 1 if turn else n // 1500 + 1)
        fitted = disparity_plane(u[part], v[part], z[part])
        if fitted is None:
            return None
        previous = normal, d
        normal, d = plane_of_disparity(fitted.coefficients, intrinsics)
        if normal @ previous[0] < 0:
            normal, d = -normal, -d
        moved = np.arccos(min(normal @ previous[0], 1.0)) + abs(d - previous[1])
        if turn and moved < 1e-3:  # the slab is centred well enough
            break
    mask = np.zeros(high[::-1] - low[::-1], np.bool_)
    mask[v - low[1], u - low[0]] = True
    v, u = np.nonzero(frame_core(mask))
    u, v = u + low[0], v + low[1]
    core = disparity_plane(u, v, depth[v, u])
    if core is None:
        return None
    turned, d = plane_of_disparity(core.coefficients, intrinsics)
    normal, d = (turned, d) if turned @ normal > 0 else (-turned, -d)
    point = mirror.point - (normal @ mirror.point - d) * normal
    basis = oriented(normal, point, mirror.basis[:, 1])[1]
    kept = core.weights > 0.1
    rays = np.column_stack(((u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy, np.ones(len(u))))
    offset = (rays * depth[v, u][:, None])[kept] - point
    extent = np.quantile(offset @ basis[:, :2], (0.005, 0.995), axis=0).T
    return replace(
        mirror,
        point=point,
        normal=basis[:, 2],
        basis=basis,
        rectangle=np.column_stack(
            (np.minimum(rectangle[:, 0], extent[:, 0]), np.maximum(rectangle[:, 1], extent[:, 1]))
        ),
        residual=float(np.sqrt(np.mean((offset @ basis[:, 2]) ** 2))),
        points_used=int(kept.sum()),
        refined=True,
        covariance=plane_covariance(core, intrinsics, point, basis),
    )


@njit(cache=True, nogil=True)
def _ring_kernel(depth, camera, basis, center, normal, d, rectangle, outward, inward, band, low, high, pixels):
    """Pixels within ``band``·z of the plane whose place on it is about, not inside, the rectangle."""
    fx, fy, cx, cy = camera
    n = 0
    p = np.empty(3)
    for v in range(low[1], high[1]):
        for u in range(low[0], high[0]):
            z = depth[v, u]
            if z == 0:
                continue
            p[0], p[1], p[2] = (u - cx) / fx * z, (v - cy) / fy * z, z
            if abs(normal[0] * p[0] + normal[1] * p[1] + normal[2] * p[2] - d) > band * z:
                continue
            inside, about = True, True
            for k in range(2):
                s = 0.0
                for c in range(3):
                    s += basis[c, k] * (p[c] - center[c])
                if not rectangle[k, 0] + inward < s < rectangle[k, 1] - inward:
                    inside = False
                if not rectangle[k, 0] - outward < s < rectangle[k, 1] + outward / (k + 1):
                    about = False
            if about and not inside:
                pixels[n, 0], pixels[n, 1] = u, v
                n += 1
    return n
