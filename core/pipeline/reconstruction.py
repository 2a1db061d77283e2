"""The whole job, read top to bottom: :func:`reconstruct`."""

from __future__ import annotations

from collections.abc import Callable, Generator

import numpy as np

from ..capture import Capture, MirrorPicks
from ..errors import ReconstructionError
from ..mirrors import Mirror
from ..numeric.blas_threads import one_blas_thread
from .avatar_stages import check_wishes, shares
from .scan import Clock, KnownScene, scan_steps
from .settings import Settings
from .surface import SCAN_SHARE, PlacedCapture, Reconstruction, joining_steps

Progress = Callable[[float, str], None]


def reconstruct(
    capture: Capture,
    mirrors: tuple[MirrorPicks | Mirror, ...] | None = None,
    settings: Settings = Settings(),
    progress: Progress | None = None,
    frame: str = "avatar",
    scene: KnownScene | None = None,
) -> Reconstruction:
    """Capture → closed, coloured avatar.

    Parameters
    ----------
    capture : Capture
        One snapshot or a burst.
    mirrors : tuple of MirrorPicks or Mirror, optional
        What is known of each mirror; by default what the capture itself holds. Empty: they are found.
    settings : Settings
    progress : callable(fraction, message), optional
        Called at the start of each stage; an exception it raises stops the work.
    frame : {"avatar", "camera"}
        Frame of the mesh.
    scene : KnownScene, optional
        Of another frame of the same recording, :attr:`.surface.Reconstruction.scene`: mirrors, floor and light are
        taken from it, and only the subject is looked for. ``mirrors`` do not count then, and the report does not count
        self-intersections (None).

    Raises
    ------
    CaptureError, MirrorError, ReconstructionError
        The input or the scene is at fault; the message says what to do.
    """
    return finish(reconstruction_steps(capture, mirrors, settings, frame, scene), progress)


def finish(
    steps: Generator[tuple[float, str], None, Reconstruction], progress: Progress | None = None
) -> Reconstruction:
    """Run all the pieces of a job, reporting each to ``progress``."""
    while True:
        try:
            fraction, message = next(steps)
        except StopIteration as done:
            return done.value
        if progress is not None:
            progress(fraction, message)


def reconstruction_steps(
    capture: Capture,
    mirrors: tuple[MirrorPicks | Mirror, ...] | None = None,
    settings: Settings = Settings(),
    frame: str = "avatar",
    scene: KnownScene | None = None,
    averaged: tuple[np.ndarray, np.ndarray] | None = None,
) -> Generator[tuple[float, str], None, Reconstruction]:
    """:func:`reconstruct` in pieces.

    Yields (fraction done, what comes next), returns the :class:`.surface.Reconstruction`. ``averaged``: the capture's
    depth map and its spread, if :func:`.depth_map.one_depth_map` made them already by ``settings.depth``.
    """
    check_frame(frame)
    check_wishes([capture], settings)
    picks = capture.mirrors if mirrors is None else tuple(mirrors)
    clock = Clock()
    with one_blas_thread():
        part = 0.0, SCAN_SHARE * shares(settings)["scan"][1]
        scan = yield from scan_steps(capture, picks, settings, clock, part, known=scene, averaged=averaged)
        placed = [PlacedCapture(capture, np.eye(4), len(scan.mirrors))]
        return (yield from joining_steps(scan, placed, settings, frame, clock, scene is not None))


def check_frame(frame: str) -> None:
    """Refuse a frame that is neither the avatar's nor the camera's.

    Raises
    ------
    ReconstructionError
    """
    if frame not in ("avatar", "camera"):
        raise ReconstructionError(f'frame must be "avatar" or "camera", got "{frame}"')
