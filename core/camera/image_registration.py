"""Depth and colour brought onto one upright pinhole grid: undistortion and registration.

A reader yields what the camera wrote; :func:`.upright_grid.align` makes of it what the pipeline expects. Colour is
looked up for each depth pixel rather than depth moved to the colour image, so that no reading is resampled twice.
"""

from __future__ import annotations

import math

import numpy as np

from ..errors import CaptureError
from ..numeric.kernels import njit
from ..numeric.threads import each
from .pinhole import Intrinsics, is_rigid, padded, undistort

MAX_GROWTH = 2.25  # of the pixel count, when a wide-angle image is straightened
_SAME_SURFACE = 0.03  # neighbouring readings differ by less than this share of their depth


def straightened(intrinsics: Intrinsics) -> Intrinsics:
    """The pinhole camera an image of ``intrinsics`` is straightened into.

    Focal lengths stay, so the centre keeps its resolution; the image grows to hold what the middle of each edge sees,
    but to no more than ``MAX_GROWTH`` times the pixels: beyond that the focal lengths give way.

    Raises
    ------
    CaptureError
        When the lens model does not hold inside the image.
    """
    middle_u = np.linspace(0.2, 0.8, 25) * (intrinsics.width - 1)
    middle_v = np.linspace(0.2, 0.8, 25) * (intrinsics.height - 1)
    edges = np.concatenate(
        [np.column_stack((np.full(25, u), middle_v)) for u in (0, intrinsics.width - 1)]
        + [np.column_stack((middle_u, np.full(25, v))) for v in (0, intrinsics.height - 1)]
    )
    rays = undistort((edges - (intrinsics.cx, intrinsics.cy)) / (intrinsics.fx, intrinsics.fy), intrinsics.distortion)
    rays = rays[np.isfinite(rays).all(axis=1)]
    low, high = (rays.min(axis=0), rays.max(axis=0)) if len(rays) else (np.zeros(2), np.zeros(2))
    if len(rays) < 50 or (low >= high).any() or max(-low.min(), high.max()) > 20:
        raise CaptureError(
            "intrinsics: the distortion coefficients do not describe this image (they fold inside it); "
            "check their order, k1 k2 p1 p2 k3 k4 k5 k6, and that they belong to this resolution",
            code="lens_wrong",
        )
    focal = np.array((intrinsics.fx, intrinsics.fy))
    size = (high - low) * focal + 1
    scale = min(1.0, math.sqrt(MAX_GROWTH * intrinsics.width * intrinsics.height / size.prod()))
    focal = focal * scale
    width, height = (max(1, math.ceil(n - 1e-6)) for n in (high - low) * focal + 1)
    fx, fy, cx, cy = (float(v) for v in (*focal, *(-low * focal)))
    return Intrinsics(width, height, fx, fy, cx, cy)


def undistort_depth(
    depth: np.ndarray, intrinsics: Intrinsics, straight: Intrinsics, interpolate: bool = True
) -> np.ndarray:
    """Depth maps as the pinhole camera ``straight`` would read them.

    Parameters
    ----------
    depth : np.ndarray [shape=(F, H, W), dtype=float32]
        Read by ``intrinsics`` [m]; 0 = no reading.
    interpolate : bool
        Between four readings of one surface 1/z is interpolated, which is exact on planes; at edges, and everywhere
        when False (for readings whose steps still matter), the nearest reading is taken.

    Returns
    -------
    np.ndarray [shape=(F, H', W'), dtype=float32]
    """
    out = np.zeros((len(depth), straight.height, straight.width), np.float32)
    _undistort_depth(np.ascontiguousarray(depth, np.float32), _pack(intrinsics), _pack(straight), interpolate, out)
    return out


def undistort_labels(labels: np.ndarray, intrinsics: Intrinsics, straight: Intrinsics) -> np.ndarray:
    """Nearest labels (F, H', W') uint8 of (F, H, W) uint8 in the pinhole camera ``straight``; 0 outside."""
    out = np.zeros((len(labels), straight.height, straight.width), np.uint8)
    _undistort_labels(np.ascontiguousarray(labels, np.uint8), _pack(intrinsics), _pack(straight), out)
    return out


def undistort_color(color: np.ndarray, intrinsics: Intrinsics, straight: Intrinsics) -> np.ndarray:
    """Colour image (H', W', 3) uint8 of (H, W, 3) in the pinhole camera ``straight``, bilinear; black outside."""
    out = np.zeros((straight.height, straight.width, 3), np.uint8)
    _undistort_color(np.ascontiguousarray(color, np.uint8), _pack(intrinsics), _pack(straight), out)
    return out


def straight_color(color: np.ndarray, intrinsics: Intrinsics) -> tuple[np.ndarray, Intrinsics]:
    """A colour image as a pinhole camera of the same focal lengths takes it, and that camera.

    Bicubic (Keys 1981, a = -1/2), which keeps fine patterns that bilinear interpolation blurs: at half a pixel's shift
    a period of 4 px keeps 88 % of its contrast, not 71 %. An image without distortion is handed back as it is.

    Parameters
    ----------
    color : np.ndarray [shape=(Hc, Wc, 3), dtype=uint8]
    intrinsics : Intrinsics
        Of the image.

    Returns
    -------
    color : np.ndarray [shape=(H', W', 3), dtype=uint8]
        Black where the lens saw nothing.
    straight : Intrinsics
        See :func:`straightened`.

    Raises
    ------
    CaptureError
        When the image is of another size than ``intrinsics``, or the lens model does not hold inside it.
    """
    _check_size(color, intrinsics, "colour image")
    if intrinsics.is_pinhole:
        return color, intrinsics
    straight = straightened(intrinsics)
    out = np.zeros((straight.height, straight.width, 3), np.uint8)
    source, lens, target = np.ascontiguousarray(color, np.uint8), _pack(intrinsics), _pack(straight)
    fold = _fold_radius(intrinsics)
    bands = np.array_split(np.arange(straight.height), max(1, straight.height // 64))
    each(lambda band: _straight_color(source, lens, target, fold, band[0], band[-1] + 1, out), bands)
    return out, straight


def color_on_depth(
    depth: np.ndarray,
    intrinsics: Intrinsics,
    color: np.ndarray,
    color_camera: Intrinsics,
    depth_to_color: np.ndarray,
) -> tuple[np.ndarray, float]:
    """Colour of each depth pixel, with occlusion between the two cameras resolved by a z-buffer.

    Pixels without a reading take the colour at the depth of the farther neighbour of their row; readings the colour
    camera cannot see because something is in front of them take the nearest seen colour of their own surface.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m] in ``intrinsics``, a pinhole; 0 = no reading.
    color : np.ndarray [shape=(Hc, Wc, 3), dtype=uint8]
        Taken by ``color_camera``, distorted or not.
    depth_to_color : np.ndarray [shape=(4, 4)]
        Takes points [m] of the depth camera's frame into the colour camera's.

    Returns
    -------
    color : np.ndarray [shape=(H, W, 3), dtype=uint8]
        Black outside the colour camera's view.
    seen : float
        Share of the readings inside that view.

    Raises
    ------
    CaptureError
        Sizes that do not fit their intrinsics, or no rigid ``depth_to_color``.
    """
    _check_size(depth, intrinsics, "depth map")
    _check_size(color, color_camera, "colour image")
    out = np.zeros((*depth.shape, 3), np.uint8)
    pitch = max(color_camera.fx / intrinsics.fx, color_camera.fy / intrinsics.fy, 1.0)
    buffer = np.full((math.ceil(color.shape[0] / pitch) + 3, math.ceil(color.shape[1] / pitch) + 3), np.inf, np.float32)
    inside, readings = _color_on_depth(
        np.ascontiguousarray(depth, np.float32),
        _pack(intrinsics),
        np.ascontiguousarray(color, np.uint8),
        _pack(color_camera),
        _fold_radius(color_camera),
        _rigid(depth_to_color),
        pitch,
        buffer,
        out,
    )
    return out, inside / max(readings, 1)


def first_readings(depth: np.ndarray) -> np.ndarray:
    """Of each pixel the first reading of a burst (F, H, W) -> (H, W) float32."""
    first = depth[0].copy()
    for frame in depth[1:]:
        np.copyto(first, frame, where=first == 0)
    return first


def _check_size(image: np.ndarray, intrinsics: Intrinsics, what: str) -> None:
    if image.shape[:2] != (intrinsics.height, intrinsics.width):
        raise CaptureError(
            f"the {what} is {image.shape[1]}×{image.shape[0]}, its intrinsics are for "
            f"{intrinsics.width}×{intrinsics.height}; "
            "use the intrinsics of this resolution",
            code="lens_wrong",
        )


def _rigid(pose: np.ndarray) -> np.ndarray:
    """``pose`` as (3, 4) float64, checked to be a rotation and a shift."""
    pose = np.asarray(pose, np.float64)
    if not is_rigid(pose):
        raise CaptureError(
            "the transform from depth to colour must be a rotation and a shift (4, 4) in metres", code="lens_wrong"
        )
    return np.ascontiguousarray(pose[:3])


def _pack(intrinsics: Intrinsics) -> np.ndarray:
    """fx, fy, cx, cy and the eight coefficients, for kernels."""
    return np.array((intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy, *padded(intrinsics.distortion)))


def _fold_radius(intrinsics: Intrinsics) -> float:
    """Squared distance from the axis on the plane z = 1 beyond which the lens model folds back."""
    if intrinsics.is_pinhole:
        return math.inf
    k1, k2, _, _, k3, k4, k5, k6 = padded(intrinsics.distortion)
    r = np.linspace(0, 6, 6001)
    r2 = r * r
    with np.errstate(all="ignore"):
        image = r * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    falling = np.flatnonzero(~(np.diff(image) > 0))
    return float(r2[falling[0]]) if len(falling) else math.inf


@njit(cache=True, nogil=True)
def _pixel(x, y, intrinsics):
    """Distorted pixel of the direction (x, y, 1)."""
    k1, k2, p1, p2, k3, k4, k5, k6 = (
        intrinsics[4],
        intrinsics[5],
        intrinsics[6],
        intrinsics[7],
        intrinsics[8],
        intrinsics[9],
        intrinsics[10],
        intrinsics[11],
    )
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return u * intrinsics[0] + intrinsics[2], v * intrinsics[1] + intrinsics[3]


@njit(cache=True, nogil=True)
def _undistort_depth(depth, intrinsics, straight, interpolate, out):
    frames, height, width = depth.shape
    for row in range(out.shape[1]):
        y = (row - straight[3]) / straight[1]
        for column in range(out.shape[2]):
            u, v = _pixel((column - straight[2]) / straight[0], y, intrinsics)
            if not (u > -0.5 and v > -0.5 and u < width - 0.5 and v < height - 0.5):
                continue
            near_u, near_v = int(u + 0.5), int(v + 0.5)
            left, top = int(math.floor(u)), int(math.floor(v))
            within = interpolate and left >= 0 and top >= 0 and left + 1 < width and top + 1 < height
            a, b = u - left, v - top
            for f in range(frames):
                z = depth[f, near_v, near_u]
                if within and z > 0:
                    z00, z01 = depth[f, top, left], depth[f, top, left + 1]
                    z10, z11 = depth[f, top + 1, left], depth[f, top + 1, left + 1]
                    low, high = min(z00, z01, z10, z11), max(z00, z01, z10, z11)
                    if low > 0 and high - low < _SAME_SURFACE * low:
                        inverse = (1 - b) * ((1 - a) / z00 + a / z01) + b * ((1 - a) / z10 + a / z11)
                        z = np.float32(1.0 / inverse)
                out[f, row, column] = z


@njit(cache=True, nogil=True)
def _undistort_labels(labels, intrinsics, straight, out):
    frames, height, width = labels.shape
    for row in range(out.shape[1]):
        y = (row - straight[3]) / straight[1]
        for column in range(out.shape[2]):
            u, v = _pixel((column - straight[2]) / straight[0], y, intrinsics)
            if u > -0.5 and v > -0.5 and u < width - 0.5 and v < height - 0.5:
                for f in range(frames):
                    out[f, row, column] = labels[f, int(v + 0.5), int(u + 0.5)]


@njit(cache=True, nogil=True)
def _sample(color, u, v, out):
    """Bilinear colour at a pixel inside the image."""
    height, width = color.shape[:2]
    left = min(max(int(math.floor(u)), 0), max(width - 2, 0))
    top = min(max(int(math.floor(v)), 0), max(height - 2, 0))
    right, bottom = min(left + 1, width - 1), min(top + 1, height - 1)
    a, b = min(max(u - left, 0.0), 1.0), min(max(v - top, 0.0), 1.0)
    for c in range(3):
        value = (1 - b) * ((1 - a) * color[top, left, c] + a * color[top, right, c]) + b * (
            (1 - a) * color[bottom, left, c] + a * color[bottom, right, c]
        )
        out[c] = np.uint8(value + 0.5)


@njit(cache=True, nogil=True)
def _undistort_color(color, intrinsics, straight, out):
    height, width = color.shape[:2]
    for row in range(out.shape[0]):
        y = (row - straight[3]) / straight[1]
        for column in range(out.shape[1]):
            u, v = _pixel((column - straight[2]) / straight[0], y, intrinsics)
            if u > -0.5 and v > -0.5 and u < width - 0.5 and v < height - 0.5:
                _sample(color, u, v, out[row, column])


@njit(cache=True, nogil=True)
def _cubic(at, weights):
    """Keys's weights of the four neighbours of a place ``at`` between the middle two, 0 to 1."""
    weights[0] = at * (at * (1.0 - 0.5 * at) - 0.5)
    weights[1] = 1.0 + at * at * (1.5 * at - 2.5)
    weights[2] = at * (0.5 + at * (2.0 - 1.5 * at))
    weights[3] = at * at * (0.5 * at - 0.5)


@njit(cache=True, nogil=True)
def _straight_color(color, intrinsics, straight, fold, first, last, out):
    height, width = color.shape[:2]
    across, down = np.empty(4), np.empty(4)
    for row in range(first, last):
        y = (row - straight[3]) / straight[1]
        for column in range(out.shape[1]):
            x = (column - straight[2]) / straight[0]
            if x * x + y * y >= fold:
                continue
            u, v = _pixel(x, y, intrinsics)
            if not (u > -0.5 and v > -0.5 and u < width - 0.5 and v < height - 0.5):
                continue
            left, top = int(math.floor(u)), int(math.floor(v))
            _cubic(u - left, across)
            _cubic(v - top, down)
            red = green = blue = 0.5
            for k in range(4):
                i = min(max(top - 1 + k, 0), height - 1)
                for m in range(4):
                    j, weight = min(max(left - 1 + m, 0), width - 1), down[k] * across[m]
                    red += weight * color[i, j, 0]
                    green += weight * color[i, j, 1]
                    blue += weight * color[i, j, 2]
            out[row, column, 0] = np.uint8(min(max(red, 0.0), 255.0))
            out[row, column, 1] = np.uint8(min(max(green, 0.0), 255.0))
            out[row, column, 2] = np.uint8(min(max(blue, 0.0), 255.0))


@njit(cache=True, nogil=True)
def _into_color(column, row, z, camera, intrinsics, fold, pose):
    """Pixel and depth of a reading in the colour camera; depth 0 when it is behind the camera or past the lens."""
    x, y = (column - camera[2]) / camera[0] * z, (row - camera[3]) / camera[1] * z
    depth = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
    if depth <= 1e-6:
        return 0.0, 0.0, 0.0
    x, y = (
        (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]) / depth,
        (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]) / depth,
    )
    if x * x + y * y >= fold:
        return 0.0, 0.0, 0.0
    u, v = _pixel(x, y, intrinsics)
    return u, v, depth


@njit(cache=True, nogil=True)
def _cell(position):
    """First of the two buffer cells around a position; rounding must not split whole ones, where grids agree."""
    return int(math.floor(position + 1e-6)) + 1


@njit(cache=True, nogil=True)
def _color_on_depth(depth, camera, color, intrinsics, fold, pose, pitch, buffer, out):
    height, width = depth.shape
    rows, columns = color.shape[:2]
    inside = readings = 0
    for row in range(height):
        for column in range(width):
            if depth[row, column] > 0:
                readings += 1
                u, v, z = _into_color(column, row, depth[row, column], camera, intrinsics, fold, pose)
                if z > 0 and u > -0.5 and v > -0.5 and u < columns - 0.5 and v < rows - 0.5:
                    inside += 1
                    i, j = _cell(v / pitch), _cell(u / pitch)
                    for k in range(2):  # a footprint of 2 x 2 cells leaves no gaps between neighbouring readings
                        for m in range(2):
                            buffer[i + k, j + m] = min(buffer[i + k, j + m], z)
    hidden = np.zeros(width, np.bool_)
    filled = np.zeros(width, np.float32)
    for row in range(height):
        _fill_row(depth[row], filled)
        for column in range(width):
            hidden[column] = False
            if filled[column] <= 0:
                continue
            u, v, z = _into_color(column, row, filled[column], camera, intrinsics, fold, pose)
            if z > 0 and u > -0.5 and v > -0.5 and u < columns - 0.5 and v < rows - 0.5:
                # hidden where all four cells are nearer: the footprint's edge alone hides nothing
                i, j = _cell(v / pitch), _cell(u / pitch)
                before = max(buffer[i, j], buffer[i, j + 1], buffer[i + 1, j], buffer[i + 1, j + 1])
                hidden[column] = before < z * (1 - _SAME_SURFACE) - 0.01
                _sample(color, u, v, out[row, column])
        _borrow(out[row], filled, hidden)
    return inside, readings


@njit(cache=True, nogil=True)
def _fill_row(depth, filled):
    """Gaps of a row take the farther of the readings on both sides: what is behind an edge."""
    width = len(depth)
    column = 0
    before = np.float32(0)
    while column < width:
        if depth[column] > 0:
            before = depth[column]
            filled[column] = before
            column += 1
            continue
        end = column
        while end < width and depth[end] <= 0:
            end += 1
        after = depth[end] if end < width else np.float32(0)
        filled[column:end] = max(before, after)
        column = end


@njit(cache=True, nogil=True)
def _borrow(colors, depth, hidden):
    """Hidden pixels of a row take the nearest seen colour at a like depth; their own, of what hides them, if none."""
    width = len(depth)
    for column in range(width):
        if not hidden[column]:
            continue
        for step in range(1, width):
            left, right = column - step, column + step
            if left < 0 and right >= width:
                break
            source = -1
            if left >= 0 and not hidden[left] and abs(depth[left] - depth[column]) < 0.1 * depth[column]:
                source = left
            elif right < width and not hidden[right] and abs(depth[right] - depth[column]) < 0.1 * depth[column]:
                source = right
            if source >= 0:
                colors[column] = colors[source]
                break
