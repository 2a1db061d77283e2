"""A clip for an avatar from whatever names a motion: a recording, a BVH file, or one of our own clips."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..avatar.clip import Clip
from ..avatar.skeleton import Skeleton
from .bvh import read_bvh
from .clips import CLIPS, make_clip
from .foot_lock import Soles, lock_feet
from .motion import Motion
from .retargeting import retarget


@dataclass(frozen=True)
class MotionOptions:
    """What becomes of a motion.

    Parameters
    ----------
    in_place : bool
        Leave out the way over the floor.
    lock_feet : bool
        Feet that stand do not slide and are not in the floor.
    loop : bool
        Lead the end over into the start, so that it repeats. Our own clips always do.
    """

    in_place: bool = False
    lock_feet: bool = True
    loop: bool = False


def choose_clip(
    source: Motion | Path | str,
    skeleton: Skeleton,
    soles: Soles | None = None,
    palms: np.ndarray | None = None,
    options: MotionOptions = MotionOptions(),
    rate: float | None = None,
) -> Clip:
    """The motion ``source`` as a clip of the skeleton.

    Parameters
    ----------
    source : Motion, path or str
        A recorded motion, the path of a BVH file, or a name of ``CLIPS``.
    skeleton : Skeleton
        Avatar frame.
    soles : Soles, optional
        As of :func:`.foot_lock.sole_points`; by default estimated of the skeleton.
    palms : np.ndarray [shape=(2, 3), dtype=float64], optional
        As of :func:`.rest_frames.palm_directions`; by default thumbs point ahead in the rest pose.
    options : MotionOptions
    rate : float, optional
        Frames a second of the clip; by default the file's own.

    Raises
    ------
    MirrorScanError
        The file cannot be read, or its joints are not recognised.
    """
    if isinstance(source, str) and source in CLIPS:
        clip = make_clip(source, skeleton, rate or 30.0)
        if options.lock_feet and soles is not None:
            clip = _locked_loop(clip, skeleton, soles)
        return clip.in_place() if options.in_place else clip
    motion = source if isinstance(source, Motion) else read_bvh(source)
    clip = retarget(motion, skeleton, options.in_place, options.lock_feet, options.loop, palms, soles)
    return clip if rate is None or clip.rate == rate else clip.resampled(rate)


def _locked_loop(clip: Clip, skeleton: Skeleton, soles: Soles) -> Clip:
    """A loop with its feet locked: the middle of three rounds, so that its ends still meet."""
    count = len(clip)
    way = (clip.translations[-1] - clip.translations[0]) * count / max(count - 1, 1) * (1.0, 1.0, 0.0)
    rounds = np.concatenate([clip.translations + k * way for k in range(3)])
    thrice = replace(clip, rotations=np.tile(clip.rotations, (3, 1, 1, 1)), translations=rounds, loops=False)
    locked = lock_feet(thrice, skeleton, soles)
    middle = slice(count, 2 * count)
    translations = locked.translations[middle] - way
    return replace(clip, rotations=locked.rotations[middle], translations=translations)
