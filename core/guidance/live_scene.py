"""A running camera's frames, each looked at as it comes: the mirrors placed once, the subject found, the cloud thinned.

The mirrors are placed by what the whole pipeline places them with, from the first frames that show them; later ones are
only sorted by mirrors that are known. What moves, a mirror or the camera, has them placed anew.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace

import numpy as np

from ..camera import Intrinsics, RgbdImage, unproject
from ..camera.noise_models import SENSORS, NoiseModel
from ..capture import Capture, MirrorPicks
from ..depth.depth_map import one_depth_map
from ..depth.sensor_recognition import measuring_principle
from ..errors import MirrorScanError, Notice
from ..mirrors import Mirror
from ..mirrors.glass_extent import with_outline
from ..mirrors.mirror import expected_error
from ..numeric.point_products import dot
from ..pipeline import Settings
from ..pipeline.mirror_placement import align_mirrors, first_mirrors
from ..pipeline.rig_calibration import moved_warning
from ..preview.palette import depth_colors
from ..subject.subject_search import find_subject
from ..subject.subject_views import Views
from ..views.floor_and_vertical import Ground, find_ground
from ..views.ray_sorting import sort_rays
from ..views.rig_axis import rig_axis
from .advice import Advice, advise, arrow_of, step_text

_FRAMES = 5  # that the mirrors are placed with
_TRIES = 4  # to place mirrors where they are said to be, before they are looked for elsewhere
_NEARER = (0.15, 0.03)  # m, and of z: so much before what is behind it somebody is
_MOVED = (0.03, 2)  # m that a moved mirror moves a person's reflection by; and how often in a row that must be seen
_SAME_MIRROR = (0.1, 0.3)  # of the normals' sine, and m between middles: found again, not another one
_LEAST_PERSON, _BODY = (0.2, 0.8), (0.3, 2.4)  # m², and m tall, of a second person; between which heights one is seen
_BESIDE = 0.6  # m: points so far from the middle of somebody are somebody else's
_MOVING = (0.05, 0.35)  # m within s: who goes farther is on the way


@dataclass(frozen=True)
class LiveSettings:
    """How a running camera is looked at.

    Parameters
    ----------
    pixels : int
        Of the thinned depth map that each frame is looked at with, about.
    placing_pixels : int
        Of the depth map that the mirrors are placed with, about.
    mirrors : int
        How many mirrors there are; until so many are found, they are looked for.
    place_every_s, check_every_s : float
        How often mirrors are looked for, and how often it is asked whether one has moved [s].
    improvements : int
        How many times at most mirrors that were found are looked for again, while something is wrong: who stands in the
        wrong place may hide half of a frame.
    beside : bool
        Mirrors are looked for beside the frames, in a thread; else a frame waits for it, and every run is alike.
    pipeline : Settings
        As for a snapshot.
    """

    pixels: int = 19_200
    placing_pixels: int = 120_000
    mirrors: int = 2
    place_every_s: float = 0.7
    check_every_s: float = 0.2
    improvements: int = 4
    beside: bool = True
    pipeline: Settings = Settings()


@dataclass(frozen=True)
class LiveFrame:
    """One frame, looked at.

    Parameters
    ----------
    seconds : float
        When it was taken.
    image : RgbdImage
        Thinned.
    points : np.ndarray [shape=(N, 3), dtype=float32]
        Where its readings really are, reflections flipped back, camera frame [m].
    colors : np.ndarray [shape=(N, 3), dtype=uint8]
        The camera's, or by distance.
    seen : np.ndarray [shape=(N,), dtype=int8]
        Through which mirror, 0 = directly.
    subject : np.ndarray [shape=(N,), dtype=bool]
        Which of them are the subject's.
    views : Views or None
        None where no subject is found.
    mirrors : tuple of Mirror
        As far as they are found; outlines in pixels of ``image``.
    advices : tuple of Advice
        What this frame says.
    """

    seconds: float
    image: RgbdImage
    points: np.ndarray
    colors: np.ndarray
    seen: np.ndarray
    subject: np.ndarray
    views: Views | None
    mirrors: tuple[Mirror, ...]
    advices: tuple[Advice, ...]


@dataclass
class _Placed:
    """What was found once: the mirrors, the ground, the sensor's noise."""

    mirrors: tuple[Mirror, ...] = ()
    framed: dict[str, Mirror] = field(default_factory=dict)  # by name: where their frames are
    thin: tuple[Mirror, ...] = ()  # with outlines in pixels of the thinned image
    ground: Ground | None = None
    model: NoiseModel | None = None
    improved: bool = False  # a mirror that was found before is better known


class LiveScene:
    """``scene.look(depth, color, seconds)`` for each frame of a camera that stands still.

    Parameters
    ----------
    intrinsics : Intrinsics
        Of the camera's depth frames.
    sensor : str
        As of :class:`..capture.live_camera.Stream`.
    known : sequence of MirrorPicks or Mirror
        The mirrors, where they are known; else they are found, and so they are when they cannot be placed there.
    settings : LiveSettings
    """

    def __init__(
        self, intrinsics: Intrinsics, sensor: str = "unknown", known: Sequence[MirrorPicks | Mirror] = (),
        settings: LiveSettings = LiveSettings(),
    ) -> None:  # fmt: skip
        self.settings, self._sensor, self._known = settings, sensor, tuple(known)
        self._camera = intrinsics
        self.step = stride(intrinsics, settings.pixels)
        self.intrinsics = thinned_intrinsics(intrinsics, self.step)
        self._coarse = 1 if self._known else stride(intrinsics, settings.placing_pixels)
        self._recent: deque[np.ndarray] = deque(maxlen=_FRAMES)
        self._placed = _Placed()
        self._work: Future[_Placed] | None = None
        self._tried = self._checked = -np.inf
        self._failed = 0  # times that known mirrors could not be placed
        self._wanted = len(self._known) or settings.mirrors
        self._farthest: np.ndarray | None = None
        self._last: np.ndarray | None = None
        self._suspected: dict[str, int] = {}
        self._improved, self._wrong = 0, False
        self._moved: tuple[str, ...] = ()
        self._path: deque[tuple[float, np.ndarray]] = deque()
        reach = max(int(round(settings.pipeline.views.min_pixels / self.step**2)), 12)
        self._view_settings = replace(settings.pipeline.views, min_pixels=reach)

    @property
    def mirrors(self) -> tuple[Mirror, ...]:
        """Those that are found, outlines in pixels of the thinned image."""
        return self._placed.thin

    @property
    def known(self) -> tuple[MirrorPicks | Mirror, ...]:
        """The mirrors that were known beforehand; none once one has moved, or none was where it was said to be."""
        return self._known

    @property
    def placed(self) -> bool:
        """Whether all mirrors are found."""
        return len(self._placed.mirrors) >= self._wanted

    @property
    def searching(self) -> bool:
        """Whether mirrors are looked for just now, beside the frames."""
        return self._work is not None

    def close(self) -> None:
        """Wait until a search beside the frames has ended."""
        if self._work is not None:
            self._work.exception()
            self._work = None

    def look(self, depth: np.ndarray, color: np.ndarray | None, seconds: float) -> LiveFrame:
        """Look at one frame.

        Parameters
        ----------
        depth : np.ndarray [shape=(H, W), dtype=float32]
            z [m], 0 = no reading.
        color : np.ndarray [shape=(H, W, 3), dtype=uint8] or None
            Aligned to depth; of another size it is not used.
        seconds : float
            When it was taken, by any clock that only goes forward.
        """
        thin = thinned_image(depth, self.step)
        self._recent.append(thinned_image(depth, self._coarse))
        self._receive()
        self._ask_whether_moved(seconds)
        self._place(seconds)
        self._learn(thin)
        image = RgbdImage(thin, self.intrinsics)
        views, elsewhere = self._subject(image)
        advices = self._advices(image, views, elsewhere, seconds)
        self._wrong = any(one.severity == "warning" and one.code not in ("nobody", "moving") for one in advices)
        if views is not None:
            seen, points, labels = views.seen, views.points, views.labels
        else:
            seen, points = sort_rays(unproject(thin, self.intrinsics), list(self._placed.thin))
            labels = np.full(seen.shape, -1, np.int8)
        shown = seen >= 0
        colors = _colors(thin, color, depth.shape, self.step)
        return LiveFrame(
            seconds, image, points[shown].astype(np.float32), colors[shown], seen[shown], labels[shown] >= 0, views,
            self.mirrors, tuple(advices),
        )  # fmt: skip

    # --- the mirrors --------------------------------------------------------------------------------------------------

    def _place(self, seconds: float) -> None:
        """Look for the mirrors, if it is time to."""
        if self._work is not None or len(self._recent) < _FRAMES:
            return
        again = self.placed
        if again and (self._known or self._improved >= self.settings.improvements or not self._wrong):
            return
        if seconds - self._tried < self.settings.place_every_s * (2.0 if again else 1.0):
            return
        self._improved += again
        self._tried = seconds
        frames = np.stack(self._recent)
        if not frames.any():
            return
        if self.settings.beside and not self._known:
            self._work = _beside(lambda: self._found(frames))
            return
        found = self._found(frames)
        self._take(found)
        if self._known and not found.mirrors:
            self._failed += 1
            if self._failed >= _TRIES:
                self._search_anew()

    def _search_anew(self) -> None:
        """Look for the mirrors from now on: where they were said to be, or were found, is of no use any more."""
        self._known, self._work, self._improved = (), None, 0
        self._coarse = stride(self._camera, self.settings.placing_pixels)
        self._recent.clear()

    def _receive(self) -> None:
        """Take what the search beside the frames has found."""
        if self._work is not None and self._work.done():
            work, self._work = self._work, None
            self._take(work.result())

    def _take(self, found: _Placed) -> None:
        if len(found.mirrors) > len(self._placed.mirrors):
            self._placed, self._moved, self._suspected = found, (), {}
            self._path.clear()  # the subject is found in another way from now on
        elif not self._placed.mirrors or (len(found.mirrors) == len(self._placed.mirrors) and found.improved):
            self._placed = found

    def _found(self, frames: np.ndarray) -> _Placed:
        """The mirrors that some frames (F, H, W) show, with those found before."""
        camera = thinned_intrinsics(self._camera, self._coarse)
        settings, before = self.settings.pipeline, self._placed
        capture = Capture(frames, None, camera, name="live", sensor=self._sensor)
        principle = measuring_principle(capture, settings.depth, settings.light.phase_said)
        depth, first, mirrors = frames[-1], [], []
        try:
            depth = one_depth_map(capture, settings.depth)[0]
            first = first_mirrors(self._known, depth, capture, settings)
            mirrors = align_mirrors(first, RgbdImage(depth, camera), capture, settings, principle)[0]
        except MirrorScanError:  # none is seen yet, which the advice says
            pass
        mirrors, improved = joined(list(before.mirrors), mirrors, self._wanted)
        first = [m for m in first if m.name in {one.name for one in mirrors}]
        seen, points = sort_rays(unproject(depth, camera), mirrors)
        return _Placed(
            tuple(mirrors), before.framed | {m.name: m for m in first},
            tuple(m if m.rectangle is None else with_outline(m, self.intrinsics) for m in mirrors),
            find_ground(points, seen, mirrors), SENSORS.get(principle.sensor), improved,
        )  # fmt: skip

    def _ask_whether_moved(self, seconds: float) -> None:
        """Have the mirrors placed anew where one, or the camera, has moved."""
        placed = self._placed
        if not placed.mirrors or seconds - self._checked < self.settings.check_every_s:
            return
        self._checked = seconds
        limit, times = _MOVED
        image = RgbdImage(self._recent[-1], thinned_intrinsics(self._camera, self._coarse))
        for mirror in placed.mirrors:
            framed = placed.framed.get(mirror.name)
            moved = False
            if framed is not None and framed.rectangle is not None and framed.covariance is not None:
                moved = moved_warning(image, framed, limit) is not None
            self._suspected[mirror.name] = self._suspected.get(mirror.name, 0) + 1 if moved else 0
        certain = tuple(name for name, count in self._suspected.items() if count >= times)
        if not certain:
            return
        self._moved, self._suspected = tuple(dict.fromkeys((*self._moved, *certain))), {}
        self._placed = _without(placed, certain)
        self._search_anew()
        if not self._placed.mirrors:  # then it may have been the camera, and the room is elsewhere, too
            self._placed = replace(self._placed, ground=None)
            self._farthest = self._last = None

    # --- the subject --------------------------------------------------------------------------------------------------

    def _learn(self, thin: np.ndarray) -> None:
        """What is behind everybody: the farthest that two frames one after the other agree on."""
        if self._last is not None:
            agreed = np.where((thin > 0) & (self._last > 0), np.minimum(thin, self._last), 0.0)
            self._farthest = agreed if self._farthest is None else np.maximum(self._farthest, agreed)
        self._last = thin

    def _nearer(self, thin: np.ndarray) -> np.ndarray:
        """Pixels (H, W) at which something stands before what was seen there earlier."""
        if self._farthest is None:
            return np.zeros(thin.shape, np.bool_)
        return (thin > 0) & (thin < self._farthest * (1.0 - _NEARER[1]) - _NEARER[0])

    def _subject(self, image: RgbdImage) -> tuple[Views | None, np.ndarray | None]:
        """The subject where the rig looks; else where somebody is (3,), beside it."""
        mirrors, ground = list(self._placed.thin), self._placed.ground
        if not image.depth.any():
            return None, None
        try:
            return find_subject(image, mirrors, self._view_settings, ground=ground), None
        except MirrorScanError:  # nobody there, which is what is asked
            pass
        found = self._figure(image, *sort_rays(unproject(image.depth, self.intrinsics), mirrors))
        place = None if found is None else np.median(found, axis=0)
        if place is None:
            return None, None
        try:
            return find_subject(image, mirrors, self._view_settings, place, ground), place
        except MirrorScanError:
            return None, place

    def _figure(
        self, image: RgbdImage, seen: np.ndarray, points: np.ndarray, apart_from: np.ndarray | None = None
    ) -> np.ndarray | None:
        """Points (N, 3) of somebody who came into the picture, as tall and large as a person; None where nobody did.

        Nor before all mirrors are known: who is seen in one looks like somebody else.

        ``seen`` (H, W) and ``points`` (H, W, 3): as :func:`..views.ray_sorting.sort_rays` has them.
        """
        ground = self._placed.ground
        if ground is None or ground.floor is None or not self.placed:
            return None
        there = (seen == 0) & self._nearer(image.depth)
        some = points[there]
        height = dot(some, ground.up) - ground.floor
        some = some[(height > _BODY[0]) & (height < _BODY[1])]
        if apart_from is not None and len(some):
            off = some - apart_from
            off -= np.outer(dot(off, ground.up), ground.up)
            some = some[np.linalg.norm(off, axis=1) > _BESIDE]
        if not len(some):
            return None
        middle = np.median(some, axis=0)
        off = some - middle
        off -= np.outer(dot(off, ground.up), ground.up)
        some = some[np.linalg.norm(off, axis=1) < _BESIDE]
        if not len(some):
            return None
        area = float(((some[:, 2] / self.intrinsics.fx) ** 2).sum())
        tall = float(np.ptp(dot(some, ground.up)))
        return some if area > _LEAST_PERSON[0] and tall > _LEAST_PERSON[1] else None

    # --- advice -------------------------------------------------------------------------------------------------------

    def _advices(
        self, image: RgbdImage, views: Views | None, elsewhere: np.ndarray | None, seconds: float
    ) -> list[Advice]:
        advices = self._of_rig()
        if views is None:
            self._path.clear()
            return [*advices, self._nobody(elsewhere)]
        if self._is_on_the_way(views, seconds):
            advices.append(Advice("moving", Notice("hold still, where you want to be scanned"), what="subject"))
        second = self._figure(image, np.where(views.labels < 0, views.seen, -1), views.points, views.axis)
        if second is not None:
            text = Notice("two people are in the picture; one of you, step out of it, and out of the mirrors")
            middle = np.median(second, axis=0)
            away = middle - views.axis
            away -= (away @ views.up) * views.up
            advices.append(Advice("two_people", text, arrow_of(middle, away), what="subject"))
        if not self._placed.mirrors or self._moved:
            return advices
        if elsewhere is not None:
            return [*advices, self._nobody(elsewhere)]
        return advices + advise(image, views, self._placed.thin, self._placed.model)

    def _of_rig(self) -> list[Advice]:
        """Of mirrors that are not found, or have moved."""
        found = [m.name for m in self._placed.mirrors]
        if len(self._moved) > 1:
            text = Notice("the camera was moved; leave it where it is now: the mirrors are looked for again")
            return [Advice("camera_moved", text, what="camera")]
        if self._moved:
            text = Notice(
                "{name} was moved; leave it where it is now, and stand where it shows you: it is looked for again",
                name=self._moved[0],
            )
            return [Advice("mirror_moved", text, where=self._moved[0], what="mirror")]
        if self.placed:
            return []
        if found:
            text = Notice(
                "only {names} is found of {count} mirrors; stand where all mirrors show you, 2 to 3 m from the camera",
                names=", ".join(found), count=self._wanted,
            )  # fmt: skip
        else:
            text = Notice(
                "the mirrors are looked for; stand where all of them show you, 2 to 3 m from the camera, and hold still"
            )
        return [Advice("mirrors_missing", text)]

    def _nobody(self, elsewhere: np.ndarray | None) -> Advice:
        """Nobody stands where the mirrors look."""
        ground, mirrors = self._placed.ground, list(self._placed.thin)
        middle = None if ground is None or not mirrors else rig_axis(mirrors, ground.up, self.intrinsics)
        if middle is None or ground is None:
            return Advice("nobody", Notice("nobody is seen; stand between the camera and the mirrors"), what="subject")
        foot = middle if ground.floor is None else middle + (ground.floor - middle @ ground.up) * ground.up
        if elsewhere is None:
            text = Notice(
                "nobody is seen; stand in front of the mirrors, {distance:.1f} m from the camera", distance=middle[2]
            )
            return Advice("nobody", text, arrow_of(foot + 0.5 * ground.up, -0.5 * ground.up), what="subject")
        step = middle - elsewhere
        step -= (step @ ground.up) * ground.up
        start = foot - step
        if np.linalg.norm(step) < 0.1:
            return Advice("nobody", Notice("nobody is seen whole; stand up, in front of the mirrors"), what="subject")
        text = Notice("step {way}, to where the mirrors look", way=step_text(step, ground.up, elsewhere))
        return Advice("step", text, arrow_of(start, step), what="subject")

    def _is_on_the_way(self, views: Views, seconds: float) -> bool:
        """Whether the subject walks."""
        far, within = _MOVING
        self._path.append((seconds, views.axis - (views.axis @ views.up) * views.up))
        while self._path[0][0] < seconds - within:
            self._path.popleft()
        places = np.array([place for _, place in self._path])
        return bool(np.linalg.norm(places - places[-1], axis=1).max() > far)


def stride(intrinsics: Intrinsics, pixels: int) -> int:
    """Every so many-th row and column leave about so many pixels."""
    return max(1, int(round(np.sqrt(intrinsics.width * intrinsics.height / pixels))))


def thinned_image(image: np.ndarray, step: int) -> np.ndarray:
    """Every ``step``-th row and column (H / step, W / step, …) of an image, from the middle of the first square on."""
    return np.ascontiguousarray(image[step // 2 :: step, step // 2 :: step])


def thinned_intrinsics(intrinsics: Intrinsics, step: int) -> Intrinsics:
    """Of :func:`thinned_image`."""
    first = step // 2
    return Intrinsics(
        len(range(first, intrinsics.width, step)), len(range(first, intrinsics.height, step)), intrinsics.fx / step,
        intrinsics.fy / step, (intrinsics.cx - first) / step, (intrinsics.cy - first) / step,
    )  # fmt: skip


def _without(placed: _Placed, names: Sequence[str]) -> _Placed:
    """What was found, without some of the mirrors."""
    mirrors, thin = (tuple(m for m in some if m.name not in names) for some in (placed.mirrors, placed.thin))
    return replace(placed, mirrors=mirrors, thin=thin)


def joined(before: list[Mirror], found: list[Mirror], wanted: int) -> tuple[list[Mirror], bool]:
    """Mirrors found before and now, each with a name of its own; whether one of the first is better known now.

    Where that would be more than are ``wanted``, one is none: those of one search alone are kept, of the first that
    found as many as are wanted.
    """
    sine, apart = _SAME_MIRROR
    mirrors, improved = list(before), False
    for one in found:
        same = [
            k
            for k, m in enumerate(before)
            if np.linalg.norm(np.cross(one.normal, m.normal)) < sine and np.linalg.norm(one.point - m.point) < apart
        ]
        if same:
            if _is_better(one, mirrors[same[0]]):
                mirrors[same[0]], improved = replace(one, name=mirrors[same[0]].name), True
            continue
        name, taken = one.name, {m.name for m in mirrors}
        while name in taken:
            name += " 2"
        mirrors.append(replace(one, name=name))
    if len(mirrors) > max(wanted, len(before)):
        return (found, True) if len(before) < wanted <= len(found) else (mirrors[: len(before)], improved)
    return mirrors, improved


def _is_better(one: Mirror, before: Mirror) -> bool:
    """Whether a mirror that was found again shows more of its glass, or is more certain."""
    error, known = expected_error(one), expected_error(before)
    larger = _area(one) > 1.02 * _area(before)
    return (larger and error <= 3.0 * known) or (error < 0.6 * known and _area(one) > 0.98 * _area(before))


def _area(mirror: Mirror) -> float:
    """Of its rectangle [m²]; of one of unknown extent, 0."""
    return 0.0 if mirror.rectangle is None else float(np.prod(np.diff(mirror.rectangle, axis=1)))


def _colors(thin: np.ndarray, color: np.ndarray | None, shape: tuple[int, ...], step: int) -> np.ndarray:
    """Colours (H, W, 3) uint8 of the thinned image: the camera's where it is aligned to depth, else by distance."""
    if color is not None and color.shape[:2] == shape:
        return thinned_image(color, step)
    return depth_colors(thin)


def _beside(job: Callable[[], _Placed]) -> Future[_Placed]:
    """Have a job done in a thread that does not outlive the program."""
    future: Future[_Placed] = Future()

    def run() -> None:
        try:
            future.set_result(job())
        except BaseException as error:
            future.set_exception(error)

    threading.Thread(target=run, name="Mirror Scan places mirrors", daemon=True).start()
    return future
