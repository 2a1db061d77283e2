"""The floor as seen directly and in a mirror is one floor: mirrors tilted until it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera import RgbdImage
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
from ..numeric.kernels import njit
from ..numeric.point_products import dot, lay_grid
from ..views.floor_and_vertical import find_ground, vertical
from ..views.ray_sorting import sort_rays
from .pose_solver import (
    ALL,
    MAD,
    NormalEquations,
    PoseFit,
    columns_of,
    confirmed_fit,
    corrected,
    correlated_equations,
    each_gains,
    frames_prior,
    solve_pose,
)


@dataclass(frozen=True)
class FloorSettings:
    """When the floor may tilt the mirrors.

    Parameters
    ----------
    use : bool
        Off leaves the planes where their frames are.
    uncertainty : float
        Only mirrors that are expected to misplace a person by more than this are tilted [m].
    height, slope : float
        How far a floor and the depth of it may be off a plane, however long the burst: one standard deviation [m], and
        of its slope [rad]. Mirrors whose frames tell the height of the floor they show better than that stay.
    gain : float
        The correction is made only when the log likelihood of floor it was not fitted to grows by this much.
    """

    use: bool = True
    uncertainty: float = 0.0015
    height: float = 0.003
    slope: float = 0.002
    gain: float = 0.5


_CORRELATED = 10.0  # neighbouring readings share so much of their errors that this many count as one
_FEWEST_READINGS = 40  # fewer say too little of a floor
_MOST_PIXELS = 110000  # that are used
_CELL, _CELLS, _NEAR = 0.05, 400, 3  # of the floor plan [m]; cells each way; cells about a reading
_LEAST_EYE_HEIGHT = 0.2  # from lower above it a floor is seen too flatly to be judged [m]
_BLOCK = 24  # pixels; halves are split by such
_NEAREST_GATE, _WIDEST_GATE = 0.05, 0.17  # in the first round, by how far the mirror may be off [m]
_LAST_GATE = 0.05  # in those after [m]
_NOISES = 4.0  # times the noise: what lies farther off the floor is not of it
_LEAST_BAND = 0.015  # about the floor, for its unevenness [m]
_LEAST_HEIGHT, _MOST_HEIGHT = 0.03, 0.6  # between which a reading is of an object that stands on the floor [m]
_ILL_CONDITIONED = 1e8  # condition number from which a plane's slopes are not known
_LEAST_NOISE = 1e-6  # of readings [1/m]
_TUKEY = 3.0  # times the noise: what lies farther off the plane has no weight
_RISING = 1e-6  # of a ray's fall towards the floor, times the eye's height: less meets it nowhere [m²]


def align_floor(
    image: RgbdImage, mirrors: list[Mirror], settings: FloorSettings | None = None, alike: float = 1.0
) -> tuple[list[Mirror], tuple[str, ...]]:
    """Mirrors moved until the floor they show lies in the floor that is seen directly.

    That corrects what tilts and lifts the floor: of a mirror that stands on it, how far it leans. The distance of the
    reflected floor from the direct one is a plane of three numbers, whose covariance is that of both fits; it joins the
    covariance of the mirror's frame. The floor is split into two sets of image blocks; what one asks for must make the
    other more likely, or the mirror stays.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m].
    alike : float
        Readings in a square of so many px err alike, see :class:`.view_correspondences.ReadingNoise`.

    Returns
    -------
    mirrors : list of Mirror
    notes : tuple of str
        None: the mirrors move within what their frames leave open.

    Notes
    -----
    O(pixels), some 40 ms for 848×480; nothing is done while every frame is certain enough.
    """
    depth, intrinsics = image.depth, image.intrinsics
    settings = settings or FloorSettings()
    if not settings.use:
        return list(mirrors), ()
    up = vertical(mirrors)
    uncertain = [
        m.covariance is not None
        and m.source != "rig file"
        and expected_error(m) > settings.uncertainty
        and _lift(m, up) > settings.height  # else the frame knows it better than the floor
        for m in mirrors
    ]
    if not any(uncertain):
        return list(mirrors), ()
    stride = int(np.ceil(np.sqrt(depth.size / _MOST_PIXELS)))
    thin = np.ascontiguousarray(depth[::stride, ::stride])
    cloud = lay_grid(thin, *(x / stride for x in intrinsics.packed))
    seen, placed = sort_rays(cloud, mirrors)
    ground = find_ground(placed, np.where(seen > 0, -1, seen).astype(seen.dtype), mirrors)
    if ground.floor is None or ground.floor > -_LEAST_EYE_HEIGHT:
        return list(mirrors), ()
    rows, columns = np.indices(seen.shape) * stride // _BLOCK
    half = (rows + columns) % 2
    band = max(_NOISES * ground.noise, _LEAST_BAND)
    direct = (seen == 0) & (np.abs(dot(placed, ground.up) - ground.floor) < band)
    if direct.sum() < 2 * _FEWEST_READINGS:
        return list(mirrors), ()
    correlated = max(_CORRELATED, (alike / stride) ** 2)
    floor = _Floor(ground.up, ground.floor, cloud[direct], half[direct], settings, correlated)
    common = floor.common(placed, seen)
    out = []
    for k, mirror in enumerate(mirrors):
        shown = (seen == k + 1) & common
        better = _levelled(mirror, floor, cloud[shown], half[shown], settings) if uncertain[k] else None
        out.append(mirror if better is None else with_reason(better, mirror, "floor"))
    return out, ()


class _Floor:
    """The floor up·p = height as seen directly: ``points`` (N, 3) and the ``half`` (N,) each is of.

    So many readings as are ``correlated`` count as one.
    """

    def __init__(
        self,
        up: np.ndarray,
        height: float,
        points: np.ndarray,
        half: np.ndarray,
        settings: FloorSettings,
        correlated: float,
    ) -> None:
        self.up, self.height, self.correlated = up, height, correlated
        self.known = np.diag((settings.height, settings.slope, settings.slope)) ** 2
        along = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
        along /= np.linalg.norm(along)
        self.level = np.stack((along, np.cross(along, up)))
        self.center = points.mean(axis=0)
        lifts, feet = self.above(points, np.eye(4))
        self.fits = {
            which: self.fit(lifts[mine], feet[mine], points[mine][:, 2], self.center)
            for which, mine in ((ALL, slice(None)), (0, half == 0), (1, half == 1))
        }

    def above(self, points: np.ndarray, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far ``points`` (N, 3), reflected by ``matrix``, lie above the floor, and where their rays meet it.

        Where they meet it is not reflected. The first is the height to first order; it is linear in 1/z, so that noise
        of 1/z causes no bias.
        """
        normal = self.up @ matrix[:3, :3]
        eye = self.height - self.up @ matrix[:3, 3]  # the floor is normal·p = eye
        reach = dot(points, normal)
        ahead = np.where(reach * eye > _RISING, eye / np.where(reach == 0.0, 1.0, reach), np.inf)  # else: from under it
        return eye * (1.0 - ahead), points * np.where(np.isfinite(ahead), ahead, 1.0)[:, None]

    def common(self, placed: np.ndarray, seen: np.ndarray) -> np.ndarray:
        """Which of the readings ``placed`` (H, W, 3) lie over floor that is seen directly too: (H, W).

        They are where they really are. Floor near something that stands on it, such as feet, is left out.
        """
        heights = dot(placed, self.up) - self.height
        cells = np.stack([np.floor(dot(placed, self.level[k]) / _CELL).astype(np.int64) for k in (0, 1)])
        cells = np.clip(cells + _CELLS // 2, 0, _CELLS - 1)
        cells = cells[0] * _CELLS + cells[1]
        fitted = self.fits[ALL]
        noise = 0.0 if fitted is None else fitted[3]
        flat = np.maximum(_NOISES * noise * placed[..., 2], _LEAST_HEIGHT)

        def about(chosen: np.ndarray, few: int) -> np.ndarray:
            near = np.bincount(cells[chosen], minlength=_CELLS**2).reshape(_CELLS, _CELLS) >= few
            for axis in (0, 1):
                near = np.any([np.roll(near, k, axis) for k in range(-_NEAR, _NEAR + 1)], axis=0)
            return near.reshape(-1)

        floor = about((seen == 0) & (np.abs(heights) < flat), 1)
        objects = about((seen == 0) & (heights > flat) & (heights < _MOST_HEIGHT), 3)
        return (floor & ~objects)[cells]

    def fit(self, lifts: np.ndarray, feet: np.ndarray, spread: np.ndarray, center: np.ndarray) -> tuple | None:
        """The plane through ``lifts`` (N,) over ``feet`` (N, 3).

        Height at ``center`` and two slopes, their covariance, what maps values to such three numbers, (3, N), and the
        noise in units of ``spread`` (N,).
        """
        if len(lifts) < _FEWEST_READINGS:
            return None
        x, y = (dot(feet, level) - level @ center for level in self.level)
        left = lifts - np.median(lifts)
        w = np.empty(len(lifts))
        for _ in range(3):
            noise = max(MAD * float(np.median(np.abs(left / spread))), _LEAST_NOISE)
            normal, right = _tukey_equations(lifts, x, y, left, noise * spread, w)
            if np.linalg.cond(normal) > _ILL_CONDITIONED:
                return None
            inverse = np.linalg.inv(normal)
            three = inverse @ right
            left = lifts - (three[0] + three[1] * x + three[2] * y)
        return three, self.correlated * inverse, np.einsum("ij,jn->in", inverse, np.stack((w, w * x, w * y))), noise

    def distance(self, mirror: Mirror, readings: np.ndarray, gate: float, which: int) -> tuple | None:
        """How far the floor that the mirror shows, ``readings`` (N, 3) behind the glass, lies above this one.

        Height and slopes (3,), their covariance, and how they change with the mirror's slopes and shift (3, 3).
        """
        fitted = self.fits[which]
        if fitted is None:
            return None
        own, covariance, _, noise = fitted
        matrix = reflection_matrix(mirror)
        lifts, feet = self.above(readings, matrix)
        near = np.abs(lifts) < np.maximum(gate, _NOISES * noise * feet[:, 2])
        if near.sum() < _FEWEST_READINGS:
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
    """Standard deviation of the height at which the mirror shows the floor about a person in front of it [m]."""
    assert mirror.covariance is not None  # else it is not moved
    moves = np.einsum("nci,c->ni", reflection_moves(mirror, person_before(mirror)), up)
    return float(np.sqrt(np.einsum("ni,ij,nj->n", moves, mirror.covariance, moves).mean()))


def _levelled(
    mirror: Mirror, floor: _Floor, readings: np.ndarray, half: np.ndarray, settings: FloorSettings
) -> Mirror | None:
    """The mirror moved until the floor it shows, ``readings`` (N, 3) as the camera sees them, is ``floor``.

    None when the ``half`` (N,) that each is of does not confirm the other.
    """
    prior = frames_prior([mirror])
    parts = {ALL: readings, 0: readings[half == 0], 1: readings[half == 1]}
    gate = float(np.clip(4.0 * _lift(mirror, floor.up) + 0.02, _NEAREST_GATE, _WIDEST_GATE))

    def fit(which: int, _: PoseFit | None) -> PoseFit | None:
        def observe(correction: np.ndarray, gate: float) -> list[NormalEquations] | None:
            found = floor.distance(moved(mirror, correction), parts[which], gate, which)
            if found is None:
                return None
            plane, covariance, change = found
            return [correlated_equations(change, -plane, covariance)]

        return solve_pose(observe, prior, (gate, _LAST_GATE, _LAST_GATE))

    def cost(correction: np.ndarray, half: int) -> float:
        """Negative log likelihood of the half of the floor."""
        found = floor.distance(moved(mirror, correction), parts[half], gate, half)
        return np.inf if found is None else 0.5 * float(found[0] @ np.linalg.solve(found[1], found[0]))

    found = confirmed_fit(fit, cost, lambda before, after: each_gains(before, after, settings.gain))
    if found is None:
        return None
    whole, _ = found
    return corrected([mirror], columns_of([0]), whole.correction, whole.covariance)[0]


@njit(cache=True, nogil=True)
def _tukey_equations(lifts, x, y, left, noise, w):
    """Normal equations (3, 3) and (3,) of the plane a + b x + c y through ``lifts`` (N,), with Tukey's weights.

    The weights of the residuals ``left`` (N,) are written into ``w`` (N,); feet and objects on the floor get none.
    """
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for i in range(len(lifts)):
        share = 1.0 - (left[i] / (_TUKEY * noise[i])) ** 2
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
