"""Whose pixels these are: the person or thing to scan, told from floor, furniture, walls and other people."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..camera import Intrinsics, unproject
from ..errors import ReconstructionError
from ..mirrors import Mirror
from ..numeric.point_products import dot
from ..views.floor_and_vertical import find_ground
from ..views.ray_sorting import sort_rays
from ..views.rig_axis import rig_axis
from .connected_pixels import connected_pixels, dilated, label_kernel, member_table
from .direct_subject import find_direct_subject, find_object, small_pieces
from .floor_plane import (
    ABOUT,
    FOOTPRINT,
    LOW,
    MAT,
    ROUGH,
    STEP,
    floor_of_views,
    horizontal_projection,
    is_stepped,
    raised_floor,
)
from .foot_segmentation import standing_pixels
from .mirrored_subject import label_mirrored_subject, verdict_kernel
from .occluded_pieces import pieces_behind
from .subject_views import Views, ViewSettings
from .support_surface import find_support

DEFAULTS = ViewSettings()

_OUTLINE = 0.08  # a view's points may stick out of the subject's outline in another view by this much [m]
_CLICK_RADIUS = 6  # px: a click without a reading takes the nearest one


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
        floors, noises, shares, rough = floor_of_views(
            points, seen, up, floor, views, center, settings, pixel_angle, rough, apart, outer
        )
        upright = standing_pixels(
            points, seen, depth, up, floors, noises, shares, highest, settings.floor_clearance, views[0], pixel_angle
        )
        return (*connected_pixels(depth, upright, pixel_angle), rough)

    def standing_anywhere(floor: float | None, center: np.ndarray | None, apart: bool):
        """The same of all views."""
        component, sizes, rough = standing(range(1), floor, center, ROUGH, apart)
        if mirrors:
            others, more, _ = standing(range(1, count), floor, center, rough, apart)
            component = np.where(others >= 0, others + len(sizes), component)
            sizes = np.concatenate((sizes, more))
        return component, sizes, rough

    floor, support, outer, low = ground.floor, None, 0.9 * settings.reach, False
    if settings.object:
        component, sizes, rough = standing_anywhere(floor, meeting, True)
        chosen = find_object(depth, component, len(sizes), seen, points, up, meeting, clicked, pixel_angle, settings)
        if chosen is not None:
            figure = member_table(chosen, len(sizes))[component] & (component >= 0)
            support = find_support(points, seen, figure, up, floor, pixel_angle, settings.min_pixels)
            if support is not None and clicked is not None and points[clicked] @ up < support:
                support = None  # what is clicked on is meant
            if support is not None:
                how = "" if floor is None else f", {100.0 * (support - floor):.0f} cm above the floor"
                warnings.append(
                    f"what the thing stands on{how}, is cut off; if it is part of the thing, click on it to keep it"
                )
            middle = np.median(points[figure & (seen == 0)], axis=0)
            off = np.inf if meeting is None else np.linalg.norm(horizontal_projection(up) @ (middle - meeting))
            if support is not None or off > FOOTPRINT / 2:
                # from here on what the thing stands on is its floor
                floor = floor if support is None else support
                component, sizes, rough = standing_anywhere(floor, middle, support is None)
                chosen = find_object(
                    depth, component, len(sizes), seen, points, up, middle, clicked, pixel_angle, settings
                )
    else:
        component, sizes, rough = standing(range(1), floor, meeting, ROUGH)
        chosen = find_direct_subject(
            depth, component, len(sizes), points, up, meeting, clicked, pixel_angle, settings
        )  # fmt: skip
        if chosen is not None and floor is not None:
            figure = member_table(chosen, len(sizes))[component] & (component >= 0)
            middle = np.median(points[figure & (seen == 0)], axis=0)
            support = raised_floor(points, seen, up, floor, middle, pixel_angle, settings.reach)
            if support is None and is_stepped(dot(points[figure], up) - floor):
                support = find_support(
                    points, seen, figure, up, floor, pixel_angle, settings.min_pixels, STEP, MAT
                )  # fmt: skip
            if support is not None:
                if support - floor > STEP[0]:
                    warnings.append(
                        f"what the subject stands on, {100.0 * (support - floor):.0f} cm above the floor, is cut off"
                    )
                low = support - floor < LOW
                floor, outer = support, ABOUT
                component, sizes, rough = standing(range(1), floor, middle, ROUGH, False)
                chosen = find_direct_subject(
                    depth, component, len(sizes), points, up, middle, clicked, pixel_angle, settings
                )  # fmt: skip
    if chosen is None:
        raise ReconstructionError(_nobody(settings, clicked))
    member = member_table(chosen, len(sizes))
    labels = np.full(depth.shape, -1, np.int8)
    label_kernel(component, member, seen, 0, labels)
    inside = points[labels == 0]
    axis = np.median(inside, axis=0)
    height = dot(inside, up)
    reach = (np.sqrt(_squared_distance(inside, axis, horizontal_projection(up)).max()) + 0.35) ** 2
    wide = dilated(labels, int(np.ceil(_OUTLINE * intrinsics.fx / np.median(depth[labels == 0]))) + 1)
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
            verdict, votes = verdict_kernel(
                component, len(sizes), seen, points, depth, labels, others, lens, wide, axis,
                horizontal_projection(up), reach, up,
                _height_limits(labels, height, floor), deepest,
            )  # fmt: skip
            return label_mirrored_subject(
                depth, component, member, verdict, votes, seen, points, pixel_angle, labels, count
            )

        taken, chosen = take()
        if not settings.object:
            small = small_pieces(direct, direct_member, points, axis, up, pixel_angle, settings)
            if small.any():
                shown = np.where(component < 0, -1, chosen[component] | (labels > 0)).astype(np.int8)
                parted = pieces_behind(
                    direct, direct_member, small, points, depth, seen, shown, mirrors, intrinsics
                )  # fmt: skip
                if parted.any():
                    labels[labels > 0] = -1
                    label_kernel(direct, parted, seen, 0, labels)
                    others &= labels < 0
                    wide = dilated(labels, int(np.ceil(_OUTLINE * intrinsics.fx / np.median(depth[labels == 0]))) + 1)
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


def _limits(depth: np.ndarray, labels: np.ndarray, views: int) -> np.ndarray:
    """Nearest and farthest z (views, 2) of the subject in each view with 5 cm to spare; NaN where it is not seen."""
    limits = np.full((views, 2), np.nan)
    for view in range(views):
        mine = depth[labels == view]
        if len(mine):
            limits[view] = mine.min() - 0.05, mine.max() + 0.05
    return limits


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
