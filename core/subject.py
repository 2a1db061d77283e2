"""Whose pixels these are: the person or thing to scan, told from floor, furniture, walls and other people."""

from __future__ import annotations

import numpy as np
from numba import njit

from .camera import Intrinsics, unproject
from .errors import ReconstructionError
from .floor_parting import NEAR_FLOOR, ROW, share_of_feet, standing_pixels
from .hidden_pieces import pieces_behind
from .mirrors import Mirror
from .numeric.point_products import dot
from .numeric.union_find import root_of
from .things import find_support, gather_pieces
from .views.floor_and_vertical import find_ground
from .views.ray_sorting import Views, ViewSettings, sort_rays
from .views.rig_axis import rig_axis

DEFAULTS = ViewSettings()

_OUTLINE = 0.08  # a view's points may stick out of the subject's outline in another view by this much [m]
_ROUGH = 0.014  # a floor's noise is less [m]
_UNSEEN = 0.004  # where a floor that a mirror hardly shows is, to within one standard deviation [m]
_ENOUGH = 1000  # readings tell a floor
_FOOTPRINT = 0.4  # radius about the subject in which feet may be [m]
_FLOOR_PRIOR = (0.01, 0.006, 0.006)  # by how much a mirror's error may lift [m] and tilt the floor in it
_SHARED = 60.0  # neighbouring readings share so much of their errors that this many count as one
_PIECE = 8  # px: fewer are noise
_CONFIRMED = 0.25  # m
_STEPS = 0.026  # a far sensor counts in steps: pieces may be so much of z apart
_THICK = 0.12  # m: what is seen so little behind something else is its other side
_LOOSE = 0.15  # of what a mirror shows of the subject: a larger piece that the direct view does not show is none
_DENIED, _HARDLY = 0.1, 0.15  # of a piece: furniture, that the direct view shows the front of
_TIGHT = 0.5  # of the depth jump that parts a figure from the room
_FEET, _ABOUT, _FARTHER = 0.2, 0.45, 1.5  # m: feet, the floor right about them; what is farther off, of that
_LIFT, _LOW = 0.003, 0.04  # m: a carpet; a mirror shows less of it than tells it from the floor about it
_STEP, _MAT = (0.008, 0.2), 0.2  # how high [m], and how large [m²] at least, is a mat or step that a person stands on
_BELOW = 0.15  # of the figure: so much of it may be seen below what stands before it
_CLICK_RADIUS = 6  # px: a click without a reading takes the nearest one
_AXIS_SPREAD, _THING_SPREAD = 0.5, 0.3  # how far off the rig's crossing a person or thing counts less [m]


def find_subject(
    depth: np.ndarray,
    intrinsics: Intrinsics,
    mirrors: list[Mirror],
    settings: ViewSettings = DEFAULTS,
    meeting: np.ndarray | None = None,
) -> Views:
    """Sort every pixel into its view and keep the subject: the connected figure above the floor where the rig looks.

    What is seen directly is chosen first: the connected figure nearest to where the lines of sight meet, or the one
    clicked on. What a mirror shows is the subject's where the direct view does not contradict it: it lies inside the
    directly seen outline, or out of the direct view's sight.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        Fused depth, z [m], 0 = no reading.
    intrinsics : Intrinsics
    mirrors : list of Mirror
    settings : ViewSettings
    meeting : np.ndarray [shape=(3,)], optional
        A point of the vertical line where the subject is meant to stand [m]; by default where the mirrors look.

    Raises
    ------
    ReconstructionError
        Nobody stands between the camera and the mirrors, or nothing is where the click is.

    Notes
    -----
    O(H W); about 80 bytes a pixel.
    """
    warnings = []
    seen, points = sort_rays(unproject(depth, intrinsics), mirrors, settings.depth_limit, settings.near)
    ground = find_ground(points, seen, mirrors)
    up = ground.up
    clicked = None if settings.click is None else _clicked_pixel(settings.click, depth, seen)
    meeting = rig_axis(mirrors, up, intrinsics) if meeting is None else meeting
    if clicked is not None:
        meeting = points[clicked]
    pixel_angle = 1.0 / intrinsics.fx
    count = len(mirrors) + 1
    highest = np.inf if ground.floor is None or settings.object else ground.floor + settings.max_height

    def standing(views: range, floor: float | None, center: np.ndarray | None, rough: float, apart: bool = True):
        """Components and sizes of what stands on the floor as these views see it, and how rough that is at most."""
        floors, noises, shares, rough = _floor_of_views(
            points, seen, up, floor, views, center, settings, pixel_angle, rough, apart, outer
        )
        upright = standing_pixels(
            points, seen, depth, up, floors, noises, shares, highest, settings.floor_clearance, views[0], pixel_angle
        )
        return (*connected_pixels(depth, upright, pixel_angle), rough)

    def standing_anywhere(floor: float | None, center: np.ndarray | None, apart: bool):
        """The same of all views."""
        component, sizes, rough = standing(range(1), floor, center, _ROUGH, apart)
        if mirrors:
            others, more, _ = standing(range(1, count), floor, center, rough, apart)
            component = np.where(others >= 0, others + len(sizes), component)
            sizes = np.concatenate((sizes, more))
        return component, sizes, rough

    floor, support, outer, low = ground.floor, None, 0.9 * settings.reach, False
    if settings.object:
        component, sizes, rough = standing_anywhere(floor, meeting, True)
        chosen = _thing(depth, component, len(sizes), seen, points, up, meeting, clicked, pixel_angle, settings)
        if chosen is not None:
            figure = _member_table(chosen, len(sizes))[component] & (component >= 0)
            support = find_support(points, seen, figure, up, floor, pixel_angle, settings.min_pixels)
            if support is not None and clicked is not None and points[clicked] @ up < support:
                support = None  # what is clicked on is meant
            if support is not None:
                how = "" if floor is None else f", {100.0 * (support - floor):.0f} cm above the floor"
                warnings.append(
                    f"what the thing stands on{how}, is cut off; if it is part of the thing, click on it to keep it"
                )
            middle = np.median(points[figure & (seen == 0)], axis=0)
            off = np.inf if meeting is None else np.linalg.norm(_across(up) @ (middle - meeting))
            if support is not None or off > _FOOTPRINT / 2:
                # from here on what the thing stands on is its floor
                floor = floor if support is None else support
                component, sizes, rough = standing_anywhere(floor, middle, support is None)
                chosen = _thing(depth, component, len(sizes), seen, points, up, middle, clicked, pixel_angle, settings)
    else:
        component, sizes, rough = standing(range(1), floor, meeting, _ROUGH)
        chosen = _direct_subject(
            depth, component, len(sizes), points, up, meeting, clicked, pixel_angle, settings
        )  # fmt: skip
        if chosen is not None and floor is not None:
            figure = _member_table(chosen, len(sizes))[component] & (component >= 0)
            middle = np.median(points[figure & (seen == 0)], axis=0)
            support = _raised_floor(points, seen, up, floor, middle, pixel_angle, settings.reach)
            if support is None and _is_stepped(dot(points[figure], up) - floor):
                support = find_support(
                    points, seen, figure, up, floor, pixel_angle, settings.min_pixels, _STEP, _MAT
                )  # fmt: skip
            if support is not None:
                if support - floor > _STEP[0]:
                    warnings.append(
                        f"what the subject stands on, {100.0 * (support - floor):.0f} cm above the floor, is cut off"
                    )
                low = support - floor < _LOW
                floor, outer = support, _ABOUT
                component, sizes, rough = standing(range(1), floor, middle, _ROUGH, False)
                chosen = _direct_subject(
                    depth, component, len(sizes), points, up, middle, clicked, pixel_angle, settings
                )  # fmt: skip
    if chosen is None:
        raise ReconstructionError(_nobody(settings, clicked))
    member = _member_table(chosen, len(sizes))
    labels = np.full(depth.shape, -1, np.int8)
    _label_kernel(component, member, seen, 0, labels)
    inside = points[labels == 0]
    axis = np.median(inside, axis=0)
    height = dot(inside, up)
    reach = (np.sqrt(_squared_distance(inside, axis, _across(up)).max()) + 0.35) ** 2
    wide = _dilated(labels, int(np.ceil(_OUTLINE * intrinsics.fx / np.median(depth[labels == 0]))) + 1)
    lens = intrinsics.lens
    # how deep a figure is behind its front; a thing may be as deep as it is wide
    deepest = 0.5 if not settings.object else max(0.3, 3.0 * np.sqrt(reach) - 1.05)
    if mirrors:
        # what stands there besides, seen directly
        others = (component >= 0) & (sizes[component] >= settings.min_pixels) & (seen == 0) & (labels < 0)
        direct, direct_member = component, member
        if not settings.object:
            component, sizes, _ = standing(range(1, count), floor, axis, rough, support is None or low)
            member = np.zeros(len(sizes), np.bool_)

        def take() -> tuple[np.ndarray, np.ndarray]:
            """Label the mirrors' pixels: how many each view has, and which components are the figure."""
            verdict, votes = _verdict_kernel(
                component, len(sizes), seen, points, depth, labels, others, lens, wide, axis, _across(up), reach, up,
                _height_limits(labels, height, floor), deepest,
            )  # fmt: skip
            return _take_mirrors(depth, component, member, verdict, votes, seen, points, pixel_angle, labels, count)

        taken, chosen = take()
        if not settings.object:
            small = _small_pieces(direct, direct_member, points, axis, up, pixel_angle, settings)
            if small.any():
                shown = np.where(component < 0, -1, chosen[component] | (labels > 0)).astype(np.int8)
                parted = pieces_behind(
                    direct, direct_member, small, points, depth, seen, shown, mirrors, intrinsics
                )  # fmt: skip
                if parted.any():
                    labels[labels > 0] = -1
                    _label_kernel(direct, parted, seen, 0, labels)
                    others &= labels < 0
                    wide = _dilated(labels, int(np.ceil(_OUTLINE * intrinsics.fx / np.median(depth[labels == 0]))) + 1)
                    height = dot(points[labels == 0], up)
                    taken, chosen = take()
        for i, m in enumerate(mirrors, start=1):
            if taken[i] < settings.min_pixels:
                labels[labels == i] = -1
                warnings.append(
                    f"{m.name}: nobody is seen in this mirror, its side of the body is guessed; "
                    "turn the mirror until the camera sees the subject's back in it"
                )
    return Views(
        labels, seen, points, up, floor, ground.noise, axis, tuple(warnings),
        _limits(depth, labels, count), ground.disagreement_deg,
    )  # fmt: skip


def _raised_floor(
    points: np.ndarray,
    seen: np.ndarray,
    up: np.ndarray,
    floor: float,
    middle: np.ndarray,
    pixel_angle: float,
    reach: float,
) -> float | None:
    """Height along ``up`` of the floor right about the feet where it is higher than farther off: a carpet, or what a
    camera that looks down misjudges. None where it is not."""

    def level(inner: float, outer: float) -> tuple[float, float, np.ndarray]:
        """Height of what is level in a ring, its standard deviation, and all heights there."""
        samples, _ = _near_floor_kernel(
            points, seen, up, floor, 0.5 * NEAR_FLOOR, middle, inner**2, outer**2, 0.0, _across(up), 0, 1, pixel_angle
        )  # fmt: skip
        height = np.sort(dot(samples[0][0], up) - floor)
        if len(height) < 200:
            return np.nan, np.inf, height
        half = len(height) // 2
        first = int(np.argmin(height[half:] - height[: len(height) - half]))
        noise = (height[first + half] - height[first]) / 1.349
        return float(np.median(height[first : first + half])), float(noise), height

    near, noise, heights = level(_FEET, _ABOUT)
    far, scatter, others = level(_FARTHER * _ABOUT, reach)
    if not np.isfinite(near + far) or max(noise, scatter) > _ROUGH:
        return None
    sure = 3.0 * np.hypot(noise * np.sqrt(_SHARED / len(heights)), scatter * np.sqrt(_SHARED / len(others)))
    if near - far < max(_LIFT, sure) or np.mean(np.abs(heights - near) < 3.0 * max(noise, 0.001)) < 0.5:
        return None
    return floor + near


def _is_stepped(height: np.ndarray) -> bool:
    """Whether much of a figure, by the heights of its pixels (N,), is at one level near the floor: a mat, a step."""
    bins = np.bincount(np.floor(height[(height >= 0.0) & (height < 1.5)] / 0.01).astype(np.int64), minlength=150)
    return bins[: int(_STEP[1] / 0.01) + 1].max() > 5.0 * np.median(bins)


def _height_limits(labels: np.ndarray, height: np.ndarray, floor: float | None) -> tuple[float, float]:
    """Between which heights a mirror may show the subject, by those that it is seen at directly (N,): where the image's
    border cuts it off there, or something before it hides its feet, more of it may be seen in a mirror."""
    low, high = height.min(), height.max()
    cut = (labels[-3:] == 0).any() or (floor is not None and low > floor + 0.1)
    return -np.inf if cut else low - 0.15, np.inf if (labels[:3] == 0).any() else high + 0.15


def _nobody(settings: ViewSettings, clicked: tuple[int, int] | None) -> str:
    if clicked is not None:
        u, v = settings.click
        return (
            f"nothing that stands on the floor is seen directly at or behind the click ({u:g}, {v:g}); "
            "click on the middle of the subject, where it is seen directly"
        )
    what = "nothing stands" if settings.object else "nobody stands"
    return (
        f"{what} between the camera and the mirrors: no connected figure is seen directly "
        f"within {settings.reach:g} m of where the mirrors look; stand where both mirrors show you, 2 to 3 m from "
        "the camera"
    )


def _clicked_pixel(click: tuple[float, float], depth: np.ndarray, seen: np.ndarray) -> tuple[int, int]:
    """Row and column of the reading nearest to the click."""
    height, width = depth.shape
    u, v = click
    if not (-0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5):
        raise ReconstructionError(f"the click ({u:g}, {v:g}) is outside the {width}×{height} depth image")
    row, column, r = int(round(v)), int(round(u)), _CLICK_RADIUS
    top, left = max(row - r, 0), max(column - r, 0)
    rows, columns = np.nonzero(seen[top : row + r + 1, left : column + r + 1] >= 0)
    if not len(rows):
        raise ReconstructionError(
            f"there is no reading within {r} px of the click ({u:g}, {v:g}); click where the depth image shows the "
            "subject"
        )
    nearest = int(np.argmin((rows + top - v) ** 2 + (columns + left - u) ** 2))
    return int(rows[nearest] + top), int(columns[nearest] + left)


def _floor_of_views(
    points: np.ndarray,
    seen: np.ndarray,
    up: np.ndarray,
    floor: float | None,
    views: range,
    middle: np.ndarray | None,
    settings: ViewSettings,
    pixel_angle: float,
    rough: float,
    apart: bool,
    outer: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """The floor as these views see it about the subject, how noisy it is, and how much of it there is beside feet.

    A mirror's plane is off by a little, and by twice that the floor in it; a longer path is noisier. So each view has
    its own plane (views, 4), n·p = d [m], noise (views,) [m] and :func:`.floor_parting.share_of_feet` (views,) [1/m].
    ``middle``: where the subject stands. ``apart``: there is more of the floor than what is under the subject; else it
    is looked for up to ``outer`` from there. Last, how rough a view of it may be: as given, or, where the direct view
    is one of them, as that tells.
    """
    planes = np.zeros((len(views), 4))
    planes[:, :3], planes[:, 3] = up, -np.inf if floor is None else floor
    noises, shares = np.zeros((2, len(views)))
    if floor is None:
        return planes, noises, shares, rough
    center = np.zeros(3) if middle is None else middle
    # farther off it is noisier, and at the subject there are feet
    ring = (0.0, np.inf) if middle is None else (_FOOTPRINT, 0.9 * settings.reach) if apart else (0.0, outer)
    if not apart and not settings.object:
        ring = (_FEET, outer)
    under = np.inf if middle is None else _FOOTPRINT
    samples, heights = _near_floor_kernel(
        points, seen, up, floor, NEAR_FLOOR, center, ring[0] ** 2, ring[1] ** 2, under**2, _across(up), views[0],
        len(views), pixel_angle,
    )  # fmt: skip
    for k, (view, (sample, rows)) in enumerate(zip(views, samples, strict=True)):
        fitted = _fit_floor(sample, up, floor, center, rough)
        if fitted is None:
            noises[k], lift = _UNSEEN, 0.0
        else:
            normal, d, kept, noise = fitted
            if view == 0:  # twice as far a sensor is four times as noisy, through a mirror more
                rough = min(_ROUGH, 7.0 * noise + 0.002)
            planes[k, :3], planes[k, 3] = normal, d
            # a row's median decides on a pixel
            noises[k] = _closest_half(rows[kept] + dot(sample[kept], normal))
            lift = (d - normal @ center) / (normal @ up) + up @ center - floor  # of this view's floor at the centre
        shares[k] = share_of_feet(heights[k], lift, noises[k])
    return planes, noises, shares, rough


def _fit_floor(
    sample: np.ndarray, up: np.ndarray, floor: float, center: np.ndarray, rough: float
) -> tuple[np.ndarray, float, np.ndarray, float] | None:
    """Plane n·p = d of the level surface among points near the floor, which points (N,) are its, and their standard
    deviation; None when there is hardly any, or it is ``rough``: feet, in a mirror that shows no floor.

    A mirror shows the floor where its plane's error puts it, near the true one: an offset and two slopes are fitted
    with that as prior, for a narrow strip does not tell its tilt, and a few readings beside feet tell little.
    """
    if len(sample) < 80:
        return None
    height = dot(sample, up) - floor
    # feet are spread over all heights, the floor has one
    bins = np.bincount(np.floor((height + NEAR_FLOOR) / 0.005).astype(np.int64).clip(0))
    level = np.convolve(bins, np.ones(4), mode="same")
    place = 0.005 * (np.arange(len(bins)) + 0.5) - NEAR_FLOOR
    likely = level * np.exp(-0.5 * (place / (2.0 * _FLOOR_PRIOR[0])) ** 2)
    first = _level_axis(up)
    plan = sample - center
    rows = np.column_stack((np.ones(len(sample)), dot(plan, first), dot(plan, np.cross(up, first))))
    found = np.array((place[np.argmax(likely)], 0.0, 0.0))
    band = noise = rough
    for _ in range(5):
        miss = height - dot(rows, found)
        kept = np.abs(miss) < band
        if kept.sum() < 60:
            return None
        # images of images lay a second sheet across the floor: its own spread is that of the closest half
        noise = max(_closest_half(miss[kept]), 0.0005)
        matrix, right = _floor_equations(rows, height, miss, band, noise)
        found = np.linalg.solve(np.diag(1.0 / np.square(_FLOOR_PRIOR)) + matrix, right)
        band = min(max(4.0 * noise, 0.003), 2.0 * rough)
    if noise >= rough or (np.abs(found) > 3.0 * np.array(_FLOOR_PRIOR)).any():
        return None
    normal = up - found[1] * first - found[2] * np.cross(up, first)
    length = np.linalg.norm(normal)
    d = (floor + found[0] - found[1] * (first @ center) - found[2] * (np.cross(up, first) @ center)) / length
    return normal / length, float(d), kept, noise


@njit(cache=True, nogil=True)
def _floor_equations(rows, height, miss, band, noise):
    """Weighted normal equations (3, 3) and (3,) of ``rows`` · x = ``height``, of rows that miss by less than a band."""
    matrix, right = np.zeros((3, 3)), np.zeros(3)
    for i in range(len(rows)):
        if abs(miss[i]) < band:
            weight = 1.0 / (_SHARED * noise * noise * (1.0 + (miss[i] / (2.0 * noise)) ** 2))
            for a in range(3):
                right[a] += weight * rows[i, a] * height[i]
                for b in range(3):
                    matrix[a, b] += weight * rows[i, a] * rows[i, b]
    return matrix, right


def _closest_half(values: np.ndarray) -> float:
    """Standard deviation of a normal distribution whose middle half is as wide as the narrowest half of the values."""
    values = np.sort(values)
    half = len(values) // 2
    return float((values[half:] - values[: len(values) - half]).min() / 1.349)


@njit(cache=True, nogil=True)
def _near_floor_kernel(
    points, seen, up, floor, band, center, inner2, outer2, under2, across, first, views, pixel_angle
):
    """Up to ``_ENOUGH`` points of each view from ``first`` on within ``band`` of the floor and in a ring about the
    subject, evenly taken, and how far the median of each one's row is above it. What stands upright is left out.

    And how many there are at each height (views, 120), from -``band`` to ``band``, nearer to the subject.
    """
    heights = np.zeros((views, 120), np.int64)
    height, width = seen.shape
    found = [np.empty(seen.size, np.int32) for _ in range(views)]
    count = np.zeros(views, np.int64)
    for v in range(height):
        for u in range(width):
            k = seen[v, u] - first
            if k < 0 or k >= views or (seen[v, u] == 0 and (u + v) % 4 > 0):  # directly there is more than enough
                continue
            x, y, z = points[v, u, 0], points[v, u, 1], points[v, u, 2]
            level = up[0] * x + up[1] * y + up[2] * z - floor
            if abs(level) >= band:
                continue
            x, y, z = x - center[0], y - center[1], z - center[2]
            squared = 0.0
            for r in range(3):
                squared += (across[r, 0] * x + across[r, 1] * y + across[r, 2] * z) ** 2
            if squared < under2:
                heights[k, int((level + band) / band * 60.0)] += 1
            if squared < inner2 or squared > outer2:
                continue
            if 3 <= v < height - 3 and seen[v - 3, u] == seen[v, u] and seen[v + 3, u] == seen[v, u]:
                a, b = points[v - 3, u], points[v + 3, u]
                rise = up[0] * (a[0] - b[0]) + up[1] * (a[1] - b[1]) + up[2] * (a[2] - b[2])
                if abs(rise) > 3.0 * pixel_angle * points[v, u, 2]:  # half of what an upright surface rises
                    continue
            found[k][count[k]] = v * width + u
            count[k] += 1
    samples = []
    row = np.empty(2 * ROW + 1)
    for k in range(views):
        some = found[k][: count[k] : count[k] // _ENOUGH + 1]
        sample, medians = np.empty((len(some), 3)), np.empty(len(some))
        for i in range(len(some)):
            v, u = some[i] // width, some[i] % width
            p = points[v, u]
            sample[i] = p
            n = 0
            for w in range(max(u - ROW, 0), min(u + ROW + 1, width)):
                q = points[v, w]
                if seen[v, w] == seen[v, u] and abs(q[2] - p[2]) < 0.1:
                    row[n] = up[0] * (q[0] - p[0]) + up[1] * (q[1] - p[1]) + up[2] * (q[2] - p[2])
                    n += 1
            medians[i] = np.median(row[:n])
        samples.append((sample, medians))
    return samples, heights


def _direct_subject(depth, component, count, points, up, meeting, clicked, pixel_angle, settings) -> np.ndarray | None:
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
        member |= _below_kernel(component, member, below, depth) >= _PIECE // 2
    others = np.flatnonzero(member)
    return np.concatenate(([best], others[others != best]))


def _thing(depth, component, count, seen, points, up, meeting, clicked, pixel_angle, settings) -> np.ndarray | None:
    """Components of all views that are the thing: what is best seen where the rig looks, in the most views."""
    total, within, score, box = _scores(component, count, points, up, meeting, _THING_SPREAD, pixel_angle, settings)
    usable = (score > 0) & (total >= _PIECE)
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


def _small_pieces(component, member, points, axis, up, pixel_angle, settings) -> np.ndarray:
    """Bool (C,): what else stands about the subject and is small beside it."""
    total, within, *_ = _pieces_kernel(
        component, len(member), points, axis, _across(up), settings.reach**2, 1.0, pixel_angle
    )  # fmt: skip
    return ~member & (total >= _PIECE) & (within > 0.6 * total) & (total < _BELOW * total[member].sum())


def _scores(component, count, points, up, meeting, spread, pixel_angle, settings):
    """Per component: pixels, those within reach of where the rig looks, how much of it there is there, and its box."""
    # without a rig that tells where it looks: near the vertical plane straight ahead of the camera
    axis, across = (np.zeros(3), np.diag((1.0, 0, 0))) if meeting is None else (meeting, _across(up))
    total, within, weight, box = _pieces_kernel(
        component, count, points, axis, across, settings.reach**2, spread**2, pixel_angle
    )
    # a wall or a chair row that only passes through the place is mostly outside of it
    return total, within, np.where((within > 0.6 * total) & (within >= 20), weight, 0.0), box


def _joined(chosen, component, count, points, up, total, score, box, pixel_angle) -> np.ndarray:
    """Bool (count,): the chosen components and what belongs to them, as near as it is."""
    member = _member_table(chosen, count)
    lowest = _lowest_kernel(component, count, points, up)
    floor_reach = lowest[chosen].min() + 0.05
    while True:  # a piece may reach the body through another one: a hand through a forearm
        low, high = box[member, 0].min(axis=0) - 0.12, box[member, 1].max(axis=0) + 0.12
        near = ~member & (score > 0) & (box[:, 0] < high).all(axis=1) & (box[:, 1] > low).all(axis=1)
        if not near.any():
            return member
        gap = _gap_kernel(component, member, near, points, total, 0.12 / pixel_angle)
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


@njit(cache=True, nogil=True)
def _gap_kernel(component, member, near, points, total, reach):
    """Least distance (C,) [m] from each ``near`` component to a ``member`` about it in the image, ``reach``/z px off.

    Its outline is asked, thinned out where it is long, and of what is around it every other row and column.
    """
    height, width = component.shape
    gap = np.full(len(member), np.inf)
    met = np.zeros(len(member), np.int64)
    for v in range(height):
        for u in range(width):
            k = component[v, u]
            if k < 0 or not near[k]:
                continue
            met[k] += 1
            border = v == 0 or u == 0 or v == height - 1 or u == width - 1
            if not border:  # the nearest pixel is one of the outline
                border = (
                    component[v - 1, u] != k or component[v + 1, u] != k
                    or component[v, u - 1] != k or component[v, u + 1] != k
                )  # fmt: skip
            if not border or met[k] % (total[k] // 3000 + 1):
                continue
            radius = min(int(reach / max(points[v, u, 2], 0.2)) + 2, 60)
            for y in range(max(v - radius, 0), min(v + radius + 1, height), 2):
                for x in range(max(u - radius, 0), min(u + radius + 1, width), 2):
                    j = component[y, x]
                    if j >= 0 and member[j]:
                        d = 0.0
                        for c in range(3):
                            d += (points[v, u, c] - points[y, x, c]) ** 2
                        gap[k] = min(gap[k], d)
    return np.sqrt(gap)


@njit(cache=True, nogil=True)
def _dilated(labels, radius):
    """Where a pixel of the direct view (label 0) is within a square of so many pixels to either side."""
    height, width = labels.shape
    rows = np.zeros((height, width), np.bool_)
    for v in range(height):
        until = -1
        for u in range(width):
            if labels[v, u] == 0:
                until = u + radius
                for x in range(u - 1, max(u - radius, 0) - 1, -1):
                    if rows[v, x]:
                        break
                    rows[v, x] = True
            if u <= until:
                rows[v, u] = True
    out = np.zeros((height, width), np.bool_)
    seen_at = np.full(width, -radius - 1)
    for v in range(height):
        for u in range(width):
            if rows[v, u]:
                seen_at[u] = v
            out[v, u] = v - seen_at[u] <= radius
    seen_at[:] = height + radius + 1
    for v in range(height - 1, -1, -1):
        for u in range(width):
            if rows[v, u]:
                seen_at[u] = v
            out[v, u] |= seen_at[u] - v <= radius
    return out


@njit(cache=True, nogil=True)
def _verdict_kernel(
    component, count, seen, points, depth, labels, others, lens, wide, axis, across, reach2, up, heights, deepest
):
    """What the direct view says of each standing pixel of a mirror: 2 the subject's, 1 it hides behind the subject, 0
    cannot tell, -1 not the subject's; -2 elsewhere. And how many of each (4, C) a component has, 2 first.

    ``wide`` is the directly seen outline, grown; ``others``: where somebody or something else is seen to stand.
    """
    height, width = component.shape
    out = np.full((height, width), -2, np.int8)
    votes = np.zeros((4, count), np.int64)
    for v in range(height):
        for u in range(width):
            if component[v, u] < 0 or seen[v, u] <= 0:
                continue
            p = points[v, u]
            level = up[0] * p[0] + up[1] * p[1] + up[2] * p[2]
            x, y, z = p[0] - axis[0], p[1] - axis[1], p[2] - axis[2]
            squared = 0.0
            for r in range(3):
                squared += (across[r, 0] * x + across[r, 1] * y + across[r, 2] * z) ** 2
            verdict = -1
            if heights[0] < level < heights[1] and squared <= reach2:
                verdict = 0
                if p[2] > 0.05:
                    row = int(np.floor(p[1] / p[2] * lens[1] + lens[3] + 0.5))
                    column = int(np.floor(p[0] / p[2] * lens[0] + lens[2] + 0.5))
                    if 0 <= row < height and 0 <= column < width:
                        if labels[row, column] == 0:
                            # behind the subject's front; too far behind it is something that the subject hides
                            verdict = 1 if p[2] - depth[row, column] > deepest else 2
                        elif not wide[row, column] and depth[row, column] > p[2] - 0.05:
                            verdict = -1
                        elif others[row, column] and -0.05 < p[2] - depth[row, column] < _THICK:
                            verdict = -1  # the other side of that
            out[v, u] = verdict
            votes[2 - verdict, component[v, u]] += 1
    return out, votes


def _take_mirrors(
    depth: np.ndarray,
    component: np.ndarray,
    member: np.ndarray,
    verdict: np.ndarray,
    votes: np.ndarray,
    seen: np.ndarray,
    points: np.ndarray,
    pixel_angle: float,
    labels: np.ndarray,
    views: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Label the mirrors' components that the direct view does not deny, and where it does not those of a ``member``;
    how many pixels (views,) each view has, and which components (C,) are the figure."""
    yes, hidden, unsure, no = votes
    told = yes + hidden + no
    chosen = (yes + unsure >= 30) & (yes > 0.6 * told) & (yes > 0.25 * (told + unsure))
    chosen |= member
    _deny_furniture(depth, component, chosen & (no >= _PIECE), verdict, seen, pixel_angle)
    taken = _take_kernel(component, chosen, verdict, seen, labels, views)
    if not chosen.any():
        return taken, chosen
    mine = labels > 0
    # right at the figure: what the direct view cannot see, a foot behind a chair's leg; and of what is denied as a
    # whole the part that it confirms, a foot that touches the chair
    small = (told + unsure < _LOOSE * taken.max()) | (yes > unsure)
    loose = ~chosen & small & (yes + unsure >= _PIECE) & (yes + unsure > 0.7 * (told + unsure))
    loose &= ~_is_furniture(yes, no, told + unsure)
    mixed = ~chosen & ~loose & (yes >= _PIECE)
    if not loose.any() and not mixed.any():
        return taken, chosen
    pieces = _pieces_beside(component, loose, mixed, verdict, seen)
    part, sizes = connected_pixels(depth, pieces, pixel_angle)
    count = len(sizes)
    part[mine] = count
    member, near = _member_table(np.array([count]), count + 1), np.append(sizes >= _PIECE, False)
    gap = _gap_kernel(part, member, near, points, np.append(sizes, 0), _CONFIRMED / pixel_angle)
    distance, sure = _piece_kernel(part, verdict, depth, count + 1)
    # what the direct view confirms, be it in part, may be far off: a foot below a chair's seat, a heel behind its leg
    joined = near & (gap < np.where(sure > 0.0, _CONFIRMED, np.maximum(0.05, _STEPS * distance)))
    return taken + _take_kernel(part, joined, verdict, seen, labels, views), chosen


def _is_furniture(yes: np.ndarray, no: np.ndarray, total: np.ndarray) -> np.ndarray:
    """Of what a mirror shows that the direct view confirms hardly anywhere, what it denies in part: the other side of
    a box that is seen directly, of which all that is deeper is hidden behind its front."""
    return (no >= np.maximum(_PIECE, _DENIED * total)) & (yes < _HARDLY * total)


def _deny_furniture(depth, component, mixed, verdict, seen, pixel_angle) -> None:
    """What is connected with the figure (``mixed`` components) across a small jump only is judged by itself, in
    ``verdict``."""
    if not mixed.any():
        return
    table = np.append(mixed, False)
    part, sizes = connected_pixels(depth, np.where(table[component], seen, -1).astype(np.int8), pixel_angle, _TIGHT)
    rows, columns = np.nonzero(part >= 0)
    piece, told = part[rows, columns], verdict[rows, columns]
    yes, no = (np.bincount(piece, told == value, len(sizes)) for value in (2, -1))
    denied = _is_furniture(yes, no, sizes)[piece]
    verdict[rows[denied], columns[denied]] = -1


@njit(cache=True, nogil=True)
def _pieces_beside(component, loose, mixed, verdict, seen):
    """``seen`` on loose components and on the confirmed pixels of mixed ones, else -1."""
    out = np.full(seen.shape, -1, np.int8)
    for v in range(seen.shape[0]):
        for u in range(seen.shape[1]):
            k = component[v, u]
            if k >= 0 and verdict[v, u] >= 0 and (loose[k] or (mixed[k] and verdict[v, u] == 2)):
                out[v, u] = seen[v, u]
    return out


@njit(cache=True, nogil=True)
def _piece_kernel(component, verdict, depth, count):
    """Mean depth of each component, and the share of it that the direct view confirms."""
    total, sure, pixels = np.zeros(count), np.zeros(count), np.zeros(count)
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            k = component[v, u]
            if k >= 0:
                total[k] += depth[v, u]
                sure[k] += verdict[v, u] == 2
                pixels[k] += 1.0
    pixels = np.maximum(pixels, 1.0)
    return total / pixels, sure / pixels


@njit(cache=True, nogil=True)
def _take_kernel(component, chosen, verdict, seen, labels, views):
    taken = np.zeros(views, np.int64)
    for v in range(component.shape[0]):
        for u in range(component.shape[1]):
            if verdict[v, u] >= 0 and chosen[component[v, u]]:
                labels[v, u] = seen[v, u]
                taken[seen[v, u]] += 1
    return taken


def _limits(depth: np.ndarray, labels: np.ndarray, views: int) -> np.ndarray:
    """Nearest and farthest z (views, 2) of the subject in each view with 5 cm to spare; NaN where it is not seen."""
    limits = np.full((views, 2), np.nan)
    for view in range(views):
        mine = depth[labels == view]
        if len(mine):
            limits[view] = mine.min() - 0.05, mine.max() + 0.05
    return limits


def _member_table(chosen: np.ndarray, count: int) -> np.ndarray:
    """Bool (count,): which components are chosen."""
    table = np.zeros(count, np.bool_)
    table[chosen] = True
    return table


@njit(cache=True, nogil=True)
def _label_kernel(component, member, seen, label, labels):
    """Write ``label`` where a pixel seen in that view has a component that is a ``member``."""
    for v in range(component.shape[0]):
        for u in range(component.shape[1]):
            if component[v, u] >= 0 and seen[v, u] == label and member[component[v, u]]:
                labels[v, u] = label


def _across(up: np.ndarray) -> np.ndarray:
    """Projection (3, 3) onto the horizontal."""
    return np.eye(3) - np.outer(up, up)


def _level_axis(up: np.ndarray) -> np.ndarray:
    """A horizontal unit vector."""
    level = _across(up)[:, int(np.argmin(np.abs(up)))]
    return level / np.linalg.norm(level)


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


def connected_pixels(
    depth: np.ndarray, seen: np.ndarray, pixel_angle: float, jump: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Connected components of each view's pixels, not connected over depth jumps (two-pass union-find).

    ``jump``: how large these are, for a slanting surface 1.

    Returns
    -------
    component : np.ndarray [shape=(H, W), dtype=int32]
        Component of each pixel, -1 where ``seen`` is negative.
    sizes : np.ndarray [shape=(C,), dtype=int64]
    """
    return _components_kernel(depth, seen, pixel_angle, jump)


@njit(cache=True, nogil=True)
def _link(depth, seen, parent, v, u, dv, du, reach):
    """Join a pixel's component to that of its neighbour before it, unless a depth jump is between them."""
    y, x = v + dv, u + du
    if y < 0 or x < 0 or x >= seen.shape[1] or seen[y, x] != seen[v, u]:
        return
    here, there = v * seen.shape[1] + u, y * seen.shape[1] + x
    if parent[here] == parent[there] or abs(depth[y, x] - depth[v, u]) >= reach * min(depth[v, u], depth[y, x]):
        return
    a, b = root_of(parent, here), root_of(parent, there)
    parent[max(a, b)] = min(a, b)
    parent[here] = parent[there] = min(a, b)


@njit(cache=True, nogil=True)
def _components_kernel(depth, seen, pixel_angle, jump):
    height, width = depth.shape
    parent = np.empty(height * width, np.int32)
    near, far = jump * (8.0 * pixel_angle + 0.012), jump * (16.0 * pixel_angle + 0.012)
    for v in range(height):
        for u in range(width):
            if seen[v, u] < 0:
                continue
            parent[v * width + u] = v * width + u
            _link(depth, seen, parent, v, u, 0, -1, near)
            _link(depth, seen, parent, v, u, -1, 0, near)
            _link(depth, seen, parent, v, u, -1, -1, near)
            _link(depth, seen, parent, v, u, -1, 1, near)
            # up to two pixels away, so that a line of drop-outs does not part a limb
            _link(depth, seen, parent, v, u, 0, -2, far)
            _link(depth, seen, parent, v, u, -2, 0, far)
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
