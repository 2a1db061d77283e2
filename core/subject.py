"""Whose pixels these are: the person or thing to scan, told from floor, furniture, walls and other people."""

from __future__ import annotations

import numpy as np
from numba import njit

from .camera import Intrinsics, unproject
from .errors import ReconstructionError
from .ground import find_floor, vertical
from .linear import dot
from .mesh import root_of
from .mirror import Mirror, reflect
from .views import Views, ViewSettings, sort_rays

DEFAULTS = ViewSettings()


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
    settings: ViewSettings = DEFAULTS,
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
    body = points[component == best]
    low, high = box[best, 0].copy(), box[best, 1].copy()
    waiting = [int(k) for k in np.argsort(-score, kind="stable") if k != best and score[k] >= 40]
    joined = True
    while joined:  # a piece may reach the body through another one: a hand through a forearm
        joined = False
        for k in list(waiting):
            if not ((box[k, 0] < high + 0.12) & (box[k, 1] > low - 0.12)).all():
                continue
            piece = points[component == k]
            gap = np.linalg.norm(
                piece[:: len(piece) // 20 + 1, None] - body[None, :: len(body) // 4000 + 1], axis=2
            ).min()
            beside = ((piece > low - 0.12) & (piece < high + 0.12)).all(axis=1).mean() > 0.9
            # a head whose neck was not read stands out of the rest; another person is as large as the rest
            if gap < (0.12 if beside else 0.08) and (beside or len(piece) < 0.3 * len(body)):
                chosen.append(k)
                waiting.remove(k)
                body = np.concatenate((body, piece))
                low, high = np.minimum(low, box[k, 0]), np.maximum(high, box[k, 1])
                joined = True
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
