"""Every pixel's view and whether it is the subject's, against the rig's truth; empty rooms and blind mirrors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirror_scan.core.camera import Intrinsics, RgbdImage, unproject
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.errors import ReconstructionError
from mirror_scan.core.mirrors.mirror import plane_mirror, reflect
from mirror_scan.core.mirrors.picked_mirror import place_mirror
from mirror_scan.core.simulation.rays import BODY
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate
from mirror_scan.core.subject.connected_pixels import connected_pixels
from mirror_scan.core.subject.subject_search import find_subject
from mirror_scan.core.views.floor_and_vertical import find_floor, vertical
from mirror_scan.core.views.ray_sorting import sort_rays
from scipy.ndimage import binary_dilation


def prepared(simulation):
    """Depth and mirrors as the pipeline has them when it looks for the subject."""
    intrinsics = simulation.capture.intrinsics
    depth = one_depth_map(simulation.capture)[0]
    return depth, [place_mirror(RgbdImage(depth, intrinsics), m) for m in simulation.capture.mirrors]


def avatar(simulation, vectors):
    return np.asarray(vectors) @ simulation.truth.camera_to_avatar[:3, :3].T


@pytest.mark.parametrize("sensor", ["ideal", "kinect_v1", "azure_kinect", "realsense_d455"])
def test_labels_of_the_subject(simulated, sensor):
    simulation = simulated(sensor)
    depth, mirrors = prepared(simulation)
    views = find_subject(RgbdImage(depth, simulation.capture.intrinsics), mirrors)
    truth, sight = simulation.truth.labels, simulation.truth.sight
    body = (truth >= 0) & (depth > 0)
    # on a silhouette a sensor may read what is behind
    body &= np.abs(depth / np.where(body, sight.depth, 1) - 1) < 0.05
    right = (views.labels == truth)[body].mean()
    wrong_view = ((views.labels >= 0) & (views.labels != truth))[body].mean()
    # stereo fattens a silhouette by up to two pixels: those are read on the body
    beside = np.select(
        [binary_dilation(truth == k, np.ones((5, 5))) & (views.labels == k) for k in range(3)], [True] * 3
    )
    ghosts = ((views.labels >= 0) & (truth < 0) & ~beside).sum() / (truth >= 0).sum()
    each = [(views.labels == k)[body & (truth == k)].mean() for k in range(3)]
    print(f"\n{sensor}: {100 * right:.2f} % right ({', '.join(f'{100 * e:.2f}' for e in each)}), "
          f"{100 * wrong_view:.3f} % in another view, ghosts {100 * ghosts:.2f} %")  # fmt: skip
    assert right > 0.99 and min(each) > 0.98 and wrong_view < 1e-3
    assert ghosts < 0.005
    assert views.warnings == () and views.labels.dtype == views.seen.dtype == np.int8
    tilt = np.degrees(np.arccos(np.clip(avatar(simulation, views.up)[2], -1, 1)))
    assert tilt < 0.5
    camera = simulation.truth.camera_to_avatar[:3, 3]
    assert views.floor == pytest.approx(-camera @ avatar(simulation, views.up), abs=0.01)
    assert np.linalg.norm((avatar(simulation, views.axis) + camera)[:2]) < 0.15


def test_rays_are_sorted_and_readings_placed(simulated):
    """On an ideal sensor every reading of the body, through whichever mirror, is put back onto the body."""
    simulation = simulated("ideal")
    intrinsics = simulation.capture.intrinsics
    depth, mirrors = prepared(simulation)
    seen, placed = sort_rays(unproject(depth, intrinsics), mirrors, 0.0)
    sight = simulation.truth.sight
    once = (depth > 0) & (sight.bounces <= 1) & (sight.object == BODY)
    assert (seen == sight.view)[once].mean() > 0.995
    assert (seen[depth == 0] == -1).all()
    truth = unproject(sight.depth.astype(np.float32), intrinsics)
    for k, given in enumerate(simulation.truth.mirrors, start=1):
        mine = once & (sight.view == k)
        truth[mine] = reflect(truth[mine], plane_mirror(given.name, given.point, given.normal))
    error = np.linalg.norm(placed - truth, axis=-1)[once & (seen == sight.view)]
    assert np.percentile(error, 99) < 0.004
    limited, _ = sort_rays(unproject(depth, intrinsics), mirrors, 3.5)
    np.testing.assert_array_equal(limited, np.where(depth <= 3.5, seen, -1))


def test_images_of_images_are_nobody_s():
    """Two mirrors at a right angle: points seen directly, by either, and by one after the other."""
    behind = replace(plane_mirror("behind", (0, 0, 3.0), (0, 0, -1)), rectangle=np.array(((-1, 1), (-1, 1))))
    beside = replace(plane_mirror("beside", (1.0, 0, 2.0), (-1, 0, 0)), rectangle=np.array(((-1.9, 1.9), (-1, 1))))
    rng = np.random.default_rng(0)
    real = rng.uniform((-0.3, -0.3, 1.2), (0.3, 0.3, 1.8), (200, 3))
    through = reflect(real, beside)
    points = np.stack((real, reflect(real, behind), through, reflect(through, behind)))
    seen, placed = sort_rays(points, [behind, beside], 0.0)
    assert (seen[0] == 0).all() and (seen[1] == 1).all() and (seen[2] == 2).all()
    assert (seen[3] == -1).all(), "an image of an image was taken for somebody"
    np.testing.assert_allclose(placed[:3], np.broadcast_to(real, (3, 200, 3)), atol=1e-12)


def test_the_glass_s_outline_decides():
    """A round glass: rays through it are reflected, those that pass its rectangle's corners see the wall behind."""
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    square = replace(plane_mirror("square", (0, 0, 2.0), (0, 0, -1)), rectangle=np.array(((-0.5, 0.5), (-0.5, 0.5))))
    intrinsics = Intrinsics(201, 201, 200.0, 200.0, 100.0, 100.0)
    polygon = 0.5 * np.column_stack((np.cos(angle), np.sin(angle)))
    depth = np.full((201, 201), 4.0, np.float32)
    points = unproject(depth, intrinsics)
    v, u = np.mgrid[:201, :201] - 100.0
    radius = np.hypot(u, v)
    furthest = np.maximum(abs(u), abs(v))
    for mirror, from_middle in ((replace(square, polygon=polygon), radius), (square, furthest)):
        seen, _ = sort_rays(points, [mirror])
        inside, sure = from_middle < 49.9, abs(from_middle - 50) > 0.5
        np.testing.assert_array_equal((seen == 1)[sure], inside[sure])
    # what stands before the glass is seen directly, wherever the ray would go on to
    near = np.full_like(depth, 1.5)
    assert (sort_rays(unproject(near, intrinsics), [square])[0] == 0).all()
    assert (sort_rays(points, [square], near=4.5)[0] == -1).all()


def test_nobody_there(simulated, person):
    rig = replace(default_rig("azure_kinect", frames=2), seed=4)
    gone = replace(person, vertices=person.vertices + (0, -30, 0))
    simulation = simulate(gone, rig)
    assert (simulation.truth.labels < 0).all()
    depth, mirrors = prepared(simulation)
    with pytest.raises(ReconstructionError, match="nobody"):
        find_subject(RgbdImage(depth, rig.intrinsics), mirrors)
    with pytest.raises(ReconstructionError, match="nobody"):
        find_subject(RgbdImage(np.zeros_like(depth), rig.intrinsics), mirrors)


def test_a_mirror_that_shows_nobody(person):
    rig = default_rig("azure_kinect", frames=2)
    right, left = rig.mirrors
    away = replace(left, normal=(0.05, -1.0, 0.0))
    simulation = simulate(person, replace(rig, mirrors=(right, away)))
    assert (simulation.truth.labels != 2).all()
    depth, mirrors = prepared(simulation)
    views = find_subject(RgbdImage(depth, rig.intrinsics), mirrors)
    assert len(views.warnings) == 1 and views.warnings[0].startswith("left:") and "nobody" in views.warnings[0]
    assert set(np.unique(views.labels).tolist()) == {-1, 0, 1}
    body = (simulation.truth.labels >= 0) & (depth > 0)
    assert (views.labels == simulation.truth.labels)[body].mean() > 0.98


def test_up_from_the_mirrors():
    mirrors = [plane_mirror("a", (1, 0, 3), (-0.6, 0, -0.8)), plane_mirror("b", (-1, 0, 3), (0.6, 0, -0.8))]
    np.testing.assert_allclose(vertical(mirrors), (0, -1, 0), atol=1e-12)
    np.testing.assert_allclose(vertical(mirrors[::-1]), (0, -1, 0), atol=1e-12)
    assert vertical(mirrors[:1]).tolist() == vertical([]).tolist() == [0, -1, 0]
    parallel = [mirrors[0], plane_mirror("c", (1.2, 0, 3), (-0.6, 0, -0.8))]
    np.testing.assert_allclose(vertical(parallel), (0, -1, 0))
    roll = np.array([[np.cos(0.2), -np.sin(0.2), 0], [np.sin(0.2), np.cos(0.2), 0], [0, 0, 1]])
    turned = [plane_mirror(m.name, roll @ m.point, roll @ m.normal) for m in mirrors]
    np.testing.assert_allclose(vertical(turned), roll @ (0, -1, 0), atol=1e-12)


@pytest.mark.parametrize(("tilt", "noise"), [(0.0, 0.0), (0.0, 0.0005), (4.0, 0.004), (9.0, 0.01)])
def test_the_floor_under_things(tilt, noise):
    rng = np.random.default_rng(0)
    angle = np.radians(tilt)
    up = np.array((0.0, -np.cos(angle), np.sin(angle)))
    across, along = np.array((1.0, 0, 0)), np.cross((1.0, 0, 0), up)
    height = -0.9
    floor = rng.uniform(-1.5, 1.5, (6000, 2)) @ (across, along) + (height + noise * rng.normal(size=(6000, 1))) * up
    table = rng.uniform(-0.4, 0.4, (1500, 2)) @ (across, along) + (height + 0.7) * up
    body = rng.uniform((-0.2, -0.1), (0.2, 0.1), (3000, 2)) @ (across, along) + rng.uniform(height, 0.8, (3000, 1)) * up
    found, at, sigma = find_floor(np.concatenate((floor, table, body)) + 3 * along, np.array((0, -1.0, 0)))
    assert np.degrees(np.arccos(min(found @ up, 1))) < 0.15
    assert at == pytest.approx(3 * along @ found + height, abs=0.003)
    assert sigma == pytest.approx(noise, abs=0.0015)


def test_no_floor_in_sight():
    rng = np.random.default_rng(1)
    wall = np.column_stack((rng.uniform(-2, 2, 5000), rng.uniform(-1, 1, 5000), np.full(5000, 4.0)))
    assert find_floor(wall, np.array((0, -1.0, 0))) is None
    assert find_floor(wall[:50], np.array((0, -1.0, 0))) is None
    assert find_floor(np.empty((0, 3)), np.array((0, -1.0, 0))) is None


def test_connected_pixels():
    depth = np.full((20, 30), 2.0, np.float32)
    depth[:, 15:] = 2.3
    seen = np.zeros((20, 30), np.int8)
    component, sizes = connected_pixels(depth, seen, 1 / 500)
    assert sizes.tolist() == [300, 300] and (component == (depth > 2.1)).all()
    seen[10, :] = -1  # a line of drop-outs parts nothing
    component, sizes = connected_pixels(depth, seen, 1 / 500)
    assert sizes.tolist() == [285, 285] and (component[10] == -1).all()
    seen[9:12] = -1
    assert len(connected_pixels(depth, seen, 1 / 500)[1]) == 4
    seen[:] = 0
    seen[:, 10:] = 1  # another view is another component, at whatever depth
    assert sorted(connected_pixels(np.full((20, 30), 2.0, np.float32), seen, 1 / 500)[1].tolist()) == [200, 400]
    component, sizes = connected_pixels(depth, np.full((20, 30), -1, np.int8), 1 / 500)
    assert len(sizes) == 0 and (component == -1).all()
