"""What was recorded or tracked, in the file's own skeleton, axes and unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import MirrorScanError


@dataclass(frozen=True)
class Motion:
    """Joints over time, as their file has them.

    Parameters
    ----------
    name : str
        For messages: the file's name.
    joints : tuple of str
        A parent stands before its children.
    parents : np.ndarray [shape=(J,), dtype=int]
        Place of each joint's parent; -1 for a root, or for all where only positions are known.
    positions : np.ndarray [shape=(F, J, 3), dtype=float64]
        In the file's axes and unit. NaN where a joint was not seen.
    rotations : np.ndarray [shape=(F, J, 3, 3), dtype=float64] or None
        World rotations from the file's rest pose, in the file's axes. None where only positions are known.
    rest : np.ndarray [shape=(J, 3), dtype=float64] or None
        Joints of the rest pose, in which all rotations are none; it need not be a pose a person can take.
    rate : float
        Frames a second.
    up : np.ndarray [shape=(3,), dtype=float64] or None
        The direction away from the floor, when the file says it; None is found from the motion.
    """

    name: str
    joints: tuple[str, ...]
    parents: np.ndarray
    positions: np.ndarray
    rotations: np.ndarray | None
    rest: np.ndarray | None
    rate: float
    up: np.ndarray | None = None

    def __post_init__(self) -> None:
        frames, count = len(self.positions), len(self.joints)
        if frames == 0:
            raise MirrorScanError(
                "{name}: holds no frame; choose a file with a recorded motion", name=self.name, code="motion"
            )
        right = self.positions.shape == (frames, count, 3) and self.parents.shape == (count,)
        if self.rotations is not None:
            right &= self.rotations.shape == (frames, count, 3, 3) and self.rest is not None
        if self.rest is not None:
            right &= self.rest.shape == (count, 3)
        if not right:
            raise MirrorScanError(
                "{name}: joints, positions and rotations are of different sizes", name=self.name, code="motion"
            )
        if not (np.isfinite(self.rate) and self.rate > 0):
            raise MirrorScanError("{name}: a rate of {rate} frames a second is not possible", name=self.name,
                                  rate=self.rate, code="motion")  # fmt: skip

    def __len__(self) -> int:
        return len(self.positions)


def posed(parents: np.ndarray, rest: np.ndarray, turns: np.ndarray, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World rotations (F, J, 3, 3) and positions (F, J, 3) of a hierarchy.

    Parameters
    ----------
    parents : np.ndarray [shape=(J,), dtype=int]
        A parent before its children.
    rest : np.ndarray [shape=(J, 3), dtype=float64]
        Joints of the rest pose.
    turns : np.ndarray [shape=(F, J, 3, 3), dtype=float64]
        Each joint's rotation relative to its parent.
    moves : np.ndarray [shape=(F, J, 3), dtype=float64]
        Each joint's place from its parent's, before the parent turns; NaN: as in the rest pose.
    """
    rotations, positions = np.empty_like(turns), np.empty(moves.shape)
    for joint, parent in enumerate(parents):
        offset = rest[joint] - (rest[parent] if parent >= 0 else 0)
        offset = np.where(np.isnan(moves[:, joint]), offset, moves[:, joint])
        if parent < 0:
            rotations[:, joint], positions[:, joint] = turns[:, joint], offset
        else:
            rotations[:, joint] = rotations[:, parent] @ turns[:, joint]
            positions[:, joint] = positions[:, parent] + np.einsum("fij,fj->fi", rotations[:, parent], offset)
    return rotations, positions
