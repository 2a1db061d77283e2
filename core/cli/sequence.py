"""The command ``sequence``: every frame of a recording a closed avatar."""

from __future__ import annotations

import argparse
import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import CaptureError, MirrorScanError, OutputError
from .commands import known_mirrors, reading_of, settings_of, worker_settings
from .outputs import Writers, blaming, check_apart, check_targets, write_together
from .terminal import advance, complain, duration, progress_bar, say, stage_of

if TYPE_CHECKING:
    from ..capture import MirrorPicks
    from ..cluster import TaskRunner
    from ..mesh import Mesh
    from ..mirrors import Mirror
    from ..pipeline.reconstruction import Progress
    from ..sequences import Recording, SequenceFrame, SequenceRig
    from ..sequences.sequence_files import SequenceFolder

_PLACING, _FRAMES, _WHOLE = 0.1, 0.75, 0.85  # of the progress: up to where each part goes
_CACHES, _VIDEOS, _CLIPS = (".abc", ".usd", ".usdc"), (".mp4", ".webp"), (".glb",)
_NOT_OF_THE_RESULT = (
    "outputs",
    "run",
    "quiet",
    "resume",
    "workers",
    "scheduler",
    "wait",
    "find_bridge",
    "readers",
    "recording",
    "skeleton",
)


@dataclass(frozen=True)
class _Targets:
    """What is written: the folder of frames, and files of the whole sequence."""

    folder: Path
    caches: list[Path]
    videos: list[Path]
    clips: list[Path]

    @property
    def files(self) -> list[Path]:
        return [*self.caches, *self.videos, *self.clips]


def run_sequence(options: argparse.Namespace, writers: Writers) -> None:
    """``sequence``: make an avatar of every frame of a recording."""
    targets = _targets(options, writers)
    frames, reading = reading_of(options)
    from ..sequences import open_recording
    from ..sequences.sequence_files import SequenceFolder

    recording = open_recording(options.recording, frames, options.every, reading)
    suffixes = [f".{name}" for name in options.formats or ("ply",)]
    folder = SequenceFolder(targets.folder, suffixes, _facts(options, recording), options.resume)
    started = time.perf_counter()
    with progress_bar(options.quiet) as progress:
        extra = folder.kept | {"rate": options.fps}
        try:
            _make_frames(options, recording, folder, extra, progress)
            made = folder.places()
            if not made:
                raise CaptureError(
                    "{path}: none of {count} frames could be made: {reason}",
                    path=options.recording, count=len(recording), reason=folder.first_reason(),
                )  # fmt: skip
            _write_whole(folder, recording, targets, writers, options.fps, progress)
            if targets.clips:
                extra["skeleton"] = _follow(folder, made, targets.clips, options.fps, progress)
        except KeyboardInterrupt as stop:
            done = len(folder.places(bridged=True))
            raise type(stop)(
                f"interrupted; {done} of {len(recording)} frames are done, and --resume goes on from there"
            ) from None
        finally:
            content = folder.finish({**extra, "seconds": round(time.perf_counter() - started, 2)})
    if options.quiet:
        return
    counts = content["counts"]
    say(f"{counts['made']} frames made, {counts['bridged']} bridged, {counts['lost']} lost, {content['seconds']:.0f} s")
    for path in (targets.folder, *targets.files):
        say(f"  {path}")


def _make_frames(
    options: argparse.Namespace, recording: Recording, folder: SequenceFolder, extra: dict, progress: Progress | None
) -> None:
    """Each frame's mesh, written as it is made."""
    from ..sequences import FilterSettings, SequenceSettings, SurfaceFilterSettings, place_rig, reconstruct_sequence

    todo = sum(not folder.has(place) for place in range(len(recording)))
    if not todo:
        return
    settings = settings_of(options)
    rig = place_rig(recording, _mirrors(options, recording), settings, progress=stage_of(progress, 0.0, _PLACING))
    for warning in rig.warnings:
        complain("warning", warning)
    extra["rig"] = _rig_summary(rig)
    steady = not options.unfiltered
    wanted = SequenceSettings(FilterSettings(use=steady), SurfaceFilterSettings(use=steady))
    began, done = time.perf_counter(), 0
    with (
        _workers(options) as runner,
        contextlib.closing(
            reconstruct_sequence(recording, rig, settings, wanted, folder.has, runner, folder.mesh_if_any)
        ) as frames,
    ):
        for frame in frames:
            with blaming(folder.folder):
                folder.add(frame, extra)
            done += 1
            _tell(frame)
            left = (time.perf_counter() - began) / done * (todo - done)
            share = _PLACING + (_FRAMES - _PLACING) * done / todo
            advance(progress, share, f"frame {frame.place + 1} of {len(recording)}, {duration(left)} left")


def _workers(options: argparse.Namespace) -> contextlib.AbstractContextManager[TaskRunner | None]:
    """Workers of Dask where they are asked for; None for this process alone."""
    if not (options.workers or options.scheduler):
        return contextlib.nullcontext()
    from ..cluster import start_workers

    return start_workers(worker_settings(options), tell=partial(complain, "warning"))


def _tell(frame: SequenceFrame) -> None:
    """Say what became of a frame that was not made."""
    if frame.reason:
        how = "the frame before is held" if frame.mesh is not None else "left out"
        complain("warning", f"frame {frame.number}: {how}: {frame.reason}")


def _follow(folder: SequenceFolder, made: list[int], paths: list[Path], rate: float, progress: Progress | None) -> dict:
    """The avatar of the sequence with its clip; what the report says of it."""
    from ..avatar.avatar_file import Avatar, write_avatar
    from ..sequences.skeleton_tracking import best_frame, track

    advance(progress, _WHOLE, "Finding the skeleton")
    rigged = best_frame(made, folder.mesh)
    clip, residual = track(rigged, made, folder.mesh, rate, stage_of(progress, _WHOLE, 1.0))
    avatar = Avatar(rigged.mesh, rigged.skeleton, rigged.weights, clips=(clip,))
    write_together([(path, write_avatar) for path in paths], avatar)
    return {"avatar_of": rigged.place, "residual_mm": [round(1000.0 * float(value), 2) for value in residual]}


def _write_whole(
    folder: SequenceFolder, recording: Recording, targets: _Targets, writers: Writers, rate: float,
    progress: Progress | None,
) -> None:  # fmt: skip
    """The files that hold all frames."""
    shown = _held(folder, len(recording))
    for path in targets.videos:
        from ..io.atomic_files import replacing
        from ..sequences.video import PreviewVideo

        advance(progress, _FRAMES, "Writing the video")
        with replacing(path) as temporary, PreviewVideo(temporary, rate) as video:
            for mesh_at in shown:
                video.add(mesh_at())
    for path in targets.caches:
        advance(progress, 0.8, f"Writing {path.name}")
        writers["sequence"](path, len(shown), lambda place: shown[place](), rate)


def _held(folder: SequenceFolder, count: int) -> list[Callable[[], Mesh]]:
    """What reads the mesh of each frame; of those that are lost, that of the frame before, or of the first there is."""
    there = folder.places(bridged=True)
    places, last = [], there[0]
    known = set(there)
    for place in range(count):
        last = place if place in known else last
        places.append(last)
    return [lambda place=place: folder.mesh(place) for place in places]  # type: ignore[misc]  # mypy cannot infer it


def _targets(options: argparse.Namespace, writers: Writers) -> _Targets:
    """What the names after ``-o`` mean, by their endings.

    Raises
    ------
    OutputError
        No folder, or two; a file that cannot be written, or within the recording; a clip without ``--skeleton``, or the
        other way round.
    """
    ends = {path: path.suffix.lower() for path in options.outputs}
    caches, videos, clips = ([p for p, end in ends.items() if end in ends_of] for ends_of in (_CACHES, _VIDEOS, _CLIPS))
    folders = [path for path in options.outputs if path not in (*caches, *videos, *clips)]
    if len(folders) != 1:
        raise OutputError(
            f"{len(folders)} folders are given for the frames; give one with -o, and files that end in "
            f"{', '.join((*_CACHES, *_VIDEOS))}, or with --skeleton in .glb, beside it"
        )
    if clips and not options.skeleton:
        raise OutputError(f"{clips[0]}: holds an avatar and its motion; ask for them with --skeleton")
    if options.skeleton and not clips:
        raise OutputError("--skeleton: give the file for the avatar and its motion, too: -o NAME.glb")
    targets = _Targets(folders[0], caches, videos, clips)
    check_targets(targets.files)
    for path in options.outputs:
        check_apart(path, options.recording)
    if caches:
        try:
            writers["sequence"]
        except KeyError as error:
            raise OutputError(f"{caches[0]}: needs Blender's Python module: “pip install bpy”") from error
    for path in videos:
        from ..sequences.video import check_video

        check_video(path)
    return targets


def _facts(options: argparse.Namespace, recording: Recording) -> dict:
    """What a sequence is made of: one that is gone on with must have the same. Files count by their content."""
    from ..batches import content_digest, settings_by_content, surroundings

    given = {
        key: value if value is None or isinstance(value, Path) else str(value)
        for key, value in sorted(vars(options).items())
        if key not in _NOT_OF_THE_RESULT
    }
    path = recording.path
    content, size = content_digest(path)
    return {
        "recording": path.name, "bytes": None if path.is_dir() else size, "content": content,
        "beside": surroundings(path), "numbers": list(recording.numbers),
        "options": {key: "None" if value is None else value for key, value in settings_by_content(given).items()},
    }  # fmt: skip


def _mirrors(options: argparse.Namespace, recording: Recording) -> tuple[MirrorPicks | Mirror, ...] | None:
    """What is known of the mirrors; None where the recording says it, or they are found."""
    if options.mirrors and options.rig:
        raise CaptureError("--mirrors and --rig both say where the mirrors are; give one of them")
    if not (options.mirrors or options.rig):
        return None
    return known_mirrors(options, _first(recording).intrinsics)


def _first(recording: Recording):
    """The first frame that can be read."""
    fault: MirrorScanError | None = None
    for number in recording.numbers:
        try:
            return recording.read(number)
        except MirrorScanError as error:
            fault = fault or error
    assert fault is not None  # a recording has frames
    raise fault


def _rig_summary(rig: SequenceRig) -> dict:
    """What the report says of the rig."""
    scene = rig.scene
    return {
        "placed_with": list(rig.placed_with),
        "spread_mm": {name: round(1000.0 * value, 2) for name, value in rig.spread.items()},
        "mirrors": [{"name": m.name, "point": m.point.tolist(), "normal": m.normal.tolist()} for m in scene.mirrors],
        "camera_to_avatar": rig.to_avatar.tolist(),
        "light_comes_two_ways": scene.lit_twice,
        "sensor": scene.principle.sensor,
        "warnings": [str(warning) for warning in rig.warnings],
    }
