"""How limbs stand in the skeleton's rest pose: along which direction, and about which axis elbow and knee bend."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..avatar.pose import SkinWeights
from ..avatar.skeleton import BONES, Skeleton
from ..errors import MirrorScanError
from ..numeric.rotations import frames, unit

UP, FRONT, LEFT = np.array([0.0, 0, 1]), np.array([0.0, -1, 0]), np.array([1.0, 0, 0])
# Upper bone, lower bone, end of the chain; towards where the lower bone moves when the joint bends.
HINGES = tuple(
    (f"{side}{upper}", f"{side}{lower}", f"{side}{end}", towards)
    for side in ("Left", "Right")
    for upper, lower, end, towards in (("Arm", "ForeArm", "Hand", FRONT), ("UpLeg", "Leg", "Foot", -FRONT))
)
_UPRIGHT = 0.5  # cosine of how far a person in the avatar frame may lean or be turned
_CLEAR_BEND = (np.radians(10), np.radians(25))  # below, a rest pose's bend says nothing of its axis; above, all


@dataclass(frozen=True)
class RestFrames:
    """Frames of the limbs in the rest pose.

    Parameters
    ----------
    frames : np.ndarray [shape=(22, 3, 3), dtype=float64]
        Of each bone, in the avatar frame. Arms and legs: first column along the bone, second the axis about which
        elbow or knee bends. Hands: second column square to the palm, out of a left palm and into a right one. Feet and
        toes: first column their direction on the floor, second up. Others: left and up.
    leg : float
        Length of thigh and shin, both legs' mean [m].
    slopes : np.ndarray [shape=(2,), dtype=float64]
        How far the way from ankle to toes slopes down, left and right [rad].
    """

    frames: np.ndarray
    leg: float
    slopes: np.ndarray


def rest_frames(skeleton: Skeleton, palms: np.ndarray | None = None) -> RestFrames:
    """The frames of a skeleton; ``palms`` (2, 3): directions out of the left and the right palm in the rest pose.

    Without ``palms`` thumbs point ahead: as arms hang, and as they do in an A- or T-pose with palms down.

    Raises
    ------
    MirrorScanError
        The skeleton does not stand as in the avatar frame.
    """
    hips, neck, left, right = (
        skeleton.joints[BONES.index(name)] for name in ("Hips", "Neck", "LeftUpLeg", "RightUpLeg")
    )
    if unit(neck - hips) @ UP < _UPRIGHT or unit(left - right) @ LEFT < _UPRIGHT:
        raise MirrorScanError(
            "the skeleton does not stand upright and face −Y in its own axes; reconstruct in the avatar frame, and "
            "turn the object, not its mesh"
        )
    along = unit(skeleton.tails() - skeleton.joints)
    out = np.tile(frames(LEFT, UP), (len(BONES), 1, 1))
    leg = 0.0
    for upper, lower, _, towards in HINGES:
        first, second = BONES.index(upper), BONES.index(lower)
        axis = bend_axis(along[first], along[second], towards)
        out[first], out[second] = frames(along[first], axis), frames(along[second], axis)
        if upper.endswith("UpLeg"):
            bones = skeleton.joints[[second, second + 1]] - skeleton.joints[[first, second]]
            leg += np.linalg.norm(bones, axis=1).sum() / 2
    for hand, sign in ((BONES.index("LeftHand"), 1), (BONES.index("RightHand"), -1)):
        axis = np.cross(along[hand], FRONT) if palms is None else sign * palms[0 if sign > 0 else 1]
        out[hand] = frames(along[hand], axis)
    for side in ("Left", "Right"):
        foot, toe = BONES.index(f"{side}Foot"), BONES.index(f"{side}ToeBase")
        out[foot] = out[toe] = level_frame(along[foot], UP)
    feet = [BONES.index("LeftFoot"), BONES.index("RightFoot")]
    return RestFrames(out, leg, np.arcsin(-along[feet, 2]))


def palm_directions(vertices: np.ndarray, weights: SkinWeights, skeleton: Skeleton) -> np.ndarray:
    """Directions (2, 3) out of the left and the right palm in the rest pose, of how the fingers lie side by side.

    A fist, or fingers that scanned as a lump, say nothing: thumbs are then taken to point ahead.

    Parameters
    ----------
    vertices : np.ndarray [shape=(V, 3), dtype=float64]
        Of the skin, in the skeleton's frame [m].
    weights : SkinWeights
    skeleton : Skeleton
    """
    out = np.empty((2, 3))
    for hand, side, sign in ((BONES.index("LeftHand"), 0, 1), (BONES.index("RightHand"), 1, -1)):
        along = skeleton.tails()[hand] - skeleton.joints[hand]
        out[side] = unit(sign * np.cross(along, FRONT))
        own = vertices[np.where(weights.index == hand, weights.weight, 0).sum(axis=1) > 0.5] - skeleton.joints[hand]
        share = own @ along / (along @ along)
        fingers = own[(share > 0.6) & (share < 0.85)]  # beyond the thumb
        if len(fingers) < 12:
            continue
        fingers = fingers - np.outer(fingers @ along, along) / (along @ along)
        _, sizes, axes = np.linalg.svd(fingers - fingers.mean(axis=0), full_matrices=False)
        if sizes[0] > 2 * sizes[1]:
            out[side] = axes[1] * np.copysign(1, axes[1] @ out[side])
    return out


def bend_axis(upper: np.ndarray, lower: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """The axis (3,) about which ``lower`` bends away from ``upper``, both (3,); where straight, towards ``towards``."""
    usual = unit(np.cross(upper, towards))
    seen = np.cross(upper, lower)
    bend = np.arctan2(np.linalg.norm(seen), upper @ lower)
    low, high = _CLEAR_BEND
    share = np.clip((bend - low) / (high - low), 0, 1) * (seen @ usual > 0)
    return unit(share * unit(seen) + (1 - share) * usual)


def level_frame(along: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Frame (..., 3, 3) of what of a direction lies in the plane square to ``up``, and of ``up``."""
    ahead = along - np.einsum("...i,...i->...", along, up)[..., None] * up
    return frames(ahead, up)
