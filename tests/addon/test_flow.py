"""The flow as scripts use it, on a virtual capture: what each operator leaves in the file, and how it lasts."""

from __future__ import annotations

import json
import os
import shutil

import numpy as np
import pytest

pytest.importorskip("bpy")

BLOCKS = ("objects", "meshes", "materials", "images", "collections", "cameras", "scenes")


def settings_of(bpy):
    return bpy.context.scene.mirror_scan


def count(bpy) -> dict[str, int]:
    return {name: len(getattr(bpy.data, name)) for name in BLOCKS}


def reports(bpy, capfd) -> str:
    return capfd.readouterr().out


# --- capture ------------------------------------------------------------------------------------------------------


def test_loading_keeps_the_depth_map_exactly(bpy, scan, loaded):
    from mirror_scan.core.capture import open_capture
    from mirror_scan.core.depth.depth_map import one_depth_map
    from mirror_scan.mirror_scan_addon.scene.point_cloud import cloud_info, read_cloud

    capture = open_capture(scan[0])
    depth = one_depth_map(capture)[0]
    arrays = read_cloud(loaded)
    np.testing.assert_array_equal(arrays.depth, depth)
    assert arrays.intrinsics == capture.intrinsics
    np.testing.assert_array_equal(arrays.color[depth > 0], capture.color[depth > 0])
    info = cloud_info(loaded)
    assert info["frames"] == 4 and info["format"] == capture.format
    settings = settings_of(bpy)
    for image, pixels in ((settings.color_image, capture.color), (settings.depth_image, None)):
        assert tuple(image.size) == (320, 288) and image.packed_file is not None
        shown = np.empty(4 * 320 * 288, np.float32)
        image.pixels.foreach_get(shown)
        if pixels is not None:
            np.testing.assert_array_equal(np.rint(shown.reshape(288, 320, 4)[::-1, :, :3] * 255), pixels[::2, ::2])
    assert bpy.context.object == loaded and settings.capture_path == str(scan[0])


def test_the_points_stand_upright_before_anything_is_known(bpy, loaded):
    from mirror_scan.mirror_scan_addon.scene.point_cloud import read_cloud

    points = read_cloud(loaded).points
    matrix = np.array(loaded.matrix_world)
    world = points @ matrix[:3, :3].T + matrix[:3, 3]
    heights = np.histogram(world[:, 2], bins=np.arange(-0.2, 2, 0.02))[0]
    assert abs(np.arange(-0.19, 2, 0.02)[np.argmax(heights)]) < 0.03  # most of what lies level is the floor


@pytest.mark.parametrize("part", ["", "intrinsic.json", "depth/000001.png", "color/000000.png"])
def test_any_file_of_a_capture_stands_for_it(bpy, scan, part):
    assert bpy.ops.mirror_scan.load_capture(filepath=os.path.join(scan[0], part), frames=1) == {"FINISHED"}
    assert settings_of(bpy).frames == 1 and len(settings_of(bpy).mirrors) == 2


def test_loading_again_replaces(bpy, scan, loaded):
    before = count(bpy)
    bpy.ops.mirror_scan.load_capture(filepath=str(scan[0]))
    assert count(bpy) == before
    settings = settings_of(bpy)
    assert [item.name for item in settings.mirrors] == ["right", "left"]
    assert [settings.cloud.name, settings.color_image.name] == ["capture Points", "capture colour"]  # no “.001”


def test_what_the_files_do_not_say_is_said_in_the_scene(bpy, scan, tmp_path):
    from mirror_scan.mirror_scan_addon.scene import point_cloud

    folder = tmp_path / "capture"
    shutil.copytree(scan[0], folder, ignore=shutil.ignore_patterns("truth", "intrinsic.json", "image"))
    with pytest.raises(RuntimeError, match="intrinsic.json: is missing"):
        bpy.ops.mirror_scan.load_capture(filepath=str(folder))
    reading = settings_of(bpy).reading
    reading.intrinsics = str(scan[0] / "intrinsic.json")
    bpy.ops.mirror_scan.load_capture(filepath=str(folder))
    plain = point_cloud.read_cloud(settings_of(bpy).cloud)
    assert bpy.ops.mirror_scan.build_avatar() == {"FINISHED"}
    assert 1.5 < bpy.context.object.dimensions.z < 2.0
    reading.turn, reading.mirrored, reading.color, reading.depth_unit_mm = "90", "YES", False, 2.0
    (folder / "mirrors.json").unlink()
    bpy.ops.mirror_scan.load_capture()
    turned = point_cloud.read_cloud(settings_of(bpy).cloud)
    as_said = 2 * np.rot90(plain.depth[:, ::-1], -1)
    assert turned.depth.shape == as_said.shape
    assert np.isclose(turned.depth, as_said, atol=1e-6).mean() > 0.9999  # cleaning goes by the distance
    assert turned.color is None
    reading.intrinsics = str(tmp_path / "none.json")
    with pytest.raises(RuntimeError, match="Error: .*none.json"):
        bpy.ops.mirror_scan.load_capture()


def test_a_live_camera_is_recorded_and_shown(bpy, scan, tmp_path, monkeypatch):
    import contextlib

    from mirror_scan.core.capture import live_camera, open_capture

    capture = open_capture(scan[0])

    @contextlib.contextmanager
    def camera(*arguments):
        yield live_camera.Stream(capture.intrinsics, "realsense_d455", iter([(capture.depth[0], capture.color)] * 40))

    monkeypatch.setitem(live_camera.DRIVERS, "realsense", camera)
    folder = tmp_path / "new"
    assert bpy.ops.mirror_scan.record(filepath=str(folder), frames=2) == {"FINISHED"}
    assert len(list((folder / "depth").iterdir())) == 2
    settings = settings_of(bpy)
    assert settings.capture_path == str(folder) and len(settings.cloud.data.vertices) > 100_000
    with pytest.raises(RuntimeError, match="exists already"):
        bpy.ops.mirror_scan.record(filepath=str(folder), frames=2)


def test_handlers_take_what_belongs_to_captures(bpy):
    from mirror_scan.mirror_scan_addon.operators.load_capture import MIRRORSCAN_FH_capture, MIRRORSCAN_FH_picture

    for handler in (MIRRORSCAN_FH_capture, MIRRORSCAN_FH_picture):
        assert handler.bl_import_operator == "mirror_scan.drop_look"
        assert handler.is_registered
    assert ".mkv" in MIRRORSCAN_FH_capture.bl_file_extensions.split(";")
    from types import SimpleNamespace

    def at(area, region):
        return SimpleNamespace(area=SimpleNamespace(type=area), region=SimpleNamespace(type=region))

    assert MIRRORSCAN_FH_capture.poll_drop(at("VIEW_3D", "WINDOW"))
    assert not MIRRORSCAN_FH_capture.poll_drop(at("IMAGE_EDITOR", "WINDOW"))
    # a picture dropped into the viewport stays what it is in every Blender: a reference image
    assert not MIRRORSCAN_FH_picture.poll_drop(at("VIEW_3D", "WINDOW"))
    assert MIRRORSCAN_FH_picture.poll_drop(at("VIEW_3D", "UI"))


# --- mirrors ------------------------------------------------------------------------------------------------------


def truth_of(scan) -> dict:
    return {mirror["name"]: mirror for mirror in json.loads((scan[0] / "truth" / "rig.json").read_text())["mirrors"]}


def planes_of(bpy) -> dict:
    from mirror_scan.mirror_scan_addon.scene.scan_records import plane_of

    return {item.name: plane_of(item) for item in settings_of(bpy).mirrors}


def assert_true(bpy, scan, names=("left", "right")):
    truth, planes = truth_of(scan), planes_of(bpy)
    for name in names:
        normal = np.array(truth[name]["normal"])
        assert np.degrees(np.arccos(min(1.0, np.dot(normal, planes[name]["normal"])))) < 0.3
        assert abs(np.dot(normal, np.array(planes[name]["point"]) - truth[name]["point"])) < 0.006


def test_the_capture_s_picks_are_fitted(bpy, scan, loaded):
    assert_true(bpy, scan)
    from mirror_scan.mirror_scan_addon.scene import point_cloud

    seen = point_cloud.values(loaded.data, point_cloud.SEEN, np.int8)
    assert set(np.unique(seen)) >= {0, 1, 2}


def test_mirrors_are_found_without_picks(bpy, scan, loaded):
    bpy.ops.mirror_scan.clear_mirrors()
    assert len(settings_of(bpy).mirrors) == 0
    assert bpy.ops.mirror_scan.find_mirrors() == {"FINISHED"}
    assert sorted(item.name for item in settings_of(bpy).mirrors) == ["left", "right"]
    assert {item.source for item in settings_of(bpy).mirrors} == {"found"}
    assert_true(bpy, scan)


def test_a_mirror_is_set_by_pixels_by_places_and_by_its_plane(bpy, scan, loaded):
    from mirror_scan.mirror_scan_addon.scene import point_cloud

    settings = settings_of(bpy)
    picks = [list(pick.pixel) for pick in settings.mirrors[0].picks]
    bpy.ops.mirror_scan.clear_mirrors()
    assert bpy.ops.mirror_scan.set_mirror(index=0, points=str(picks), name="right") == {"FINISHED"}
    assert_true(bpy, scan, ["right"])
    # the same points as places in the world
    arrays = point_cloud.read_cloud(loaded)
    order = {int(pixel): k for k, pixel in enumerate(arrays.pixel)}
    matrix = np.array(loaded.matrix_world)
    rows = [order.get(round(v) * 640 + round(u)) for u, v in picks]
    places = [matrix[:3, :3] @ arrays.points[k] + matrix[:3, 3] for k in rows if k is not None]
    bpy.ops.mirror_scan.set_mirror(index=0, points=str([list(map(float, place)) for place in places]))
    assert_true(bpy, scan, ["right"]) and len(settings.mirrors[0].picks) == len(places)
    left = truth_of(scan)["left"]
    bpy.ops.mirror_scan.set_mirror(name="left", point=left["point"], normal=left["normal"])
    assert [item.source for item in settings.mirrors] == ["picked", "given"] and settings.mirror_index == 1
    assert_true(bpy, scan)
    bpy.ops.mirror_scan.remove_mirror(index=0)
    assert [item.name for item in settings.mirrors] == ["left"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"points": "[[1, 2], [3, 4]]"}, "too few for a plane"),
        ({"points": "[[1, 2], [3, 4], [5, 60000]]"}, "outside the 640×576"),
        ({"points": "[[100, 20], [320, 20], [540, 20]]"}, "depth reading|one line"),
        ({"points": "import os"}, "give a list such as"),
        ({"points": "[1, 2, 3]"}, "give a list such as"),
        ({"points": "[[1, 2], [3]]"}, "pairs of pixels"),
        ({"points": "[[1, 2], [3, float('nan')]]"}, "give a list such as"),
        ({}, "Give points"),
        ({"index": 7, "points": "[[1, 2]]"}, "too large"),
    ],
)
def test_what_is_no_mirror_is_refused_and_nothing_changes(bpy, loaded, options, words):
    from mirror_scan.mirror_scan_addon.scene.scan_records import records_of

    before = records_of(settings_of(bpy))
    with pytest.raises(RuntimeError, match=words) as caught:
        bpy.ops.mirror_scan.set_mirror(**options)
    assert "Traceback" not in str(caught.value)
    assert records_of(settings_of(bpy)) == before


def test_mirrors_are_written_for_the_next_capture(bpy, scan, loaded, tmp_path):
    from mirror_scan.core.capture.folders.rgbd_folder import read_mirrors

    left = truth_of(scan)["left"]
    bpy.ops.mirror_scan.set_mirror(index=1, point=left["point"], normal=left["normal"])
    file = tmp_path / "mirrors.json"
    assert bpy.ops.mirror_scan.save_mirrors(filepath=str(file)) == {"FINISHED"}
    right, left = read_mirrors(file, None)
    assert right.name == "right" and len(right.frame_pixels) == 8 and left.frame_pixels is None
    bpy.ops.mirror_scan.load_capture(filepath=str(scan[0]), mirrors_filepath=str(file))
    assert [item.source for item in settings_of(bpy).mirrors] == ["picked", "given"]
    with pytest.raises(RuntimeError, match="Error: .*does not exist"):
        bpy.ops.mirror_scan.save_mirrors(filepath=str(tmp_path / "no" / "mirrors.json"))


def test_a_rig_is_calibrated_once_and_used_again(bpy, scan, loaded, tmp_path, capfd):
    file = tmp_path / "rig.json"
    assert bpy.ops.mirror_scan.calibrate_rig(filepath=str(file)) == {"FINISHED"}
    assert [mirror["name"] for mirror in json.loads(file.read_text())["mirrors"]] == ["right", "left"]
    bpy.ops.mirror_scan.clear_mirrors()
    capfd.readouterr()
    assert bpy.ops.mirror_scan.use_rig(filepath=str(file)) == {"FINISHED"}
    assert "moved" not in reports(bpy, capfd)
    assert {item.source for item in settings_of(bpy).mirrors} == {"rig file"}
    assert_true(bpy, scan)
    # found when there are none yet
    bpy.ops.mirror_scan.clear_mirrors()
    assert bpy.ops.mirror_scan.calibrate_rig(filepath=str(file)) == {"FINISHED"}
    assert_true(bpy, scan)
    content = json.loads(file.read_text())
    content["mirrors"][0]["point"][2] += 0.05
    file.write_text(json.dumps(content))
    bpy.ops.mirror_scan.use_rig(filepath=str(file))
    assert "Warning: " in (said := reports(bpy, capfd)) and "has moved since it was calibrated" in said
    content["intrinsics"]["width"] += 1
    file.write_text(json.dumps(content))
    before = len(settings_of(bpy).mirrors)
    for path, words in ((file, "calibrated at"), (tmp_path, "is a folder"), (tmp_path / "no.json", "cannot be read")):
        with pytest.raises(RuntimeError, match=f"Error: .*{words}"):
            bpy.ops.mirror_scan.use_rig(filepath=str(path))
    with pytest.raises(RuntimeError, match="Error: .*does not exist"):
        bpy.ops.mirror_scan.calibrate_rig(filepath=str(tmp_path / "no" / "rig.json"))
    assert len(settings_of(bpy).mirrors) == before


# --- subject and avatar -------------------------------------------------------------------------------------------


def test_sliders_move_the_colours_at_once(bpy, scan, loaded):
    from mirror_scan.core.preview.palette import PART_PALETTE
    from mirror_scan.mirror_scan_addon.interface.overlay import cloud_arrays, cloud_key

    bpy.ops.mirror_scan.find_subject()
    settings = settings_of(bpy)
    assert settings.cloud_colors == "PART" and "direct" in settings.subject.message

    def share(part):
        return (cloud_arrays(loaded, settings)[1][:, :3] == PART_PALETTE[part]).all(axis=1).mean()

    person, floor = share(2), share(1)
    assert 0.02 < person < 0.3 and floor > 0.05 and share(3) == 0
    key = cloud_key(loaded, settings)
    settings.subject.floor_clearance = 0.5
    assert cloud_key(loaded, settings) != key
    assert share(2) < 0.95 * person and share(1) > floor
    settings.subject.max_height = 1.0
    assert share(2) < 0.7 * person
    settings.subject.depth_limit = 2.0
    assert share(3) > 0.3


def test_the_person_is_who_was_clicked(bpy, scan, loaded):
    from mirror_scan.mirror_scan_addon.scene import point_cloud

    subject = settings_of(bpy).subject
    bpy.ops.mirror_scan.find_subject()
    width = point_cloud.read_cloud(loaded).intrinsics.width
    pixels = point_cloud.read_cloud(loaded).pixel
    found = point_cloud.values(loaded.data, point_cloud.VIEW, np.int8)
    v, u = np.median(np.divmod(pixels[found == 0], width), axis=1)
    assert bpy.ops.mirror_scan.pick_subject(pixel=(u, v)) == {"FINISHED"}
    assert subject.clicked and subject.stale
    bpy.ops.mirror_scan.find_subject()
    assert (point_cloud.values(loaded.data, point_cloud.VIEW, np.int8) == found).mean() > 0.999 and not subject.stale
    assert bpy.ops.mirror_scan.build_avatar() == {"FINISHED"}
    # on the wall behind nobody stands
    u, v = next(divmod(int(p), width)[::-1] for p in pixels[found == -1] if p // width < 60)
    bpy.ops.mirror_scan.pick_subject(pixel=(u, v))
    with pytest.raises(RuntimeError, match="Error: .*click"):
        bpy.ops.mirror_scan.find_subject()
    with pytest.raises(RuntimeError, match="Error: pixel: give a column from 0 to 639"):
        bpy.ops.mirror_scan.pick_subject(pixel=(640, 3))
    bpy.ops.mirror_scan.load_capture(filepath=str(scan[0]))
    assert not subject.clicked


def turn_until_done(live, scene, limit=120.0):
    """What Blender's timers do in a window; the longest turn [ms], apart from the one that starts a process."""
    import time

    live._wanted.add(scene.session_uid)
    longest, deadline = 0.0, time.monotonic() + limit
    while True:
        begins = live._search is None
        start = time.perf_counter()
        pause = live._turn()
        if not begins:
            longest = max(longest, 1000 * (time.perf_counter() - start))
        if pause is None:
            return longest
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_what_the_search_goes_by_is_searched_for_again_by_itself(bpy, loaded):
    from mirror_scan.mirror_scan_addon.scene import live_subject, point_cloud

    bpy.ops.mirror_scan.find_subject()
    scene, subject = bpy.context.scene, settings_of(bpy).subject
    assert not subject.stale
    found, place = point_cloud.values(loaded.data, point_cloud.VIEW, np.int8), loaded.matrix_world.copy()
    subject.reach, subject.depth_limit = 0.9, 3.0  # the mirrors show the person from beyond that
    assert subject.stale
    turn_until_done(live_subject, scene)
    assert not subject.stale and not subject.problem and not live_subject.searching(scene)
    near = point_cloud.values(loaded.data, point_cloud.VIEW, np.int8)
    assert (near == 0).any() and not (near > 0).any() and (near[near == 0] == found[near == 0]).all()
    assert loaded.matrix_world == place
    subject.reach, subject.depth_limit = 1.15, 0.0
    assert turn_until_done(live_subject, scene) < 150
    assert (point_cloud.values(loaded.data, point_cloud.VIEW, np.int8) == found).all()
    subject.depth_limit = 0.6  # nobody is there
    turn_until_done(live_subject, scene)
    assert subject.problem and not subject.message and not subject.stale
    assert (point_cloud.values(loaded.data, point_cloud.VIEW, np.int8) < 0).all()
    subject.depth_limit = 0.0
    turn_until_done(live_subject, scene)
    assert not subject.problem and (point_cloud.values(loaded.data, point_cloud.VIEW, np.int8) == found).all()


def test_a_setting_that_moves_before_the_first_search_makes_one(bpy, loaded):
    from mirror_scan.mirror_scan_addon.scene import live_subject

    settings = settings_of(bpy)
    settings.subject.object = True
    turn_until_done(live_subject, bpy.context.scene)
    assert settings.cloud_colors == "PART" and "direct" in settings.subject.message and not settings.subject.stale


def test_a_live_search_drops_what_is_not_true_any_more(bpy, loaded):
    from mirror_scan.mirror_scan_addon.scene import live_subject

    scene, settings = bpy.context.scene, settings_of(bpy)
    for change in ("clear", "delete"):
        if change == "delete":
            bpy.ops.mirror_scan.find_mirrors()
        live_subject._wanted.add(scene.session_uid)
        live_subject._turn()
        assert live_subject.searching(scene)
        if change == "clear":
            bpy.ops.mirror_scan.clear_mirrors()
        elif change == "delete":
            bpy.data.objects.remove(settings.cloud)
        turn_until_done(live_subject, scene)
        assert not settings.subject.message and not live_subject.searching(scene)


def test_folding_lays_the_mirrored_body_onto_the_person(bpy, loaded):
    from mirror_scan.mirror_scan_addon.interface.overlay import cloud_arrays
    from mirror_scan.mirror_scan_addon.scene import point_cloud

    bpy.ops.mirror_scan.find_subject()
    settings = settings_of(bpy)
    view = point_cloud.values(loaded.data, point_cloud.VIEW, np.int8)
    direct = cloud_arrays(loaded, settings)[0][view == 0].mean(axis=0)
    apart = cloud_arrays(loaded, settings)[0][view == 1].mean(axis=0)
    settings.fold = True
    folded = cloud_arrays(loaded, settings)[0][view == 1].mean(axis=0)
    assert np.linalg.norm(apart - direct) > 1.0 and np.linalg.norm(folded - direct) < 0.3
    reflected, colors = cloud_arrays(loaded, settings, only_reflected=True)
    assert len(reflected) == len(colors) < len(loaded.data.vertices)


def test_the_avatar_coincides_with_its_points(bpy, loaded):
    bpy.ops.mirror_scan.find_subject()
    assert bpy.ops.mirror_scan.build_avatar() == {"FINISHED"}
    avatar, settings = bpy.context.object, settings_of(bpy)
    assert not settings.show_cloud
    from mirror_scan.mirror_scan_addon.interface.overlay import cloud_arrays
    from mirror_scan.mirror_scan_addon.scene import point_cloud

    settings.fold = True
    view = point_cloud.values(loaded.data, point_cloud.VIEW, np.int8)
    matrix = np.array(loaded.matrix_world)
    points = cloud_arrays(loaded, settings)[0][view >= 0] @ matrix[:3, :3].T + matrix[:3, 3]
    surface = np.array([vertex.co for vertex in avatar.data.vertices])
    sample = points[::400]
    nearest = np.linalg.norm(sample[:, None] - surface[None], axis=2).min(axis=1)
    assert np.median(nearest) < 0.006
    loaded.location.x += 1.0  # moved by hand: it stays there
    bpy.context.view_layer.update()
    bpy.ops.mirror_scan.build_avatar()
    assert loaded.location.x == pytest.approx(matrix[0, 3] + 1.0, abs=1e-4)


def test_when_the_file_has_moved_the_points_are_enough(bpy, scan, tmp_path, capfd):
    folder = tmp_path / "capture"
    shutil.copytree(scan[0], folder, ignore=shutil.ignore_patterns("truth"))
    bpy.ops.mirror_scan.load_capture(filepath=str(folder))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "work.blend"))
    shutil.rmtree(folder)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "work.blend"))
    assert bpy.ops.mirror_scan.build_avatar() == {"FINISHED"}
    assert "no longer exists" in capfd.readouterr().out
    assert bpy.context.object.dimensions.z == pytest.approx(scan[1], abs=0.03)
    with pytest.raises(RuntimeError, match="Error: .*no such file"):
        bpy.ops.mirror_scan.load_capture()


def test_check_finds_a_hole_and_jumps_to_it(bpy, capsule):
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only
    from mirror_scan.mirror_scan_addon.scene.report_text import avatar_report

    triangles = capsule.triangles.copy()
    centers = capsule.vertices[triangles].mean(axis=1)
    keep = np.linalg.norm(centers - (0, -0.2, 1.0), axis=1) > 0.08
    from dataclasses import replace

    open_one = replace(capsule, triangles=triangles[keep], kind=np.zeros(int(keep.sum()), np.int8))
    avatar = create_avatar(open_one, collection=bpy.context.collection, report={})
    select_only(bpy.context, avatar)
    with pytest.raises(RuntimeError, match="Check the avatar first"):
        bpy.ops.mirror_scan.jump_to_problem()
    assert bpy.ops.mirror_scan.check() == {"FINISHED"}
    report = avatar_report(avatar)
    assert report["mesh"]["watertight"] is False
    hole = report["problems"][0]
    assert hole["kind"] == "hole"
    assert abs(hole["point"][0]) < 0.05 and hole["point"][1] < -0.15 and hole["normal"][1] < -0.9
    assert bpy.ops.mirror_scan.jump_to_problem() == {"FINISHED"}
    assert settings_of(bpy).problem_index == 1
    with pytest.raises(RuntimeError, match="There is no problem number"):
        bpy.ops.mirror_scan.jump_to_problem(direction="NUMBER", number=99)


def test_a_sound_mesh_has_no_problem(bpy, capsule):
    from dataclasses import replace

    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only
    from mirror_scan.mirror_scan_addon.scene.report_text import avatar_report

    sound = replace(capsule, kind=np.zeros(len(capsule.triangles), np.int8))
    avatar = create_avatar(sound, collection=bpy.context.collection)
    select_only(bpy.context, avatar)
    bpy.ops.mirror_scan.check()
    report = avatar_report(avatar)
    assert report["problems"] == [] and report["mesh"]["watertight"]
    assert report["mesh"]["volume_l"] == pytest.approx(1000 * np.pi * 0.2**2 * (1.3 + 4 / 3 * 0.2), rel=0.02)
    with pytest.raises(RuntimeError, match="has no problem"):
        bpy.ops.mirror_scan.jump_to_problem()


def test_a_problem_is_looked_at_with_up_upwards(bpy):
    from mathutils import Vector
    from mirror_scan.mirror_scan_addon.interface.viewport import STEEPEST, upright_look

    front = Vector((0, -1, 0))
    for outward in ((0, 0, -1), (0, 0, 1), (0.001, 0, -1), (0, -1, 0), (0.3, 0.4, -0.9), (-1, 1, 0.2), (0, 0, 0)):
        turned = upright_look(Vector(outward), front)
        right, up, back = (turned @ Vector(axis) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
        assert up.z > 0.3 and abs(right.z) < 1e-6  # never upside down, never aslant
        if any(outward) and abs(Vector(outward).normalized().z) < np.sin(STEEPEST):
            assert (back - Vector(outward).normalized()).length < 1e-5  # straight at it
        elif any(outward):
            assert back.z * outward[2] > 0  # soles from below
    assert (upright_look(Vector((0, 0, -1)), front) @ Vector((0, 0, 1))).y < -0.3  # from the front


def test_swapped_rows_and_columns_of_mirrors_are_told_before_anything_is_built(bpy, scan, tmp_path, capfd):
    from mirror_scan.mirror_scan_addon.scene import scan_records

    entry = json.loads((scan[0] / "mirrors.json").read_text())
    for mirror in entry["mirrors"]:
        mirror["frame_pixels"] = [[v, u] for u, v in mirror["frame_pixels"]]
    file = tmp_path / "mirrors.json"
    file.write_text(json.dumps(entry))
    bpy.ops.mirror_scan.load_capture(filepath=str(scan[0]), mirrors_filepath=str(file))
    mirrors = settings_of(bpy).mirrors
    assert [scan_records.quality_of(item) for item in mirrors] == ["BAD", "BAD"]
    assert all("rows and columns" in scan_records.complaint_of(item) for item in mirrors)
    assert "rows and columns" in capfd.readouterr().out
    assert bpy.ops.mirror_scan.find_mirrors() == {"FINISHED"}  # the cure
    assert [scan_records.quality_of(item) for item in mirrors] == ["GOOD", "GOOD"]
    assert scan_records.quality_word(mirrors[0]) == "good" and "mm" in scan_records.mirror_figures(mirrors[0])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "kept.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "kept.blend"))
    assert [item.quality for item in settings_of(bpy).mirrors] == ["good", "good"]
    assert bpy.ops.mirror_scan.select_mirror(index=1) == {"FINISHED"} and settings_of(bpy).mirror_index == 1


def test_colours_say_what_they_are_asked(bpy, capsule):
    from mirror_scan.core.preview.palette import KIND_PALETTE, MADE, VIEW_PALETTE
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only

    avatar = create_avatar(capsule, collection=bpy.context.collection)
    select_only(bpy.context, avatar)

    def shown():
        attribute = avatar.data.color_attributes.active_color
        rgba = np.empty(4 * len(attribute.data), np.float32)
        attribute.data.foreach_get("color_srgb", rgba)
        return attribute, np.rint(rgba.reshape(-1, 4)[:, :3] * 255).astype(int)

    bpy.ops.mirror_scan.color_by(mode="VIEW")
    attribute, colors = shown()
    assert attribute.domain == "POINT"
    for view in (0, 1, 2):
        assert (colors[capsule.view == view] == VIEW_PALETTE[view]).all()
    assert (colors[capsule.view < 0] == MADE).all()
    bpy.ops.mirror_scan.color_by(mode="KIND")
    attribute, colors = shown()
    assert attribute.domain == "CORNER"
    np.testing.assert_array_equal(colors[::3], np.array(KIND_PALETTE)[capsule.kind])
    node = next(node for node in avatar.data.materials[0].node_tree.nodes if node.type == "VERTEX_COLOR")
    assert (
        node.layer_name
        == attribute.name
        == avatar.data.color_attributes[avatar.data.color_attributes.render_color_index].name
    )
    bpy.ops.mirror_scan.color_by(mode="CAPTURE")
    assert [item.name for item in avatar.data.color_attributes] == ["Color"]
    np.testing.assert_array_equal(shown()[1], capsule.colors)
    avatar.data.attributes.remove(avatar.data.attributes["kind"])
    with pytest.raises(RuntimeError, match="select an avatar that Mirror Scan built"):
        bpy.ops.mirror_scan.color_by(mode="KIND")


COMPANIONS = {"obj": ["out.mtl", "out.png"], "usdc": ["textures"], "gltf": ["out.bin"]}


@pytest.mark.parametrize("ending", ["glb", "gltf", "fbx", "obj", "ply", "stl", "3mf", "usdc", "abc", "blend"])
def test_every_format_is_written_and_nothing_else_changes(bpy, capsule, tmp_path, ending):
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only

    avatar = create_avatar(capsule, collection=bpy.context.collection)
    other = create_avatar(capsule, name="Other", collection=bpy.context.collection)
    select_only(bpy.context, avatar)
    other.select_set(True)
    before = count(bpy)
    file = tmp_path / f"out.{ending}"
    assert bpy.ops.mirror_scan.export_avatar(filepath=str(file)) == {"FINISHED"}
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([file.name, *COMPANIONS.get(ending, ())])
    assert count(bpy) == before and bpy.context.object == avatar and other.select_get()
    if ending in ("ply", "obj", "stl"):
        from mirror_scan.core.io import read_mesh

        assert len(read_mesh(file).triangles) == len(capsule.triangles)  # the avatar alone, whole
    if ending == "blend":
        with bpy.data.libraries.load(str(file)) as (there, _):
            assert there.objects == ["Avatar"]


def test_a_click_writes_into_the_folder_that_was_chosen(bpy, capsule, tmp_path):
    from types import SimpleNamespace

    from mirror_scan.mirror_scan_addon.operators.export_avatar import MIRRORSCAN_OT_export_avatar as Export
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only

    select_only(bpy.context, create_avatar(capsule, collection=bpy.context.collection))
    said = []
    kind = bpy.ops.mirror_scan.export_avatar.get_rna_type()

    class Button(SimpleNamespace):
        bl_idname = Export.bl_idname

    button = Button(
        filepath="", format="PLY", colors="CAPTURE", _ending=lambda: ".ply",
        report=lambda kind, text: said.append((kind, text)),
        properties=SimpleNamespace(is_property_set=lambda name: name == "format", format="PLY", bl_rna=kind),
        bl_rna=kind,
    )  # fmt: skip
    button.execute = lambda context: Export.execute(button, context)
    settings_of(bpy).export_folder = str(tmp_path)
    assert Export.invoke(button, bpy.context, None) == {"FINISHED"} and (tmp_path / "Avatar.ply").is_file()
    button.filepath, settings_of(bpy).export_folder = "", "//avatars"  # of a .blend that is not saved
    assert Export.invoke(button, bpy.context, None) == {"CANCELLED"} and "save it first" in said[-1][1]


def test_a_format_unknown_or_a_folder_missing_is_told(bpy, capsule, tmp_path):
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only

    select_only(bpy.context, create_avatar(capsule, collection=bpy.context.collection))
    for path, words in (("x.doc", "not one of the formats"), ("no/x.ply", "does not exist"), ("", "Enter the name")):
        with pytest.raises(RuntimeError, match=words):
            bpy.ops.mirror_scan.export_avatar(filepath=str(tmp_path / path) if path else "")
    assert bpy.ops.mirror_scan.export_avatar(filepath=str(tmp_path / "named"), format="PLY") == {"FINISHED"}
    assert [path.name for path in tmp_path.iterdir()] == ["named.ply"]
    bpy.ops.mirror_scan.export_avatar(filepath=str(tmp_path), format="PLY")  # a folder: under the avatar's name
    assert (tmp_path / "Avatar.ply").is_file()


# --- virtual rig --------------------------------------------------------------------------------------------------


def test_a_rig_of_objects_is_the_rig_they_came_from(bpy):
    from mirror_scan.core.simulation.scene import Rig, default_rig
    from mirror_scan.mirror_scan_addon.scene import virtual_rig

    wanted = default_rig(roll_deg=3.0, tilt_deg=5.0, lean_deg=2.0)
    virtual_rig.add_objects(bpy.context.scene, wanted)
    bpy.context.view_layer.update()
    got = Rig(wanted.intrinsics, mirrors=(), **virtual_rig.camera_of(bpy.context.scene.camera))
    np.testing.assert_allclose(got.camera_to_avatar, wanted.camera_to_avatar, atol=1e-5)
    mirrors = virtual_rig.mirrors_of(bpy.context.scene)
    for mine, true in zip(sorted(mirrors, key=lambda m: m["name"]), sorted(wanted.mirrors, key=lambda m: m.name),
                          strict=True):  # fmt: skip
        assert mine["name"] == true.name
        np.testing.assert_allclose(mine["centre"], true.centre, atol=1e-5)
        np.testing.assert_allclose(mine["normal"], true.axes[2], atol=1e-5)
        np.testing.assert_allclose((mine["width"], mine["height"]), (true.width, true.height), rtol=1e-5)
    camera = bpy.context.scene.camera
    angle = 2 * np.arctan(wanted.intrinsics.width / 2 / wanted.intrinsics.fx)
    assert camera.data.angle_x == pytest.approx(angle, rel=1e-5)


def test_a_virtual_scan_shows_coverage_and_can_be_built(bpy, tmp_path):
    from mirror_scan.core.simulation.mannequin import mannequin
    from mirror_scan.mirror_scan_addon.scene.avatar_objects import create_avatar, select_only

    person = mannequin()
    body = create_avatar(person, name="Body", collection=bpy.context.collection)
    bpy.ops.mirror_scan.add_rig()
    select_only(bpy.context, body)
    assert bpy.ops.mirror_scan.simulate(frames=2, sensor="azure_kinect") == {"FINISHED"}
    settings = settings_of(bpy)
    share = float(settings.rig_message.split("sees ")[1].split("%")[0])
    assert 80 < share < 99 and len(settings.mirrors) == 2 and settings.capture_path == ""
    assert body.data.color_attributes.active_color.name == "Coverage"
    assert bpy.ops.mirror_scan.build_avatar() == {"FINISHED"}
    avatar = bpy.context.object
    assert avatar != body and avatar.dimensions.z == pytest.approx(np.ptp(person.vertices[:, 2]), abs=0.03)
    # one mirror hidden: less is seen
    next(item for item in bpy.data.objects if item.name == "Mirror left").hide_render = True
    select_only(bpy.context, body)
    bpy.ops.mirror_scan.simulate(frames=1, filepath=str(tmp_path / "scan"))
    less = float(settings.rig_message.split("sees ")[1].split("%")[0])
    assert less < share - 15 and (tmp_path / "scan" / "mirrors.json").is_file()
    assert settings.capture_path == str(tmp_path / "scan")


def test_without_a_body_the_mannequin_is_scanned_and_bad_rigs_are_told(bpy):
    bpy.ops.mirror_scan.simulate(frames=1)
    assert len(settings_of(bpy).mirrors) == 2
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.mirror_scan.is_mirror = True
    with pytest.raises(RuntimeError, match="not flat|no camera"):
        bpy.ops.mirror_scan.simulate(frames=1)
    bpy.ops.object.delete()
    bpy.ops.mesh.primitive_plane_add()
    bpy.context.object.mirror_scan.is_mirror = True
    with pytest.raises(RuntimeError, match="no camera"):
        bpy.ops.mirror_scan.simulate(frames=1)


# --- the file remembers -------------------------------------------------------------------------------------------


def whole_state(bpy) -> dict:
    from mirror_scan.mirror_scan_addon.scene.point_cloud import read_cloud
    from mirror_scan.mirror_scan_addon.scene.scan_records import build_settings, records_of

    settings = settings_of(bpy)
    cloud = settings.cloud
    arrays = read_cloud(cloud)
    return {
        "mirrors": records_of(settings),
        "settings": build_settings(settings),
        "points": arrays.points.tobytes(),
        "attributes": sorted(item.name for item in cloud.data.attributes),
        "images": (settings.color_image.name, settings.depth_image.name),
        "message": settings.subject.message,
    }


@pytest.fixture
def worked(bpy, loaded):
    bpy.ops.mirror_scan.find_subject()
    settings = settings_of(bpy)
    settings.subject.depth_limit = 7.5
    settings.quality.preset = "SMOOTH"
    return loaded


def test_saving_and_opening_keeps_all(bpy, worked, tmp_path):
    before = whole_state(bpy)
    assert before["settings"]["depth"]["smoothing"] == pytest.approx(1.6)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "work.blend"))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert settings_of(bpy).cloud is None
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "work.blend"))
    assert whole_state(bpy) == before
    assert bpy.ops.mirror_scan.find_subject() == {"FINISHED"}


def test_undo_and_redo_walk_through_the_steps(bpy, scan):
    def step(call, **options):
        assert call(**options) == {"FINISHED"}
        bpy.ops.ed.undo_push(message="step")
        return whole_state(bpy)

    bpy.ops.ed.undo_push(message="start")
    states = [step(bpy.ops.mirror_scan.load_capture, filepath=str(scan[0])), step(bpy.ops.mirror_scan.find_mirrors),
              step(bpy.ops.mirror_scan.find_subject)]  # fmt: skip
    assert states[0]["mirrors"] != states[1]["mirrors"]
    bpy.ops.ed.undo()
    assert whole_state(bpy) == states[1]
    bpy.ops.ed.undo()
    assert whole_state(bpy) == states[0]
    bpy.ops.ed.redo()
    bpy.ops.ed.redo()
    assert whole_state(bpy) == states[2]
    for _ in range(3):
        bpy.ops.ed.undo()
    assert settings_of(bpy).cloud is None and len(settings_of(bpy).mirrors) == 0
    assert count(bpy)["objects"] == count(bpy)["meshes"] == count(bpy)["images"] == 0


def test_a_copied_scene_has_a_scan_of_its_own(bpy, worked):
    before = whole_state(bpy)
    bpy.ops.scene.new(type="FULL_COPY")
    copy = bpy.context.scene
    assert copy.mirror_scan.cloud is not None and copy.mirror_scan.cloud != worked
    assert whole_state(bpy)["mirrors"] == before["mirrors"]
    bpy.ops.mirror_scan.clear_mirrors()
    bpy.context.window.scene = next(scene for scene in bpy.data.scenes if scene != copy)
    assert whole_state(bpy)["mirrors"] == before["mirrors"]


def test_a_linked_scan_is_shown_but_not_changed(bpy, worked, tmp_path):
    library = str(tmp_path / "library.blend")
    bpy.context.scene.name = "Linked"
    bpy.ops.wm.save_as_mainfile(filepath=library)
    before = whole_state(bpy)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(library, link=True) as (there, here):
        here.scenes = there.scenes
    bpy.context.window.scene = bpy.data.scenes["Linked"]
    after = whole_state(bpy)
    assert after["points"] == before["points"] and after["mirrors"] == before["mirrors"]
    for operator in ("load_capture", "find_mirrors", "find_subject", "build_avatar", "clear_mirrors", "simulate"):
        with pytest.raises(RuntimeError, match="linked from another file"):
            getattr(bpy.ops.mirror_scan, operator)()


def test_presets_set_what_they_say_and_notice_when_left(bpy):
    from mirror_scan.mirror_scan_addon.scene.properties import QUALITY

    quality = settings_of(bpy).quality
    assert quality.preset == "BALANCED"
    for preset, values in QUALITY.items():
        quality.preset = preset
        assert quality.preset == preset
        for name, value in values.items():
            assert getattr(quality, name) == pytest.approx(value)
    quality.smoothing = 0.123
    assert quality.preset == "CUSTOM"
    for name, value in QUALITY["FINE"].items():
        setattr(quality, name, value)
    assert quality.preset == "FINE"
