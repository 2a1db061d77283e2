"""The virtual rig against closed forms: spheres and planes in mirrors, sensor statistics, seeds, picks, files."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from mirror_scan.core.camera import Intrinsics, project, unproject
from mirror_scan.core.capture import ReadOptions, open_capture
from mirror_scan.core.errors import MirrorScanError, OutputError
from mirror_scan.core.io import read_mesh
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mesh.bvh import build_bvh, closest_point
from mirror_scan.core.numeric.srgb import from_linear, to_linear
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.optics import Optics
from mirror_scan.core.simulation.rays import BODY, FLOOR, FRAME, WALL, look
from mirror_scan.core.simulation.scene import FramedMirror, Rig, default_rig, with_own_color_camera
from mirror_scan.core.simulation.sensors import COLOR_CAMERAS, SENSORS, measure
from mirror_scan.core.simulation.simulate import simulate, write_simulation
from scipy.spatial import cKDTree

LENS = Intrinsics(192, 144, 150.0, 150.0, 95.5, 71.5)


def sphere(centre, radius) -> Mesh:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    return Mesh(np.asarray(ball.vertices) + centre, np.asarray(ball.faces, dtype=np.int32))


def reflect(points, point, normal):
    return points - 2 * ((points - point) @ normal)[..., None] * normal


def to_camera(rig, points):
    return (np.asarray(points, dtype=float) - rig.camera_to_avatar[:3, 3]) @ rig.camera_to_avatar[:3, :3]


def sphere_depth(intrinsics, centre, radius):
    """z at which each pixel's ray first meets a sphere (camera frame); inf for a miss."""
    rays = unproject(np.ones((intrinsics.height, intrinsics.width)), intrinsics)
    a, b, c = (rays**2).sum(-1), rays @ centre, centre @ centre - radius**2
    root = b**2 - a * c
    return np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.inf)


def small(rig):
    """The same rig at half the resolution, to be quick."""
    return replace(rig, intrinsics=rig.intrinsics.scaled(rig.intrinsics.width // 2, rig.intrinsics.height // 2))


@pytest.fixture(scope="module")
def body() -> Mesh:
    return mannequin(resolution=0.015)


def test_sphere_in_a_leaning_mirror():
    centre, radius = np.array([0.1, 0.0, 1.1]), 0.3
    mirror = FramedMirror("right", (1.0, 1.1, 1.0), (-0.92, -1.73, 0.12), (0.05, 0, 1), 0.9, 1.3, 0.03, 0.01)
    rig = Rig(LENS, (0.0, -2.2, 1.3), (mirror,), 3.0, 6.0, 4.0, sensor="ideal", room=None, floor=False)
    sight, _ = look(sphere(centre, radius), rig)
    point, normal = to_camera(rig, mirror.centre), mirror.axes[2] @ rig.camera_to_avatar[:3, :3]
    direct = sphere_depth(LENS, to_camera(rig, centre), radius)
    folded = sphere_depth(LENS, reflect(to_camera(rig, centre), point, normal), radius)
    rays = unproject(np.ones((LENS.height, LENS.width)), LENS)
    glass = (point @ normal) / (rays @ normal)
    across = (glass[..., None] * rays - point) @ (mirror.axes[:2] @ rig.camera_to_avatar[:3, :3]).T
    through = (np.abs(across) < (0.445, 0.645)).all(-1) & ~np.isfinite(direct)

    seen = (sight.object == BODY) & (sight.view == 1)
    assert seen.sum() > 250 and (sight.bounces[seen] == 1).all()
    # The ball's facets (edges up to 12 mm) lie edge² / 6 radius = 0.08 mm inside the sphere, seen at a slant.
    inner = seen & (sight.incidence < np.radians(80))
    late = (sight.depth - np.where(inner, folded, 0.0))[inner] * np.cos(sight.incidence[inner])
    assert -1e-9 < late.min() and late.max() < 1e-4
    expected = through & np.isfinite(folded)
    assert (expected & ~seen).sum() < 0.03 * expected.sum() and (seen & np.isinf(folded)).sum() == 0
    # The folded length itself: camera to glass to the point on the sphere.
    at = np.argwhere(seen)[140]
    ray = rays[tuple(at)]
    on_glass = ray * glass[tuple(at)]
    on_sphere = to_camera(rig, sight.point[tuple(at)])
    length = np.linalg.norm(on_glass) + np.linalg.norm(on_sphere - on_glass)
    assert sight.depth[tuple(at)] == pytest.approx(length / np.linalg.norm(ray), rel=1e-9)
    assert np.linalg.norm(sight.point[tuple(at)] - centre) == pytest.approx(radius, abs=2e-4)

    seen = (sight.object == BODY) & (sight.view == 0)
    assert seen.sum() > 300
    inner = seen & (sight.incidence < np.radians(80))
    np.testing.assert_allclose(sight.depth[inner], direct[inner], atol=5e-4)
    cosine = (rays * (sight.depth[..., None] * rays - to_camera(rig, centre))).sum(-1)[seen] / radius
    cosine = -cosine / np.linalg.norm(rays[seen], axis=-1)
    np.testing.assert_allclose(np.cos(sight.incidence[seen]), np.abs(cosine), atol=0.02)


def test_image_of_an_image():
    """Two mirrors in a corner: the second image is the centre reflected in one, then the other."""
    centre, radius = np.array([0.5, 0.3, 1.0]), 0.15
    one = FramedMirror("right", (0.8, 1.2, 1.0), (-1, -1, 0), width=2.0, height=1.6, frame_width=0.0)
    two = FramedMirror("left", (-0.8, 1.2, 1.0), (0.9, -1, 0), width=2.0, height=1.6, frame_width=0.0)
    rig = Rig(LENS, (0.0, -1.2, 1.1), (one, two), sensor="ideal", room=None, floor=False)
    sight, _ = look(sphere(centre, radius), rig)
    twice = (sight.object == BODY) & (sight.bounces == 2)
    assert twice.sum() > 50
    assert (sight.view[twice] == 2).all(), "from here the ball is seen in the left mirror's image of the right one"
    image = reflect(centre, np.array(one.centre), one.axes[2])
    image = reflect(image, np.array(two.centre), two.axes[2])
    at = twice & (sight.incidence < np.radians(80))
    expected = sphere_depth(LENS, to_camera(rig, image), radius)[at]
    np.testing.assert_allclose(sight.depth[at], expected, atol=5e-4)
    labels = simulate(sphere(centre, radius), rig).truth.labels
    assert (labels[twice] == -1).all() and {0, 1, 2} <= set(np.unique(labels))


def test_planes_lie_where_they_are():
    """Floor and walls, seen directly and in mirrors, with the camera panned, tilted and rolled."""
    rig = replace(default_rig("ideal"), intrinsics=LENS.scaled(320, 240), pan_deg=-4.0, tilt_deg=11.0, roll_deg=7.0)
    sight, _ = look(sphere((0, 0, 0.9), 0.2), rig)
    points = unproject(sight.depth, rig.intrinsics)
    for view in (0, 1, 2):
        here = (sight.view == view) & (sight.bounces <= 1)
        for kind in (FLOOR, WALL):
            at = here & (sight.object == kind)
            assert at.sum() > 100
            there = points[at] @ rig.camera_to_avatar[:3, :3].T + rig.camera_to_avatar[:3, 3]
            if view:
                there = reflect(there, np.array(rig.mirrors[view - 1].centre), rig.mirrors[view - 1].axes[2])
            np.testing.assert_allclose(there, sight.point[at], atol=1e-9)
            x0, x1, y0, y1, z1 = rig.room
            if kind == FLOOR:
                np.testing.assert_allclose(there[:, 2], 0.0, atol=1e-9)
            else:
                gaps = np.abs(there[:, [0, 0, 1, 1, 2]] - (x0, x1, y0, y1, z1)).min(axis=1)
                np.testing.assert_allclose(gaps, 0.0, atol=1e-9)


def test_moulding_stands_proud_and_the_back_is_a_board():
    mirror = FramedMirror("m", (0, 1.0, 1.0), (0, -1, 0), width=0.8, height=0.8, frame_width=0.1, frame_depth=0.05)
    rig = Rig(LENS, (0.0, -1.0, 1.0), (mirror,), sensor="ideal", floor=False, room=None)
    far = sphere((0, 50.0, 0), 0.1)
    sight, _ = look(far, rig)
    frame = sight.object == FRAME
    facing = frame & (sight.incidence < np.radians(40)) & (sight.bounces == 0)
    np.testing.assert_allclose(np.unique(np.round(sight.depth[facing], 9)), [1.95])
    assert (sight.bounces[~frame & (np.abs(sight.depth) == 0)] <= 1).all()
    behind, _ = look(far, replace(rig, camera=(0.0, 3.0, 1.0), pan_deg=180.0))
    assert set(np.unique(behind.object)) == {0, FRAME} and (behind.bounces == 0).all()
    np.testing.assert_allclose(behind.depth[72, 96], 2.0 - 0.02, atol=1e-9)


@pytest.mark.parametrize("mirrors", [(120.0, -120.0), (130.0, -115.0, 160.0)])
def test_reflected_pixels_land_on_the_body(body, mirrors):
    rig = default_rig("ideal", mirrors=mirrors, lean_deg=[1.0, -0.7, 2.0][: len(mirrors)], roll_deg=2.0, frames=1)
    simulation = simulate(body, rig)
    truth = simulation.truth
    points = unproject(simulation.capture.depth[0], rig.intrinsics)
    bvh = build_bvh(truth.body.vertices, truth.body.triangles)
    for view in range(len(mirrors) + 1):
        at = (truth.labels == view) & (simulation.capture.depth[0] > 0)
        assert at.sum() > (4000 if view < 3 else 200)
        there = points[at]
        if view:
            there = reflect(there, truth.mirrors[view - 1].point, truth.mirrors[view - 1].normal)
        assert closest_point(bvh, there)[0].max() < 1e-3


def test_whole_person_is_seen_in_every_mirror(body):
    """No labelled pixel touches the frame on its left or right or the picture's edge."""
    for sensor in SENSORS:
        rig = default_rig(sensor, frames=1)
        truth = simulate(body, rig if rig.intrinsics.width < 500 else small(rig)).truth
        height = np.ptp(truth.body.vertices[:, 1])
        for view in (0, 1, 2):
            at = truth.labels == view
            assert not (at[0] | at[-1]).any() and not (at[:, 0] | at[:, -1]).any()
            seen = truth.sight.point[at][:, 2]
            assert np.ptp(seen) > 0.97 * height, (sensor, view)


@pytest.mark.parametrize("z", [1.5, 2.5, 4.0, 4.8])
def test_noise_follows_the_formulas(z):
    flat, facing = np.full((60, 80), z), np.zeros((60, 80))
    sigma = {}
    for name, sensor in SENSORS.items():
        burst = measure(sensor, flat, facing, sensor.intrinsics.fx, 30, np.random.default_rng(3))
        read = burst[burst > 0].astype(np.float64)
        assert abs(1 - len(read) / burst.size - sensor.dropout) < 0.001
        assert abs(read.mean() - z) < 0.004
        assert np.abs(read * 1000 - np.rint(read * 1000)).max() < 1e-3
        sigma[name] = np.sqrt(((read - z) ** 2).mean() - (0.001**2 / 12) * (name != "ideal"))
    assert sigma["ideal"] < 5e-4
    assert sigma["azure_kinect"] == pytest.approx(0.0012 + 0.0003 * z**2, rel=0.03)
    assert sigma["realsense_d455"] == pytest.approx(z**2 * 0.08 / (428.0 * 0.095), rel=0.03)
    assert sigma["kinect_v1"] == pytest.approx(0.0012 + 0.0019 * (z - 0.4) ** 2, rel=0.2)


def test_kinect_disparity_comes_in_eighths():
    sensor = SENSORS["kinect_v1"]
    ramp = np.tile(np.linspace(1.0, 3.0, 200), (50, 1))
    burst = measure(sensor, ramp, np.zeros_like(ramp), 585.0, 2, np.random.default_rng(0))
    z = burst[burst > 0].astype(np.float64)
    eighths = 585.0 * 0.075 / z * 8
    # 1 mm rounding blurs a quantum by f b / z² / 2 mm.
    assert (np.abs(eighths - np.rint(eighths)) <= 585.0 * 0.075 / z**2 * 8 * 0.00051).all()


def test_range_and_slant_limits():
    sensor = SENSORS["azure_kinect"]
    depth = np.array([[0.3, 1.0, 5.9, 6.2, 2.0, 0.0]])
    slant = np.radians([[0.0, 0, 0, 0, 89, 0]])
    sensor = replace(sensor, dropout=0.0, flying=0.0, dropped=0.0)
    burst = measure(sensor, depth, slant, 504.0, 5, np.random.default_rng(1))
    assert ((burst > 0) == [False, True, True, False, False, False]).all()


def test_flying_pixels_lie_between_and_stay_put():
    depth = np.full((80, 80), 4.0)
    depth[20:60, 20:60] = 2.0
    burst = measure(SENSORS["azure_kinect"], depth, np.zeros_like(depth), 504.0, 8, np.random.default_rng(2))
    flying = (burst > 2.05) & (burst < 3.95)
    assert flying.any(axis=0).sum() > 20
    edge = np.zeros(depth.shape, dtype=bool)
    edge[19:61, 19:61] = True
    edge[21:59, 21:59] = False
    assert not flying[:, ~edge].any()
    always = flying[:, flying.any(axis=0)].mean()
    assert always > 0.85, "flying pixels of a still subject come back in each frame"


def test_stereo_fattens_the_foreground():
    depth = np.full((120, 120), 4.0)
    depth[40:80, 40:80] = 2.0
    sensor = replace(SENSORS["realsense_d455"], disparity_noise=0.0, dropout=0.0)
    near = measure(sensor, depth, np.zeros_like(depth), 428.0, 1, np.random.default_rng(2))[0] < 3.0
    assert near[40:80, 40:80].all() and 40 * 40 + 60 < near.sum() <= 44 * 44


def test_projector_shadow_is_as_wide_as_the_disparity_step():
    ball, wall = np.array([0.0, 1.0, 1.0]), 3.0
    room, intrinsics = (-9, 9, -1, wall, 9), SENSORS["kinect_v1"].intrinsics
    rig = Rig(intrinsics, (0.0, 0.0, 1.0), (), floor=False, room=room, sensor="kinect_v1", frames=1)
    simulation = simulate(sphere(ball, 0.2), rig)
    row = ~simulation.truth.readable[239]
    columns = np.flatnonzero(row)
    assert (simulation.truth.sight.object[239][columns[0]] == WALL) and columns[-1] < 320
    silhouette = 1.0 - 0.2**2 / 1.0
    assert len(columns) == pytest.approx(585.0 * 0.075 * (1 / silhouette - 1 / wall), abs=3)
    assert np.array_equal(columns, np.arange(columns[0], columns[-1] + 1))


def test_interference_leaves_no_overlap(body):
    rig = default_rig("ideal", frames=1)

    def doubly_read(simulation):
        sight, labels = simulation.truth.sight, np.where(simulation.truth.readable, simulation.truth.labels, -1)
        trees = [sight.point[labels == view] for view in (0, 1, 2)]
        near = [cKDTree(trees[0]).query(trees[view])[0] < 0.004 for view in (1, 2)]
        return np.concatenate(near).mean()

    assert doubly_read(simulate(body, rig)) > 0.10
    assert doubly_read(simulate(body, replace(rig, interference=True))) < 0.01
    kinect = simulate(body, default_rig("kinect_v1", frames=1)).truth
    for view in (0, 1, 2):
        at = kinect.labels == view
        assert kinect.readable[at].mean() > 0.5, "enough must be left to scan"


def test_seed_decides_every_byte(body):
    for sensor in ("kinect_v1", "azure_kinect", "realsense_d455"):
        rigs = [small(default_rig(sensor, frames=2, seed=s)) for s in (4, 4, 5)]
        one, same, other = (simulate(body, rig).capture for rig in rigs)
        assert one.depth.tobytes() == same.depth.tobytes() and one.color.tobytes() == same.color.tobytes()
        assert (one.depth != other.depth).mean() > 0.2 and (one.color != other.color).any()
        assert (one.depth[0] != one.depth[1]).mean() > 0.2
        for a, b, c in zip(one.mirrors, same.mirrors, other.mirrors, strict=True):
            assert np.array_equal(a.frame_pixels, b.frame_pixels) and not np.array_equal(a.frame_pixels, c.frame_pixels)


def test_picks_lie_on_their_frames(body):
    rig = default_rig("azure_kinect", frames=1, lean_deg=(1.0, -1.0))
    simulation = simulate(body, rig)
    sight = simulation.truth.sight
    for i, picks in enumerate(simulation.capture.mirrors):
        assert picks.frame_pixels.shape == (8, 2) and picks.name == ("right", "left")[i]
        u, v = np.rint(picks.frame_pixels).astype(int).T
        assert (sight.object[v, u] == FRAME).all() and (sight.index[v, u] == i).all()
        points = unproject(sight.depth, rig.intrinsics)[v, u]
        plane = simulation.truth.mirrors[i]
        assert np.abs((points - plane.point) @ plane.normal).max() < 1e-9
        assert np.ptp(points, axis=0).max() > 1.0, "picks huddle together"
    frameless = simulate(body, replace(rig, mirrors=(replace(rig.mirrors[0], frame_width=0.0),)))
    assert frameless.capture.mirrors[0].frame_pixels is None
    np.testing.assert_allclose(frameless.capture.mirrors[0].normal, simulation.truth.mirrors[0].normal)


def test_folder_reads_back(body, tmp_path):
    simulation = simulate(body, default_rig("kinect_v1", frames=2))
    write_simulation(simulation, tmp_path / "scan")
    capture = open_capture(tmp_path / "scan")
    assert np.array_equal(capture.depth, simulation.capture.depth)
    assert np.array_equal(capture.color, simulation.capture.color)
    assert capture.intrinsics == simulation.capture.intrinsics
    for read, written in zip(capture.mirrors, simulation.capture.mirrors, strict=True):
        assert read.name == written.name and np.array_equal(read.frame_pixels, written.frame_pixels)
    truth = read_mesh(tmp_path / "scan" / "truth" / "body.ply")
    np.testing.assert_allclose(truth.vertices, simulation.truth.body.vertices, atol=1e-6)
    rig = json.loads((tmp_path / "scan" / "truth" / "rig.json").read_text())
    np.testing.assert_allclose(rig["mirrors"][1]["normal"], simulation.truth.mirrors[1].normal)
    back = np.array(rig["camera_to_avatar"])
    np.testing.assert_allclose(truth.transformed(back).vertices, body.vertices, atol=1e-5)
    one = simulate(body, default_rig("kinect_v1", frames=1))
    with pytest.raises(OutputError, match=r"000001\.png belongs to another capture"):
        write_simulation(one, tmp_path / "scan")


def checks(points, size=0.03):
    """A pattern of red and blue cubes, of more than two colours where a sample lies on an edge."""
    odd = np.floor(points / size).sum(axis=1) % 2 == 0
    return np.where(odd[:, None], (200.0, 50.0, 50.0), (50.0, 50.0, 200.0))


def own_camera(rig, **changes):
    """The rig at a third of its size, its colour camera larger, beside the depth camera, rotated."""
    lens = rig.intrinsics.scaled(rig.intrinsics.width // 3, rig.intrinsics.height // 3)
    values = {"color_scale": 4, "color_offset": (-0.03, -0.004, 0.006), "color_tilt_deg": 3.0} | changes
    return replace(rig, intrinsics=lens, pan_deg=4.0, roll_deg=5.0, **values)


@pytest.mark.parametrize("elsewhere", [True, False])
def test_a_colour_camera_of_its_own_sees_each_point_where_it_projects(body, elsewhere):
    """The painted pattern, in the large image, at what each depth pixel shows: directly, and in the mirrors."""
    place = {} if elsewhere else {"color_offset": (0.0, 0.0, 0.0), "color_tilt_deg": 0.0}
    rig = own_camera(default_rig("ideal", frames=1), **place)
    simulation = simulate(body, rig, paint=checks)
    capture, sight = simulation.capture, simulation.truth.sight
    camera, pose = capture.color_intrinsics, capture.depth_to_color
    assert capture.native_color.shape == (640, 852, 3) == (camera.height, camera.width, 3)
    assert capture.color.shape == (160, 213, 3)
    np.testing.assert_allclose(rig.seen_by_color.camera_to_avatar @ pose, rig.camera_to_avatar, atol=1e-12)
    if elsewhere:
        np.testing.assert_allclose(np.linalg.inv(pose)[:3, 3], rig.color_offset)
        assert np.linalg.inv(pose)[1, 2] > 0, "it looks further down, and y points down"
    points = unproject(sight.depth, rig.intrinsics) @ pose[:3, :3].T + pose[:3, 3]
    u, v = np.moveaxis(np.nan_to_num(np.rint(project(points, camera))).astype(int), -1, 0)
    edge = np.abs((sight.point / 0.03 + 0.5) % 1 - 0.5).min(axis=-1) * 0.03  # to the nearest edge of the pattern
    for view in (0, 1, 2):
        at = (simulation.truth.labels == view) & (edge > 0.006) & (sight.incidence < 1.0)
        at &= (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
        assert at.sum() > 150
        seen = capture.native_color[v[at], u[at]].astype(int)
        red = checks(sight.point[at])[:, 0] > 100
        right = (seen[:, 0] > seen[:, 2]) == red
        assert right.mean() > 0.98, (view, right.mean())  # the few others are behind a limb for the other camera


def test_a_larger_colour_image_comes_in_bands_and_reads_back(body, tmp_path, monkeypatch):
    rig = own_camera(default_rig("ideal", frames=1))
    simulation = simulate(body, rig, paint=checks)
    monkeypatch.setattr("mirror_scan.core.simulation.simulate._BAND_PIXELS", 100_000)
    again = simulate(body, rig, paint=checks)
    np.testing.assert_array_equal(again.capture.native_color, simulation.capture.native_color)
    write_simulation(simulation, tmp_path / "scan")
    capture = open_capture(tmp_path / "scan", options=ReadOptions(native_color=True))
    for name in ("depth", "color", "native_color", "depth_to_color"):
        np.testing.assert_array_equal(getattr(capture, name), getattr(simulation.capture, name), err_msg=name)
    assert capture.color_intrinsics == simulation.capture.color_intrinsics
    plain = simulate(body, replace(rig, color_scale=1, color_offset=(0.0, 0.0, 0.0), color_tilt_deg=0.0))
    assert plain.capture.native_color is None and plain.capture.color_intrinsics is None
    np.testing.assert_array_equal(plain.capture.depth, simulation.capture.depth)
    write_simulation(plain, tmp_path / "scan")
    assert not (tmp_path / "scan" / "color_intrinsic.json").exists()
    assert open_capture(tmp_path / "scan").color.tobytes() == plain.capture.color.tobytes()


def test_a_pixel_gathers_light_from_all_of_its_area(body):
    """The mean of a three times larger image, but for their grain."""
    rig = own_camera(default_rig("ideal", frames=1), color_scale=1)
    fine = simulate(body, replace(rig, color_scale=3), paint=checks).capture.native_color
    mean = fine.reshape(160, 3, 213, 3, 3).mean(axis=(1, 3))
    gathered = simulate(body, replace(rig, color_samples=3), paint=checks).capture.native_color
    assert gathered.shape == mean.shape
    assert np.abs(gathered - mean).mean() < 1.5 and np.percentile(np.abs(gathered - mean), 99) < 6
    single = simulate(body, rig, paint=checks).capture.native_color
    assert np.percentile(np.abs(single - mean), 99) > 40


@pytest.mark.parametrize("sensor", COLOR_CAMERAS)
def test_a_sensor_s_own_colour_camera_sees_the_person(body, sensor):
    rig = with_own_color_camera(small(default_rig(sensor, frames=1)))
    lens = rig.color_intrinsics
    rig = replace(rig, color_intrinsics=lens.scaled(lens.width // 4, lens.height // 4))
    simulation = simulate(body, rig)
    capture, labels = simulation.capture, simulation.truth.labels
    points = unproject(simulation.truth.sight.depth, rig.intrinsics)[labels >= 0]
    pose = capture.depth_to_color
    u, v = project(points @ pose[:3, :3].T + pose[:3, 3], capture.color_intrinsics).T
    inside = (u > 0) & (v > 0) & (u < capture.color_intrinsics.width - 1) & (v < capture.color_intrinsics.height - 1)
    assert inside.mean() > 0.8
    assert capture.native_color.shape == (lens.height // 4, lens.width // 4, 3)
    with pytest.raises(MirrorScanError, match="no colour camera of its own"):
        with_own_color_camera(default_rig("ideal"))


def test_mirrors_tint_what_they_show(body):
    rig = small(default_rig("ideal", frames=1))
    gains = ((0.8, 1.0, 0.6), (1.0, 0.7, 0.9))
    tinted = replace(rig, mirrors=tuple(replace(m, tint=g) for m, g in zip(rig.mirrors, gains, strict=True)))
    plain, other = simulate(body, rig), simulate(body, tinted)
    np.testing.assert_array_equal(other.capture.depth, plain.capture.depth)
    sight = plain.truth.sight
    direct = sight.bounces == 0
    np.testing.assert_array_equal(other.capture.color[direct], plain.capture.color[direct])
    for view, gain in enumerate(gains, start=1):
        at = (sight.view == view) & (sight.bounces == 1)
        light = to_linear(sight.color[at] / 255.0) * gain
        expected = 255 * from_linear(light)
        grain = plain.capture.color[at].astype(float) - sight.color[at]
        assert np.abs(other.capture.color[at] - expected - grain).max() < 1.01


def test_optics_move_a_large_colour_image_in_proportion(body):
    """A shift of pixels of the depth map is one of as many times more pixels; a pattern moves with the body."""
    rig = own_camera(default_rig("ideal", frames=1), color_offset=(0.0, 0.0, 0.0), color_tilt_deg=0.0)
    plain = simulate(body, rig, paint=checks).capture.native_color.astype(float)
    moved = simulate(body, replace(rig, optics=Optics(color_shift=(2.0, -1.0))), paint=checks).capture
    changed = np.abs(moved.native_color[100:500, 208:708] - plain[104:504, 200:700]).max(axis=-1)
    assert np.percentile(changed, 99) < 15  # twice the grain
    assert moved.color_intrinsics == rig.color_camera  # nobody calibrated it
    late = simulate(body, replace(rig, optics=Optics(color_delay=0.05, sway=0.4)), paint=checks)
    sight = late.truth.sight
    edge = np.abs((sight.point / 0.03 + 0.5) % 1 - 0.5).min(axis=-1) * 0.03
    points = sight.point[(late.truth.labels == 0) & (sight.incidence < 0.8) & (edge > 0.006)]
    u, v = np.rint(project(to_camera(rig, points + (0.02, 0.0, 0.0)), rig.color_camera)).astype(int).T
    now = late.capture.native_color[v, u].astype(int)
    assert ((now[:, 0] > now[:, 2]) == (checks(points)[:, 0] > 100)).mean() > 0.98


def test_paint_of_the_wrong_shape_is_refused(body):
    for wrong in (lambda p: p[:, :2], lambda p: np.full(p.shape, np.nan)):
        with pytest.raises(MirrorScanError, match="paint gave"):
            simulate(body, small(default_rig(frames=1)), paint=wrong)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: default_rig(color_scale=0), "color_scale = 0"),
        (lambda: default_rig(color_scale=1.5), "whole number"),
        (lambda: replace(default_rig(), color_offset=(2.0, 0.0, 0.0)), "within 1 m"),
        (lambda: replace(default_rig(), color_intrinsics=replace(LENS, distortion=(0.1, 0, 0, 0))), "pinhole"),
        (lambda: FramedMirror("x", (0, 0, 0), (0, 1, 0), tint=(0.0, 1.0, 1.0)), "tint"),
        (lambda: default_rig("kinect_v9"), "no sensor 'kinect_v9'"),
        (lambda: default_rig(frames=0), "frames = 0"),
        (lambda: default_rig(mirrors=-1), "mirrors = -1"),
        (lambda: default_rig(view_angle_deg=30), "no mirror gives a view at 30"),
        (lambda: default_rig(path_length=2.0), "longer than the subject's distance"),
        (lambda: default_rig(camera_height=-1.0), "under the floor"),
        (lambda: FramedMirror("x", (0, 0, 0), (0, 0, 1)), "up and normal are parallel"),
        (lambda: FramedMirror("x", (0, 0, 0), (0, 0, 0)), "parallel or zero"),
        (lambda: FramedMirror("x", (0, 0, float("nan")), (0, 1, 0)), "finite"),
    ],
)
def test_refuses_what_cannot_be(make, message):
    with pytest.raises(MirrorScanError, match=message):
        make()


@pytest.mark.parametrize("mirrors", [0, 1, 3, 5])
def test_any_number_of_mirrors(body, mirrors):
    simulation = simulate(body, replace(default_rig("ideal", mirrors=mirrors, frames=1), intrinsics=LENS))
    assert len(simulation.capture.mirrors) == len(simulation.truth.mirrors) == mirrors
    assert len({m.name for m in simulation.capture.mirrors}) == mirrors
    assert (simulation.truth.labels == 0).any()
