"""Joints are followed through bodies whose poses are known."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.avatar.pose import Pose, bone_matrices, posed_joints, skinned
from mirror_scan.core.avatar.skin_weights import skinned_mesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.motion import make_clip
from mirror_scan.core.numeric.rotations import between
from mirror_scan.core.sequences.skeleton_tracking import RiggedFrame, smoothed, track
from mirror_scan.core.simulation.mannequin import rigged_mannequin


@pytest.fixture(scope="module")
def rigged():
    body, skeleton = rigged_mannequin(resolution=0.02)
    mesh, weights = skinned_mesh(Mesh(body.vertices, body.triangles), skeleton)
    return RiggedFrame(0, mesh, skeleton, weights, np.array((0.1, -0.2, 0.0)))


def test_joints_are_followed(rigged):
    """From the rest pose into a squat in five frames, one of them lost; a mesh says only where the surface is."""
    deep = make_clip("squat", rigged.skeleton)
    lowest = deep.pose(int(np.argmin(deep.translations[:, 2])))

    def pose_at(place):
        share = 0.15 * place
        rotations = between(np.tile(np.eye(3), (22, 1, 1)), lowest.rotations, share)
        return Pose(rotations, share * lowest.translation)

    def mesh_at(place):
        matrices = bone_matrices(rigged.skeleton, pose_at(place))
        vertices = skinned(rigged.mesh.vertices, rigged.weights, matrices) - rigged.shift
        order = np.random.default_rng(place).permutation(len(vertices))
        return Mesh(vertices[order], np.argsort(order)[rigged.mesh.triangles].astype(np.int32))

    made, residual = track(rigged, [0, 1, 2, 4], mesh_at, 12.0)
    assert len(made) == 5 and len(residual) == 4
    true = np.stack([posed_joints(rigged.skeleton, pose_at(place)) for place in range(5)])
    off = np.linalg.norm(made.joints(rigged.skeleton) - true, axis=2)
    assert np.linalg.norm(true[-1] - true[0], axis=1).max() > 0.15
    assert off.mean() < 0.01


def test_smoothing_keeps_what_does_not_change():
    rotations = np.tile(np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0], (5, 22, 1, 1))
    rotations *= np.linalg.det(rotations)[..., None, None]
    kept, moved = smoothed(rotations, np.ones((5, 3)))
    np.testing.assert_allclose(kept, rotations, atol=1e-12)
    np.testing.assert_array_equal(moved, np.ones((5, 3)))
