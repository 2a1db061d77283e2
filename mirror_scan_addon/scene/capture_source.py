"""Which capture an avatar was built from, and with which mirrors: kept with it, so that its colours can be asked for
again."""

from __future__ import annotations

import json
import os

import bpy
import numpy as np

from ...core.errors import CaptureError
from ..language.texts import say
from ..tasks import Source
from . import point_cloud, report_text, scan_records
from .scan_records import SOURCE
from .units import metres_per_unit

_SAME_SIZE = 0.04  # logarithm: fewer triangles make an avatar a little smaller


def keep_source(
    avatar: bpy.types.Object, path: str, frames: int, reading: dict, mirrors: list[dict], name: str = ""
) -> None:
    """Keep with an avatar what it was built from; ``mirrors`` are records of the mirrors as they were in the end, and
    ``name`` is the capture's."""
    kept = {"path": path, "frames": frames, "reading": reading, "mirrors": mirrors, "name": name}
    avatar[SOURCE] = json.dumps(kept)


def source_of(avatar: bpy.types.Object, scene: bpy.types.Scene) -> Source:
    """What an avatar was built from; one of an older version, by what its scene holds.

    Raises
    ------
    CaptureError, MirrorError
        When that is not there any more.
    """
    report = report_text.avatar_report(avatar) or {}
    placement = report.get("camera_to_avatar")
    if placement is None:
        text = say("{name}: does not say where its camera stood; build the avatar again")
        raise CaptureError(text.format(name=avatar.name), code="no_data")
    kept = _kept(avatar)
    settings = scene.mirror_scan
    if kept is None:
        path, frames = scan_records.capture_root(settings.capture_path), settings.frames
        reading, mirrors = scan_records.reading_of(settings), scan_records.placed_mirrors(settings)
    else:
        path, frames, reading, mirrors = kept["path"], kept["frames"], kept["reading"], kept["mirrors"]
    try:
        absolute = scan_records.absolute(path)
        there = bool(path) and os.path.exists(absolute)
    except CaptureError:  # relative to a .blend that is not saved
        there, absolute = False, path
    if there:
        return Source(absolute, frames, reading, mirrors, placement, None)
    points = point_cloud.cloud_of(scene)
    same = points is not None and (kept is None or scan_records.capture_root(settings.capture_path) == path)
    if not same:
        text = say("{path}: no longer exists; put the capture back, or load it again and build the avatar from it")
        raise CaptureError(text.format(path=path or say("The capture")), code="gone")
    return Source("", frames, reading, mirrors, placement, point_cloud.read_cloud(points))


def unit_as_built(avatar: bpy.types.Object, scene: bpy.types.Scene) -> float:
    """Metres in a unit of the avatar's mesh, whatever its object's scale is and whatever became of the scene's unit.

    Raises
    ------
    CaptureError
        When the mesh itself was scaled.
    """
    report = report_text.avatar_report(avatar) or {}
    tall = report.get("mesh", {}).get("height_m")
    unit = metres_per_unit(scene)
    heights = np.array(avatar.bound_box)[:, 2]
    shown = float(np.ptp(heights))
    if tall is None or not shown > 0:
        return unit
    units = np.array((unit, 1.0, 0.1, 0.01, 0.001, 1000.0, 0.3048, 0.0254))
    off = np.abs(np.log(units * shown / tall))
    if off.min() > _SAME_SIZE:
        text = say("{name}: its mesh is no longer as large as in its capture; undo its scaling, or build it again")
        raise CaptureError(text.format(name=avatar.name), code="no_data")
    return float(units[np.argmin(off)])


def _kept(avatar: bpy.types.Object) -> dict | None:
    """What :func:`keep_source` kept; None when nothing, or edited into nonsense."""
    try:
        kept = json.loads(avatar.get(SOURCE, ""))
        return kept if {"path", "frames", "reading", "mirrors"} <= set(kept) else None
    except (TypeError, ValueError):
        return None
