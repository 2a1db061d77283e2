"""Mirrors: reflection against I - 2 n nᵀ, planes against numpy, and framed mirrors found in synthetic depth maps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mirror_scan.core.camera import Intrinsics, RgbdImage, project, unproject
from mirror_scan.core.capture import MirrorPicks
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.errors import MirrorError
from mirror_scan.core.mirrors.disparity_plane import erosion
from mirror_scan.core.mirrors.mirror import plane_mirror, reflect, reflection_matrix
from mirror_scan.core.mirrors.picked_mirror import MirrorSettings, fit_plane, place_mirror
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate

vector = hnp.arrays(np.float64, 3, elements=st.floats(-5, 5))
seeds = st.integers(0, 2**32 - 1)


def unit(v):
    return np.asarray(v, dtype=float) / np.linalg.norm(v)


@settings(max_examples=60, deadline=None)
@given(vector, vector, hnp.arrays(np.float64, (6, 3), elements=st.floats(-10, 10)))
def test_reflection_is_the_householder_matrix(point, normal, cloud):
    assume(np.linalg.norm(normal) > 1e-3)
    mirror = plane_mirror("m", point, normal)
    n = unit(normal)
    matrix = reflection_matrix(mirror)
    np.testing.assert_allclose(matrix[:3, :3], np.eye(3) - 2 * np.outer(n, n), atol=1e-12)
    np.testing.assert_allclose(matrix[:3, 3], 2 * (n @ point) * n, atol=1e-11)
    assert matrix[3].tolist() == [0, 0, 0, 1] and np.linalg.det(matrix) == pytest.approx(-1)
    image = reflect(cloud, mirror)
    np.testing.assert_allclose(reflect(image, mirror), cloud, atol=1e-11)  # an involution
    np.testing.assert_allclose(
        np.linalg.norm(image[:, None] - image, axis=2), np.linalg.norm(cloud[:, None] - cloud, axis=2), atol=1e-11
    )
    np.testing.assert_allclose((image + cloud) @ n / 2, np.full(6, n @ point), atol=1e-11)  # half-way is on the mirror
    assert reflect(cloud.reshape(2, 3, 3), mirror).shape == (2, 3, 3)


def test_reflection_reverses_winding():
    mirror = plane_mirror("m", (0.4, 0.1, 2.0), (-0.6, 0.1, -0.8))
    corners = np.random.default_rng(0).normal(size=(4, 3))
    image = reflect(corners, mirror)
    assert np.linalg.det(image[1:] - image[0]) == pytest.approx(-np.linalg.det(corners[1:] - corners[0]))


@settings(max_examples=60, deadline=None)
@given(vector, vector)
def test_basis_is_right_handed_and_looks_at_the_camera(point, normal):
    assume(np.linalg.norm(normal) > 1e-3)
    mirror = plane_mirror("m", point, normal)
    np.testing.assert_allclose(mirror.basis.T @ mirror.basis, np.eye(3), atol=1e-12)
    assert np.linalg.det(mirror.basis) == pytest.approx(1)
    np.testing.assert_array_equal(mirror.basis[:, 2], mirror.normal)
    assert mirror.normal @ mirror.point <= 1e-12 and abs(mirror.normal @ unit(normal)) == pytest.approx(1)
    if mirror.normal[2] < -0.3 and abs(mirror.normal[1]) < 0.7:
        assert mirror.basis[1, 1] > 0 and abs(mirror.basis[1, 0]) < 1e-12, "b points down and a is level"


@settings(max_examples=60, deadline=None)
@given(seeds, st.integers(3, 40), st.sampled_from([0.0, 1e-3, 0.02]))
def test_plane_is_the_least_squares_plane(seed, count, noise):
    rng = np.random.default_rng(seed)
    flat = np.column_stack((rng.uniform(-0.5, 0.5, (count, 2)), noise * rng.normal(size=count)))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    points = flat @ turn.T + (0.3, -0.2, 3.0)
    singular = np.linalg.svd(points - points.mean(axis=0))
    assume(singular[1][1] > 0.1 * singular[1][0] and singular[1][1] > 3 * singular[1][2])
    plane = fit_plane(points)
    np.testing.assert_allclose(plane.point, points.mean(axis=0), atol=1e-12)
    assert abs(plane.normal @ singular[2][2]) == pytest.approx(1, abs=1e-9)
    assert plane.normal @ plane.point <= 0 and plane.points_used == count and not plane.refined
    assert plane.residual == pytest.approx(singular[1][2] / np.sqrt(count), rel=1e-6, abs=1e-8)
    again = fit_plane(np.concatenate((points, points, [[np.nan, 0, 1], [np.inf, 0, 1]]))[::-1])
    np.testing.assert_allclose((again.point, again.normal), (plane.point, plane.normal), atol=1e-7)
    assert again.points_used == 2 * count, "points that are not finite do not count"


SQUARE = np.array([(0, 0, 2), (1, 0, 2), (1, 1, 2.5), (0, 1, 2.5)], dtype=float)


@pytest.mark.parametrize(
    ("points", "said"),
    [
        (SQUARE[:2], "at least 3"),
        (np.empty((0, 3)), "at least 3"),
        (np.where(np.arange(4)[:, None] > 1, np.nan, SQUARE), "2 usable"),
        (np.repeat(SQUARE[:1], 5, axis=0), "one line"),
        (np.repeat(SQUARE[:2], 3, axis=0), "one line"),
        (np.linspace(0, 1, 9)[:, None] * (0.2, 1.0, 0.1) + (0, 0, 2), "one line"),
        (np.linspace(0, 1, 9)[:, None] * (0, 1.0, 0) + (0.1, 0, 2) + 1e-3 * np.eye(9, 3), "one line"),
    ],
)
def test_points_that_make_no_plane(points, said):
    with pytest.raises(MirrorError, match=f"left.*{said}"):
        fit_plane(points, "left")


@pytest.mark.parametrize(
    ("point", "normal"),
    [((0, 0, 1), (0, 0, 0)), ((0, 0, np.nan), (0, 0, 1)), ((0, 0, 1), (0, np.inf, 1)), ((0, 0), (0, 0, 1)),
     ((0, 0, 1), (0, 0, 1, 0))],
)  # fmt: skip
def test_given_planes_that_are_none(point, normal):
    with pytest.raises(MirrorError, match="left"):
        plane_mirror("left", point, normal)


LENS = Intrinsics(320, 240, 292.0, 292.0, 159.5, 119.5)
CENTRE, NORMAL = np.array([0.5, 0.05, 2.9]), unit((-0.55, 0.04, -0.8))
GLASS, FRAME = np.array([0.4, 0.62]), 0.045  # half width and height of the glass, width of its frame [m]
TRUE = plane_mirror("right", CENTRE, NORMAL)
CORNERS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])


def scene(noise: float, seed: int = 0):
    """Noisy depth map of a framed mirror before a wall, the room seen in its glass; and where the frame is."""
    v, u = np.mgrid[:240, :320]
    rays = np.stack(((u - LENS.cx) / LENS.fx, (v - LENS.cy) / LENS.fy, np.ones(u.shape)), axis=-1)
    z = (NORMAL @ CENTRE) / (rays @ NORMAL)
    local = np.abs((rays * z[..., None] - CENTRE) @ TRUE.basis[:, :2])
    glass = (local < GLASS).all(axis=-1)
    frame = (local < GLASS + FRAME).all(axis=-1) & ~glass
    rng = np.random.default_rng(seed)
    depth = np.where(frame, z, np.where(glass, 5.0 + 0.5 * rays[..., 0], 4.2))
    disparity = (1 / depth) * (1 + noise * rng.normal(size=depth.shape))
    return (1 / disparity).astype(np.float32), frame


def clicks(seed: int = 0, count: int = 8):
    """Pixels along the middle of the frame, all round, missed by up to half a pixel."""
    rng = np.random.default_rng(seed)
    side = np.arange(count) % 4
    along = rng.uniform(0, 1, count)[:, None]
    at = (CORNERS[side] * (1 - along) + CORNERS[(side + 1) % 4] * along) * (GLASS + FRAME / 2)
    return project(CENTRE + at @ TRUE.basis[:, :2].T, LENS) + rng.uniform(-0.5, 0.5, (count, 2))


def misplaced(mirror) -> float:
    """How far the mirror's error moves the reflection of a body before it [m], at worst."""
    body = CENTRE + 1.6 * NORMAL + np.random.default_rng(9).uniform((-0.4, -0.85, -0.2), (0.4, 0.85, 0.2), (50, 3))
    return float(np.linalg.norm(reflect(body, mirror) - reflect(body, TRUE), axis=1).max())


def test_growing_to_the_frame_beats_the_picks_alone():
    noise = 0.004
    plain, grown = [], []
    for seed in range(12):
        depth, frame = scene(noise, seed)
        picks = MirrorPicks("right", clicks(seed))
        plain.append(misplaced(place_mirror(RgbdImage(depth, LENS), picks, MirrorSettings(grow=False))))
        mirror = place_mirror(RgbdImage(depth, LENS), picks)
        grown.append(misplaced(mirror))
        assert mirror.refined and mirror.normal @ CENTRE < 0
        assert 0.75 * frame.sum() < mirror.points_used < 1.25 * frame.sum()
        # a reading's error along its ray, seen across the mirror's plane
        slant = np.abs(unproject(depth, LENS)[frame] @ NORMAL)
        assert mirror.residual == pytest.approx(noise * np.sqrt(np.mean(slant**2)), rel=0.25)
        half = np.ptp(mirror.rectangle, axis=1) / 2
        np.testing.assert_allclose(half, GLASS + FRAME, atol=0.03)
        expected = project(CENTRE + CORNERS * (GLASS + FRAME) @ TRUE.basis[:, :2].T, LENS)
        np.testing.assert_allclose(mirror.outline, expected, atol=4)
    print(f"\nworst displacement of the body, median of 12: picks {1e3 * np.median(plain):.1f} mm, "
          f"frame {1e3 * np.median(grown):.1f} mm")  # fmt: skip
    assert np.median(grown) < 0.2 * np.median(plain) and max(grown) < 0.012


def test_exact_without_noise():
    depth, _ = scene(0.0)
    assert misplaced(place_mirror(RgbdImage(depth, LENS), MirrorPicks("right", clicks()))) < 1e-4
    plain = place_mirror(RgbdImage(depth, LENS), MirrorPicks("right", np.rint(clicks(3))), MirrorSettings(grow=False))
    assert misplaced(plain) < 1e-4 and not plain.refined and plain.points_used == 8 and plain.residual < 1e-5


def test_mistaken_picks_are_outvoted():
    """Two of eight clicks hit the glass, which shows the room behind the camera."""
    for seed in range(6):
        depth, _ = scene(0.003, seed)
        pixels = clicks(seed)
        pixels[[1, 6]] = project(CENTRE + np.array([(0.1, 0.2), (-0.2, -0.3)]) @ TRUE.basis[:, :2].T, LENS)
        assert misplaced(place_mirror(RgbdImage(depth, LENS), MirrorPicks("right", pixels))) < 0.02


def test_picks_beside_a_reading_take_the_nearest():
    depth, _ = scene(0.0)
    pixels = np.rint(clicks()).astype(int)
    for u, v in pixels:
        depth[v, u] = 0
    assert misplaced(place_mirror(RgbdImage(depth, LENS), MirrorPicks("right", pixels.astype(float)))) < 1e-3


def test_glass_behind_its_frame():
    depth, _ = scene(0.0)
    mirror = place_mirror(RgbdImage(depth, LENS), MirrorPicks("right", clicks()), MirrorSettings(glass_offset=0.02))
    assert (mirror.point - CENTRE) @ NORMAL == pytest.approx(-0.02, abs=1e-4)


def test_a_known_plane_is_taken_as_it_is():
    depth, _ = scene(0.0)
    mirror = place_mirror(RgbdImage(depth, LENS), MirrorPicks("right", None, CENTRE, -3 * NORMAL))
    np.testing.assert_allclose(mirror.normal, NORMAL)
    np.testing.assert_array_equal(mirror.point, CENTRE)
    assert mirror.residual == 0 and mirror.rectangle is None and mirror.name == "right"


def test_clicks_that_place_no_mirror():
    depth, _ = scene(0.002)
    good = clicks()

    def place(pixels, depth=depth):
        return place_mirror(RgbdImage(depth, LENS), MirrorPicks("left one", np.array(pixels, dtype=float)))

    with pytest.raises(MirrorError, match="left one.*at least 3"):
        place(good[:2])
    with pytest.raises(MirrorError, match=r"left one.*\(330, 10\).*outside.*320×240"):
        place([*good, (330, 10)])
    with pytest.raises(MirrorError, match="left one.*outside"):
        place([*good, (np.nan, 10)])
    with pytest.raises(MirrorError, match="left one.*outside"):
        place([*good, (5, -0.6)])
    with pytest.raises(MirrorError, match="left one.*line"):
        side = CORNERS[1] + np.linspace(0.1, 0.9, 7)[:, None] * (CORNERS[2] - CORNERS[1])
        place(project(CENTRE + side * (GLASS + FRAME / 2) @ TRUE.basis[:, :2].T, LENS))
    with pytest.raises(MirrorError, match="left one.*line"):
        place(np.repeat(good[:1], 5, axis=0))
    with pytest.raises(MirrorError, match="left one.*reading"):
        place(good, np.zeros_like(depth))


def test_displacement_of_a_reflection_is_what_the_covariance_says():
    """To first order, against planes drawn from the covariance."""
    rng = np.random.default_rng(3)
    root = rng.normal(size=(3, 3)) * np.array((1e-4, 2e-4, 3e-4))[:, None]
    mirror = replace(TRUE, covariance=root @ root.T)
    body = CENTRE + 1.6 * NORMAL + rng.uniform(-0.5, 0.5, (40, 3))
    squares = []
    for _ in range(1500):
        alpha, beta, shift = root @ rng.normal(size=3)
        a, b, n = TRUE.basis.T
        turned = plane_mirror("m", CENTRE + shift * n, n - alpha * a - beta * b)
        squares.append(np.sum((reflect(body, turned) - reflect(body, TRUE)) ** 2, axis=1).mean())
    assert mirror.displacement(body) == pytest.approx(np.sqrt(np.mean(squares)), rel=0.06)
    assert TRUE.displacement(body) is None


def test_the_expected_error_is_the_one_made():
    """Over many noisy scenes: what the covariance promises against the displacement there is."""
    body = CENTRE + 1.6 * NORMAL + np.random.default_rng(9).uniform((-0.4, -0.85, -0.2), (0.4, 0.85, 0.2), (50, 3))
    for settings_ in (MirrorSettings(), MirrorSettings(grow=False)):
        made, promised = [], []
        for seed in range(16):
            depth, _ = scene(0.004, seed)
            mirror = place_mirror(RgbdImage(depth, LENS), MirrorPicks("right", clicks(seed)), settings_)
            made.append(np.linalg.norm(reflect(body, mirror) - reflect(body, TRUE), axis=1) ** 2)
            promised.append(mirror.displacement(body) ** 2)
        ratio = np.sqrt(np.mean(made) / np.mean(promised))
        assert 0.4 < ratio < 2.6, (settings_, ratio)


def test_rings_of_a_frame():
    mask = np.zeros((60, 80), np.bool_)
    mask[5:55, 10:20] = True
    ring = erosion(mask)
    assert (ring > 0).sum() == 50 * 10 and (ring > 1).sum() == 48 * 8 and (ring > 2).sum() == 46 * 6
    assert (ring[7:53, 12:18] == 3).all() and not erosion(np.zeros((9, 9), np.bool_)).any()


@pytest.mark.parametrize("sensor", ["azure_kinect", "kinect_v1"])
def test_picked_glass_ends_where_the_frame_does(person, sensor):
    """With a rolled camera, mirrors that lean, and floor seen below the frame: the rectangle is turned as the frame is,
    and ends at its outer edge on every side that is seen."""
    rig = default_rig(sensor, frames=6, roll_deg=-7.0, lean_deg=(3.0, -2.0), camera_height=1.1, tilt_deg=6.0)
    capture = simulate(person, rig).capture
    depth = one_depth_map(capture)[0]
    to_avatar, seen = rig.camera_to_avatar, 0
    for picks, true in zip(capture.mirrors, rig.mirrors, strict=True):
        mirror = place_mirror(RgbdImage(depth, capture.intrinsics), picks)
        (left, right), (top, bottom) = mirror.rectangle
        corners = np.array(((left, top), (right, top), (right, bottom), (left, bottom)))
        corners = (mirror.point + corners @ mirror.basis[:, :2].T) @ to_avatar[:3, :3].T + to_avatar[:3, 3]
        place = (corners - true.centre) @ true.axes[:2].T
        half = 0.5 * np.array((true.width, true.height)) + true.frame_width
        for corner in place:
            near = np.abs(np.abs(corner) - half)
            seen += int((near < 0.01).sum())
            assert ((near < 0.01) | (near > 1.5)).all(), "where the frame ends, or beyond the picture"
        np.testing.assert_allclose(mirror.basis.T @ mirror.basis, np.eye(3), atol=1e-12)
    assert seen >= 12, "of 16 coordinates of corners"
