"""Tracked joints become poses frame by frame, as a sensor or a stream sends them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..avatar.pose import Pose, posed_joints
from ..avatar.skeleton import BONES, PARENTS, Skeleton
from ..errors import MirrorScanError
from ..numeric.rotations import about_axis, between, frames, from_vectors, shortest_turn, twist_angles, unit
from .foot_lock import estimated_soles
from .joint_names import match_joints
from .rest_frames import FRONT, HINGES, UP, rest_frames

_UPPER, _LOWER, _END = (np.array([BONES.index(hinge[k]) for hinge in HINGES]) for k in range(3))
_ARMS = np.array([hinge[0].endswith("Arm") for hinge in HINGES])


def _both(part: str) -> list[int]:
    return [BONES.index(f"Left{part}"), BONES.index(f"Right{part}")]


_HANDS, _FEET, _TOES = _both("Hand"), _both("Foot"), _both("ToeBase")
_THIGHS, _UPPER_ARMS, _COLLARS = _both("UpLeg"), _both("Arm"), _both("Shoulder")
_SPINE1, _CHEST, _NECK, _HEAD = (BONES.index(name) for name in ("Spine1", "Spine2", "Neck", "Head"))
_STRAIGHT, _BENT = np.sin(np.radians([10, 30]))  # below, a limb's bend says nothing of its axis; above, all
_RELAX = 0.05  # a frame: how fast a straight limb turns to where its bend usually faces
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
        As of :func:`.rest_frames.rest_frames`.
    floor : bool, default=True
        Lift the avatar so that no foot is in the floor.

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
        floor: bool = True,
    ) -> None:
        self.skeleton = skeleton
        self._own = names is None
        self._names = tuple(BONES if names is None else names)
        self._up = UP if names is None and up is None else up
        self._floor = floor
        self._rest = rest_frames(skeleton, palms)
        self._soles = estimated_soles(skeleton)
        self._places, self._fingers = _places(self._names)
        self._along = self._rest.frames[:, :, 0]
        self.pose = Pose.rest()
        self.restart()

    def restart(self) -> None:
        """Forget the person: the next frame is a first one."""
        self._world: np.ndarray | None = None
        self._origin: np.ndarray | None = None
        self._legs: list[float] = []
        self._lowest = np.inf
        self.pose = Pose.rest()
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
            )
        return self.pose

    def _turned(self, rotations: np.ndarray, hips: np.ndarray | None) -> Pose:
        seen = np.isfinite(rotations).all(axis=(1, 2))
        u, _, vt = np.linalg.svd(np.where(seen[:, None, None], rotations, np.eye(3)))
        u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
        out = self._held(u @ vt, seen)
        translation = self.pose.translation
        if hips is not None and np.isfinite(hips).all():
            translation = np.asarray(hips, dtype=np.float64) - self.skeleton.joints[0]
        return Pose(out, translation)

    def _held(self, rotations: np.ndarray, seen: np.ndarray) -> np.ndarray:
        """Rotations with what was not seen as it was to its parent."""
        if not seen.all():
            last = self.pose.rotations
            for bone in np.flatnonzero(~seen):
                parent = PARENTS[bone]
                rotations[bone] = last[bone] if parent < 0 else rotations[parent] @ last[parent].T @ last[bone]
        return rotations

    def _placed(self, joints: np.ndarray) -> Pose:
        if self._world is None:
            self._world = self._find_world(joints)
            if self._world is None:
                return self.pose
        joints = joints @ self._world.T
        seen = np.where(self._places[:, None] >= 0, joints[self._places], np.nan)
        out = np.empty((len(BONES), 3, 3))
        self._trunk(seen, out)
        self._limbs(seen, out)
        self._hands(joints, seen, out)
        self._feet(seen, out)
        return Pose(out, self._translation(seen, out))

    def _find_world(self, joints: np.ndarray) -> np.ndarray | None:
        """From the tracker's axes to the avatar frame (3, 3), the person facing −Y; None until they are seen."""
        if self._own and self._up is UP:
            return np.eye(3)
        seen = joints[self._places]
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
        left = lifted @ (hips[0] - hips[1])
        ahead = np.cross(left, UP)
        return about_axis(2, -np.pi / 2 - np.arctan2(ahead[1], ahead[0])) @ lifted

    def _trunk(self, seen: np.ndarray, out: np.ndarray) -> None:
        """Hips, spine, neck, head and collar bones, by the same landmarks in the rest pose and now."""
        rest, last = self.skeleton.joints, self.pose.rotations
        stands = []
        for points in (rest, seen):
            hips, arms = points[_THIGHS], points[_UPPER_ARMS]
            low, high = hips.mean(axis=0), arms.mean(axis=0)
            middle = points[_SPINE1] if np.isfinite(seen[_SPINE1]).all() else (low + high) / 2
            across = np.array([hips[0] - hips[1], arms[0] - arms[1]])
            stands.append(frames(np.array([middle - low, high - middle]), across))
        turns = stands[1] @ np.swapaxes(stands[0], -1, -2)
        known = np.isfinite(turns).all(axis=(1, 2))
        out[0] = turns[0] if known[0] else last[0]
        out[_CHEST] = turns[1] if known[1] else out[0] @ last[0].T @ last[_CHEST]
        out[1:_CHEST] = between(np.tile(out[0], (2, 1, 1)), out[_CHEST], np.array([1 / 3, 2 / 3]))
        neck = seen[_HEAD] - seen[_NECK]
        if np.isfinite(neck).all():
            out[_NECK] = out[_HEAD] = shortest_turn(out[_CHEST] @ (rest[_HEAD] - rest[_NECK]), neck) @ out[_CHEST]
        else:
            out[_NECK] = out[_HEAD] = out[_CHEST] @ last[_CHEST].T @ last[_NECK]
        for bone, arm in zip(_COLLARS, _UPPER_ARMS, strict=True):
            out[bone] = out[_CHEST]
            way = seen[arm] - seen[bone]
            if self._own and np.isfinite(way).all():
                out[bone] = shortest_turn(out[_CHEST] @ (rest[arm] - rest[bone]), way) @ out[_CHEST]

    def _limbs(self, seen: np.ndarray, out: np.ndarray) -> None:
        """Arms and legs: along what is seen, about the axis they bend about or last bent about."""
        upper, lower = unit(seen[_LOWER] - seen[_UPPER]), unit(seen[_END] - seen[_LOWER])
        last, parents = self.pose.rotations, np.where(_ARMS, _CHEST, 0)
        moved = out[parents] @ np.swapaxes(last[parents], -1, -2)  # with the trunk, since the last frame
        ok = np.isfinite(upper).all(axis=1)
        before = np.einsum("kij,kj->ki", last[_UPPER], self._along[_UPPER])
        upper = np.where(ok[:, None], upper, np.einsum("kij,kj->ki", moved, before))
        below = np.isfinite(lower).all(axis=1)
        carried = np.einsum("kij,kj->ki", shortest_turn(before, upper), self._axes)
        usual = unit(np.cross(upper, np.where(_ARMS[:, None], out[_CHEST] @ FRONT, -(out[0] @ FRONT))))
        axes = (1 - _RELAX) * carried + _RELAX * usual
        bent = np.cross(upper, np.where(below[:, None], lower, upper))
        sine = np.sqrt(np.einsum("ki,ki->k", bent, bent))
        share = np.clip((sine - _STRAIGHT) / (_BENT - _STRAIGHT), 0, 1)[:, None]
        axes = share * unit(bent) + (1 - share) * axes
        turns = frames(upper, axes)
        self._axes = turns[:, :, 1]
        out[_UPPER] = turns @ np.swapaxes(self._rest.frames[_UPPER], -1, -2)
        held = out[_UPPER] @ np.swapaxes(last[_UPPER], -1, -2) @ last[_LOWER]
        bend = frames(np.where(below[:, None], lower, upper), axes) @ np.swapaxes(self._rest.frames[_LOWER], -1, -2)
        out[_LOWER] = np.where(below[:, None, None], bend, held)

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
            if not np.isfinite(way).all():
                out[hand] = out[fore] @ last[fore].T @ last[hand]
            elif np.isfinite(across).all():
                out[hand] = frames(way, np.cross(way, across)) @ self._rest.frames[hand].T
            else:
                out[hand] = shortest_turn(out[fore] @ self._along[hand], way) @ out[fore]
            twist = float(twist_angles(out[fore].T @ out[hand], self._along[fore]))
            out[fore] = out[fore] @ from_vectors(twist / 2 * self._along[fore])

    def _feet(self, seen: np.ndarray, out: np.ndarray) -> None:
        """Feet along what is seen, soles square to the axis of the knee."""
        rest, last = self.skeleton.joints, self.pose.rotations
        for foot, toe, knee in zip(_FEET, _TOES, np.flatnonzero(~_ARMS), strict=True):
            shin, way = foot - 1, seen[toe] - seen[foot]
            if self._places[toe] < 0:
                out[foot] = out[shin]
            elif np.isfinite(way).all():
                axis = self._rest.frames[_UPPER[knee], :, 1]
                out[foot] = frames(way, self._axes[knee]) @ frames(rest[toe] - rest[foot], axis).T
            else:
                out[foot] = out[shin] @ last[shin].T @ last[foot]
            out[toe] = out[foot]

    def _translation(self, seen: np.ndarray, out: np.ndarray) -> np.ndarray:
        """Of the hips, the person's way scaled by the legs."""
        knees = seen[_LOWER[~_ARMS]]
        legs = np.linalg.norm(knees - seen[_THIGHS], axis=1) + np.linalg.norm(seen[_FEET] - knees, axis=1)
        if len(self._legs) < _SETTLED and np.isfinite(legs).any():
            self._legs.append(float(np.nanmean(legs)))
        middle = seen[_THIGHS].mean(axis=0)
        if not self._legs or not np.isfinite(middle).all():
            return self.pose.translation
        scale = (
            1.0 if self._own and self._up is UP and self._same(legs) else self._rest.leg / float(np.mean(self._legs))
        )
        rest = self.skeleton.joints
        own = rest[_THIGHS].mean(axis=0) - rest[0]
        place = middle * scale - out[0] @ own - rest[0]
        if self._origin is None:
            pose = Pose(out, place)
            self._origin = place * [1, 1, 0] if not self._own else np.zeros(3)
            if not self._own:
                self._origin[2] = self._lowest_sole(pose)
        place = place - self._origin
        if self._floor:
            place = place + max(0.0, -self._lowest_sole(Pose(out, place))) * UP
        return place

    def _same(self, legs: np.ndarray) -> bool:
        return bool(abs(np.nanmean(legs) / self._rest.leg - 1) < 1e-3)

    def _lowest_sole(self, pose: Pose) -> float:
        """Height of the lowest point of both soles [m]."""
        moves = posed_joints(self.skeleton, pose) - np.einsum("bij,bj->bi", pose.rotations, self.skeleton.joints)
        heights = self._soles.points @ pose.rotations[:, 2].T + moves[:, 2]
        return float((heights * self._soles.weights).sum(axis=-1).min())


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
