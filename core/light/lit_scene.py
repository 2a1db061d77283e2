"""A depth map with its views and mirrors, and the light that reaches what it shows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..camera import Intrinsics, RgbdImage
from ..mirrors import Mirror
from ..mirrors.mirror import reflect
from ..numeric.kernels import njit
from ..numeric.point_products import dot
from ..subject.subject_views import Views
from .irradiance import irradiance, light_sources
from .local_surface import local_surface

REFLECTIVITY = 0.85
"""Of glass in the near infrared, one pass; what it really is goes into the response's weights."""

_GAP = 10  # so far the subject goes on where nothing is read [px]


@dataclass(frozen=True)
class Surface:
    """Surface at some pixels: points, unit normals (N, 3) where they really are, view, z (N,) in it [m], 0 unknown."""

    points: np.ndarray
    normals: np.ndarray
    view: np.ndarray
    z: np.ndarray


class LitScene:
    """One depth map with its views and mirrors, while two-way light is looked for in it."""

    def __init__(self, image: RgbdImage, views: Views, mirrors: list[Mirror]) -> None:
        self.depth, self.intrinsics = image.depth, image.intrinsics
        self.views, self.mirrors = views, mirrors
        self.labels = views.labels
        self.sources = light_sources(mirrors)
        self.reflectivity = np.full(len(mirrors), REFLECTIVITY)

    @cached_property
    def hiding(self) -> tuple[np.ndarray, np.ndarray]:
        """Depth and labels (H, W) of what can hide a point from a source: the subject, unread parts of it too."""
        return grown_into_gaps(self.labels, self.depth)

    @cached_property
    def heights(self) -> np.ndarray:
        """Heights (H, W) of readings over the floor, which must be known [m]."""
        assert self.views.floor is not None
        return dot(self.views.points, self.views.up) - self.views.floor

    def surface(
        self, depth: np.ndarray, trusted: np.ndarray, rows: np.ndarray, columns: np.ndarray, reach: int = 0
    ) -> Surface:
        """Where the surface at some pixels really is, and which way it faces."""
        fitted = local_surface(depth, self.labels, trusted, rows, columns, self.intrinsics.packed, reach)
        view, normals = self.labels[rows, columns].astype(np.intp), fitted[:, :3].copy()
        for k, mirror in enumerate(self.mirrors, start=1):
            mine = view == k
            normals[mine] -= 2.0 * (normals[mine] @ mirror.normal)[:, None] * mirror.normal
        return Surface(self.place(rows, columns, fitted[:, 3], view), normals, view, fitted[:, 3])

    def place(self, rows: np.ndarray, columns: np.ndarray, z: np.ndarray, view: np.ndarray) -> np.ndarray:
        """Where readings (N,) at z of some pixels really are (N, 3)."""
        x, y = (columns - self.intrinsics.cx) / self.intrinsics.fx, (rows - self.intrinsics.cy) / self.intrinsics.fy
        points = np.column_stack((x, y, np.ones(len(rows)))) * z[:, None]
        for k, mirror in enumerate(self.mirrors, start=1):
            points[view == k] = reflect(points[view == k], mirror)
        return points

    def light(
        self,
        points: np.ndarray,
        normals: np.ndarray,
        own: np.ndarray,
        hiding: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """:func:`.irradiance.irradiance` of points (N, 3) that the views ``own`` (N,) see; hidden by :attr:`hiding`."""
        depth, labels = hiding or self.hiding
        return irradiance(points, normals, own, depth, labels, self.mirrors, self.intrinsics, self.reflectivity)


def ray_lengths(rows: np.ndarray, columns: np.ndarray, intrinsics: Intrinsics) -> np.ndarray:
    """Length of a pixel's ray a metre of z; (N,)."""
    x, y = (columns - intrinsics.cx) / intrinsics.fx, (rows - intrinsics.cy) / intrinsics.fy
    return np.sqrt(x * x + y * y + 1.0)


def grown_into_gaps(labels: np.ndarray, depth: np.ndarray, reach: int = _GAP) -> tuple[np.ndarray, np.ndarray]:
    """Depth and labels (H, W) of the subject carried on along the rows into pixels without a reading.

    A camera gives up skin that light reaches two ways; it hides what is behind it all the same.
    """
    return _gaps_kernel(labels, depth, reach)


@njit(cache=True, nogil=True)
def _gaps_kernel(labels, depth, reach):
    height, width = labels.shape
    out, view = np.zeros_like(depth), labels.copy()
    for v in range(height):
        begin = -1  # of a run of pixels without a reading
        for u in range(width + 1):
            if u < width and labels[v, u] < 0 and depth[v, u] == 0:
                begin = u if begin < 0 else begin
                continue
            if u < width and labels[v, u] >= 0:
                out[v, u] = depth[v, u]
            if begin >= 0:
                left, right = begin - 1, u
                from_left = left >= 0 and labels[v, left] >= 0
                from_right = right < width and labels[v, right] >= 0
                for x in range(begin, u):
                    near, far = x - left, right - x
                    if from_left and near <= reach and (near <= far or not from_right):
                        out[v, x], view[v, x] = depth[v, left], labels[v, left]
                    elif from_right and far <= reach:
                        out[v, x], view[v, x] = depth[v, right], labels[v, right]
                begin = -1
    return out, view


def shifted(image: np.ndarray, down: int, right: int) -> np.ndarray:
    """The image (H, W) moved by at most one pixel; 0 moves in."""
    out = np.zeros_like(image)
    height, width = image.shape
    out[max(down, 0) : height + min(down, 0), max(right, 0) : width + min(right, 0)] = image[
        max(-down, 0) : height + min(-down, 0), max(-right, 0) : width + min(-right, 0)
    ]
    return out


def grown(mask: np.ndarray, radius: int) -> np.ndarray:
    """The mask (H, W) and all pixels up to ``radius`` rows and columns from it."""
    mask = mask.copy()
    for _ in range(radius):
        mask[1:] |= mask[:-1].copy()
        mask[:-1] |= mask[1:].copy()
        mask[:, 1:] |= mask[:, :-1].copy()
        mask[:, :-1] |= mask[:, 1:].copy()
    return mask
