"""Views round a body whose poses are known: their order becomes poses, contradictions become an error."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest
from mirror_scan.core.errors import ReconstructionError
from mirror_scan.core.numeric.rotations import about_axis, to_vectors
from mirror_scan.core.registration.turntable import (
    SubjectView,
    even_angles,
    guessed_poses,
    paired_views,
    register_turntable,
)

needs_icp = pytest.mark.skipif(
    all(importlib.util.find_spec(name) is None for name in ("small_gicp", "open3d")),
    reason="neither small_gicp nor open3d is installed",
)

CAMERA_UP = np.array([0.0, -1.0, 0.0])
HIGH = 0.9
"""The camera over the floor [m]."""


def seen(body, turn_deg, away=2.5):
    """What a level camera sees of a body turned to its left, and its pose: camera frame → the body's (z up)."""
    pose = np.eye(4)
    pose[:3, :3] = about_axis(2, np.radians(-turn_deg)) @ np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    pose[:3, 3] = about_axis(2, np.radians(-turn_deg)) @ (0.0, -away, HIGH)
    to_camera = np.linalg.inv(pose)
    vertices = body.vertices @ to_camera[:3, :3].T + to_camera[:3, 3]
    p, q, s = (vertices[body.triangles[:, k]] for k in range(3))
    normal = np.cross(q - p, s - p)
    facing = (normal * p).sum(axis=1) < -0.25 * np.linalg.norm(normal, axis=1) * np.linalg.norm(p, axis=1)
    used, renumbered = np.unique(body.triangles[facing], return_inverse=True)
    return SubjectView(vertices[used], renumbered.reshape(-1, 3), CAMERA_UP, -HIGH), pose


def worst(found, poses, views):
    """The largest error of a pose [m], in the middle of what its view shows, and of its rotation [rad]."""
    wanted = np.linalg.inv(poses[0]) @ np.array(poses)
    gap = [np.linalg.norm((f - w)[:3, :3] @ v.vertices.mean(axis=0) + (f - w)[:3, 3])
           for f, w, v in zip(found, wanted, views, strict=True)]  # fmt: skip
    turn = [np.linalg.norm(to_vectors(f[:3, :3].T @ w[:3, :3])) for f, w in zip(found, wanted, strict=True)]
    return max(gap), max(turn)


def test_guesses_follow_the_order(person):
    made = [seen(person, angle) for angle in even_angles(6)]
    views, poses = [v for v, _ in made], [p for _, p in made]
    gap, turn = worst(guessed_poses(views, even_angles(6)), poses, views)
    assert turn < 1e-9 and gap < 0.12
    assert paired_views(even_angles(8)) == sorted(
        {(min(k, (k + s) % 8), max(k, (k + s) % 8)) for k in range(8) for s in (1, 2)}
    )
    assert paired_views(np.array([0.0, 130.0])) == []
    assert paired_views(np.array([0.0, 90.0])) == [(0, 1)]


@needs_icp
@pytest.mark.slow
def test_poses_are_found_from_the_order(person):
    made = [seen(person, -angle) for angle in even_angles(8)]
    views, poses = [v for v, _ in made], [p for _, p in made]
    found = register_turntable(views, -45.0)
    gap, turn = worst(found.poses, poses, views)
    assert gap < 3e-3 and turn < 0.01, (gap, turn)
    assert found.shifted.max() < 5e-3 and found.notes == ()
    with pytest.raises(ReconstructionError, match=r"captures|too little in common"):
        register_turntable([views[k] for k in (0, 3, 1, 6, 2, 5)], -60.0)


@needs_icp
def test_what_is_no_turntable(person):
    view = seen(person, 0.0)[0]
    with pytest.raises(ReconstructionError, match="give several"):
        register_turntable([view])
    with pytest.raises(ReconstructionError, match="give 1° to 180°"):
        register_turntable([view, view], 0.2)
