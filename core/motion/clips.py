"""Clips we make ourselves, so that a rig can be tried at once: idle, walk, arms up, squat, turn; and the T-pose.

Hips and feet follow a plan, legs are bent to fit between them, arms and trunk swing by angles. All lengths are the
skeleton's own: feet neither slide nor sink, and every clip repeats.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..avatar.clip import Clip
from ..avatar.pose import Pose, SkinWeights, bone_matrices, posed_joints, posed_skeleton, skinned
from ..avatar.skeleton import BONES, Skeleton
from ..errors import MirrorScanError
from ..numeric.rotations import about_axis, between, frames, from_vectors, unit
from .foot_lock import estimated_soles
from .rest_frames import FRONT, LEFT, UP, rest_frames

_SIDES = (("Left", 1), ("Right", -1))
_STRAIGHT = 0.997  # of the leg's length: knees are never quite straight
_HANGING_ARM, _HANGING_LEG, _LEVEL_FOOT = frames(-UP, -LEFT), frames(-UP, LEFT), frames(FRONT, UP)


def make_clip(name: str, skeleton: Skeleton, rate: float = 30.0, in_place: bool = False) -> Clip:
    """A clip of ``CLIPS`` for the skeleton; all repeat.

    Raises
    ------
    MirrorScanError
        There is no clip of that name.
    """
    if name not in CLIPS:
        raise MirrorScanError(
            "there is no clip {name}; choose of {names}", name=name, names=", ".join(CLIPS), code="motion"
        )
    seconds, plan = CLIPS[name]
    count = max(4, round(seconds * rate))
    body = _Body(skeleton, count)
    plan(body, np.arange(count) / count)
    rotations, translations = body.rotations, body.hips - skeleton.joints[0]
    translations[:, :2] -= translations[0, :2]
    clip = Clip(name, count / seconds, rotations, translations, loops=True)
    return clip.in_place() if in_place else clip


def t_pose(skeleton: Skeleton) -> Pose:
    """Upright, arms straight to the sides, palms down, legs straight and parallel, feet level and ahead, on z = 0."""
    body = _Body(skeleton, 1)
    still = np.zeros(1)
    for side, sign in _SIDES:
        body.arm(side, about_axis(1, np.array([-sign * np.pi / 2])), still)
        for bone in ("UpLeg", "Leg"):
            body.place(f"{side}{bone}", _HANGING_LEG)
        for bone in ("Foot", "ToeBase"):
            body.place(f"{side}{bone}", _LEVEL_FOOT)
    standing = posed_joints(skeleton, Pose(body.rotations[0], np.zeros(3)))
    lift = min(skeleton.joints[bone, 2] - standing[bone, 2] for bone in map(BONES.index, ("LeftFoot", "RightFoot")))
    return Pose(body.rotations[0], lift * UP)


def take_as_rest(
    vertices: np.ndarray, weights: SkinWeights, skeleton: Skeleton, pose: Pose
) -> tuple[np.ndarray, Skeleton]:
    """The mesh (V, 3) and the skeleton moved into ``pose``, which is the rest pose from then on.

    Clips go along by :meth:`.Clip.from_rest`.
    """
    return skinned(vertices, weights, bone_matrices(skeleton, pose)), posed_skeleton(skeleton, pose)


class _Body:
    """A skeleton being posed over time: rotations (F, 22, 3, 3) and places of its hips (F, 3)."""

    def __init__(self, skeleton: Skeleton, count: int) -> None:
        self.skeleton, self.count = skeleton, count
        self.rest = rest_frames(skeleton)
        self.rotations = np.tile(np.eye(3), (count, len(BONES), 1, 1))
        joints = {bone: skeleton.joints[place] for place, bone in enumerate(BONES)}
        self.joints = joints
        self.middle = (joints["LeftUpLeg"] + joints["RightUpLeg"]) / 2 - joints["Hips"]
        self.half = 0.55 * float(joints["LeftUpLeg"][0] - joints["RightUpLeg"][0])  # of the way between standing feet
        ankle = float(joints["LeftFoot"][2] + joints["RightFoot"][2]) / 2
        self.tall = ankle + np.sqrt((_STRAIGHT * self.rest.leg) ** 2 - (0.1 * self.half) ** 2)  # of the hip joints [m]
        self.hips = np.tile(joints["Hips"], (count, 1))

    def place(self, bone: str, frame: np.ndarray) -> None:
        """A bone so that its rest frame comes to ``frame`` ([F,] 3, 3)."""
        at = BONES.index(bone)
        self.rotations[:, at] = frame @ self.rest.frames[at].T

    def trunk(self, middle: np.ndarray, hips: np.ndarray, chest: np.ndarray, head: np.ndarray) -> None:
        """Turns (F, 3, 3) of hips, chest and head, and the place (F, 3) between the hip joints."""
        spread = {"Hips": 0, "Spine": 1 / 3, "Spine1": 2 / 3, "Spine2": 1, "LeftShoulder": 1, "RightShoulder": 1}
        for bone, share in spread.items():
            self.rotations[:, BONES.index(bone)] = between(hips, chest, share)
        self.rotations[:, BONES.index("Neck")] = between(chest, head, 0.5)
        self.rotations[:, BONES.index("Head")] = head
        self.hips = middle - hips @ self.middle

    def arm(self, side: str, upper: np.ndarray, elbow: np.ndarray) -> None:
        """The upper arm turned from hanging by ``upper`` (F, 3, 3), the elbow bent by ``elbow`` (F,) [rad]."""
        lower = upper @ about_axis(0, -elbow)
        for bone, turn in (("Arm", upper), ("ForeArm", lower), ("Hand", lower)):
            self.place(f"{side}{bone}", turn @ _HANGING_ARM)

    def swung_arms(self, aside: np.ndarray, ahead: dict[str, np.ndarray], elbow: np.ndarray) -> None:
        """Both arms from the chest: aside and ahead (F,), the elbows bent [rad]."""
        chest = self.rotations[:, BONES.index("Spine2")]
        for side, sign in _SIDES:
            self.arm(side, chest @ about_axis(1, -sign * aside) @ about_axis(0, -ahead[side]), elbow)

    def leg(self, side: str, ankle: np.ndarray, heading: np.ndarray, pitch: np.ndarray, toes: np.ndarray) -> None:
        """A leg bent to reach ``ankle`` (F, 3); its foot's heading, its pitch and its toes', toe down (F,) [rad]."""
        hips = self.rotations[:, 0]
        hip = self.hips + hips @ (self.joints[f"{side}UpLeg"] - self.joints["Hips"])
        thigh, shin = (
            float(np.linalg.norm(self.joints[side + low] - self.joints[side + high]))
            for high, low in (("UpLeg", "Leg"), ("Leg", "Foot"))
        )
        way = ankle - hip
        length = np.clip(np.linalg.norm(way, axis=1), abs(thigh - shin) * 1.01, 0.9995 * (thigh + shin))
        turn = about_axis(2, heading)
        axis = frames(way, unit(hips[:, :, 0] + turn[:, :, 0]))[:, :, 1]
        angle = np.arccos(np.clip((thigh**2 + length**2 - shin**2) / (2 * thigh * length), -1, 1))
        upper = np.einsum("fij,fj->fi", from_vectors(-axis * angle[:, None]), unit(way)) * thigh
        self.place(f"{side}UpLeg", frames(upper, axis))
        self.place(f"{side}Leg", frames(unit(way) * length[:, None] - upper, axis))
        self.place(f"{side}Foot", turn @ about_axis(0, pitch) @ _LEVEL_FOOT)
        self.place(f"{side}ToeBase", turn @ about_axis(0, toes) @ _LEVEL_FOOT)

    def standing(self, side: str) -> np.ndarray:
        """Where the ankle (3,) is when the foot stands under the hips."""
        return np.array([dict(_SIDES)[side] * self.half, 0.0, self.joints[f"{side}Foot"][2]])

    def stand(self) -> None:
        """Both feet on their places, toes a little out."""
        still = np.zeros(self.count)
        for side, sign in _SIDES:
            out = still + sign * np.radians(6)
            self.leg(side, np.tile(self.standing(side), (self.count, 1)), out, still, still)


def _turned(ahead: np.ndarray, around: np.ndarray, aside: np.ndarray | float = 0.0) -> np.ndarray:
    """Turns (F, 3, 3): leaning ahead, around the vertical to the left, aside to the left [rad]."""
    ahead, around, aside = np.broadcast_arrays(ahead, around, aside)
    return about_axis(2, around) @ about_axis(1, aside) @ about_axis(0, ahead)


def _wave(phase: np.ndarray, size: float, shift: float = 0.0, times: int = 1) -> np.ndarray:
    return np.radians(size) * np.sin(2 * np.pi * (times * phase + shift))


def _there_and_back(phase: np.ndarray) -> np.ndarray:
    """From 0 to 1, a rest there, and back."""
    share = np.clip(np.minimum(phase, 1 - phase) / 0.4, 0, 1)
    return share**3 * (share * (6 * share - 15) + 10)


def _idle(body: _Body, phase: np.ndarray) -> None:
    still = np.zeros(body.count)
    sway = np.sin(2 * np.pi * phase)
    middle = np.stack([0.012 * sway, 0.004 * np.cos(2 * np.pi * phase), body.tall - 0.006 + 0.002 * sway**2], axis=1)
    breath = _wave(phase, 0.8, times=2)
    body.trunk(
        middle,
        _turned(still, _wave(phase, 1), _wave(phase, 0.6)),
        _turned(breath, _wave(phase, -1), _wave(phase, -0.8)),
        _turned(_wave(phase, 1.5, 0.2), _wave(phase, 5, 0.35)),
    )
    ahead = {"Left": np.radians(4) + breath, "Right": np.radians(3) + _wave(phase, 0.8, 0.1, 2)}
    body.swung_arms(np.radians(9) + breath / 2, ahead, np.radians(16) + breath)
    body.stand()


def _arms_up(body: _Body, phase: np.ndarray) -> None:
    share = _there_and_back(phase)
    still = np.zeros(body.count)
    middle = np.tile([0, 0, body.tall - 0.005], (body.count, 1))
    body.trunk(
        middle, _turned(still, still), _turned(-np.radians(4) * share, still), _turned(-np.radians(8) * share, still)
    )
    aside = np.radians(9) + np.radians(156) * share
    ahead = {side: np.radians(4) * (1 - share) for side, _ in _SIDES}
    body.swung_arms(aside, ahead, np.radians(16) * (1 - share) + np.radians(6) * share)
    body.stand()


def _squat(body: _Body, phase: np.ndarray) -> None:
    share = _there_and_back(phase)
    still = np.zeros(body.count)
    middle = np.stack([still, 0.24 * body.rest.leg * share, body.tall - 0.005 - 0.47 * body.rest.leg * share], axis=1)
    lean = np.radians(38) * share
    body.trunk(middle, _turned(0.8 * lean, still), _turned(lean, still), _turned(0.5 * lean, still))
    ahead = {side: np.radians(4) + (np.radians(82) + lean) * share for side, _ in _SIDES}
    body.swung_arms(np.radians(9) * (1 - 0.5 * share), ahead, np.radians(16) * (1 - 0.5 * share))
    body.stand()


def _walk(body: _Body, phase: np.ndarray) -> None:
    """A stride begins as the left heel meets the floor."""
    stride = 1.42 * body.rest.leg
    soles = estimated_soles(body.skeleton).points.reshape(2, 3, 2, 3).mean(axis=2)
    plans = {}
    for place, (side, shift) in enumerate((("Left", 0.0), ("Right", 0.5))):
        own = (phase + shift) % 1
        joints = np.stack([body.joints[f"{side}Foot"], body.joints[f"{side}ToeBase"]])
        ankle, pitch, toes = _step(body.standing(side), soles[place], joints, own, stride)
        ankle[:, 1] -= (np.floor(phase + shift) - shift) * stride
        plans[side] = ankle, pitch, toes
    way = stride * (0.23 - phase)
    bob = -0.013 * np.cos(4 * np.pi * (phase - 0.05)) * body.rest.leg
    middle = np.stack([0.018 * np.sin(2 * np.pi * (phase - 0.05)), way, body.tall + bob], axis=1)
    # As high as the leg that carries can reach.
    reach = (0.997 * body.rest.leg) ** 2
    for side, (ankle, _, _) in plans.items():
        carries = (phase + (side == "Right") / 2) % 1 < 0.6
        hip = middle + [dict(_SIDES)[side] * body.half / 0.55 / 2, 0, 0]
        flat = np.square(hip[:, :2] - ankle[:, :2]).sum(axis=1)
        highest = ankle[:, 2] + np.sqrt(np.maximum(reach - flat, 0))
        middle[:, 2] -= max(0.0, float((middle[:, 2] - highest)[carries].max()))
    around = _wave(phase, 5, 0.25)
    body.trunk(
        middle,
        _turned(np.radians(3), around, _wave(phase, 2.5, 0.05)),
        _turned(np.radians(5) + _wave(phase, 1, 0.1, 2), -around, _wave(phase, -1)),
        _turned(np.radians(3), -0.2 * around),
    )
    swing = {"Left": np.radians(2) - _wave(phase, 21, 0.23), "Right": np.radians(2) + _wave(phase, 21, 0.23)}
    chest = body.rotations[:, BONES.index("Spine2")]
    for side, sign in _SIDES:
        upper = chest @ about_axis(1, -sign * np.full(body.count, np.radians(8))) @ about_axis(0, -swing[side])
        body.arm(side, upper, np.radians(20) + 0.45 * (swing[side] + np.radians(20)))
        ankle, pitch, toes = plans[side]
        body.leg(side, ankle, np.full(body.count, sign * np.radians(5)), pitch, toes)


def _step(
    standing: np.ndarray, soles: np.ndarray, joints: np.ndarray, phase: np.ndarray, stride: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ankle (F, 3) of a step that begins as the heel meets the floor at y = 0, and pitch of foot and toes (F,).

    ``soles`` (3, 3): heel, ball and tip, ``joints`` (2, 3): ankle and toe base in the rest pose.
    """
    times = np.array([0, 0.07, 0.12, 0.33, 0.45, 0.6, 0.7, 0.84, 0.95, 1])
    angles = np.radians([-18, -6, 0, 0, 13, 48, 42, 4, -17, -18])
    pitch = _through(phase, times, angles)
    joint, heel, ball, tip = (np.stack([joints[1], *soles]) - joints[0]) * [0, 1, 1]  # from the ankle
    lifts = 0.6

    def rolled(angle: np.ndarray, late: np.ndarray) -> np.ndarray:
        """The ankle of a foot that rolls over its heel, or over its ball."""
        turn = about_axis(0, angle)
        return standing + np.where(late[:, None], ball - turn @ ball, heel - turn @ heel)

    on_floor = rolled(pitch, pitch > 0)
    start = rolled(_through(np.array([lifts]), times, angles), np.array([True]))[0]
    end = rolled(angles[:1], np.array([False]))[0] - [0, stride, 0]
    share = np.clip((phase - lifts) / (1 - lifts), 0, 1)
    eased = share * share * (3 - 2 * share)
    swung = start + (end - start) * np.stack([eased, eased, share], axis=1)
    swung[:, 2] += 0.04 * np.sin(np.pi * share) ** 2
    ankle = np.where((phase < lifts)[:, None], on_floor, swung)
    # Toes stay on the floor while the foot rolls over the ball, and follow once it has left.
    follow = np.clip((phase - lifts) / 0.2, 0, 1)
    toes = np.where(pitch > 0, pitch * follow, pitch)
    foot = about_axis(0, pitch)
    lowest = np.stack(
        [(foot @ heel)[:, 2], (foot @ ball)[:, 2], (foot @ joint + about_axis(0, toes) @ (tip - joint))[:, 2]]
    )
    ankle[:, 2] += np.maximum(0, 0.03 * np.sqrt(share * (1 - share)) - ankle[:, 2] - lowest.min(axis=0))
    return ankle, pitch, toes


def _through(phase: np.ndarray, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A smooth curve through values, without overshoot (Fritsch and Carlson 1980)."""
    steps = np.diff(values) / np.diff(times)
    slopes = np.zeros(len(values))
    same = steps[:-1] * steps[1:] > 0
    slopes[1:-1][same] = 2 / (1 / steps[:-1][same] + 1 / steps[1:][same])
    at = np.clip(np.searchsorted(times, phase, side="right") - 1, 0, len(times) - 2)
    width = times[at + 1] - times[at]
    t = (phase - times[at]) / width
    low, high = values[at], values[at + 1]
    return (
        (1 + 2 * t) * (1 - t) ** 2 * low
        + t * (1 - t) ** 2 * width * slopes[at]
        + t * t * (3 - 2 * t) * high
        + t * t * (t - 1) * width * slopes[at + 1]
    )


def _turn(body: _Body, phase: np.ndarray) -> None:
    """Once around to the left in six steps of each foot."""
    still, full, steps = np.zeros(body.count), 2 * np.pi, 6
    around = full * phase
    weight = np.cos(2 * np.pi * (steps * phase - 0.25))
    lean = np.stack([-0.02 * weight, still, still], axis=1)
    turn = about_axis(2, around)
    middle = np.einsum("fij,fj->fi", turn, lean) + [0, 0, body.tall - 0.012]
    body.trunk(
        middle,
        _turned(still, around),
        _turned(np.radians(2), around + np.radians(4)),
        _turned(still, around + np.radians(10)),
    )
    ahead = {side: still + np.radians(5) for side, _ in _SIDES}
    body.swung_arms(still + np.radians(11), ahead, still + np.radians(18))
    for side, sign in _SIDES:
        # Half of the time a foot is in the air, the left one first.
        own = steps * phase - (0.5 if side == "Right" else 0.0)
        done, share = np.floor(own), np.clip((own - np.floor(own)) * 2, 0, 1)
        eased = share * share * (3 - 2 * share)
        heading = full / steps * (done + eased) + (np.pi / steps / 2 if side == "Right" else -np.pi / steps / 2)
        ankle = np.einsum("fij,j->fi", about_axis(2, heading), body.standing(side))
        ankle[:, 2] += 0.05 * np.sin(np.pi * share) ** 2
        body.leg(side, ankle, heading + sign * np.radians(6), still, still)


CLIPS: dict[str, tuple[float, Callable[[_Body, np.ndarray], None]]] = {
    "idle": (5.0, _idle),
    "walk": (1.1, _walk),
    "arms_up": (3.6, _arms_up),
    "squat": (3.4, _squat),
    "turn": (4.6, _turn),
}
"""Name to seconds and the function that poses a body over the phase of one round."""
