"""A rig calibrated once, kept as a JSON file and used for every later snapshot, as long as it has not moved.

``{"format": "mirror-scan rig", "version": 1, "intrinsics": {…}, "mirrors": [{"name", "point", "normal", "down",
"rectangle", "outline", "covariance", "residual_mm", "points_used"}, …]}``: metres, camera frame; the covariance is
:attr:`.mirror.Mirror.covariance`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..camera import RgbdImage
from ..capture import Capture, MirrorPicks
from ..depth.depth_map import one_depth_map
from ..depth.sensor_recognition import measures_time
from ..depth.settings import DepthSettings
from ..errors import MirrorError, Notice
from ..mirror_alignment.reflection_alignment import JointSettings, align_reflections
from ..mirror_detection.detection import find_mirrors
from ..mirror_detection.edge_segments import DetectionSettings
from ..mirror_detection.mirror_verification import circumference
from ..mirrors import Mirror
from ..mirrors.curved_glass import with_thickness, without_delay
from ..mirrors.frame_fit import fit_frame
from ..mirrors.mirror import person_before, reflection_shift
from ..mirrors.picked_mirror import MirrorSettings, place_mirror
from ..mirrors.rig_file import RigFile
from ..mirrors.wall_behind_frame import THICK, on_wall

_BOARD = JointSettings(two_sided=True)
_MIRROR, _DEPTH, _EMPTY = MirrorSettings(), DepthSettings(), DetectionSettings(empty_rig=True)
_LEAST_SHIFT = 0.003  # what moves the reflection of a person by less is not reported [m]
_CERTAIN, _LIKELY = 5.0, 3.0  # standard deviations by which a mirror has moved, and by which when another one has


def calibrate(
    capture: Capture,
    picks: tuple[MirrorPicks | Mirror, ...] | None = None,
    mirror: MirrorSettings = _MIRROR,
    depth: DepthSettings = _DEPTH,
) -> RigFile:
    """The rig that a snapshot of it shows, with or without a person in it; a longer burst makes it more certain.

    A thin flat board placed where people will stand, seen directly and in the mirrors, shows where the glass is even
    when the frames project in front of it.

    Parameters
    ----------
    capture : Capture
    picks : tuple of MirrorPicks or Mirror, optional
        What is known of each mirror; by default what the capture holds, and when that is nothing they are found.
    mirror : MirrorSettings
        The thickness of the glass goes into the rig file.
    depth : DepthSettings

    Raises
    ------
    CaptureError, MirrorError
        No readings, no mirrors, or picks that place none.
    """
    intrinsics = capture.intrinsics
    known = capture.mirrors if picks is None else tuple(picks)
    fused = one_depth_map(capture, depth)[0]
    if known:
        placed = [
            pick if isinstance(pick, Mirror) else place_mirror(RgbdImage(fused, intrinsics), pick, mirror)
            for pick in known
        ]
    else:
        placed = find_mirrors(RgbdImage(fused, intrinsics, capture.color), _EMPTY, mirror.behind_frame)
    if not placed:
        raise MirrorError(
            "{capture}: no mirror was found; see that each mirror's frame is in the picture and stands clear of walls, "
            "or pick points on the frames (option “mirrors”)",
            capture=capture.name,
            code="no_mirror",
        )
    image = RgbdImage(fused, intrinsics)
    if mirror.glass_thickness:
        placed = with_thickness(placed, mirror.glass_thickness)
        image = without_delay(image, placed) if measures_time(capture, depth) else image
    on_frames, placed = placed, align_reflections(image, placed, _BOARD)[0]
    placed = [
        replace(m, frame_ahead=mirror.behind_frame + float((on_frame.point - m.point) @ m.normal))
        if m.source in ("picked", "found") else m
        for on_frame, m in zip(on_frames, placed, strict=True)
    ]  # fmt: skip
    for m in placed:
        if m.rectangle is None:
            raise MirrorError(
                "{name}: a plane alone is no calibration; pick points on this mirror's frame instead", name=m.name
            )
    return RigFile(intrinsics, tuple(placed))


@dataclass(frozen=True)
class _Change:
    """A mirror beside its frame as it is seen now, ``seen``.

    By how much that moves the reflection of a person [m], and how many standard deviations of both fits that is.
    ``gone``: its frame is not there any more.
    """

    mirror: Mirror
    seen: Mirror | None
    shift: float = 0.0
    deviations: float = 0.0
    gone: bool = False

    def moved(self, deviations: float, limit: float) -> bool:
        """Whether the mirror has moved by more than so many standard deviations, and by more than ``limit`` [m]."""
        return self.gone or (self.deviations > deviations and self.shift > limit)


def moved_warnings(image: RgbdImage, mirrors: Sequence[Mirror], limit: float = _LEAST_SHIFT) -> list[str]:
    """:func:`moved_warning` of all mirrors of a rig file; one when all have moved, for then it is the camera.

    Where one mirror has certainly moved, weaker evidence is enough to say so of the others.
    """
    changes = [_change(image, mirror) for mirror in mirrors]
    if not any(change.moved(_CERTAIN, limit) for change in changes):
        return []
    warned: list[str] = [_in_words(change) for change in changes if change.moved(_LIKELY, 0.5 * limit)]
    if len(warned) < max(2, len(mirrors)):
        return warned
    return [
        Notice(
            "{names}: {first}; all have moved alike, so most likely it was the camera",
            names=", ".join(mirror.name for mirror in mirrors), first=_movement(changes[0]),
            mirrors=[mirror.name for mirror in mirrors],
        )
    ]  # fmt: skip


def moved_warning(image: RgbdImage, mirror: Mirror, limit: float = _LEAST_SHIFT) -> str | None:
    """A warning when a mirror is no longer where the rig file says; None when it is, or cannot be seen.

    The frame as it is seen now is fitted anew about the stored plane. It has moved when slopes and shift between both
    are more than their covariances allow (Mahalanobis), and change the reflection of a person 1.5 m in front of the
    mirror by more than ``limit`` [m]. What it does not change, a mirror pushed along its own plane, is not reported.

    Parameters
    ----------
    mirror : Mirror
        From a rig file.
    image : RgbdImage
        Fused depth of the snapshot, z [m].
    """
    change = _change(image, mirror)
    return _in_words(change) if change.moved(_CERTAIN, limit) else None


def _change(image: RgbdImage, mirror: Mirror) -> _Change:
    mirror = replace(mirror, point=mirror.point + mirror.frame_ahead * mirror.normal)  # where its frame was
    seen = fit_frame(image, mirror, inward=0.06)
    if seen is None:
        # is something seen behind the place of the frame, which the frame should hide?
        return _Change(mirror, None, gone=_empty(image, mirror))
    a, b, normal = mirror.basis.T
    along = seen.normal @ normal
    step = np.array((-(seen.normal @ a), -(seen.normal @ b), seen.normal @ (seen.point - mirror.point))) / along
    allowed = _random(seen) + (_random(mirror) if mirror.covariance is not None else 0.0)
    deviations = float(np.sqrt(max(step @ np.linalg.solve(allowed, step), 0.0)))
    return _Change(mirror, seen, reflection_shift(person_before(mirror), seen, mirror), deviations)


def _random(mirror: Mirror) -> np.ndarray:
    """The covariance of its plane without the thickness of a glass that hangs on a wall: that is the same twice."""
    covariance = np.array(mirror.covariance)
    if on_wall(mirror):
        covariance[2, 2] -= THICK**2
    return covariance


def _in_words(change: _Change) -> Notice:
    name = change.mirror.name
    return Notice("{name}: {change}", name=name, change=_movement(change), mirrors=[name])


def _movement(change: _Change) -> Notice:
    """What happened, without whose mirror it is."""
    mirror, seen = change.mirror, change.seen
    if seen is None:
        return Notice("the rig has moved since it was calibrated: its frame is not where it was; calibrate it again")
    nearer = float(seen.normal @ (seen.point - mirror.point) / (seen.normal @ mirror.normal))
    turned = float(np.degrees(np.arccos(np.clip(seen.normal @ mirror.normal, -1.0, 1.0))))
    how = [f"{1000.0 * abs(nearer):.0f} mm {'forward' if nearer > 0 else 'back'}"] if abs(nearer) > 0.002 else []
    how += [f"turned by {turned:.1f}°"] if turned > 0.15 else []
    return Notice(
        "the rig has moved since it was calibrated, by about {shift:.0f} mm at the person ({how}); put it back, or "
        "calibrate it again",
        shift=1000.0 * change.shift, how=", ".join(how) or "tilted a little",
    )  # fmt: skip


def _empty(image: RgbdImage, mirror: Mirror) -> bool:
    """Nothing stands in the frame's place, and what is farther away is seen in much of it."""
    assert mirror.rectangle is not None  # every mirror of a rig file has one
    there, beyond = circumference(image, mirror.point, mirror.basis, mirror.rectangle, outward=-0.015)
    return beyond > 0.5 or (beyond > 0.25 and there < 0.02)
