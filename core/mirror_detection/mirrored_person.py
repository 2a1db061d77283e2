"""A person and their mirror image as a pair, and the plane between the two."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..camera import Intrinsics, RgbdImage
from ..mirrors import Mirror
from ..mirrors.glass_kernels import NEAREST
from ..mirrors.mirror import (
    behind_glass,
    expected_error,
    moved,
    oriented,
    person_before,
    reflection_matrix,
    reflection_moves,
    reflection_shift,
)
from ..numeric.kernels import njit
from ..numeric.point_products import dot
from ..views.view_correspondences import Surfaces, find_correspondences, noise_of, surfaces

_ABOVE_FLOOR = 0.3  # above the floor objects begin [m]: a mirror that leans lifts the floor it shows
_TALLEST = 2.4  # what is higher above the floor is no figure's [m]
_LEAST_READINGS = 150  # a figure has at least so many readings of the thinned picture
_WIDE, _HIGH, _FLAT = 2.2, 0.4, 0.015  # no figure is wider, less high, or flatter (standard deviation) [m]
_FIGURE_SAMPLE = 1200  # of a figure's readings say where it is
_FIGURES = 8  # so many are looked at, the largest
_SKIN = 0.08  # how far in front of its middle a figure is seen [m]
_MOST_LEAN = np.radians(6.0)  # mirrors do not lean more
_SURFACE_PIECES = 8000  # of a figure's surface
_LEAST_PAIRS = 42
# cosine to the line of sight under which skin is not judged, in turn when that leaves too few pairs, and what then may
# be wrong with the shift [m]: the more grazing, the flatter cameras see a limb
_GRAZING = ((0.35, 0.003), (0.25, 0.007), (0.15, 0.012))
_LOOKED_SHARE, _JUDGED_SHARE, _MET_SHARE = (0.03, 0.05), 0.25, 0.6  # shares of a figure and of its image, see _one_body
_OBLIQUE = 0.03  # of a rounded body a tenth is seen obliquely; patterns that meet over a mirror put it out
_RAGGED_SKIN = 0.010  # root mean square of the gaps between skin seen both ways [m]
_MOST_ERROR = 0.03  # a mirror expected to misplace a person by more is dropped [m]
_HALVES_APART = 0.05  # at what distance from each other the two halves of the readings may place a person [m]
_SLOPE_ERROR = 0.002  # error of the slopes that shows in no residual [rad]


@dataclass(frozen=True)
class Figure:
    """An object that may be a person, or a person's image in a mirror.

    Attributes
    ----------
    id : int
        In the picture of objects.
    count : int
        Of its readings.
    points : np.ndarray [shape=(N, 3)]
        Some of them [m].
    middle : np.ndarray [shape=(3,)]
        Median of these [m].
    top : float
        Along the vertical [m].
    cut : bool
        The image's border cuts its top off.
    """

    id: int
    count: int
    points: np.ndarray
    middle: np.ndarray
    top: float
    cut: bool


def find_figures(
    depth: np.ndarray, cloud: np.ndarray, up: np.ndarray, floor: float, known: list[Mirror], flat: float = _FLAT
) -> tuple[np.ndarray, list[Figure]]:
    """Picture of objects (H, W), 0 = none, and those of them that may be somebody, the largest first.

    Not what is seen in mirrors that are ``known``, nor what deviates less from a plane than ``flat`` [m].
    """
    height = dot(cloud, up) - floor
    objects, count = _objects_kernel(depth, (height > _ABOVE_FLOOR) & (height < _TALLEST))
    sizes = np.bincount(objects.ravel(), minlength=count + 1)
    sizes[0] = 0
    across = np.cross(up, (0.0, 0.0, 1.0))
    across /= np.linalg.norm(across)
    ahead = np.cross(across, up)
    out: list[Figure] = []
    for k in np.argsort(-sizes, kind="stable")[:40]:
        if sizes[k] < _LEAST_READINGS or len(out) == _FIGURES:
            break
        rows, columns = np.nonzero(objects == k)
        some = slice(None, None, len(rows) // _FIGURE_SAMPLE + 1)
        points = cloud[rows[some], columns[some]]
        middle = np.median(points, axis=0)
        if behind_glass(middle[None], known)[0]:
            continue
        place = np.sort(points @ np.column_stack((across, ahead, up)), axis=0)
        low, high, top = (place[int(share * (len(place) - 1))] for share in (0.02, 0.98, 0.995))
        span = high - low
        if span[:2].max() > _WIDE or span[2] < _HIGH or top[2] > floor + _TALLEST - 0.1:
            continue
        if _thickness(points) < flat:
            continue
        out.append(Figure(int(k), int(sizes[k]), points, middle, float(top[2]), rows.min() < 3))
    return objects, out


def _thickness(points: np.ndarray) -> float:
    """Standard deviation of points (N, 3) from the plane that most of them lie about [m]."""
    for _ in range(4):
        offset = points - points.mean(axis=0)
        spread, axes = np.linalg.eigh(offset.T @ offset / len(points))
        away = np.abs(offset @ axes[:, 0])
        points = points[away <= max(3.0 * np.median(away), 0.01)]
    return float(np.sqrt(max(spread[0], 0.0)))


@njit(cache=True, nogil=True)
def _objects_kernel(depth, stands):
    """Connected objects (H, W) int32, numbered from 1, and how many."""
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


def figure_surfaces(image: RgbdImage, one: Figure, reflection: Figure, objects: np.ndarray) -> list[Surfaces]:
    """What is seen of a figure and of its image as pieces of surface: of the one, of the other.

    Parameters
    ----------
    objects : np.ndarray [shape=(H, W), dtype=int32]
        Picture of objects, 0 = none.
    image : RgbdImage
        z [m], 0 = no reading.
    """
    depth = image.depth
    views = np.full(depth.shape, -1, np.int8)
    views[objects == one.id] = 0
    views[objects == reflection.id] = 1
    noise = noise_of(depth, views)
    return [surfaces(image, views, view, noise, _SURFACE_PIECES) for view in (0, 1)]


def search_mirror_plane(
    image: RgbdImage, one: Figure, reflection: Figure, shown: list[Surfaces], objects: np.ndarray, up: np.ndarray
) -> Mirror | None:
    """The plane between a figure and its image, rotated and shifted to where each fits the other's silhouette best.

    Parameters
    ----------
    shown : list of Surfaces
        Of the figure and of its image, see :func:`figure_surfaces`.
    objects : np.ndarray [shape=(H, W), dtype=int32]
        Picture of objects, 0 = none.
    image : RgbdImage
        z [m], 0 = no reading.
    up : np.ndarray [shape=(3,)]
        The vertical, a unit vector.

    Returns
    -------
    Mirror or None
        Without a rectangle; None when the plane is seen edge-on, or nothing fits.
    """
    depth, intrinsics = image.depth, image.intrinsics
    here, there = (f.middle + _SKIN * f.middle / np.linalg.norm(f.middle) for f in (one, reflection))
    way: np.ndarray = here - there
    way = way - (way @ up) * up
    if not (one.cut or reflection.cut):  # a mirror that leans shows the head higher or lower
        lean = (one.top - reflection.top) / np.linalg.norm(way)
        way = way + np.clip(lean, -np.tan(_MOST_LEAN), np.tan(_MOST_LEAN)) * np.linalg.norm(way) * up
    middle = 0.5 * (here + there)
    normal, basis = oriented(way, middle, -up)
    if -normal @ middle < 0.1 * np.linalg.norm(middle):
        return None
    mirror = Mirror("", middle, normal, basis, source="found")
    best = np.zeros(3)
    # slopes along a and b, and shift; the first rotates about the vertical
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
                s.points[thin], s.normals[thin], flips, intrinsics.packed, objects, depth,
                (one, reflection)[by].id, by == 0,
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


_ASKED = 300  # pieces of a figure's surface that are projected on the other
# against 1 for a piece that may be where it is projected: for one that may not, and besides for one that meets its like
_LOOKED_THROUGH, _ALIKE = -3.0, 2.0


@njit(cache=True, nogil=True)
def _score_kernel(
    points, normals, flips, intrinsics, objects, depth, other, whole, grid, stride, there, there_normals, slack
):  # fmt: skip
    """How well the pieces of a figure, flipped into the other view, fit what that sees; for every plane (K, 4, 4)."""
    scores = np.zeros(len(flips))
    q, m = np.empty(3), np.empty(3)
    for k in range(len(flips)):
        total, judged = 0.0, 0
        for i in range(len(points)):
            kind, u, v = _fit_of(points[i], flips[k], intrinsics, objects, depth, other, whole, slack)
            if kind == _NOT_JUDGED:
                continue
            judged += 1
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
        scores[k] = total / len(points) if judged > 0.3 * len(points) else -3.0
    return scores


_NOT_JUDGED, _ON, _HIDDEN_BEHIND, _LOOKED = 0, 1, 2, 3
_RAGGED_PIXELS = 2  # px by which silhouettes are ragged
_ROOM = 3.0  # what the glass shows farther behind a figure's image is not the room right behind it [m]
_BODY = 0.5  # nothing of a figure is farther behind what is seen of it [m]
_ERROR = 0.0015  # by so much, times z², readings may be off


@njit(cache=True, nogil=True)
def _fit_of(p, flip, intrinsics, objects, depth, other, whole, slack):
    """What becomes of a point flipped into the other view.

    Nothing is said, it is on the other figure, or hidden behind it, or the camera looks through it; and its pixel.
    ``whole``: beside the other figure the room is seen, not what is beside the glass.
    """
    z = flip[2, 3]
    x = flip[0, 3]
    y = flip[1, 3]
    for c in range(3):
        x += flip[0, c] * p[c]
        y += flip[1, c] * p[c]
        z += flip[2, c] * p[c]
    if z < NEAREST:
        return _NOT_JUDGED, 0, 0
    u, v = int(np.rint(x / z * intrinsics[0] + intrinsics[2])), int(np.rint(y / z * intrinsics[1] + intrinsics[3]))
    if u < 0 or v < 0 or v >= depth.shape[0] or u >= depth.shape[1]:
        return _NOT_JUDGED, 0, 0
    seen = depth[v, u]
    slack += _ERROR * max(z, p[2]) ** 2
    if seen == 0:
        return _NOT_JUDGED, u, v
    if objects[v, u] != other:
        if seen < z + slack or not (whole or seen < z + _ROOM):
            return _NOT_JUDGED, u, v
        # silhouettes are ragged: is the other figure beside?
        beside = False
        for dv, du in ((0, -_RAGGED_PIXELS), (0, _RAGGED_PIXELS), (-_RAGGED_PIXELS, 0), (_RAGGED_PIXELS, 0)):
            i, j = min(max(v + dv, 0), depth.shape[0] - 1), min(max(u + du, 0), depth.shape[1] - 1)
            if objects[i, j] == other:
                v, u, seen, beside = i, j, depth[i, j], True
                break
        if not beside:
            return _LOOKED, u, v
    if z < seen - slack or z > seen + _BODY:
        return _LOOKED, u, v
    return (_ON if z < seen + 2.0 * slack else _HIDDEN_BEHIND), u, v


def is_one_body(image: RgbdImage, one: Figure, reflection: Figure, objects: np.ndarray, mirror: Mirror) -> bool:
    """Whether the image, flipped over the mirror, lies within the figure, and the other way round.

    Almost no reading is a free-space violation of the other view, enough are where that view says anything, and most of
    the image lies on the figure or behind it.
    """
    depth, intrinsics = image.depth, image.intrinsics
    flip = reflection_matrix(mirror)
    for points, other, whole in ((one.points, reflection.id, False), (reflection.points, one.id, True)):
        kinds = _kinds_kernel(np.ascontiguousarray(points), flip, intrinsics.packed, objects, depth, other, whole, 0.03)
        counts = np.bincount(kinds, minlength=4)
        judged = len(points) - counts[_NOT_JUDGED]
        if judged < _JUDGED_SHARE * len(points) or counts[_LOOKED] > _LOOKED_SHARE[whole] * judged:
            return False
        if whole and counts[_ON] + counts[_HIDDEN_BEHIND] < _MET_SHARE * len(points):
            return False
    return True


@njit(cache=True, nogil=True)
def _kinds_kernel(points, flip, intrinsics, objects, depth, other, whole, slack):
    out = np.empty(len(points), np.int64)
    for i in range(len(points)):
        out[i] = _fit_of(points[i], flip, intrinsics, objects, depth, other, whole, slack)[0]
    return out


def fit_mirror_to_skin(mirror: Mirror, shown: list[Surfaces], intrinsics: Intrinsics) -> Mirror | None:
    """The mirror moved to where the skin that both views show coincides.

    Parameters
    ----------
    mirror : Mirror
        Good to some centimetres.
    shown : list of Surfaces
        Of the figure and of its image, see :func:`figure_surfaces`.

    Returns
    -------
    Mirror or None
        With its covariance and ``residual`` [m]; None where too little is seen both ways, or two halves of it ask for
        different planes.
    """
    if min(_oblique(s) for s in shown) < _OBLIQUE:
        return None  # what both views see is oblique to both: of what is left of it some may be on the wrong side
    prior = np.diag(1.0 / np.array((0.03, 0.02, 0.04)) ** 2)

    def solve(half: int, facing: float) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        correction = np.zeros(3)
        for iteration in range(10):
            gate = 0.10 if iteration < 4 else 0.05
            rows, gaps, weights = _equations(moved(mirror, correction), shown, intrinsics, gate, half, facing)
            if len(gaps) < _LEAST_PAIRS // (1 if half < 0 else 3):
                return None
            information = (rows * weights[:, None]).T @ rows + prior
            change = np.linalg.solve(information, (rows * weights[:, None]).T @ gaps - prior @ correction)
            correction = correction + change
            if iteration >= 5 and np.abs(change).max() < 1e-4:
                break
        return correction, np.linalg.inv(information), gaps

    for facing, shift_error in _GRAZING:
        fits = [fit for half in (-1, 0, 1) if (fit := solve(half, facing)) is not None]
        if len(fits) == 3:
            deviations = _SLOPE_ERROR, _SLOPE_ERROR, shift_error
            break
    else:
        return None
    (correction, covariance, gaps), first, second = fits
    made = moved(mirror, correction)
    distance = reflection_shift(person_before(made), moved(mirror, first[0]), moved(mirror, second[0]))
    residual = float(np.sqrt(np.mean(gaps**2)))
    covariance = covariance + np.diag(deviations) ** 2
    made = replace(made, residual=residual, points_used=len(gaps), covariance=covariance)
    if distance > _HALVES_APART or residual > _RAGGED_SKIN or expected_error(made) > _MOST_ERROR:
        return None
    return made


def _oblique(shown: Surfaces) -> float:
    """Share of a figure's surface that is seen at more than 60 degrees from its normal."""
    facing = -np.einsum("nc,nc->n", shown.points, shown.normals) / np.linalg.norm(shown.points, axis=1)
    return float((facing < 0.5).mean()) if len(facing) else 0.0


def _equations(
    mirror: Mirror, shown: list[Surfaces], intrinsics: Intrinsics, gate: float, half: int, facing: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of pieces of skin seen both ways: how their gaps change with the mirror (N, 3), the gaps (N,), and weights."""
    rows, gaps, weights = [], [], []
    for m in find_correspondences([mirror], shown, intrinsics, gate, facing=facing):
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
