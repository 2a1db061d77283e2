"""What each view saw, pixel by pixel, as maps that kernels look into."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera import RgbdImage
from ..mesh import Mesh
from ..mirrors import Mirror
from ..mirrors.mirror import reflection_matrix
from ..numeric.kernels import njit
from ..numeric.point_products import transform
from .free_space import NEAREST_Z, FreeSpace, clear_depth, in_view_frame


@dataclass(frozen=True)
class ViewMaps:
    """What every view says of any point in space: the smoothed depth map with per-pixel normals and confidence.

    ``to_view`` (N+1, 4, 4), ``intrinsics`` (N+1, 4), ``noise``, ``clear`` and ``through`` are as in
    :class:`.free_space.FreeSpace`. Several cameras share one map: their images stand below one another
    (:func:`stack_maps`).
    """

    depth: np.ndarray
    labels: np.ndarray
    clear: np.ndarray
    through: np.ndarray
    normals: np.ndarray
    confidence: np.ndarray
    to_view: np.ndarray
    intrinsics: np.ndarray
    noise: np.ndarray

    @property
    def free_space(self) -> FreeSpace:
        """What kernels take to ask whether a place was seen to be empty."""
        return FreeSpace(self.to_view, self.intrinsics, self.noise, self.clear, self.through)


NOTHING_SEEN = ViewMaps(
    depth=np.zeros((1, 1), np.float32),
    labels=np.full((1, 1), -1, np.int8),
    clear=np.zeros((1, 1), np.float32),
    through=np.full((1, 1), -1, np.int8),
    normals=np.zeros((1, 1, 3)),
    confidence=np.zeros((1, 1)),
    to_view=np.eye(4)[None],
    intrinsics=np.array(((1.0, 1.0, 0.0, 0.0),)),
    noise=np.zeros(1),
)
"""The maps of a camera that reads nothing, for where there is no camera: they forbid no bridge."""


def view_maps(
    image: RgbdImage, labels: np.ndarray, seen: np.ndarray, mirrors: list[Mirror], noise: np.ndarray
) -> ViewMaps:
    """Normals (real space) and confidence of each subject pixel.

    Confidence is cos²(incidence) / path length, less within 3 px of the view's silhouette: nearer, more frontal
    readings are better, and the last pixels of an outline mix foreground with background.
    """
    depth, intrinsics = image.depth, image.intrinsics
    to_view = np.stack([np.eye(4)] + [reflection_matrix(m) for m in mirrors])
    packed = intrinsics.packed
    normals, confidence = _maps_kernel(depth, labels, packed, to_view, _nearest_first())
    every = np.tile(packed, (len(to_view), 1))
    return ViewMaps(depth, labels, *clear_depth(depth, seen), normals, confidence, to_view, every, noise)


_BLANK_ROWS = 4  # blank rows between the images of two cameras, more than any window reaches [px]


def stack_maps(maps: list[ViewMaps], poses: list[np.ndarray]) -> ViewMaps:
    """The maps of several cameras as one, its views numbered through, camera by camera.

    Parameters
    ----------
    maps : list of ViewMaps
        One a camera, each in its own camera frame.
    poses : list of np.ndarray [shape=(4, 4)]
        Rigid: camera frame → the frame they share.
    """
    rows = sum(m.depth.shape[0] + _BLANK_ROWS for m in maps)
    columns = max(m.depth.shape[1] for m in maps)
    depth, clear = np.zeros((rows, columns), np.float32), np.zeros((rows, columns), np.float32)
    labels, through = np.full((rows, columns), -1, np.int8), np.full((rows, columns), -1, np.int8)
    normals, confidence = np.zeros((rows, columns, 3)), np.zeros((rows, columns))
    to_view, intrinsics = [], []
    top = views = 0
    for one, pose in zip(maps, poses, strict=True):
        height, width = one.depth.shape
        part = (slice(top, top + height), slice(0, width))
        depth[part], clear[part], confidence[part] = one.depth, one.clear, one.confidence
        labels[part] = np.where(one.labels >= 0, one.labels + views, -1)
        through[part] = np.where(one.through >= 0, one.through + views, -1)
        turn = np.eye(4)
        turn[:3, :3] = pose[:3, :3]
        normals[part] = transform(one.normals, turn)
        to_view.append(one.to_view @ np.linalg.inv(pose))
        intrinsics.append(one.intrinsics + (0.0, 0.0, 0.0, top))
        top += height + _BLANK_ROWS
        views += len(one.to_view)
    return ViewMaps(
        depth,
        labels,
        clear,
        through,
        normals,
        confidence,
        np.concatenate(to_view),
        np.concatenate(intrinsics),
        np.concatenate([one.noise for one in maps]),
    )


_BORDER = 3  # so near its silhouette a view's readings are worth less [px]
_SILHOUETTE_STEP = 0.05  # of z: pixels at a larger distance are not of one surface, even where it is steep
_NORMAL_STEP = 0.03  # of z: a normal takes no neighbour at a larger distance; less, as a wrong one tilts it


def _nearest_first() -> np.ndarray:
    """Offsets (K, 2) of the pixels up to ``_BORDER`` rows and columns around one, by distance."""
    offsets = np.stack(np.meshgrid(*2 * [np.arange(-_BORDER, _BORDER + 1)], indexing="ij"), axis=-1).reshape(-1, 2)
    distance = (offsets**2).sum(axis=1)
    return offsets[np.argsort(distance, kind="stable")][1:]


@njit(cache=True, nogil=True, error_model="numpy")
def _maps_kernel(depth, labels, intrinsics, to_view, offsets):
    height, width = depth.shape
    fx, fy, cx, cy = intrinsics
    normals = np.zeros((height, width, 3))
    confidence = np.zeros((height, width))
    for v in range(1, height - 1):
        for u in range(1, width - 1):
            k = labels[v, u]
            if k < 0:
                continue
            z = depth[v, u]
            step, border = np.float32(_SILHOUETTE_STEP) * z, float(_BORDER)
            inner = min(v, u, height - 1 - v, width - 1 - u) >= _BORDER
            for o in range(len(offsets)):
                y, x = v + offsets[o, 0], u + offsets[o, 1]
                if inner or (0 <= y < height and 0 <= x < width):
                    if labels[y, x] == k and abs(depth[y, x] - z) <= step:
                        continue
                border = min(border, np.sqrt(offsets[o, 0] ** 2 + offsets[o, 1] ** 2) - 0.5)
                break
            left, right, above, below = u, u, v, v
            if labels[v, u - 1] == k and abs(depth[v, u - 1] - z) < _NORMAL_STEP * z:
                left = u - 1
            if labels[v, u + 1] == k and abs(depth[v, u + 1] - z) < _NORMAL_STEP * z:
                right = u + 1
            if labels[v - 1, u] == k and abs(depth[v - 1, u] - z) < _NORMAL_STEP * z:
                above = v - 1
            if labels[v + 1, u] == k and abs(depth[v + 1, u] - z) < _NORMAL_STEP * z:
                below = v + 1
            if left == right or above == below:
                continue
            # along the row and down the column, where the camera projects them
            za, zb = np.float64(depth[v, left]), np.float64(depth[v, right])
            rx = (right - cx) / fx * zb - (left - cx) / fx * za
            ry, rz = (v - cy) / fy * (zb - za), zb - za
            za, zb = np.float64(depth[above, u]), np.float64(depth[below, u])
            dx, dz = (u - cx) / fx * (zb - za), zb - za
            dy = (below - cy) / fy * zb - (above - cy) / fy * za
            # down × right points to the camera
            nx, ny, nz = dy * rz - dz * ry, dz * rx - dx * rz, dx * ry - dy * rx
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            if length == 0:
                continue
            nx, ny, nz = nx / length, ny / length, nz / length
            px, py = (u - cx) / fx, (v - cy) / fy
            cosine = -(nx * px + ny * py + nz) / np.sqrt(px * px + py * py + 1.0)
            if cosine <= 0:
                continue
            confidence[v, u] = cosine * cosine / z * border / _BORDER
            for r in range(3):  # back from where the view places it: the inverse of a rotation is its transpose
                normals[v, u, r] = to_view[k, 0, r] * nx + to_view[k, 1, r] * ny + to_view[k, 2, r] * nz
    return normals, confidence


@njit(cache=True, nogil=True, error_model="numpy")
def look_at(points, i, to_view, k, image, intrinsics):
    """Where view k projects points[i]: pixel and z there; (row, column) -1 outside the image or behind the camera."""
    x, y, z = in_view_frame(to_view, k, points[i, 0], points[i, 1], points[i, 2])
    if z <= NEAREST_Z:
        return -1.0, -1.0, z
    u, v = x / z * intrinsics[k, 0] + intrinsics[k, 2], y / z * intrinsics[k, 1] + intrinsics[k, 3]
    if not (0 <= u <= image.shape[1] - 1 and 0 <= v <= image.shape[0] - 1):
        return -1.0, -1.0, z
    return v, u, z


def reading_noise(mesh: Mesh, maps: ViewMaps) -> np.ndarray:
    """Noise (V,) of each vertex's reading [m]; 0 for those of filled surface."""
    return _noise_kernel(mesh.vertices, mesh.view, maps.to_view, maps.noise)


@njit(cache=True, nogil=True, error_model="numpy")
def _noise_kernel(vertices, view, to_view, relative):
    noise = np.zeros(len(vertices))
    for i in range(len(vertices)):
        k = view[i]
        if k >= 0 and k < len(relative):
            z = to_view[k, 2, 3]
            for c in range(3):
                z += to_view[k, 2, c] * vertices[i, c]
            noise[i] = relative[k] * z
    return noise
