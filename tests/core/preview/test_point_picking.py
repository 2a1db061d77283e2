"""Clicks on a cloud mean what a person means by them."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.preview.point_picking import Picture, project_to_picture

SIZE = (800, 600)


def perspective(near=0.1, far=100.0, focal=1.8):
    aspect = SIZE[0] / SIZE[1]
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 1] = focal / aspect, focal
    matrix[2, 2], matrix[2, 3] = -(far + near) / (far - near), -2 * far * near / (far - near)
    matrix[3, 2] = -1
    return matrix


def parallel(scale=3.0, far=100.0):
    aspect = SIZE[0] / SIZE[1]
    return np.diag((1 / scale / aspect, 1 / scale, -2 / far, 1.0))


def eye(distance=5.0, turn=0.4):
    view = np.eye(4)
    c, s = np.cos(turn), np.sin(turn)
    view[:3, :3] = ((c, 0, s), (0, 1, 0), (-s, 0, c))
    view[2, 3] = -distance
    return view


def sphere(count, seed=0):
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return (points / np.linalg.norm(points, axis=1)[:, None]).astype(np.float32)


@pytest.mark.parametrize("projection", [perspective(), parallel()], ids=["perspective", "parallel"])
def test_a_click_on_a_sphere_hits_its_near_side(projection):
    points, view = sphere(60_000), eye()
    camera = np.linalg.inv(view)[:3, 3]
    toward = np.linalg.inv(view)[:3, 2]
    # true places on the side that faces the viewer, seen steeply enough not to be the rim
    truth = sphere(400, 1).astype(float)
    facing = truth @ toward if projection[3, 3] else np.einsum("ij,ij->i", truth, camera - truth)
    truth = truth[facing > 0.6 * (1 if projection[3, 3] else 5)]
    pixels = project_to_picture(truth, projection @ view, SIZE)
    picture = Picture(points, view, projection, SIZE)
    for place, pixel in zip(truth[:60], pixels[:60], strict=True):
        index = picture.pick(pixel)
        assert np.linalg.norm(points[index] - place) < 0.1


def test_what_lies_behind_is_not_reached_through_gaps():
    front = np.array([[0.02, 0.0, 0.0]], np.float32)
    behind = np.array([[0.0, 0.0, -2.0]], np.float32)  # exactly under the mouse, but behind
    view = eye(turn=0.0)
    assert Picture(np.concatenate((behind, front)), view, perspective(), SIZE).pick((400, 300)) == 1
    assert Picture(behind, view, perspective(), SIZE).pick((400, 300)) == 0


def test_empty_space_and_ugly_input_mean_nothing():
    view = eye(turn=0.0)
    points = np.array([[0, 0, 0], [np.nan, 0, 0], [0, 0, 9], [np.inf, 0, 0]], np.float32)  # the third is behind us
    picture = Picture(points, view, perspective(), SIZE)
    assert picture.pick((400, 300)) == 0
    assert picture.pick((100, 100)) is None
    assert Picture(np.zeros((0, 3), np.float32), view, perspective(), SIZE).pick((400, 300)) is None
    assert np.isnan(project_to_picture(points, perspective() @ view, SIZE)[2]).all()
