"""The command ``live``: what to change before the shutter, and the burst taken by itself when all is well."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import CaptureError, OutputError
from .commands import avatar_to_files, known_mirrors, planned_files, reading_of, settings_of
from .outputs import Writers
from .terminal import advance, complain, progress_bar, say, summary_line

if TYPE_CHECKING:
    from ..capture import MirrorPicks
    from ..capture.live_camera import Stream
    from ..guidance import LiveSettings, LiveUpdate, ShutterSettings
    from ..mirrors import Mirror
    from ..pipeline.reconstruction import Progress

_PLAIN_READING = {
    "frames": None, "intrinsics": None, "depth_unit": None, "turn": None, "mirrored": None, "disparity": "factory",
    "kinect_calibration": "factory",
}  # fmt: skip
"""Options of reading for an RGB-D folder of ours."""


def run_live(options: argparse.Namespace, writers: Writers) -> None:
    """``live``: say what to change, take the burst, and make an avatar of it."""
    capture = _capture_folder(options, writers)
    with _camera(options) as (stream, known, clock):
        from ..capture import MirrorPicks
        from ..guidance import LiveScene, Shutter, guide
        from ..guidance.shutter import write_burst

        live, settings = _settings(options, len(known))
        scene = LiveScene(stream.intrinsics, stream.sensor, known, live)
        shutter = Shutter(stream.intrinsics, settings)
        told = _Told(options.quiet)
        with (
            progress_bar(options.quiet) as progress,
            contextlib.closing(guide(stream, scene, shutter, clock=clock)) as updates,
        ):
            for update in updates:
                told.tell(update)
                _show(progress, update)
        if not scene.known:  # a rig that moved is not the burst's
            options.rig = None
        picks = [one for one in scene.known if isinstance(one, MirrorPicks)]
        write_burst(capture, stream, shutter.burst, shutter.color, picks)
    if shutter.warning is not None:
        complain("warning", shutter.warning)
    if not options.quiet:
        say(f"the burst is taken: {len(shutter.burst)} frames")
        say(f"  {capture}")
    if options.capture_only:
        return
    _of_capture(options, capture)
    result, planned = avatar_to_files(options, writers)
    if not options.quiet:
        say(summary_line(result))
        for path in planned:
            say(f"  {path}")


def _of_capture(options: argparse.Namespace, capture: Path) -> None:
    """Have the options read the burst, of which nothing needs to be told that the camera or its recording needed."""
    vars(options).update(_PLAIN_READING, captures=[capture], poses=None, mirrors=None)


def _capture_folder(options: argparse.Namespace, writers: Writers) -> Path:
    """The folder for the burst: the one after ``-o``, or one beside the avatar.

    Raises
    ------
    OutputError
        The avatar or the capture cannot be written there, or something is there already.
    """
    folder: Path | None = options.capture
    if options.capture_only:
        if len(options.outputs) != 1 or options.outputs[0].suffix or folder is not None:
            raise OutputError("--capture-only: give one folder for the capture with -o, without a suffix")
        folder = options.outputs[0]
    else:
        planned_files(options, writers)
        if folder is None:
            folder = options.outputs[0].with_name(options.outputs[0].stem + "_capture")
    from ..io.atomic_files import free_folder  # here: io brings numpy, and --help must not wait for it

    free_folder(folder)
    return folder


@contextlib.contextmanager
def _camera(
    options: argparse.Namespace,
) -> Iterator[tuple[Stream, tuple[MirrorPicks | Mirror, ...], Callable[[int], float] | None]]:
    """The running camera or recording, the mirrors that are known, and what tells the time if that is not its own."""
    from ..guidance.playback import CAMERAS, played

    if options.play is None:
        if options.fast:
            raise CaptureError("--fast: is for a recording; give one with --play")
        wanted = {"size": options.size} if options.size else {}
        with CAMERAS[options.camera](rate=options.rate, serial=options.serial, **wanted) as stream:
            yield stream, known_mirrors(options, stream.intrinsics) or (), None
        return
    from ..sequences import open_recording

    frames, reading = reading_of(options)
    recording = open_recording(options.play, frames, options=reading)
    first = recording.read(recording.numbers[0])
    known = known_mirrors(options, first.intrinsics)
    known = first.mirrors if known is None else known
    rate = float(options.rate)
    clock = (lambda number: number / rate) if options.fast else None
    yield played(recording, rate, paced=not options.fast), known, clock


def _settings(options: argparse.Namespace, known: int) -> tuple[LiveSettings, ShutterSettings]:
    """How frames are looked at, and when the burst is taken."""
    from ..guidance import LiveSettings, ShutterSettings, advice

    unknown = [kind for kind in options.ignore if kind not in advice.KINDS]
    if unknown:
        raise CaptureError(f"--ignore: there is no advice “{unknown[0]}”; give one of {', '.join(advice.KINDS)}")
    pipeline = settings_of(options)
    return (
        LiveSettings(mirrors=known or options.mirror_count, beside=not options.fast, pipeline=pipeline),
        ShutterSettings(
            countdown_s=options.countdown, frames=options.burst, ignore=tuple(options.ignore), depth=pipeline.depth
        ),
    )


class _Told:
    """Says what changes, and nothing twice."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._advices: frozenset[Any] = frozenset()
        self._state, self._second, self._retaken, self._warned = "", -1, 0, False
        self._mirrors: tuple[str, ...] = ()

    def tell(self, update: LiveUpdate) -> None:
        """What is new in an update."""
        if self._quiet:
            return
        if update.frame is not None:
            mirrors = tuple(sorted(mirror.name for mirror in update.frame.mirrors))
            if mirrors != self._mirrors and mirrors:
                say(f"mirrors found: {', '.join(mirrors)}")
            self._mirrors = mirrors
        if update.retaken > self._retaken:
            self._retaken = update.retaken
            say("you moved during the burst; it is taken again")
        keys = frozenset(one.key for one in update.advices)
        for one in update.advices:
            if one.key not in self._advices:
                say(f"{_LEADS[one.severity]}{one.text}")
        warned = any(one.severity == "warning" for one in update.advices)
        if self._warned and not warned and update.state != "burst":
            say("all is well")
        self._advices, self._warned = keys, warned
        second = int(update.left_s + 0.999)
        if update.state == "counting down" and (self._state != update.state or second != self._second):
            say(f"hold still: {second}")
        if update.state == "burst" and self._state != "burst":
            say("hold still: the burst is taken")
        self._state, self._second = update.state, second


_LEADS = {"warning": "", "note": "note: "}


def _show(progress: Progress | None, update: LiveUpdate) -> None:
    """The bar: of the countdown, then of the burst, with how far the subject moved."""
    if update.state == "burst":
        advance(progress, update.share, f"hold still, moved by {1000 * update.moved_m:.0f} mm")
    elif update.state == "counting down":
        advance(progress, 0.0, f"hold still, {update.left_s:.0f} s")
    else:
        advance(progress, 0.0, update.advices[0].text if update.advices else "all is well")
