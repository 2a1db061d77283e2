"""Which pixel belongs to which view (direct, mirror 1…N) and to the subject; floor, background and ghosts removed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange

from .camera import Intrinsics, unproject
from .errors import ReconstructionError
from .linear import dot
from .mesh import root_of
from .mirror import Mirror, reflect, reflection_matrix


@dataclass(frozen=True)
class ViewSettings:
    """How the subject is told from the room.

    Parameters
    ----------
    depth_limit : float
        What lies farther along the (folded) path is dropped [m]; 0 = no limit.
    floor_clearance : float
        Readings up to this far above the floor are the floor's [m]; never less than the floor's own noise asks for.
    reach : float
        Radius about the vertical axis through the subject inside which it is looked for [m].
    max_height : float
        Height above the floor up to which the subject is looked for [m].
    min_pixels : int
        A view with fewer pixels of the subject shows nobody.
    """

    depth_limit: float = 0.0
    floor_clearance: float = 0.015
    reach: float = 1.15
    max_height: float = 2.4
    min_pixels: int = 150


@dataclass(frozen=True)
class Views:
    """The capture sorted into views.

    Parameters
    ----------
    labels : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel of the subject: 0 direct, 1..N through mirror N; -1 = not the subject.
    seen : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel with a reading, subject or not; -1 = none or seen by two reflections.
    points : np.ndarray [shape=(H, W, 3), dtype=float64]
        Every reading where it really is: mirrored ones flipped back, camera frame [m].
    up : np.ndarray [shape=(3,)]
        Unit vertical, camera frame.
    floor : float or None
        Height of the floor along ``up`` [m]; None when no floor is seen.
    warnings : tuple of str
    """

    labels: np.ndarray
    seen: np.ndarray
    points: np.ndarray
    up: np.ndarray
    floor: float | None
    floor_noise: float
    axis: np.ndarray
    warnings: tuple[str, ...]


def vertical(mirrors: list[Mirror]) -> np.ndarray:
    """Up from the rig: mirrors stand vertically, so the cross product of two normals is vertical (paper 4.2.2).

    With fewer than two mirrors, or parallel ones, the camera is taken to stand upright.
    """
    up = np.zeros(3)
    for i, a in enumerate(mirrors):
        for b in mirrors[:i]:
            cross = np.cross(a.normal, b.normal)
            up += cross if cross[1] < 0 else -cross
    length = np.linalg.norm(up)
    return up / length if length > 0.1 else np.array((0.0, -1.0, 0.0))


def sort_rays(
    depth: np.ndarray, points: np.ndarray, mirrors: list[Mirror], depth_limit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Direct or through which mirror: decided by whether a pixel's ray passes a mirror's glass before its reading.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
    points : np.ndarray [shape=(H, W, 3)]
        Unprojected readings, camera frame [m].
    mirrors : list of Mirror
    depth_limit : float
        Readings with larger z are dropped [m]; 0 = no limit.

    Returns
    -------
    seen : np.ndarray [shape=(H, W), dtype=int8]
        0 direct, i through mirror i (1-based), -1 no reading, on a mirror's frame, or reflected twice.
    placed : np.ndarray [shape=(H, W, 3)]
        The readings where they really are.
    """
    count = len(mirrors)
    planes = np.zeros((count, 4))
    axes = np.zeros((count, 2, 3))
    limits = np.zeros((count, 2, 2))
    centers = np.zeros((count, 3))
    flips = np.zeros((count, 4, 4))
    for i, m in enumerate(mirrors):
        planes[i, :3], planes[i, 3] = m.normal, m.normal @ m.point
        axes[i] = m.basis[:, :2].T
        limits[i] = ((-np.inf, np.inf), (-np.inf, np.inf)) if m.rectangle is None else m.rectangle
        centers[i] = m.point
        flips[i] = reflection_matrix(m)
    return _sort_kernel(depth, points, planes, axes, limits, centers, flips, depth_limit if depth_limit > 0 else np.inf)


@njit(cache=True, nogil=True)
def _crosses(origin, target, plane, axes, limits, center, margin):
    """Share of the way from origin to target at which it meets the mirror's rectangle; 2 when it does not."""
    a = plane[0] * origin[0] + plane[1] * origin[1] + plane[2] * origin[2] - plane[3]
    b = plane[0] * target[0] + plane[1] * target[1] + plane[2] * target[2] - plane[3]
    if a <= 0 or b >= -margin:
        return 2.0
    t = a / (a - b)
    for k in range(2):
        s = 0.0
        for c in range(3):
            s += axes[k, c] * (origin[c] + t * (target[c] - origin[c]) - center[c])
        if s < limits[k, 0] or s > limits[k, 1]:
            return 2.0
    return t


@njit(cache=True, nogil=True, parallel=True)
def _sort_kernel(depth, points, planes, axes, limits, centers, flips, depth_limit):
    height, width = depth.shape
    count = len(planes)
    seen = np.full((height, width), -1, np.int8)
    placed = np.empty_like(points)
    for v in prange(height):
        placed[v] = points[v]
        camera = np.zeros(3)
        crossing = np.empty(3)
        for u in range(width):
            z = depth[v, u]
            if z == 0 or z > depth_limit:
                continue
            p = points[v, u]
            margin = 0.01 * z + 0.01
            best, which = 2.0, -1
            on_frame = False
            for i in range(count):
                t = _crosses(camera, p, planes[i], axes[i], limits[i], centers[i], margin)
                if t < best:
                    best, which = t, i
                if not np.isinf(limits[i, 0, 0]):
                    off = planes[i, 0] * p[0] + planes[i, 1] * p[1] + planes[i, 2] * p[2] - planes[i, 3]
                    if abs(off) < margin:
                        inside = True
                        for k in range(2):
                            s = 0.0
                            for c in range(3):
                                s += axes[i, k, c] * (p[c] - centers[i, c])
                            if s < limits[i, k, 0] - 0.02 or s > limits[i, k, 1] + 0.02:
                                inside = False
                        on_frame = on_frame or inside
            if which < 0:
                if not on_frame:
                    seen[v, u] = 0
                continue
            for r in range(3):
                s = flips[which, r, 3]
                for c in range(3):
                    s += flips[which, r, c] * p[c]
                placed[v, u, r] = s
                crossing[r] = best * p[r]
            twice = False
            for j in range(count):
                if (
                    j != which
                    and _crosses(crossing, placed[v, u], planes[j], axes[j], limits[j], centers[j], margin) < 1.0
                ):
                    twice = True
            if not twice:
                seen[v, u] = which + 1
    return seen, placed


def find_floor(points: np.ndarray, up: np.ndarray, tilt_limit: float = 15.0) -> tuple[np.ndarray, float, float] | None:
    """The floor among placed readings: the lowest large plane that is level to within ``tilt_limit`` degrees.

    Parameters
    ----------
    points : np.ndarray [shape=(N, 3)]
        Directly seen readings, camera frame [m].
    up : np.ndarray [shape=(3,)]
        First guess of the vertical.

    Returns
    -------
    (up, height, noise) or None
        The floor's normal, its height along it and the standard deviation of its points [m].
    """
    if len(points) > 20000:
        points = points[:: len(points) // 20000 + 1]
    if len(points) < 200:
        return None
    rng = np.random.default_rng(0)
    sample = points[:: len(points) // 4000 + 1]
    height = dot(sample, up)
    low = sample[height <= np.quantile(height, 0.4)]
    a, b, c = low[rng.integers(0, len(low), (3, 80))]
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    normals /= np.where(length > 0, length, 1.0)[:, None]
    normals *= np.where(dot(normals, up) < 0, -1.0, 1.0)[:, None]
    level = (length > 4e-4) & (dot(normals, up) > np.cos(np.radians(tilt_limit)))
    if not level.any():
        return None
    normals, offsets = normals[level], np.einsum("ij,ij->i", normals, a)[level]
    score = _floor_scores(sample, normals, offsets)
    winner = int(np.argmax(score))
    if score[winner] < 0.02 * len(sample):
        return None
    n, d = normals[winner], offsets[winner]
    band = 0.06
    for _ in range(5):
        inliers = points[np.abs(dot(points, n) - d) < band]
        center = inliers.mean(axis=0)
        fitted = np.linalg.svd(_scatter(inliers, center))[2][2]
        n = fitted if fitted @ up > 0 else -fitted
        d = n @ center
        noise = 1.4826 * np.median(np.abs(dot(inliers, n) - d))
        band = max(4 * noise, 0.015)
    return (n, float(d), float(noise)) if n @ up > np.cos(np.radians(tilt_limit)) else None


@njit(cache=True, nogil=True)
def _floor_scores(points, normals, offsets):
    """Points within 2 cm of each plane, less three for each 6 cm under it: nothing of substance lies under a floor."""
    score = np.zeros(len(normals), np.int64)
    for k in range(len(normals)):
        x, y, z, offset = normals[k, 0], normals[k, 1], normals[k, 2], offsets[k]
        total = 0
        for i in range(len(points)):
            distance = points[i, 0] * x + points[i, 1] * y + points[i, 2] * z - offset
            total += (abs(distance) < 0.02) - 3 * (distance < -0.06)
        score[k] = total
    return score


@njit(cache=True, nogil=True)
def _scatter(points, center):
    """Scatter matrix (3, 3) of points (N, 3) about ``center``."""
    out = np.zeros((3, 3))
    for i in range(len(points)):
        for a in range(3):
            for b in range(3):
                out[a, b] += (points[i, a] - center[a]) * (points[i, b] - center[b])
    return out


def rig_axis(mirrors: list[Mirror], up: np.ndarray, intrinsics: Intrinsics) -> np.ndarray | None:
    """A point of the vertical line where the reflected lines of sight meet: where the subject is meant to stand.

    The line of sight to the middle of what the image shows of each mirror is reflected; the answer is the point
    nearest to all of them and to the
    camera's own line of sight, seen from above. None with no mirror of known extent.
    """
    A, b = np.zeros((3, 3)), np.zeros(3)
    lines = [(np.zeros(3), np.array((0.0, 0.0, 1.0)))]
    for m in mirrors:
        if m.outline is None:
            continue
        middle = _visible_middle(m, intrinsics)
        direction = reflect(middle * 2, m) - middle
        lines.append((middle, direction / np.linalg.norm(direction)))
    if len(lines) < 2:
        return None
    A += 1e-3 * np.outer(up, up)
    for origin, direction in lines:
        level = direction - (direction @ up) * up
        level /= np.linalg.norm(level)
        P = np.eye(3) - np.outer(level, level) - np.outer(up, up)
        A += P
        b += P @ origin
    return np.linalg.solve(A, b)


def _visible_middle(mirror: Mirror, intrinsics: Intrinsics) -> np.ndarray:
    """Point of the mirror's plane in the middle of its outline, as far as that is in the image."""
    corners = np.nan_to_num(mirror.outline, nan=0.0)
    size = np.array((intrinsics.width - 1, intrinsics.height - 1))
    u, v = 0.5 * (np.clip(corners.min(axis=0), 0, size) + np.clip(corners.max(axis=0), 0, size))
    ray = np.array(((u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy, 1.0))
    return ray * (mirror.normal @ mirror.point) / (mirror.normal @ ray)


def find_subject(
    depth: np.ndarray,
    intrinsics: Intrinsics,
    mirrors: list[Mirror],
    settings: ViewSettings = ViewSettings(),
    meeting: np.ndarray | None = None,
) -> Views:
    """Sort every pixel into its view and keep the subject: the connected figure above the floor where the rig looks.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        Fused depth, z [m], 0 = no reading.
    meeting : np.ndarray [shape=(3,)], optional
        A point of the vertical line where the subject is meant to stand [m]; by default where the mirrors look.

    Raises
    ------
    ReconstructionError
        Nobody stands between the camera and the mirrors.

    Notes
    -----
    O(H W); about 60 bytes a pixel.
    """
    warnings = []
    seen, points = sort_rays(depth, unproject(depth, intrinsics), mirrors, settings.depth_limit)
    up = vertical(mirrors)
    direct = np.flatnonzero(seen == 0)
    floor = find_floor(points.reshape(-1, 3)[direct[:: len(direct) // 20000 + 1]], up)
    floor_height, floor_noise = None, 0.0
    if floor is not None:
        up, floor_height, floor_noise = floor
    if floor_height is None:
        lowest, highest = -np.inf, np.inf
    else:
        lowest = floor_height + max(settings.floor_clearance, 3.0 * floor_noise)
        highest = floor_height + settings.max_height
    standing = _between_kernel(points, seen, up, lowest, highest)
    component, sizes = connected_pixels(depth, standing, 1.0 / intrinsics.fx)
    meeting = rig_axis(mirrors, up, intrinsics) if meeting is None else meeting
    direct = _direct_subject(component, len(sizes), seen, points, up, meeting, settings)
    if direct is None:
        raise ReconstructionError(
            "nobody stands between the camera and the mirrors: no connected figure is seen directly "
            f"within {settings.reach:g} m of where the mirrors look; stand where both mirrors show you, 2 to 3 m from "
            "the camera"
        )
    labels = np.full(depth.shape, -1, np.int8)
    _label_kernel(component, _member_table(direct, len(sizes)), 0, labels)
    inside = points[labels == 0]
    axis = np.median(inside, axis=0)
    height = dot(inside, up)
    radius = np.sqrt(_squared_distance(inside, axis, _across(up)).max())
    for i, m in enumerate(mirrors, start=1):
        # components among this mirror's pixels that lie where the directly seen subject stands
        total, within, _ = _component_kernel(
            component, len(sizes), seen, i, points, axis, _across(up), (radius + 0.35) ** 2, up,
            (height.min() - 0.15, height.max() + 0.15)
        )
        chosen = np.flatnonzero((within > 0.6 * total) & (within >= 30))
        if within[chosen].sum() < settings.min_pixels:
            warnings.append(
                f"{m.name}: nobody is seen in this mirror, its side of the body is guessed; "
                "turn the mirror until the camera sees the subject's back in it"
            )
            continue
        _label_kernel(component, _member_table(chosen, len(sizes)), i, labels)
    return Views(labels, seen, points, up, floor_height, floor_noise, axis, tuple(warnings))


def _direct_subject(component, count, seen, points, up, meeting, settings) -> np.ndarray | None:
    """Components seen directly that are the subject: the largest near the rig's meeting point and what touches it."""
    # without a rig that tells where it looks: near the vertical plane straight ahead of the camera
    axis, across = (np.zeros(3), np.diag((1.0, 0, 0))) if meeting is None else (meeting, _across(up))
    total, within, box = _component_kernel(
        component, count, seen, 0, points, axis, across, settings.reach**2, up, (-np.inf, np.inf)
    )
    # a wall or a chair row that only passes through the place is mostly outside of it
    score = np.where(within > 0.6 * total, within, 0)
    if not len(score) or score.max() < settings.min_pixels:
        return None
    best = int(np.argmax(score))
    chosen = [best]
    low, high = box[best, 0] - 0.12, box[best, 1] + 0.12
    near = ((box[:, 0] < high) & (box[:, 1] > low)).all(axis=1)
    near[best] = False
    body = None
    for k in np.flatnonzero(near & (score >= 40)):
        if body is None:
            body = points[component == best]
        piece = points[component == k]
        if ((piece > low) & (piece < high)).all(axis=1).mean() > 0.9:
            gap = np.linalg.norm(
                piece[:: len(piece) // 20 + 1, None] - body[None, :: len(body) // 4000 + 1], axis=2
            ).min()
            if gap < 0.12:
                chosen.append(int(k))
    return np.array(chosen)


def _member_table(chosen: np.ndarray, count: int) -> np.ndarray:
    """Bool (count,): which components are chosen."""
    table = np.zeros(count, np.bool_)
    table[chosen] = True
    return table


@njit(cache=True, nogil=True)
def _label_kernel(component, member, label, labels):
    """Write ``label`` where a pixel's component is a ``member``."""
    for v in range(component.shape[0]):
        for u in range(component.shape[1]):
            if component[v, u] >= 0 and member[component[v, u]]:
                labels[v, u] = label


def _across(up: np.ndarray) -> np.ndarray:
    """Projection (3, 3) onto the horizontal."""
    return np.eye(3) - np.outer(up, up)


@njit(cache=True, nogil=True)
def _squared_distance(points, origin, projection):
    """|projection · (point − origin)|² (N,) of points (N, 3)."""
    out = np.empty(len(points))
    for i in range(len(points)):
        x, y, z = points[i, 0] - origin[0], points[i, 1] - origin[1], points[i, 2] - origin[2]
        total = 0.0
        for r in range(3):
            total += (projection[r, 0] * x + projection[r, 1] * y + projection[r, 2] * z) ** 2
        out[i] = total
    return out


@njit(cache=True, nogil=True)
def _component_kernel(component, count, seen, view, points, origin, projection, reach2, up, heights):
    """Per component of one view's pixels: how many (C,), how many inside, and their box (C, 2, 3).

    Inside: |projection · (point − origin)|² below ``reach2``, height along ``up`` between ``heights``.
    """
    total, within = np.zeros(count, np.int64), np.zeros(count, np.int64)
    box = np.empty((count, 2, 3))
    box[:, 0], box[:, 1] = np.inf, -np.inf
    for v in range(component.shape[0]):
        for u in range(component.shape[1]):
            k = component[v, u]
            if k < 0 or seen[v, u] != view:
                continue
            p = points[v, u]
            total[k] += 1
            for c in range(3):
                box[k, 0, c] = min(box[k, 0, c], p[c])
                box[k, 1, c] = max(box[k, 1, c], p[c])
            height = up[0] * p[0] + up[1] * p[1] + up[2] * p[2]
            if not heights[0] < height < heights[1]:
                continue
            x, y, z = p[0] - origin[0], p[1] - origin[1], p[2] - origin[2]
            squared = 0.0
            for r in range(3):
                squared += (projection[r, 0] * x + projection[r, 1] * y + projection[r, 2] * z) ** 2
            within[k] += squared < reach2
    return total, within, box


def connected_pixels(depth: np.ndarray, seen: np.ndarray, pixel_angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Connected components of each view's pixels, not connected over depth jumps (two-pass union-find).

    Returns
    -------
    component : np.ndarray [shape=(H, W), dtype=int32]
        Component of each pixel, -1 where ``seen`` is negative.
    sizes : np.ndarray [shape=(C,), dtype=int64]
    """
    return _components_kernel(depth, seen, pixel_angle)


@njit(cache=True, nogil=True)
def _between_kernel(points, seen, up, lowest, highest):
    """``seen`` where a pixel's point is higher than ``lowest`` and lower than ``highest`` along ``up``, else -1."""
    out = np.full(seen.shape, -1, np.int8)
    for v in range(seen.shape[0]):
        for u in range(seen.shape[1]):
            if seen[v, u] >= 0:
                p = points[v, u]
                height = p[0] * up[0] + p[1] * up[1] + p[2] * up[2]
                if lowest < height < highest:
                    out[v, u] = seen[v, u]
    return out


@njit(cache=True, nogil=True)
def _components_kernel(depth, seen, pixel_angle):
    height, width = depth.shape
    parent = np.arange(height * width)
    for v in range(height):
        for u in range(width):
            if seen[v, u] < 0:
                continue
            z = depth[v, u]
            # up to two pixels away, so that a line of drop-outs does not part a limb
            for k in range(6):
                dv, du = ((0, -1), (-1, 0), (-1, -1), (-1, 1), (0, -2), (-2, 0))[k]
                y, x = v + dv, u + du
                if y < 0 or x < 0 or x >= width or seen[y, x] != seen[v, u]:
                    continue
                if parent[v * width + u] == parent[y * width + x]:
                    continue
                if abs(depth[y, x] - z) < (8.0 * pixel_angle * max(abs(dv), abs(du)) + 0.012) * min(z, depth[y, x]):
                    a, b = root_of(parent, v * width + u), root_of(parent, y * width + x)
                    if a != b:
                        parent[max(a, b)] = min(a, b)
    component = np.full((height, width), -1, np.int32)
    sizes = np.zeros(height * width, np.int64)
    count = 0
    for v in range(height):
        for u in range(width):
            if seen[v, u] < 0:
                continue
            root = root_of(parent, v * width + u)
            if root == v * width + u:
                component[v, u] = count
                count += 1
            else:
                component[v, u] = component[root // width, root % width]
            sizes[component[v, u]] += 1
    return component, sizes[:count]
