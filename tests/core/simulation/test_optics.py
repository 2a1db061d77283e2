"""Glass, bow, weak light, skin, warp, noise and colour of the virtual rig, each against its closed form."""

from __future__ import annotations

import json
from dataclasses import fields, replace

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics, unproject
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.multipath import by_one_way, paths, ray_lengths
from mirror_scan.core.simulation.optics import EFFECTS, IDEAL, Optics, real
from mirror_scan.core.simulation.props import box
from mirror_scan.core.simulation.rays import BODY, FLOOR, FRAME, WALL, lit, look
from mirror_scan.core.simulation.returned_light import albedo, depth_warp, filled, noise_gain, signal, skin_delay
from mirror_scan.core.simulation.scene import (
    FramedMirror,
    Rig,
    apparent_depth,
    apparent_plane,
    default_rig,
    glass_delay,
    with_real_optics,
)
from mirror_scan.core.simulation.sensors import SENSORS, measure
from mirror_scan.core.simulation.simulate import simulate, write_simulation

LENS = Intrinsics(192, 144, 150.0, 150.0, 95.5, 71.5)
FAR = box((50.0, 50.0, 0.0), (50.1, 50.1, 0.1))


def small(rig):
    return replace(rig, intrinsics=rig.intrinsics.scaled(rig.intrinsics.width // 2, rig.intrinsics.height // 2))


def to_camera(rig, points):
    return (np.asarray(points, dtype=float) - rig.camera_to_avatar[:3, 3]) @ rig.camera_to_avatar[:3, :3]


@pytest.fixture(scope="module")
def body() -> Mesh:
    return mannequin(resolution=0.015)


def rig_with(mirror: FramedMirror, **changes) -> Rig:
    return replace(Rig(LENS, (0.3, -2.0, 1.1), (mirror,), sensor="azure_kinect", room=(-4, 4, -5, 4, 3)), **changes)


# --- glass --------------------------------------------------------------------------------------------------------


def test_figures_of_five_millimetres_of_glass():
    cosine = np.cos(np.radians([0.0, 40.0, 60.0]))
    np.testing.assert_allclose(apparent_depth(0.005, cosine) * 1e3, (3.29, 2.78, 2.00), atol=0.01)
    assert glass_delay(0.005, np.array(1.0)) == pytest.approx(8.62e-3, abs=1e-5)
    assert glass_delay(0.005, np.cos(np.radians(60))) > 10e-3


@pytest.mark.parametrize("thickness", [0.003, 0.006])
def test_rays_through_glass_by_snell(thickness):
    """Each ray refracted in, reflected at the silver and refracted out meets the same point, after the same way."""
    mirror = FramedMirror("m", (0.2, 1.5, 1.2), (0.35, -1.0, 0.1), width=1.0, height=1.4, frame_width=0.0,
                          glass_thickness=thickness)  # fmt: skip
    rig = rig_with(mirror)
    sight, _ = look(FAR, rig)
    v, u = np.nonzero((sight.view == 1) & (sight.bounces == 1) & (sight.object == WALL))
    eye, normal = rig.camera_to_avatar[:3, 3], mirror.axes[2]
    rays = unproject(np.ones((LENS.height, LENS.width)), LENS)[v, u] @ rig.camera_to_avatar[:3, :3].T
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    cosine = -(rays @ normal)
    front = eye + (((np.array(mirror.centre) - eye) @ normal) / (rays @ normal))[:, None] * rays
    within = np.sqrt(1 - (1 - cosine**2) / 1.52**2)
    sideways = (rays + cosine[:, None] * normal) / 1.52  # length sin θ' within the glass
    out = front + 2 * thickness * sideways / within[:, None]
    onward = rays + 2 * cosine[:, None] * normal
    away = sight.point[v, u] - out
    along = (away * onward).sum(1)
    np.testing.assert_allclose(away, along[:, None] * onward, atol=1e-8)
    optical = np.linalg.norm(front - eye, axis=1) + 1.52 * 2 * thickness / within + along
    length = ray_lengths(LENS)[v, u]
    np.testing.assert_allclose(sight.depth[v, u] * length + sight.delay[v, u], optical, atol=1e-8)
    late = by_one_way(sight, rig, np.zeros(sight.depth.shape)) - sight.depth
    np.testing.assert_allclose(late[v, u] * length, glass_delay(thickness, cosine), atol=1e-9)
    assert (late[sight.bounces == 0] == 0).all()


def test_only_cameras_that_time_light_are_late(body):
    mirrors = default_rig("ideal").mirrors
    for sensor, late in (("azure_kinect", 0.0088), ("kinect_v2", 0.0088), ("realsense_d455", 0.0), ("kinect_v1", 0.0)):
        rig = small(default_rig(sensor, frames=6))
        rig = replace(rig, mirrors=tuple(replace(m, glass_thickness=0.005) for m in mirrors))
        made = simulate(body, rig)
        at = (made.truth.labels > 0) & (made.truth.sight.incidence < 1.0) & (made.capture.depth > 0).all(0)
        off = (made.capture.depth.mean(0) - made.truth.sight.depth)[at]
        quantum = 0.002 if sensor == "kinect_v1" else 0.0  # half the picture's size doubles that of its disparity
        assert np.median(off) == pytest.approx(late, abs=0.0015 + quantum), sensor


def test_the_true_plane_is_where_the_glass_appears_to_reflect(body):
    rig = default_rig("ideal")
    rig = replace(rig, mirrors=tuple(replace(m, glass_thickness=0.005) for m in rig.mirrors))
    made = simulate(body, rig)
    for view, mirror in enumerate(made.truth.mirrors, start=1):
        at = made.truth.labels == view
        seen = unproject(made.truth.sight.depth, rig.intrinsics)[at]
        unfolded = seen - 2 * ((seen - mirror.point) @ mirror.normal)[:, None] * mirror.normal
        off = unfolded - to_camera(rig, made.truth.sight.point[at])
        assert np.linalg.norm(off, axis=1).max() < 1e-3
        depth = (to_camera(rig, rig.mirrors[view - 1].centre) - mirror.point) @ mirror.normal
        assert 0.0025 < depth < 0.0033


# --- bow ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sag", [(0.0, 0.003), (0.002, -0.004)])
def test_rays_off_bowed_glass(sag):
    """A marching twin: the first place where the ray is behind the parabola, and the law of reflection there."""
    mirror = FramedMirror("m", (0.2, 1.5, 1.2), (0.35, -1.0, 0.1), width=1.0, height=1.4, frame_width=0.04, sag=sag)
    rig = rig_with(mirror)
    sight, _ = look(FAR, rig)
    v, u = (a[::97] for a in np.nonzero((sight.view == 1) & (sight.bounces == 1) & (sight.object == WALL)))
    assert len(v) > 10
    eye, (right, up, normal), centre = rig.camera_to_avatar[:3, 3], mirror.axes, np.array(mirror.centre)
    rays = unproject(np.ones((LENS.height, LENS.width)), LENS)[v, u] @ rig.camera_to_avatar[:3, :3].T

    def height(t):
        at = eye + t[:, None] * rays - centre
        x, y = at @ right / 0.5, at @ up / 0.7
        return at @ normal - sag[0] * (1 / 3 - x**2) - sag[1] * (1 / 3 - y**2)

    low, high = np.full(len(v), 1.0), np.full(len(v), 8.0)
    for _ in range(60):
        middle = (low + high) / 2
        low, high = np.where(height(middle) > 0, middle, low), np.where(height(middle) > 0, high, middle)
    at = eye + low[:, None] * rays - centre
    x, y = at @ right, at @ up
    tilted = normal + np.outer(2 * sag[0] * x / 0.25, right) + np.outer(2 * sag[1] * y / 0.49, up)
    tilted /= np.linalg.norm(tilted, axis=1)[:, None]
    onward = rays - 2 * (rays * tilted).sum(1)[:, None] * tilted
    away = sight.point[v, u] - centre - at
    along = (away * onward).sum(1) / (onward**2).sum(1)
    np.testing.assert_allclose(away, along[:, None] * onward, atol=1e-8)
    np.testing.assert_allclose(sight.depth[v, u], low + along, atol=1e-8)


def test_two_millimetres_of_bow_displace_by_eighteen():
    """Slope 4 s / L at the ends of 1.75 m, twice that over 2 m behind the glass: 18 mm across the ray."""
    flat = FramedMirror("m", (0.0, 1.0, 1.0), (0, -1, 0), width=1.2, height=1.75, frame_width=0.0)
    lens = Intrinsics(61, 601, 300.0, 300.0, 30.0, 300.0)
    rig = Rig(lens, (0.0, -1.0, 1.0), (flat,), floor=False, room=(-9, 9, -1.0000001, 9, 9), sensor="ideal")
    off = []
    for sag in (0.002, -0.002):
        seen = [look(FAR, replace(rig, mirrors=(m,)))[0] for m in (flat, replace(flat, sag=(0.0, sag)))]
        ends = np.abs(seen[0].point[..., 2][:, 30] - 1.0)
        v = np.argmax(np.where(seen[0].bounces[:, 30] == 1, ends, 0))
        assert ends[v] == pytest.approx(1.75, abs=0.02), "this ray comes from an end of the glass"
        off.append(seen[1].point[v, 30, 2] - seen[0].point[v, 30, 2])
    slant = 0.875 / 2.0
    across = (np.abs(off) - 2 * slant * 0.002 * 2 / 3) / (1 + slant**2)  # the end lies 2/3 of the sag off, too
    assert across == pytest.approx(2 * 2.0 * 4 * 0.002 / 1.75, rel=0.03) and off[0] * off[1] < 0


def test_the_frame_bends_with_the_glass():
    mirror = FramedMirror("m", (0.0, 1.5, 1.2), (0, -1, 0), width=0.8, height=1.6, frame_width=0.06, frame_depth=0.02)
    seen = [look(FAR, rig_with(m, camera=(0.0, -1.0, 1.2)))[0] for m in (mirror, replace(mirror, sag=(0.0, 0.009)))]
    at = (seen[0].object == FRAME) & (seen[1].object == FRAME) & (seen[0].bounces == 0) & (seen[0].incidence < 0.8)
    at &= (seen[1].bounces == 0) & (seen[1].incidence < 0.8)
    moved = seen[0].depth[at] - seen[1].depth[at]
    y = (seen[1].point[at][:, 2] - 1.2) / 0.8
    front = np.abs(seen[0].point[at][:, 1] - 1.48) < 1e-9
    assert front.sum() > 100
    np.testing.assert_allclose(moved[front], 0.009 * (1 / 3 - y[front] ** 2), atol=2e-4)


def test_the_plane_of_bowed_glass_is_its_mean_plane():
    mirror = FramedMirror("m", (0.0, 1.5, 1.2), (0.2, -1, 0), width=0.8, height=1.6, sag=(0.002, -0.003))
    point, normal = apparent_plane(mirror, (0.0, -2.0, 1.0))
    np.testing.assert_allclose(normal, mirror.axes[2], atol=1e-9)
    np.testing.assert_allclose(point, mirror.centre, atol=1e-4)


def test_light_by_way_of_bowed_thick_glass():
    """The shortest of all ways by the surface (Fermat), for one point."""
    mirror = FramedMirror("m", (0.0, 2.0, 1.0), (0.3, -1.0, 0.0), width=1.0, height=1.2, sag=(0.004, 0.006))
    rig = rig_with(mirror, camera=(0.4, -2.0, 1.1))
    sight, bvh = look(FAR, rig)
    light = lit(sight, bvh, rig, 0.0)
    at = (light[..., 1] > 0) & (sight.view == 0)
    ways = paths(sight, light, rig, at)
    eye, (right, up, normal) = np.array(rig.camera), mirror.axes
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-0.5, 0.5, 201), np.linspace(-0.6, 0.6, 201)))
    z = 0.004 * (1 / 3 - (x / 0.5) ** 2) + 0.006 * (1 / 3 - (y / 0.6) ** 2)
    surface = np.array(mirror.centre) + np.outer(x, right) + np.outer(y, up) + np.outer(z, normal)
    for k in range(0, at.sum(), 60):
        both = np.linalg.norm(surface - eye, axis=1) + np.linalg.norm(surface - sight.point[at][k], axis=1)
        assert ways.source[k, 1] == pytest.approx(both.min(), abs=1.5e-4)
    thick = paths(sight, light, replace(rig, mirrors=(replace(mirror, glass_thickness=0.005),)), at)
    longer = thick.source[:, 1] - ways.source[:, 1]
    assert (longer > 0.0125).all() and (longer < 0.0155).all(), "2 t √(n² - sin²θ): 15.2 mm squarely"


# --- light that is weak --------------------------------------------------------------------------------------------


def test_signal_falls_as_it_should():
    """A wall, directly and by a mirror: albedo · cos / r² · ρ² for the two passes."""
    mirror = FramedMirror("m", (0.2, 1.5, 1.2), (0.35, -1.0, 0.1), width=1.0, height=1.4, reflectivity=0.7)
    rig = rig_with(mirror, optics=Optics(attenuation=True))
    sight, _ = look(FAR, rig)
    got = signal(sight, rig, replace(SENSORS["azure_kinect"], window=1), albedo(sight, FAR, (), rig.optics))
    for view, passes in ((0, 1.0), (1, 0.49)):
        at = (sight.view == view) & (sight.object == WALL) & (sight.bounces == view)
        way = np.linalg.norm(unproject(sight.depth, LENS)[at], axis=1)
        np.testing.assert_allclose(got[at], 0.5 * passes * np.cos(sight.incidence[at]) / way**2, rtol=1e-6)


def test_windows_at_edges_and_thin_parts():
    depth = np.full((40, 60), 4.0)
    depth[:, :20] = 2.0
    depth[:, 40] = 2.0
    share = filled(depth, 9)
    assert share[20, 10] == 1 and share[20, 19] == pytest.approx(5 / 9) and share[20, 40] == pytest.approx(1 / 9)
    assert share[20, 30] == 1, "what lies behind is not thin"
    assert (filled(np.zeros((9, 9)), 3) == 0).all()


def test_noise_grows_and_readings_are_lost(body):
    rig = small(default_rig("azure_kinect", frames=1))
    sight, _ = look(body, rig)
    sensor = SENSORS["azure_kinect"]
    usual = 0.5 / (sight.depth * ray_lengths(rig.intrinsics))[40, 160] ** 2
    gains = [noise_gain(np.full(sight.depth.shape, s * usual), sight, rig, sensor)[40, 160] for s in (2.0, 1.0, 0.25)]
    background = sensor.faintest
    by_hand = np.sqrt((usual / 4 + background) / (usual / 4) ** 2 * usual**2 / (usual + background))
    assert gains == pytest.approx((1.0, 1.0, by_hand))
    lost = []
    for reflectivity in (0.95, 0.6, 0.2):
        mirrors = tuple(replace(m, reflectivity=reflectivity) for m in rig.mirrors)
        made = simulate(body, replace(rig, mirrors=mirrors, optics=Optics(attenuation=True)))
        there = made.capture.depth[0] > 0
        lost.append([1 - there[made.truth.labels == view].mean() for view in (0, 1)])
    lost = np.array(lost)
    assert lost[0, 1] < lost[1, 1] < lost[2, 1] and lost[2, 1] > 0.95 and np.ptp(lost[:, 0]) == 0


def test_dark_hair_gives_nothing_and_pale_cloth_does(body):
    rig = default_rig("azure_kinect", frames=1, optics=Optics(dark=True, attenuation=True))
    made = simulate(body, rig)
    sight, read = made.truth.sight, made.capture.depth[0] > 0
    colors = body.colors.astype(float)[body.triangles].mean(1)[np.maximum(sight.index, 0)]
    back = (sight.object == BODY) & (sight.view > 0) & (sight.incidence < 1.0)
    hair = back & (np.abs(colors - (74, 50, 36)).max(-1) < 3)
    skin = back & (np.abs(colors - (226, 178, 146)).max(-1) < 3)
    shirt = back & (np.abs(colors - (46, 96, 168)).max(-1) < 3)
    assert hair.sum() > 100 and read[hair].mean() < 0.2
    assert read[skin].mean() > 0.9 and read[shirt].mean() > 0.9


# --- skin, warp, noise, colour, room ---------------------------------------------------------------------------------


def test_skin_reads_too_far_and_hands_most(body):
    rig = default_rig("azure_kinect", frames=1, optics=Optics(skin=(0.004, 0.011)))
    sight, bvh = look(body, rig)
    within = skin_delay(sight, bvh, body, rig.optics)
    person = sight.object == BODY
    assert (within[~person] == 0).all()
    x, z = np.abs(sight.point[..., 0]), sight.point[..., 2]
    hands, face = person & (x > 0.58), person & (z > 1.52) & (within > 0)
    shins = person & (z < 0.4) & (z > 0.2)
    assert 0.008 <= np.median(within[hands]) <= 0.015 and 0.004 <= np.median(within[face]) < 0.006
    assert (within[shins] == 0).all(), "trousers"
    late = by_one_way(sight, rig, within) - sight.depth
    np.testing.assert_allclose((late * ray_lengths(rig.intrinsics))[hands], within[hands], atol=1e-9)


@pytest.mark.parametrize("sensor", ["azure_kinect", "phone_dtof", "realsense_d455"])
def test_warp_is_smooth_and_within_what_is_allowed(sensor):
    rig = default_rig(sensor)
    made, z = SENSORS[sensor], np.full((rig.intrinsics.height, rig.intrinsics.width), 3.0)
    shapes = []
    for unit in range(4):
        warp = depth_warp(replace(rig, optics=Optics(warp=1.0, unit=unit)), made, z)
        limit = 0.014 if made.baseline == 0 else 9.0 * 0.1 / (rig.intrinsics.fx * made.baseline) * 1.05
        assert 0.005 < np.abs(warp).max() <= limit
        assert np.abs(np.diff(warp, 2, axis=0)).max() < 1e-4 and np.abs(np.diff(warp, 2, axis=1)).max() < 1e-4
        shapes.append(warp)
    assert np.ptp(shapes, axis=0).max() > 0.005


@pytest.mark.parametrize("fixed", [0.0, 0.5, 0.9])
def test_a_burst_of_correlated_noise(fixed):
    """The variance of the mean of n frames is σ² (f + (1 - f) / n); neighbours correlate as their windows overlap."""
    sensor = replace(SENSORS["realsense_d455"], dropout=0.0)
    z, focal, n = np.full((300, 400), 2.0), 428.0, 8
    sigma = 4.0 * 0.08 / (focal * 0.095)
    burst = measure(sensor, z, np.zeros_like(z), focal, n, np.random.default_rng(5), fixed=fixed).astype(float) - 2.0
    rounding = 0.001**2 / 12
    assert burst[0].var() - rounding == pytest.approx(sigma**2, rel=0.12)
    mean = burst.mean(axis=0)
    assert mean.var() - rounding / n == pytest.approx(sigma**2 * (fixed + (1 - fixed) / n), rel=0.12)
    for step in (1, 3, 9):
        overlap = max(0.0, 1 - step / sensor.window)
        product = (burst[..., step:] * burst[..., :-step]).mean() / (burst**2).mean()
        assert product == pytest.approx(overlap, abs=0.06)


def test_colour_lies_beside_depth(body):
    rig = default_rig("azure_kinect", frames=1)
    plain = simulate(body, rig).capture.color.astype(float)
    moved = simulate(body, replace(rig, optics=Optics(color_shift=(3.0, -2.0)))).capture.color.astype(float)
    back = np.roll(moved, (2, -3), (0, 1))[8:-8, 8:-8]
    assert np.abs(back - plain[8:-8, 8:-8]).mean() < 3.0 < np.abs(moved - plain)[8:-8, 8:-8].mean() + 2.0
    late = simulate(body, replace(rig, optics=Optics(color_delay=0.05, sway=0.8)))
    changed = np.abs(late.capture.color.astype(float) - plain).max(-1) > 25
    near = np.zeros_like(changed)
    for down in range(-9, 10):
        for right in range(-9, 10):
            near |= np.roll(late.truth.sight.object == BODY, (down, right), (0, 1))
    assert changed.sum() > 500 and changed[near].sum() == changed.sum()
    assert np.array_equal(late.capture.depth, simulate(body, rig).capture.depth)


def test_floor_and_walls_are_uneven():
    mirror = FramedMirror("m", (0.2, 1.5, 1.2), (0.35, -1.0, 0.1), width=1.0, height=1.4)
    rig = rig_with(mirror, optics=Optics(uneven_floor=0.003, uneven_walls=0.008))
    sight, _ = look(FAR, rig)
    height = sight.point[..., 2][sight.object == FLOOR]
    assert 0.001 < height.std() < 0.004 and np.abs(height).max() < 0.01
    direct = (sight.object == WALL) & (sight.bounces == 0)
    camera = to_camera(rig, sight.point)
    np.testing.assert_allclose(camera[direct][:, 2], sight.depth[direct], atol=1e-9)
    deep = sight.point[..., 1][direct & (sight.index == 4)]
    assert 0.002 < deep.std() < 0.01 and np.abs(deep - 4.0).max() < 0.03


# --- all together --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sensor", SENSORS)
def test_real_optics(sensor, body, tmp_path):
    rig = small(default_rig(sensor, frames=2, seed=4))
    made = with_real_optics(rig)
    assert made == with_real_optics(rig) and made != with_real_optics(replace(rig, seed=5))
    assert (made.optics == IDEAL) == (sensor == "ideal")
    one, two = simulate(body, made), simulate(body, made)
    assert np.array_equal(one.capture.depth, two.capture.depth)
    for view in (0, 1, 2):
        at = one.truth.labels == view
        assert (one.capture.depth[0] > 0)[at].mean() > 0.35, (sensor, view)
    write_simulation(one, tmp_path / "out")
    written = json.loads((tmp_path / "out" / "truth" / "rig.json").read_text())
    assert written["optics"]["skin"] == list(made.optics.skin)
    for entry, mirror in zip(written["mirrors"], made.mirrors, strict=True):
        assert entry["sag"] == list(mirror.sag) and entry["glass_thickness"] == mirror.glass_thickness
        assert entry["reflectivity"] == mirror.reflectivity
    # what applies to which camera
    timed = SENSORS[sensor].principle in ("phase", "pulse")
    assert made.optics.multipath == timed and (made.optics.skin[0] > 0) == timed
    assert made.optics.correlated_noise == (SENSORS[sensor].baseline > 0)


def test_effects_one_by_one():
    """Each effect changes its own fields only, and all together are the whole."""
    rig = default_rig("azure_kinect", seed=3)
    whole, none = with_real_optics(rig), with_real_optics(rig, effects=())
    assert replace(none.optics, unit=0) == replace(IDEAL, frequencies=whole.optics.frequencies)
    assert all(m.sag == (0.0, 0.0) and m.glass_thickness == 0.0 for m in none.mirrors)
    changed = set()
    for name, names in EFFECTS.items():
        one = with_real_optics(rig, effects=(name,))
        for field in fields(Optics):
            value = getattr(whole.optics if field.name in names else none.optics, field.name)
            assert getattr(one.optics, field.name) == value
            changed |= {field.name} if value != getattr(none.optics, field.name) else set()
        for a, b in zip(one.mirrors, whole.mirrors, strict=True):
            assert (a.sag == b.sag) == (name == "bow") and (a.glass_thickness == b.glass_thickness) == (name == "glass")
    assert {"multipath", "attenuation", "dark", "skin", "warp", "color_shift", "uneven_floor"} <= changed
    with pytest.raises(MirrorScanError, match="no effect “fog”"):
        real("azure_kinect", effects=("fog",))


def test_ideal_is_as_if_there_were_no_optics(body):
    """Fields at their defaults, each written out, change no byte."""
    rig = small(default_rig("azure_kinect", frames=2))
    plain = simulate(body, rig)
    written = Optics(**{f.name: getattr(IDEAL, f.name) for f in fields(Optics)})
    again = simulate(
        body, replace(rig, optics=written, mirrors=tuple(replace(m, reflectivity=0.5) for m in rig.mirrors))
    )
    assert np.array_equal(plain.capture.depth, again.capture.depth)
    assert np.array_equal(plain.capture.color, again.capture.color)
    assert (plain.truth.sight.delay == 0).all()


def test_what_is_refused():
    for wrong in ({"warp": np.inf}, {"fixed_noise": 1.5, "correlated_noise": True}, {"uneven_floor": 0.5}):
        with pytest.raises(MirrorScanError, match="optics: "):
            Optics(**wrong)
    with pytest.raises(MirrorScanError, match="turn correlated_noise on"):
        Optics(fixed_noise=0.5)
    for wrong in ({"sag": (0.0, 0.2)}, {"sag": (np.nan, 0.0)}, {"glass_thickness": -0.001}, {"glass_thickness": 0.05}):
        with pytest.raises(MirrorScanError, match="rig: mirror 'm'"):
            FramedMirror("m", (0, 1, 1), (0, -1, 0), **wrong)
    with pytest.raises(MirrorScanError, match="no sensor"):
        real("kinect_v9")
