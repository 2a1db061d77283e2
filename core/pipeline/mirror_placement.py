"""The mirrors of a capture: placed from picks, taken from a rig file, or found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..camera import RgbdImage, unproject
from ..camera.noise_models import SENSORS
from ..capture import Capture, MirrorPicks
from ..depth.sensor_recognition import Principle, measuring_principle
from ..errors import MirrorError, Notice, PicksDisagreeError
from ..mirror_alignment.floor_alignment import align_floor
from ..mirror_alignment.frame_shape import honest_error
from ..mirror_alignment.glass_alignment import (
    GlassEvidence,
    align_bows,
    doubted_offsets,
    thick_glass,
    with_unsure_offsets,
)
from ..mirror_alignment.own_reflection import align_own_reflections
from ..mirror_alignment.person_alignment import align_persons
from ..mirror_alignment.reflection_alignment import align_reflections
from ..mirror_alignment.view_alignment import align_views
from ..mirror_detection.detection import find_mirrors
from ..mirror_detection.frameless_mirrors import frameless_notes
from ..mirror_detection.mirror_at_picks import MirrorSearch, contradicted, find_better_at, find_mirror_at
from ..mirrors import Mirror
from ..mirrors.curved_glass import with_thickness, without_delay
from ..mirrors.frame_fit import without_crossing_walls
from ..mirrors.picked_mirror import place_mirror
from ..views.view_correspondences import likeness
from .rig_calibration import moved_warnings
from .settings import Settings


def place_mirrors(
    known: tuple[MirrorPicks | Mirror, ...], depth: np.ndarray, capture: Capture, settings: Settings
) -> tuple[list[Mirror], tuple[str, ...]]:
    """The mirrors that were picked or given, or else those that the depth map shows; and what to warn of."""
    first = first_mirrors(known, depth, capture, settings)
    principle = measuring_principle(capture, settings.depth, settings.light.phase_said)
    return align_mirrors(first, RgbdImage(depth, capture.intrinsics), capture, settings, principle)


def first_mirrors(
    known: tuple[MirrorPicks | Mirror, ...], depth: np.ndarray, capture: Capture, settings: Settings
) -> list[Mirror]:
    """The mirrors where their frames are: picked, given, or found in the depth map.

    Raises
    ------
    MirrorError
        There is none, or one cannot be placed.
    """
    image, offset = RgbdImage(depth, capture.intrinsics), settings.mirror.behind_frame
    cloud, search = unproject(depth, capture.intrinsics), MirrorSearch(image, settings.detection, offset)

    def place(one: MirrorPicks | Mirror) -> Mirror:
        if isinstance(one, Mirror):
            return one
        if one.frame_pixels is not None and len(one.frame_pixels) < 3:
            return find_mirror_at(image, one, settings.detection, offset)
        mirror, fault = None, None
        try:
            mirror = place_mirror(image, one, settings.mirror, cloud)
        except PicksDisagreeError as error:
            fault = error
        mirror = find_better_at(search, one, mirror)
        if mirror is None:
            assert fault is not None  # a mirror that was placed is kept unless a better one is found
            raise fault
        return mirror

    placed = [place(one) for one in known]
    if not known:
        placed = find_mirrors(replace(image, color=capture.color), settings.detection, offset)
    if not placed:
        raise MirrorError(
            "{name}: no mirror was found: none is given, and no straight frame with the person's reflection in it is "
            "seen; pick points on each mirror's frame and save them in mirrors.json beside the capture, or elsewhere "
            "(option “mirrors”); a frame at least 3 cm wide and 10 cm off the wall is found automatically, and a "
            "mirror without one where the camera sees some of the same skin directly and in it",
            name=capture.name,
            code="no_mirror",
        )
    return placed


def align_mirrors(
    first: list[Mirror], image: RgbdImage, capture: Capture, settings: Settings, principle: Principle
) -> tuple[list[Mirror], tuple[str, ...]]:
    """The mirrors corrected until frames, floor and views fit together; and what to warn of."""
    given = first
    image, first = without_crossing_walls(image, given)
    warnings = list(moved_warnings(image, [m for m in first if m.source == "rig file"]))
    warnings += [
        Notice(
            "{name}: the plane through its picks does not look like a mirror's: almost no frame lies in it, or what "
            "is seen in it would be where the camera sees empty space; pick again, on its frame only",
            name=m.name, mirrors=[m.name],
        )
        for k, m in enumerate(first)
        if m.source == "picked" and m is given[k] and contradicted(image, m, first[:k] + first[k + 1 :])
    ]  # fmt: skip
    alike = likeness(image.depth)[1]
    judged = [honest_error(image, m, alike) if m.source in ("picked", "found") else (m, None) for m in first]
    placed = [mirror for mirror, _ in judged]
    warnings += [warning for _, warning in judged if warning is not None]
    placed, by_camera = align_own_reflections(replace(image, color=capture.color), placed, settings.own_reflection)
    warnings += by_camera
    placed = with_thickness(placed, settings.mirror.glass_thickness)
    timed, raw = principle.time, image
    image = without_delay(raw, placed) if timed else raw
    # what was told of the glass is known
    told = settings.mirror.glass_thickness or settings.mirror.glass_offset
    glass = GlassEvidence() if told and timed is False else thick_glass(image, placed, settings.thickness, timed)
    before, thick = placed, glass.thickness
    placed, by_reflections = align_reflections(image, placed, settings.alignment, thick)
    placed, doubts = doubted_offsets(placed, glass, before)
    image = without_delay(raw, placed) if timed or thick is not None else raw
    placed, by_floor = align_floor(image, placed, settings.floor, alike)
    model = SENSORS.get(principle.sensor)
    placed, by_person = align_persons(image, placed, settings.person, None if model is None else model.baseline)
    placed, by_views = align_views(image, placed, settings.agreement)
    placed, by_bow = align_bows(image, placed, settings.bow)
    bowed = {m.name for m in placed if m.sag}
    warnings += [doubt for doubt in doubts if bowed.isdisjoint(Notice.of(doubt).mirrors)]  # a bow explains it
    # a camera that measures time shows thick glass by its delay
    placed = placed if told or timed else with_unsure_offsets(placed, glass, before)
    warnings += (*by_reflections, *by_floor, *by_person, *by_views, *by_bow)
    return placed, (*warnings, *frameless_notes(placed))
