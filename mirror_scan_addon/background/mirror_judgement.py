"""What placed mirrors are worth, into the records that a scene keeps of them; runs where the mirrors are placed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.camera import Intrinsics, RgbdImage
from ...core.capture import MirrorPicks
from ...core.mirrors import Mirror


def judged(
    records: Sequence[dict], depth: np.ndarray, intrinsics: Intrinsics, mirrors: Sequence[Mirror], sensor: str
) -> list[dict]:
    """Records with ``quality``, ``reason`` and ``error_mm`` of :func:`.mirror_quality.judge_mirrors`.

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
    if not mirrors:
        return list(records)
    from ...core.checks.mirror_quality import judge_mirrors

    placed = [record for record in records if record["plane"]]
    picks = [
        MirrorPicks(record["name"], np.array(record["picks"], np.float64)) if len(record["picks"]) >= 3 else None
        for record in placed
    ]
    found = judge_mirrors(RgbdImage(depth, intrinsics), mirrors, picks, sensor)
    words = {
        id(record): {"quality": one.word, "reason": str(one.reason or ""), "error_mm": 1000.0 * min(one.error, 10.0)}
        for record, one in zip(placed, found, strict=True)
    }
    return [record | words.get(id(record), {}) for record in records]
