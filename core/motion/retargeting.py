"""A motion of any skeleton becomes a clip of ours, by the directions of its bones.

Trunk, neck, head and collar bones turn as the source's do from its neutral stance; limbs point where the source's
point, turned about themselves so that elbows and knees bend about the same axes and palms and soles face the same way.
Lengths play no part but one: the way of the hips is scaled by the legs. The neutral stance is the source's rest pose if
a person could stand so, whatever its arms do; otherwise (all bones along X) it is put together from bones and frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..avatar.clip import Clip
from ..avatar.skeleton import BONES, Skeleton
from ..errors import MirrorScanError
from ..numeric.rotations import (
    about_axis,
    between,
    frames,
    from_vectors,
    mean_rotation,
    shortest_turn,
    twist_angles,
    unit,
)
from .foot_lock import Soles, stand_on_floor
from .foot_lock import lock_feet as locked
from .joint_names import JointMap, match_joints
from .motion import Motion
from .pose_follower import PoseFollower
from .rest_frames import FRONT, HINGES, LEFT, UP, RestFrames, level_frame, rest_frames

_SIDES = ("Left", "Right")
_SAME_REST = 0.003  # of the skeleton's height: rest poses whose joints lie as near are the same
_USUAL_SLOPE = np.radians(20)  # of the way from ankle to toes, on a level sole
_SLOPE_TRUSTED = np.radians(12)
_STANDS, _STANDS_LONG = 1.0, 0.3  # lengths of the foot a second: slower it stands; s: so long it must
_SLOPE_LEFT, _SLOPE_GIVEN = np.radians(2), np.radians(8)


def retarget(
    motion: Motion,
    skeleton: Skeleton,
    in_place: bool = False,
    lock_feet: bool = True,
    loop: bool = False,
    palms: np.ndarray | None = None,
    soles: Soles | None = None,
) -> Clip:
    """The motion as a clip of the skeleton; it starts where the skeleton stands, facing −Y.

    Parameters
    ----------
    motion : Motion
        Of any skeleton :mod:`.joint_names` knows, in any unit and with any axis up.
    skeleton : Skeleton
        In the avatar frame: Z up, facing −Y, soles on z = 0.
    in_place : bool, default=False
        Leave out the way over the floor.
    lock_feet : bool, default=True
        Feet that stand do not slide and are not in the floor. Otherwise the clip is only put on the floor as a whole.
    loop : bool, default=False
        Make it repeat without a jump.
    palms : np.ndarray [shape=(2, 3), dtype=float64], optional
        As of :func:`.rest_frames.palm_directions`; otherwise thumbs point ahead in the rest pose.
    soles : Soles, optional
        As of :func:`.foot_lock.sole_points`; otherwise estimated of the skeleton.

    Raises
    ------
    MirrorScanError
        The motion's joints are not recognised, or no frame can be used.
    """
    joints = match_joints(motion.name, motion.joints, motion.parents)
    rest = rest_frames(skeleton, palms)
    if motion.rotations is None:
        clip = _followed(motion, joints, skeleton, palms)
    elif (own := _as_it_is(motion, joints, skeleton)) is not None:
        clip = own
    else:
        clip = _turned(motion, joints, skeleton, rest)
    clip = locked(clip, skeleton, soles) if lock_feet else stand_on_floor(clip, skeleton, soles)
    if in_place:
        clip = clip.in_place()
    return clip.looped() if loop else clip


def _followed(motion: Motion, joints: JointMap, skeleton: Skeleton, palms: np.ndarray | None) -> Clip:
    """A clip of positions alone, frame by frame."""
    follower = PoseFollower(skeleton, motion.joints, _up_axis(motion, joints), palms, floor=False)
    poses = [follower.follow(frame) for frame in motion.positions]
    if follower.world is None:
        raise MirrorScanError("{name}: hips and shoulders are never seen together", name=motion.name, code="motion")
    rotations = np.array([pose.rotations for pose in poses])
    translations = np.array([pose.translation for pose in poses])
    return _facing_front(motion, rotations, translations, follower.world)


def _as_it_is(motion: Motion, joints: JointMap, skeleton: Skeleton) -> Clip | None:
    """The clip of a motion whose rest pose is the skeleton's own, whatever its size; None where it is another.

    What such a file does not say, where its palms and soles face, is then as the avatar has them: its own motion comes
    back as it went.
    """
    assert motion.rotations is not None and motion.rest is not None
    known = joints.joints | dict(zip(("Spine", "Spine1", "Spine2"), joints.trunk, strict=False))
    if len(joints.trunk) != 3 or not all(bone in known for bone in BONES):
        return None
    places = [known[bone] for bone in BONES]
    turn, scale, shift = _similarity(motion.rest[places], skeleton.joints)
    moved = scale * motion.rest[places] @ turn.T + shift
    if np.linalg.norm(moved - skeleton.joints, axis=1).max() > _SAME_REST * np.ptp(skeleton.joints[:, 2]):
        return None
    rotations = turn @ motion.rotations[:, places] @ turn.T
    translations = scale * motion.positions[:, places[0]] @ turn.T + shift - skeleton.joints[0]
    return _facing_front(motion, rotations, translations, turn)


def _similarity(points: np.ndarray, to: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Rotation (3, 3), scale and shift (3,) that bring points (N, 3) nearest to others, by least squares.

    Umeyama 1991.
    """
    middle, there = points.mean(axis=0), to.mean(axis=0)
    u, sizes, vt = np.linalg.svd((to - there).T @ (points - middle))
    sizes[2] *= (sign := np.sign(np.linalg.det(u @ vt)))
    u[:, 2] *= sign
    turn = u @ vt
    scale = float(sizes.sum() / max(np.sum((points - middle) ** 2), 1e-30))
    return turn, scale, there - scale * turn @ middle


@dataclass(frozen=True)
class _Source:
    """What is known of the source's joints: rotations, positions, and their neutral stance in their own axes."""

    motion: Motion
    map: JointMap
    neutral: np.ndarray | None  # (3, 3), rest axes to avatar axes, when the rest pose is a stance
    world: np.ndarray  # (3, 3), file's axes to upright ones

    def spin(self, joint: int) -> np.ndarray:
        """Rotations (F, 3, 3) of a joint."""
        assert self.motion.rotations is not None
        return self.motion.rotations[:, joint]

    def way(self, start: int, end: int) -> np.ndarray:
        """Directions (F, 3) from a joint to another, file's axes."""
        return unit(self.motion.positions[:, end] - self.motion.positions[:, start])

    def local(self, joint: int, vectors: np.ndarray) -> np.ndarray:
        """Vectors (F, 3) of the file's axes in the joint's own."""
        return np.einsum("fji,fj->fi", self.spin(joint), vectors)

    def steady(self, joint: int, start: int, end: int) -> np.ndarray:
        """The mean direction (3,) from ``start`` to ``end`` in the axes of ``joint``; exact where they move with it."""
        return unit(self.local(joint, self.way(start, end)).mean(axis=0))


def _turned(motion: Motion, joints: JointMap, skeleton: Skeleton, rest: RestFrames) -> Clip:
    """A clip of rotations."""
    leg = _leg_length(motion, joints)
    source = _Source(motion, joints, _rest_stance(motion, joints), shortest_turn(_up_axis(motion, joints), UP))
    out = np.empty((len(motion), len(BONES), 3, 3))
    _turn_trunk(source, out)
    for upper, lower, end, towards in HINGES:
        _turn_limb(source, rest, out, (upper, lower, end), towards)
    for side in _SIDES:
        _turn_hand(source, rest, out, side)
        _turn_foot(source, rest, out, side)
    out = source.world @ out
    thighs = [joints.joints["LeftUpLeg"], joints.joints["RightUpLeg"]]
    middle = motion.positions[:, thighs].mean(axis=1) @ source.world.T * (rest.leg / leg)
    # The middle between the thighs' joints travels; where Hips lies from it differs between skeletons.
    places = [BONES.index("LeftUpLeg"), BONES.index("RightUpLeg")]
    own = skeleton.joints[places].mean(axis=0) - skeleton.joints[0]
    translations = middle - np.einsum("fij,j->fi", out[:, 0], own) - skeleton.joints[0]
    return _facing_front(motion, out, translations, source.world)


def _leg_length(motion: Motion, joints: JointMap) -> float:
    """Length of thigh and shin, the mean of both legs, in the file's unit.

    Raises
    ------
    MirrorScanError
        A bone of a limb has no length, so that it points nowhere.
    """
    length = 0.0
    for upper, lower, end, _ in HINGES:
        places = [joints.joints[bone] for bone in (upper, lower, end)]
        lengths = np.linalg.norm(np.diff(motion.positions[:, places], axis=1), axis=2)
        for bone, own in zip((upper, lower), lengths.T, strict=True):
            if not own.min() > 0:
                raise MirrorScanError(
                    "{name}: {bone} has no length in frame {frame}; export it again with a whole skeleton",
                    name=motion.name, bone=bone, frame=int(np.argmin(own)) + 1, code="motion",
                )  # fmt: skip
        if upper.endswith("UpLeg"):
            length += float(np.median(lengths.sum(axis=1))) / 2
    return length


def _facing_front(motion: Motion, rotations: np.ndarray, translations: np.ndarray, world: np.ndarray) -> Clip:
    """Everything turned about Z and moved over the floor so that it starts where the skeleton stands, facing −Y."""
    ahead = (rotations[:, 0] + rotations[:, BONES.index("Spine2")]) @ FRONT / 2
    level = np.linalg.norm(ahead[:, :2], axis=1)
    first = ahead[int(np.argmax(level > 0.5))]
    turn = about_axis(2, -np.pi / 2 - np.arctan2(first[1], first[0]))
    translations = (translations - translations[0] * [1, 1, 0]) @ turn.T
    return Clip(motion.name, motion.rate, turn @ rotations, translations, turned=turn @ world)


def _up_axis(motion: Motion, joints: JointMap) -> np.ndarray:
    """The direction (3,) away from the floor in the file's axes."""
    up = motion.up
    if up is None:
        places = joints.joints
        feet = np.nanmean(motion.positions[:, [places["LeftFoot"], places["RightFoot"]]], axis=1)
        arms = np.nanmean(motion.positions[:, [places["LeftArm"], places["RightArm"]]], axis=1)
        hips = np.nanmean(motion.positions[:, [places["LeftUpLeg"], places["RightUpLeg"]]], axis=1)
        mean = np.nanmean(unit(hips - feet) + unit(arms - hips), axis=0)
        if not np.isfinite(mean).all():
            raise MirrorScanError(
                "{name}: hips, shoulders and feet are never seen together", name=motion.name, code="motion"
            )
        up = np.zeros(3)
        axis = int(np.argmax(np.abs(mean)))
        up[axis] = np.sign(mean[axis])
    return up


def _rest_stance(motion: Motion, joints: JointMap) -> np.ndarray | None:
    """Rest axes to avatar axes (3, 3), or None where nobody could stand as the rest pose does."""
    assert motion.rest is not None
    place = {bone: motion.rest[joint] for bone, joint in joints.joints.items()}
    feet, shoulders = ((place[f"Left{part}"] + place[f"Right{part}"]) / 2 for part in ("Foot", "Arm"))
    hips = (place["LeftUpLeg"] + place["RightUpLeg"]) / 2
    tall = shoulders - feet
    up = np.zeros(3)
    axis = int(np.argmax(np.abs(tall)))
    up[axis] = np.sign(tall[axis])
    left = place["LeftUpLeg"] - place["RightUpLeg"]
    if np.linalg.norm(np.cross(up, unit(left))) < 0.9 or unit(shoulders - hips) @ up < 0.85:
        return None
    for side in _SIDES:
        thigh, shin = place[f"{side}Leg"] - place[f"{side}UpLeg"], place[f"{side}Foot"] - place[f"{side}Leg"]
        if -unit(thigh) @ up < 0.75 or -unit(shin) @ up < 0.75:
            return None
        arms = place[f"{side}Arm"] - shoulders
        if unit(arms) @ unit(left) * (1 if side == "Left" else -1) < 0.7:
            return None
    ahead = np.cross(unit(left), up)
    snapped = np.zeros(3)
    axis = int(np.argmax(np.abs(ahead)))
    snapped[axis] = np.sign(ahead[axis])
    ahead = snapped if snapped @ unit(ahead) > 0.9 else unit(ahead)
    return frames(LEFT, UP) @ frames(np.cross(up, ahead), up).T


def _turn_trunk(source: _Source, out: np.ndarray) -> None:
    """Hips, spine, neck, head and collar bones: as the source's from its neutral stance (file's axes)."""
    joints, trunk = source.map.joints, source.map.trunk
    chain = [joints["Hips"], *trunk]
    stance = _trunk_stance(source, chain)
    spun = {joint: source.spin(joint) @ turn.T for joint, turn in stance.items()}
    chest = spun[chain[-1]]
    out[:, 0] = spun[chain[0]]
    # Spine, Spine1 and Spine2 stand for however many joints there are; the last of all carries the arms.
    places = (1, (len(chain)) / 2, len(chain) - 1) if len(chain) > 2 else np.array([1, 2, 3]) / 3 * (len(chain) - 1)
    for bone, place in zip(("Spine", "Spine1", "Spine2"), places, strict=True):
        low = int(min(np.floor(place), max(len(chain) - 2, 0)))
        high = min(low + 1, len(chain) - 1)
        out[:, BONES.index(bone)] = between(spun[chain[low]], spun[chain[high]], float(place - low))
    head = spun.get(joints.get("Head", -1), chest)
    neck = spun[joints["Neck"]] if "Neck" in joints else between(chest, head, 0.5)
    out[:, BONES.index("Neck")], out[:, BONES.index("Head")] = neck, head
    for side in _SIDES:
        out[:, BONES.index(f"{side}Shoulder")] = spun.get(joints.get(f"{side}Shoulder", -1), chest)


def _trunk_stance(source: _Source, chain: list[int]) -> dict[int, np.ndarray]:
    """Of each joint of the trunk, the rotation (3, 3) of its own axes in the neutral stance, in avatar axes."""
    joints, ends = source.map.joints, source.map.ends
    others = [joints[bone] for bone in ("Neck", "Head", "LeftShoulder", "RightShoulder") if bone in joints]
    if source.neutral is not None:
        return {joint: source.neutral for joint in (*chain, *others)}
    left = source.steady(chain[0], joints["RightUpLeg"], joints["LeftUpLeg"])
    above = joints["Neck"] if "Neck" in joints else chain[-1]
    up = source.steady(chain[0], chain[0], next((j for j in chain[1:] if _apart(source, chain[0], j)), above))
    stance = {chain[0]: frames(LEFT, UP) @ frames(left, up).T}

    def straightened(joint: int, parent: int, end: int | None, towards: np.ndarray) -> None:
        """As it stands to its parent on the average, and pointing ``towards``."""
        turn = mean_rotation(np.swapaxes(source.spin(parent), -1, -2) @ source.spin(joint))
        turn = stance[parent] @ turn
        if end is not None and _apart(source, joint, end):
            along = turn @ source.steady(joint, joint, end)
            if along @ towards > 0.7:  # some ends lie anywhere
                turn = shortest_turn(along, towards) @ turn
        stance[joint] = turn

    for parent, joint, end in zip(chain, chain[1:], [*chain[2:], joints.get("Neck", joints.get("Head"))], strict=False):
        straightened(joint, parent, end, UP)
    chest = chain[-1]
    if len(chain) > 1:  # the arms say which way the chest faces
        left = stance[chest] @ source.steady(chest, joints["RightArm"], joints["LeftArm"])
        stance[chest] = shortest_turn(left * [1, 1, 0], LEFT) @ stance[chest]
    if "Neck" in joints:
        straightened(joints["Neck"], chest, joints.get("Head"), UP)
    if "Head" in joints:
        straightened(joints["Head"], joints.get("Neck", chest), ends.get("Head"), UP)
    for side, towards in zip(_SIDES, (LEFT, -LEFT), strict=True):
        if f"{side}Shoulder" in joints:
            straightened(joints[f"{side}Shoulder"], chest, joints[f"{side}Arm"], towards)
    return stance


def _apart(source: _Source, first: int, second: int) -> bool:
    way = source.motion.positions[:, second] - source.motion.positions[:, first]
    return bool(np.median(np.linalg.norm(way, axis=1)) > 1e-6 * np.ptp(source.motion.positions[0]))


def _turn_limb(
    source: _Source, rest: RestFrames, out: np.ndarray, bones: tuple[str, str, str], towards: np.ndarray
) -> None:
    """Both bones of an arm or a leg: along the source's bones, bending about the axis the source bends about."""
    joints = source.map.joints
    upper, lower, end = (joints[bone] for bone in bones)
    first, second = BONES.index(bones[0]), BONES.index(bones[1])
    along, below = source.way(upper, lower), source.way(lower, end)
    local = source.steady(upper, upper, lower)
    # Where it is bent, the axis is seen; a mean in the bone's own axes holds it where the limb is straight.
    seen = np.cross(along, below)
    bend = np.linalg.norm(seen, axis=1)
    weight = np.clip((bend - 0.17) / 0.26, 0, 1)
    if weight.sum() > 2:
        axis = (source.local(upper, unit(seen)) * weight[:, None]).sum(axis=0)
    elif source.neutral is not None:
        axis = source.neutral.T @ np.cross(source.neutral @ local, towards)
    else:
        ahead = np.einsum("fij,j->fi", out[:, 0], towards)
        axis = source.local(upper, np.cross(along, ahead)).mean(axis=0)
    turns = source.spin(upper) @ frames(local, axis) @ rest.frames[first].T
    turns = shortest_turn(turns @ rest.frames[first][:, 0], along) @ turns
    out[:, first] = turns
    out[:, second] = frames(below, turns @ rest.frames[first][:, 1]) @ rest.frames[second].T


def _turn_hand(source: _Source, rest: RestFrames, out: np.ndarray, side: str) -> None:
    """The hand as the source's palm, and half of its turn about the forearm given to the forearm."""
    hand, fore = BONES.index(f"{side}Hand"), BONES.index(f"{side}ForeArm")
    joint = _palm_joint(source, side)
    local, axis = _palm(source, side, joint, out[:, fore] @ rest.frames[fore][:, 1])
    out[:, hand] = source.spin(joint) @ frames(local, axis) @ rest.frames[hand].T
    along = rest.frames[fore][:, 0]
    twist = np.unwrap(twist_angles(np.swapaxes(out[:, fore], -1, -2) @ out[:, hand], along))
    twist -= 2 * np.pi * np.round(np.median(twist) / (2 * np.pi))
    out[:, fore] = out[:, fore] @ from_vectors(twist[:, None] / 2 * along)


def _palm_joint(source: _Source, side: str) -> int:
    """The joint with which the palm turns: CMU's wrist only twists, a second joint in the same place does the rest."""
    joint = source.map.joints[f"{side}Hand"]
    fingers = [place for finger, place in source.map.fingers.items() if finger in (side + "Middle", side + "Tip")]
    if fingers:
        above, at = [], fingers[0]
        while at != joint:
            at = int(source.motion.parents[at])
            above.append(at)
        return next((other for other in above if not _apart(source, joint, other)), joint)
    return joint


def _palm(source: _Source, side: str, hand: int, hinge: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Direction of the hand and axis square to its palm (3,), in its own axes; ``hinge`` (F, 3): the elbow's axis."""
    fingers = source.map.fingers
    tips = [fingers[side + name] for name in ("Middle", "Tip", "Index") if side + name in fingers]
    tips = [tip for tip in tips if _apart(source, hand, tip)]
    if tips:
        local = source.steady(hand, hand, tips[0])
    else:  # a hand without an end goes on as the forearm does
        local = source.steady(hand, source.map.joints[f"{side}ForeArm"], hand)
    if side + "Index" in fingers and side + "Pinky" in fingers:
        return local, np.cross(local, source.steady(hand, fingers[side + "Pinky"], fingers[side + "Index"]))
    if source.neutral is None:
        return local, source.local(hand, hinge).mean(axis=0)
    usual = source.neutral.T @ np.cross(source.neutral @ local, FRONT)
    if side + "Thumb" in fingers:
        # A thumb lies before the palm, up to 45° out of its plane, and moves: at rest it says whether usual is wrong.
        rest, thumb = source.motion.rest, fingers[side + "Thumb"]
        assert rest is not None
        ends = [thumb, *np.flatnonzero(source.motion.parents == thumb)]
        ways = [rest[end] - rest[hand] for end in ends if np.linalg.norm(rest[end] - rest[hand]) > 1e-6 * np.ptp(rest)]
        seen = np.cross(local, ways[0]) if ways else usual
        if unit(seen) @ unit(usual) < 0.7:
            return local, seen
    return local, usual


def _turn_foot(source: _Source, rest: RestFrames, out: np.ndarray, side: str) -> None:
    """Foot and toes: level where the source's sole is level, pointing where it points."""
    joints = source.map.joints
    foot, toe = BONES.index(f"{side}Foot"), BONES.index(f"{side}ToeBase")
    joint, end = joints[f"{side}Foot"], joints.get(f"{side}ToeBase")
    if end is None or not _apart(source, joint, end):  # no toes: as the foot turns from its stance
        shin = out[:, BONES.index(f"{side}Leg")]
        usual = mean_rotation(np.swapaxes(shin, -1, -2) @ source.spin(joint))
        out[:, foot] = source.spin(joint) @ (usual if source.neutral is None else source.neutral).T
        out[:, toe] = out[:, foot]
        return
    local = source.steady(joint, joint, end)
    up = _sole_normal(source, side, local) if source.neutral is None else source.neutral.T @ UP
    level = level_frame(local, up)
    bend = np.swapaxes(source.spin(joint), -1, -2) @ source.spin(end)
    if source.neutral is None:
        bend = bend @ mean_rotation(bend).T
    # Ankles lie higher over the toes in one skeleton than in another. Level soles are right on the floor, the same
    # direction in the air: the direction is kept to 2°.
    slope = np.arcsin(-unit(local) @ level[:, 1])
    standing = _standing_slope(source, joint, end)
    if abs(standing - slope) < _SLOPE_TRUSTED:  # feet are level where they stand rather than in the rest pose
        level = level @ about_axis(2, standing - slope)
        slope = standing
    slope -= rest.slopes[0 if side == "Left" else 1]
    pitch = np.sign(slope) * np.clip(abs(slope) - _SLOPE_LEFT, 0, _SLOPE_GIVEN)
    out[:, foot] = source.spin(joint) @ level @ about_axis(2, -pitch) @ rest.frames[foot].T
    out[:, toe] = source.spin(joint) @ bend @ level @ rest.frames[toe].T


def _standing_slope(source: _Source, ankle: int, toe: int) -> float:
    """How far the way from ankle to toes slopes down where the foot stands [rad]; NaN where it never does."""
    way = (source.motion.positions[:, toe] - source.motion.positions[:, ankle]) @ source.world.T
    places = source.motion.positions[:, [ankle, toe]] @ source.world.T / np.median(np.linalg.norm(way, axis=1))
    if len(places) < 2:
        return np.nan
    speeds = np.linalg.norm(np.gradient(places, axis=0), axis=-1).max(axis=1) * source.motion.rate
    height = places[:, 1, 2]
    stands = (speeds < _STANDS) & (height < np.quantile(height, 0.05) + 0.3)
    slopes = np.arctan2(-way[:, 2], np.linalg.norm(way[:, :2], axis=1))
    return float(np.median(slopes[stands])) if stands.sum() >= _STANDS_LONG * source.motion.rate else np.nan


def _sole_normal(source: _Source, side: str, foot: np.ndarray) -> np.ndarray:
    """Up (3,) from a level sole, in the foot's own axes, of a source without a stance; ``foot`` (3,): towards the toes.

    Toes are level when the sole is; where they say nothing, the foot slopes as feet do.
    """
    joints = source.map.joints
    ankle, toe, end = joints[f"{side}Foot"], joints[f"{side}ToeBase"], source.map.ends.get(f"{side}ToeBase")
    shin = source.steady(ankle, ankle, joints[f"{side}Leg"])
    raised = unit(shin - (shin @ foot) * foot)
    slope = _USUAL_SLOPE
    if end is not None and _apart(source, toe, end):
        toes = source.steady(ankle, toe, end)
        seen = np.arctan2(toes @ raised, toes @ foot)
        slope = seen if np.radians(8) < seen < np.radians(45) else slope
    return np.cos(slope) * raised - np.sin(slope) * foot
