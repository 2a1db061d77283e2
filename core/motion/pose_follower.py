"""Tracked joints become poses frame by frame, as a sensor or a stream sends them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..avatar.pose import Pose
from ..avatar.skeleton import BONES, PARENTS, Skeleton
from ..errors import MirrorScanError
from ..numeric.rotations import about_axis, cross, frames, from_vectors, shortest_turn, twist_angles, unit
from .foot_lock import Soles, estimated_soles
from .joint_names import match_joints
from .rest_frames import FRONT, HINGES, UP, rest_frames


def _both(part: str) -> list[int]:
    return [BONES.index(f"Left{part}"), BONES.index(f"Right{part}")]


_UPPER, _LOWER, _END = (np.array([BONES.index(hinge[k]) for hinge in HINGES]) for k in range(3))
_ABOVE, _BELOW = np.concatenate([_UPPER, _LOWER]), np.concatenate([_LOWER, _END])  # of the upper bones, then the lower
_ARMS = np.array([hinge[0].endswith("Arm") for hinge in HINGES])
_HANGS_ON = np.where(_ARMS, 0, 1)  # chest or hips
_KNEES = np.flatnonzero(~_ARMS)
_HANDS, _FEET, _TOES, _SHINS = _both("Hand"), _both("Foot"), _both("ToeBase"), _both("Leg")
_FEET_AND_TOES = np.array([_FEET, _TOES]).T
_THIGHS, _UPPER_ARMS, _COLLARS = _both("UpLeg"), _both("Arm"), _both("Shoulder")
_LEG_STARTS, _LEG_ENDS = np.array(_THIGHS + _SHINS), np.array(_SHINS + _FEET)
_SPINE1, _CHEST, _NECK, _HEAD = (BONES.index(name) for name in ("Spine1", "Spine2", "Neck", "Head"))
_SWUNG, _SWUNG_TO = [_NECK, *_COLLARS], [_HEAD, *_UPPER_ARMS]  # bones that hang on the chest, and where they end
# Joints and those that cannot lie in the same place: the ends of bones, and left and right.
_JOINTS = np.concatenate([_LOWER, _END, _TOES, [_HEAD], _THIGHS, _UPPER_ARMS])
_OTHERS = np.concatenate([_UPPER, _LOWER, _FEET, [_NECK], _THIGHS[::-1], _UPPER_ARMS[::-1]])
_SHORTEST = 1e-300  # a length that counts as 0
_SAME_PLACE = 1e-12  # square of a length, in any unit
_SPINE_SHARES = np.array([1 / 3, 2 / 3])[:, None, None]
_STRAIGHT, _BENT = np.sin(np.radians([10, 30]))  # below, a limb's bend says nothing of its axis; above, all
_RELAX = 0.05  # a frame: how fast a straight limb turns to where its bend usually faces
_TOES_BEND = np.radians(45)
_SETTLED = 30  # frames after which the person's size is known


class PoseFollower:
    """Follows a person: ``follow(joints)`` a frame gives the pose of the skeleton.

    What is not seen (NaN) stays as it was to its parent. Where a limb is straight, its axis is carried on from when it
    was bent: no flips. The person's size is taken from the legs of the first frames.

    Parameters
    ----------
    skeleton : Skeleton
        In the avatar frame.
    names : sequence of str, optional
        Of the joints that will come, in their order: any set :mod:`.joint_names` knows, such as those of
        ``JOINT_SETS``. Default: our own 22, in the avatar frame.
    up : np.ndarray [shape=(3,), dtype=float64], optional
        The direction away from the floor in the tracker's axes. Default: Z for our own joints; for others seen from the
        first person.
    palms : np.ndarray [shape=(2, 3), dtype=float64], optional
        As of :func:`.rest_frames.palm_directions`; otherwise thumbs point ahead in the rest pose.
    soles : Soles, optional
        As of :func:`.foot_lock.sole_points`; otherwise estimated of the skeleton.
    floor : bool, default=True
        Lift the avatar so that no foot is in the floor.

    Attributes
    ----------
    pose : Pose
        The last one; the rest pose at first.
    world : np.ndarray [shape=(3, 3), dtype=float64] or None
        From the tracker's axes to the avatar frame, the person facing −Y at first; None until somebody was seen.

    Raises
    ------
    MirrorScanError
        The names are not recognised.
    """

    def __init__(
        self,
        skeleton: Skeleton,
        names: Sequence[str] | None = None,
        up: np.ndarray | None = None,
        palms: np.ndarray | None = None,
        soles: Soles | None = None,
        floor: bool = True,
    ) -> None:
        self.skeleton = skeleton
        self._own = names is None
        self._names = tuple(BONES if names is None else names)
        self._up = up
        self._floor = floor
        self._places, self._fingers = _places(self._names)
        self._rest = rest_frames(skeleton, palms)
        self._along = self._rest.frames[:, :, 0]
        self._rest_feet = self._rest.frames[_FEET]
        self._unturned = np.swapaxes(self._rest.frames, -1, -2).copy()
        joints = skeleton.joints
        self._swung = unit(joints[_SWUNG_TO] - joints[_SWUNG])
        knees = self._rest.frames[_UPPER[_KNEES], :, 1]
        self._feet_unturned = np.swapaxes(frames(joints[_TOES] - joints[_FEET], knees), -1, -2).copy()
        # Down both legs at once: the bones that carry the next joint, and the way to it.
        chain = [[0, 0], _THIGHS, _SHINS, _FEET, _TOES]
        self._down = [(high, joints[low] - joints[high]) for high, low in zip(chain, chain[1:], strict=False)]
        firm = (estimated_soles(skeleton) if soles is None else soles).rigid()
        ends = np.stack([joints[_FEET], joints[_TOES]], axis=1)
        self._sole_offsets = firm.points[:, :, None] - ends[:, None]
        self._sole_weights = np.stack([firm.weights[[0, 1], :, bones] for bones in (_FEET, _TOES)], axis=-1)
        self.restart()

    def restart(self) -> None:
        """Forget the person: the next frame is a first one."""
        self.pose = Pose.rest()
        self.world: np.ndarray | None = np.eye(3) if self._own and self._up is None else None
        self._origin = np.zeros(3) if self._own and self._up is None else None
        self._legs: list[float] = []
        self._axes = self._rest.frames[_UPPER, :, 1]  # of elbows and knees, as carried on

    def follow(self, values: np.ndarray, hips: np.ndarray | None = None) -> Pose:
        """The pose of a frame.

        Parameters
        ----------
        values : np.ndarray [shape=(J, 3) or (22, 3, 3), dtype=float64]
            Joints in the tracker's unit and axes, in the order of ``names``; or world rotations of our 22 bones from
            the skeleton's rest pose, avatar frame. NaN: not seen.
        hips : np.ndarray [shape=(3,), dtype=float64], optional
            With rotations: where the joint Hips is [m].
        """
        values = np.asarray(values, dtype=np.float64)
        if values.shape == (len(BONES), 3, 3):
            self.pose = self._turned(values, hips)
        elif values.shape == (len(self._names), 3):
            self.pose = self._placed(values)
        else:
            raise MirrorScanError(
                "joints must come as {count} times 3 numbers, or as 22 rotations; got {shape}",
                count=len(self._names),
                shape=values.shape,
                code="motion",
            )
        return self.pose

    def _turned(self, rotations: np.ndarray, hips: np.ndarray | None) -> Pose:
        """The pose of rotations that came."""
        seen = np.isfinite(rotations).all(axis=(1, 2))
        u, _, vt = np.linalg.svd(np.where(seen[:, None, None], rotations, np.eye(3)))
        u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
        out, last = u @ vt, self.pose.rotations
        for bone in np.flatnonzero(~seen):
            parent = PARENTS[bone]
            out[bone] = last[bone] if parent < 0 else out[parent] @ last[parent].T @ last[bone]
        translation = self.pose.translation
        if hips is not None and np.isfinite(hips).all():
            translation = np.asarray(hips, dtype=np.float64) - self.skeleton.joints[0]
        return Pose(out, translation)

    def _placed(self, joints: np.ndarray) -> Pose:
        """The pose of joints that came."""
        if self.world is None:
            self.world = self._find_world(joints)
            if self.world is None:
                return self.pose
        joints = joints @ self.world.T
        seen = self._seen(joints)
        out = np.empty((len(BONES), 3, 3))
        self._trunk(seen, out)
        self._limbs(seen, out)
        self._hands(joints, seen, out)
        self._soles(seen, out)
        return Pose(out, self._translation(seen, out))

    def _seen(self, joints: np.ndarray) -> np.ndarray:
        """Our 22 joints (22, 3) of what came, NaN for those not seen: many trackers send one place for all of those."""
        seen = np.where(self._places[:, None] >= 0, joints[self._places], np.nan)
        ways = seen[_JOINTS] - seen[_OTHERS]
        seen[_JOINTS[np.einsum("ki,ki->k", ways, ways) < _SAME_PLACE]] = np.nan
        return seen

    def _find_world(self, joints: np.ndarray) -> np.ndarray | None:
        """From the tracker's axes to the avatar frame (3, 3), the person facing −Y; None until they are seen."""
        seen = self._seen(joints)
        hips, arms = seen[_THIGHS], seen[_UPPER_ARMS]
        if not (np.isfinite(hips).all() and np.isfinite(arms).all()):
            return None
        tall = arms.mean(axis=0) - hips.mean(axis=0)
        if self._up is None:
            up = np.zeros(3)
            axis = int(np.argmax(np.abs(tall)))
            up[axis] = np.sign(tall[axis])
        else:
            up = unit(np.asarray(self._up, dtype=np.float64))
        lifted = shortest_turn(up, UP)
        left = lifted @ (unit(hips[0] - hips[1]) + unit(arms[0] - arms[1])) * [1, 1, 0]
        ahead, toes = cross(left, UP), lifted @ (seen[_TOES] - seen[_FEET]).sum(axis=0)
        if toes @ ahead < -0.5 * np.linalg.norm(toes[:2]) * np.linalg.norm(ahead):
            # Toes that point backwards: the tracker's axes are left-handed (Unity), left and right stand exchanged.
            left = unit(left)
            lifted, ahead = lifted - 2 * np.outer(left, left @ lifted), -ahead
        return about_axis(2, -np.pi / 2 - np.arctan2(ahead[1], ahead[0])) @ lifted

    def _trunk(self, seen: np.ndarray, out: np.ndarray) -> None:
        """Hips, spine, neck, head and collar bones, by the same landmarks in the rest pose and now."""
        last = self.pose.rotations
        points = np.array([self.skeleton.joints, seen])
        hips, arms = points[:, _THIGHS], points[:, _UPPER_ARMS]
        low, high = (hips[:, 0] + hips[:, 1]) / 2, (arms[:, 0] + arms[:, 1]) / 2
        middle = points[:, _SPINE1] if np.isfinite(seen[_SPINE1]).all() else (low + high) / 2
        across = np.array([hips[:, 0] - hips[:, 1], arms[:, 0] - arms[:, 1]])
        lower, upper = frames(np.array([middle - low, high - middle]), across)
        for bone, stands in ((0, lower), (_CHEST, upper)):
            turn = stands[1] @ stands[0].T
            if np.isfinite(turn).all():
                out[bone] = turn
            else:
                out[bone] = last[0] if bone == 0 else out[0] @ last[0].T @ last[_CHEST]
        # From hips to chest turns are small: shares of their axes, made square, are near enough.
        blend = out[0] + _SPINE_SHARES * (out[_CHEST] - out[0])
        out[1:_CHEST] = frames(blend[:, :, 0], blend[:, :, 1])
        ways, held = seen[_SWUNG_TO] - seen[_SWUNG], self._swung @ out[_CHEST].T
        known = np.isfinite(ways).all(axis=1)
        known[1:] &= self._own  # others' collar bones begin elsewhere
        whole = known.all()
        out[_SWUNG] = shortest_turn(held, ways if whole else np.where(known[:, None], ways, held)) @ out[_CHEST]
        if not whole:
            stay = np.array(_SWUNG)[~known]
            out[stay] = out[_CHEST] @ last[_CHEST].T @ last[stay]
        out[_HEAD] = out[_NECK]

    def _limbs(self, seen: np.ndarray, out: np.ndarray) -> None:
        """Arms and legs: along what is seen, about the axis they bend about or last bent about."""
        ways = unit(seen[_BELOW] - seen[_ABOVE])
        upper, lower = ways[:4], ways[4:]
        last, parents = self.pose.rotations, np.where(_ARMS, _CHEST, 0)
        before = np.einsum("kij,kj->ki", last[_UPPER], self._along[_UPPER])
        known = np.isfinite(upper).all(axis=1)
        if not known.all():  # with the trunk, since the last frame
            moved = out[parents] @ np.swapaxes(last[parents], -1, -2)
            upper = np.where(known[:, None], upper, np.einsum("kij,kj->ki", moved, before))
        below = np.isfinite(lower).all(axis=1)[:, None]
        if not below.all():
            lower = np.where(below, lower, upper)
        carried = np.einsum("kij,kj->ki", shortest_turn(before, upper), self._axes)
        ahead = np.array([out[_CHEST], -out[0]]) @ FRONT
        crossed = cross(np.array([upper, upper]), np.array([ahead[_HANGS_ON], lower]))  # with what is ahead; bent
        lengths = np.sqrt(np.einsum("ski,ski->sk", crossed, crossed))[..., None]
        usual, bent = crossed / np.maximum(lengths, _SHORTEST)
        share = np.minimum(np.maximum((lengths[1] - _STRAIGHT) / (_BENT - _STRAIGHT), 0.0), 1.0)
        relax = _RELAX * known[:, None]
        axes = share * bent + (1 - share) * ((1 - relax) * carried + relax * usual)
        turned = frames(np.concatenate([upper, lower]), np.concatenate([axes, axes]))
        self._axes = turned[:4, :, 1]
        out[_UPPER] = turned[:4] @ self._unturned[_UPPER]
        out[_LOWER] = turned[4:] @ self._unturned[_LOWER]
        if not below.all():
            held = out[_UPPER] @ np.swapaxes(last[_UPPER], -1, -2) @ last[_LOWER]
            out[_LOWER] = np.where(below[:, None], out[_LOWER], held)

    def _hands(self, joints: np.ndarray, seen: np.ndarray, out: np.ndarray) -> None:
        """Hands as far as fingers are seen; half of a hand's turn goes to the forearm."""
        last = self.pose.rotations
        for hand, fingers in zip(_HANDS, self._fingers, strict=True):
            fore = hand - 1
            out[hand] = out[fore]
            if "Tip" not in fingers:
                continue
            way, across = joints[fingers["Tip"]] - seen[hand], np.full(3, np.nan)
            if "Index" in fingers and "Pinky" in fingers:
                across = joints[fingers["Index"]] - joints[fingers["Pinky"]]
            elif "Thumb" in fingers:
                across = joints[fingers["Thumb"]] - seen[hand]
            if not way @ way > _SAME_PLACE:  # true for NaN too
                out[hand] = out[fore] @ last[fore].T @ last[hand]
            elif np.isfinite(across).all():
                out[hand] = frames(way, cross(way, across)) @ self._unturned[hand]
            else:
                out[hand] = shortest_turn(out[fore] @ self._along[hand], way) @ out[fore]
            twist = float(twist_angles(out[fore].T @ out[hand], self._along[fore]))
            out[fore] = out[fore] @ from_vectors(twist / 2 * self._along[fore])

    def _soles(self, seen: np.ndarray, out: np.ndarray) -> None:
        """Feet along what is seen, soles square to the axis of the knee."""
        last, ways = self.pose.rotations, seen[_TOES] - seen[_FEET]
        known = np.isfinite(ways).all(axis=1)
        if known.all():
            out[_FEET] = frames(ways, self._axes[_KNEES]) @ self._feet_unturned
        else:
            for side, (foot, shin) in enumerate(zip(_FEET, _SHINS, strict=True)):
                if known[side]:
                    out[foot] = frames(ways[side], self._axes[_KNEES[side]]) @ self._feet_unturned[side]
                else:
                    out[foot] = out[shin] @ last[shin].T @ last[foot]
        # Toes stay level while the foot tips over them.
        stands = out[_FEET] @ self._rest_feet
        tips = np.minimum(np.arcsin(np.minimum(np.maximum(-stands[:, 2, 0], 0.0), 1.0)), _TOES_BEND)
        out[_TOES] = stands @ about_axis(2, tips) @ np.swapaxes(self._rest_feet, -1, -2) if tips.any() else out[_FEET]

    def _translation(self, seen: np.ndarray, out: np.ndarray) -> np.ndarray:
        """Of the hips: the person's way, scaled by the legs."""
        bones = seen[_LEG_ENDS] - seen[_LEG_STARTS]
        lengths = np.sqrt(np.einsum("ki,ki->k", bones, bones))
        length = float(lengths.sum()) / 2
        if len(self._legs) < _SETTLED and np.isfinite(length):
            self._legs.append(length)
        middle = (seen[_THIGHS[0]] + seen[_THIGHS[1]]) / 2
        if not self._legs or not np.isfinite(middle).all():
            return self.pose.translation
        rest = self.skeleton.joints
        scale = self._rest.leg * len(self._legs) / sum(self._legs)
        place = middle * scale - out[0] @ ((rest[_THIGHS[0]] + rest[_THIGHS[1]]) / 2 - rest[0]) - rest[0]
        if self._origin is None:  # the person begins where the skeleton stands, on the floor
            self._origin = np.array([place[0], place[1], self._lowest_sole(out, place)])
        place = place - self._origin
        if self._floor:
            place[2] += max(0.0, -self._lowest_sole(out, place))
        return place

    def _lowest_sole(self, turns: np.ndarray, place: np.ndarray) -> float:
        """Height of the lowest point of both soles, the hips moved by ``place`` from where they rest [m]."""
        height = place[2] + self.skeleton.joints[0, 2]
        heights = [height := height + np.einsum("ki,ki->k", turns[high, 2], way) for high, way in self._down]
        rows = turns[_FEET_AND_TOES, 2]
        points = np.einsum("skbi,sbi->skb", self._sole_offsets, rows) + np.array(heights[2:]).T[:, None]
        return float((self._sole_weights * points).sum(axis=-1).min())


def _places(names: Sequence[str]) -> tuple[np.ndarray, list[dict[str, int]]]:
    """Place of each of our bones in the tracker's joints (22,), -1 without one; and fingers of left and right hand."""
    found = match_joints("tracker", names, np.full(len(names), -1))
    places = np.array([found.joints.get(bone, -1) for bone in BONES])
    if found.trunk:
        places[_SPINE1] = found.trunk[(len(found.trunk) - 1) // 2]
    fingers = []
    for side in ("Left", "Right"):
        own = {name.removeprefix(side): place for name, place in found.fingers.items() if name.startswith(side)}
        tip = own.get("Middle", own.get("Tip", own.get("Index")))
        fingers.append(({"Tip": tip} if tip is not None else {}) | {k: v for k, v in own.items() if k != "Tip"})
    return places, fingers
