"""Somebody who is seen directly, the room about them, and what of a glass shows their image."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..camera import Intrinsics, RgbdImage, project
from ..mirrors import Mirror
from ..mirrors.mirror import behind_glass
from ..numeric.point_products import dot, lay_grid
from ..views.floor_and_vertical import find_floor
from ..views.silhouette_contact import shadow_width
from ..views.view_correspondences import noise_of
from .mirrored_person import Figure, find_figures

_UP = np.array((0.0, -1.0, 0.0))
_MOST_PERSONS = 2  # that are tried
_FLAT = 0.009  # a person's front deviates from a plane by more, standard deviation [m]
_ARMS, _LEAST_PIECE = 0.95, 12  # no part of a person is farther from the middle [m]; readings of it, thinned
_BEHIND = 0.12  # behind the plane a reading is seen in the glass [m]
_THROUGH, _ON = (0.08, 0.02), (0.10, 0.45)  # before what is seen a flipped reading is a violation [m] and times z;
# and between so much before and behind it it is on the body [m]
_RAGGED = 3  # px by which silhouettes are ragged
_IMAGE_FARTHER, _MOST_NOISE = 2.2, 0.08  # times as far as a person is their image; noise there, at most [m]
_LEAST_HEIGHT = 0.45  # share of the person's height that readings of their image span
_AROUND = 0.12  # m about a person's place in which the image is looked for
LEAST_MET = 150
"""Readings of an image, in a large picture."""


@dataclass(frozen=True)
class Room:
    """What is known of the place before a mirror is looked at.

    The picture, the floor up·p = ``floor``, the pixels of a ``person`` (H, W) and those ``about`` them, and how wide
    shadows are.
    """

    image: RgbdImage
    up: np.ndarray
    floor: float
    figure: Figure
    person: np.ndarray
    about: np.ndarray
    shadow: float


def rooms_about_persons(image: RgbdImage, baseline: float | None = None) -> Iterable[Room]:
    """The room with each of those who may be a person, the largest first.

    ``baseline`` [m] is that of the camera, 0 where it has but one viewpoint, None where that is not known: its shadows
    tell.
    """
    depth = image.depth
    stride = max(1, round(np.sqrt(depth.size / 80000.0)))
    thin = np.ascontiguousarray(depth[::stride, ::stride])
    cloud = lay_grid(thin, *(x / stride for x in image.intrinsics.packed))
    points = cloud[thin > 0]
    ground = find_floor(points, _UP, 20.0) if len(points) else None
    if ground is None:
        return
    up, floor, _ = ground
    objects, figures = find_figures(thin, cloud, up, floor, [], _FLAT)
    sigma = noise_of(depth, np.where(depth > 0, 1, 0).astype(np.int8)).sigma
    for figure in figures[:_MOST_PERSONS]:
        pieces = _pieces_of(figure, objects, cloud, up)
        person = _all_pixels(pieces, thin, depth, stride)
        # noise at an image's distance, flipped, is an error sideways
        noise = 2.0 * sigma * (_IMAGE_FARTHER * figure.middle[2]) ** 2
        ragged = _RAGGED + int(min(noise, _MOST_NOISE) / figure.middle[2] * image.intrinsics.fx)
        about = person
        for axis in (0, 1):
            about = _spread_along(about, ragged, axis)
        focal = image.intrinsics.fx
        shadow = shadow_width(depth, focal) if baseline is None else focal * baseline
        yield Room(image, up, floor, figure, person, about, shadow)


def _spread_along(mask: np.ndarray, reach: int, axis: int) -> np.ndarray:
    """The mask and what is within ``reach`` pixels of it along an axis."""
    total = np.cumsum(np.pad(mask, [(reach + 1, reach) if k == axis else (0, 0) for k in (0, 1)]), axis=axis)
    size = mask.shape[axis]
    return np.take(total, np.arange(2 * reach + 1, size + 2 * reach + 1), axis) > np.take(total, np.arange(size), axis)


def _pieces_of(figure: Figure, objects: np.ndarray, cloud: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Pixels (H, W) of the thinned picture that are of a figure: of all objects within an arm's reach, torn as it is.

    An object that reaches beyond is another one.
    """
    away = cloud - figure.middle
    away = away - dot(away, up)[..., None] * up
    beyond = np.sqrt((away * away).sum(axis=-1)) > _ARMS
    inside = np.bincount(objects.ravel(), (~beyond).ravel(), objects.max() + 1)
    outside = np.bincount(objects.ravel(), beyond.ravel(), objects.max() + 1)
    whose = (inside >= _LEAST_PIECE) & (outside == 0)
    whose[0] = False
    whose[figure.id] = True
    return whose[objects]


def _all_pixels(thinned: np.ndarray, thin: np.ndarray, depth: np.ndarray, stride: int) -> np.ndarray:
    """The pixels (H, W) of the whole picture beside those of the ``thinned`` one, in like depth."""
    if stride == 1:
        return thinned
    height, width = depth.shape
    rows, columns = np.arange(height), np.arange(width)
    out = np.zeros(depth.shape, np.bool_)
    for down in (0, 1):
        for right in (0, 1):
            i = np.minimum(rows // stride + down, thin.shape[0] - 1)[:, None]
            j = np.minimum(columns // stride + right, thin.shape[1] - 1)[None, :]
            out |= thinned[i, j] & (np.abs(thin[i, j] - depth) < 0.02 + 0.005 * depth * depth)
    return out & (depth > 0)


def glass_pixels(mirror: Mirror, intrinsics: Intrinsics) -> np.ndarray:
    """Pixels (H, W) in which the mirror's glass is."""
    rays = lay_grid(np.ones((intrinsics.height, intrinsics.width), np.float32), *intrinsics.packed).reshape(-1, 3)
    return behind_glass(rays, [mirror], nearest=np.inf).reshape(intrinsics.height, intrinsics.width)


def span(room: Room) -> tuple[float, float]:
    """From where to where above the floor the person reaches [m]."""
    height = room.figure.points @ room.up - room.floor
    return float(np.quantile(height, 0.01)), float(np.quantile(height, 0.99))


def fate_on_person(points: np.ndarray, mirror: Mirror, room: Room) -> tuple[np.ndarray, np.ndarray]:
    """Which of ``points`` (N, 3), flipped over the mirror, are on the person, and which the camera looks through."""
    depth = room.image.depth
    ahead = (points - mirror.point) @ mirror.normal
    q = points - 2.0 * ahead[:, None] * mirror.normal
    pixels = project(q, room.image.intrinsics)
    size = np.array((depth.shape[1], depth.shape[0])) - 1
    inside = ((pixels >= 0) & (pixels <= size)).all(axis=1) & (q[:, 2] > 0.1) & (ahead < -_BEHIND)  # false where NaN
    column, row = np.rint(np.where(inside[:, None], pixels, 0.0)).astype(np.int64).T
    seen = depth[row, column]
    apart = q[:, 2] - seen
    on = inside & room.person[row, column] & (apart > -_ON[0]) & (apart < _ON[1])
    through = inside & (seen > 0) & (apart < -_THROUGH[0] - _THROUGH[1] * q[:, 2]) & ~room.about[row, column]
    return on, through


def views_of_person(mirror: Mirror, glass: np.ndarray, room: Room, most_wrong: float) -> np.ndarray | None:
    """View of each pixel (H, W) int8: 0 the person, 1 the image, else -1; None where that is not the person's image.

    At most a share ``most_wrong`` of the image may be where the camera looks through it.
    """
    depth, k = room.image.depth, room.image.intrinsics
    rows, columns = np.nonzero(glass & (depth > 0) & ~room.person)
    z = depth[rows, columns].astype(np.float64)
    points = np.column_stack(((columns - k.cx) / k.fx * z, (rows - k.cy) / k.fy * z, z))
    ahead = (points - mirror.point) @ mirror.normal
    q = points - 2.0 * ahead[:, None] * mirror.normal
    away = room.figure.points - room.figure.middle
    across = np.linalg.norm(away - (away @ room.up)[:, None] * room.up, axis=1)
    off = q - room.figure.middle
    height = q @ room.up - room.floor
    low, high = span(room)
    off = np.linalg.norm(off - (off @ room.up)[:, None] * room.up, axis=1)
    near = (ahead < -_BEHIND) & (off < across.max() + _AROUND) & (height > low) & (height < high + _AROUND)
    if near.sum() < max(LEAST_MET // (1 + 3 * (depth.size < 100_000)), 1):
        return None
    on, through = fate_on_person(points[near], mirror, room)
    spans = height[near][on]
    if through.sum() > most_wrong * near.sum() or on.sum() < 0.3 * near.sum():
        return None
    if len(spans) < 30 or np.quantile(spans, 0.98) - np.quantile(spans, 0.02) < _LEAST_HEIGHT * (high - low):
        return None
    seen = np.full(depth.shape, -1, np.int8)
    seen[room.person] = 0
    seen[rows[near], columns[near]] = 1
    return seen
