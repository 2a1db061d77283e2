"""The floor as seen directly and in a mirror is one floor: mirrors tilted until it is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from ..camera import Intrinsics
from ..mirrors import Mirror
from ..mirrors.mirror import (
    expected_error,
    moved,
    person_before,
    reflect,
    reflection_matrix,
    reflection_moves,
    with_reason,
)
from ..numeric.point_products import dot, lay_grid
from ..views.floor_and_vertical import find_ground, vertical
from ..views.ray_sorting import sort_rays


@dataclass(frozen=True)
class FloorSettings:
    """When the floor may tilt the mirrors.

    Parameters
    ----------
    use : bool
        Off leaves the planes where their frames are.
    unsure : float
        Only mirrors that are expected to misplace a person by more than this are tilted [m].
    height, slope : float
        How far a floor and the depth of it may be off a plane, however long the burst: one standard deviation [m], and
        of its slope [rad]. Mirrors whose frames tell the height of the floor they show better than that stay.
    gain : float
        The step is made only when the log likelihood of floor it was not fitted to grows by this much.
    """

    use: bool = True
    unsure: float = 0.0015
    height: float = 0.003
    slope: float = 0.002
    gain: float = 0.5


_SHARED = 10.0  # neighbouring readings share so much of their errors that this many count as one
_FEW = 40  # readings of a floor that say too little
_ENOUGH = 110000  # pixels that are asked
_CELL, _CELLS, _NEAR = 0.05, 400, 3  # of the floor plan [m]; cells each way; cells about a reading
_EYE = 0.2  # a floor is not judged from lower above it [m]
_BLOCK = 24  # pixels; halves are split by such


def level_floor(
    mirrors: list[Mirror], depth: np.ndarray, intrinsics: Intrinsics, settings: FloorSettings | None = None
) -> list[Mirror]:
    """Mirrors moved until the floor they show lies in the floor that is seen directly.

    That fixes what turns and lifts the floor: of a mirror that stands on it, how far it leans. The distance of the
    reflected floor from the direct one is a plane of three numbers, whose covariance is that of both fits; it joins the
    covariance of the mirror's frame. The floor is split into two sets of image blocks; what one asks for must make the
    other more likely, or the mirror stays.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        Fused depth, z [m].

    Notes
    -----
    O(pixels), some 40 ms for 848×480; nothing is done while every frame is sure enough.
    """
    settings = settings or FloorSettings()
    if not settings.use:
        return list(mirrors)
    up = vertical(mirrors)
    unsure = [
        m.covariance is not None
        and m.source != "rig file"
        and expected_error(m) > settings.unsure
        and _lift(m, up) > settings.height  # else the frame knows it better than the floor
        for m in mirrors
    ]
    if not any(unsure):
        return list(mirrors)
    stride = int(np.ceil(np.sqrt(depth.size / _ENOUGH)))
    thin = np.ascontiguousarray(depth[::stride, ::stride])
    cloud = lay_grid(thin, *(x / stride for x in intrinsics.lens))
    seen, placed = sort_rays(cloud, mirrors)
    ground = find_ground(placed, np.where(seen > 0, -1, seen).astype(seen.dtype), mirrors)
    if ground.floor is None or ground.floor > -_EYE:
        return list(mirrors)
    rows, columns = np.indices(seen.shape) * stride // _BLOCK
    half = (rows + columns) % 2
    band = max(4.0 * ground.noise, 0.015)
    direct = (seen == 0) & (np.abs(dot(placed, ground.up) - ground.floor) < band)
    if direct.sum() < 2 * _FEW:
        return list(mirrors)
    floor = _Floor(ground.up, ground.floor, cloud[direct], half[direct], settings)
    common = floor.common(placed, seen)
    out = []
    for k, (mirror, doubt) in enumerate(zip(mirrors, unsure, strict=True)):
        shown = (seen == k + 1) & common
        better = _levelled(mirror, floor, cloud[shown], half[shown], settings) if doubt else None
        out.append(mirror if better is None else with_reason(better, mirror, "floor"))
    return out


class _Floor:
    """The floor up·p = height as seen directly: ``points`` (N, 3) and the ``half`` (N,) each is of."""

    def __init__(
        self, up: np.ndarray, height: float, points: np.ndarray, half: np.ndarray, settings: FloorSettings
    ) -> None:
        self.up, self.height = up, height
        self.known = np.diag((settings.height, settings.slope, settings.slope)) ** 2
        along = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
        along /= np.linalg.norm(along)
        self.level = np.stack((along, np.cross(along, up)))
        self.center = points.mean(axis=0)
        lifts, feet = self.above(points, np.eye(4))
        self.fits = {
            which: self.fit(lifts[mine], feet[mine], points[mine][:, 2], self.center)
            for which, mine in ((-1, slice(None)), (0, half == 0), (1, half == 1))
        }

    def above(self, points: np.ndarray, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far ``points`` (N, 3), flipped by ``matrix``, lie above the floor, and where their rays meet it, not
        flipped. To first order the height; linear in 1/z, so that noise of 1/z makes no bias."""
        normal = self.up @ matrix[:3, :3]
        eye = self.height - self.up @ matrix[:3, 3]  # the floor is normal·p = eye
        reach = dot(points, normal)
        ahead = np.where(reach * eye > 1e-6, eye / np.where(reach == 0.0, 1.0, reach), np.inf)  # else: from under it
        return eye * (1.0 - ahead), points * np.where(np.isfinite(ahead), ahead, 1.0)[:, None]

    def common(self, placed: np.ndarray, seen: np.ndarray) -> np.ndarray:
        """Which of the readings ``placed`` (H, W, 3), where they are, lie over floor that is seen directly too, clear
        of what stands on it, such as feet: (H, W)."""
        heights = dot(placed, self.up) - self.height
        cells = np.stack([np.floor(dot(placed, self.level[k]) / _CELL).astype(np.int64) for k in (0, 1)])
        cells = np.clip(cells + _CELLS // 2, 0, _CELLS - 1)
        cells = cells[0] * _CELLS + cells[1]
        noise = self.fits[-1][3] if self.fits[-1] is not None else 0.0
        flat = np.maximum(4.0 * noise * placed[..., 2], 0.03)

        def about(chosen: np.ndarray, few: int) -> np.ndarray:
            near = np.bincount(cells[chosen], minlength=_CELLS**2).reshape(_CELLS, _CELLS) >= few
            for axis in (0, 1):
                near = np.any([np.roll(near, k, axis) for k in range(-_NEAR, _NEAR + 1)], axis=0)
            return near.reshape(-1)

        floor = about((seen == 0) & (np.abs(heights) < flat), 1)
        things = about((seen == 0) & (heights > flat) & (heights < 0.6), 3)
        return (floor & ~things)[cells]

    def fit(self, lifts: np.ndarray, feet: np.ndarray, spread: np.ndarray, center: np.ndarray) -> tuple | None:
        """The plane through ``lifts`` (N,) over ``feet`` (N, 3): height at ``center`` and two slopes, their covariance,
        what maps values to such three numbers, (3, N), and the noise in units of ``spread`` (N,)."""
        if len(lifts) < _FEW:
            return None
        x, y = (dot(feet, level) - level @ center for level in self.level)
        left = lifts - np.median(lifts)
        w = np.empty(len(lifts))
        for _ in range(3):
            noise = max(1.4826 * float(np.median(np.abs(left / spread))), 1e-6)
            normal, right = _tukey_equations(lifts, x, y, left, noise * spread, w)
            if np.linalg.cond(normal) > 1e8:
                return None
            inverse = np.linalg.inv(normal)
            three = inverse @ right
            left = lifts - (three[0] + three[1] * x + three[2] * y)
        return three, _SHARED * inverse, np.einsum("ij,jn->in", inverse, np.stack((w, w * x, w * y))), noise

    def apart(self, mirror: Mirror, laid: np.ndarray, gate: float, which: int) -> tuple | None:
        """How far the floor that the mirror shows, ``laid`` (N, 3) behind the glass, lies above this one: height and
        slopes (3,), their covariance, and how they change with the mirror's slopes and shift (3, 3)."""
        if self.fits[which] is None:
            return None
        own, covariance, _, noise = self.fits[which]
        matrix = reflection_matrix(mirror)
        lifts, feet = self.above(laid, matrix)
        near = np.abs(lifts) < np.maximum(gate, 4.0 * noise * feet[:, 2])
        if near.sum() < _FEW:
            return None
        feet = feet[near]
        there = reflect(feet, mirror)
        center = there.mean(axis=0)
        # an error of 1/z lifts a reading by as much times z and the height of the eye, which is one for all
        shown = self.fit(lifts[near], there, feet[:, 2], center)
        if shown is None:
            return None
        moves = np.einsum("nci,c->ni", reflection_moves(mirror, feet), self.up)
        carry = np.eye(3)
        carry[0, 1:] = self.level @ (center - self.center)
        return (
            shown[0] - carry @ own,
            shown[1] + carry @ covariance @ carry.T + self.known,
            np.einsum("in,nj->ij", shown[2], moves),
        )


def _lift(mirror: Mirror, up: np.ndarray) -> float:
    """How far the floor about a person before the mirror may well be shown too high or too low [m]."""
    moves = np.einsum("nci,c->ni", reflection_moves(mirror, person_before(mirror)), up)
    return float(np.sqrt(np.einsum("ni,ij,nj->n", moves, mirror.covariance, moves).mean()))


def _levelled(
    mirror: Mirror, floor: _Floor, laid: np.ndarray, half: np.ndarray, settings: FloorSettings
) -> Mirror | None:
    prior = np.linalg.inv(mirror.covariance)
    parts = {-1: laid, 0: laid[half == 0], 1: laid[half == 1]}
    gate = float(np.clip(4.0 * _lift(mirror, floor.up) + 0.02, 0.05, 0.17))

    def fit(which: int) -> tuple[np.ndarray, np.ndarray] | None:
        step = np.zeros(3)
        for turn in range(3):
            told = floor.apart(moved(mirror, step), parts[which], gate if turn == 0 else 0.05, which)
            if told is None:
                return None
            three, covariance, change = told
            weighed = np.linalg.solve(covariance, change)
            information = change.T @ weighed + prior
            step = step - np.linalg.solve(information, weighed.T @ three + prior @ step)
        return step, np.linalg.inv(information)

    def unlikely(step: np.ndarray, which: int) -> float:
        told = floor.apart(moved(mirror, step), parts[which], gate, which)
        return np.inf if told is None else 0.5 * float(told[0] @ np.linalg.solve(told[1], told[0]))

    whole = fit(-1)
    halves = [fit(0), fit(1)]
    if whole is None or None in halves:
        return None
    gains = [unlikely(np.zeros(3), k) - unlikely(halves[1 - k][0], k) for k in (0, 1)]
    if not (min(gains) >= 0.0 and sum(gains) >= settings.gain):
        return None
    return replace(moved(mirror, whole[0]), covariance=whole[1])


@njit(cache=True, nogil=True)
def _tukey_equations(lifts, x, y, left, noise, w):
    """Normal equations (3, 3) and (3,) of the plane a + b x + c y through ``lifts`` (N,), with Tukey's weights, into
    ``w`` (N,), of what is ``left``: feet and things on the floor are no part of it."""
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for i in range(len(lifts)):
        share = 1.0 - (left[i] / (3.0 * noise[i])) ** 2
        w[i] = (share / noise[i]) ** 2 if share > 0.0 else 0.0
        normal[0, 0] += w[i]
        normal[0, 1] += w[i] * x[i]
        normal[0, 2] += w[i] * y[i]
        normal[1, 1] += w[i] * x[i] * x[i]
        normal[1, 2] += w[i] * x[i] * y[i]
        normal[2, 2] += w[i] * y[i] * y[i]
        right[0] += w[i] * lifts[i]
        right[1] += w[i] * lifts[i] * x[i]
        right[2] += w[i] * lifts[i] * y[i]
    for a in range(3):
        for b in range(a):
            normal[a, b] = normal[b, a]
    return normal, right
