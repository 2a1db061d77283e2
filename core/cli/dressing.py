"""The command ``dress``: garments for an avatar with a skeleton."""

from __future__ import annotations

import argparse
from dataclasses import replace

from ..errors import OutputError
from .commands import rigged_avatar
from .outputs import Writers, check_targets, dressed_writer_of, write_together
from .terminal import advance, progress_bar, say


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
