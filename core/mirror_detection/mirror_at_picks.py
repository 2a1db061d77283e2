"""The mirror that picked pixels mean, and whether what it shows contradicts its plane."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property

import numpy as np

from ..camera import RgbdImage
from ..capture import MirrorPicks
from ..errors import MirrorError
from ..mirrors import Mirror
from .edge_segments import DetectionSettings
from .framed_mirrors import mirror_on_frame
from .frameless_mirrors import find_verified_frameless
from .mirror_verification import Evidence, circumference, count_evidence, doubtful, floor_drop, hypotheses
from .rectangle_hypotheses import Hypothesis

DEFAULTS = DetectionSettings()
_CONTRADICTED = 0.15  # share of free-space violations in what a mirror shows from which its plane is wrong
_HIT = 0.35  # share of the picks that say which mirror is meant, where they fit no plane together
_STANDS, _MOSTLY = 0.6, 0.9  # of its outline, of all and of what can be judged, something must stand in its plane


def find_mirror_at(
    image: RgbdImage, picks: MirrorPicks, settings: DetectionSettings = DEFAULTS, glass_offset: float = 0.0
) -> Mirror:
    """The mirror whose frame is nearest to one or two picked pixels, too few for a plane of their own.

    That a mirror is there is the user's word: it need not show anybody.

    Parameters
    ----------
    picks : MirrorPicks
        One pixel or more on the mirror's frame; in the glass will do.

    Raises
    ------
    MirrorError
        No frame is near.
    """
    trusting = replace(settings, empty_rig=True, max_violation=max(2.0 * settings.max_violation, 0.3))
    pixels = np.asarray(picks.frame_pixels, dtype=np.float64).reshape(-1, 2)
    best = _nearest(MirrorSearch(image, trusting, glass_offset).framed, pixels, 0.5)
    if best is None and (bare := find_frameless_at(MirrorSearch(image, settings), picks, 0.5)) is not None:
        return bare
    if best is None:
        u, v = pixels[0]
        raise MirrorError(
            f"{picks.name}: no straight frame is seen near ({u:g}, {v:g}), and {len(pixels)} pick(s) are too few for a "
            "plane; pick at least 3 points on its frame, on two sides"
        )
    return replace(best, name=picks.name, source="picked")


class MirrorSearch:
    """The mirrors that an image shows, wherever picks are: searched for when first asked for, once."""

    def __init__(self, image: RgbdImage, settings: DetectionSettings = DEFAULTS, glass_offset: float = 0.0) -> None:
        self.image, self.settings, self.glass_offset = image, settings, glass_offset

    @cached_property
    def framed(self) -> list[Mirror]:
        """Those with a frame."""
        guesses = hypotheses(self.image, self.settings)
        settled = [mirror_on_frame(self.image, guess, self.glass_offset, self.settings) for guess in guesses]
        return [mirror for mirror in settled if mirror is not None]

    @cached_property
    def frameless(self) -> list[Mirror]:
        """Those without."""
        return find_verified_frameless(self.image, [], self.settings)


def find_better_at(search: MirrorSearch, picks: MirrorPicks, mirror: Mirror | None) -> Mirror | None:
    """A better mirror than ``mirror``, the one placed through the picks, where that is contradicted or None.

    Then the picks missed the frame, or there is none. Else ``mirror``.
    """
    if mirror is None or contradicted(search.image, mirror):
        pixels = np.asarray(picks.frame_pixels, dtype=np.float64).reshape(-1, 2)
        better = _nearest(search.framed, pixels, 0.05)
        if better is not None:
            return replace(better, name=picks.name, source="picked")
    elif not doubtful(search.image, mirror):
        return mirror
    return find_frameless_at(search, picks) or mirror


def contradicted(image: RgbdImage, mirror: Mirror, known: Iterable[Mirror] = ()) -> bool:
    """Whether what a mirror shows, or its outline, contradicts its plane.

    Much of what is seen in its glass is, flipped over the plane, a free-space violation; or almost nothing stands in
    the plane along its outline, as far as other mirrors that are ``known`` do not hide it.
    """
    evidence = glass_evidence(image, mirror)
    if evidence is None or mirror.rectangle is None:
        return False
    if evidence.violated > max(_CONTRADICTED * evidence.judged, 50.0):
        return True
    shares = [
        circumference(image, mirror.point, mirror.basis, mirror.rectangle, outward, known)
        for outward in (-0.015, 0.015)
    ]
    return all(on < _STANDS and on < _MOSTLY * (on + beyond) for on, beyond in shares)


def glass_evidence(image: RgbdImage, mirror: Mirror) -> Evidence | None:
    """What becomes of the readings in a mirror's glass that are flipped over its plane; None without a rectangle."""
    if mirror.rectangle is None or mirror.polygon is not None:
        return None
    guess = Hypothesis(mirror.point, mirror.basis, mirror.rectangle, {})
    return count_evidence(image, guess, floor_drop(image, mirror.basis))


def find_frameless_at(search: MirrorSearch, picks: MirrorPicks, reach: float = 0.15) -> Mirror | None:
    """The mirror without a frame along whose edges picks were made, which no reading there can place.

    None when there is none within ``reach`` of its size. Its ``source`` stays "found": the picks say only which.
    """
    pixels = np.asarray(picks.frame_pixels, dtype=np.float64).reshape(-1, 2)
    mirror = _nearest(search.frameless, pixels, reach)
    return None if mirror is None else replace(mirror, name=picks.name)


def _nearest(mirrors: list[Mirror], pixels: np.ndarray, reach: float) -> Mirror | None:
    """The mirror whose outline is nearest to the better part of pixels (K, 2), within ``reach`` of its lesser size."""
    best, nearest = None, np.inf
    for mirror in mirrors:
        assert mirror.outline is not None  # found mirrors have one
        corners = np.nan_to_num(mirror.outline)
        distance = float(np.quantile([_to_outline(pixel, corners) for pixel in pixels], _HIT))
        if distance < nearest and distance < reach * np.ptp(corners, axis=0).min():
            best, nearest = mirror, distance
    return best


def _to_outline(pixel: np.ndarray, corners: np.ndarray) -> float:
    """Distance of a pixel from the outline [px]."""
    start, along = corners, np.roll(corners, -1, axis=0) - corners
    share = ((pixel - start) * along).sum(axis=1) / np.maximum((along * along).sum(axis=1), 1e-9)
    return float(np.linalg.norm(start + np.clip(share, 0.0, 1.0)[:, None] * along - pixel, axis=1).min())
