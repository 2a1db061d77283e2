"""Scans with ``Settings.skeleton``: joints where the mannequin has them, weights that pose it, or why not."""

from __future__ import annotations

import numpy as np
import pytest
from mirror_scan.core.avatar.pose import bone_matrices, skinned
from mirror_scan.core.avatar.skeleton import BONES
from mirror_scan.core.avatar.skin_weights import limbs_apart
from mirror_scan.core.mesh.soundness import connectivity
from mirror_scan.core.pipeline import Settings, reconstruct
from mirror_scan.core.simulation.mannequin import rigged_mannequin
from mirror_scan.core.subject.subject_views import ViewSettings


@pytest.fixture(scope="module")
def rigged(simulated):
    return reconstruct(simulated("azure_kinect").capture, settings=Settings(skeleton=True))


def test_joints_and_weights_are_the_persons(simulated, rigged):
    truth = simulated("azure_kinect").truth
    joints = (
        rigged_mannequin(resolution=0.012)[1]
        .transformed(rigged.camera_to_avatar @ np.linalg.inv(truth.camera_to_avatar))
        .joints
    )
    apart = 1e3 * np.linalg.norm(rigged.skeleton.joints - joints, axis=1)
    assert np.median(apart) < 20 and apart.max() < 60
    assert ((rigged.skeleton.confidence >= 0) & (rigged.skeleton.confidence <= 1)).all()
    assert len(rigged.weights.index) == len(rigged.mesh.vertices) == rigged.report["mesh"]["vertices"]
    found = rigged.report["skeleton"]
    np.testing.assert_array_equal([found["joints"][name] for name in BONES], rigged.skeleton.joints)
    np.testing.assert_array_equal([found["confidence"][name] for name in BONES], rigged.skeleton.confidence)
    assert rigged.report["timings_ms"]["skeleton"] > 0


def test_the_mesh_stays_as_it_was_but_for_finer_fills(reconstructed, rigged):
    plain = reconstructed("azure_kinect")
    count = len(plain.mesh.vertices)
    np.testing.assert_array_equal(rigged.mesh.vertices[:count], plain.mesh.vertices)
    assert len(rigged.mesh.vertices) > count and plain.skeleton is plain.weights is None
    assert "skeleton" not in plain.report
    checked = connectivity(rigged.mesh)
    assert checked["watertight"] and checked["manifold"] and checked["components"] == 1


def test_limbs_can_be_moved_without_webs(rigged):
    mesh = rigged.mesh
    moved = skinned(mesh.vertices, rigged.weights, bone_matrices(rigged.skeleton, limbs_apart(rigged.skeleton)))
    ends = mesh.triangles, np.roll(mesh.triangles, -1, axis=1)
    before, after = (np.linalg.norm(v[ends[0]] - v[ends[1]], axis=2) for v in (mesh.vertices, moved))
    assert (after / np.maximum(before, 1e-3)).max() < 4.0


def test_either_frame_holds_the_same_skeleton(simulated, rigged):
    there = reconstruct(simulated("azure_kinect").capture, settings=Settings(skeleton=True), frame="camera")
    moved = there.skeleton.transformed(there.camera_to_avatar)
    np.testing.assert_allclose(moved.joints, rigged.skeleton.joints, atol=1e-9)
    np.testing.assert_array_equal(there.weights.index, rigged.weights.index)


def test_an_object_gets_none_and_is_told_why(simulated):
    thing = reconstruct(
        simulated("azure_kinect").capture, settings=Settings(skeleton=True, views=ViewSettings(object=True))
    )
    assert thing.skeleton is thing.weights is None and "skeleton" not in thing.report
    assert sum("skeleton" in warning for warning in thing.warnings) == 1
