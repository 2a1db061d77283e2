"""Mirrors without a frame that stand clear of any wall: planes from the figure that is seen twice.

Nothing of such a mirror is at its plane, so no depth reading shows where it is. What it shows does: somebody seen
directly and, farther off and the other way round, in the glass. The plane lies half way between the two; it is rotated
and shifted until the mirrored figure's skin coincides with that seen directly, each within the other's silhouette. Only
then is the glass looked for: on that plane the depth jumps along straight, upright lines on both sides of the figure. A
door with somebody behind it fails, since the two are not one body and its reflection.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ..camera import RgbdImage, project
from ..mirrors import Mirror
from ..mirrors.frame_fit import fit_frame
from ..mirrors.glass_extent import at_border, with_outline
from ..mirrors.glass_kernels import glass_of, place_on_plane, share_at_plane
from ..mirrors.mirror import behind_glass, expected_error, person_before, reflection_shift
from ..mirrors.wall_behind_frame import on_wall
from ..numeric.kernels import njit
from ..numeric.point_products import dot, lay_grid
from ..views.floor_and_vertical import find_floor
from .edge_segments import DetectionSettings
from .mirror_verification import count_evidence, floor_drop, frame_edge_share, missing_reflection
from .mirrored_person import Figure, figure_surfaces, find_figures, fit_mirror_to_skin, is_one_body, search_mirror_plane
from .rectangle_hypotheses import Hypothesis

_UP = np.array((0.0, -1.0, 0.0))
_IMAGE_FARTHER = 0.7  # an image is so much farther off than the figure [m]
_WARN_ERROR = 0.006  # a mirror expected to misplace a person by more is warned of [m]
_PAST_GLASS = 0.03  # an image does not reach farther beyond its glass [m]
_PLANE_CELL = 0.012  # of the mirror's plane along a, and along b [m]
_SEARCHED_BESIDE = 1.5  # how far from the image glass may reach [m]
_POST, _POST_DEPTH = (0.10, 0.13), 0.4  # beside the glass, and so near its plane, nothing stands [m]
_JUMP_SHARE = 0.5  # of a side, where it can be seen, the depth must jump
_ASKED_HEIGHT = 0.55  # of the image's height, from its top, is asked: floor goes on through glass without a jump


def find_frameless(image: RgbdImage, known: Iterable[Mirror] = (), most: int = 2) -> list[tuple[Mirror, bool]]:
    """Mirrors that only the figure in them reveals, besides those ``known``.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, flying pixels removed; z [m], 0 = no reading.
    most : int
        At most so many.

    Returns
    -------
    list of (Mirror, bool)
        ``source`` "found", not ``refined``; the covariance says how certain the plane is. True: something stands beside
        the glass near its plane. Without a frame there nothing would, so it is its frame, or the post of a door.

    Notes
    -----
    O(H W).
    """
    depth, intrinsics = image.depth, image.intrinsics
    stride = max(1, round(np.sqrt(depth.size / 80000.0)))
    thin = np.ascontiguousarray(depth[::stride, ::stride])
    cloud = lay_grid(thin, *(x / stride for x in intrinsics.packed))
    points = cloud[thin > 0]
    ground = find_floor(points, _UP, 20.0) if len(points) else None
    if ground is None:
        return []
    up, floor, _ = ground
    known = list(known)
    objects, figures = find_figures(thin, cloud, up, floor, known)
    found: list[tuple[Mirror, bool]] = []
    pairs = [
        (one, reflection) for one in figures for reflection in figures
        if reflection.middle[2] > one.middle[2] + 0.5 * _IMAGE_FARTHER
        and np.linalg.norm(reflection.middle) > np.linalg.norm(one.middle) + _IMAGE_FARTHER
        and (one.cut or reflection.cut or abs(one.top - reflection.top) < 0.35)
    ]  # fmt: skip
    if pairs:
        objects = _widened_kernel(depth, thin, objects, stride)
    pairs.sort(key=lambda pair: -min(pair[0].count, pair[1].count))
    for one, reflection in pairs[:12]:
        if len(found) == most or behind_glass(reflection.middle[None], [mirror for mirror, _ in found])[0]:
            continue
        shown = figure_surfaces(image, one, reflection, objects)
        start = search_mirror_plane(image, one, reflection, shown, objects, up)
        mirror = start and fit_mirror_to_skin(start, shown, intrinsics)
        if mirror is None or not is_one_body(image, one, reflection, objects, mirror):
            continue
        glass = with_glass(image, mirror, reflection, objects, np.append(up, floor))
        if glass is not None:
            found.append(glass)
    return found


def frameless_notes(mirrors: list[Mirror]) -> tuple[str, ...]:
    """What the user should know of mirrors that were placed without a frame, and are uncertain."""
    bare = tuple(
        f"{m.name}: no frame is visible; its plane was computed from the person it shows, and its reflection may be "
        f"misplaced by {1000.0 * error:.0f} mm; strips of paper or tape, 3 cm wide, along its edges would reduce that"
        for m in mirrors
        if m.source == "found" and not m.refined and (error := expected_error(m)) > _WARN_ERROR
    )
    return bare + tuple(
        f"{m.name}: hangs on a wall, and no frame projects in front of the wall: the wall's plane was taken for the "
        "mirror's, and its reflection is misplaced by twice the distance from the wall to the glass; strips of paper "
        "or tape, 3 cm wide, on the edges of the glass would show where the glass is"
        for m in mirrors
        if m.refined and m.source != "rig file" and on_wall(m)
    )


@njit(cache=True, nogil=True)
def _widened_kernel(depth, thin, objects, stride):
    """The picture of objects (H, W) int32 for all pixels: a pixel is part of the object beside it in like depth."""
    height, width = depth.shape
    out = np.zeros((height, width), np.int32)
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            if z == 0:
                continue
            for k in range(4):
                i, j = min(v // stride + k // 2, objects.shape[0] - 1), min(u // stride + k % 2, objects.shape[1] - 1)
                if objects[i, j] and abs(thin[i, j] - z) < 0.02 + 0.005 * z * z:
                    out[v, u] = objects[i, j]
                    break
    return out


def overlaps(mirror: Mirror, others: Iterable[Mirror]) -> bool:
    """Whether it shares more than a quarter of the smaller one's place in the picture with one of the others."""
    mine = mirror.outline
    for other in others:
        its = other.outline
        assert mine is not None and its is not None
        size = np.minimum(mine.max(axis=0), its.max(axis=0)) - np.maximum(mine.min(axis=0), its.min(axis=0))
        smaller = min(np.prod(np.ptp(outline, axis=0)) for outline in (mine, its))
        if size.min() > 0 and np.prod(size) > 0.25 * smaller:
            return True
    return False


def find_verified_frameless(image: RgbdImage, known: list[Mirror], settings: DetectionSettings) -> list[Mirror]:
    """Mirrors that only the figure in them reveals, as far as the rest of what they show may be a reflection too.

    Where something stands beside the glass it must be a frame in its plane, to which the plane is then fitted.
    """
    intrinsics = image.intrinsics
    good = []
    for mirror, beside in find_frameless(image, known, settings.max_mirrors - len(known)):
        if beside:
            framed, person = fit_frame(image, mirror), person_before(mirror)
            if framed is None or reflection_shift(person, framed, mirror) > 3.0 * expected_error(mirror):
                continue
            mirror = with_outline(framed, intrinsics)
        assert mirror.rectangle is not None  # that of its glass
        guess = Hypothesis(mirror.point, mirror.basis, mirror.rectangle, {})
        if beside and frame_edge_share(image, guess, 0.2, known) < settings.min_rim:
            continue
        evidence = count_evidence(image, guess, floor_drop(image, mirror.basis))
        bad = evidence.violated > settings.max_violation * evidence.judged
        if evidence.shown >= 30 and not bad and not missing_reflection(image, mirror):
            good.append(mirror)
    return good


# --- the glass, by the depth jumps along its sides -----------------------------------------------------------------


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
