"""A mirror placed from points picked on its frame, or from a known plane."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..camera import Intrinsics, RgbdImage, unproject
from ..capture import MirrorPicks
from ..errors import MirrorError, PicksDisagreeError
from .curved_glass import REFRACTION
from .disparity_plane import BLOCK, DisparityPlane, disparity_of_plane, fit_core, plane_covariance, plane_of_disparity
from .frame_pixels import grow_frame
from .frame_sides import WIDEST
from .glass_extent import with_measured_sides, with_rectangle
from .mirror import Mirror, oriented, plane_mirror
from .wall_behind_frame import THICK, SeparatedFrame, separate_wall


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
    glass_thickness : float
        Of the glass before the silver [m], where it is known: the mirror reflects as if it lay a third of that behind
        the front, and delays the light of cameras that measure time.
    pick_radius : int
        A pick without a reading takes the nearest reading within this many pixels.
    """

    grow: bool = True
    band: float = 0.02
    glass_offset: float = 0.0
    glass_thickness: float = 0.0
    pick_radius: int = 3

    @property
    def behind_frame(self) -> float:
        """How far the apparent surface lies behind the front of the frame [m]."""
        return self.glass_offset + self.glass_thickness / REFRACTION


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


def place_mirror(
    image: RgbdImage, picks: MirrorPicks, settings: MirrorSettings = MirrorSettings(), cloud: np.ndarray | None = None
) -> Mirror:
    """The mirror that picked frame pixels mean: plane from the picks, grown to the frame's pixels, fitted robustly.

    Parameters
    ----------
    picks : MirrorPicks
        Pixels on the frame, or a plane that is taken as it is.
    image : RgbdImage
        z [m], 0 = no reading.
    cloud : np.ndarray [shape=(H, W, 3)], optional
        ``depth`` unprojected, where that is at hand.

    Raises
    ------
    MirrorError
        Picks outside the image, on no reading, fewer than three, on one line, or most of them in no common plane.
    """
    depth, intrinsics = image.depth, image.intrinsics
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
    if abs(mirror.normal @ mirror.point) < _EDGE_ON * np.linalg.norm(mirror.point):
        raise MirrorError(
            f"{picks.name}: the plane through the picks is seen edge-on, so that nothing could be seen in it; pick on "
            "the frame itself, on at least two of its sides, not on the glass or on something in front of it"
        )
    if settings.behind_frame:
        mirror = replace(mirror, point=mirror.point - settings.behind_frame * mirror.normal)
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
            away = (rows + v0 - v) ** 2 + (cols + u0 - u) ** 2
            z = window[rows, cols]
            # a click that just missed the frame is on the glass, which shows more distant things
            beside = (away <= 2) & (z < z[np.argmin(away)] - 0.1)
            if beside.sum() >= 2:
                away = np.where(beside, away, 99)
            nearest = np.argmin(away)
            snapped.append((cols[nearest] + u0, rows[nearest] + v0))
    if len(snapped) < 3:
        raise MirrorError(
            f"{picks.name}: only {len(snapped)} of {len(pixels)} picks are on a depth reading, a plane needs at least "
            "3; "
            "pick where the frame shows depth"
        )
    return np.array(snapped)


def _without_outliers(points: np.ndarray, plane: Mirror) -> Mirror:
    """Plane of the picks that agree.

    The triple that most are near decides (MSAC; Torr and Zisserman 2000), then SVD of its inliers. The median distance
    would not do: half of the picks may be on one side of the frame, in a line.
    """
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
    # picks at a large distance fix a plane better: ties go to the larger triangle
    score = np.sqrt((np.minimum(distance, _NO_PICK) ** 2).mean(axis=1)) + 0.002 / length[usable]
    best = distance[np.argmin(score)]
    near = int((best <= _NO_PICK).sum())
    if near < 0.6 * count:
        raise PicksDisagreeError(
            f"{plane.name}: only {near} of {count} picked points lie in one plane, the others up to "
            f"{best.max():.1f} m off it; pick on the frame itself, not on the glass. If the mirror has no frame "
            "and does not hang on a wall, put strips of paper or tape, 3 cm wide, along its edges"
        )
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
    """Refit on the frame's pixels around the picks; None when there are almost none."""
    first = disparity_of_plane(plane.normal, float(plane.normal @ plane.point), intrinsics)
    grown = grow_frame(depth, seeds, first, 0.5 * (intrinsics.fx + intrinsics.fy), band)
    if grown is None:
        return None
    beside = _near_picks(depth, seeds, cloud, plane, first, intrinsics, band, grown)
    u, v, fitted = beside
    mirror, core = _on_pixels(u, v, fitted, depth, seeds, cloud, plane, intrinsics)
    assert mirror.rectangle is not None  # it was just set
    if beside is not grown:  # a wall that is not flat shows steps that are no frame's
        separated = SeparatedFrame(u, v, fitted, THICK)
    else:
        separated = separate_wall(u, v, depth, fitted, intrinsics.packed, mirror.point, mirror.basis, mirror.rectangle)
    if separated.fitted is not fitted:
        mirror, core = _on_pixels(separated.u, separated.v, separated.fitted, depth, seeds, cloud, plane, intrinsics)
    covariance = plane_covariance(core, intrinsics, mirror.point, mirror.basis)
    return replace(mirror, covariance=covariance + np.diag((0.0, 0.0, separated.depth_error**2)))


_Grown = tuple[np.ndarray, np.ndarray, DisparityPlane]


def _near_picks(
    depth: np.ndarray,
    seeds: np.ndarray,
    cloud: np.ndarray,
    plane: Mirror,
    first: np.ndarray,
    intrinsics: Intrinsics,
    band: float,
    grown: _Grown,
) -> _Grown:
    """What was ``grown``, or only what of it lies near the picks, where it ran on over a wall that is not flat.

    What a mirror hangs on says where it is only beside it: the rest of the wall may bulge, or be another wall.
    """
    u, v, fitted = grown
    if not _uneven(u, v, cloud, fitted, intrinsics):
        return grown
    picked = (cloud[seeds[:, 1], seeds[:, 0]] - plane.point) @ plane.basis[:, :2]
    low, high = picked.min(axis=0), picked.max(axis=0)
    place = (cloud[v, u] - plane.point) @ plane.basis[:, :2]
    past = np.maximum(low - place, place - high).max(axis=1)  # outside of the picks' box, negative inside
    if (past > WIDEST).sum() < _WALL_SHARE * len(u):  # it is no wall
        return grown
    for reach in _BESIDE:
        beside = np.zeros_like(depth)
        mine = np.abs(past) < reach
        beside[v[mine], u[mine]] = depth[v[mine], u[mine]]
        kept = beside[seeds[:, 1], seeds[:, 0]] > 0.0
        again = grow_frame(
            beside, seeds[kept], first, 0.5 * (intrinsics.fx + intrinsics.fy), band
        ) if kept.sum() >= 3 else None  # fmt: skip
        if again is None:
            break
        grown = again
        if not _uneven(*grown[:2], cloud, grown[2], intrinsics):
            break
    return grown


def _uneven(u: np.ndarray, v: np.ndarray, cloud: np.ndarray, fitted: DisparityPlane, intrinsics: Intrinsics) -> bool:
    """Whether blocks of the pixels are off the plane by far more than noise."""
    normal, d = plane_of_disparity(fitted.coefficients, intrinsics)
    lift = cloud[v, u] @ normal - d
    _, member, count = np.unique(u // BLOCK * 10_000 + v // BLOCK, return_inverse=True, return_counts=True)
    mean = np.bincount(member, lift) / count
    noise = 1.4826 * float(np.median(np.abs(lift - mean[member])))
    return float(np.sqrt(np.mean(mean[count > BLOCK] ** 2))) > max(_UNEVEN, noise) if (count > BLOCK).any() else False


def _on_pixels(
    u: np.ndarray,
    v: np.ndarray,
    fitted: DisparityPlane,
    depth: np.ndarray,
    seeds: np.ndarray,
    cloud: np.ndarray,
    plane: Mirror,
    intrinsics: Intrinsics,
) -> tuple[Mirror, DisparityPlane]:
    """The mirror on the plane of its frame's pixels, with its rectangle, about picks ``seeds``; and that plane."""
    kept = fitted.weights > 0.1
    points = cloud[v[kept], u[kept]]
    core = fit_core(u, v, depth, fitted)
    normal, d = plane_of_disparity(core.coefficients, intrinsics)
    normal, d = (normal, d) if normal @ plane.normal > 0 else (-normal, -d)
    center = points.mean(axis=0)
    center = center - (normal @ center - d) * normal
    mirror = Mirror(plane.name, center, *oriented(normal, center), points_used=len(points), refined=True)
    residual = (points - center) @ mirror.normal
    mirror = replace(mirror, residual=float(np.sqrt(np.mean(residual**2))))
    picked = cloud[seeds[:, 1], seeds[:, 0]]
    on_plane = np.abs((picked - center) @ normal) < max(0.05, 4 * mirror.residual)
    # where the lines of sight to all picks meet the plane, whatever was read there
    rays = picked / np.maximum(picked[:, 2:], 1e-9)
    drawn = rays * (d / (rays @ normal))[:, None] if np.abs(rays @ normal).min() > _EDGE_ON else picked
    near = picked[on_plane] if on_plane.any() else points
    mirror = with_measured_sides(RgbdImage(depth, intrinsics), mirror, points, near, drawn, core)
    return mirror, core


_UNEVEN = 0.0025  # root mean square by which a wall is off a plane from which on it is not flat [m]
_WALL_SHARE = 0.2  # of what was grown that lies farther from the picks than a frame is wide, else it is no wall
_BESIDE = (0.15, 0.05)  # how near to the picks' box a wall that is not flat still counts [m]
_EDGE_ON = 0.08  # cosine between line of sight and normal from which on nothing can be seen in a mirror
_NO_PICK = 0.06  # a pick this far off the plane is not on the frame [m]
