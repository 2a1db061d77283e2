"""The command ``plan``: where camera, person and mirrors go in a room."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

from ..errors import OutputError
from .outputs import Writers, make_folder, read_surface, stand
from .terminal import advance, complain, progress_bar, say, stage_of

if TYPE_CHECKING:
    from ..rig_planning.placement_search import Placement


def run_plan(options: argparse.Namespace, writers: Writers) -> None:
    """``plan``: search the best placement, say it, and write the plan."""
    if options.folder is not None and options.folder.exists() and not options.folder.is_dir():
        raise OutputError(f"{options.folder}: is not a folder; choose another name")
    if not 0.0 <= options.frame <= 0.3:
        raise OutputError(f"--frame: {options.frame:g} m is no width of a frame; give 0 to 0.3 m")
    from ..rig_planning.area_coverage import body_samples  # brings numba
    from ..rig_planning.placement_advice import placement_advice
    from ..rig_planning.placement_search import PlanSettings, find_placement
    from ..rig_planning.plan_files import write_plan
    from ..rig_planning.rooms import Room
    from ..simulation.mannequin import mannequin

    room = Room(*options.room)
    with progress_bar(options.quiet) as progress:
        advance(progress, 0.0, "preparing the person")
        if options.body:
            body = stand(read_surface(options.body), options.body)
        else:
            body = mannequin(options.person, resolution=0.015)
        settings = PlanSettings(frame_width=options.frame, frames=options.frames)
        placement = find_placement(
            room, options.sensor, options.mirrors, body, settings, stage_of(progress, 0.05, 0.95)
        )
        paths = []
        if options.folder is not None:
            advance(progress, 0.95, "writing")
            make_folder(options.folder)
            paths = write_plan(placement, body, options.folder)
        checks = placement_advice(body_samples(body), placement.rig)
    for check in checks:
        if check.advice is not None:
            complain("advice", check.advice)
    if not options.quiet:
        for line in placement_lines(placement):
            say(line)
        for path in paths:
            say(f"  {path}")


def placement_lines(placement: Placement) -> list[str]:
    """A placement in plain words, a line each: what is seen and expected, and where everything goes."""
    from ..rig_planning.plan_drawing import heights_in_words, tape_marks

    coverage, error = placement.coverage, placement.error
    parts = ", ".join(f"{name} {share:.0%}" for name, share in coverage.by_part.items() if not math.isnan(share))
    views = ", ".join(f"{name} {share:.0%}" for name, share in coverage.by_view.items())
    lines = [
        f"the rig sees {coverage.share:.0%} of the body's area ({views}); {parts}",
        f"predicted mean error {error.mean_mm:.1f} mm: noise {error.noise_mm:.1f}, planes of the mirrors "
        f"{error.plane_mm:.1f}, unseen area {error.guessed_mm:.1f}",
    ]
    if error.lit_twice > 0:
        lines.append(
            f"light comes by two ways to {error.lit_twice:.0%} of what is seen; after correction it costs "
            f"{error.light_mm:.1f} mm"
        )
    along = "width" if placement.turned else "depth"
    lines.append(f"the camera looks along the room's {along}; distances from the left wall and from the camera's wall:")
    lines += [
        f"  {mark.letter}  {mark.from_left:.2f} m, {mark.from_near:.2f} m  {mark.what}"
        for mark in tape_marks(placement)
    ]
    return lines + [f"  {line}" for line in heights_in_words(placement.rig)]
