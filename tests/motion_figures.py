"""A person of joints for tests, and motions of other skeletons that move like it."""

from __future__ import annotations

import numpy as np
from mirror_scan.core.avatar.skeleton import BONES, Skeleton
from mirror_scan.core.motion import Motion
from mirror_scan.core.motion.motion import posed
from scipy.spatial.transform import Rotation

_HALF = {
    "Shoulder": (0.04, 0.02, 1.44),
    "Arm": (0.17, 0.02, 1.40),
    "ForeArm": (0.32, 0.03, 1.18),
    "Hand": (0.45, -0.02, 0.97),
    "UpLeg": (0.09, 0.0, 0.92),
    "Leg": (0.10, -0.01, 0.50),
    "Foot": (0.11, 0.02, 0.08),
    "ToeBase": (0.12, -0.10, 0.02),
}
_MIDDLE = {
    "Hips": (0, 0, 0.97),
    "Spine": (0, 0, 1.07),
    "Spine1": (0, 0.01, 1.17),
    "Spine2": (0, 0.02, 1.29),
    "Neck": (0, 0.02, 1.47),
    "Head": (0, 0.01, 1.55),
}


def skeleton(scale: float = 1.0) -> Skeleton:
    """In an A-pose, 1.75 m tall."""
    joints = []
    for bone in BONES:
        if bone in _MIDDLE:
            joints.append(_MIDDLE[bone])
        else:
            side = 1 if bone.startswith("Left") else -1
            x, y, z = _HALF[bone.removeprefix("Left").removeprefix("Right")]
            joints.append((side * x, y, z))
    ends = [(0, 0.01, 1.75), (0.52, -0.05, 0.83), (-0.52, -0.05, 0.83), (0.12, -0.17, 0.01), (-0.12, -0.17, 0.01)]
    return Skeleton(scale * np.array(joints), scale * np.array(ends, dtype=np.float64), np.ones(22))


# Another person's T-pose: other proportions, Y up, facing +Z, centimetres.
_T_HALF = {
    "Shoulder": (3, 138, -2),
    "Arm": (18, 140, -3),
    "ForeArm": (47, 140, -3),
    "Hand": (70, 140, -3),
    "HandMiddle1": (79, 140, -3),
    "HandThumb1": (73, 139, 1),
    "UpLeg": (9, 88, 0),
    "Leg": (9, 47, 0),
    "Foot": (9, 8, -2),
    "ToeBase": (9, 2, 11),
}
_T_MIDDLE = {
    "Hips": (0, 93, 0),
    "Spine": (0, 100, 0),
    "Spine1": (0, 112, -1),
    "Spine2": (0, 124, -2),
    "Neck": (0, 144, -2),
    "Head": (0, 151, 0),
}
_T_TREE = {
    "Hips": None, "Spine": "Hips", "Spine1": "Spine", "Spine2": "Spine1", "Neck": "Spine2", "Head": "Neck",
    "Shoulder": "Spine2", "Arm": "Shoulder", "ForeArm": "Arm", "Hand": "ForeArm", "HandMiddle1": "Hand",
    "HandThumb1": "Hand", "UpLeg": "Hips", "Leg": "UpLeg", "Foot": "Leg", "ToeBase": "Foot",
}  # fmt: skip


def other_person() -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names, parents (J,) and T-pose joints (J, 3) [cm], Y up, facing +Z."""
    names, parents, joints = [], [], []
    for part, parent in _T_TREE.items():
        for side in ("",) if part in _T_MIDDLE else ("Left", "Right"):
            names.append(side + part)
            above = None if parent is None else parent if parent in _T_MIDDLE else side + parent
            parents.append(-1 if above is None else names.index(above))
            x, y, z = _T_MIDDLE[part] if part in _T_MIDDLE else _T_HALF[part]
            joints.append((-x if side == "Right" else x, y, z))
    return names, np.array(parents), np.array(joints, dtype=np.float64)


def gymnastics(frames: int = 60, seed: int = 3) -> Motion:
    """The other person moving all joints smoothly, knees and elbows as hinges; feet in the air."""
    names, parents, rest = other_person()
    rng = np.random.default_rng(seed)
    time = np.linspace(0, 2 * np.pi, frames)
    turns = np.tile(np.eye(3), (frames, len(names), 1, 1))
    for place, name in enumerate(names):
        sizes, shifts = rng.uniform(-0.3, 0.3, 3), rng.uniform(0, 6, 3)
        wave = sizes * np.sin(time[:, None] + shifts) - sizes * np.sin(shifts)
        if name.endswith("ForeArm"):  # about the vertical, forearms ahead
            bend = 1.0 + 0.7 * np.sin(time + shifts[0])
            wave = np.stack([0 * time, -bend if name.startswith("Left") else bend, 0 * time], axis=1)
        elif name.endswith("Leg") and not name.endswith("UpLeg"):
            wave = np.stack([0.8 + 0.6 * np.sin(time + shifts[0]), 0 * time, 0 * time], axis=1)
        elif name.endswith("Middle1") or name.endswith("Thumb1") or name.endswith("ToeBase"):
            wave = wave * 0
        turns[:, place] = Rotation.from_rotvec(wave).as_matrix()
    moves = np.full((frames, len(names), 3), np.nan)
    moves[:, 0] = rest[0] + np.stack([20 * np.sin(time), 10 * np.sin(2 * time), 40 * time], axis=1)
    rotations, positions = posed(parents, rest, turns, moves)
    return Motion("gymnastics", tuple(names), parents, positions, rotations, rest, 30.0)


def changed(motion: Motion, axes: np.ndarray | None = None, unit: float = 1.0, names=None) -> Motion:
    """The same motion in other axes (3, 3), unit and names."""
    axes = np.eye(3) if axes is None else axes
    rotations = axes @ motion.rotations @ axes.T
    names = motion.joints if names is None else names
    return Motion(
        motion.name, tuple(names), motion.parents, unit * motion.positions @ axes.T, rotations,
        unit * motion.rest @ axes.T, motion.rate,
    )  # fmt: skip


def along_x(motion: Motion) -> Motion:
    """The same motion of a skeleton whose rest pose has all bones along X (as Rokoko exports): no pose at all."""
    count = len(motion.joints)
    own = np.tile(np.eye(3), (count, 1, 1))  # from the new rest axes to the old
    for joint in range(1, count):
        children = np.flatnonzero(motion.parents == joint)
        if len(children):
            way = motion.rest[children[0]] - motion.rest[joint]
            own[joint] = Rotation.align_vectors([way / np.linalg.norm(way)], [[1.0, 0, 0]])[0].as_matrix()
        else:
            own[joint] = own[motion.parents[joint]]
    rest = motion.rest.copy()
    for joint in range(1, count):
        parent = motion.parents[joint]
        rest[joint] = rest[parent] + own[parent].T @ (motion.rest[joint] - motion.rest[parent])
    return Motion(
        motion.name, motion.joints, motion.parents, motion.positions, motion.rotations @ own, rest, motion.rate
    )


def angles(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Degrees between vectors (..., 3)."""
    across = np.linalg.norm(np.cross(first, second), axis=-1)
    return np.degrees(np.arctan2(across, (first * second).sum(axis=-1)))


def apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Degrees between rotations (..., 3, 3)."""
    cosine = (np.einsum("...ij,...ij->...", first, second) - 1) / 2
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))
