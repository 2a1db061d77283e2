"""One capture as far as its patches: depth, mirrors, views."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..camera import Intrinsics, RgbdImage, unproject
from ..camera.noise_models import SENSORS, NoiseModel
from ..capture import Capture, MirrorPicks
from ..checks.scene_advice import check_scene
from ..checks.seat import check_seat
from ..checks.view_disagreement import check_agreement
from ..depth.burst_motion import still_warning
from ..depth.clean_views import clean
from ..depth.depth_map import one_depth_map
from ..depth.noise_estimate import BurstNoise, burst_noise
from ..depth.sensor_recognition import Principle, measuring_principle
from ..depth.settings import DepthSettings
from ..errors import Notice, ReconstructionError
from ..light.phase_response import PhaseResponse
from ..light.surface_light import LitReadings
from ..light.two_way_light import (
    TwoWayLight,
    shows_two_way_light,
    undo_two_way_light,
    without_falsified_floor,
    without_spoiled,
)
from ..mesh import Mesh
from ..mirrors import Mirror
from ..mirrors.curved_glass import flattened, without_delay
from ..mirrors.mirror import reflection_matrix
from ..numeric.threads import each
from ..patches.grid_triangulation import largest_jump, triangulate_view
from ..patches.outline_colors import colors_from_inside
from ..subject.image_border import SIDES, cut_sides
from ..subject.subject_search import find_subject
from ..subject.subject_views import Views
from ..views.floor_and_vertical import Ground
from ..views.silhouette_contact import Outline, outline_of
from ..views.view_maps import ViewMaps, view_maps
from .mirror_placement import align_mirrors, first_mirrors
from .settings import Settings


@dataclass(frozen=True)
class KnownScene:
    """What does not change from frame to frame of a recording, so that it is found once and handed on.

    Parameters
    ----------
    framed, mirrors : tuple of Mirror
        Where their frames are; and as they were aligned, with the thickness and bow of their glass.
    principle : Principle
        How the camera measures.
    ground : Ground
        Vertical and floor.
    lit_twice : bool
        Light comes two ways.
    response : PhaseResponse or None
        What the camera makes of such light.
    subject : np.ndarray [shape=(3,)] or None
        A point of the vertical line through the subject, camera frame [m]: about there it is looked for.
    """

    framed: tuple[Mirror, ...]
    mirrors: tuple[Mirror, ...]
    principle: Principle
    ground: Ground
    lit_twice: bool = False
    response: PhaseResponse | None = None
    subject: np.ndarray | None = None


@dataclass(frozen=True)
class Scan:
    """What one camera saw, or several in one frame: a patch and a map a view.

    Parameters
    ----------
    patches : list of Mesh
        One a view, where the subject really is.
    maps : ViewMaps
    up, axis : np.ndarray [shape=(3,)]
        Vertical, and a point of the vertical through the subject.
    floor : float or None
        Height of the floor along ``up`` [m].
    names : list of str
        Of the views.
    mirrors : list of Mirror
    sensor : str
    warnings : tuple of str
        Those that carry more than their text are :class:`.notices.Notice`.
    limits : np.ndarray [shape=(N+1, 2)]
        Nearest and farthest depth of the subject in each view [m], see :class:`.subject_views.Views`.
    noise : tuple of BurstNoise
        Of each view's readings, before smoothing.
    lenses : tuple of Intrinsics
        Of the cameras.
    cut : tuple of str
        Sides on which the picture ends at the subject, see :func:`.image_border.cut_sides`.
    lit_twice : tuple of float or None
        Where light came two ways: the shares of the subject's readings that it reached, and that were corrected [0..1].
    principles : tuple of Principle
        How each camera measures.
    outline : Outline or None
        Of the subject as it is seen directly, where light came two ways and the mirrors were not known before.
    lit : LitReadings or None
        Its readings as they were read, where light came two ways.
    scene : KnownScene or None
        What another snapshot of the same rig need not find again.
    """

    patches: list[Mesh]
    maps: ViewMaps
    up: np.ndarray
    axis: np.ndarray
    floor: float | None
    names: list[str]
    mirrors: list[Mirror]
    sensor: str
    warnings: tuple[str, ...]
    limits: np.ndarray
    noise: tuple[BurstNoise, ...]
    lenses: tuple[Intrinsics, ...] = ()
    cut: tuple[str, ...] = ()
    lit_twice: tuple[float, float] | None = None
    principles: tuple[Principle, ...] = ()
    outline: Outline | None = None
    lit: LitReadings | None = None

    scene: KnownScene | None = None

    @property
    def timed(self) -> bool | None:
        """Whether the camera measures time, which glass delays; None for several, and where it is not known."""
        return self.principles[0].time if len(self.principles) == 1 else None


def scan_steps(
    capture: Capture,
    picks: tuple[MirrorPicks | Mirror, ...],
    settings: Settings,
    clock: Clock,
    part: tuple[float, float],
    meeting: np.ndarray | None = None,
    find: bool = True,
    alone: bool = True,
    known: KnownScene | None = None,
    averaged: tuple[np.ndarray, np.ndarray] | None = None,
) -> Generator[tuple[float, str], None, Scan]:
    """One camera's readings → patches: the first half of the job, ``part`` of the whole.

    ``meeting``: where the subject is meant to stand, camera frame [m]; by default where the mirrors look. ``find``:
    without ``picks`` mirrors are searched for. ``alone``: as in :func:`.scene_advice.check_scene`. ``known``: the scene
    of another snapshot of the same rig; nothing of it is found again or judged, and ``picks`` do not count.
    ``averaged``: what :func:`.depth_map.one_depth_map` gave for this capture and these settings, if that is known.
    """

    def at(share: float) -> float:
        return part[0] + (part[1] - part[0]) * share

    camera = capture.intrinsics
    yield at(0.0), "Averaging the frames"
    depth, spread = one_depth_map(capture, settings.depth) if averaged is None else averaged
    clock.lap("depth")

    yield at(0.17), "Fitting the mirrors"
    if known is not None:
        first, principle = list(known.framed), known.principle
    else:
        first = first_mirrors(picks, depth, capture, settings) if picks or find else []
        principle = measuring_principle(capture, settings.depth, settings.light.phase_said)
    sensor, model = principle.sensor, SENSORS.get(principle.sensor)
    fused, read = depth, RgbdImage(depth, camera)
    image, placed, placement = _aligned(first, read, capture, settings, principle, known)
    clock.lap("mirrors")

    yield at(0.33), "Finding the subject"
    ground = None if known is None else known.ground
    if known is not None and meeting is None:
        meeting = known.subject
    surely_lit = known is not None and known.lit_twice  # then the subject is looked for when that is undone
    views = None if surely_lit else find_subject(image, placed, settings.views, meeting, ground)
    clock.lap("views")
    light, unlearnt, lit = None, None, None
    if views is None or (known is None and _shows_light(image, views, placed, principle, settings)):
        yield at(0.45), "Correcting two-way light"
        light = _light_undone(read, first, principle, settings, meeting, known)
    if light is None:
        views = views or find_subject(image, placed, settings.views, meeting, ground)
    else:
        unlearnt = None if views is None else unlearnt_light(light, views)
        principle = principle if principle.phase else replace(principle, time=True, phase=True, by="readings")
        read = read.with_depth(light.depth)
        trusted = read.with_depth(np.where(light.spoiled, np.float32(0.0), light.depth))
        image, placed, placement = _aligned(first, trusted, capture, _without_pairs(settings), principle, known)
        whole = without_delay(read, placed) if image is not trusted else read
        found = find_subject(whole, placed, settings.views, meeting, ground)
        lit = LitReadings(RgbdImage(fused, camera), found.labels, light.spoiled, light.response)
        views = without_spoiled(found, light.spoiled)
    # what the seams tell of glass is asked only where the mirrors are not known
    outline = None if light is None or known is not None else outline_of(fused, views.labels == 0, 0.0, frayed=1)
    depth = image.depth
    clock.lap("light")

    yield at(0.58), "Smoothing the depth"
    seat: list[str] = []
    faults: list[str] = []
    if known is None:  # else it was judged there
        views, contradictions = check_agreement(image, views, placed, principle.time)
        seat = [] if settings.views.object else [*check_seat(views)]
        faults = [*contradictions, *check_scene(image, views, placed, model, alone)]
    burst = burst_noise(len(capture.depth), spread, depth, views.labels, len(placed) + 1)
    moved = still_warning(capture.depth, views.labels, camera.fx, settings.depth)
    cut = tuple(cut_sides(depth, views.labels == 0))
    if placed and len(cut) == len(SIDES) and not (views.labels > 0).any():
        raise ReconstructionError(
            "nobody stands between the camera and the mirrors: what the camera sees fills the picture to all four "
            "sides, and no mirror shows it; clear away what is right in front of the camera, or step back until it "
            "sees all of you",
            code="nobody",
        )
    depth, views, noise = clean_views(
        image, views, len(placed), settings.depth, model, spread if len(capture.depth) > 1 else None
    )
    clock.lap("smoothing")

    yield at(0.83), "Triangulating the views"
    work: tuple[Callable[[], Any], ...] = (
        lambda: view_maps(RgbdImage(depth, camera), views.labels, views.seen, placed, noise),
        lambda: make_patches(depth, views, placed, noise, capture, settings),
    )
    maps, patches = each(lambda make: make(), work)
    clock.lap("triangulation")
    # where it is known why a mirror shows nobody, that is reported instead
    explained = {name for fault in faults for name in Notice.of(fault).mirrors}
    blind = [text for text in views.warnings if explained.isdisjoint(Notice.of(text).mirrors)]
    warnings = (*seat, *placement, *(text for text in (unlearnt, moved) if text), *blind, *faults)
    assert views.limits is not None  # find_subject gives them
    return Scan(
        patches, maps, views.up, views.axis, views.floor, view_names(placed), placed, sensor, warnings, views.limits,
        burst, (camera,), cut,
        None if light is None else (light.lit_twice_share, light.corrected_share), (principle,), outline, lit,
        KnownScene(
            tuple(first), tuple(placed), principle, known.ground if known else _ground(views), light is not None,
            None if light is None else light.response, views.axis,
        ),
    )  # fmt: skip


def _ground(views: Views) -> Ground:
    """Vertical and floor as the views have them."""
    return Ground(views.up, views.floor, views.floor_noise, views.disagreement_deg)


def _shows_light(
    image: RgbdImage, views: Views, placed: list[Mirror], principle: Principle, settings: Settings
) -> bool:
    """Whether the readings show light that comes two ways, where that is looked for."""
    sought = settings.light.two_ways != "off" and principle.phase is not False
    return sought and shows_two_way_light(image, views, placed, principle.phase is True)


def _without_pairs(settings: Settings) -> Settings:
    """Settings by which surfaces seen twice move no mirror: light reaches them two ways."""
    return replace(
        settings,
        alignment=replace(settings.alignment, use=False),
        person=replace(settings.person, skin=False),
        agreement=replace(settings.agreement, use=False),
        thickness=replace(settings.thickness, use=False),
    )


def _aligned(
    first: list[Mirror], read: RgbdImage, capture: Capture, settings: Settings, principle: Principle,
    known: KnownScene | None = None,
) -> tuple[RgbdImage, list[Mirror], tuple[str, ...]]:  # fmt: skip
    """The mirrors aligned, or as they are known, the depth without what their glass delays, and what to warn of."""
    if not first:
        return read, [], ()
    warnings: tuple[str, ...] = ()
    if known is not None:
        placed = list(known.mirrors)
    else:
        placed, warnings = align_mirrors(first, read, capture, settings, principle)
    if principle.time is not False:
        read = without_delay(read, placed)
    return read, placed, warnings


def _light_undone(
    read: RgbdImage, first: list[Mirror], principle: Principle, settings: Settings, meeting: np.ndarray | None,
    known: KnownScene | None = None,
) -> TwoWayLight | None:  # fmt: skip
    """:func:`.two_way_light.undo_two_way_light` with the mirrors where their frames are."""
    ground = None if known is None else known.ground
    response = None if known is None else known.response
    views = find_subject(read, first, settings.views, meeting, ground)
    if any(not (views.labels == view).any() for view in range(1, len(first) + 1)):
        read = without_falsified_floor(read, views, first)
        views = find_subject(read, first, settings.views, meeting, ground)
    phase = principle.phase is True or response is not None
    return undo_two_way_light(read, views, first, views.floor_noise, settings.light, phase, response)


_MUCH_LEFT_OUT = 0.1  # share of the subject's readings that is reported when it is left out for want of a response


def unlearnt_light(light: TwoWayLight, views: Views) -> Notice | None:
    """What to do when readings that light reached two ways are left out, because nothing says how to correct them."""
    mine = views.labels >= 0
    share = float((light.spoiled & mine).sum()) / max(int(mine.sum()), 1)
    if light.response is not None or share < _MUCH_LEFT_OUT:
        return None
    return Notice(
        "{share:.0%} of what is seen of the person is left out: light reaches it directly and by way of a mirror, and "
        "the floor does not show what this camera makes of that. Have more of a matt floor about the person in the "
        "picture, or give the camera's modulation (option “frequencies”)",
        share=share,
    )  # fmt: skip


def clean_views(
    image: RgbdImage,
    views: Views,
    mirrors: int,
    settings: DepthSettings,
    model: NoiseModel | None = None,
    spread: np.ndarray | None = None,
) -> tuple[np.ndarray, Views, np.ndarray]:
    """:func:`.clean_views.clean` over all views; returns the noise (N+1,) that was left, relative to z."""
    depth, camera = image.depth, image.intrinsics
    depth, labels, noise = clean(depth, views.labels, mirrors + 1, camera.fx, settings, model, spread)
    return depth, replace(views, labels=labels), noise


def make_patches(
    depth: np.ndarray,
    views: Views,
    mirrors: list[Mirror],
    noise: np.ndarray,
    capture: Capture,
    settings: Settings,
) -> list[Mesh]:
    """Each view triangulated in the camera frame, then flipped over its mirror: that reverses the winding."""
    camera = capture.intrinsics
    points = unproject(depth, camera)
    color = capture.color
    if color is not None:
        jumps = np.array([largest_jump(1.0 / camera.fx, level, settings.triangulation) for level in noise])
        color = colors_from_inside(color, depth, views.labels, jumps, settings.colors)

    def make(view: int) -> Mesh:
        patch = triangulate_view(
            depth, views.labels, view, points, 1.0 / camera.fx, noise[view], color, settings.triangulation
        )
        if view > 0:
            patch = replace(patch, vertices=flattened(patch.vertices, mirrors[view - 1]))
            patch = patch.transformed(reflection_matrix(mirrors[view - 1]))
            patch = replace(patch, triangles=np.ascontiguousarray(patch.triangles[:, ::-1]))
        return patch

    patches = each(make, range(len(mirrors) + 1))
    if not any(len(patch.triangles) for patch in patches):
        raise ReconstructionError(
            "the subject's readings are too noisy to connect; use a longer burst or come closer to the camera",
            code="noise",
        )
    return patches


class Clock:
    """Milliseconds of each stage, by name."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Add the time since the last lap to the stage ``name``."""
        now = time.perf_counter()
        self.laps[name] = self.laps.get(name, 0.0) + 1000.0 * (now - self._last)
        self._last = now


def view_names(mirrors: list[Mirror]) -> list[str]:
    """Names of the views: the direct one, then the mirrors'."""
    return ["direct"] + [mirror.name for mirror in mirrors]
