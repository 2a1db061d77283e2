"""A recording → one closed avatar a frame, in order, as they are made: :func:`reconstruct_sequence`."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..camera.noise_models import SENSORS
from ..capture import Capture
from ..errors import MirrorScanError, Notice
from ..mesh import Mesh
from ..numeric.threads import thread_count
from ..pipeline import KnownScene, Settings, reconstruct
from .exposure import match_frame
from .recording import Recording
from .rig_placement import SequenceRig
from .surface_filter import SurfaceFilter, SurfaceFilterSettings
from .temporal_filter import DepthFilter, FilterSettings

if TYPE_CHECKING:
    from ..cluster import TaskRunner

MADE, BRIDGED, LOST = "made", "bridged", "lost"
"""States of a frame: reconstructed; the mesh before it is held; nothing to be held, or for too long."""

_KNOWN_VOLUMES = 5  # frames whose median a volume is held against


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
        It took, reading aside.
    """

    place: int
    number: int
    state: str
    mesh: Mesh | None
    reason: str = ""
    report: dict | None = None
    steadied: float = 0.0
    seconds: float = 0.0


def reconstruct_sequence(
    recording: Recording,
    rig: SequenceRig,
    settings: Settings = Settings(),
    sequence: SequenceSettings = SequenceSettings(),
    skip: Callable[[int], bool] | None = None,
    runner: TaskRunner | None = None,
) -> Iterator[SequenceFrame]:
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
        Frames that are there already: they only go through the filter, and are not yielded.
    runner : TaskRunner, optional
        Workers of :mod:`..cluster` that make the frames; by default this process does.

    Notes
    -----
    Holds as many frames as are made at the same time, and the filters' last; any length of recording takes as much.
    Frames do not depend on how many are made at the same time. A frame's report is of the mesh before it is steadied,
    which moves vertices and leaves triangles as they are.
    """
    settings = replace(settings, skeleton=False, measure=False, triangles=None, texture=None)
    judge = _Judge(sequence)
    jobs = _jobs(recording, rig, sequence, skip)
    made = _made_here(jobs, rig, settings, sequence) if runner is None else _made_by(runner, jobs, rig, settings)
    for job in made:
        yield judge.judged(job, rig)


def _made_here(
    jobs: Iterator[_Job], rig: SequenceRig, settings: Settings, sequence: SequenceSettings
) -> Iterator[_Job]:
    """The frames made by threads of this process, in order."""
    workers = sequence.workers or min(2, thread_count())
    with ThreadPoolExecutor(workers, thread_name_prefix="mirror_scan_frame") as pool:
        waiting: deque[tuple[_Job, Future | None]] = deque()
        try:
            for job in jobs:
                capture, job.capture = job.capture, None
                task = None if capture is None else pool.submit(frame_made, capture, rig.scene, settings)
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
        except MirrorScanError as fault:
            job.fault = fault
    return job


def _made_by(runner: TaskRunner, jobs: Iterator[_Job], rig: SequenceRig, settings: Settings) -> Iterator[_Job]:
    """The frames made by workers, which end in any order, in order."""
    waiting: deque[_Job] = deque()
    tasks: list[_Job] = []

    def arguments() -> Iterator[tuple]:
        for job in jobs:
            waiting.append(job)
            if job.capture is not None:
                tasks.append(job)
                yield job.capture, rig.scene, settings

    for outcome in runner.run(frame_made, arguments()):
        job = tasks[outcome.number]
        job.capture = None
        if outcome.error is None:
            job.made = outcome.value
        elif isinstance(outcome.error, MirrorScanError):
            job.fault = outcome.error
        else:
            raise outcome.error
        while waiting and (waiting[0].made is not None or waiting[0].fault is not None):
            yield waiting.popleft()
    yield from waiting


@dataclass
class _Job:
    """A frame on its way."""

    place: int
    number: int
    capture: Capture | None = None
    fault: MirrorScanError | None = None
    steadied: float = 0.0
    made: FrameMade | None = None


def _jobs(
    recording: Recording, rig: SequenceRig, sequence: SequenceSettings, skip: Callable[[int], bool] | None
) -> Iterator[_Job]:
    """The frames read and steadied, one after the other."""
    steady: DepthFilter | None = None
    for place, number in enumerate(recording.numbers):
        skipped = skip is not None and skip(place)
        try:
            capture = recording.read(number)
        except MirrorScanError as fault:
            if not skipped:
                yield _Job(place, number, fault=fault)
            continue
        if steady is None:
            model = SENSORS.get(rig.scene.principle.sensor)
            steady = DepthFilter(capture.intrinsics, model, sequence.filter, rig.background)
        depth = steady.next(capture.depth[0])
        if skipped:
            continue
        capture = match_frame(capture, rig.color, rig.background)
        share = steady.share
        yield _Job(place, number, replace(capture, depth=depth[None]), steadied=share)


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

    def __init__(self, settings: SequenceSettings) -> None:
        self._settings, self._steady = settings, SurfaceFilter(settings.surface)
        self._volumes: deque[float] = deque(maxlen=_KNOWN_VOLUMES)
        self._last: Mesh | None = None
        self._held = 0

    def judged(self, job: _Job, rig: SequenceRig) -> SequenceFrame:
        """The frame, once it is made."""
        result = job.made
        if result is None:
            return self._bridged(job, str(job.fault))
        reason = self._fault(result.report["mesh"])
        if reason:
            return self._bridged(job, reason)
        self._volumes.append(result.report["mesh"]["volume_l"])
        self._held = 0
        self._last = self._steady.next(result.mesh.transformed(rig.to_avatar))
        return SequenceFrame(
            job.place, job.number, MADE, self._last, "", result.report, job.steadied, result.seconds
        )  # fmt: skip

    def _fault(self, mesh: dict) -> str:
        """What is wrong with a mesh, in one sentence; empty when nothing is."""
        if not (mesh["watertight"] and mesh["manifold"]):
            return "its mesh is not closed"
        if len(self._volumes) < self._volumes.maxlen // 2 + 1:  # type: ignore[operator]  # it has one
            return ""
        usual, now = float(np.median(self._volumes)), mesh["volume_l"]
        if abs(now / usual - 1.0) > self._settings.volume_change:
            return Notice(
                "the body has {now:.0f} l where the frames before have {usual:.0f} l: it moved too fast for the "
                "camera, or something hides a part of it",
                now=now, usual=usual,
            )  # fmt: skip
        return ""

    def _bridged(self, job: _Job, reason: str) -> SequenceFrame:
        self._held += 1
        if self._last is None or self._held > self._settings.hold:
            return SequenceFrame(job.place, job.number, LOST, None, reason, None, job.steadied)
        return SequenceFrame(job.place, job.number, BRIDGED, self._last, reason, None, job.steadied)
