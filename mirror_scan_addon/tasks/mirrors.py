"""Tasks of mirrors: fit them to picks, find them, place them once for a rig."""

from __future__ import annotations

import numpy as np

from ...core.camera import Intrinsics, RgbdImage
from ...core.errors import MirrorError
from ...core.mirrors import Mirror
from .mirror_judgement import ENOUGH, judged, picks_of
from .mirror_records import known_mirror, mirror_of, record_of
from .results import Cloud, Fitted, Steps

FINDING, FITTING = "Finding the mirrors", "Fitting the mirrors"


def fit_steps(
    depth: np.ndarray,
    intrinsics: Intrinsics,
    mirrors: list[dict],
    glass_offset: float,
    numbers: list[int] | None = None,
    sensor: str = "",
) -> Steps[Fitted]:
    """Fit every mirror that has picks; one that cannot be fitted says why in its record.

    ``numbers`` are the mirrors' places in the scene's list, from 0, when these are not all.
    """
    yield 0.0, FITTING
    return fit_records(depth, intrinsics, mirrors, glass_offset, numbers, sensor)


def find_mirrors_steps(
    depth: np.ndarray, color: np.ndarray | None, intrinsics: Intrinsics, glass_offset: float, sensor: str = ""
) -> Steps[Fitted]:
    """Mirrors that show themselves; none found gives an empty list."""
    yield 0.0, FINDING
    from ...core.mirror_detection.detection import find_mirrors

    found = find_mirrors(RgbdImage(depth, intrinsics, color), glass_offset=glass_offset)
    yield 0.9, FITTING
    records = _judged_records(found, depth, intrinsics, sensor)
    return Fitted(records, _seen(depth, intrinsics, found) if found else None)


def calibrate_steps(
    cloud: Cloud, mirrors: list[dict], glass_offset: float, path: str, glass_thickness: float = 0.0
) -> Steps[Fitted]:
    """Place the mirrors of a rig, found when there are none yet, and write them to the rig file ``path``."""
    yield 0.0, FITTING if mirrors else FINDING
    from ...core.mirrors.picked_mirror import MirrorSettings
    from ...core.mirrors.rig_file import read_rig, write_rig
    from ...core.pipeline.rig_calibration import calibrate

    known = tuple(known_mirror(record) for record in mirrors)
    glass = MirrorSettings(glass_offset=glass_offset, glass_thickness=glass_thickness)
    write_rig(path, calibrate(cloud.capture(), known, glass))
    placed = list(read_rig(path).mirrors)  # as later captures will have them
    records = _judged_records(placed, cloud.depth, cloud.intrinsics, str(cloud.info.get("sensor", "")))
    return Fitted(records, _seen(cloud.depth, cloud.intrinsics, placed))


def rig_steps(cloud: Cloud, path: str) -> Steps[Fitted]:
    """The mirrors of a rig file, and a warning of each that has moved since it was written."""
    yield 0.0, "Reading the rig file"
    from ...core.mirrors.rig_file import mirrors_for, read_rig
    from ...core.pipeline.rig_calibration import moved_warnings

    placed, depth = list(mirrors_for(read_rig(path), cloud.intrinsics)), cloud.depth
    yield 0.5, FITTING
    warnings = tuple(moved_warnings(RgbdImage(depth, cloud.intrinsics), placed))
    records = _judged_records(placed, depth, cloud.intrinsics, str(cloud.info.get("sensor", "")))
    return Fitted(records, _seen(depth, cloud.intrinsics, placed), warnings)


def fit_records(
    depth: np.ndarray,
    intrinsics: Intrinsics,
    records: list[dict],
    glass_offset: float,
    places: list[int] | None = None,
    sensor: str = "",
) -> Fitted:
    """Records of mirrors, each fitted to its picks; as :func:`fit_steps`, without its steps."""
    from ...core.mirrors.picked_mirror import MirrorSettings, place_mirror

    settings = MirrorSettings(glass_offset=glass_offset)
    answers, placed, numbers = [], [], [-1, 0]
    for place, record in zip(places or range(len(records)), records, strict=True):
        try:
            if len(record["picks"]) >= ENOUGH:
                mirror = place_mirror(RgbdImage(depth, intrinsics), picks_of(record), settings)
            elif record["picks"]:
                from ...core.mirror_detection.mirror_at_picks import find_mirror_at

                mirror = find_mirror_at(RgbdImage(depth, intrinsics), picks_of(record), glass_offset=glass_offset)
            else:
                mirror = mirror_of(record)
        except MirrorError as error:
            answers.append(record | {"plane": "", "residual_mm": 0.0, "message": str(error)})
        else:
            answers.append(record_of(mirror, record["picks"]))
            placed.append(mirror)
            numbers.append(place + 1)
    answers = judged(answers, depth, intrinsics, placed, sensor)
    if not placed:
        return Fitted(answers, None)
    # a view's number is its mirror's place in the list, whether earlier ones are placed or not
    return Fitted(answers, np.array(numbers, np.int8)[_seen(depth, intrinsics, placed) + 1])


def _judged_records(mirrors: list[Mirror], depth: np.ndarray, intrinsics: Intrinsics, sensor: str) -> list[dict]:
    """Records of placed mirrors, with what each is worth."""
    return judged([record_of(mirror) for mirror in mirrors], depth, intrinsics, mirrors, sensor)


def _seen(depth: np.ndarray, intrinsics: Intrinsics, mirrors: list[Mirror]) -> np.ndarray:
    from ...core.camera import unproject
    from ...core.views.ray_sorting import sort_rays

    return sort_rays(unproject(depth, intrinsics), mirrors, 0.0)[0]
