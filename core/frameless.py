"""Mirrors without a frame that stand clear of any wall: planes from the figure that is seen twice.

Nothing of such a mirror is at its plane, so no depth reading tells where it is. What it shows does: somebody seen
directly and, farther off and the other way round, in the glass. The plane lies half way between the two, and turning
and shifting it until the mirrored figure's skin meets that seen directly, each within the other's silhouette, fixes it.
Only then is the glass looked for: on that plane the depth jumps along straight, upright lines on both sides of the
figure. A door with somebody behind fails, since the two are not one body turned about.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from .camera import Intrinsics, project
from .mirrors import Mirror
from .mirrors.glass_extent import at_border
from .mirrors.mirror import (
    behind_glass,
    expected_error,
    moved,
    oriented,
    person_before,
    reflection_matrix,
    reflection_moves,
    reflection_shift,
)
from .mirrors.wall_behind_frame import on_wall
from .numeric.point_products import dot, lay_grid
from .views.floor_and_vertical import find_floor
from .views.view_correspondences import Surfaces, meetings, noise_of, surfaces

_UP = np.array((0.0, -1.0, 0.0))
_CLEAR = 0.3  # above the floor things begin [m]: a mirror that leans lifts the floor it shows
_TALL = 2.4  # what is higher above the floor is no figure's [m]
_CELLS = 150  # a figure has at least so many readings of the thinned picture
_WIDE, _HIGH, _FLAT = 2.2, 0.4, 0.015  # no figure is wider, less high, or flatter (standard deviation) [m]
_ENOUGH = 1200  # of a figure's readings say where it is
_FIGURES = 8  # so many are looked at, the largest
_BEHIND = 0.7  # an image is so much farther off than the figure [m]
_SKIN = 0.08  # how far before its middle a figure is seen [m]
_LEAN = np.radians(6.0)  # mirrors do not lean more
_PIECES = 8000  # of a figure's surface
_FEW_PAIRS = 42
# cosine to the line of sight under which skin is not judged, in turn when that leaves too few pairs, and what then may
# be wrong with the shift [m]: the more grazing, the flatter cameras see a limb
_GRAZING = ((0.35, 0.003), (0.25, 0.007), (0.15, 0.012))
_THROUGH, _TOLD, _MET_SHARE = (0.03, 0.05), 0.25, 0.6  # shares of a figure and of its image, see _one_body
_OBLIQUE = 0.03  # of a rounded body a tenth is seen obliquely; patterns that meet over a mirror put it out
_RAGGED = 0.010  # root mean square of the gaps between skin seen both ways [m]
_OUTSIDE = 0.03  # an image does not reach farther beyond its glass [m]
_SURE = 0.006  # a mirror expected to misplace a person by more is told of [m]
_USELESS = 0.03  # a mirror expected to misplace a person by more tells nothing [m]
_HELD_OUT = 0.05  # how far apart the two halves of the readings may place a person [m]
_SYSTEMATIC = 0.002  # slopes that no residual tells [rad]


@dataclass(frozen=True)
class Figure:
    """A thing that stands out: ``id`` in the picture of things, ``count`` of its readings, ``points`` (N, 3), some of
    them [m], ``middle`` (3,), and ``top`` along the vertical [m]; ``cut``: the picture's border cuts its top off."""

    id: int
    count: int
    points: np.ndarray
    middle: np.ndarray
    top: float
    cut: bool


def find_frameless(
    depth: np.ndarray, intrinsics: Intrinsics, known: Iterable[Mirror] = (), most: int = 2
) -> list[tuple[Mirror, bool]]:
    """Mirrors that nothing but the figure in them tells of, besides those ``known``.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        Fused depth, flying pixels removed; z [m], 0 = no reading.
    most : int
        At most so many.

    Returns
    -------
    list of (Mirror, bool)
        ``source`` "found", not ``refined``; the covariance says how sure. True: something stands beside the glass near
        its plane. Without a frame there nothing would, so it is its frame, or the post of a door.

    Notes
    -----
    O(H W).
    """
    stride = max(1, round(np.sqrt(depth.size / 80000.0)))
    thin = np.ascontiguousarray(depth[::stride, ::stride])
    cloud = lay_grid(thin, *(x / stride for x in intrinsics.lens))
    points = cloud[thin > 0]
    ground = find_floor(points, _UP, 20.0) if len(points) else None
    if ground is None:
        return []
    up, floor, _ = ground
    known = list(known)
    things, figures = _figures(thin, cloud, up, floor, known)
    found, beside = [], []
    pairs = [
        (one, image) for one in figures for image in figures
        if image.middle[2] > one.middle[2] + 0.5 * _BEHIND
        and np.linalg.norm(image.middle) > np.linalg.norm(one.middle) + _BEHIND
        and (one.cut or image.cut or abs(one.top - image.top) < 0.35)
    ]  # fmt: skip
    if pairs:
        things = _widened_kernel(depth, thin, things, stride)
    pairs.sort(key=lambda pair: -min(pair[0].count, pair[1].count))
    for one, image in pairs[:12]:
        if len(found) == most or behind_glass(image.middle[None], found)[0]:
            continue
        shown = _surfaces(one, image, things, depth, intrinsics)
        start = _searched(one, image, shown, things, depth, intrinsics, up)
        mirror = start and _fitted(start, shown, intrinsics)
        if mirror is None or not _one_body(one, image, things, depth, intrinsics, mirror):
            continue
        mirror = _with_glass(mirror, image, things, depth, intrinsics, np.append(up, floor))
        if mirror is not None:
            found.append(mirror[0])
            beside.append(mirror[1])
    return list(zip(found, beside, strict=True))


def frameless_notes(mirrors: list[Mirror]) -> tuple[str, ...]:
    """What the user should know of mirrors that were placed without a frame, and are not sure."""
    bare = tuple(
        f"{m.name}: nothing is seen of its frame; where it stands was told from the figure that it shows, which may be "
        f"misplaced by {1000.0 * error:.0f} mm; strips of paper or tape, 3 cm wide, along its edges would make that "
        "surer"
        for m in mirrors
        if m.source == "found" and not m.refined and (error := expected_error(m)) > _SURE
    )
    return bare + tuple(
        f"{m.name}: hangs on a wall, and no frame stands out before it: its plane was taken to be the wall's, and what "
        "it shows is misplaced by twice as much as its glass stands before the wall; strips of paper or tape, 3 cm "
        "wide, on the edges of the glass would tell where that is"
        for m in mirrors
        if m.refined and m.source != "rig file" and on_wall(m)
    )


def _figures(
    depth: np.ndarray, cloud: np.ndarray, up: np.ndarray, floor: float, known: list[Mirror]
) -> tuple[np.ndarray, list[Figure]]:
    """Picture of things (H, W), 0 = none, and those of them that may be somebody, the largest first; not what is seen
    in mirrors that are ``known``."""
    height = dot(cloud, up) - floor
    things, count = _things_kernel(depth, (height > _CLEAR) & (height < _TALL))
    sizes = np.bincount(things.ravel(), minlength=count + 1)
    sizes[0] = 0
    across = np.cross(up, (0.0, 0.0, 1.0))
    across /= np.linalg.norm(across)
    ahead = np.cross(across, up)
    out = []
    for k in np.argsort(-sizes, kind="stable")[:40]:
        if sizes[k] < _CELLS or len(out) == _FIGURES:
            break
        rows, columns = np.nonzero(things == k)
        some = slice(None, None, len(rows) // _ENOUGH + 1)
        points = cloud[rows[some], columns[some]]
        middle = np.median(points, axis=0)
        if behind_glass(middle[None], known)[0]:
            continue
        place = np.sort(points @ np.column_stack((across, ahead, up)), axis=0)
        low, high, top = (place[int(share * (len(place) - 1))] for share in (0.02, 0.98, 0.995))
        span = high - low
        if span[:2].max() > _WIDE or span[2] < _HIGH or top[2] > floor + _TALL - 0.1:
            continue
        if _thickness(points) < _FLAT:
            continue
        out.append(Figure(int(k), int(sizes[k]), points, middle, float(top[2]), rows.min() < 3))
    return things, out


def _thickness(points: np.ndarray) -> float:
    """Standard deviation of points (N, 3) from the plane that most of them lie about [m]."""
    for _ in range(4):
        offset = points - points.mean(axis=0)
        spread, axes = np.linalg.eigh(offset.T @ offset / len(points))
        away = np.abs(offset @ axes[:, 0])
        points = points[away <= max(3.0 * np.median(away), 0.01)]
    return float(np.sqrt(max(spread[0], 0.0)))


@njit(cache=True, nogil=True)
def _things_kernel(depth, stands):
    """Connected things (H, W) int32, numbered from 1, and how many."""
    height, width = depth.shape
    label = np.zeros((height, width), np.int32)
    parent = np.zeros(height * width + 1, np.int32)
    count = 0
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            if z == 0 or not stands[v, u]:
                continue
            mine = 0
            for dv, du in ((0, -1), (0, -2), (-1, 0), (-2, 0), (-1, -1), (-1, 1)):
                y, x = v + dv, u + du
                if y < 0 or x < 0 or x >= width or label[y, x] == 0:
                    continue
                if abs(depth[y, x] - z) > 0.03 + 0.006 * z * z:
                    continue
                other = label[y, x]
                while parent[other] != other:
                    other = parent[other]
                if mine == 0:
                    mine = other
                elif other != mine:
                    low, high = min(mine, other), max(mine, other)
                    parent[high] = low
                    mine = low
            if mine == 0:
                count += 1
                parent[count] = mine = count
            label[v, u] = mine
    for v in range(height):
        for u in range(width):
            k = label[v, u]
            if k:
                while parent[k] != k:
                    k = parent[k]
                label[v, u] = k
    return label, count


@njit(cache=True, nogil=True)
def _widened_kernel(depth, thin, things, stride):
    """The picture of things (H, W) int32 for all pixels: a pixel is part of the thing beside it in like depth."""
    height, width = depth.shape
    out = np.zeros((height, width), np.int32)
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            if z == 0:
                continue
            for k in range(4):
                i, j = min(v // stride + k // 2, things.shape[0] - 1), min(u // stride + k % 2, things.shape[1] - 1)
                if things[i, j] and abs(thin[i, j] - z) < 0.02 + 0.005 * z * z:
                    out[v, u] = things[i, j]
                    break
    return out


def _surfaces(one: Figure, image: Figure, things: np.ndarray, depth: np.ndarray, lens: Intrinsics) -> list[Surfaces]:
    """What is seen of a figure and of its image as pieces of surface."""
    views = np.full(depth.shape, -1, np.int8)
    views[things == one.id] = 0
    views[things == image.id] = 1
    sigma = noise_of(depth, views)
    return [surfaces(depth, views, view, lens, sigma, _PIECES) for view in (0, 1)]


def _searched(
    one: Figure,
    image: Figure,
    shown: list[Surfaces],
    things: np.ndarray,
    depth: np.ndarray,
    lens: Intrinsics,
    up: np.ndarray,
) -> Mirror | None:
    """The plane between a figure and its image, turned and shifted to where each fits the other's silhouette best."""
    here, there = (f.middle + _SKIN * f.middle / np.linalg.norm(f.middle) for f in (one, image))
    way = here - there
    way = way - (way @ up) * up
    if not (one.cut or image.cut):  # a mirror that leans shows the head higher or lower
        lean = (one.top - image.top) / np.linalg.norm(way)
        way = way + np.clip(lean, -np.tan(_LEAN), np.tan(_LEAN)) * np.linalg.norm(way) * up
    middle = 0.5 * (here + there)
    normal, basis = oriented(way, middle, -up)
    if -normal @ middle < 0.1 * np.linalg.norm(middle):
        return None
    mirror = Mirror("", middle, normal, basis, source="found")
    best = np.zeros(3)
    # slopes along a and b, and shift; the first turns about the vertical
    for reach, steps, slack in (
        ((0.12, 0.0, 0.15), (13, 1, 11), 0.04),
        ((0.02, 0.03, 0.03), (5, 5, 7), 0.025),
        ((0.006, 0.010, 0.010), (5, 5, 5), 0.015),
    ):
        axes = [c + np.linspace(-r, r, n) for c, r, n in zip(best, reach, steps, strict=True)]
        tries = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        flips = _flips(mirror, tries)
        scores = np.zeros(len(tries))
        for of, by in ((0, 1), (1, 0)):
            s, t = shown[of], shown[by]
            thin = slice(None, None, len(s.points) // _ASKED + 1)
            scores += _score_kernel(
                s.points[thin], s.normals[thin], flips, lens.lens, things, depth, (one, image)[by].id, by == 0,
                t.grid, t.stride, t.points, t.normals, slack,
            )  # fmt: skip
        best = tries[np.argmax(scores)]
    return moved(mirror, best) if scores.max() > 0.0 else None


def _flips(mirror: Mirror, steps: np.ndarray) -> np.ndarray:
    """:func:`.mirror.reflection_matrix` (K, 4, 4) of the mirror :func:`.mirror.moved` by each of ``steps`` (K, 3)."""
    a, b, n = mirror.basis.T
    normals = n - steps[:, :1] * a - steps[:, 1:2] * b
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    out = np.tile(np.eye(4), (len(steps), 1, 1))
    out[:, :3, :3] -= 2.0 * normals[:, :, None] * normals[:, None, :]
    out[:, :3, 3] = 2.0 * ((mirror.point + steps[:, 2:] * n) * normals).sum(axis=1)[:, None] * normals
    return out


_ASKED = 300  # pieces of a figure's surface that are laid on the other
# against 1 for a piece that may be where it is laid: for one that may not, and besides for one that meets its like
_LOOKED_THROUGH, _ALIKE = -3.0, 2.0


@njit(cache=True, nogil=True)
def _score_kernel(
    points, normals, flips, lens, things, depth, other, whole, grid, stride, there, there_normals, slack
):  # fmt: skip
    """How well the pieces of a figure, flipped into the other view, fit what that sees; for every plane (K, 4, 4)."""
    scores = np.zeros(len(flips))
    q, m = np.empty(3), np.empty(3)
    for k in range(len(flips)):
        total, told = 0.0, 0
        for i in range(len(points)):
            kind, u, v = _fit_of(points[i], flips[k], lens, things, depth, other, whole, slack)
            if kind == _UNTOLD:
                continue
            told += 1
            total += _LOOKED_THROUGH if kind == _LOOKED else 1.0
            row, column = (v + stride // 2) // stride, (u + stride // 2) // stride
            if kind != _ON or row >= grid.shape[0] or column >= grid.shape[1] or grid[row, column] < 0:
                continue
            j = grid[row, column]
            alike, gap = 0.0, 0.0
            for r in range(3):
                q[r], m[r] = flips[k, r, 3], 0.0
                for c in range(3):
                    q[r] += flips[k, r, c] * points[i, c]
                    m[r] += flips[k, r, c] * normals[i, c]
                alike += m[r] * there_normals[j, r]
                gap += there_normals[j, r] * (there[j, r] - q[r])
            if alike > 0.7 and abs(gap) < slack:
                total += _ALIKE
        scores[k] = total / len(points) if told > 0.3 * len(points) else -3.0
    return scores


_UNTOLD, _ON, _HIDDEN_BEHIND, _LOOKED = 0, 1, 2, 3
_RIM = 2  # px by which silhouettes are ragged


@njit(cache=True, nogil=True)
def _fit_of(p, flip, lens, things, depth, other, whole, slack):
    """What becomes of a point flipped into the other view: nothing is said, it is on the other figure, or hidden behind
    it, or the camera looks through it; and its pixel. ``whole``: beside the other figure the room is seen, not what is
    beside the glass."""
    z = flip[2, 3]
    x = flip[0, 3]
    y = flip[1, 3]
    for c in range(3):
        x += flip[0, c] * p[c]
        y += flip[1, c] * p[c]
        z += flip[2, c] * p[c]
    if z < 0.3:
        return _UNTOLD, 0, 0
    u, v = int(np.rint(x / z * lens[0] + lens[2])), int(np.rint(y / z * lens[1] + lens[3]))
    if u < 0 or v < 0 or v >= depth.shape[0] or u >= depth.shape[1]:
        return _UNTOLD, 0, 0
    seen = depth[v, u]
    slack += 0.0015 * max(z, p[2]) ** 2
    if seen == 0:
        return _UNTOLD, u, v
    if things[v, u] != other:
        if seen < z + slack or not (whole or seen < z + 3.0):
            return _UNTOLD, u, v
        # silhouettes are ragged: is the other figure beside?
        beside = False
        for dv, du in ((0, -_RIM), (0, _RIM), (-_RIM, 0), (_RIM, 0)):
            i, j = min(max(v + dv, 0), depth.shape[0] - 1), min(max(u + du, 0), depth.shape[1] - 1)
            if things[i, j] == other:
                v, u, seen, beside = i, j, depth[i, j], True
                break
        if not beside:
            return _LOOKED, u, v
    if z < seen - slack or z > seen + 0.5:
        return _LOOKED, u, v
    return (_ON if z < seen + 2.0 * slack else _HIDDEN_BEHIND), u, v


def _one_body(
    one: Figure, image: Figure, things: np.ndarray, depth: np.ndarray, lens: Intrinsics, mirror: Mirror
) -> bool:
    """Flipped over the mirror the image lies within the figure and the other way round: hardly a reading is where the
    other view looks through, enough are where it says anything, and of the image most lie on the figure or behind."""
    flip = reflection_matrix(mirror)
    for points, other, whole in ((one.points, image.id, False), (image.points, one.id, True)):
        kinds = _kinds_kernel(np.ascontiguousarray(points), flip, lens.lens, things, depth, other, whole, 0.03)
        counts = np.bincount(kinds, minlength=4)
        told = len(points) - counts[_UNTOLD]
        if told < _TOLD * len(points) or counts[_LOOKED] > _THROUGH[whole] * told:
            return False
        if whole and counts[_ON] + counts[_HIDDEN_BEHIND] < _MET_SHARE * len(points):
            return False
    return True


@njit(cache=True, nogil=True)
def _kinds_kernel(points, flip, lens, things, depth, other, whole, slack):
    out = np.empty(len(points), np.int64)
    for i in range(len(points)):
        out[i] = _fit_of(points[i], flip, lens, things, depth, other, whole, slack)[0]
    return out


def _fitted(mirror: Mirror, shown: list[Surfaces], lens: Intrinsics) -> Mirror | None:
    """The plane for which the skin that both views show meets, with its covariance; None when it does not."""
    if min(_oblique(s) for s in shown) < _OBLIQUE:
        return None  # what both views see is oblique to both: of what is left of it some may be on the wrong side
    prior = np.diag(1.0 / np.array((0.03, 0.02, 0.04)) ** 2)

    def solve(half: int, facing: float) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        step = np.zeros(3)
        for turn in range(10):
            gate = 0.10 if turn < 4 else 0.05
            rows, gaps, weights = _equations(moved(mirror, step), shown, lens, gate, half, facing)
            if len(gaps) < _FEW_PAIRS // (1 if half < 0 else 3):
                return None
            information = (rows * weights[:, None]).T @ rows + prior
            change = np.linalg.solve(information, (rows * weights[:, None]).T @ gaps - prior @ step)
            step = step + change
            if turn >= 5 and np.abs(change).max() < 1e-4:
                break
        return step, np.linalg.inv(information), gaps

    tried = ((wrong, [solve(half, facing) for half in (-1, 0, 1)]) for facing, wrong in _GRAZING)
    wrong, fits = next(((wrong, fits) for wrong, fits in tried if None not in fits), (0.0, None))
    if fits is None:
        return None
    (step, covariance, gaps), *halves = fits
    made = moved(mirror, step)
    apart = reflection_shift(person_before(made), moved(mirror, halves[0][0]), moved(mirror, halves[1][0]))
    residual = float(np.sqrt(np.mean(gaps**2)))
    covariance = covariance + np.diag((_SYSTEMATIC, _SYSTEMATIC, wrong)) ** 2
    made = replace(made, residual=residual, points_used=len(gaps), covariance=covariance)
    if apart > _HELD_OUT or residual > _RAGGED or expected_error(made) > _USELESS:
        return None
    return made


def _oblique(shown: Surfaces) -> float:
    """Share of a figure's surface that is seen at more than 60 degrees from its normal."""
    facing = -np.einsum("nc,nc->n", shown.points, shown.normals) / np.linalg.norm(shown.points, axis=1)
    return float((facing < 0.5).mean()) if len(facing) else 0.0


def _equations(
    mirror: Mirror, shown: list[Surfaces], lens: Intrinsics, gate: float, half: int, facing: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of pieces of skin seen both ways: how their gaps change with the mirror (N, 3), the gaps (N,), and weights."""
    rows, gaps, weights = [], [], []
    for m in meetings([mirror], shown, lens, gate, facing=facing):
        mine = slice(None) if half < 0 else m.half == half
        here = m.here if m.of == 1 else m.there
        moves = np.einsum("nci,nc->ni", reflection_moves(mirror, here[mine]), m.normals[mine])
        rows.append(moves if m.of == 1 else -moves)
        gaps.append(m.gaps[mine])
        variances = m.variances[mine]
        s, t = shown[m.of], shown[m.by]
        alike = 2.0 * max((2 * s.radius + 1) / s.stride, (2 * t.radius + 1) / t.stride) ** 2
        weights.append(1.0 / (variances * (1.0 + m.gaps[mine] ** 2 / (4.0 * variances))) / alike)
    if not rows:
        return np.empty((0, 3)), np.empty(0), np.empty(0)
    return np.concatenate(rows), np.concatenate(gaps), np.concatenate(weights)


_CELL = 0.012  # of the mirror's plane along a, and along b [m]
_BESIDE = 1.5  # how far from the image glass may reach [m]
_POST, _NEAR_PLANE = (0.10, 0.13), 0.4  # beside the glass, and so near its plane, nothing stands [m]
_COVERED = 0.5  # of a side, where it can be seen, the depth must jump
_STRIP = 0.55  # of the image's height, from its top, is asked: floor goes on through glass without a jump


def _with_glass(
    mirror: Mirror,
    image: Figure,
    things: np.ndarray,
    depth: np.ndarray,
    lens: Intrinsics,
    floor: np.ndarray,
) -> tuple[Mirror, bool] | None:
    """The mirror with its glass: the rectangle about the image whose sides depth jumps along; None when no straight
    line bounds it; and whether something stands beside it. ``floor`` (4,): up and the floor's height."""
    up, height = floor[:3], floor[3]
    a, b, n = mirror.basis.T
    d = float(n @ mirror.point)
    at = image.points * (d / dot(image.points, n))[:, None] - mirror.point
    left, right = np.quantile(dot(at, a), (0.01, 0.99))
    top, feet = np.quantile(dot(at, b), (0.005, 0.995))
    bottom = (height - up @ mirror.point) / (up @ b)  # where the plane meets the floor
    if not top < feet < bottom + 0.1:
        return None
    corner = np.array((left - _BESIDE, top - _BESIDE))
    size = np.ceil((np.array((right + _BESIDE, bottom)) - corner) / _CELL).astype(np.int64)
    upright, lying, seen = _jumps_kernel(
        depth, _about(things == image.id, 4), lens.lens, mirror.basis, mirror.point, d, corner, size, _CELL
    )
    rows = slice(int((top - corner[1]) / _CELL), int((top + _STRIP * (feet - top) - corner[1]) / _CELL) + 1)
    share, told = _covered(upright[rows], seen[rows])
    begin = ((np.array((left + _OUTSIDE, right - _OUTSIDE)) - corner[0]) / _CELL).astype(int)
    sides = [_first(share[: begin[0]][::-1], told[: begin[0]][::-1]), _first(share[begin[1] :], told[begin[1] :])]
    rectangle = np.array(((left, right), (top, bottom)))
    met = 0
    for end, (state, place) in enumerate(sides):
        if state == _NONE:
            return None
        if state == _MET:
            met += 1
            rectangle[0, end] = corner[0] + (begin[end] + (-place if end == 0 else place + 1)) * _CELL
    columns = slice(*(np.clip((rectangle[0] - corner[0]) / _CELL, 0, size[0]).astype(int) + (2, -2)))
    share, told = _covered(lying[:, columns].T, seen[:, columns].T)
    state, place = _first(share[: rows.start][::-1], told[: rows.start][::-1])
    if state == _MET:
        met += 1
        rectangle[1, 0] = corner[1] + (rows.start - place) * _CELL
    elif met == 2:  # as high as the sides go
        both = upright[:, columns.start - 4 : columns.start + 1].any(axis=1) | upright[
            :, columns.stop : columns.stop + 5].any(axis=1)  # fmt: skip
        rectangle[1, 0] = corner[1] + np.flatnonzero(both)[0] * _CELL if both.any() else top
    if met < 2:
        return None
    beside = _stands_beside(mirror, rectangle, [side[0] == _MET for side in sides], depth, lens)
    open_ends = np.array(((sides[0][0] != _MET, sides[1][0] != _MET), (state != _MET, True)))
    return at_border(replace(mirror, rectangle=rectangle), lens, open_ends), beside


_NONE, _MET, _HIDDEN = 0, 1, 2


def _stands_beside(mirror: Mirror, rectangle: np.ndarray, met: list[bool], depth: np.ndarray, lens: Intrinsics) -> bool:
    """Beside the glass, where only the room behind should be seen, something is near the plane: posts of a door."""
    down = np.linspace(rectangle[1, 0], 0.5 * rectangle[1].sum(), 40)
    for end in np.flatnonzero(met):
        near, told = 0, 0
        for outward in _POST:
            across = np.full(len(down), rectangle[0, end] + (2 * end - 1) * outward)
            points = mirror.point + np.column_stack((across, down)) @ mirror.basis[:, :2].T
            u, v = np.rint(project(points, lens)).T
            inside = (u >= 0) & (v >= 0) & (u < lens.width) & (v < lens.height)
            read = depth[v[inside].astype(int), u[inside].astype(int)]
            apart = read - points[inside, 2]
            near += int(((read > 0) & (np.abs(apart) < _NEAR_PLANE)).sum())
            told += int((apart > -_NEAR_PLANE).sum()) + int((read == 0).sum())
        if near > 0.3 * max(told, 1):
            return True
    return False


def _about(mask: np.ndarray, reach: int) -> np.ndarray:
    """The mask and what is within ``reach`` pixels of it, along rows and columns."""
    for axis in (0, 1):
        mask = np.any([np.roll(mask, k, axis) for k in range(-reach, reach + 1)], axis=0)
    return mask


def _covered(jumps: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of the lines along axis 0 the share where depth jumps within a cell beside them, of what is seen of them; and
    how much is seen."""
    near = jumps.copy()
    near[:, 1:] |= jumps[:, :-1]
    near[:, :-1] |= jumps[:, 1:]
    told = seen.sum(axis=0)
    return (near & seen).sum(axis=0) / np.maximum(told, 1), told / max(len(seen), 1)


def _first(share: np.ndarray, told: np.ndarray) -> tuple[int, int]:
    """The first line outwards that is a side, at its peak; or, when what is seen ends before, that it is hidden."""
    clear = told > 0.4
    strong = np.flatnonzero((share > _COVERED) & clear)
    if len(strong):
        first = int(strong[0])
        return _MET, first + int(np.argmax(share[first : first + 4] * clear[first : first + 4]))
    return (_NONE if clear.mean() > 0.9 else _HIDDEN), 0


@njit(cache=True, nogil=True)
def _jumps_kernel(depth, image, lens, basis, point, d, corner, size, cell):
    """Cells (b, a) of the mirror's plane where depth jumps sideways, or up and down, beyond the plane and off the image
    itself; and those that nothing before the plane hides."""
    height, width = depth.shape
    upright = np.zeros((size[1], size[0]), np.bool_)
    lying = np.zeros((size[1], size[0]), np.bool_)
    seen = np.zeros((size[1], size[0]), np.bool_)
    for v in range(height - 1):
        y = (v - lens[3]) / lens[1]
        for u in range(width - 1):
            x = (u - lens[2]) / lens[0]
            slope = x * basis[0, 2] + y * basis[1, 2] + basis[2, 2]
            if slope >= -1e-6:
                continue
            z = d / slope
            place0 = z * (x * basis[0, 0] + y * basis[1, 0] + basis[2, 0])
            place1 = z * (x * basis[0, 1] + y * basis[1, 1] + basis[2, 1])
            for c in range(3):
                place0 -= basis[c, 0] * point[c]
                place1 -= basis[c, 1] * point[c]
            i, j = int((place1 - corner[1]) / cell), int((place0 - corner[0]) / cell)
            if i < 0 or j < 0 or i >= size[1] or j >= size[0]:
                continue
            here = depth[v, u]
            if here > 0 and here < 0.98 * z - 0.02:
                continue
            # a pixel may be wider than a cell
            reach = int(0.5 * z / lens[0] / cell) + 1
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
