"""What a capture holds and whether it can be right: for the person who is about to reconstruct it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..camera import RgbdImage, unproject
from ..camera.noise_models import SENSORS, NoiseModel
from ..capture import Capture
from ..capture.capture_summary import picture, words
from ..capture.depth_units import UNIT_MISTAKES
from ..depth.burst_fusion import fuse_burst
from ..depth.burst_motion import still_warning
from ..depth.clean_views import clean
from ..depth.dequantisation import find_step
from ..depth.noise_estimate import measure_noise
from ..depth.outliers_and_dropouts import close_dropouts, remove_flying_pixels
from ..depth.sensor_recognition import recognise
from ..depth.settings import DepthSettings
from ..errors import MirrorScanError
from ..mirror_detection.detection import find_mirrors
from ..mirrors import Mirror
from ..mirrors.picked_mirror import place_mirror
from ..subject.subject_search import find_subject
from ..views.floor_and_vertical import find_floor
from .settings import Settings

_USUAL = (0.25, 12.0)  # m: median distance of what a depth camera looks at
_CAMERA_HEIGHTS = (0.2, 3.2)  # m above the floor
_PERSON_HEIGHTS = (0.6, 2.3)  # m
_SAID_BY = {
    "file": "the file says so",
    "format": "by the format of the file",
    "name": "by the name of the folder",
    "size": "by the size of the image",
}


@dataclass(frozen=True)
class Inspection:
    """``lines`` to print, ``warnings`` of what looks wrong, and the ``cleaned`` depth map (H, W) float32 [m]."""

    lines: tuple[str, ...]
    warnings: tuple[str, ...]
    cleaned: np.ndarray


def inspect_capture(capture: Capture, settings: Settings = Settings()) -> Inspection:  # noqa: B008 - frozen
    """Examine a capture: contents, sensor, units, stillness, and what each step of cleaning does to it."""
    lines = list(words(replace(capture, sensor="unknown")))  # the sensor has a line of its own here
    warnings: list[str] = []
    sensor, model = recognise(capture, settings.depth)
    lines[1:1] = [_sensor_line(capture, sensor, model, settings.depth)]
    units, wrong = check_units(capture)
    lines += units
    warnings += wrong
    cleaned = capture.depth[0]
    if not wrong:
        effect, cleaned, more = _effect(capture, model, settings)
        lines += effect
        warnings += more
    return Inspection(tuple(lines), tuple(warnings), cleaned)


def inspection_picture(capture: Capture, cleaned: np.ndarray) -> np.ndarray:
    """:func:`.capture_summary.picture` with the cleaned depth on its right, in the same colours.

    Returns
    -------
    np.ndarray [shape=(H, 2 W or 3 W, 3), dtype=uint8]
    """
    bare = replace(capture, depth=np.stack((cleaned,)), color=None, mirrors=())
    return np.hstack((picture(capture), picture(bare)))


def _sensor_line(capture: Capture, sensor: str, model: NoiseModel | None, settings: DepthSettings) -> str:
    if model is None:
        return f"  sensor   {sensor if sensor != 'unknown' else 'unknown; noise is measured on the readings'}"
    z = float(np.median(capture.depth[0][capture.depth[0] > 0])) if capture.depth[0].any() else 2.0
    how = _SAID_BY.get(capture.sensor_from, "") if capture.sensor == sensor else "known by its steps"
    how = how if settings.sensor == "auto" else "set"
    sigma = 1e3 * float(model.sigma(z, capture.intrinsics.fx))
    return f"  sensor   {model.title}, {how}; noise at {z:.1f} m should be {sigma:.1f} mm a frame"


# --- units -----------------------------------------------------------------------------------------------------------


def check_units(capture: Capture) -> tuple[list[str], list[str]]:
    """Whether a metre is a metre: usual distances, the camera's height above the floor, a Kinect's steps.

    Returns
    -------
    lines, warnings : list of str
    """
    depth = capture.depth[0] if capture.depth[0].any() else capture.depth.max(axis=0)
    camera = capture.intrinsics
    median = float(np.median(depth[depth > 0]))
    if not _USUAL[0] <= median <= _USUAL[1]:
        side = "nearer than" if median < _USUAL[0] else "beyond"
        what = f"half of the readings are {side} {median:.3g} m"
        return [], [_unit_warning(what, _mistakes(lambda f: _USUAL[0] <= median * f <= _USUAL[1]))]
    step = find_step(depth)
    expected = step * camera.fx * SENSORS["kinect_v1"].baseline / SENSORS["kinect_v1"].disparity_step if step else 0.0
    points = unproject(depth, camera)[depth > 0]
    floor = find_floor(points, np.array((0.0, -1.0, 0.0)), tilt_limit=35.0)
    lines = []
    if floor is None or floor[2] > 0.03:
        lines.append("  units    distances are usual; no floor is seen that would show more")
    else:
        up, height, noise = floor
        tilt = np.degrees(np.arcsin(np.clip(up[2], -1, 1)))
        lines.append(
            f"  units    the camera is {-height:.2f} m above the lowest level plane (flat to {1e3 * noise:.0f} mm), "
            f"tilted {abs(tilt):.0f}° {'down' if tilt < 0 else 'up'}"
        )
        mistakes = _mistakes(lambda f: _CAMERA_HEIGHTS[0] <= -height * f <= _CAMERA_HEIGHTS[1])
        usual = _CAMERA_HEIGHTS[0] <= -height <= _CAMERA_HEIGHTS[1]
        if mistakes and not usual:  # a table may be the lowest that is seen
            return lines, [_unit_warning(f"the camera would be {-height:.2f} m above the floor", mistakes)]
    if step:
        lines.append(f"  steps    readings come in steps of {1e3 * step * median**2:.0f} mm at {median:.1f} m")
        if not 0.7 < expected < 1.4:  # other cameras have steps of their own, much finer ones
            lines[-1] += f"; a Kinect v1 would have {1e3 * step / expected * median**2:.0f} mm"
    return lines, []


def _mistakes(fits: Callable[[float], bool]) -> list[tuple[str, float]]:
    """Those of the usual mix-ups of units that explain it."""
    return [(name, factor) for name, factor in UNIT_MISTAKES if fits(factor)]


def _unit_warning(what: str, mistakes: list[tuple[str, float]]) -> str:
    """What to do about a unit: one cure where one mix-up explains it, else all of them, each with its cause."""
    if not mistakes:
        return f"{what}: check the depth unit (--depth-unit) and the intrinsics"
    if len(mistakes) > 1:
        cures = "; ".join(f"by {factor:g} if they are {name}" for name, factor in mistakes)
        return f"{what}: the readings are in another unit; multiply it (--depth-unit) {cures}"
    name, factor = mistakes[0]
    return f"{what}: it looks like {name}; multiply the depth unit (--depth-unit) by {factor:g}"


# --- cleaning --------------------------------------------------------------------------------------------------------


def _effect(capture: Capture, model: NoiseModel | None, settings: Settings) -> tuple[list[str], np.ndarray, list[str]]:
    """What each step of cleaning does, on the subject where it is found, else on all that is seen."""
    camera, frames, options = capture.intrinsics, len(capture.depth), settings.depth
    warnings = []
    fused, spread = fuse_burst(capture.depth, options)
    kept = remove_flying_pixels(fused, 1.0 / camera.fx, options)
    labels = np.where(kept > 0, 0, -1).astype(np.int8)
    views, where, height = 1, "on the whole picture", None
    lines = []
    try:
        mirrors = _mirrors(capture, kept, settings)
        found = find_subject(RgbdImage(kept, camera), mirrors, settings.views) if mirrors else None
    except MirrorScanError as error:
        warnings.append(str(error))
        found = None
    if found is not None:
        if not capture.mirrors:
            lines.append(f"  mirrors  {len(mirrors)} are found without picks: {', '.join(m.name for m in mirrors)}")
        labels, views, where = found.labels, len(mirrors) + 1, "on the subject"
        body = found.points[labels >= 0] @ found.up
        height = float(body.max() - (body.min() if found.floor is None else found.floor))
    lines.append(f"  cleaning {where}")
    dropped = (fused > 0) & (kept == 0)
    single = np.where(capture.depth[0] > 0, labels, -1).astype(np.int8)
    noise = [_noise_mm(capture.depth[0], single), _noise_mm(kept, labels)]
    if frames > 1:
        lines.append(f"    {frames} frames fused: noise {noise[0]:.2f} to {noise[1]:.2f} mm")
    lines.append(f"    flying pixels dropped: {dropped.sum()} ({dropped.sum() / max((fused > 0).sum(), 1):.1%} of all)")
    closed_depth, closed = close_dropouts(kept, labels, options.close_gaps)
    lines.append(f"    missing readings filled: {((closed >= 0) & (labels < 0)).sum()}")
    burst = spread if frames > 1 else None
    undone = clean(kept, labels, views, camera.fx, replace(options, smoothing=0.0), model, burst)[0]
    moved = np.abs(undone - closed_depth)[closed >= 0]
    if model is not None and model.disparity_step:
        text = f"{1e3 * np.median(moved[moved > 0]):.1f} mm moved" if moved.any() else "noise averages them out"
        lines.append(f"    steps undone: {text}")
    smooth, closed, _ = clean(kept, labels, views, camera.fx, options, model, burst)
    shift = np.abs(smooth - undone)[closed >= 0]
    lines.append(
        f"    smoothed: readings moved by {1e3 * np.median(shift):.2f} mm, noise {_noise_mm(undone, closed):.2f} to "
        f"{_noise_mm(smooth, closed):.2f} mm"
    )
    if height is not None:
        pixels = [int((labels == k).sum()) for k in range(views)]
        lines.append(f"  subject  {height:.2f} m tall; {', '.join(str(n) for n in pixels)} px in {views} views")
        if not _PERSON_HEIGHTS[0] <= height <= _PERSON_HEIGHTS[1]:
            what = f"the subject would be {height:.2f} m tall"
            mistakes = _mistakes(lambda f: _PERSON_HEIGHTS[0] <= height * f <= _PERSON_HEIGHTS[1])
            warnings.append(_unit_warning(what, mistakes))
    still = still_warning(capture.depth, labels, camera.fx, options)
    if still:
        warnings.append(still)
    elif frames > 1:
        lines.append("  still    the subject did not move during the burst")
    return lines, np.where(closed >= 0, smooth, 0).astype(np.float32), warnings


def _mirrors(capture: Capture, depth: np.ndarray, settings: Settings) -> list[Mirror]:
    if capture.mirrors:
        return [place_mirror(RgbdImage(depth, capture.intrinsics), pick, settings.mirror) for pick in capture.mirrors]
    return find_mirrors(
        RgbdImage(depth, capture.intrinsics, capture.color), settings.detection, settings.mirror.behind_frame
    )


def _noise_mm(depth: np.ndarray, labels: np.ndarray) -> float:
    """Noise of the readings [mm], of all views together."""
    mine = np.where(labels >= 0, 0, -1).astype(np.int8)
    return 1e3 * float(measure_noise(depth, mine, 1)[0] * np.median(depth[mine >= 0])) if (mine >= 0).any() else 0.0
