"""Views that show the same surface must agree: mirrors moved until they do, and told when they do not.

Neighbouring mirrors show much of a person's back twice, and some of it shows directly too. A mirror whose frame is
narrow, noisy or half hidden may be sure to some centimetres only; what it shows beside another view ties it down.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from .camera import Intrinsics, project, unproject
from .mirrors import Mirror
from .mirrors.mirror import expected_error, moved, reflect, reflection_matrix, reflection_moves, with_reason
from .numeric.point_products import dot
from .views import Views, sort_rays


@dataclass(frozen=True)
class AgreementSettings:
    """When what two views show of the same surface may move the mirrors.

    Parameters
    ----------
    use : bool
        Off leaves the planes where their frames are.
    unsure : float
        Mirrors are only moved when one is expected to misplace a person by more than this [m].
    gate : float
        Surfaces farther apart than this are not taken for one another [m].
    gain : float
        The step is made only when the log likelihood of pairs it was not fitted to grows by this much.
    min_pairs : int
        Of surface points seen both ways.
    """

    use: bool = True
    unsure: float = 0.005
    gate: float = 0.10
    gain: float = 0.5
    min_pairs: int = 40


_SYSTEMATIC = 0.003  # how far apart two views may see one surface, however long the burst [m]
_FACING = 0.35  # cosine to the line of sight under which a surface is not judged
_ABOUT = 1.0  # how far from the vertical through the subject it may reach [m]
_THROUGH = 0.3  # of what one view shows may be looked through by another: silhouettes are ragged
_HIDDEN = 0.03  # surfaces farther behind others are hidden by them [m]
_ENOUGH = 1600  # pieces of a view
_APART = 0.12  # surfaces of the subject that lie farther apart are other parts of it [m]


@dataclass(frozen=True)
class Surfaces:
    """Pieces of surface a view shows, laid where the camera sees them (behind the glass).

    ``grid`` (H', W') is the index of the piece at every ``stride``-th pixel or -1; ``points`` and unit ``normals``
    towards the camera (K, 3), ``variances`` (K,) of the place along the normal [m²], ``pixels`` (K, 2).
    """

    grid: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    variances: np.ndarray
    pixels: np.ndarray
    stride: int
    radius: int


def views_of(
    mirrors: list[Mirror], depth: np.ndarray, seen: np.ndarray, intrinsics: Intrinsics, sigma: float
) -> list[Surfaces]:
    """The surfaces that each view shows; of the direct one only what mirrors may show too."""
    shown = [surfaces(depth, seen, view, intrinsics, sigma) for view in range(1, len(mirrors) + 1)]
    laid = np.concatenate([reflect(s.points, m) for s, m in zip(shown, mirrors, strict=True)])
    pixels = project(laid[laid[:, 2] > 0.3], intrinsics)
    size = np.array((intrinsics.width, intrinsics.height))
    pixels = pixels[((pixels >= 0) & (pixels < size)).all(axis=1)]
    direct = np.full_like(seen, -1)
    if len(pixels):
        # by columns: a mirror shows what stands beside it too, and a box about all of that is most of the image
        columns = np.bincount((pixels[:, 0] // 16).astype(int), minlength=intrinsics.width // 16 + 1)
        busy = np.repeat(columns > 0.004 * len(pixels), 16)[: intrinsics.width]
        top, bottom = np.quantile(pixels[:, 1], (0.01, 0.99)).astype(int)
        direct[top : bottom + 1, busy] = np.where(seen == 0, 0, -1)[top : bottom + 1, busy]
    return [surfaces(depth, direct, 0, intrinsics, sigma), *shown]


def surfaces(
    depth: np.ndarray, seen: np.ndarray, view: int, intrinsics: Intrinsics, sigma: float, most: int = _ENOUGH
) -> Surfaces:
    """The pieces of surface that one view shows, each a plane fitted to a small window.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
    seen : np.ndarray [shape=(H, W), dtype=int8]
        View of each pixel, or -1.
    view : int
    sigma : float
        Standard deviation of 1/z [1/m]: how wide the window must be.
    most : int
        About so many pieces at most.
    """
    count, z, *box = _extent_kernel(depth, seen, view)
    size = (depth.shape[0] + 1) // 2, (depth.shape[1] + 1) // 2
    if count == 0:
        nothing = np.empty((0, 3))
        return Surfaces(
            np.full(size, -1, np.int32), nothing, nothing, np.empty(0), np.empty((0, 2), np.int32), 2, 2
        )  # fmt: skip
    # wide enough that noise tilts the plane by less than a fifth
    radius = 2
    while radius < 6 and sigma * z * intrinsics.fx > 0.2 * (2 * radius + 1) * np.sqrt(radius * (radius + 1) / 3.0):
        radius += 1
    # neighbours share their windows, and some hundred pieces tell as much as thousands
    stride = max(2 if radius < 4 else 3, int(np.ceil(np.sqrt(count / most))))
    grid, points, normals, variances, pixels = _surface_kernel(
        depth, seen, view, intrinsics.lens, np.array(box), stride, radius, sigma
    )
    return Surfaces(grid, points, normals, variances, pixels, stride, radius)


@dataclass(frozen=True)
class Meeting:
    """Surfaces of view ``of`` that view ``by`` sees too: where both place them.

    ``here`` and ``there`` (K, 3): the piece and that of the other view's surface in its line of sight, both where the
    camera lays them; ``normals`` (K, 3) of the latter where it really is, ``gaps`` (K,) along these [m], ``variances``
    (K,) of the gaps, ``half`` (K,) 0 or 1 by image blocks. ``before``: how many pieces lie before what the other view
    sees there by more than the gate, where it should see them: it would have to look through them. ``through``, of
    ``judged``: how many of all pieces, whichever way they face, the other view looks through to something behind,
    subject or not.
    """

    of: int
    by: int
    here: np.ndarray
    there: np.ndarray
    normals: np.ndarray
    gaps: np.ndarray
    variances: np.ndarray
    half: np.ndarray
    before: int
    through: int
    judged: int


def meetings(
    mirrors: list[Mirror],
    shown: list[Surfaces],
    intrinsics: Intrinsics,
    gate: float,
    depth: np.ndarray | None = None,
    seen: np.ndarray | None = None,
    facing: float = _FACING,
) -> list[Meeting]:
    """What each pair of views shows of the same surface; with ``depth`` and ``seen`` also what is looked through.
    Surfaces are not judged whose cosine to the line of sight is under ``facing``."""
    if depth is None or seen is None:
        depth, seen = np.zeros((1, 1), np.float32), np.full((1, 1), -1, np.int8)
    flips = [np.eye(4), *(reflection_matrix(m) for m in mirrors)]
    out = []
    for of in range(len(shown)):
        for by in range(len(shown)):
            if of == by or len(shown[of].points) == 0 or len(shown[by].points) == 0 or (of == 0 and by == 0):
                continue
            s, t = shown[of], shown[by]
            plane = np.zeros(4) if by == 0 else np.append(mirrors[by - 1].normal, mirrors[by - 1].normal
                                                          @ mirrors[by - 1].point)  # fmt: skip
            here, there, normals, gaps, variances, half, *counts = _meet_kernel(
                s.points, s.normals, s.variances, s.pixels, flips[of], flips[by], plane, intrinsics.lens, t.grid,
                t.stride, t.points, t.normals, t.variances, gate, depth, seen, by, facing,
            )  # fmt: skip
            out.append(Meeting(of, by, here, there, normals, gaps, variances, half, *counts))
    return out


def agree(
    mirrors: list[Mirror], depth: np.ndarray, intrinsics: Intrinsics, settings: AgreementSettings | None = None
) -> list[Mirror]:
    """Mirrors moved until the views agree on what they show twice, weighed against how sure each frame's plane is.

    All mirrors are solved for together: two slopes and a shift each, the frames' covariances as prior, the distances of
    surfaces seen twice as observations. The pairs are split into two sets of image blocks; what one asks for must make
    the other more likely, or all stay.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        Fused depth, z [m].

    Returns
    -------
    list of Mirror
        With what they are now known to in their covariances; as they were when that cannot be shown to help.

    Notes
    -----
    O(pixels behind glass); nothing is done while every frame is sure enough.
    """
    settings = settings or AgreementSettings()
    free = [m.covariance is not None and m.rectangle is not None and m.source != "rig file" for m in mirrors]
    if not settings.use or not any(
        f and expected_error(m) > settings.unsure for m, f in zip(mirrors, free, strict=True)
    ):
        return list(mirrors)
    seen = sort_rays(unproject(depth, intrinsics), mirrors)[0]
    sigma = noise_of(depth, seen)
    shown = views_of(mirrors, depth, seen, intrinsics, sigma)
    index = np.cumsum([0, *(3 * f for f in free)])
    prior = np.zeros((index[-1], index[-1]))
    for k, mirror in enumerate(mirrors):
        if free[k]:
            prior[index[k] : index[k] + 3, index[k] : index[k] + 3] = np.linalg.inv(mirror.covariance)

    def placed(step: np.ndarray) -> list[Mirror]:
        return [
            moved(m, step[index[k] : index[k] + 3]) if free[k] else m for k, m in enumerate(mirrors)
        ]  # fmt: skip

    nothing = np.zeros(index[-1])

    def solve(half: int, start: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        step = start
        first = 0 if start is nothing else 2
        for turn in range(first, 6):
            at = placed(step)
            gate = settings.gate if turn < 2 else 0.6 * settings.gate
            information, right, count = prior.copy(), -prior @ step, 0
            for m in meetings(at, shown, intrinsics, gate):
                mine = slice(None) if half < 0 else m.half == half
                gaps = m.gaps[mine]
                if not len(gaps):
                    continue
                count += len(gaps)
                rows = np.zeros((len(gaps), index[-1]))
                for view, points, sign in ((m.of, m.here[mine], 1.0), (m.by, m.there[mine], -1.0)):
                    if view and free[view - 1]:
                        moves = np.einsum("nci,nc->ni", reflection_moves(at[view - 1], points), m.normals[mine])
                        rows[:, index[view - 1] : index[view - 1] + 3] += sign * moves
                weight = _weights(gaps, m.variances[mine], shown, m)
                information += (rows * weight[:, None]).T @ rows
                right += (rows * weight[:, None]).T @ gaps
            if count < settings.min_pairs:
                return None
            change = np.linalg.solve(information, right)
            step = step + change
            if turn >= 2 and np.abs(change).max() < 1e-4:
                break
        return step, np.linalg.inv(information)

    def likelihood(step: np.ndarray, half: int) -> float:
        total = 0.0
        for m in meetings(placed(step), shown, intrinsics, settings.gate):
            mine = m.half == half
            r = m.gaps[mine] ** 2 / m.variances[mine]
            # a pair that is lost to the gate counts as one at it
            total -= float(np.log1p(r).sum()) / _shared(shown, m)
            total -= (
                m.before / 2 * np.log1p(settings.gate**2 / max(np.median(m.variances), 1e-6)) / _shared(shown, m)
                if len(m.variances)
                else 0.0
            )
        return total

    whole = solve(-1, nothing)
    if whole is None:
        return list(mirrors)
    before = [likelihood(nothing, half) for half in (0, 1)]
    if sum(likelihood(whole[0], half) - before[half] for half in (0, 1)) < settings.gain:
        return list(mirrors)  # what does not make all pairs together more likely need not be asked of the halves
    halves = [solve(half, whole[0]) for half in (0, 1)]
    if None in halves:
        return list(mirrors)
    gains = [likelihood(halves[1 - half][0], half) - before[half] for half in (0, 1)]
    if sum(gains) < settings.gain or min(gains) < 0.0:
        return list(mirrors)
    step, covariance = whole
    parts = [slice(index[k], index[k + 1]) for k in range(len(mirrors))]
    return [
        with_reason(replace(m, covariance=covariance[part, part]), old, "views") if f else m
        for m, old, f, part in zip(placed(step), mirrors, free, parts, strict=True)
    ]


@dataclass(frozen=True)
class Disagreement:
    """Two views place the subject apart.

    Parameters
    ----------
    mirror : int
        Index of the mirror most likely at fault.
    other : int
        The view it contradicts, 0 = direct.
    distance : float
        Median distance of surfaces both see [m]; 0 when that is no more than noise, or they hardly meet.
    through : float
        Share of what one of them shows that the other looks through.
    sure : bool
        It is this mirror; else it may as well be the other.
    """

    mirror: int
    other: int
    distance: float
    through: float
    sure: bool

    @property
    def hopeless(self) -> bool:
        """The surface would be doubled, and by which mirror is known."""
        return self.sure and (self.distance > 0.03 or self.through > 0.5)


def disagreements(depth: np.ndarray, views: Views, mirrors: list[Mirror], intrinsics: Intrinsics) -> list[Disagreement]:
    """Where views of the subject contradict each other, the worst of each mirror.

    Compared is what each mirror shows about the subject's place, whether it was taken for the subject or not: a mirror
    that is far off shows something that no longer looks like it. O(pixels of the subject).
    """
    subject = dot(views.points.reshape(-1, 3)[np.flatnonzero(views.labels == 0)[::5]], views.up)
    low, high = (subject.min(), subject.max()) if len(subject) else (-np.inf, np.inf)
    low = low + 0.1 if views.floor is None else views.floor + 0.1
    labels = _about_kernel(views.labels, views.seen, views.points, views.up, views.axis, low, high + 0.1)
    sigma = noise_of(depth, labels)
    shown = [surfaces(depth, labels, view, intrinsics, sigma) for view in range(len(mirrors) + 1)]
    apart: dict[tuple[int, int], list[Meeting]] = {}
    for m in meetings(mirrors, shown, intrinsics, _APART, depth, views.seen):
        apart.setdefault((min(m.of, m.by), max(m.of, m.by)), []).append(m)
    told = []  # pair, distance, share looked through
    doubt = np.zeros(len(mirrors) + 1)  # how far each mirror contradicts the direct view, though that need not be told
    for pair, both in apart.items():
        # what lies far behind what the other view sees there may well be hidden from it
        gaps = [np.abs(m.gaps[m.gaps < _HIDDEN]) for m in both] + [np.full(m.before, _APART) for m in both]
        gaps = np.concatenate(gaps)
        variances = np.concatenate([m.variances for m in both])
        distance = 0.0
        if len(gaps) >= 40 and len(variances):
            distance = float(np.median(gaps))
            if distance < max(0.012, 3.0 * float(np.sqrt(np.median(variances)))):
                distance = 0.0
        through = max(_looked_through(m) for m in both)
        if pair[0] == 0:
            doubt[pair[1]] = max(m.through / max(m.judged, 100) for m in both)
        if distance > 0.0 or through > _THROUGH:
            told.append((pair, distance, through))
    direct = {pair[1] for pair, _, _ in told if pair[0] == 0}
    worst: dict[int, Disagreement] = {}
    for (one, other), distance, through in told:
        guilty, witness, sure = other, one, True
        if one > 0:
            unsure = [expected_error(mirrors[k - 1]) + 1e-6 for k in (one, other)]
            # by the direct view where it can tell, else by their frames
            blame = [
                (k in direct) + 4.0 * doubt[k] + 0.2 * np.log2(e) for k, e in zip((one, other), unsure, strict=True)
            ]
            sure = abs(blame[0] - blame[1]) > 0.6
            guilty, witness = (one, other) if blame[0] > blame[1] else (other, one)
        known = worst.get(guilty, Disagreement(guilty - 1, witness, 0.0, 0.0, False))
        worst[guilty] = replace(
            known,
            distance=max(distance, known.distance),
            through=max(through, known.through),
            sure=sure or known.sure,
        )
    return [worst[k] for k in sorted(worst)]


def _looked_through(m: Meeting) -> float:
    """Share of the pieces, where there are enough to go by; of a few most must say so."""
    share = m.through / max(m.judged, 1)
    return share if m.judged >= 100 or (m.judged >= 40 and share > 0.7) else 0.0


def noise_of(depth: np.ndarray, seen: np.ndarray) -> float:
    """Standard deviation of 1/z behind glass, from second differences along the rows [1/m]."""
    bend = _bend_kernel(depth, seen)
    return 1.4826 * float(np.median(np.abs(bend))) / np.sqrt(6.0) if len(bend) else 0.0


@njit(cache=True, nogil=True)
def _bend_kernel(depth, seen):
    """Second differences of 1/z behind glass along every third row."""
    height, width = depth.shape
    out = np.empty(((height + 2) // 3) * width)
    n = 0
    for v in range(0, height, 3):
        for u in range(1, width - 1):
            a, b, c = depth[v, u - 1], depth[v, u], depth[v, u + 1]
            if seen[v, u] > 0 and a > 0 and b > 0 and c > 0:
                out[n] = 1.0 / a - 2.0 / b + 1.0 / c
                n += 1
    return out[:n]


@njit(cache=True, nogil=True)
def _about_kernel(labels, seen, points, up, axis, low, high):
    """The directly seen subject's pixels, 0, and what mirrors show about it, their views; else -1."""
    out = np.full(labels.shape, -1, np.int8)
    for v in range(labels.shape[0]):
        for u in range(labels.shape[1]):
            if labels[v, u] == 0:
                out[v, u] = 0
            if seen[v, u] <= 0:
                continue
            x, y, z = points[v, u, 0], points[v, u, 1], points[v, u, 2]
            height = up[0] * x + up[1] * y + up[2] * z
            if height <= low or height >= high:
                continue
            x, y, z = x - axis[0], y - axis[1], z - axis[2]
            along = up[0] * x + up[1] * y + up[2] * z
            if x * x + y * y + z * z - along * along < _ABOUT * _ABOUT:
                out[v, u] = seen[v, u]
    return out


@njit(cache=True, nogil=True)
def _extent_kernel(depth, seen, view):
    """How many pixels a view has, their mean depth, and their box: left, top, right, bottom, the latter two beyond."""
    height, width = depth.shape
    count, total = 0, 0.0
    left, top, right, bottom = width, height, 0, 0
    for v in range(height):
        for u in range(width):
            if seen[v, u] == view:
                count += 1
                total += depth[v, u]
                left, right = min(left, u), max(right, u + 1)
                top, bottom = min(top, v), v + 1
    return count, total / max(count, 1), left, top, right, bottom


def _shared(shown: list[Surfaces], m: Meeting) -> float:
    """How many neighbouring pieces, which share pixels and errors, count as one."""
    s, t = shown[m.of], shown[m.by]
    return 2.0 * max((2 * s.radius + 1) / s.stride, (2 * t.radius + 1) / t.stride) ** 2


def _weights(gaps: np.ndarray, variances: np.ndarray, shown: list[Surfaces], m: Meeting) -> np.ndarray:
    return 1.0 / (variances * (1.0 + gaps * gaps / (4.0 * variances))) / _shared(shown, m)


@njit(cache=True, nogil=True)
def _surface_kernel(depth, seen, view, camera, box, stride, radius, sigma):
    """Planes 1/z = a·x + b·y + c fitted to windows about every ``stride``-th pixel of a view."""
    height, width = depth.shape
    fx, fy, cx, cy = camera
    grid = np.full(((height + stride - 1) // stride, (width + stride - 1) // stride), -1, np.int32)
    room = ((box[3] - box[1]) // stride + 2) * ((box[2] - box[0]) // stride + 2)
    points, normals, variances = np.empty((room, 3)), np.empty((room, 3)), np.empty(room)
    pixels = np.empty((room, 2), np.int32)
    n = 0
    needed = 0.6 * (2 * radius + 1) ** 2
    for v in range((box[1] + stride - 1) // stride * stride, box[3], stride):
        if v < radius or v >= height - radius:
            continue
        for u in range((box[0] + stride - 1) // stride * stride, box[2], stride):
            if u < radius or u >= width - radius or seen[v, u] != view or depth[v, u] == 0.0:
                continue
            middle = 1.0 / depth[v, u]
            a, b, c = 0.0, 0.0, middle
            reach = 4.0 * sigma + 0.05 * middle * middle
            good = False
            for _ in range(2):
                s = sx = sy = sxx = sxy = syy = r = rx = ry = 0.0
                for y in range(-radius, radius + 1):
                    for x in range(-radius, radius + 1):
                        z = depth[v + y, u + x]
                        if z == 0.0 or seen[v + y, u + x] != view:
                            continue
                        d = 1.0 / z
                        if abs(d - (a * x + b * y + c)) > reach:
                            continue
                        s += 1.0
                        sx += x
                        sy += y
                        sxx += x * x
                        sxy += x * y
                        syy += y * y
                        r += d
                        rx += d * x
                        ry += d * y
                if s < needed:
                    good = False
                    break
                xx, xy, yy = sxx - sx * sx / s, sxy - sx * sy / s, syy - sy * sy / s
                det = xx * yy - xy * xy
                if det < 1e-9:
                    good = False
                    break
                px, py = rx - r * sx / s, ry - r * sy / s
                a, b = (px * yy - py * xy) / det, (py * xx - px * xy) / det
                c = (r - a * sx - b * sy) / s
                good = c > 0.0
                reach = 3.0 * sigma + 0.01 * middle * middle
            if not good:
                continue
            nx, ny = a * fx, b * fy
            nz = a * (cx - u) + b * (cy - v) + c
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            z = 1.0 / c
            x, y = (u - cx) / fx, (v - cy) / fy
            facing = 1.0 / (length * z * np.sqrt(x * x + y * y + 1.0))  # m·p = 1
            if facing < _FACING:
                continue
            points[n, 0], points[n, 1], points[n, 2] = x * z, y * z, z
            normals[n, 0], normals[n, 1], normals[n, 2] = -nx / length, -ny / length, -nz / length
            # along the normal: dz = z² dd, and the normal's part of it
            along = z * z * abs(nx * x + ny * y + nz) / length
            variances[n] = along * along * sigma * sigma / s
            pixels[n, 0], pixels[n, 1] = u, v
            grid[v // stride, u // stride] = n
            n += 1
    return grid, points[:n], normals[:n], variances[:n], pixels[:n]


@njit(cache=True, nogil=True)
def _meet_kernel(
    points, normals, variances, pixels, flip, flip_by, plane, camera, grid, stride, there, there_normals,
    there_variances, gate, depth, seen, by, facing_limit,
):  # fmt: skip
    """Pieces of one view laid before another's eye, and what that sees in the same line of sight."""
    fx, fy, cx, cy = camera
    count = len(points)
    here, other, e_out = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 3))
    gaps, spread, half = np.empty(count), np.empty(count), np.empty(count, np.int8)
    q, m, laid, d, e = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    n, before, through, judged = 0, 0, 0, 0
    height, width = depth.shape
    rows, columns = grid.shape
    for i in range(count):
        for r in range(3):
            q[r], m[r] = flip[r, 3], 0.0
            for c in range(3):
                q[r] += flip[r, c] * points[i, c]
                m[r] += flip[r, c] * normals[i, c]
        if plane[0] * q[0] + plane[1] * q[1] + plane[2] * q[2] < plane[3] + 0.05 and plane[3] != 0.0:
            continue  # behind the other mirror
        facing, length = 0.0, 0.0
        for r in range(3):
            laid[r] = flip_by[r, 3]
            turned = 0.0
            for c in range(3):
                laid[r] += flip_by[r, c] * q[c]
                turned += flip_by[r, c] * m[c]
            facing -= turned * laid[r]
            length += laid[r] * laid[r]
        if laid[2] < 0.3:
            continue
        x, y = int(np.rint(laid[0] / laid[2] * fx + cx)), int(np.rint(laid[1] / laid[2] * fy + cy))
        if 0 <= x < width and 0 <= y < height and seen[y, x] == by and depth[y, x] > 0.0:
            judged += 1
            if depth[y, x] > laid[2] + gate:
                through += 1
        if facing < facing_limit * np.sqrt(length) or x < 0 or y < 0:
            continue
        row, column = (y + stride // 2) // stride, (x + stride // 2) // stride
        if row >= rows or column >= columns:
            continue
        k = grid[row, column]
        if k < 0:
            continue
        alike, gap = 0.0, 0.0
        for r in range(3):
            d[r], e[r] = flip_by[r, 3], 0.0
            for c in range(3):
                d[r] += flip_by[r, c] * there[k, c]
                e[r] += flip_by[r, c] * there_normals[k, c]
            alike += m[r] * e[r]
        for r in range(3):
            gap += e[r] * (d[r] - q[r])
        if gap < -gate:
            before += 1
        if alike < 0.7 or abs(gap) > gate:
            continue
        for r in range(3):
            here[n, r], other[n, r], e_out[n, r] = points[i, r], there[k, r], e[r]
        gaps[n] = gap
        spread[n] = variances[i] + there_variances[k] + _SYSTEMATIC * _SYSTEMATIC
        half[n] = (pixels[i, 0] // 24 + pixels[i, 1] // 24) % 2
        n += 1
    return here[:n], other[:n], e_out[:n], gaps[:n], spread[:n], half[:n], before, through, judged
