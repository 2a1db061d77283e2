"""A burst's way to one depth map: against a naive twin, and against planes, spheres and steps whose truth is known."""

from __future__ import annotations

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mirror_scan.core.camera import Intrinsics
from mirror_scan.core.camera.noise_models import SENSORS
from mirror_scan.core.capture import Capture
from mirror_scan.core.depth.burst_fusion import fuse_burst
from mirror_scan.core.depth.burst_motion import burst_motion, still_warning
from mirror_scan.core.depth.clean_views import clean
from mirror_scan.core.depth.dequantisation import dequantise, find_step
from mirror_scan.core.depth.disparity_smoothing import smooth_view, smoothing_sigma
from mirror_scan.core.depth.noise_estimate import measure_noise
from mirror_scan.core.depth.outliers_and_dropouts import close_dropouts, remove_flying_pixels
from mirror_scan.core.depth.sensor_recognition import recognise
from mirror_scan.core.depth.settings import DepthSettings
from mirror_scan.core.errors import CaptureError, MirrorScanError

FOCAL = 400.0
V, U = np.mgrid[:90, :120]
RAYS = np.stack(((U - 60.3) / FOCAL, (V - 44.1) / FOCAL, np.ones(U.shape)), axis=-1)


def plane(normal=(0.5, -0.3, 1.0), distance=3.0):
    return distance / (RAYS @ np.asarray(normal, dtype=float))


def sphere(centre=(0.02, -0.01, 3.0), radius=0.5):
    """z of the sphere, 0 beside it; RAYS are not unit vectors, so that their length along z is 1."""
    a, b, c = (RAYS**2).sum(-1), RAYS @ centre, np.dot(centre, centre) - radius**2
    inside = b * b > a * c
    return np.where(inside, (b - np.sqrt(np.where(inside, b * b - a * c, 0))) / a, 0)


def kinect_burst(z, frames, seed=0, baseline=0.075, noise=0.056, step=0.125, focal=585.0):
    """What a structured-light camera reads: its disparity, noisy, then rounded to eighths of a pixel."""
    rng = np.random.default_rng(seed)
    d = focal * baseline / np.where(z > 0, z, np.inf) + noise * rng.normal(size=(frames, *z.shape))
    quantised = np.maximum(np.rint(d / step), 1) * step
    return np.where(z > 0, focal * baseline / quantised, 0).astype(np.float32)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_fusing_against_the_naive_twin(seed, frames):
    """Readings near one surface with mistaken ones among them, never so near the tolerance that rounding decides."""
    rng = np.random.default_rng(seed)
    burst = 2.0 * (1 + 0.005 * rng.normal(size=(frames, 5, 6)))
    wrong = rng.random(burst.shape) < 0.15
    burst[wrong] = rng.choice([0.0, np.nan, -1.0, np.inf, 0.05, 40.0, 1.2, 3.7], wrong.sum())
    burst = burst.astype(np.float32)
    fused, spread = fuse_burst(burst)
    assert fused.shape == spread.shape == (5, 6) and fused.dtype == spread.dtype == np.float32
    limits = DepthSettings()
    for v, u in np.ndindex(5, 6):
        column = burst[:, v, u]
        usable = (column >= limits.min_depth) & (column <= limits.max_depth)
        near = usable & (np.abs(column - 2) < 0.1)
        if 2 * near.sum() <= usable.sum() + 1:
            continue  # no surface has the majority
        expected = naive.fuse(column, limits.min_depth, limits.max_depth, limits.burst_tolerance, limits.burst_share)
        assert fused[v, u] == pytest.approx(expected, rel=1e-6)
        if expected and near.sum() > 1:
            d = 1 / column[near].astype(float)
            assert spread[v, u] == pytest.approx(d.std(ddof=1) / d.mean(), rel=1e-3, abs=2e-6)


def test_fusing_averages_disparity_not_depth():
    fused, _ = fuse_burst(np.array([2.0, 2.1], np.float32).reshape(2, 1, 1))
    assert fused[0, 0] == pytest.approx(2 / (1 / 2.0 + 1 / 2.1))


def test_a_pixel_needs_its_share_of_the_frames():
    burst = np.zeros((10, 1, 3), np.float32)
    burst[:2, 0, 0] = burst[:3, 0, 1] = burst[:, 0, 2] = 1.5
    np.testing.assert_array_equal(fuse_burst(burst)[0], [[0, 1.5, 1.5]])
    np.testing.assert_array_equal(fuse_burst(burst, DepthSettings(burst_share=0.0))[0], [[1.5, 1.5, 1.5]])
    np.testing.assert_array_equal(fuse_burst(burst[:1])[0], [[1.5, 1.5, 1.5]])


@pytest.mark.parametrize(
    "burst",
    [
        np.zeros((3, 4, 5)), np.full((3, 4, 5), np.nan), np.full((3, 4, 5), 0.1), np.full((3, 4, 5), 1500.0),
        np.ones((4, 5)), np.ones((0, 4, 5)), np.ones((2, 0, 5)), np.ones(()),
    ],
)  # fmt: skip
def test_a_burst_of_nothing(burst):
    with pytest.raises(CaptureError, match="depth"):
        fuse_burst(burst)


def smoothed(depth, noise, labels=None):
    options = DepthSettings()
    labels = np.where(depth > 0, 0, -1).astype(np.int8) if labels is None else labels
    sigma = smoothing_sigma(noise, float(np.median(depth[depth > 0])), 1 / FOCAL, options)
    return smooth_view(depth, labels, 0, noise, sigma, options)


def test_smoothing_keeps_a_plane_a_plane():
    depth = plane().astype(np.float32)
    out = smoothed(depth, 0.004)
    error = np.abs(out / depth - 1)
    inner = error[10:-10, 10:-10]
    assert inner.max() < 5e-7, "float32 keeps about seven digits"
    assert error.max() < 2e-4, "windows cut by the edge of the image are held a little"


@pytest.mark.parametrize(("name", "truth"), [("plane", plane()), ("sphere", sphere())])
def test_smoothing_a_kinect_burst(name, truth):
    burst = kinect_burst(truth, 10, seed=3)
    fused = fuse_burst(burst)[0]
    labels = np.where(fused > 0, 0, -1).astype(np.int8)
    noise = measure_noise(fused, labels, 1)[0]
    out = smoothed(fused, noise)
    slant = 0.0 if name == "plane" else 0.985  # at the sphere's outermost rim depth runs away
    rays = RAYS / np.linalg.norm(RAYS, axis=-1, keepdims=True)
    frontal = np.ones(truth.shape, bool)
    if name == "sphere":
        points = RAYS * truth[..., None]
        normals = (points - (0.02, -0.01, 3.0)) / 0.5
        frontal = (truth > 0) & (-(normals * rays).sum(-1) > np.sqrt(1 - slant**2))
    error = [1e3 * np.sqrt(np.mean((z - truth)[frontal & (z > 0)] ** 2)) for z in (burst[0], fused, out)]
    print(f"\n{name} at 3 m: one frame {error[0]:.2f} mm, ten fused {error[1]:.2f} mm, smoothed {error[2]:.2f} mm")
    assert error[2] < error[0] / 8 and error[2] < error[1] / 3


def step_bias(jump, noise):
    """Mean error [m] of the columns beside a step in a frontal plane, by distance from it: lower side first."""
    rows = 400
    step = np.tile(np.where(np.arange(120) < 60, 2.5, 2.5 + jump), (rows, 1))
    depth = (step * (1 + noise * np.random.default_rng(0).normal(size=step.shape))).astype(np.float32)
    out = smoothed(depth, noise)
    assert np.abs(out - step).max() < 0.06 * jump + 4 * noise * 2.6, "a reading has left its side"
    return (out - step)[:, 59:49:-1].mean(axis=0)


def test_smoothing_keeps_a_step_of_30_cm():
    for noise in (0.001, 0.002, 0.004):
        assert np.abs(step_bias(0.3, noise)).max() < 0.2 * noise * 2.5


def test_smoothing_keeps_a_step_of_10_cm():
    for noise in (0.001, 0.002, 0.004):
        assert np.abs(step_bias(0.1, noise)).max() < 0.3 * noise * 2.5


def test_smoothing_leaves_other_views_alone():
    depth = kinect_burst(plane(), 1)[0]
    labels = np.zeros(depth.shape, np.int8)
    labels[:, 60:] = 1
    labels[:20] = -1
    out = smoothed(depth, 0.004, labels)
    np.testing.assert_array_equal(out[labels != 0], depth[labels != 0])
    assert (out[labels == 0] != depth[labels == 0]).mean() > 0.9
    apart = depth.copy()
    apart[labels != 0] = 1.0  # what other views read has no say
    sigma = smoothing_sigma(0.004, float(np.median(apart)), 1 / FOCAL, DepthSettings())
    expected = smooth_view(depth, labels, 0, 0.004, sigma, DepthSettings())
    np.testing.assert_array_equal(smoothed(apart, 0.004, labels)[labels == 0], expected[labels == 0])


def test_no_smoothing_when_told_so():
    depth = kinect_burst(plane(), 1)[0]
    options = DepthSettings(smoothing=0.0)
    sigma = smoothing_sigma(0.01, 3.0, 1 / FOCAL, options)
    np.testing.assert_array_equal(smooth_view(depth, np.zeros(depth.shape, np.int8), 0, 0.01, sigma, options), depth)


def test_noise_is_measured_on_the_data():
    rng = np.random.default_rng(1)
    labels = np.where(U < 60, 0, 2).astype(np.int8)
    sigma = np.where(U < 60, 0.002, 0.008)
    for truth in (plane(), plane((0, 0, 1)), 3.0 + 0.15 * ((U - 60) / 60) ** 2 - 0.1 * ((V - 45) / 45) ** 2):
        depth = (truth * (1 + sigma * rng.normal(size=truth.shape))).astype(np.float32)
        np.testing.assert_allclose(measure_noise(depth, labels, 4), (0.002, 0, 0.008, 0), rtol=0.06, atol=0)
    exact = measure_noise(plane().astype(np.float32), np.zeros(U.shape, np.int8), 1)
    assert exact[0] < 1e-6
    assert measure_noise(depth, np.full(U.shape, -1, np.int8), 1).tolist() == [0]
    outliers = depth.copy()
    outliers[rng.random(depth.shape) < 0.003] *= 1.3
    assert measure_noise(outliers, labels, 3)[0] == pytest.approx(0.002, rel=0.15)


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_flying_pixels_go_and_surfaces_stay(noise):
    near, far = plane((0.3, 0, 1.0), 1.9), plane((0, 0.2, 1.0), 3.2)
    across = (np.abs(U - 60) < 25) & (np.abs(V - 45) < 25)
    depth = np.where(across, near, far)
    rim = across & ~((np.abs(U - 60) < 24) & (np.abs(V - 45) < 24))
    rng = np.random.default_rng(0)
    flying = rim & (rng.random(rim.shape) < 0.5)
    depth[flying] = (depth + rng.uniform(0.25, 0.75, depth.shape) * (far - near))[flying]
    depth = (depth * (1 + noise * rng.normal(size=depth.shape))).astype(np.float32)
    before = depth.copy()
    out = remove_flying_pixels(depth, 1 / FOCAL)
    np.testing.assert_array_equal(depth, before)
    kept = out > 0
    np.testing.assert_array_equal(out[kept], depth[kept])
    assert kept[flying].mean() < 0.03
    away = ~rim & (U > 0) & (U < 119) & (V > 0) & (V < 89)
    next_to = np.abs(np.maximum(np.abs(U - 60), np.abs(V - 45)) - 24.5) < 2.5
    assert kept[away & ~next_to].mean() > 0.9995
    assert kept[away & next_to].mean() > 0.9


def test_steep_but_smooth_surfaces_do_not_fly():
    for degrees in (0, 45, 60, 70):  # and up to 8.5° more, seen along the rays
        tilted = plane((np.tan(np.radians(degrees)), 0, 1.0), 3.0)
        depth = np.where((tilted > 0.5) & (tilted < 8), tilted, 0).astype(np.float32)
        whole = np.zeros(depth.shape, bool)
        whole[1:-1, 1:-1] = (depth[1:-1, :-2] > 0) & (depth[1:-1, 2:] > 0) & (depth[1:-1, 1:-1] > 0)
        assert whole.sum() > 1000 and (remove_flying_pixels(depth, 1 / FOCAL)[whole] > 0).all()
    alone = np.zeros((20, 20), np.float32)
    alone[10, 10] = 2.0
    assert not remove_flying_pixels(alone, 1 / FOCAL).any()


def test_dropouts_are_closed_inside_a_surface_only():
    truth = plane()
    depth, labels = truth.astype(np.float32), np.zeros(U.shape, np.int8)
    labels[:, 60:] = -1
    holes = np.zeros(U.shape, bool)
    holes[10:80:7, 5:50:7] = True
    labels[holes] = -1
    depth[labels < 0] = 0
    filled, sorted_in = close_dropouts(depth, labels, 2)
    assert (sorted_in[holes] == 0).all()
    # a plane is linear in disparity, so the mean around a pixel is the pixel's own
    np.testing.assert_allclose(filled[holes], truth[holes], rtol=1e-6)
    assert (sorted_in[:, 60:] == -1).all() and not filled[:, 60:].any()
    assert (labels[holes] == -1).all(), "the caller's arrays are not touched"
    unchanged = close_dropouts(depth, labels, 0)
    np.testing.assert_array_equal(unchanged[0], depth)
    between = np.where(U < 60, 0, 1).astype(np.int8)
    between[40, 59] = -1
    assert close_dropouts(truth.astype(np.float32), between, 2)[1][40, 59] in (-1, 0)


# --- smoothing, its fast way -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("sigma", [1.0, 2.3, 4.0])
def test_smooth_surfaces_against_least_squares(sigma):
    """Where no window holds an edge, the separable sums give what a weighted least-squares fit gives."""
    rng = np.random.default_rng(2)
    noise = 0.003
    depth = (sphere((0.02, -0.01, 3.0), 2.0) * (1 + noise * rng.normal(size=U.shape))).astype(np.float32)
    labels = np.zeros(U.shape, np.int8)
    labels[rng.random(U.shape) < 0.2] = -1  # torn
    labels[:, 100:] = -1
    out = smooth_view(depth, labels, 0, noise, sigma, DepthSettings(max_radius=9))
    radius = min(int(np.ceil(2.4 * sigma)), 9)
    for v, u in ((0, 0), (3, 97), (45, 60), (89, 50), (60, 99)):
        if labels[v, u] < 0:
            continue
        rows, columns = np.mgrid[max(v - radius, 0) : v + radius + 1, max(u - radius, 0) : u + radius + 1]
        inside = (rows < 90) & (columns < 120)
        rows, columns = rows[inside], columns[inside]
        mine = labels[rows, columns] == 0
        y, x = (rows[mine] - v) / sigma, (columns[mine] - u) / sigma
        weight = np.exp(-0.5 * (x * x + y * y))
        terms = np.column_stack((np.ones_like(x), x, y, x * x, x * y, y * y))
        d = depth[v, u] / depth[rows[mine], columns[mine]] - 1.0
        ridge = weight.sum() * np.diag((1e-6, 2e-3, 2e-3, 3e-2, 3e-2, 3e-2))
        fit = np.linalg.solve(terms.T @ (weight[:, None] * terms) + ridge, terms.T @ (weight * d))
        # in places the window is weighed reading by reading instead
        assert out[v, u] == pytest.approx(depth[v, u] / (1 + fit[0]), rel=3e-4)


@pytest.mark.parametrize("name", ["ideal", "folds", "ball"])
def test_cleaning_does_not_spoil_what_is_clean(name, simulated):
    """Readings that only rounding has touched: as good afterwards, though they hold relief as fine as the pixels."""
    if name == "ideal":
        made = simulated("ideal")
        labels = np.where(made.truth.labels == 0, 0, -1).astype(np.int8)
        truth, depth, focal = made.truth.sight.depth, made.capture.depth[0], made.capture.intrinsics.fx
    else:
        folds = 0.002 * np.sin(U / 1.3) * (U > 30)
        truth, focal = (plane() + folds if name == "folds" else sphere()), FOCAL
        depth = np.round(truth, 3).astype(np.float32)
        labels = np.where(depth > 0, 0, -1).astype(np.int8)
    out, kept, _ = clean(depth, labels, 1, focal, DepthSettings())
    before, after = (1e3 * np.sqrt(np.mean((z - truth)[labels == 0] ** 2)) for z in (depth, out))
    print(f"\n{name}: {before:.3f} mm rounded, {after:.3f} mm cleaned")
    assert after < 1.05 * before


# --- steps -----------------------------------------------------------------------------------------------------------


KINECT_STEP = SENSORS["kinect_v1"].step(585.0)


@pytest.mark.parametrize("noise", [0.0, 0.056])
def test_a_kinect_is_known_by_its_steps(noise):
    truth = plane((0.9, -0.5, 1.0), 3.2)
    burst = np.round(kinect_burst(truth, 1, noise=noise), 3)
    assert find_step(burst[0]) == pytest.approx(KINECT_STEP, rel=0.01)
    camera = Intrinsics(120, 90, 585.0, 585.0, 60.0, 45.0)
    kinect = Capture(burst, None, camera)
    assert recognise(kinect, DepthSettings()) == ("kinect_v1", SENSORS["kinect_v1"])
    assert recognise(kinect, DepthSettings(sensor="unknown")) == ("unknown", None)
    told = Capture(burst, None, camera, sensor="azure_kinect")
    assert recognise(told, DepthSettings())[0] == "azure_kinect"
    with pytest.raises(MirrorScanError, match="kinect_v1"):
        recognise(kinect, DepthSettings(sensor="kinect_v3"))


def test_other_readings_have_no_steps():
    rng = np.random.default_rng(0)
    truth = plane((0.9, -0.5, 1.0), 3.2)
    smooth = np.round(truth, 3)
    for depth in (smooth, smooth * (1 + 0.002 * rng.normal(size=truth.shape)), np.zeros(truth.shape),
                  np.full(truth.shape, 3.0), np.round(truth, 1), rng.choice([2.0, 2.5, 3.1], truth.shape)):  # fmt: skip
        assert find_step(depth.astype(np.float32)) == 0


@pytest.mark.parametrize(("name", "gain"), [("plane", 8), ("sphere", 3)])
def test_steps_without_noise_are_undone(name, gain):
    truth = plane((0.6, -0.5, 1.0), 3.5) if name == "plane" else sphere((0.0, 0.0, 3.4), 0.9)
    depth = kinect_burst(truth, 1, noise=0.0)[0]
    labels = np.where(depth > 0, 0, -1).astype(np.int8)
    out = dequantise(depth, labels, 0, KINECT_STEP, DepthSettings())
    inner = np.zeros(truth.shape, bool)
    inner[15:-15, 15:-15] = True
    error = [1e3 * np.sqrt(np.mean((z - truth)[inner & (truth > 0)] ** 2)) for z in (depth, out)]
    print(f"\n{name}: in steps {error[0]:.2f} mm, undone {error[1]:.2f} mm")
    assert error[1] < error[0] / gain
    read = depth > 0
    assert np.abs(1 / out[read] - 1 / depth[read]).max() <= 0.5 * KINECT_STEP * 1.001, "a reading is an interval"
    np.testing.assert_array_equal(dequantise(depth, labels, 1, KINECT_STEP, DepthSettings()), depth)


def test_cleaning_each_step_can_be_turned_off():
    burst = kinect_burst(sphere(), 10, seed=1)
    fused, spread = fuse_burst(burst)
    labels = np.where(fused > 0, 0, -1).astype(np.int8)
    off = DepthSettings(smoothing=0.0, close_gaps=0, dequantise=False, support=0)
    np.testing.assert_array_equal(remove_flying_pixels(fused, 1 / FOCAL, off), fused)
    depth, kept, _ = clean(fused, labels, 1, FOCAL, off, SENSORS["kinect_v1"], spread)
    np.testing.assert_array_equal(depth, fused)
    np.testing.assert_array_equal(kept, labels)
    still = kinect_burst(sphere((0.02, -0.01, 3.6), 0.5), 1, noise=0.0)
    labels = np.where(still[0] > 0, 0, -1).astype(np.int8)
    with_steps = clean(still[0], labels, 1, 585.0, DepthSettings(dequantise=False, smoothing=0), SENSORS["kinect_v1"])[
        0
    ]
    without = clean(still[0], labels, 1, 585.0, DepthSettings(smoothing=0), SENSORS["kinect_v1"])[0]
    np.testing.assert_array_equal(with_steps, still[0])
    assert (without != with_steps).mean() > 0.05


# --- standing still --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("frames", [2, 3, 10, 30])
@pytest.mark.parametrize("noise", [0.001, 0.009])  # of a time-of-flight camera near by, of a stereo camera far off
@pytest.mark.parametrize("toward", [True, False])
def test_a_moving_subject_is_told_with_how_far(frames, toward, noise):
    rng = np.random.default_rng(0)

    def burst(far):
        shots = []
        for t in np.linspace(0, 1, frames):
            ball = sphere((0.02 + (0 if toward else far * t), -0.01, 2.5 + (far * t if toward else 0)), 0.28)
            shots.append(np.where(ball > 0, ball, 4.0))
        depth = np.stack(shots)
        return (depth * (1 + noise * rng.normal(size=depth.shape))).astype(np.float32)

    labels = np.where(sphere((0.02, -0.01, 2.5), 0.28) > 0, 0, -1).astype(np.int8)
    still = burst(0.0)
    assert burst_motion(still, labels, 1 / FOCAL).share < 0.04
    assert still_warning(still, labels, FOCAL, DepthSettings()) is None
    for far in (0.01, 0.05):
        if far < 0.02 and noise > 0.005 and not toward:
            continue  # 1.6 px of a silhouette whose pixels flip
        moving = burst(far)
        motion = burst_motion(moving, labels, 1 / FOCAL)
        if toward:
            assert motion.share > 0.6 and motion.median == pytest.approx(far, rel=0.2, abs=0.002)
        else:
            assert motion.share > 0.1 and 0.4 * far < motion.median < 1.5 * far
        warning = still_warning(moving, labels, FOCAL, DepthSettings())
        assert f"{1e3 * motion.median:.0f} mm" in warning
    assert still_warning(moving, labels, FOCAL, DepthSettings(still_share=1.0)) is None
    assert still_warning(moving[:1], labels, FOCAL, DepthSettings()) is None


@pytest.mark.parametrize("sensor", ["kinect_v1", "azure_kinect", "realsense_d455"])
def test_no_sensor_makes_a_still_subject_move(simulated, sensor):
    """Noise of centimetres at the mirrors, flying pixels, silhouettes that jitter: bursts of two frames and more."""
    made = simulated(sensor)
    labels, focal = made.truth.labels.astype(np.int8), made.capture.intrinsics.fx
    for frames in range(2, len(made.capture.depth) + 1):
        burst = made.capture.depth[:frames]
        assert burst_motion(burst, labels, 1 / focal).share < 0.04
        moved = np.concatenate((burst[:-1], np.where(burst[-1:] > 0, burst[-1:] + np.float32(0.02), 0)))
        assert frames > 5 or still_warning(moved, labels, focal, DepthSettings()), "the last frame alone is a third"
