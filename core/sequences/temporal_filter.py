"""Depth steadied in time: readings of one surface in successive frames are averaged, readings of what moved are not.

What stands still is averaged pixel by pixel. What moves is first followed: a grid of nodes over the picture finds for
each neighbourhood the small rigid motion that lays it on the frame before (projective point-to-plane registration, as
in Rusinkiewicz and Levoy 2001, by nodes that keep to their neighbours, as in embedded deformation, Sumner et al. 2007).
A reading then joins the mean of the surface it lies on where it, and its neighbourhood, lie within the noise of it;
else the mean begins anew. All is done in inverse depth, as everywhere in :mod:`..depth`: there a plane is linear in u
and v.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera import Intrinsics
from ..camera.noise_models import NoiseModel
from ..numeric.kernels import njit
from ..numeric.point_products import cross
from ..numeric.threads import each_range

_SPACING, _REACH = 8, 12  # px: between nodes; half of a node's window
_STRIDES = (4, 4, 4, 2, 2)  # rounds of the registration: of a window's pixels every so many, in either direction
_PATCH = 3  # half the side of the window in which the surface's slope is fitted [px]
_GRID = 2  # px: between planes
_SAME = 0.06  # m: what differs by more in depth is another surface
_TURN, _SHIFT = 0.25, 0.05  # standard deviations of a neighbourhood's motion from frame to frame [rad], [m]
_OUTLIER = 4.0  # standard deviations from which a pixel weighs less
_FEWEST = 12  # pixels from which a plane is fitted
_TOGETHER = 4.0  # so many pixels of a window count: noise of neighbours is alike
_STILL = 3.0  # standard deviations from the background that are no motion
_SPECK, _ALONE = 2, 6  # half the side of a window [px], and readings in it from which something moves: fewer are noise
_SLACK = 2  # px beside what moved, where its planes are fitted, too


@dataclass(frozen=True)
class FilterSettings:
    """How depth is steadied.

    Parameters
    ----------
    use : bool
    memory : int
        Frames that the mean goes back at most.
    deviations : float
        Of the noise: what differs by more has moved, or is another surface.
    window : int
        Half the side of the neighbourhood that is looked at, too [px].
    follow : bool
        Moving surfaces are followed; else only what stands still is averaged.
    """

    use: bool = True
    memory: int = 6
    deviations: float = 2.5
    window: int = 2
    follow: bool = True


class DepthFilter:
    """Filters the frames of a recording one after the other: ``filter.next(depth)``.

    Parameters
    ----------
    intrinsics : Intrinsics
        A pinhole.
    model : NoiseModel or None
        Of the camera; without one the noise is measured on what stands still.
    settings : FilterSettings
    background : np.ndarray [shape=(H, W), dtype=float32], optional
        Depth of what stands still in the whole recording [m], 0 elsewhere: there nothing is followed.

    Attributes
    ----------
    share : float
        Of the last frame's readings that are not the background's, what share was averaged with those before [0..1].
    """

    def __init__(
        self,
        intrinsics: Intrinsics,
        model: NoiseModel | None = None,
        settings: FilterSettings = FilterSettings(),
        background: np.ndarray | None = None,
    ) -> None:
        self._camera, self._model, self._settings = intrinsics, model, settings
        self._background = background
        self._mean: np.ndarray | None = None  # of 1/z [1/m], 0 = none
        self._count: np.ndarray | None = None
        self._moved: np.ndarray | None = None  # what moved in the frame before
        self.share = 0.0

    def next(self, depth: np.ndarray) -> np.ndarray:
        """The next frame's depth (H, W) float32 [m], steadied; where there is no reading there is none after."""
        settings = self._settings
        if not settings.use:
            return depth
        inverse = np.zeros(depth.shape, np.float32)
        np.divide(np.float32(1.0), depth, out=inverse, where=depth > 0)
        if self._mean is None or self._count is None or self._mean.shape != depth.shape:
            self._mean, self._count = inverse, (depth > 0).astype(np.uint8)
            self._moved, self.share = inverse > 0, 0.0
            return depth
        sigma = self._sigma(inverse)
        moving = self._moving(inverse, sigma)
        change = np.where((inverse > 0) & (self._mean > 0) & ~moving, self._mean - inverse, np.float32(np.nan))
        before = np.where(moving, np.uint8(0), self._count)
        if settings.follow and moving.any():
            self._follow(inverse, moving, sigma, change, before)
        elif not settings.follow:
            change = np.where((inverse > 0) & (self._mean > 0), self._mean - inverse, np.float32(np.nan))
            before = self._count
        out, count = np.zeros_like(inverse), np.zeros(depth.shape, np.uint8)
        each_range(
            _blend_kernel, len(depth), inverse, change, before, sigma, np.float32(settings.deviations),
            settings.window, settings.memory, out, count,
        )  # fmt: skip
        self._mean, self._count, self._moved = out, count, moving
        self.share = float((count[moving] > 1).mean()) if moving.any() else 0.0
        steady = np.zeros_like(depth)
        np.divide(np.float32(1.0), out, out=steady, where=out > 0)
        return steady

    def _moving(self, inverse: np.ndarray, sigma: np.ndarray) -> np.ndarray:
        """Readings (H, W) that are not of the background."""
        moving = inverse > 0
        if self._background is None or self._background.shape != inverse.shape:
            return moving
        there = np.zeros_like(inverse)
        np.divide(np.float32(1.0), self._background, out=there, where=self._background > 0)
        moving &= ~((there > 0) & (np.abs(inverse - there) < _STILL * sigma))
        return moving & (_around(moving, _SPECK) >= _ALONE)

    def _sigma(self, inverse: np.ndarray) -> np.ndarray:
        """Standard deviation (H, W) float32 of inverse depth [1/m]: of the model, or of what is quiet."""
        assert self._mean is not None
        if self._model is not None:
            z = 1.0 / np.maximum(inverse, np.float32(1e-3))
            return (self._model.sigma(z, self._camera.fx) * inverse * inverse).astype(np.float32)
        both = (inverse > 0) & (self._mean > 0)
        change = np.abs(inverse[both] - self._mean[both]) if both.any() else np.zeros(1, np.float32)
        # a quarter of a normal distribution's values lie within 0.3186 standard deviations
        quiet = max(float(np.percentile(change, 25)) / 0.3186 / np.sqrt(2.0), 1e-6)
        return np.full(inverse.shape, quiet, np.float32)

    def _follow(
        self, inverse: np.ndarray, moving: np.ndarray, sigma: np.ndarray, change: np.ndarray, before: np.ndarray
    ) -> None:
        """Where things move: ``change`` to the mean of the surface that each reading lies on, and its ``before``."""
        camera, mean, count = self._camera, self._mean, self._count
        assert mean is not None and count is not None
        lens = np.array((camera.fx, camera.fy, camera.cx, camera.cy))
        planes = np.zeros((*(-(-size // _GRID) for size in inverse.shape), 3), np.float32)
        assert self._moved is not None
        each_range(_plane_kernel, len(planes), mean, _around(self._moved, _SLACK), planes)
        found, middle = _nodes(inverse, moving, lens)
        shape = found.shape
        nodes = np.flatnonzero(found.ravel())
        motion = np.zeros((*shape, 6))  # turn [rad] and shift [m] about each node's middle
        centers = middle.reshape(-1, 3)
        prior = np.diag([_TURN**-2] * 3 + [_SHIFT**-2] * 3)
        for stride in _STRIDES:
            equations, right = np.zeros((len(nodes), 6, 6)), np.zeros((len(nodes), 6))
            flat = motion.reshape(-1, 6)
            each_range(
                _register_kernel, len(nodes), nodes, shape[1], inverse, moving, planes, centers, flat, lens,
                sigma, stride, equations, right,
            )  # fmt: skip
            equations += np.tril(equations, -1).transpose(0, 2, 1)  # the kernel fills the lower half
            right = right / _TOGETHER - flat[nodes] @ prior
            flat[nodes] += np.linalg.solve(equations / _TOGETHER + prior, right[..., None])[..., 0]
            motion = _with_neighbours(motion, found, middle)
        each_range(
            _change_kernel, len(inverse), inverse, moving, mean, count, found, middle, motion, lens, change, before
        )


def _around(mask: np.ndarray, radius: int) -> np.ndarray:
    """How many pixels of the mask (H, W) lie in the window of that radius about each; uint8."""
    count = np.pad(mask.astype(np.uint8), radius)
    for axis in (0, 1):
        size = count.shape[axis] - 2 * radius
        parts = [count.take(range(k, k + size), axis) for k in range(2 * radius + 1)]
        count = np.sum(parts, axis=0, dtype=np.uint8)
    return count


def _nodes(inverse: np.ndarray, moving: np.ndarray, lens: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which blocks of the picture show something that moves (R, C), and the points (R, C, 3) in their middles [m]."""
    rows, columns = inverse.shape[0] // _SPACING, inverse.shape[1] // _SPACING
    cut = (slice(0, rows * _SPACING), slice(0, columns * _SPACING))
    blocks = np.where(moving, inverse, np.float32(np.inf))[cut].reshape(rows, _SPACING, columns, _SPACING)
    sorted_blocks = np.sort(blocks.transpose(0, 2, 1, 3).reshape(rows, columns, -1), axis=-1)
    number = np.isfinite(sorted_blocks).sum(axis=-1)
    found = number > 0
    median = np.take_along_axis(sorted_blocks, np.where(found, number // 2, 0)[..., None], axis=-1)[..., 0]
    z = np.where(found, 1.0 / np.where(found, median, 1.0), 0.0)
    v, u = (_SPACING * np.arange(n) + _SPACING // 2 for n in (rows, columns))
    x, y = (u - lens[2]) / lens[0] * z, ((v - lens[3]) / lens[1])[:, None] * z
    return found, np.stack((x, y, z), axis=-1)


def _with_neighbours(motion: np.ndarray, found: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Motions (R, C, 6) averaged half and half with those of the four neighbours on the same surface."""
    total, weight = np.zeros_like(motion), np.zeros(found.shape)
    for axis, way in ((0, 1), (0, -1), (1, 1), (1, -1)):
        other, there = np.roll(middle, way, axis), np.roll(found, way, axis)
        edge = [slice(None), slice(None)]
        edge[axis] = slice(0, 1) if way == 1 else slice(-1, None)
        there = there.copy()
        there[tuple(edge)] = False
        same = there & found & (np.abs(other[..., 2] - middle[..., 2]) < _SAME)
        moved = np.roll(motion, way, axis)
        # the neighbour's motion, seen from this node's middle
        shift = moved[..., 3:] + cross(moved[..., :3], middle - other)
        total += same[..., None] * np.concatenate((moved[..., :3], shift), axis=-1)
        weight += same
    mean = total / np.maximum(weight, 1.0)[..., None]
    return np.where((weight > 0)[..., None], 0.5 * motion + 0.5 * mean, motion)


@njit(cache=True, nogil=True, error_model="numpy")
def _plane_kernel(begin, end, mean, wanted, planes):
    """Of pixels that are ``wanted``, one in ``_GRID`` × ``_GRID``, the plane through the same surface about them.

    Inverse depth there, and slopes a pixel.
    """
    height, width = mean.shape
    for row in range(begin, end):
        v = _GRID * row
        for u in range(0, width, _GRID):
            d = mean[v, u]
            if d == 0.0 or wanted[v, u] == 0:
                continue
            limit = d * d * _SAME
            n = su = sv = suu = svv = suv = sd = sdu = sdv = 0.0
            for y in range(max(v - _PATCH, 0), min(v + _PATCH + 1, height)):
                for x in range(max(u - _PATCH, 0), min(u + _PATCH + 1, width)):
                    e = mean[y, x] - d
                    if mean[y, x] == 0.0 or abs(e) > limit:
                        continue
                    a, b = float(x - u), float(y - v)
                    n += 1.0
                    su += a
                    sv += b
                    suu += a * a
                    svv += b * b
                    suv += a * b
                    sd += e
                    sdu += e * a
                    sdv += e * b
            if n < _FEWEST:
                continue
            # about the middle of the neighbourhood
            suu -= su * su / n
            svv -= sv * sv / n
            suv -= su * sv / n
            sdu -= sd * su / n
            sdv -= sd * sv / n
            det = suu * svv - suv * suv
            if det < 1e-3 * suu * svv or det <= 0.0:
                continue
            gu = (svv * sdu - suv * sdv) / det
            gv = (suu * sdv - suv * sdu) / det
            planes[row, u // _GRID, 0] = d + (sd - gu * su - gv * sv) / n
            planes[row, u // _GRID, 1] = gu
            planes[row, u // _GRID, 2] = gv


@njit(cache=True, nogil=True, error_model="numpy")
def _register_kernel(
    begin, end, nodes, columns, inverse, moving, planes, centers, motion, lens, sigma, stride, equations, right
):
    """Normal equations of some nodes' motions: their windows' points onto the planes of the frame before."""
    height, width = inverse.shape
    last_i, last_j = len(planes) - 1, planes.shape[1] - 1
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    row = np.zeros(6)
    for k in range(begin, end):
        node = nodes[k]
        v0, u0 = _SPACING * (node // columns) + _SPACING // 2, _SPACING * (node % columns) + _SPACING // 2
        mx, my, mz = centers[node, 0], centers[node, 1], centers[node, 2]
        wx, wy, wz = motion[node, 0], motion[node, 1], motion[node, 2]
        tx, ty, tz = motion[node, 3], motion[node, 4], motion[node, 5]
        for v in range(max(v0 - _REACH, 0), min(v0 + _REACH + 1, height), stride):
            for u in range(max(u0 - _REACH, 0), min(u0 + _REACH + 1, width), stride):
                if not moving[v, u]:
                    continue
                z, precision = 1.0 / inverse[v, u], 1.0 / sigma[v, u]
                if abs(z - mz) > 2.0 * _SAME:
                    continue
                rx, ry, rz = (u - cx) / fx * z - mx, (v - cy) / fy * z - my, z - mz
                x = mx + rx + wy * rz - wz * ry + tx
                y = my + ry + wz * rx - wx * rz + ty
                q = mz + rz + wx * ry - wy * rx + tz
                if q < 0.1:
                    continue
                at_u, at_v = fx * x / q + cx, fy * y / q + cy
                if not (0.0 <= at_u <= width - 1.0 and 0.0 <= at_v <= height - 1.0):
                    continue
                i, j = min(int(at_v / _GRID + 0.5), last_i), min(int(at_u / _GRID + 0.5), last_j)
                d = planes[i, j, 0]
                if d == 0.0:
                    continue
                gu, gv = planes[i, j, 1], planes[i, j, 2]
                e = (d + gu * (at_u - _GRID * j) + gv * (at_v - _GRID * i) - 1.0 / q) * precision
                if abs(e) > _SAME * d * d * precision:
                    continue
                gx, gy = gu * fx / q * precision, gv * fy / q * precision
                gz = (1.0 / q - gu * fx * x / q - gv * fy * y / q) / q * precision
                row[0], row[1], row[2] = ry * gz - rz * gy, rz * gx - rx * gz, rx * gy - ry * gx
                row[3], row[4], row[5] = gx, gy, gz
                weight = 1.0 / (1.0 + (e / _OUTLIER) ** 2)
                for a in range(6):
                    right[k, a] -= weight * row[a] * e
                    for b in range(a + 1):
                        equations[k, a, b] += weight * row[a] * row[b]


@njit(cache=True, nogil=True, error_model="numpy")
def _change_kernel(begin, end, inverse, moving, mean, count, found, middle, motion, lens, change, before):
    """How far each moving reading is from the mean of the surface that it lies on, and how many frames that has."""
    height, width = inverse.shape
    rows, columns = found.shape
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    for v in range(begin, end):
        for u in range(width):
            if not moving[v, u]:
                continue
            z = 1.0 / inverse[v, u]
            px, py = (u - cx) / fx * z, (v - cy) / fy * z
            at_i, at_j = (v - _SPACING // 2) / _SPACING, (u - _SPACING // 2) / _SPACING
            i0, j0 = int(np.floor(at_i)), int(np.floor(at_j))
            total = x = y = q = 0.0
            for i in range(max(i0, 0), min(i0 + 2, rows)):
                for j in range(max(j0, 0), min(j0 + 2, columns)):
                    if not found[i, j] or abs(middle[i, j, 2] - z) > 2.0 * _SAME:
                        continue
                    share = (1.0 - abs(at_i - i)) * (1.0 - abs(at_j - j)) + 1e-6
                    m, c = motion[i, j], middle[i, j]
                    rx, ry, rz = px - c[0], py - c[1], z - c[2]
                    x += share * (px + m[1] * rz - m[2] * ry + m[3])
                    y += share * (py + m[2] * rx - m[0] * rz + m[4])
                    q += share * (z + m[0] * ry - m[1] * rx + m[5])
                    total += share
            if total == 0.0 or q < 0.1 * total:
                continue
            x, y, q = x / total, y / total, q / total
            at_u, at_v = fx * x / q + cx, fy * y / q + cy
            if not (0.0 <= at_u < width - 1.0 and 0.0 <= at_v < height - 1.0):
                continue
            i, j = int(at_v), int(at_u)
            b, a = at_v - i, at_u - j
            d00, d01, d10, d11 = mean[i, j], mean[i, j + 1], mean[i + 1, j], mean[i + 1, j + 1]
            least = min(min(d00, d01), min(d10, d11))
            most = max(max(d00, d01), max(d10, d11))
            if least == 0.0 or most - least > _SAME * least * least:
                continue
            d = (1.0 - b) * ((1.0 - a) * d00 + a * d01) + b * ((1.0 - a) * d10 + a * d11)
            change[v, u] = d - 1.0 / q
            before[v, u] = count[int(at_v + 0.5), int(at_u + 0.5)]


@njit(cache=True, nogil=True, error_model="numpy")
def _blend_kernel(begin, end, inverse, change, before, sigma, deviations, window, memory, out, number):
    """Each reading and the mean that it joins, where both it and its neighbourhood lie within the noise of that."""
    height, width = inverse.shape
    for v in range(begin, end):
        for u in range(width):
            d = inverse[v, u]
            if d == 0.0:
                continue
            out[v, u], number[v, u] = d, 1
            r, n = change[v, u], np.float32(before[v, u])
            limit = deviations * sigma[v, u] * np.sqrt(np.float32(1.0) + np.float32(1.0) / max(n, np.float32(1.0)))
            if n == 0.0 or not abs(r) <= limit:  # true for NaN, too
                continue
            total, found = np.float32(0.0), np.float32(0.0)
            for y in range(max(v - window, 0), min(v + window + 1, height)):
                for x in range(max(u - window, 0), min(u + window + 1, width)):
                    near = change[y, x]
                    if near == near:
                        total += near
                        found += np.float32(1.0)
            if abs(total) > np.float32(0.5) * limit * found:
                continue
            frames = min(n + np.float32(1.0), np.float32(memory))
            out[v, u] = d + (np.float32(1.0) - np.float32(1.0) / frames) * r
            number[v, u] = min(before[v, u] + 1, memory)
