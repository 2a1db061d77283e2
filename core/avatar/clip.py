"""A motion of our skeleton: poses at a fixed rate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import MirrorScanError
from ..numeric.rotations import between
from .pose import Pose, chained_joints
from .skeleton import BONES, Skeleton


@dataclass(frozen=True)
class Clip:
    """Poses over time.

    Parameters
    ----------
    name : str
    rate : float
        Frames a second.
    rotations : np.ndarray [shape=(F, 22, 3, 3), dtype=float64]
        As of :class:`.pose.Pose`: world rotations from the skeleton's rest pose, avatar frame.
    translations : np.ndarray [shape=(F, 3), dtype=float64]
        Of the joint Hips from the rest pose, avatar frame [m].
    loops : bool
        The frame after the last is the first (in place, or a step further on).
    turned : np.ndarray [shape=(3, 3), dtype=float64]
        The rotation from the axes of the file it came from to the avatar frame.
    """

    name: str
    rate: float
    rotations: np.ndarray
    translations: np.ndarray
    loops: bool = False
    turned: np.ndarray | None = None

    def __post_init__(self) -> None:
        frames = len(self.rotations)
        if frames == 0 or self.rotations.shape != (frames, len(BONES), 3, 3) or self.translations.shape != (frames, 3):
            raise MirrorScanError("{name}: rotations and translations are of different sizes", name=self.name)

    def __len__(self) -> int:
        return len(self.rotations)

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last; of a loop, until the first comes again."""
        return (len(self) - (not self.loops)) / self.rate

    def pose(self, frame: int) -> Pose:
        """The pose of a frame; a loop goes round."""
        frame = frame % len(self) if self.loops else min(max(frame, 0), len(self) - 1)
        return Pose(self.rotations[frame], self.translations[frame])

    def joints(self, skeleton: Skeleton) -> np.ndarray:
        """Joints (F, 22, 3) over time [m]."""
        return chained_joints(skeleton.joints, self.rotations, skeleton.joints[0] + self.translations)

    def at(self, seconds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (N, 22, 3, 3) and translations (N, 3) at times (N,), between frames on the shortest way."""
        place = np.asarray(seconds, dtype=np.float64) * self.rate
        count = len(self)
        place = place % count if self.loops else np.clip(place, 0, count - 1)
        first = np.minimum(np.floor(place).astype(int), count - 1)
        second = (first + 1) % count if self.loops else np.minimum(first + 1, count - 1)
        share = place - first
        rotations = between(self.rotations[first], self.rotations[second], share[:, None])
        moves = self.translations[second] - self.translations[first]
        if self.loops:  # a loop that walks on does not jump back between its last frame and its first
            moves[second < first, :2] = self._step()
        return rotations, self.translations[first] + share[:, None] * moves

    def resampled(self, rate: float) -> Clip:
        """The clip at another rate."""
        if not (np.isfinite(rate) and rate > 0):
            raise MirrorScanError("a rate of {rate} frames a second is not possible; choose a positive one", rate=rate)
        count = max(1, round(self.duration * rate) + (not self.loops))
        rotations, translations = self.at(np.arange(count) / rate)
        return replace(self, rate=float(rate), rotations=rotations, translations=translations)

    def in_place(self) -> Clip:
        """The clip without its way over the floor; the hips stay above where they rest."""
        return replace(self, translations=self.translations * np.array([0, 0, 1.0]))

    def looped(self, blend: float = 0.4) -> Clip:
        """A loop: cut where the pose is nearest to the first, the last ``blend`` seconds led over into the start.

        Nothing is cut but of the last third. What the clip walks on the floor it keeps, a turn it undoes.
        """
        if self.loops or len(self) < 4:
            return replace(self, loops=True)
        near = np.zeros(len(self) - 1)
        for frame in (0, 1):  # the pose and the way it moves on
            own = slice(frame, len(self) - 1 + frame)
            # 1 + 2 cos of each bone's angle, summed
            near += np.einsum("fbij,bij->f", self.rotations[own], self.rotations[frame])
            near -= 40 * np.square(self.translations[own, 2] - self.translations[frame, 2])
        last = len(self) * 2 // 3
        last += int(np.argmax(near[last:]))
        count = min(max(1, round(blend * self.rate)), last // 2)
        rotations, translations = self.rotations[:last].copy(), self.translations[:last].copy()
        share = np.arange(1, count + 1) / (count + 1)
        share = share * share * (3 - 2 * share)
        # The difference between where it ends and where it starts, spread over the last frames.
        rest = np.swapaxes(self.rotations[last], -1, -2) @ self.rotations[0]
        for k in range(count):
            step = between(np.broadcast_to(np.eye(3), rest.shape), rest, share[k])
            rotations[last - count + k] = rotations[last - count + k] @ step
        translations[-count:, 2] += share * (self.translations[0, 2] - self.translations[last, 2])
        return replace(self, rotations=rotations, translations=translations, loops=True)

    def from_rest(self, pose: Pose) -> Clip:
        """The same motion of the skeleton whose rest pose is ``pose`` of this one: see :func:`.clips.take_as_rest`."""
        rotations = self.rotations @ np.swapaxes(pose.rotations, -1, -2)
        return replace(self, rotations=rotations, translations=self.translations - pose.translation)

    def _step(self) -> np.ndarray:
        """The way over the floor (2,) from the last frame to the first of the next round."""
        if len(self) < 2:
            return np.zeros(2)
        way = self.translations[-1, :2] - self.translations[0, :2]
        return way / (len(self) - 1)
