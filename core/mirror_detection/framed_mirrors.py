"""A verified rectangle as a mirror on the plane of its frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ..camera import Intrinsics, RgbdImage, project
from ..mirrors import Mirror
from ..mirrors.frame_fit import fit_frame, without_frames
from ..mirrors.glass_extent import at_border
from .edge_segments import BOTTOM, LEFT, RIGHT, TOP, DetectionSettings, Segment
from .mirror_verification import floor_drop, hidden_by_mirrors, missing_reflection, verify
from .rectangle_hypotheses import Hypothesis


def depth_without_frames(image: RgbdImage, mirrors: list[Mirror], glass_offset: float) -> np.ndarray:
    """The depth without what stands on the frames of mirrors.

    Parameters
    ----------
    image : RgbdImage
        z [m], 0 = no reading.
    glass_offset : float
        How far the mirrors' planes lie behind the fronts of their frames [m].
    """
    depth = image.depth
    frames = [replace(m, point=m.point + glass_offset * m.normal) for m in mirrors]
    return without_frames(image, frames) if frames else depth


def partly_behind(guess: Hypothesis, mirrors: list[Mirror]) -> bool:
    """Whether the glass of known mirrors hides part of the rectangle's outline, but not its middle.

    Corners and the middles of sides are asked. With a hidden middle it would be one of those mirrors, or an image in
    one.
    """
    (left, right), (top, bottom) = guess.rectangle
    x, y = np.meshgrid((left, 0.5 * (left + right), right), (top, 0.5 * (top + bottom), bottom))
    points = guess.point + np.column_stack((x.ravel(), y.ravel())) @ guess.basis[:, :2].T
    hidden = hidden_by_mirrors(points, mirrors)
    return bool(hidden.any() and not hidden[4])


def mirror_on_frame(
    image: RgbdImage,
    guess: Hypothesis,
    glass_offset: float,
    settings: DetectionSettings,
    known: Iterable[Mirror] = (),
    bare: np.ndarray | None = None,
) -> Mirror | None:
    """The hypothesis as a mirror on the plane of its frame; None when what it shows makes no sense with that plane.

    Parameters
    ----------
    image : RgbdImage
        Depth in z [m], 0 = no reading; the colour picture as for :func:`.mirror_verification.frame_edge_share`.
    glass_offset : float
        How far the reflecting glass lies behind the front of the frame [m].
    known : iterable of Mirror
        Behind whose glass the frame is hidden.
    bare : np.ndarray [shape=(H, W), dtype=float32], optional
        The depth without the frames of other mirrors, to fit the plane to; by default ``depth``.
    """
    depth, intrinsics = image.depth, image.intrinsics
    fitted = fit_to_frame(image.with_depth(depth if bare is None else bare), guess)
    if fitted is None:
        return None
    final = replace(guess, point=fitted.point, basis=fitted.basis)
    floor = floor_drop(image, fitted.basis)
    if verify(image, final, floor, settings, known) is None:
        return None
    if missing_reflection(image, fitted):
        return None
    behind = replace(fitted, point=fitted.point - glass_offset * fitted.normal)
    return at_border(behind, intrinsics, ends_without_edge(guess))


def fit_to_frame(image: RgbdImage, guess: Hypothesis) -> Mirror | None:
    """:func:`.frame_fit.fit_frame` of a hypothesis, from its depth edges."""
    mirror = Mirror("", guess.point, guess.basis[:, 2], guess.basis, guess.rectangle, source="found")
    return fit_frame(image, mirror, seeds=_along(guess.sides.values()))


def _along(sides: Iterable[Segment]) -> np.ndarray:
    """Pixels (K, 2), every few along the depth edges."""
    return np.concatenate(
        [np.linspace(a, b, max(int(np.abs(b - a).max()) // 8, 2)) for a, b in (s.ends for s in sides)]
    )


def ends_without_edge(guess: Hypothesis) -> np.ndarray:
    """Which ends of the rectangle have no depth edge, (2, 2): only those may be cut off by the image's border."""
    return np.array(
        ((RIGHT not in guess.sides, LEFT not in guess.sides), (TOP not in guess.sides, BOTTOM not in guess.sides))
    )


def without_overlap(good: list[Hypothesis], intrinsics: Intrinsics, known: list[Mirror]) -> list[Hypothesis]:
    """The best of those that share a part of the picture, with each other or a known mirror.

    Images of mirrors in a mirror go.
    """
    outlines = [m.outline for m in known if m.outline is not None and np.isfinite(m.outline).all()]
    taken = [(outline.min(axis=0), outline.max(axis=0)) for outline in outlines]
    boxes = []
    for h in good:
        corners = np.array([(x, y) for x in h.rectangle[0] for y in h.rectangle[1]])
        pixels = project(h.point + corners @ h.basis[:, :2].T, intrinsics)
        boxes.append((pixels.min(axis=0), pixels.max(axis=0)))
    chosen: list[int] = []
    for i in range(len(good)):
        for low, high in taken + [boxes[j] for j in chosen]:
            size = np.minimum(boxes[i][1], high) - np.maximum(boxes[i][0], low)
            smaller = min(np.prod(boxes[i][1] - boxes[i][0]), np.prod(high - low))
            if size.min() > 0 and np.prod(size) > 0.25 * smaller:
                break
        else:
            chosen.append(i)
    return [good[i] for i in chosen]
