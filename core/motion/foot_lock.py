"""Feet that stand on the floor: neither in it nor sliding over it, without a visible change of the motion.

Hips go up and down so that the lower foot meets the floor; each leg swings about its hip so that a foot that stands
stays where it stands. Both leave knees as they were: they stretch or bend by a degree at most, in the plane they had.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..avatar.clip import Clip
from ..avatar.pose import SkinWeights
from ..avatar.skeleton import BONES, Skeleton
from ..errors import MirrorScanError
from ..numeric.rotations import about_axis, from_vectors, shortest_turn, unit
from .rest_frames import FRONT, LEFT, UP

_SIDES = ("Left", "Right")
_THIGH, _SHIN, _FOOT, _TOE = (
    [BONES.index(side + part) for side in _SIDES] for part in ("UpLeg", "Leg", "Foot", "ToeBase")
)
_NEAR_FLOOR = 0.035  # m above where the foot usually stands: a point of a sole may stand
_SLOW = 0.4  # m/s: the same
_SHORTEST = 0.08  # s: shorter gaps in standing are bridged, shorter standing is none
_STILL = 0.12  # m/s: slower it stands, wherever a suit that lost the floor believes it
_DRIFT = 0.15  # m: so far they may be off
_LONGEST_FLIGHT = 0.9  # s
_FADE = 0.25  # s: in which a foot that left the floor forgets where it stood
_ROLLED = 0.02  # m: points so much above the lowest count a third of it
_HEADING_SLACK = np.radians(4)
_BALL = 0.05  # m: sole points so far from the ball of the foot count a third of those under it
_LARGEST_ROLL = np.radians(20)
_LARGEST_TILT = np.radians(2.5)
_SMOOTH = 0.06  # s: sigma of the hips' way up and down
_SINK = 0.002  # m: a sole may be this much in the floor before anything is done
_KNEE_SLACK = np.radians(0.9)


@dataclass(frozen=True)
class Soles:
    """Points of the skin that can meet the floor, of the left and the right foot, and which bones move them.

    Parameters
    ----------
    points : np.ndarray [shape=(2, K, 3), dtype=float64]
        In the rest pose [m].
    weights : np.ndarray [shape=(2, K, 22), dtype=float64]
        Each point's sum to 1.
    """

    points: np.ndarray
    weights: np.ndarray

    def rigid(self) -> Soles:
        """The same points moved by foot and toes alone: where a foot stands, its skin gives way, its bones do not."""
        weights = np.zeros_like(self.weights)
        for side in range(2):
            own = self.weights[side][:, [_FOOT[side], _TOE[side]]]
            own = np.where(own.sum(axis=1, keepdims=True) > 0, own, [1.0, 0.0])
            weights[side][:, [_FOOT[side], _TOE[side]]] = own / own.sum(axis=1, keepdims=True)
        return Soles(self.points, weights)


def sole_points(vertices: np.ndarray, weights: SkinWeights, skeleton: Skeleton) -> Soles:
    """Soles of a skin, shoes included.

    Parameters
    ----------
    vertices : np.ndarray [shape=(V, 3), dtype=float64]
        In the skeleton's frame [m].
    weights : SkinWeights
    skeleton : Skeleton

    Returns
    -------
    Soles
        Of heel and toes each, the outermost in 48 directions downwards and aside.
    """
    full = np.zeros((len(vertices), len(BONES)))
    for k in range(weights.index.shape[1]):
        np.add.at(full, (np.arange(len(vertices)), weights.index[:, k]), weights.weight[:, k])
    tilt, turn = np.meshgrid(np.radians([5, 20, 40, 70]), np.arange(12) * np.pi / 6, indexing="ij")
    downwards = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt)], axis=-1).reshape(
        -1, 3
    )
    points, shares = [], []
    for side in range(2):
        ankle, toe = skeleton.joints[_FOOT[side]], skeleton.joints[_TOE[side]]
        length = float(np.linalg.norm((toe - ankle)[:2]))
        ahead = unit((toe - ankle) * [1, 1, 0])
        along, beside = (vertices - ankle) @ ahead / length, (vertices - ankle) @ np.cross(UP, ahead) / length
        near = (np.abs(beside) < 0.6) & (vertices[:, 2] < ankle[2]) & (along > -0.8) & (along < 2.2)
        for own in (near & (along < 1), near & (along >= 1)):
            at = np.flatnonzero(own)
            if len(at) == 0:
                raise MirrorScanError("the skin has no foot where the skeleton has one; check the skeleton")
            at = at[np.argmax(vertices[at] @ downwards.T, axis=0)]
            points.append(vertices[at])
            shares.append(full[at] / full[at].sum(axis=1, keepdims=True))
    return Soles(np.reshape(points, (2, -1, 3)), np.reshape(shares, (2, -1, len(BONES))))


def estimated_soles(skeleton: Skeleton) -> Soles:
    """Soles on z = 0, of the joints alone: left and right edge of heel, ball and tip (2, 6, 3)."""
    tails = skeleton.tails()
    points, weights = np.empty((2, 6, 3)), np.zeros((2, 6, len(BONES)))
    for side in range(2):
        ankle, toe = skeleton.joints[_FOOT[side]], skeleton.joints[_TOE[side]]
        tip = tails[_TOE[side]] + 0.06 * (tails[_TOE[side]] - ankle)
        across = np.cross(UP, toe - ankle)
        places = ((ankle - 0.38 * (toe - ankle), 0.18), (toe, 0.3), (tip, 0.12))
        points[side] = [middle + edge * across for middle, half in places for edge in (half, -half)]
        weights[side, :4, _FOOT[side]] = 1
        weights[side, 4:, _TOE[side]] = 1
    points[..., 2] = 0
    return Soles(points, weights)


def stand_on_floor(clip: Clip, skeleton: Skeleton, soles: Soles | None = None) -> Clip:
    """The clip lifted or lowered as a whole until standing feet are on z = 0 [m]."""
    points = _sole_places(clip, skeleton, estimated_soles(skeleton) if soles is None else soles)
    floor = _usual_heights(points, clip.rate).min()
    return replace(clip, translations=clip.translations - floor * UP)


def lock_feet(clip: Clip, skeleton: Skeleton, soles: Soles | None = None) -> Clip:
    """The clip with its feet on the floor z = 0, and at rest where they stand.

    Parameters
    ----------
    clip : Clip
    skeleton : Skeleton
    soles : Soles, optional
        As of :func:`sole_points`; otherwise estimated of the joints.
    """
    soles = estimated_soles(skeleton) if soles is None else soles
    firm = soles.rigid()
    points = _sole_places(clip, skeleton, firm)
    usual = _usual_heights(points, clip.rate)
    stands = _standing(points, usual, clip.rate)
    clip = _settled(clip, skeleton, stands.any(axis=2))
    lowest = _sole_places(clip, skeleton, soles)[..., 2].min(axis=2)
    clip = _hips_tilted(clip, skeleton, lowest, stands.any(axis=2))
    clip = _on_floor(
        clip, _sole_places(clip, skeleton, soles)[..., 2].min(axis=2), stands.any(axis=2), float(usual.min())
    )
    lowest = _sole_places(clip, skeleton, soles)[..., 2].min(axis=2)
    # What stays where it stands lies between sole and joints: a foot that tips moves the one or the other.
    above = skeleton.joints[_TOE][:, None] - soles.points
    from_ball = np.linalg.norm(above[..., :2], axis=-1)
    points = _sole_places(clip, skeleton, replace(firm, points=soles.points + above * [0, 0, 0.75]))
    clip = _reached(clip, skeleton, _corrections(points, lowest, stands * np.exp(-from_ball / _BALL), clip.rate))
    lowest = _sole_places(clip, skeleton, soles)[..., 2].min(axis=(1, 2))
    return replace(clip, translations=clip.translations + _covering(-lowest - _SINK, clip.rate)[:, None] * UP)


def _sole_places(clip: Clip, skeleton: Skeleton, soles: Soles) -> np.ndarray:
    """Where the soles' points are (F, 2, K, 3) [m]."""
    used = np.flatnonzero(soles.weights.any(axis=(0, 1)))
    rotations = clip.rotations[:, used]
    moves = clip.joints(skeleton)[:, used] - np.einsum("fbij,bj->fbi", rotations, skeleton.joints[used])
    matrices = np.concatenate([rotations, moves[..., None]], axis=3).transpose(0, 2, 1, 3).reshape(len(clip), 3, -1)
    points = np.concatenate([soles.points, np.ones((*soles.points.shape[:2], 1))], axis=2)
    parts = soles.weights[..., used, None] * points[:, :, None]
    places = matrices @ parts.reshape(-1, 4 * len(used)).T
    return np.swapaxes(places, 1, 2).reshape(len(clip), *soles.points.shape)


def _usual_heights(points: np.ndarray, rate: float) -> np.ndarray:
    """The height (2,) at which each foot usually stands [m]: low and slow."""
    lowest = np.take_along_axis(points, points[..., 2].argmin(axis=2)[..., None, None], axis=2)[:, :, 0, 2]
    slow = _speeds(points, rate).min(axis=2) < _SLOW
    heights = np.empty(2)
    for side in range(2):
        own = lowest[slow[:, side], side] if slow[:, side].any() else lowest[:, side]
        heights[side] = np.median(own[own < np.quantile(own, 0.05) + 0.06])
    # A foot that never stands (a kick, a seat) tells nothing of the floor.
    return np.minimum(heights, heights.min() + 0.06)


def _speeds(points: np.ndarray, rate: float) -> np.ndarray:
    """Speeds (F, 2, K) [m/s]."""
    return (
        np.linalg.norm(np.gradient(points, axis=0), axis=-1) * rate if len(points) > 1 else np.zeros(points.shape[:3])
    )


def _standing(points: np.ndarray, usual: np.ndarray, rate: float) -> np.ndarray:
    """Which points of the soles stand (F, 2, K): low and slow, and not for a moment only."""
    speeds = _speeds(points, rate)
    slow = speeds < _SLOW
    floor = _floor(points[..., 2].min(axis=(1, 2)), float(usual.min()), rate)
    near = floor[:, None] + (usual - usual.min()) + _NEAR_FLOOR
    stands = slow & (points[..., 2] < near[..., None])
    stands |= (speeds < _STILL) & (points[..., 2] < near[..., None] + _DRIFT)
    shortest = max(1, round(_SHORTEST * rate))
    for side in range(2):
        foot = stands[:, side].any(axis=1)
        for first, last in _runs(~foot):
            if last - first < shortest and first > 0 and last < len(foot):
                stands[first:last, side] = stands[first - 1, side]
        for first, last in _runs(stands[:, side].any(axis=1)):
            if last - first < shortest and first > 0 and last < len(foot):
                stands[first:last, side] = False
    return stands


def _floor(height: np.ndarray, usual: float, rate: float) -> np.ndarray:
    """The floor's height over time (F,) [m] of the lower sole's ``height`` (F,).

    Inertial suits lose the floor, by a hand's breadth in a dance. But nobody flies for longer than a jump: what stays
    up longer stands. Higher than that, it stands on a step, and the floor is where it usually is.
    """
    reach = max(1, round(_LONGEST_FLIGHT * rate / 2))

    def around(values: np.ndarray) -> np.ndarray:
        padded = np.pad(values, reach, mode="edge")
        return np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)

    opened = around(around(height).min(axis=1)).max(axis=1)
    return _smoothed(np.where(opened < usual + _DRIFT, opened, usual), rate)


def _runs(true: np.ndarray) -> list[tuple[int, int]]:
    """First and one past the last frame of each run of true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], true, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _hips_tilted(clip: Clip, skeleton: Skeleton, lowest: np.ndarray, feet: np.ndarray) -> Clip:
    """Hips tilted by a few degrees where both feet stand and one is higher: the source's legs differ in length.

    ``lowest`` and ``feet`` as of :func:`_on_floor`.
    """
    hips = clip.rotations[:, 0]
    width = float(np.linalg.norm(np.subtract(*skeleton.joints[_THIGH])))
    gap = lowest[:, 1] - lowest[:, 0]
    tilt = np.clip(gap / width, -_LARGEST_TILT, _LARGEST_TILT)
    known = feet.all(axis=1) & (np.abs(gap) < _NEAR_FLOOR)
    tilt = _smoothed(_faded(tilt[:, None], known, clip.rate)[:, 0], clip.rate)
    rotations = clip.rotations.copy()
    rotations[:, 0] = from_vectors(hips @ FRONT * tilt[:, None]) @ hips
    return replace(clip, rotations=rotations)


def _on_floor(clip: Clip, lowest: np.ndarray, feet: np.ndarray, usual: float) -> Clip:
    """Hips raised and lowered so that the lower of the standing feet is on the floor, and neither is in it.

    Parameters
    ----------
    clip : Clip
    lowest : np.ndarray [shape=(F, 2), dtype=float64]
        Heights of left and right sole [m].
    feet : np.ndarray [shape=(F, 2), dtype=bool]
        Which of them stand.
    usual : float
        Height at which feet usually stand [m].
    """
    lift = -_floor(lowest.min(axis=1), usual, clip.rate)
    standing = feet.any(axis=1)
    more = np.where(standing, np.where(feet, -lowest, -np.inf).max(axis=1) - lift, 0)
    lift = _smoothed(lift + _faded(more[:, None], standing, clip.rate)[:, 0], clip.rate)
    lift = lift + _covering(-lowest.min(axis=1) - _SINK - lift, clip.rate)
    return replace(clip, translations=clip.translations + lift[:, None] * UP)


def _smoothed(values: np.ndarray, rate: float) -> np.ndarray:
    """Values (F,) under a Gaussian, ends held."""
    reach = max(1, round(3 * _SMOOTH * rate))
    bell = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (_SMOOTH * rate)) ** 2)
    return np.convolve(np.pad(values, reach, mode="edge"), bell / bell.sum(), mode="valid")


def _covering(values: np.ndarray, rate: float) -> np.ndarray:
    """A smooth curve (F,) that is nowhere below ``values`` (F,) nor below 0."""
    reach = max(1, round(_SMOOTH * rate))
    wide = np.lib.stride_tricks.sliding_window_view(
        np.pad(np.maximum(values, 0), 2 * reach, mode="edge"), 2 * reach + 1
    )
    even = np.full(2 * reach + 1, 1 / (2 * reach + 1))
    return np.convolve(wide.max(axis=1), even, mode="valid")


def _settled(clip: Clip, skeleton: Skeleton, stands: np.ndarray) -> Clip:
    """Feet that stand lie level from side to side, and their heading stays until it must follow; both turn with it.

    Parameters
    ----------
    clip : Clip
    skeleton : Skeleton
    stands : np.ndarray [shape=(F, 2), dtype=bool]
    """
    rotations = clip.rotations.copy()
    for side in range(2):
        ahead = unit(rotations[:, _FOOT[side]] @ (skeleton.joints[_TOE[side]] - skeleton.joints[_FOOT[side]]))
        left = rotations[:, _FOOT[side]] @ LEFT
        # About the way from ankle to toes, which so keeps its direction.
        roll = np.arctan2(-left[:, 2], np.abs(np.cross(ahead, left)[:, 2]))
        roll = np.clip(roll, -_LARGEST_ROLL, _LARGEST_ROLL) * np.linalg.norm(ahead[:, :2], axis=1)
        headings = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
        turns = np.stack([roll, np.zeros(len(clip))], axis=1)
        for first, last in _runs(stands[:, side]):
            held = float(np.median(headings[first:last]))
            for frame in range(first, last):
                held = min(max(held, headings[frame] - _HEADING_SLACK), headings[frame] + _HEADING_SLACK)
                turns[frame, 1] = held - headings[frame]
        turns = _faded(turns, stands[:, side], clip.rate)
        spin = about_axis(2, turns[:, 1]) @ from_vectors(ahead * turns[:, :1])
        for bone in (_FOOT[side], _TOE[side]):
            rotations[:, bone] = spin @ rotations[:, bone]
    return replace(clip, rotations=rotations)


def _corrections(points: np.ndarray, lowest: np.ndarray, weights: np.ndarray, rate: float) -> np.ndarray:
    """How far each foot must be moved (F, 2, 3) [m] to stay where it stands, faded between.

    Parameters
    ----------
    points : np.ndarray [shape=(F, 2, K, 3), dtype=float64]
        Of the soles [m].
    lowest : np.ndarray [shape=(F, 2), dtype=float64]
        Heights of the skin of the soles [m].
    weights : np.ndarray [shape=(F, 2, K), dtype=float64]
        How much a point that stands counts; 0 where it does not stand.
    rate : float
    """
    out = np.zeros((len(points), 2, 3))
    for side in range(2):
        known = np.zeros(len(points), dtype=bool)
        for first, last in _runs(weights[:, side].any(axis=1)):
            out[first:last, side, :2] = _rolled(points[first:last, side], weights[first:last, side])
            out[first:last, side, 2] = -lowest[first:last, side]
            known[first:last] = True
        out[:, side] = _faded(out[:, side], known, rate)
    return out


def _faded(values: np.ndarray, known: np.ndarray, rate: float) -> np.ndarray:
    """Values (F, n) where ``known`` (F,), between two steps over from one to the other, and none far from both."""
    at, frames = np.flatnonzero(known), np.arange(len(known))
    if len(at) == 0:
        return np.zeros_like(values)
    after = np.minimum(np.searchsorted(at, frames), len(at) - 1)
    distance = np.minimum(np.abs(frames - at[after]), np.abs(frames - at[np.maximum(after - 1, 0)])) / rate
    share = np.clip(1 - distance / _FADE, 0, 1)
    between = np.stack([np.interp(frames, at, column) for column in values[at].T], axis=1)
    return between * (share * share * (3 - 2 * share))[:, None]


def _rolled(points: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Moves (F, 2) with which a foot rolls without sliding: what stands of it (F, K, 3) is at rest, the lowest most."""
    heights = points[..., 2] - points[..., 2].min(axis=1, keepdims=True)
    weights = np.exp(-heights / _ROLLED) * (1e-3 + weights)
    weights = weights[1:] * weights[:-1]
    slides = np.einsum("fk,fkc->fc", weights, np.diff(points[..., :2], axis=0)) / weights.sum(axis=1, keepdims=True)
    moves = np.concatenate([np.zeros((1, 2)), -np.cumsum(slides, axis=0)])
    return moves - (moves.min(axis=0) + moves.max(axis=0)) / 2


def _reached(clip: Clip, skeleton: Skeleton, moves: np.ndarray) -> Clip:
    """Legs turned so that ankles are moved by ``moves`` (F, 2, 3); feet keep their turn.

    Over the floor a foot comes where it should; up and down only as far as the knee's slack allows.
    """
    joints, rotations = clip.joints(skeleton), clip.rotations.copy()
    for side in range(2):
        hip, knee, ankle = (joints[:, bone[side]] for bone in (_THIGH, _SHIN, _FOOT))
        thigh, shin = np.linalg.norm(knee - hip, axis=1), np.linalg.norm(ankle - knee, axis=1)
        across = np.cross(knee - hip, ankle - knee)
        usual = np.einsum("fij,j->fi", rotations[:, _THIGH[side]], [1.0, 0, 0])
        sine = np.linalg.norm(across, axis=1)
        bend = np.arctan2(sine, np.einsum("fi,fi->f", knee - hip, ankle - knee))
        axis = np.where((sine > 0.02 * thigh * shin)[:, None], unit(across), usual)
        least = np.maximum(bend - _KNEE_SLACK, np.minimum(bend, 0.01))
        near, far = (_reach(thigh, shin, angle) for angle in (bend + _KNEE_SLACK, least))
        target = ankle + moves[:, side] - hip
        length = np.clip(np.linalg.norm(target, axis=1), near, far)
        level = np.minimum(np.linalg.norm(target[:, :2], axis=1), 0.999 * length)
        target[:, :2] = unit(target * [1, 1, 0])[:, :2] * level[:, None]
        target[:, 2] = np.copysign(np.sqrt(length**2 - level**2), target[:, 2])
        cosine = (length**2 - thigh**2 - shin**2) / (2 * thigh * shin)
        more = from_vectors(axis * (np.arccos(np.clip(cosine, -1, 1)) - bend)[:, None])
        more = np.where((np.abs(length - np.linalg.norm(ankle - hip, axis=1)) > 1e-12)[:, None, None], more, np.eye(3))
        bent = knee - hip + np.einsum("fij,fj->fi", more, ankle - knee)
        swing = shortest_turn(bent, target)
        rotations[:, _THIGH[side]] = swing @ rotations[:, _THIGH[side]]
        rotations[:, _SHIN[side]] = swing @ more @ rotations[:, _SHIN[side]]
    return replace(clip, rotations=rotations)


def _reach(thigh: np.ndarray, shin: np.ndarray, bend: np.ndarray) -> np.ndarray:
    """Length (F,) from hip to ankle with the knee bent by ``bend`` [rad]."""
    return np.sqrt(thigh**2 + shin**2 + 2 * thigh * shin * np.cos(bend))
