"""A recording → one closed avatar a frame, in order, as they are made: :func:`reconstruct_sequence`."""

from __future__ import annotations

import contextlib
import itertools
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..camera.noise_models import SENSORS
from ..capture import Capture
from ..errors import MirrorScanError, Notice, ReconstructionError
from ..mesh import Mesh
from ..mesh.soundness import volume
from ..numeric.threads import thread_count
from ..pipeline import KnownScene, Settings, reconstruct
from .exposure import match_frame
from .recording import Recording
from .rig_placement import SequenceRig
from .subject_following import SubjectFollower
from .surface_filter import SurfaceFilter, SurfaceFilterSettings
from .temporal_filter import DepthFilter, FilterSettings

if TYPE_CHECKING:
    from ..cluster import TaskRunner

MADE, BRIDGED, LOST = "made", "bridged", "lost"
"""States of a frame: reconstructed; the mesh before it is held; nothing to be held, or for too long."""

_KNOWN_VOLUMES = 5  # frames whose median a volume is held against
_FORGOTTEN = 4  # memories of the depth filter, after which a frame counts for nothing any more


@dataclass(frozen=True)
class SequenceSettings:
    """How a recording is gone through.

    Parameters
    ----------
    filter, surface : FilterSettings, SurfaceFilterSettings
        How depth, and the closed surfaces, are steadied in time.
    workers : int
        Frames made at the same time; 0 = as many as there are cores, two at most.
    hold : int
        Frames that the last good mesh is held for at most.
    volume_change : float
        A body whose volume differs from that of the frames before by more than this share is not whole [0..1].
    """

    filter: FilterSettings = FilterSettings()
    surface: SurfaceFilterSettings = SurfaceFilterSettings()
    workers: int = 0
    hold: int = 15
    volume_change: float = 0.3


@dataclass(frozen=True)
class SequenceFrame:
    """One frame of a recording.

    Parameters
    ----------
    place, number : int
        In the sequence; in the recording.
    state : str
        "made", "bridged" or "lost".
    mesh : Mesh or None
        Closed, in the frame of :attr:`.rig_placement.SequenceRig.to_avatar`; None when the frame is lost.
    reason : str
        Why it was not made; empty when it was.
    report : dict
        Of the pipeline, :attr:`..pipeline.Reconstruction.report`; empty when it was not made.
    steadied : float
        Share of its readings that were averaged with those of the frames before [0..1].
    seconds : float
        Of work on it, reading aside; some of it beside that on other frames.
    again : bool
        It was not made for a reason that may pass, such as a lost worker.
    """

    place: int
    number: int
    state: str
    mesh: Mesh | None
    reason: str = ""
    report: dict | None = None
    steadied: float = 0.0
    seconds: float = 0.0
    again: bool = False


def reconstruct_sequence(
    recording: Recording,
    rig: SequenceRig,
    settings: Settings = Settings(),
    sequence: SequenceSettings = SequenceSettings(),
    skip: Callable[[int], bool] | None = None,
    runner: TaskRunner | None = None,
    kept: Callable[[int], Mesh | None] | None = None,
) -> Generator[SequenceFrame, None, None]:
    """Each frame's closed avatar, in order.

    Parameters
    ----------
    recording : Recording
    rig : SequenceRig
        Of :func:`.rig_placement.place_rig`.
    settings : Settings
        As for one snapshot; skeleton, measurements, texture and fewer triangles are not made.
    sequence : SequenceSettings
    skip : callable(place), optional
        Frames that are there already: they are not yielded. Those shortly before others are read once more, for the
        filter.
    runner : TaskRunner, optional
        Workers of :mod:`..cluster` that make the frames; by default this process does.
    kept : callable(place), optional
        The mesh of a frame that is there already, None where it has none: what follows is steadied and bridged by it.

    Notes
    -----
    Holds as many frames as are made at the same time, and the filters' last; any length of recording takes as much.
    Frames do not depend on how many are made at the same time. A frame's report is of the mesh before it is steadied,
    which moves vertices and leaves triangles as they are. Close the iterator where it is left before its end: frames
    that have not begun are then not made.
    """
    settings = replace(
        settings, skeleton=False, measure=False, triangles=None, texture=None,
        views=replace(settings.views, click=None),
    )  # fmt: skip  # a click shows where the subject stood once
    judge = _Judge(sequence, kept)
    jobs = _jobs(recording, rig, settings, sequence, skip)
    made = _made_here(jobs, settings, sequence) if runner is None else _made_by(runner, jobs, settings)
    with contextlib.closing(made):
        for job in made:
            if job.kept:
                judge.goes_on_from(job.place)
            else:
                yield judge.judged(job, rig)


def _made_here(jobs: Iterator[_Job], settings: Settings, sequence: SequenceSettings) -> Generator[_Job, None, None]:
    """The frames made by threads of this process, in order."""
    workers = sequence.workers or min(2, thread_count())
    with ThreadPoolExecutor(workers, thread_name_prefix="mirror_scan_frame") as pool:
        waiting: deque[tuple[_Job, Future | None]] = deque()
        try:
            for job in jobs:
                given, job.given = job.given, None
                task = None if given is None else pool.submit(frame_made, *given, settings)
                waiting.append((job, task))
                if len(waiting) > workers:
                    yield _ended(*waiting.popleft())
            while waiting:
                yield _ended(*waiting.popleft())
        finally:
            for _, task in waiting:
                if task is not None:
                    task.cancel()


def _ended(job: _Job, task: Future | None) -> _Job:
    """The job with what its task gave, waited for."""
    if task is not None:
        try:
            job.made = task.result()
        except Exception as fault:  # it is the frame's: reported with it
            job.fault = fault
    return job


def _made_by(runner: TaskRunner, jobs: Iterator[_Job], settings: Settings) -> Generator[_Job, None, None]:
    """The frames made by workers, which end in any order, in order."""
    waiting: deque[_Job] = deque()
    running: dict[int, _Job] = {}
    numbers = itertools.count()

    def arguments() -> Iterator[tuple]:
        for job in jobs:
            waiting.append(job)
            if job.given is not None:
                running[next(numbers)] = job
                given, job.given = job.given, None
                yield *given, settings

    with contextlib.closing(runner.run(frame_made, arguments())) as outcomes:
        for outcome in outcomes:
            job = running.pop(outcome.number)
            job.made, job.fault = outcome.value, outcome.error
            while waiting and waiting[0].is_done:
                yield waiting.popleft()
    yield from waiting


@dataclass
class _Job:
    """A frame on its way; ``given``: what it is made of; ``kept``: it is there already."""

    place: int
    number: int
    given: tuple[Capture, KnownScene] | None = None
    fault: Exception | None = None
    steadied: float = 0.0
    seconds: float = 0.0
    made: FrameMade | None = None
    kept: bool = False

    @property
    def is_done(self) -> bool:
        return self.kept or self.made is not None or self.fault is not None


def _jobs(
    recording: Recording,
    rig: SequenceRig,
    settings: Settings,
    sequence: SequenceSettings,
    skip: Callable[[int], bool] | None,
) -> Iterator[_Job]:
    """The frames read and steadied, one after the other."""
    steady: DepthFilter | None = None
    follower: SubjectFollower | None = None
    there = [skip is not None and skip(place) for place in range(len(recording))]
    far = _FORGOTTEN * sequence.filter.memory if sequence.filter.use else 0
    for place, number in enumerate(recording.numbers):
        if there[place]:
            yield _Job(place, number, kept=True)
            if all(there[place + 1 : place + 1 + far]):  # nothing near is made with it
                continue
        try:
            capture = recording.read(number)
        except MirrorScanError as fault:
            if not there[place]:
                yield _Job(place, number, fault=fault)
            continue
        started = time.perf_counter()
        if steady is None or follower is None:
            model = SENSORS.get(rig.scene.principle.sensor)
            steady = DepthFilter(capture.intrinsics, model, sequence.filter, rig.background)
            follower = SubjectFollower(rig.scene, capture.intrinsics, rig.background, settings.views.reach)
        depth = steady.next(capture.depth[0])
        scene = replace(rig.scene, subject=follower.next(depth))
        if there[place]:
            continue
        capture = replace(match_frame(capture, rig.color, rig.background), depth=depth[None])
        yield _Job(place, number, (capture, scene), steadied=steady.share, seconds=time.perf_counter() - started)


class FrameMade(NamedTuple):
    """A frame's mesh in the camera's frame, its report, and the seconds it took."""

    mesh: Mesh
    report: dict
    seconds: float


def frame_made(capture: Capture, scene: KnownScene, settings: Settings) -> FrameMade:
    """One frame reconstructed in a scene that is known: the task of a worker.

    Raises
    ------
    MirrorScanError
        As of :func:`..pipeline.reconstruct`.
    """
    started = time.perf_counter()
    result = reconstruct(capture, (), settings, frame="camera", scene=scene)
    return FrameMade(result.mesh, result.report, time.perf_counter() - started)


class _Judge:
    """Says what becomes of each frame: it is taken, or bridged by the last one that was."""

    def __init__(self, settings: SequenceSettings, kept: Callable[[int], Mesh | None] | None = None) -> None:
        self._settings, self._steady, self._kept = settings, SurfaceFilter(settings.surface), kept
        self._volumes: deque[float] = deque(maxlen=_KNOWN_VOLUMES)
        self._refused: deque[float] = deque(maxlen=_KNOWN_VOLUMES)
        self._last: Mesh | None = None
        self._before: int | None = None  # the frame before, where it is one that was there already
        self._held = 0

    def goes_on_from(self, place: int) -> None:
        """A frame that is there already comes before the next."""
        self._before = place

    def judged(self, job: _Job, rig: SequenceRig) -> SequenceFrame:
        """The frame, once it is made."""
        started = time.perf_counter()
        self._recall()
        result = job.made
        if result is None:
            return self._bridged(job, job.fault)
        reason = self._fault(result.report["mesh"])
        if reason:
            return self._bridged(job, ReconstructionError(reason))
        self._volumes.append(result.report["mesh"]["volume_l"])
        self._refused.clear()
        self._held = 0
        self._last = self._steady.next(result.mesh.transformed(rig.to_avatar))
        seconds = job.seconds + result.seconds + time.perf_counter() - started
        return SequenceFrame(job.place, job.number, MADE, self._last, "", result.report, job.steadied, seconds)

    def _recall(self) -> None:
        """Take the mesh of the frame before, where it is one that was there already."""
        place, self._before = self._before, None
        if place is None or self._kept is None:
            return
        mesh = self._kept(place)
        if mesh is not None:
            self._last, self._held = mesh, 0
            self._volumes.append(1000.0 * volume(mesh))
            self._steady.begin(mesh)

    def _fault(self, mesh: dict) -> str:
        """What is wrong with a mesh, in one sentence; empty when nothing is."""
        if not (mesh["watertight"] and mesh["manifold"]):
            return "its mesh is not closed"
        if len(self._volumes) < _KNOWN_VOLUMES // 2 + 1:
            return ""
        usual, now = float(np.median(self._volumes)), mesh["volume_l"]
        if self._is_near(now, usual):
            return ""
        self._refused.append(now)
        if self._held >= self._settings.hold and self._agree():
            self._volumes = deque(self._refused, _KNOWN_VOLUMES)  # it was the frames before that showed less, or more
            return ""
        return Notice(
            "the body has {now:.0f} l where the frames before have {usual:.0f} l: it moved too fast for the "
            "camera, or something hides a part of it",
            now=now, usual=usual,
        )  # fmt: skip

    def _is_near(self, now: float, usual: float) -> bool:
        return abs(now / usual - 1.0) <= self._settings.volume_change

    def _agree(self) -> bool:
        """Whether the last volumes that were refused are one body's."""
        middle = float(np.median(self._refused))
        return len(self._refused) == _KNOWN_VOLUMES and all(self._is_near(one, middle) for one in self._refused)

    def _bridged(self, job: _Job, fault: Exception | None) -> SequenceFrame:
        self._held += 1
        held = self._last is not None and self._held <= self._settings.hold
        return SequenceFrame(
            job.place, job.number, BRIDGED if held else LOST, self._last if held else None, _in_words(fault), None,
            job.steadied, again=_is_passing(fault),
        )  # fmt: skip


def _in_words(fault: Exception | None) -> str:
    """Why a frame was not made."""
    if isinstance(fault, MirrorScanError):
        return str(fault)
    return f"a fault of the program: {type(fault).__name__}: {fault}"


def _is_passing(fault: Exception | None) -> bool:
    """Whether the frame may well be made another time: it is not its own fault."""
    from ..cluster import ClusterError

    return not isinstance(fault, MirrorScanError) or isinstance(fault, ClusterError) or fault.code == "gone"
