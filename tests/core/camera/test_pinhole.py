"""The pinhole model against its own inverse and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.camera import Intrinsics, project, unproject
from mirror_scan.core.errors import CaptureError

focal = st.floats(50, 2000)
center = st.floats(-300, 300)


@settings(max_examples=40, deadline=None)
@given(
    st.integers(1, 9), st.integers(1, 9), focal, focal, center, center, st.integers(0, 2**32 - 1), st.floats(0.01, 50)
)
def test_project_undoes_unproject(width, height, fx, fy, cx, cy, seed, scale):
    intrinsics = Intrinsics(width, height, fx, fy, cx, cy)
    depth = (np.random.default_rng(seed).uniform(0.1, 1.0, (height, width)) * scale).astype(np.float32)
    depth.flat[::3] = 0
    points = unproject(depth, intrinsics)
    assert points.shape == (height, width, 3) and points.dtype == np.float64
    assert (points[depth == 0] == 0).all()
    np.testing.assert_array_equal(points[..., 2], depth)
    pixels = project(points, intrinsics)
    assert np.isnan(pixels[depth == 0]).all()
    v, u = np.nonzero(depth)
    np.testing.assert_allclose(pixels[v, u], np.column_stack((u, v)), atol=1e-9)


def test_a_tilted_plane_unprojects_to_a_plane():
    intrinsics = Intrinsics(64, 48, 70.0, 60.0, 30.0, 25.0)
    normal, offset = np.array([0.3, -0.2, 0.93]), 2.0
    v, u = np.mgrid[:48, :64]
    rays = np.stack(((u - 30.0) / 70.0, (v - 25.0) / 60.0, np.ones((48, 64))), axis=-1)
    points = unproject(offset / (rays @ normal), intrinsics)
    np.testing.assert_allclose(points @ normal, offset, rtol=1e-13)


def test_behind_the_camera_is_no_pixel():
    intrinsics = Intrinsics(64, 48, 70.0, 60.0, 30.0, 25.0)
    points = np.array([[[0.1, 0, 1], [0, 0, -1]], [[0, 0, 0], [np.nan, 0, 1]]])
    pixels = project(points, intrinsics)
    assert pixels.shape == (2, 2, 2)
    np.testing.assert_allclose(pixels[0, 0], (37, 25))
    assert np.isnan(pixels[[0, 1, 1], [1, 0, 1], 0]).all()


def test_scaled_camera_sees_the_same_through_other_pixels():
    intrinsics = Intrinsics(640, 480, 585.0, 580.0, 317.0, 242.0)
    small = intrinsics.scaled(160, 240)
    points = np.random.default_rng(0).uniform((-1, -1, 1), (1, 1, 4), (50, 3))
    # edges of the image, half a pixel off the outermost centres, stay edges
    np.testing.assert_allclose(
        project(points, small) + 0.5, (project(points, intrinsics) + 0.5) * (160 / 640, 240 / 480)
    )
    assert (small.width, small.height) == (160, 240)


@pytest.mark.parametrize(
    "values",
    [
        (0, 48, 70, 60, 30, 25), (64, -1, 70, 60, 30, 25), (64, 48, 0, 60, 30, 25), (64, 48, 70, -60, 30, 25),
        (64, 48, np.nan, 60, 30, 25), (64, 48, 70, np.inf, 30, 25), (64, 48, 70, 60, np.nan, 25),
        (64, 48, 70, 60, 30, -np.inf),
    ],
)  # fmt: skip
def test_impossible_intrinsics(values):
    with pytest.raises(CaptureError, match="intrinsics"):
        Intrinsics(*values)
