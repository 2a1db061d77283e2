"""What the second process sees live, handed to the window: one small file a frame, of which the newest counts.

The process writes ``frame_000012.npz`` beside the messages it sends; the window reads the newest and removes what it
has no use for. No bpy is needed here.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ...core.guidance import LiveUpdate

_KEPT = 3  # files that are not read are kept
_SUFFIX = ".npz"


@dataclass(frozen=True)
class LivePicture:
    """One frame as the window draws it.

    Parameters
    ----------
    number : int
    points : np.ndarray [shape=(N, 3), dtype=float32]
        Camera frame [m].
    colors : np.ndarray [shape=(N, 3), dtype=uint8]
    placement : np.ndarray [shape=(4, 4)]
        Camera frame → Z up, floor at z = 0.
    mirrors : list of dict
        ``name`` and ``corners`` (4, 3), camera frame [m].
    advices : list of dict
        ``code``, ``text`` (parts of a :class:`.notices.Notice`), ``severity``, ``where``, and ``arrow``: start and end,
        camera frame [m], or None.
    state, left_s, share, moved_m, retaken
        As of :class:`.guidance.LiveUpdate`.
    """

    number: int
    points: np.ndarray
    colors: np.ndarray
    placement: np.ndarray
    mirrors: list[dict] = field(default_factory=list)
    advices: list[dict] = field(default_factory=list)
    state: str = ""
    left_s: float = 0.0
    share: float = 0.0
    moved_m: float = 0.0
    retaken: int = 0

    @property
    def well(self) -> bool:
        """Whether nothing is to be changed."""
        return all(one["severity"] != "warning" for one in self.advices)


def picture_of(update: LiveUpdate, before: LivePicture | None) -> LivePicture:
    """An update as the window draws it; during the burst the cloud and mirrors of the frame ``before`` stay."""
    from ...core.errors import Notice
    from ...core.views.capture_placement import upright_frame

    if update.frame is not None:
        frame = update.frame
        points, colors = frame.points, frame.colors
        placement = upright_frame(frame.image.depth, frame.image.intrinsics) if before is None or not before.mirrors \
            else before.placement  # fmt: skip
        mirrors = [{"name": m.name, "corners": _corners(m)} for m in frame.mirrors]
    else:
        assert before is not None  # a burst begins after frames that were looked at
        points, colors, placement, mirrors = before.points, before.colors, before.placement, before.mirrors
    advices = [
        {
            "code": one.code, "text": Notice.of(one.text).parts(), "severity": one.severity, "where": one.where,
            "arrow": None if one.arrow is None else [one.arrow.start.tolist(), one.arrow.end.tolist()],
        }
        for one in update.advices
    ]  # fmt: skip
    return LivePicture(
        update.number, points, colors, placement, mirrors, advices, update.state, update.left_s, update.share,
        update.moved_m, update.retaken,
    )  # fmt: skip


def _corners(mirror: Any) -> list[list[float]]:
    """Of a mirror's glass (4, 3), or of a part of one of unknown extent, camera frame [m]."""
    (left, right), (top, bottom) = mirror.rectangle if mirror.rectangle is not None else ((-0.4, 0.4), (-0.8, 0.8))
    places = np.array(((left, top), (right, top), (right, bottom), (left, bottom)))
    return (mirror.point + places @ mirror.basis[:, :2].T).tolist()


def write_picture(folder: str, picture: LivePicture) -> None:
    """Put a frame into the folder; the oldest that nobody read go.

    Raises
    ------
    OutputError
        The disk is full.
    """
    from ...core.io.atomic_files import replacing

    said = {k: v for k, v in asdict(picture).items() if k not in ("points", "colors", "placement")}
    with replacing(Path(folder) / f"frame_{picture.number:06d}{_SUFFIX}") as temporary, open(temporary, "wb") as file:
        np.savez(
            file, points=picture.points, colors=picture.colors, placement=picture.placement,
            said=np.frombuffer(json.dumps(said).encode(), np.uint8),
        )  # fmt: skip
    _remove(_frames(folder)[:-_KEPT])


def newest_picture(folder: str, after: int = -1) -> LivePicture | None:
    """The newest frame in the folder, if its number is above ``after``; older ones are removed."""
    names = _frames(folder)
    if not names or int(names[-1].stem.split("_")[1]) <= after:
        return None
    try:
        with np.load(names[-1]) as content:
            said = json.loads(content["said"].tobytes())
            picture = LivePicture(
                points=content["points"], colors=content["colors"], placement=content["placement"], **said
            )
    except (FileNotFoundError, PermissionError):  # the other process removes it just now: the next one is there soon
        return None
    _remove(names)
    return picture


def _frames(folder: str) -> list[Path]:
    """Whole frames in the folder, oldest first."""
    if not os.path.isdir(folder):
        return []
    return sorted(path for path in Path(folder).glob(f"frame_*{_SUFFIX}"))


def _remove(paths: Sequence[Path]) -> None:
    for path in paths:
        with contextlib.suppress(FileNotFoundError, PermissionError):  # Windows: the other process reads it just now
            path.unlink()
