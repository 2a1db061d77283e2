"""``batch``: many captures, each an avatar, over the cores of this machine or over a cluster."""

from __future__ import annotations

import argparse
import contextlib
import errno
import importlib.util
import itertools
import os
import platform
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import CaptureError, MirrorScanError, OutputError, ReconstructionError
from .commands import avatar_to_files, check_wishes, reading_of, worker_settings
from .outputs import Writers, check_apart
from .terminal import advance, complain, complaints_heard, duration, progress_bar, say

if TYPE_CHECKING:
    from ..batches import BatchFolder, Finished, Found, Row
    from ..cluster import Outcome, TaskRunner, WorkerSettings
    from ..pipeline import Reconstruction
    from ..pipeline.reconstruction import Progress

AVATAR, REPORT, PREVIEW, THUMBNAIL = "avatar", "report.json", "preview.png", "thumbnail.png"
WORKER_LOG = "workers.log"
_SHOWN = (THUMBNAIL, PREVIEW, REPORT)
_NOT_SETTINGS = frozenset(
    ("captures", "folder", "run", "find_bridge", "readers", "quiet", "workers", "threads", "memory", "scheduler",
     "wait", "every_frames", "frames")
)  # fmt: skip
"""Options that do not belong to one avatar; its frames are chosen for each."""
_NO_ROOM = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))
_PREVIEW_SIZE, _THUMBNAIL_SIZE = (300, 480), (110, 176)


@dataclass
class _Job:
    """A capture of the batch, or some frames of it, and what became of it."""

    path: Path
    frames: str | None
    error: MirrorScanError | None = None
    row: Row | None = None
    key: str = ""
    size: int = 0  # bytes

    @property
    def label(self) -> str:
        return f"{self.path}{f' [{self.frames}]' if self.frames else ''}"

    @property
    def source(self) -> str:
        return f"{os.path.abspath(self.path)}{f' [{self.frames}]' if self.frames else ''}"

    @property
    def name(self) -> str:
        """What its folder is to be called."""
        whole = Path(os.path.abspath(self.path))
        name = whole.name if os.path.isdir(whole) else whole.stem
        return f"{name}_{self.frames.replace(':', '-')}" if self.frames else name


class Made(NamedTuple):
    """What a worker sends back: the files of a result by name, what the summary shows, and what was said of it."""

    files: dict[str, bytes]
    figures: dict[str, Any]
    said: list[str]


def run_batch(options: argparse.Namespace, writers: Writers) -> None:
    """``batch``: make an avatar of each of many captures."""
    from ..batches import find_captures, open_batch_folder

    options.skeleton = options.skeleton or options.vrm
    options.formats = tuple(dict.fromkeys(options.formats or ["glb"]))
    settings = worker_settings(options, options.folder / WORKER_LOG)
    if options.every_frames and options.single_frame:
        raise OutputError("--every-frames: takes bursts of a recording; leave out --single-frame")
    outputs = [Path(f"{AVATAR}.{suffix}") for suffix in options.formats]
    check_wishes(argparse.Namespace(**vars(options) | {"outputs": outputs}))
    found = find_captures(options.captures)
    if not found:
        raise CaptureError("no capture was found")
    for one in found:
        if one.error is None:
            check_apart(options.folder, one.path)
    jobs = [job for one in found for job in _jobs_of(one, options)]
    folder = open_batch_folder(options.folder)
    batch = _Batch(jobs, folder, options)
    try:
        batch.run(settings)
    except KeyboardInterrupt as stop:
        batch.finish()
        done = sum(job.row is not None and job.row.state in ("made", "kept") for job in jobs)
        raise type(stop)(
            f"interrupted; {done} of {len(jobs)} captures are done, and the same command goes on from there"
        ) from None
    except BaseException:
        batch.finish()
        raise
    page = batch.finish()
    failed = sum(job.row is not None and job.row.state == "failed" for job in jobs)
    if not options.quiet:
        say(f"  {page}")
    if failed:
        raise ReconstructionError(
            "{failed} of {count} captures failed; {page} says why", failed=failed, count=len(jobs), page=page
        )


class _Read(NamedTuple):
    """What a capture's files are: digest, what counts beside them, and how many bytes."""

    content: str
    beside: list
    size: int


def _read(path: Path) -> _Read:
    from ..batches import content_digest, surroundings

    if not os.path.lexists(path) and os.access(path.parent, os.R_OK | os.X_OK):
        raise CaptureError("{path}: there is no such file or folder", path=path)
    content, size = content_digest(path)
    return _Read(content, surroundings(path), size)


def _read_into(path: Path, answer: Future[_Read]) -> None:
    try:
        answer.set_result(_read(path))
    except Exception as error:  # raised where the answer is asked for
        answer.set_exception(error)


def _jobs_of(one: Found, options: argparse.Namespace) -> list[_Job]:
    """A capture whole, or, with ``--every-frames``, piece by piece."""
    if one.error is not None or not options.every_frames:
        return [_Job(one.path, options.frames, one.error)]
    from ..capture import frame_count
    from ..capture.camera_poses import holds_poses
    from ..capture.frames import chosen_frames

    try:
        if holds_poses(one.path):
            raise CaptureError("{path}: holds several cameras; leave out --every-frames", path=one.path)
        chosen = chosen_frames(one.path, options.frames, frame_count(one.path, reading_of(options)[1]))
    except MirrorScanError as error:
        return [_Job(one.path, None, error)]
    except OSError as error:
        reason = error.strerror or error
        return [_Job(one.path, None, CaptureError("{path}: cannot be read: {reason}", path=one.path, reason=reason))]
    pieces = [chosen[k : k + options.every_frames] for k in range(0, len(chosen), options.every_frames)]
    step = "" if chosen.step == 1 else f":{chosen.step}"
    return [_Job(one.path, f"{piece[0]}:{piece[-1] + 1}{step}") for piece in pieces]


class _Batch:
    """The captures on their way through the workers."""

    def __init__(self, jobs: list[_Job], folder: BatchFolder, options: argparse.Namespace) -> None:
        self._jobs, self._folder, self._options = jobs, folder, options
        self._on_their_way: dict[str, list[_Job]] = {}
        self._submitted: list[_Job] = []
        self._dealt_with = 0
        self._progress: Progress | None = None
        self._settings = ""
        self._reading: tuple[Path, Future[_Read]] | None = None  # of the capture that is next, while workers work
        self._sent = argparse.Namespace(
            **{
                name: Path(os.path.abspath(value)) if isinstance(value, Path) else value
                for name, value in vars(options).items()
                if name not in _NOT_SETTINGS
            }
        )

    def run(self, settings: WorkerSettings) -> None:
        """Make what is not made yet."""
        from ..batches import settings_digest
        from ..cluster import start_workers

        self._settings = settings_digest(vars(self._sent))
        with progress_bar(self._options.quiet) as progress:
            self._progress = progress
            advance(progress, 0.0, "looking for what is done already")
            tasks = self._tasks()
            first = next(tasks, None)
            if first is None:
                return
            advance(progress, self._dealt_with / len(self._jobs), "starting workers, compiling")
            began = time.perf_counter()
            with start_workers(settings, partial(compile_kernels, self._sent), partial(complain, "warning")) as runner:
                ready = time.perf_counter()
                with contextlib.closing(runner.run(make_avatar, itertools.chain([first], tasks))) as outcomes:
                    for made, outcome in enumerate(outcomes, 1):
                        self._take(outcome)
                        done = self._dealt_with
                        left = (time.perf_counter() - ready) / made * (len(self._jobs) - done)
                        words = f"{done} of {len(self._jobs)}, {duration(left)} left"
                        advance(progress, done / len(self._jobs), words)
        if not self._options.quiet:
            self._say_times(runner, ready - began, time.perf_counter() - ready)

    def finish(self) -> Path:
        """Write the summary, whatever has become of each; its page."""
        from ..batches import Row, write_summary

        log = self._folder.path / WORKER_LOG
        try:
            with contextlib.suppress(PermissionError):  # on Windows, where a worker has not quite ended
                if log.is_file() and not log.stat().st_size:
                    log.unlink()
            return write_summary(self._folder.path, [job.row or Row(job.label, "left") for job in self._jobs])[1]
        finally:
            self._folder.close()

    def _tasks(self) -> Iterator[tuple]:
        """Arguments of :func:`make_avatar` for what must be made; the rest is dealt with on the way."""
        for job, after in zip(self._jobs, [*self._jobs[1:], None], strict=True):
            try:
                if job.error is not None:
                    raise job.error
                read = self._being_read(job.path).result()
                if after is not None and after.error is None:
                    self._being_read(after.path)
                job.key = self._key(job, read)
                earlier = self._folder.finished(job.key, job.source)
                if earlier is not None:
                    self._keep(job, earlier)
                    if not self._submitted:
                        share = self._dealt_with / len(self._jobs)
                        advance(self._progress, share, "looking for what is done already")
                    continue
            except MirrorScanError as error:
                self._fail(job, error)
                continue
            if job.key in self._on_their_way:
                self._on_their_way[job.key].append(job)
                continue
            self._on_their_way[job.key] = [job]
            self._submitted.append(job)
            yield os.path.abspath(job.path), job.frames, self._sent

    def _being_read(self, path: Path) -> Future[_Read]:
        """What is read last, or now; a recording has many pieces."""
        if self._reading is None or self._reading[0] != path:
            self._reading = path, Future()
            # not of a pool, which would be waited for at the end
            threading.Thread(target=_read_into, args=self._reading, daemon=True).start()
        return self._reading[1]

    def _key(self, job: _Job, read: _Read) -> str:
        """Digest of all that the result depends on; with PyAV there is colour in recordings that had none before."""
        from ..batches import settings_digest
        from ..cluster import program_version

        job.size = read.size
        return settings_digest(
            {
                "program": program_version(), "settings": self._settings, "frames": job.frames,
                "content": read.content, "beside": read.beside, "video": importlib.util.find_spec("av") is not None,
            }
        )  # fmt: skip

    def _take(self, outcome: Outcome) -> None:
        """Keep what a worker sent back, for each capture of that content."""
        job = self._submitted[outcome.number]
        for same in self._on_their_way.pop(job.key):
            if outcome.error is not None:
                self._fail(same, outcome.error)
                continue
            try:
                self._enter(same, outcome.value)
            except MirrorScanError as error:
                self._fail(same, error)

    def _enter(self, job: _Job, made: Made) -> None:
        from ..batches import Finished

        name = self._folder.name_for(job.source, job.name)
        figures = {**made.figures, "bytes_in": job.size, "said": made.said}
        finished = self._folder.keep(name, Finished(job.key, job.source, {}, figures), made.files)
        self._set_row(job, "made", finished)

    def _keep(self, job: _Job, earlier: Finished) -> None:
        """A result of before; of the same content elsewhere, once more under this capture's name."""
        if earlier.source != job.source:
            name = self._folder.name_for(job.source, job.name)
            earlier = self._folder.keep(name, replace(earlier, source=job.source), self._folder.files_of(earlier))
        self._set_row(job, "kept", earlier)

    def _set_row(self, job: _Job, state: str, finished: Finished) -> None:
        from ..batches import Row

        files = [name for name in finished.files if name not in _SHOWN]
        picture = self._folder.path / finished.folder / THUMBNAIL
        said = [str(text) for text in finished.figures.get("said", ())]
        self._dealt_with += 1
        job.row = Row(
            job.label, state, finished.folder, [*files, PREVIEW, REPORT], finished.figures, said, picture
        )  # fmt: skip
        if not self._options.quiet:
            words = "made before" if state == "kept" else f"{finished.figures['seconds']:.1f} s"
            say(f"{job.label}: {words}")
        for text in said if state == "made" else ():
            kind, _, words = text.partition(": ")
            complain(kind, f"{job.label}: {words}")

    def _fail(self, job: _Job, error: Exception) -> None:
        from ..batches import Row

        text = str(error)
        if not isinstance(error, MirrorScanError):
            text = f"a fault of the program: {type(error).__name__}: {error}; {WORKER_LOG} has more"
            with (
                contextlib.suppress(OSError),  # on a full disk; the error itself is shown all the same
                open(self._folder.path / WORKER_LOG, "a", encoding="utf-8", errors="backslashreplace") as file,
            ):
                file.write(f"{job.label}\n{''.join(traceback.format_exception(error))}\n")
        text = text.replace(os.path.abspath(job.path), str(job.path))  # as the user named it
        job.row = Row(job.label, "failed", said=[text])
        self._dealt_with += 1
        complain("error", text if text.startswith(str(job.path)) else f"{job.label}: {text}")
        cause = error.__cause__
        if isinstance(cause, OSError) and cause.errno in _NO_ROOM:
            raise OutputError(
                "{folder}: the disk is full; make room, and the same command goes on from there",
                folder=self._folder.path,
            ) from error

    def _say_times(self, runner: TaskRunner, until_ready: float, seconds: float) -> None:
        count = sum(job.row is not None and job.row.state == "made" for job in self._jobs)
        say(
            f"{count} avatar{'' if count == 1 else 's'} in {seconds:.1f} s; workers had started after "
            f"{runner.start_s:.1f} s and had their kernels {max(0.0, until_ready - runner.start_s):.1f} s later"
        )


def make_avatar(path: str, frames: str | None, options: argparse.Namespace) -> Made:
    """What a worker does with one capture. Results are sent back, so that only captures must lie where all see them.

    Parameters
    ----------
    path : str
        Absolute.
    frames : str or None
        As of :func:`.capture.open_capture`.
    options : argparse.Namespace
        Of the command.
    """
    from ..io.images import png_bytes
    from ..preview.mesh_views import SIDES, render_views

    if not os.path.exists(path):
        raise CaptureError(
            "{path}: the worker on {host} does not see it; put captures where all machines have them under one path",
            path=path, host=platform.node(),
        )  # fmt: skip
    began, began_cpu = time.perf_counter(), time.process_time()
    with tempfile.TemporaryDirectory(prefix="mirror_scan_") as folder, complaints_heard() as said:
        outputs = [Path(folder, f"{AVATAR}.{suffix}") for suffix in options.formats]
        if options.measure and "csv" not in options.formats:
            outputs.append(Path(folder, "measurements.csv"))
        own = vars(options) | {
            "captures": [Path(path)], "outputs": outputs, "report": Path(folder, REPORT), "poses": None, "quiet": True,
            "frames": frames,
        }  # fmt: skip
        result, _ = avatar_to_files(argparse.Namespace(**own), {})
        files = {name: Path(folder, name).read_bytes() for name in sorted(os.listdir(folder))}
    shown = _upright(result)
    sides = [SIDES[side] for side in ("front", "left side", "back", "right side")]
    files[PREVIEW] = png_bytes(render_views(shown, shown.colors, sides, *_PREVIEW_SIZE, texture=result.texture))
    files[THUMBNAIL] = png_bytes(
        render_views(shown, shown.colors, sides[::2], *_THUMBNAIL_SIZE, texture=result.texture)
    )
    mesh = result.report["mesh"]
    figures = {
        **{name: mesh.get(name) for name in ("height_m", "volume_l", "triangles", "watertight")},
        "warnings": len(said), "seconds": round(time.perf_counter() - began, 3),
        "processor_s": round(time.process_time() - began_cpu, 3), "memory_mb": _peak_memory(),
        "bytes_out": sum(len(data) for data in files.values()),
    }  # fmt: skip
    return Made(files, figures, said)


def compile_kernels(options: argparse.Namespace) -> None:
    """Make an avatar of a small capture that comes with the program, with what the options ask of an avatar."""
    from ..batches import small_capture

    plain: dict[str, Any] = {
        "rig": None, "mirrors": None, "subject": None, "intrinsics": None, "turn": None, "mirrored": None,
        "depth_unit": None, "sensor": "auto", "texture": 256 if options.texture else None, "single_frame": False,
        "min_confidence": 1,
    }  # fmt: skip
    try:
        make_avatar(str(small_capture()), None, argparse.Namespace(**vars(options) | plain))
    except MirrorScanError as error:  # then the rest is compiled when the first capture needs it
        complain("warning", f"not all could be compiled beforehand: {error}")


def _upright(result: Reconstruction) -> Any:
    """The mesh in the avatar frame."""
    return result.mesh if result.frame == "avatar" else result.mesh.transformed(result.camera_to_avatar)


def _peak_memory() -> float | None:
    """The most memory this process has had [MB]; None where the system does not say."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6, 1)
