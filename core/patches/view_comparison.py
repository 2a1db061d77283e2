"""Which of two views saw a surface better."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mesh import Mesh
from ..numeric.kernels import njit
from ..views.view_maps import ViewMaps, look_at

_SAME_SIDE = 0.2  # cosine between the normals of two views; under it they show two sides of something thin
_ONE_SURFACE = 0.04  # of z: between pixels at a larger distance nothing is interpolated
_LEAST_READ = 0.5  # of the weights of the four pixels around, that readings must have


@dataclass(frozen=True)
class OverlapSettings:
    """How overlaps of views are cut.

    Parameters
    ----------
    reach : float
        Surfaces of two views nearer than this are the same skin [m]; grows with the views' noise.
    gap : float
        Gap left between the cut patches [edge lengths of the coarser one].
    lean : float
        How much a view gains over another towards its own camera [log confidence per metre].
    blend : bool
        Move both views to their weighted mean where they overlap.
    """

    reach: float = 0.012
    gap: float = 0.8
    blend: bool = True
    lean: float = 8.0


@njit(cache=True, nogil=True, error_model="numpy")
def _sample(v, u, view, depth, labels, normals, confidence, out):
    """Bilinear disparity, normal and confidence of a view at (v, u); out = (z, nx, ny, nz, confidence).

    False off the view.
    """
    y0, x0 = int(v), int(u)
    y1, x1 = min(y0 + 1, depth.shape[0] - 1), min(x0 + 1, depth.shape[1] - 1)
    fy, fx = v - y0, u - x0
    total = 0.0
    out[:] = 0.0
    low, high = 1e9, 0.0
    for a in range(2):
        for b in range(2):
            y, x = (y1 if a else y0), (x1 if b else x0)
            w = (fy if a else 1 - fy) * (fx if b else 1 - fx)
            if labels[y, x] != view or confidence[y, x] <= 0 or w <= 0:
                continue
            total += w
            out[0] += w / depth[y, x]
            for c in range(3):
                out[1 + c] += w * normals[y, x, c]
            out[4] += w * confidence[y, x]
            low, high = min(low, depth[y, x]), max(high, depth[y, x])
    if total < _LEAST_READ or high - low > _ONE_SURFACE * high:
        return False
    out[0] = total / out[0]
    length = np.sqrt(out[1] ** 2 + out[2] ** 2 + out[3] ** 2)
    if length == 0:
        return False
    for c in range(3):
        out[1 + c] /= length
    # pixels off the view count as no confidence: the field falls to zero towards a silhouette
    return True


def compare_views(
    vertices: np.ndarray,
    view: np.ndarray,
    normals: np.ndarray,
    own: np.ndarray,
    maps: ViewMaps,
    settings: OverlapSettings,
    center: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """How a patch's vertices stand against the other views that see the same skin.

    Parameters
    ----------
    vertices, normals : np.ndarray [shape=(V, 3)]
        Camera frame, real space [m].
    view : np.ndarray [shape=(V,), dtype=int8]
        The view each vertex is from.
    own : np.ndarray [shape=(V,)]
        Confidence of each vertex in its own view.
    center : np.ndarray [shape=(3,)], optional
        Middle of the subject. A view then gains ``settings.lean`` per metre towards its own camera: where two views are
        equally good over a wide flat part, such as a back, that draws one line between them.

    Returns
    -------
    advantage : np.ndarray [shape=(V,)]
        log(own confidence / best other), and the lean; +inf where nobody else sees this skin.
    shift : np.ndarray [shape=(V, 3)]
        To the confidence-weighted mean of all views that see it [m].
    """
    return _compare_kernel(
        vertices,
        view,
        normals,
        own,
        maps.to_view,
        maps.depth,
        maps.labels,
        maps.normals,
        maps.confidence,
        maps.intrinsics,
        settings.reach,
        maps.noise,
        np.zeros(3) if center is None else center,
        0.0 if center is None else settings.lean,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _compare_kernel(
    vertices,
    view,
    vertex_normals,
    own,
    to_view,
    depth,
    labels,
    normals,
    confidence,
    intrinsics,
    reach,
    noise,
    center,
    lean,
):
    count = len(vertices)
    eyes = np.zeros((len(to_view), 3))  # where each view's camera stands
    for k in range(len(to_view)):
        for c in range(3):
            for r in range(3):
                eyes[k, c] -= to_view[k, r, c] * to_view[k, r, 3]
    advantage = np.full(count, np.inf)
    shift = np.zeros((count, 3))
    out = np.empty(5)
    for i in range(count):
        total = own[i]
        for k in range(len(to_view)):
            if k == view[i]:
                continue
            v, u, z = look_at(vertices, i, to_view, k, depth, intrinsics)
            if v < 0 or not _sample(v, u, k, depth, labels, normals, confidence, out):
                continue
            agree = out[1] * vertex_normals[i, 0] + out[2] * vertex_normals[i, 1] + out[3] * vertex_normals[i, 2]
            if agree < _SAME_SIDE:
                continue
            # the offset along the ray, measured across the surface: ray direction · normal
            px, py = (u - intrinsics[k, 2]) / intrinsics[k, 0], (v - intrinsics[k, 3]) / intrinsics[k, 1]
            rx = to_view[k, 0, 0] * px + to_view[k, 1, 0] * py + to_view[k, 2, 0]
            ry = to_view[k, 0, 1] * px + to_view[k, 1, 1] * py + to_view[k, 2, 1]
            rz = to_view[k, 0, 2] * px + to_view[k, 1, 2] * py + to_view[k, 2, 2]
            step = (out[0] - z) * (rx * out[1] + ry * out[2] + rz * out[3])
            if abs(step) > reach + 3.0 * noise[k] * z:
                continue
            gain = np.log((own[i] + 1e-9) / (out[4] + 1e-9))
            if lean > 0.0:
                away = along = 0.0
                for c in range(3):
                    apart = eyes[view[i], c] - eyes[k, c]
                    away += apart * apart
                    along += apart * (vertices[i, c] - center[c])
                gain += lean * along / np.sqrt(away)
            advantage[i] = min(advantage[i], gain)
            total += out[4]
            for c in range(3):
                shift[i, c] += out[4] * step * out[1 + c]
        if total > 0:
            for c in range(3):
                shift[i, c] /= total
    return advantage, shift


def own_confidence(patch: Mesh, maps: ViewMaps) -> np.ndarray:
    """Confidence (V,) of a patch's vertices in the view they come from."""
    return _own_kernel(patch.vertices, patch.view, maps.to_view, maps.confidence, maps.intrinsics)


@njit(cache=True, nogil=True, error_model="numpy")
def _own_kernel(vertices, view, to_view, confidence, intrinsics):
    own = np.zeros(len(vertices))
    for i in range(len(vertices)):
        v, u, _ = look_at(vertices, i, to_view, view[i], confidence, intrinsics)
        if v >= 0:
            own[i] = confidence[int(v + 0.5), int(u + 0.5)]
    return own
