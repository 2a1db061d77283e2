"""A motion does the same on our skeleton, whatever the source's rest pose, axes, unit and names."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.avatar.pose import SkinWeights
from mirror_scan.core.avatar.skeleton import BONES, PARENTS
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.motion import Motion, make_clip, palm_directions, retarget
from motion_figures import along_x, angles, apart, changed, gymnastics, other_person, skeleton
from scipy.spatial.transform import Rotation

Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
NAMES = {"Arm": "Shoulder", "Shoulder": "Collar", "ForeArm": "Elbow", "Hand": "Wrist", "UpLeg": "Hip", "Leg": "Knee",
         "Foot": "Ankle", "ToeBase": "Toe"}  # fmt: skip


def _cmu_names(names):
    out = []
    for name in names:
        side = next((side for side in ("Left", "Right") if name.startswith(side)), "")
        out.append(side + NAMES.get(name.removeprefix(side), name.removeprefix(side)))
    return out


def _limb_angles(motion: Motion, clip) -> float:
    """Worst difference of an elbow's or knee's angle [°]."""
    joints, names, worst = clip.joints(skeleton()), list(motion.joints), 0.0
    for side in ("Left", "Right"):
        for chain in (("Arm", "ForeArm", "Hand"), ("UpLeg", "Leg", "Foot")):
            ours = [joints[:, BONES.index(side + part)] for part in chain]
            theirs = [motion.positions[:, names.index(side + part)] for part in chain]
            bends = [angles(b - a, c - b) for a, b, c in (ours, theirs)]
            worst = max(worst, float(np.abs(bends[0] - bends[1]).max()))
    return worst


@pytest.mark.parametrize("lock_feet", [False, True])
def test_limbs_point_and_bend_as_the_source_s(lock_feet):
    motion = gymnastics()
    clip = retarget(motion, skeleton(), lock_feet=lock_feet)
    assert _limb_angles(motion, clip) < (1.0 if lock_feet else 1e-6)
    names, joints = list(motion.joints), clip.joints(skeleton())
    for part, child in (("LeftArm", "LeftForeArm"), ("RightForeArm", "RightHand")):
        ours = joints[:, BONES.index(child)] - joints[:, BONES.index(part)]
        theirs = motion.positions[:, names.index(child)] - motion.positions[:, names.index(part)]
        assert angles(ours, theirs @ clip.turned.T).max() < 1e-4


def test_palms_and_soles_face_where_the_source_s_do():
    motion, person = gymnastics(), skeleton()
    clip = retarget(motion, person, lock_feet=False)
    names = list(motion.joints)
    for side in ("Left", "Right"):
        # In our rest pose thumbs point ahead: palms face square to hand and −Y. In the T-pose they face down.
        hand = BONES.index(f"{side}Hand")
        along = person.tails()[hand] - person.joints[hand]
        out = np.cross(along, [0, -1, 0]) * (1 if side == "Left" else -1)
        theirs = motion.rotations[:, names.index(f"{side}Hand")] @ [0, -1, 0]
        assert angles(clip.rotations[:, hand] @ out, theirs @ clip.turned.T).max() < 1e-4
        fingers = motion.rotations[:, names.index(f"{side}Hand")] @ [1 if side == "Left" else -1, 0, 0]
        assert angles(clip.rotations[:, hand] @ along, fingers @ clip.turned.T).max() < 1e-4
        foot = BONES.index(f"{side}Foot")
        theirs = motion.rotations[:, names.index(f"{side}Foot")] @ [0, 1, 0]
        assert angles(clip.rotations[:, foot] @ [0, 0, 1], theirs @ clip.turned.T).max() < 5


def test_trunk_turns_as_the_source_s_and_starts_facing_the_front():
    motion = gymnastics()
    around = Rotation.from_euler("y", 130, degrees=True).as_matrix()
    turned = Motion(motion.name, motion.joints, motion.parents, motion.positions @ around.T,
                    around @ motion.rotations, motion.rest, motion.rate)  # fmt: skip
    clip = retarget(turned, skeleton(), lock_feet=False)
    ahead = clip.rotations[0, 0] @ [0, -1, 0]
    assert ahead[1] < 0 and abs(ahead[0]) < 1e-9
    np.testing.assert_allclose(clip.translations[0, :2], 0, atol=1e-12)
    chest, hips = (clip.rotations[:, BONES.index(bone)] for bone in ("Spine2", "Hips"))
    names = list(motion.joints)
    theirs = [motion.rotations[:, names.index(bone)] for bone in ("Spine2", "Hips")]
    np.testing.assert_allclose(
        np.degrees(Rotation.from_matrix(np.swapaxes(hips, 1, 2) @ chest).magnitude()),
        np.degrees(Rotation.from_matrix(np.swapaxes(theirs[1], 1, 2) @ theirs[0]).magnitude()), atol=1e-6)  # fmt: skip


@pytest.mark.parametrize(
    "alter",
    [
        lambda motion: changed(motion, unit=0.01),
        lambda motion: changed(motion, Z_UP, unit=1 / 2.54),
        lambda motion: changed(motion, Rotation.from_euler("y", 90, degrees=True).as_matrix()),
        lambda motion: changed(motion, names=_cmu_names(motion.joints)),
        lambda motion: changed(motion, names=[f"mixamorig:{name}" for name in motion.joints]),
    ],
)
def test_axes_units_and_names_make_no_difference(alter):
    motion = gymnastics()
    plain, other = retarget(motion, skeleton()), retarget(alter(motion), skeleton())
    np.testing.assert_allclose(other.rotations, plain.rotations, atol=1e-6)
    np.testing.assert_allclose(other.translations, plain.translations, atol=1e-6)


def test_a_rest_pose_that_is_none_is_seen_through():
    motion = gymnastics()
    plain, other = retarget(motion, skeleton(), lock_feet=False), retarget(along_x(motion), skeleton(), lock_feet=False)
    assert _limb_angles(motion, other) < 1e-6
    difference = apart(plain.turned.T @ plain.rotations, other.turned.T @ other.rotations)
    limbs = [BONES.index(side + part) for side in ("Left", "Right") for part in ("Arm", "UpLeg", "Leg")]
    assert difference[:, limbs].max() < 1
    # The stance of trunk, palms and soles can only be guessed.
    assert np.median(difference) < 12 and difference.max() < 45


def test_lengths_scale_the_way_and_nothing_else():
    motion = gymnastics()
    small, large = retarget(motion, skeleton(0.6)), retarget(motion, skeleton(1.1))
    way = [np.ptp(clip.translations[:, 1]) for clip in (small, large)]
    assert way[1] / way[0] == pytest.approx(1.1 / 0.6, rel=0.02)


def test_in_place_and_as_a_loop():
    clip = retarget(gymnastics(), skeleton(), in_place=True, loop=True)
    assert np.ptp(clip.translations[:, :2]) == 0
    assert clip.loops
    step = apart(clip.rotations[-1], clip.rotations[0])
    assert step.max() < 2 * apart(clip.rotations[1:], clip.rotations[:-1]).max() + 1


def test_other_hips_and_fewer_joints_do():
    """Without collar bones, neck, toes or fingers, as some trackers have it."""
    motion = gymnastics()
    keep = [k for k, name in enumerate(motion.joints)
            if not any(part in name for part in ("Shoulder", "Neck", "Toe", "Middle", "Thumb", "Spine1"))]  # fmt: skip
    parents = []
    for k in keep:
        parent = motion.parents[k]
        while parent >= 0 and parent not in keep:
            parent = motion.parents[parent]
        parents.append(keep.index(parent) if parent >= 0 else -1)
    fewer = Motion("few", tuple(motion.joints[k] for k in keep), np.array(parents), motion.positions[:, keep],
                   motion.rotations[:, keep], motion.rest[keep], motion.rate)  # fmt: skip
    clip = retarget(fewer, skeleton(), lock_feet=False)
    assert _limb_angles(motion, clip) < 1e-6
    assert np.isfinite(clip.rotations).all()


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_a_few_frames_are_a_clip_too(frames):
    motion = gymnastics()
    short = Motion(motion.name, motion.joints, motion.parents, motion.positions[:frames], motion.rotations[:frames],
                   motion.rest, motion.rate)  # fmt: skip
    for source in (short, along_x(short)):
        clip = retarget(source, skeleton(), loop=True)
        assert len(clip) == frames and np.isfinite(clip.rotations).all() and np.isfinite(clip.translations).all()


def test_the_source_at_rest_is_a_t_pose():
    names, parents, rest = other_person()
    still = Motion("still", tuple(names), parents, np.tile(rest, (3, 1, 1)), np.tile(np.eye(3), (3, len(names), 1, 1)),
                   rest, 30.0)  # fmt: skip
    clip = retarget(still, skeleton())
    joints = clip.joints(skeleton())[0]
    for side, sign in (("Left", 1), ("Right", -1)):
        arm, hand = joints[BONES.index(f"{side}Arm")], joints[BONES.index(f"{side}Hand")]
        assert angles(hand - arm, np.array([sign, 0, 0])) < 0.1
    np.testing.assert_allclose(clip.rotations[0, : BONES.index("Head") + 1], np.tile(np.eye(3), (6, 1, 1)), atol=1e-9)
    assert abs(joints[BONES.index("LeftFoot"), 2] - 0.08) < 0.01


def test_palms_of_a_skin_are_those_of_its_fingers():
    person, rng = skeleton(), np.random.default_rng(2)
    vertices, index, truth = [], [], []
    for side, sign in (("Left", 1), ("Right", -1)):
        hand = BONES.index(f"{side}Hand")
        along = person.tails()[hand] - person.joints[hand]
        usual = sign * np.cross(along, [0, -1, 0])
        normal = Rotation.from_rotvec(np.radians(25) * along / np.linalg.norm(along)).apply(
            usual / np.linalg.norm(usual)
        )
        across = np.cross(along / np.linalg.norm(along), normal)
        flat = rng.uniform([0, -0.04, -0.008], [1, 0.04, 0.008], (500, 3))
        vertices.append(person.joints[hand] + flat @ np.stack([along, across, normal]))
        index.append(np.full(500, hand))
        truth.append(normal)
    index = np.concatenate(index)
    weights = SkinWeights(np.stack([index] + [0 * index] * 3, axis=1).astype(np.uint8),
                          np.tile(np.array([1, 0, 0, 0], np.float32), (1000, 1)))  # fmt: skip
    palms = palm_directions(np.concatenate(vertices), weights, person)
    assert angles(palms, np.array(truth)).max() < 3
    lump = person.joints[index] + 0.03 * rng.normal(size=(1000, 3))
    fallen_back = palm_directions(lump, weights, person)
    clip, other = (retarget(gymnastics(), person, palms=each) for each in (None, fallen_back))
    np.testing.assert_allclose(other.rotations, clip.rotations, atol=1e-9)


@pytest.mark.parametrize("bone", ["LeftForeArm", "RightLeg", "LeftUpLeg", "RightArm"])
@pytest.mark.parametrize("frames", [slice(None), slice(4, 5)])
def test_a_limb_that_points_nowhere_is_refused(bone, frames):
    motion = gymnastics()
    names = list(motion.joints)
    child = {"Leg": "Foot", "UpLeg": "Leg", "ForeArm": "Hand", "Arm": "ForeArm"}
    side = bone[: 4 if bone.startswith("Left") else 5]
    end = names.index(side + child[bone.removeprefix(side)])
    motion.positions[frames, end] = motion.positions[frames, names.index(bone)]
    with pytest.raises(MirrorScanError, match=f"gymnastics: {bone} has no length in frame"):
        retarget(motion, skeleton())


def test_one_place_for_all_joints_is_refused():
    motion = gymnastics()
    motion.positions[:], motion.rest[:] = 0, 0
    with pytest.raises(MirrorScanError, match="has no length"):
        retarget(motion, skeleton())


@pytest.mark.parametrize("turn", [("x", 90), ("x", 180), ("z", 90), ("z", 180)])
def test_a_skeleton_in_other_axes_is_refused(turn):
    """As of “--frame camera”, or of a mesh that was turned: no motion fits it."""
    lying = np.eye(4)
    lying[:3, :3] = Rotation.from_euler(*turn, degrees=True).as_matrix()
    with pytest.raises(MirrorScanError, match="does not stand upright"):
        retarget(gymnastics(), skeleton().transformed(lying))
    lying[:3, :3] = Rotation.from_euler(turn[0], 35, degrees=True).as_matrix()
    retarget(gymnastics(), skeleton().transformed(lying))


def test_a_motion_of_the_same_rest_pose_comes_back_as_it_is():
    """As from the avatar's own file, turned and in centimetres: palms that the file does not say stay as they are."""
    person = skeleton()
    clip = make_clip("arms_up", person)
    axes = Rotation.from_euler("xz", (-90, 40), degrees=True).as_matrix()
    motion = Motion(
        "own", tuple(f"mixamorig:{bone}" for bone in BONES), np.array(PARENTS), 100 * clip.joints(person) @ axes.T,
        axes @ clip.rotations @ axes.T, 100 * person.joints @ axes.T, clip.rate, axes[:, 2],
    )  # fmt: skip
    hands = [BONES.index("LeftHand"), BONES.index("RightHand")]
    along = person.tails()[hands] - person.joints[hands]
    palms = np.array([np.cross(along[0], (0.7, -1, 0)), -np.cross(along[1], (0.7, -1, 0))])
    back = retarget(motion, person, lock_feet=False, palms=palms / np.linalg.norm(palms, axis=1, keepdims=True))
    assert apart(back.rotations, clip.rotations).max() < 0.5
    np.testing.assert_allclose(back.translations[:, :2], clip.translations[:, :2], atol=0.005)
