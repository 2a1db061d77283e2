"""Pieces of surface that two views show both, paired."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..camera import Intrinsics, RgbdImage, project
from ..mirrors import Mirror
from ..mirrors.glass_kernels import NEAREST
from ..mirrors.mirror import reflect, reflection_matrix
from ..numeric.kernels import njit

_SYSTEMATIC = 0.003  # distance at which two views may see one surface, however long the burst [m]
_FACING = 0.35  # cosine to the line of sight under which a surface is not judged
_MOST_PIECES = 1600  # of a view: more share their readings
_COLUMN = 16  # px across the strips of the image by which the direct view is searched
_BUSY = 0.004  # share of the reflected pieces from which a strip is searched
_LAGS = (1, 2, 4, 8)  # px between readings whose noise is compared; the last is about the widest camera's window
_EVERY = 5  # rows, one of which is looked at for that
_SMOOTH = 2.5  # times the variance of second differences grows with the lag where neighbours err alike: else less
_CURVED = 6.0  # times from lag to lag: by more it is the surface that bends, which makes 16
_HALFWAY = 1.6  # windows over the lag at which second differences have half of their variance
_TILT = 0.2  # of a piece by noise: windows are made wide enough that it stays below
_WIDEST = 6  # px to each side of a piece's window


class ReadingNoise(NamedTuple):
    """Noise of a depth map.

    ``sigma`` is the standard deviation of 1/z [1/m]. Cameras that match windows, interpolate or smooth give neighbours
    the same error: those in a square of ``alike`` px count as one.
    """

    sigma: float
    alike: float


@dataclass(frozen=True)
class Surfaces:
    """Pieces of surface a view shows, placed where the camera sees them (behind the glass).

    ``grid`` (H', W') is the index of the piece at every ``stride``-th pixel or -1; ``points`` and unit ``normals``
    towards the camera (K, 3), ``variances`` (K,) of the place along the normal [m²], ``pixels`` (K, 2).
    """

    grid: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    variances: np.ndarray
    pixels: np.ndarray
    stride: int
    radius: int


def surfaces_of_views(image: RgbdImage, mirrors: list[Mirror], seen: np.ndarray, noise: ReadingNoise) -> list[Surfaces]:
    """The surfaces that each view shows; of the direct one only what mirrors may show too."""
    intrinsics = image.intrinsics
    shown = [surfaces(image, seen, view, noise) for view in range(1, len(mirrors) + 1)]
    placed = np.concatenate([reflect(s.points, m) for s, m in zip(shown, mirrors, strict=True)])
    pixels = project(placed[placed[:, 2] > NEAREST], intrinsics)
    size = np.array((intrinsics.width, intrinsics.height))
    pixels = pixels[((pixels >= 0) & (pixels < size)).all(axis=1)]
    direct = np.full_like(seen, -1)
    if len(pixels):
        # by columns: a mirror shows what stands beside it too, and a box about all of that is most of the image
        columns = np.bincount((pixels[:, 0] // _COLUMN).astype(int), minlength=intrinsics.width // _COLUMN + 1)
        busy = np.repeat(columns > _BUSY * len(pixels), _COLUMN)[: intrinsics.width]
        top, bottom = np.quantile(pixels[:, 1], (0.01, 0.99)).astype(int)
        direct[top : bottom + 1, busy] = np.where(seen == 0, 0, -1)[top : bottom + 1, busy]
    return [surfaces(image, direct, 0, noise), *shown]


def surfaces(image: RgbdImage, seen: np.ndarray, view: int, noise: ReadingNoise, most: int = _MOST_PIECES) -> Surfaces:
    """The pieces of surface that one view shows, each a plane fitted to a small window.

    Parameters
    ----------
    image : RgbdImage
    seen : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel, or -1.
    view : int
    noise : ReadingNoise
        How wide the window must be.
    most : int
        About so many pieces at most.
    """
    depth, intrinsics = image.depth, image.intrinsics
    count, z, *box = _extent_kernel(depth, seen, view)
    size = (depth.shape[0] + 1) // 2, (depth.shape[1] + 1) // 2
    if count == 0:
        nothing = np.empty((0, 3))
        return Surfaces(
            np.full(size, -1, np.int32), nothing, nothing, np.empty(0), np.empty((0, 2), np.int32), 2, 2
        )  # fmt: skip
    # wide enough that noise tilts the plane by less than a fifth
    radius = 2
    of_mean = noise.sigma * noise.alike  # times the root of how many readings: the standard deviation of their mean
    while radius < _WIDEST and of_mean * z * intrinsics.fx > _TILT * (2 * radius + 1) * np.sqrt(
        radius * (radius + 1) / 3.0
    ):
        radius += 1
    # neighbours share their windows, and some hundred pieces say as much as thousands
    stride = max(2 if radius < 4 else 3, int(np.ceil(np.sqrt(count / most))))
    grid, points, normals, variances, pixels = _surface_kernel(
        depth, seen, view, intrinsics.packed, np.array(box), stride, radius, noise.sigma, noise.alike**2
    )
    return Surfaces(grid, points, normals, variances, pixels, stride, radius)


@dataclass(frozen=True)
class Correspondences:
    """Surfaces of view ``of`` that view ``by`` sees too: where both place them.

    ``here`` and ``there`` (K, 3): the piece and that of the other view's surface in its line of sight, both where the
    camera sees them; ``normals`` (K, 3) of the latter where it really is, ``gaps`` (K,) along these [m], ``variances``
    (K,) of the gaps, ``half`` (K,) 0 or 1 by image blocks. ``before``: how many pieces lie in front of what the other
    view sees there by more than the gate, where it should see them: free-space violations. ``through``, of
    ``judged``: how many of all pieces, whichever way they face, the other view looks through to something behind,
    subject or not.
    """

    of: int
    by: int
    here: np.ndarray
    there: np.ndarray
    normals: np.ndarray
    gaps: np.ndarray
    variances: np.ndarray
    half: np.ndarray
    before: int
    through: int
    judged: int


def find_correspondences(
    mirrors: list[Mirror],
    shown: list[Surfaces],
    intrinsics: Intrinsics,
    gate: float,
    depth: np.ndarray | None = None,
    seen: np.ndarray | None = None,
    facing: float = _FACING,
) -> list[Correspondences]:
    """What each pair of views shows of the same surface; with ``depth`` and ``seen`` also free-space violations.

    Surfaces are not judged whose cosine to the line of sight is under ``facing``.
    """
    if depth is None or seen is None:
        depth, seen = np.zeros((1, 1), np.float32), np.full((1, 1), -1, np.int8)
    flips = [np.eye(4), *(reflection_matrix(m) for m in mirrors)]
    out = []
    for of in range(len(shown)):
        for by in range(len(shown)):
            if of == by or len(shown[of].points) == 0 or len(shown[by].points) == 0 or (of == 0 and by == 0):
                continue
            s, t = shown[of], shown[by]
            plane = np.zeros(4) if by == 0 else np.append(mirrors[by - 1].normal, mirrors[by - 1].normal
                                                          @ mirrors[by - 1].point)  # fmt: skip
            met = _meet_kernel(
                s.points, s.normals, s.variances, s.pixels, flips[of], flips[by], plane, intrinsics.packed, t.grid,
                t.stride, t.points, t.normals, t.variances, gate, depth, seen, by, facing,
            )  # fmt: skip
            out.append(Correspondences(of, by, *met))
    return out


def noise_of(depth: np.ndarray, seen: np.ndarray) -> ReadingNoise:
    """Noise behind glass, from second differences along the rows; how far it is alike, from all of the depth map."""
    bend = _bend_kernel(depth, seen)
    beside = 1.4826 * float(np.median(np.abs(bend))) / np.sqrt(6.0) if len(bend) else 0.0
    grows, alike = likeness(depth)
    return ReadingNoise(beside * float(np.sqrt(grows)), alike)


def likeness(depth: np.ndarray) -> tuple[float, float]:
    """How many times the variance of second differences of 1/z grows with the lag, and the window that explains it.

    1 and 1 px where neighbours err independently. Most of a picture is plane, and of a plane second differences are 0
    but for noise. Of a moving mean over w readings those of neighbours have 4 / w of its variance, at lags from w on
    6, and half of that at w / 1.6.
    """
    rows = depth[::_EVERY]
    inverse = np.divide(1.0, rows, where=rows > 0, out=np.full(rows.shape, np.nan, np.float32))
    spread: list[float] = []
    for lag in _LAGS:
        bend = inverse[:, : -2 * lag] - 2.0 * inverse[:, lag:-lag] + inverse[:, 2 * lag :]
        bend = np.abs(bend[np.isfinite(bend)])
        variance = float(np.median(bend)) ** 2 if len(bend) else 0.0
        if variance == 0.0 or (spread and variance > _CURVED * spread[-1]):
            break
        spread.append(max(variance, spread[-1]) if spread else variance)
    if len(spread) < 2 or spread[-1] < _SMOOTH * spread[0]:
        return 1.0, 1.0
    half = float(np.interp(0.5 * spread[-1], spread, _LAGS[: len(spread)]))
    return spread[-1] / spread[0], max(1.0, _HALFWAY * half)


@njit(cache=True, nogil=True)
def _bend_kernel(depth, seen):
    """Second differences of 1/z behind glass along every third row."""
    height, width = depth.shape
    out = np.empty(((height + 2) // 3) * width)
    n = 0
    for v in range(0, height, 3):
        for u in range(1, width - 1):
            a, b, c = depth[v, u - 1], depth[v, u], depth[v, u + 1]
            if seen[v, u] > 0 and a > 0 and b > 0 and c > 0:
                out[n] = 1.0 / a - 2.0 / b + 1.0 / c
                n += 1
    return out[:n]


@njit(cache=True, nogil=True)
def _extent_kernel(depth, seen, view):
    """How many pixels a view has, their mean depth, and their box: left, top, right, bottom, the latter two beyond."""
    height, width = depth.shape
    count, total = 0, 0.0
    left, top, right, bottom = width, height, 0, 0
    for v in range(height):
        for u in range(width):
            if seen[v, u] == view:
                count += 1
                total += depth[v, u]
                left, right = min(left, u), max(right, u + 1)
                top, bottom = min(top, v), v + 1
    return count, total / max(count, 1), left, top, right, bottom


@njit(cache=True, nogil=True)
def _surface_kernel(depth, seen, view, camera, box, stride, radius, sigma, alike):
    """Planes 1/z = a·x + b·y + c fitted to windows about every ``stride``-th pixel of a view.

    So many of their readings as are ``alike`` count as one.
    """
    height, width = depth.shape
    fx, fy, cx, cy = camera
    grid = np.full(((height + stride - 1) // stride, (width + stride - 1) // stride), -1, np.int32)
    room = ((box[3] - box[1]) // stride + 2) * ((box[2] - box[0]) // stride + 2)
    points, normals, variances = np.empty((room, 3)), np.empty((room, 3)), np.empty(room)
    pixels = np.empty((room, 2), np.int32)
    n = 0
    needed = 0.6 * (2 * radius + 1) ** 2
    for v in range((box[1] + stride - 1) // stride * stride, box[3], stride):
        if v < radius or v >= height - radius:
            continue
        for u in range((box[0] + stride - 1) // stride * stride, box[2], stride):
            if u < radius or u >= width - radius or seen[v, u] != view or depth[v, u] == 0.0:
                continue
            middle = 1.0 / depth[v, u]
            a, b, c = 0.0, 0.0, middle
            reach = 4.0 * sigma + 0.05 * middle * middle
            good = False
            for _ in range(2):
                s = sx = sy = sxx = sxy = syy = r = rx = ry = 0.0
                for y in range(-radius, radius + 1):
                    for x in range(-radius, radius + 1):
                        z = depth[v + y, u + x]
                        if z == 0.0 or seen[v + y, u + x] != view:
                            continue
                        d = 1.0 / z
                        if abs(d - (a * x + b * y + c)) > reach:
                            continue
                        s += 1.0
                        sx += x
                        sy += y
                        sxx += x * x
                        sxy += x * y
                        syy += y * y
                        r += d
                        rx += d * x
                        ry += d * y
                if s < needed:
                    good = False
                    break
                xx, xy, yy = sxx - sx * sx / s, sxy - sx * sy / s, syy - sy * sy / s
                det = xx * yy - xy * xy
                if det < 1e-9:
                    good = False
                    break
                px, py = rx - r * sx / s, ry - r * sy / s
                a, b = (px * yy - py * xy) / det, (py * xx - px * xy) / det
                c = (r - a * sx - b * sy) / s
                good = c > 0.0
                reach = 3.0 * sigma + 0.01 * middle * middle
            if not good:
                continue
            nx, ny = a * fx, b * fy
            nz = a * (cx - u) + b * (cy - v) + c
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            z = 1.0 / c
            x, y = (u - cx) / fx, (v - cy) / fy
            facing = 1.0 / (length * z * np.sqrt(x * x + y * y + 1.0))  # m·p = 1
            if facing < _FACING:
                continue
            points[n, 0], points[n, 1], points[n, 2] = x * z, y * z, z
            normals[n, 0], normals[n, 1], normals[n, 2] = -nx / length, -ny / length, -nz / length
            # along the normal: dz = z² dd, and the normal's part of it
            along = z * z * abs(nx * x + ny * y + nz) / length
            variances[n] = along * along * sigma * sigma * min(alike / s, 1.0)
            pixels[n, 0], pixels[n, 1] = u, v
            grid[v // stride, u // stride] = n
            n += 1
    return grid, points[:n], normals[:n], variances[:n], pixels[:n]


class _Met(NamedTuple):
    """What :func:`_meet_kernel` finds: the fields of :class:`Correspondences` after ``of`` and ``by``."""

    here: np.ndarray
    there: np.ndarray
    normals: np.ndarray
    gaps: np.ndarray
    variances: np.ndarray
    half: np.ndarray
    before: int
    through: int
    judged: int


@njit(cache=True, nogil=True)
def _meet_kernel(
    points, normals, variances, pixels, flip, flip_by, plane, camera, grid, stride, there, there_normals,
    there_variances, gate, depth, seen, by, facing_limit,
):  # fmt: skip
    """Pieces of one view projected into another, and what that sees in the same line of sight: :class:`_Met`."""
    fx, fy, cx, cy = camera
    count = len(points)
    here, other, e_out = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 3))
    gaps, spread, half = np.empty(count), np.empty(count), np.empty(count, np.int8)
    q, m, laid, d, e = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    n, before, through, judged = 0, 0, 0, 0
    height, width = depth.shape
    rows, columns = grid.shape
    for i in range(count):
        for r in range(3):
            q[r], m[r] = flip[r, 3], 0.0
            for c in range(3):
                q[r] += flip[r, c] * points[i, c]
                m[r] += flip[r, c] * normals[i, c]
        if plane[0] * q[0] + plane[1] * q[1] + plane[2] * q[2] < plane[3] + 0.05 and plane[3] != 0.0:
            continue  # behind the other mirror
        facing, length = 0.0, 0.0
        for r in range(3):
            laid[r] = flip_by[r, 3]
            turned = 0.0
            for c in range(3):
                laid[r] += flip_by[r, c] * q[c]
                turned += flip_by[r, c] * m[c]
            facing -= turned * laid[r]
            length += laid[r] * laid[r]
        if laid[2] < NEAREST:
            continue
        x, y = int(np.rint(laid[0] / laid[2] * fx + cx)), int(np.rint(laid[1] / laid[2] * fy + cy))
        if 0 <= x < width and 0 <= y < height and seen[y, x] == by and depth[y, x] > 0.0:
            judged += 1
            if depth[y, x] > laid[2] + gate:
                through += 1
        if facing < facing_limit * np.sqrt(length) or x < 0 or y < 0:
            continue
        row, column = (y + stride // 2) // stride, (x + stride // 2) // stride
        if row >= rows or column >= columns:
            continue
        k = grid[row, column]
        if k < 0:
            continue
        alike, gap = 0.0, 0.0
        for r in range(3):
            d[r], e[r] = flip_by[r, 3], 0.0
            for c in range(3):
                d[r] += flip_by[r, c] * there[k, c]
                e[r] += flip_by[r, c] * there_normals[k, c]
            alike += m[r] * e[r]
        for r in range(3):
            gap += e[r] * (d[r] - q[r])
        if gap < -gate:
            before += 1
        if alike < 0.7 or abs(gap) > gate:
            continue
        for r in range(3):
            here[n, r], other[n, r], e_out[n, r] = points[i, r], there[k, r], e[r]
        gaps[n] = gap
        spread[n] = variances[i] + there_variances[k] + _SYSTEMATIC * _SYSTEMATIC
        half[n] = (pixels[i, 0] // 24 + pixels[i, 1] // 24) % 2
        n += 1
    return _Met(here[:n], other[:n], e_out[:n], gaps[:n], spread[:n], half[:n], before, through, judged)
