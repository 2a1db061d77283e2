"""Rotations against scipy's, at the edges too."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.numeric import rotations
from scipy.spatial.transform import Rotation


@pytest.mark.parametrize("order", ["ZYX", "XYZ", "YXZ", "ZXY", "Y", "ZX"])
def test_euler_angles_are_intrinsic_in_the_order_given(order):
    angles = np.random.default_rng(1).uniform(-np.pi, np.pi, (40, len(order)))
    truth = Rotation.from_euler(order, angles if len(order) > 1 else angles[:, :1]).as_matrix()
    np.testing.assert_allclose(rotations.from_euler(order, angles), truth, atol=1e-12)


def test_angles_of_rotations_give_them_back_also_at_the_pole():
    turns = Rotation.random(50, random_state=2).as_matrix()
    pole = Rotation.from_euler("ZYX", [[0.3, np.pi / 2, 0.7], [0.3, -np.pi / 2, 0.7]]).as_matrix()
    for matrices in (turns, pole):
        again = rotations.from_euler("ZYX", rotations.euler_zyx(matrices))
        np.testing.assert_allclose(again, matrices, atol=1e-7)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.4, 3.0, np.pi - 1e-7, np.pi])
def test_rotation_vectors_there_and_back(angle):
    axes = rotations.unit(np.random.default_rng(3).normal(size=(30, 3)))
    turns = rotations.from_vectors(axes * angle)
    np.testing.assert_allclose(turns, Rotation.from_rotvec(axes * angle).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(rotations.from_vectors(rotations.to_vectors(turns)), turns, atol=1e-7)


def test_shortest_turn_takes_one_direction_to_the_other_and_never_further():
    rng = np.random.default_rng(4)
    start, end = rotations.unit(rng.normal(size=(2, 60, 3)))
    end[0], end[1] = start[0], -start[1]
    turns = rotations.shortest_turn(start, end)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", turns, start), end, atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(turns), 1)
    angle = np.degrees(Rotation.from_matrix(turns).magnitude())
    np.testing.assert_allclose(angle, np.degrees(np.arccos(np.clip((start * end).sum(1), -1, 1))), atol=1e-5)


def test_frames_are_right_handed_also_of_parallel_vectors():
    rng = np.random.default_rng(5)
    first, second = rng.normal(size=(2, 20, 3))
    second[:5] = 2 * first[:5]
    made = rotations.frames(first, second)
    np.testing.assert_allclose(np.swapaxes(made, 1, 2) @ made, np.tile(np.eye(3), (20, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(made), 1)
    np.testing.assert_allclose(made[:, :, 0], rotations.unit(first), atol=1e-12)
    assert (np.einsum("ni,ni->n", made[5:, :, 1], second[5:]) > 0).all()


def test_between_goes_half_way_and_twist_forgets_the_swing():
    turns = Rotation.random(40, random_state=6)
    half = rotations.between(np.tile(np.eye(3), (40, 1, 1)), turns.as_matrix(), 0.5)
    np.testing.assert_allclose(half @ half, turns.as_matrix(), atol=1e-6)
    axis = np.array([0.0, 0.6, 0.8])
    swing = Rotation.from_rotvec([0.5, 0.8, -0.6])  # square to the axis
    twist = Rotation.from_rotvec(0.9 * axis)
    assert rotations.twist_angles((swing * twist).as_matrix(), axis) == pytest.approx(0.9)


def test_mean_rotation_is_a_rotation_in_the_middle():
    steps = Rotation.from_rotvec(np.array([[0, 0, -0.2], [0, 0, 0.2], [0.0, 0, 0.3], [0, 0, -0.3]]))
    np.testing.assert_allclose(rotations.mean_rotation(steps.as_matrix()), np.eye(3), atol=1e-12)
