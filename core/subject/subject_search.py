"""Whose pixels these are: the person or object to scan, separated from floor, furniture, walls and other people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..camera import Intrinsics, RgbdImage, unproject
from ..errors import Notice, ReconstructionError
from ..mirrors import Mirror
from ..numeric.point_products import dot
from ..views.floor_and_vertical import Ground, find_ground
from ..views.ray_sorting import sort_rays
from ..views.rig_axis import reflected_sight, rig_axis
from .connected_pixels import Readings, label_kernel
from .direct_subject import DirectSubject, figure_areas, find_object, find_person
from .floor_plane import ROUGH, Floor, horizontal_projection, standing_pieces
from .mirrored_subject import label_mirrored_subject, mirrored_pieces
from .occluded_pieces import occluded_pieces
from .subject_views import Views, ViewSettings

DEFAULTS = ViewSettings()

_ALONG_SIGHT = np.arange(0.5, 4.0, 0.25)  # m from a mirror, on the line of sight, where somebody is looked for
_OFF_SIGHT, _TALL = 0.5, 0.5  # m: how far beside that line, and how tall at least
_CLICK_RADIUS = 6  # px: a click without a reading takes the nearest one


def find_subject(
    image: RgbdImage, mirrors: list[Mirror], settings: ViewSettings = DEFAULTS, expected: np.ndarray | None = None,
    ground: Ground | None = None,
) -> Views:  # fmt: skip
    """Sort every pixel into its view and keep the subject: the connected figure above the floor where the rig looks.

    What is seen directly is chosen first: the connected figure nearest to where the lines of sight meet, or the one
    clicked on. What a mirror shows is the subject's where the direct view does not contradict it: it lies inside the
    directly seen outline, or out of the direct view's sight.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m], 0 = no reading.
    mirrors : list of Mirror
    settings : ViewSettings
    expected : np.ndarray [shape=(3,)], optional
        A point of the vertical line where the subject is meant to stand, camera frame [m]; by default where the
        mirrors look.
    ground : Ground, optional
        Vertical and floor where they are known; by default they are found.

    Raises
    ------
    ReconstructionError
        Nobody stands between the camera and the mirrors, or nothing is where the click is.

    Notes
    -----
    O(H W); about 80 bytes a pixel.
    """
    depth, intrinsics = image.depth, image.intrinsics
    seen, points = sort_rays(unproject(depth, intrinsics), mirrors, settings.depth_limit, settings.near)
    ground, views = ground or find_ground(points, seen, mirrors), len(mirrors) + 1
    readings = Readings(depth, seen, points, ground.up, 1.0 / intrinsics.fx)
    clicked = None if settings.click is None else _clicked_pixel(settings.click, depth, seen)
    told = expected is not None
    if clicked is not None:
        expected = points[clicked]
    elif not told:
        expected = rig_axis(mirrors, ground.up, intrinsics)
    highest = np.inf if ground.floor is None or settings.object else ground.floor + settings.max_height
    floor = Floor(ground.floor, expected, True, 0.9 * settings.reach, highest)

    if settings.object:
        direct = find_object(readings, floor, clicked, views, settings)
    else:
        direct = find_person(readings, floor, clicked, settings)
        if direct is None and clicked is None and not told:
            direct = _person_beside_axis(readings, floor, mirrors, intrinsics, settings)
    if direct is None:
        raise ReconstructionError(_nobody(settings), code="nobody")
    labels = direct.labels()
    axis = np.median(points[labels == 0], axis=0)

    warnings = direct.warnings
    if mirrors:
        mirrored = mirrored_pieces(direct, labels, axis, views, settings)
        taken, chosen = label_mirrored_subject(labels, direct, mirrored, intrinsics, views, settings)
        if not settings.object:
            occluded = occluded_pieces(
                direct, labels, mirrored.pieces.component, chosen, axis, mirrors, intrinsics, settings
            )
            if occluded.any():  # then the direct view confirms more of what the mirrors show
                labels[labels > 0] = -1
                label_kernel(direct.pieces.component, occluded, seen, 0, labels)
                taken, _ = label_mirrored_subject(labels, direct, mirrored, intrinsics, views, settings)
        warnings += _without_empty_views(labels, taken, mirrors, settings)
    return Views(
        labels, seen, points, ground.up, direct.floor.height, ground.noise, axis, warnings,
        _limits(depth, labels, views), ground.disagreement_deg,
    )  # fmt: skip


def _person_beside_axis(
    readings: Readings, floor: Floor, mirrors: list[Mirror], intrinsics: Intrinsics, settings: ViewSettings
) -> DirectSubject | None:
    """The person at the image's side, on the line of sight by way of one mirror, where the camera does not look there.

    A camera that is turned away, or that has only one mirror in its picture, does not look at where they meet.
    """
    lines = reflected_sight(mirrors, intrinsics)
    if not lines:
        return None
    places = np.concatenate([middle + _ALONG_SIGHT[:, None] * direction for middle, direction in lines])
    pieces, _ = standing_pieces(readings, range(1), replace(floor, center=None), ROUGH, settings)
    areas = figure_areas(pieces, places, settings)
    best = int(np.argmax(areas))
    if areas[best] <= 0.0:
        return None
    found = find_person(readings, replace(floor, center=places[best]), None, settings)
    if found is None or not _is_on_line(found.middle(), lines, readings.up):
        return None
    return found if np.ptp(dot(readings.points[found.labels() == 0], readings.up)) > _TALL else None


def _is_on_line(place: np.ndarray, lines: list[tuple[np.ndarray, np.ndarray]], up: np.ndarray) -> bool:
    """Whether a place is near one of some lines, seen from above."""
    level = horizontal_projection(up)
    across = [np.cross(up, direction) / np.linalg.norm(level @ direction) for _, direction in lines]
    return any(abs(float((place - point) @ side)) < _OFF_SIGHT for (point, _), side in zip(lines, across, strict=True))


def figures_at(
    image: RgbdImage, mirrors: list[Mirror], places: np.ndarray, settings: ViewSettings = DEFAULTS
) -> np.ndarray:
    """How large the figure is that the camera sees directly at each of some places (K, 3), camera frame [m].

    Returns
    -------
    np.ndarray [shape=(K,)]
        [m²]; 0 where nothing stands.
    """
    depth, intrinsics = image.depth, image.intrinsics
    seen, points = sort_rays(unproject(depth, intrinsics), mirrors, settings.depth_limit, settings.near)
    ground = find_ground(points, seen, mirrors)
    readings = Readings(depth, seen, points, ground.up, 1.0 / intrinsics.fx)
    floor = Floor(ground.floor, None, True, 0.9 * settings.reach, np.inf)
    pieces, _ = standing_pieces(readings, range(1), floor, ROUGH, settings)
    return figure_areas(pieces, places, settings)


def _without_empty_views(
    labels: np.ndarray, taken: np.ndarray, mirrors: list[Mirror], settings: ViewSettings
) -> tuple[str, ...]:
    """Warnings of mirrors that show too few pixels (N+1,) of the subject; these pixels are taken out of ``labels``."""
    warnings = []
    for i, m in enumerate(mirrors, start=1):
        if taken[i] < settings.min_pixels:
            labels[labels == i] = -1
            warnings.append(
                Notice(
                    "{name}: nobody is seen in this mirror, its side of the body is guessed; turn the mirror until the "
                    "camera sees the subject's back in it",
                    name=m.name, mirrors=[m.name],
                )
            )  # fmt: skip
    return tuple(warnings)


def _nobody(settings: ViewSettings) -> str:
    if settings.click is not None:
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
        raise ReconstructionError(
            f"the click ({u:g}, {v:g}) is outside the {width}×{height} depth image", code="nobody"
        )
    row, column, r = int(round(v)), int(round(u)), _CLICK_RADIUS
    top, left = max(row - r, 0), max(column - r, 0)
    rows, columns = np.nonzero(seen[top : row + r + 1, left : column + r + 1] >= 0)
    if not len(rows):
        raise ReconstructionError(
            f"there is no reading within {r} px of the click ({u:g}, {v:g}); click where the depth image shows the "
            "subject",
            code="nobody",
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
