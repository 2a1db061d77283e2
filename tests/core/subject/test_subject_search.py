"""The subject among furniture, walls and other people, on a table, on a plinth, and by a click."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from mirror_scan.core.camera import RgbdImage
from mirror_scan.core.cli.commands import settings_of
from mirror_scan.core.cli.parser import build_parser
from mirror_scan.core.depth.depth_map import one_depth_map
from mirror_scan.core.errors import ReconstructionError
from mirror_scan.core.mesh import Mesh
from mirror_scan.core.mirrors.mirror import plane_mirror
from mirror_scan.core.mirrors.picked_mirror import place_mirror
from mirror_scan.core.pipeline import Settings
from mirror_scan.core.simulation import props
from mirror_scan.core.simulation.mannequin import mannequin
from mirror_scan.core.simulation.rays import BODY
from mirror_scan.core.simulation.scene import default_rig
from mirror_scan.core.simulation.simulate import simulate
from mirror_scan.core.subject.connected_pixels import Readings
from mirror_scan.core.subject.floor_plane import _fit_floor
from mirror_scan.core.subject.foot_segmentation import NEAR_FLOOR, FloorViews, share_of_feet, standing_pixels
from mirror_scan.core.subject.subject_search import find_subject
from mirror_scan.core.subject.subject_views import ViewSettings
from mirror_scan.core.views.floor_and_vertical import find_ground, leans, mirrors_vertical
from mirror_scan.core.views.rig_axis import rig_axis


def sorted_out(simulation, settings=None):
    """Views, and shares: of the subject's pixels in the right view, of what is kept that is not the subject."""
    intrinsics = simulation.capture.intrinsics
    depth = one_depth_map(simulation.capture)[0]
    mirrors = [place_mirror(RgbdImage(depth, intrinsics), m) for m in simulation.capture.mirrors]
    views = find_subject(RgbdImage(depth, intrinsics), mirrors, settings or ViewSettings())
    truth, sight = simulation.truth.labels, simulation.truth.sight
    told = np.abs(depth / np.where(sight.depth > 0, sight.depth, np.inf) - 1) < 0.02
    body, kept = told & (truth >= 0), views.labels >= 0
    right = (views.labels == truth)[body].mean()
    left = (kept & told & (sight.object != BODY)).sum() / kept.sum()
    print(f"\n{100 * right:.2f} % right, {100 * left:.3f} % left over, {[(views.labels == k).sum() for k in range(3)]}")
    return views, right, left, body


@pytest.fixture(scope="module")
def other():
    return mannequin(1.8, seed=3, resolution=0.018)


@pytest.mark.parametrize(
    "case",
    ["bystander behind", "bystander beside", "bystander behind the camera", "chair beside", "chair behind", "walls"],
)
def test_others_and_furniture_are_dropped(person, other, case):
    rig = default_rig("azure_kinect", frames=3)
    stand = {
        "bystander behind": [props.placed(other, 0.55, 1.2, 30)],
        "bystander beside": [props.placed(other, -1.75, -0.1, -50)],
        "bystander behind the camera": [props.placed(other, 0.4, -3.6, 180)],
        "chair beside": [props.placed(props.chair(), 0.62, 0.3, 20)],
        "chair behind": [props.placed(props.chair(), -0.1, 0.75, 180)],
        "walls": [],
    }[case]
    if case == "walls":
        rig = replace(rig, room=(-1.6, 1.6, -3.4, 1.05, 2.4))
    views, right, left, _ = sorted_out(simulate(person, rig, stand))
    assert right > 0.995 and left < 0.002 and views.warnings == ()


@pytest.mark.parametrize("sides", [(-1.0, 1.0), (1.0,)])
def test_toes_beyond_an_instep_without_a_reading(simulated, sides):
    """Toes are the person's although nothing is read up to the shin."""
    simulation = simulated("ideal")
    place, direct = simulation.truth.sight.point, simulation.truth.labels == 0
    dark = direct & (place[..., 2] > 0.04) & (place[..., 2] < 0.11) & np.isin(np.sign(place[..., 0]), sides)
    depth = np.where(dark, np.float32(0.0), one_depth_map(simulation.capture)[0])
    image = RgbdImage(depth, simulation.capture.intrinsics)
    views = find_subject(image, [place_mirror(image, m) for m in simulation.capture.mirrors], ViewSettings())
    toes = direct & (place[..., 2] > 0.005) & (place[..., 2] < 0.035) & (depth > 0)
    assert toes.sum() > 60 and (views.labels[toes] == 0).mean() > 0.85


@pytest.mark.parametrize(("x", "y"), [(0.17, -0.38), (0.45, -0.1), (0.0, -0.25)])
def test_a_shoe_on_the_floor_is_not_the_person(person, x, y):
    shoe = trimesh.creation.box((0.09, 0.2, 0.07), trimesh.transformations.translation_matrix((0, 0, 0.035)))
    shoe = Mesh(np.array(shoe.vertices), np.array(shoe.faces, np.int32), np.full((8, 3), 90, np.uint8))
    _, right, left, _ = sorted_out(
        simulate(person, default_rig("azure_kinect", frames=3), [props.placed(shoe, x, y, 0)])
    )
    assert right > 0.99 and left < 0.002


@pytest.mark.parametrize(
    ("wrists", "mirrors", "object_"),
    [("both", "dark", False), ("one", "dark", False), ("whole arms", "dark", False), ("none", "dark", False),
     ("one", "one dark", False), ("both", "one pixel", False), ("none", "one pixel", False),
     ("both", "hands only", False), ("both", "dark", True), ("one", "one pixel", True)],
)  # fmt: skip
def test_dark_cloth_and_dark_mirrors(simulated, wrists, mirrors, object_):
    """Sleeves without a reading part the hands from the body; mirrors may show nothing at all, or a pixel."""
    simulation = simulated("ideal")
    truth, place = simulation.truth.labels, simulation.truth.sight.point
    aside = np.abs(place[..., 0]) > 0.2
    sleeve = aside & (place[..., 2] > 0.9 if wrists != "whole arms" else place[..., 2] > 0.6) & (place[..., 2] < 1.45)
    sleeve &= {"both": True, "one": place[..., 0] > 0, "whole arms": True, "none": False}[wrists]
    dark = sleeve & (truth == 0)
    if mirrors == "one pixel":
        one = np.argwhere(truth == 1)[len(np.argwhere(truth == 1)) // 2]
        dark |= truth > 0
        dark[tuple(one)] = False
    else:
        dark |= {"dark": truth > 0, "one dark": (truth == 1) | (sleeve & (truth == 2)),
                 "hands only": (truth > 0) & ~(aside & (place[..., 2] < 0.9))}[mirrors]  # fmt: skip
    intrinsics = simulation.capture.intrinsics
    depth = np.where(dark, 0, one_depth_map(simulation.capture)[0]).astype(np.float32)
    placed = [
        place_mirror(RgbdImage(one_depth_map(simulation.capture)[0], intrinsics), m) for m in simulation.capture.mirrors
    ]
    views = find_subject(RgbdImage(depth, intrinsics), placed, ViewSettings(object=object_))
    trunk = (truth == 0) & ~aside
    assert (views.labels == 0)[trunk].mean() > 0.98
    assert not (views.labels[truth < 0] >= 0).any() or (views.labels >= 0)[truth < 0].mean() < 1e-3
    blind = [m.name for k, m in enumerate(placed, start=1) if not (views.labels == k).any()]
    assert [name for name in blind if not any(name in text for text in views.warnings)] == []


def test_feet_and_hair_stay_and_the_floor_goes(simulated):
    for sensor in ("ideal", "azure_kinect", "realsense_d455", "kinect_v1"):
        simulation = simulated(sensor)
        views, _, left, body = sorted_out(simulation)
        height = simulation.truth.sight.point[..., 2]
        for name, part, limit in (("feet", height < 0.12, 0.02), ("hair", height > 1.58, 0.005)):
            lost = (views.labels < 0)[body & part].mean()
            print(f"{sensor}: {name} {100 * lost:.2f} % lost")
            assert lost < limit
        assert left < 0.002
        assert views.limits.shape == (3, 2) and (views.limits[1:, 0] > views.limits[0, 1]).all()


def test_a_mirror_s_floor_is_told_from_what_lies_across_it():
    """A sheet of images of images through the floor, feet on it, and only a strip of it: the floor's plane stays."""
    rng = np.random.default_rng(0)
    up, center = np.array((0.0, -1.0, 0.0)), np.array((0.0, 0.0, 2.6))

    def points(count: int, height: Callable[[np.ndarray, np.ndarray], np.ndarray], wide: float) -> np.ndarray:
        x, y = rng.uniform(0.2, 0.2 + wide, count), rng.uniform(-0.9, 0.9, count)
        return center + np.column_stack((x, -height(x, y), y))

    for wide, noise in ((0.8, 0.0005), (0.8, 0.004), (0.05, 0.004)):
        floor = points(700, lambda x, y: -0.9 + 0.004 + 0.002 * x + rng.normal(0, noise, len(x)), wide)  # noqa: B023
        across = points(350, lambda x, y: -0.9 + 0.08 * y, wide)
        feet = points(150, lambda x, y: -0.9 + rng.uniform(0, 0.12, len(x)), 0.1)
        sample = np.concatenate((floor, across, feet))
        sample = sample[np.abs(sample @ up + 0.9) < 0.12]
        normal, d, _, spread = _fit_floor(sample, up, -0.9, center, 0.01)
        at = center + np.array(((0.4, 0.8952, 0.0), (-0.3, 0.8966, 0.0), (0.2, 0.8956, 0.5)))
        assert np.abs(at @ normal - d).max() < 0.0015 + noise and spread < 1.5 * noise + 0.0003
    feet = points(150, lambda x, y: -0.9 + rng.uniform(0, 0.12, len(x)), 0.1)
    assert _fit_floor(feet, up, -0.9, center, 0.008) is None


def test_how_much_floor_there_is_for_feet():
    rng = np.random.default_rng(0)
    noise, edges = 0.003, np.linspace(-NEAR_FLOOR, NEAR_FLOOR, 121)
    feet = rng.uniform(0.0, NEAR_FLOOR, 12_000)
    for lift in (0.0, 0.004):
        for ground in (400, 4_000, 40_000):
            level = np.concatenate((rng.normal(0.0, noise, ground), feet)) + lift
            share = share_of_feet(np.histogram(level, edges)[0], lift, noise)
            assert share == pytest.approx(12_000 / NEAR_FLOOR / ground, rel=0.25)
    assert share_of_feet(np.zeros(120, np.int64), 0.0, noise) > 0


@pytest.mark.parametrize(("distance", "noise"), [(2.4, 0.0), (2.4, 0.011), (4.8, 0.023)])
def test_a_foot_begins_where_its_column_does(distance, noise):
    """A box on the floor, read with noise of z [m] that lifts the floor by more than the box's first row."""
    rng = np.random.default_rng(0)
    height, width, focal, eye = 200, 120, 430.0, 1.0
    v, u = np.indices((height, width))
    rays = np.stack(((u - 60) / focal, (v - 120.6) / focal + eye / distance, np.ones(v.shape)), axis=-1)
    floor = np.where(rays[..., 1] > 0.05, eye / np.maximum(rays[..., 1], 1e-9), 0.0)
    box = (np.abs(u - 60) < 12) & (floor > distance) & (distance * rays[..., 1] > eye - 0.15)
    true = np.where(box, distance, floor)
    depth = true + noise * (true / distance) ** 2 * rng.standard_normal(true.shape) * (true > 0)
    seen = np.where(true > 0, 0, -1).astype(np.int8)
    up = np.array((0.0, -1.0, 0.0))
    about = np.abs(floor - distance) < 0.4
    lifts = (depth[..., None] * rays @ up + eye)[about & ~box]
    quiet = np.median(np.abs(lifts)) * 1.4826 / 2.2  # of a row's median
    share = box.sum() / 0.15 / (about & ~box).sum()
    readings = Readings(depth, seen, rays * depth[..., None], up, 1 / focal)
    ground = FloorViews(np.array([[*up, -eye]]), np.array([quiet]), np.array([share]), 0.0)
    found = standing_pixels(readings, ground, 0, np.inf, 0.002) == 0
    around = np.abs(u - 60) < 9
    rows = box.any(axis=1).sum()
    lost, left = (box & ~found & around).sum(axis=0), (found & ~box & around & about).sum(axis=0)
    print(f"{distance} m, noise of a row {1000 * quiet:.1f} mm: lost {lost.sum()}, left {left.sum()} of {rows} rows")
    assert lost.sum() <= 0.4 * around[0].sum() and left.sum() <= 0.4 * around[0].sum()
    assert not found[about & (np.abs(u - 60) > 20)].any()


def test_a_head_out_of_the_picture_is_kept_in_the_mirrors(person):
    simulation = simulate(person, default_rig("ideal", 2.0, tilt_deg=9.0))
    views, _, left, body = sorted_out(simulation)
    height = simulation.truth.sight.point[..., 2]
    head = body & (height > height[body].max() - 0.12)
    assert head.sum() > 300 and not (simulation.truth.labels[head] == 0).any()
    assert (views.labels[head] < 0).mean() < 0.01 and left < 0.002


@pytest.mark.parametrize("case", ["mirrors lean", "chair beside"])
def test_feet_stay(person, case):
    """Kinect v1: steps of 6 cm on the mirrored floor, mirrors that lean, a heel behind a chair's leg."""
    rig = default_rig("kinect_v1", frames=10, lean_deg=(2.5, -2.0) if case == "mirrors lean" else 0.0)
    chair = [props.placed(props.chair(), 0.62, 0.3, 20)] if case == "chair beside" else []
    simulation = simulate(person, rig, chair)
    views, _, left, body = sorted_out(simulation)
    feet = body & (simulation.truth.sight.point[..., 2] < 0.12)
    assert (views.labels[feet] < 0).mean() < 0.02 and left < 0.002


def test_a_click_chooses(person, other):
    """Somebody nearer to the rig's crossing than the one who is meant, clicked on directly and in a mirror."""
    rig = default_rig("azure_kinect", frames=2, mirrors=[125.0])
    meant = replace(person, vertices=person.vertices + (-0.75, 0.3, 0))
    simulation = simulate(meant, rig, [props.placed(other, 0.35, -0.1)])
    assert sorted_out(simulation)[1] < 0.5, "without a click the one at the crossing is taken"
    for view in (0, 1):
        rows, columns = np.nonzero(simulation.truth.labels == view)
        middle = len(rows) // 2
        settings = ViewSettings(click=(float(columns[middle]), float(rows[middle])))
        views, right, left, _ = sorted_out(simulation, settings)
        assert (views.labels == 0).sum() > 10_000 and right > 0.9 and left < 0.02
    with pytest.raises(ReconstructionError, match="outside the 640×576"):
        sorted_out(simulation, ViewSettings(click=(700.0, 20.0)))


@pytest.mark.parametrize("stand", ["floor", "table", "plinth"])
def test_a_thing(stand):
    """Not a person: 40 cm tall, on the floor, a table or a plinth, which is cut off."""
    height = {"floor": 0.0, "table": 0.72, "plinth": 0.6}[stand]
    thing = mannequin(0.42, resolution=0.0045)
    thing = replace(thing, vertices=thing.vertices + (0, 0, height))
    rig = default_rig("azure_kinect", frames=4, subject_distance=1.4, path_length=2.8, camera_height=height + 0.55,
                      tilt_deg=14.0)  # fmt: skip
    under = {"floor": [], "table": [props.table()], "plinth": [props.plinth()]}[stand]
    views, right, left, _ = sorted_out(simulate(thing, rig, under), ViewSettings(object=True))
    assert right > 0.97 and left < 0.01
    assert views.floor == pytest.approx(-0.55, abs=0.012), "the height of what it stands on, from the camera"


@pytest.mark.parametrize("height", [0.03, 0.12])
def test_a_mat_or_a_step_is_cut_off(person, height):
    mat = props.box((-0.45, -0.4, 0.0), (0.45, 0.4, height))
    standing = replace(person, vertices=person.vertices + (0, 0, height))
    simulation = simulate(standing, default_rig("azure_kinect"), [mat])
    views, right, left, _ = sorted_out(simulation)
    assert right > 0.99 and left < 0.002
    assert f"{100 * height:.0f} cm above the floor, is cut off" in views.warnings[0]


@pytest.mark.parametrize(
    ("sensor", "thick", "pitch"),
    [
        ("ideal", 0.015, 2.3), ("azure_kinect", 0.008, 2.3), ("kinect_v1", 0.015, 2.3), ("kinect_v1", 0.025, 2.3),
        ("realsense_d455", 0.015, 20.0), ("azure_kinect", 0.008, 20.0), ("azure_kinect", 0.025, 2.3),
    ],
)  # fmt: skip
def test_a_carpet_is_floor(person, sensor, thick, pitch):
    """Thinner than what may be told from the floor by its edges; feet do not pay for it, and nobody hears of it."""
    carpet = props.box((-0.75, -0.65, 0.0), (0.75, 0.65, thick))
    standing = replace(person, vertices=person.vertices + (0, 0, thick))
    height = 0.85 + 2.5 * np.tan(np.radians(pitch))
    rig = default_rig(sensor, frames=10, tilt_deg=pitch, camera_height=height)
    simulation = simulate(standing, rig, [carpet])
    views, right, left, body = sorted_out(simulation)
    feet = body & (simulation.truth.sight.point[..., 2] < thick + 0.12)
    assert right > 0.99 and left < 0.004 and (views.labels[feet] >= 0).mean() > 0.98
    direct = (views.labels == 0) & (simulation.truth.labels < 0) & (simulation.truth.sight.object != BODY)
    # a camera that matches pictures reads silhouettes too wide
    assert direct.sum() < (0.09 if sensor == "realsense_d455" else 0.005) * (views.labels == 0).sum()
    assert views.warnings == ()


def test_what_stands_before_the_legs(person):
    """A chair between camera and legs: its back, that only mirrors show, goes, and what is seen of the feet below it
    stays."""
    chair = props.placed(props.chair(), -0.05, -0.6, 170)
    views, right, left, body = sorted_out(simulate(person, default_rig("azure_kinect", frames=3), [chair]))
    assert right > 0.98 and left < 0.002


@pytest.mark.parametrize("what", ["box", "stool", "low table"])
def test_something_before_the_legs(person, what):
    """Of a foot that is seen beside or below it nothing is lost, and of the thing, whose back mirrors show, hardly
    anything is kept."""
    prop = {
        "box": props.placed(props.box((-0.2, -0.15, 0.0), (0.2, 0.15, 0.35)), -0.05, -0.5, 10),
        "stool": props.placed(props.table(0.36, 0.32, 0.45), 0.14, -0.5, 10),
        "low table": props.placed(props.table(0.9, 0.45, 0.45), 0.0, -0.6, -15),
    }[what]
    simulation = simulate(person, default_rig("azure_kinect", frames=1), [prop])
    views, right, left, body = sorted_out(simulation)
    feet = body & (simulation.truth.sight.point[..., 2] < 0.12)
    assert (views.labels[feet] >= 0).mean() > 0.98
    assert right > 0.995 and left < 0.002


@pytest.mark.parametrize("what", ["chair", "stool", "lamp", "suitcase"])
def test_a_thing_whole(what):
    """Thin legs that hide each other, a foot below a shade, a handle on a lid: all is kept, nothing is a plinth."""
    box = props.box
    thing = {
        "chair": props.placed(props.chair(), 0, 0, 75),
        "stool": props.placed(props.together(
            box((-0.17, -0.17, 0.42), (0.17, 0.17, 0.45)),
            *(box((x, y, 0), (x + 0.025, y + 0.025, 0.42)) for x in (-0.16, 0.135) for y in (-0.16, 0.135)),
        ), 0, 0, 30),
        "lamp": props.together(
            box((-0.15, -0.15, 0), (0.15, 0.15, 0.03)), box((-0.012, -0.012, 0.03), (0.012, 0.012, 1.1)),
            box((-0.2, -0.2, 1.1), (0.2, 0.2, 1.4)),
        ),
        "suitcase": props.placed(props.together(
            box((-0.26, -0.11, 0), (0.26, 0.11, 0.7)), box((-0.1, 0.03, 0.7), (-0.08, 0.05, 0.98)),
            box((0.08, 0.03, 0.7), (0.1, 0.05, 0.98)), box((-0.1, 0.03, 0.98), (0.1, 0.05, 1.0)),
        ), 0, 0, 20),
    }[what]  # fmt: skip
    simulation = simulate(thing, default_rig("azure_kinect", frames=4))
    views, right, left, body = sorted_out(simulation, ViewSettings(object=True))
    assert right > 0.98 and left < 0.003 and views.warnings == ()


def test_a_click_keeps_what_a_thing_stands_on():
    thing = props.together(props.plinth(), props.placed(props.box((-0.1, -0.1, 0), (0.1, 0.1, 0.3)), 0, 0, 30, 0.6))
    simulation = simulate(thing, default_rig("azure_kinect", frames=2, camera_height=1.2, tilt_deg=15.0))
    rows, columns = np.nonzero((simulation.truth.labels == 0) & (simulation.truth.sight.point[..., 2] < 0.4))
    for click in (None, (float(np.median(columns)), float(np.median(rows)))):
        views, right, _, _ = sorted_out(simulation, ViewSettings(object=True, click=click))
        assert right > 0.98 if click else right < 0.7
        assert bool(views.warnings) is (click is None) and all("60 cm above" in text for text in views.warnings)


def test_where_mirrors_look_that_reach_out_of_the_image():
    rig = default_rig("azure_kinect", 1.6, path_length=3.6, camera_height=0.72, tilt_deg=17.0, frames=1)
    simulation = simulate(props.box((-0.15, -0.15, 0), (0.15, 0.15, 0.4)), rig)
    intrinsics, depth = simulation.capture.intrinsics, simulation.capture.depth[0]
    mirrors = [place_mirror(RgbdImage(depth, intrinsics), m) for m in simulation.capture.mirrors]
    assert any(not np.isfinite(m.outline).all() for m in mirrors)
    up = np.linalg.inv(rig.camera_to_avatar)[:3, 2]
    meeting = rig.camera_to_avatar[:3, :3] @ rig_axis(mirrors, up, intrinsics) + rig.camera_to_avatar[:3, 3]
    assert np.hypot(*meeting[:2]) < 0.25


@pytest.mark.parametrize(("sensor", "pan"), [("kinect_v1", 18.0), ("azure_kinect", 24.0), ("azure_kinect", -22.0)])
def test_somebody_at_the_images_side(person, sensor, pan):
    """The camera is turned away, so that one mirror is out of its picture, and nothing is where it looks."""
    simulation = simulate(person, replace(default_rig(sensor, frames=3), pan_deg=pan))
    views, right, left, _ = sorted_out(simulation)
    assert right > 0.99 and left < 0.004 and (views.labels == 0).sum() > 10_000


def test_something_small_at_the_images_side_is_nobody():
    rig = replace(default_rig("azure_kinect", frames=3), pan_deg=24.0)
    with pytest.raises(ReconstructionError, match="nobody stands"):
        sorted_out(simulate(props.box((-0.05, -0.05, 0.0), (0.05, 0.05, 0.02)), rig))


def test_gravity_from_mirrors_and_floor():
    up = np.array((0.0, -1.0, 0.0))
    lean = np.radians(5.0)
    upright = plane_mirror("a", (1, 0, 3), (-0.6, 0, -0.8))
    leaning = plane_mirror("b", (-1, 0, 3), (0.6 * np.cos(lean), np.sin(lean), -0.8 * np.cos(lean)))
    assert leans([upright, leaning], up) == pytest.approx([0.0, 5.0], abs=1e-9)
    rng = np.random.default_rng(0)
    floor = np.column_stack((rng.uniform(-2, 2, 9000), np.full(9000, 0.9), rng.uniform(1, 4, 9000)))
    seen = np.zeros((90, 100), np.int8)
    ground = find_ground(floor.reshape(90, 100, 3), seen, [upright, leaning])
    np.testing.assert_allclose(ground.up, up, atol=1e-6)
    assert ground.floor == pytest.approx(-0.9) and 4.0 < ground.disagreement_deg < 9.0
    # seen only by way of a mirror it is still the floor
    assert find_ground(floor.reshape(90, 100, 3), seen + 1, [upright]).floor == pytest.approx(-0.9)
    nothing = find_ground(floor.reshape(90, 100, 3), seen - 1, [upright, leaning])
    assert nothing.floor is None and nothing.disagreement_deg is None
    assert mirrors_vertical([upright, leaning])[1] and not mirrors_vertical([upright])[1]


def test_options_on_the_command_line(capsys):
    line = ["reconstruct", "scan", "-o", "a.ply"]
    options = build_parser("mirror-scan").parse_args([*line, "--subject", "120,340.5", "--object", "--keep-islands"])
    settings = settings_of(options)
    assert settings.views == ViewSettings(click=(120.0, 340.5), object=True) and settings.closing.keep_islands
    assert settings_of(build_parser("mirror-scan").parse_args(line)) == Settings()
    for text in ("12", "a,b", "1,nan"):
        with pytest.raises(SystemExit):
            build_parser("mirror-scan").parse_args([*line, "--subject", text])
        assert "--subject" in capsys.readouterr().err
