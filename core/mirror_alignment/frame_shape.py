"""How flat a mirror's frame is: its bow, and what else its readings are off the plane by more than noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..camera import RgbdImage, project
from ..errors import Notice
from ..mirrors.curved_glass import bow_profile
from ..mirrors.disparity_plane import BLOCK, erosion
from ..mirrors.mirror import Mirror, expected_error, long_axis, seen_extent
from ..mirrors.wall_behind_frame import on_wall
from .pose_solver import MAD

_OUTSIDE, _INSIDE = 0.01, 0.08  # about the glass's rectangle the frame is looked for [m]
_WALL = 0.06  # the same about a mirror that hangs on a wall [m]
_TUKEY = 4.7
_ROUNDS = 6  # of weighing the blocks anew
_FEWEST_BLOCKS = 24  # fewer say nothing of a bow
_PARTS = 16  # of the frame, by the direction from its middle, whose means are compared
_COMMON = 0.06  # of a reading's noise, that a part of the frame errs in common
_BEST_REACH = 0.6  # of the longer side must be seen, else no bow can be distinguished from a slope


@dataclass(frozen=True)
class FrameShape:
    """A frame's readings against its plane.

    Parameters
    ----------
    step : np.ndarray [shape=(4,)]
        What the plane's two slopes [rad], its shift [m] and the sag [m] should change by, fitted together.
    covariance : np.ndarray [shape=(4, 4)]
        Of these.
    unevenness : float
        By how much parts of the frame are off plane and bow, root mean square, without what noise explains [m].
    noise : float
        Standard deviation of a reading about its neighbours' mean [m].
    """

    step: np.ndarray
    covariance: np.ndarray
    unevenness: float
    noise: float

    @property
    def sag(self) -> float:
        """Of the frame, see :attr:`.mirror.Mirror.sag` [m]."""
        return float(self.step[3])

    @property
    def sag_error(self) -> float:
        """Of :attr:`sag`, one standard deviation [m]."""
        return float(np.sqrt(self.covariance[3, 3]))


def frame_shape(image: RgbdImage, mirror: Mirror) -> FrameShape | None:
    """The shape of the frame by its own readings.

    A camera's smooth depth warp looks the same in them: see :mod:`.glass_alignment` for what tells both apart.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m], 0 = no reading.
    mirror : Mirror
        On its frame's plane.

    Returns
    -------
    FrameShape or None
        Of a mirror that hangs on a wall it is the wall's about it. None where not enough is seen.
    """
    if mirror.rectangle is None or mirror.polygon is not None or not mirror.refined:
        return None
    found = _frame_blocks(image, mirror, _WALL if on_wall(mirror) else _OUTSIDE)
    if found is None:
        return None
    place, lift, count, noise = found
    axis, _, length = long_axis(mirror)
    if np.ptp(place[:, axis]) < _BEST_REACH * length:
        return None
    rows = np.column_stack((place, np.ones(len(place)), bow_profile(mirror, place[:, axis])))
    weights, left = count.copy(), lift
    for _ in range(_ROUNDS):
        normal = (rows * weights[:, None]).T @ rows
        if np.linalg.cond(normal) > 1e8:
            return None
        step = np.linalg.solve(normal, (rows * weights[:, None]).T @ lift)
        left = lift - rows @ step
        scale = MAD * float(np.median(np.abs(left) * np.sqrt(count))) + 1e-9
        share = 1.0 - (left * np.sqrt(count) / (_TUKEY * scale)) ** 2
        weights = count * np.where(share > 0.0, share, 0.0) ** 2
    part = _parts(place, mirror)
    bread = np.linalg.inv(normal)
    scores = np.zeros((4, 4))
    misfit, expected, weight = 0.0, 0.0, 0.0
    for k in range(_PARTS):
        mine = (part == k) & (weights > 0.0)
        total = weights[mine].sum()
        if total == 0.0:
            continue
        score = (weights[mine, None] * rows[mine]).T @ left[mine]
        common = _COMMON * noise * (weights[mine, None] * rows[mine]).sum(axis=0)
        scores += np.outer(score, score) + np.outer(common, common)
        # all blocks of the part count, as far as they were taken for the frame's
        mean = float(np.average(left[part == k], weights=np.minimum(count[part == k], 50.0)))
        misfit += mean**2
        expected += scale**2 / total + (_COMMON * noise) ** 2
        weight += 1.0
    if weight < _PARTS // 2:
        return None
    uneven = float(np.sqrt(max(misfit / weight - 2.0 * expected / weight, 0.0)))
    return FrameShape(step, bread @ scores @ bread * weight / max(weight - 4.0, 1.0), uneven, noise)


def _parts(place: np.ndarray, mirror: Mirror) -> np.ndarray:
    """Which part of the frame each place (N, 2) on the plane is of."""
    seen = seen_extent(mirror)
    middle, size = seen.mean(axis=1), np.diff(seen, axis=1)[:, 0]
    x, y = ((place - middle) / size).T
    return ((np.arctan2(y, x) / (2.0 * np.pi) + 0.5) * _PARTS).astype(int) % _PARTS


def _frame_blocks(
    image: RgbdImage, mirror: Mirror, outside: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float] | None:
    """Blocks of the frame's readings: places (N, 2), how far before the plane (N,), how many (N,), and their noise."""
    depth, intrinsics = image.depth, image.intrinsics
    assert mirror.rectangle is not None  # it was asked for
    outer = seen_extent(mirror) + np.array((-outside, outside))
    corners = np.array([(x, y) for x in outer[0] for y in outer[1]])
    box = project(mirror.point + corners @ mirror.basis[:, :2].T, intrinsics)
    size = np.array((intrinsics.width, intrinsics.height))
    if not np.isfinite(box).all():
        return None
    (left, top), (right, bottom) = (
        np.clip(np.floor(box.min(axis=0)), 0, size).astype(int),
        np.clip(np.ceil(box.max(axis=0)) + 1, 0, size).astype(int),
    )
    z = depth[top:bottom, left:right]
    rows, columns = np.nonzero(z)
    z = z[rows, columns].astype(np.float64)
    x, y = (columns + left - intrinsics.cx) / intrinsics.fx, (rows + top - intrinsics.cy) / intrinsics.fy
    n, d = mirror.normal, float(mirror.normal @ mirror.point)
    band = max(5.0 * mirror.residual, 0.012)
    near = np.abs((n[0] * x + n[1] * y + n[2]) * z - d) < band
    rows, columns, z, x, y = rows[near], columns[near], z[near], x[near], y[near]
    offset = np.column_stack((x * z, y * z, z)) - mirror.point
    place, lift = offset @ mirror.basis[:, :2], offset @ n
    beyond = ((place < outer[:, 0]) | (place > outer[:, 1])).any(axis=1)
    inner = mirror.rectangle + np.array((_INSIDE, -_INSIDE))
    inside = ((place > inner[:, 0]) & (place < inner[:, 1])).all(axis=1)
    kept = ~beyond & ~inside
    rows, columns, place, lift = rows[kept], columns[kept], place[kept], lift[kept]
    if len(rows) < 200:
        return None
    mask = np.zeros((bottom - top, right - left), np.bool_)
    mask[rows, columns] = True
    ring = erosion(mask)[rows, columns]
    levels = np.array([(ring > k).sum() for k in range(3)])
    core = ring > (2 if levels[2] > max(0.25 * levels[0], 200) else 1 if levels[1] > max(0.25 * levels[0], 200) else 0)
    rows, columns, place, lift = rows[core], columns[core], place[core], lift[core]
    cell = rows // BLOCK * (mask.shape[1] // BLOCK + 1) + columns // BLOCK
    _, member, count = np.unique(cell, return_inverse=True, return_counts=True)
    many = np.flatnonzero(count > 3)
    if len(many) < _FEWEST_BLOCKS:
        return None
    means = np.column_stack([np.bincount(member, value, len(count)) / count for value in (*place.T, lift)])
    noise = MAD * float(np.median(np.abs(lift - means[member, 2])))
    return means[many, :2], means[many, 2], count[many].astype(float), noise


def honest_error(image: RgbdImage, mirror: Mirror, alike: float = 1.0) -> tuple[Mirror, Notice | None]:
    """The mirror with what its frame is uneven by in its error, and a warning, where that is far above noise.

    A plane through what is no plane has a small formal error: noise averages out, a wrong model does not. Nor does
    noise average out that is alike over a matching window, which may be as wide as the frame.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m], 0 = no reading.
    mirror : Mirror
        On its frame's plane.
    alike : float
        Readings in a square of so many px err alike, see :class:`.view_correspondences.ReadingNoise`.
    """
    shape = frame_shape(image, mirror) if mirror.covariance is not None else None
    if shape is None:
        return mirror, None
    if alike > 1.0 and not on_wall(mirror):
        mirror = _less_sure(mirror, shape)
    wall = on_wall(mirror)
    bent = abs(shape.sag) * np.sqrt(_BENT_SQUARE) if wall else 0.0  # glass does not bend with the wall it hangs on
    uneven = float(np.hypot(shape.unevenness, bent))
    if uneven < max(_UNEVEN, _UNEVEN_NOISES * shape.noise):
        return mirror, None
    axis, _, length = long_axis(mirror)
    extra = shape.covariance[:3, :3].copy()
    if wall:
        extra[axis, axis] += (4.0 * shape.sag / length) ** 2 / 3.0
    assert mirror.covariance is not None  # else it has no shape
    doubted = replace(mirror, covariance=mirror.covariance + extra)
    return doubted, Notice(
        "{name}: {what} by {uneven:.0f} mm, far more than the camera's noise, so that its reflection may be off by "
        "{error:.0f} mm; see that nothing covers or bends the frame and that every pick is on it, or, for a mirror on "
        "a wall, give it a frame that stands 2 cm off the wall",
        name=mirror.name, uneven=1000.0 * uneven, error=1000.0 * expected_error(doubted), mirrors=[mirror.name],
        what=Notice("the wall it hangs on is uneven") if wall else Notice("its frame is uneven"),
    )  # fmt: skip


def _less_sure(mirror: Mirror, shape: FrameShape) -> Mirror:
    """As sure as parts of its frame agree, each of them longer than a matching window, and as glass is flat."""
    information = np.linalg.inv(shape.covariance)
    information[3, 3] += _USUAL_SAG**-2
    covariance = np.linalg.inv(information)
    less = replace(mirror, covariance=covariance[:3, :3], sag_error=float(np.sqrt(covariance[3, 3])))
    return less if expected_error(less) > expected_error(mirror) else mirror


_USUAL_SAG = 0.0012  # of mirrors as they are sold, one standard deviation [m]
_UNEVEN, _UNEVEN_NOISES = 0.0025, 0.6  # [m], and of a reading's noise
_BENT_SQUARE = 4.0 / 45.0  # mean square of the bow's profile over its length
