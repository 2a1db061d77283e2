"""Clips of our own repeat, stand on the floor and fit every body; the T-pose as rest changes nothing that is seen."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.avatar.pose import SkinWeights, bone_matrices, posed_joints, skinned
from mirror_scan.core.avatar.skeleton import BONES
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.motion import CLIPS, Clip, make_clip, t_pose, take_as_rest
from mirror_scan.core.motion.foot_lock import _sole_places, estimated_soles
from motion_figures import angles, apart, skeleton
from scipy.spatial.transform import Rotation


@pytest.mark.parametrize("scale", [0.65, 1.0])
@pytest.mark.parametrize("name", CLIPS)
def test_clips_repeat_smoothly_and_stand_on_the_floor(name, scale):
    person = skeleton(scale)
    clip = make_clip(name, person)
    assert clip.loops
    np.testing.assert_allclose(np.linalg.det(clip.rotations), 1)
    steps = apart(clip.rotations[1:], clip.rotations[:-1])
    assert steps.max() < 25
    assert (apart(clip.rotations[-1], clip.rotations[0]) < 1.5 * steps.max(axis=0) + 1).all()
    points = _sole_places(clip, person, estimated_soles(person))
    assert points[..., 2].min() > -0.005
    assert points[..., 2].min(axis=(1, 2)).max() < 0.01  # one foot always stands
    standing = points[..., 2].argmin(axis=2)
    for side in range(2):
        for frame in range(1, len(clip)):
            k = standing[frame, side]
            if points[frame - 1, side, k, 2] < 0.001 and points[frame, side, k, 2] < 0.001:
                slide = points[frame, side, k, :2] - points[frame - 1, side, k, :2]
                assert np.linalg.norm(slide) < 0.002 * scale + 0.002


def test_walk_goes_ahead_and_mirrors_itself_half_a_round_later():
    person = skeleton()
    clip = make_clip("walk", person, rate=40)
    assert 0.9 < -clip.translations[-1, 1] / clip.duration < 1.5
    assert np.abs(clip.translations[:, 0]).max() < 0.05
    half = len(clip) // 2
    flip = np.diag([-1.0, 1, 1])
    left, right = BONES.index("LeftLeg"), BONES.index("RightLeg")
    mirrored = flip @ np.roll(clip.rotations, -half, axis=0)[:, right] @ flip
    assert apart(clip.rotations[:, left], mirrored).max() < 0.1
    ways = make_clip("walk", person, in_place=True).translations
    assert np.ptp(ways[:, :2]) == 0


def test_knees_bend_back():
    person = skeleton()
    for name in CLIPS:
        clip = make_clip(name, person)
        joints, left = clip.joints(person), clip.rotations[:, 0] @ [1, 0, 0]
        for side in ("Left", "Right"):
            hip, knee, ankle = (joints[:, BONES.index(side + part)] for part in ("UpLeg", "Leg", "Foot"))
            bend = np.cross(knee - hip, ankle - knee)
            assert (np.einsum("fi,fi->f", bend, left) > 0).all(), (name, side)


def test_an_unknown_clip_is_told():
    with pytest.raises(MirrorScanError, match="there is no clip dance; choose of idle, walk"):
        make_clip("dance", skeleton())


def test_t_pose():
    person = skeleton()
    joints = posed_joints(person, t_pose(person))
    for side, sign in (("Left", 1), ("Right", -1)):
        at = [joints[BONES.index(side + part)] for part in ("Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot")]
        assert angles(at[2] - at[0], np.array([sign, 0, 0])) < 1e-5
        assert angles(at[5] - at[3], np.array([0, 0, -1])) < 1e-5
    assert joints[BONES.index("LeftFoot"), 2] == pytest.approx(0.08)


def test_the_t_pose_as_rest_shows_the_same_clip():
    person, rng = skeleton(), np.random.default_rng(3)
    vertices = rng.uniform([-0.5, -0.2, 0], [0.5, 0.2, 1.75], (300, 3))
    index = np.zeros((300, 4), np.uint8)
    index[:, 0] = rng.integers(0, 22, 300)  # one bone a vertex: blending is not linear in the rest pose
    weights = SkinWeights(index, np.tile(np.array([1, 0, 0, 0], np.float32), (300, 1)))
    rest = t_pose(person)
    clip = make_clip("walk", person)
    moved, changed = take_as_rest(vertices, weights, person, rest)
    again = clip.from_rest(rest)
    for frame in (0, 7, 20):
        first = skinned(vertices, weights, bone_matrices(person, clip.pose(frame)))
        second = skinned(moved, weights, bone_matrices(changed, again.pose(frame)))
        np.testing.assert_allclose(second, first, atol=1e-9)
    np.testing.assert_allclose(changed.tails()[8] - changed.joints[8],
                               rest.rotations[8] @ (person.tails()[8] - person.joints[8]), atol=1e-12)  # fmt: skip


def test_a_clip_at_other_rates_and_times():
    time = np.arange(31) / 30
    turns = np.tile(Rotation.from_euler("z", time[:, None]).as_matrix()[:, None], (1, 22, 1, 1))
    clip = Clip("turn", 30.0, turns, np.stack([time, 0 * time, 0 * time], axis=1))
    other = clip.resampled(25)
    assert len(other) == 26 and other.duration == pytest.approx(clip.duration)
    truth = Rotation.from_euler("z", np.arange(26)[:, None] / 25).as_matrix()
    np.testing.assert_allclose(other.rotations[:, 3], truth, atol=1e-9)
    np.testing.assert_allclose(other.translations[:, 0], np.arange(26) / 25)
    assert clip.pose(400).translation[0] == 1 and clip.pose(-3).translation[0] == 0
    for wrong in (0, -1, np.nan):
        with pytest.raises(MirrorScanError, match="is not possible"):
            clip.resampled(wrong)


def test_a_walking_loop_walks_on_between_its_last_frame_and_its_first():
    clip = make_clip("walk", skeleton())
    fine = clip.resampled(240)
    assert len(fine) == pytest.approx(240 * clip.duration, abs=1)
    steps = np.linalg.norm(np.diff(fine.translations[:, :2], axis=0), axis=1)
    assert steps.max() < 3 * np.median(steps)


def test_a_loop_is_cut_where_it_comes_round():
    time = np.arange(100) / 30
    swing = 0.5 * np.sin(2 * np.pi * time)  # a round is 30 frames: 90 of 100 are three
    turns = np.tile(Rotation.from_euler("x", swing[:, None]).as_matrix()[:, None], (1, 22, 1, 1))
    loop = Clip("swing", 30.0, turns, np.zeros((100, 3))).looped()
    assert loop.loops and len(loop) == 90
    assert apart(loop.rotations[-1], loop.rotations[0]).max() < 8
