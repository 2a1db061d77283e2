"""Tasks of a capture: read it, record it, look at a live camera."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from ...core.errors import CaptureError
from ...core.preview.palette import depth_colors
from .mirror_records import record_of_picks
from .mirrors import FITTING, fit_records
from .results import Loaded, Steps

if TYPE_CHECKING:
    from ...core.capture import Capture, ReadOptions

READING, AVERAGING = "Reading the capture", "Averaging the frames"


def load_steps(path: str, frames: int, mirrors_path: str = "", reading: dict | None = None) -> Steps[Loaded]:
    """Read a capture, average its burst, and fit the mirrors it knows; ``reading`` is of
    :func:`.scan_records.reading_of`."""
    yield 0.0, READING
    capture = opened(path, frames, mirrors_path, reading)
    return (yield from loaded_steps(capture, path))[0]


def record_steps(camera: str, folder: str, frames: int) -> Steps[Loaded]:
    """Record a burst of a live camera (a name of ``core.record.DRIVERS``) into ``folder``, and load it."""
    yield 0.0, "Starting the camera"
    from ...core.capture.live_camera import DRIVERS, record

    with DRIVERS[camera]() as stream:
        yield 0.1, "Recording: hold still"
        record(stream, folder, frames)
    yield 0.3, READING
    return (yield from load_steps(folder, 0))


def live_steps(source: dict, capture: str, frames_folder: str, shutter: dict) -> Steps[str]:
    """Look at a live camera, or a recording played as one, until the burst is taken; the folder of the burst.

    Parameters
    ----------
    source : dict
        ``camera``: a name of ``core.guidance.playback.CAMERAS``; ``serial`` of it, or the path of the recording;
        ``paced`` for a recording, and ``rate`` [1/s]; ``mirrors``: how many there are, where it does not say.
    capture : str
        Folder to make for the burst.
    frames_folder : str
        Where :mod:`.live_frames` puts each frame that is looked at.
    shutter : dict
        Arguments of ``core.guidance.ShutterSettings``.
    """
    yield 0.0, "Starting the camera"
    from ...core.capture import MirrorPicks
    from ...core.guidance import LiveScene, LiveSettings, Shutter, ShutterSettings, guide
    from ...core.guidance.playback import CAMERAS, mirrors_of
    from ...core.guidance.shutter import write_burst
    from .live_frames import picture_of, write_picture

    recording = source["camera"] == "playback"
    more = {"paced": source["paced"], "rate": source["rate"]} if recording else {}
    rate = float(source["rate"])
    clock = (lambda number: number / rate) if recording and not source["paced"] else None
    with CAMERAS[source["camera"]](serial=source["serial"] or None, **more) as stream:
        live = LiveSettings(beside=clock is None, mirrors=source["mirrors"])
        known = mirrors_of(source["serial"]) if recording else ()
        scene = LiveScene(stream.intrinsics, stream.sensor, known, live)
        taker = Shutter(stream.intrinsics, ShutterSettings(**shutter))
        picture = None
        for update in guide(stream, scene, taker, clock=clock):
            picture = picture_of(update, picture)
            write_picture(frames_folder, picture)
            yield 0.9 * update.share, LIVE_WORDS[update.state]
        picks = [one for one in scene.known if isinstance(one, MirrorPicks)]
        write_burst(capture, stream, taker.burst, taker.color, picks)
    return capture


LIVE_WORDS = {
    "advising": "Looking: follow the advice in the viewport", "well": "All is well: hold still",
    "counting down": "All is well: hold still", "burst": "Taking the burst: hold still",
    "done": "The burst has been taken",
}  # fmt: skip
"""What the status bar says of each state of the shutter."""


def opened(path: str, frames: int, mirrors_path: str, reading: dict | None, native_color: bool = False) -> Capture:
    """The capture at ``path``, its first ``frames`` (0 = all), read as ``reading`` of
    :func:`.scan_records.reading_of` says; mirrors from ``mirrors_path``, unless it is empty.

    Raises
    ------
    CaptureError
        When it cannot be read.
    """
    from ...core.capture import ReadOptions, open_capture
    from ...core.capture.folders.lens_file import lens_options
    from ...core.capture.folders.rgbd_folder import read_mirrors

    options = dict(reading or {})
    intrinsics, lens = options.pop("intrinsics", ""), options.pop("lens", "")
    if intrinsics:
        options |= lens_options(intrinsics)
    mirrors = options.pop("mirrors", True) and not mirrors_path
    options = ReadOptions(**options, native_color=native_color, mirrors=mirrors)
    if lens and not intrinsics:
        capture = _open_with_lens(path, frames, options, lens)
    else:
        capture = open_capture(path, frames or None, options)
    if mirrors_path:
        capture = dataclasses.replace(capture, mirrors=read_mirrors(mirrors_path, capture.intrinsics))
    return capture


def _open_with_lens(path: str, frames: int, options: ReadOptions, sensor: str) -> Capture:
    """A capture with the published lens of a sensor, in whichever of its sizes the images are."""
    from ...core.capture import open_capture
    from ...core.capture.nominal_intrinsics import published_lenses

    first: CaptureError | None = None
    for lens in published_lenses(sensor):
        try:
            return open_capture(path, frames or None, dataclasses.replace(options, intrinsics=lens))
        except CaptureError as error:  # of another size, or something that no lens helps with
            first = first or error
    assert first is not None  # every sensor has a lens
    raise first


def loaded_steps(capture: Capture, path: str) -> Steps[tuple[Loaded, np.ndarray]]:
    """What is shown of a capture, and how much each pixel's readings spread over the frames, relative to z."""
    yield 0.4, AVERAGING
    from ...core.depth.depth_map import one_depth_map
    from ...core.depth.sensor_recognition import measuring_principle
    from ...core.depth.settings import DepthSettings

    depth, spread = one_depth_map(capture)
    yield 0.7, FITTING
    from ...core.views.capture_placement import upright_frame

    records = [record_of_picks(known) for known in capture.mirrors]
    fitted = fit_records(depth, capture.intrinsics, records, 0.0, None, capture.sensor)
    info = {
        "name": capture.name,
        "format": capture.format,
        "path": path,
        "frames": len(capture.depth),
        "size": [capture.intrinsics.width, capture.intrinsics.height],
        "color": capture.color is not None,
        "sensor": capture.sensor,
        "sensor_from": capture.sensor_from,
        "measures": measuring_principle(capture, DepthSettings()).measures,
        "notes": list(capture.notes),
    }
    loaded = Loaded(
        depth, capture.color, depth_colors(depth), capture.intrinsics, info,
        upright_frame(depth, capture.intrinsics), fitted.mirrors, fitted.seen,
    )  # fmt: skip
    return loaded, spread
