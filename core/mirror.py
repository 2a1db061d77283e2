"""A mirror's plane from points on its frame (paper eq. 1), reflection over it (eq. 2–4), and growing picks to the
whole frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from .camera import Intrinsics, project, unproject
from .capture import MirrorPicks
from .errors import MirrorError


@dataclass(frozen=True)
class MirrorSettings:
    """How picks become a plane.

    Parameters
    ----------
    grow : bool
        Pull in the frame's own pixels around the picks; off is the paper's plain fit.
    band : float
        Half thickness of the slab around the first plane in which the frame is searched, relative to z.
    glass_offset : float
        How far the reflecting glass lies behind the front of the frame [m].
    pick_radius : int
        A pick without a reading takes the nearest reading within this many pixels.
    """

    grow: bool = True
    band: float = 0.02
    glass_offset: float = 0.0
    pick_radius: int = 3


@dataclass(frozen=True)
class Mirror:
    """A mirror's plane and outline, camera frame.

    Parameters
    ----------
    name : str
        For reports.
    point : np.ndarray [shape=(3,)]
        Centroid of the frame points [m] (the paper's c_m).
    normal : np.ndarray [shape=(3,)]
        Unit, towards the camera.
    basis : np.ndarray [shape=(3, 3)]
        Columns a, b, c of eq. 1: the paper's M, mirror → world, right-handed. Seen by the camera a points left, b down;
        c is ``normal``.
    rectangle : np.ndarray [shape=(2, 2)] or None
        Extent of the glass along a and b about ``point`` [m]: ((a_min, a_max), (b_min, b_max)). None = unlimited.
    outline : np.ndarray [shape=(4, 2)] or None
        Corners of ``rectangle`` in pixels.
    residual : float
        RMS distance of the points used from the plane [m]; 0 for a plane that was given.
    points_used : int
        How many.
    refined : bool
        The frame's own pixels were pulled in.
    source : str
        Where it is from: "picked", "given" (its plane was), "found" (without a click) or "rig file".
    covariance : np.ndarray [shape=(3, 3)] or None
        How sure the plane is, about ``point``: of its slope along a and along b [rad], and of its shift along the
        normal [m]. None for a plane that was given.
    polygon : np.ndarray [shape=(K, 2)] or None
        Corners of a glass that is no rectangle, along a and b about ``point`` [m], inside ``rectangle``.
    """

    name: str
    point: np.ndarray
    normal: np.ndarray
    basis: np.ndarray
    rectangle: np.ndarray | None = None
    outline: np.ndarray | None = None
    residual: float = 0.0
    points_used: int = 0
    refined: bool = False
    source: str = "picked"
    covariance: np.ndarray | None = None
    polygon: np.ndarray | None = None

    def displacement(self, points: np.ndarray) -> float | None:
        """Expected error of reflected ``points`` (N, 3), root mean square over them [m]; None without a covariance.

        To first order a slope (α, β) and a shift δ move the image of a point at r from ``point``, s in front of the
        plane, by 2 (α a·r + β b·r + δ) n + 2 s (α a + β b).
        """
        if self.covariance is None:
            return None
        a, b, n = self.basis.T
        moves = reflection_moves(self, points)
        return float(np.sqrt(np.einsum("nci,ij,ncj->n", moves, self.covariance, moves).mean()))


def reflection_moves(mirror: Mirror, points: np.ndarray) -> np.ndarray:
    """How the reflections of ``points`` (N, 3) move with the mirror: derivatives (N, 3, 3), the last axis over its
    slopes along a and b and its shift along the normal."""
    a, b, n = mirror.basis.T
    offset = np.asarray(points, dtype=np.float64).reshape(-1, 3) - mirror.point
    ahead = (offset @ n)[:, None]
    return np.stack(
        (
            2.0 * ((offset @ a)[:, None] * n + ahead * a),
            2.0 * ((offset @ b)[:, None] * n + ahead * b),
            np.broadcast_to(2.0 * n, offset.shape),
        ),
        axis=2,
    )


def fit_plane(points: np.ndarray, name: str = "mirror") -> Mirror:
    """Plane through points by the SVD of their covariance (paper eq. 1).

    Parameters
    ----------
    points : np.ndarray [shape=(K, 3)]
        Camera-frame points [m] on the mirror's frame, K ≥ 3, not on one line.

    Raises
    ------
    MirrorError
        Fewer than three finite points, or all (nearly) on one line.
    """
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 3:
        raise MirrorError(
            f"{name}: {len(points)} usable frame point(s), a plane needs at least 3; pick more points on its frame"
        )
    center = points.mean(axis=0)
    offset = points - center
    _, scales, axes = np.linalg.svd(offset.T @ offset / len(points))
    spread = np.sqrt(scales)
    if spread[0] == 0 or spread[1] < 0.02 * spread[0]:
        raise MirrorError(
            f"{name}: the {len(points)} frame points lie on one line; pick points on at least two of its sides"
        )
    normal, basis = oriented(axes[2], center)
    misses = offset @ normal
    A = np.column_stack((offset @ basis[:, :2], np.ones(len(points))))
    noise = float(misses @ misses) / max(len(points) - 3, 1)
    return Mirror(
        name,
        center,
        normal,
        basis,
        residual=float(np.sqrt(np.mean(misses**2))),
        points_used=len(points),
        covariance=noise * np.linalg.inv(A.T @ A) if len(points) > 3 else None,
    )


def oriented(normal: np.ndarray, point: np.ndarray, down=(0.0, 1.0, 0.0)) -> tuple[np.ndarray, np.ndarray]:
    """Unit normal towards the camera, and the basis (a left, b down, c normal); ``down`` says where b points."""
    normal = normal / np.linalg.norm(normal)
    if normal @ point > 0:
        normal = -normal
    down = np.asarray(down) - (normal @ down) * normal
    if np.linalg.norm(down) < 0.1:  # a mirror on floor or ceiling
        down = np.array((0.0, 0.0, 1.0)) - normal[2] * normal
    down /= np.linalg.norm(down)
    return normal, np.column_stack((np.cross(down, normal), down, normal))


def plane_mirror(name: str, point: np.ndarray, normal: np.ndarray) -> Mirror:
    """A mirror whose plane is known; its glass is taken as unlimited."""
    point = np.asarray(point, dtype=np.float64)
    normal = np.asarray(normal, dtype=np.float64)
    if (
        point.shape != (3,)
        or normal.shape != (3,)
        or not np.isfinite((point, normal)).all()
        or np.linalg.norm(normal) < 1e-9
    ):
        raise MirrorError(f"{name}: a plane needs a point and a non-zero normal of three numbers each")
    return Mirror(name, point, *oriented(normal, point), source="given")


def reflection_matrix(mirror: Mirror) -> np.ndarray:
    """Reflection over the mirror as one matrix (4, 4): to mirror coordinates, flip z, and back (paper eq. 2–4)."""
    flip = np.diag((1.0, 1.0, -1.0))
    matrix = np.eye(4)
    matrix[:3, :3] = mirror.basis @ flip @ mirror.basis.T
    matrix[:3, 3] = mirror.point - matrix[:3, :3] @ mirror.point
    return matrix


def reflect(points: np.ndarray, mirror: Mirror) -> np.ndarray:
    """Points [shape=(..., 3)] flipped over the mirror's plane (paper eq. 2–4)."""
    matrix = reflection_matrix(mirror)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def place_mirror(
    picks: MirrorPicks,
    depth: np.ndarray,
    intrinsics: Intrinsics,
    settings: MirrorSettings = MirrorSettings(),
    cloud: np.ndarray | None = None,
) -> Mirror:
    """The mirror that picked frame pixels mean: plane from the picks, grown to the frame's pixels, fitted robustly.

    Parameters
    ----------
    picks : MirrorPicks
        Pixels on the frame, or a plane that is taken as it is.
    depth : np.ndarray [shape=(H, W), dtype=float32]
        z [m], 0 = no reading.
    cloud : np.ndarray [shape=(H, W, 3)], optional
        ``depth`` unprojected, where that is at hand.

    Raises
    ------
    MirrorError
        Picks outside the image, on no reading, fewer than three or on one line.
    """
    if picks.frame_pixels is None:
        return plane_mirror(picks.name, picks.point, picks.normal)
    pixels = _snap_picks(picks, depth, settings.pick_radius)
    cloud = unproject(depth, intrinsics) if cloud is None else cloud
    picked = cloud[pixels[:, 1], pixels[:, 0]]
    first = fit_plane(picked, picks.name)
    first = _without_outliers(picked, first)
    mirror = first
    if settings.grow:
        grown = _grow(depth, pixels, cloud, first, intrinsics, settings.band)
        if grown is not None:
            mirror = grown
    if settings.glass_offset:
        mirror = replace(mirror, point=mirror.point - settings.glass_offset * mirror.normal)
    return mirror if mirror.outline is not None else with_rectangle(mirror, picked, picked, intrinsics)


def _snap_picks(picks: MirrorPicks, depth: np.ndarray, radius: int) -> np.ndarray:
    """Integer pixels (K, 2) of the picks, each on a reading that its neighbourhood agrees with."""
    height, width = depth.shape
    pixels = np.asarray(picks.frame_pixels, dtype=np.float64).reshape(-1, 2)
    if len(pixels) < 3:
        raise MirrorError(f"{picks.name}: {len(pixels)} frame point(s) picked, a plane needs at least 3; pick more")
    outside = ~((pixels >= -0.5) & (pixels <= (width - 0.5, height - 0.5))).all(axis=1)
    if outside.any():
        u, v = pixels[outside][0]
        raise MirrorError(f"{picks.name}: pick ({u:g}, {v:g}) is outside the {width}×{height} depth image")
    snapped = []
    for u, v in np.rint(pixels).astype(int):
        u0, v0 = max(u - radius, 0), max(v - radius, 0)
        window = depth[v0 : v + radius + 1, u0 : u + radius + 1]
        rows, cols = np.nonzero(window)
        if len(rows):
            nearest = np.argmin((rows + v0 - v) ** 2 + (cols + u0 - u) ** 2)
            snapped.append((cols[nearest] + u0, rows[nearest] + v0))
    if len(snapped) < 3:
        raise MirrorError(
            f"{picks.name}: only {len(snapped)} of {len(pixels)} picks are on a depth reading, a plane needs at least "
            "3; "
            "pick where the frame shows depth"
        )
    return np.array(snapped)


def _without_outliers(points: np.ndarray, plane: Mirror) -> Mirror:
    """Plane of the picks that agree: the triple of least median distance decides, then SVD of its inliers."""
    count = len(points)
    if count < 5:
        return plane
    triples = np.array([(i, j, k) for i in range(count) for j in range(i) for k in range(j)])
    if len(triples) > 600:
        triples = triples[np.random.default_rng(0).choice(len(triples), 600, replace=False)]
    a, b, c = points[triples[:, 0]], points[triples[:, 1]], points[triples[:, 2]]
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    usable = length > 1e-3
    if not usable.any():
        return plane
    normals = normals[usable] / length[usable, None]
    distance = np.abs(normals @ points.T - np.einsum("ij,ij->i", normals, a[usable])[:, None])
    # picks far apart fix a plane better: ties in the median go to the larger triangle
    score = np.median(distance, axis=1) + 0.002 / length[usable]
    best = distance[np.argmin(score)]
    inlier = best <= max(3.0 * np.median(best), 0.02)
    if inlier.sum() < 4:
        return plane
    try:
        return fit_plane(points[inlier], plane.name)
    except MirrorError:  # the agreeing picks are on one line, all of them are not
        return plane


def _grow(
    depth: np.ndarray, seeds: np.ndarray, cloud: np.ndarray, plane: Mirror, intrinsics: Intrinsics, band: float
) -> Mirror | None:
    """Refit on the pixels connected to the picks along the plane; None when there are hardly any."""
    normal = plane.normal
    state, stack = np.zeros(depth.shape, dtype=np.int8), np.empty((depth.size, 2), np.int32)
    d = float(normal @ plane.point)
    # the picks' plane may be off by more than the frame's noise: follow the fit until it stands still, so that the
    # slab is centred on the frame and cuts no side of its noise off
    leading = True  # a sample leads the way, all have the last word
    for turn in range(8):
        u, v = stack[: _grow_kernel(depth, cloud, seeds, normal, d, band, 2 * turn + 1, state, stack)].T
        if len(u) < 30:
            return None
        leading &= turn < 7
        part = slice(None, None, len(u) // 1500 + 1 if leading else 1)
        fitted = disparity_plane(u[part], v[part], depth[v[part], u[part]])
        if fitted is None:
            return None
        previous = normal
        normal, d = plane_of_disparity(fitted.coefficients, intrinsics)
        normal, d = (normal, d) if normal @ previous > 0 else (-normal, -d)
        turned = np.arccos(min(normal @ previous, 1.0))
        if not leading and turned < 5e-4:  # the slab is centred well enough
            break
        leading &= bool(turned > 5e-3)
    points = cloud[v, u][fitted.weights > 0.1]
    low, high = (v.min(), u.min()), (v.max() + 1, u.max() + 1)
    v, u = np.nonzero(frame_core(state[low[0] : high[0], low[1] : high[1]] == 2 * turn + 1))
    v, u = v + low[0], u + low[1]
    core = disparity_plane(u, v, depth[v, u])
    if core is not None:
        fitted, previous = core, normal
        normal, d = plane_of_disparity(fitted.coefficients, intrinsics)
        normal, d = (normal, d) if normal @ previous > 0 else (-normal, -d)
    center = points.mean(axis=0)
    center = center - (normal @ center - d) * normal
    grown = Mirror(plane.name, center, *oriented(normal, center), points_used=len(points), refined=True)
    residual = (points - center) @ grown.normal
    grown = replace(
        grown,
        residual=float(np.sqrt(np.mean(residual**2))),
        covariance=plane_covariance(fitted, intrinsics, center, grown.basis),
    )
    picked = cloud[seeds[:, 1], seeds[:, 0]]
    on_plane = np.abs((picked - center) @ normal) < max(0.05, 4 * grown.residual)
    return with_rectangle(grown, points, picked[on_plane] if on_plane.any() else points, intrinsics)


@njit(cache=True, nogil=True)
def _grow_kernel(depth, cloud, seeds, normal, d, band, stamp, state, queue):
    """Flood fill from the seeds over pixels within ``band``·z of the plane; steps over gaps of two pixels.

    Writes the pixels (u, v) to ``queue`` and says how many. ``state`` becomes ``stamp`` on them and ``stamp`` + 1 on
    what was asked and is none of them; smaller values are those of earlier turns.
    """
    height, width = depth.shape
    end = 0
    for k in range(len(seeds)):
        u, v = seeds[k]
        p = cloud[v, u]
        if state[v, u] < stamp and abs(
            normal[0] * p[0] + normal[1] * p[1] + normal[2] * p[2] - d
        ) < band * depth[v, u]:  # fmt: skip
            state[v, u] = stamp
            queue[end, 0], queue[end, 1] = u, v
            end += 1
    start = 0
    while start < end:
        u, v = queue[start]
        start += 1
        for reach in (1, 3):  # amid the frame its neighbours see all that it sees
            whole = True
            for y in range(max(v - reach, 0), min(v + reach + 1, height)):
                for x in range(max(u - reach, 0), min(u + reach + 1, width)):
                    if state[y, x] < stamp:
                        z = depth[y, x]
                        p = cloud[y, x]
                        if z > 0 and abs(normal[0] * p[0] + normal[1] * p[1] + normal[2] * p[2] - d) < band * z:
                            state[y, x] = stamp
                            queue[end, 0], queue[end, 1] = x, y
                            end += 1
                        else:
                            state[y, x] = stamp + 1
                    whole &= state[y, x] == stamp
            if whole:
                break
    return end


@dataclass(frozen=True)
class DisparityPlane:
    """1/z = a·u + b·v + c: ``coefficients`` (3,), their ``covariance`` (3, 3), and ``weights`` (K,) of the pixels."""

    coefficients: np.ndarray
    covariance: np.ndarray
    weights: np.ndarray


def disparity_plane(u: np.ndarray, v: np.ndarray, z: np.ndarray) -> DisparityPlane | None:
    """Robust plane 1/z = a·u + b·v + c by iteratively re-weighted least squares (Tukey); None when all are on a line.

    A depth camera's error is even in 1/z, and a plane is linear there. Neighbouring pixels share errors (edges,
    quantisation, smoothing inside the camera), so the covariance is that of clustered data: pixels are pooled by their
    direction from the middle, and the pools' scores are taken as independent (Liang and Zeger 1986).
    """
    found, solution, normal, weights, center, scale, pooled = _reweighted_kernel(
        np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64), 1.0 / z.astype(np.float64)
    )
    if not found:
        return None
    unscale = np.diag(1.0 / scale)
    unscale[2, :2] = -center[:2] / scale[:2]
    sandwich = unscale @ np.linalg.inv(normal) @ pooled
    return DisparityPlane(unscale @ solution, sandwich @ sandwich.T * (_POOLS / (_POOLS - 3.0)), weights)


_POOLS = 36


@njit(cache=True, nogil=True)
def _reweighted_kernel(u, v, d):
    """Tukey's re-weighted least squares of d over (u, v, 1), centred and scaled so that the normal equations are exact
    enough: found, solution (3,), their matrix (3, 3), weights (K,), centre and scale (3,), pooled scores (3, pools)."""
    count = len(d)
    center, scale = np.zeros(3), np.ones(3)
    center[0], center[1] = u.mean(), v.mean()
    scale[0], scale[1] = max(np.abs(u).max(), 1.0), max(np.abs(v).max(), 1.0)
    weights, residual, row = np.ones(count), np.empty(count), np.ones(3)
    solution, normal, pooled = np.zeros(3), np.zeros((3, 3)), np.zeros((3, _POOLS))
    for _ in range(12):
        normal[:] = 0.0
        right = np.zeros(3)
        for i in range(count):
            row[0], row[1] = (u[i] - center[0]) / scale[0], (v[i] - center[1]) / scale[1]
            for a in range(3):
                right[a] += weights[i] * row[a] * d[i]
                for b in range(3):
                    normal[a, b] += weights[i] * row[a] * row[b]
        previous = solution
        found, solution = _solve_3x3(normal, right)
        if not found:  # all on one line
            return False, previous, normal, weights, center, scale, pooled
        for i in range(count):
            x, y = (u[i] - center[0]) / scale[0], (v[i] - center[1]) / scale[1]
            residual[i] = d[i] - (solution[0] * x + solution[1] * y + solution[2])
        _weigh(residual, weights)
        if np.abs(solution - previous).max() < 1e-5 * np.abs(solution).max():
            break
    for i in range(count):
        x, y = u[i] - center[0], v[i] - center[1]
        pool = int((np.arctan2(y, x) / (2.0 * np.pi) + 0.5) * _POOLS) % _POOLS
        score = weights[i] * residual[i]
        pooled[0, pool] += score * x / scale[0]
        pooled[1, pool] += score * y / scale[1]
        pooled[2, pool] += score
    return True, solution, normal, weights, center, scale, pooled


@njit(cache=True, nogil=True)
def _solve_3x3(matrix, right):
    """Cramer's rule, and whether the determinant is far enough from 0; numba's own solver needs scipy, which Blender
    has not."""
    a, b, c = matrix[0], matrix[1], matrix[2]
    minors = np.empty((3, 3))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        minors[0, k] = b[i] * c[j] - b[j] * c[i]
        minors[1, k] = c[i] * a[j] - c[j] * a[i]
        minors[2, k] = a[i] * b[j] - a[j] * b[i]
    determinant = a[0] * minors[0, 0] + a[1] * minors[0, 1] + a[2] * minors[0, 2]
    trace = a[0] + b[1] + c[2]
    solution = np.zeros(3)
    if determinant < 1e-10 * trace * trace * trace:
        return False, solution
    for k in range(3):
        for row in range(3):
            solution[k] += minors[row, k] * right[row] / determinant
    return True, solution


@njit(cache=True, nogil=True)
def _weigh(residual, weights):
    """Tukey's weights of residuals."""
    scale = 1.4826 * np.median(np.abs(residual[:: len(residual) // 2000 + 1])) + 1e-9
    for i in range(len(residual)):
        r = residual[i] / (4.7 * scale)
        weights[i] = (1.0 - r * r) ** 2 if abs(r) < 1.0 else 0.0


def plane_of_disparity(coefficients: np.ndarray, intrinsics: Intrinsics) -> tuple[np.ndarray, float]:
    """Normal and offset d (n·p = d, metres) of the plane 1/z = a·u + b·v + c."""
    a, b, c = coefficients
    n = np.array((a * intrinsics.fx, b * intrinsics.fy, a * intrinsics.cx + b * intrinsics.cy + c))
    length = np.linalg.norm(n)
    return n / length, 1.0 / length


def plane_covariance(
    fitted: DisparityPlane, intrinsics: Intrinsics, point: np.ndarray, basis: np.ndarray
) -> np.ndarray:
    """:attr:`Mirror.covariance` (3, 3) about ``point`` from that of the disparity plane's coefficients.

    With m = (a·fx, b·fy, a·cx + b·cy + c) the plane is m·p = 1; a change of m lifts it at p by -δm·p / |m|.
    """
    to_m = np.array(((intrinsics.fx, 0, 0), (0, intrinsics.fy, 0), (intrinsics.cx, intrinsics.cy, 1)))
    length = np.linalg.norm(to_m @ fitted.coefficients)
    transfer = -np.array((basis[:, 0], basis[:, 1], point)) @ to_m / length
    return transfer @ fitted.covariance @ transfer.T


def frame_core(mask: np.ndarray) -> np.ndarray:
    """The pixels of a frame without its edges, which cameras smear: as far from them as leaves a third of the frame.

    Parameters
    ----------
    mask : np.ndarray [shape=(H, W), dtype=bool]

    Returns
    -------
    np.ndarray [shape=(H, W), dtype=bool]
        Eroded by 2, 1 or 0 pixels.
    """
    depth = _erosion_kernel(mask)
    count = np.bincount(depth.ravel(), minlength=4)
    frame = count[1:].sum()
    for edge in (2, 1):
        kept = count[edge + 1 :].sum()
        if kept > 0.33 * frame and kept > 200:
            return depth > edge
    return mask


@njit(cache=True, nogil=True)
def _erosion_kernel(mask):
    """0 off the mask, else 1 + how many rings of 8-neighbours are all on it, up to 3."""
    height, width = mask.shape
    out = np.zeros(mask.shape, np.uint8)
    for v in range(height):
        for u in range(width):
            if not mask[v, u]:
                continue
            rings = 0
            while rings < 2:
                r = rings + 1
                if v < r or u < r or v >= height - r or u >= width - r:
                    break
                whole = True
                for k in range(-r, r + 1):
                    if not (mask[v - r, u + k] and mask[v + r, u + k] and mask[v + k, u - r] and mask[v + k, u + r]):
                        whole = False
                        break
                if not whole:
                    break
                rings = r
            out[v, u] = 1 + rings
    return out


def _extent(frame: np.ndarray, picked: np.ndarray, mirror: Mirror) -> np.ndarray:
    """Extent of the frame along the mirror's right and down axes, about its point: rows (min, max) [m]."""
    grown = (frame - mirror.point) @ mirror.basis[:, :2]
    picks = (picked - mirror.point) @ mirror.basis[:, :2]
    top, bottom = np.quantile(grown[:, 1], (0.002, 0.998))
    # near the floor the flood may run along the line where floor and plane meet: the width is read above it
    upper = grown[grown[:, 1] < top + 0.7 * (bottom - top)]
    left, right = np.quantile(upper[:, 0], (0.005, 0.995))
    low, high = picks.min(axis=0), picks.max(axis=0)
    beyond = ((grown < low - _FRAME) | (grown > high + _FRAME)).any(axis=1)
    # a frame that goes on past the picks stays a rim, a wall is a surface
    inset = np.minimum(grown - (left, top), (right, bottom) - grown).min(axis=1)
    wall = beyond & (np.abs(inset) > 1.5 * _FRAME)
    if wall.mean() > 0.3:  # a wall goes on in the frame's plane: only the picks say how far the mirror goes
        left, right = np.clip((left, right), low[0] - _FRAME / 4, high[0] + _FRAME / 4)
        top, bottom = np.clip((top, bottom), low[1] - _FRAME / 4, high[1] + _FRAME / 4)
    return np.array(((min(left, low[0]), max(right, high[0])), (min(top, low[1]), max(bottom, high[1]))))


def with_rectangle(mirror: Mirror, frame: np.ndarray, picked: np.ndarray, intrinsics: Intrinsics) -> Mirror:
    """The mirror with the bounding rectangle of its frame as its glass, and that rectangle's corners in pixels.

    Parameters
    ----------
    frame, picked : np.ndarray [shape=(K, 3)]
        The frame's points, and the picks that lie on the plane [m].

    Notes
    -----
    A side that lies at the image's border, or beyond it, is cut off by it: the glass goes on there.
    """
    rectangle = _extent(frame, picked, mirror)
    cut = _cut_off(frame, mirror, rectangle, intrinsics)
    return at_border(replace(mirror, rectangle=rectangle), intrinsics, cut=cut)


def _cut_off(frame: np.ndarray, mirror: Mirror, rectangle: np.ndarray, intrinsics: Intrinsics) -> np.ndarray:
    """Which sides of the rectangle (2, 2) bool the image's border cuts off: the frame reaches the border on that side,
    and has no bar along it."""
    pixels, middle = project(frame, intrinsics), project(mirror.point, intrinsics)
    place = (frame - mirror.point) @ mirror.basis[:, :2]
    size = np.array((intrinsics.width, intrinsics.height)) - 1
    cut = np.zeros((2, 2), np.bool_)
    for axis in range(2):
        low, high = rectangle[1 - axis]
        for end in range(2):
            at = np.empty(2)
            at[axis], at[1 - axis] = rectangle[axis, end], rectangle[1 - axis].mean()
            beyond = project(mirror.point + mirror.basis[:, :2] @ at, intrinsics)[axis] > middle[axis]
            reaches = (pixels[:, axis] > size[axis] - 2).sum() if beyond else (pixels[:, axis] < 2).sum()
            along = place[np.abs(place[:, axis] - rectangle[axis, end]) < 0.04, 1 - axis]
            cells = np.unique(np.floor(20.0 * (along - low) / max(high - low, 1e-9)))
            cut[axis, end] = reaches >= 3 and len(cells) < 8
    return cut


def at_border(
    mirror: Mirror, intrinsics: Intrinsics, open_ends: np.ndarray | None = None, cut: np.ndarray | None = None
) -> Mirror:
    """The mirror with the outline of its rectangle [px]; sides at the image's border are moved beyond it.

    ``open_ends`` (2, 2) bool, as ``rectangle``, says which ends may be cut off; by default any. ``cut`` (2, 2) bool
    says which are known to be.
    """
    rectangle = np.array(mirror.rectangle)
    margin = 0.04 * np.array((intrinsics.width, intrinsics.height))
    for axis in range(2):
        for end in range(2):
            if open_ends is not None and not open_ends[axis, end]:
                continue
            at = np.empty(2)
            at[axis], at[1 - axis] = rectangle[axis, end], rectangle[1 - axis].mean()
            pixel = project(mirror.point + mirror.basis[:, :2] @ at, intrinsics)[axis]
            size = (intrinsics.width, intrinsics.height)[axis]
            known = cut is not None and cut[axis, end]
            if known or not margin[axis] < pixel < size - 1 - margin[axis]:
                rectangle[axis, end] += (-_BEYOND, _BEYOND)[end]
    (left, right), (top, bottom) = rectangle
    corners = np.array(((left, top), (right, top), (right, bottom), (left, bottom)))
    return replace(
        mirror, rectangle=rectangle, outline=project(mirror.point + corners @ mirror.basis[:, :2].T, intrinsics)
    )


_FRAME = 0.15  # more than a frame is wide [m]
_BEYOND = 2.0  # how far glass is taken to go on past the image's border [m]
