"""Components seen directly that are the subject."""

from __future__ import annotations

import numpy as np
from numba import njit

from .connected_pixels import gap_kernel, member_table
from .floor_plane import horizontal_projection
from .object_pieces import gather_pieces

PIECE = 8  # px: fewer are noise
_BELOW = 0.15  # of the figure: so much of it may be seen below what stands before it
_AXIS_SPREAD, _THING_SPREAD = 0.5, 0.3  # how far off the rig's crossing a person or thing counts less [m]


def find_direct_subject(
    depth, component, count, points, up, meeting, clicked, pixel_angle, settings
) -> np.ndarray | None:
    """Components seen directly that are the subject: the chosen one first, then what belongs to it."""
    spread = _AXIS_SPREAD if clicked is None else _THING_SPREAD
    total, within, score, box = _scores(component, count, points, up, meeting, spread, pixel_angle, settings)
    if clicked is not None and component[clicked] >= 0:
        best = int(component[clicked])
    else:
        whole = np.where(within >= settings.min_pixels, score, 0.0)
        if not count or whole.max() <= 0:
            return None
        best = int(np.argmax(whole))
    member = _joined(np.array([best]), component, count, points, up, total, score, box, pixel_angle)
    below = ~member & (score > 0) & (total < _BELOW * total[member].sum())
    if below.any():
        member |= _below_kernel(component, member, below, depth) >= PIECE // 2
    others = np.flatnonzero(member)
    return np.concatenate(([best], others[others != best]))


def find_object(
    depth, component, count, seen, points, up, meeting, clicked, pixel_angle, settings
) -> np.ndarray | None:
    """Components of all views that are the thing: what is best seen where the rig looks, in the most views."""
    total, within, score, box = _scores(component, count, points, up, meeting, _THING_SPREAD, pixel_angle, settings)
    usable = (score > 0) & (total >= PIECE)
    group = gather_pieces(component, count, points, depth, up, usable)
    views = int(seen.max()) + 1
    standing = component >= 0
    pixels = np.bincount(seen[standing].astype(np.int64) * count + group[component[standing]], minlength=views * count)
    pixels = pixels.reshape(views, count)
    if clicked is not None and component[clicked] >= 0:
        best = int(group[component[clicked]])
    else:
        near = np.bincount(group, score, count)
        # furniture that happens to stand there is hardly seen in every mirror
        near *= (pixels >= 0.3 * settings.min_pixels).sum(axis=0) ** 2
        near[pixels[0] < settings.min_pixels] = 0.0
        if not count or near.max() <= 0:
            return None
        best = int(np.argmax(near))
    mine = group == best
    direct = np.zeros(count, np.bool_)
    direct[np.unique(component[standing & (seen == 0)])] = True
    direct &= mine
    if not direct.any():
        return None
    alone = np.where(seen == 0, component, -1)
    joined = _joined(np.flatnonzero(direct), alone, count, points, up, total, score, box, pixel_angle)
    return np.flatnonzero(mine | joined)


def small_pieces(component, member, points, axis, up, pixel_angle, settings) -> np.ndarray:
    """Bool (C,): what else stands about the subject and is small beside it."""
    total, within, *_ = _pieces_kernel(
        component, len(member), points, axis, horizontal_projection(up), settings.reach**2, 1.0, pixel_angle
    )  # fmt: skip
    return ~member & (total >= PIECE) & (within > 0.6 * total) & (total < _BELOW * total[member].sum())


def _scores(component, count, points, up, meeting, spread, pixel_angle, settings):
    """Per component: pixels, those within reach of where the rig looks, how much of it there is there, and its box."""
    # without a rig that tells where it looks: near the vertical plane straight ahead of the camera
    axis, across = (np.zeros(3), np.diag((1.0, 0, 0))) if meeting is None else (meeting, horizontal_projection(up))
    total, within, weight, box = _pieces_kernel(
        component, count, points, axis, across, settings.reach**2, spread**2, pixel_angle
    )
    # a wall or a chair row that only passes through the place is mostly outside of it
    return total, within, np.where((within > 0.6 * total) & (within >= 20), weight, 0.0), box


def _joined(chosen, component, count, points, up, total, score, box, pixel_angle) -> np.ndarray:
    """Bool (count,): the chosen components and what belongs to them, as near as it is."""
    member = member_table(chosen, count)
    lowest = _lowest_kernel(component, count, points, up)
    floor_reach = lowest[chosen].min() + 0.05
    while True:  # a piece may reach the body through another one: a hand through a forearm
        low, high = box[member, 0].min(axis=0) - 0.12, box[member, 1].max(axis=0) + 0.12
        near = ~member & (score > 0) & (box[:, 0] < high).all(axis=1) & (box[:, 1] > low).all(axis=1)
        if not near.any():
            return member
        gap = gap_kernel(component, member, near, points, total, 0.12 / pixel_angle)
        inside = (box[:, 0] > low).all(axis=1) & (box[:, 1] < high).all(axis=1)
        # a head whose neck was not read stands out of the rest; another person is as large as the rest, and what
        # stands on the floor by itself is furniture unless it is right at the figure: a leg behind a drop-out
        limit = np.where(inside, 0.12, np.where(total < 0.3 * total[member].sum(), 0.08, 0.0))
        joined = near & (gap < np.where(lowest < floor_reach, np.minimum(limit, 0.04), limit))
        if not joined.any():
            return member
        member |= joined


@njit(cache=True, nogil=True)
def _pieces_kernel(component, count, points, origin, projection, reach2, spread2, pixel_angle):
    """Per component: pixels, those within reach, their area weighed by how near they are, box."""
    total, within = np.zeros(count, np.int64), np.zeros(count, np.int64)
    weight = np.zeros(count)
    box = np.empty((count, 2, 3))
    box[:, 0], box[:, 1] = np.inf, -np.inf
    for v in range(component.shape[0]):
        for u in range(component.shape[1]):
            k = component[v, u]
            if k < 0:
                continue
            p = points[v, u]
            total[k] += 1
            for c in range(3):
                box[k, 0, c] = min(box[k, 0, c], p[c])
                box[k, 1, c] = max(box[k, 1, c], p[c])
            x, y, z = p[0] - origin[0], p[1] - origin[1], p[2] - origin[2]
            squared = 0.0
            for r in range(3):
                squared += (projection[r, 0] * x + projection[r, 1] * y + projection[r, 2] * z) ** 2
            if squared < reach2:
                within[k] += 1
                weight[k] += (p[2] * pixel_angle) ** 2 * np.exp(-squared / spread2)
    return total, within, weight, box


@njit(cache=True, nogil=True)
def _below_kernel(component, member, small, depth):
    """In how many columns (C,) a ``small`` component goes on below a member, but for what stands before both."""
    height, width = component.shape
    columns = np.zeros(len(member), np.int64)
    for v in range(1, height):
        for u in range(width):
            k = component[v, u]
            if k < 0 or not small[k] or component[v - 1, u] == k:
                continue
            hidden = unread = 0
            y = v - 1
            while y >= 0 and unread <= 4:
                j, z = component[y, u], depth[y, u]
                if j >= 0 and member[j]:
                    columns[k] += hidden > 0 and abs(z - depth[v, u]) < 0.3
                    break
                if z == 0:
                    unread += 1
                elif z < depth[v, u] - 0.05:
                    hidden, unread = hidden + 1, 0
                else:
                    break
                y -= 1
    return columns


@njit(cache=True, nogil=True)
def _lowest_kernel(component, count, points, up):
    """Lowest height (C,) of each component along ``up``."""
    low = np.full(count, np.inf)
    for v in range(component.shape[0]):
        for u in range(component.shape[1]):
            k = component[v, u]
            if k >= 0:
                p = points[v, u]
                low[k] = min(low[k], p[0] * up[0] + p[1] * up[1] + p[2] * up[2])
    return low
