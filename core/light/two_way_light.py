"""Light that comes two ways into a camera that measures phase: predicted, corrected where it can be, else thrown away.

A point of skin that is lit directly and by way of a mirror returns light of both ways into each pixel that sees it. A
camera that measures phase reads the phase of the sum: somewhere between the two ways. Geometry gives how strong each
way is (:mod:`.irradiance`); how the camera turns that into a distance is learnt from the floor, whose place is known
(:mod:`.phase_response`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..camera import Intrinsics, RgbdImage
from ..errors import MirrorScanError
from ..mirrors import Mirror
from ..mirrors.mirror import reflect
from ..subject.subject_views import Views
from .irradiance import irradiance, light_sources, path_lengths, ratio_to_own, seen_at, through_glass
from .local_surface import local_surface
from .phase_response import PhaseResponse, fit_response, weighted_by_frequency

TWO_WAYS = ("auto", "on", "off")


@dataclass(frozen=True)
class LightSettings:
    """What to do about light that comes two ways.

    Parameters
    ----------
    two_ways : str
        "auto": undone where readings show it, in cameras that measure phase or may; "on": the camera is taken to
        measure phase, whatever its file says; "off": never looked for.
    frequencies : tuple of float
        Of the camera's modulation [MHz], from 1 to 1000, where they are known; else they are learnt from the floor.
        Who gives them says that the camera measures phase.
    """

    two_ways: str = "auto"
    frequencies: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.two_ways not in TWO_WAYS:
            raise MirrorScanError(f"light: two_ways is “{self.two_ways}”; choose {', '.join(TWO_WAYS)}")
        if not all(1.0 <= f <= 1000.0 for f in self.frequencies):
            raise MirrorScanError(f"light: frequencies = {self.frequencies}; give them in MHz, from 1 to 1000")

    @property
    def phase_said(self) -> bool:
        """Whether these settings say that the camera measures phase."""
        return self.two_ways == "on" or bool(self.frequencies)


DEFAULTS = LightSettings()


@dataclass(frozen=True)
class TwoWayLight:
    """What light that comes two ways did to a depth map, undone.

    Parameters
    ----------
    depth : np.ndarray [shape=(H, W), dtype=float32]
        Corrected z [m]; what is not to be trusted still stands in it.
    spoiled : np.ndarray [shape=(H, W), dtype=bool]
        Readings that are not to be trusted: another way's light is the stronger, or too strong to correct.
    lit_twice_share, corrected_share : float
        Shares of the subject's readings that the light of another way reaches noticeably, and that were corrected.
    response : PhaseResponse or None
        What the camera makes of such light; None when it could not be learnt, so that nothing was corrected.
    """

    depth: np.ndarray
    spoiled: np.ndarray
    lit_twice_share: float
    corrected_share: float
    response: PhaseResponse | None


_REFLECTIVITY = 0.85  # of glass in the near infrared, one pass; what it really is goes into the response's weights
_NOTICEABLE = 0.025  # ratio of light below which the bias stays under the noise
_MODERATE = 0.6  # ratio up to which a floor reading tells how the camera mixes two ways
_RATIO_ERROR, _LENGTH_ERROR = 0.15, 0.01  # of what is predicted: share of the ratio, difference of the ways [m]
_CORRECTABLE = 0.004  # bias by these errors up to which a reading is corrected [m]
_UNLEARNT = 0.05  # ratio beyond which a reading is thrown away when the response could not be learnt
_SAMPLE = 700  # pixels of a view by which the evidence is judged
_DECISIVE = 3.0  # ratio from which a reading of the other way is expected
_AGREES, _GHOST = 0.12, 0.25  # so near the skin, or the middle of both ways, is a reading of it [m]
_FEWEST = 15  # readings astray below which there is no evidence
_MOST_AGREEING = 0.25  # share of the readings looked at that may agree with light that comes one way
_MOST_AGREEING_PHASE = 0.33  # the same of a camera that is known to measure phase
_EVEN, _LOSING = 0.3, 1.5  # ways that differ by less [m] are mixed smoothly; ratio from which a pattern would be lost
_MOSTLY = 0.6  # share of such readings that is missing where a pattern is lost
_CERTAINLY = 0.5  # of them, that agree: light comes one way
_SEED = 0.15  # share of a limb's half width, from its middle, that light of one way is taken to reach alone
_LIMB_STEP = 0.03  # of z between neighbours: more is the edge of a limb
_ROUNDS, _REACH = 16, 2  # so often, and so far each time, the surface is followed outwards [px]
_DAMPING = 0.25  # of a correction that is made again: it depends on the surface, which depends on it
_CONSISTENT, _DEVIATIONS = 0.008, 3.0  # a corrected reading may lie so far off the surface's way on [m], and noise
_ON_FLOOR, _LOW = 0.03, 0.2  # so near the floor a reading is the floor's; so low a misread one seems to be [m]
_IN_FRONT = 0.006, 0.0015  # so far in front of what another view sees a reading is wrong [m], and times z
_FLOOR_SAMPLE = 1500  # floor readings that the response is fitted to
_FLOOR_PIXELS = 90_000  # of the image in which the floor is looked for
_FLOOR_BAND = 0.08  # so far from the floor a reading may be the floor's, misread [m]
_FLOOR_GRAZING = 0.12  # sine of the ray's angle to the floor, below which it is not judged
_TOGETHER = 4  # of 3 x 3 readings that are left out, so many are no noise
_FARTHEST_FLOOR, _ABOUT_FEET = 8.0, 1.4  # from the camera, and about the subject [m]
_ENOUGH_FLOOR = 4000  # readings
_GAP = 10  # so far the subject goes on where nothing is read [px]
_CLEARLY_EXPLAINED = 0.25  # of the floor's bias, that shows two ways by itself: at most 0.15 where light comes one way
_LEAST_EXPLAINED = 0.15  # share of the floor's bias that a response must explain


def shows_two_way_light(image: RgbdImage, views: Views, mirrors: list[Mirror], phase: bool = False) -> bool:
    """Whether readings that the camera's direct light must dominate are astray in the mirrors: missing, or ghosts.

    Where that is not clear, the floor of a camera that measures phase says it.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m], 0 = no reading.
    views : Views
        Of these readings, with these mirrors.
    mirrors : list of Mirror
    phase : bool
        The camera is known to measure phase.

    Notes
    -----
    Looks at a few thousand pixels.
    """
    if not mirrors:
        return False
    scene = _Scene(image, views, mirrors)
    agreeing, counted, _ = scene.agreement()
    if counted < _FEWEST or agreeing > _CERTAINLY * counted or scene.loses_its_pattern():
        return False
    if agreeing < (_MOST_AGREEING_PHASE if phase else _MOST_AGREEING) * counted:
        return True
    if not phase:
        return False
    floor = scene.floor_readings(views.floor_noise)
    return floor is not None and floor.explained >= _CLEARLY_EXPLAINED


def undo_two_way_light(
    image: RgbdImage,
    views: Views,
    mirrors: list[Mirror],
    noise: float,
    settings: LightSettings = DEFAULTS,
    phase: bool = False,
) -> TwoWayLight | None:
    """Readings that the light of mirrors falsifies are corrected or marked.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, z [m], 0 = no reading.
    views : Views
        Of these readings, with these mirrors.
    mirrors : list of Mirror
        Where their frames are: what is seen twice would have misled their alignment.
    noise : float
        Standard deviation of a reading of the floor [m].
    settings : LightSettings
    phase : bool
        The camera is known to measure phase; else its readings must show it.

    Returns
    -------
    TwoWayLight or None
        None when nothing but a lost pattern shows it: that falsifies no reading.

    Notes
    -----
    Path model after Bhandari et al. 2014 and Freedman et al. 2014. O(H W).
    """
    scene = _Scene(image, views, mirrors)
    response = weighted_by_frequency(tuple(1e6 * f for f in settings.frequencies)) if settings.frequencies else None
    floor = scene.floor_readings(noise)
    shown = floor is not None and floor.explained >= _LEAST_EXPLAINED
    if not (phase or shown or scene.agreement()[2] >= _FEWEST):
        return None
    if response is None and floor is not None and (phase or shown):
        response = floor.response
    return scene.corrected(response)


def without_falsified_floor(image: RgbdImage, views: Views, mirrors: list[Mirror]) -> RgbdImage:
    """The depth without the floor's readings that light of two ways falsifies: they stick to feet, or hide a person.

    Of ``views`` only the direct one must have found the subject.
    """
    spoiled = np.zeros(image.depth.shape, np.bool_)
    _Scene(image, views, mirrors).correct_floor(None, image.depth.copy(), spoiled)
    return image.with_depth(np.where(spoiled, np.float32(0.0), image.depth))


@dataclass(frozen=True)
class _Floor:
    """What the floor's readings say: the response that they show, and which share of their bias it explains."""

    response: PhaseResponse
    explained: float


class _Scene:
    """One depth map with its views and mirrors, while two-way light is looked for in it."""

    def __init__(self, image: RgbdImage, views: Views, mirrors: list[Mirror]) -> None:
        self.depth, self.intrinsics = image.depth, image.intrinsics
        self.views, self.mirrors = views, mirrors
        self.labels = views.labels
        self.sources = light_sources(mirrors)
        self.reflectivity = np.full(len(mirrors), _REFLECTIVITY)

    @cached_property
    def hiding(self) -> tuple[np.ndarray, np.ndarray]:
        """Depth and labels (H, W) of what can hide a point from a source: the subject, unread parts of it too."""
        return grown_into_gaps(self.labels, self.depth)

    # --- is there any? -----------------------------------------------------------------------------------------------

    def sample(self, view: int) -> tuple[_Surface, np.ndarray, np.ndarray]:
        """Some pixels of a view as they are read, with :func:`.irradiance.irradiance` of what only readings hide."""
        rows, columns = np.nonzero((self.labels == view) & (self.depth > 0))
        step = max(len(rows) // _SAMPLE, 1)
        surface = self.surface(self.depth, self.labels >= 0, rows[::step], columns[::step])
        return surface, *self.light(surface.points, surface.normals, surface.view, (self.depth, self.labels))

    def agreement(self) -> tuple[int, int, int]:
        """Of readings in mirrors that the camera's direct light must dominate: how many agree with the skin it shows.

        Also how many there are, those missing included, and how many are ghosts: in the middle between both ways.
        """
        agree = missing = ghosts = 0
        surface, light, lengths = self.sample(0)
        for other in range(1, len(self.sources)):
            strong = (surface.z > 0) & (light[:, other] > 0) & (light[:, 0] > _DECISIVE * light[:, other])
            y, x, z, inside = seen_at(surface.points[strong], other, self.mirrors, self.intrinsics)
            there = self.depth[y, x].astype(np.float64)
            middle = z * 0.5 * (1.0 + lengths[strong, 0] / lengths[strong, other])
            near = inside & (np.abs(there - z) < _AGREES)
            agree += int(near.sum())
            missing += int((inside & (there == 0)).sum())
            ghosts += int((inside & ~near & (np.abs(there - middle) < _GHOST)).sum())
        return agree, agree + missing + ghosts, ghosts

    def loses_its_pattern(self) -> bool:
        """Whether what two mirrors light over ways of almost the same length is missing.

        A camera that measures phase reads it: all its frequencies agree. One that loses its pattern does not.
        """
        missing = counted = 0
        for view in range(1, len(self.sources)):
            surface, light, lengths = self.sample(view)
            for other in range(1, len(self.sources)):
                if other == view:
                    continue
                even = np.abs(lengths[:, view] - lengths[:, other]) < _EVEN
                strong = (surface.z > 0) & even & (light[:, other] > 0) & (light[:, view] > _LOSING * light[:, other])
                y, x, _, inside = seen_at(surface.points[strong], other, self.mirrors, self.intrinsics)
                counted += int(inside.sum())
                missing += int((inside & (self.depth[y, x] == 0)).sum())
        return counted >= _FEWEST and missing > _MOSTLY * counted

    # --- what the floor says -----------------------------------------------------------------------------------------

    def floor_readings(self, noise: float) -> _Floor | None:
        """The floor's readings that light reaches two ways, and the response they show."""
        views = self.views
        if views.floor is None:
            return None
        skipped = max(int(np.sqrt(self.depth.size / _FLOOR_PIXELS)), 1)
        few = np.s_[::skipped, ::skipped]
        height = views.points[few] @ views.up - views.floor
        rows, columns = np.nonzero((views.seen[few] == 0) & (self.labels[few] < 0) & (np.abs(height) < _FLOOR_BAND))
        if len(rows) < _FLOOR_SAMPLE // 10:
            return None
        offset, points = height[rows, columns], views.points[few][rows, columns]
        flat = points - points @ views.up[:, None] * views.up
        grazing = np.abs(points @ views.up) / np.linalg.norm(points, axis=1)
        normals = np.broadcast_to(views.up, points.shape)
        own = np.zeros(len(rows), np.intp)
        light, lengths = self.light(points, normals, own)
        ratio = ratio_to_own(light, own)
        total, seen_well = ratio.sum(axis=1), grazing > _FLOOR_GRAZING
        east = np.cross(views.up, (0.0, 0.0, 1.0))
        x, y = flat @ east, flat @ np.cross(east, views.up)
        shape = np.column_stack((np.ones(len(x)), x, y, x * x, x * y, y * y))
        clean = np.flatnonzero((total < 0.003) & seen_well)
        lit = np.flatnonzero((total > _NOTICEABLE / 2) & (total < _MODERATE) & seen_well)
        if min(len(clean), len(lit)) < _FLOOR_SAMPLE // 10:
            return None
        clean = clean[:: max(len(clean) // _FLOOR_SAMPLE, 1)]
        lit = lit[:: max(len(lit) // _FLOOR_SAMPLE, 1)]
        form = _robust_fit(shape[clean], offset[clean])
        slant = (points @ views.up) / np.linalg.norm(points, axis=1)  # height gained a metre of ray
        bias = (offset - shape @ form) / slant
        noise = max(noise, 1.4826 * float(np.median(np.abs(bias[clean]))))
        response, explained = fit_response(
            ratio[lit][:, 1:], lengths[lit][:, 1:] - lengths[lit][:, :1], bias[lit], noise,
            shape[lit] / slant[lit, None],
        )  # fmt: skip
        return _Floor(response, explained)

    # --- prediction and correction -----------------------------------------------------------------------------------

    def surface(
        self, depth: np.ndarray, trusted: np.ndarray, rows: np.ndarray, columns: np.ndarray, reach: int = 0
    ) -> _Surface:
        """Where the surface at some pixels really is, and which way it faces."""
        fitted = local_surface(depth, self.labels, trusted, rows, columns, self.intrinsics.packed, reach)
        view, normals = self.labels[rows, columns].astype(np.intp), fitted[:, :3].copy()
        for k, mirror in enumerate(self.mirrors, start=1):
            mine = view == k
            normals[mine] -= 2.0 * (normals[mine] @ mirror.normal)[:, None] * mirror.normal
        return _Surface(self.place(rows, columns, fitted[:, 3], view), normals, view, fitted[:, 3])

    def place(self, rows: np.ndarray, columns: np.ndarray, z: np.ndarray, view: np.ndarray) -> np.ndarray:
        """Where readings (N,) at z of some pixels really are (N, 3)."""
        x, y = (columns - self.intrinsics.cx) / self.intrinsics.fx, (rows - self.intrinsics.cy) / self.intrinsics.fy
        points = np.column_stack((x, y, np.ones(len(rows)))) * z[:, None]
        for k, mirror in enumerate(self.mirrors, start=1):
            points[view == k] = reflect(points[view == k], mirror)
        return points

    def light(
        self,
        points: np.ndarray,
        normals: np.ndarray,
        own: np.ndarray,
        hiding: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """:func:`.irradiance.irradiance` of points (N, 3) that the views ``own`` (N,) see; hidden by :attr:`hiding`."""
        depth, labels = hiding or self.hiding
        return irradiance(points, normals, own, depth, labels, self.mirrors, self.intrinsics, self.reflectivity)

    def corrected(self, response: PhaseResponse | None) -> TwoWayLight:
        """From the middle of each limb outwards: the surface so far tells which light the next pixels get.

        A reading that light of two ways falsified bends the surface, so that it seems to turn away from that light.
        Therefore only what is corrected already says how the surface goes on.
        """
        rows, columns = np.nonzero((self.labels >= 0) & (self.depth > 0))
        length = ray_lengths(rows, columns, self.intrinsics)
        measured, (edge, middle) = self.depth[rows, columns], self.runs()
        depth, trusted = self.depth.copy(), middle & (self.labels >= 0) & (self.depth > 0)
        noise = self.noise(rows, columns)
        bias, total = np.zeros(len(rows)), np.full(len(rows), np.inf)
        good, settled = np.zeros(len(rows), np.bool_), np.zeros(len(rows), np.bool_)
        for _ in range(_ROUNDS):
            some = np.flatnonzero(grown(trusted, _REACH)[rows, columns] & ~settled)
            if not len(some):
                break
            surface = self.surface(depth, trusted, rows[some], columns[some], _REACH)
            light, lengths = self.light(surface.points, surface.normals, surface.view)
            ratio = ratio_to_own(light, surface.view)
            longer = lengths - lengths[np.arange(len(some)), surface.view][:, None]
            known, before = surface.z > 0, total[some]
            total[some] = np.where(known, ratio.sum(axis=1), np.inf)
            predicted, uncertain = self.predicted(response, ratio, longer, known)
            step = np.where(np.isinf(before), 1.0, _DAMPING)
            bias[some] = np.where(known, bias[some] + step * (predicted - bias[some]), bias[some])
            value = measured[some] - bias[some] / length[some]
            depth[rows[some], columns[some]] = np.maximum(value, 0.0)
            good[some] = (
                known
                & (uncertain < _CORRECTABLE)
                & (np.abs(value - surface.z) * length[some] < _CONSISTENT + _DEVIATIONS * noise[some])
            )
            settled[some] = good[some] & (total[some] == 0) & (before == 0) & (bias[some] == 0)
            trusted = np.zeros(depth.shape, np.bool_)
            trusted[rows[good], columns[good]] = True
        trusted &= ~self.contradicted(depth, trusted, edge)
        # where a mirror's reading borders on some that are left out, it is half wrong itself; one alone is noise
        left_out = (self.labels > 0) & ~trusted
        together = sum(shifted(left_out.astype(np.int8), dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1))
        trusted &= ~((self.labels > 0) & grown(left_out & (together >= _TOGETHER), 1))
        spoiled = (self.labels >= 0) & ~trusted
        surface = self.surface(depth, trusted, rows, columns)
        light, _ = self.light(surface.points, surface.normals, surface.view)
        spoiled |= self.ghosts(surface, light, depth)
        self.correct_floor(response, depth, spoiled)
        kept = trusted[rows, columns]
        return TwoWayLight(
            depth, spoiled, float(((total > _NOTICEABLE) | ~kept).mean()),
            float((kept & (np.abs(bias) > 0.0005)).mean()), response,
        )  # fmt: skip

    def predicted(
        self, response: PhaseResponse | None, ratio: np.ndarray, longer: np.ndarray, known: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Bias of readings (N,) along the ray and what it may be wrong by [m]."""
        predicted, uncertain = np.zeros(len(ratio)), np.zeros(len(ratio))
        lit = np.flatnonzero(known & (ratio.sum(axis=1) > 0))
        if response is None:
            uncertain[lit] = np.where(ratio[lit].sum(axis=1) > _UNLEARNT, np.inf, 0.0)
            return predicted, uncertain
        predicted[lit] = response.bias(ratio[lit], longer[lit])
        by_ratio = response.bias((1.0 + _RATIO_ERROR) * ratio[lit], longer[lit]) - predicted[lit]
        by_length = response.bias(ratio[lit], longer[lit] + _LENGTH_ERROR) - predicted[lit]
        uncertain[lit] = np.hypot(by_ratio, by_length)
        return predicted, uncertain

    def noise(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Standard deviation of some readings [m], by the second differences along the rows of their view."""
        left = self.depth[rows, np.maximum(columns - 1, 0)]
        right = self.depth[rows, np.minimum(columns + 1, self.depth.shape[1] - 1)]
        here, bend = self.depth[rows, columns], np.zeros(len(rows))
        known = (left > 0) & (right > 0)
        bend[known] = np.abs(left[known] + right[known] - 2.0 * here[known])
        noise = np.zeros(len(rows))
        for view in range(len(self.sources)):
            mine = self.labels[rows, columns] == view
            if (mine & known).any():
                noise[mine] = 1.4826 * float(np.median(bend[mine & known])) / np.sqrt(6.0)
        return noise

    def runs(self) -> tuple[np.ndarray, np.ndarray]:
        """How far out in its limb each pixel of a row lies (H, W), 0 in the middle, 1 at the edge; and the middles."""
        labels, depth = self.labels, self.depth
        starts = np.ones(labels.shape, np.bool_)
        starts[:, 1:] = (labels[:, 1:] != labels[:, :-1]) | (
            np.abs(depth[:, 1:] - depth[:, :-1]) > _LIMB_STEP * depth[:, 1:]
        )
        first = np.flatnonzero(starts.ravel())
        run = np.cumsum(starts.ravel()) - 1
        size = np.diff(np.append(first, labels.size))
        place = (np.arange(labels.size) - first[run] + 0.5) / size[run]
        share = np.abs(2.0 * place - 1.0)
        share = np.where(size[run] >= 3, share, 1.0)
        middle = share < np.maximum(_SEED, 1.01 / size[run])
        return share.reshape(labels.shape), middle.reshape(labels.shape)

    def contradicted(self, depth: np.ndarray, trusted: np.ndarray, edge: np.ndarray) -> np.ndarray:
        """Trusted pixels (H, W) in front of what another view sees there.

        That is skin nearer to the middle of a limb, or the floor.
        """
        rows, columns = np.nonzero(trusted)
        view = self.labels[rows, columns].astype(np.intp)
        points = self.place(rows, columns, depth[rows, columns].astype(np.float64), view)
        noise = np.zeros(depth.shape, np.float32)
        noise[rows, columns] = self.noise(rows, columns)
        bad = np.zeros(len(rows), np.bool_)
        for other in range(len(self.sources)):
            y, x, z, inside = seen_at(points, other, self.mirrors, self.intrinsics)
            inside &= view != other
            if other > 0:
                inside &= through_glass(points, self.mirrors[other - 1])
            slack = _IN_FRONT[0] + _IN_FRONT[1] * z + _DEVIATIONS * np.hypot(noise[rows, columns], noise[y, x])
            before = inside & (depth[y, x] > z + slack)
            bad |= before & trusted[y, x] & (self.labels[y, x] == other) & (edge[rows, columns] > edge[y, x])
            if other == 0 and self.views.floor is not None:
                height = self.views.points @ self.views.up - self.views.floor
                floor = (self.views.seen == 0) & (self.labels < 0) & (np.abs(height) < _ON_FLOOR)
                on_floor = ~grown(~floor, 1)
                low = points @ self.views.up - self.views.floor < _LOW
                bad |= before & low & on_floor[y, x] & (depth[y, x] > z + 2.0 * _ON_FLOOR)
        marked = np.zeros(depth.shape, np.bool_)
        marked[rows[bad], columns[bad]] = True
        return grown(marked, 1)

    def correct_floor(self, response: PhaseResponse | None, depth: np.ndarray, spoiled: np.ndarray) -> None:
        """Correct or mark the floor's readings in ``depth`` and ``spoiled``, as they are seen directly and in mirrors.

        What a mirror shows of it is found by its ray, wherever the reading is.
        """
        views = self.views
        if views.floor is None:
            return
        for view in range(len(self.sources)):
            rows, columns = np.nonzero((self.labels < 0) & (depth > 0) & ((views.seen == 0) if view == 0 else True))
            to_floor = self.floor_distance(rows, columns, view)
            some = np.isfinite(to_floor)
            if view == 0:
                height = views.points[rows, columns] @ views.up - views.floor
                some &= np.abs(height) < _FLOOR_BAND
                away = views.points[rows, columns] - views.axis
                far = some & ((away**2).sum(axis=1) - (away @ views.up) ** 2 > _ABOUT_FEET**2)
                if (some & ~far).sum() > _ENOUGH_FLOOR:  # then nobody needs what is farther
                    spoiled[rows[far], columns[far]] = True
                    some &= ~far
            rows, columns, z = rows[some], columns[some], to_floor[some]
            own = np.full(len(rows), view, np.intp)
            points = self.place(rows, columns, z, own)
            if view > 0:
                shown = through_glass(points, self.mirrors[view - 1])
                rows, columns, own, points = rows[shown], columns[shown], own[shown], points[shown]
            light, lengths = self.light(points, np.broadcast_to(views.up, points.shape), own)
            ratio = ratio_to_own(light, own)
            total = ratio.sum(axis=1)
            if view > 0:  # what a mirror shows of the floor need not be corrected
                lost = total > _UNLEARNT
                spoiled[rows[lost], columns[lost]] = True
                continue
            known = np.ones(len(rows), np.bool_)
            predicted, uncertain = self.predicted(response, ratio, lengths - lengths[:, :1], known)
            lost = (uncertain > _CORRECTABLE) | (total > _MODERATE)
            spoiled[rows[lost], columns[lost]] = True
            kept = ~lost & (predicted != 0)
            rows, columns = rows[kept], columns[kept]
            change = predicted[kept] / ray_lengths(rows, columns, self.intrinsics)
            depth[rows, columns] -= change.astype(np.float32)

    def floor_distance(self, rows: np.ndarray, columns: np.ndarray, view: int) -> np.ndarray:
        """The z (N,) at which the rays of some pixels meet the floor as a view shows it [m]; infinite if they don't."""
        assert self.views.floor is not None
        up, height = self.views.up, self.views.floor
        if view > 0:  # the mirror's image of the floor
            mirror = self.mirrors[view - 1]
            height = height - 2.0 * (mirror.point @ mirror.normal) * (mirror.normal @ up)
            up = up - 2.0 * (mirror.normal @ up) * mirror.normal
        x, y = (columns - self.intrinsics.cx) / self.intrinsics.fx, (rows - self.intrinsics.cy) / self.intrinsics.fy
        fall = up[0] * x + up[1] * y + up[2]
        with np.errstate(divide="ignore"):
            z = height / fall
        return np.where((z > 0) & (z < _FARTHEST_FLOOR), z, np.inf)

    def ghosts(self, surface: _Surface, light: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Readings (H, W) of no view that lie in the middle between both ways to skin which another view shows."""
        marked = np.zeros(depth.shape, np.bool_)
        for view in range(len(self.sources)):
            ghost = np.zeros(depth.shape, np.float32)
            for other in range(len(self.sources)):
                if other == view:
                    continue
                mine = np.flatnonzero((surface.z > 0) & (surface.view == other) & (light[:, view] > 0))
                points = surface.points[mine]
                lengths = path_lengths(points, self.sources[[view, other]])
                y, x, z, inside = seen_at(points, view, self.mirrors, self.intrinsics)
                ghost[y[inside], x[inside]] = (0.5 * z * (1.0 + lengths[:, 1] / lengths[:, 0]))[inside]
            for dy in (-1, 0, 1):
                for dx in (-1, 0, 1):
                    middle = shifted(ghost, dy, dx)
                    marked |= (middle > 0) & (depth > 0) & (np.abs(depth - middle) < _GHOST)
        return marked & (self.labels < 0)


@dataclass(frozen=True)
class _Surface:
    """Surface at some pixels: points, unit normals (N, 3) where they really are, view, z (N,) in it [m], 0 unknown."""

    points: np.ndarray
    normals: np.ndarray
    view: np.ndarray
    z: np.ndarray


def ray_lengths(rows: np.ndarray, columns: np.ndarray, intrinsics: Intrinsics) -> np.ndarray:
    """Length of a pixel's ray a metre of z; (N,)."""
    x, y = (columns - intrinsics.cx) / intrinsics.fx, (rows - intrinsics.cy) / intrinsics.fy
    return np.sqrt(x * x + y * y + 1.0)


def shifted(image: np.ndarray, down: int, right: int) -> np.ndarray:
    """The image (H, W) moved by at most one pixel; 0 moves in."""
    out = np.zeros_like(image)
    height, width = image.shape
    out[max(down, 0) : height + min(down, 0), max(right, 0) : width + min(right, 0)] = image[
        max(-down, 0) : height + min(-down, 0), max(-right, 0) : width + min(-right, 0)
    ]
    return out


def grown_into_gaps(labels: np.ndarray, depth: np.ndarray, reach: int = _GAP) -> tuple[np.ndarray, np.ndarray]:
    """Depth and labels (H, W) of the subject carried on along the rows into pixels without a reading.

    A camera gives up skin that light reaches two ways; it hides what is behind it all the same.
    """
    free = (labels < 0) & (depth == 0)
    depth, labels = np.where(labels >= 0, depth, np.float32(0.0)), labels.copy()
    for right in (1, -1) * reach:
        near = shifted(labels + 1, 0, right)
        taken = free & (near > 0) & (labels < 0)
        labels[taken] = near[taken] - 1
        depth[taken] = shifted(depth, 0, right)[taken]
    return depth, labels


def grown(mask: np.ndarray, radius: int) -> np.ndarray:
    """The mask (H, W) and all pixels up to ``radius`` rows and columns from it."""
    mask = mask.copy()
    for _ in range(radius):
        mask[1:] |= mask[:-1].copy()
        mask[:-1] |= mask[1:].copy()
        mask[:, 1:] |= mask[:, :-1].copy()
        mask[:, :-1] |= mask[:, 1:].copy()
    return mask


def _robust_fit(shape: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Coefficients of ``shape`` (N, D) that fit values (N,), those far off left out."""
    form = np.linalg.lstsq(shape, values, rcond=None)[0]
    for _ in range(3):
        rest = np.abs(values - shape @ form)
        near = rest <= 3.0 * 1.4826 * max(float(np.median(rest)), 1e-6)
        form = np.linalg.lstsq(shape[near], values[near], rcond=None)[0]
    return form


def without_spoiled(views: Views, spoiled: np.ndarray) -> Views:
    """The views without readings that are not to be trusted: they show nothing, not even that space is empty."""
    return replace(
        views,
        labels=np.where(spoiled, np.int8(-1), views.labels),
        seen=np.where(spoiled, np.int8(-1), views.seen),
    )
