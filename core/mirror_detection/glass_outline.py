"""The outline of a mirror without a frame, by the depth jumps along its sides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..camera import RgbdImage, project
from ..mirrors import Mirror
from ..mirrors.glass_extent import at_border
from ..mirrors.glass_kernels import glass_of, place_on_plane, share_at_plane
from ..numeric.kernels import njit
from ..numeric.point_products import dot
from .mirrored_person import Figure

_PAST_GLASS = 0.03  # an image does not reach farther beyond its glass [m]


_PLANE_CELL = 0.012  # of the mirror's plane along a, and along b [m]
_SEARCHED_BESIDE = 1.5  # how far from the image glass may reach [m]
_POST, _POST_DEPTH = (0.10, 0.13), 0.4  # beside the glass, and so near its plane, nothing stands [m]
_JUMP_SHARE = 0.5  # of a side, where it can be seen, the depth must jump
_ASKED_HEIGHT = 0.55  # of the image's height, from its top, is asked: floor goes on through glass without a jump


def with_glass(
    image: RgbdImage, mirror: Mirror, reflection: Figure, objects: np.ndarray, floor: np.ndarray
) -> tuple[Mirror, bool] | None:
    """The mirror with the rectangle of its glass, and whether something stands beside it; None without straight sides.

    The glass is the rectangle about the person's image along whose sides depth jumps. ``floor`` (4,): up and the
    floor's height.
    """
    depth, intrinsics = image.depth, image.intrinsics
    up, height = floor[:3], floor[3]
    a, b, n = mirror.basis.T
    d = float(n @ mirror.point)
    at = reflection.points * (d / dot(reflection.points, n))[:, None] - mirror.point
    left, right = np.quantile(dot(at, a), (0.01, 0.99))
    top, feet = np.quantile(dot(at, b), (0.005, 0.995))
    bottom = (height - up @ mirror.point) / (up @ b)  # where the plane meets the floor
    if not top < feet < bottom + 0.1:
        return None
    corner = np.array((left - _SEARCHED_BESIDE, top - _SEARCHED_BESIDE))
    size = np.ceil((np.array((right + _SEARCHED_BESIDE, bottom)) - corner) / _PLANE_CELL).astype(np.int64)
    upright, lying, seen = _jumps_kernel(
        depth, _about(objects == reflection.id, 4), intrinsics.packed, glass_of([mirror]), corner, size, _PLANE_CELL
    )
    rows = slice(
        int((top - corner[1]) / _PLANE_CELL), int((top + _ASKED_HEIGHT * (feet - top) - corner[1]) / _PLANE_CELL) + 1
    )
    share, visible = _covered(upright[rows], seen[rows])
    begin = ((np.array((left + _PAST_GLASS, right - _PAST_GLASS)) - corner[0]) / _PLANE_CELL).astype(int)
    sides = [_first(share[: begin[0]][::-1], visible[: begin[0]][::-1]), _first(share[begin[1] :], visible[begin[1] :])]
    rectangle = np.array(((left, right), (top, bottom)))
    met = 0
    for end, (state, place) in enumerate(sides):
        if state == _NO_EDGE:
            return None
        if state == _EDGE_FOUND:
            met += 1
            rectangle[0, end] = corner[0] + (begin[end] + (-place if end == 0 else place + 1)) * _PLANE_CELL
    columns = slice(*(np.clip((rectangle[0] - corner[0]) / _PLANE_CELL, 0, size[0]).astype(int) + (2, -2)))
    share, visible = _covered(lying[:, columns].T, seen[:, columns].T)
    state, place = _first(share[: rows.start][::-1], visible[: rows.start][::-1])
    if state == _EDGE_FOUND:
        met += 1
        rectangle[1, 0] = corner[1] + (rows.start - place) * _PLANE_CELL
    elif met == 2:  # as high as the sides go
        both = upright[:, columns.start - 4 : columns.start + 1].any(axis=1) | upright[
            :, columns.stop : columns.stop + 5].any(axis=1)  # fmt: skip
        rectangle[1, 0] = corner[1] + np.flatnonzero(both)[0] * _PLANE_CELL if both.any() else top
    if met < 2:
        return None
    beside = _stands_beside(image, mirror, rectangle, [side[0] == _EDGE_FOUND for side in sides])
    open_ends = np.array(((sides[0][0] != _EDGE_FOUND, sides[1][0] != _EDGE_FOUND), (state != _EDGE_FOUND, True)))
    return at_border(replace(mirror, rectangle=rectangle), intrinsics, open_ends), beside


_NO_EDGE, _EDGE_FOUND, _EDGE_HIDDEN = 0, 1, 2


def _stands_beside(image: RgbdImage, mirror: Mirror, rectangle: np.ndarray, met: list[bool]) -> bool:
    """Beside the glass, where only the room behind should be seen, something is near the plane: posts of a door."""
    depth, intrinsics = image.depth, image.intrinsics
    down = np.linspace(rectangle[1, 0], 0.5 * rectangle[1].sum(), 40)
    for end in np.flatnonzero(met):
        near, visible = 0, 0
        for outward in _POST:
            across = np.full(len(down), rectangle[0, end] + (2 * end - 1) * outward)
            points = mirror.point + np.column_stack((across, down)) @ mirror.basis[:, :2].T
            u, v = np.rint(project(points, intrinsics)).T
            inside = (u >= 0) & (v >= 0) & (u < intrinsics.width) & (v < intrinsics.height)
            read = depth[v[inside].astype(int), u[inside].astype(int)]
            apart = read - points[inside, 2]
            near += int(((read > 0) & (np.abs(apart) < _POST_DEPTH)).sum())
            visible += int((apart > -_POST_DEPTH).sum()) + int((read == 0).sum())
        if near > 0.3 * max(visible, 1):
            return True
    return False


def _about(mask: np.ndarray, reach: int) -> np.ndarray:
    """The mask and what is within ``reach`` pixels of it, along rows and columns."""
    for axis in (0, 1):
        mask = np.any([np.roll(mask, k, axis) for k in range(-reach, reach + 1)], axis=0)
    return mask


def _covered(jumps: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of each line along axis 0: the share of its visible part where depth jumps, and how much is visible.

    A jump may be up to a cell beside the line.
    """
    near = jumps.copy()
    near[:, 1:] |= jumps[:, :-1]
    near[:, :-1] |= jumps[:, 1:]
    visible = seen.sum(axis=0)
    return (near & seen).sum(axis=0) / np.maximum(visible, 1), visible / max(len(seen), 1)


def _first(share: np.ndarray, visible: np.ndarray) -> tuple[int, int]:
    """The first line outwards that is a side, at its peak; or, when what is seen ends before, that it is hidden."""
    clear = visible > 0.4
    strong = np.flatnonzero((share > _JUMP_SHARE) & clear)
    if len(strong):
        first = int(strong[0])
        return _EDGE_FOUND, first + int(np.argmax(share[first : first + 4] * clear[first : first + 4]))
    return (_NO_EDGE if clear.mean() > 0.9 else _EDGE_HIDDEN), 0


@njit(cache=True, nogil=True)
def _jumps_kernel(depth, image, intrinsics, glass, corner, size, cell):
    """Cells (b, a) of the mirror's plane where depth jumps sideways, where it jumps up or down, and which are visible.

    Jumps count beyond the plane and off the person's image itself; a cell is visible when nothing in front of the plane
    hides it.
    """
    height, width = depth.shape
    upright = np.zeros((size[1], size[0]), np.bool_)
    lying = np.zeros((size[1], size[0]), np.bool_)
    seen = np.zeros((size[1], size[0]), np.bool_)
    for v in range(height - 1):
        y = (v - intrinsics[3]) / intrinsics[1]
        for u in range(width - 1):
            x = (u - intrinsics[2]) / intrinsics[0]
            z = share_at_plane(glass, 0, x, y, 1.0)
            if z == np.inf:
                continue
            a, b = place_on_plane(glass, 0, z * x, z * y, z)
            i, j = int((b - corner[1]) / cell), int((a - corner[0]) / cell)
            if i < 0 or j < 0 or i >= size[1] or j >= size[0]:
                continue
            here = depth[v, u]
            if here > 0 and here < 0.98 * z - 0.02:
                continue
            # a pixel may be wider than a cell
            reach = int(0.5 * z / intrinsics[0] / cell) + 1
            for k in range(max(i - reach, 0), min(i + reach + 1, size[1])):
                for m in range(max(j - reach, 0), min(j + reach + 1, size[0])):
                    seen[k, m] = True
            if image[v, u]:
                continue
            for way in range(2):
                y1, x1 = v + way, u + 1 - way
                there = depth[y1, x1]
                if there > 0 and there < 0.98 * z - 0.02:
                    continue
                jump = (here == 0) != (there == 0) or (here > 0 and abs(here - there) > 0.05 * min(here, there))
                if not jump:
                    continue
                if way == 0:
                    for k in range(max(i - reach, 0), min(i + reach + 1, size[1])):
                        upright[k, j] = True
                else:
                    for m in range(max(j - reach, 0), min(j + reach + 1, size[0])):
                        lying[i, m] = True
    return upright, lying, seen
