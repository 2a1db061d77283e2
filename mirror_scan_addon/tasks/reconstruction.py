"""Tasks from a capture to an avatar: find the person, build, check, and draw a picture."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from ...core.camera import Intrinsics, RgbdImage
from ...core.errors import CaptureError, MirrorScanError
from ...core.mesh import Mesh
from .captures import READING, loaded_steps, opened
from .mirror_records import known_mirror, mirror_of, record_of
from .mirrors import find_mirrors_steps
from .results import Built, Checked, Cloud, Scanned, Steps, Subject

if TYPE_CHECKING:
    from ...core.pipeline import Settings


def find_subject_steps(depth: np.ndarray, intrinsics: Intrinsics, mirrors: list[dict], views: dict) -> Steps[Subject]:
    """Sort every pixel into view and part; ``views`` are the fields of ``core.views.ViewSettings``."""
    yield 0.0, "Finding the person"
    from ...core.avatar.coordinate_frame import avatar_frame
    from ...core.subject.subject_search import find_subject
    from ...core.subject.subject_views import ViewSettings

    settings = ViewSettings(**views)
    placed = [mirror_of(record) for record in mirrors]
    found = find_subject(RgbdImage(depth, intrinsics), placed, settings)
    subject = found.points[found.labels >= 0]
    lowest = float((subject @ found.up).min()) if found.floor is None else found.floor
    return Subject(
        found.seen,
        found.labels,
        (found.points @ found.up - lowest).astype(np.float32),
        found.floor is not None,
        max(settings.floor_clearance, 3.0 * found.floor_noise),
        avatar_frame(subject, found.up, found.axis, found.floor),
        [int((found.labels == view).sum()) for view in range(len(placed) + 1)],
        found.warnings,
    )


def build_steps(
    path: str,
    frames: int,
    mirrors: list[dict] | None = None,
    mirrors_path: str = "",
    settings: dict | None = None,
    cloud: Cloud | None = None,
    reading: dict | None = None,
) -> Steps[Built]:
    """Read a capture and reconstruct it.

    Parameters
    ----------
    path, frames
        What to read; an empty path takes ``cloud`` instead.
    mirrors : list of dict, optional
        Records; by default what the capture or ``mirrors_path`` says, and if that is nothing they are found.
    settings : dict, optional
        By the names of ``core.pipeline.Settings``, each a dict of the fields that differ from the defaults.
    reading : dict, optional
        Of :func:`.scan_records.reading_of`.
    """
    yield 0.0, READING
    if path:
        capture = opened(path, frames, mirrors_path, reading)
    elif cloud is not None:
        capture = cloud.capture()
    else:
        raise CaptureError("no capture is chosen; load one first", code="not_loaded")
    yield 0.05, "Loading the program"
    from ...core.pipeline import reconstruction_steps
    from ...core.pipeline.avatar_stages import scaled

    known = None if mirrors is None else tuple(known_mirror(record) for record in mirrors)
    steps = reconstruction_steps(capture, known, _settings_of(settings))
    return _built((yield from scaled(steps, (0.1, 1.0))))


SCAN_SHARES = (0.16, 0.32)
"""When the capture is loaded and when its mirrors are found, as shares of the time from the file to the avatar."""


def scan_steps(
    path: str,
    frames: int,
    mirrors_path: str = "",
    settings: dict | None = None,
    reading: dict | None = None,
    glass_offset: float = 0.0,
) -> Steps[Scanned]:
    """From a file to the avatar: read a capture, find its mirrors unless it names them, and reconstruct it.

    What goes wrong once the capture is read is part of the result, so that its points can be shown: arguments as of
    :func:`build_steps`.
    """
    yield 0.0, READING
    capture = opened(path, frames, mirrors_path, reading)
    yield 0.02, "Loading the program"
    from ...core.depth.settings import DepthSettings
    from ...core.pipeline import reconstruction_steps
    from ...core.pipeline.avatar_stages import scaled

    read, found = SCAN_SHARES
    loaded, spread = yield from scaled(loaded_steps(capture, path), (0.04, read))
    known: tuple | None = None
    if not loaded.mirrors:
        seen = yield from scaled(
            find_mirrors_steps(loaded.depth, loaded.color, loaded.intrinsics, glass_offset), (read, found)
        )
        loaded = dataclasses.replace(loaded, mirrors=seen.mirrors, seen=seen.seen)
        known = tuple(mirror_of(record) for record in seen.mirrors)
    chosen = _settings_of(settings)
    averaged = (loaded.depth, spread) if chosen.depth == DepthSettings() else None
    try:
        steps = reconstruction_steps(capture, known, chosen, averaged=averaged)
        return Scanned(loaded, _built((yield from scaled(steps, (found, 1.0)))), None)
    except MirrorScanError as error:
        return Scanned(loaded, None, error)


def _settings_of(fields: dict | None) -> Settings:
    """Settings of a reconstruction, by the fields that differ from the defaults; see :func:`build_steps`."""
    from ...core.pipeline import Settings

    base = Settings()
    return dataclasses.replace(
        base, **{name: dataclasses.replace(getattr(base, name), **chosen) for name, chosen in (fields or {}).items()}
    )


def _built(result) -> Built:
    report = result.report | {"warnings": list(result.warnings)}  # with the parts of notices, to be translated
    return Built(result.mesh, report, result.warnings, [record_of(mirror) for mirror in result.mirrors])


def check_steps(mesh: Mesh) -> Steps[Checked]:
    """Check a mesh: closed, in one piece, without crossings; and where it is not."""
    yield 0.0, "Checking the surface"
    from ...core.mesh.soundness import find_problems, mesh_report

    report = mesh_report(mesh)
    yield 0.5, "Looking for problems"
    return Checked(report, [dataclasses.asdict(problem) for problem in find_problems(mesh)])


PICTURE_SIZE = 256
"""Width and height of an asset's picture [px]."""


def picture_steps(mesh: Mesh, front: tuple[float, float, float]) -> Steps[np.ndarray]:
    """A picture (S, S, 3) uint8 of a mesh, seen from ``front``, in its own frame."""
    yield 0.0, "Drawing a picture"
    from ...core.preview.mesh_views import render_views

    return render_views(mesh, mesh.colors, [front], PICTURE_SIZE, PICTURE_SIZE)
