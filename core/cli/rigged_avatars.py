"""The commands ``animate`` and ``dress``: a motion, or garments, for an avatar with a skeleton."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import CaptureError, OutputError
from .outputs import Readers, Writers, check_targets, dressed_writer_of, motion_writer_of, reader_of, write_together
from .terminal import advance, progress_bar, say

if TYPE_CHECKING:
    from ..avatar.avatar_file import Avatar
    from ..motion import Clip


def run_animate(options: argparse.Namespace, writers: Writers) -> None:
    """``animate``: give an avatar with a skeleton a motion."""
    outputs = [(path, motion_writer_of(path, writers, options.vrm)) for path in options.outputs]
    check_targets(options.outputs)
    for path in options.outputs:
        if path.resolve() == Path(options.motion).resolve():
            raise OutputError(f"{path}: is the motion that is read; choose another name for what is written")

    with progress_bar(options.quiet) as progress:
        advance(progress, 0.0, "reading the avatar")
        avatar = rigged_avatar(options.avatar, options.readers)
        advance(progress, 0.3, "moving it")
        clip = _clip_for(avatar, options)
        advance(progress, 0.6, "writing")
        write_together(outputs, avatar, clip)
    if not options.quiet:
        frames = len(clip.rotations)
        say(f"{clip.name}: {frames} frame{'s' if frames > 1 else ''}, {clip.rate:g} a second")
        for path, _ in outputs:
            say(f"  {path}")


def _clip_for(avatar: Avatar, options: argparse.Namespace) -> Clip:
    """The motion that a command line names, for the avatar's skeleton."""
    from ..motion import CLIPS, MotionOptions, choose_clip, palm_directions, sole_points

    assert avatar.skeleton is not None and avatar.weights is not None  # seen to when it was read
    source: Any = options.motion
    suffix = Path(source).suffix.lower()
    if source not in CLIPS:
        if suffix not in (".bvh", ".fbx"):
            raise CaptureError(f"{source}: is no motion; give a .bvh or .fbx file, or one of {', '.join(CLIPS)}")
        source = Path(source) if suffix == ".bvh" else reader_of(Path(source), options.readers)(Path(source))
    skin = avatar.mesh.vertices, avatar.weights, avatar.skeleton
    wanted = MotionOptions(options.in_place, loop=options.loop)
    return choose_clip(source, avatar.skeleton, sole_points(*skin), palm_directions(*skin), wanted)


def run_dress(options: argparse.Namespace, writers: Writers) -> None:
    """``dress``: give an avatar garments."""
    _check_kinds(options.garments)
    outputs = [(path, dressed_writer_of(path, writers)) for path in options.outputs]
    check_targets(options.outputs)

    with progress_bar(options.quiet) as progress:
        advance(progress, 0.0, "reading the avatar")
        avatar = rigged_avatar(options.avatar, options.readers)
        assert avatar.skeleton is not None and avatar.weights is not None  # seen to when it was read
        made = []
        # brings numba; an avatar that cannot be read is reported before that
        from ..clothes import LAYER, NAMES, make_garment

        names = {NAMES[kind] for kind in options.garments}
        ease, worn = options.ease / 1000.0, sum(garment.name not in names for garment in avatar.garments)
        for number, kind in enumerate(options.garments):
            advance(progress, 0.2 + 0.6 * number / len(options.garments), f"cutting out: {kind}")
            made.append(
                make_garment(
                    avatar.mesh, avatar.skeleton, avatar.weights, kind, ease + LAYER * (worn + number), options.tight
                )
            )  # fmt: skip
        kept = [garment for garment in avatar.garments if garment.name not in names]
        avatar = replace(avatar, garments=(*kept, *made))
        advance(progress, 0.85, "writing")
        write_together(outputs, avatar)
    if not options.quiet:
        for garment in made:
            say(f"{garment.name}: {len(garment.mesh.vertices):,} vertices, {len(garment.mesh.triangles):,} triangles")
        for path, _ in outputs:
            say(f"  {path}")


def _check_kinds(kinds: list[str]) -> None:
    """Refuse a garment that is asked for twice."""
    for kind in kinds:
        if kinds.count(kind) > 1:
            raise OutputError(f"{kind}: is asked for twice; name each garment once")


def rigged_avatar(path: Path, readers: Readers) -> Avatar:
    """The avatar in a file, which must have a skeleton."""
    from ..avatar.avatar_file import read_avatar

    suffix = path.suffix.lower()
    if suffix not in (".glb", ".vrm", ".blend"):
        raise CaptureError(f"{path}: is no avatar; give a .glb or .blend that “reconstruct --skeleton” wrote")
    avatar = reader_of(path, readers)(path) if suffix == ".blend" else read_avatar(path)
    if avatar.skeleton is None or avatar.weights is None:
        raise CaptureError(f"{path}: the avatar has no skeleton; make it with “reconstruct --skeleton”")
    return avatar
