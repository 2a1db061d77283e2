"""Bowed mirrors: what the frame says of a bow, where what is seen twice confirms it.

A smooth warp of a camera's depth bends a frame's readings exactly as a bowed mirror does. What both do to the
reflection differs tenfold: a bow of 2 mm moves it by 18 mm at its ends, a warp by its own size. So skin that is seen
twice, and the floor as it is seen directly and in the glass, tell one from the other; how large the bow is the frame
says better than they.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..camera import RgbdImage, unproject
from ..errors import Notice
from ..mirrors import Mirror
from ..mirrors.curved_glass import behind_front, bow_moves, thickness_moves, without_delay
from ..mirrors.mirror import expected_error, moved, reflection_moves, with_reason
from ..mirrors.wall_behind_frame import on_wall
from ..numeric.point_products import dot
from ..views.floor_and_vertical import find_ground
from ..views.ray_sorting import sort_rays
from ..views.view_correspondences import find_correspondences, noise_of, surfaces_of_views
from .frame_shape import FrameShape, frame_shape
from .pose_solver import ALL, HALVES, MAD, NormalEquations, cauchy_weights, scaled_cauchy_weights, weighted_equations


@dataclass(frozen=True)
class BowSettings:
    """When a mirror counts as bowed.

    Parameters
    ----------
    use : bool
        Off takes every glass for flat.
    least : float
        Smaller bows of a frame are not looked into [m]; nor are those within ``deviations`` of its noise.
    deviations : float
    noises : float
        No smaller bow than so many times the noise of a reading is confirmed: cameras smear a frame's edges.
    most : float
        No bow is larger [m].
    warp : float
        How much a frame may seem bowed because of the camera's depth warp where a bow is confirmed, one standard
        deviation [m].
    gain, even_gain : float
        By so much what is seen twice must be likelier with the bow than without: twice the log of the ratio. The latter
        where the floor shows that the camera does not warp depth.
    even : float
        Depth that errs by less than this share of itself is not warped.
    """

    use: bool = True
    least: float = 0.0004
    deviations: float = 3.0
    noises: float = 0.3
    most: float = 0.012
    warp: float = 0.0002
    gain: float = 14.0
    even_gain: float = 2.5
    even: float = 8e-5


@dataclass(frozen=True)
class ThicknessSettings:
    """When mirrors count as thick.

    Parameters
    ----------
    use : bool
    least, most : float
        Of the glass [m].
    offset : float
        How far a frame may project in front of its glass, or how thick that may be: one standard deviation [m].
    gain, preferred, preferred_share : float
        By so much what is seen twice must be likelier with thick glass than with thin glass level with its frame, and
        than with thin glass behind it: twice the log of the ratio. The last is a share of the gain: what both leave
        unexplained grows with it.
    doubtful : float
        From so much on the glass is not level with its frame, be it known why or not.
    """

    use: bool = True
    least: float = 0.0015
    most: float = 0.009
    offset: float = 0.01
    gain: float = 9.0
    doubtful: float = 4.0
    preferred: float = 4.0
    preferred_share: float = 0.2


_NONE = 1e-6  # standard deviation of what is known not to be [m]
_GATE = 0.08  # surfaces at a larger distance from each other are not paired [m]
_USUAL_OFFSET = 0.003  # of what reflects from the front of the frame where nothing is known of it, one deviation [m]
_OFFSET = 0.006  # how far the glass may lie off the frame's plane, one standard deviation [m]
_FREE = 0.01  # of a sag that only what is seen twice shall tell, one standard deviation [m]
_FLOOR_BAND = 0.06  # about the floor [m]
_FLOOR_HEIGHT, _FLOOR_SLOPE = 0.003, 0.002  # a floor and its depth may be off a plane, as in ``FloorSettings``
_MOST_READINGS = 1500  # of the floor in one mirror
_FEWEST = 60  # readings of it
_CORRELATED = 4.0  # of those so thinned that count as one
_LEAST_NOISE = 0.002  # of the floor's height [m]
_LEAST_EYE_HEIGHT = 0.2  # of the camera over the floor, that this is judged by [m]
_NOISES, _LEAST_BAND = 4.0, 0.015  # about the floor: times its noise, and at least [m]
_LEAST_SCALE = 1e-9  # [m]
_FEWEST_CELLS = 12  # of the floor, that say something of its evenness
_BLOCK = 24  # pixels; halves are split by such
_ROUNDS = 5
_TELLING = {"reflections", "views"}  # by which a mirror is moved as far as its glass lies off its frame
_UNDERRATED = 1.5  # times: pairs that are far apart are found less often, which makes an offset seem smaller
_DEEPEST = 0.025  # a frame projects in front of its glass [m]
_THICKNESS_ROUNDS = 5
_SETTLED = 1e-4  # of the thickness [m]
_PER_MIRROR = 8  # unknowns: two slopes, shift, sag, thickness; height and two slopes by which the floor may be off


@dataclass(frozen=True)
class _Observations:
    """Distances (N,) [m] that should vanish, how they change with the unknowns (N, P), and what they are worth."""

    residuals: np.ndarray
    jacobian: np.ndarray
    variances: np.ndarray  # 0 = known from the residuals only
    half: np.ndarray
    correlated: float


def align_bows(
    image: RgbdImage, mirrors: Sequence[Mirror], settings: BowSettings | None = None
) -> tuple[list[Mirror], tuple[str, ...]]:
    """Mirrors with the bow that their frames show and what is seen twice confirms.

    Where it neither confirms nor denies it, the mirror stays flat, and what a bow would change is part of its error.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m].

    Returns
    -------
    mirrors : list of Mirror
    notes : tuple of str
        Which are bowed, for the user.

    Notes
    -----
    O(pixels of the frames) where no frame seems bowed, else O(pixels).
    """
    settings = settings or BowSettings()
    if not settings.use:
        return list(mirrors), ()
    seen = {k: shape for k, m in enumerate(mirrors) if (shape := _shape(image, m)) is not None}
    mirrors = [
        replace(m, bow_by_frame=(seen[k].step, seen[k].covariance)) if k in seen else m for k, m in enumerate(mirrors)
    ]  # fmt: skip
    shapes = {k: shape for k, shape in seen.items() if _bent(shape, settings)}
    if not shapes:
        return mirrors, ()
    seen_twice = _observations(image, mirrors, list(shapes), False)
    out, notes = list(mirrors), []
    gain = settings.even_gain if _depth_is_even(image, mirrors, settings) else settings.gain
    confirmed = _confirmed(seen_twice, shapes, replace(settings, gain=gain))
    for k, shape in shapes.items():
        error, sag = confirmed[k]
        if sag is None:
            slopes_and_sag = (float(shape.step[0]), float(shape.step[1]), float(shape.step[2]), shape.sag)
            out[k] = replace(mirrors[k], sag_error=error, frame_bow=slopes_and_sag)
            continue
        bowed = moved(mirrors[k], shape.step[:3])
        out[k] = with_reason(replace(bowed, sag=sag, sag_error=error, bow_by_frame=None), mirrors[k], "bow")
        notes.append(_note(mirrors[k], sag))
    return out, tuple(notes)


def _note(mirror: Mirror, sag: float) -> Notice:
    if sag > 0.0:
        return Notice(
            "{name}: its glass is bowed, its middle lies {sag:.1f} mm in front of its ends, as its frame and surfaces "
            "seen twice show; what it shows is reflected accordingly",
            name=mirror.name, sag=1000.0 * sag, mirrors=[mirror.name],
        )  # fmt: skip
    return Notice(
        "{name}: its glass is bowed, its middle lies {sag:.1f} mm behind its ends, as its frame and surfaces seen "
        "twice show; what it shows is reflected accordingly",
        name=mirror.name, sag=-1000.0 * sag, mirrors=[mirror.name],
    )  # fmt: skip


def _shape(image: RgbdImage, mirror: Mirror) -> FrameShape | None:
    """The shape of the frame, where the glass may be bowed as that is."""
    if mirror.covariance is None or mirror.source == "rig file" or mirror.sag != 0.0 or on_wall(mirror):
        return None
    return frame_shape(image, mirror)


def _bent(shape: FrameShape, settings: BowSettings) -> bool:
    """Whether the frame is bowed by more than noise."""
    return max(settings.least, settings.deviations * shape.sag_error) < abs(shape.sag) < settings.most


def _observations(
    image: RgbdImage, mirrors: Sequence[Mirror], bent: list[int], time_of_flight: bool
) -> list[_Observations]:
    """What is seen twice: surfaces by two views, and the floor directly and in each mirror that may be bowed."""
    depth, intrinsics = image.depth, image.intrinsics
    cloud = unproject(depth, intrinsics)
    seen, placed = sort_rays(cloud, list(mirrors))
    column = {k: _PER_MIRROR * n for n, k in enumerate(bent)}
    unknowns = _PER_MIRROR * len(bent)
    shown = surfaces_of_views(image, list(mirrors), seen, noise_of(depth, seen))
    out = []
    for m in find_correspondences(list(mirrors), shown, intrinsics, _GATE):
        jacobian = np.zeros((len(m.gaps), unknowns))
        for view, points, sign in ((m.of, m.here, 1.0), (m.by, m.there, -1.0)):
            if view - 1 in column:
                part = slice(column[view - 1], column[view - 1] + 5)
                jacobian[:, part] += sign * _along(mirrors[view - 1], points, m.normals, time_of_flight)
        if len(m.gaps) and jacobian.any():
            s, t = shown[m.of], shown[m.by]
            correlated = 2.0 * max((2 * s.radius + 1) / s.stride, (2 * t.radius + 1) / t.stride) ** 2
            out.append(_Observations(m.gaps, jacobian, m.variances, m.half, correlated))
    ground = find_ground(placed, np.where(seen > 0, -1, seen).astype(seen.dtype), list(mirrors))
    if ground.floor is None:
        return out
    heights = dot(placed, ground.up) - ground.floor
    for k in bent:
        rows, columns = np.nonzero((seen == k + 1) & (np.abs(heights) < _FLOOR_BAND))
        if len(rows) < _FEWEST:
            continue
        thin = slice(None, None, len(rows) // _MOST_READINGS + 1)
        rows, columns = rows[thin], columns[thin]
        points = cloud[rows, columns]
        jacobian = np.zeros((len(rows), unknowns))
        part = slice(column[k], column[k] + 5)
        jacobian[:, part] = -_along(mirrors[k], points, np.broadcast_to(ground.up, points.shape), time_of_flight)
        real = placed[rows, columns]
        jacobian[:, column[k] + 5] = 1.0
        jacobian[:, column[k] + 6 : column[k] + 8] = (real - real.mean(axis=0)) @ _level(ground.up)
        half = (rows // _BLOCK + columns // _BLOCK) % 2
        out.append(_Observations(heights[rows, columns], jacobian, np.zeros(len(rows)), half, _CORRELATED))
    return out


def _along(mirror: Mirror, points: np.ndarray, normals: np.ndarray, time_of_flight: bool) -> np.ndarray:
    """How readings ``points`` (N, 3) move along ``normals`` (N, 3) with slopes, shift, sag and thickness: (N, 5)."""
    moves = np.einsum("nci,nc->ni", reflection_moves(mirror, points), normals)
    others = bow_moves(mirror, points), thickness_moves(mirror, points, time_of_flight)
    return np.column_stack((moves, *(np.einsum("nc,nc->n", change, normals) for change in others)))


def _depth_is_even(image: RgbdImage, mirrors: Sequence[Mirror], settings: BowSettings) -> bool:
    """Whether the floor as it is seen directly is so even that the camera can hardly warp depth.

    A relative error of depth lifts the floor by as much times the height of the camera.
    """
    seen, placed = sort_rays(unproject(image.depth, image.intrinsics), list(mirrors))
    ground = find_ground(placed, np.where(seen > 0, -1, seen).astype(seen.dtype), list(mirrors))
    if ground.floor is None or not ground.floor < -_LEAST_EYE_HEIGHT:
        return False
    heights = dot(placed, ground.up) - ground.floor
    rows, columns = np.nonzero((seen == 0) & (np.abs(heights) < max(_NOISES * ground.noise, _LEAST_BAND)))
    cells = rows // _BLOCK * (image.intrinsics.width // _BLOCK + 1) + columns // _BLOCK
    _, member, count = np.unique(cells, return_inverse=True, return_counts=True)
    full = count > _BLOCK * _BLOCK // 2
    if full.sum() < _FEWEST_CELLS:
        return False
    along = placed[rows, columns] @ _level(ground.up)
    means = [np.bincount(member, value)[full] / count[full] for value in (heights[rows, columns], *along.T)]
    design = np.column_stack((np.ones(full.sum()), *means[1:]))
    weights, scale = np.ones(full.sum()), np.inf
    for _ in range(_ROUNDS):  # feet and what lies about weigh little
        plane = np.linalg.lstsq(design * weights[:, None], means[0] * weights, rcond=None)[0]
        left = means[0] - design @ plane
        scale = MAD * float(np.median(np.abs(left))) + _LEAST_SCALE
        weights = 1.0 / np.sqrt(1.0 + (left / (2.0 * scale)) ** 2)
    return scale < settings.even * -ground.floor


def _level(up: np.ndarray) -> np.ndarray:
    """Two unit vectors (3, 2) along the floor."""
    along = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    along /= np.linalg.norm(along)
    return np.column_stack((along, np.cross(along, up)))


@dataclass(frozen=True)
class _Evidence:
    """Costs of the unknowns x (P,) by a half of the observations, or all: x·information·x - 2 right·x."""

    information: np.ndarray
    right: np.ndarray

    def best(self) -> np.ndarray:
        """The most likely unknowns (P,)."""
        return np.linalg.solve(self.information, self.right)

    def likelihood(self) -> float:
        """Twice its logarithm there, but for a constant."""
        return float(self.right @ self.best())

    def least(self, fixed: int, value: float) -> float:
        """The least cost where one unknown has this value, but for a constant."""
        free = np.arange(len(self.right)) != fixed
        inner = self.information[np.ix_(free, free)]
        right = self.right[free] - self.information[free, fixed] * value
        return float(
            self.information[fixed, fixed] * value**2 - 2.0 * self.right[fixed] * value
            - right @ np.linalg.solve(inner, right)
        )  # fmt: skip


@dataclass(frozen=True)
class GlassEvidence:
    """What is seen twice says of where glass lies: how thick it is [m], or None.

    ``behind`` (mirror's index → m): how far behind its frame each apparent surface seems to lie, where that is clear
    but not why. ``unsure`` (mirror's index → m): how far it may lie off its frame's plane for all that is known, one
    standard deviation.
    """

    thickness: float | None = None
    behind: dict[int, float] = field(default_factory=dict)
    unsure: dict[int, float] = field(default_factory=dict)


def thick_glass(
    image: RgbdImage, mirrors: Sequence[Mirror], settings: ThicknessSettings | None = None, timed: bool | None = True
) -> GlassEvidence:
    """How thick the mirrors are, where what is seen twice shows that.

    For a camera that measures time: the delay in the glass displaces along the ray, a frame that projects in front of
    thin glass along the mirror's normal. Asked of all mirrors together.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m].
    timed : bool or None
        The camera measures time, or may; of others only ``unsure`` is judged, and of those known to measure it not:
        thick glass would show by its delay.
    """
    settings = settings or ThicknessSettings()
    asked = [
        k for k, m in enumerate(mirrors)
        if m.covariance is not None and m.source in ("picked", "found") and m.rectangle is not None
        and not m.glass_thickness and not on_wall(m)
    ]  # fmt: skip
    if not settings.use or not asked:
        return GlassEvidence()
    observations = _observations(image, mirrors, asked, timed is not False)
    poses = [(np.zeros(3), _proper(mirrors[k])) for k in asked]
    unsure = {} if timed else _unsure_offsets(observations, poses, asked)
    if timed is False:
        return GlassEvidence(unsure=unsure)
    nothing = [0.0] * len(asked), [_NONE] * len(asked)
    x = _solved(observations, _prior(poses, *nothing, settings.offset))
    level, projecting, thick = (
        _weighed(observations, x, ALL, _prior(poses, *nothing, offset, thickness))
        for offset, thickness in ((_NONE, _NONE), (settings.offset, _NONE), (_NONE, settings.offset))
    )
    gains = [other.likelihood() - level.likelihood() for other in (projecting, thick)]
    if not gains[1] > max(settings.gain, gains[0] + max(settings.preferred, settings.preferred_share * gains[1])):
        shifts = projecting.best()[2::_PER_MIRROR]
        clear = max(gains) > settings.doubtful and shifts.mean() < 0.0
        return GlassEvidence(
            behind={k: -float(s) for k, s in zip(asked, shifts, strict=True) if s < 0.0} if clear else {}, unsure=unsure
        )
    prior = _prior(poses, *nothing, _NONE, settings.offset)
    thickness, at = 0.0, list(mirrors)
    for _ in range(_THICKNESS_ROUNDS):  # pairs far apart are not all found: nearer they are
        more = float(_solved(observations, prior)[4::_PER_MIRROR].mean())
        thickness = thickness + more
        if not 0.0 < thickness < settings.most:
            return GlassEvidence()
        if abs(more) < _SETTLED:
            break
        at = [behind_front(m, thickness) if k in asked else m for k, m in enumerate(mirrors)]
        observations = _observations(without_delay(image, at), at, asked, True)
    return GlassEvidence(thickness if thickness > settings.least else None)


def _unsure_offsets(
    observations: list[_Observations], poses: Sequence[tuple[np.ndarray, np.ndarray]], asked: list[int]
) -> dict[int, float]:
    """How far each apparent surface may lie off its frame's plane by what is seen twice: mirror's index → m."""
    nothing = [0.0] * len(asked), [_NONE] * len(asked)
    deviations = []
    for offset in (_USUAL_OFFSET, _NONE):
        prior = _prior(poses, *nothing, offset, _NONE)
        weighed = _weighed(observations, _solved(observations, prior), ALL, prior)
        deviations.append(np.diag(np.linalg.inv(weighed.information))[2::_PER_MIRROR])
    return {k: float(np.sqrt(max(v, 0.0))) for k, v in zip(asked, deviations[0] - deviations[1], strict=True)}


def with_unsure_offsets(mirrors: Sequence[Mirror], evidence: GlassEvidence, before: Sequence[Mirror]) -> list[Mirror]:
    """Mirrors less certain by how far their glass may lie off their frames, where nothing since ``before`` tells that.

    Glass of 5 mm that is silvered on its back reflects as if it lay 3 mm behind its front, and frames project.
    """
    return [
        replace(m, covariance=m.covariance + np.diag((0.0, 0.0, evidence.unsure[k] ** 2)))
        if k in evidence.unsure and k not in evidence.behind and m.covariance is not None
        and not _TELLING & {*m.moved_by[len(before[k].moved_by) :]} else m
        for k, m in enumerate(mirrors)
    ]  # fmt: skip


def doubted_offsets(
    mirrors: Sequence[Mirror], evidence: GlassEvidence, before: Sequence[Mirror]
) -> tuple[list[Mirror], tuple[str, ...]]:
    """Mirrors less certain whose glass seems to lie behind their frames, and that nothing moved from ``before``.

    Returns
    -------
    mirrors : list of Mirror
    warnings : tuple of str
    """
    out, warnings = list(mirrors), []
    for k, behind in evidence.behind.items():
        mirror = mirrors[k]
        if mirror is not before[k] or mirror.covariance is None:
            continue
        offset = _UNDERRATED * behind
        if offset > _DEEPEST or expected_error(mirror) > offset:  # no frame's, or in the error already
            continue
        out[k] = replace(mirror, covariance=mirror.covariance + np.diag((0.0, 0.0, offset**2)))
        warnings.append(
            Notice(
                "{name}: what is seen twice does not quite coincide, as if its glass lay {offset:.0f} mm behind the "
                "front of its frame or were thick; measure both and give them (glass_offset, glass_thickness)",
                name=mirror.name, offset=1000.0 * offset, mirrors=[mirror.name],
            )
        )  # fmt: skip
    return out, tuple(warnings)


def _proper(mirror: Mirror) -> np.ndarray:
    """Its covariance, not quite singular."""
    return np.asarray(mirror.covariance) + np.diag((1e-5, 1e-5, 1e-5)) ** 2


def _solved(observations: list[_Observations], prior: _Evidence) -> np.ndarray:
    """The most likely unknowns (P,)."""
    x = np.zeros(len(prior.right))
    for _ in range(_ROUNDS):
        x = _weighed(observations, x, ALL, prior).best()
    return x


def _confirmed(
    observations: list[_Observations], shapes: dict[int, FrameShape], settings: BowSettings
) -> dict[int, tuple[float, float | None]]:
    """Of each mirror how uncertain its sag is, and the sag where it is confirmed, else None [m]."""
    poses = [(shape.step[:3], shape.covariance[:3, :3]) for shape in shapes.values()]
    free = _prior(poses, [0.0] * len(shapes), [_FREE] * len(shapes))
    x = _solved(observations, free)
    evidence = {which: _weighed(observations, x, which, free) for which in (ALL, *HALVES)}
    out: dict[int, tuple[float, float | None]] = {}
    likely = []
    for n, (k, shape) in enumerate(shapes.items()):
        column = _PER_MIRROR * n + 3
        gains = [evidence[which].least(column, 0.0) - evidence[which].least(column, shape.sag) for which in evidence]
        clear = abs(shape.sag) > settings.noises * shape.noise
        likely.append(clear and gains[0] > settings.gain and min(gains[1:]) > 0.0)
        # the truth is 0 or what the frame says: so likely is the latter
        share = 1.0 / (1.0 + np.exp(-0.5 * np.clip(gains[0], -100.0, 100.0)))
        out[k] = (abs(shape.sag) * float(np.sqrt(share)), None)
    framed = _prior(
        poses, [shape.sag for shape in shapes.values()],
        [float(np.hypot(shape.sag_error, settings.warp)) for shape in shapes.values()],
    )  # fmt: skip
    both = _weighed(observations, x, ALL, framed)
    best, covariance = np.linalg.solve(both.information, both.right), np.linalg.inv(both.information)
    for n, k in enumerate(shapes):
        column = _PER_MIRROR * n + 3
        if likely[n]:
            out[k] = (float(np.sqrt(covariance[column, column])), float(best[column]))
    return out


def _prior(
    poses: Sequence[tuple[np.ndarray, np.ndarray]],
    sags: Sequence[float],
    sag_errors: Sequence[float],
    offset: float = _OFFSET,
    thickness: float = _NONE,
) -> _Evidence:
    """What is known beforehand.

    Parameters
    ----------
    poses : sequence of tuple
        Of each mirror, by its frame: slopes and shift (3,), and their covariance (3, 3).
    sags, sag_errors : sequence of float
        Of each mirror: the most likely sag, and one standard deviation [m].
    offset, thickness : float
        How far the glass may lie off the frame's plane, and how thick it may be: one standard deviation [m].
    """
    count = _PER_MIRROR * len(poses)
    information, right = np.zeros((count, count)), np.zeros(count)
    for n, ((step, covariance), sag, error) in enumerate(zip(poses, sags, sag_errors, strict=True)):
        start = _PER_MIRROR * n
        pose = slice(start, start + 3)
        known = np.linalg.inv(covariance + np.diag((0.0, 0.0, offset**2)))
        information[pose, pose], right[pose] = known, known @ step
        information[start + 3, start + 3], right[start + 3] = error**-2, sag * error**-2
        information[start + 4, start + 4] = thickness**-2
        floor = np.arange(start + 5, start + 8)
        information[floor, floor] = np.array((_FLOOR_HEIGHT, _FLOOR_SLOPE, _FLOOR_SLOPE)) ** -2
    return _Evidence(information, right)


def _weighed(observations: list[_Observations], x: np.ndarray, which: int, prior: _Evidence) -> _Evidence:
    """The costs by observations of a half, or all, with a prior; outliers about ``x`` weigh less."""
    information, right = prior.information.copy(), prior.right.copy()
    for o in observations:
        mine = slice(None) if which == ALL else o.half == which
        left = o.residuals - o.jacobian @ x
        weights = (
            cauchy_weights(left, o.variances, o.correlated) if o.variances.any()
            else scaled_cauchy_weights(left, _LEAST_NOISE, o.correlated)
        )  # fmt: skip
        equations: NormalEquations = weighted_equations(o.jacobian[mine], o.residuals[mine], weights[mine])
        information += equations.information
        right += equations.right
    return _Evidence(information, right)
