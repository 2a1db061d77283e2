"""Where a mirror ought to show the subject, by what the other views see of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..camera import RgbdImage, project
from ..mirrors import Mirror
from ..mirrors.glass_extent import glass_corners
from ..mirrors.mirror import reflection_matrix
from ..numeric.point_products import dot, transform
from ..subject.subject_views import Views

_WIDEST_FRAME, _IN_PLANE = 0.15, 0.02  # of a mirror [m]; how near to its plane that is read, of z
_NEAREST = 0.1  # m: what is nearer to the camera, along z, is not projected
_TRUNK = 0.24  # from the body's middle: what is farther off is an arm [m]


@dataclass(frozen=True)
class Reflection:
    """Where the subject's reflection in a mirror ought to be: shares of its points that other views show.

    ``over_glass``, ``over_image``: how far the subject reaches over the left, right, top and bottom edge of the glass
    [m on the mirror] and of the image [m at the subject], negative = room to spare; ``out``: share past the glass;
    ``seen``: share inside both; ``hidden``: share of all that is behind the subject's own body, and ``blocked``: behind
    something else; ``arms``: how much of ``hidden`` is behind what is held off the trunk; ``unread``: share of what is
    inside both without a reading; ``distance``: median z along the folded path [m].
    """

    over_glass: dict[str, float]
    over_image: dict[str, float]
    out: float
    seen: float
    hidden: float
    blocked: float
    arms: float
    unread: float
    distance: float


def thinned(views: Views, which: np.ndarray) -> np.ndarray:
    """Some thousand points (N, 3) of the pixels that are meant (H, W)."""
    mine = np.flatnonzero(which)
    return views.points.reshape(-1, 3)[mine[:: len(mine) // 4000 + 1]]


def foresee(image: RgbdImage, subject: np.ndarray, views: Views, mirror: Mirror) -> Reflection:
    """Where the mirror ought to show the subject, by points of it that other views show.

    Parameters
    ----------
    subject : np.ndarray [shape=(N, 3)]
        These points, N > 0, camera frame [m].
    image : RgbdImage
        z [m], 0 = no reading.
    views : Views
    mirror : Mirror
    """
    depth, intrinsics = image.depth, image.intrinsics
    k = intrinsics
    reflected, a, b, through = reflections_on_mirror(subject, mirror)
    ahead = reflected[:, 2] > _NEAREST
    z = np.where(ahead, reflected[:, 2], 1.0)
    u, v = reflected[:, 0] / z * k.fx + k.cx, reflected[:, 1] / z * k.fy + k.cy
    within = (u >= 0) & (v >= 0) & (u <= k.width - 1) & (v <= k.height - 1)
    row, column = (np.rint(np.where(within, x, 0.0)).astype(int) for x in (v, u))
    masked = within & ahead & (views.labels[row, column] == 0)
    over_glass, out = dict.fromkeys(("left", "right", "top", "bottom"), -np.inf), 0.0
    corners = glass_corners(mirror)
    if corners is not None:
        (a0, b0), (a1, b1) = corners.min(axis=0), corners.max(axis=0)
        # where the edge is behind the subject itself, how far the glass goes on is not known
        edge = project(
            mirror.point + np.column_stack((np.clip(a, a0, a1), np.clip(b, b0, b1))) @ mirror.basis[:, :2].T, k
        )  # fmt: skip
        edge = np.rint(np.clip(np.nan_to_num(edge), 0, (k.width - 1, k.height - 1))).astype(int)
        masked &= views.labels[edge[:, 1], edge[:, 0]] == 0
        shown = masked | ((a > a0) & (a < a1) & (b > b0) & (b < b1))
        through, out = through & shown, float((ahead & ~shown).mean())
        over_glass = reach_beyond_edges({
            side: np.where(masked, np.minimum(value, 0.0), np.where(ahead, value, np.inf))
            for side, value in distance_past_edges(a, b, corners).items()
        })  # fmt: skip
    per_pixel = z / k.fx
    over_image = reach_beyond_edges({
        "left": -u * per_pixel, "right": (u - k.width + 1) * per_pixel,
        "top": -v * per_pixel, "bottom": (v - k.height + 1) * per_pixel,
    })  # fmt: skip
    inside = through & within
    row, column = row[inside], column[inside]
    label, reading = views.labels[row, column], depth[row, column]
    hidden = label == 0
    blocked = ~hidden & (reading > 0) & (views.seen[row, column] == 0)
    across = np.cross(views.up, views.axis)
    aside = dot(views.points[row[hidden], column[hidden]] - views.axis, across / np.linalg.norm(across))
    unread = reading == 0
    return Reflection(
        over_glass, over_image, out, float(inside.mean()), float(hidden.sum() / len(subject)),
        float(blocked.sum() / len(subject)), float((np.abs(aside) > _TRUNK).sum() / max(len(aside), 1)),
        float(unread.sum() / max(int(inside.sum()), 1)), float(np.median(z)),
    )  # fmt: skip


def without_frame(image: RgbdImage, mirror: Mirror, views: Views) -> Mirror:
    """The mirror whose rectangle ends where its frame begins: up to there readings lie in its plane."""
    depth, intrinsics = image.depth, image.intrinsics
    if mirror.rectangle is None or mirror.polygon is not None:
        return mirror
    height, width = depth.shape
    rectangle = np.array(mirror.rectangle, dtype=np.float64)
    steps = np.arange(0.0, _WIDEST_FRAME, 0.004)
    for axis in range(2):
        low, high = np.clip(mirror.rectangle[1 - axis], -2.0, 2.0)
        along = np.linspace(low, high, 62)[6:-6]
        for end, way in ((0, 1.0), (1, -1.0)):
            place = np.empty((len(steps), len(along), 2))
            place[..., axis], place[..., 1 - axis] = (mirror.rectangle[axis, end] + way * steps)[:, None], along
            on = mirror.point + place @ mirror.basis[:, :2].T
            pixel = np.rint(np.nan_to_num(project(on.reshape(-1, 3), intrinsics), nan=-1.0)).reshape(place.shape)
            u, v = pixel[..., 0], pixel[..., 1]
            free = (u >= 0) & (v >= 0) & (u < width) & (v < height)
            row, column = np.where(free, v, 0).astype(int), np.where(free, u, 0).astype(int)
            free &= views.labels[row, column] != 0
            frame = free & (np.abs(depth[row, column] - on[..., 2]) < _IN_PLANE * on[..., 2])
            free, frame = free.sum(axis=1), frame.sum(axis=1)
            moulding = (free >= 6) & (frame >= 0.5 * free)
            if moulding.any():
                first = int(np.argmax(moulding))  # the outermost pixels are often not read
                last = first + int(np.argmin(moulding[first:]))
                if not moulding[last]:
                    rectangle[axis, end] += way * steps[last]
    return replace(mirror, rectangle=rectangle)


def reflections_on_mirror(subject: np.ndarray, mirror: Mirror) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Reflections (N, 3) of points.

    Where their lines of sight meet the mirror's plane, along a and b (N,) [m]; and which of them (N,) meet it on their
    way.
    """
    reflected = transform(subject, reflection_matrix(mirror))
    share = (mirror.normal @ mirror.point) / dot(reflected, mirror.normal)
    on = reflected * share[:, None] - mirror.point
    through = (reflected[:, 2] > _NEAREST) & (share > 0) & (share < 1)
    return reflected, dot(on, mirror.basis[:, 0]), dot(on, mirror.basis[:, 1]), through


def distance_past_edges(a: np.ndarray, b: np.ndarray, corners: np.ndarray) -> dict[str, np.ndarray]:
    """How far places on a mirror (N,) are past each edge of its glass [m]."""
    (a0, b0), (a1, b1) = corners.min(axis=0), corners.max(axis=0)
    # seen by the camera a points left, b down
    return {"left": a - a1, "right": a0 - a, "top": b0 - b, "bottom": b - b1}


def reach_beyond_edges(distance: dict[str, np.ndarray]) -> dict[str, float]:
    """How far the subject reaches beyond each edge, but for its outermost hundredth [m]; negative = room to spare."""
    reach = np.quantile(np.stack(list(distance.values())), 0.99, axis=1)
    return dict(zip(distance, reach.tolist(), strict=True))
