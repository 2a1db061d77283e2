"""The command ``sequence``: every frame of a recording a closed avatar."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING

from ..errors import CaptureError
from .commands import reading_of, settings_of
from .outputs import Writers
from .terminal import advance, complain, progress_bar, say, stage_of

if TYPE_CHECKING:
    from ..capture import MirrorPicks
    from ..mirrors import Mirror
    from ..sequences import Recording, SequenceFrame

_PLACING = 0.1  # of the progress


def run_sequence(options: argparse.Namespace, writers: Writers) -> None:
    """``sequence``: make an avatar of every frame of a recording."""
    frames, reading = reading_of(options)
    from ..sequences import FilterSettings, SequenceSettings, open_recording, place_rig, reconstruct_sequence
    from ..sequences.sequence_files import SequenceFolder

    recording = open_recording(options.recording, frames, options.every, reading)
    suffixes = [f".{name}" for name in options.formats or ("ply",)]
    folder = SequenceFolder(options.folder, suffixes, _facts(options, recording), options.resume)
    settings = settings_of(options)
    wanted = SequenceSettings(FilterSettings(use=not options.unfiltered), options.workers)
    started, done = time.perf_counter(), 0
    with progress_bar(options.quiet) as progress:
        rig = place_rig(recording, _mirrors(options, recording), settings, progress=stage_of(progress, 0.0, _PLACING))
        for warning in rig.warnings:
            complain("warning", warning)
        began, todo = time.perf_counter(), sum(not folder.has(place) for place in range(len(recording)))

        def report(frame: SequenceFrame) -> None:
            nonlocal done
            done += 1
            if frame.reason:
                complain("warning", f"frame {frame.number}: {frame.state}: {frame.reason}")
            left = (time.perf_counter() - began) / done * (todo - done)
            share = _PLACING + (1.0 - _PLACING) * done / max(todo, 1)
            advance(progress, share, f"frame {frame.place + 1} of {len(recording)}, {_time(left)} left")

        extra = {"rig": _rig_rows(rig), "rate": options.fps}
        try:
            for frame in reconstruct_sequence(recording, rig, settings, wanted, folder.has):
                folder.add(frame)
                report(frame)
        finally:
            content = folder.finish({**extra, "seconds": round(time.perf_counter() - started, 2)})
    if not options.quiet:
        counts = content["counts"]
        say(f"{counts['made']} frames made, {counts['bridged']} bridged, {counts['lost']} lost")
        if content["seconds_a_frame"] is not None:
            say(f"{content['seconds']:.1f} s in all, {(time.perf_counter() - began) / max(done, 1):.2f} s a frame")
        say(f"  {options.folder}")


def _facts(options: argparse.Namespace, recording: Recording) -> dict:
    """What a sequence is made of: one that is gone on with must have the same."""
    given = {
        key: str(value) for key, value in sorted(vars(options).items())
        if key not in ("folder", "run", "quiet", "resume", "workers", "find_bridge", "readers", "recording", "fps")
    }  # fmt: skip
    status = recording.path.stat()
    return {
        "recording": recording.path.name, "bytes": 0 if recording.path.is_dir() else status.st_size,
        "numbers": list(recording.numbers), "options": given,
    }  # fmt: skip


def _mirrors(options: argparse.Namespace, recording: Recording) -> tuple[MirrorPicks | Mirror, ...] | None:
    """What is known of the mirrors; None where the recording says it."""
    from ..capture.folders.rgbd_folder import read_mirrors
    from ..mirrors.rig_file import mirrors_for, read_rig

    if not (options.mirrors or options.rig):
        return None
    intrinsics = recording.read(recording.numbers[0]).intrinsics
    if options.mirrors and options.rig:
        raise CaptureError("--mirrors and --rig both say where the mirrors are; give one of them")
    return (
        read_mirrors(options.mirrors, intrinsics) if options.mirrors else mirrors_for(read_rig(options.rig), intrinsics)
    )


def _rig_rows(rig) -> dict:
    return {
        "placed_with": list(rig.placed_with),
        "spread_mm": {name: round(1000.0 * value, 2) for name, value in rig.spread.items()},
        "mirrors": [
            {"name": m.name, "point": m.point.tolist(), "normal": m.normal.tolist()} for m in rig.scene.mirrors
        ],
        "camera_to_avatar": rig.to_avatar.tolist(),
        "light_comes_two_ways": rig.scene.lit_twice,
        "sensor": rig.scene.principle.sensor,
    }


def _time(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"
