"""Distances and alignment against closed forms, MeshLab and the scorer the figures are quoted by."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from meshes import lopsided, ours, sphere
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.surface_distance import (
    evaluate,
    hausdorff,
    rigid_alignment,
    sample_surface,
    surface_distance,
)

trimesh = pytest.importorskip("trimesh")
SHARED = Path(__file__).resolve().parents[4] / "shared"


def small_motion():
    motion = trimesh.transformations.rotation_matrix(0.015, [1, -2, 0.5])
    motion[:3, 3] = 0.012, -0.008, 0.01
    return motion


def test_distance_between_a_plate_and_a_parallel_plane():
    plate = Mesh(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    wide = Mesh(plate.vertices * 9 - [4, 4, -0.01], plate.triangles)
    found = surface_distance(plate, wide, 1000)
    assert [found.mean, found.rms, found.p95, found.max] == pytest.approx([0.01] * 4)
    # back from the wide plate: farthest at its corners, four edge lengths away along both axes
    assert surface_distance(wide, plate, 1000).max == pytest.approx(np.sqrt(4**2 + 4**2 + 0.01**2))
    assert hausdorff(plate, wide, 1000) == hausdorff(wide, plate, 1000) == surface_distance(wide, plate, 1000).max


def test_distance_between_spheres_agrees_with_closed_form_and_meshlab():
    inner, outer = sphere(1.0, (0.05, 0, 0)), sphere(1.2)
    found = surface_distance(ours(inner), ours(outer), 50_000)
    # distance 1.2 - |x| over the shifted sphere; E|x| = 1 + d²/3, E x² = 1 + d²
    assert found.mean == pytest.approx(0.2 - 0.05**2 / 3, abs=1e-3)
    assert found.max == pytest.approx(0.25, abs=1e-3)
    again = surface_distance(ours(inner), ours(outer), 50_000)
    assert found == again and found != surface_distance(ours(inner), ours(outer), 50_000, seed=1)

    pymeshlab = pytest.importorskip("pymeshlab")
    scene = pymeshlab.MeshSet()
    for mesh in (inner, outer):
        scene.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    theirs = scene.get_hausdorff_distance(
        sampledmesh=0, targetmesh=1, samplenum=50_000, maxdist=pymeshlab.PercentageValue(100)
    )
    assert found.mean == pytest.approx(theirs["mean"], rel=2e-3)
    assert found.rms == pytest.approx(theirs["RMS"], rel=2e-3)
    assert found.max == pytest.approx(theirs["max"], rel=2e-3)


def test_samples_are_uniform_by_area():
    # a triangle a hundred times the other, and one without area between them
    vertices = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [20, 0, 0], [21, 0, 0], [20, 1, 0.0]])
    mesh = Mesh(vertices, np.array([[0, 1, 2], [0, 0, 1], [3, 4, 5]], np.int32))
    points, triangle = sample_surface(mesh, 10_100)
    assert np.abs(np.bincount(triangle) - [10_000, 0, 100]).max() <= 1
    np.testing.assert_allclose(points[triangle == 0].mean(axis=0), [10 / 3, 10 / 3, 0], atol=0.1)
    assert (points[triangle == 0][:, :2].sum(axis=1) <= 10 + 1e-9).all()


def test_alignment_finds_a_small_motion_despite_parts_of_its_own():
    truth = lopsided()
    motion = small_motion()
    moved = truth.copy()
    moved.apply_transform(np.linalg.inv(motion))
    both = moved + sphere(0.15, (0.9, 0, 0.5), 3)  # a blob the truth does not have must not pull
    found = rigid_alignment(ours(both), ours(truth), samples=5000)
    np.testing.assert_allclose(found, motion, atol=2e-4)
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1)
    # a sphere on itself: its turn is free, and must stay none
    np.testing.assert_allclose(rigid_alignment(ours(sphere()), ours(sphere()), samples=2000), np.eye(4), atol=1e-3)
    with pytest.raises(MirrorScanError, match="same frame"):
        rigid_alignment(ours(truth), ours(sphere(0.1, (9, 9, 9))), samples=1000)


def test_bad_meshes_are_refused():
    good = ours(sphere(level=1))
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    for bad in (empty, Mesh(np.full((3, 3), np.nan), np.int32([[0, 1, 2]]))):
        with pytest.raises(MirrorScanError):
            surface_distance(good, bad)
        with pytest.raises(MirrorScanError):
            surface_distance(bad, good)
    with pytest.raises(MirrorScanError, match="area"):
        surface_distance(Mesh(np.ones((3, 3)), np.int32([[0, 1, 2]])), good)


def test_evaluation_of_a_swollen_and_moved_body():
    truth = lopsided()
    swollen = truth.copy()
    swollen.vertices = truth.vertices + 0.002 * truth.vertex_normals
    swollen.apply_transform(np.linalg.inv(small_motion()))
    found = evaluate(ours(swollen), ours(truth), samples=20_000)
    assert found["accuracy_mean"] == pytest.approx(2, abs=0.05) and found["complete_mean"] == pytest.approx(2, abs=0.05)
    assert found["hausdorff"] == max(found["accuracy_max"], found["complete_max"]) < 3
    assert found["volume_error_pct"] == pytest.approx((swollen.volume / truth.volume - 1) * 100)
    assert found["watertight"] and found["components"] == 1 and found["self_intersecting_faces"] == 0
    assert evaluate(ours(swollen), ours(truth), align=False, samples=20_000)["accuracy_mean"] > 5


def test_evaluation_agrees_with_the_scorer():
    """The scorer aligns by sampled points, ours by the surface itself; hence tolerances of some hundredths."""
    path = SHARED / "tools" / "score.py"
    if not path.exists():
        pytest.skip("score.py is not here")
    spec = importlib.util.spec_from_file_location("score", path)
    scorer = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(scorer)
    except ImportError as error:
        pytest.skip(f"score.py cannot run here: {error}")
    truth = lopsided()
    noisy = truth.copy()
    bump = 0.004 * np.sin(20 * truth.vertices[:, [2]])
    noisy.vertices = truth.vertices + bump * truth.vertex_normals
    noisy.apply_transform(np.linalg.inv(small_motion()))
    noisy = trimesh.Trimesh(noisy.vertices, noisy.faces[:-5], process=False)
    theirs, found = scorer.score(noisy, truth), evaluate(ours(noisy), ours(truth))
    assert set(found) == set(theirs)
    for name, value in theirs.items():
        if name.endswith(("_mean", "_p95", "_max", "hausdorff", "_mm")):
            assert found[name] == pytest.approx(value, rel=0.05, abs=0.05), name
        else:
            assert found[name] == value, name
