"""Mirrors found without a click: rectangles of straight depth edges, verified by what they show.

The readings in such a rectangle (:mod:`.edge_segments`), flipped over its plane, must make sense: none may be a
free-space violation, where the camera looks through, and a part must lie on, or close behind, what is seen directly. A
doorway, a table's legs or a window fail there.

Of a mirror that is too near the image's border only one upright side may be seen, see :mod:`.one_sided_mirrors`; where
it has no frame and no wall about it, see :mod:`.frameless_mirrors`.
"""

from __future__ import annotations

from dataclasses import replace

from ..camera import RgbdImage
from ..mirrors import Mirror
from .edge_segments import DetectionSettings, Segment, find_edge_segments
from .framed_mirrors import depth_without_frames, mirror_on_frame, partly_behind, without_overlap
from .frameless_mirrors import find_verified_frameless, overlaps
from .identical_frames import find_identical_frames
from .mirror_at_picks import DEFAULTS
from .mirror_verification import doubtful, verified_hypotheses
from .one_sided_mirrors import may_be_images, with_one_sided
from .rectangle_hypotheses import propose

_USUAL = 2  # mirrors: where depth alone finds fewer, the colour picture's lines are asked as well


def find_mirrors(image: RgbdImage, settings: DetectionSettings = DEFAULTS, glass_offset: float = 0.0) -> list[Mirror]:
    """All mirrors of a scene, from the left, without a click.

    Parameters
    ----------
    image : RgbdImage
        Fused depth, flying pixels removed; z [m], 0 = no reading. Where depth alone finds fewer than two mirrors, lines
        of the colour picture stand for parts of frames that give no readings, as black and glossy ones do.
    glass_offset : float
        How far the reflecting glass lies behind the front of the frame [m].

    Returns
    -------
    list of Mirror
        ``source`` "found"; named left, right, or mirror 1, 2 … from the left. Empty when there is none.

    Notes
    -----
    O(H W) and the square of the number of straight depth edges; deterministic.
    """
    depth, color = image.depth, image.color
    if color is not None and color.shape[:2] != depth.shape:
        color = None
    segments = find_edge_segments(image.without_color(), settings)
    found = _framed(image.without_color(), segments, [], glass_offset, settings)
    if color is not None and len(found) < _USUAL:
        found = _framed(image, find_edge_segments(image, settings), found, glass_offset, settings)
    if not settings.empty_rig and (len(found) < _USUAL or may_be_images(found)):
        most = min(_USUAL, settings.max_mirrors)
        old, found = found, with_one_sided(image, segments, found, most, settings)
        found = [
            m if any(m is one for one in old) else replace(m, point=m.point - glass_offset * m.normal) for m in found
        ]
    doubt = [doubtful(image, m) for m in found]
    sure = [m for m, doubted in zip(found, doubt, strict=True) if not doubted]
    if len(sure) < settings.max_mirrors and not settings.empty_rig:
        better = find_verified_frameless(image, sure, settings)
        found = [m for m, doubted in zip(found, doubt, strict=True) if not (doubted and overlaps(m, better))] + better
    found.sort(key=lambda m: m.point[0] / m.point[2])
    return [replace(m, name=name) for m, name in zip(found, _names(found), strict=True)]


def _framed(
    image: RgbdImage, segments: list[Segment], found: list[Mirror], glass_offset: float, settings: DetectionSettings
) -> list[Mirror]:
    """Mirrors with a frame or a wall about them, besides those ``found``: these and the new ones."""
    intrinsics = image.intrinsics
    lenient = replace(settings, max_violation=2.0 * settings.max_violation)
    proposed = propose(segments, settings)
    guesses = verified_hypotheses(image, proposed, lenient)
    bare = depth_without_frames(image, found, glass_offset)
    while guesses:
        new = []
        for guess in without_overlap(guesses, intrinsics, found)[: settings.max_mirrors - len(found)]:
            mirror = mirror_on_frame(image, guess, glass_offset, settings, found, bare)
            if mirror is not None:
                new.append(mirror)
                bare = depth_without_frames(image.with_depth(bare), [mirror], glass_offset)
        found = found + new
        if not new or len(found) == settings.max_mirrors:
            break
        # a mirror seen in another one: its frame's edge does not count where the other's glass is in front of it
        behind = [guess for guess in proposed if partly_behind(guess, found)]
        guesses = verified_hypotheses(image, behind, lenient, found)
    return found + find_identical_frames(image, proposed, found, glass_offset, bare, settings)


def _names(mirrors: list[Mirror]) -> list[str]:
    if len(mirrors) == 2:
        return ["left", "right"]
    if len(mirrors) == 1:
        return ["left" if mirrors[0].point[0] < 0 else "right"]
    return [f"mirror {k}" for k in range(1, len(mirrors) + 1)]
