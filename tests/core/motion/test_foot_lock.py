"""Feet stand on the floor and stay where they stand; knees and headings hardly change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.avatar.pose import SkinWeights
from mirror_scan.core.avatar.skeleton import BONES
from mirror_scan.core.motion import make_clip, sole_points
from mirror_scan.core.motion.foot_lock import _sole_places, estimated_soles, lock_feet, stand_on_floor
from motion_figures import angles, apart, skeleton


def _knees(clip):
    joints = clip.joints(skeleton())
    out = []
    for side in ("Left", "Right"):
        hip, knee, ankle = (joints[:, BONES.index(side + part)] for part in ("UpLeg", "Leg", "Foot"))
        out.append(angles(knee - hip, ankle - knee))
    return np.array(out)


def _soles(clip):
    return _sole_places(clip, skeleton(), estimated_soles(skeleton()))


def _disturbed(clip, seed: int):
    """The clip as a capture has it: on a wrong height that drifts, feet that slide, knees a little off."""
    rng = np.random.default_rng(seed)
    time = np.arange(len(clip)) / clip.rate
    slide = 0.03 * np.sin(2 * time + rng.uniform(0, 6)) * [[1.0], [0.7], [0]]
    height = 0.4 + 0.012 * np.sin(3 * time)
    moved = clip.translations + slide.T + height[:, None] * [0, 0, 1.0]
    return replace(clip, translations=moved, loops=False)


@pytest.mark.parametrize("name", ["walk", "squat", "turn", "idle"])
def test_a_disturbed_clip_stands_again(name):
    clip = make_clip(name, skeleton())
    if name == "walk":
        clip = replace(clip, rotations=np.tile(clip.rotations, (3, 1, 1, 1)), loops=False,
                       translations=np.concatenate([clip.translations + k * (clip.translations[-1] + [*clip._step(), 0])
                                                    for k in range(3)]))  # fmt: skip
    locked = lock_feet(_disturbed(clip, 5), skeleton())
    points = _soles(locked)
    assert points[..., 2].min() > -0.005
    assert np.abs(_knees(locked) - _knees(clip)).max() < 1.0
    # Where the undisturbed feet stand still for long, so do the locked ones.
    truth = _soles(clip)
    ball = truth[:, :, 2:4].mean(axis=2)
    still = (np.linalg.norm(np.gradient(ball, axis=0), axis=-1) * clip.rate < 0.05) & (
        truth[..., 2].min(axis=2) < 0.005
    )
    for side in range(2):
        at = np.flatnonzero(still[:, side])
        for step in np.split(at, np.flatnonzero(np.diff(at) > 1) + 1):
            if len(step) > 6:
                own = points[step[2:-2], side][:, 2:4, :2].mean(axis=1)
                assert np.linalg.norm(own - own[0], axis=1).max() < 0.010


def test_a_clip_that_stands_already_is_left_alone():
    clip = make_clip("squat", skeleton())
    locked = lock_feet(clip, skeleton())
    assert np.abs(locked.translations - clip.translations).max() < 0.006
    assert apart(locked.rotations, clip.rotations).max() < 1.5


def test_a_jump_stays_in_the_air():
    clip = make_clip("idle", skeleton())
    time = np.arange(len(clip)) / clip.rate
    rise = np.maximum(0, 3.0 * (time - 2) - 4.9 * (time - 2) ** 2)
    jump = replace(clip, translations=clip.translations + rise[:, None] * [0, 0, 1.0], loops=False)
    locked = lock_feet(jump, skeleton())
    assert np.abs(locked.translations[:, 2] - jump.translations[:, 2]).max() < 0.03


def test_the_floor_that_a_suit_lost_is_found_again():
    clip = make_clip("turn", skeleton())
    drift = np.linspace(0, 0.12, len(clip))
    lost = replace(clip, translations=clip.translations + drift[:, None] * [0, 0, 1.0], loops=False)
    lowest = _soles(lock_feet(lost, skeleton()))[..., 2].min(axis=(1, 2))
    assert np.abs(lowest).max() < 0.012


def test_the_whole_clip_is_put_on_the_floor_without_another_change():
    clip = make_clip("walk", skeleton())
    lifted = replace(clip, translations=clip.translations + [0, 0, 0.7])
    placed = stand_on_floor(lifted, skeleton())
    np.testing.assert_array_equal(placed.rotations, clip.rotations)
    assert np.ptp(placed.translations - clip.translations, axis=0) == pytest.approx(0, abs=1e-12)
    assert abs(_soles(placed)[..., 2].min()) < 0.01


def test_soles_of_a_skin_are_its_outermost_low_points():
    person = skeleton()
    rng = np.random.default_rng(8)
    vertices, index = [], []
    for side in ("Left", "Right"):
        ankle, toe = person.joints[BONES.index(f"{side}Foot")], person.joints[BONES.index(f"{side}ToeBase")]
        for along in (0.0, 1.2):
            shoe = ankle + along * (toe - ankle) + rng.uniform([-0.04, -0.05, -0.5], [0.04, 0.05, 0.3], (400, 3)) * 0.9
            shoe[:, 2] = np.abs(shoe[:, 2]) * 0.2
            vertices.append(shoe)
            index.append(np.full(400, BONES.index(f"{side}Foot" if along == 0 else f"{side}ToeBase")))
    vertices, index = np.concatenate(vertices), np.concatenate(index)
    weights = SkinWeights(np.stack([index] + [np.zeros_like(index)] * 3, axis=1).astype(np.uint8),
                          np.tile(np.array([1, 0, 0, 0], np.float32), (len(index), 1)))  # fmt: skip
    soles = sole_points(vertices, weights, person)
    assert soles.points.shape[0] == 2 and soles.weights.shape == (*soles.points.shape[:2], 22)
    np.testing.assert_allclose(soles.weights.sum(axis=-1), 1)
    for side, sign in enumerate((1, -1)):
        own = vertices[np.sign(vertices[:, 0]) == sign]
        assert soles.points[side, :, 2].min() == own[:, 2].min()
        assert soles.points[side, :, 1].min() == pytest.approx(own[:, 1].min(), abs=0.005)
