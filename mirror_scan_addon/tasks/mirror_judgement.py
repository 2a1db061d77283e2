"""What placed mirrors are worth, into the records that a scene keeps of them; runs where the mirrors are placed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.camera import Intrinsics, RgbdImage
from ...core.capture import MirrorPicks
from ...core.mirrors import Mirror

ENOUGH = 3
"""Picks that make a plane; with fewer the mirror is looked for around them."""


def judged(
    records: Sequence[dict], depth: np.ndarray, intrinsics: Intrinsics, mirrors: Sequence[Mirror], sensor: str
) -> list[dict]:
    """Records with ``quality``, ``reason`` and ``error_mm`` of :func:`.mirror_quality.judge_mirrors`; where points
    cannot be placed because their rows and columns are swapped, the message says so.

    Parameters
    ----------
    records : sequence of dict
        Of all mirrors; those that are placed have a plane.
    depth : np.ndarray [shape=(H, W), dtype=float32]
        [m]
    mirrors : sequence of Mirror
        The placed ones, in the same order.
    sensor : str
        The camera's name, as a capture has it.
    """
    if not records:
        return []
    from ...core.checks.mirror_quality import judge_mirrors, swapped_points

    image = RgbdImage(depth, intrinsics)
    placed = [record for record in records if record["plane"]]
    found = judge_mirrors(image, mirrors, [_enough_picks(record) for record in placed], sensor)
    words = {
        id(record): {"quality": one.word, "reason": str(one.reason or ""), "error_mm": 1000.0 * min(one.error, 10.0)}
        for record, one in zip(placed, found, strict=True)
    }
    for record in records:
        picks = _enough_picks(record)
        if record["message"] and picks is not None and (notice := swapped_points(image, picks)) is not None:
            words[id(record)] = {"message": str(notice)}
    return [record | words.get(id(record), {}) for record in records]


def picks_of(record: dict) -> MirrorPicks:
    """The points that a record's mirror was placed by, or shall be."""
    return MirrorPicks(record["name"], np.array(record["picks"], np.float64).reshape(-1, 2))


def _enough_picks(record: dict) -> MirrorPicks | None:
    """The same; None when they are too few for a plane."""
    return picks_of(record) if len(record["picks"]) >= ENOUGH else None
