"""Registration of two views: analytic surfaces whose pose is known, and what is said without a package."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest
from mirror_scan.core.errors import MirrorScanError, ReconstructionError
from mirror_scan.core.numeric.rotations import from_vectors, to_vectors
from mirror_scan.core.registration import pairwise
from mirror_scan.core.registration.pairwise import BACKENDS, IcpSettings, Registration, find_backend, register

RADII = np.array([0.22, 0.15, 0.5])


def ellipsoid(rng, count=9000):
    """Points of an ellipsoid with no rotational symmetry: a closed form, so that only sampling differs."""
    points = rng.standard_normal((count, 3))
    return RADII * points / np.linalg.norm(points, axis=1)[:, None]


def moved(points, pose):
    return points @ pose[:3, :3].T + pose[:3, 3]


@pytest.fixture(params=BACKENDS)
def backend(request):
    if importlib.util.find_spec(request.param) is None:
        pytest.skip(f"{request.param} is not installed")
    return request.param


def test_a_known_pose_is_found(backend):
    rng = np.random.default_rng(0)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = from_vectors(np.array([0.08, -0.06, 0.1])), (0.03, -0.02, 0.04)
    # half of it each, as from two sides, with two thirds in common
    whole, other = ellipsoid(rng), ellipsoid(rng)
    source, target = whole[whole[:, 1] < 0.09], moved(other[other[:, 1] > -0.09], pose)
    whole_result = register(whole, moved(other, pose), settings=IcpSettings(backend=backend))
    part = register(source, target, settings=IcpSettings(backend=backend))
    for found, tolerance in ((whole_result, 1e-3), (part, 4e-3)):
        assert np.linalg.norm(to_vectors(pose[:3, :3].T @ found.pose[:3, :3])) < 2 * tolerance
        assert np.linalg.norm(found.pose[:3, 3] - pose[:3, 3]) < tolerance
        np.testing.assert_allclose(found.pose[:3, :3] @ found.pose[:3, :3].T, np.eye(3), atol=1e-12)
    assert whole_result.overlap > 0.9 and whole_result.residual < 3e-3
    assert 0.2 < part.overlap < 0.9


def test_noise_is_the_residual(backend):
    rng = np.random.default_rng(1)
    noise = 0.003
    walls = np.eye(3)[np.arange(60_000) % 3]  # of a corner: a plane alone does not tell how it lies
    a = rng.uniform(-0.5, 0.5, (60_000, 3)) * (1 - walls) + noise * rng.standard_normal((60_000, 1)) * walls
    b = rng.uniform(-0.5, 0.5, (60_000, 3)) * (1 - walls) + (0, 0, 0.01)
    found = register(a, b, settings=IcpSettings(spacing=0.004, reach=(0.05,), iterations=3, backend=backend))
    # the walls are found, noise is left: a little less of it where points share a cube
    assert 0.8 * noise < found.residual < 1.02 * noise and found.overlap > 0.99
    assert found.pose[2, 3] == pytest.approx(0.01, abs=2e-4)


def test_views_with_nothing_in_common(backend):
    rng = np.random.default_rng(2)
    points = ellipsoid(rng, 2000)
    with pytest.raises(ReconstructionError, match="no surface in common"):
        register(points, points + 3.0, settings=IcpSettings(backend=backend))
    for bad in (points[:10], points[:, :2], np.full((100, 3), np.nan)):
        with pytest.raises(MirrorScanError, match="first of two views"):
            register(bad, points, settings=IcpSettings(backend=backend))


def test_without_a_package_one_is_named(monkeypatch):
    monkeypatch.setattr(pairwise.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MirrorScanError, match="pip install small_gicp"):
        find_backend()
    with pytest.raises(MirrorScanError, match="pip install open3d"):
        register(np.zeros((100, 3)), np.zeros((100, 3)), settings=IcpSettings(backend="open3d"))
    with pytest.raises(MirrorScanError, match="choose one of small_gicp, open3d"):
        find_backend("pcl")


def test_a_package_that_does_not_start_is_named(monkeypatch):
    def start(name):
        if name == "small_gicp":
            raise OSError("libgomp.so.1: cannot open shared object file")

    monkeypatch.setattr(pairwise.importlib.util, "find_spec", lambda name: name)
    monkeypatch.setattr(pairwise.importlib, "import_module", start)
    assert find_backend() == "open3d"
    with pytest.raises(MirrorScanError, match="does not start .libgomp.*or open3d instead"):
        find_backend("small_gicp")


def test_misfit_counts_points_without_a_partner():
    assert Registration(np.eye(4), 0.003, 1.0).misfit(0.02) == pytest.approx(0.003)
    assert Registration(np.eye(4), 0.0, 0.0).misfit(0.02) == pytest.approx(0.02)
    assert Registration(np.eye(4), 0.006, 0.5).misfit(0.008) == pytest.approx(np.sqrt(0.5 * 36e-6 + 0.5 * 64e-6))
