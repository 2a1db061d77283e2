"""A mirror's plane from points on its frame (paper eq. 1), reflection over it (eq. 2–4), and growing picks to the
whole frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from .camera import Intrinsics, project, unproject
from .capture import MirrorPicks
from .errors import MirrorError, PicksDisagreeError
from .frame_fit import THICK, DisparityPlane, fit_core, frame_sides, grow_frame, part_wall


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
    moved_by : tuple of str
        What moved the plane from where its frame is: "reflections" of what is seen directly too, the "floor" that is
        seen both ways, "views" that must agree, "seams" that showed a step.
    moved : float
        By how much that moves the reflection of somebody 1.5 m before it, root mean square [m].
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
    moved_by: tuple[str, ...] = ()
    moved: float = 0.0

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


def on_wall(mirror: Mirror) -> bool:
    """Its plane is that of a wall it hangs on; its glass is before it, nobody knows how far."""
    return mirror.covariance is not None and mirror.covariance[2, 2] > THICK**2


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


def behind_glass(
    points: np.ndarray, mirrors: Iterable[Mirror], margin: float = 0.0, nearest: float = 1.0
) -> np.ndarray:
    """Which of some points (N, 3) the camera sees, or would see, in the rectangle of a mirror that is before them.

    ``margin`` [m] widens the rectangles; what is nearer than the plane counts, too, when the plane is less than
    ``nearest`` times as far.
    """
    hidden = np.zeros(len(points), np.bool_)
    for m in mirrors:
        if m.rectangle is None:  # how far it goes is not known
            continue
        share = (m.normal @ m.point) / (points @ m.normal)
        place = (points * share[:, None] - m.point) @ m.basis[:, :2]
        on = ((m.rectangle[:, 0] - margin < place) & (place < m.rectangle[:, 1] + margin)).all(axis=1)
        hidden |= on & (share > 0.0) & (share < nearest)
    return hidden


def moved(mirror: Mirror, step: np.ndarray) -> Mirror:
    """The mirror tilted by two slopes and shifted along its normal."""
    a, b, n = mirror.basis.T
    point = mirror.point + step[2] * n
    normal, basis = oriented(n - step[0] * a - step[1] * b, point, b)
    return replace(mirror, point=point, normal=normal, basis=basis)


def person_before(mirror: Mirror) -> np.ndarray:
    """Points (6, 3) where a person 1.5 m before the middle of the mirror would be [m]."""
    middle = mirror.point
    if mirror.rectangle is not None:
        middle = middle + mirror.basis[:, :2] @ np.clip(mirror.rectangle, -1.5, 1.5).mean(axis=1)
    x, y = np.meshgrid((-0.3, 0.3), (-0.8, 0.0, 0.8))
    return middle + 1.5 * mirror.normal + np.column_stack((x.ravel(), y.ravel())) @ mirror.basis[:, :2].T


def reflection_shift(person: np.ndarray, one: Mirror, other: Mirror) -> float:
    """How far apart two mirrors lay ``person`` (N, 3), root mean square over the points [m]."""
    return float(np.sqrt(np.mean(np.sum((reflect(person, one) - reflect(person, other)) ** 2, axis=1))))


def with_reason(new: Mirror, old: Mirror, reason: str) -> Mirror:
    """``new``, noting that ``reason`` moved it from ``old``, and by how much at a person."""
    apart = reflection_shift(person_before(old), new, old)
    return replace(new, moved_by=(*old.moved_by, reason), moved=float(np.hypot(old.moved, apart)))


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
        Picks outside the image, on no reading, fewer than three, on one line, or most of them in no common plane.
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
    if abs(mirror.normal @ mirror.point) < _EDGE_ON * np.linalg.norm(mirror.point):
        raise MirrorError(
            f"{picks.name}: the plane through the picks is seen edge-on, nothing could be seen in it; pick on the "
            "frame itself, on at least two of its sides, not on the glass or on what stands before it"
        )
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
    """Plane of the picks that agree: the triple that most are near decides (MSAC; Torr and Zisserman 2000), then SVD of
    its inliers. The median distance would not do: half of the picks may be on one side of the frame, in a line."""
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
    # picks far apart fix a plane better: ties go to the larger triangle
    score = np.sqrt((np.minimum(distance, _NO_PICK) ** 2).mean(axis=1)) + 0.002 / length[usable]
    best = distance[np.argmin(score)]
    near = int((best <= _NO_PICK).sum())
    if near < 0.6 * count:
        raise PicksDisagreeError(
            f"{plane.name}: only {near} of {count} picked points lie in one plane, the others up to "
            f"{best.max():.1f} m off it; pick on the frame itself, not on the glass. A mirror without a frame that "
            "stands clear of the wall shows only by the person in it where it is, and here that is not enough: put "
            "strips of paper or tape, 3 cm wide, along its edges"
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
    """Refit on the frame's pixels around the picks; None when there are hardly any."""
    first = disparity_of_plane(plane.normal, float(plane.normal @ plane.point), intrinsics)
    grown = grow_frame(depth, seeds, first, 0.5 * (intrinsics.fx + intrinsics.fy), band)
    if grown is None:
        return None
    u, v, fitted = grown
    mirror, core = _on_pixels(u, v, fitted, depth, seeds, cloud, plane, intrinsics)
    parted = part_wall(u, v, depth, fitted, intrinsics.lens, mirror.point, mirror.basis, mirror.rectangle)
    if parted.fitted is not fitted:
        mirror, core = _on_pixels(parted.u, parted.v, parted.fitted, depth, seeds, cloud, plane, intrinsics)
    covariance = plane_covariance(core, intrinsics, mirror.point, mirror.basis)
    return replace(mirror, covariance=covariance + np.diag((0.0, 0.0, parted.unsure**2)))


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
    mirror = _with_sides(
        mirror, points, picked[on_plane] if on_plane.any() else points, drawn, depth, core, intrinsics
    )  # fmt: skip
    return mirror, core


def _with_sides(
    mirror: Mirror,
    frame: np.ndarray,
    picked: np.ndarray,
    drawn: np.ndarray,
    depth: np.ndarray,
    fitted: DisparityPlane,
    intrinsics: Intrinsics,
) -> Mirror:
    """The mirror turned as its frame is, with the rectangle that this encloses.

    Each side is where the depth across it says, see :func:`.frame_fit.frame_sides`; the extent of the pixels that were
    grown, which may run on along the floor or a wall, counts only where no evidence is.
    """
    plane = fitted.coefficients
    # a plane's pixels, but not what a shallow surface beside it has within a hand's breadth
    tolerance = 4.0 * np.hypot(fitted.scale, np.sqrt(fitted.common))
    tolerance = min(max(tolerance, 0.004 / mirror.point[2] ** 2), 0.02 / mirror.point[2])
    thin = frame[:: len(frame) // 6000 + 1]
    rectangle = _extent(thin, picked, drawn, mirror)[0]
    for _ in range(3):
        inner, outer, cut, turn = frame_sides(
            depth, intrinsics.lens, plane, tolerance, mirror.point, mirror.basis, rectangle
        )
        # a frame's bars are about as wide as each other: what is wider runs on along the floor or a wall
        width = np.abs(outer - inner)
        least = np.nanmin(width) if np.isfinite(width).sum() > 1 else np.inf
        outer = inner + np.sign(outer - inner) * np.minimum(width, 1.5 * least + 0.005)
        place = (picked - mirror.point) @ mirror.basis[:, :2]
        within = np.column_stack((outer[:, 0] - place.min(axis=0), place.max(axis=0) - outer[:, 1]))
        known = within < _INSIDE  # false where NaN
        rectangle = np.where(known, outer, rectangle)
        if abs(turn) < 2.5e-3:
            break
        down = mirror.basis[:, 1] - np.tan(turn) * mirror.basis[:, 0]
        mirror = replace(mirror, basis=oriented(mirror.normal, mirror.point, down)[1])
    if not known.all():
        extent, wall = _extent(thin, picked, drawn, mirror)
        rectangle = np.where(known, rectangle, extent)
        cut = (cut & ~wall) | _cut_off(frame, mirror, rectangle, intrinsics, ~known & ~wall)
    return at_border(replace(mirror, rectangle=rectangle), intrinsics, ~known, cut & ~known)


def plane_of_disparity(coefficients: np.ndarray, intrinsics: Intrinsics) -> tuple[np.ndarray, float]:
    """Normal and offset d (n·p = d, metres) of the plane 1/z = a·u + b·v + c."""
    a, b, c = coefficients
    n = np.array((a * intrinsics.fx, b * intrinsics.fy, a * intrinsics.cx + b * intrinsics.cy + c))
    length = np.linalg.norm(n)
    return n / length, 1.0 / length


def disparity_of_plane(normal: np.ndarray, d: float, intrinsics: Intrinsics) -> np.ndarray:
    """Coefficients (3,) of 1/z = a·u + b·v + c on the plane n·p = d."""
    n, k = np.asarray(normal) / d, intrinsics
    return np.array((n[0] / k.fx, n[1] / k.fy, n[2] - n[0] * k.cx / k.fx - n[1] * k.cy / k.fy))


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


def _extent(frame: np.ndarray, picked: np.ndarray, drawn: np.ndarray, mirror: Mirror) -> tuple[np.ndarray, np.ndarray]:
    """Extent of the frame along the mirror's right and down axes, about its point: rows (min, max) [m]; and on which
    sides (2, 2) a wall goes on in its plane: there only the picks, as ``drawn`` on the plane, say how far it goes."""
    grown = (frame - mirror.point) @ mirror.basis[:, :2]
    picks = (picked - mirror.point) @ mirror.basis[:, :2]
    top, bottom = np.quantile(grown[:, 1], (0.002, 0.998))
    # near the floor the flood may run along the line where floor and plane meet: the width is read above it
    upper = grown[grown[:, 1] < top + 0.7 * (bottom - top)]
    extent = np.array((np.quantile(upper[:, 0], (0.005, 0.995)), (top, bottom)))
    said = np.column_stack((picks.min(axis=0), picks.max(axis=0)))
    wall = np.zeros((2, 2), np.bool_)
    for axis in range(2):
        for end, sign in ((0, -1.0), (1, 1.0)):
            start = sign * said[axis, end] + _FRAME / 2
            far = sign * extent[axis, end] - start
            if far > _FRAME / 2:
                # a frame that goes on past the picks stays a rim, a wall is a surface
                beyond = grown[sign * grown[:, axis] > start]
                cells = np.floor(beyond / _CELL).astype(np.int64)
                filled = len(np.unique(cells[:, 0] * 100_003 + cells[:, 1])) * _CELL**2
                wall[axis, end] = filled > 0.5 * far * (said[1 - axis, 1] - said[1 - axis, 0])
    marks = (drawn - mirror.point) @ mirror.basis[:, :2]
    clipped = np.column_stack((marks.min(axis=0) - _RIM, marks.max(axis=0) + _RIM))
    outer = np.column_stack((np.minimum(extent[:, 0], said[:, 0]), np.maximum(extent[:, 1], said[:, 1])))
    return np.where(wall, clipped, outer), wall


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
    rectangle, wall = _extent(frame, picked, picked, mirror)
    cut = _cut_off(frame, mirror, rectangle, intrinsics, ~wall)
    return at_border(replace(mirror, rectangle=rectangle), intrinsics, cut=cut)


def _cut_off(
    frame: np.ndarray, mirror: Mirror, rectangle: np.ndarray, intrinsics: Intrinsics, asked: np.ndarray
) -> np.ndarray:
    """Which sides of the rectangle (2, 2) bool, of those ``asked`` for, the image's border cuts off: the frame reaches
    the border on that side, and has no bar along it."""
    pixels, middle = project(frame, intrinsics), project(mirror.point, intrinsics)
    place = (frame - mirror.point) @ mirror.basis[:, :2]
    size = np.array((intrinsics.width, intrinsics.height)) - 1
    cut = np.zeros((2, 2), np.bool_)
    for axis in range(2):
        low, high = rectangle[1 - axis]
        for end in np.flatnonzero(asked[axis]):
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
    return with_outline(replace(mirror, rectangle=rectangle), intrinsics)


def with_outline(mirror: Mirror, intrinsics: Intrinsics) -> Mirror:
    """The mirror with the corners of its rectangle in pixels."""
    (left, right), (top, bottom) = mirror.rectangle
    corners = np.array(((left, top), (right, top), (right, bottom), (left, bottom)))
    return replace(mirror, outline=project(mirror.point + corners @ mirror.basis[:, :2].T, intrinsics))


_FRAME = 0.15  # more than a frame is wide [m]
_RIM = 0.01  # about as far outside of picks on a wall a mirror ends [m]
_CELL = 0.03  # side of the cells that tell a rim from a surface [m]
_INSIDE = 0.04  # a side that ends so far inside of picks on the plane is not the frame's [m]
_EDGE_ON = 0.08  # cosine between line of sight and normal from which on nothing can be seen in a mirror
_NO_PICK = 0.06  # a pick this far off the plane is not on the frame [m]
_BEYOND = 2.0  # how far glass is taken to go on past the image's border [m]
